#pragma once

#include <array>
#include <string>

#include "io/types.hpp"

namespace dimple {

/// Canonical axis c is stored axis `stored[c]`, running the other way if `flipped[c]`.
struct AxisOrder {
  std::array<int, 3> stored{0, 1, 2};
  std::array<bool, 3> flipped{};
};

/// The signed permutation with det > 0 that brings the axes nearest to +L, +P, +S: the greatest sum of
/// cosines. Where two are equally near (a turn by 45 degrees) the resulting matrix decides, not the order in
/// which they are tried, so that the choice does not depend on how the image was stored.
AxisOrder nearest_to_LPS(const Mat3& linear);

/// Letters that say toward which side each stored axis increases.
std::string letters(const AxisOrder& order);

/// A geometry whose lengths and angles are free of the last digits in which headers of one image differ.
/// `linear` has its axes in canonical order; how they lie in space stays, but for a turn of 2e-5.
Mat3 snapped(const Mat3& linear);

double with_twelve_digits(double x);

}  // namespace dimple
