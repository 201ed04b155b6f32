#include "solver/terms/touching_tool.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

// Contact with a rigid tool or wall, for each sample s:
// 1. Place x_s = X_s + sum_a phi_a(X_s) u_a; pose of the tool at the present depth.
// 2. gap_s = signed distance to the tool, plus the distance by which its surface is set back; n_s its
//    gradient.
// 3. Normal force lambda_s n_s, set by the search for equilibrium.
// 4. Friction: the anchor of a new contact is its predicted place of first contact (foresee()).
// 5. slip_s: tangential part of x_s - tip - R anchor_s; |t_s| <= min(friction, 100) lambda_s, for new contact
//    min(friction, 1).
// 6. Accepted state: sliding samples get their present foot as anchor, no-slip ones keep theirs; dissipation
//    is summed.
//
// Source:   Wriggers 2006, chapters 4 and 5.
// Departs:  slip counts from the last accepted state; infinite friction is 100. Anchors of new contact are
//           our own.

namespace dimple {
namespace {

// `nearly`: fraction of the friction bound within which a force counts as sliding, for the tolerance of the
// search and the rotation of normals. `errors_apart`: contact errors by which a held sample may leave its
// anchor.
constexpr double nearly = 1e-3, errors_apart = 2.0;
// Coulomb's coefficient of no-slip contact. Nothing slides with it, and friction fades with the pressure
// where contact ends; unbounded, it would have to jump there, and a slip of 2 mm could not be reversed.
constexpr double stuck = 100.0;
constexpr double rounding = 1e-6;  // of the tool's radius: tolerance of clears_body()

// The tool moved along its axis to first contact with any of these places.
ToolPose first_touch(const ToolShape& shape, const ToolPose& axis, const Points& places,
                     const Points& between) {
  double way = std::numeric_limits<double>::infinity();
  for (const Points* part : {&places, &between})
    for (const auto& x : part->colwise())
      way = std::min(way, (x - axis.tip).dot(axis.points_at) + height_of_tool(shape, axis, x));
  return {axis.tip + way * axis.points_at, axis.points_at};
}

}  // namespace

ToolPose first_touch(const ToolShape& shape, const ToolPlace& at, const ContactSurface& surface) {
  return first_touch(shape, {at.centre, at.push}, surface.place, surface.between);
}

ToolPose first_touch(const Touch& touch, const Nodal& u) {
  const ContactSurface& surface = touch.surface;
  const Points moves = surface.at_place(u.topRows<3>());
  Index under = 0;
  (surface.place.colwise() - touch.pose.tip).colwise().squaredNorm().minCoeff(&under);
  return first_touch(touch.shape, {touch.pose.tip + moves.col(under), touch.pose.points_at},
                     surface.place + moves, surface.between + surface.at_between(u.topRows<3>()));
}

Eigen::VectorXd roundness(const Touch& touch) {
  const ContactSurface& surface = touch.surface;
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(surface.count());
  const bool stands = touch.motion && touch.motion->isZero(0.0) && !touch.is_tool;
  if (!stands || surface.sample_of.size() == 0) return mean;
  const auto from = [&](const Vec3& x) { return distance_to_tool(touch.shape, touch.pose, x).distance; };
  for (Index k = 0; k < surface.sample_of.size(); ++k)
    mean[surface.sample_of[k]] += surface.share[k] * from(surface.between.col(k));
  for (Index s = 0; s < mean.size(); ++s) mean[s] -= from(surface.place.col(s));
  return mean;
}

TouchingTool::TouchingTool(Touch touch) : touch_(std::move(touch)), roundness_(roundness(touch_)) {
  way_.motion = touch_.motion.value_or(touch_.pose.points_at);
  force_.setZero(count());
  gap_.setZero(count());
  normal_.setZero(3, count());
  place_ = touch_.surface.place;
  if (!rubs()) return;
  friction_.setZero(3, count());
  slip_ = slid_ = anchor_ = friction_;
  held_within_ = force_before_ = force_;
  slid_along_.setZero(count());
  last_ = before_last_ = touch_.surface.place.colwise() - touch_.pose.tip;
  touched_.assign(static_cast<std::size_t>(count()), 0);
  if (!is_measured()) gone_before_ = -1.0;  // walls are in place before anything moves
}

Eigen::VectorXd TouchingTool::pressures() const {
  const ContactSurface& surface = touch_.surface;
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(count());
  for (Index s = 0; s < count(); ++s) {
    double force = 0.0, area = 0.0;
    for (int k = surface.around.offset[s]; k < surface.around.offset[s + 1]; ++k) {
      const Index t = surface.around.member[k];
      force += surface.hat[k] * force_[t];
      area += surface.hat[k] * surface.area[t];
    }
    mean[s] = force / area;
  }
  return mean;
}

Points TouchingTool::forces_on_body() const {
  Points all = normal_;
  for (Index s = 0; s < count(); ++s) {
    all.col(s) *= force_[s];
    if (rubs()) all.col(s) += friction_.col(s);
  }
  return all;
}

// Path length of the tool. A wall adds the fraction of the loads, which move the body as well.
double TouchingTool::gone(const Instant& now) const {
  return gone_ + now.depth + (is_measured() ? 0.0 : now.share);
}

// A new contact may open again during the search; a larger bound would then make its friction jump.
double TouchingTool::bound(Index s, double normal_force) const {
  if (!(may_rub() && normal_force > 0.0)) return 0.0;
  return std::min(touch_.friction, touched_[static_cast<std::size_t>(s)] ? stuck : 1.0) * normal_force;
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
  const Vec3 tip = touch_.pose.tip + way_.come_at(depth);
  if (!way_.has_turned()) return {tip, touch_.pose.points_at};
  const Mat3 turned = way_.turned_at(depth);
  return {tip, turned * touch_.pose.points_at, turned * touch_.pose.axes()};
}

void TouchingTool::go_on(const RigidWay& way, double gone) {
  way_ = way, gone_ = gone;
}

void TouchingTool::add_force(const Nodal& u, const Instant& now, Nodal& f) {
  const ContactSurface& surface = touch_.surface;
  const ToolPose pose = pose_at(now.depth);
  tip_ = pose.tip;
  is_accepted_ = false;
  place_ = surface.place + surface.at_place(u.topRows<3>());
  gap_.resize(count());
  normal_.resize(3, count());
  if (apart_) {
    gap_.setConstant(touch_.shape.radius);
    normal_.colwise() = pose.points_at;
    return;
  }
  for (Index s = 0; s < count(); ++s) {
    const ToolDistance here = distance_to_tool(touch_.shape, pose, place_.col(s));
    gap_[s] = here.distance + set_back(s);
    normal_.col(s) = here.normal;
  }
  spread(force_, f);
  if (!rubs()) return;
  if (may_rub() && foreseen_for_ != gone(now)) foresee(gone(now));
  turned_ = way_.turned_at(now.depth);
  for (Index s = 0; s < count(); ++s) {
    const Vec3 n = normal_.col(s);
    friction_.col(s) -= n * n.dot(friction_.col(s));
    if (!may_rub()) continue;
    const Vec3 way = place_.col(s) - pose.tip - turned_ * anchor_.col(s);
    slip_.col(s) = way - n * n.dot(way);
    held_within_[s] = errors_apart * error_at(s, now);
  }
  spread(friction_, f);
}

bool TouchingTool::slides(Index s) const {
  const double most = bound(s, force_[s]);
  return most > 0.0 &&
         (friction_.col(s).norm() >= (1.0 - nearly) * most || slip_.col(s).norm() > held_within_[s]);
}

TouchingTool::Contact TouchingTool::contact(Index s) const {
  if (!(force_[s] > 0.0)) return Contact::none;
  return bound(s, force_[s]) > 0.0 && !slides(s) ? Contact::sticks : Contact::slides;
}

Eigen::VectorXd TouchingTool::slid_along() const {
  Eigen::VectorXd all = slid_along_;
  if (is_accepted_) return all;
  for (Index s = 0; s < all.size(); ++s) {
    if (!(force_[s] > 0.0))
      all[s] = 0.0;
    else if (slides(s))
      all[s] += (slip_.col(s) - turned_ * slid_.col(s)).norm();
  }
  return all;
}

// Along the slip the force is the bound, by its mean over the last accepted state and this one.
double TouchingTool::heat() const {
  // All contacting samples count: a force just below its bound slips too, by the tolerance of the search.
  double sum = 0.0;
  if (is_accepted_) return sum;
  for (Index s = 0; s < slip_.cols(); ++s)
    if (bound(s, force_[s]) > 0.0)
      sum -= 0.5 * (1.0 + force_before_[s] / force_[s]) *
             friction_.col(s).dot(slip_.col(s) - turned_ * slid_.col(s));
  return std::max(0.0, sum);
}

// Predicts the anchors of samples not yet in contact: their motion continues as between the last two accepted
// states.
void TouchingTool::foresee(double gone) {
  const ToolPose at_origin{Vec3::Zero(), touch_.pose.points_at};
  const double share = (gone - last_gone_) / (last_gone_ - gone_before_);
  for (Index s = 0; s < count(); ++s) {
    if (touched_[static_cast<std::size_t>(s)]) continue;
    const Vec3 x = last_.col(s), way = share * (x - before_last_.col(s));
    const double gap = distance_to_tool(touch_.shape, at_origin, x).distance + set_back(s),
                 closes = gap - set_back(s) - distance_to_tool(touch_.shape, at_origin, x + way).distance;
    const Vec3 there = x + (closes > gap && gap > 0.0 ? gap / closes : 1.0) * way;
    const ToolDistance tool = distance_to_tool(touch_.shape, at_origin, there);
    anchor_.col(s) = there - (tool.distance + set_back(s)) * tool.normal;
  }
  foreseen_for_ = gone;
}

void TouchingTool::accept(const Nodal&, const Instant& now) {
  if (!rubs() || is_accepted_) return;
  slid_along_ = slid_along();
  heat_so_far_ += heat();
  force_before_ = force_;
  const Vec3 tip = pose_at(now.depth).tip;
  const Mat3 back = turned_.transpose();
  for (Index s = 0; s < count(); ++s) {
    touched_[static_cast<std::size_t>(s)] = force_[s] > 0.0;
    // A no-slip sample keeps its first anchor, so that slips within the tolerance do not add up.
    slid_.col(s) = back * slip_.col(s);
    if (bound(s, force_[s]) > 0.0 && !slides(s)) continue;
    slid_.col(s).setZero();
    anchor_.col(s) = back * (place_.col(s) - gap_[s] * normal_.col(s) - tip);
  }
  // Accepting a state again is not a step.
  if (gone(now) != last_gone_) before_last_ = last_, gone_before_ = last_gone_;
  last_ = back * (place_.colwise() - tip);
  last_gone_ = gone(now);
  foreseen_for_ = -1.0;
  is_accepted_ = true;
}

std::vector<double> TouchingTool::past() const {
  std::vector<double> all = {last_gone_, gone_before_, heat_so_far_};
  for (const Points* part : {&anchor_, &last_, &before_last_, &slid_})
    all.insert(all.end(), part->data(), part->data() + part->size());
  for (const Eigen::VectorXd* part : {&slid_along_, &force_before_})
    all.insert(all.end(), part->begin(), part->end());
  for (const char touched : touched_) all.push_back(touched);
  return all;
}

void TouchingTool::restore_past(const std::vector<double>& past) {
  auto next = past.begin();
  last_gone_ = *next++;
  gone_before_ = *next++;
  heat_so_far_ = *next++;
  for (Points* part : {&anchor_, &last_, &before_last_, &slid_}) {
    std::copy_n(next, part->size(), part->data());
    next += part->size();
  }
  for (Eigen::VectorXd* part : {&slid_along_, &force_before_})
    for (double& value : *part) value = *next++;
  for (char& touched : touched_) touched = *next++ != 0.0;
  foreseen_for_ = -1.0;
  is_accepted_ = true;
}

double TouchingTool::along(const Vec3& push) const {
  const double without = (normal_ * force_).dot(push);
  return rubs() ? without + friction_.rowwise().sum().dot(push) : without;
}

Wrench TouchingTool::on_tool(const Instant& now) const {
  return on_tool_about(pose_at(now.depth).tip);
}

Wrench TouchingTool::on_tool_about(const Vec3& tip) const {
  Wrench sum = Wrench::Zero();
  for (Index s = 0; s < count(); ++s) {
    Vec3 on_body = force_[s] * normal_.col(s);
    if (rubs()) on_body += friction_.col(s);
    sum.head<3>() -= on_body;
    sum.tail<3>() -= (place_.col(s) - tip).cross(on_body);
  }
  return sum;
}

// Power of the contact forces on the body per metre of the path: motion of the tip times their sum, and for a
// rotating tool the rotation times their moment about the tip.
double TouchingTool::working_force(const Instant& now) const {
  if (!way_.turns()) return along(way_.motion);
  return along(way_.speed_at(now.depth)) - way_.turn.dot(on_tool(now).tail<3>());
}

TouchingTool::Touched TouchingTool::touched() const {
  const Eigen::VectorXd& area = touch_.surface.area;
  Touched all;
  if (count() > 0) all.pressure = pressures().maxCoeff();
  const Wrench on_it = on_tool_about(tip_);
  all.force = on_it.head<3>(), all.moment = on_it.tail<3>();
  all.heat = heat_so_far_ + heat();
  for (Index s = 0; s < count(); ++s) {
    all.penetration = std::max(all.penetration, -gap_[s]);
    if (!(force_[s] > 0.0)) continue;
    ++all.samples;
    all.area += area[s];
    if (contact(s) == Contact::sticks) all.sticks += area[s];
  }
  return all;
}

TouchingTool::Audit TouchingTool::audit(const Nodal& u, const Instant& now) const {
  const ContactSurface& surface = touch_.surface;
  const ToolPose pose = pose_at(now.depth);
  Audit result;
  const Points between = surface.between + surface.at_between(u.topRows<3>()),
               beyond = surface.beyond + surface.at_beyond(u.topRows<3>());
  for (Index k = 0; k < between.cols(); ++k)
    result.penetration = std::max(
        result.penetration, -distance_to_tool(touch_.shape, pose, between.col(k)).distance -
                                (touch_.set_back_between.size() > 0 ? touch_.set_back_between[k] : 0.0));
  for (Index s = 0; s < place_.cols(); ++s)
    result.penetration = std::max(
        result.penetration, -distance_to_tool(touch_.shape, pose, place_.col(s)).distance - set_back(s));
  for (Index v = 0; v < beyond.cols(); ++v)
    if (const double in = -distance_to_tool(touch_.shape, pose, beyond.col(v)).distance; in > result.beyond) {
      result.beyond = in;
      result.beyond_at = v;
    }
  return result;
}

bool TouchingTool::clears_body(const Nodal& u, const Instant& now) const {
  const ToolPose pose = pose_at(now.depth);
  const ContactSurface& surface = touch_.surface;
  const Points place = surface.place + surface.at_place(u.topRows<3>()),
               between = surface.between + surface.at_between(u.topRows<3>()),
               beyond = surface.beyond + surface.at_beyond(u.topRows<3>());
  for (const Points* part : {&place, &between, &beyond})
    for (const auto& x : part->colwise())
      if (distance_to_tool(touch_.shape, pose, x).distance < -rounding * touch_.shape.radius) return false;
  return true;
}

}  // namespace dimple
