#include "solver/mixed_iteration.hpp"

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>

#include "solver/huge_pages.hpp"

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;
using Kind = Constraints::Kind;
using Sparse = Eigen::SparseMatrix<double>;

// The tangent at rest is at most twice the Laplacian; load and the curvature of the law add to that. Too soft
// an A overshoots, too stiff a one only takes more steps: 2 to 4 serve alike, 1 diverges.
constexpr double stiffer = 3.0;
constexpr double neighbour_distance = 1.6;  // of the mean spacing: some 14 neighbours
constexpr int fewest_neighbours = 6;
constexpr int remembered = 30;    // steps, by Anderson's acceleration
constexpr int without_gain = 30;  // iterations, and it is given up
// Operations of a new factor for each pair of a point and a node, at most: some thirty evaluations' worth of
// time. A factor's cost grows with the square of the nodes, and what it saves does not.
constexpr double worthwhile = 300.0;
constexpr double setback = 10.0;  // growth of the residual that is taken back

// The Cholesky factor of a scalar matrix over some of the nodes, in single precision: a preconditioner needs
// no more, and Eigen solves for one column at a time where here three components share each entry. Nodes are
// ordered as two halves of the body, which two threads eliminate, and what lies between them.
struct NodalFactor {
  using Vec4 = float __attribute__((vector_size(16)));
  Eigen::SimplicialLLT<Sparse, Eigen::Lower, Eigen::NaturalOrdering<int>> cholesky;
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int>
      order;                          // row in the matrix -> row in the factor
  std::size_t half = 0, between = 0;  // where the second half begins, and what separates the two
  std::vector<Index> node;            // of each row of the factor
  std::vector<int> offset;
  LongVector<int> row;
  LongVector<float> value;
  std::vector<float> inverse;
  std::vector<Vec4> x, from_half[2];  // what each half sends to the rest

  // Halves by the longest extent of the body; the nodes of the second that touch the first separate them.
  void dissect(const Sparse& matrix, const Points& X, const std::vector<Index>& of_row) {
    const Index n = matrix.rows();
    Points place(3, n);
    for (Index i = 0; i < n; ++i) place.col(i) = X.col(of_row[static_cast<std::size_t>(i)]);
    Index axis = 0;
    (place.rowwise().maxCoeff() - place.rowwise().minCoeff()).maxCoeff(&axis);
    std::vector<double> along(place.row(axis).begin(), place.row(axis).end());
    std::nth_element(along.begin(), along.begin() + n / 2, along.end());
    const double middle = along[static_cast<std::size_t>(n / 2)];
    std::vector<int> part(static_cast<std::size_t>(n));
    for (Index i = 0; i < n; ++i) part[static_cast<std::size_t>(i)] = place(axis, i) < middle ? 0 : 1;
    for (int j = 0; j < n; ++j)
      for (Sparse::InnerIterator entry(matrix, j); entry; ++entry) {
        const auto r = static_cast<std::size_t>(entry.row()), c = static_cast<std::size_t>(j);
        if (part[r] == 0 && part[c] == 1) part[c] = 2;
        if (part[c] == 0 && part[r] == 1) part[r] = 2;
      }
    order.resize(n);
    int next = 0;
    for (int p = 0; p < 3; ++p) {
      if (p == 1) half = static_cast<std::size_t>(next);
      if (p == 2) between = static_cast<std::size_t>(next);
      std::vector<int> mine, number(static_cast<std::size_t>(n), -1);
      for (int i = 0; i < n; ++i)
        if (part[static_cast<std::size_t>(i)] == p) {
          number[static_cast<std::size_t>(i)] = static_cast<int>(mine.size());
          mine.push_back(i);
        }
      if (mine.empty()) continue;
      std::vector<Eigen::Triplet<double>> entry;
      for (const int j : mine)
        for (Sparse::InnerIterator e(matrix, j); e; ++e)
          if (const int i = number[static_cast<std::size_t>(e.row())]; i >= 0)
            entry.emplace_back(i, number[static_cast<std::size_t>(j)], 1.0);
      Sparse block(static_cast<Index>(mine.size()), static_cast<Index>(mine.size()));
      block.setFromTriplets(entry.begin(), entry.end());
      Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> inverse_order;
      Eigen::AMDOrdering<int>()(block.selfadjointView<Eigen::Lower>(), inverse_order);
      for (Index k = 0; k < inverse_order.size(); ++k)
        order.indices()[mine[static_cast<std::size_t>(inverse_order.indices()[k])]] = next++;
    }
  }

