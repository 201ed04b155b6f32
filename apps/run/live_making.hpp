#pragma once

#include "apps/run/live.hpp"

namespace dimple {

/// What is made beside the frames of a live tool. One function per transition:
///
///     nothing -> refining           make_finer()
///     refining -> nothing           take_finer(), or give_up_finer(): the tool leaves the place
///     refining -> refining          take_finer(), where the body was cut meanwhile
///     nothing, refining -> cutting  next_cut()
///     cutting -> nothing, refining  take_cut()
enum class Making {
  nothing,
  refining,  ///< a finer cloud of nodes for the place where the tool came down
  cutting    ///< the body after a stroke; a finer cloud that is made as well waits for it
};
Making in_the_making(const LiveTool& tool);

/// The tool is on this cloud from here on.
void use(LiveTool& tool, TriedTouch tried);

void make_finer(LiveTool& tool, const Site& site);
/// Waits for an earlier one where too many that were given up are still being made.
void give_up_finer(LiveTool& tool);
/// The finer cloud takes the coarse one's place, where the tool is, as soon as it is ready. One that cannot
/// be followed is dropped.
void take_finer(LiveTool& tool, const FrameLimit& limit, double dt);

/// Begins with the first of the strokes that wait, if none is in the making.
void next_cut(LiveTool& tool);
/// Waits for the stroke that is in the making; the tool goes on with the cut body, and the record says what
/// came of it.
void take_cut(LiveTool& tool);
/// All strokes that wait, one after the other.
void finish_cuts(LiveTool& tool);

/// What sessions on an organ are made with beside the body.
SessionGiven given_of(const LiveOrgan& live);

}  // namespace dimple
