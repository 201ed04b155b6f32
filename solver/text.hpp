#pragma once

#include <sstream>
#include <string>

namespace dimple {

/// The parts one after the other, numbers with four digits. std::format is not in this compiler's library,
/// and the solver needs nothing else from a formatting library.
template <class... Parts>
std::string text(const Parts&... parts) {
  std::ostringstream out;
  out.precision(4);
  (out << ... << parts);
  return out.str();
}

}  // namespace dimple
