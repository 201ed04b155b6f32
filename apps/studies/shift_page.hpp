#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "apps/run/images.hpp"
#include "apps/studies/shift_run.hpp"

namespace dimple {

// What of a shift is for people: a picture of it, and what report.html shows beside the summary.

/// Three planes through a place below the opening, before and after: of the first image that is warped, or of
/// the labels, as `written` into the folder. The bytes of a PNG. `told`: says of which, in a sentence. Throws
/// InputError.
std::string before_and_after(const Shifted& now, const ShiftScene& asked, const Scene& scene,
                             const ImageTask& written, const std::filesystem::path& folder,
                             const std::string& title, std::string& told);

/// `options`: config.resolved.toml; `command`: what repeats it; `picture`: of before_and_after().
nlohmann::ordered_json page_of_shift(Shifted& now, const ShiftScene& asked, const Scene& scene,
                                     const std::string& options, const std::string& command,
                                     const std::string& picture);

}  // namespace dimple
