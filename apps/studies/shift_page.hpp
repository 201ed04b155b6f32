#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "apps/run/images.hpp"
#include "apps/studies/shift_run.hpp"

namespace dimple {

// Presentation of a shift: a picture, and what report.html shows next to the summary.

/// PNG of three planes through a point below the opening, before and after: of the first warped image, or of
/// the labels, as `written` into the folder. `reported`: a sentence that names the image. Throws InputError.
std::string before_and_after(const Shifted& now, const ShiftScene& requested, const Scene& scene,
                             const ImageTask& written, const std::filesystem::path& folder,
                             const std::string& title, std::string& reported);

/// Data of report.html. `options`: config.resolved.toml; `command`: repeats the run; `picture`: of
/// before_and_after().
nlohmann::ordered_json page_of_shift(Shifted& now, const ShiftScene& requested, const Scene& scene,
                                     const std::string& options, const std::string& command,
                                     const std::string& picture);

}  // namespace dimple
