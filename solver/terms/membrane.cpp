#include "solver/terms/membrane.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

// Membrane forces:
// 1. Corners x_v = X_v + sum_a phi_a(X_v) u_a.
// 2. F [3x2] of each triangle from its edges now and at rest; C = F' F.
// 3. Principal stretches l1 >= l2 of C. It wrinkles if l2 is less than that of a strip free across, and is
//    slack if the strip is not stretched.
// 4. S = (h mu + T) I - h mu C^-1 / det C; wrinkled: the strip's stress along l1 alone; slack: 0.
// 5. Forces of the corners by area P = area F S; each corner sums its triangles in one order.
// 6. f_a += sum_v phi_a(X_v) f_v.
//
// Source:   Pipkin 1986 (relaxed energy).
// Departs:  a tension T at rest is added, also to the strip.

namespace dimple {
namespace {

using Plane = Eigen::Matrix<double, 3, 2>;

class Film : public ForceTerm {
 public:
  explicit Film(Membrane film) : film_(std::move(film)) {
    const SurfacePatch& patch = film_.patch;
    for (const auto& t : patch.triangles.colwise()) {
      const Vec3 a = patch.corner.col(t[0]), ab = patch.corner.col(t[1]) - a, ac = patch.corner.col(t[2]) - a;
      const Vec3 e1 = ab.normalized(), normal = ab.cross(ac), e2 = normal.normalized().cross(e1);
      Eigen::Matrix2d edges;
      edges << ab.dot(e1), ac.dot(e1), ab.dot(e2), ac.dot(e2);
      triangle_.push_back({0.5 * normal.norm(), edges.inverse()});
    }
    between_ = stiffness_between();
    find_gradients();
    find_sums();
  }

  void add_force(const Nodal& u, const Instant& now, Nodal& f) override {
    const Points corner = moved(u);
    std::vector<Plane> of_edges(triangle_.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, triangle_.size(), 256), [&](const auto& range) {
      for (std::size_t k = range.begin(); k < range.end(); ++k) {
        const Triangle& mine = triangle_[k];
        const Plane F =
            deformed(corner, film_.patch.triangles.col(static_cast<Index>(k))) * mine.to_undeformed;
        const Plane P = F * second_stress(F);
        of_edges[k] = (now.fraction * mine.area) * P * mine.to_undeformed.transpose();
      }
    });
    Points force(3, corner.cols());
    for_all(force.cols(), [&](Index v) {
      Vec3 sum = Vec3::Zero();  // in one order
      for (int i = of_corner_.offset[v]; i < of_corner_.offset[v + 1]; ++i) {
        const auto k = static_cast<std::size_t>(of_corner_.member[i] / 3);
        const int which = of_corner_.member[i] % 3;
        if (which == 0)
          sum -= of_edges[k].rowwise().sum();
        else
          sum += of_edges[k].col(which - 1);
      }
      force.col(v) = sum;
    });
    for_all(of_node_.rows(), [&](Index a) {
      for (int i = of_node_.offset[a]; i < of_node_.offset[a + 1]; ++i)
        f.col(a).head<3>() += weight_of_node_[i] * force.col(of_node_.member[i]);
    });
  }

  double energy(const Nodal& u, const Instant& now) override {
    const Points corner = moved(u);
    double sum = 0.0;
    for (std::size_t k = 0; k < triangle_.size(); ++k) {
      const Triangle& mine = triangle_[k];
      const Plane F = deformed(corner, film_.patch.triangles.col(static_cast<Index>(k))) * mine.to_undeformed;
      sum += mine.area * energy_per_area(F);
    }
    return now.fraction * sum;
  }

  void add_stiffness_bound(StiffnessBound& bound) const override {
    bound.directed.insert(bound.directed.end(), between_.begin(), between_.end());
  }

  // In its plane as in stiffness_between(), out of it by its stress S, A G.S G: a taut film is stiff there
  // too.
  void add_node_stiffness(const Nodal& u, NodeStiffness& sum) const override {
    const Points corner = moved(u);
    const double shear = stiff();
    for (std::size_t k = 0; k < triangle_.size(); ++k) {
      const auto t = film_.patch.triangles.col(static_cast<Index>(k));
      const double area = triangle_[k].area;
      const Plane F = deformed(corner, t) * triangle_[k].to_undeformed;
      const Vec3 normal = F.col(0).cross(F.col(1)).normalized();
      const Eigen::Matrix2d S = second_stress(F);
      for (std::size_t i = first_gradient_[k]; i < first_gradient_[k + 1]; ++i) {
        const Eigen::Vector2d& G = gradient_[i].value;
        const double within = area * shear * G.squaredNorm(), out = area * std::max(0.0, G.dot(S * G));
        Eigen::Map<Mat3>(sum.col(gradient_[i].node).data()) +=
            within * Mat3::Identity() + (out - within) * normal * normal.transpose();
      }
    }
  }

