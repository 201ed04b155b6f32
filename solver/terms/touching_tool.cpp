#include "solver/terms/touching_tool.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>

namespace dimple {
namespace {

constexpr double rounding = 1e-9;  // of its bound, which a force that slides has but for rounding

}  // namespace

ToolPose first_touch(const ToolShape& shape, const Indenter& at, const ContactSurface& surface) {
  double way = std::numeric_limits<double>::infinity();
  const auto meet = [&](const Points& places) {
    for (const auto& x : places.colwise()) {
      const Vec3 d = x - at.centre;
      const double along = d.dot(at.push);
      way = std::min(way, along + height_of_tool(shape, {at.centre, at.push}, x));
    }
  };
  meet(surface.place);
  meet(surface.between);
  return {at.centre + way * at.push, at.push};
}

TouchingTool::TouchingTool(Touch touch) : touch_(std::move(touch)) {
  force_.setZero(count());
  if (!rubs()) return;
  friction_.setZero(3, count());
  slip_ = anchor_ = friction_;
  touched_.assign(static_cast<std::size_t>(count()), 0);
}

double TouchingTool::bound(Index s, double normal_force) const {
  return had_touched(s) && normal_force > 0.0 ? touch_.friction * normal_force : 0.0;
}

void TouchingTool::set_forces(const Eigen::VectorXd& unknowns) {
  force_ = unknowns.head(count());
  if (!rubs()) return;
  for (Index s = 0; s < count(); ++s)
    friction_.col(s) = brought_within(bound(s, force_[s]), unknowns.segment<3>(count() + 3 * s));
}

void TouchingTool::bring_back(Eigen::Ref<Eigen::VectorXd> unknowns) const {
  unknowns.head(count()) = unknowns.head(count()).cwiseMax(0.0);
  if (!rubs()) return;
  for (Index s = 0; s < count(); ++s) {
    auto one = unknowns.segment<3>(count() + 3 * s);
    one = brought_within(bound(s, unknowns[s]), one);
  }
}

ToolPose TouchingTool::pose_at(double depth) const {
  return {touch_.pose.tip + depth * touch_.pose.points_at, touch_.pose.points_at};
}

void TouchingTool::add_force(const Nodal& u, const Instant& now, Nodal& f) {
  const ContactSurface& surface = touch_.surface;
  const ToolPose pose = pose_at(now.depth);
  place_ = surface.place + surface.at_place(u.topRows<3>());
  gap_.resize(count());
  normal_.resize(3, count());
  for (Index s = 0; s < count(); ++s) {
    const ToolDistance here = distance_to_tool(touch_.shape, pose, place_.col(s));
    gap_[s] = here.distance;
    normal_.col(s) = here.normal;
  }
  spread(force_, f);
  if (!rubs()) return;
  for (Index s = 0; s < count(); ++s) {
    const Vec3 n = normal_.col(s);
    friction_.col(s) -= n * n.dot(friction_.col(s));
    if (!had_touched(s)) continue;
    const Vec3 way = place_.col(s) - pose.tip - anchor_.col(s);
    slip_.col(s) = way - n * n.dot(way);
  }
  spread(friction_, f);
}

void TouchingTool::spread(const Eigen::VectorXd& force, Nodal& f) const {
  const auto& [rows, weight] = touch_.surface.at_place;
  for (Index s = 0; s < count(); ++s) {
    if (force[s] == 0.0) continue;
    for (int k = rows.offset[s]; k < rows.offset[s + 1]; ++k)
      f.col(rows.member[k]).head<3>() -= (weight[k] * force[s]) * normal_.col(s);
  }
}

void TouchingTool::spread(const Points& force, Nodal& f) const {
  const auto& [rows, weight] = touch_.surface.at_place;
  for (Index s = 0; s < count(); ++s) {
    if (force.col(s).isZero(0.0)) continue;
    for (int k = rows.offset[s]; k < rows.offset[s + 1]; ++k)
      f.col(rows.member[k]).head<3>() -= weight[k] * force.col(s);
  }
}

bool TouchingTool::slides(Index s) const {
  const double most = bound(s, force_[s]);
  return most > 0.0 && friction_.col(s).norm() >= (1.0 - rounding) * most;
}

double TouchingTool::heat() const {
  double sum = 0.0;
  for (Index s = 0; s < slip_.cols(); ++s)
    if (slides(s)) sum -= friction_.col(s).dot(slip_.col(s));
  return sum;
}

void TouchingTool::accept(const Nodal&, const Instant& now) {
  if (!rubs()) return;
  const Vec3 tip = pose_at(now.depth).tip;
  for (Index s = 0; s < count(); ++s) {
    const bool stuck = bound(s, force_[s]) > 0.0 && !slides(s);
    touched_[static_cast<std::size_t>(s)] = force_[s] > 0.0;
    // What sticks is held where it was first, so that its slip within the tolerance does not add up.
    if (!stuck) anchor_.col(s) = place_.col(s) - gap_[s] * normal_.col(s) - tip;
  }
  slip_.setZero();
}

std::vector<double> TouchingTool::past() const {
  std::vector<double> all(anchor_.data(), anchor_.data() + anchor_.size());
  for (const char touched : touched_) all.push_back(touched);
  return all;
}

void TouchingTool::restore_past(const std::vector<double>& past) {
  if (!rubs()) return;
  std::copy_n(past.begin(), anchor_.size(), anchor_.data());
  for (Index s = 0; s < count(); ++s)
    touched_[static_cast<std::size_t>(s)] = past[static_cast<std::size_t>(3 * count() + s)] != 0.0;
}

double TouchingTool::along(const Vec3& push) const {
  const double without = (normal_ * force_).dot(push);
  return rubs() ? without + friction_.rowwise().sum().dot(push) : without;
}

Wrench TouchingTool::on_tool(const Instant& now) const {
  const Vec3 tip = pose_at(now.depth).tip;
  Wrench sum = Wrench::Zero();
  for (Index s = 0; s < count(); ++s) {
    Vec3 on_body = force_[s] * normal_.col(s);
    if (rubs()) on_body += friction_.col(s);
    sum.head<3>() -= on_body;
    sum.tail<3>() -= (place_.col(s) - tip).cross(on_body);
  }
  return sum;
}

TouchingTool::Audit TouchingTool::audit(const Nodal& u, const Instant& now) const {
  const ContactSurface& surface = touch_.surface;
  const ToolPose pose = pose_at(now.depth);
  Audit result;
  const Points between = surface.between + surface.at_between(u.topRows<3>()),
               beyond = surface.beyond + surface.at_beyond(u.topRows<3>());
  for (const auto& x : between.colwise())
    result.penetration = std::max(result.penetration, -distance_to_tool(touch_.shape, pose, x).distance);
  for (const auto& x : place_.colwise())
    result.penetration = std::max(result.penetration, -distance_to_tool(touch_.shape, pose, x).distance);
  for (Index v = 0; v < beyond.cols(); ++v)
    if (const double in = -distance_to_tool(touch_.shape, pose, beyond.col(v)).distance; in > result.beyond) {
      result.beyond = in;
      result.beyond_at = v;
    }
  return result;
}

}  // namespace dimple
