#include "preprocess/sizing.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace dimple {
namespace {

constexpr int rim_corners = 48;
constexpr double too_large = 1.35;  // a box is halved above this multiple of the wanted volume

double distance_to_segment(const Vec3& x, const Vec3& a, const Vec3& b) {
  const Vec3 ab = b - a;
  const double t = std::clamp((x - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0);
  return (x - a - t * ab).norm();
}

double wanted_in(const Leaf& box, const std::function<double(const Vec3&)>& wanted) {
  double least = wanted(box.centre);
  if (box.volume() < 0.3 * least) return least;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 sign(corner & 1 ? 0.7 : -0.7, corner & 2 ? 0.7 : -0.7, corner & 4 ? 0.7 : -0.7);
    least = std::min(least, wanted(box.centre + sign.cwiseProduct(box.half)));
  }
  return least;
}

}  // namespace

Sizing::Sizing(const BodySurface& body, const Boundary& boundary, const GradingOptions& options) {
  if (options.rim >= 1.0) return;
  rim_ = rim_of_circle(body, boundary, rim_corners);
  share_ = options.rim;
  slope_ = (1.0 - options.rim) / (options.reach * boundary.radius);
}

double Sizing::operator()(const Vec3& x) const {
  if (even()) return 1.0;
  const double reach = (1.0 - share_) / slope_;
  // Most places are far from all of the rim.
  double nearest = (x - rim_.col(0)).norm();
  const double across = (rim_.col(rim_.cols() / 2) - rim_.col(0)).norm();
  if (nearest > reach + 1.5 * across) return 1.0;
  for (Index k = 0; k < rim_.cols(); ++k)
    nearest = std::min(nearest, distance_to_segment(x, rim_.col(k), rim_.col((k + 1) % rim_.cols())));
  return std::min(1.0, share_ + slope_ * nearest);
}

std::vector<Leaf> bisect(const BodySurface& body, double edge,
                         const std::function<double(const Vec3&)>& wanted) {
  const Vec3 size = body.upper() - body.lower();
  Eigen::Array3d count;
  for (int d = 0; d < 3; ++d) count[d] = std::max(1.0, std::ceil(size[d] / edge - 1e-9));
  const Vec3 half = 0.5 * (size.array() / count).matrix();
  std::vector<Leaf> level;
  for (int k = 0; k < count[2]; ++k)
    for (int j = 0; j < count[1]; ++j)
      for (int i = 0; i < count[0]; ++i) {
        const Vec3 at(2 * i + 1, 2 * j + 1, 2 * k + 1);
        level.push_back({.centre = body.lower() + at.cwiseProduct(half), .half = half, .cut = true});
      }
  std::vector<Leaf> leaves;
  // Level by level, so that the costly question, how far the surface is, is asked in parallel.
  while (!level.empty()) {
    enum Fate : char { outside, done, halve };
    std::vector<Fate> fate(level.size());
    tbb::parallel_for(std::size_t{0}, level.size(), [&](std::size_t k) {
      Leaf& box = level[k];
      if (box.cut && body.closest(box.centre).distance > box.half.norm()) {
        if (!body.contains(box.centre)) {
          fate[k] = outside;
          return;
        }
        box.cut = false;
      }
      fate[k] = box.volume() > too_large * wanted_in(box, wanted) ? halve : done;
    });
    std::vector<Leaf> next;
    for (std::size_t k = 0; k < level.size(); ++k) {
      const Leaf& box = level[k];
      if (fate[k] == done) leaves.push_back(box);
      if (fate[k] != halve) continue;
      int axis = 0;
      for (int d = 1; d < 3; ++d)
        if (box.half[d] > box.half[axis] * (1.0 + 1e-9)) axis = d;
      Leaf part = box;
      part.half[axis] *= 0.5;
      part.centre[axis] = box.centre[axis] - part.half[axis];
      next.push_back(part);
      part.centre[axis] = box.centre[axis] + part.half[axis];
      next.push_back(part);
    }
    level = std::move(next);
  }
  return leaves;
}

}  // namespace dimple
