#include "solver/terms/loads.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

namespace dimple {
namespace {

class DeadLoad : public ForceTerm {
 public:
  explicit DeadLoad(Nodal force) : force_(std::move(force)) {}
  void add_force(const Nodal&, const Instant& now, Nodal& f) override { f -= now.fraction * force_; }
  double energy(const Nodal& u, const Instant& now) override {
    return -now.fraction * force_.cwiseProduct(u).sum();
  }

 private:
  Nodal force_;
};

// [3xV] m: positions of the patch's corners.
Points moved(const SurfacePatch& patch, const Nodal& u) {
  Points corner = patch.corner;
  const auto& [rows, weight] = patch.at_corner;
  for (Index v = 0; v < corner.cols(); ++v)
    for (int k = rows.offset[v]; k < rows.offset[v + 1]; ++k)
      corner.col(v) += weight[k] * u.col(rows.member[k]).head<3>();
  return corner;
}

// [4xN] N of a pressure of 1 Pa on these corners, by the rule of surface_integrals(): a uniform pressure then
// balances a uniform stress exactly.
Nodal unit_pressure(const SurfacePatch& patch, const Points& corner, Index nodes) {
  Nodal force = Nodal::Zero(4, nodes);
  const auto& [rows, weight] = patch.at_middle;
  for (Index t = 0; t < patch.triangles.cols(); ++t) {
    const Vec3 a = corner.col(patch.triangles(0, t)), b = corner.col(patch.triangles(1, t)),
               c = corner.col(patch.triangles(2, t));
    const Vec3 inward = -0.5 * (b - a).cross(c - a);
    for (int k = rows.offset[t]; k < rows.offset[t + 1]; ++k)
      force.col(rows.member[k]).head<3>() += weight[k] * inward;
  }
  return force;
}

// A following pressure on a patch with a moving edge has no energy. Its work is used instead, by the mean of
// the forces at both ends of each step.
class FollowingPressure : public ForceTerm {
 public:
  FollowingPressure(SurfacePatch patch, double pressure, bool around, Index nodes)
      : patch_(std::move(patch)),
        pressure_(pressure),
        around_(around),
        u_(Nodal::Zero(4, nodes)),
        force_(u_) {}
  double pressure_around() const override { return around_ ? pressure_ : 0.0; }
  void add_force(const Nodal& u, const Instant& now, Nodal& f) override { f -= force_at(u, now); }
  double energy(const Nodal& u, const Instant& now) override {
    return -(work_ + 0.5 * (force_ + force_at(u, now)).cwiseProduct(u - u_).sum());
  }
  void accept(const Nodal& u, const Instant& now) override {
    work_ = -energy(u, now);
    u_ = u;
    force_ = force_at(u, now);
  }
  std::vector<double> past() const override {
    std::vector<double> all(u_.data(), u_.data() + u_.size());
    all.insert(all.end(), force_.data(), force_.data() + force_.size());
    all.push_back(work_);
    return all;
  }
  void restore_past(const std::vector<double>& past) override {
    u_ = Eigen::Map<const Nodal>(past.data(), 4, u_.cols());
    force_ = Eigen::Map<const Nodal>(past.data() + u_.size(), 4, u_.cols());
    work_ = past.back();
  }

 private:
  SurfacePatch patch_;
  double pressure_;
  bool around_;
  Nodal u_, force_;  // of the last accepted step
  double work_ = 0.0;

  Nodal force_at(const Nodal& u, const Instant& now) const {
    return (now.fraction * pressure_) * unit_pressure(patch_, moved(patch_, u), u.cols());
  }
};

}  // namespace

Nodal lost_buoyancy(const Model& model, const FluidLost& fluid) {
  Eigen::VectorXd mass = Eigen::VectorXd::Zero(model.node_count());
  for (Index q = 0; q < model.point_count(); ++q) {
    // A cell counts as a box: its second moment along `up` is a third of half its height, squared.
    const double half =
        model.second_moments.cols() > 0
            ? std::sqrt(3.0 * std::max(0.0, fluid.up.dot(as_matrix(model.second_moments, q) * fluid.up)))
            : 0.0;
    const double height = model.point.col(q).dot(fluid.up) - fluid.level;
    const double above = half > 0.0 ? std::clamp(0.5 + 0.5 * height / half, 0.0, 1.0) : height > 0.0;
    const double fraction =
        above * fluid.density * model.volume[q] / static_cast<double>(model.support.count(q));
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
      mass[model.support.member[k]] += fraction;
  }
  return padded(-fluid.acceleration * fluid.up) * mass.transpose();
}

Nodal nodal_force(const Model& model, const Interpolation& to_points, const BodyForce& body) {
  const auto& [rows, phi] = to_points;
  Nodal force = Nodal::Zero(4, model.node_count());
  for (Index q = 0; q < model.point_count(); ++q) {
    const Vec3 f = body.force + body.gradient * (model.point.col(q) - body.at);
    for (int k = rows.offset[q]; k < rows.offset[q + 1]; ++k)
      force.col(rows.member[k]).head<3>() += model.volume[q] * phi[k] * f;
  }
  return force;
}

bool Loads::move_the_body() const {
  return !gravity.isZero(0.0) || !pressure.empty() || fluid || !body_force.empty() ||
         std::any_of(membrane.begin(), membrane.end(), [](const Membrane& m) { return m.tension > 0.0; });
}

std::unique_ptr<ForceTerm> dead_load(Nodal force) {
  return std::make_unique<DeadLoad>(std::move(force));
}

ForceTerms make_terms(const Model& model, const Loads& loads) {
  ForceTerms terms;
  if (!loads.gravity.isZero(0.0)) terms.push_back(dead_load(padded(loads.gravity) * model.mass.transpose()));
  if (loads.fluid) terms.push_back(dead_load(lost_buoyancy(model, *loads.fluid)));
  for (const Loads::OnNodes& one : loads.body_force) terms.push_back(dead_load(one.force));
  for (const SurfacePressure& one : loads.pressure)
    if (one.follows)
      terms.push_back(
          std::make_unique<FollowingPressure>(one.patch, one.pressure, one.around, model.node_count()));
    else
      terms.push_back(
          dead_load(one.pressure * unit_pressure(one.patch, one.patch.corner, model.node_count())));
  for (const Membrane& one : loads.membrane) terms.push_back(membrane(one));
  return terms;
}

}  // namespace dimple
