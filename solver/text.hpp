#pragma once

#include <concepts>
#include <sstream>
#include <string>

#include "io/digits.hpp"

namespace dimple {

/// The parts one after the other, numbers with four digits at most and without an exponent. std::format is
/// not in this compiler's library, and the solver needs nothing else from a formatting library.
template <class... Parts>
std::string text(const Parts&... parts) {
  std::ostringstream out;
  const auto put = [&](const auto& part) {
    if constexpr (std::floating_point<std::decay_t<decltype(part)>>)
      out << plain(part, 4);
    else
      out << part;
  };
  (put(parts), ...);
  return out.str();
}

}  // namespace dimple
