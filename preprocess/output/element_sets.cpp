#include "preprocess/output/element_sets.hpp"

#include <fmt/format.h>

#include "io/error.hpp"

namespace dimple {

void require_apart(const std::set<Index>& base, const std::set<Index>& circle, const MeshWords& words) {
  if (base.empty() || circle.empty())
    throw ModelError({.fact = fmt::format("no {} of the mesh lies {}", words.face,
                                          base.empty() ? "on the base" : "in the circle"),
                      .where = words.mesh,
                      .why = words.why,
                      .remedy = "give a smaller --spacing or more --nodes"});
  for (const Index v : base)
    if (circle.count(v) > 0)
      throw ModelError({.fact = "the tool's circle lies on the fixed base",
                        .where = words.mesh,
                        .why = "a node of the mesh belongs to both",
                        .remedy = "choose another place (--indent-at) or another --base"});
}

}  // namespace dimple
