#include "solver/between_frames.hpp"

#include <algorithm>
#include <cmath>

namespace dimple {
namespace {

double by_frame(const BetweenFrames& b, double depth) {
  if (depth <= 0.0) return 0.0;
  if (depth >= b.depth) return b.force + b.stiffness * std::min(depth - b.depth, b.trusted);
  const double share = depth / b.depth, rise = b.stiffness * b.depth;
  return share * (2.0 * b.force - rise + share * (rise - b.force));
}

}  // namespace

void correct(BetweenFrames& b, const LiveFrame& frame) {
  const double before = by_frame(b, b.asked);
  b.depth = frame.depth;
  b.force = frame.force;
  b.stiffness = std::max(0.0, frame.stiffness);
  b.left += before - by_frame(b, b.asked);
}

double answer(BetweenFrames& b, double depth, double dt) {
  b.asked = depth;
  b.left *= std::exp(-dt / b.fade);
  return depth <= 0.0 ? 0.0 : by_frame(b, depth) + b.left;
}

}  // namespace dimple
