#include "preprocess/scene/load_path.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "io/stop.hpp"

namespace dimple {
namespace {

constexpr double cells = 15000.0;    // of the lattice in the body
constexpr double most_in_box = 4e6;  // and in all, in a body that fills little of its box
constexpr double most_finer = 30.0;  // times the half-space's flux

// Cells of one edge that fill the body's box.
struct FlowLattice {
  std::array<Index, 3> n = {}, stride = {};
  double edge = 0.0;
  Vec3 origin = Vec3::Zero();             // the first cell's centre
  std::vector<char> inside;               // by cell of the box: its centre is in the body
  std::array<std::vector<char>, 3> open;  // tissue connects it with the next one along the axis
  std::vector<int> number;                // among those inside, or -1
  std::vector<Index> cell;                // those inside

  explicit FlowLattice(const BodySurface& body) {
    const Vec3 size = body.upper() - body.lower();
    edge = std::cbrt(std::max(body.volume() / cells, size.prod() / most_in_box));
    for (std::size_t d = 0; d < 3; ++d)
      n[d] = std::max<Index>(2, static_cast<Index>(std::ceil(size[static_cast<Index>(d)] / edge)));
    const Vec3 count(static_cast<double>(n[0]), static_cast<double>(n[1]), static_cast<double>(n[2]));
    origin = 0.5 * (body.lower() + body.upper()) - 0.5 * edge * (count - Vec3::Ones());
    stride = {1, n[0], n[0] * n[1]};
    inside.assign(static_cast<std::size_t>(all()), 0);
    for (int axis = 0; axis < 3; ++axis) look_along(body, axis);
    number.assign(inside.size(), -1);
    for (Index c = 0; c < all(); ++c)
      if (inside[static_cast<std::size_t>(c)]) {
        number[static_cast<std::size_t>(c)] = static_cast<int>(cell.size());
        cell.push_back(c);
      }
  }

  Index all() const { return n[0] * n[1] * n[2]; }
  Vec3 place(Index i, Index j, Index k) const {
    return origin + edge * Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k));
  }
  std::array<Index, 3> at(Index c) const { return {c % n[0], (c / n[0]) % n[1], c / stride[2]}; }
  bool leads_on(Index c, std::size_t d) const {
    return at(c)[d] + 1 < n[d] && open[d][static_cast<std::size_t>(c)];
  }
  bool leads_back(Index c, std::size_t d) const {
    return at(c)[d] > 0 && open[d][static_cast<std::size_t>(c - stride[d])];
  }

  // Connections of neighbours along each axis, exact along the lines through centres: no slit is too narrow.
  void look_along(const BodySurface& body, int axis) {
    const auto d = static_cast<std::size_t>(axis), e = (d + 1) % 3, f = (d + 2) % 3;
    open[d].assign(inside.size(), 0);
    tbb::parallel_for(Index{0}, n[e] * n[f], [&](Index line) {
      if (line % 64 == 0) stop_if_requested();
      const Index first = (line % n[e]) * stride[e] + (line / n[e]) * stride[f];
      Vec3 from = origin;
      from[static_cast<Index>(e)] += edge * static_cast<double>(line % n[e]);
      from[static_cast<Index>(f)] += edge * static_cast<double>(line / n[e]);
      const std::vector<double> t = body.chord(from, axis, edge * static_cast<double>(n[d] - 1));
      for (std::size_t pair = 0; pair + 1 < t.size(); pair += 2) {
        const Index begin = static_cast<Index>(std::ceil(t[pair] / edge - 1e-9));
        const Index end = std::min(n[d] - 1, static_cast<Index>(std::floor(t[pair + 1] / edge + 1e-9)));
        for (Index i = std::max<Index>(begin, 0); i <= end; ++i) {
          if (axis == 0) inside[static_cast<std::size_t>(first + i)] = 1;
          if (i < end) open[d][static_cast<std::size_t>(first + i * stride[d])] = 1;
        }
      }
    });
  }
};

