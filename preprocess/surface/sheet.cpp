#include "preprocess/surface/sheet.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "preprocess/surface/surface_cells.hpp"

namespace dimple {
namespace {

// Tolerances in sizes of the sheet: distance that counts as on it, and of the search around it.
constexpr double on_sheet = 1e-9, next_to_sheet = 1e-6;

// On which side of an edge a line passes: by the edge's ends in the order of their numbers, so that the two
// triangles at an edge agree.
bool left_of(const Points& vertex, int a, int b, const Vec3& x, const Vec3& segment) {
  const bool turned = a > b;
  const Vec3 u = vertex.col(turned ? b : a) - x, v = vertex.col(turned ? a : b) - x;
  return (segment.dot(u.cross(v)) >= 0.0) != turned;
}

}  // namespace

Sheet::Sheet(Points vertex, Triangles triangles)
    : vertex_(std::move(vertex)),
      triangles_(std::move(triangles)),
      normal_(3, triangles_.cols()),
      lower_(vertex_.rowwise().minCoeff()),
      upper_(vertex_.rowwise().maxCoeff()),
      boxes_(vertex_, triangles_) {
  size_ = (upper_ - lower_).norm();
  Vec3 sum = Vec3::Zero();
  for (Index t = 0; t < triangles_.cols(); ++t) {
    const Vec3 a = vertex_.col(triangles_(0, t));
    const Vec3 twice = (vertex_.col(triangles_(1, t)) - a).cross(vertex_.col(triangles_(2, t)) - a);
    normal_.col(t) = twice.normalized();
    sum += twice;
  }
  across_ = sum.normalized();  // any direction, or none, for a closed sheet
  const Eigen::VectorXd along = vertex_.transpose() * across_;
  lowest_ = along.minCoeff() - next_to_sheet * size_;
  highest_ = along.maxCoeff() + next_to_sheet * size_;
}

bool Sheet::passes(Index t, const Vec3& x, const Vec3& y) const {
  const std::array<int, 3> corner = {static_cast<int>(triangles_(0, t)), static_cast<int>(triangles_(1, t)),
                                     static_cast<int>(triangles_(2, t))};
  const Vec3 a = vertex_.col(corner[0]), normal = normal_.col(t);
  const auto above = [&](const Vec3& p) { return normal.dot(p - a) >= -on_sheet * size_; };
  if (above(x) == above(y)) return false;
  const Vec3 segment = y - x;
  const bool first = left_of(vertex_, corner[0], corner[1], x, segment);
  return first == left_of(vertex_, corner[1], corner[2], x, segment) &&
         first == left_of(vertex_, corner[2], corner[0], x, segment);
}

bool Sheet::between(const Vec3& x, const Vec3& y) const {
  const double slack = on_sheet * size_;
  if ((x.cwiseMin(y).array() > upper_.array() + slack).any() ||
      (x.cwiseMax(y).array() < lower_.array() - slack).any())
    return false;
  // Blades are nearly plane: only the part of the segment within their thickness can meet them.
  const double from = across_.dot(x), to = across_.dot(y);
  if (std::max(from, to) < lowest_ || std::min(from, to) > highest_) return false;
  double first = 0.0, last = 1.0;
  if (const double rise = to - from; std::abs(rise) > slack) {
    const auto [enters, leaves] = std::minmax({(lowest_ - from) / rise, (highest_ - from) / rise});
    first = std::max(first, enters);
    last = std::min(last, leaves);
  }
  struct Visit {
    const Sheet& sheet;
    const Vec3 &x, &y;
    double half;
    bool found = false;
    double reach() const { return found ? -1.0 : half; }
    void triangle(int t) { found = found || sheet.passes(t, x, y); }
  } visit{*this, x, y, 0.5 * (last - first) * (y - x).norm() + next_to_sheet * size_};
  boxes_.around(x + 0.5 * (first + last) * (y - x), visit);
  return visit.found;
}

bool Sheet::reaches(const Vec3& x, double d) const {
  if ((x.array() > upper_.array() + d).any() || (x.array() < lower_.array() - d).any()) return false;
  struct Visit {
    const Sheet& sheet;
    const Vec3& x;
    double d;
    bool found = false;
    double reach() const { return found ? -1.0 : d; }
    void triangle(int t) {
      const auto at = [&](int c) { return Vec3(sheet.vertex_.col(sheet.triangles_(c, t))); };
      found = found || distance2_to_triangle(x, at(0), at(1), at(2)) <= d * d;
    }
  } visit{*this, x, d};
  boxes_.around(x, visit);
  return visit.found;
}

}  // namespace dimple
