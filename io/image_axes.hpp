#pragma once

#include <array>
#include <string>

#include "io/types.hpp"

namespace dimple {

/// Canonical axis c is stored axis `stored[c]`, in the opposite direction if `flipped[c]`.
struct StoredAxes {
  std::array<int, 3> stored{0, 1, 2};
  std::array<bool, 3> flipped{};
};

/// The signed permutation with det > 0 that brings the axes nearest to +L, +P, +S: the greatest sum of
/// cosines. Between two equally near ones (a turn by 45 degrees) the resulting matrix decides. So the choice
/// does not depend on the order of trials or on how the image was stored.
StoredAxes nearest_to_LPS(const Mat3& linear);

/// Letters of the sides toward which the stored axes increase.
std::string letters(const StoredAxes& order);

/// A geometry whose lengths and angles are free of the last digits in which headers of one image differ.
/// `linear` has its axes in canonical order; their orientation changes by at most 2e-5.
Mat3 snapped(const Mat3& linear);

double with_twelve_digits(double x);

}  // namespace dimple
