#pragma once

#include <vector>

#include "solver/session.hpp"

namespace dimple {

/// Force on a tool between two frames, with depth, error and status.
struct LiveAnswer {
  double depth = 0.0;  ///< of the force: as requested, or the deepest known [m]
  double force = 0.0;  ///< along the press direction [N]
  /// Error estimate of `force` for the requested depth [N]; infinite if that is deeper than `depth`.
  double error = 0.0;
  double error_at_depth = 0.0;  ///< the same at `depth`
  Wrench on_tool = Wrench::Zero();
  LiveFrame::Tool tool = LiveFrame::Tool::there;
};

/// Force on a tool between two frames, for a loop much faster than the search for equilibria: from the last
/// frame's force and stiffness, without a jump at a new frame.
///
/// Each frame gives the force at other depths. Deeper: the line with its stiffness, up to a fifth of the
/// tool's radius; under a contacting tool no farther than the frame is deep, as first contact has no
/// stiffness. Less deep: the parabola through its force with that slope and through no force at depth 0. The
/// answer is the mean over the frames by weights that add to one: a new frame begins with none, and older
/// ones lose theirs by 1/e in `fade`, with or without requests. So no answer is outside the range of the
/// frames.
struct BetweenFrames {
  double radius = 5e-3;      ///< of the tool [m]
  double fade = 0.06;        ///< [s]
  bool has_contact = false;  ///< contacting tool: its contact grows with the depth, from none
  struct Known {
    double depth, force, stiffness, error;  ///< [m], [N], [N/m], [N] at this depth
    Wrench per_force;
    LiveFrame::Tool tool;
    double fraction;
  };
  std::vector<Known> frame = {};  ///< of one place, the newest last
  double now = 0.0;               ///< time of the weights [s]
};

/// Adds a new frame at the time `now` [s], which never decreases.
void correct(BetweenFrames& between, const LiveFrame& frame, double now);
/// Force at a depth [m] and a time [s]; none above the surface.
///
/// Its error is the sum of the frame's own; of that of its stiffness k, the slope of a secant; of that of the
/// curve: for a line of length x, k x^2 / radius, or four times the bend of the parabola, which at most
/// doubles k; for a parabola, its distance from the chord and from the tangent, which bound any convex or
/// concave curve; and of the deviation of the older frames from the newest.
LiveAnswer answer(BetweenFrames& between, double depth, double now);
/// Discards all frames: the tool comes down elsewhere.
void forget(BetweenFrames& between);

}  // namespace dimple
