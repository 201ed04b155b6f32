#pragma once

#include <array>
#include <cmath>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Boxes of a surface's triangles, eight to a node and eight nodes to the next above, in the order of a
/// space-filling curve. Finds the triangles within a distance of a place.
///
/// Boxes are in single precision and slightly enlarged, so that none is missed.
class BoxTree {
 public:
  BoxTree() = default;
  BoxTree(const Points& vertex, const Triangles& triangles);

  /// Calls visit.triangle(t) for every triangle whose box is within visit.reach() of x [mm]; the reach may
  /// shrink during the search. Near triangles come first, approximately.
  template <class Visit>
  void around(const Vec3& x, Visit&& visit) const;

 private:
  static constexpr int width = 8;
  using Lanes = Eigen::Array<float, width, 1>;
  struct Node {
    std::array<Lanes, 3> low, high;
  };
  // Squared distances of a place relative to the origin.
  static Lanes distances2(const Node& node, const std::array<float, 3>& x) {
    Lanes sum = Lanes::Zero();
    for (std::size_t d = 0; d < 3; ++d)
      sum += (node.low[d] - x[d]).max(x[d] - node.high[d]).max(0.0f).square();
    return sum;
  }

  Vec3 origin_ = Vec3::Zero();
  double size_ = 0.0;
  std::vector<std::vector<Node>> level_;  // the lowest first: its boxes are of single triangles
  std::vector<int> triangle_;             // in their order
};

template <class Visit>
void BoxTree::around(const Vec3& x, Visit&& visit) const {
  if (level_.empty()) return;
  const Vec3 there = x - origin_;
  const std::array<float, 3> at = {static_cast<float>(there.x()), static_cast<float>(there.y()),
                                   static_cast<float>(there.z())};
  const double rounding = 1e-6 * (size_ + there.cwiseAbs().maxCoeff());
  // Only a shrinking reach is read again: roots and squares are costly here.
  double reach = -1.0;
  float reach2 = -1.0f;
  const auto look = [&] {
    if (const double now = visit.reach(); now != reach) {
      reach = now;
      reach2 = now < 0.0 ? -1.0f : static_cast<float>(1.00001 * (now + rounding) * (now + rounding));
    }
  };
  struct Entry {
    float distance2;
    int level, node;
  };
  std::array<Entry, 128> stack;  // at most seven more on each level than the current one
  std::size_t count = 0;
  stack[count++] = {0.0f, static_cast<int>(level_.size()) - 1, 0};
  look();
  while (count > 0) {
    const Entry entry = stack[--count];
    if (entry.distance2 > reach2) continue;
    const auto l = static_cast<std::size_t>(entry.level);
    const Lanes distance2 = distances2(level_[l][static_cast<std::size_t>(entry.node)], at);
    const int first = width * entry.node;
    if (l == 0) {
      for (int k = 0; k < width; ++k)
        if (distance2[k] <= reach2) {
          visit.triangle(triangle_[static_cast<std::size_t>(first + k)]);
          look();
        }
      continue;
    }
    const std::size_t before = count;
    for (int k = 0; k < width; ++k) {
      if (distance2[k] > reach2) continue;
      // Keeps the nearest on top.
      std::size_t place = count++;
      for (; place > before && stack[place - 1].distance2 < distance2[k]; --place)
        stack[place] = stack[place - 1];
      stack[place] = {distance2[k], entry.level - 1, first + k};
    }
  }
}

}  // namespace dimple
