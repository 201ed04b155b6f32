#pragma once

#include <string>

#include "io/digits.hpp"
#include "io/types.hpp"

namespace dimple {

/// Text of a place: "(1.0, -2.5, 30.0) mm".
inline std::string in_words(const Vec3& place_mm) {
  std::string words = "(";
  words += fixed(place_mm.x(), 1) + ", " + fixed(place_mm.y(), 1) + ", " + fixed(place_mm.z(), 1);
  return words += ") mm";
}

}  // namespace dimple
