#pragma once

#include "solver/session.hpp"

namespace dimple {

/// The force on a tool between two frames, for a loop that asks far more often than equilibria are found: from the last
/// frame's force and stiffness, without a jump where a new frame corrects them.
///
/// Deeper than the frame: the line with its stiffness, as far as `trusted`. Less deep: the parabola through that force with
/// that slope and through no force at no depth. What a new frame changes is given out by and by, by 1/e in `fade`.
struct BetweenFrames {
  double trusted = 1e-3;                             ///< [m]
  double fade = 0.06;                                ///< [s]
  double depth = 0.0, force = 0.0, stiffness = 0.0;  ///< of the last frame [m], [N], [N/m]
  double left = 0.0;                                 ///< of the last corrections [N]
  double asked = 0.0;                                ///< depth of the last answer [m]
};

/// A new frame is there.
void correct(BetweenFrames& between, const LiveFrame& frame);
/// The force along the push [N] at a depth [m], `dt` [s] after the last answer. None in the air.
double answer(BetweenFrames& between, double depth, double dt);

}  // namespace dimple
