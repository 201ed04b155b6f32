#include "solver/terms/membrane.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

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
  }

  void add_force(const Nodal& u, const Instant& now, Nodal& f) override {
    const Points corner = moved(u);
    Points force = Points::Zero(3, corner.cols());
    for (std::size_t k = 0; k < triangle_.size(); ++k) {
      const auto t = film_.patch.triangles.col(static_cast<Index>(k));
      const Triangle& mine = triangle_[k];
      const Plane F = deformed(corner, t) * mine.to_rest;
      const Eigen::Matrix2d C = F.transpose() * F;
      const Plane P =
          film_.thickness * film_.shear_modulus * (F - F * C.inverse() / C.determinant()) + film_.tension * F;
      const Plane of_edges = (now.share * mine.area) * P * mine.to_rest.transpose();
      force.col(t[0]) -= of_edges.rowwise().sum();
      force.col(t[1]) += of_edges.col(0);
      force.col(t[2]) += of_edges.col(1);
    }
    const auto& [rows, weight] = film_.patch.at_corner;
    for (Index v = 0; v < force.cols(); ++v)
      for (int k = rows.offset[v]; k < rows.offset[v + 1]; ++k)
        f.col(rows.member[k]).head<3>() += weight[k] * force.col(v);
  }

  double energy(const Nodal& u, const Instant& now) override {
    const Points corner = moved(u);
    double sum = 0.0;
    for (std::size_t k = 0; k < triangle_.size(); ++k) {
      const Triangle& mine = triangle_[k];
      const Plane F = deformed(corner, film_.patch.triangles.col(static_cast<Index>(k))) * mine.to_rest;
      const Eigen::Matrix2d C = F.transpose() * F;
      sum += mine.area *
             (0.5 * film_.thickness * film_.shear_modulus * (C.trace() + 1.0 / C.determinant() - 3.0) +
              0.5 * film_.tension * (C.trace() - 2.0));
    }
    return now.share * sum;
  }

  // What shears it, in all directions alike: A shear |grad u|^2, the sum over a triangle's edges of cot / 2
  // (u_i - u_j)^2. What it stretches is up to four times as stiff and what bends it not at all; four times in
  // all directions takes more steps. A difference of corners is one of their nodes: with D = w_i - w_j, which
  // sums to nothing, (sum D_a u_a)^2 <= sum of D+_a D-_b (u_a - u_b)^2.
  void add_stiffness_bound(StiffnessBound& bound) const override {
    const double shear = film_.thickness * film_.shear_modulus + film_.tension;
    std::map<std::pair<int, int>, double> corners, nodes;
    for (const auto& t : film_.patch.triangles.colwise())
      for (int i = 0; i < 3; ++i) {
        const auto a = static_cast<int>(t[(i + 1) % 3]), b = static_cast<int>(t[(i + 2) % 3]);
        const Vec3 x = film_.patch.corner.col(a) - film_.patch.corner.col(t[i]),
                   y = film_.patch.corner.col(b) - film_.patch.corner.col(t[i]);
        // Obtuse angles count nothing: they only soften.
        corners[std::minmax(a, b)] += 0.5 * std::max(0.0, x.dot(y) / x.cross(y).norm());
      }
    const auto& [rows, weight] = film_.patch.at_corner;
    for (const auto& [ends, share] : corners) {
      std::map<int, double> difference;
      for (int k = rows.offset[ends.first]; k < rows.offset[ends.first + 1]; ++k)
        difference[rows.member[k]] += weight[k];
      for (int k = rows.offset[ends.second]; k < rows.offset[ends.second + 1]; ++k)
        difference[rows.member[k]] -= weight[k];
      for (const auto& [a, more] : difference)
        for (const auto& [b, less] : difference)
          if (more > 0.0 && less < 0.0) nodes[std::minmax(a, b)] -= shear * share * more * less;
    }
    for (const auto& [ends, value] : nodes) bound.edge.push_back({ends.first, ends.second, value});
  }

 private:
  struct Triangle {
    double area;              // at rest [m^2]
    Eigen::Matrix2d to_rest;  // from its edges in its own plane to those of the unit triangle
  };
  Membrane film_;
  std::vector<Triangle> triangle_;

  Points moved(const Nodal& u) const { return film_.patch.corner + film_.patch.at_corner(u.topRows<3>()); }
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
