#include "preprocess/supports/support.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <atomic>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <numeric>
#include <optional>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/cloud/neighbours.hpp"
#include "preprocess/supports/mls_lanes.hpp"
#include "preprocess/surface/sight.hpp"

namespace dimple {
namespace {

constexpr double largest_growth = 2.5;
// Points whose local matrices are held at a time: few enough for the processor's cache to hold them too.
constexpr Index slab = 2048;
// A moment matrix that looks worse than this beside seven others is looked at by itself; and of nodes that
// lie on one bank of a fold, nearly in a plane, more are wanted (with 1e-5 some bodies found no equilibrium).
constexpr double surely_conditioned = 1e-3;
constexpr std::size_t enough_nodes = 8;  // at a place: twice the terms of the linear basis
constexpr Index most_members = 2'000'000'000;

struct PlaceSupport {
  std::vector<int> nodes;
  Eigen::VectorXd phi;
  Points dphi;
  double growth = 1.0;
  bool unconnected = false;  // too few nodes are connected with it: those that are near were taken
  MlsResult mls;
  bool ok = false;
};

// What the places of one model share.
struct Cloud {
  Cloud(const Discretisation& m, const SupportOptions& o)
      : model(m), options(o), tree(m.X), radius(o.radius_factor * m.spacing) {
    std::map<int, std::vector<int>> of_octave;
    for (Index a = 0; a < m.node_count(); ++a)
      of_octave[std::ilogb(radius[a])].push_back(static_cast<int>(a));
    for (auto& [octave, nodes] : of_octave) {
      const double largest = radius(nodes).maxCoeff();
      octaves.push_back({Neighbours(m.X(Eigen::all, nodes)), std::move(nodes), largest});
    }
    pinned.assign(static_cast<std::size_t>(m.node_count()), 0);
    if (o.interpolation <= 0.0) return;
    for (const auto* set : {&m.base, &m.circle})
      for (const Index a : *set) pinned[static_cast<std::size_t>(a)] = 1;
  }
  const Discretisation& model;
  const SupportOptions& options;
  Neighbours tree;
  Eigen::VectorXd radius;
  // Nodes by the powers of two of their radii: who looks for enlarged ones would meet, in a graded cloud,
  // most nodes of the fine part within the largest radius of all.
  struct Octave {
    Neighbours tree;
    std::vector<int> nodes;
    double largest_radius;
  };
  std::vector<Octave> octaves;
  std::vector<char> pinned;

  // Nodes whose radius, enlarged by `growth`, comes within `extent` of x; ascending.
  void reaching(const Vec3& x, double growth, std::vector<int>& result, double extent = 0.0) const {
    result.clear();
    thread_local std::vector<int> found;
    for (const Octave& octave : octaves) {
      octave.tree.within_unordered(x, octave.largest_radius * growth + extent, found);
      for (const int k : found)
        if (const int a = octave.nodes[static_cast<std::size_t>(k)]; reaches(a, x, growth, extent))
          result.push_back(a);
    }
    std::sort(result.begin(), result.end());
  }
  bool reaches(int a, const Vec3& x, double growth, double extent = 0.0) const {
    return (model.X.col(a) - x).norm() < radius[a] * growth + extent;
  }
};

// Nodes that enlarged supports of places within `extent` of `middle` may take, looked for once for all of
// them; and whether each is connected, asked once where it is in reach.
struct Around {
  Vec3 middle;
  double extent = 0.0;
  std::vector<int> node;
  enum class Known : char { no, connected, hidden };
  std::vector<Known> known;

