// A contacting tool that rotates: against the same tool after another motion, and against closed forms of
// linear elasticity.

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "io/error.hpp"
#include "solver/march/steps.hpp"
#include "tests/helpers/marched.hpp"
#include "tests/helpers/report.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

constexpr double mu = 2000.0, degree = std::numbers::pi / 180.0;

const ToolShape capsule = capsule_shape(3e-3, 20e-3), punch = punch_shape(4e-3, 2e-3),
                sphere = sphere_shape(5e-3);

// Block of 40 x 40 x 20 mm, fine in the middle of its top.
struct Block {
  Model model;
  ContactSurface surface;
  Block(Index nodes, double contact_radius_mm, double reach)
      : model(model_with_tool(block_surface({-20, -20, 0}, {20, 20, 20}),
                              {.nodes = nodes, .contact_radius = contact_radius_mm})),
        surface(contact_surface(model, reach)) {}
};

struct Ran {
  History history;
  std::vector<ForceSample> end;  // of each step
  Eigen::Map<const Wrench> wrench(std::size_t step) const {
    return Eigen::Map<const Wrench>(end[step].on_tool.data());
  }
  double work_until(std::size_t step) const { return energy_at(step).external; }
  const EnergySample& energy_at(std::size_t step) const {
    return *std::find_if(history.energy.begin(), history.energy.end(),
                         [&](const EnergySample& e) { return e.t > end[step].t * (1.0 - 1e-9); });
  }
};

struct Requested {
  double friction = 0.0, tolerance = 1e-4, step_radii = 0.1;
  const MarchState* from = nullptr;
  std::vector<MarchState>* kept = nullptr;
};

Ran run(const Block& block, const ToolShape& shape, const ToolPose& pose, const std::vector<Step>& steps,
        const Requested& requested = {}) {
  auto indenter = std::make_shared<RigidBody>();
  indenter->shape = shape;
  indenter->surface = block.surface;
  indenter->pose = pose;
  indenter->friction = requested.friction;
  Loading loading;
  loading.indenter = indenter;
  loading.steps = steps;
  const ForceSystem system(block.model, {{neo_hookean(mu, 0.49, 1000.0)}, block.model.tissue},
                           Precision::double_);
  Ran ran;
  Observer observer;
  if (requested.kept)
    observer.between_steps = [&](const std::function<MarchState()>& state) {
      requested.kept->push_back(state());
    };
  ran.history = marched(system, block.model, loading,
                        {.frames = 1, .step_radii = requested.step_radii, .tolerance = requested.tolerance},
                        observer, requested.from);
  double until = 0.0;
  for (const Step& step : steps) {
    until += step.length() / loading.rate;
    const auto at = std::find_if(ran.history.force.begin(), ran.history.force.end(),
                                 [&](const ForceSample& s) { return s.t > until * (1.0 - 1e-9); });
    EXPECT_NE(at, ran.history.force.end());
    ran.end.push_back(at == ran.history.force.end() ? ForceSample{} : *at);
  }
  return ran;
}

ToolPose has_contact(const Block& block, const ToolShape& shape) {
  return first_contact(shape, block.model.tool, block.surface);
}

Step by(const Vec3& displacement) {
  return {.name = "", .moves = "", .displacement = displacement};
}
Step turn(const Vec3& degrees, double lever, std::optional<Vec3> about = {},
          const Vec3& displacement = Vec3::Zero()) {
  return {.name = "",
          .moves = "",
          .displacement = displacement,
          .turn = degree * degrees,
          .about = about,
          .lever = lever};
}

// Expects agreement within `fraction` of the force, and of its moment at `lever`.
void expect_near(const Wrench& found, const Wrench& known, double fraction, double lever) {
  const double force = known.head<3>().norm();
  EXPECT_LT((found - known).head<3>().norm(), fraction * force);
  EXPECT_LT((found - known).tail<3>().norm(), fraction * force * lever);
}

