#pragma once

#include <string>
#include <vector>

#include "apps/scene/scene.hpp"
#include "preprocess/surface/cut.hpp"
#include "preprocess/surface/label_surface.hpp"

namespace dimple {

/// Of sheets from files that are so small beside the body that they may have been drawn in other units.
std::vector<std::string> warnings_of_small_sheets(const Scene& scene, const BodySurface& body);
/// The labels that are taken out, by number or name.
std::vector<std::string> labels_cut_out(const Cut& cut);
std::vector<std::string> labels_cut_out_at_rest(const Scene& scene);
/// What the blades sweep, in the body's own frame, in triangles of `step` [mm] where nobody drew them. Throws
/// ModelError: no way into the body.
std::vector<TriangleMesh> blades_of(const Cut& cut, const BodySurface& body, double step);
/// What an edge sweeps from place to place [mm, of the body's own frame], straight into the surface there.
/// Throws ModelError: no one way into the body along it; `text`, `where`: what is then said to be wrong.
TriangleMesh line_blade(const Vec3& x, const Vec3& y, double depth, const BodySurface& body, double step,
                        const std::string& text, const std::string& where);
/// Of all cuts at rest.
std::vector<TriangleMesh> blades_of(const Scene& scene, const SegmentedBody& body);

}  // namespace dimple
