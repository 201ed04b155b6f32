#pragma once

#include <functional>

#include "apps/run/record.hpp"
#include "io/element_files.hpp"

namespace dimple {

/// Each file says so in a comment near its beginning.
inline constexpr const char* written_by = "written by dimple";

/// A body filled with elements.
struct ElementMesh {
  ElementModel model;  ///< nodes, elements, base and circle only, in the surface's frame
  const char* elements = "tetrahedra";
  double spacing_mm = 0.0, rim = 1.0;  ///< edges far from the circle; those at its rim, as a part of them
  double volume_mm3 = 0.0;
};
using FillBody = std::function<ElementMesh(const Scene&, const BodySurface&, const Boundary&, ModelOptions)>;

/// The scene of `scene` as a finite-element model: the surface, base and circle that `dimple run` finds,
/// filled with ten-node tetrahedra that are graded towards the circle's rim, or by `fill`. Throws what they
/// throw, and UsageError for what other programs are not given: several tissues, Ogden, viscoelastic.
ElementModel element_model(const Scene& scene, const RunObserver& observer, const FillBody& fill = {});

/// Writes it. `format` may be empty: from the file's name (.inp, .feb). Throws UsageError.
Outcome export_model(const Scene& scene, const std::string& format, const std::filesystem::path& file,
                     const RunObserver& observer = {});

}  // namespace dimple