// Moves the tool, rotated by R from the first, along its own axis to this position of its tip.
Ran tilted_straight_to(const Block& block, const ToolShape& shape, const Mat3& R, const Vec3& tip) {
  const Vec3 approach = R * block.model.tool.approach;
  const ToolPose begins = first_contact(shape, {.centre = tip, .approach = approach}, block.surface);
  return run(block, shape, begins, {by(tip - begins.tip)});
}

// ---------------------------------------------------------------------------------------------------------

TEST(RigidMotion, ItsSpeedIsTheDerivativeOfItsPlaceAndItsTurnContinuesEvenly) {
  RigidMotion moving;
  moving.initial_displacement = Vec3(1e-3, 2e-3, -3e-3);
  moving.turned = rotation(Vec3(0.3, -0.2, 0.5));
  moving.motion = Vec3(0.2, -0.7, 0.1);
  moving.turn = Vec3(80.0, -30.0, 50.0);
  moving.arm = Vec3(4e-3, -1e-3, 9e-3);
  const double s = 2e-3, h = 1e-7;
  const Vec3 speed = (moving.displacement_at(s + h) - moving.displacement_at(s - h)) / (2.0 * h);
  EXPECT_LT((moving.speed_at(s) - speed).norm(), 1e-6 * speed.norm());
  EXPECT_LT((moving.turned_at(2.0 * s) - rotation(s * moving.turn) * moving.turned_at(s)).norm(), 1e-12);
  const Vec3 pivot = moving.initial_displacement + moving.arm,
             after = moving.displacement_at(s) - s * moving.motion;
  EXPECT_NEAR((after - pivot).norm(), moving.arm.norm(), 1e-15)
      << "but for its motion it keeps away from it as far";
  EXPECT_LT((rotation_vector(rotation(Vec3(0.3, -0.2, 0.5))) - Vec3(0.3, -0.2, 0.5)).norm(), 1e-12);
  EXPECT_EQ(rotation_vector(Mat3::Identity()).norm(), 0.0);
}

// A box of 8 x 4 x 12 mm, which no rotation about its axis maps to itself.
ToolShape drawn_box() {
  const BodySurface box = block_surface({-4.0, -2.0, 0.0}, {4.0, 2.0, 12.0});
  return drawn_shape(std::make_shared<const ToolMesh>(tool_mesh(box.vertex(), box.triangles(), "box.stl")));
}

TEST(TurningTool, IsTheSameBodyWhereverItHasTurned) {
  const Vec3 tip(1e-3, -2e-3, 3e-3), pivot(5e-3, 4e-3, 9e-3), motion(0.1, 0.2, -0.3);
  for (const ToolShape& shape : {capsule, punch, drawn_box()}) {
    RigidBody indenter{.shape = shape, .pose = {tip, Vec3(0.2, -0.3, -0.9).normalized()}, .surface = {}};
    RigidContact tool(indenter);
    RigidMotion moving;
    moving.turned = rotation(Vec3(-0.4, 0.1, 0.8));
    moving.motion = motion, moving.turn = Vec3(50.0, 70.0, -90.0), moving.arm = pivot - tip;
    tool.begin_motion(moving, 0.0);
    const double s = 8e-3;
    const Mat3 turn = rotation(s * moving.turn);
    for (int k = 0; k < 40; ++k) {
      const Vec3 x(4e-3 * std::sin(1.3 * k), 4e-3 * std::cos(2.1 * k), 4e-3 * std::sin(0.7 * k));
      const Vec3 before = tip + x,
                 after = pivot + turn * (tip + moving.turned * x - pivot) +
                         s * motion;  // first rotated about its tip
      const ToolDistance was = distance_to_tool(shape, indenter.pose, before),
                         is = distance_to_tool(shape, tool.pose_at(s), after);
      EXPECT_NEAR(is.distance, was.distance, 1e-12);
      EXPECT_LT((is.normal - turn * moving.turned * was.normal).norm(), 1e-6);
    }
  }
}

