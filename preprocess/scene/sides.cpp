#include "preprocess/scene/sides.hpp"

#include <algorithm>
#include <array>
#include <map>

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

std::optional<Vec3> side_named(const std::string& word) {
  static const std::map<std::string, std::string> same_side = {
      {"bottom", "inferior"}, {"below", "inferior"}, {"under", "inferior"}, {"down", "inferior"},
      {"top", "superior"},    {"above", "superior"}, {"up", "superior"},    {"front", "anterior"},
      {"back", "posterior"},  {"I", "inferior"},     {"S", "superior"},     {"A", "anterior"},
      {"P", "posterior"},     {"L", "left"},         {"R", "right"}};
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
