#include "preprocess/nodes/graded_parts.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <utility>

#include "io/stop.hpp"

namespace dimple {
namespace {

// Subdivides a triangle until the spacing is nearly constant on each part.
// `of`: the surface's triangle; `whole`: t is all of it.
void subdivide(const SmallTriangle& t, int of, bool whole, const Sizing& sizing, double far_spacing,
               std::size_t room, GradedFacets& result) {
  if (result.facet.size() > room) return;
  const double longest = std::max({(t.b - t.a).norm(), (t.c - t.b).norm(), (t.a - t.c).norm()});
  const Vec3 middle = (t.a + t.b + t.c) / 3.0;
  // No corner is farther from the middle than two thirds of a median, which is shorter than the longest edge.
  const auto [here, least, distance, finer] = sizing.around(middle, 0.67 * longest);
  // The spacing at a corner may be much less than in the middle.
  const auto small_enough = [&](double s) { return longest <= 0.7 * far_spacing * s; };
  if (sizing.even() || (small_enough(here) &&
                        (small_enough(least) || (small_enough(sizing(t.a)) && small_enough(sizing(t.b)) &&
                                                 small_enough(sizing(t.c)))))) {
    result.facet.push_back(
        {of, whole ? -1 : static_cast<int>(result.part.size()), t.area, here, distance, finer});
    if (!whole) result.part.push_back(t);
    return;
  }
  // A sliver, as fans of triangles have them, is cut across: its quarters would be as slim, and many.
  if (longest * longest > 8.0 * t.area) {
    SmallTriangle turned = t;
    while ((turned.b - turned.a).norm() < longest) turned = {turned.b, turned.c, turned.a, t.normal, t.area};
    const Vec3 across = 0.5 * (turned.a + turned.b);
    for (const SmallTriangle& part : {SmallTriangle{turned.a, across, turned.c, t.normal, 0.5 * t.area},
                                      SmallTriangle{across, turned.b, turned.c, t.normal, 0.5 * t.area}})
      subdivide(part, of, false, sizing, far_spacing, room, result);
    return;
  }
  const Vec3 ab = 0.5 * (t.a + t.b), bc = 0.5 * (t.b + t.c), ca = 0.5 * (t.c + t.a);
  const double quarter = 0.25 * t.area;
  for (const SmallTriangle& part :
       {SmallTriangle{t.a, ab, ca, t.normal, quarter}, SmallTriangle{ab, t.b, bc, t.normal, quarter},
        SmallTriangle{ca, bc, t.c, t.normal, quarter}, SmallTriangle{ab, bc, ca, t.normal, quarter}})
    subdivide(part, of, false, sizing, far_spacing, room, result);
}

SmallTriangle whole_triangle(const BodySurface& body, Index t) {
  const auto corner = [&](int k) { return body.vertex().col(body.triangles()(k, t)); };
  return {corner(0), corner(1), corner(2), body.normal().col(t), body.triangle_area()[t]};
}

}  // namespace

SmallTriangle triangle_of(const BodySurface& body, const GradedFacets& facets, std::size_t k) {
  const GradedFacets::Facet& facet = facets.facet[k];
  return facet.part < 0 ? whole_triangle(body, facet.triangle)
                        : facets.part[static_cast<std::size_t>(facet.part)];
}

std::optional<GradedFacets> facets_of(const BodySurface& body, const Sizing& sizing, double far_spacing,
                                      std::size_t most) {
  constexpr Index block = 256;
  const Index count = body.triangles().cols();
  const std::size_t room = most + static_cast<std::size_t>(count);
  std::atomic<std::size_t> all = 0;
  std::vector<GradedFacets> parts(static_cast<std::size_t>((count + block - 1) / block));
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t part) {
    stop_if_requested();
    if (all > room) return;
    const Index first = block * static_cast<Index>(part);
    for (Index t = first; t < std::min(first + block, count); ++t)
      subdivide(whole_triangle(body, t), static_cast<int>(t), true, sizing, far_spacing, room, parts[part]);
    all += parts[part].facet.size();
  });
  if (all > room) return std::nullopt;
  GradedFacets result;
  result.facet.reserve(all);
  for (const GradedFacets& part : parts) {
    const auto before = static_cast<int>(result.part.size());
    for (GradedFacets::Facet facet : part.facet) {
      if (facet.part >= 0) facet.part += before;
      result.facet.push_back(facet);
    }
    result.part.insert(result.part.end(), part.part.begin(), part.part.end());
  }
  return result;
}

std::optional<GradedBoxes> boxes_of(const BodySurface& body, const Sizing& sizing, double far_spacing,
                                    std::size_t most) {
  auto leaves = bisect(
      body, 0.63 * far_spacing, sizing, [&](double s) { return 0.25 * std::pow(far_spacing * s, 3); }, most);
  if (!leaves) return std::nullopt;
  GradedBoxes boxes;
  boxes.leaf = std::move(*leaves);
  boxes.size.resize(boxes.leaf.size());
  tbb::parallel_for(std::size_t{0}, boxes.leaf.size(), [&](std::size_t k) {
    stop_if_requested();
    const Leaf& box = boxes.leaf[k];
    double inside = 1.0;
    if (box.cut) {
      const double r = std::cbrt(box.half.prod());
      const double d = body.farther(box.centre, 1.000001 * r) ? 2.0 * r : body.closest(box.centre).distance;
      inside = std::clamp(0.5 + (body.contains(box.centre) ? 0.5 : -0.5) * d / r, 0.0, 1.0);
    }
    boxes.size[k] = inside * box.volume();
  });
  return boxes;
}

}  // namespace dimple
