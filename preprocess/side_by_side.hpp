#pragma once

#include <tbb/parallel_invoke.h>

#include <exception>

namespace dimple {

/// Does both at once, and throws what the first of them threw, or else the second.
///
/// Unlike tbb::parallel_invoke it never cancels one because the other has failed: inside a cancelled task the
/// loops of oneTBB return without a word and with their work undone, and what is computed from that may not
/// end.
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
