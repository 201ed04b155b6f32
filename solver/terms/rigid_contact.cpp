#include "solver/terms/rigid_contact.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

// Contact with a rigid tool or wall, for each sample s:
// 1. Place x_s = X_s + sum_a phi_a(X_s) u_a; pose of the tool at the present depth.
// 2. gap_s = signed distance to the tool, plus the distance by which its surface is set back; n_s its
//    gradient.
// 3. Normal force lambda_s n_s, set by the search for equilibrium.
// 4. Friction: the anchor of a new contact is its predicted place of first contact (predict_contact()).
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
constexpr double no_slip_friction = 100.0;
constexpr double rounding = 1e-6;  // of the tool's radius: tolerance of is_separated()

// The tool moved along its axis to first contact with any of these places.
ToolPose first_contact(const ToolShape& shape, const ToolPose& axis, const Points& places,
                       const Points& between) {
  double distance = std::numeric_limits<double>::infinity();
  for (const Points* part : {&places, &between})
    for (const auto& x : part->colwise())
      distance = std::min(distance, (x - axis.tip).dot(axis.points_at) + height_of_tool(shape, axis, x));
  return {axis.tip + distance * axis.points_at, axis.points_at};
}

}  // namespace

ToolPose first_contact(const ToolShape& shape, const ToolPlace& at, const ContactSurface& surface) {
  return first_contact(shape, {at.centre, at.approach}, surface.place, surface.between);
}

ToolPose first_contact(const RigidBody& body, const Nodal& u) {
  const ContactSurface& surface = body.surface;
  const Points moves = surface.at_place(u.topRows<3>());
  Index under = 0;
  (surface.place.colwise() - body.pose.tip).colwise().squaredNorm().minCoeff(&under);
  return first_contact(body.shape, {body.pose.tip + moves.col(under), body.pose.points_at},
                       surface.place + moves, surface.between + surface.at_between(u.topRows<3>()));
}

Eigen::VectorXd roundness(const RigidBody& body) {
  const ContactSurface& surface = body.surface;
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(surface.count());
  const bool is_fixed = body.motion && body.motion->isZero(0.0) && !body.is_tool;
  if (!is_fixed || surface.sample_of.size() == 0) return mean;
  const auto from = [&](const Vec3& x) { return distance_to_tool(body.shape, body.pose, x).distance; };
  for (Index k = 0; k < surface.sample_of.size(); ++k)
    mean[surface.sample_of[k]] += surface.fraction[k] * from(surface.between.col(k));
  for (Index s = 0; s < mean.size(); ++s) mean[s] -= from(surface.place.col(s));
  return mean;
}

RigidContact::RigidContact(RigidBody body) : body_(std::move(body)), roundness_(roundness(body_)) {
  motion_.motion = body_.motion.value_or(body_.pose.points_at);
  force_.setZero(count());
  gap_.setZero(count());
  normal_.setZero(3, count());
  place_ = body_.surface.place;
  if (!has_friction()) return;
  friction_.setZero(3, count());
  slip_ = slid_ = anchor_ = friction_;
  held_within_ = force_before_ = force_;
  slid_along_.setZero(count());
  last_ = before_last_ = body_.surface.place.colwise() - body_.pose.tip;
  was_in_contact_.assign(static_cast<std::size_t>(count()), 0);
  if (!is_measured()) travel_before_ = -1.0;  // walls are in place before anything moves
}

