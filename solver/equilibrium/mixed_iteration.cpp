#include "solver/equilibrium/mixed_iteration.hpp"

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <future>
#include <thread>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/equilibrium/anderson.hpp"
#include "solver/equilibrium/best_state.hpp"
#include "solver/equilibrium/contact_step.hpp"
#include "solver/equilibrium/friction_step.hpp"
#include "solver/equilibrium/multigrid.hpp"
#include "solver/text.hpp"

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;
using Sparse = Eigen::SparseMatrix<double>;

// The tangent at rest is at most twice the Laplacian; load and the curvature of the law add to that. Too soft
// an A overshoots, too stiff a one only takes more steps: 3 to 5 serve alike, 2 takes twice as many.
constexpr double stiffer = 4.0;
// Of a node's weight, by which it is held where it stands: keeps a piece that nothing holds from being
// singular. A body that contact alone keeps from drifting would go 100 m by its weight at 1e-6, and what
// brings it back is lost in single precision; 1e-3 to 1e-2 serve alike.
constexpr double own_of_piece = 1e-6, own_of_drift = 1e-3;
constexpr double neighbour_distance = 1.6;  // of the mean spacing: some 14 neighbours
constexpr int fewest_neighbours = 6;
constexpr Index most_samples = 12000;  // of contact, met at once: two matrices of 1.2 GB
// Of the strain between neighbours in one iteration; longer steps pass through the law's barriers.
constexpr double longest_step = 0.3;
// Of what the law is at rest: single points have 1e5, and 300 takes no fewer steps.
constexpr double stiffest = 30.0;
constexpr double borne = 1e-9;              // of the force that contact lacks: less is nothing
constexpr double usual_tolerance = 1e-4;    // of a residual, to which contact_error belongs
constexpr Index quickly_factorised = 3000;  // rows, in a tenth of a second; the time grows as their square
// Rows. With 100,000 nodes the factors took three times as long as the rest of the solution.
constexpr Index worth_factorising = 12000;

// About the inverse of a scalar matrix over some of the nodes.
struct NodalInverse {
  std::vector<Index> node;  // of each row
  Multigrid multigrid;
  Multigrid::Vectors b, x;

  // z = A^-1 r at its nodes, zero elsewhere.
  void solve(const Nodal& r, Nodal& z) {
    for (std::size_t j = 0; j < node.size(); ++j)
      for (int i = 0; i < 4; ++i) b[j][i] = static_cast<float>(r(i, node[j]));
    multigrid.solve(b, x);
    z.setZero();
    for (std::size_t j = 0; j < node.size(); ++j)
      for (int i = 0; i < 4; ++i) z(i, node[j]) = static_cast<double>(x[j][i]);
  }
};

using Factor = Eigen::SimplicialLLT<Sparse>;

// The inverse of a matrix that is like a mass: as well conditioned with many rows as with few. It is
// factorised, but where that would take longer than all else it is left to conjugate gradients.
struct MassInverse {
  std::shared_ptr<const Factor> factor;
  Sparse matrix = {};  // lower half, without a factor
  bool ready() const { return factor || matrix.rows() > 0; }
  Eigen::VectorXd operator()(const Eigen::VectorXd& b) const {
    if (factor) return factor->solve(b);
    Eigen::ConjugateGradient<Sparse, Eigen::Lower> iteration(matrix);
    iteration.setTolerance(1e-6).setMaxIterations(100);
    stop_if_asked();
    return iteration.solve(b);
  }
};

// Null where the matrix is not positive definite. Eigen listens to nobody: where it may last it works on a
// thread of its own, which is left behind when the work is to end.
std::shared_ptr<const Factor> factorised(Sparse matrix) {
  const auto positive = [](std::shared_ptr<const Factor> factor) {
    return factor->info() == Eigen::Success ? factor : nullptr;
  };
  if (matrix.rows() < quickly_factorised) return positive(std::make_shared<const Factor>(matrix));
  std::packaged_task<std::shared_ptr<const Factor>()> task(
      [matrix = std::move(matrix)] { return std::make_shared<const Factor>(matrix); });
  auto result = task.get_future();
  std::thread(std::move(task)).detach();
  while (result.wait_for(std::chrono::milliseconds(20)) != std::future_status::ready) stop_if_asked();
  return positive(result.get());
}

// Pairs of neighbours a > b.
using Edges = std::vector<std::pair<int, int>>;

Edges neighbours(const Model& model) {
  constexpr Index each = 256;  // nodes
  std::vector<Edges> of_block(static_cast<std::size_t>((model.node_count() + each - 1) / each));
  tbb::parallel_for(std::size_t{0}, of_block.size(), [&](std::size_t block) {
    stop_if_asked();
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
        if (k >= fewest_neighbours && near[k].first > neighbour_distance) break;
        of_block[block].emplace_back(std::max(static_cast<int>(a), near[k].second),
                                     std::min(static_cast<int>(a), near[k].second));
      }
    }
  });
  Edges edge;
  for (const Edges& its : of_block) edge.insert(edge.end(), its.begin(), its.end());
  tbb::parallel_sort(edge.begin(), edge.end());
  edge.erase(std::unique(edge.begin(), edge.end()), edge.end());
  return edge;
}

