#include "preprocess/consistency.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "preprocess/neighbours.hpp"
#include "preprocess/support.hpp"

namespace dimple {
namespace {

// Of the residual: where 1e-6 leaves a patch test some 1e-7 of its scale, this leaves 1e-8; and the force, at
// 1e-6 as at 1e-12, is the same to a millionth.
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
  // Of the linear field nearest to the nodal values lambda [3xN].
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

// sum_q V_q (I - P_q), assembled: each of its rows is used in every iteration.
struct Operator {
  explicit Operator(const Model& model) {
    const Index n = model.node_count();
    const LinearFields fields(model);
    const CompressedRows influence = transpose(model.support, n);
    diagonal.resize(n);
    offset.assign(1, 0);
    struct Row {
      std::vector<int> column;
      std::vector<double> value;
    };
    std::vector<Row> rows(static_cast<std::size_t>(std::min(n, block)));
    for (Index first = 0; first < n; first += block) {
      const Index last = std::min(first + block, n);
      tbb::parallel_for(first, last, [&](Index a) {
        thread_local std::vector<double> sum;
        if (sum.size() < static_cast<std::size_t>(n)) sum.resize(static_cast<std::size_t>(n), 0.0);
        Row& row = rows[static_cast<std::size_t>(a - first)];
        row.column.assign(1, static_cast<int>(a));
        double volume = 0.0;
        for (int k = influence.offset[a]; k < influence.offset[a + 1]; ++k) {
          const int q = influence.member[k];
          Eigen::Vector4d g = model.volume[q] * (fields.inverse[static_cast<std::size_t>(q)] *
                                                 fields.at(q, static_cast<int>(a)));
          g.tail<3>() /= fields.size[q];
          const Vec3 x = model.point.col(q);
          volume += model.volume[q];
          for (int m = model.support.offset[q]; m < model.support.offset[q + 1]; ++m) {
            const int b = model.support.member[m];
            double& at = sum[static_cast<std::size_t>(b)];
            if (at == 0.0 && b != a) row.column.push_back(b);
            at -= g[0] + g.tail<3>().dot(model.X.col(b) - x);
          }
        }
        sum[static_cast<std::size_t>(a)] += volume;
        diagonal[a] = sum[static_cast<std::size_t>(a)];
        std::sort(row.column.begin(), row.column.end());
        row.column.erase(std::unique(row.column.begin(), row.column.end()), row.column.end());
        row.value.clear();
        for (const int b : row.column)
          row.value.push_back(std::exchange(sum[static_cast<std::size_t>(b)], 0.0));
      });
      for (Index a = first; a < last; ++a)
        offset.push_back(offset.back() +
                         static_cast<Index>(rows[static_cast<std::size_t>(a - first)].column.size()));
      // realloc() moves the pages of what is large: it is never held twice.
      column.conservativeResize(offset.back());
      value.conservativeResize(offset.back());
      tbb::parallel_for(first, last, [&](Index a) {
        const Row& row = rows[static_cast<std::size_t>(a - first)];
        std::copy(row.column.begin(), row.column.end(), column.data() + offset[static_cast<std::size_t>(a)]);
        std::copy(row.value.begin(), row.value.end(), value.data() + offset[static_cast<std::size_t>(a)]);
      });
    }
  }
  void apply(const Points& lambda, Points& result) const {
    tbb::parallel_for(Index{0}, lambda.cols(), [&](Index a) {
      Vec3 sum = Vec3::Zero();
      for (Index k = offset[static_cast<std::size_t>(a)]; k < offset[static_cast<std::size_t>(a) + 1]; ++k)
        sum += value[k] * lambda.col(column[k]);
      result.col(a) = sum;
    });
  }
  static constexpr Index block = 4096;  // rows that are made at a time
  Eigen::VectorXd diagonal;
  std::vector<Index> offset;
  Eigen::VectorXi column;  // of each row ascending
  Eigen::VectorXd value;
};

void divide(const Vec3& a, const Vec3& b, const Vec3& c, const Neighbours& nodes, const Model& model,
            std::vector<Vec3>& place, std::vector<Vec3>& area) {
  const double longest = std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
  const Vec3 middle = (a + b + c) / 3.0;
  if (longest <= model.spacing[nodes.nearest(middle, 1).front()]) {
    place.push_back(middle);
    area.push_back(0.5 * (b - a).cross(c - a));
    return;
  }
  const Vec3 ab = 0.5 * (a + b), bc = 0.5 * (b + c), ca = 0.5 * (c + a);
  divide(a, ab, ca, nodes, model, place, area);
  divide(ab, b, bc, nodes, model, place, area);
  divide(ca, bc, c, nodes, model, place, area);
  divide(ab, bc, ca, nodes, model, place, area);
}

}  // namespace

SurfacePieces pieces_of(const Points& vertex, const Triangles& triangles, const Model& model) {
  const Neighbours nodes(model.X);
  std::vector<std::vector<Vec3>> place(static_cast<std::size_t>(triangles.cols())), area = place;
  tbb::parallel_for(Index{0}, triangles.cols(), [&](Index t) {
    divide(vertex.col(triangles(0, t)), vertex.col(triangles(1, t)), vertex.col(triangles(2, t)), nodes,
           model, place[static_cast<std::size_t>(t)], area[static_cast<std::size_t>(t)]);
  });
  Index count = 0;
  for (const auto& list : place) count += static_cast<Index>(list.size());
  SurfacePieces result = {Points(3, count), Points(3, count)};
  Index at = 0;
  for (std::size_t t = 0; t < place.size(); ++t)
    for (std::size_t k = 0; k < place[t].size(); ++k, ++at) {
      result.place.col(at) = place[t][k];
      result.area.col(at) = area[t][k];
    }
  return result;
}

ConsistencyReport make_consistent(Model& model, const SupportOptions& options, const SurfacePieces& surface) {
  const Index n = model.node_count();
  Points wanted = Points::Zero(3, n);
  for (Index first = 0; first < surface.place.cols(); first += slab) {
    const Index count = std::min(slab, surface.place.cols() - first);
    const Interpolation phi = make_interpolation(model, options, surface.place.middleCols(first, count));
    for (Index k = 0; k < count; ++k)
      for (int e = phi.rows.offset[k]; e < phi.rows.offset[k + 1]; ++e)
        wanted.col(phi.rows.member[e]) += phi.weight[e] * surface.area.col(first + k);
  }

  Eigen::VectorXd scale(n);
  const auto residual = [&] {
    Points r = -wanted;
    scale.setZero();
    for (Index q = 0; q < model.point_count(); ++q)
      for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k) {
        const int a = model.support.member[k];
        r.col(a) += model.volume[q] * model.dphi.col(k);
        scale[a] += model.volume[q] * model.dphi.col(k).norm();
      }
    return r;
  };
  const auto largest = [&](const Points& r) {
    return (r.colwise().norm().transpose().array() / scale.array().max(1e-300)).maxCoeff();
  };