  // `place` [N]: a node's row in `matrix`, or -1.
  bool factorise(const Sparse& matrix, const std::vector<int>& place, const Points& X) {
    Sparse ordered(matrix.rows(), matrix.rows());
    const bool first = node.empty();
    if (first) {
      std::vector<Index> of_row(static_cast<std::size_t>(matrix.rows()));
      for (std::size_t a = 0; a < place.size(); ++a)
        if (place[a] >= 0) of_row[static_cast<std::size_t>(place[a])] = static_cast<Index>(a);
      dissect(matrix, X, of_row);
      node.resize(of_row.size());
      for (std::size_t i = 0; i < of_row.size(); ++i)
        node[static_cast<std::size_t>(order.indices()[static_cast<Index>(i)])] = of_row[i];
      x.resize(node.size());
      for (auto& sent : from_half) sent.resize(node.size() - between);
    }
    ordered.selfadjointView<Eigen::Lower>() = matrix.selfadjointView<Eigen::Lower>().twistedBy(order);
    if (first) cholesky.analyzePattern(ordered);
    cholesky.factorize(ordered);
    if (cholesky.info() != Eigen::Success) return false;
    const Sparse& L = cholesky.matrixL().nestedExpression();
    offset.assign(1, 0);
    row.clear();
    value.clear();
    inverse.clear();
    row.reserve(static_cast<std::size_t>(L.nonZeros()));
    value.reserve(static_cast<std::size_t>(L.nonZeros()));
    for (int j = 0; j < L.outerSize(); ++j) {
      for (Sparse::InnerIterator entry(L, j); entry; ++entry) {
        if (entry.row() == j) {
          inverse.push_back(static_cast<float>(1.0 / entry.value()));
        } else {
          row.push_back(static_cast<int>(entry.row()));
          value.push_back(static_cast<float>(entry.value()));
        }
      }
      offset.push_back(static_cast<int>(row.size()));
    }
    return true;
  }

  // Rows of a half send what they have for those between the halves to `sent`; rows between know no other.
  void forward(std::size_t first, std::size_t last, Vec4* sent) {
    for (std::size_t j = first; j < last; ++j) {
      const Vec4 now = x[j] *= inverse[j];
      for (auto k = static_cast<std::size_t>(offset[j]), end = static_cast<std::size_t>(offset[j + 1]);
           k < end; ++k) {
        const auto i = static_cast<std::size_t>(row[k]);
        (i < between ? x[i] : sent[i - between]) -= now * value[k];
      }
    }
  }
  void backward(std::size_t first, std::size_t last) {
    for (std::size_t j = last; j-- > first;) {
      Vec4 sum[2] = {x[j], {}};
      auto k = static_cast<std::size_t>(offset[j]);
      const auto end = static_cast<std::size_t>(offset[j + 1]);
      for (; k + 1 < end; k += 2) {
        sum[0] -= x[static_cast<std::size_t>(row[k])] * value[k];
        sum[1] -= x[static_cast<std::size_t>(row[k + 1])] * value[k + 1];
      }
      if (k < end) sum[0] -= x[static_cast<std::size_t>(row[k])] * value[k];
      x[j] = (sum[0] + sum[1]) * inverse[j];
    }
  }

