// An elastic sphere pressed on a rigid plane, against Hertz.

#include "tests/verification/hertz.hpp"

#include <gtest/gtest.h>

#include "preprocess/supports/wall_surface.hpp"
#include "solver/solve.hpp"

namespace dimple {
namespace {

TEST(HertzTruth, TheSeriesOfASphereIsTheHalfSpacesForASmallContactAndStifferThanThatForALargeOne) {
  const auto of_half_space = [](double approach) {
    return 4.0 / 3.0 * hertz::young / (1.0 - hertz::nu * hertz::nu) * std::sqrt(hertz::radius) *
           std::pow(approach, 1.5);
  };
  double before = 1.0;
  for (const double approach : {0.02e-3, 0.1e-3, 0.4e-3}) {
    const double ratio = hertz::force_at(approach) / of_half_space(approach);
    EXPECT_GT(ratio, before);
    EXPECT_LT(ratio, 1.0 + 1.2 * std::sqrt(approach / hertz::radius));
    before = ratio;
  }
}

// The middle plane moves up as a whole and slides in itself; only the plane above the sphere resists.
TEST(Hertz, HasTheForceOfASphereThatIsPressedOnARigidPlane) {
  const auto [nodes, within] = hertz::fineness();
  Discretisation places = hertz::half_sphere(nodes);
  const Index centre = hertz::centre_of(places);
  places.bonded_patch = places.base;
  std::erase(places.bonded_patch, centre);
  places.base.clear();
  places.tool = {.centre = Vec3::Zero(), .approach = Vec3::UnitZ(), .radius = hertz::radius};
  Eigen::VectorXi of_point = Eigen::VectorXi::Zero(places.point_count());
  const Model model = make_model(std::move(places), converging, std::move(of_point), {1000.0});
  const ForceSystem tissue(model, {{neo_hookean(hertz::mu, hertz::nu, 1000.0)}, model.tissue});
  const double top = hertz::radius, depth = 0.3e-3;
  Loading loading{.depth = depth, .contact = Contact::frictionless};
  loading.further = {{.name = "centre", .node = {centre}, .direction = Vec3::UnitZ(), .fraction = 1.0}};
  loading.walls = {
      {.shape = plane_shape(hertz::radius),
       .pose = {Vec3(0.0, 0.0, top), -Vec3::UnitZ()},
       .surface = wall_surface(
           model, [&](const Vec3& x, const Vec3& outward) { return outward.z() > 0.9 && x.z() > 0.9 * top; },
           2000),
       .motion = Vec3::Zero().eval(),
       .name = "plane"}};
  History history;
  solve(TimeMode::quasi_static, tissue, model, loading, {.frames = 3}, {}, history);
  ASSERT_EQ(history.walls.size(), 1u);
  const RigidContact::ContactSummary& wall = history.walls.front();
  const double expected = hertz::force_at(depth);
  std::printf("%td nodes: %+.2f %% of the truth\n", nodes, 100.0 * (wall.force.z() / expected - 1.0));
  EXPECT_NEAR(wall.force.z(), expected, within * expected);
  EXPECT_LT(wall.force.head<2>().norm(), 1e-3 * expected);
  EXPECT_LT(wall.penetration, 0.03 * depth);
}

}  // namespace
}  // namespace dimple
