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
  result.clear();
  thread_local std::vector<std::pair<int, double>> found;
  found.clear();
  const nanoflann::SearchParams unsorted(32, 0.0f, false);
  tree_->index.radiusSearch(x.data(), radius * radius, found, unsorted);  // nanoflann wants the square
  for (const auto& [i, distance2] : found) result.push_back(i);
  std::sort(result.begin(), result.end());
}

std::vector<int> Neighbours::nearest(const Vec3& x, int count) const {
  const auto wanted = static_cast<std::size_t>(std::clamp<Index>(count, 0, tree_->points.cols()));
  if (wanted == 0) return {};
  std::vector<int> id(wanted);
  std::vector<double> distance2(wanted);
  tree_->index.knnSearch(x.data(), wanted, id.data(), distance2.data());
  // Of several at the last distance the tree takes whichever it meets first: ask for all of them, take the
  // lowest.
  within(x, std::sqrt(distance2.back()) * (1.0 + 1e-12) + 1e-150, id);
  std::vector<std::pair<double, int>> order;
  for (const int i : id) order.emplace_back((tree_->points.col(i) - x).squaredNorm(), i);
  std::sort(order.begin(), order.end());
  std::vector<int> result;
  for (std::size_t k = 0; k < std::min(wanted, order.size()); ++k) result.push_back(order[k].second);
  return result;
}

double Neighbours::distance_to_nearest(const Vec3& x, int self) const {
  for (const int i : nearest(x, 2))
    if (i != self) return (tree_->points.col(i) - x).norm();
  return std::numeric_limits<double>::infinity();
}

}  // namespace dimple