// Fixed potential on cell faces on the base: half a cell's distance from the centre.
void hold(const FlowLattice& lattice, const Boundary& boundary, Index c, double& diagonal) {
  const auto [i, j, k] = lattice.at(c);
  if (boundary.lowest - lattice.place(i, j, k).dot(boundary.down) > boundary.base_depth + lattice.edge)
    return;
  for (std::size_t d = 0; d < 3; ++d)
    for (const Index side : {-1, 1}) {
      const double down = boundary.down[static_cast<Index>(d)] * static_cast<double>(side);
      if (down < 0.5) continue;
      if (!(side > 0 ? lattice.leads_on(c, d) : lattice.leads_back(c, d))) diagonal += 2.0;
    }
}

// Matrix of div grad with unit conductance between neighbouring cells inside.
Eigen::SparseMatrix<double> conduction(const FlowLattice& lattice, const Boundary& boundary) {
  const auto rows = static_cast<Index>(lattice.cell.size());
  Eigen::VectorXd diagonal = Eigen::VectorXd::Constant(rows, 1e-9);
  std::vector<Eigen::Triplet<double>> entries;
  for (Index r = 0; r < rows; ++r) {
    const Index c = lattice.cell[static_cast<std::size_t>(r)];
    for (std::size_t d = 0; d < 3; ++d) {
      if (!lattice.leads_on(c, d)) continue;
      const Index other = lattice.number[static_cast<std::size_t>(c + lattice.stride[d])];
      if (other < 0) continue;
      diagonal[r] += 1.0;
      diagonal[other] += 1.0;
      entries.emplace_back(r, other, -1.0);
      entries.emplace_back(other, r, -1.0);
    }
    hold(lattice, boundary, c, diagonal[r]);
  }
  for (Index r = 0; r < rows; ++r) entries.emplace_back(r, r, diagonal[r]);
  Eigen::SparseMatrix<double> matrix(rows, rows);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

// The inside cell nearest to a place, among those around it; -1: none.
Index cell_near(const FlowLattice& lattice, const Vec3& x) {
  const Eigen::Matrix<Index, 3, 1> near = ((x - lattice.origin) / lattice.edge).array().round().cast<Index>();
  const auto& n = lattice.n;
  Index best = -1;
  double least = 0.0;
  for (Index dk = -1; dk <= 1; ++dk)
    for (Index dj = -1; dj <= 1; ++dj)
      for (Index di = -1; di <= 1; ++di) {
        const Index i = near[0] + di, j = near[1] + dj, l = near[2] + dk;
        if (i < 0 || j < 0 || l < 0 || i >= n[0] || j >= n[1] || l >= n[2]) continue;
        const Index other =
            lattice.number[static_cast<std::size_t>(i + j * lattice.stride[1] + l * lattice.stride[2])];
        const double away = (lattice.place(i, j, l) - x).squaredNorm();
        if (other >= 0 && (best < 0 || away < least)) best = other, least = away;
      }
  return best;
}

// [cells inside] Flux into the body under the contact patch, 1 in all; zero if no cell is near it.
Eigen::VectorXd inflow(const FlowLattice& lattice, const Boundary& boundary, const Points& patch_edge) {
  Eigen::VectorXd flux = Eigen::VectorXd::Zero(static_cast<Index>(lattice.cell.size()));
  for (const double part : {0.25, 0.55, 0.75, 0.93})
    for (Index k = 0; k < patch_edge.cols(); ++k) {
      const Vec3 x = boundary.centre + part * (patch_edge.col(k) - boundary.centre) +
                     0.7 * lattice.edge * boundary.approach;
      if (const Index best = cell_near(lattice, x); best >= 0) flux[best] += part;
    }
  if (flux.sum() > 0.0) flux /= flux.sum();
  return flux;
}

// [cells inside] Potential of a flux.
Eigen::VectorXd potential(const Eigen::SparseMatrix<double>& matrix, const Eigen::VectorXd& flux) {
  Eigen::ConjugateGradient<Eigen::SparseMatrix<double>, Eigen::Lower | Eigen::Upper,
                           Eigen::IncompleteCholesky<double>>
      solver;
  solver.setTolerance(1e-3);
  solver.setMaxIterations(300);
  solver.compute(matrix);
  return solver.solve(flux);
}

// Flux through a cell, the mean of opposite faces.
Vec3 flux_through(const FlowLattice& lattice, const Eigen::VectorXd& phi, Index r) {
  const Index c = lattice.cell[static_cast<std::size_t>(r)];
  Vec3 through = Vec3::Zero();
  for (std::size_t d = 0; d < 3; ++d) {
    if (lattice.leads_on(c, d))
      if (const int other = lattice.number[static_cast<std::size_t>(c + lattice.stride[d])]; other >= 0)
        through[static_cast<Index>(d)] += 0.5 * (phi[other] - phi[r]);
    if (lattice.leads_back(c, d))
      if (const int other = lattice.number[static_cast<std::size_t>(c - lattice.stride[d])]; other >= 0)
        through[static_cast<Index>(d)] += 0.5 * (phi[r] - phi[other]);
  }
  return through;
}

// Limits the change from a cell to the next to `step`.
void limit_slope(const FlowLattice& lattice, double step, std::vector<double>& value) {
  for (int pass = 0; pass < 2; ++pass)
    for (Index k = 0; k < lattice.all(); ++k) {
      const Index c = pass == 0 ? k : lattice.all() - 1 - k;
      const std::array<Index, 3> at = lattice.at(c);
      double& here = value[static_cast<std::size_t>(c)];
      for (std::size_t d = 0; d < 3; ++d)
        if (pass == 0 ? at[d] > 0 : at[d] + 1 < lattice.n[d])
          here = std::min(
              here,
              value[static_cast<std::size_t>(pass == 0 ? c - lattice.stride[d] : c + lattice.stride[d])] +
                  step);
    }
}

}  // namespace

