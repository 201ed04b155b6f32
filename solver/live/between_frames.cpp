#include "solver/live/between_frames.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dimple {
namespace {

using Known = BetweenFrames::Known;
using Tool = LiveFrame::Tool;

constexpr double extrapolation_range = 0.2;  // radii beyond a frame
constexpr double secant = 0.1;               // radii between the two states of a stiffness, at most
constexpr double forgotten = 1e-4;           // weight of a frame that is left out

double trusted_of(const BetweenFrames& b, const Known& frame) {
  const bool continues = frame.tool != Tool::stopped && frame.tool != Tool::beyond && frame.stiffness > 0.0;
  if (!continues) return 0.0;
  return b.has_contact ? std::min(extrapolation_range * b.radius, std::max(0.0, frame.depth))
                       : extrapolation_range * b.radius;
}

double extrapolated(const BetweenFrames& b, const Known& frame, double depth) {
  if (depth >= frame.depth)
    return frame.force + frame.stiffness * std::min(depth - frame.depth, trusted_of(b, frame));
  // The slope is limited so that the parabola has no tension.
  const double rise = std::min(frame.stiffness * frame.depth, std::max(0.0, 2.0 * frame.force));
  const double fraction = depth / frame.depth;
  return fraction * (2.0 * frame.force - rise + fraction * (rise - frame.force));
}

double error_of(const BetweenFrames& b, const Known& frame, double depth) {
  const double of_slope = secant / 2.0 * frame.stiffness;  // a secant's slope is that of its middle
  if (depth >= frame.depth) {
    const double x = std::min(depth - frame.depth, trusted_of(b, frame)), rises = frame.stiffness * x;
    const double fraction = frame.depth > 0.0 ? x / frame.depth : 0.0;
    const double bends = 4.0 * std::abs(frame.stiffness * frame.depth - frame.force) * fraction * fraction;
    return frame.error + of_slope * x + std::max(rises * x / b.radius, std::min(rises, bends));
  }
  const double fraction = depth / frame.depth, force = extrapolated(b, frame, depth),
               chord = frame.force * fraction;
  const double tangent =
      std::clamp(frame.force + frame.stiffness * (depth - frame.depth), 0.0, std::max(0.0, 4.0 * chord));
  return fraction * (2.0 - fraction) * frame.error + fraction * (1.0 - fraction) * frame.depth * of_slope +
         std::max(std::abs(chord - force), std::abs(tangent - force));
}

void fade_to(BetweenFrames& b, double now) {
  const double keeps = std::exp(-std::max(0.0, now - b.now) / b.fade);
  b.now = std::max(b.now, now);
  if (b.frame.empty()) return;
  for (Known& frame : b.frame) frame.fraction *= keeps;
  const Known newest = b.frame.back();
  b.frame.pop_back();
  std::erase_if(b.frame, [](const Known& frame) { return frame.fraction < forgotten; });
  b.frame.push_back(newest);
  double older = 0.0;
  for (std::size_t k = 0; k + 1 < b.frame.size(); ++k) older += b.frame[k].fraction;
  b.frame.back().fraction = 1.0 - older;
}

}  // namespace

void correct(BetweenFrames& b, const LiveFrame& frame, double now) {
  fade_to(b, now);
  b.frame.push_back({frame.depth, frame.force, std::max(0.0, frame.stiffness), frame.error_at_depth,
                     frame.per_force, frame.tool, 0.0});
}

void forget(BetweenFrames& b) {
  b.frame.clear();
}

LiveAnswer answer(BetweenFrames& b, double depth, double now) {
  fade_to(b, now);
  LiveAnswer said;
  if (depth <= 0.0) return said;
  said.tool = Tool::lags;
  constexpr double unknown = std::numeric_limits<double>::infinity();
  if (b.frame.empty()) {
    said.error = unknown;
    return said;
  }
  const Known& newest = b.frame.back();
  said.depth = std::min(depth, newest.depth + trusted_of(b, newest));
  if (said.depth == depth)
    said.tool = Tool::there;
  else if (newest.tool == Tool::stopped || newest.tool == Tool::beyond)
    said.tool = newest.tool;
  const double by_newest = extrapolated(b, newest, depth);
  for (const Known& frame : b.frame) {
    const double force = extrapolated(b, frame, depth);
    said.force += frame.fraction * force;
    said.on_tool += frame.fraction * force * frame.per_force;
    said.error_at_depth += frame.fraction * std::abs(force - by_newest);
  }
  said.error_at_depth += error_of(b, newest, depth);
  said.error = said.depth < depth ? unknown : said.error_at_depth;
  return said;
}

}  // namespace dimple
