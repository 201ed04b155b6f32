#pragma once

#include <fmt/format.h>

#include <cmath>
#include <string>

#include "io/types.hpp"

namespace dimple {

/// "(1.0, -2.5, 30.0) mm", never with a minus before a zero.
inline std::string in_words(const Vec3& place_mm) {
  const auto tenths = [](double x) { return std::round(10.0 * x) / 10.0 + 0.0; };
  return fmt::format("({:.1f}, {:.1f}, {:.1f}) mm", tenths(place_mm.x()), tenths(place_mm.y()),
                     tenths(place_mm.z()));
}

}  // namespace dimple