// [N] Pa m^3 of shear modulus x volume that each node stands for.
template <class Shear>
Eigen::VectorXd shear_of_nodes(const Model& model, const Shear& mu) {
  constexpr Index slab = 65536;  // points whose shares are held at a time
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(model.node_count()), share;
  for (Index from = 0; from < model.point_count(); from += slab) {
    stop_if_asked();
    const Index to = std::min(from + slab, model.point_count());
    const int first = model.support.offset[from];
    share.resize(model.support.offset[to] - first);
    tbb::parallel_for(tbb::blocked_range<Index>(from, to, 256), [&](const auto& range) {
      for (Index q = range.begin(); q < range.end(); ++q) {
        double* its = share.data() + model.support.offset[q] - first;
        double all = 0.0;  // one by one: Eigen's sum hangs on where the numbers lie
        for (Index k = 0; k < model.support.count(q); ++k) {
          const int a = model.support.member[model.support.offset[q] + k];
          its[k] = std::exp(-4.0 * (model.X.col(a) - model.point.col(q)).squaredNorm() /
                            std::pow(model.spacing[a], 2));
          all += its[k];
        }
        for (Index k = 0; k < model.support.count(q); ++k) its[k] *= model.volume[q] * mu(q) / all;
      }
    });
    for (Index k = 0; k < share.size(); ++k) sum[model.support.member[first + k]] += share[k];
  }
  return sum;
}

// Of the size of the tangent at F: of distortion by differences, and of what volume the point bears itself.
double stiffness(const Material& m, const Mat3& F) {
  constexpr double h = 1e-5;
  const Mat3 P = distortional_stress(m, F);
  double square = 0.0;
  for (Index k = 0; k < 9; ++k) {
    Mat3 moved = F;
    moved(k) += h;
    square += ((distortional_stress(m, moved) - P) / h).squaredNorm();
  }
  return std::sqrt(square) + pointwise_bulk_modulus(m) * cofactor(F).squaredNorm();
}

// Which nodes the points of a patch see.
CompressedRows nodes_of_patches(const Model& model, const CompressedRows& points) {
  std::vector<std::vector<int>> nodes(static_cast<std::size_t>(points.rows()));
  tbb::enumerable_thread_specific<std::vector<Index>> stamps(
      std::vector<Index>(static_cast<std::size_t>(model.node_count()), -1));
  tbb::parallel_for(tbb::blocked_range<Index>(0, points.rows(), 64), [&](const auto& range) {
    stop_if_asked();
    std::vector<Index>& seen = stamps.local();
    for (Index b = range.begin(); b < range.end(); ++b) {
      std::vector<int>& its = nodes[static_cast<std::size_t>(b)];
      for (int k = points.offset[b]; k < points.offset[b + 1]; ++k) {
        const int q = points.member[k];
        for (int e = model.support.offset[q]; e < model.support.offset[q + 1]; ++e) {
          const int a = model.support.member[e];
          if (seen[static_cast<std::size_t>(a)] == b) continue;
          seen[static_cast<std::size_t>(a)] = b;
          its.push_back(a);
        }
      }
      std::sort(its.begin(), its.end());
    }
  });
  CompressedRows result;
  result.offset = Eigen::VectorXi::Zero(points.rows() + 1);
  for (Index b = 0; b < points.rows(); ++b)
    result.offset[b + 1] = result.offset[b] + static_cast<int>(nodes[static_cast<std::size_t>(b)].size());
  result.member.resize(result.offset[points.rows()]);
  for (Index b = 0; b < points.rows(); ++b)
    std::copy(nodes[static_cast<std::size_t>(b)].begin(), nodes[static_cast<std::size_t>(b)].end(),
              result.member.data() + result.offset[b]);
  return result;
}

}  // namespace

struct MixedIteration::Parts {
  Anderson anderson;  // of displacements and pressures, scaled to be of one kind
  System& body;
  ForceState& forces;
  const ForceSystem& system;
  const Model& model;
  const Constraints& constraints;
  Edges edge;
  Eigen::VectorXd weight_at_rest, weight;  // [N] of the edges at each node
  Eigen::VectorXi slot;                    // where in patches.psi each member of `points` stands
  CompressedRows points;                   // of each patch
  CompressedRows nodes;                    // of each patch
  Eigen::Matrix4Xf gradient;               // [4 x nodes.member]
  std::vector<Eigen::Vector4d> sliding;  // along which sets are held that slide across; one inverse for each
  NodalInverse across;                   // of nodes that move in some direction,
  std::vector<NodalInverse> along;       // and of those that move along each of `sliding`
  NodalInverse soft_across;              // the same without what resists in some directions alone
  std::vector<NodalInverse> soft_along;
  Eigen::VectorXd soft_diagonal;  // [N] N/m, of those; empty: there is nothing of that kind
  NodeStiffness soft_part;        // [9xN] Q, see laplacian_solve()
  MassInverse schur;
  Eigen::VectorXd bulk;                       // [patches] for which `schur` was made
  Nodal u_of_gradient;                        // where `gradient` is that
  double viscous_share = 0.0;                 // for which the memory of `anderson` was made
  std::chrono::steady_clock::duration lap{};  // of an iteration in bounded time, mean of the last few
  Nodal viscous;                              // force
  Eigen::VectorXd scale, dual_scale;          // that make u and lambda of one kind: square roots of energies
  int pairings = 0;                           // the sum of all contacts', for which `compliance` is known
  Eigen::MatrixXd compliance;  // [active x active] m/N of forces: w_s A^-1 w_t, as System::active() has them

  explicit Parts(System& s)
      : body(s),
        forces(s.tissue()),
        system(forces.system()),
        model(s.model()),
        constraints(s.held()),
        edge(neighbours(model)),
        points(transpose(model.patches.of_point, model.patches.count(), &slot)),
        nodes(nodes_of_patches(model, points)) {
    sliding = constraints.sliding_directions();
    const Eigen::VectorXd shear = shear_of_nodes(model, [&](Index q) { return mu(q); });
    scale = (shear.array() / model.spacing.array().square()).sqrt();
    // The Laplacian's energy of any linear field is that of the shear.
    Eigen::VectorXd lengths = Eigen::VectorXd::Zero(model.node_count());
    for (const auto& [a, b] : edge) {
      const double length = (model.X.col(a) - model.X.col(b)).squaredNorm();
      lengths[a] += length;
      lengths[b] += length;
    }
    weight_at_rest = weight = 3.0 * stiffer * shear.array() / lengths.array().max(1e-30);
    if (in_contact()) stiffen_single_nodes();
    dual_scale.resize(model.patches.count());
    for (Index b = 0; b < dual_scale.size(); ++b)
      dual_scale[b] = 1.0 / std::sqrt(mu(points.member[points.offset[b]]) * model.patches.volume[b]);
  }

