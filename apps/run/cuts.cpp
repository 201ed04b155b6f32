#include "apps/run/cuts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "apps/run/words.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

// Largest number of rings of a whole plane: Ctrl-C does not stop CGAL, and a lung took 12 s with 214 rings.
constexpr double most_rings = 60.0;

}  // namespace

std::vector<std::string> warnings_of_small_sheets(const Scene& scene, const BodySurface& body) {
  constexpr double small = 1.0 / 16.0;  // of the body; one of the body's size, drawn in cm, has a tenth
  const double whole = (body.upper() - body.lower()).maxCoeff();
  std::vector<Cut> all = cuts_of_undeformed_body(scene);
  for (CutStep& step : cuts_after_moves(scene)) all.push_back(std::move(step.cut));
  std::vector<std::string> warnings;
  for (const Cut& cut : all)
    for (const Blade& blade : cut.blades)
      if (const double size = blade.kind == Blade::Kind::sheet ? size_of(blade.sheet) : whole;
          size < small * whole)
        warnings.push_back(
            fmt::format("the sheet of the cut '{}' is {} long, and the body {}: the file has no units, and "
                        "its numbers are read as mm; scale it if it is in metres, inches or cm",
                        blade.text, length_in_words(size), length_in_words(whole)));
  return warnings;
}

std::vector<std::string> labels_cut_out(const Cut& cut) {
  std::vector<std::string> labels;
  for (const Blade& blade : cut.blades)
    if (blade.kind == Blade::Kind::label) labels.push_back(blade.label);
  return labels;
}

std::vector<std::string> labels_cut_out_of_undeformed_body(const Scene& scene) {
  std::vector<std::string> labels;
  for (const Cut& cut : cuts_of_undeformed_body(scene))
    for (std::string& label : labels_cut_out(cut)) labels.push_back(std::move(label));
  return labels;
}

TriangleMesh line_blade(const Vec3& x, const Vec3& y, double depth, const BodySurface& body, double step,
                        const std::string& text, const std::string& where) {
  const Vec3 along = (y - x).normalized();
  const int places = std::clamp(static_cast<int>((y - x).norm() / step), 2, 1000);
  const auto place = [&](int k) { return Vec3(x + static_cast<double>(k) / places * (y - x)); };
  Vec3 into = Vec3::Zero();
  for (int k = 0; k <= places; ++k) into -= body.normal().col(body.closest(place(k)).triangle) / (places + 1);
  into -= into.dot(along) * along;
  if (!(into.norm() > 0.2))
    throw ModelError(
        {.fact = fmt::format("the direction into the body is not unique along the cut '{}'", text),
         .where = where,
         .why = "the surface near it faces opposite directions, or along it",
         .remedy = "give places on one side of the body, or a plane or sheet instead",
         .code = "cut"});
  into.normalize();
  // The edge starts outside: the surface may bulge beyond the straight line.
  double above = 0.0;
  for (int k = 0; k <= places; ++k) {
    const Vec3 at = place(k);
    if (!body.contains(at)) continue;
    for (const double t : body.crossings(at, -into))
      if (t > 0.0) {
        above = std::max(above, t);
        break;
      }
  }
  return swept_sheet(x, y, into, above + 0.1 * step, depth, step);
}

namespace {

TriangleMesh sheet_of(const Blade& blade, const std::string& where, const BodySurface& body, double step) {
  const Eigen::Isometry3d to_body = body.to_world().inverse();
  const Vec3 place = to_body * blade.first;
  if (blade.kind == Blade::Kind::line)
    return line_blade(place, to_body * blade.second, blade.length, body, step, blade.text, where);
  if (blade.kind == Blade::Kind::sheet) {
    TriangleMesh sheet = blade.sheet;
    sheet.vertex = (to_body * sheet.vertex.colwise().homogeneous()).eval();
    return sheet;
  }
  // A whole plane is a disc whose radius exceeds the body.
  const double all =
      (body.upper() - body.lower()).norm() + (place - 0.5 * (body.upper() + body.lower())).norm();
  const bool is_whole = !(blade.length > 0.0);
  return disc_sheet(place, to_body.linear() * blade.second, is_whole ? all : blade.length,
                    is_whole ? std::max(step, all / most_rings) : step);
}

}  // namespace

std::vector<TriangleMesh> blades_of(const Cut& cut, const BodySurface& body, double step) {
  std::vector<TriangleMesh> sheets;
  for (const Blade& blade : cut.blades)
    if (blade.kind != Blade::Kind::label) sheets.push_back(sheet_of(blade, cut.where, body, step));
  return sheets;
}

std::vector<TriangleMesh> blades_of(const Scene& scene, const SegmentedBody& body) {
  std::vector<TriangleMesh> sheets;
  for (const Cut& cut : cuts_of_undeformed_body(scene))
    for (TriangleMesh& sheet :
         blades_of(cut, body.surface, body.report.step_mm > 0.0 ? body.report.step_mm : 1.0))
      sheets.push_back(std::move(sheet));
  return sheets;
}

}  // namespace dimple
