#pragma once

#include <atomic>

#include "io/error.hpp"

namespace dimple {

/// Reason for which the current work must end.
enum class StopReason : int { none = 0, interrupted, out_of_time };

/// The current work must end. Code with a partial result catches it, stores the result, and rethrows.
struct Stopped : Error {
  explicit Stopped(StopReason why);
  StopReason reason;
};

namespace stop_detail {
inline std::atomic<StopReason> requested{StopReason::none};
static_assert(std::atomic<StopReason>::is_always_lock_free, "signal handlers set it");
}  // namespace stop_detail

/// Requests that all work of this process end; the first reason counts. Safe in a signal handler and from any
/// thread.
inline void ask_to_stop(StopReason why) noexcept {
  StopReason none = StopReason::none;
  stop_detail::requested.compare_exchange_strong(none, why);
}
inline StopReason stop_requested() noexcept {
  return stop_detail::requested.load(std::memory_order_relaxed);
}
/// Allows work to begin again, for programs that continue after a stop.
inline void forget_stop() noexcept {
  stop_detail::requested.store(StopReason::none);
}

/// Throws Stopped if the work must end. It costs one load: every long loop calls it at least ten times a
/// second, also inside oneTBB's loops, which pass the exception on.
inline void stop_if_requested() {
  if (const StopReason why = stop_requested(); why != StopReason::none) throw Stopped(why);
}

inline Stopped::Stopped(StopReason why)
    : Error(ExitCode::interrupted,
            why == StopReason::out_of_time
                ? Report{.fact = "the time limit has passed",
                         .where = "--time-limit",
                         .why = "the work was not finished by then",
                         .remedy = "give more time, fewer --nodes or fewer --frames",
                         .code = "out-of-time"}
                : Report{.fact = "interrupted",
                         .where = "",
                         .why = "it was requested by Ctrl-C or a signal",
                         .remedy = "start the command again; `dimple run --resume` continues a run"}),
      reason(why) {}

}  // namespace dimple
