#include "preprocess/neighbours.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nanoflann.hpp>

namespace dimple {

struct Neighbours::Tree {
  using Index_ =
      nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Tree>, Tree, 3, int>;

  explicit Tree(const Points& p) : points(p), index(3, *this, {16}) {}

  std::size_t kdtree_get_point_count() const { return static_cast<std::size_t>(points.cols()); }
  double kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return points(static_cast<Index>(axis), static_cast<Index>(i));
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }

  Points points;
  Index_ index;
};

Neighbours::Neighbours(const Points& points) : tree_(std::make_unique<Tree>(points)) {}
Neighbours::~Neighbours() = default;
Neighbours::Neighbours(Neighbours&&) noexcept = default;
Neighbours& Neighbours::operator=(Neighbours&&) noexcept = default;

void Neighbours::within(const Vec3& x, double radius, std::vector<int>& result) const {
  within_unordered(x, radius, result);
  std::sort(result.begin(), result.end());
}

void Neighbours::within_unordered(const Vec3& x, double radius, std::vector<int>& result) const {
  result.clear();
  thread_local std::vector<std::pair<int, double>> found;
  found.clear();
  const nanoflann::SearchParams unsorted(32, 0.0f, false);
  tree_->index.radiusSearch(x.data(), radius * radius, found, unsorted);  // nanoflann wants the square
  for (const auto& [i, distance2] : found) result.push_back(i);
}

std::vector<int> Neighbours::nearest(const Vec3& x, int count) const {
  const Index all = tree_->points.cols();
  const auto wanted = static_cast<std::size_t>(std::clamp<Index>(count, 0, all));
  if (wanted == 0) return {};
  // One more than asked for: of several at the last distance the tree takes whichever it meets first.
  const std::size_t asked = std::min<std::size_t>(wanted + 1, static_cast<std::size_t>(all));
  std::vector<int> id(asked);
  thread_local std::vector<double> distance2;
  distance2.resize(asked);
  tree_->index.knnSearch(x.data(), asked, id.data(), distance2.data());
  const double last = distance2[wanted - 1];
  if (asked == wanted || distance2[wanted] <= last * (1.0 + 1e-11) + 1e-290)
    within(x, std::sqrt(last) * (1.0 + 1e-12) + 1e-150, id);  // all of them, and take the lowest
  thread_local std::vector<std::pair<double, int>> order;
  order.clear();
  for (const int i : id) order.emplace_back((tree_->points.col(i) - x).squaredNorm(), i);
  std::sort(order.begin(), order.end());
  id.resize(std::min(wanted, order.size()));
  for (std::size_t k = 0; k < id.size(); ++k) id[k] = order[k].second;
  return id;
}

double Neighbours::distance_to_nearest(const Vec3& x, int self) const {
  for (const int i : nearest(x, 2))
    if (i != self) return (tree_->points.col(i) - x).norm();
  return std::numeric_limits<double>::infinity();
}

}  // namespace dimple
