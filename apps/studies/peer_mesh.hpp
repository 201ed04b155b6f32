#pragma once

#include "apps/run/record.hpp"
#include "io/element_files.hpp"

namespace dimple {

/// Each file says so in a comment near its beginning.
inline constexpr const char* written_by = "written by dimple";

/// The scene of `config` as a finite-element model: the surface, base and circle that `dimple run` finds,
/// filled with elements that are graded towards the circle's rim. `format`: calculix or febio. `elements`:
/// hexahedra (20 nodes for CalculiX; 8 for FEBio, whose mixed elements these are) or tetrahedra (10 nodes).
/// Throws what they throw, and UsageError for what these programs are not given: several tissues, Ogden,
/// viscoelastic.
ElementModel element_model(const Config& config, const std::string& format, const std::string& elements,
                           const RunObserver& observer = {});

/// Writes it. `format` may be empty: from the file's name (.inp, .feb). Throws UsageError.
Outcome export_model(const Config& config, const std::string& format, const std::string& elements,
                     const std::filesystem::path& file, const RunObserver& observer = {});

}  // namespace dimple