TEST(TurningTool, ThatComesToASurfaceWithoutSamplesEndsWithThePlaceAndNotWithAForce) {
  const Block block(600, 2.7, 3.5e-3);
  const ToolPose pose = has_contact(block, capsule);
  const Vec3 pivot = pose.tip + Vec3(0, 0, 20e-3);
  // It moves 8 mm sideways, and samples are within 3.5 mm.
  expect_error<SolveError>(
      [&] {
        run(block, capsule, pose, {by({0, 0, -1e-3}), turn({0, 25, 0}, 20e-3, pivot, {0, 0, -1.5e-3})},
            {.step_radii = 0.2});
      },
      {.code = "contact-surface"});
}

class TurningToolOf : public testing::TestWithParam<const ToolShape*> {};
INSTANTIATE_TEST_SUITE_P(Shapes, TurningToolOf, testing::Values(&capsule, &punch),
                         [](const auto& shape) { return shape.param == &punch ? "Punch" : "Capsule"; });

// Elastic tissue without friction is independent of the path.
TEST_P(TurningToolOf, WithoutFrictionDependsOnItsPoseAndNotHowItHasTurnedThere) {
  const ToolShape& shape = *GetParam();
  const Block block(900, 2.7, 8e-3);
  const Vec3 down(0, 0, -1.5e-3), angle(4, 15, 0);
  const ToolPose straight = has_contact(block, shape);
  const Ran turned = run(block, shape, straight, {by(down), turn(angle, 3e-3)});

  const Mat3 R = rotation(degree * angle);
  const Ran came = tilted_straight_to(block, shape, R, straight.tip + down);
  const Wrench there = came.wrench(0);
  EXPECT_GT(there.tail<3>().norm(), 0.1 * there.head<3>().norm() * shape.radius) << "it leans on the tissue";
  expect_near(turned.wrench(1), there, 2e-3, shape.radius);
  EXPECT_NEAR(turned.energy_at(1).stored, came.energy_at(0).stored, 2e-3 * came.energy_at(0).stored);
  EXPECT_LT(std::abs(turned.energy_at(1).error()), 0.01 * turned.energy_at(1).external);
  const Vec3 reported(turned.end[1].turned.data());
  EXPECT_LT((reported - degree * angle).norm(), 1e-12);
  EXPECT_EQ(Vec3(turned.end[0].turned.data()), Vec3::Zero());
}

// The pivot is above and to the side, and the tool moves meanwhile.
TEST(TurningTool, AboutAPlaceAndMovedMeanwhileComesWhereARigidBodyDoes) {
  const Block block(900, 2.7, 8e-3);
  const Vec3 down(0, 0, -1.5e-3), angle(0, -12, 5), aside(0.5e-3, 0, -0.3e-3);
  const ToolPose straight = has_contact(block, capsule);
  const Vec3 pivot = straight.tip + Vec3(1e-3, 0, 12e-3);
  const Ran turned = run(block, capsule, straight, {by(down), turn(angle, 12e-3, pivot, aside)});

  const Mat3 R = rotation(degree * angle);
  const Vec3 tip = pivot + R * (straight.tip + down - pivot) + aside;
  EXPECT_GT((tip - straight.tip - down).head<2>().norm(), 1e-3);
  const Vec3 come = (turned.end[1].depth) * straight.points_at + Vec3(turned.end[1].aside.data());
  EXPECT_LT((straight.tip + come - tip).norm(), 1e-9);
  const Ran came = tilted_straight_to(block, capsule, R, tip);
  expect_near(turned.wrench(1), came.wrench(0), 2e-3, capsule.radius);
  EXPECT_LT(std::abs(turned.energy_at(1).error()), 0.01 * turned.energy_at(1).external);
}

