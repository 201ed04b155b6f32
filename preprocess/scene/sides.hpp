#pragma once

#include <optional>
#include <string>

#include "io/types.hpp"

namespace dimple {

/// The patient's side of that name, as the LPS unit vector out of the patient: superior, inferior, anterior,
/// posterior, left or right, 3D Slicer's letters S, I, A, P, L and R, or top, bottom, front, back, above,
/// below, under, up and down of a patient whose z points up. Nothing for any other word.
std::optional<Vec3> side_named(const std::string& word);

/// The name of the patient's side that an LPS direction comes nearest to.
std::string side_towards(const Vec3& lps);

/// The six names, in the order in which a tool is most likely to come from them.
constexpr const char* names_of_sides[] = {"superior", "anterior", "posterior", "left", "right", "inferior"};

}  // namespace dimple