  // Those that reach x with radii `growth` times as large; ascending.
  void reaching(const Vec3& x, const Cloud& cloud, double growth, const std::function<bool(int)>& connected,
                bool only_connected, std::vector<int>& result) {
    if (node.empty()) {
      cloud.reaching(middle, 1.001 * largest_growth, node, 1.001 * extent);
      known.assign(node.size(), Known::no);
    }
    result.clear();
    for (std::size_t k = 0; k < node.size(); ++k) {
      if (!cloud.reaches(node[k], x, growth)) continue;
      if (only_connected && known[k] == Known::no)
        known[k] = connected(node[k]) ? Known::connected : Known::hidden;
      if (!only_connected || known[k] == Known::connected) result.push_back(node[k]);
    }
  }
};

// `near`: all nodes that reach x ungrown and are `connected` with it by the tissue, and perhaps others of
// these. `around` holds x.
PlaceSupport support_of(const Vec3& x, const Cloud& cloud, std::span<const int> near, Around& around,
                        const std::function<bool(int)>& connected = {}) {
  PlaceSupport result;
  stop_if_asked();
  result.nodes.assign(near.begin(), near.end());
  std::erase_if(result.nodes, [&](int a) { return !cloud.reaches(a, x, 1.0); });
  const auto find = [&](bool only_connected) {
    for (result.growth = 1.0; result.growth <= largest_growth; result.growth *= 1.1) {
      if (result.growth > 1.0 || result.unconnected)
        around.reaching(x, cloud, result.growth, connected, only_connected, result.nodes);
      if (result.nodes.size() < enough_nodes) continue;
      result.mls = mls_shape_functions(x, cloud.model.X, result.nodes, cloud.radius, result.growth,
                                       cloud.options, cloud.pinned, result.phi, result.dphi);
      if (result.mls.ok() && (!only_connected || result.mls.pivot_ratio > surely_conditioned)) return true;
    }
    return false;
  };
  result.ok = find(static_cast<bool>(connected));
  if (!result.ok && connected) {
    result.unconnected = true;
    result.ok = find(false);
  }
  return result;
}

// The same of a place by itself.
PlaceSupport support_of(const Vec3& x, const Cloud& cloud, std::span<const int> near,
                        const std::function<bool(int)>& connected = {}) {
  Around around{x, 0.0, {}, {}};
  return support_of(x, cloud, near, around, connected);
}

// Of each place the nodes near it, ascending.
struct Near {
  std::vector<std::size_t> offset;
  std::vector<int> node;
  std::span<const int> of(Index place) const {
    const auto k = static_cast<std::size_t>(place);
    return {node.data() + offset[k], offset[k + 1] - offset[k]};
  }
};

// For each place the nodes whose radius comes within `margin` of it and that `connected`(node, place), if
// given, does not exclude. Nodes ask, not places: in a graded cloud a place would have to look as far as the
// largest radius of all.
Near nodes_near(const Points& places, const Cloud& cloud, const Eigen::VectorXd& margin,
                const Connected& connected = {}) {
  Near result;
  result.offset.assign(static_cast<std::size_t>(places.cols()) + 1, 0);
  if (places.cols() == 0) return result;
  const Neighbours tree(places);
  const double largest_margin = margin.size() > 0 ? margin.maxCoeff() : 0.0;
  const Vec3 lower = places.rowwise().minCoeff(), upper = places.rowwise().maxCoeff();
  // Only those around these places: with all nodes for every slab of points the time would grow as N^2.
  const double slack = 1.0 + 1e-9;
  std::vector<int> around;
  cloud.reaching(0.5 * (lower + upper), slack, around,
                 slack * (0.5 * (upper - lower).norm() + largest_margin));
  std::vector<std::vector<int>> of_node(around.size());
  tbb::parallel_for(std::size_t{0}, around.size(), [&](std::size_t k) {
    if (k % 256 == 0) stop_if_asked();
    const int a = around[k];
    const Vec3 x = cloud.model.X.col(a);
    const double reach = cloud.radius[a] + largest_margin;
    if (((x - lower).array() < -reach).any() || ((x - upper).array() > reach).any()) return;
    std::vector<int>& found = of_node[k];
    thread_local std::vector<int> all;
    tree.within_unordered(x, reach, all);
    for (const int q : all)
      if (const double within = cloud.radius[a] + (margin.size() > 0 ? margin[q] : 0.0);
          (places.col(q) - x).squaredNorm() < within * within && (!connected || connected(a, q)))
        found.push_back(q);
  });
  for (const auto& found : of_node)
    for (const int q : found) ++result.offset[static_cast<std::size_t>(q) + 1];
  for (std::size_t q = 1; q < result.offset.size(); ++q) result.offset[q] += result.offset[q - 1];
  result.node.resize(result.offset.back());
  std::vector<std::size_t> next(result.offset.begin(), result.offset.end() - 1);
  for (std::size_t k = 0; k < of_node.size(); ++k)
    for (const int q : of_node[k]) result.node[next[static_cast<std::size_t>(q)]++] = around[k];
  return result;
}

// The symmetric root, in the frame of the body's axes: smooth in the moments, and it turns with the body.
Mat3 root_of_moments(const Discretisation& model, Index q) {
  const Mat3 about = as_matrix(model.second_moments, q);
  const double size = about.trace();
  if (!(size > 0.0)) return Mat3::Zero();
  const Eigen::SelfAdjointEigenSolver<Mat3> solver(about / size);
  const Vec3 root = (solver.eigenvalues().cwiseMax(0.0) * size).cwiseSqrt();
  return solver.eigenvectors() * root.asDiagonal() * solver.eigenvectors().transpose();
}

// What was met on the way to a point's support.
struct PointReport {
  bool grown = false, unconnected = false;
  double largest_growth = 1.0;
  double worst_pivot_ratio = 1.0;
  double linear_error = 0.0;
  bool ok = true;
  MlsResult failed;
  std::size_t failed_nodes = 0;
};

// A point's support, and the local matrix of the variance, its lower triangle row by row.
struct PointSupport : PointReport {
  std::vector<int> nodes;
  Points dphi;
  std::vector<double> variance;
};

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

void at_point(Index q, const Cloud& cloud, std::span<const int> near,
              const std::function<bool(int)>& connected, PointSupport& result) {
  PlaceSupport place = support_of(cloud.model.point.col(q), cloud, near, connected);
  take(result, place);
  result.nodes = std::move(place.nodes);
  result.dphi = std::move(place.dphi);
}

// Whether mls_of_eight() served this place without any doubt.
bool surely_good(const MlsOfEight& eight, std::size_t place) {
  return eight.reached[place] >= static_cast<int>(enough_nodes) &&
         eight.pivot_ratio[place] > surely_conditioned;
}

// The gradients at each place, found one by one, with larger supports where they need it.
bool one_by_one(const Points& x, const Cloud& cloud, std::span<const int> near,
                const std::function<bool(int)>& connected, PointSupport& result, MlsOfEight& gradients) {
  std::array<PlaceSupport, cell_places> at;
  Around around{x.rowwise().mean(), 0.0, {}, {}};
  around.extent = (x.colwise() - around.middle).colwise().norm().maxCoeff();
  std::vector<int>& nodes = gradients.nodes;
  nodes.clear();
  for (int k = 0; k < cell_places; ++k) {
    PlaceSupport& place = at[static_cast<std::size_t>(k)] =
        support_of(x.col(k), cloud, near, around, connected);
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

void over_cell(Index q, const Cloud& cloud, std::span<const int> near,
               const std::function<bool(int)>& connected, double weight, PointSupport& result) {
  const Mat3 root = root_of_moments(cloud.model, q);
  Points x(3, cell_places);
  for (int k = 0; k < cell_places; ++k) {
    const Vec3 sign(k & 1 ? 1.0 : -1.0, k & 2 ? 1.0 : -1.0, k & 4 ? 1.0 : -1.0);
    x.col(k) = cloud.model.point.col(q) + root * sign;
  }
  thread_local MlsOfEight gradients;
  mls_of_eight(x, cloud.model.X, near, cloud.radius, cloud.pinned, cloud.options.interpolation, true,
               gradients);
  bool good = true;
  for (std::size_t k = 0; k < cell_places; ++k) {
    good = good && surely_good(gradients, k);
    result.worst_pivot_ratio = std::min(result.worst_pivot_ratio, gradients.pivot_ratio[k]);
  }
  if (!good) {
    result.worst_pivot_ratio = 1.0;
    if (!one_by_one(x, cloud, near, connected, result, gradients)) return;
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
  // To multiples of 2^-52 m, less than a billionth of what a node has: sums of these are exact (below 2 m),
  // so that a cut can take a cell's share out again and nothing of it is left.
  constexpr double coarse = 1.5;
  for (double& k : result.variance) k = (k + coarse) - coarse;
}

// Row a of a symmetric matrix: columns b <= a, ascending.
struct LowerRow {
  std::vector<int> column;
  std::vector<double> value;
};

// Adds the local matrices of points first, first + 1, ... to the rows; row by row, points ascending, so that
// the sums have one order. `slot`: one of each node, all -1 between calls.
void add_variance(const std::vector<PointSupport>& points, std::span<const int> tissue, int wanted,
                  std::vector<int>& slot, std::vector<LowerRow>& rows) {
  std::vector<int> nodes;  // of these points, as they are met
  std::vector<std::size_t> offset(1, 0);
  for (std::size_t q = 0; q < points.size(); ++q)
    if (tissue[q] == wanted)
      for (const int a : points[q].nodes) {
        int& at = slot[static_cast<std::size_t>(a)];
        if (at < 0) {
          at = static_cast<int>(nodes.size());
          nodes.push_back(a);
          offset.push_back(0);
        }
        ++offset[static_cast<std::size_t>(at) + 1];
      }
  for (std::size_t n = 0; n < nodes.size(); ++n) offset[n + 1] += offset[n];
  std::vector<std::pair<int, int>> influence(offset.back());  // point, place in its list
  std::vector<std::size_t> next(offset.begin(), offset.end() - 1);
  for (std::size_t q = 0; q < points.size(); ++q)
    if (tissue[q] == wanted)
      for (std::size_t k = 0; k < points[q].nodes.size(); ++k) {
        const int at = slot[static_cast<std::size_t>(points[q].nodes[k])];
        influence[next[static_cast<std::size_t>(at)]++] = {static_cast<int>(q), static_cast<int>(k)};
      }
  for (const int a : nodes) slot[static_cast<std::size_t>(a)] = -1;
  tbb::parallel_for(std::size_t{0}, nodes.size(), [&](std::size_t n) {
    if (n % 1024 == 0) stop_if_asked();
    const auto a = static_cast<std::size_t>(nodes[n]);
    thread_local std::vector<double> sum;          // all zero between rows
    thread_local std::vector<std::uint64_t> seen;  // a bit for each column; likewise
    if (sum.size() < rows.size()) {
      sum.resize(rows.size(), 0.0);
      seen.resize(rows.size() / 64 + 1, 0);
    }
    int lowest = static_cast<int>(a);
    const auto add = [&](const int* column, const double* value, std::size_t count) {
      lowest = std::min(lowest, column[0]);
      for (std::size_t m = 0; m < count; ++m) {
        const auto b = static_cast<std::size_t>(column[m]);
        seen[b / 64] |= std::uint64_t{1} << (b % 64);
        sum[b] += value[m];
      }
    };
    LowerRow& row = rows[a];
    if (!row.column.empty()) add(row.column.data(), row.value.data(), row.column.size());
    for (std::size_t i = offset[n]; i < offset[n + 1]; ++i) {
      const PointSupport& point = points[static_cast<std::size_t>(influence[i].first)];
      const auto k = static_cast<std::size_t>(influence[i].second);
      add(point.nodes.data(), point.variance.data() + k * (k + 1) / 2, k + 1);
    }
    std::size_t count = 0;
    const std::size_t from = static_cast<std::size_t>(lowest) / 64;
    for (std::size_t word = from; word <= a / 64; ++word)
      count += static_cast<std::size_t>(std::popcount(seen[word]));
    if (count > row.column.size()) row = {std::vector<int>(count), std::vector<double>(count)};
    std::size_t at = 0;
    for (std::size_t word = from; word <= a / 64; ++word)
      for (; seen[word] != 0; seen[word] &= seen[word] - 1) {
        const std::size_t b = 64 * word + static_cast<std::size_t>(std::countr_zero(seen[word]));
        row.column[at] = static_cast<int>(b);
        row.value[at++] = sum[b];
        sum[b] = 0.0;
      }
  });
}

// The whole matrix from its lower triangle, which is used up.
void unfold(std::vector<LowerRow>& lower, GradientVariance& result) {
  const std::size_t n = lower.size();
  std::vector<int> next(n + 1, 0);
  for (std::size_t a = 0; a < n; ++a)
    for (const int b : lower[a].column) {
      ++next[a];
      if (b != static_cast<int>(a)) ++next[static_cast<std::size_t>(b)];
    }
  result.rows.offset.resize(static_cast<Index>(n) + 1);
  result.rows.offset[0] = 0;
  for (std::size_t a = 0; a < n; ++a) {
    const auto row = static_cast<Index>(a);
    result.rows.offset[row + 1] = result.rows.offset[row] + next[a];
    next[a] = result.rows.offset[row];
  }
  result.rows.member.resize(result.rows.offset[static_cast<Index>(n)]);
  result.K.resize(result.rows.member.size());
  // Rows ascending: all columns below a have entered row a before those above it do.
  for (std::size_t a = 0; a < n; ++a) {
    const LowerRow row = std::move(lower[a]);
    for (std::size_t k = 0; k < row.column.size(); ++k) {
      const auto b = static_cast<std::size_t>(row.column[k]);
      result.rows.member[next[a]] = row.column[k];
      result.K[next[a]++] = row.value[k];
      if (b == a) continue;
      result.rows.member[next[b]] = static_cast<int>(a);
      result.K[next[b]++] = row.value[k];
    }
    lower[a] = {};
  }
}

// What the derivatives owe: a constant has no gradient, and the gradient of x is the identity.
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

}  // namespace

std::shared_ptr<const Sight> sight_in(const Discretisation& model, const SupportOptions& options) {
  if (!options.through_tissue || model.surface.empty()) return {};
  auto sight = std::make_shared<const Sight>(model, options.radius_factor * model.spacing);
  return sight->all_clear() ? nullptr : sight;
}

namespace {

// In the body's own axes: how well nodes span the basis is judged along the axes, and must not depend on how
// the image is turned.
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
                       mm.x(), mm.y(), mm.z(), largest_growth),
       .why = "the cloud is too sparse or too flat there",
       .remedy = fmt::format("raise support.radius_factor from {:.2f}, or ask for more nodes "
                             "(--nodes)",
                             options.radius_factor),
       .code = s.failed_nodes < enough_nodes ? "supports" : "conditioning"});
}

// Room in the lists for those of points [0, done), which hold so many nodes; for all, if the others have
// about as many.
void make_room(Model& model, Index members, Index done) {
  if (members > most_members)
    throw ModelError({.fact = fmt::format("the supports hold over {} nodes in all, {} at each of {} points",
                                          most_members, members / done, model.point_count()),
                      .where = "support domains",
                      .why = "their lists are numbered with 32 bits",
                      .remedy = "ask for fewer nodes (--nodes) or points (--points), or a smaller --support",
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

// Takes the supports of points from `first` on into the model's lists.
void take_slab(Model& model, const InOwnAxes& at_rest, Index first, const std::vector<PointSupport>& found) {
  const auto count = static_cast<Index>(found.size());
  Index members = model.support.offset[first];
  for (const PointSupport& s : found) members += static_cast<Index>(s.nodes.size());
  make_room(model, members, first + count);
  for (Index k = 0; k < count; ++k) {
    const Index q = first + k;
    const PointSupport& s = found[static_cast<std::size_t>(k)];
    if (!s.ok) refuse_support(model.scheme.support, q, s, at_rest.point.col(q) * 1e3);
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

// From the axes that they were found in; what was left of the lists' room is given back.
void finish_lists(Model& model, const InOwnAxes& at_rest) {
  const Index members = model.support.offset[model.point_count()];
  model.support.member.conservativeResize(members);
  model.dphi.conservativeResize(3, members);
  if (!at_rest.axes.isIdentity(0.0))
    tbb::parallel_for(tbb::blocked_range<Index>(0, members, 4096), [&](const auto& range) {
      for (Index k = range.begin(); k < range.end(); ++k)
        model.dphi.col(k) = at_rest.axes * model.dphi.col(k);
    });
  model.support_report.mean = static_cast<double>(members) / static_cast<double>(model.point_count());
}

void supports_of(Model& model, const Connected& sees) {
  const InOwnAxes at_rest(model);
  const SupportOptions& options = model.scheme.support;
  const Cloud cloud(model, options);
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
  std::vector<PointSupport> found;  // one slab's after the other's, in the same memory
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
    const Near near = nodes_near(model.point.middleCols(first, count), cloud,
                                 averaged ? Eigen::VectorXd(margin.segment(first, count)) : margin,
                                 hidden ? connected : Connected());
    tbb::parallel_for(Index{0}, count, [&](Index k) {
      stop_if_asked();
      const Index q = first + k;
      PointSupport& s = found[static_cast<std::size_t>(k)];
      static_cast<PointReport&>(s) = {};
      std::function<bool(int)> to_point;
      if (hidden) to_point = [&](int a) { return connected(a, k); };
      if (averaged)
        over_cell(q, cloud, near.of(k), to_point, model.volume[q], s);
      else
        at_point(q, cloud, near.of(k), to_point, s);
      if (s.ok) s.linear_error = linear_error(model, q, s, mean_radius);
    });
    report.unseen += unseen;
    take_slab(model, at_rest, first, found);
    for (auto& [t, rows] : variance)
      add_variance(found, {of_point.data() + first, static_cast<std::size_t>(count)}, t, slot, rows);
  }
  finish_lists(model, at_rest);
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

Interpolation make_interpolation(const Discretisation& body, const SupportOptions& options,
                                 const Points& places, const Connected& connected) {
  const Cloud cloud(body, options);
  const bool masked = static_cast<bool>(connected);
  const auto near = nodes_near(places, cloud, {}, connected);
  struct Row {
    std::vector<int> member;
    std::vector<double> weight;
  };
  std::vector<Row> rows(static_cast<std::size_t>(places.cols()));
  const auto by_itself = [&](Index m) {
    std::function<bool(int)> to_place;
    if (masked) to_place = [&](int a) { return connected(a, m); };
    const PlaceSupport s = support_of(places.col(m), cloud, near.of(m), to_place);
    Row& row = rows[static_cast<std::size_t>(m)];
    if (s.ok && !s.unconnected) {
      row = {s.nodes, {s.phi.begin(), s.phi.end()}};
      return;
    }
    const auto away = [&](int a) { return (body.X.col(a) - places.col(m)).norm(); };
    const auto there = near.of(m);
    row = {{there.empty() ? cloud.tree.nearest(places.col(m), 1).front()
                          : *std::min_element(there.begin(), there.end(),
                                              [&](int a, int b) { return away(a) < away(b); })},
           {1.0}};
  };
  tbb::parallel_for(Index{0}, (places.cols() + cell_places - 1) / cell_places, [&](Index group) {
    stop_if_asked();
    const Index first = group * cell_places, last = std::min(first + cell_places, places.cols());
    if (last - first < cell_places) {
      for (Index m = first; m < last; ++m) by_itself(m);
      return;
    }
    thread_local std::vector<int> nodes;
    thread_local MlsOfEight eight;
    nodes.clear();
    for (Index m = first; m < last; ++m) nodes.insert(nodes.end(), near.of(m).begin(), near.of(m).end());
    std::sort(nodes.begin(), nodes.end());
    nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
    mls_of_eight(places.middleCols(first, cell_places), body.X, nodes, cloud.radius, cloud.pinned,
                 options.interpolation, false, eight);
    for (Index m = first; m < last; ++m) {
      const auto k = static_cast<std::size_t>(m - first);
      // Another place of the eight may be connected with a node that this one is not.
      const bool same = !masked || eight.reached[k] == static_cast<int>(near.of(m).size());
      if (!same || !surely_good(eight, k)) {
        by_itself(m);
        continue;
      }
      const double* phi = eight.rows.data() + (m - first) * eight.stride;
      Row& row = rows[static_cast<std::size_t>(m)];
      row.member.reserve(static_cast<std::size_t>(eight.reached[k]));
      row.weight.reserve(static_cast<std::size_t>(eight.reached[k]));
      for (std::size_t e = 0; e < eight.nodes.size(); ++e)
        if (phi[e] != 0.0) {
          row.member.push_back(eight.nodes[e]);
          row.weight.push_back(phi[e]);
        }
    }
  });

  Interpolation result;
  result.rows.offset.resize(places.cols() + 1);
  result.rows.offset[0] = 0;
  for (Index m = 0; m < places.cols(); ++m)
    result.rows.offset[m + 1] =
        result.rows.offset[m] + static_cast<int>(rows[static_cast<std::size_t>(m)].member.size());
  result.rows.member.resize(result.rows.offset[places.cols()]);
  result.weight.resize(result.rows.member.size());
  for (Index m = 0; m < places.cols(); ++m) {
    const Row& row = rows[static_cast<std::size_t>(m)];
    std::copy(row.member.begin(), row.member.end(), result.rows.member.data() + result.rows.offset[m]);
    std::copy(row.weight.begin(), row.weight.end(), result.weight.data() + result.rows.offset[m]);
  }
  return result;
}

namespace {

Connected members_of(const CompressedRows& rows) {
  return [&rows](int a, Index m) {
    return std::binary_search(rows.member.data() + rows.offset[m], rows.member.data() + rows.offset[m + 1],
                              a);
  };
}

// A model that make_model() has not made has none at hand.
std::shared_ptr<const Sight> sight_of(const Model& model) {
  if (model.sight || model.support_report.unseen == 0) return model.sight;
  return sight_in(model, model.scheme.support);
}

// Of places, the nodes that they are connected with: those of the supports of the nearest points that
// `reaches`(point, place) holds for. Good enough for pictures, and cheaper than to ask every node.
template <class Reaches>
CompressedRows nodes_by_points(const Model& model, const Points& places, Reaches&& reaches) {
  constexpr int asked = 12, enough = 2;
  const Neighbours points(model.point);
  std::vector<std::vector<int>> nodes(static_cast<std::size_t>(places.cols()));
  tbb::parallel_for(Index{0}, places.cols(), [&](Index m) {
    if (m % 256 == 0) stop_if_asked();
    std::vector<int>& list = nodes[static_cast<std::size_t>(m)];
    int taken = 0;
    for (const int q : points.nearest(places.col(m), asked)) {
      if (!reaches(q, m)) continue;
      list.insert(list.end(), model.support.member.data() + model.support.offset[q],
                  model.support.member.data() + model.support.offset[q + 1]);
      if (++taken == enough) break;
    }
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  });
  CompressedRows result;
  result.offset.resize(places.cols() + 1);
  result.offset[0] = 0;
  for (Index m = 0; m < places.cols(); ++m)
    result.offset[m + 1] = result.offset[m] + static_cast<int>(nodes[static_cast<std::size_t>(m)].size());
  result.member.resize(result.offset[places.cols()]);
  for (Index m = 0; m < places.cols(); ++m)
    std::copy(nodes[static_cast<std::size_t>(m)].begin(), nodes[static_cast<std::size_t>(m)].end(),
              result.member.data() + result.offset[m]);
  return result;
}

}  // namespace

Interpolation surface_interpolation(const Model& model) {
  std::vector<Index> all(static_cast<std::size_t>(model.surface.vertex_mm.cols()));
  std::iota(all.begin(), all.end(), Index{0});
  return surface_interpolation(model, all);
}

Interpolation surface_interpolation(const Model& model, const std::vector<Index>& vertices) {
  const Points places = model.surface.vertex_mm * 1e-3;
  Points normals = Points::Zero(3, places.cols());
  for (const auto& t : model.surface.triangles.colwise()) {
    const Vec3 a = places.col(t[0]), n = (places.col(t[1]) - a).cross(places.col(t[2]) - a);
    for (const Index v : t) normals.col(v) += n;
  }
  return surface_interpolation(model, places(Eigen::all, vertices), normals(Eigen::all, vertices));
}

Interpolation surface_interpolation(const Model& model, const Points& places, const Points& normals) {
  if (model.support_report.unseen == 0) return make_interpolation(model, model.scheme.support, places);
  CompressedRows allowed;
  if (const auto sight = sight_of(model))
    allowed = nodes_by_points(model, places, [&](int q, Index m) {  // behind the surface
      return (model.point.col(q) - places.col(m)).dot(normals.col(m)) < 0.0 &&
             sight->point_sees(q, places.col(m));
    });
  return make_interpolation(model, model.scheme.support, places,
                            allowed.offset.size() > 0 ? members_of(allowed) : Connected());
}

Interpolation inner_interpolation(const Model& model, const Points& places) {
  CompressedRows allowed;
  if (const auto sight = sight_of(model))
    allowed =
        nodes_by_points(model, places, [&](int q, Index m) { return sight->point_sees(q, places.col(m)); });
  return make_interpolation(model, model.scheme.support, places,
                            allowed.offset.size() > 0 ? members_of(allowed) : Connected());
}

Interpolation node_interpolation(const Model& model) {
  if (model.support_report.unseen == 0) return make_interpolation(model, model.scheme.support, model.X);
  const Connected belongs = members_of(model.support);
  const CompressedRows allowed =
      nodes_by_points(model, model.X, [&](int q, Index m) { return belongs(static_cast<int>(m), q); });
  return make_interpolation(model, model.scheme.support, model.X, members_of(allowed));
}

Interpolation point_interpolation(const Model& model) {
  return make_interpolation(model, model.scheme.support, model.point,
                            model.support_report.unseen > 0 ? members_of(model.support) : Connected());
}

Eigen::MatrixXd Interpolation::operator()(const Eigen::MatrixXd& nodal) const {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(nodal.rows(), rows.rows());
  for (Index m = 0; m < rows.rows(); ++m)
    for (int k = rows.offset[m]; k < rows.offset[m + 1]; ++k)
      result.col(m) += weight[k] * nodal.col(rows.member[k]);
  return result;
}

struct FieldAnywhere::Parts {
  explicit Parts(const Model& m) : model(m), cloud(m, m.scheme.support), sight(sight_of(m)) {
    if (sight) points.emplace(m.point);
  }
  const Model& model;
  Cloud cloud;
  std::shared_ptr<const Sight> sight;
  std::optional<Neighbours> points;

  // The nodes that x is connected with, by the nearest points that see it; `first` of them, or -1.
  void connected_with(const Vec3& x, std::vector<int>& nodes, int& first) const {
    constexpr int asked = 12, enough = 2;
    nodes.clear();
    first = -1;
    int taken = 0;
    const auto take = [&](int q) {
      nodes.insert(nodes.end(), model.support.member.data() + model.support.offset[q],
                   model.support.member.data() + model.support.offset[q + 1]);
      if (first < 0) first = q;
      return ++taken == enough;
    };
    const std::vector<int> nearest = points->nearest(x, asked);
    for (const int q : nearest)
      if (sight->point_sees(q, x) && take(q)) break;
    if (nodes.empty()) take(nearest.front());
    std::sort(nodes.begin(), nodes.end());
    nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  }

  // One place with larger supports where it needs them; where none serves, the nearest node's value.
  void by_itself(const Vec3& x, const Points& nodal, std::span<const int> near_x,
                 const std::vector<int>* allowed, Index k, Points& value,
                 Eigen::Matrix<double, 9, Eigen::Dynamic>* derivative) const {
    std::function<bool(int)> connected;
    if (allowed) connected = [&](int a) { return std::binary_search(allowed->begin(), allowed->end(), a); };
    std::vector<int> reaching(near_x.begin(), near_x.end());
    if (connected) std::erase_if(reaching, [&](int a) { return !connected(a); });
    const PlaceSupport s = support_of(x, cloud, reaching, connected);
    value.col(k).setZero();
    if (derivative) derivative->col(k).setZero();
    if (!s.ok) {
      value.col(k) = nodal.col(cloud.tree.nearest(x, 1).front());
      return;
    }
    for (std::size_t m = 0; m < s.nodes.size(); ++m) {
      const auto column = static_cast<Index>(m);
      const Vec3 u = nodal.col(s.nodes[m]);
      value.col(k) += s.phi[column] * u;
      if (derivative) derivative->col(k) += (u * s.dphi.col(column).transpose()).reshaped();
    }
  }
};

FieldAnywhere::FieldAnywhere(const Model& model) : parts_(std::make_unique<Parts>(model)) {}
FieldAnywhere::~FieldAnywhere() = default;

void FieldAnywhere::at(const Points& places, const Points& nodal, Points& value,
                       Eigen::Matrix<double, 9, Eigen::Dynamic>* derivative) const {
  const Parts& p = *parts_;
  const Index count = places.cols();
  value.resize(3, count);
  if (derivative) derivative->resize(9, count);
  if (count == 0) return;
  const Vec3 centre = places.rowwise().mean();
  const double extent = (places.colwise() - centre).colwise().norm().maxCoeff();
  thread_local std::vector<int> nodes;
  p.cloud.reaching(centre, 1.0, nodes, extent);

  // Places of which the first one's nearest point sees all are connected with the same nodes.
  bool alike = true;
  thread_local std::array<std::vector<int>, most_places> allowed;
  thread_local std::vector<int> all_allowed, reaching;
  const bool hidden =
      p.sight && std::any_of(nodes.begin(), nodes.end(), [&](int a) { return !p.sight->sees_all(a); });
  reaching.assign(nodes.begin(), nodes.end());
  if (hidden) {
    all_allowed.clear();
    int first = -1, own = -1;
    for (Index k = 0; k < count; ++k) {
      auto& list = allowed[static_cast<std::size_t>(k)];
      p.connected_with(places.col(k), list, own);
      if (k == 0) first = own;
      alike = alike && (k == 0 || own == first || p.sight->point_sees(first, places.col(k)));
      all_allowed.insert(all_allowed.end(), list.begin(), list.end());
    }
    std::sort(all_allowed.begin(), all_allowed.end());
    all_allowed.erase(std::unique(all_allowed.begin(), all_allowed.end()), all_allowed.end());
    std::erase_if(reaching,
                  [&](int a) { return !std::binary_search(all_allowed.begin(), all_allowed.end(), a); });
  }
  const auto single = [&](Index k) {
    const std::vector<int>* list = !hidden ? nullptr
                                   : alike ? &all_allowed
                                           : &allowed[static_cast<std::size_t>(k)];
    p.by_itself(places.col(k), nodal, nodes, list, k, value, derivative);
  };
  const SupportOptions& options = p.cloud.options;
  if (!alike || reaching.empty()) {
    for (Index k = 0; k < count; ++k) single(k);
    return;
  }
  thread_local MlsOfEight eight;
  Points x(3, cell_places);  // places that are not there repeat the last
  for (Index k = 0; k < cell_places; ++k) x.col(k) = places.col(std::min(k, count - 1));
  value.setZero();
  mls_of_eight(x, p.model.X, reaching, p.cloud.radius, p.cloud.pinned, options.interpolation, false, eight);
  std::array<bool, most_places> good{};
  for (Index k = 0; k < count; ++k) {
    good[static_cast<std::size_t>(k)] = surely_good(eight, static_cast<std::size_t>(k));
    if (!good[static_cast<std::size_t>(k)]) {
      single(k);
      continue;
    }
    const double* phi = eight.rows.data() + k * eight.stride;
    Vec3 sum = Vec3::Zero();
    for (std::size_t e = 0; e < eight.nodes.size(); ++e) sum += phi[e] * nodal.col(eight.nodes[e]);
    value.col(k) = sum;
  }
  if (!derivative) return;
  mls_of_eight(x, p.model.X, reaching, p.cloud.radius, p.cloud.pinned, options.interpolation, true, eight);
  for (Index k = 0; k < count; ++k) {
    if (!good[static_cast<std::size_t>(k)]) continue;
    Mat3 sum = Mat3::Zero();
    const double* row = eight.rows.data() + 3 * k * eight.stride;
    for (std::size_t e = 0; e < eight.nodes.size(); ++e)
      sum += nodal.col(eight.nodes[e]) *
             Eigen::RowVector3d(row[e], row[static_cast<std::size_t>(eight.stride) + e],
                                row[2 * static_cast<std::size_t>(eight.stride) + e]);
    derivative->col(k) = sum.reshaped();
  }
}

}  // namespace dimple
