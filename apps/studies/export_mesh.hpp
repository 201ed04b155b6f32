#pragma once

#include "apps/run/record.hpp"
#include "io/element_files.hpp"

namespace dimple {

/// Each file says so in a comment near its beginning.
inline constexpr const char* written_by = "written by dimple";

/// The scene of `scene` as a finite-element model: the surface, base and circle that `dimple run` finds,
/// filled with ten-node tetrahedra that are graded towards the circle's rim. Throws what they throw, and
/// UsageError for what other programs are not given: several tissues, Ogden, viscoelastic.
ElementModel element_model(const Scene& scene, const RunObserver& observer);

/// Writes it. `format` may be empty: from the file's name (.inp, .feb). Throws UsageError.
Outcome export_model(const Scene& scene, const std::string& format, const std::filesystem::path& file,
                     const RunObserver& observer = {});

}  // namespace dimple