  // z = A^-1 r at its nodes, zero elsewhere.
  void solve(const Nodal& r, Nodal& z) {
    const auto n = node.size();
    const auto load = [&](std::size_t first, std::size_t last) {
      for (std::size_t j = first; j < last; ++j)
        for (int i = 0; i < 4; ++i) x[j][i] = static_cast<float>(r(i, node[j]));
    };
    const auto down = [&](int h) {
      const std::size_t first = h == 0 ? 0 : half, last = h == 0 ? half : between;
      std::fill(from_half[h].begin(), from_half[h].end(), Vec4{});
      load(first, last);
      forward(first, last, from_half[h].data());
    };
    tbb::parallel_invoke([&] { down(0); }, [&] { down(1); });
    load(between, n);
    for (std::size_t j = between; j < n; ++j) x[j] += from_half[0][j - between] + from_half[1][j - between];
    forward(between, n, x.data() + between);
    backward(between, n);
    z.setZero();
    const auto up = [&](std::size_t first, std::size_t last, std::size_t until) {
      backward(first, last);
      for (std::size_t j = first; j < until; ++j)
        for (int i = 0; i < 4; ++i) z(i, node[j]) = static_cast<double>(x[j][i]);
    };
    tbb::parallel_invoke([&] { up(0, half, half); }, [&] { up(half, between, n); });
  }
};

// Pairs of neighbours a > b, and the share of each point's volume that a node stands for.
struct Graph {
  std::vector<std::pair<int, int>> edge;
  Eigen::VectorXd share;  // [support.member]
};

Graph make_graph(const Model& model) {
  Graph graph;
  const Index n = model.node_count();
  std::vector<std::vector<std::pair<double, int>>> near(static_cast<std::size_t>(n));
  for (const GradientVariance& v : model.variance)
    for (Index a = 0; a < n; ++a)
      for (int k = v.rows.offset[a]; k < v.rows.offset[a + 1]; ++k)
        if (const int b = v.rows.member[k]; b != a)
          near[static_cast<std::size_t>(a)].emplace_back(
              (model.X.col(a) - model.X.col(b)).norm() / (0.5 * (model.spacing[a] + model.spacing[b])), b);
  for (std::size_t a = 0; a < near.size(); ++a) {
    std::sort(near[a].begin(), near[a].end());
    for (std::size_t k = 0; k < near[a].size(); ++k) {
      if (k >= fewest_neighbours && near[a][k].first > neighbour_distance) break;
      graph.edge.emplace_back(std::max(static_cast<int>(a), near[a][k].second),
                              std::min(static_cast<int>(a), near[a][k].second));
    }
  }
  std::sort(graph.edge.begin(), graph.edge.end());
  graph.edge.erase(std::unique(graph.edge.begin(), graph.edge.end()), graph.edge.end());

  graph.share.resize(model.support.member.size());
  for (Index q = 0; q < model.point_count(); ++q) {
    double sum = 0.0;
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k) {
      const int a = model.support.member[k];
      graph.share[k] = std::exp(-4.0 * (model.X.col(a) - model.point.col(q)).squaredNorm() /
                                std::pow(model.spacing[a], 2));
      sum += graph.share[k];
    }
    graph.share.segment(model.support.offset[q], model.support.count(q)) /= sum;
  }
  return graph;
}

// Which nodes the points of a patch see.
CompressedRows nodes_of_patches(const Model& model) {
  const CompressedRows points = transpose(model.patches.of_point, model.patches.count());
  CompressedRows result;
  result.offset = Eigen::VectorXi::Zero(points.rows() + 1);
  std::vector<int> member;
  std::vector<Index> seen(static_cast<std::size_t>(model.node_count()), -1);
  for (Index b = 0; b < points.rows(); ++b) {
    const auto first = static_cast<std::ptrdiff_t>(member.size());
    for (int k = points.offset[b]; k < points.offset[b + 1]; ++k) {
      const int q = points.member[k];
      for (int e = model.support.offset[q]; e < model.support.offset[q + 1]; ++e) {
        const int a = model.support.member[e];
        if (seen[static_cast<std::size_t>(a)] == b) continue;
        seen[static_cast<std::size_t>(a)] = b;
        member.push_back(a);
      }
    }
    std::sort(member.begin() + first, member.end());
    result.offset[b + 1] = static_cast<int>(member.size());
  }
  result.member = Eigen::Map<Eigen::VectorXi>(member.data(), static_cast<Index>(member.size()));
  return result;
}

}  // namespace

