#include <algorithm>
#include <cmath>
#include <limits>

#include "solver/live/session_parts.hpp"

namespace dimple {

double force_apart(const LiveFrame& frame, double apart) {
  if (apart == 0.0) return 0.0;
  const double force = std::abs(frame.force) + frame.error_at_depth;
  if (apart < 0.0) return frame.depth > 0.0 ? force * std::min(1.0, -2.0 * apart / frame.depth) : force;
  if (!(apart <= frame.depth)) return std::numeric_limits<double>::infinity();
  const double grown = 1.0 + apart / frame.depth;
  return force * (grown * grown - 1.0);
}

// Contribution of the unbalanced forces and volumes at a depth to the force on the tool; see
// Session::follow().
double Session::Parts::correction_at(double at, const MixedIteration::Residual& its) const {
  const KnownStates::Slope slope = known.slope(at);
  return slope.u.cwiseProduct(its.force).sum() + slope.lambda.head(its.volume.size()).dot(its.volume);
}

LiveFrame Session::Parts::frame_at_depth(double requested, std::int64_t evaluations) const {
  LiveFrame frame{.requested = requested, .depth = depth, .residual = residual, .evaluations = evaluations};
  frame.force = resistance(u, lambda, f, depth);
  system->set({.depth = depth});
  frame.on_tool = system->on_tool(u, f);
  frame.per_force = per_force(frame);
  if (options.indenter && depth > 0.0)
    frame.penetration = system->tool_contact()->audit(u, system->now()).penetration;
  if (state == State::cut) {
    frame.error_at_depth = std::abs(frame.force);
    return frame;
  }
  if (known.state.size() < 2) return frame;
  const double correction = correction_at(depth, left), stiffness = known.slope(depth).force;
  frame.stiffness = stiffness;
  frame.force += correction;
  frame.on_tool.head<3>() -= correction * model.tool.approach;
  frame.per_force = per_force(frame);
  frame.error_at_depth = live_constants.of_correction * std::abs(correction) +
                         (options.indenter ? live_constants.of_energy_in_contact : live_constants.of_energy) *
                             std::sqrt(left.energy * std::max(0.0, stiffness)) +
                         live_constants.of_force * std::abs(frame.force);
  return frame;
}

Wrench Session::Parts::per_force(const LiveFrame& frame) const {
  if (frame.on_tool.head<3>().norm() < live_constants.steepest * frame.force)
    return frame.on_tool / frame.force;
  for (const KnownStates::State& one : known.state)
    if (!one.per_force.isZero(0.0)) return one.per_force;
  return Wrench::Zero();
}

}  // namespace dimple
