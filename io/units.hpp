#pragma once

#include <cmath>

namespace dimple {

/// Lengths, areas and volumes on the grid that survives a file in mm: a picometre, and a billionth of a mm^2
/// and mm^3. Rounded values are the same, bit for bit, after they are written in mm and read again.
inline double metres(double mm) {
  return std::round(mm * 1e9) / 1e12;
}
inline double millimetres(double m) {
  return std::round(m * 1e12) / 1e9;
}
inline double square_metres(double mm2) {
  return std::round(mm2 * 1e9) / 1e15;
}
inline double square_millimetres(double m2) {
  return std::round(m2 * 1e15) / 1e9;
}
inline double cubic_metres(double mm3) {
  return std::round(mm3 * 1e9) / 1e18;
}
inline double cubic_millimetres(double m3) {
  return std::round(m3 * 1e18) / 1e9;
}

}  // namespace dimple
