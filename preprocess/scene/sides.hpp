#pragma once

#include <optional>
#include <string>

#include "io/types.hpp"

namespace dimple {

/// Side of the patient by name, as the LPS unit vector out of the patient: superior, inferior, anterior,
/// posterior, left or right, 3D Slicer's letters S, I, A, P, L and R, or front and back. Nothing for any
/// other word. Throws UsageError for up, down, top, bottom, above, below and under, whose side depends on the
/// patient's position. `where`: the option that holds the word.
std::optional<Vec3> side_named(const std::string& word, const std::string& where);

/// The name of the patient's side nearest to an LPS direction.
std::string side_towards(const Vec3& lps);

/// The six names, in the order in which a tool is most likely to come from them.
constexpr const char* names_of_sides[] = {"superior", "anterior", "posterior", "left", "right", "inferior"};

}  // namespace dimple
