#include "preprocess/nodes/neighbours.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <nanoflann.hpp>
#include <numeric>

#include "io/stop.hpp"

namespace dimple {

namespace {

// Appends the results of a radius search directly to the list.
struct List {
  double radius2;
  std::vector<int>& slot;
  bool addPoint(double, int i) {
    slot.push_back(i);
    return true;
  }
  double worstDist() const { return radius2; }
  bool full() const { return true; }
  std::size_t size() const { return slot.size(); }
};

// Points as the searches read them.
struct Places {
  Points points;
  double kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return points(static_cast<Index>(axis), static_cast<Index>(i));
  }
};

}  // namespace

struct Neighbours::Tree : Places {
  using Index_ =
      nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Places>, Tree, 3, int>;

  explicit Tree(const Points& p) : Places{p}, index(3, *this, {16}), number(index.vAcc) {
    // In the order of the leaves: a search then reads contiguous memory.
    for (std::size_t slot = 0; slot < number.size(); ++slot)
      points.col(static_cast<Index>(slot)) = p.col(number[slot]);
    std::iota(index.vAcc.begin(), index.vAcc.end(), 0);
  }

  std::size_t kdtree_get_point_count() const { return static_cast<std::size_t>(points.cols()); }
  // Read during construction, which takes seconds for millions of places: it must be stoppable.
  double kdtree_get_pt(std::size_t i, std::size_t axis) const {
    if (++read % (1U << 20) == 0) stop_if_requested();
    return Places::kdtree_get_pt(i, axis);
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
  // Slots within the radius, in the tree's order.
  void within(const Vec3& x, double radius, std::vector<int>& slots) const {
    slots.clear();
    List list{radius * radius, slots};  // nanoflann expects the square
    index.findNeighbors(list, x.data(), nanoflann::SearchParams());
  }
  // Squared distances and numbers; valid until the next call in this thread.
  const std::vector<std::pair<double, int>>& nearest(const Vec3& x, int count) const {
    thread_local std::vector<std::pair<double, int>> order;
    order.clear();
    const Index all = points.cols();
    const auto requested = static_cast<std::size_t>(std::clamp<Index>(count, 0, all));
    if (requested == 0) return order;
    // One more than requested: of several at the last distance the tree returns any.
    const std::size_t fetched = std::min<std::size_t>(requested + 1, static_cast<std::size_t>(all));
    thread_local std::vector<int> slots;
    thread_local std::vector<double> distance2;
    slots.resize(fetched);
    distance2.resize(fetched);
    index.knnSearch(x.data(), fetched, slots.data(), distance2.data());
    const double last = distance2[requested - 1];
    if (fetched == requested || distance2[requested] <= last * (1.0 + 1e-11) + 1e-290)
      within(x, std::sqrt(last) * (1.0 + 1e-12) + 1e-150, slots);  // all of them, to return the lowest
    for (const int i : slots)
      order.emplace_back((points.col(i) - x).squaredNorm(), number[static_cast<std::size_t>(i)]);
    std::sort(order.begin(), order.end());
    order.resize(std::min(requested, order.size()));
    return order;
  }

  mutable std::size_t read = 0;
  Index_ index;
  std::vector<int> number;  // of the point in each slot
};

Neighbours::Neighbours(const Points& points) : tree_(std::make_unique<Tree>(points)) {}
Neighbours::~Neighbours() = default;
Neighbours::Neighbours(Neighbours&&) noexcept = default;
Neighbours& Neighbours::operator=(Neighbours&&) noexcept = default;

void Neighbours::within(const Vec3& x, double radius, std::vector<int>& result) const {
  within_unordered(x, radius, result);
  if (result.empty()) return;
  const auto [lowest, highest] = std::minmax_element(result.begin(), result.end());
  const auto first = static_cast<std::size_t>(*lowest) / 64, last = static_cast<std::size_t>(*highest) / 64;
  if (last - first > 16 * result.size()) {
    std::sort(result.begin(), result.end());
    return;
  }
  // A bit for each number: for a hundred or so this is several times as fast as comparisons.
  thread_local std::vector<std::uint64_t> seen;  // all zero between calls
  if (seen.size() <= last) seen.resize(last + 1, 0);
  for (const int i : result) seen[static_cast<std::size_t>(i) / 64] |= std::uint64_t{1} << (i % 64);
  std::size_t at = 0;
  for (std::size_t word = first; word <= last; ++word)
    for (; seen[word] != 0; seen[word] &= seen[word] - 1)
      result[at++] = static_cast<int>(64 * word) + std::countr_zero(seen[word]);
}

void Neighbours::within_unordered(const Vec3& x, double radius, std::vector<int>& result) const {
  tree_->within(x, radius, result);
  for (int& i : result) i = tree_->number[static_cast<std::size_t>(i)];
}

std::vector<int> Neighbours::nearest(const Vec3& x, int count) const {
  const auto& order = tree_->nearest(x, count);
  std::vector<int> id(order.size());
  for (std::size_t k = 0; k < id.size(); ++k) id[k] = order[k].second;
  return id;
}

double Neighbours::distance_to_nearest(const Vec3& x, int self) const {
  for (const auto& [distance2, i] : tree_->nearest(x, 2))
    if (i != self) return std::sqrt(distance2);
  return std::numeric_limits<double>::infinity();
}

}  // namespace dimple