  double mu(Index q) const {
    return system.materials()[static_cast<std::size_t>(system.tissues().of_point[q])].mu;
  }

  // [N] N/m of the tangent's diagonal at rest, the mean of a node's directions, without what volume adds.
  Eigen::VectorXd diagonal_at_rest() const {
    Eigen::VectorXd diagonal = Eigen::VectorXd::Zero(model.node_count());
    std::vector<int> node;
    Points dphi;
    for (Index q = 0; q < model.point_count(); ++q) {
      if (q % 4096 == 0) stop_if_asked();
      system.gradients_at(q, node, dphi);
      for (std::size_t k = 0; k < node.size(); ++k)
        diagonal[node[k]] += model.volume[q] * mu(q) * dphi.col(static_cast<Index>(k)).squaredNorm();
    }
    for (const GradientVariance& v : model.variance) {
      const double its_mu = system.materials()[static_cast<std::size_t>(v.tissue)].mu;
      for (Index a = 0; a < diagonal.size(); ++a)
        for (int k = v.rows.offset[a]; k < v.rows.offset[a + 1]; ++k)
          if (v.rows.member[k] == a) diagonal[a] += its_mu * v.K[k];
    }
    return diagonal;
  }

  // A node that its neighbours hardly surround may be far stiffer than the mean of which its weight is made.
  // Under a tool that begins to touch such a node takes the whole load, each step there overshoots ten times,
  // and no shorter way helps. Its weight is raised until A's diagonal is no less than the tangent's.
  void stiffen_single_nodes() {
    const Eigen::VectorXd tangent = diagonal_at_rest();
    Eigen::VectorXd of_others = Eigen::VectorXd::Zero(tangent.size()), count = of_others;
    for (const auto& [a, b] : edge) {
      of_others[a] += weight_at_rest[b];
      of_others[b] += weight_at_rest[a];
      ++count[a];
      ++count[b];
    }
    for (Index a = 0; a < tangent.size(); ++a)
      if (count[a] > 0.0)
        weight[a] = std::max(weight_at_rest[a], (2.0 * tangent[a] - of_others[a]) / count[a]);
    weight_at_rest = weight;
  }

  // Makes the weights as much stiffer than at rest as the law is at u.
  void stiffen(const Nodal& u) {
    forces.stress_sweep(u);
    const auto F = forces.deformation_gradients();
    std::vector<double> at_rest;
    for (const Material& m : system.materials()) at_rest.push_back(stiffness(m, Mat3::Identity()));
    Eigen::VectorXd ratio(model.point_count());
    tbb::parallel_for(tbb::blocked_range<Index>(0, ratio.size(), 256), [&](const auto& range) {
      stop_if_asked();
      for (Index q = range.begin(); q < range.end(); ++q) {
        const auto tissue = static_cast<std::size_t>(system.tissues().of_point[q]);
        const Material& m = system.materials()[tissue];
        ratio[q] = std::clamp(stiffness(m, Eigen::Map<const Mat3>(F.col(q).data())) / at_rest[tissue], 1.0,
                              stiffest);
      }
    });
    // As points count in the tangent's diagonal.
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(weight.size()), all = sum;
    std::vector<int> node;
    Points dphi;
    for (Index q = 0; q < ratio.size(); ++q) {
      if (q % 4096 == 0) stop_if_asked();
      system.gradients_at(q, node, dphi);
      for (std::size_t k = 0; k < node.size(); ++k) {
        const double share = model.volume[q] * dphi.col(static_cast<Index>(k)).squaredNorm();
        sum[node[k]] += share * ratio[q];
        all[node[k]] += share;
      }
    }
    weight = weight_at_rest.cwiseProduct(sum.cwiseQuotient(all.cwiseMax(1e-300)).cwiseMax(1.0));
  }

  // A v, A as at rest.
  void laplacian(const Nodal& v, Nodal& result) const {
    result.setZero(4, v.cols());
    for (const auto& [a, b] : edge) {
      const Eigen::Vector4d pull = 0.5 * (weight_at_rest[a] + weight_at_rest[b]) * (v.col(a) - v.col(b));
      result.col(a) += pull;
      result.col(b) -= pull;
    }
  }

  // The Laplacian, and what bounds all other forces.
  bool invert_laplacian() {
    const StiffnessBound bound = body.stiffness_bound();
    const double own = constraints.let_drift() ? own_of_drift : own_of_piece;
    const auto invert = [&](NodalInverse& inverse, const Eigen::Vector4d* direction, bool directed) {
      std::vector<int> place(static_cast<std::size_t>(weight.size()), -1);
      inverse.node.clear();
      for (Index a = 0; a < weight.size(); ++a) {
        if (direction ? !constraints.moves_along(a, *direction) : constraints.is_held_wholly(a)) continue;
        place[static_cast<std::size_t>(a)] = static_cast<int>(inverse.node.size());
        inverse.node.push_back(a);
      }
      std::vector<Eigen::Triplet<double>> entry;
      Eigen::VectorXd diagonal = own * weight + bound.node;
      const auto join = [&](int a, int b, double w) {
        diagonal[a] += w;
        diagonal[b] += w;
        const int i = place[static_cast<std::size_t>(a)], j = place[static_cast<std::size_t>(b)];
        if (i < 0 || j < 0) return;
        entry.emplace_back(i, j, -w);
        entry.emplace_back(j, i, -w);
      };
      for (const auto& [a, b] : edge) join(a, b, 0.5 * (weight[a] + weight[b]));
      for (const StiffnessBound::Edge& one : bound.edge) join(one.a, one.b, one.weight);
      if (directed)
        for (const StiffnessBound::Edge& one : bound.directed) join(one.a, one.b, one.weight);
      else
        soft_diagonal = diagonal;
      const auto rows = static_cast<Index>(inverse.node.size());
      for (Index i = 0; i < rows; ++i)
        entry.emplace_back(static_cast<int>(i), static_cast<int>(i),
                           diagonal[inverse.node[static_cast<std::size_t>(i)]]);
      Multigrid::Sparse matrix(rows, rows);
      matrix.setFromTriplets(entry.begin(), entry.end());
      inverse.b.resize(inverse.node.size());
      return inverse.multigrid.compute(std::move(matrix));
    };
    compliance.resize(0, 0);
    soft_diagonal.resize(0);
    const auto invert_all = [&](NodalInverse& to_the_side, std::vector<NodalInverse>& down, bool directed) {
      down.resize(sliding.size());
      bool positive = invert(to_the_side, nullptr, directed);
      for (std::size_t d = 0; positive && d < sliding.size(); ++d)
        positive = invert(down[d], &sliding[d], directed);
      return positive;
    };
    return (bound.directed.empty() || invert_all(soft_across, soft_along, false)) &&
           invert_all(across, along, true);
  }

