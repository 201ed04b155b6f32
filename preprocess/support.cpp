#include "preprocess/support.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include "io/error.hpp"
#include "preprocess/neighbours.hpp"

namespace dimple {
namespace {

constexpr double largest_growth = 2.5;

struct PointSupport {
  std::vector<int> nodes;
  Eigen::VectorXd phi;
  Points dphi;
  double growth = 1.0;
  MlsResult mls;
  bool ok = false;
};

// A node far away may have a large radius in a graded cloud: search with the largest, keep those that reach
// x.
void nodes_reaching(const Vec3& x, const Model& model, const Neighbours& tree, const Eigen::VectorXd& radius,
                    double largest_radius, double growth, std::vector<int>& nodes) {
  tree.within(x, largest_radius * growth, nodes);
  std::erase_if(nodes, [&](int a) { return (model.X.col(a) - x).norm() >= radius[a] * growth; });
}

PointSupport support_of(const Vec3& x, const Model& model, const Neighbours& tree,
                        const Eigen::VectorXd& radius, double largest_radius, const SupportOptions& options) {
  const std::size_t terms = options.basis == Basis::linear ? 4 : 10;
  PointSupport result;
  for (result.growth = 1.0; result.growth <= largest_growth; result.growth *= 1.1) {
    nodes_reaching(x, model, tree, radius, largest_radius, result.growth, result.nodes);
    if (result.nodes.size() < 2 * terms) continue;
    result.mls = mls_shape_functions(x, model.X, result.nodes, radius, result.growth, options, result.phi,
                                     result.dphi);
    if (result.mls.ok()) {
      result.ok = true;
      break;
    }
  }
  return result;
}

struct Supports {
  std::vector<PointSupport> at;
  CompressedRows rows;
};

Supports supports_at(const Points& places, const Model& model, const SupportOptions& options) {
  const Neighbours tree(model.X);
  const Eigen::VectorXd radius = options.effective_radius_factor() * model.spacing;
  const double largest_radius = radius.maxCoeff();

  Supports result;
  result.at.resize(static_cast<std::size_t>(places.cols()));
  tbb::parallel_for(Index{0}, places.cols(), [&](Index q) {
    result.at[static_cast<std::size_t>(q)] =
        support_of(places.col(q), model, tree, radius, largest_radius, options);
  });

  result.rows.offset.resize(places.cols() + 1);
  result.rows.offset[0] = 0;
  for (Index q = 0; q < places.cols(); ++q)
    result.rows.offset[q + 1] =
        result.rows.offset[q] + static_cast<int>(result.at[static_cast<std::size_t>(q)].nodes.size());
  result.rows.member.resize(result.rows.offset[places.cols()]);
  for (Index q = 0; q < places.cols(); ++q)
    std::copy(result.at[static_cast<std::size_t>(q)].nodes.begin(),
              result.at[static_cast<std::size_t>(q)].nodes.end(),
              result.rows.member.data() + result.rows.offset[q]);
  return result;
}

}  // namespace

SupportReport find_supports(Model& model, const SupportOptions& options) {
  Supports found = supports_at(model.point, model, options);

  SupportReport report;
  report.fewest = model.node_count();
  model.dphi.resize(3, found.rows.member.size());
  for (Index q = 0; q < model.point_count(); ++q) {
    const PointSupport& s = found.at[static_cast<std::size_t>(q)];
    const Index n = static_cast<Index>(s.nodes.size());
    if (!s.ok) {
      const Vec3 x = model.point.col(q) * 1e3;
      throw ModelError(
          {.fact =
               fmt::format("integration point {} has {} nodes in its support, which do not span "
                           "the {} basis (pivot ratio {:.1e})",
                           q, n, options.basis == Basis::linear ? "linear" : "quadratic", s.mls.pivot_ratio),
           .where = fmt::format("support domains; point at ({:.2f}, {:.2f}, {:.2f}) mm, radii enlarged "
                                "{:.1f} times",
                                x.x(), x.y(), x.z(), largest_growth),
           .why = "the cloud is too sparse or too flat there",
           .remedy = fmt::format("raise support.radius_factor from {:.2f}, or ask for more nodes "
                                 "(--nodes) or a linear basis",
                                 options.effective_radius_factor())});
    }
    const Index first = found.rows.offset[q];
    model.dphi.middleCols(first, n) = s.dphi;

    if (s.growth > 1.0) ++report.grown;
    report.largest_growth = std::max(report.largest_growth, s.growth);
    report.fewest = std::min(report.fewest, n);
    report.most = std::max(report.most, n);
    report.worst_pivot_ratio = std::min(report.worst_pivot_ratio, s.mls.pivot_ratio);

    // What the derivatives owe: a constant has no gradient, and the gradient of x is the identity.
    Mat3 of_position = Mat3::Zero();
    for (Index k = 0; k < n; ++k)
      of_position += (model.X.col(s.nodes[static_cast<std::size_t>(k)]) - model.point.col(q)) *
                     s.dphi.col(k).transpose();
    const double radius = options.effective_radius_factor() * model.spacing.mean();
    const double error = std::max((of_position - Mat3::Identity()).cwiseAbs().maxCoeff(),
                                  s.dphi.rowwise().sum().cwiseAbs().maxCoeff() * radius);
    report.linear_error = std::max(report.linear_error, error);
  }
  report.mean = static_cast<double>(found.rows.member.size()) / static_cast<double>(model.point_count());
  model.support = std::move(found.rows);
  return report;
}

Interpolation make_interpolation(const Model& model, const SupportOptions& options, const Points& places) {
  Supports found = supports_at(places, model, options);
  const Neighbours tree(model.X);

  Interpolation result;
  std::vector<int> member;
  std::vector<double> weight;
  result.rows.offset.resize(places.cols() + 1);
  result.rows.offset[0] = 0;
  for (Index m = 0; m < places.cols(); ++m) {
    const PointSupport& s = found.at[static_cast<std::size_t>(m)];
    if (s.ok) {
      member.insert(member.end(), s.nodes.begin(), s.nodes.end());
      weight.insert(weight.end(), s.phi.begin(), s.phi.end());
    } else {
      member.push_back(tree.nearest(places.col(m), 1).front());
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