  // Only the tissue holds it.
  bool is_load() const override { return false; }

 private:
  struct Triangle {
    double area;                    // at rest [m^2]
    Eigen::Matrix2d to_undeformed;  // from its edges in its own plane to those of the unit triangle
  };
  Membrane film_;
  std::vector<Triangle> triangle_;
  std::vector<StiffnessBound::Edge> between_;  // of nodes
  struct Gradient {                            // of a node's function in a triangle
    int node;
    Eigen::Vector2d value;
  };
  std::vector<Gradient> gradient_;  // of triangle k from first_gradient_[k] on, in order of the nodes
  std::vector<std::size_t> first_gradient_;
  CompressedRows of_corner_;  // 3 k + i: corner i of triangle k
  CompressedRows of_node_;    // corners to which a node contributes
  Eigen::VectorXd weight_of_node_;

  template <class Do>
  static void for_all(Index count, const Do& at) {
    tbb::parallel_for(tbb::blocked_range<Index>(0, count, 256), [&](const auto& range) {
      for (Index i = range.begin(); i < range.end(); ++i) at(i);
    });
  }

  void find_gradients() {
    const auto& [rows, weight] = film_.patch.at_corner;
    std::map<int, Eigen::Vector2d> gradient;
    first_gradient_ = {0};
    for (std::size_t k = 0; k < triangle_.size(); ++k) {
      const auto t = film_.patch.triangles.col(static_cast<Index>(k));
      const Eigen::Matrix2d& to_undeformed = triangle_[k].to_undeformed;
      gradient.clear();
      for (int i = 0; i < 3; ++i) {
        const Eigen::Vector2d of_corner = i == 0 ? Eigen::Vector2d(-to_undeformed.colwise().sum())
                                                 : Eigen::Vector2d(to_undeformed.row(i - 1));
        for (int r = rows.offset[t[i]]; r < rows.offset[t[i] + 1]; ++r)
          gradient.try_emplace(rows.member[r], Eigen::Vector2d::Zero()).first->second +=
              weight[r] * of_corner;
      }
      for (const auto& [a, G] : gradient) gradient_.push_back({a, G});
      first_gradient_.push_back(gradient_.size());
    }
  }

  // Lists of the terms of each corner's and each node's force, which are summed in one order.
  void find_sums() {
    const Triangles& triangles = film_.patch.triangles;
    const CompressedRows corners{
        .offset = Eigen::VectorXi::LinSpaced(triangles.cols() + 1, 0, static_cast<int>(triangles.size())),
        .member = triangles.reshaped().cast<int>()};
    CompressedRows of_corner = transpose(corners, film_.patch.corner.cols(), &of_corner_.member);
    of_corner_.offset = std::move(of_corner.offset);
    const auto& [rows, weight] = film_.patch.at_corner;
    const Index nodes = rows.member.size() > 0 ? rows.member.maxCoeff() + 1 : 0;
    Eigen::VectorXi place;
    of_node_ = transpose(rows, nodes, &place);
    weight_of_node_ = weight(place);
  }

  // Bound by isotropic shear: A shear |grad u|^2, the sum over a triangle's edges of cot / 2 (u_i - u_j)^2.
  // Stretching is up to four times as stiff and bending not at all; a factor of four in all directions takes
  // more steps. With D = w_i - w_j, whose sum is zero, (sum D_a u_a)^2 <= sum of D+_a D-_b (u_a - u_b)^2
  // turns edges of corners into edges of nodes.
  std::vector<StiffnessBound::Edge> stiffness_between() const {
    const double shear = stiff();
    std::map<std::pair<int, int>, double> corners, nodes;
    for (const auto& t : film_.patch.triangles.colwise())
      for (int i = 0; i < 3; ++i) {
        const auto a = static_cast<int>(t[(i + 1) % 3]), b = static_cast<int>(t[(i + 2) % 3]);
        const Vec3 x = film_.patch.corner.col(a) - film_.patch.corner.col(t[i]),
                   y = film_.patch.corner.col(b) - film_.patch.corner.col(t[i]);
        // Obtuse angles are left out: they only soften.
        corners[std::minmax(a, b)] += 0.5 * std::max(0.0, x.dot(y) / x.cross(y).norm());
      }
    const auto& [rows, weight] = film_.patch.at_corner;
    for (const auto& [ends, fraction] : corners) {
      std::map<int, double> difference;
      for (int k = rows.offset[ends.first]; k < rows.offset[ends.first + 1]; ++k)
        difference[rows.member[k]] += weight[k];
      for (int k = rows.offset[ends.second]; k < rows.offset[ends.second + 1]; ++k)
        difference[rows.member[k]] -= weight[k];
      for (const auto& [a, more] : difference)
        for (const auto& [b, less] : difference)
          if (more > 0.0 && less < 0.0) nodes[std::minmax(a, b)] -= shear * fraction * more * less;
    }
    std::vector<StiffnessBound::Edge> result;
    for (const auto& [ends, value] : nodes) result.push_back({ends.first, ends.second, value});
    return result;
  }

