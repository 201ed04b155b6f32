#pragma once

#include <vector>

#include "solver/session.hpp"

namespace dimple {

/// What a tool feels between two frames: force, depth, error and status of one moment.
struct LiveAnswer {
  double depth = 0.0;  ///< that the force is of: as asked, or as deep as it is known to [m]
  double force = 0.0;  ///< along the push [N]
  /// How far it may be from the force of equilibrium at the depth that was asked for [N]; infinite where that
  /// is deeper than `depth`.
  double error = 0.0;
  double error_at_depth = 0.0;  ///< the same at `depth`
  Wrench on_tool = Wrench::Zero();
  LiveFrame::Tool tool = LiveFrame::Tool::there;
};

/// The force on a tool between two frames, for a loop that asks far more often than equilibria are found:
/// from the last frame's force and stiffness, without a jump where a new frame corrects them.
///
/// Each frame tells the force at other depths. Deeper: by the line with its stiffness, as far as a fifth of
/// the tool's radius; of a tool that touches no farther than the frame is deep, as its first contact has no
/// stiffness. Less deep: by the parabola through its force with that slope and through no force at no depth.
/// An answer is the mean of what the frames tell of the depth that is asked for, by shares that add to one: a
/// new frame begins with none, and those before it lose theirs by 1/e in `fade`, whether something is asked
/// or not. So no answer lies outside of what the frames tell.
struct BetweenFrames {
  double radius = 5e-3;  ///< of the tool [m]
  double fade = 0.06;    ///< [s]
  bool touches = false;  ///< no circle: its contact grows with the depth, from none
  struct Known {
    double depth, force, stiffness, error;  ///< [m], [N], [N/m], [N] at this depth
    Wrench per_force;
    LiveFrame::Tool tool;
    double share;
  };
  std::vector<Known> frame = {};  ///< of one place, the newest last
  double now = 0.0;               ///< that the shares are of [s]
};

/// A new frame is there at the time `now` [s], which never goes back.
void correct(BetweenFrames& between, const LiveFrame& frame, double now);
/// At a depth [m] and a time [s]. None in the air.
///
/// Its error is the sum of the frame's own; of that of its stiffness k, the slope of a secant; of what the
/// curve may be off: for a line of the length x, k x^2 / radius, or four times the bend of the parabola,
/// which at most doubles k; for a parabola, its distance from the chord and from the tangent, between which a
/// force that is convex or concave over the depth lies; and of how far the older frames hold the answer off
/// the newest.
LiveAnswer answer(BetweenFrames& between, double depth, double now);
/// The tool has come down elsewhere: nothing is known.
void forget(BetweenFrames& between);

}  // namespace dimple
