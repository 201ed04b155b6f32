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

constexpr double cells = 15000.0;    // of the lattice that lie in the body
constexpr double most_in_box = 4e6;  // and all, in a body that fills little of its box
constexpr double most_finer = 30.0;  // times the half-space's flux
constexpr int rim_places = 48;

}  // namespace

LoadPath::LoadPath(const BodySurface& body, const Boundary& boundary, double exponent, double slope)
    : slope_(slope) {
  const Vec3 size = body.upper() - body.lower();
  edge_ = std::cbrt(std::max(body.volume() / cells, size.prod() / most_in_box));
  for (std::size_t d = 0; d < 3; ++d)
    n_[d] = std::max<Index>(2, static_cast<Index>(std::ceil(size[static_cast<Index>(d)] / edge_)));
  const Vec3 count(static_cast<double>(n_[0]), static_cast<double>(n_[1]), static_cast<double>(n_[2]));
  origin_ = 0.5 * (body.lower() + body.upper()) - 0.5 * edge_ * (count - Vec3::Ones());
  const std::array<Index, 3> stride = {1, n_[0], n_[0] * n_[1]};
  const Index all = n_[0] * n_[1] * n_[2];
  const auto place = [&](Index i, Index j, Index k) -> Vec3 {
    return origin_ + edge_ * Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k));
  };

  // What lies between neighbours along each axis: the lines say it exactly, so that no slit is too narrow.
  std::vector<char> inside(static_cast<std::size_t>(all), 0);
  std::array<std::vector<char>, 3> open;  // towards the next along the axis
  for (int axis = 0; axis < 3; ++axis) {
    const auto d = static_cast<std::size_t>(axis), e = (d + 1) % 3, f = (d + 2) % 3;
    open[d].assign(static_cast<std::size_t>(all), 0);
    tbb::parallel_for(Index{0}, n_[e] * n_[f], [&](Index line) {
      if (line % 64 == 0) stop_if_asked();
      const Index first = (line % n_[e]) * stride[e] + (line / n_[e]) * stride[f];
      Vec3 from = origin_;
      from[static_cast<Index>(e)] += edge_ * static_cast<double>(line % n_[e]);
      from[static_cast<Index>(f)] += edge_ * static_cast<double>(line / n_[e]);
      const std::vector<double> t = body.chord(from, axis, edge_ * static_cast<double>(n_[d] - 1));
      for (std::size_t pair = 0; pair + 1 < t.size(); pair += 2) {
        const Index begin = static_cast<Index>(std::ceil(t[pair] / edge_ - 1e-9));
        const Index end = std::min(n_[d] - 1, static_cast<Index>(std::floor(t[pair + 1] / edge_ + 1e-9)));
        for (Index i = std::max<Index>(begin, 0); i <= end; ++i) {
          if (axis == 0) inside[static_cast<std::size_t>(first + i)] = 1;
          if (i < end) open[d][static_cast<std::size_t>(first + i * stride[d])] = 1;
        }
      }
    });
  }
  std::vector<int> number(static_cast<std::size_t>(all), -1);
  std::vector<Index> cell;
  for (Index c = 0; c < all; ++c)
    if (inside[static_cast<std::size_t>(c)]) {
      number[static_cast<std::size_t>(c)] = static_cast<int>(cell.size());
      cell.push_back(c);
    }
  const auto at_of = [&](Index c) {
    return std::array<Index, 3>{c % n_[0], (c / n_[0]) % n_[1], c / stride[2]};
  };

  const auto rows = static_cast<Index>(cell.size());
  finer_.assign(static_cast<std::size_t>(all), 1.0);
  if (rows == 0) return;
  Eigen::VectorXd diagonal = Eigen::VectorXd::Constant(rows, 1e-9), flux = Eigen::VectorXd::Zero(rows);
  std::vector<Eigen::Triplet<double>> entries;
  for (Index r = 0; r < rows; ++r) {
    const Index c = cell[static_cast<std::size_t>(r)];
    const std::array<Index, 3> at = at_of(c);
    for (std::size_t d = 0; d < 3; ++d)
      if (at[d] + 1 < n_[d] && open[d][static_cast<std::size_t>(c)]) {
        const Index other = number[static_cast<std::size_t>(c + stride[d])];
        if (other < 0) continue;
        diagonal[r] += 1.0;
        diagonal[other] += 1.0;
        entries.emplace_back(r, other, -1.0);
        entries.emplace_back(other, r, -1.0);
      }
    // Held: what lies on the surface beneath, low enough.
    const Vec3 x = place(at[0], at[1], at[2]);
    if (boundary.lowest - x.dot(boundary.down) > boundary.base_depth + edge_) continue;
    for (std::size_t d = 0; d < 3; ++d)
      for (const Index side : {-1, 1}) {
        const double down = boundary.down[static_cast<Index>(d)] * static_cast<double>(side);
        if (down < 0.5) continue;
        const bool within = side > 0 ? at[d] + 1 < n_[d] && open[d][static_cast<std::size_t>(c)]
                                     : at[d] > 0 && open[d][static_cast<std::size_t>(c - stride[d])];
        if (!within) diagonal[r] += 2.0;
      }
  }
  for (Index r = 0; r < rows; ++r) entries.emplace_back(r, r, diagonal[r]);
  const Points rim = rim_of_circle(body, boundary, rim_places);
  for (const double part : {0.25, 0.55, 0.75, 0.93})
    for (Index k = 0; k < rim_places; ++k) {
      const Vec3 x = boundary.centre + part * (rim.col(k) - boundary.centre) + 0.7 * edge_ * boundary.push;
      const Eigen::Matrix<Index, 3, 1> near = ((x - origin_) / edge_).array().round().cast<Index>();
      Index best = -1;
      double least = 0.0;
      for (Index dk = -1; dk <= 1; ++dk)
        for (Index dj = -1; dj <= 1; ++dj)
          for (Index di = -1; di <= 1; ++di) {
            const Index i = near[0] + di, j = near[1] + dj, l = near[2] + dk;
            if (i < 0 || j < 0 || l < 0 || i >= n_[0] || j >= n_[1] || l >= n_[2]) continue;
            const Index other = number[static_cast<std::size_t>(i + j * stride[1] + l * stride[2])];
            const double away = (place(i, j, l) - x).squaredNorm();
            if (other >= 0 && (best < 0 || away < least)) best = other, least = away;
          }
      if (best >= 0) flux[best] += part;
    }
  if (!(flux.sum() > 0.0)) return;
  flux /= flux.sum();

  Eigen::SparseMatrix<double> matrix(rows, rows);
  matrix.setFromTriplets(entries.begin(), entries.end());
  Eigen::ConjugateGradient<Eigen::SparseMatrix<double>, Eigen::Lower | Eigen::Upper,
                           Eigen::IncompleteCholesky<double>>
      solver;
  solver.setTolerance(1e-3);
  solver.setMaxIterations(300);
  solver.compute(matrix);
  const Eigen::VectorXd phi = solver.solve(flux);
  stop_if_asked();
  if (!phi.allFinite()) return;  // then nothing is made finer

  // Flux through a cell's faces, the mean of each two.
  tbb::parallel_for(Index{0}, rows, [&](Index r) {
    const Index c = cell[static_cast<std::size_t>(r)];
    const std::array<Index, 3> at = at_of(c);
    Vec3 through = Vec3::Zero();
    for (std::size_t d = 0; d < 3; ++d) {
      if (at[d] + 1 < n_[d] && open[d][static_cast<std::size_t>(c)])
        if (const int other = number[static_cast<std::size_t>(c + stride[d])]; other >= 0)
          through[static_cast<Index>(d)] += 0.5 * (phi[other] - phi[r]);
      if (at[d] > 0 && open[d][static_cast<std::size_t>(c - stride[d])])
        if (const int other = number[static_cast<std::size_t>(c - stride[d])]; other >= 0)
          through[static_cast<Index>(d)] += 0.5 * (phi[r] - phi[other]);
    }
    const Vec3 x = place(at[0], at[1], at[2]);
    const double from_centre = (x - boundary.centre).norm();
    if (from_centre < boundary.radius + 2.0 * edge_) return;  // coarser than what changes there
    const double half_space =
        1.0 / (std::numbers::pi * (2.0 * from_centre * from_centre + boundary.radius * boundary.radius));
    const double more = std::clamp(through.norm() / (edge_ * edge_) / half_space, 1.0, most_finer);
    finer_[static_cast<std::size_t>(c)] = std::pow(more, -exponent);
  });

  // Nowhere steeper than the slope.
  const double step = slope * edge_;
  for (int pass = 0; pass < 2; ++pass)
    for (Index k = 0; k < all; ++k) {
      const Index c = pass == 0 ? k : all - 1 - k;
      const std::array<Index, 3> at = at_of(c);
      double& here = finer_[static_cast<std::size_t>(c)];
      for (std::size_t d = 0; d < 3; ++d)
        if (pass == 0 ? at[d] > 0 : at[d] + 1 < n_[d])
          here = std::min(here,
                          finer_[static_cast<std::size_t>(pass == 0 ? c - stride[d] : c + stride[d])] + step);
    }
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