  // Stretch state of a film that wrinkles: taut in all directions; taut along `direction` alone, if it is
  // shorter across than a strip of it; or slack.
  enum class Taut { in_all_directions, in_one, nowhere };
  struct Stretched {
    Taut taut = Taut::in_all_directions;
    double most = 1.0;  // stretch
    Eigen::Vector2d direction = Eigen::Vector2d::Zero();
  };
  double shear() const { return film_.thickness * film_.shear_modulus; }  // [N/m]
  double stiff() const { return shear() + film_.tension; }
  Stretched stretched(const Eigen::Matrix2d& C) const {
    if (!film_.wrinkles) return {};
    const double mean = 0.5 * (C(0, 0) + C(1, 1)), half = 0.5 * (C(0, 0) - C(1, 1)),
                 off = std::hypot(half, C(0, 1)), most = std::sqrt(mean + off), least2 = mean - off,
                 ratio = shear() / stiff();
    if (least2 * most > std::sqrt(ratio)) return {};
    if (most * most * most <= std::sqrt(ratio)) return {Taut::nowhere};
    // The longer of the two columns of C - least2 I, both along `direction`.
    const Eigen::Vector2d direction =
        half > 0.0 ? Eigen::Vector2d(half + off, C(0, 1)) : Eigen::Vector2d(C(0, 1), off - half);
    return {Taut::in_one, most, direction.normalized()};
  }
  double energy_per_area(const Plane& F) const {
    const Eigen::Matrix2d C = F.transpose() * F;
    const Stretched now = stretched(C);
    const double undeformed = 1.5 * shear() + film_.tension, mixed = std::sqrt(shear() * stiff());
    if (now.taut == Taut::nowhere) return 1.5 * std::cbrt(mixed * mixed * stiff()) - undeformed;
    if (now.taut == Taut::in_one) return 0.5 * stiff() * now.most * now.most + mixed / now.most - undeformed;
    return 0.5 * stiff() * C.trace() + 0.5 * shear() / C.determinant() - undeformed;
  }
  // Second Piola-Kirchhoff stress times the thickness [N/m].
  Eigen::Matrix2d second_stress(const Plane& F) const {
    const Eigen::Matrix2d C = F.transpose() * F;
    const Stretched now = stretched(C);
    if (now.taut == Taut::nowhere) return Eigen::Matrix2d::Zero();
    if (now.taut == Taut::in_one)
      return (stiff() - std::sqrt(shear() * stiff()) / (now.most * now.most * now.most)) * now.direction *
             now.direction.transpose();
    return stiff() * Eigen::Matrix2d::Identity() - shear() * C.inverse() / C.determinant();
  }
  Points moved(const Nodal& u) const {
    const CompressedRows& rows =
        film_.patch.at_corner.rows;  // no structured bindings: clang 14 captures none
    const Eigen::VectorXd& weight = film_.patch.at_corner.weight;
    Points now(3, film_.patch.corner.cols());
    for_all(now.cols(), [&](Index v) {
      Vec3 moves = Vec3::Zero();
      for (int k = rows.offset[v]; k < rows.offset[v + 1]; ++k)
        moves += weight[k] * u.col(rows.member[k]).head<3>();
      now.col(v) = film_.patch.corner.col(v) + moves;
    });
    return now;
  }
  template <class Corners>
  static Plane deformed(const Points& corner, const Corners& t) {
    Plane edges;
    edges << corner.col(t[1]) - corner.col(t[0]), corner.col(t[2]) - corner.col(t[0]);
    return edges;
  }
};

}  // namespace

std::unique_ptr<ForceTerm> membrane(Membrane film) {
  return std::make_unique<Film>(std::move(film));
}

}  // namespace dimple