Eigen::VectorXd RigidContact::pressures() const {
  const ContactSurface& surface = body_.surface;
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

Points RigidContact::forces_on_body() const {
  Points all = normal_;
  for (Index s = 0; s < count(); ++s) {
    all.col(s) *= force_[s];
    if (has_friction()) all.col(s) += friction_.col(s);
  }
  return all;
}

// Path length of the tool. A wall adds the fraction of the loads, which move the body as well.
double RigidContact::travel(const Instant& now) const {
  return travel_ + now.depth + (is_measured() ? 0.0 : now.fraction);
}

// A new contact may open again during the search; a larger bound would then make its friction jump.
double RigidContact::bound(Index s, double normal_force) const {
  if (!(friction_is_active() && normal_force > 0.0)) return 0.0;
  return std::min(body_.friction, was_in_contact_[static_cast<std::size_t>(s)] ? no_slip_friction : 1.0) *
         normal_force;
}

void RigidContact::set_forces(const Eigen::VectorXd& unknowns) {
  force_ = unknowns.head(count());
  if (!has_friction()) return;
  for (Index s = 0; s < count(); ++s)
    friction_.col(s) = brought_within(bound(s, force_[s]), unknowns.segment<3>(count() + 3 * s));
}

void RigidContact::project_to_admissible(Eigen::Ref<Eigen::VectorXd> unknowns) const {
  unknowns.head(count()) = unknowns.head(count()).cwiseMax(0.0);
  if (!has_friction()) return;
  for (Index s = 0; s < count(); ++s) {
    auto one = unknowns.segment<3>(count() + 3 * s);
    one = brought_within(bound(s, unknowns[s]), one);
  }
}

ToolPose RigidContact::pose_at(double depth) const {
  const Vec3 tip = body_.pose.tip + motion_.displacement_at(depth);
  if (!motion_.has_turned()) return {tip, body_.pose.points_at};
  const Mat3 turned = motion_.turned_at(depth);
  return {tip, turned * body_.pose.points_at, turned * body_.pose.axes()};
}

void RigidContact::begin_motion(const RigidMotion& motion, double travel) {
  motion_ = motion, travel_ = travel;
}

void RigidContact::add_force(const Nodal& u, const Instant& now, Nodal& f) {
  const ContactSurface& surface = body_.surface;
  const ToolPose pose = pose_at(now.depth);
  tip_ = pose.tip;
  is_accepted_ = false;
  place_ = surface.place + surface.at_place(u.topRows<3>());
  gap_.resize(count());
  normal_.resize(3, count());
  if (separated_) {
    gap_.setConstant(body_.shape.radius);
    normal_.colwise() = pose.points_at;
    return;
  }
  for (Index s = 0; s < count(); ++s) {
    const ToolDistance here = distance_to_tool(body_.shape, pose, place_.col(s));
    gap_[s] = here.distance + gap_offset(s);
    normal_.col(s) = here.normal;
  }
  spread(force_, f);
  if (!has_friction()) return;
  if (friction_is_active() && predicted_for_ != travel(now)) predict_contact(travel(now));
  turned_ = motion_.turned_at(now.depth);
  for (Index s = 0; s < count(); ++s) {
    const Vec3 n = normal_.col(s);
    friction_.col(s) -= n * n.dot(friction_.col(s));
    if (!friction_is_active()) continue;
    const Vec3 displacement = place_.col(s) - pose.tip - turned_ * anchor_.col(s);
    slip_.col(s) = displacement - n * n.dot(displacement);
    held_within_[s] = errors_apart * error_at(s, now);
  }
  spread(friction_, f);
}

bool RigidContact::slides(Index s) const {
  const double most = bound(s, force_[s]);
  return most > 0.0 &&
         (friction_.col(s).norm() >= (1.0 - nearly) * most || slip_.col(s).norm() > held_within_[s]);
}

RigidContact::Contact RigidContact::contact(Index s) const {
  if (!(force_[s] > 0.0)) return Contact::none;
  return bound(s, force_[s]) > 0.0 && !slides(s) ? Contact::no_slip : Contact::slides;
}

Eigen::VectorXd RigidContact::slid_along() const {
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
double RigidContact::dissipation() const {
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
void RigidContact::predict_contact(double travel) {
  const ToolPose at_origin{Vec3::Zero(), body_.pose.points_at};
  const double fraction = (travel - last_travel_) / (last_travel_ - travel_before_);
  for (Index s = 0; s < count(); ++s) {
    if (was_in_contact_[static_cast<std::size_t>(s)]) continue;
    const Vec3 x = last_.col(s), displacement = fraction * (x - before_last_.col(s));
    const double gap = distance_to_tool(body_.shape, at_origin, x).distance + gap_offset(s),
                 closes = gap - gap_offset(s) -
                          distance_to_tool(body_.shape, at_origin, x + displacement).distance;
    const Vec3 there = x + (closes > gap && gap > 0.0 ? gap / closes : 1.0) * displacement;
    const ToolDistance tool = distance_to_tool(body_.shape, at_origin, there);
    anchor_.col(s) = there - (tool.distance + gap_offset(s)) * tool.normal;
  }
  predicted_for_ = travel;
}

void RigidContact::accept(const Nodal&, const Instant& now) {
  if (!has_friction() || is_accepted_) return;
  slid_along_ = slid_along();
  dissipated_ += dissipation();
  force_before_ = force_;
  const Vec3 tip = pose_at(now.depth).tip;
  const Mat3 back = turned_.transpose();
  for (Index s = 0; s < count(); ++s) {
    was_in_contact_[static_cast<std::size_t>(s)] = force_[s] > 0.0;
    // A no-slip sample keeps its first anchor, so that slips within the tolerance do not add up.
    slid_.col(s) = back * slip_.col(s);
    if (bound(s, force_[s]) > 0.0 && !slides(s)) continue;
    slid_.col(s).setZero();
    anchor_.col(s) = back * (place_.col(s) - gap_[s] * normal_.col(s) - tip);
  }
  // Accepting a state again is not a step.
  if (travel(now) != last_travel_) before_last_ = last_, travel_before_ = last_travel_;
  last_ = back * (place_.colwise() - tip);
  last_travel_ = travel(now);
  predicted_for_ = -1.0;
  is_accepted_ = true;
}

std::vector<double> RigidContact::past() const {
  std::vector<double> all = {last_travel_, travel_before_, dissipated_};
  for (const Points* part : {&anchor_, &last_, &before_last_, &slid_})
    all.insert(all.end(), part->data(), part->data() + part->size());
  for (const Eigen::VectorXd* part : {&slid_along_, &force_before_})
    all.insert(all.end(), part->begin(), part->end());
  for (const char contact_summary : was_in_contact_) all.push_back(contact_summary);
  return all;
}

void RigidContact::restore_past(const std::vector<double>& past) {
  auto next = past.begin();
  last_travel_ = *next++;
  travel_before_ = *next++;
  dissipated_ = *next++;
  for (Points* part : {&anchor_, &last_, &before_last_, &slid_}) {
    std::copy_n(next, part->size(), part->data());
    next += part->size();
  }
  for (Eigen::VectorXd* part : {&slid_along_, &force_before_})
    for (double& value : *part) value = *next++;
  for (char& contact_summary : was_in_contact_) contact_summary = *next++ != 0.0;
  predicted_for_ = -1.0;
  is_accepted_ = true;
}

double RigidContact::along(const Vec3& approach) const {
  const double without = (normal_ * force_).dot(approach);
  return has_friction() ? without + friction_.rowwise().sum().dot(approach) : without;
}

Wrench RigidContact::on_tool(const Instant& now) const {
  return on_tool_about(pose_at(now.depth).tip);
}

Wrench RigidContact::on_tool_about(const Vec3& tip) const {
  Wrench sum = Wrench::Zero();
  for (Index s = 0; s < count(); ++s) {
    Vec3 on_body = force_[s] * normal_.col(s);
    if (has_friction()) on_body += friction_.col(s);
    sum.head<3>() -= on_body;
    sum.tail<3>() -= (place_.col(s) - tip).cross(on_body);
  }
  return sum;
}

// Power of the contact forces on the body per metre of the path: motion of the tip times their sum, and for a
// rotating tool the rotation times their moment about the tip.
double RigidContact::force_along_motion(const Instant& now) const {
  if (!motion_.turns()) return along(motion_.motion);
  return along(motion_.speed_at(now.depth)) - motion_.turn.dot(on_tool(now).tail<3>());
}

RigidContact::ContactSummary RigidContact::contact_summary() const {
  const Eigen::VectorXd& area = body_.surface.area;
  ContactSummary all;
  if (count() > 0) all.pressure = pressures().maxCoeff();
  const Wrench on_it = on_tool_about(tip_);
  all.force = on_it.head<3>(), all.moment = on_it.tail<3>();
  all.dissipation = dissipated_ + dissipation();
  for (Index s = 0; s < count(); ++s) {
    all.penetration = std::max(all.penetration, -gap_[s]);
    if (!(force_[s] > 0.0)) continue;
    ++all.samples;
    all.area += area[s];
    if (contact(s) == Contact::no_slip) all.no_slip += area[s];
  }
  return all;
}

RigidContact::Audit RigidContact::audit(const Nodal& u, const Instant& now) const {
  const ContactSurface& surface = body_.surface;
  const ToolPose pose = pose_at(now.depth);
  Audit result;
  const Points between = surface.between + surface.at_between(u.topRows<3>()),
               beyond = surface.beyond + surface.at_beyond(u.topRows<3>());
  for (Index k = 0; k < between.cols(); ++k)
    result.penetration = std::max(
        result.penetration, -distance_to_tool(body_.shape, pose, between.col(k)).distance -
                                (body_.gap_offset_between.size() > 0 ? body_.gap_offset_between[k] : 0.0));
  for (Index s = 0; s < place_.cols(); ++s)
    result.penetration = std::max(
        result.penetration, -distance_to_tool(body_.shape, pose, place_.col(s)).distance - gap_offset(s));
  for (Index v = 0; v < beyond.cols(); ++v)
    if (const double in = -distance_to_tool(body_.shape, pose, beyond.col(v)).distance; in > result.beyond) {
      result.beyond = in;
      result.beyond_at = v;
    }
  return result;
}

bool RigidContact::is_separated(const Nodal& u, const Instant& now) const {
  const ToolPose pose = pose_at(now.depth);
  const ContactSurface& surface = body_.surface;
  const Points place = surface.place + surface.at_place(u.topRows<3>()),
               between = surface.between + surface.at_between(u.topRows<3>()),
               beyond = surface.beyond + surface.at_beyond(u.topRows<3>());
  for (const Points* part : {&place, &between, &beyond})
    for (const auto& x : part->colwise())
      if (distance_to_tool(body_.shape, pose, x).distance < -rounding * body_.shape.radius) return false;
  return true;
}

}  // namespace dimple
