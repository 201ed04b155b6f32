#include "preprocess/supports/consistency.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <iterator>
#include <utility>

#include "io/stop.hpp"
#include "preprocess/clones.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {
namespace {

// Relative residual. With 1e-6 a patch test has errors of some 1e-7 of its scale, with this 1e-8. Forces with
// 1e-6 and 1e-12 agree to a millionth.
constexpr double tolerance = 1e-7;
constexpr Index slab = 65536;  // pieces of the surface whose shape functions are held at a time

using Coefficients = Eigen::Matrix<double, 4, 3>;

// Linear fields over the nodes of each cell: 1 and (X - x_q) / size.
struct LinearFields {
  explicit LinearFields(const Model& m) : model(m) {
    const Index count = model.point_count();
    size.resize(count);
    inverse.resize(static_cast<std::size_t>(count));
    tbb::parallel_for(Index{0}, count, [&](Index q) {
      if (q % 256 == 0) stop_if_requested();
      size[q] = 0.0;
      for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
        size[q] = std::max(size[q], (model.X.col(model.support.member[k]) - model.point.col(q)).norm());
      Eigen::Matrix4d gram = Eigen::Matrix4d::Zero();
      for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k) {
        const Eigen::Vector4d b = at(q, model.support.member[k]);
        gram += b * b.transpose();
      }
      inverse[static_cast<std::size_t>(q)] = gram.ldlt().solve(Eigen::Matrix4d::Identity());
    });
  }
  Eigen::Vector4d at(Index q, int node) const {
    Eigen::Vector4d b;
    b << 1.0, (model.X.col(node) - model.point.col(q)) / size[q];
    return b;
  }
  // Coefficients of the linear field nearest to the nodal values lambda [3xN].
  Coefficients nearest(Index q, const Points& lambda) const {
    Coefficients sum = Coefficients::Zero();
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k) {
      const int a = model.support.member[k];
      sum += at(q, a) * lambda.col(a).transpose();
    }
    return inverse[static_cast<std::size_t>(q)] * sum;
  }
  const Model& model;
  Eigen::VectorXd size;
  std::vector<Eigen::Matrix4d> inverse;
};

// Four numbers for each node: three directions and one that remains zero.
using Lanes = double __attribute__((vector_size(32), aligned(8), may_alias));
using Nodal = Eigen::Matrix<double, 4, Eigen::Dynamic>;

DIMPLE_CLONES void rows_times(const int* offset, const int* column, const double* value, const double* x,
                              Index first, Index last, double* result) {
  for (Index a = first; a < last; ++a) {
    Lanes even = {}, odd = {};
    int k = offset[a];
    for (; k + 1 < offset[a + 1]; k += 2) {
      even += value[k] * *reinterpret_cast<const Lanes*>(x + 4 * column[k]);
      odd += value[k + 1] * *reinterpret_cast<const Lanes*>(x + 4 * column[k + 1]);
    }
    if (k < offset[a + 1]) even += value[k] * *reinterpret_cast<const Lanes*>(x + 4 * column[k]);
    *reinterpret_cast<Lanes*>(result + 4 * a) = even + odd;
  }
}

// Row a: the cells that node a belongs to, and its index in the list of each.
struct Influence {
  explicit Influence(const Model& model) : rows(transpose(model.support, model.node_count(), &slot)) {}
  Eigen::VectorXi slot;
  CompressedRows rows;
};

// Pairs of nodes in a common cell: the columns of the variance, for all tissues.
CompressedRows columns_of(const Model& model) {
  CompressedRows result = model.variance.front().rows;
  for (std::size_t t = 1; t < model.variance.size(); ++t) {
    const CompressedRows &one = result, &other = model.variance[t].rows;
    std::vector<int> offset(1, 0), member;
    for (Index a = 0; a < one.rows(); ++a) {
      std::set_union(one.member.begin() + one.offset[a], one.member.begin() + one.offset[a + 1],
                     other.member.begin() + other.offset[a], other.member.begin() + other.offset[a + 1],
                     std::back_inserter(member));
      offset.push_back(static_cast<int>(member.size()));
    }
    result.offset = Eigen::VectorXi::Map(offset.data(), static_cast<Index>(offset.size()));
    result.member = Eigen::VectorXi::Map(member.data(), static_cast<Index>(member.size()));
  }
  return result;
}

