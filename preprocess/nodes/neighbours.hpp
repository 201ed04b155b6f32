#pragma once

#include <memory>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Search for points near a place. Takes lengths, not squared lengths; ties never depend on the tree's order.
class Neighbours {
 public:
  explicit Neighbours(const Points& points);  ///< keeps its own copy
  ~Neighbours();
  Neighbours(Neighbours&&) noexcept;
  Neighbours& operator=(Neighbours&&) noexcept;

  /// Numbers of the points within `radius` of x, ascending.
  void within(const Vec3& x, double radius, std::vector<int>& result) const;
  void within_unordered(const Vec3& x, double radius, std::vector<int>& result) const;
  /// The nearest `count` points, nearest first, equal distances by number.
  std::vector<int> nearest(const Vec3& x, int count) const;
  /// Distance from x to the nearest point other than number `self`.
  double distance_to_nearest(const Vec3& x, int self = -1) const;

 private:
  struct Tree;
  std::unique_ptr<Tree> tree_;
};

}  // namespace dimple