struct MixedIteration::Parts {
  // Anderson's memory, in variables scaled to be of one kind: what each step changed, in the place and in the
  // step. It outlives a call when the next one is of nearly the same problem, as in time steps.
  struct Memory {
    Eigen::MatrixXf moved, changed;  // a preconditioner's: their digits are worth no more
    Eigen::MatrixXd gram;
    int kept = 0, next = 0;
  } memory;
  const ForceSystem& system;
  const Model& model;
  const Constraints& constraints;
  Graph graph;
  CompressedRows nodes;       // of each patch
  Eigen::Matrix4Xf gradient;  // [4 x nodes.member]
  bool slides = false;
  NodalFactor across,
      along;  // of nodes that move freely across the push, and along it; the same if none slides
  Eigen::SimplicialLLT<Sparse> schur, schur_of_inertia;
  Eigen::VectorXd shear, inertia;     // [Q] Pa, [N] N/m or empty: that of the factors
  Eigen::VectorXd bulk;               // [patches] for which `schur` was made
  Eigen::VectorXd scale, dual_scale;  // that make u and lambda of one kind: square roots of energies

  Parts(const ForceSystem& s, const Model& m, const Constraints& c)
      : system(s), model(m), constraints(c), graph(make_graph(m)), nodes(nodes_of_patches(m)) {
    slides = std::find(c.kind.begin(), c.kind.end(), Kind::sliding) != c.kind.end();
    shear.resize(model.point_count());
    for (Index q = 0; q < shear.size(); ++q) shear[q] = mu(q);
    scale.setZero(model.node_count());
    for (Index q = 0; q < shear.size(); ++q)
      for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
        scale[model.support.member[k]] += graph.share[k] * model.volume[q] * shear[q];
    scale = (scale.array() / model.spacing.array().square()).sqrt();
    dual_scale.resize(model.patches.count());
    const CompressedRows points = transpose(model.patches.of_point, model.patches.count());
    for (Index b = 0; b < dual_scale.size(); ++b)
      dual_scale[b] = 1.0 / std::sqrt(mu(points.member[points.offset[b]]) * model.patches.volume[b]);
  }

  double mu(Index q) const {
    return system.materials()[static_cast<std::size_t>(system.tissues().of_point[q])].mu;
  }

  bool factor_is_cheap() const {
    double operations = 0.0;
    for (std::size_t j = 0; j + 1 < across.offset.size(); ++j)
      operations += std::pow(across.offset[j + 1] - across.offset[j], 2);
    return operations < worthwhile * static_cast<double>(model.support.member.size());
  }

  // The Laplacian whose energy of any linear field is that of `shear` [Q] Pa: node a's edges have the weight
  // 3 sum_q V shear / sum of their squared lengths.
  bool factorise() {
    const Index n = model.node_count();
    Eigen::VectorXd weight = Eigen::VectorXd::Zero(n), lengths = weight;
    for (Index q = 0; q < model.point_count(); ++q)
      for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
        weight[model.support.member[k]] += graph.share[k] * model.volume[q] * shear[q];
    for (const auto& [a, b] : graph.edge) {
      const double length = (model.X.col(a) - model.X.col(b)).squaredNorm();
      lengths[a] += length;
      lengths[b] += length;
    }
    weight.array() *= 3.0 * stiffer / lengths.array().max(1e-30);
    const auto factor_of = [&](NodalFactor& factor, bool sliding_too) {
      std::vector<int> place(static_cast<std::size_t>(n), -1);
      int count = 0;
      for (std::size_t a = 0; a < place.size(); ++a)
        if (constraints.kind[a] == Kind::free || (sliding_too && constraints.kind[a] == Kind::sliding))
          place[a] = count++;
      std::vector<Eigen::Triplet<double>> entry;
      // A little of its own keeps a piece that nothing holds from being singular.
      Eigen::VectorXd diagonal = 1e-6 * weight;
      if (inertia.size() == n) diagonal += inertia;
      for (const auto& [a, b] : graph.edge) {
        const double w = 0.5 * (weight[a] + weight[b]);
        diagonal[a] += w;
        diagonal[b] += w;
        const int i = place[static_cast<std::size_t>(a)], j = place[static_cast<std::size_t>(b)];
        if (i >= 0 && j >= 0) entry.emplace_back(std::max(i, j), std::min(i, j), -w);
      }
      for (Index a = 0; a < n; ++a)
        if (const int i = place[static_cast<std::size_t>(a)]; i >= 0) entry.emplace_back(i, i, diagonal[a]);
      Sparse matrix(count, count);
      matrix.setFromTriplets(entry.begin(), entry.end());
      return factor.factorise(matrix, place, model.X);
    };
    return factor_of(across, true) && (!slides || factor_of(along, false));
  }

