#pragma once

#include "io/stop.hpp"

namespace dimple {

/// Does `work`. An error during a stop is a consequence of the stop, and is replaced by Stopped.
template <class Work>
auto unless_stopped(const Work& work) {
  try {
    return work();
  } catch (...) {
    stop_if_requested();
    throw;
  }
}

}  // namespace dimple
