#pragma once

#include <tbb/parallel_invoke.h>

#include <exception>

namespace dimple {

/// Runs both at the same time, and throws what the first of them threw, or else the second.
///
/// Never cancels one because the other has failed, unlike tbb::parallel_invoke. Inside a cancelled task
/// oneTBB's loops return silently with their work undone, and a computation on that may not end.
template <class First, class Second>
void side_by_side(First&& first, Second&& second) {
  std::exception_ptr first_failed, second_failed;
  const auto kept = [](auto&& work, std::exception_ptr& failed) {
    try {
      work();
    } catch (...) {
      failed = std::current_exception();
    }
  };
  tbb::parallel_invoke([&] { kept(first, first_failed); }, [&] { kept(second, second_failed); });
  if (first_failed) std::rethrow_exception(first_failed);
  if (second_failed) std::rethrow_exception(second_failed);
}

}  // namespace dimple
