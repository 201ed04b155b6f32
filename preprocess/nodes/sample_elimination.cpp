#include "preprocess/nodes/sample_elimination.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <numeric>
#include <span>
#include <utility>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/scene/boundary_conditions.hpp"

namespace dimple {
namespace {

constexpr std::size_t crowd_per_candidate = 1000;

// Numbers 0, 1, ... by a decreasing value; the largest on top, among equals the last number.
class Heap {
 public:
  explicit Heap(std::vector<double>& value) : value_(value), order_(value.size()), place_(value.size()) {
    std::iota(order_.begin(), order_.end(), std::size_t{0});
    std::iota(place_.begin(), place_.end(), std::size_t{0});
    for (std::size_t k = order_.size() / 2; k-- > 0;) {
      if (k % 65536 == 0) stop_if_requested();
      sink(k);
    }
  }
  std::size_t pop() {
    const std::size_t top = order_.front(), last = order_.back();
    order_.pop_back();
    if (!order_.empty()) {
      put(last, 0);
      sink(0);
    }
    return top;
  }
  void lower(std::size_t i, double by) {
    value_[i] -= by;
    sink(place_[i]);
  }

 private:
  void put(std::size_t i, std::size_t k) {
    order_[k] = i;
    place_[i] = k;
  }
  bool above(std::size_t i, std::size_t j) const { return std::pair(value_[i], i) > std::pair(value_[j], j); }
  void sink(std::size_t k) {
    const std::size_t i = order_[k];
    for (std::size_t child; (child = 2 * k + 1) < order_.size(); k = child) {
      if (child + 1 < order_.size() && above(order_[child + 1], order_[child])) ++child;
      if (above(i, order_[child])) break;
      put(order_[child], k);
    }
    put(i, k);
  }
  std::vector<double>& value_;
  std::vector<std::size_t> order_, place_;
};

// Weights between candidates, one list for a block of them: millions of lists take long to free at a stop.
struct Crowded {
  std::vector<std::pair<int, double>> other;
  std::vector<std::size_t> end = {};  // of each candidate's, in `other`
  std::span<const std::pair<int, double>> of(std::size_t i) const {
    return std::span(other).subspan(i > 0 ? end[i - 1] : 0, end[i] - (i > 0 ? end[i - 1] : 0));
  }
};

[[noreturn]] void refuse_crowd(std::size_t candidates) {
  throw ModelError(
      {.fact = fmt::format("{} candidate places for nodes have over {} neighbours each", candidates,
                           crowd_per_candidate),
       .where = "nodes",
       .why =
           "the spacing changes too steeply near the contact patch, or the body is folded too finely for it",
       .remedy = "use more nodes (--nodes), a coarser --rim or a larger --indenter-diameter"});
}

}  // namespace

std::vector<Vec3> thin_out(const std::vector<Vec3>& candidates, const std::vector<Vec3>& fixed, Index count,
                           double reach, const Spacing& spacing) {
  const std::size_t m = candidates.size();
  if (static_cast<Index>(m) <= count) return candidates;
  std::vector<Vec3> all = candidates;
  all.insert(all.end(), fixed.begin(), fixed.end());
  const Points points = to_points(all);
  const Neighbours tree(points);
  std::vector<double> h(all.size());
  tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) { h[i] = spacing(all[i]); });

  constexpr std::size_t block = 256;
  std::vector<Crowded> near((m + block - 1) / block);
  std::vector<double> crowding(m, 0.0);
  std::atomic<std::size_t> crowd = 0;
  tbb::parallel_for(std::size_t{0}, near.size(), [&](std::size_t part) {
    thread_local std::vector<int> found;
    Crowded& here = near[part];
    for (std::size_t i = block * part; i < std::min(block * (part + 1), m); ++i) {
      stop_if_requested();
      if (crowd > crowd_per_candidate * m) return;
      tree.within(points.col(static_cast<Index>(i)), far_enough * reach * h[i], found);
      crowd += found.size();
      for (const int j : found) {
        if (j == static_cast<int>(i)) continue;
        const double within = reach * (0.5 * (h[i] + h[static_cast<std::size_t>(j)]));
        const double d = (points.col(static_cast<Index>(i)) - points.col(j)).norm();
        if (d >= within) continue;
        double w = 1.0 - d / within;
        for (int square = 0; square < 3; ++square) w *= w;  // the eighth power
        crowding[i] += w;
        if (j < static_cast<int>(m)) here.other.push_back({j, w});
      }
      here.end.push_back(here.other.size());
    }
    here.other.shrink_to_fit();
  });

  if (crowd > crowd_per_candidate * m) refuse_crowd(m);
  Heap heap(crowding);
  std::vector<bool> gone(m, false);
  for (Index left = static_cast<Index>(m); left > count; --left) {
    if (left % 1024 == 0) stop_if_requested();
    const std::size_t i = heap.pop();
    gone[i] = true;
    for (const auto& [j, weight] : near[i / block].of(i % block))
      if (!gone[static_cast<std::size_t>(j)]) heap.lower(static_cast<std::size_t>(j), weight);
  }
  std::vector<Vec3> result;
  for (std::size_t i = 0; i < m; ++i)
    if (!gone[i]) result.push_back(candidates[i]);
  return result;
}

}  // namespace dimple
