#include "apps/run/closing_cut.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "preprocess/surface/body_surface.hpp"

namespace dimple {
namespace {

constexpr Index most_samples = 600;
constexpr double opposite_within = 1.5;  // gaps
constexpr double small = 0.01;           // of the area of the faces
constexpr double shallow = 0.05;         // gaps: the error of the displacements

// Point opposite, on the other face of the cut [mm].
std::optional<Vec3> across_gap(const BodySurface& surface, const Vec3& x, const Vec3& normal, double gap) {
  const double lift = 0.01 * gap;
  for (const double t : surface.crossings(x + lift * normal, normal))
    if (t > 0.0)
      return t < opposite_within * gap ? std::optional(Vec3(x + (lift + t) * normal)) : std::nullopt;
  return std::nullopt;
}

}  // namespace

ClosingCut::ClosingCut(const Model& model, double gap) {
  const Surface& faces = model.surface;
  std::vector<Index> fold_face;
  for (Index t = 0; t < faces.triangles.cols(); ++t)
    if (faces.is_cut_face(t)) fold_face.push_back(t);
  if (fold_face.empty()) return;
  const BodySurface surface(faces.vertex_mm, faces.triangles);
  const auto stride =
      static_cast<std::size_t>((static_cast<Index>(fold_face.size()) + most_samples - 1) / most_samples);
  std::vector<Vec3> place, normal;
  std::vector<double> area;
  for (std::size_t k = 0; k < fold_face.size(); k += stride) {
    const Index t = fold_face[k];
    const Points corner = faces.vertex_mm(Eigen::all, faces.triangles.col(t));
    const Vec3 n = surface.normal().col(t), middle = corner.rowwise().mean();
    const std::optional<Vec3> other = across_gap(surface, middle, n, 1e3 * gap);
    if (!other) continue;
    for (const auto& x : corner.colwise()) place.emplace_back(1e-3 * x), normal.push_back(n);
    place.push_back(1e-3 * *other), normal.push_back(-n);
    area.push_back(surface.triangle_area()[t]);
  }
  if (area.empty()) return;
  place_ = to_points(place);
  at_ = surface_interpolation(model, place_, to_points(normal));
  area_ = Eigen::Map<Eigen::VectorXd>(area.data(), static_cast<Index>(area.size()));
  gap_ = gap;
}

void ClosingCut::see(const Frame& frame) {
  if (area_.size() == 0) return;
  const Points x = place_ + at_(frame.u.topRows<3>());
  double worst = 0.0, through = 0.0;
  for (Index s = 0; s < area_.size(); ++s) {
    const Vec3 a = x.col(4 * s), b = x.col(4 * s + 1), c = x.col(4 * s + 2), other = x.col(4 * s + 3);
    const double apart = (other - (a + b + c) / 3.0).dot((b - a).cross(c - a).normalized());
    if (apart > -shallow * gap_) continue;
    worst = std::max(worst, -apart);
    through += area_[s];
  }
  if (worst <= worst_) return;
  worst_ = worst, fraction_ = through / area_.sum(), depth_ = frame.depth;
}

std::string ClosingCut::warning() const {
  if (fraction_ < small) return {};
  return fmt::format(
      "the load closes the cut and its faces pass through each other: at {} over {:.0f} % of their area, by "
      "up to {}; real faces would be in contact, so the force is too low there: give --self-contact on, end "
      "the cut farther from the tool, or use a smaller --depth",
      length_in_words(1e3 * depth_), 100.0 * fraction_, length_in_words(1e3 * worst_));
}

}  // namespace dimple
