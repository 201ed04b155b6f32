#pragma once

#include <string>
#include <vector>

#include "apps/run/config.hpp"
#include "preprocess/surface/cut.hpp"
#include "preprocess/surface/label_surface.hpp"

namespace dimple {

/// --cut: what is cut, or taken out, before the load. Several are separated by semicolons.
///
///     plane:x,y,z,nx,ny,nz              a plane through a place, with its normal: LPS, mm
///     plane:x,y,z,nx,ny,nz,radius=20mm  a disc of it
///     line:x,y,z,x,y,z,depth=15mm       an edge's way from place to place, straight into the surface there
///     FILE.stl, .obj, .vtp              a sheet that was drawn: LPS, mm; a closed one is taken out whole
///     label:NAME                        the voxels of a label are taken out
///
/// A cut at rest is that, or of a step of the scene before anything has moved.
struct CutText {
  std::string text;
  std::string where;  ///< the option
};
std::vector<CutText> cuts_at_rest(const Config& config);
CutText cut_of_step(const std::string& name, const std::string& text);
bool has_cuts(const Config& config);  ///< at rest
/// Of all steps too. Throws UsageError: a word, number or unit that is none, or a cut no longer or deeper
/// than its gap; InputError of a file.
void check_cuts(const Config& config);
/// Of sheets from files that are so small beside the body that they may have been drawn in other units.
std::vector<std::string> warnings_of_small_sheets(const Config& config, const BodySurface& body);
/// The labels that are taken out, by number or name.
std::vector<std::string> labels_cut_out(const CutText& cut);
std::vector<std::string> labels_cut_out_at_rest(const Config& config);
/// What the blades sweep, in the body's own frame, in triangles of `step` [mm] where nobody drew them. Throws
/// as check_cuts(); ModelError: no way into the body.
std::vector<TriangleMesh> blades_of(const CutText& cut, const BodySurface& body, double step);
/// What an edge sweeps from place to place [mm, of the body's own frame], straight into the surface there.
/// Throws ModelError: no one way into the body along it; `text`, `where`: what is then said to be wrong.
TriangleMesh line_blade(const Vec3& x, const Vec3& y, double depth, const BodySurface& body, double step,
                        const std::string& text, const std::string& where);
/// Of all cuts at rest.
std::vector<TriangleMesh> blades_of(const Config& config, const SegmentedBody& body);

}  // namespace dimple
