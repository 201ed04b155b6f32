#include "solver/constraints.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "solver/solve.hpp"
#include "tests/helpers/block.hpp"

namespace dimple::constraints_test {
namespace {

using namespace testing_bodies;

TEST(Constraints, HoldTheBaseAndDriveTheBondedPatch) {
  const Model model = block(5);
  const Constraints bonded = make_constraints(model, Contact::bonded);
  const Constraints frictionless = make_constraints(model, Contact::frictionless);
  for (Index a = 0; a < model.node_count(); ++a) {
    const bool base = std::find(model.base.begin(), model.base.end(), a) != model.base.end();
    const bool bonded_patch =
        std::find(model.bonded_patch.begin(), model.bonded_patch.end(), a) != model.bonded_patch.end();
    EXPECT_EQ(bonded.is_held_wholly(a), base || bonded_patch);
    EXPECT_EQ(frictionless.is_held_wholly(a), base);
    EXPECT_EQ(frictionless.slides(a), bonded_patch && !base);
    EXPECT_EQ(bonded.is_free(a), !base && !bonded_patch);
  }
}

TEST(Constraints, ProjectLeavesWhatIsNotPrescribed) {
  const Vec3 approach = Vec3(1, 2, -2) / 3.0;
  const Constraints c(5,
                      {{.name = "fixed", .node = {1}},
                       {.name = "moved", .node = {2}, .direction = approach, .fraction = 1.0},
                       {.name = "slides", .node = {3}, .hold = HeldSet::Hold::along, .direction = approach},
                       {.name = "bed", .node = {4}, .hold = HeldSet::Hold::across, .direction = approach}});
  const Eigen::Vector4d v(0.3, -0.7, 1.1, 0.0), along = padded(approach);
  EXPECT_EQ(c.project(0, v), v);
  EXPECT_EQ(c.project(1, v), Eigen::Vector4d::Zero());
  EXPECT_EQ(c.project(2, v), Eigen::Vector4d::Zero());
  EXPECT_NEAR(c.project(3, v).dot(along), 0.0, 1e-15);
  EXPECT_LT((c.project(3, c.project(3, v)) - c.project(3, v)).norm(), 1e-15);
  EXPECT_LT((c.project(3, v) + along * v.dot(along) - v).norm(), 1e-15);
  EXPECT_LT((c.project(4, v) - along * v.dot(along)).norm(), 1e-15) << "along its direction it slides";
}

TEST(Constraints, LeaveARigidBodyModeWhereABodyIsNotHeldInSomeDirection) {
  using Hold = HeldSet::Hold;
  const Vec3 tilted = Vec3(1, 2, -2) / 3.0;
  const HeldSet plane{.name = "plane", .node = {0}, .hold = Hold::along, .direction = tilted},
      same{.name = "same", .node = {1}, .hold = Hold::along, .direction = -tilted},
      line{.name = "line", .node = {2}, .hold = Hold::across, .direction = tilted};
  EXPECT_TRUE(Constraints(4, {}).has_rigid_body_modes());
  EXPECT_TRUE(Constraints(4, {plane, same}).has_rigid_body_modes());
  EXPECT_TRUE(Constraints(4, {line}).has_rigid_body_modes());
  EXPECT_FALSE(Constraints(4, {plane, line}).has_rigid_body_modes());
  EXPECT_FALSE(Constraints(4, {{.name = "fixed", .node = {3}}}).has_rigid_body_modes());
}

TEST(Constraints, HaveADirectionOfTheirOwnForEachDirectionInWhichSetsAreHeldAndSlide) {
  const auto along = [](const char* name, Index node, const Vec3& direction) {
    return HeldSet{
        .name = name, .node = {node}, .hold = HeldSet::Hold::along, .direction = direction.normalized()};
  };
  const Constraints held(5, {along("x", 0, Vec3::UnitX()),
                             along("nearly -x", 1, {-1.0, 0.2, 0.0}),
                             along("z", 2, Vec3::UnitZ()),
                             {.name = "fixed", .node = {3}}});
  const auto directions = held.sliding_directions();
  ASSERT_EQ(directions.size(), 2u);
  EXPECT_EQ(directions[0], padded(Vec3::UnitX()));
  EXPECT_EQ(directions[1], padded(Vec3::UnitZ()));
  const std::vector<bool> x = {false, false, true, false, true}, z = {true, true, false, false, true};
  for (Index a = 0; a < 5; ++a) {
    EXPECT_EQ(held.moves_along(a, directions[0]), x[static_cast<std::size_t>(a)]) << a;
    EXPECT_EQ(held.moves_along(a, directions[1]), z[static_cast<std::size_t>(a)]) << a;
  }
}

TEST(Constraints, PutEachSetWhereItsFractionOfThePathHasBroughtIt) {
  const Constraints c(4, {{.name = "fixed", .node = {1}},
                          {.name = "half", .node = {2}, .direction = Vec3::UnitX(), .fraction = 0.5},
                          {.name = "slides",
                           .node = {3},
                           .hold = HeldSet::Hold::along,
                           .direction = Vec3::UnitZ(),
                           .fraction = -1.0}});
  Nodal u = Nodal::Constant(4, 4, 7.0), v = u;
  u.row(3).setZero();
  c.prescribe(u, 2.0);
  EXPECT_EQ(u.col(0), Eigen::Vector4d(7, 7, 7, 0));
  EXPECT_EQ(u.col(1), Eigen::Vector4d::Zero());
  EXPECT_EQ(u.col(2), Eigen::Vector4d(1, 0, 0, 0));
  EXPECT_EQ(u.col(3), Eigen::Vector4d(7, 7, -2, 0));
  v.setZero();
  EXPECT_DOUBLE_EQ(c.apply_initial_velocity(v, 4.0, Eigen::VectorXd::Constant(4, 3.0)),
                   0.5 * 3.0 * (4.0 + 16.0));
  EXPECT_EQ(v.col(2), Eigen::Vector4d(2, 0, 0, 0));
  Nodal f = Nodal::Constant(4, 4, 1.0);
  EXPECT_DOUBLE_EQ(c.force_along_motion(f), 0.5 - 1.0);
  Nodal requested = Nodal::Constant(4, 4, 3.0);
  c.apply_dirichlet(u, requested);
  EXPECT_EQ(u.col(0), Eigen::Vector4d(7, 7, 7, 0));
  EXPECT_EQ(u.col(2), requested.col(2));
  EXPECT_EQ(u.col(3), Eigen::Vector4d(7, 7, 3, 0));
}

// A patch of a side is drawn outwards while the tool moves down; no march has code for it.
TEST(Constraints, ARetractorIsFollowedByEveryMarch) {
  const Model model = averaged_block(5);
  const ForceSystem system(model, neo_hookean(210.0, 0.45, 1000.0));
  HeldSet retractor{.name = "retractor", .node = {}, .direction = Vec3::UnitX(), .fraction = 0.5};
  const double side = model.X.row(0).maxCoeff(), middle = 0.5 * model.X.row(2).maxCoeff();
  for (Index a = 0; a < model.node_count(); ++a)
    if (model.X(0, a) > side - 1e-9 && std::abs(model.X(2, a) - middle) < 4e-3) retractor.node.push_back(a);
  ASSERT_GT(retractor.node.size(), 3u);
  const Loading alone{.depth = 1e-3, .rate = 1e-3}, held{.depth = 1e-3, .rate = 1e-3, .further = {retractor}};
  double still = 0.0;
  for (const TimeMode time : {TimeMode::quasi_static, TimeMode::explicit_}) {
    History history, without;
    Nodal u;
    const Observer observer{.frame = [&](const Frame& frame) { u = frame.u; }, .sample = {}};
    const SolverOptions options{.damping = 20.0, .frames = 4};
    solve(time, system, model, held, options, observer, history);
    for (const Index a : retractor.node)
      EXPECT_LT((u.col(a) - Eigen::Vector4d(0.5e-3, 0, 0, 0)).norm(), 1e-12);
    const double force = history.force.back().force;
    if (time == TimeMode::quasi_static) still = force;
    EXPECT_NEAR(force, still, 0.02 * still);
    EXPECT_NEAR(history.energy.back().external - history.energy.back().dissipated,
                history.energy.back().stored, 0.03 * history.energy.back().stored);
    if (time != TimeMode::quasi_static) continue;
    solve(time, system, model, alone, options, {}, without);
    EXPECT_GT(std::abs(without.force.back().force - force), 0.01 * force);
  }
}

}  // namespace
}  // namespace dimple::constraints_test