  // S = M / (V_b V_c mu) + 1 / (bulk V): M_bc = sum_q V psi_b psi_c.
  bool factorise_schur() {
    const PressurePatches& patches = model.patches;
    std::vector<Eigen::Triplet<double>> entry;
    for (Index q = 0; q < model.point_count(); ++q)
      for (int i = patches.of_point.offset[q]; i < patches.of_point.offset[q + 1]; ++i)
        for (int j = patches.of_point.offset[q]; j <= i; ++j) {
          const int b = patches.of_point.member[i], c = patches.of_point.member[j];
          entry.emplace_back(b, c,
                             patches.psi[i] * patches.psi[j] * model.volume[q] /
                                 (mu(q) * patches.volume[b] * patches.volume[c]));
        }
    for (int b = 0; b < patches.count(); ++b) entry.emplace_back(b, b, 1.0 / (bulk[b] * patches.volume[b]));
    Sparse matrix(patches.count(), patches.count());
    matrix.setFromTriplets(entry.begin(), entry.end());
    schur.compute(matrix);
    return schur.info() == Eigen::Success;
  }

  // G' (inertia)^-1 G over the nodes that may move: what the Schur complement is of where inertia rules.
  bool factorise_schur_of_inertia() {
    std::vector<std::vector<std::pair<int, int>>> of_node(static_cast<std::size_t>(model.node_count()));
    for (int b = 0; b < nodes.rows(); ++b)
      for (int k = nodes.offset[b]; k < nodes.offset[b + 1]; ++k)
        if (constraints.kind[static_cast<std::size_t>(nodes.member[k])] == Kind::free)
          of_node[static_cast<std::size_t>(nodes.member[k])].emplace_back(b, k);
    std::vector<Eigen::Triplet<double>> entry;
    for (std::size_t a = 0; a < of_node.size(); ++a)
      for (const auto& [b, k] : of_node[a])
        for (const auto& [c, l] : of_node[a])
          if (c <= b)
            entry.emplace_back(
                b, c,
                static_cast<double>(gradient.col(k).dot(gradient.col(l))) / inertia[static_cast<Index>(a)]);
    for (int b = 0; b < nodes.rows(); ++b)
      entry.emplace_back(b, b, 1.0 / (bulk[b] * model.patches.volume[b]));
    Sparse matrix(nodes.rows(), nodes.rows());
    matrix.setFromTriplets(entry.begin(), entry.end());
    schur_of_inertia.compute(matrix);
    return schur_of_inertia.info() == Eigen::Success;
  }

  void laplacian_solve(const Nodal& r, Nodal& z) {
    across.solve(r, z);
    if (!slides) return;
    Nodal normal(4, r.cols());
    along.solve(r, normal);
    for (Index a = 0; a < z.cols(); ++a)
      z.col(a) += constraints.push * constraints.push.dot(normal.col(a) - z.col(a));
  }