// sum_q V_q (I - P_q), assembled: each of its rows is used in every iteration.
struct Operator {
  Operator(const Model& model, const LinearFields& fields, const Influence& influence)
      : rows(columns_of(model)), value(rows.member.size()), diagonal(Eigen::VectorXd::Zero(rows.rows())) {
    const Index n = rows.rows();
    std::vector<int> next(static_cast<std::size_t>(n));  // place after the diagonal
    // The lower triangle, row by row, points ascending.
    tbb::parallel_for(Index{0}, n, [&](Index a) {
      if (a % 64 == 0) stop_if_requested();
      thread_local std::vector<double> sum;  // all zero between rows
      if (sum.size() < static_cast<std::size_t>(n)) sum.resize(static_cast<std::size_t>(n), 0.0);
      double volume = 0.0;
      for (int k = influence.rows.offset[a]; k < influence.rows.offset[a + 1]; ++k) {
        const int q = influence.rows.member[k];
        Eigen::Vector4d g = model.volume[q] *
                            (fields.inverse[static_cast<std::size_t>(q)] * fields.at(q, static_cast<int>(a)));
        g.tail<3>() /= fields.size[q];
        g[0] -= g.tail<3>().dot(model.point.col(q));
        volume += model.volume[q];
        for (int m = model.support.offset[q]; m <= influence.slot[k]; ++m) {
          const int b = model.support.member[m];
          const double* X = model.X.data() + 3 * b;
          sum[static_cast<std::size_t>(b)] -= g[0] + (g[1] * X[0] + g[2] * X[1] + g[3] * X[2]);
        }
      }
      sum[static_cast<std::size_t>(a)] += volume;
      diagonal[a] = sum[static_cast<std::size_t>(a)];
      int k = rows.offset[a];
      for (; k < rows.offset[a + 1] && rows.member[k] <= a; ++k)
        value[k] = std::exchange(sum[static_cast<std::size_t>(rows.member[k])], 0.0);
      next[static_cast<std::size_t>(a)] = k;
    });
    // Rows ascending: what is above the diagonal enters each row in its order.
    for (Index a = 0; a < n; ++a) {
      if (a % 4096 == 0) stop_if_requested();
      for (int k = rows.offset[a]; k < rows.offset[a + 1] && rows.member[k] < a; ++k)
        value[next[static_cast<std::size_t>(rows.member[k])]++] = value[k];
    }
  }
  void apply(const Nodal& x, Nodal& result) const {
    tbb::parallel_for(tbb::blocked_range<Index>(0, x.cols(), 128), [&](const auto& range) {
      rows_times(rows.offset.data(), rows.member.data(), value.data(), x.data(), range.begin(), range.end(),
                 result.data());
    });
  }
  CompressedRows rows;
  Eigen::VectorXd value, diagonal;
};

