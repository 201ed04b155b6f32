#include "preprocess/nodes/sizing.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <numbers>
#include <utility>

#include "io/stop.hpp"
#include "preprocess/clones.hpp"

namespace dimple {
namespace {

constexpr int patch_edge_corners = 48;
constexpr double too_large = 1.35;  // a box is halved above this multiple of the requested volume

double distance2_to_segment(const Vec3& x, const Vec3& a, const Vec3& b) {
  const Vec3 ab = b - a;
  const double t = std::clamp((x - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0);
  return (x - a - t * ab).squaredNorm();
}

double square(double x) {
  return x * x;
}

// Squared distances of the edge's corners from x, and the least of them; `corner`: coordinate by coordinate.
DIMPLE_CLONES double corner_distances2(const Vec3& x, const double* corner, double* distance2) {
  using Four = double __attribute__((vector_size(32)));
  constexpr double beyond = std::numeric_limits<double>::infinity();
  const auto take = [&](Index k, Four& values) { std::memcpy(&values, corner + k, sizeof values); };
  Four least = {beyond, beyond, beyond, beyond};  // the minimum is exact in any order
  for (Index k = 0; k < patch_edge_corners; k += 4) {
    Four dx, dy, dz;
    take(k, dx);
    take(patch_edge_corners + k, dy);
    take(2 * patch_edge_corners + k, dz);
    dx -= x.x();
    dy -= x.y();
    dz -= x.z();
    const Four here = dx * dx + (dy * dy + dz * dz);
    least = here < least ? here : least;
    std::memcpy(distance2 + k, &here, sizeof here);
  }
  return std::min(std::min(least[0], least[1]), std::min(least[2], least[3]));
}

// Bits of the edges of which an end is nearer than the limit; `distance2`: of the corners, with the first one
// repeated at the end.
DIMPLE_CLONES std::uint64_t near_edges(const double* distance2, double limit2) {
  using Four = double __attribute__((vector_size(32)));
  using Bits = std::int64_t __attribute__((vector_size(32)));
  Bits near = {0, 0, 0, 0}, place = {1, 2, 4, 8};
  for (Index k = 0; k < patch_edge_corners; k += 4) {
    Four from, to;
    std::memcpy(&from, distance2 + k, sizeof from);
    std::memcpy(&to, distance2 + k + 1, sizeof to);
    near |= ((from < limit2) | (to < limit2)) & place;
    place <<= 4;
  }
  return static_cast<std::uint64_t>(near[0] | near[1] | near[2] | near[3]);
}

// Sizings from which on a box is not too large, and surely small.
struct Limits {
  double enough, ample;
};

// The least sizing from which on `holds`, which holds for all larger ones; infinite if not even for 1.
template <class Holds>
double least_with(const Holds& holds) {
  if (!holds(1.0)) return std::numeric_limits<double>::infinity();
  auto low = std::bit_cast<std::uint64_t>(0.0), high = std::bit_cast<std::uint64_t>(1.0);
  while (high - low > 1) {
    const std::uint64_t middle = low + (high - low) / 2;
    (holds(std::bit_cast<double>(middle)) ? high : low) = middle;
  }
  return std::bit_cast<double>(high);
}

// Limits for boxes of one volume: the requested one, which is costly, is then needed for none of them.
Limits limits_for(double volume, const std::function<double(double)>& requested) {
  return {least_with([&](double s) { return volume <= too_large * requested(s); }),
          least_with([&](double s) { return volume < 0.3 * requested(s); })};
}

// Is the box larger than `too_large` times the least volume requested in its middle and towards its corners?
// For most boxes the sizing's slope decides that from the middle alone.
bool must_halve(Leaf& box, const Sizing& sizing, const Limits& limits) {
  constexpr double towards = 0.7;  // of the distance to the corners
  const double reach = towards * box.half.norm();
  const Sizing::Bounds s = sizing.around(box.centre, reach);
  box.distance = s.distance;
  box.finer = s.finer;
  if (s.here < limits.enough) return true;
  if (s.here >= limits.ample || s.least >= limits.enough) return false;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 sign(corner & 1 ? towards : -towards, corner & 2 ? towards : -towards,
                    corner & 4 ? towards : -towards);
    if (sizing(box.centre + sign.cwiseProduct(box.half)) < limits.enough) return true;
  }
  return false;
}

}  // namespace

Sizing::Sizing(const BodySurface& body, const Boundary& boundary, const GradingOptions& options,
               std::vector<Vec3> along, const BodySurface* uncut) {
  if (options.patch_edge >= 1.0) return;
  along_ = std::move(along);
  Boundary whole = boundary;
  whole.over_cut = false;
  patch_edge_ = edge_of_patch(uncut ? *uncut : body, whole, patch_edge_corners);
  corner_ = patch_edge_.transpose();
  fraction_ = options.patch_edge;
  whole_patch_ = options.whole_patch;
  centre_ = boundary.centre;
  approach_ = boundary.approach;
  radius_ = boundary.radius;
  reach_ = options.reach * boundary.radius;
  slope_ = (1.0 - options.patch_edge) / reach_;
  if (options.load_exponent > 0.0)
    path_ = std::make_shared<LoadPath>(body, boundary, patch_edge_, options.load_exponent,
                                       options.load_slope / reach_);
  for (int k = 0; k < patch_edge_corners; ++k)
    longest_edge_ =
        std::max(longest_edge_, (patch_edge_.col((k + 1) % patch_edge_corners) - patch_edge_.col(k)).norm());
  lower_ = patch_edge_.rowwise().minCoeff().array() - 1e-6 * boundary.radius;
  upper_ = patch_edge_.rowwise().maxCoeff().array() + 1e-6 * boundary.radius;
}

// True above or below the contact patch; `away`: the distance from it.
bool Sizing::above_patch(const Vec3& x, double& away) const {
  const Vec3 d = x - centre_;
  const double along = d.dot(approach_);
  away = std::abs(along);
  return (d - along * approach_).squaredNorm() < square(radius_);
}

double Sizing::distance_to_one(const Vec3& x, double farthest) const {
  constexpr double beyond = std::numeric_limits<double>::infinity();
  if (double away = 0.0; whole_patch_ && above_patch(x, away)) return away > farthest ? beyond : away;
  if (((x - lower_).array() < -farthest).any() || ((x - upper_).array() > farthest).any()) return beyond;
  // One end of the edge nearest to x is hardly farther than the nearest corner: half an edge aside.
  std::array<double, patch_edge_corners + 1> corner2;
  double nearest2 = corner_distances2(x, corner_.data(), corner2.data());
  corner2[patch_edge_corners] = corner2[0];
  if (nearest2 > square(1.000001 * (farthest + longest_edge_))) return beyond;
  const double limit2 = 1.000001 * (nearest2 + 0.25 * square(longest_edge_));
  for (std::uint64_t edges = near_edges(corner2.data(), limit2); edges != 0; edges &= edges - 1) {
    const Index c = std::countr_zero(edges), next = c + 1 < patch_edge_corners ? c + 1 : 0;
    nearest2 = std::min(nearest2, distance2_to_segment(x, patch_edge_.col(c), patch_edge_.col(next)));
  }
  return std::sqrt(nearest2);
}

double Sizing::distance_to_patch_edge(const Vec3& x, double farthest) const {
  double least = distance_to_one(x, farthest);
  for (const Vec3& moved : along_)
    least = std::min(least, distance_to_one(x - moved, std::min(farthest, least)));
  return least;
}

double Sizing::patch_edge_length() const {
  double length = 0.0;
  for (Index k = 0; k < patch_edge_.cols(); ++k)
    length += (patch_edge_.col((k + 1) % patch_edge_.cols()) - patch_edge_.col(k)).norm();
  return length;
}

double Sizing::distance(const Vec3& x) const {
  return even() ? std::numeric_limits<double>::infinity() : distance_to_patch_edge(x, reach_);
}

Sizing Sizing::with_edge_spacing(double patch_edge) const {
  if (even() || patch_edge >= 1.0) return {};
  Sizing result = *this;
  result.fraction_ = patch_edge;
  result.slope_ = (1.0 - patch_edge) / reach_;
  return result;
}

Sizing::Bounds Sizing::around(const Vec3& x, double radius) const {
  if (even()) return {1.0, 1.0, std::numeric_limits<double>::infinity(), 1.0};
  const double distance = distance_to_patch_edge(x, reach_ + radius);
  const double f = finer(x);
  // A little less than the slopes allow, for rounding. Between lattice points f is linear: sqrt(3) times its
  // slope.
  const double steepest = path_ ? std::numbers::sqrt3 * path_->slope() : 0.0;
  const double least = std::max(0.0, f - 1.000001 * steepest * radius);
  return {at(distance, f), at(distance - 1.000001 * radius, least) - 1e-9, distance, f};
}

double Sizing::steepest() const {
  if (whole_patch_) return std::numeric_limits<double>::infinity();  // at the rim of the cylinder above it
  return even() ? 0.0 : slope_ + (path_ ? std::numbers::sqrt3 * path_->slope() : 0.0);
}

std::optional<std::vector<Leaf>> bisect(const BodySurface& body, double edge, const Sizing& sizing,
                                        const std::function<double(double)>& requested, std::size_t most) {
  if (!(edge > 0.0)) return std::nullopt;
  const Vec3 size = body.upper() - body.lower();
  Eigen::Array3d count;
  // A thin body fills little of its box: the grid starts coarser.
  for (;; edge *= 2.0) {
    for (int d = 0; d < 3; ++d) count[d] = std::max(1.0, std::ceil(size[d] / edge - 1e-9));
    if (!(count.prod() > static_cast<double>(most))) break;
  }
  const Vec3 half = 0.5 * (size.array() / count).matrix();
  std::vector<Leaf> level;
  for (int k = 0; k < count[2]; ++k)
    for (int j = 0; j < count[1]; ++j)
      for (int i = 0; i < count[0]; ++i) {
        const Vec3 at(2 * i + 1, 2 * j + 1, 2 * k + 1);
        level.push_back({.centre = body.lower() + at.cwiseProduct(half), .half = half, .cut = true});
      }
  std::vector<Leaf> leaves;
  // Level by level, so that the costly distances to the surface are computed in parallel.
  while (!level.empty()) {
    if (level.size() + leaves.size() > most) return std::nullopt;
    const Limits limits = limits_for(level.front().volume(), requested);  // all of one size
    enum Fate : char { outside, done, halve };
    std::vector<Fate> fate(level.size());
    tbb::parallel_for(std::size_t{0}, level.size(), [&](std::size_t k) {
      stop_if_requested();
      Leaf& box = level[k];
      if (box.cut && body.farther(box.centre, box.half.norm())) {
        if (!body.contains(box.centre)) {
          fate[k] = outside;
          return;
        }
        box.cut = false;
      }
      fate[k] = must_halve(box, sizing, limits) ? halve : done;
    });
    std::vector<Leaf> next;
    for (std::size_t k = 0; k < level.size(); ++k) {
      if (k % 65536 == 0) stop_if_requested();
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