  // Where the gradient is that of.
  void find_soft_part() {
    soft_part.resize(9, 0);
    if (soft_diagonal.size() == 0) return;
    soft_part = body.node_stiffness(u_of_gradient);
    for (Index a = 0; a < soft_part.cols(); ++a) {
      Eigen::Map<Mat3> Q(soft_part.col(a).data());
      const Mat3 relative = Mat3::Identity() + Q / soft_diagonal[a];
      Q = Eigen::SelfAdjointEigenSolver<Mat3>(relative).operatorInverseSqrt();
    }
  }

  bool in_contact() const { return !body.contacts().empty(); }
  Index samples_of_tool() const { return body.touching() ? body.touching()->count() : 0; }

  const System::ActiveSample& met(Index row) const { return body.active()[static_cast<std::size_t>(row)]; }
  const System::OneContact& contact_of(const System::ActiveSample& one) const {
    return body.contacts()[static_cast<std::size_t>(one.contact)];
  }

  // visit(node, w) of what moves a sample's gap.
  template <class Visit>
  void of_sample(Index row, const Visit& visit) const {
    const System::ActiveSample& one = met(row);
    const auto& [rows, w] = contact_of(one).term->moves();
    for (int k = rows.offset[one.sample]; k < rows.offset[one.sample + 1]; ++k) visit(rows.member[k], w[k]);
  }

  // What the last force found beyond a wall or beyond each other has met: it joins the samples that are
  // known.
  void find_compliance() {
    body.activate_penetrating();
    int pairings_now = 0;
    for (const System::OneContact& one : body.contacts()) pairings_now += one.term->pairing();
    if (pairings_now != pairings) compliance.resize(0, 0);
    pairings = pairings_now;
    const auto count = static_cast<Index>(body.active().size());
    if (count > most_samples)
      throw SolveError(
          {.fact = text("contact is met at ", count, " places, and at most ", most_samples, " are computed"),
           .where = "static solver",
           .why = "how far a force at each place moves every other one is kept, and takes memory and time as "
                  "the square and the cube of their number",
           .remedy =
               "enforce it at fewer places: fewer nodes (--nodes), or --set wall.NAME.places for a wall",
           .code = "contact-places"});
    if (count > compliance.rows()) extend_compliance();
  }

  // Of each node's own stiffness the softest direction's part, see laplacian_solve(): a tool presses across a
  // membrane, which hardly resists that.
  Eigen::VectorXd softest_part() const {
    Eigen::VectorXd result(soft_part.cols());
    for (Index a = 0; a < soft_part.cols(); ++a)
      result[a] = Eigen::SelfAdjointEigenSolver<Mat3>(Eigen::Map<const Mat3>(soft_part.col(a).data()),
                                                      Eigen::EigenvaluesOnly)
                      .eigenvalues()
                      .maxCoeff();
    return result;
  }

  // How far a unit force at one sample moves another, as laplacian_solve() has it; four forces at a time.
  void extend_compliance() {
    const Index known = compliance.rows(), count = static_cast<Index>(body.active().size());
    compliance.conservativeResize(count, count);
    Nodal force(4, model.node_count()), moved = force, soft = force;
    const Eigen::VectorXd softest = softest_part();
    for (Index first = known; first < count; first += 4) {
      stop_if_asked();
      force.setZero();
      const Index last = std::min(first + 4, count);
      for (Index t = first; t < last; ++t) of_sample(t, [&](int a, double w) { force(t - first, a) = w; });
      across.solve(force, moved);
      if (softest.size() > 0) {
        soft_across.solve(force * softest.asDiagonal(), soft);
        moved = 0.5 * (moved + soft * softest.asDiagonal());
      }
      for (Index s = 0; s < count; ++s) {
        Eigen::Vector4d sum = Eigen::Vector4d::Zero();
        of_sample(s, [&](int a, double w) { sum += w * moved.col(a); });
        for (Index t = first; t < last; ++t) compliance(s, t) = sum[t - first];
      }
    }
    // Of a tool the mean of both ways; of what has met since, whenever that was, as it moves what met before.
    const Index of_tool = samples_of_tool();
    if (known == 0 && of_tool > 0) {
      const auto block = compliance.topLeftCorner(of_tool, of_tool);
      compliance.topLeftCorner(of_tool, of_tool) = (0.5 * (block + block.transpose())).eval();
    }
    for (Index t = std::max(known, of_tool); t < count; ++t)
      for (Index s = 0; s < t; ++s) compliance(t, s) = compliance(s, t);
    compliance.diagonal().tail(count - known) *= 1.0 + 1e-4;  // single precision is not surely positive
  }

