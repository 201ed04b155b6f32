#pragma once

#include "apps/pipeline.hpp"
#include "io/element_files.hpp"

namespace dimple {

/// The scene of `config` as a finite-element model: the surface, base and circle that `dimple run` finds,
/// filled with tetrahedra that are graded towards the circle's rim in the same way. Throws what they throw,
/// and UsageError for what these programs are not given: several tissues, Ogden, viscoelastic.
ElementModel element_model(const Config& config);

/// Writes it. `format`: calculix or febio, or empty: from the file's name (.inp, .feb). Throws UsageError.
Outcome export_model(const Config& config, const std::string& format, const std::filesystem::path& file);

}  // namespace dimple
