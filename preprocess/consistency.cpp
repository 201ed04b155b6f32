#include "preprocess/consistency.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "preprocess/neighbours.hpp"
#include "preprocess/support.hpp"

namespace dimple {
namespace {

// Of the residual: where 1e-6 leaves a patch test some 1e-7 of its scale, this leaves 1e-8; and the force, at
// 1e-6 as at 1e-12, is the same to a millionth.
constexpr double tolerance = 1e-7;

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
  Operator(const Model& model, const LinearFields& fields, const CompressedRows& influence) {
    const Index n = model.node_count();
    std::vector<std::vector<std::pair<int, double>>> rows(static_cast<std::size_t>(n));
    tbb::parallel_for(Index{0}, n, [&](Index a) {
      thread_local std::vector<double> sum;
      thread_local std::vector<int> members;
      if (sum.size() < static_cast<std::size_t>(n)) sum.resize(static_cast<std::size_t>(n), 0.0);
      members.assign(1, static_cast<int>(a));
      double volume = 0.0;
      for (int k = influence.offset[a]; k < influence.offset[a + 1]; ++k) {
        const int q = influence.member[k];
        Eigen::Vector4d g = model.volume[q] *
                            (fields.inverse[static_cast<std::size_t>(q)] * fields.at(q, static_cast<int>(a)));
        g.tail<3>() /= fields.size[q];
        const Vec3 x = model.point.col(q);
        volume += model.volume[q];
        for (int m = model.support.offset[q]; m < model.support.offset[q + 1]; ++m) {
          const int b = model.support.member[m];
          double& at = sum[static_cast<std::size_t>(b)];
          if (at == 0.0 && b != a) members.push_back(b);
          at -= g[0] + g.tail<3>().dot(model.X.col(b) - x);
        }
      }
      sum[static_cast<std::size_t>(a)] += volume;
      std::sort(members.begin(), members.end());
      auto& row = rows[static_cast<std::size_t>(a)];
      row.reserve(members.size());
      for (const int b : members) {
        double& at = sum[static_cast<std::size_t>(b)];
        if (at != 0.0) row.push_back({b, at});
        at = 0.0;
      }
    });
    diagonal.resize(n);
    offset.assign(1, 0);
    for (auto& row : rows) {
      const int a = static_cast<int>(offset.size()) - 1;
      diagonal[a] = std::lower_bound(row.begin(), row.end(), std::pair(a, -1e300))->second;
      entry.insert(entry.end(), row.begin(), row.end());
      offset.push_back(entry.size());
      row = {};
    }
  }
  void apply(const Points& lambda, Points& result) const {
    tbb::parallel_for(Index{0}, lambda.cols(), [&](Index a) {
      Vec3 sum = Vec3::Zero();
      for (std::size_t k = offset[static_cast<std::size_t>(a)]; k < offset[static_cast<std::size_t>(a) + 1];
           ++k)
        sum += entry[k].second * lambda.col(entry[k].first);
      result.col(a) = sum;
    });
  }
  Eigen::VectorXd diagonal;
  std::vector<std::size_t> offset;
  std::vector<std::pair<int, double>> entry;  // number, value; numbers ascending but for exact zeros
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
  const Interpolation phi = make_interpolation(model, options, surface.place);
  for (Index k = 0; k < surface.place.cols(); ++k)
    for (int e = phi.rows.offset[k]; e < phi.rows.offset[k + 1]; ++e)
      wanted.col(phi.rows.member[e]) += phi.weight[e] * surface.area.col(k);

  Eigen::VectorXi slot;
  const CompressedRows influence = transpose(model.support, n, &slot);
  Eigen::VectorXd scale = Eigen::VectorXd::Zero(n);
  const auto residual = [&] {
    Points r = -wanted;
    tbb::parallel_for(Index{0}, n, [&](Index a) {
      scale[a] = 0.0;
      for (int k = influence.offset[a]; k < influence.offset[a + 1]; ++k) {
        const double volume = model.volume[influence.member[k]];
        r.col(a) += volume * model.dphi.col(slot[k]);
        scale[a] += volume * model.dphi.col(slot[k]).norm();
      }
    });
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
  const LinearFields fields(model);
  const Operator A(model, fields, influence);
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
