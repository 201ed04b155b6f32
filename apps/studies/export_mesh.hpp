#pragma once

#include "apps/run/record.hpp"
#include "io/element_files.hpp"

namespace dimple {

/// Comment near the beginning of each exported file.
inline constexpr const char* written_by = "written by dimple";

/// Finite-element model of a scene: the surface, base and bonded patch that `dimple run` finds, filled with
/// ten-node tetrahedra that are graded towards the edge of the patch. Throws what these throw, and UsageError
/// for features that are not exported: several tissues, Ogden, viscoelastic.
ElementModel element_model(const Scene& scene, const RunObserver& observer);

/// Writes the model. An empty `format` follows from the file's name (.inp, .feb). Throws UsageError.
Outcome export_model(const Scene& scene, const std::string& format, const std::filesystem::path& file,
                     const RunObserver& observer = {});

}  // namespace dimple