// Coarse space of the preconditioner. The operator acts only on what bends within a cell's support: smooth
// fields have nearly zero energy, and conjugate gradients would find them one by one. Linear fields over
// groups of about a hundred nodes span nearly all smooth fields. With their exact solution the number of
// iterations does not grow with the nodes, up to some 131,000; beyond, the groups grow. Source: Nicolaides,
// SIAM J. Numer. Anal. 24 (1987), in its additive form.
class CoarseFields {
 public:
  CoarseFields(const Model& model, const Operator& A)
      : nodes_(model.node_count()), groups_(group_count(nodes_)), field_(4, nodes_) {
    // Nodes are in the order of a space-filling curve: a run of them is a compact group, and repeated halves
    // of all nodes are boxes.
    tbb::parallel_for(Index{0}, groups_, [&](Index g) {
      const auto X = model.X.middleCols(first(g), first(g + 1) - first(g));
      const Vec3 middle = X.rowwise().mean();
      const double size = std::max((X.colwise() - middle).cwiseAbs().maxCoeff(), 1e-300);
      for (Index a = first(g); a < first(g + 1); ++a) field_.col(a) << 1.0, (model.X.col(a) - middle) / size;
    });
    using Block = Eigen::Matrix4d;
    std::vector<std::vector<std::pair<Index, Block>>> blocks(static_cast<std::size_t>(groups_));
    tbb::parallel_for(Index{0}, groups_, [&](Index g) {
      stop_if_requested();
      std::vector<Block> sum(static_cast<std::size_t>(g + 1), Block::Zero());
      std::vector<char> met(sum.size(), 0);
      for (Index a = first(g); a < first(g + 1); ++a)
        for (int k = A.rows.offset[a]; k < A.rows.offset[a + 1];) {
          const Index h = group_of(A.rows.member[k]), end = first(h + 1);
          if (h > g) break;
          Eigen::Vector4d row = Eigen::Vector4d::Zero();
          for (; k < A.rows.offset[a + 1] && A.rows.member[k] < end; ++k)
            row += A.value[k] * field_.col(A.rows.member[k]);
          sum[static_cast<std::size_t>(h)] += field_.col(a) * row.transpose();
          met[static_cast<std::size_t>(h)] = 1;
        }
      for (Index h = 0; h <= g; ++h)
        if (met[static_cast<std::size_t>(h)])
          blocks[static_cast<std::size_t>(g)].push_back({h, sum[static_cast<std::size_t>(h)]});
    });
    std::vector<Eigen::Triplet<double>> lower;
    double largest = 0.0;
    for (Index g = 0; g < groups_; ++g)
      for (const auto& [h, block] : blocks[static_cast<std::size_t>(g)]) {
        for (int i = 0; i < 4; ++i)
          for (int j = 0; j < (h == g ? i + 1 : 4); ++j)
            lower.emplace_back(static_cast<int>(4 * g + i), static_cast<int>(4 * h + j), block(i, j));
        if (h == g) largest = std::max(largest, block.diagonal().maxCoeff());
      }
    // Globally linear fields have no energy, and the right side has no part in them.
    for (int i = 0; i < 4 * groups_; ++i) lower.emplace_back(i, i, 1e-9 * largest);
    Eigen::SparseMatrix<double> matrix(4 * groups_, 4 * groups_);
    matrix.setFromTriplets(lower.begin(), lower.end());
    factor_.compute(matrix);
  }
  // x += the solution in the coarse space for the right side r.
  void add_solution(const Nodal& r, Nodal& x) const {
    Eigen::MatrixXd coarse(4 * groups_, 3);
    tbb::parallel_for(Index{0}, groups_, [&](Index g) {
      const Index from = first(g), count = first(g + 1) - from;
      coarse.middleRows<4>(4 * g).noalias() =
          field_.middleCols(from, count) * r.topRows<3>().middleCols(from, count).transpose();
    });
    coarse = factor_.solve(coarse).eval();
    tbb::parallel_for(Index{0}, groups_, [&](Index g) {
      const Index from = first(g), count = first(g + 1) - from;
      x.topRows<3>().middleCols(from, count).noalias() +=
          coarse.middleRows<4>(4 * g).transpose() * field_.middleCols(from, count);
    });
  }

 private:
  static Index group_count(Index nodes) {
    constexpr Index fewest = 64;  // nodes of a group: 32 need a tenth less time, 128 half more
    // Factors grow faster than the nodes: 4096 groups of 300,000 nodes took half of the supports' time.
    constexpr Index most = 1024;
    const auto few = static_cast<std::size_t>(std::max<Index>(1, nodes / fewest));
    return std::min(most, static_cast<Index>(std::bit_floor(few)));
  }
  Index first(Index group) const { return nodes_ * group / groups_; }
  Index group_of(Index node) const { return ((node + 1) * groups_ - 1) / nodes_; }
  Index nodes_, groups_;
  Eigen::Matrix4Xd field_;  // of each node those of its group: 1 and (X - middle) / size
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor_;
};

// No triangle is larger than a body, and no spacing less than a thousandth of one.
constexpr int deepest = 12;

// A place on the surface, and the spacing of the node nearest to it.
struct Corner {
  Vec3 x;
  double spacing;
};

