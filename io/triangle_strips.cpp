#include "io/triangle_strips.hpp"

#include <array>
#include <vector>

namespace dimple {
namespace {

using Corners = std::array<int, 3>;

// The k-th triangle of a strip that begins with these corners, and the one after it ends in d.
Corners next_of(const Corners& now, bool odd, int d) {
  return odd ? Corners{now[0], now[2], d} : Corners{now[2], now[1], d};
}

// Finds the triangle with an edge in a given direction: sorted by where edges begin.
class Edges {
 public:
  explicit Edges(const Triangles& triangles)
      : triangles_(triangles),
        offset_(static_cast<std::size_t>(triangles.size() > 0 ? triangles.maxCoeff() + 2 : 1), 0),
        triangle_(static_cast<std::size_t>(triangles.size())) {
    for (const Index v : triangles.reshaped()) ++offset_[static_cast<std::size_t>(v) + 1];
    for (std::size_t v = 1; v < offset_.size(); ++v) offset_[v] += offset_[v - 1];
    std::vector<std::size_t> at(offset_.begin(), offset_.end() - 1);
    for (Index t = 0; t < triangles.cols(); ++t)
      for (const Index v : triangles.col(t)) triangle_[at[static_cast<std::size_t>(v)]++] = t;
  }
  // The first unused triangle with the edge, and its third corner; -1: there is none.
  template <class Unused>
  Index along(int from, int to, const Unused& unused, int& third) const {
    const auto v = static_cast<std::size_t>(from);
    for (std::size_t k = offset_[v]; k < offset_[v + 1]; ++k) {
      const Index t = triangle_[k];
      if (!unused(t)) continue;
      for (int c = 0; c < 3; ++c)
        if (triangles_(c, t) == from && triangles_((c + 1) % 3, t) == to) {
          third = static_cast<int>(triangles_((c + 2) % 3, t));
          return t;
        }
    }
    return -1;
  }

 private:
  const Triangles& triangles_;
  std::vector<std::size_t> offset_;
  std::vector<Index> triangle_;
};

}  // namespace

Triangles in_strips(const Triangles& triangles) {
  const Edges edges(triangles);
  std::vector<Index> walked(static_cast<std::size_t>(triangles.cols()), -1);  // by which walk
  const Index in_a_strip = 3 * triangles.cols();
  struct Step {
    Index triangle;
    Corners corner;
  };
  std::vector<Step> best, walk;
  Triangles result(3, triangles.cols());
  Index count = 0;
  for (Index t = 0; t < triangles.cols(); ++t) {
    if (walked[static_cast<std::size_t>(t)] == in_a_strip) continue;
    best.clear();
    for (int c = 0; c < 3; ++c) {
      const Index mark = 3 * t + c;
      walk.clear();
      Step now{t,
               {static_cast<int>(triangles(c, t)), static_cast<int>(triangles((c + 1) % 3, t)),
                static_cast<int>(triangles((c + 2) % 3, t))}};
      for (bool odd = false; now.triangle >= 0; odd = !odd) {
        walk.push_back(now);
        walked[static_cast<std::size_t>(now.triangle)] = mark;
        const Corners& at = now.corner;
        int d = 0;
        const Index next = edges.along(
            odd ? at[0] : at[2], odd ? at[2] : at[1],
            [&](Index other) {
              const Index by = walked[static_cast<std::size_t>(other)];
              return by != mark && by != in_a_strip;
            },
            d);
        now = {next, next_of(at, odd, d)};
      }
      if (walk.size() > best.size()) best.swap(walk);
    }
    for (const Step& step : best) {
      walked[static_cast<std::size_t>(step.triangle)] = in_a_strip;
      result.col(count++) << step.corner[0], step.corner[1], step.corner[2];
    }
  }
  return result;
}

}  // namespace dimple
