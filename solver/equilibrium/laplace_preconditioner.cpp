#include "solver/equilibrium/laplace_preconditioner.hpp"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "io/stop.hpp"
#include "solver/equilibrium/mixed_constants.hpp"

namespace dimple {
namespace {

using NodePairs = std::vector<std::pair<int, int>>;

// Pairs of neighbours a > b, ascending.
NodePairs neighbour_pairs(const Model& model) {
  constexpr Index each = 256;  // nodes
  std::vector<NodePairs> of_block(static_cast<std::size_t>((model.node_count() + each - 1) / each));
  tbb::parallel_for(std::size_t{0}, of_block.size(), [&](std::size_t block) {
    stop_if_requested();
    std::vector<std::pair<double, int>> near;
    const Index first = static_cast<Index>(block) * each, last = std::min(first + each, model.node_count());
    for (Index a = first; a < last; ++a) {
      near.clear();
      for (const GradientVariance& v : model.variance)
        for (int k = v.rows.offset[a]; k < v.rows.offset[a + 1]; ++k)
          if (const int b = v.rows.member[k]; b != a)
            near.emplace_back(
                (model.X.col(a) - model.X.col(b)).norm() / (0.5 * (model.spacing[a] + model.spacing[b])), b);
      std::sort(near.begin(), near.end());
      for (std::size_t k = 0; k < near.size(); ++k) {
        if (k >= mixed_constants.fewest_neighbours && near[k].first > mixed_constants.neighbour_distance)
          break;
        of_block[block].emplace_back(std::max(static_cast<int>(a), near[k].second),
                                     std::min(static_cast<int>(a), near[k].second));
      }
    }
  });
  NodePairs edge;
  for (const NodePairs& its : of_block) edge.insert(edge.end(), its.begin(), its.end());
  tbb::parallel_sort(edge.begin(), edge.end());
  edge.erase(std::unique(edge.begin(), edge.end()), edge.end());
  return edge;
}

// [N] Pa m^3: shear modulus x volume, distributed among the nodes.
Eigen::VectorXd shear_of_nodes(const Model& model, const ForceSystem& tissue) {
  constexpr Index slab = 65536;  // points whose fractions are held at a time
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(model.node_count()), fraction;
  for (Index from = 0; from < model.point_count(); from += slab) {
    stop_if_requested();
    const Index to = std::min(from + slab, model.point_count());
    const int first = model.support.offset[from];
    fraction.resize(model.support.offset[to] - first);
    tbb::parallel_for(tbb::blocked_range<Index>(from, to, 256), [&](const auto& range) {
      for (Index q = range.begin(); q < range.end(); ++q) {
        double* its = fraction.data() + model.support.offset[q] - first;
        double all = 0.0;  // one by one: the order of Eigen's sum depends on the numbers' alignment
        for (Index k = 0; k < model.support.count(q); ++k) {
          const int a = model.support.member[model.support.offset[q] + k];
          its[k] = std::exp(-4.0 * (model.X.col(a) - model.point.col(q)).squaredNorm() /
                            std::pow(model.spacing[a], 2));
          all += its[k];
        }
        for (Index k = 0; k < model.support.count(q); ++k)
          its[k] *= model.volume[q] * tissue.shear_modulus(q) / all;
      }
    });
    for (Index k = 0; k < fraction.size(); ++k) sum[model.support.member[first + k]] += fraction[k];
  }
  return sum;
}

// Norm of the tangent at F [Pa]: distortion by differences, and the point-wise bulk modulus.
double stiffness(const Material& m, const Mat3& F) {
  constexpr double h = mixed_constants.difference_of_F;
  const Mat3 P = distortional_stress(m, F);
  double square = 0.0;
  for (Index k = 0; k < 9; ++k) {
    Mat3 moved = F;
    moved(k) += h;
    square += ((distortional_stress(m, moved) - P) / h).squaredNorm();
  }
  return std::sqrt(square) + pointwise_bulk_modulus(m) * cofactor(F).squaredNorm();
}

}  // namespace

void NodalInverse::solve(const Nodal& r, Nodal& z) {
  for (std::size_t j = 0; j < node.size(); ++j)
    for (int i = 0; i < 4; ++i) b[j][i] = static_cast<float>(r(i, node[j]));
  multigrid.solve(b, x);
  z.setZero();
  for (std::size_t j = 0; j < node.size(); ++j)
    for (int i = 0; i < 4; ++i) z(i, node[j]) = static_cast<double>(x[j][i]);
}

LaplacePreconditioner::LaplacePreconditioner(System& body)
    : body_(body),
      model_(body.model()),
      edge_(neighbour_pairs(model_)),
      sliding_(body.held().sliding_directions()) {
  const Eigen::VectorXd shear = shear_of_nodes(model_, tissue());
  scale_ = (shear.array() / model_.spacing.array().square()).sqrt();
  // The Laplacian's energy of any linear field is that of the shear.
  Eigen::VectorXd lengths = Eigen::VectorXd::Zero(model_.node_count());
  for (const auto& [a, b] : edge_) {
    const double length = (model_.X.col(a) - model_.X.col(b)).squaredNorm();
    lengths[a] += length;
    lengths[b] += length;
  }
  undeformed_weight_ = weight_ =
      3.0 * mixed_constants.laplacian_stiffness * shear.array() / lengths.array().max(1e-30);
  if (!body.contacts().empty()) stiffen_single_nodes();
}

// [N] N/m: the tangent's diagonal at rest, the mean of a node's directions, without what volume adds.
Eigen::VectorXd LaplacePreconditioner::undeformed_diagonal() const {
  Eigen::VectorXd diagonal = Eigen::VectorXd::Zero(model_.node_count());
  std::vector<int> node;
  Points dphi;
  for (Index q = 0; q < model_.point_count(); ++q) {
    if (q % 4096 == 0) stop_if_requested();
    tissue().gradients_at(q, node, dphi);
    for (std::size_t k = 0; k < node.size(); ++k)
      diagonal[node[k]] +=
          model_.volume[q] * tissue().shear_modulus(q) * dphi.col(static_cast<Index>(k)).squaredNorm();
  }
  for (const GradientVariance& v : model_.variance) {
    const double its_mu = tissue().materials()[static_cast<std::size_t>(v.tissue)].mu;
    for (Index a = 0; a < diagonal.size(); ++a)
      for (int k = v.rows.offset[a]; k < v.rows.offset[a + 1]; ++k)
        if (v.rows.member[k] == a) diagonal[a] += its_mu * v.K[k];
  }
  return diagonal;
}

// A node with few neighbours around may be far stiffer than the mean that gives its weight. At first contact
// it bears the whole load and each step overshoots ten times, however short. Its weight is raised until A's
// diagonal is no less than the tangent's.
void LaplacePreconditioner::stiffen_single_nodes() {
  const Eigen::VectorXd tangent = undeformed_diagonal();
  Eigen::VectorXd of_others = Eigen::VectorXd::Zero(tangent.size()), count = of_others;
  for (const auto& [a, b] : edge_) {
    of_others[a] += undeformed_weight_[b];
    of_others[b] += undeformed_weight_[a];
    ++count[a];
    ++count[b];
  }
  for (Index a = 0; a < tangent.size(); ++a)
    if (count[a] > 0.0)
      weight_[a] = std::max(undeformed_weight_[a], (2.0 * tangent[a] - of_others[a]) / count[a]);
  undeformed_weight_ = weight_;
}

// [points] ratio of the law's stiffness at u to that at rest.
Eigen::VectorXd LaplacePreconditioner::stiffening(const Nodal& u) {
  body_.tissue().stress_sweep(u);
  const auto F = body_.tissue().deformation_gradients();
  std::vector<double> undeformed;
  for (const Material& m : tissue().materials()) undeformed.push_back(stiffness(m, Mat3::Identity()));
  Eigen::VectorXd ratio(model_.point_count());
  tbb::parallel_for(tbb::blocked_range<Index>(0, ratio.size(), 256), [&](const auto& range) {
    stop_if_requested();
    for (Index q = range.begin(); q < range.end(); ++q) {
      const auto number = static_cast<std::size_t>(tissue().tissues().of_point[q]);
      const Material& m = tissue().materials()[number];
      ratio[q] = std::clamp(stiffness(m, Eigen::Map<const Mat3>(F.col(q).data())) / undeformed[number], 1.0,
                            mixed_constants.largest_stiffening);
    }
  });
  return ratio;
}

void LaplacePreconditioner::stiffen(const Nodal& u) {
  const Eigen::VectorXd ratio = stiffening(u);
  // Each point counts as it does in the tangent's diagonal.
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(weight_.size()), all = sum;
  std::vector<int> node;
  Points dphi;
  for (Index q = 0; q < ratio.size(); ++q) {
    if (q % 4096 == 0) stop_if_requested();
    tissue().gradients_at(q, node, dphi);
    for (std::size_t k = 0; k < node.size(); ++k) {
      const double fraction = model_.volume[q] * dphi.col(static_cast<Index>(k)).squaredNorm();
      sum[node[k]] += fraction * ratio[q];
      all[node[k]] += fraction;
    }
  }
  weight_ = undeformed_weight_.cwiseProduct(sum.cwiseQuotient(all.cwiseMax(1e-300)).cwiseMax(1.0));
}

void LaplacePreconditioner::relax() {
  weight_ = undeformed_weight_;
  across_.node.clear();
}

void LaplacePreconditioner::multiply_undeformed(const Nodal& v, Nodal& result) const {
  result.setZero(4, v.cols());
  for (const auto& [a, b] : edge_) {
    const Eigen::Vector4d pull =
        0.5 * (undeformed_weight_[a] + undeformed_weight_[b]) * (v.col(a) - v.col(b));
    result.col(a) += pull;
    result.col(b) -= pull;
  }
}

double LaplacePreconditioner::strain_between(const Nodal& before, const Nodal& after) const {
  double square = 0.0;
  for (const auto& [a, b] : edge_)
    square = std::max(square, (after.col(a) - after.col(b) - (before.col(a) - before.col(b))).squaredNorm() /
                                  (model_.X.col(a) - model_.X.col(b)).squaredNorm());
  return std::sqrt(square);
}

// A, or A_soft without the `directed` terms, whose diagonal is then kept.
Multigrid::Sparse LaplacePreconditioner::matrix_over(const std::vector<Index>& node,
                                                     const StiffnessBound& bound, bool directed) {
  std::vector<int> place(static_cast<std::size_t>(weight_.size()), -1);
  for (std::size_t i = 0; i < node.size(); ++i)
    place[static_cast<std::size_t>(node[i])] = static_cast<int>(i);
  const double own = body_.held().has_rigid_body_modes() ? mixed_constants.diagonal_of_loose
                                                         : mixed_constants.diagonal_of_held;
  std::vector<Eigen::Triplet<double>> entry;
  Eigen::VectorXd diagonal = own * weight_ + bound.node;
  const auto join = [&](int a, int b, double w) {
    diagonal[a] += w;
    diagonal[b] += w;
    const int i = place[static_cast<std::size_t>(a)], j = place[static_cast<std::size_t>(b)];
    if (i < 0 || j < 0) return;
    entry.emplace_back(i, j, -w);
    entry.emplace_back(j, i, -w);
  };
  for (const auto& [a, b] : edge_) join(a, b, 0.5 * (weight_[a] + weight_[b]));
  for (const StiffnessBound::Edge& one : bound.edge) join(one.a, one.b, one.weight);
  if (directed)
    for (const StiffnessBound::Edge& one : bound.directed) join(one.a, one.b, one.weight);
  else
    soft_diagonal_ = diagonal;
  const auto rows = static_cast<Index>(node.size());
  for (Index i = 0; i < rows; ++i)
    entry.emplace_back(static_cast<int>(i), static_cast<int>(i), diagonal[node[static_cast<std::size_t>(i)]]);
  Multigrid::Sparse matrix(rows, rows);
  matrix.setFromTriplets(entry.begin(), entry.end());
  return matrix;
}

// Over the nodes that move along `direction`; null: in any direction.
bool LaplacePreconditioner::invert(NodalInverse& inverse, const Eigen::Vector4d* direction,
                                   const StiffnessBound& bound, bool directed) {
  inverse.node.clear();
  for (Index a = 0; a < weight_.size(); ++a)
    if (direction ? body_.held().moves_along(a, *direction) : !body_.held().is_held_wholly(a))
      inverse.node.push_back(a);
  inverse.b.resize(inverse.node.size());
  return inverse.multigrid.compute(matrix_over(inverse.node, bound, directed));
}

bool LaplacePreconditioner::invert_all(NodalInverse& across, std::vector<NodalInverse>& along,
                                       const StiffnessBound& bound, bool directed) {
  along.resize(sliding_.size());
  bool positive = invert(across, nullptr, bound, directed);
  for (std::size_t d = 0; positive && d < sliding_.size(); ++d)
    positive = invert(along[d], &sliding_[d], bound, directed);
  return positive;
}

bool LaplacePreconditioner::factorise() {
  const StiffnessBound bound = body_.stiffness_bound();
  soft_diagonal_.resize(0);
  return (bound.directed.empty() || invert_all(soft_across_, soft_along_, bound, false)) &&
         invert_all(across_, along_, bound, true);
}

void LaplacePreconditioner::find_soft_part(const Nodal& u) {
  soft_part_.resize(9, 0);
  if (soft_diagonal_.size() == 0) return;
  soft_part_ = body_.node_stiffness(u);
  for (Index a = 0; a < soft_part_.cols(); ++a) {
    Eigen::Map<Mat3> Q(soft_part_.col(a).data());
    const Mat3 relative = Mat3::Identity() + Q / soft_diagonal_[a];
    Q = Eigen::SelfAdjointEigenSolver<Mat3>(relative).operatorInverseSqrt();
  }
}

Eigen::VectorXd LaplacePreconditioner::softest_part() const {
  Eigen::VectorXd result(soft_part_.cols());
  for (Index a = 0; a < soft_part_.cols(); ++a)
    result[a] = Eigen::SelfAdjointEigenSolver<Mat3>(Eigen::Map<const Mat3>(soft_part_.col(a).data()),
                                                    Eigen::EigenvaluesOnly)
                    .eigenvalues()
                    .maxCoeff();
  return result;
}

// Exact where the directions are orthogonal.
void LaplacePreconditioner::solve_with(NodalInverse& across, std::vector<NodalInverse>& along, const Nodal& r,
                                       Nodal& z) const {
  across.solve(r, z);
  if (sliding_.empty()) return;
  Nodal normal(4, r.cols());
  for (std::size_t d = 0; d < sliding_.size(); ++d) {
    along[d].solve(r, normal);
    for (Index a = 0; a < z.cols(); ++a) z.col(a) += sliding_[d] * sliding_[d].dot(normal.col(a) - z.col(a));
  }
}

// v = Q v.
void LaplacePreconditioner::take_soft_part(Nodal& v) const {
  for (Index a = 0; a < v.cols(); ++a)
    v.col(a).head<3>() = Eigen::Map<const Mat3>(soft_part_.col(a).data()) * Vec3(v.col(a).head<3>());
}

void LaplacePreconditioner::apply(const Nodal& r, Nodal& z) {
  solve_with(across_, along_, r, z);
  if (!has_soft_part()) return;
  Nodal part = r, soft(4, r.cols());
  take_soft_part(part);
  solve_with(soft_across_, soft_along_, part, soft);
  take_soft_part(soft);
  z = 0.5 * (z + soft);
}

void LaplacePreconditioner::apply_to_scalars(const Eigen::VectorXd& softest, const Nodal& r, Nodal& z) {
  across_.solve(r, z);
  if (softest.size() > 0) {
    Nodal soft(4, r.cols());
    soft_across_.solve(r * softest.asDiagonal(), soft);
    z = 0.5 * (z + soft * softest.asDiagonal());
  }
}

}  // namespace dimple