LoadPath::LoadPath(const BodySurface& body, const Boundary& boundary, const Points& patch_edge,
                   double exponent, double slope)
    : slope_(slope) {
  const FlowLattice lattice(body);
  n_ = lattice.n;
  edge_ = lattice.edge;
  origin_ = lattice.origin;
  finer_.assign(static_cast<std::size_t>(lattice.all()), 1.0);
  if (lattice.cell.empty()) return;
  const Eigen::VectorXd flux = inflow(lattice, boundary, patch_edge);
  if (!(flux.sum() > 0.0)) return;
  const Eigen::VectorXd phi = potential(conduction(lattice, boundary), flux);
  stop_if_requested();
  if (!phi.allFinite()) return;  // then nothing is refined

  tbb::parallel_for(Index{0}, phi.size(), [&](Index r) {
    const Index c = lattice.cell[static_cast<std::size_t>(r)];
    const auto [i, j, k] = lattice.at(c);
    const double from_centre = (lattice.place(i, j, k) - boundary.centre).norm();
    if (from_centre < boundary.radius + 2.0 * edge_) return;  // the cells are too coarse there
    const double half_space =
        1.0 / (std::numbers::pi * (2.0 * from_centre * from_centre + boundary.radius * boundary.radius));
    const double through = flux_through(lattice, phi, r).norm();
    const double more = std::clamp(through / (edge_ * edge_) / half_space, 1.0, most_finer);
    finer_[static_cast<std::size_t>(c)] = std::pow(more, -exponent);
  });
  limit_slope(lattice, slope * edge_, finer_);
}

double LoadPath::operator()(const Vec3& x) const {
  if (finer_.empty()) return 1.0;
  Eigen::Array<Index, 3, 1> low;
  Vec3 part;
  for (Index d = 0; d < 3; ++d) {
    const double most = static_cast<double>(n_[static_cast<std::size_t>(d)] - 1);
    const double t = std::clamp((x[d] - origin_[d]) / edge_, 0.0, most);
    low[d] = std::min(static_cast<Index>(t), n_[static_cast<std::size_t>(d)] - 2);
    part[d] = t - static_cast<double>(low[d]);
  }
  double sum = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const Index i = low[0] + (corner & 1), j = low[1] + (corner >> 1 & 1), k = low[2] + (corner >> 2 & 1);
    const double weight = (corner & 1 ? part[0] : 1.0 - part[0]) * (corner & 2 ? part[1] : 1.0 - part[1]) *
                          (corner & 4 ? part[2] : 1.0 - part[2]);
    sum += weight * finer_[static_cast<std::size_t>(i + n_[0] * (j + n_[1] * k))];
  }
  return sum;
}

}  // namespace dimple
