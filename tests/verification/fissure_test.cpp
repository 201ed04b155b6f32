// Folds of an organ that close: penetration of their opposing walls, measured on the displaced surface
// itself, independently of the contact that limits it.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include "apps/run/simulate.hpp"
#include "preprocess/image/phantom.hpp"
#include "preprocess/supports/support.hpp"
#include "tests/helpers/scene_with.hpp"

namespace dimple {
namespace {

// Penetration of the walls of the phantom's fissure, which are left and right of x = 0 at rest.
struct Reach {
  double deepest = 0.0;  // [mm] of a vertex of one wall beyond the other along x
  int facing = 0;        // vertices that have the other wall opposite
};

// Computes x of the triangle at (y, z); false if it does not cover that point.
bool crosses(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& p, double& x) {
  const Vec3 n = (b - a).cross(c - a);
  if (std::abs(n.x()) < 1e-9) return false;
  const auto side = [&](const Vec3& from, const Vec3& to) {
    return ((to.y() - from.y()) * (p.z() - from.z()) - (to.z() - from.z()) * (p.y() - from.y())) * n.x();
  };
  if (side(a, b) < 0.0 || side(b, c) < 0.0 || side(c, a) < 0.0) return false;
  x = a.x() - (n.y() * (p.y() - a.y()) + n.z() * (p.z() - a.z())) / n.x();
  return true;
}

Reach reach_of(const Surface& surface, const Points& displaced_mm) {
  const auto in_fissure = [&](Index v) {
    return std::abs(surface.vertex_mm(0, v)) < 4.0 && surface.vertex_mm(2, v) > 17.0;
  };
  Reach reach;
  std::vector<Index> right;  // triangles of the wall at x < 0, which face towards x > 0
  for (Index t = 0; t < surface.triangles.cols(); ++t) {
    const auto corner = surface.triangles.col(t);
    if (!in_fissure(corner[0]) || !in_fissure(corner[1]) || !in_fissure(corner[2])) continue;
    const Vec3 a = surface.vertex_mm.col(corner[0]), b = surface.vertex_mm.col(corner[1]),
               c = surface.vertex_mm.col(corner[2]);
    if ((a + b + c).x() < 0.0 && (b - a).cross(c - a).normalized().x() > 0.5) right.push_back(t);
  }
  for (Index v = 0; v < displaced_mm.cols(); ++v) {
    if (!in_fissure(v) || surface.vertex_mm(0, v) <= 0.3) continue;
    const Vec3 p = displaced_mm.col(v);
    double farthest = -1e9, x = 0.0;
    for (const Index t : right) {
      const auto corner = surface.triangles.col(t);
      if (crosses(displaced_mm.col(corner[0]), displaced_mm.col(corner[1]), displaced_mm.col(corner[2]), p,
                  x))
        farthest = std::max(farthest, x);
    }
    if (farthest < -1e8) continue;
    ++reach.facing;
    reach.deepest = std::max(reach.deepest, farthest - p.x());
  }
  return reach;
}

// Two spheres of 10 mm press the crests of both hemispheres together and down, each by 8 mm.
Case pinch(const LabelImage& image, const char* self_contact, Index nodes) {
  return {.scene = scene_with({{"cloud.nodes", std::to_string(nodes)},
                               {"boundary.base", "inferior"},
                               {"boundary.indent_at", "15,0,23"},
                               {"boundary.direction", "-1,0,-0.5"},
                               {"tool.shape", "sphere:10mm"},
                               {"tool.other.shape", "sphere:10mm"},
                               {"tool.other.at_mm", "-15,0,23"},
                               {"tool.other.direction", "1,0,-0.5"},
                               {"tool.other.move_mm", "8"},
                               {"load.depth_mm", "8"},
                               {"load.self_contact", self_contact}}),
          .image = &image};
}

struct Pinched {
  Result result;
  Reach reach;
  double spacing_mm = 0.0;  // of nodes at the fissure, the smallest
  std::vector<MarchState> kept;
};

Pinched pinched(const Case& given) {
  Pinched found;
  Points u;
  Interpolation of_surface;
  RunObserver observer;
  observer.begin = [&](Result& result) { of_surface = surface_interpolation(result.model); };
  observer.march.frame = [&](const Frame& frame) { u = frame.u.topRows<3>(); };
  observer.march.between_steps = [&](const std::function<MarchState()>& state) {
    found.kept.push_back(state());
  };
  simulate(given, observer, found.result);
  const Model& model = found.result.model;
  double finest = 1e9;
  for (Index a = 0; a < model.node_count(); ++a)
    if (std::abs(model.X(0, a)) < 4e-3 && model.X(2, a) > 17e-3) finest = std::min(finest, model.spacing[a]);
  found.spacing_mm = 1e3 * finest;
  found.reach = reach_of(model.surface, model.surface.vertex_mm + 1e3 * of_surface(u));
  return found;
}

TEST(AFissureThatIsPressedShut, HasFacesThatPenetrateEachOtherByLessThanAHundredthOfTheSpacing) {
  const LabelImage image = make_phantom({});
  std::vector<Index> sizes = {1500};
  if (std::getenv("DIMPLE_ALL_SCENES")) sizes.insert(sizes.end(), {2500, 3000, 4000, 5000, 6000});
  for (const Index nodes : sizes) {
    const Pinched passing = pinched(pinch(image, "off", nodes)),
                  in_contact = pinched(pinch(image, "on", nodes));
    const FoldContact::Audit& folds = in_contact.result.history.folds;
    std::printf(
        "%td nodes %.2f mm apart: banks that pass reach %.3f mm into each other, banks that touch %.4f mm, "
        "and %.5f mm where contact is looked for\n",
        nodes, in_contact.spacing_mm, passing.reach.deepest, in_contact.reach.deepest,
        1e3 * folds.penetration);
    EXPECT_GT(in_contact.reach.facing, 500);
    EXPECT_GT(passing.reach.deepest, 0.05 * in_contact.spacing_mm) << "else nothing is shut";
    EXPECT_LT(in_contact.reach.deepest, 0.01 * in_contact.spacing_mm);
    EXPECT_LT(1e3 * folds.penetration, 0.001 * in_contact.spacing_mm);
    EXPECT_GT(folds.in_contact, 1);
    EXPECT_GT(in_contact.result.history.force.back().force, passing.result.history.force.back().force);
  }
}

TEST(AFissureThatIsPressedShut, ContinuesFromAStateThatWasKeptToTheSameBits) {
  const LabelImage image = make_phantom({});
  Case given = pinch(image, "on", 1500);  // with 800 the fissure stays open
  const Pinched whole = pinched(given);
  ASSERT_GT(whole.kept.size(), 2u);
  given.from = &whole.kept[whole.kept.size() - 2];
  const Result again = simulate(given);
  EXPECT_EQ(again.history.force.back().force, whole.result.history.force.back().force);
  EXPECT_EQ(again.history.folds.force, whole.result.history.folds.force);
  EXPECT_GT(whole.result.history.folds.force, 0.0);
}

}  // namespace
}  // namespace dimple
