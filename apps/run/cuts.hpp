#pragma once

#include <string>
#include <vector>

#include "apps/scene/scene.hpp"
#include "preprocess/surface/cut.hpp"
#include "preprocess/surface/label_surface.hpp"

namespace dimple {

/// Warnings of sheets from files so small compared with the body that their unit may be another one.
std::vector<std::string> warnings_of_small_sheets(const Scene& scene, const BodySurface& body);
/// Labels that a cut removes, by number or name.
std::vector<std::string> labels_cut_out(const Cut& cut);
std::vector<std::string> labels_cut_out_of_undeformed_body(const Scene& scene);
/// Sheets that the blades of a cut sweep, in the body frame; triangles of `step` [mm] unless drawn in a file.
/// Throws ModelError: no direction into the body.
std::vector<TriangleMesh> blades_of(const Cut& cut, const BodySurface& body, double step);
/// Sheet that an edge sweeps from x to y [mm, body frame], normal to the surface. Throws ModelError: no
/// single direction into the body; `text`, `where`: the cut and its option in the message.
TriangleMesh line_blade(const Vec3& x, const Vec3& y, double depth, const BodySurface& body, double step,
                        const std::string& text, const std::string& where);
/// Sheets of all cuts at rest.
std::vector<TriangleMesh> blades_of(const Scene& scene, const SegmentedBody& body);

}  // namespace dimple