TEST(TurningTool, ThereAndBackWithoutFrictionTakesNoWorkAndWithFrictionLosesIt) {
  const Block block(800, 2.7, 8e-3);
  const ToolPose pose = has_contact(block, punch);
  const auto there_and_back = [&](double friction, std::optional<Vec3> about) {
    return run(block, punch, pose,
               {by({0, 0, -1e-3}), turn({0, 10, 0}, 4e-3, about), turn({0, -10, 0}, 4e-3, about)},
               {.friction = friction});
  };
  const Ran free = there_and_back(0.0, std::nullopt);
  EXPECT_LT((free.wrench(2) - free.wrench(0)).head<3>().norm(), 1e-3 * free.wrench(0).head<3>().norm());
  const double there = std::abs(free.work_until(1) - free.work_until(0));
  EXPECT_GT(there, 1e-3 * free.work_until(0));
  EXPECT_LT(std::abs(free.work_until(2) - free.work_until(0)), 0.05 * there + 1e-4 * free.work_until(0));
  EXPECT_LT(free.history.energy.back().dissipated, 1e-3 * there);

  const Ran with_friction = there_and_back(0.3, pose.tip + Vec3(0, 0, 5e-3));
  double before = 0.0;
  for (const EnergySample& sample : with_friction.history.energy) {
    EXPECT_GE(sample.dissipated, before - 1e-15);
    before = sample.dissipated;
  }
  EXPECT_GT(with_friction.energy_at(2).dissipated - with_friction.energy_at(0).dissipated,
            0.01 * with_friction.energy_at(0).external);
  EXPECT_LT(std::abs(with_friction.history.energy.back().error()),
            0.05 * with_friction.history.energy.back().external);
}

TEST(TurningTool, InTheOppositeSenseOnASymmetricBlockHasTheMirroredForceAndMoment) {
  const Block block(1000, 2.7, 8e-3);
  const ToolPose pose = has_contact(block, punch);
  const Requested coarse{.step_radii = 0.2};
  const Ran left = run(block, punch, pose, {by({0, 0, -1.5e-3}), turn({12, 0, 0}, 4e-3)}, coarse),
            right = run(block, punch, pose, {by({0, 0, -1.5e-3}), turn({-12, 0, 0}, 4e-3)}, coarse);
  Wrench mirrored = right.wrench(1);  // in y: for a moment the other two components change sign
  mirrored[1] *= -1.0, mirrored[3] *= -1.0, mirrored[5] *= -1.0;
  EXPECT_GT(std::abs(left.wrench(1)[3]), 0.1 * left.wrench(1).head<3>().norm() * punch.radius);
  expect_near(mirrored, left.wrench(1), 0.01, punch.radius);
}

TEST(TurningTool, ContinuesFromAnyStateThatWasKeptToTheSameBits) {
  const Block block(600, 2.7, 8e-3);
  const ToolPose pose = has_contact(block, capsule);
  const std::vector<Step> steps = {by({0, 0, -1e-3}), turn({0, 8, 0}, 6e-3, pose.tip + Vec3(0, 0, 6e-3)),
                                   turn({5, 0, 8}, 6e-3)};
  std::vector<MarchState> kept;
  const Ran whole = run(block, capsule, pose, steps, {.friction = 0.2, .kept = &kept});
  for (const int step : {1, 2}) {  // during the steps
    const auto state = std::find_if(kept.rbegin(), kept.rend(),
                                    [&](const MarchState& s) { return s.step_of_scene == step; });
    ASSERT_NE(state, kept.rend());
    const Ran again = run(block, capsule, pose, steps, {.friction = 0.2, .from = &*state});
    EXPECT_EQ(again.wrench(2), whole.wrench(2));
    EXPECT_EQ(again.end[2].turned, whole.end[2].turned);
    EXPECT_EQ(again.history.energy.back().dissipated, whole.history.energy.back().dissipated);
  }
}

// ---------------------------------------------------------------------------------------------------------
// Rotation of a sphere about its centre
// ---------------------------------------------------------------------------------------------------------