  // The lower triangle of a symmetric matrix between patches, column by column: `visit(c, add)` calls
  // add(b, value), b >= c. As triplets there would be hundreds for each entry.
  template <class Visit>
  Sparse between_patches(const Visit& visit) const {
    const int count = static_cast<int>(model.patches.count());
    Sparse matrix(count, count);
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(count);
    std::vector<char> seen(static_cast<std::size_t>(count), 0);
    std::vector<int> rows;
    for (int c = 0; c < count; ++c) {
      if (c % 256 == 0) stop_if_asked();
      rows.clear();
      visit(c, [&](int row, double value) {
        if (!seen[static_cast<std::size_t>(row)]) {
          seen[static_cast<std::size_t>(row)] = 1;
          rows.push_back(row);
        }
        sum[row] += value;
      });
      std::sort(rows.begin(), rows.end());
      matrix.startVec(c);
      for (const int row : rows) {
        matrix.insertBack(row, c) = sum[row];
        sum[row] = 0.0;
        seen[static_cast<std::size_t>(row)] = 0;
      }
    }
    matrix.finalize();
    return matrix;
  }

  // S = M / (V_b V_c mu) + 1 / (bulk V): M_bc = sum_q V psi_b psi_c.
  bool factorise_schur() {
    const PressurePatches& patches = model.patches;
    Sparse matrix = between_patches([&](int c, const auto& add) {
      for (int k = points.offset[c]; k < points.offset[c + 1]; ++k) {
        const int q = points.member[k];
        for (int i = patches.of_point.offset[q]; i < patches.of_point.offset[q + 1]; ++i)
          if (const int b = patches.of_point.member[i]; b >= c)
            add(b, patches.psi[i] * patches.psi[slot[k]] * model.volume[q] /
                       (mu(q) * patches.volume[b] * patches.volume[c]));
      }
      add(c, 1.0 / (bulk[c] * patches.volume[c]));
    });
    schur = {};
    if (matrix.rows() > worth_factorising) {
      schur.matrix = std::move(matrix);
      return Eigen::VectorXd(schur.matrix.diagonal()).minCoeff() > 0.0;
    }
    schur.factor = factorised(std::move(matrix));
    return schur.factor != nullptr;
  }

  // The largest change of the strain between neighbours.
  double strain_between(const Nodal& before, const Nodal& after) const {
    double square = 0.0;
    for (const auto& [a, b] : edge)
      square =
          std::max(square, (after.col(a) - after.col(b) - (before.col(a) - before.col(b))).squaredNorm() /
                               (model.X.col(a) - model.X.col(b)).squaredNorm());
    return std::sqrt(square);
  }

  // After the forces at u have been asked for.
  void find_gradient(const Nodal& u) {
    forces.patch_gradients(nodes, gradient);
    u_of_gradient = u;
  }

  // Exact where the directions are orthogonal.
  void solve_with(NodalInverse& to_the_side, std::vector<NodalInverse>& down, const Nodal& r,
                  Nodal& z) const {
    to_the_side.solve(r, z);
    if (sliding.empty()) return;
    Nodal normal(4, r.cols());
    for (std::size_t d = 0; d < sliding.size(); ++d) {
      down[d].solve(r, normal);
      for (Index a = 0; a < z.cols(); ++a) z.col(a) += sliding[d] * sliding[d].dot(normal.col(a) - z.col(a));
    }
  }

  // A membrane is stiff within its plane and hardly so across it, and a scalar matrix has one stiffness for
  // both: A, stiff in all directions, would let a surface bend by a thousandth of what it gives. What a
  // node's own stiffness leaves soft, Q = (1 + stiffness / soft_diagonal)^-1/2, is therefore moved as tissue
  // alone besides: half of A^-1 + Q A_soft^-1 Q, where both splittings of a motion, stiff and soft, cost
  // little.
  void laplacian_solve(const Nodal& r, Nodal& z) {
    solve_with(across, along, r, z);
    if (soft_part.cols() == 0) return;
    Nodal part = r, soft(4, r.cols());
    const auto take_part = [&](Nodal& v) {
      for (Index a = 0; a < v.cols(); ++a)
        v.col(a).head<3>() = Eigen::Map<const Mat3>(soft_part.col(a).data()) * Vec3(v.col(a).head<3>());
    };
    take_part(part);
    solve_with(soft_across, soft_along, part, soft);
    take_part(soft);
    z = 0.5 * (z + soft);
  }

  // share x A (u - about).
  const Nodal* viscous_force(const Nodal& u, const Viscosity& viscosity) {
    laplacian(u - viscosity.about, viscous);
    viscous *= viscosity.share;
    return &viscous;
  }

  // To the next place after u and lambda, where the step is du and dlambda.
  void go_on(Nodal& u, Eigen::VectorXd& lambda, const Nodal& du, const Eigen::VectorXd& dlambda,
             double caution) {
    const Index n = u.cols(), nb = lambda.size();
    Eigen::VectorXd of_lambda = Eigen::VectorXd::Ones(nb);
    of_lambda.head(dual_scale.size()) = dual_scale;
    for (Index k = 0; k < compliance.rows(); ++k) {
      const System::ActiveSample& one = met(k);
      of_lambda[dual_scale.size() + contact_of(one).first + one.sample] = std::sqrt(compliance(k, k));
    }
    for (const System::OneContact& one : body.contacts())
      if (one.rigid && one.rigid->rubs())
        for (const auto& [k, s] : known_of(one.term))
          of_lambda.segment<3>(dual_scale.size() + one.first + one.rigid->count() + 3 * s)
              .setConstant(std::sqrt(compliance(k, k)));
    const auto scaled = [&](const Nodal& v, const Eigen::VectorXd& l) {
      Eigen::VectorXd all(4 * n + nb);
      Eigen::Map<Nodal>(all.data(), 4, n) = v * scale.asDiagonal();
      all.tail(nb) = l.cwiseProduct(of_lambda);
      return all;
    };
    const Nodal from = u;
    const Eigen::VectorXd here = scaled(u, lambda);
    Eigen::VectorXd place = anderson.next(here, scaled(du, dlambda), caution);
    u = Eigen::Map<Nodal>(place.data(), 4, n) * scale.cwiseInverse().asDiagonal();
    if (const double strain = strain_between(from, u); strain > longest_step) {
      place = here + longest_step / strain * (place - here);
      u = Eigen::Map<Nodal>(place.data(), 4, n) * scale.cwiseInverse().asDiagonal();
    }
    lambda = place.tail(nb).cwiseQuotient(of_lambda);
    for (const System::OneContact& one : body.contacts())
      one.term->bring_back(lambda.segment(dual_scale.size() + one.first, one.term->unknowns()));
  }

