#pragma once

// tbb::parallel_invoke for the thread sanitizer, by plain threads; why: parallel_for.h.

#include <tbb/global_control.h>

#include <exception>
#include <thread>

namespace tbb {

inline thread_local int invoked = 0;  // calls within calls

template <class First, class Second, class... More>
void parallel_invoke(const First& first, const Second& second, const More&... more) {
  constexpr int deepest = 4;  // below, by the thread that meets it: a recursion would start hundreds
  if (invoked == deepest || global_control::active_value(global_control::max_allowed_parallelism) < 2) {
    first();
    second();
    (more(), ...);
    return;
  }
  const int depth = ++invoked;
  std::exception_ptr of_other, mine;
  std::thread other([&] {
    invoked = depth;
    try {
      first();
    } catch (...) {
      of_other = std::current_exception();
    }
  });
  try {
    if constexpr (sizeof...(more) > 0)
      parallel_invoke(second, more...);
    else
      second();
  } catch (...) {
    mine = std::current_exception();
  }
  other.join();
  invoked = depth - 1;
  if (of_other) std::rethrow_exception(of_other);
  if (mine) std::rethrow_exception(mine);
}

}  // namespace tbb