TEST(TurningSphere, AboutItsMiddleWithoutFrictionHasNoTorque) {
  const Block block(800, 2.7, 8e-3);
  const ToolPose pose = has_contact(block, sphere);
  const Vec3 down(0, 0, -1.5e-3), middle = pose.tip + down + Vec3(0, 0, sphere.radius);
  const Requested coarse{.step_radii = 0.2};
  const Ran ran = run(block, sphere, pose, {by(down), turn({20, 10, 30}, sphere.radius, middle)}, coarse);
  EXPECT_LT((ran.wrench(1) - ran.wrench(0)).head<3>().norm(), 1e-4 * ran.wrench(0).head<3>().norm());
  EXPECT_NEAR(ran.work_until(1), ran.work_until(0), 1e-4 * ran.work_until(0));
}

// Rotation of a sphere on a body that is large compared with the contact.
struct Spun {
  double force, moment, a;  // along the press direction; contact radius by Hertz [m]
  Ran ran;
};
Spun spun(double friction, double degrees, Index nodes = 1500) {
  const Block block(nodes, 0.9, 2.5e-3);
  const ToolPose pose = has_contact(block, sphere);
  const Vec3 down(0, 0, -0.15e-3);
  Ran ran = run(block, sphere, pose, {by(down), turn({0, 0, degrees}, 0.15e-3)}, {friction, 1e-5, 0.01});
  const double force = ran.wrench(1)[2], E = 2.0 * mu * 1.49, nu = 0.49;
  const double a = std::cbrt(0.75 * force * sphere.radius * (1.0 - nu * nu) / E);
  return {force, ran.wrench(1)[5], a, std::move(ran)};
}

// Lubkin 1951; Johnson, Contact Mechanics, 1985, section 7.4: the whole contact slides.
TEST(TurningSphere, AboutItsApproachSlidesWithTheTorqueOfLubkin) {
  const double friction = 0.05;
  const Spun sphere_spun = spun(friction, 30.0);
  const double slides = 3.0 * std::numbers::pi / 16.0 * friction * sphere_spun.force * sphere_spun.a;
  EXPECT_NEAR(sphere_spun.moment, -slides, 0.05 * slides) << "against the turn";
  const History& history = sphere_spun.ran.history;
  EXPECT_GT(history.energy.back().dissipated, 0.0);
  EXPECT_LT(history.no_slip_area, 0.1 * history.contact_area);
}

// Slipping samples that are treated as held would lag behind, all in the same sense of rotation.
TEST(TurningSphere, AboutItsApproachHasNearlyTheSameTorqueUnderTheUsualTolerance) {
  const Block block(1500, 2.7, 7e-3);
  const ToolPose pose = has_contact(block, sphere);
  const Vec3 down(0, 0, -1.5e-3);
  std::vector<double> torque;
  for (const double tolerance : {1e-4, 1e-5})
    torque.push_back(
        run(block, sphere, pose, {by(down), turn({0, 0, 60}, 1.5e-3)}, {0.3, tolerance, 0.1}).wrench(1)[5]);
  EXPECT_NEAR(torque[0], torque[1], 0.01 * std::abs(torque[1]));
}

// Johnson, equation 7.43 (Reissner and Sagoci 1944): without slip it rotates like a bonded disc. The mean of
// three discretisations is used: each torque is 2 to 5 % too small, with 1000 nodes as with 4000.
TEST(TurningSphere, AboutItsApproachWithoutSlipHasTheTorqueOfABondedDisc) {
  const double angle = 2.0;
  double mean = 0.0;
  for (const Index nodes : {1000, 1500, 2000}) {
    const Spun sphere_spun = spun(std::numeric_limits<double>::infinity(), angle, nodes);
    const double bonded = 16.0 / 3.0 * mu * std::pow(sphere_spun.a, 3) * angle * degree;
    mean -= sphere_spun.moment / bonded / 3.0;
    EXPECT_NEAR(-sphere_spun.moment / bonded, 1.0, 0.07) << nodes;
    const EnergySample &end = sphere_spun.ran.energy_at(1), &before = sphere_spun.ran.energy_at(0);
    const double work = 0.5 * bonded * angle * degree;
    EXPECT_NEAR(end.stored - before.stored, work, 0.1 * work);
  }
  EXPECT_NEAR(mean, 1.0, 0.05) << "against the turn";
}

}  // namespace
}  // namespace dimple