  // The step (du, dlambda) from the unbalanced force r and the unbalanced volume s.
  void step(const Nodal& r, const Eigen::VectorXd& s, Nodal& du, Eigen::VectorXd& dlambda) {
    laplacian_solve(r, du);
    Eigen::VectorXd rest(s.size());
    tbb::parallel_for(tbb::blocked_range<Index>(0, s.size(), 64), [&](const auto& range) {
      for (Index b = range.begin(); b < range.end(); ++b) {
        double sum = 0.0;
        for (int k = nodes.offset[b]; k < nodes.offset[b + 1]; ++k)
          sum += gradient.col(k).cast<double>().dot(du.col(nodes.member[k]));
        rest[b] = s[b] - sum;
      }
    });
    // Cahouet and Chabard 1988: the inverse of the sum is nearly the sum of the inverses.
    dlambda = schur.solve(rest);
    if (inertia.size() > 0) dlambda += schur_of_inertia.solve(rest);
    Nodal held = r;
    for (Index b = 0; b < s.size(); ++b)
      for (int k = nodes.offset[b]; k < nodes.offset[b + 1]; ++k)
        held.col(nodes.member[k]) += dlambda[b] * gradient.col(k).cast<double>();
    laplacian_solve(held, du);
    du = -du;
  }
};

MixedIteration::MixedIteration(const ForceSystem& system, const Model& model, const Constraints& constraints)
    : parts_(std::make_unique<Parts>(system, model, constraints)) {}
MixedIteration::~MixedIteration() = default;

bool MixedIteration::serves(const ForceSystem& system, const Model& model) {
  if (model.patches.count() == 0 || model.variance.empty()) return false;
  return std::all_of(system.materials().begin(), system.materials().end(),
                     [](const Material& m) { return m.kappa - pointwise_bulk_modulus(m) > 1e-2 * m.mu; });
}