  // Where a node is held nothing was added but rounding; it must not move at all from where it was.
  void hold_still(Nodal& u, const Nodal& was) const {
    for (Index a = 0; a < u.cols(); ++a)
      if (!constraints.is_free(a)) u.col(a) = was.col(a) + constraints.project(a, u.col(a) - was.col(a));
  }

  // The samples of one contact that are known: their rows in `compliance`, and which they are.
  struct Known {
    Index row, sample;
  };
  std::vector<Known> known_of(const ContactTerm* term) const {
    std::vector<Known> result;
    for (Index k = 0; k < compliance.rows(); ++k)
      if (contact_of(met(k)).term == term) result.push_back({k, met(k).sample});
    return result;
  }

  // What a sample's friction lacks at the last force [m].
  double lack_of_friction(const TouchingTool& rigid, Index row, Index s) const {
    const Vec3 force = rigid.friction_forces().col(s), slip = rigid.slips().col(s);
    const double most = rigid.bound(s, rigid.forces()[s]), C = compliance(row, row);
    return most > 0.0 ? C * (force - brought_within(most, force - slip / C)).norm() : 0.0;
  }

  // What a contact lacks at the last force: the largest, over what it may be.
  struct Lack {
    double largest = 0.0;
    double force = 0.0;  // what about would bring it about [N]
  };
  Lack lack_of(const System::OneContact& one) const {
    Lack lack;
    const bool rubs = one.rigid && one.rigid->rubs();
    for (const auto& [k, s] : known_of(one.term)) {
      const double C = compliance(k, k);
      double off = std::abs(std::min(one.term->gaps()[s], C * one.term->forces()[s]));
      if (rubs) off = std::max(off, lack_of_friction(*one.rigid, k, s));
      lack.largest = std::max(lack.largest, off / one.term->error_at(s, body.now()));
      lack.force = std::hypot(lack.force, off / C);
    }
    return lack;
  }
  double lack_of_tool() const { return body.touching() ? lack_of(body.contacts().front()).largest : 0.0; }

  // Of the last force: the residual, with what contact lacks. What has come to lie beyond a wall or a fold
  // counts as much as the forces that are missing there: else the first of these, which unbalance the body,
  // would look like a step in the wrong direction.
  double residual_with_contact(double residual, double reactions, double tolerance) const {
    Lack beside;
    for (const System::OneContact& one : body.contacts()) {
      const Lack its = lack_of(one);
      if (one.rigid && one.rigid->is_measured()) {
        // As long as it lacks more than it may it counts as it does usually: under a stricter tolerance a
        // body that nothing holds up yet would look better than all that comes after.
        const double counts = its.largest > 1.0 ? std::max(tolerance, usual_tolerance) : tolerance;
        residual = std::max(residual, counts * its.largest);
        // Nothing bears anything yet: all of it is missing, however little the tool reaches in.
        const double nothing = std::max(borne * its.force, body.least_reactions());
        if (its.largest > 1.0 && reactions <= nothing) residual = std::max(residual, 1.0);
        continue;
      }
      beside.largest = std::max(beside.largest, its.largest);
      beside.force = std::hypot(beside.force, its.force);
    }
    reactions = std::max(reactions, borne * beside.force);  // none at all where nothing has met yet
    return std::max(residual, beside.largest > 1.0
                                  ? std::max(tolerance * beside.largest, beside.force / reactions)
                                  : tolerance * beside.largest);
  }

  // The change [3xM] of one contact's friction beside that of all normal forces, where the nodes would move
  // by du else.
  Points friction_beside(const TouchingTool& rigid, const Eigen::VectorXd& of_normal_forces,
                         const Points& normal, double thicker, const Nodal& du) const {
    const std::vector<Known> own = known_of(&rigid);
    const auto count = static_cast<Index>(own.size());
    std::vector<Index> row, changed;
    for (Index t = 0; t < of_normal_forces.size(); ++t)
      if (of_normal_forces[t] != 0.0) changed.push_back(t);
    Points way(3, count), its_normal(3, count), before(3, count);
    Eigen::VectorXd bound(count);
    for (Index i = 0; i < count; ++i) {
      const auto& [k, s] = own[static_cast<std::size_t>(i)];
      row.push_back(k);
      const Vec3 n = its_normal.col(i) = rigid.normals().col(s);
      way.col(i) = thicker * rigid.slips().col(s);
      before.col(i) = rigid.friction_forces().col(s);
      bound[i] = rigid.bound(s, rigid.forces()[s] + of_normal_forces[k]);
      if (!(bound[i] > 0.0)) continue;
      Vec3 move = Vec3::Zero();
      of_sample(k, [&](int a, double w) { move += w * du.col(a).head<3>(); });
      for (const Index t : changed) move += compliance(k, t) * of_normal_forces[t] * normal.col(t);
      way.col(i) += move - n * n.dot(move);
    }
    const Points of_known = friction_step(compliance(row, row), its_normal, way, before, bound);
    Points change = Points::Zero(3, rigid.count());
    for (Index i = 0; i < count; ++i) change.col(own[static_cast<std::size_t>(i)].sample) = of_known.col(i);
    return change;
  }

