#pragma once

#include <bit>
#include <cstdint>

namespace dimple {

/// x^(-1/3) within 4 %, from a third of the exponent; Newton steps r (4 - x r^3) / 3 then give every digit.
/// std::cbrt has no form for several numbers at once, and may round differently from one C library to the
/// next.
inline float inverse_cube_root_guess(float x) {
  return std::bit_cast<float>(std::uint32_t{0x54a21d2a} - std::bit_cast<std::uint32_t>(x) / 3);
}
inline double inverse_cube_root_guess(double x) {
  return std::bit_cast<double>(std::uint64_t{0x553ef0ff289dd796} - std::bit_cast<std::uint64_t>(x) / 3);
}

}  // namespace dimple