Relaxed MixedIteration::operator()(Nodal& u, Eigen::VectorXd& lambda, Nodal& f, const RelaxOptions& options,
                                   const Nodal& external, Prepare prepare, const Inertia* inertia) {
  Parts& p = *parts_;
  const Model& model = p.model;
  const Constraints& constraints = p.constraints;
  const Index n = u.cols(), nb = model.patches.count();
  const bool loaded = external.cols() == n;
  const Eigen::VectorXd& volume = model.patches.volume;
  Relaxed result;
  result.converged = false;

  Nodal r(4, n), du(4, n);
  Eigen::VectorXd s(nb), dlambda(nb);
  ForceSystem::Patches patches;
  double volume_error = 0.0;
  const auto evaluate = [&] {
    p.system.hold_pressures(lambda.cwiseQuotient(volume));
    result.sweep = p.system.internal_force(u, f);
    p.system.patch_state(patches);
    ++result.evaluations;
    double unbalanced = 0.0, reactions = 0.0;
    for (Index a = 0; a < n; ++a) {
      Eigen::Vector4d all = f.col(a);
      if (loaded) all -= external.col(a);
      if (inertia) all += inertia->inertia[a] * constraints.project(a, u.col(a) - inertia->about.col(a));
      r.col(a) = constraints.project(a, all);
      unbalanced += r.col(a).squaredNorm();
      reactions += 0.5 * (all - r.col(a)).norm() + (loaded ? external.col(a).norm() : 0.0);
    }
    s = patches.dilation - lambda.cwiseQuotient(patches.bulk.cwiseProduct(volume));
    result.residual = std::sqrt(unbalanced) / std::max(reactions, 1e-30);
    volume_error = std::sqrt(s.cwiseAbs2().dot(volume) / volume.sum());
  };

  evaluate();
  if (prepare != Prepare::nothing || p.gradient.cols() == 0) p.system.patch_gradients(p.nodes, p.gradient);
  const Index size = inertia ? n : 0;
  const bool other_inertia = size != p.inertia.size() || (inertia && inertia->inertia != p.inertia);
  if (prepare == Prepare::all && !p.factor_is_cheap()) prepare = Prepare::volume;
  if (prepare == Prepare::all) p.shear = p.system.stiffness();
  if (other_inertia) p.inertia = inertia ? inertia->inertia : Eigen::VectorXd();
  if ((prepare == Prepare::all || other_inertia || p.across.node.empty()) && !p.factorise()) return result;
  if (p.bulk.size() != nb || p.bulk != patches.bulk) {
    p.bulk = patches.bulk;
    if (!p.factorise_schur()) return result;
  }
  if (other_inertia && inertia && !p.factorise_schur_of_inertia()) return result;

  const Index length = 4 * n + nb;
  Parts::Memory& m = p.memory;
  if (m.gram.size() == 0) {
    m.moved.resize(length, remembered);
    m.changed.resize(length, remembered);
    m.gram.resize(remembered, remembered);
  }
  if (prepare != Prepare::nothing || other_inertia) m.kept = m.next = 0;
  Eigen::VectorXd place(length), last_place(length), now(length), last(length);
  const auto scaled = [&](const Nodal& v, const Eigen::VectorXd& l, Eigen::VectorXd& out) {
    Eigen::Map<Nodal>(out.data(), 4, n) = v * p.scale.asDiagonal();
    out.tail(nb) = l.cwiseProduct(p.dual_scale);
  };
  int setbacks = 0, since_gain = 0;
  double best = result.residual, caution = 1.0;
  Nodal best_u = u, best_du;
  Eigen::VectorXd best_lambda = lambda, best_dlambda;
  bool fresh = true;  // no step has been remembered since the last setback
  for (;; evaluate()) {
    const bool worse = !std::isfinite(result.residual) || !std::isfinite(volume_error) ||
                       (best_du.size() > 0 && result.residual > setback * best);
    if (worse) {
      if (best_du.size() == 0 || ++setbacks > 4) return result;
      caution *= 2.0;
      u = best_u + best_du / caution;
      lambda = best_lambda + best_dlambda / caution;
      m.kept = m.next = 0;
      fresh = true;
      continue;
    }
    if (result.residual < options.tolerance && volume_error < options.tolerance) {
      result.converged = true;
      return result;
    }
    if (++since_gain > without_gain || result.evaluations >= options.evaluations) return result;
    p.step(r, s, du, dlambda);
    if (result.residual < 0.9 * best || best_du.size() == 0) {
      best = result.residual;
      best_u = u;
      best_lambda = lambda;
      best_du = du;
      best_dlambda = dlambda;
      since_gain = 0;
    }
    scaled(u, lambda, place);
    scaled(du, dlambda, now);
    if (!fresh) {
      m.moved.col(m.next) = (place - last_place).cast<float>();
      m.changed.col(m.next) = (now - last).cast<float>();
      m.kept = std::min(m.kept + 1, remembered);
      for (int k = 0; k < m.kept; ++k)
        m.gram(m.next, k) = m.gram(k, m.next) =
            static_cast<double>(m.changed.col(m.next).dot(m.changed.col(k)));
      m.next = (m.next + 1) % remembered;
    }
    fresh = false;
    last_place = place;
    last = now;
    place += now / caution;
    if (m.kept > 0) {
      // Of columns of length one: steps shrink by orders of magnitude.
      const Eigen::VectorXd unit = m.gram.diagonal().head(m.kept).cwiseSqrt().cwiseMax(1e-300).cwiseInverse();
      Eigen::MatrixXd normal = unit.asDiagonal() * m.gram.topLeftCorner(m.kept, m.kept) * unit.asDiagonal();
      normal.diagonal().array() += 1e-10;
      const Eigen::VectorXd right =
          unit.cwiseProduct((m.changed.leftCols(m.kept).transpose() * now.cast<float>()).cast<double>());
      const Eigen::VectorXf share = unit.cwiseProduct(normal.ldlt().solve(right)).cast<float>();
      place -= (m.moved.leftCols(m.kept) * share +
                m.changed.leftCols(m.kept) * (share / static_cast<float>(caution)))
                   .cast<double>();
    }
    u = Eigen::Map<Nodal>(place.data(), 4, n) * p.scale.cwiseInverse().asDiagonal();
    lambda = place.tail(nb).cwiseQuotient(p.dual_scale);
    // Where a node is held nothing was added but rounding; it must not move at all.
    for (Index a = 0; a < n; ++a)
      if (constraints.kind[static_cast<std::size_t>(a)] != Kind::free)
        u.col(a) = best_u.col(a) + constraints.project(a, u.col(a) - best_u.col(a));
  }
}

}  // namespace dimple
