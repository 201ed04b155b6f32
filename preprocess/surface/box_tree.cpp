#include "preprocess/surface/box_tree.hpp"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <utility>

#include "io/stop.hpp"

namespace dimple {
namespace {

constexpr int bits = 10;  // of an axis

// Spreads the bits of a number to every third bit.
std::uint32_t spread_bits(std::uint32_t x) {
  x = (x | (x << 16)) & 0x030000ffu;
  x = (x | (x << 8)) & 0x0300f00fu;
  x = (x | (x << 4)) & 0x030c30c3u;
  return (x | (x << 2)) & 0x09249249u;
}

// Numbers 0, 1, ... sorted by keys of 30 bits, equal keys by number.
std::vector<int> in_order(const std::vector<std::uint32_t>& key) {
  std::vector<int> order(key.size()), other(key.size());
  for (std::size_t k = 0; k < key.size(); ++k) order[k] = static_cast<int>(k);
  for (int shift = 0; shift < 3 * bits; shift += bits) {
    std::array<std::size_t, (std::size_t{1} << bits) + 1> begin{};
    const auto digit = [&](int k) { return key[static_cast<std::size_t>(k)] >> shift & ((1u << bits) - 1); };
    for (const int k : order) ++begin[digit(k) + 1];
    for (std::size_t d = 1; d < begin.size(); ++d) begin[d] += begin[d - 1];
    for (const int k : order) other[begin[digit(k)]++] = k;
    order.swap(other);
  }
  return order;
}

}  // namespace

// Morton order, packed from below: no search for a good tree, and boxes that are nearly as good.
BoxTree::BoxTree(const Points& vertex, const Triangles& triangles) {
  const auto count = static_cast<std::size_t>(triangles.cols());
  if (count == 0) return;
  const Vec3 lower = vertex.rowwise().minCoeff(), upper = vertex.rowwise().maxCoeff();
  origin_ = 0.5 * (lower + upper);
  size_ = (upper - lower).norm();
  const double margin = 1e-6 * size_;
  const double cells = ((1 << bits) - 1) / std::max((upper - lower).maxCoeff(), 1e-300) / 3.0;
  const auto corner = [&](std::size_t t, int c) -> Vec3 {
    return vertex.col(triangles(c, static_cast<Index>(t)));
  };
  std::vector<std::uint32_t> key(count);
  for (std::size_t t = 0; t < count; ++t) {
    if (t % 65536 == 0) stop_if_requested();
    const Vec3 at = cells * (corner(t, 0) + corner(t, 1) + corner(t, 2) - 3.0 * lower);
    for (int d = 0; d < 3; ++d) key[t] |= spread_bits(static_cast<std::uint32_t>(std::max(at[d], 0.0))) << d;
  }
  triangle_ = in_order(key);

  constexpr auto lanes = static_cast<std::size_t>(width);
  constexpr float nowhere = std::numeric_limits<float>::max();  // its distance is infinite, within no reach
  const auto empty_nodes = [&](std::size_t boxes) {
    Node none;
    for (std::size_t d = 0; d < 3; ++d) {
      none.low[d].fill(nowhere);
      none.high[d].fill(-nowhere);
    }
    return std::vector<Node>((boxes + lanes - 1) / lanes, none);
  };
  level_.push_back(empty_nodes(count));
  for (std::size_t k = 0; k < count; ++k) {
    const auto t = static_cast<std::size_t>(triangle_[k]);
    const Vec3 a = corner(t, 0), b = corner(t, 1), c = corner(t, 2);
    Node& node = level_[0][k / lanes];
    const auto lane = static_cast<Index>(k % lanes);
    for (std::size_t d = 0; d < 3; ++d) {
      const auto i = static_cast<Index>(d);
      node.low[d][lane] = static_cast<float>(std::min({a[i], b[i], c[i]}) - origin_[i] - margin);
      node.high[d][lane] = static_cast<float>(std::max({a[i], b[i], c[i]}) - origin_[i] + margin);
    }
  }
  while (level_.back().size() > 1) {
    const std::vector<Node>& below = level_.back();
    std::vector<Node> above = empty_nodes(below.size());
    for (std::size_t k = 0; k < below.size(); ++k)
      for (std::size_t d = 0; d < 3; ++d) {
        const auto lane = static_cast<Index>(k % lanes);
        above[k / lanes].low[d][lane] = below[k].low[d].minCoeff();
        above[k / lanes].high[d][lane] = below[k].high[d].maxCoeff();
      }
    level_.push_back(std::move(above));
  }
}

}  // namespace dimple