  // The step (du, dlambda) from the unbalanced force r and the unbalanced volume s, and of contact from its
  // gaps, `thicker` times.
  void step(const Nodal& r, const Eigen::VectorXd& s, double thicker, Nodal& du, Eigen::VectorXd& dlambda) {
    Eigen::VectorXd of_patches(s.size());
    step(r, s, du, of_patches);
    dlambda.tail(dlambda.size() - s.size()).setZero();
    if (compliance.rows() > 0) {
      Nodal held = r;
      change_contact(thicker, du, held, dlambda.tail(dlambda.size() - s.size()));
      step(held, s, du, of_patches);
    }
    dlambda.head(s.size()) = of_patches;
  }

  // Where the nodes would move by du without it: the change of the contact's unknowns, and of the force r.
  void change_contact(double thicker, const Nodal& du, Nodal& r, Eigen::Ref<Eigen::VectorXd> change) {
    const Index count = compliance.rows();
    Eigen::VectorXd gap(count), before(count);
    Points normal(3, count);
    for (Index k = 0; k < count; ++k) {
      const Index sample = met(k).sample;
      const ContactTerm& of = *contact_of(met(k)).term;
      before[k] = of.forces()[sample];
      normal.col(k) = of.normals().col(sample);
      gap[k] = thicker * of.gaps()[sample];
      of_sample(k, [&](int a, double w) { gap[k] += w * normal.col(k).dot(du.col(a).head<3>()); });
    }
    const Eigen::VectorXd of_normals = contact_step(compliance, normal, gap, before);
    for (Index k = 0; k < count; ++k) change[contact_of(met(k)).first + met(k).sample] = of_normals[k];
    for (const System::OneContact& one : body.contacts()) {
      one.term->spread(Eigen::VectorXd(change.segment(one.first, one.term->count())), r);
      if (!(one.rigid && one.rigid->rubs())) continue;
      const Points of_friction = friction_beside(*one.rigid, of_normals, normal, thicker, du);
      one.rigid->spread(of_friction, r);
      change.segment(one.first + one.rigid->count(), of_friction.size()) =
          Eigen::Map<const Eigen::VectorXd>(of_friction.data(), of_friction.size());
    }
  }

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
    dlambda = schur(rest);
    Nodal held = r;
    for (Index b = 0; b < s.size(); ++b)
      for (int k = nodes.offset[b]; k < nodes.offset[b + 1]; ++k)
        held.col(nodes.member[k]) += dlambda[b] * gradient.col(k).cast<double>();
    laplacian_solve(held, du);
    du = -du;
  }
};

namespace {

// What a state lacks of equilibrium.
struct Unbalanced {
  Unbalanced(Index nodes, Index patch_count) : force(4, nodes), volume(patch_count) {}
  Nodal force;             // on what is free to move
  Eigen::VectorXd volume;  // J - 1 - p / bulk
  ForceState::Patches patches;
  ForceSystem::Sweep sweep;
  double residual = 0.0, reactions = 0.0, volume_error = 0.0;
  double contact = 0.0;  // what a tool's lacks, over what it may

  void at(System& body, const Nodal& u, const Eigen::VectorXd& lambda, Nodal& f, const Nodal* viscous) {
    const Eigen::VectorXd& of_patches = body.model().patches.volume;
    sweep = body.force_at(u, lambda, f);
    body.tissue().patch_state(patches);
    const Balance balance = body.balance(f, force, [&](Index a, Eigen::Vector4d& all) {
      if (viscous) all += viscous->col(a);
    });
    residual = balance.residual();
    reactions = balance.reactions;
    volume = patches.dilation -
             lambda.head(of_patches.size()).cwiseQuotient(patches.bulk.cwiseProduct(of_patches));
    volume_error = std::sqrt(volume.cwiseAbs2().dot(of_patches) / of_patches.sum());
  }
};

// What is left unbalanced at the best state, where somebody asks for that.
struct AtBest {
  AtBest(MixedIteration::Left* left_, const Nodal& f_, const Unbalanced& now) : left(left_) { keep(f_, now); }
  MixedIteration::Left* left;
  Nodal f;
  ForceSystem::Sweep sweep;

  void keep(const Nodal& f_, const Unbalanced& now) {
    if (!left) return;
    f = f_;
    sweep = now.sweep;
    left->force = now.force;
    left->volume = now.volume;
    left->contact = contact_error * now.contact;
  }
  void give_back(Nodal& f_, ForceSystem::Sweep& sweep_) const {
    if (!left) return;
    f_ = f;
    sweep_ = sweep;
  }
};

// Of iterations in bounded time. `mean`: of the last few.
struct Laps {
  using Clock = std::chrono::steady_clock;
  Laps(Clock::time_point until_, Clock::duration& mean_)
      : until(until_),
        mean(mean_),
        timed(until != Clock::time_point::max()),
        last(timed ? Clock::now() : Clock::time_point()) {}
  Clock::time_point until;
  Clock::duration& mean;
  bool timed;
  Clock::time_point last;

  // `counts`: the lap that ends here is a whole one.
  bool none_left(bool counts, bool* late) {
    if (!timed) return false;
    const Clock::time_point now = Clock::now();
    if (counts) mean += (now - last - mean) / 5;
    last = now;
    const bool none = now + mean + mean / 2 > until;
    if (late) *late = none;
    return none;
  }
};

}  // namespace

MixedIteration::MixedIteration(System& system) : parts_(std::make_unique<Parts>(system)) {}
MixedIteration::~MixedIteration() = default;

double MixedIteration::laplacian_of(const Nodal& v) const {
  Nodal pull;
  parts_->laplacian(v, pull);
  return v.cwiseProduct(pull).sum();
}

Eigen::VectorXd pressures_of_volumes(const System& system) {
  ForceState::Patches patches;
  system.tissue().patch_state(patches);
  return patches.dilation.cwiseProduct(patches.bulk).cwiseProduct(system.model().patches.volume);
}

