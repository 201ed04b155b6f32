#include "preprocess/supports/support.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <functional>
#include <map>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/supports/gradient_variance.hpp"
#include "preprocess/supports/place_support.hpp"

namespace dimple {
namespace {

// Points whose local matrices are held at a time: few enough to fit in the processor's cache.
constexpr Index slab = 2048;
constexpr Index most_members = 2'000'000'000;

// The symmetric root, in the frame of the body's axes: smooth in the moments, and it turns with the body.
Mat3 root_of_moments(const Discretisation& model, Index q) {
  const Mat3 about = as_matrix(model.second_moments, q);
  const double size = about.trace();
  if (!(size > 0.0)) return Mat3::Zero();
  const Eigen::SelfAdjointEigenSolver<Mat3> solver(about / size);
  const Vec3 root = (solver.eigenvalues().cwiseMax(0.0) * size).cwiseSqrt();
  return solver.eigenvectors() * root.asDiagonal() * solver.eigenvectors().transpose();
}

void take(PointSupport& result, const PlaceSupport& place) {
  result.grown = result.grown || place.growth > 1.0;
  result.unconnected = result.unconnected || place.unconnected;
  result.largest_growth = std::max(result.largest_growth, place.growth);
  result.worst_pivot_ratio = std::min(result.worst_pivot_ratio, place.mls.pivot_ratio);
  if (place.ok || !result.ok) return;
  result.ok = false;
  result.failed = place.mls;
  result.failed_nodes = place.nodes.size();
}

void at_point(Index q, const SupportNodes& node_set, std::span<const int> near,
              const std::function<bool(int)>& connected, PointSupport& result) {
  PlaceSupport place = support_of(node_set.model.point.col(q), node_set, near, connected);
  take(result, place);
  result.nodes = std::move(place.nodes);
  result.dphi = std::move(place.dphi);
}

// The gradients at each place, found one by one, with larger supports where necessary.
bool one_by_one(const Points& x, const SupportNodes& node_set, std::span<const int> near,
                const std::function<bool(int)>& connected, PointSupport& result, MlsOfEight& gradients) {
  std::array<PlaceSupport, cell_places> at;
  NodesAround around{x.rowwise().mean(), 0.0, {}, {}};
  around.extent = (x.colwise() - around.middle).colwise().norm().maxCoeff();
  std::vector<int>& nodes = gradients.nodes;
  nodes.clear();
  for (int k = 0; k < cell_places; ++k) {
    PlaceSupport& place = at[static_cast<std::size_t>(k)] =
        support_of(x.col(k), node_set, near, around, connected);
    take(result, place);
    if (!result.ok) return false;
    nodes.insert(nodes.end(), place.nodes.begin(), place.nodes.end());
  }
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  gradients.stride = static_cast<Index>((nodes.size() + 7) / 8 * 8);
  gradients.rows.assign(static_cast<std::size_t>(3 * cell_places * gradients.stride), 0.0);
  for (int k = 0; k < cell_places; ++k) {
    const PlaceSupport& place = at[static_cast<std::size_t>(k)];
    std::size_t column = 0;
    for (std::size_t m = 0; m < place.nodes.size(); ++m) {
      while (nodes[column] != place.nodes[m]) ++column;
      for (int r = 0; r < 3; ++r)
        gradients.rows[static_cast<std::size_t>((3 * k + r) * gradients.stride) + column] =
            place.dphi(r, static_cast<Index>(m));
    }
  }
  return true;
}

void over_cell(Index q, const SupportNodes& node_set, std::span<const int> near,
               const std::function<bool(int)>& connected, double weight, PointSupport& result) {
  const Mat3 root = root_of_moments(node_set.model, q);
  Points x(3, cell_places);
  for (int k = 0; k < cell_places; ++k) {
    const Vec3 sign(k & 1 ? 1.0 : -1.0, k & 2 ? 1.0 : -1.0, k & 4 ? 1.0 : -1.0);
    x.col(k) = node_set.model.point.col(q) + root * sign;
  }
  thread_local MlsOfEight gradients;
  mls_of_eight(x, node_set.model.X, near, node_set.radius, node_set.pinned, node_set.options.interpolation,
               true, gradients);
  bool good = true;
  for (std::size_t k = 0; k < cell_places; ++k) {
    good = good && surely_good(gradients, k);
    result.worst_pivot_ratio = std::min(result.worst_pivot_ratio, gradients.pivot_ratio[k]);
  }
  if (!good) {
    result.worst_pivot_ratio = 1.0;
    if (!one_by_one(x, node_set, near, connected, result, gradients)) return;
  }
  result.nodes = gradients.nodes;
  const auto n = static_cast<Index>(result.nodes.size());
  mean_and_deviations(gradients);
  const Index stride = gradients.stride;
  result.dphi =
      Eigen::Map<const Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::RowMajor>, 0, Eigen::OuterStride<>>(
          gradients.rows.data(), 3, n, Eigen::OuterStride<>(stride));
  result.variance.resize(static_cast<std::size_t>(n * (n + 1) / 2));
  lower_products(gradients.rows.data() + 3 * stride, 3 * (cell_places - 1), stride, n, weight / cell_places,
                 result.variance.data());
  // Rounded to multiples of 2^-52 m, less than a billionth of a node's value. Their sums are exact (below 2
  // m), so that a cut can remove a cell's contribution without a remainder.
  constexpr double coarse = 1.5;
  for (double& k : result.variance) k = (k + coarse) - coarse;
}

// Error for linear fields: a constant has no gradient, and the gradient of x is the identity.
double linear_error(const Model& model, Index q, const PointSupport& s, double radius) {
  Mat3 of_position = Mat3::Zero();
  Vec3 of_one = Vec3::Zero();
  for (std::size_t m = 0; m < s.nodes.size(); ++m) {
    const Vec3 g = s.dphi.col(static_cast<Index>(m));
    of_position += (model.X.col(s.nodes[m]) - model.point.col(q)) * g.transpose();
    of_one += g;
  }
  return std::max((of_position - Mat3::Identity()).cwiseAbs().maxCoeff(),
                  of_one.cwiseAbs().maxCoeff() * radius);
}

// The body's own axes: pivots depend on the axes, and must not depend on how the image is turned.
struct InOwnAxes {
  explicit InOwnAxes(Model& m)
      : model(m), axes(m.axes), X(m.X), point(m.point), second_moments(m.second_moments) {
    model.X = axes.transpose() * X;
    model.point = axes.transpose() * point;
    model.second_moments = turned(second_moments, axes.transpose());
    model.axes.setIdentity();
  }
  ~InOwnAxes() {
    model.X.swap(X);
    model.point.swap(point);
    model.second_moments.swap(second_moments);
    model.axes = axes;
  }
  InOwnAxes(const InOwnAxes&) = delete;
  InOwnAxes& operator=(const InOwnAxes&) = delete;
  Model& model;
  Mat3 axes;
  Points X, point;
  SecondMoments second_moments;
};

[[noreturn]] void refuse_support(const SupportOptions& options, Index q, const PointSupport& s,
                                 const Vec3& mm) {
  throw ModelError(
      {.fact =
           fmt::format("integration point {} has {} nodes in its support, which do not span the linear basis "
                       "(pivot ratio {:.1e})",
                       q, s.failed_nodes, s.failed.pivot_ratio),
       .where =
           fmt::format("support domains; point at ({:.2f}, {:.2f}, {:.2f}) mm, radii enlarged {:.1f} times",
                       mm.x(), mm.y(), mm.z(), largest_support_growth),
       .why = "the nodes are too sparse or too nearly in a plane there",
       .remedy = fmt::format("raise support.radius_factor from {:.2f}, or use more nodes (--nodes)",
                             options.radius_factor),
       .code = s.failed_nodes < enough_nodes ? "supports" : "conditioning"});
}

// Reserves room in the lists for those of points [0, done), with `members` nodes; for all, if the others have
// about as many.
void make_room(Model& model, Index members, Index done) {
  if (members > most_members)
    throw ModelError({.fact = fmt::format("the supports hold over {} nodes in all, {} at each of {} points",
                                          most_members, members / done, model.point_count()),
                      .where = "support domains",
                      .why = "their lists are numbered with 32 bits",
                      .remedy = "use fewer nodes (--nodes) or points (--points), or a smaller --support",
                      .code = "too-large"});
  if (members <= model.support.member.size()) return;
  const Index room = std::lround(1.05 * static_cast<double>(members) *
                                 static_cast<double>(model.point_count()) / static_cast<double>(done));
  model.support.member.conservativeResize(room);
  model.dphi.conservativeResize(3, room);
}

void add_to(SupportReport& report, Index q, const PointSupport& s) {
  const auto n = static_cast<Index>(s.nodes.size());
  report.grown += s.grown ? 1 : 0;
  if (s.unconnected) report.unconnected.push_back(q);
  report.largest_growth = std::max(report.largest_growth, s.largest_growth);
  if (n < report.fewest) report.fewest_at = q;
  if (s.worst_pivot_ratio < report.worst_pivot_ratio) report.worst_pivot_at = q;
  report.fewest = std::min(report.fewest, n);
  report.most = std::max(report.most, n);
  report.worst_pivot_ratio = std::min(report.worst_pivot_ratio, s.worst_pivot_ratio);
  report.linear_error = std::max(report.linear_error, s.linear_error);
}

// Copies the supports of points from `first` on into the model's lists.
void take_slab(Model& model, const InOwnAxes& undeformed, Index first,
               const std::vector<PointSupport>& found) {
  const auto count = static_cast<Index>(found.size());
  Index members = model.support.offset[first];
  for (const PointSupport& s : found) members += static_cast<Index>(s.nodes.size());
  make_room(model, members, first + count);
  for (Index k = 0; k < count; ++k) {
    const Index q = first + k;
    const PointSupport& s = found[static_cast<std::size_t>(k)];
    if (!s.ok) refuse_support(model.scheme.support, q, s, undeformed.point.col(q) * 1e3);
    model.support.offset[q + 1] = model.support.offset[q] + static_cast<int>(s.nodes.size());
    add_to(model.support_report, q, s);
  }
  tbb::parallel_for(Index{0}, count, [&](Index k) {
    const PointSupport& s = found[static_cast<std::size_t>(k)];
    const int at = model.support.offset[first + k];
    std::copy(s.nodes.begin(), s.nodes.end(), model.support.member.data() + at);
    model.dphi.middleCols(at, s.dphi.cols()) = s.dphi;
  });
}

// Rotates gradients back from the body's own axes; unused room of the lists is released.
void finish_lists(Model& model, const InOwnAxes& undeformed) {
  const Index members = model.support.offset[model.point_count()];
  model.support.member.conservativeResize(members);
  model.dphi.conservativeResize(3, members);
  if (!undeformed.axes.isIdentity(0.0))
    tbb::parallel_for(tbb::blocked_range<Index>(0, members, 4096), [&](const auto& range) {
      for (Index k = range.begin(); k < range.end(); ++k)
        model.dphi.col(k) = undeformed.axes * model.dphi.col(k);
    });
  model.support_report.mean = static_cast<double>(members) / static_cast<double>(model.point_count());
}

void supports_of(Model& model, const Connected& sees) {
  const InOwnAxes undeformed(model);
  const SupportOptions& options = model.scheme.support;
  const SupportNodes node_set(model, options);
  const bool hidden = static_cast<bool>(sees);
  const bool averaged = model.scheme.averaged_gradients;
  Eigen::VectorXd margin;
  if (averaged)
    margin = model.second_moments.topRows<3>().colwise().sum().cwiseMax(0.0).cwiseSqrt().transpose() * 1.8;
  const double mean_radius = options.radius_factor * model.spacing.mean();

  SupportReport& report = model.support_report = {};
  report.fewest = model.node_count();
  const Eigen::VectorXi& of_point = model.tissue;
  std::map<int, std::vector<LowerRow>> variance;  // of each tissue
  if (averaged)
    for (const int t : of_point) variance[t].resize(static_cast<std::size_t>(model.node_count()));
  model.support.offset.resize(model.point_count() + 1);
  model.support.offset[0] = 0;
  model.support.member.resize(0);
  std::vector<PointSupport> found;  // one slab's after another's, in the same memory
  std::vector<int> slot(static_cast<std::size_t>(averaged ? model.node_count() : 0), -1);
  for (Index first = 0; first < model.point_count(); first += slab) {
    const Index count = std::min(slab, model.point_count() - first);
    found.resize(static_cast<std::size_t>(count));
    std::atomic<Index> unseen = 0;
    const Connected connected = [&](int a, Index k) {
      const bool seen = sees(a, first + k);
      if (!seen) unseen.fetch_add(1, std::memory_order_relaxed);
      return seen;
    };
    const NodesNear near = nodes_near(model.point.middleCols(first, count), node_set,
                                      averaged ? Eigen::VectorXd(margin.segment(first, count)) : margin,
                                      hidden ? connected : Connected());
    tbb::parallel_for(Index{0}, count, [&](Index k) {
      stop_if_requested();
      const Index q = first + k;
      PointSupport& s = found[static_cast<std::size_t>(k)];
      static_cast<PointReport&>(s) = {};
      std::function<bool(int)> to_point;
      if (hidden) to_point = [&](int a) { return connected(a, k); };
      if (averaged)
        over_cell(q, node_set, near.of(k), to_point, model.volume[q], s);
      else
        at_point(q, node_set, near.of(k), to_point, s);
      if (s.ok) s.linear_error = linear_error(model, q, s, mean_radius);
    });
    report.unseen += unseen;
    take_slab(model, undeformed, first, found);
    for (auto& [t, rows] : variance)
      add_variance(found, {of_point.data() + first, static_cast<std::size_t>(count)}, t, slot, rows);
  }
  finish_lists(model, undeformed);
  model.variance.clear();
  for (auto& [t, rows] : variance) {
    GradientVariance& v = model.variance.emplace_back();
    v.tissue = t;
    unfold(rows, v);
  }
}

}  // namespace

void find_supports(Model& model) {
  supports_of(model, {});
}
void find_supports(Model& model, const Sight& sight) {
  supports_of(model, [&](int a, Index q) { return sight.sees(a, q); });
}
void find_supports_seen(Model& model, const Connected& sees) {
  supports_of(model, sees);
}

}  // namespace dimple
