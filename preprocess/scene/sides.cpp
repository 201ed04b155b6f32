#include "preprocess/scene/sides.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>

#include "io/error.hpp"

namespace dimple {
namespace {

struct Side {
  const char* word;
  Vec3 lps;
};
const std::array<Side, 6> sides = {{{"inferior", {0, 0, -1}},
                                    {"posterior", {0, 1, 0}},
                                    {"anterior", {0, -1, 0}},
                                    {"left", {1, 0, 0}},
                                    {"right", {-1, 0, 0}},
                                    {"superior", {0, 0, 1}}}};

}  // namespace

std::optional<Vec3> side_named(const std::string& word, const std::string& where) {
  static const std::map<std::string, std::string> same_side = {
      {"front", "anterior"}, {"back", "posterior"}, {"I", "inferior"}, {"S", "superior"},
      {"A", "anterior"},     {"P", "posterior"},    {"L", "left"},     {"R", "right"}};
  for (const char* of_room : {"up", "down", "top", "bottom", "above", "below", "under"})
    if (word == of_room)
      throw UsageError({.fact = fmt::format("'{}' is no side of the patient", word),
                        .where = where,
                        .why = "it depends on the patient's position: anterior is up in a supine patient, "
                               "superior in a standing one",
                        .remedy = "give superior, inferior, anterior, posterior, left or right"});
  const auto other = same_side.find(word);
  const std::string& name = other == same_side.end() ? word : other->second;
  for (const Side& side : sides)
    if (side.word == name) return side.lps;
  return std::nullopt;
}

std::string side_towards(const Vec3& lps) {
  const auto best = std::max_element(sides.begin(), sides.end(), [&](const Side& a, const Side& b) {
    return a.lps.dot(lps) < b.lps.dot(lps) - 1e-9;
  });
  return best->word;
}

}  // namespace dimple