bool MixedIteration::serves(const ForceSystem& system, const Model& model) {
  return model.scheme.pressure_patches && model.scheme.averaged_gradients && serves(system.materials());
}

bool MixedIteration::serves(const std::vector<Material>& tissues) {
  return std::all_of(tissues.begin(), tissues.end(),
                     [](const Material& m) { return m.kappa - pointwise_bulk_modulus(m) > 1e-2 * m.mu; });
}

Relaxed MixedIteration::operator()(Nodal& u, Eigen::VectorXd& lambda, Nodal& f, const RelaxOptions& options,
                                   bool anew, const Viscosity* viscosity) {
  Parts& p = *parts_;
  const Relaxed first = iterate(u, lambda, f, options, anew, viscosity);
  if (first.converged || viscosity || !std::isfinite(first.residual) ||
      first.evaluations >= options.evaluations)
    return first;
  RelaxOptions rest = options;
  rest.evaluations -= first.evaluations;
  Relaxed second = first;
  p.stiffen(u);
  if (p.invert_laplacian()) {
    second = iterate(u, lambda, f, rest, true, nullptr);
    second.evaluations += first.evaluations;
  }
  p.weight = p.weight_at_rest;
  p.across.node.clear();  // made again when it is needed
  return second;
}

Relaxed MixedIteration::within(Nodal& u, Eigen::VectorXd& lambda, Nodal& f, const RelaxOptions& options,
                               bool anew, Left& left) {
  Parts& p = *parts_;
  left.force.setZero(4, u.cols());
  left.volume.setZero(p.model.patches.count());
  left.contact = 0.0;
  left.late = false;
  const Relaxed found = iterate(u, lambda, f, options, anew, nullptr, &left);
  if (p.across.node.empty() || !p.schur.ready()) return found;
  Nodal z(4, u.cols());
  p.laplacian_solve(left.force, z);
  left.energy = left.force.cwiseProduct(z).sum() + left.volume.dot(p.schur(left.volume));
  return found;
}

// Makes what the step needs, where it is not that of the last call. False: a matrix is not positive definite.
bool MixedIteration::prepare(const Nodal& u, const Eigen::VectorXd& bulk, bool anew,
                             const Viscosity* viscosity) {
  Parts& p = *parts_;
  if (anew || p.gradient.cols() == 0) p.find_gradient(u);
  const bool other_viscosity = p.viscous_share != (viscosity ? viscosity->share : 0.0);
  p.viscous_share = viscosity ? viscosity->share : 0.0;
  const bool matrix_anew = p.across.node.empty();
  if (matrix_anew && !p.invert_laplacian()) return false;
  if (matrix_anew || anew || p.soft_part.cols() == 0) p.find_soft_part();
  if (p.bulk.size() != bulk.size() || p.bulk != bulk) {
    p.bulk = bulk;
    if (!p.factorise_schur()) {
      p.bulk.resize(0);
      return false;
    }
  }
  p.anderson.begin(4 * u.cols() + bulk.size() + p.body.contact_unknowns(), anew || other_viscosity);
  return true;
}

Relaxed MixedIteration::iterate(Nodal& u, Eigen::VectorXd& lambda, Nodal& f, const RelaxOptions& options,
                                bool anew, const Viscosity* viscosity, Left* left) {
  Parts& p = *parts_;
  Relaxed result;
  result.converged = false;
  Unbalanced now(u.cols(), p.model.patches.count());
  const auto evaluate = [&] {
    stop_if_asked();
    now.at(p.body, u, lambda, f, viscosity ? p.viscous_force(u, *viscosity) : nullptr);
    result.sweep = now.sweep;
    result.residual = now.residual;
    ++result.evaluations;
  };
  const auto look_at_contact = [&] {
    if (!p.in_contact()) return;
    p.find_compliance();
    // In bounded time states are compared that were sought to one tolerance or another.
    result.residual =
        p.residual_with_contact(result.residual, now.reactions, left ? usual_tolerance : options.tolerance);
    if (left && p.body.touching()) now.contact = p.lack_of_tool();
  };
  evaluate();
  if (!prepare(u, now.patches.bulk, anew, viscosity)) return result;
  look_at_contact();

  BestState best(u, lambda, result.residual);
  AtBest at_best(left, f, now);
  const auto give_up = [&] {
    u = best.u();
    lambda = best.lambda();
    result.residual = best.residual();
    at_best.give_back(f, result.sweep);
    return result;
  };
  Laps laps(options.until, p.lap);
  Nodal du(4, u.cols());
  Eigen::VectorXd dlambda(lambda.size());
  for (;; evaluate(), look_at_contact()) {
    if (best.is_setback(result.residual) || !std::isfinite(now.volume_error)) {
      if (!best.step_back(u, lambda)) return give_up();
      p.anderson.forget();
      continue;
    }
    if (result.residual < options.tolerance && now.volume_error < options.tolerance) {
      result.converged = true;
      at_best.keep(f, now);
      return result;
    }
    const bool late = !best.was_the_last_chance() && result.evaluations < options.evaluations &&
                      laps.none_left(best.has_step(), left ? &left->late : nullptr);
    if (!best.may_go_on() || result.evaluations >= options.evaluations || late) {
      if (left && result.residual < best.residual()) {
        best.take(u, lambda, result.residual);
        at_best.keep(f, now);
      }
      return give_up();
    }
    const double thicker = viscosity ? 1.0 + viscosity->share : 1.0;  // of (1 + share) A
    if (viscosity) now.volume *= thicker;
    p.step(now.force, now.volume, thicker, du, dlambda);
    if (viscosity) du /= thicker;
    if (best.is_gain(result.residual)) {
      best.take(u, lambda, result.residual, du, dlambda);
      at_best.keep(f, now);
    }
    p.go_on(u, lambda, du, dlambda, best.caution());
    p.hold_still(u, best.u());
  }
}

}  // namespace dimple
