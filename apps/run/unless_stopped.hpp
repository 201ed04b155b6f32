#pragma once

#include "io/stop.hpp"

namespace dimple {

/// Does `work`. What breaks while everything is being stopped is a consequence of that: Stopped is thrown in
/// its place.
template <class Work>
auto unless_stopped(const Work& work) {
  try {
    return work();
  } catch (...) {
    stop_if_asked();
    throw;
  }
}

}  // namespace dimple
