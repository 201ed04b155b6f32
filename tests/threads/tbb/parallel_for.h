#pragma once

// tbb::parallel_for for the thread sanitizer, by plain threads. The sanitizer cannot see how oneTBB's library
// hands work over (it is not instrumented, and uses fences), so that with it every loop is a false report,
// and a suppression wide enough to hide those hides ours too. Here it sees each start and join, and no race
// is excused.

#include <tbb/blocked_range.h>
#include <tbb/global_control.h>
#include <tbb/partitioner.h>

#include <algorithm>
#include <cstddef>
#include <exception>
#include <thread>
#include <vector>

namespace tbb {

template <class Value, class Body, class... Partitioner>
void parallel_for(const blocked_range<Value>& all, const Body& body, Partitioner&&...) {
  thread_local bool inside = false;  // a loop in a loop: by the thread that meets it
  const auto grain = static_cast<Value>(std::max<std::size_t>(all.grainsize(), 1));
  const Value chunks = (all.end() - all.begin() + grain - 1) / grain;
  const auto threads =
      std::min<std::size_t>(global_control::active_value(global_control::max_allowed_parallelism),
                            static_cast<std::size_t>(chunks));
  if (inside || threads < 2) {
    if (!all.empty()) body(all);
    return;
  }
  std::vector<std::exception_ptr> failure(threads);
  const auto work = [&](std::size_t t) {
    inside = true;
    try {
      // In turn rather than whoever is free: neighbours always meet, and a race shows in every run.
      for (auto c = static_cast<Value>(t); c < chunks; c += static_cast<Value>(threads))
        body(blocked_range<Value>(all.begin() + c * grain,
                                  std::min<Value>(all.begin() + (c + 1) * grain, all.end())));
    } catch (...) {
      failure[t] = std::current_exception();
    }
    inside = false;
  };
  std::vector<std::thread> others;
  for (std::size_t t = 1; t < threads; ++t) others.emplace_back(work, t);
  work(0);
  for (std::thread& other : others) other.join();
  for (const auto& exception : failure)
    if (exception) std::rethrow_exception(exception);
}

template <class Value, class Body>
void parallel_for(Value first, Value last, const Body& body) {
  if (!(first < last)) return;
  const auto grain = std::max<std::size_t>(static_cast<std::size_t>(last - first) / 64, 1);
  parallel_for(blocked_range<Value>(first, last, grain), [&](const blocked_range<Value>& range) {
    for (Value i = range.begin(); i != range.end(); ++i) body(i);
  });
}

}  // namespace tbb
