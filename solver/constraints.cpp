#include "solver/constraints.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

namespace dimple {

double max_displacement_ratio(const std::vector<HeldSet>& sets) {
  double longest = 1.0;
  for (const HeldSet& set : sets) longest = std::max(longest, std::abs(set.fraction));
  return longest;
}

Constraints::Constraints(Index node_count, std::vector<HeldSet> sets)
    : set_(std::move(sets)), of_node_(static_cast<std::size_t>(node_count), -1) {
  for (std::size_t s = 0; s < set_.size(); ++s) {
    held_.push_back({padded(set_[s].direction), set_[s].fraction, set_[s].hold});
    for (const Index a : set_[s].node) of_node_[static_cast<std::size_t>(a)] = static_cast<std::int16_t>(s);
  }
}

void Constraints::prescribe(Nodal& u, double depth) const {
  for (Index a = 0; a < u.cols(); ++a) place(a, u.col(a), depth);
}

void Constraints::apply_dirichlet(Nodal& u, const Nodal& requested) const {
  for (Index a = 0; a < u.cols(); ++a) {
    if (is_held_wholly(a)) u.col(a) = requested.col(a);
    if (slides(a)) u.col(a) = requested.col(a) + project(a, u.col(a) - requested.col(a));
  }
}

double Constraints::force_along_motion(const Nodal& f) const {
  double sum = 0.0;
  for (std::size_t s = 0; s < set_.size(); ++s) {
    if (held_[s].fraction == 0.0) continue;
    double of_set = 0.0;
    for (const Index a : set_[s].node)
      if (of_node_[static_cast<std::size_t>(a)] == static_cast<std::int16_t>(s))
        of_set += f.col(a).dot(held_[s].direction);
    sum += held_[s].fraction * of_set;
  }
  return sum;
}

double Constraints::apply_initial_velocity(Nodal& v, double rate, const Eigen::VectorXd& mass) const {
  double work = 0.0;
  for (std::size_t s = 0; s < set_.size(); ++s) {
    const double speed = held_[s].fraction * rate;
    if (held_[s].fraction == 0.0) continue;
    for (const Index a : set_[s].node)
      if (of_node_[static_cast<std::size_t>(a)] == static_cast<std::int16_t>(s)) {
        v.col(a) = held_[s].direction * speed;
        work += 0.5 * mass[a] * speed * speed;
      }
  }
  return work;
}

Vec3 Constraints::motion(std::string_view name) const {
  for (const HeldSet& set : set_)
    if (set.name == name) return set.fraction == 1.0 ? set.direction : Vec3(set.fraction * set.direction);
  return Vec3::Zero();
}

bool Constraints::has_rigid_body_modes() const {
  Mat3 held_parts = Mat3::Zero();
  for (Index a = 0; a < node_count(); ++a)
    if (!is_free(a))
      for (int d = 0; d < 3; ++d) {
        const Eigen::Vector4d one = Eigen::Vector4d::Unit(d);
        held_parts.col(d) += (one - project(a, one)).head<3>();
      }
  return Eigen::SelfAdjointEigenSolver<Mat3>(held_parts, Eigen::EigenvaluesOnly).eigenvalues()[0] < 1e-6;
}

std::vector<Eigen::Vector4d> Constraints::sliding_directions() const {
  std::vector<Eigen::Vector4d> all;
  const auto is_known = [&](const Eigen::Vector4d& direction) {
    return std::any_of(all.begin(), all.end(), [&](const Eigen::Vector4d& one) {
      return std::abs(one.dot(direction)) > std::sqrt(0.5);
    });
  };
  for (const Held& held : held_)
    if (held.hold == HeldSet::Hold::along && !is_known(held.direction)) all.push_back(held.direction);
  return all;
}

Constraints make_constraints(const Model& model, Contact contact, std::vector<HeldSet> further) {
  std::vector<HeldSet> sets = std::move(further);
  sets.push_back({.name = tool_set,
                  .node = model.bonded_patch,
                  .hold = contact == Contact::bonded ? HeldSet::Hold::all : HeldSet::Hold::along,
                  .direction = model.tool.approach,
                  .fraction = 1.0});
  sets.push_back({.name = base_set, .node = model.base});
  return {model.node_count(), std::move(sets)};
}

}  // namespace dimple