  // A surface of flat pieces may enclose another volume than the cells have, by a little: of the residual
  // that part is left, which no change that spares linear fields can take away.
  Points r = residual();
  ConsistencyReport report;
  report.before = largest(r);
  {
    Eigen::Matrix4Xd b(4, n);
    const Vec3 middle = model.X.rowwise().mean();
    const double size = (model.X.colwise() - middle).cwiseAbs().maxCoeff();
    b.row(0).setOnes();
    b.bottomRows<3>() = (model.X.colwise() - middle) / size;
    const Eigen::Matrix4d gram = b * b.transpose();
    r -= (gram.ldlt().solve(b * r.transpose())).transpose() * b;
  }

  // Conjugate gradients for sum_q V_q (I - P_q) lambda = r, all three directions at once.
  const Operator A(model);
  const Eigen::RowVectorXd precondition = A.diagonal.cwiseMax(1e-300).cwiseInverse().transpose();
  Points lambda = Points::Zero(3, n), z = r * precondition.asDiagonal(), p = z, Ap = z;
  const double start = r.norm();
  double rz = r.cwiseProduct(z).sum();
  while (report.iterations < 500 && start > 0.0 && r.norm() > tolerance * start) {
    A.apply(p, Ap);
    const double alpha = rz / p.cwiseProduct(Ap).sum();
    lambda += alpha * p;
    r -= alpha * Ap;
    z = r * precondition.asDiagonal();
    const double next = r.cwiseProduct(z).sum();
    p = z + (next / rz) * p;
    rz = next;
    ++report.iterations;
  }

  const LinearFields fields(model);  // again, rather than to hold them beside the operator
  Eigen::VectorXd change(model.point_count());
  tbb::parallel_for(Index{0}, model.point_count(), [&](Index q) {
    const Coefficients linear = fields.nearest(q, lambda);
    double most = 0.0, gradient = 0.0;
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k) {
      const int a = model.support.member[k];
      const Vec3 by = lambda.col(a) - linear.transpose() * fields.at(q, a);
      gradient = std::max(gradient, model.dphi.col(k).norm());
      most = std::max(most, by.norm());
      model.dphi.col(k) -= by;
    }
    change[q] = most / gradient;
  });
  report.largest_change = change.maxCoeff();
  report.after = largest(residual());
  return report;
}

}  // namespace dimple