void divide(const Corner& a, const Corner& b, const Corner& c, const Neighbours& nodes,
            const Eigen::VectorXd& spacing, std::vector<std::array<Vec3, 3>>& piece, int depth = 0) {
  stop_if_requested();
  const auto at = [&](const Vec3& x) { return Corner{x, spacing[nodes.nearest(x, 1).front()]}; };
  const double longest = std::max({(b.x - a.x).norm(), (c.x - b.x).norm(), (a.x - c.x).norm()});
  const Corner middle = at((a.x + b.x + c.x) / 3.0);
  // Nodes at a corner may be much closer together than in the middle.
  if (depth == deepest || longest <= std::min({middle.spacing, a.spacing, b.spacing, c.spacing})) {
    piece.push_back({a.x, b.x, c.x});
    return;
  }
  const Corner ab = at(0.5 * (a.x + b.x)), bc = at(0.5 * (b.x + c.x)), ca = at(0.5 * (c.x + a.x));
  divide(a, ab, ca, nodes, spacing, piece, depth + 1);
  divide(ab, b, bc, nodes, spacing, piece, depth + 1);
  divide(ca, bc, c, nodes, spacing, piece, depth + 1);
  divide(ab, bc, ca, nodes, spacing, piece, depth + 1);
}

}  // namespace

SurfacePieces pieces_of(const Discretisation& discretisation) {
  return pieces_of(discretisation, discretisation.surface.triangles);
}

SurfacePieces pieces_of(const Discretisation& discretisation, const Triangles& triangles) {
  const Points vertex = discretisation.surface.vertex_mm * 1e-3;
  const Neighbours nodes(discretisation.X);
  std::vector<Corner> corner(static_cast<std::size_t>(vertex.cols()));
  tbb::parallel_for(Index{0}, vertex.cols(), [&](Index v) {
    if (v % 256 == 0) stop_if_requested();
    corner[static_cast<std::size_t>(v)] = {vertex.col(v),
                                           discretisation.spacing[nodes.nearest(vertex.col(v), 1).front()]};
  });
  std::vector<std::vector<std::array<Vec3, 3>>> pieces(static_cast<std::size_t>(triangles.cols()));
  tbb::parallel_for(Index{0}, triangles.cols(), [&](Index t) {
    const auto of = [&](int k) -> const Corner& { return corner[static_cast<std::size_t>(triangles(k, t))]; };
    divide(of(0), of(1), of(2), nodes, discretisation.spacing, pieces[static_cast<std::size_t>(t)]);
  });
  Index count = 0;
  for (const auto& list : pieces) count += static_cast<Index>(list.size());
  SurfacePieces result = {Points(3, count), Points(3, count), Points(3, 3 * count)};
  Index at = 0;
  for (const auto& list : pieces)
    for (const auto& [a, b, c] : list) {
      result.place.col(at) = (a + b + c) / 3.0;
      result.area.col(at) = 0.5 * (b - a).cross(c - a);
      result.corner.middleCols(3 * at++, 3) << a, b, c;
    }
  return result;
}

Points surface_integrals(const Discretisation& discretisation, const SupportOptions& options,
                         const SurfacePieces& surface) {
  Points result = Points::Zero(3, discretisation.node_count());
  for (Index first = 0; first < surface.place.cols(); first += slab) {
    const Index count = std::min(slab, surface.place.cols() - first);
    const Interpolation phi =
        make_interpolation(discretisation, options, surface.place.middleCols(first, count));
    for (Index k = 0; k < count; ++k)
      for (int e = phi.rows.offset[k]; e < phi.rows.offset[k + 1]; ++e)
        result.col(phi.rows.member[e]) += phi.weight[e] * surface.area.col(first + k);
  }
  return result;
}

