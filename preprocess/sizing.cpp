#include "preprocess/sizing.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace dimple {
namespace {

constexpr int rim_corners = 48;
constexpr double too_large = 1.35;  // a box is halved above this multiple of the wanted volume

double distance2_to_segment(const Vec3& x, const Vec3& a, const Vec3& b) {
  const Vec3 ab = b - a;
  const double t = std::clamp((x - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0);
  return (x - a - t * ab).squaredNorm();
}

double square(double x) {
  return x * x;
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
  corner_ = rim_.transpose();
  share_ = options.rim;
  slope_ = (1.0 - options.rim) / (options.reach * boundary.radius);
  for (int k = 0; k < rim_corners; ++k)
    longest_edge_ = std::max(longest_edge_, (rim_.col((k + 1) % rim_corners) - rim_.col(k)).norm());
  lower_ = rim_.rowwise().minCoeff().array() - 1e-6 * boundary.radius;
  upper_ = rim_.rowwise().maxCoeff().array() + 1e-6 * boundary.radius;
}

double Sizing::operator()(const Vec3& x) const {
  if (even()) return 1.0;
  const double reach = (1.0 - share_) / slope_;
  if (((x - lower_).array() < -reach).any() || ((x - upper_).array() > reach).any()) return 1.0;
  // Of the edge nearest to x one end is hardly farther than the nearest corner is: half an edge aside.
  std::array<double, rim_corners + 1> corner2;
  std::array<double, 4> least;  // of every fourth corner: the minimum is exact in any order
  least.fill(std::numeric_limits<double>::infinity());
  for (std::size_t k = 0; k < rim_corners; k += 4)
    for (std::size_t lane = 0; lane < 4; ++lane) {
      const auto c = static_cast<Index>(k + lane);
      const double dx = x.x() - corner_(c, 0), dy = x.y() - corner_(c, 1), dz = x.z() - corner_(c, 2);
      const double distance2 = dx * dx + (dy * dy + dz * dz);
      corner2[k + lane] = distance2;
      least[lane] = distance2 < least[lane] ? distance2 : least[lane];
    }
  corner2[rim_corners] = corner2[0];
  double nearest2 = std::min(std::min(least[0], least[1]), std::min(least[2], least[3]));
  if (nearest2 > square(1.000001 * (reach + longest_edge_))) return 1.0;
  const double limit2 = 1.000001 * (nearest2 + 0.25 * square(longest_edge_));
  for (std::size_t k = 0; k < rim_corners; ++k)
    if (std::min(corner2[k], corner2[k + 1]) < limit2) {
      const auto c = static_cast<Index>(k);
      nearest2 = std::min(nearest2, distance2_to_segment(x, rim_.col(c), rim_.col((c + 1) % rim_corners)));
    }
  return std::min(1.0, share_ + slope_ * std::sqrt(nearest2));
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
      if (box.cut && body.farther(box.centre, box.half.norm())) {
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
