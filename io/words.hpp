#pragma once

#include <fmt/format.h>

#include <algorithm>
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

/// How numbers of one size are written, so that no small one looks like nothing: "0.0754 N", "7.54 mN".
struct Written {
  const char* unit;
  double per_unit;  ///< units in one of SI, or in one mm3
  int decimals;     ///< below 0: three figures

  std::string number(double x) const {
    const double shown = x * per_unit;
    if (decimals < 0) return fmt::format("{:.3g}", shown);
    return fmt::format("{:.{}f}", shown + 0.0, decimals);
  }
  std::string operator()(double x) const { return number(x) + ' ' + unit; }
};

/// Digits after the point that leave three figures of a number.
inline int decimals_of_three(double x) {
  return std::clamp(2 - static_cast<int>(std::floor(std::log10(x))), 0, 3);
}

/// For forces of this size [N], and those beside it: N with four decimals from 0.01 N on, else mN or uN.
inline Written force_written(double N) {
  const double size = std::abs(N);
  if (size >= 0.01 || size == 0.0 || !std::isfinite(size)) return {"N", 1.0, 4};
  if (size >= 1e-4) return {"mN", 1e3, decimals_of_three(1e3 * size)};
  if (size >= 1e-7) return {"uN", 1e6, decimals_of_three(1e6 * size)};
  return {"N", 1.0, -1};
}

/// For volumes of this size [mm3]: cm3 with two decimals from 0.1 cm3 on, else mm3.
inline Written volume_written(double mm3) {
  const double size = std::abs(mm3);
  if (size >= 100.0 || size == 0.0 || !std::isfinite(size)) return {"cm3", 1e-3, 2};
  return {"mm3", 1.0, size >= 0.1 ? decimals_of_three(size) : -1};
}

}  // namespace dimple
