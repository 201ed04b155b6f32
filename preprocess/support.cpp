#include "preprocess/support.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <map>

#include "io/error.hpp"
#include "preprocess/neighbours.hpp"

namespace dimple {
namespace {

constexpr double largest_growth = 2.5;
constexpr Index slab = 16384;  // points whose local matrices are held at a time

struct PlaceSupport {
  std::vector<int> nodes;
  Eigen::VectorXd phi;
  Points dphi;
  double growth = 1.0;
  MlsResult mls;
  bool ok = false;
};

// What the places of one model share.
struct Cloud {
  Cloud(const Model& m, const SupportOptions& o)
      : model(m), options(o), tree(m.X), radius(o.effective_radius_factor() * m.spacing) {
    largest_radius = radius.maxCoeff();
    pinned.assign(static_cast<std::size_t>(m.node_count()), 0);
    for (const auto* set : {&m.base, &m.indenter})
      for (const Index a : *set) pinned[static_cast<std::size_t>(a)] = 1;
  }
  const Model& model;
  const SupportOptions& options;
  Neighbours tree;
  Eigen::VectorXd radius;
  double largest_radius = 0.0;
  std::vector<char> pinned;
};

// `near`: all nodes that reach x ungrown, and perhaps others.
PlaceSupport support_of(const Vec3& x, const Cloud& cloud, const std::vector<int>& near) {
  const std::size_t terms = cloud.options.basis == Basis::linear ? 4 : 10;
  PlaceSupport result;
  result.nodes = near;
  for (result.growth = 1.0; result.growth <= largest_growth; result.growth *= 1.1) {
    if (result.growth > 1.0) cloud.tree.within(x, cloud.largest_radius * result.growth, result.nodes);
    std::erase_if(result.nodes, [&](int a) {
      return (cloud.model.X.col(a) - x).norm() >= cloud.radius[a] * result.growth;
    });
    if (result.nodes.size() < 2 * terms) continue;
    result.mls = mls_shape_functions(x, cloud.model.X, result.nodes, cloud.radius, result.growth,
                                     cloud.options, cloud.pinned, result.phi, result.dphi);
    if (result.mls.ok()) {
      result.ok = true;
      break;
    }
  }
  return result;
}

// For each place the nodes whose radius comes within `margin` of it, ascending. Nodes ask, not places: in a
// graded cloud a place would have to look as far as the largest radius of all.
std::vector<std::vector<int>> nodes_near(const Points& places, const Cloud& cloud,
                                         const Eigen::VectorXd& margin) {
  const Neighbours tree(places);
  const double largest_margin = margin.size() > 0 ? margin.maxCoeff() : 0.0;
  std::vector<std::vector<int>> of_node(static_cast<std::size_t>(cloud.model.node_count()));
  tbb::parallel_for(Index{0}, cloud.model.node_count(), [&](Index a) {
    std::vector<int>& found = of_node[static_cast<std::size_t>(a)];
    tree.within_unordered(cloud.model.X.col(a), cloud.radius[a] + largest_margin, found);
    if (margin.size() > 0)
      std::erase_if(found, [&](int q) {
        return (places.col(q) - cloud.model.X.col(a)).norm() >= cloud.radius[a] + margin[q];
      });
  });
  std::vector<std::vector<int>> result(static_cast<std::size_t>(places.cols()));
  for (std::size_t a = 0; a < of_node.size(); ++a)
    for (const int q : of_node[a]) result[static_cast<std::size_t>(q)].push_back(static_cast<int>(a));
  return result;
}

// The symmetric root in the frame of the image's axes: smooth in the spread, and it turns with the body.
Mat3 root_of_spread(const Model& model, Index q) {
  const auto s = model.spread.col(q);
  Mat3 about;
  about << s[0], s[3], s[5], s[3], s[1], s[4], s[5], s[4], s[2];
  about = model.axes.transpose() * about * model.axes;
  const double size = about.trace();
  if (!(size > 0.0)) return Mat3::Zero();
  const Eigen::SelfAdjointEigenSolver<Mat3> solver(about / size);
  const Vec3 root = (solver.eigenvalues().cwiseMax(0.0) * size).cwiseSqrt();
  return model.axes * solver.eigenvectors() * root.asDiagonal() * solver.eigenvectors().transpose();
}

// A point's support, and the local matrix of the variance, its lower triangle row by row.
struct PointSupport {
  std::vector<int> nodes;
  Points dphi;
  std::vector<double> variance;
  Index grown = 0;
  double largest_growth = 1.0;
  double worst_pivot_ratio = 1.0;
  bool ok = true;
  MlsResult failed;
  std::size_t failed_nodes = 0;
};

void take(PointSupport& result, const PlaceSupport& place) {
  if (place.growth > 1.0) ++result.grown;
  result.largest_growth = std::max(result.largest_growth, place.growth);
  result.worst_pivot_ratio = std::min(result.worst_pivot_ratio, place.mls.pivot_ratio);
  if (place.ok || !result.ok) return;
  result.ok = false;
  result.failed = place.mls;
  result.failed_nodes = place.nodes.size();
}

PointSupport at_point(Index q, const Cloud& cloud, const std::vector<int>& near) {
  PointSupport result;
  PlaceSupport place = support_of(cloud.model.point.col(q), cloud, near);
  take(result, place);
  result.nodes = std::move(place.nodes);
  result.dphi = std::move(place.dphi);
  return result;
}

PointSupport over_cell(Index q, const Cloud& cloud, const std::vector<int>& near, double weight) {
  constexpr int places = 8;
  const Mat3 root = root_of_spread(cloud.model, q);
  PointSupport result;
  std::array<PlaceSupport, places> at;
  for (int k = 0; k < places; ++k) {
    const Vec3 sign(k & 1 ? 1.0 : -1.0, k & 2 ? 1.0 : -1.0, k & 4 ? 1.0 : -1.0);
    PlaceSupport& place = at[static_cast<std::size_t>(k)] =
        support_of(cloud.model.point.col(q) + root * sign, cloud, near);
    take(result, place);
    if (!result.ok) return result;
    result.nodes.insert(result.nodes.end(), place.nodes.begin(), place.nodes.end());
  }
  std::sort(result.nodes.begin(), result.nodes.end());
  result.nodes.erase(std::unique(result.nodes.begin(), result.nodes.end()), result.nodes.end());

  const auto n = static_cast<Index>(result.nodes.size());
  Eigen::MatrixXd gradient = Eigen::MatrixXd::Zero(3 * places, n);  // of place k in rows 3k, 3k+1, 3k+2
  for (int k = 0; k < places; ++k) {
    const PlaceSupport& place = at[static_cast<std::size_t>(k)];
    Index column = 0;
    for (std::size_t m = 0; m < place.nodes.size(); ++m) {
      while (result.nodes[static_cast<std::size_t>(column)] != place.nodes[m]) ++column;
      gradient.block<3, 1>(3 * k, column) = place.dphi.col(static_cast<Index>(m));
    }
  }
  result.dphi = Points::Zero(3, n);
  for (int k = 0; k < places; ++k) result.dphi += gradient.middleRows<3>(3 * k);
  result.dphi /= places;
  for (int k = 0; k < places; ++k) gradient.middleRows<3>(3 * k) -= result.dphi;
  result.variance.reserve(static_cast<std::size_t>(n * (n + 1) / 2));
  for (Index a = 0; a < n; ++a)
    for (Index b = 0; b <= a; ++b)
      result.variance.push_back(weight / places * gradient.col(a).dot(gradient.col(b)));
  return result;
}

using SparseRow = std::vector<std::pair<int, double>>;

// Adds the local matrices of points first, first + 1, ... to the rows; row by row, points ascending, so that
// the sums have one order.
void add_variance(const std::vector<PointSupport>& points, std::span<const int> tissue, int wanted,
                  std::vector<SparseRow>& rows) {
  std::vector<std::vector<std::pair<int, int>>> influence(rows.size());  // point, place in its list
  for (std::size_t q = 0; q < points.size(); ++q)
    if (tissue[q] == wanted)
      for (std::size_t k = 0; k < points[q].nodes.size(); ++k)
        influence[static_cast<std::size_t>(points[q].nodes[k])].push_back(
            {static_cast<int>(q), static_cast<int>(k)});
  tbb::parallel_for(std::size_t{0}, rows.size(), [&](std::size_t a) {
    if (influence[a].empty()) return;
    thread_local std::vector<double> sum;
    thread_local std::vector<char> seen;
    thread_local std::vector<int> members;
    sum.resize(rows.size());
    seen.resize(rows.size());
    members.clear();
    const auto add = [&](int b, double value) {
      const auto at = static_cast<std::size_t>(b);
      if (!seen[at]) {
        seen[at] = 1;
        sum[at] = 0.0;
        members.push_back(b);
      }
      sum[at] += value;
    };
    for (const auto& [b, value] : rows[a]) add(b, value);
    for (const auto& [q, k] : influence[a]) {
      const PointSupport& point = points[static_cast<std::size_t>(q)];
      const auto row = static_cast<std::size_t>(k);
      for (std::size_t m = 0; m < point.nodes.size(); ++m) {
        const std::size_t high = std::max(row, m), low = std::min(row, m);
        add(point.nodes[m], point.variance[high * (high + 1) / 2 + low]);
      }
    }
    std::sort(members.begin(), members.end());
    rows[a].clear();
    for (const int b : members) {
      rows[a].push_back({b, sum[static_cast<std::size_t>(b)]});
      seen[static_cast<std::size_t>(b)] = 0;
    }
  });
}

}  // namespace

SupportReport find_supports(Model& model, const SupportOptions& options, const Eigen::VectorXi& tissue) {
  const Cloud cloud(model, options);
  const bool averaged = model.spread.cols() > 0;
  Eigen::VectorXd margin;
  if (averaged)
    margin = model.spread.topRows<3>().colwise().sum().cwiseMax(0.0).cwiseSqrt().transpose() * 1.8;
  const auto near = nodes_near(model.point, cloud, margin);

  SupportReport report;
  report.fewest = model.node_count();
  std::vector<int> member;
  std::vector<double> dphi;
  const Eigen::VectorXi of_point = tissue.size() > 0 ? tissue : Eigen::VectorXi::Zero(model.point_count());
  std::map<int, std::vector<SparseRow>> variance;  // of each tissue
  if (averaged)
    for (const int t : of_point) variance[t].resize(static_cast<std::size_t>(model.node_count()));
  model.support.offset.resize(model.point_count() + 1);
  model.support.offset[0] = 0;
  for (Index first = 0; first < model.point_count(); first += slab) {
    const Index count = std::min(slab, model.point_count() - first);
    std::vector<PointSupport> found(static_cast<std::size_t>(count));
    tbb::parallel_for(Index{0}, count, [&](Index k) {
      const Index q = first + k;
      const auto& candidates = near[static_cast<std::size_t>(q)];
      found[static_cast<std::size_t>(k)] =
          averaged ? over_cell(q, cloud, candidates, model.volume[q]) : at_point(q, cloud, candidates);
    });
    for (Index k = 0; k < count; ++k) {
      const Index q = first + k;
      const PointSupport& s = found[static_cast<std::size_t>(k)];
      const Index n = static_cast<Index>(s.nodes.size());
      if (!s.ok) {
        const Vec3 x = model.point.col(q) * 1e3;
        throw ModelError(
            {.fact = fmt::format("integration point {} has {} nodes in its support, which do not span "
                                 "the {} basis (pivot ratio {:.1e})",
                                 q, s.failed_nodes, options.basis == Basis::linear ? "linear" : "quadratic",
                                 s.failed.pivot_ratio),
             .where = fmt::format("support domains; point at ({:.2f}, {:.2f}, {:.2f}) mm, radii enlarged "
                                  "{:.1f} times",
                                  x.x(), x.y(), x.z(), largest_growth),
             .why = "the cloud is too sparse or too flat there",
             .remedy = fmt::format("raise support.radius_factor from {:.2f}, or ask for more nodes "
                                   "(--nodes) or a linear basis",
                                   options.effective_radius_factor())});
      }
      member.insert(member.end(), s.nodes.begin(), s.nodes.end());
      dphi.insert(dphi.end(), s.dphi.data(), s.dphi.data() + s.dphi.size());
      model.support.offset[q + 1] = static_cast<int>(member.size());

      report.grown += s.grown;
      report.largest_growth = std::max(report.largest_growth, s.largest_growth);
      report.fewest = std::min(report.fewest, n);
      report.most = std::max(report.most, n);
      report.worst_pivot_ratio = std::min(report.worst_pivot_ratio, s.worst_pivot_ratio);

      // What the derivatives owe: a constant has no gradient, and the gradient of x is the identity.
      Mat3 of_position = Mat3::Zero();
      for (Index m = 0; m < n; ++m)
        of_position += (model.X.col(s.nodes[static_cast<std::size_t>(m)]) - model.point.col(q)) *
                       s.dphi.col(m).transpose();
      const double radius = options.effective_radius_factor() * model.spacing.mean();
      const double error = std::max((of_position - Mat3::Identity()).cwiseAbs().maxCoeff(),
                                    s.dphi.rowwise().sum().cwiseAbs().maxCoeff() * radius);
      report.linear_error = std::max(report.linear_error, error);
    }
    for (auto& [t, rows] : variance)
      add_variance(found, {of_point.data() + first, static_cast<std::size_t>(count)}, t, rows);
  }
  report.mean = static_cast<double>(member.size()) / static_cast<double>(model.point_count());
  model.support.member = Eigen::Map<Eigen::VectorXi>(member.data(), static_cast<Index>(member.size()));
  model.dphi = Eigen::Map<Points>(dphi.data(), 3, static_cast<Index>(member.size()));

  model.variance.clear();
  for (const auto& [t, rows] : variance) {
    GradientVariance& v = model.variance.emplace_back();
    v.tissue = t;
    v.rows.offset.resize(model.node_count() + 1);
    v.rows.offset[0] = 0;
    for (std::size_t a = 0; a < rows.size(); ++a)
      v.rows.offset[static_cast<Index>(a) + 1] =
          v.rows.offset[static_cast<Index>(a)] + static_cast<int>(rows[a].size());
    v.rows.member.resize(v.rows.offset[model.node_count()]);
    v.K.resize(v.rows.member.size());
    Index at = 0;
    for (const SparseRow& row : rows)
      for (const auto& [b, value] : row) {
        v.rows.member[at] = b;
        v.K[at++] = value;
      }
  }
  return report;
}

Interpolation make_interpolation(const Model& model, const SupportOptions& options, const Points& places) {
  const Cloud cloud(model, options);
  const auto near = nodes_near(places, cloud, {});
  std::vector<PlaceSupport> found(static_cast<std::size_t>(places.cols()));
  tbb::parallel_for(Index{0}, places.cols(), [&](Index m) {
    found[static_cast<std::size_t>(m)] = support_of(places.col(m), cloud, near[static_cast<std::size_t>(m)]);
  });

  Interpolation result;
  std::vector<int> member;
  std::vector<double> weight;
  result.rows.offset.resize(places.cols() + 1);
  result.rows.offset[0] = 0;
  for (Index m = 0; m < places.cols(); ++m) {
    const PlaceSupport& s = found[static_cast<std::size_t>(m)];
    if (s.ok) {
      member.insert(member.end(), s.nodes.begin(), s.nodes.end());
      weight.insert(weight.end(), s.phi.begin(), s.phi.end());
    } else {
      member.push_back(cloud.tree.nearest(places.col(m), 1).front());
      weight.push_back(1.0);
    }
    result.rows.offset[m + 1] = static_cast<int>(member.size());
  }
  result.rows.member = Eigen::Map<Eigen::VectorXi>(member.data(), static_cast<Index>(member.size()));
  result.weight = Eigen::Map<Eigen::VectorXd>(weight.data(), static_cast<Index>(weight.size()));
  return result;
}

Eigen::MatrixXd Interpolation::operator()(const Eigen::MatrixXd& nodal) const {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(nodal.rows(), rows.rows());
  for (Index m = 0; m < rows.rows(); ++m)
    for (int k = rows.offset[m]; k < rows.offset[m + 1]; ++k)
      result.col(m) += weight[k] * nodal.col(rows.member[k]);
  return result;
}

}  // namespace dimple
