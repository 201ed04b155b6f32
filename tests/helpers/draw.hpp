#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <random>

namespace dimple {

/// Random numbers that are the same on all platforms; distributions of the standard library are not.
struct Draw {
  std::mt19937_64 bits;
  double between(double low, double high) {
    return low + (high - low) * 0x1p-53 * static_cast<double>(bits() >> 11U);
  }
  template <class T, std::size_t n>
  T of(const std::array<T, n>& list) {
    return list[static_cast<std::size_t>(between(0.0, static_cast<double>(n)))];
  }
  /// Normal number of mean 0 and standard deviation 1, by the transform of Box and Muller.
  double gaussian() {
    const double u = between(0.0, 1.0), v = between(0.0, 1.0);
    return std::sqrt(-2.0 * std::log(1.0 - u)) * std::cos(2.0 * std::numbers::pi * v);
  }
};

}  // namespace dimple
