#pragma once

#include "solver/live/live_constants.hpp"

namespace dimple {

/// Progress of an advanced tool towards its requested depth. One function per transition:
///
///     advances -> stopped   stop(); stall() too often
///     stopped -> advances   advance(), which an arrival is too
struct Progress {
  enum class State { advances, stopped };
  State state = State::advances;
  std::int64_t evaluations = 0;  ///< of the force, since the tool came nearer
  std::int64_t frames = 0;       ///< likewise

  /// Records a frame that brought the tool nearer, or to its depth.
  void advance() { *this = {}; }
  /// Records a frame without progress, and its force evaluations.
  void stall(std::int64_t its_evaluations) {
    evaluations += its_evaluations;
    frames += 1;
    if (evaluations >= live_constants.fruitless_evaluations || frames >= live_constants.fruitless_frames)
      stop();
  }
  /// No equilibrium is found any deeper, however short the move.
  void stop() { state = State::stopped; }
};

}  // namespace dimple
