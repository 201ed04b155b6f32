#pragma once

#include "apps/run/live.hpp"

namespace dimple {

/// Work in the background of the frames of a live tool. One function per transition:
///
///     nothing -> refining           make_finer()
///     refining -> nothing           take_finer(), or give_up_finer(): the tool leaves the place
///     refining -> refining          take_finer(), where the body was cut meanwhile
///     nothing, refining -> cutting  next_cut()
///     cutting -> nothing, refining  take_cut()
enum class Making {
  nothing,
  refining,  ///< finer nodes for the present contact
  cutting    ///< the body after a stroke; finer nodes made at the same time wait for it
};
Making in_the_making(const LiveTool& tool);

/// Moves the tool to this discretisation.
void use(LiveTool& tool, TriedContact tried);

void make_finer(LiveTool& tool, const Site& site);
/// Waits for an earlier one if too many cancelled ones are still in the making.
void give_up_finer(LiveTool& tool);
/// Replaces the coarse nodes by the finer ones, at the tool's pose, once they are ready. They are dropped if
/// they cannot be followed.
void take_finer(LiveTool& tool, const FrameLimit& limit, double dt);

/// Begins the first of the waiting strokes, if none is in the making.
void next_cut(LiveTool& tool);
/// Waits for the stroke in the making; the tool then continues on the cut body, and the record has the
/// result.
void take_cut(LiveTool& tool);
/// Makes all waiting strokes, one after the other.
void finish_cuts(LiveTool& tool);

/// Parts of the sessions on an organ other than the body.
SessionGiven given_of(const LiveOrgan& live);

}  // namespace dimple