namespace {

// Residual of the divergence theorem, and its largest ratio to the sum of the terms' norms.
struct Lack {
  Points residual;
  double largest;
};

Lack lack_of(const Model& model, const Influence& influence, const Points& requested) {
  Points r = -requested;
  Eigen::VectorXd scale(r.cols());
  tbb::parallel_for(Index{0}, r.cols(), [&](Index a) {
    if (a % 256 == 0) stop_if_requested();
    scale[a] = 0.0;
    for (int k = influence.rows.offset[a]; k < influence.rows.offset[a + 1]; ++k) {
      const double volume = model.volume[influence.rows.member[k]];
      const auto g = model.dphi.col(influence.slot[k]);
      r.col(a) += volume * g;
      scale[a] += volume * g.norm();
    }
  });
  const double largest = (r.colwise().norm().transpose().array() / scale.array().max(1e-300)).maxCoeff();
  return {std::move(r), largest};
}

// Removes from the residual its part in linear fields, which no admissible change of gradients can affect. It
// is not zero since a surface of flat pieces encloses a slightly different volume than the cells.
void spare_linear_fields(const Model& model, Points& residual) {
  Eigen::Matrix4Xd b(4, model.node_count());
  const Vec3 middle = model.X.rowwise().mean();
  const double size = (model.X.colwise() - middle).cwiseAbs().maxCoeff();
  b.row(0).setOnes();
  b.bottomRows<3>() = (model.X.colwise() - middle) / size;
  const Eigen::Matrix4d gram = b * b.transpose();
  residual -= (gram.ldlt().solve(b * residual.transpose())).transpose() * b;
}

// Conjugate gradients for sum_q V_q (I - P_q) lambda = r, all three directions together.
Points multipliers(const Operator& A, const CoarseFields& coarse, Nodal r, int& iterations) {
  const Index n = r.cols();
  const Eigen::RowVectorXd inverse_diagonal = A.diagonal.cwiseMax(1e-300).cwiseInverse().transpose();
  Nodal lambda = Nodal::Zero(4, n), z(4, n), Ap = lambda;
  const auto precondition = [&] {
    z = r * inverse_diagonal.asDiagonal();
    coarse.add_solution(r, z);
  };
  precondition();
  Nodal p = z;
  const double start = r.norm();
  double rz = r.cwiseProduct(z).sum();
  while (iterations < 500 && start > 0.0 && r.norm() > tolerance * start) {
    stop_if_requested();
    A.apply(p, Ap);
    const double curvature = p.cwiseProduct(Ap).sum();
    if (!(curvature > 0.0)) break;  // only rounding is left
    const double alpha = rz / curvature;
    lambda += alpha * p;
    r -= alpha * Ap;
    precondition();
    const double next = r.cwiseProduct(z).sum();
    p = z + (next / rz) * p;
    rz = next;
    ++iterations;
  }
  return lambda.topRows<3>();
}

// Corrects all gradients. Returns the largest change relative to the largest gradient of its point.
double change_gradients(Model& model, const LinearFields& fields, const Points& change_of) {
  Eigen::VectorXd change(model.point_count());
  tbb::parallel_for(Index{0}, model.point_count(), [&](Index q) {
    if (q % 256 == 0) stop_if_requested();
    const Coefficients linear = fields.nearest(q, change_of);
    double most = 0.0, gradient = 0.0;
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k) {
      const int a = model.support.member[k];
      const Vec3 by = change_of.col(a) - linear.transpose() * fields.at(q, a);
      gradient = std::max(gradient, model.dphi.col(k).norm());
      most = std::max(most, by.norm());
      model.dphi.col(k) -= by;
    }
    change[q] = most / gradient;
  });
  return change.maxCoeff();
}

}  // namespace

void make_consistent(Model& model, const Points& requested) {
  const LinearFields fields(model);
  const Influence influence(model);
  ConsistencyReport& report = model.consistency_report = {};
  Lack before = lack_of(model, influence, requested);
  report.before = before.largest;
  spare_linear_fields(model, before.residual);
  Nodal r = Nodal::Zero(4, model.node_count());
  r.topRows<3>() = before.residual;
  const Operator A(model, fields, influence);
  const Points change_of = multipliers(A, CoarseFields(model, A), std::move(r), report.iterations);
  report.largest_change = change_gradients(model, fields, change_of);
  report.after = lack_of(model, influence, requested).largest;
}

}  // namespace dimple
