// Every guard is provoked, and its message checked.

#include "solver/guards.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <limits>

#include "solver/solve.hpp"
#include "solver/text.hpp"
#include "tests/helpers/block.hpp"
#include "tests/helpers/report.hpp"

namespace dimple::guards_test {
namespace {

using namespace testing_bodies;
using testing::HasSubstr;
using Nodal = ForceSystem::Nodal;

const Material tissue = neo_hookean(210.0, 0.49, 1000.0);
const Material brain = neo_hookean(210.0, 0.499, 1000.0);

// Expects a report with all five parts.
void expect_whole(const Report& r, const std::string& code) {
  EXPECT_EQ(r.code, code);
  for (const std::string* part : {&r.fact, &r.where, &r.why, &r.remedy}) EXPECT_FALSE(part->empty()) << code;
}

const Finding* finding(const std::vector<Finding>& findings, const std::string& code) {
  for (const Finding& f : findings)
    if (f.report.code == code) return &f;
  return nullptr;
}

/// Finding with that code and all parts of its report; fails the test if there is none.
Finding found_in(const std::vector<Finding>& findings, const std::string& code) {
  const Finding* found = finding(findings, code);
  EXPECT_NE(found, nullptr) << code;
  if (!found) return {};
  expect_whole(found->report, code);
  return *found;
}

// ------------------------------------------------------------------------------------------ of the model

TEST(Text, HasNoExponent) {
  EXPECT_EQ(text(3.103e-7, " %, ", 1.5e7, ", ", 7, ", ", 0.5f), "0.0000003103 %, 15000000, 7, 0.5");
}

// The sheet is so thin compared with its supports that all nodes around a point are nearly in a plane.
TEST(ModelGuard, FindsSupportsThatLieNearlyInAPlane) {
  const auto sheet = [](double thinner) {
    Model model = block(4);
    model.X.row(2) *= thinner;
    model.point.row(2) *= thinner;
    return model;
  };
  Model poor = sheet(6e-3);
  const SupportReport support = find_supports(poor, {});
  ASSERT_GT(support.worst_pivot_ratio, 1e-5);
  const auto findings = check_model(poor, support, 1e-3);
  const Finding found = found_in(findings, "conditioning");
  EXPECT_EQ(found.worst, support.worst_pivot_ratio);
  EXPECT_THAT(found.report.where, HasSubstr("mm"));
  EXPECT_THAT(found.report.remedy, HasSubstr("--nodes"));

  Model flat = sheet(1e-4);
  expect_whole(report_of<ModelError>([&] { find_supports(flat, {}); }), "conditioning");
}

TEST(ModelGuard, RefusesGradientsThatAreWrong) {
  const Model model = block(4);
  const SupportReport wrong = {.fewest_at = 0, .worst_pivot_at = 5, .linear_error = 1e-3};
  const Report report = report_of<ModelError>([&] { check_model(model, wrong, 1e-3); });
  expect_whole(report, "conditioning");
  EXPECT_THAT(report.where, HasSubstr("point 5"));
}

TEST(ModelGuard, FindsNodesThatAreSparseComparedWithTheirSupports) {
  Model model = block(4);
  const SupportReport support = find_supports(model, {.radius_factor = 1.1});
  ASSERT_GT(support.grown, 0);
  const auto findings = check_model(model, support, 1e-3);
  const Finding found = found_in(findings, "supports");
  EXPECT_THAT(found.report.fact, HasSubstr(std::to_string(support.grown)));

  Model few = block(2);  // so few that no support has enough
  few.X = Points(few.X.leftCols(6));
  few.spacing = Eigen::VectorXd(few.spacing.head(6));
  few.base = {0};
  few.bonded_patch = {5};
  expect_whole(report_of<ModelError>([&] { find_supports(few, {}); }), "supports");
}

TEST(ModelGuard, FindsTooFewNodesUnderThePatchAndSaysHowManyItTakes) {
  Model model = block(5);
  const SupportReport support = find_supports(model, {});
  const auto findings = check_model(model, support, 4e-3);
  const Finding found = found_in(findings, "circle-nodes");
  EXPECT_EQ(found.worst, static_cast<double>(model.bonded_patch.size()));
  EXPECT_THAT(found.report.remedy, HasSubstr("--nodes"));

  while (model.bonded_patch.size() < 120) model.bonded_patch.push_back(0);
  EXPECT_EQ(finding(check_model(model, support, 4e-3), "circle-nodes"), nullptr);
}

// ----------------------------------------------------------------------------------------- of the state

class StateGuard : public testing::Test {
 protected:
  const Model model = averaged_block(5);
  const ForceSystem system{model, brain};
  System body{system, model, {}};
  ForceState& forces = body.tissue();
  const Moment now = {.t = 1.0, .depth = 2e-3};
  std::vector<Finding> findings;
  Guards guards{body, true, true, findings};
  Nodal u = Nodal::Zero(4, model.node_count()), f = u;
};

TEST_F(StateGuard, OfAToolThatLeavesWarnsOnceAndOnlyWhereTheTissueSpringsBackByMoreThanTheToolMoved) {
  u(2, 3) = -0.4e-3;
  guards.found_lost_contact(u, 0.4e-3, now);
  EXPECT_TRUE(findings.empty()) << "it follows a tool that is lifted";
  guards.found_lost_contact(u, 0.3e-3, now);
  ASSERT_EQ(findings.size(), 1u);
  expect_whole(findings.front().report, "tool-left");
  EXPECT_THAT(findings.front().report.fact, HasSubstr("0.40 mm while the tool moved by 0.30 mm"));
  EXPECT_THAT(findings.front().report.where, HasSubstr("node 3"));
  guards.found_lost_contact(2.0 * u, 0.1e-3, now);
  EXPECT_EQ(findings.size(), 1u);
}

// Under a sphere at first contact with a block, tissue moved by 0.76 mm with the tool's 0.75 mm. The curve
// was correct to its end.
TEST_F(StateGuard, OfALimitPointWarnsOnceAndOnlyWhereANodeJumpsByMoreThanTheToolMoved) {
  u(2, 3) = -0.76e-3;
  guards.found_limit_point(u, 0.75e-3, false, now);
  EXPECT_TRUE(findings.empty()) << "it goes with the tool";
  guards.found_limit_point(u, 0.25e-3, false, now);
  ASSERT_EQ(findings.size(), 1u);
  expect_whole(findings.front().report, "limit-point");
  EXPECT_THAT(findings.front().report.fact, HasSubstr("0.76 mm while the tool moved by 0.25 mm"));
  EXPECT_THAT(findings.front().report.remedy, HasSubstr("trust the curve to 1.75 mm"));
  guards.found_limit_point(2.0 * u, 0.1e-3, false, now);
  EXPECT_EQ(findings.size(), 1u);
}

TEST_F(StateGuard, OfAContactingToolWarnsOfPenetrationAndEndsWhereItIsTooMuchOrNowhereLookedFor) {
  RigidBody indenter;
  indenter.surface.beyond = Points::Constant(3, 1, 7e-3);
  const double most = 5e-6;
  EXPECT_NO_THROW(
      guards.check_contact({.penetration = most, .beyond = most, .beyond_at = 0}, most, indenter, now));
  EXPECT_TRUE(findings.empty());
  EXPECT_NO_THROW(guards.check_contact({.penetration = 2.0 * most}, most, indenter, now));
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_EQ(findings.front().report.code, "penetration");
  EXPECT_TRUE(findings.front().is_minor) << "1.4 x 0.01 mm of 2 mm: 0.7 % of the force";
  guards.check_contact({.penetration = 40.0 * most}, most, indenter, now);
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_FALSE(findings.front().is_minor) << "14 %";
  EXPECT_THAT(findings.front().report.why, HasSubstr("may be off by up to 14"));
  const auto ends_with = [&](const RigidContact::Audit& audit) {
    return report_of<SolveError>([&] { guards.check_contact(audit, most, indenter, now); }).code;
  };
  EXPECT_EQ(ends_with({.penetration = 51.0 * most}), "penetration");
  EXPECT_EQ(ends_with({.penetration = 0.0, .beyond = 1.01 * most, .beyond_at = 0}), "contact-surface");
}

TEST_F(StateGuard, DistinguishesTooFewNodesFromASurfaceThatFoldsAtAToolsEdge) {
  RigidBody indenter;
  indenter.shape = punch_shape(5e-3, 1e-3);
  const double most = 5e-6;
  const auto check = [&](double penetration) {
    guards.check_contact({.penetration = penetration}, most, indenter, now);
  };
  const auto why = [&](double penetration) {
    const Report report = report_of<SolveError>([&] { check(penetration); });
    expect_whole(report, "penetration");
    return report.why;
  };
  EXPECT_NO_THROW(check(40.0 * most));
  EXPECT_THAT(why(60.0 * most), HasSubstr("too far apart")) << "a little more than before";
  EXPECT_THAT(why(90.0 * most),
              HasSubstr("it was 0.2000 mm before: without friction the surface has folded"));
  indenter.friction = 0.3;
  EXPECT_THAT(why(90.0 * most), HasSubstr("too far apart"));
  indenter.friction = 0.0;
  indenter.shape = sphere_shape(5e-3);
  EXPECT_THAT(why(90.0 * most), HasSubstr("too far apart")) << "it has no edge";
}

TEST_F(StateGuard, ReportsWhetherTheSurfacePenetratesAWallOrAFurtherTool) {
  RigidBody rigid;
  rigid.name = "skull";
  rigid.surface.place.setZero(3, 1);
  rigid.surface.spacing.setConstant(1, 1e-3);
  guards.check_wall(rigid, 0.14e-3, false, now);
  EXPECT_TRUE(findings.empty());
  guards.check_wall(rigid, 0.16e-3, true, now);
  rigid.name = "spatula";
  rigid.is_tool = true;
  guards.check_wall(rigid, 0.16e-3, true, now);
  ASSERT_EQ(findings.size(), 2u);
  EXPECT_THAT(findings[0].report.fact, HasSubstr("into the wall 'skull'"));
  EXPECT_THAT(findings[1].report.fact, HasSubstr("into the tool 'spatula'"));
  const double deep = 0.06 * rigid.shape.radius;
  EXPECT_NO_THROW(guards.check_wall(rigid, deep, true, now)) << "its force is something";
  EXPECT_THROW(guards.check_wall(rigid, deep, false, now), SolveError) << "its force is none";
}

TEST_F(StateGuard, SeesWhatIsNoNumberInAnyComponentOfAnyNode) {
  EXPECT_NO_THROW(guards.check_nodes(u, f, now));
  for (const double nonsense :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
    for (const Index a : {Index{0}, model.node_count() / 2, model.node_count() - 1})
      for (int i = 0; i < 3; ++i) {
        Nodal bad = u;
        bad(i, a) = nonsense;
        const Report of_u = report_of<SolveError>([&] { guards.check_nodes(bad, f, now); });
        expect_whole(of_u, "non-finite");
        EXPECT_THAT(of_u.fact, HasSubstr("node " + std::to_string(a)));
        EXPECT_THAT(of_u.fact, HasSubstr(std::string("along ") + "xyz"[i]));
        EXPECT_THAT(of_u.where, HasSubstr("2 mm"));
        EXPECT_THAT(report_of<SolveError>([&] { guards.check_nodes(u, bad, now); }).fact,
                    HasSubstr("force on"));
      }
}

TEST_F(StateGuard, SeesADisplacementThatIsNoNumberAtAPoint) {
  u(1, 40) = std::numeric_limits<double>::quiet_NaN();
  const ForceSystem::Sweep sweep = forces.stress_sweep(u);
  expect_whole(report_of<SolveError>([&] { guards.check_sweep(sweep, now); }), "non-finite");
}

// One node is pressed through its neighbours, as at a sharp edge of the contact patch.
TEST_F(StateGuard, SaysThatAFewPointsAreInsideOutAndStopsForMany) {
  const Index a = model.bonded_patch.front();
  u(2, a) = -1.6 * model.spacing[a];
  ForceSystem::Sweep sweep = forces.stress_sweep(u);
  ASSERT_GT(sweep.inverted, 0);
  guards.check_sweep(sweep, now);
  guards.check_points(sweep, now);
  const Finding found = found_in(findings, "inverted");
  EXPECT_EQ(found.worst, sweep.J_min);
  EXPECT_THAT(found.report.fact, HasSubstr(std::to_string(sweep.inverted) + " of "));

  const Finding crushed = found_in(findings, "stress");
  EXPECT_GE(crushed.worst, static_cast<double>(sweep.inverted));

  sweep = forces.stress_sweep(affine(model, Eigen::Vector3d(1.0, 1.0, -0.5).asDiagonal()));
  expect_whole(report_of<SolveError>([&] { guards.check_points(sweep, now); }), "inverted");
}

// Points that were crushed earlier but no longer are have a stress.
TEST_F(StateGuard, CountsPointsWithoutStressInTheLastStateAlone) {
  const auto check = [&](double height) {
    const ForceSystem::Sweep sweep =
        forces.stress_sweep(affine(model, Eigen::Vector3d(1.0, 1.0, height).asDiagonal()));
    try {
      guards.check_points(sweep, now);
    } catch (const SolveError& error) {  // so much of it is far from its volume
      EXPECT_EQ(error.report.code, "volume");
    }
    const Finding* found = finding(findings, "stress");
    return found ? found->worst : 0.0;
  };
  EXPECT_EQ(check(0.15), static_cast<double>(model.point_count()));
  EXPECT_FALSE(finding(findings, "stress")->is_minor);
  EXPECT_EQ(check(0.25), 0.0);
  EXPECT_EQ(check(1.0), 0.0);
}

TEST_F(StateGuard, OfThePapersSchemeStopsForOnePointInsideOut) {
  const Model paper = block(5);
  const ForceSystem plain(paper, tissue);
  System plain_body(plain, paper, {});
  std::vector<Finding> none;
  const Guards strict(plain_body, true, true, none);
  Nodal v = Nodal::Zero(4, paper.node_count());
  v(2, paper.bonded_patch.front()) = -3.0 * paper.spacing[0];
  const Report report = report_of<SolveError>([&] { strict.check_sweep(plain_body.stress_sweep(v), now); });
  expect_whole(report, "inverted");
  EXPECT_THAT(report.where, HasSubstr("mm"));
}

TEST_F(StateGuard, SeesNearlyIncompressibleTissueChangeItsVolume) {
  guards.check_points(forces.stress_sweep(affine(model, 1.02 * Mat3::Identity())), now);
  EXPECT_TRUE(findings.empty());
  // First only the upper tenth expands, then the whole body.
  for (Index a = 0; a < model.node_count(); ++a)
    if (model.X(2, a) > 17e-3) u(2, a) = 0.5 * (model.X(2, a) - 17e-3);
  guards.check_points(forces.stress_sweep(u), now);
  const Finding found = found_in(findings, "volume");
  EXPECT_GT(found.worst, 0.01);
  const ForceSystem::Sweep all = forces.stress_sweep(affine(model, 1.2 * Mat3::Identity()));
  expect_whole(report_of<SolveError>([&] { guards.check_points(all, now); }), "volume");

  const ForceSystem sponge(model, neo_hookean(210.0, 0.3, 1000.0));  // compressible
  System sponge_body(sponge, model, {});
  std::vector<Finding> none;
  Guards(sponge_body, true, true, none)
      .check_points(sponge_body.stress_sweep(affine(model, 1.2 * Mat3::Identity())), now);
  EXPECT_TRUE(none.empty());
}

TEST_F(StateGuard, SeesEnergyThatIsNotBalanced) {
  const double J = 1e-4;
  const auto sample = [&](double stored) { return EnergySample{1.0, 2e-3, 0.0, stored, J, 0.0}; };
  guards.check_energy(sample(0.99 * J), J, 1.0, false, now);
  EXPECT_TRUE(findings.empty());
  guards.check_energy(sample(1.05 * J), J, 1.0, false, now);
  const Finding found = found_in(findings, "energy");
  EXPECT_NEAR(found.worst, 0.05, 1e-9);
  const Report gained =
      report_of<SolveError>([&] { guards.check_energy(sample(1.2 * J), J, 1.0, false, now); });
  expect_whole(gained, "energy");
  EXPECT_THAT(gained.fact, HasSubstr("energy gained"));
  EXPECT_NO_THROW(guards.check_energy(sample(0.8 * J), J, 1.0, false, now));  // lost by damping steps
  EXPECT_THAT(report_of<SolveError>([&] { guards.check_energy(sample(0.8 * J), J, 1.0, true, now); }).fact,
              HasSubstr("lost"));
  // For a body without a tool, where no other step helps, the guard only warns.
  EXPECT_NO_THROW(guards.check_energy(sample(1.3 * J), J, 1.0, false, now, /*warns_alone=*/true));
  EXPECT_NEAR(finding(findings, "energy")->worst, 0.3, 1e-9);
  // Central differences gain energy only by instability.
  const Moment marching = {.t = 1.0, .depth = 2e-3, .dt = 0.9e-3, .dt_stable = 1e-3};
  EXPECT_NO_THROW(guards.check_energy(sample(1.01 * J), J, 1.0, true, marching));
  EXPECT_NO_THROW(guards.check_energy(sample(0.97 * J), J, 1.0, true, marching));
  EXPECT_THAT(
      report_of<SolveError>([&] { guards.check_energy(sample(1.03 * J), J, 1.0, true, marching); }).remedy,
      HasSubstr("solver.safety"));
  expect_whole(report_of<SolveError>([&] { guards.check_kinetic(2.0 * J, J, now); }), "energy");
  EXPECT_NO_THROW(guards.check_kinetic(0.5 * J, J, now));
}

TEST_F(StateGuard, SeesAForceThatJumpsFromSampleToSample) {
  std::vector<double> force;
  for (int k = 0; k < 60; ++k) force.push_back(0.05 + 1e-3 * k + (k % 2 == 0 ? 1e-4 : -1e-4));
  guards.check_smooth(force, 0.1, 2.0, now);  // by 0.4 %
  EXPECT_TRUE(findings.empty());
  for (int k = 30; k < 50; ++k) force[static_cast<std::size_t>(k)] += k % 2 == 0 ? 2e-3 : -2e-3;
  guards.check_smooth(force, 0.1, 10.0, now);  // the load has only begun
  EXPECT_TRUE(findings.empty());
  guards.check_smooth(force, 0.1, 2.0, now);
  const Finding found = found_in(findings, "jagged");
  EXPECT_NEAR(found.worst, 0.084, 1e-9);
  EXPECT_THAT(found.report.fact, HasSubstr("by 8.40 % of the largest"));
  std::vector<Finding> none;
  Guards(body, false, true, none).check_smooth(force, 0.1, 2.0, now);  // a fast load may ring
  EXPECT_TRUE(none.empty());
}

TEST_F(StateGuard, SeesABodyThatSwingsWhereTheAnswerShouldBeStatic) {
  const EnergySample vibrating = {1.0, 2e-3, 0.1e-4, 1e-4, 1.1e-4, 0.0};
  guards.check_energy(vibrating, 1.1e-4, 10.0, true, now);  // the load has only begun
  EXPECT_TRUE(findings.empty());
  guards.check_energy(vibrating, 1.1e-4, 2.0, true, now);
  const Finding found = found_in(findings, "kinetic");
  EXPECT_NEAR(found.worst, 0.1, 1e-9);
  EXPECT_THAT(found.report.remedy, HasSubstr("--damping"));
  std::vector<Finding> none;
  Guards(body, false, true, none).check_energy(vibrating, 1.1e-4, 2.0, true, now);  // a fast load may vibrate
  EXPECT_TRUE(none.empty());
}

// Nodes alternate up and down in a lattice that is also that of the integration, so all mean gradients are
// zero.
TEST_F(StateGuard, SeesEnergyInModesThatMeanGradientsDoNotSee) {
  const Model lattice = averaged_block(5, 0.0, 1.0);
  const ForceSystem own(lattice, brain);
  System own_body(own, lattice, {});
  ForceState& own_forces = own_body.tissue();
  Guards watch(own_body, true, true, findings);
  double hourglass = 0.0,
         stored = own_forces.stored_energy(affine(lattice, 1.01 * Mat3::Identity()), &hourglass);
  EXPECT_LT(hourglass, 1e-6 * stored);  // no linear field has any
  watch.check_hourglass(hourglass, stored, now);
  EXPECT_TRUE(findings.empty());
  Nodal checkers = Nodal::Zero(4, lattice.node_count());
  for (Index a = 0; a < lattice.node_count(); ++a) {
    const double h = lattice.spacing[a];
    const Vec3 cell = (lattice.X.col(a) / h).array().round();
    checkers(0, a) = 0.05 * h * (static_cast<int>(cell.sum()) % 2 == 0 ? 1.0 : -1.0);
  }
  stored = own_forces.stored_energy(checkers, &hourglass);
  watch.check_hourglass(hourglass, stored, now);
  const Finding found = found_in(findings, "hourglass");
  EXPECT_NEAR(found.worst, hourglass / stored, 1e-12);
}

TEST_F(StateGuard, SeesATimeStepAboveTheStableOne) {
  EXPECT_NO_THROW(guards.check_step({.t = 0.0, .depth = 0.0, .dt = 1e-3, .dt_stable = 1.001e-3}));
  const Report report = report_of<SolveError>(
      [&] { guards.check_step({.t = 0.0, .depth = 0.0, .dt = 1e-3, .dt_stable = 0.99e-3}); });
  expect_whole(report, "time-step");
  EXPECT_THAT(report.remedy, HasSubstr("solver.safety"));
}

// ------------------------------------------------------------------------------------------- recovery

const Loading approach = {.depth = 1e-3, .rate = 5e-3};

TEST(Recovery, OfALongTimeStepBeginsWithinAHundredStepsAndEndsAtTheForceOfAShortOne) {
  const Model model = block(5);
  const ForceSystem system(model, tissue);
  History undisturbed;
  solve(TimeMode::explicit_, system, model, approach, {.damping = 60.0, .frames = 4}, {}, undisturbed);
  EXPECT_TRUE(undisturbed.retries.empty());
  for (const double safety : {1.05, 2.0}) {
    History history;
    std::int64_t steps = -1;
    const Observer observer = {.frame = {}, .sample = {}, .retry = [&](const Retry&) {
                                 if (steps < 0) steps = history.evaluations;
                               }};
    solve(TimeMode::explicit_, system, model, approach, {.safety = safety, .damping = 60.0, .frames = 4},
          observer, history);
    ASSERT_FALSE(history.retries.empty()) << safety;
    EXPECT_LE(history.retries.size(), static_cast<std::size_t>(most_retries));
    EXPECT_EQ(history.retries.front().code, "time-step");
    EXPECT_LE(steps, 100) << safety;
    EXPECT_NEAR(history.force.back().force, undisturbed.force.back().force,
                2e-3 * undisturbed.force.back().force)
        << safety;
    EXPECT_EQ(history.force.size(), undisturbed.force.size());
  }
}

// One segment is so deep that the step that is stable at rest becomes unstable.
TEST(Recovery, GoesBackToTheLastFrameWhenTheStableStepShrinksUnderTheLoad) {
  const Model model = block(8);
  const ForceSystem system(model, tissue);
  const Loading deep = {.depth = 8e-3, .rate = 40e-3};
  History undisturbed;
  solve(TimeMode::explicit_, system, model, deep, {.safety = 0.3, .damping = 60.0, .frames = 2}, {},
        undisturbed);
  ASSERT_TRUE(undisturbed.retries.empty());
  std::vector<History> histories;
  for (const std::size_t threads : {1, 2, 3}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    History& history = histories.emplace_back();
    std::vector<int> frames;
    const Observer observer = {
        .frame = [&](const Frame& frame) { frames.push_back(frame.number); }, .sample = {}, .retry = {}};
    solve(TimeMode::explicit_, system, model, deep, {.damping = 60.0, .frames = 2}, observer, history);
    ASSERT_FALSE(history.retries.empty());
    EXPECT_THAT(history.retries.front().code,
                testing::AnyOf("time-step", "energy", "inverted", "non-finite"));
    EXPECT_THAT(frames, testing::ElementsAre(0, 1, 2));
    EXPECT_NEAR(history.force.back().force, undisturbed.force.back().force,
                2e-3 * undisturbed.force.back().force);
    for (std::size_t k = 1; k < history.force.size(); ++k)
      EXPECT_GT(history.force[k].t, history.force[k - 1].t);
    ASSERT_EQ(history.force.size(), histories[0].force.size());
    for (std::size_t k = 0; k < history.force.size(); ++k)
      EXPECT_EQ(history.force[k].force, histories[0].force[k].force);
    EXPECT_EQ(history.retries.size(), histories[0].retries.size());
    found_in(history.guards, "hourglass");  // so few points
  }
}

// Supports are so wide, and points so few, that displacements of the patch's nodes have no resistance.
TEST(Recovery, IsNotTriedForModesThatNothingResists) {
  const Model model = block(8, 0.2, 1.15, {.radius_factor = 2.5});
  const ForceSystem system(model, tissue);
  History history;
  const Report report = report_of<SolveError>([&] {
    solve(TimeMode::explicit_, system, model, {.depth = 12e-3, .rate = 40e-3}, {.damping = 60.0, .frames = 6},
          {}, history);
  });
  expect_whole(report, "hourglass");
  EXPECT_THAT(report.fact, HasSubstr("times the stored energy"));
  EXPECT_THAT(report.remedy, HasSubstr("grid.ratio"));
  EXPECT_THAT(report.why, testing::Not(HasSubstr("retries")));
}

TEST(Recovery, EndsInAFailureThatSaysHowOftenItWasTried) {
  const Model model = block(6, 0.2, 2.2);
  const ForceSystem system(model, tissue);
  History history;
  int last_frame = -1;
  double last_depth = -1.0;
  const Observer observer = {.frame =
                                 [&](const Frame& frame) {
                                   last_frame = frame.number;
                                   last_depth = frame.depth;
                                 },
                             .sample = {},
                             .retry = {}};
  const Report report = report_of<SolveError>([&] {
    solve(TimeMode::explicit_, system, model, {.depth = 60e-3, .rate = 1.0}, {.frames = 8}, observer,
          history);  // thrice its height
  });
  EXPECT_THAT(report.code, testing::AnyOf("inverted", "time-step"));
  EXPECT_THAT(report.why, HasSubstr("3 retries"));
  EXPECT_EQ(history.retries.size(), static_cast<std::size_t>(most_retries));
  EXPECT_GE(last_frame, 0);
  for (const ForceSample& s : history.force) EXPECT_TRUE(std::isfinite(s.force));
  ASSERT_FALSE(history.force.empty());
  EXPECT_NEAR(history.force.back().depth, last_depth, 1e-12);
  EXPECT_LT(last_depth, 20e-3);
}

TEST(Recovery, FindsAnEquilibriumByShorterStepsOfTheLoad) {
  const Model model = averaged_block(5);
  const ForceSystem system(model, brain);
  const Loading load = {.depth = 4e-3, .rate = 1e-3};
  History undisturbed;
  solve(TimeMode::quasi_static, system, model, load, {.frames = 2}, {}, undisturbed);
  ASSERT_TRUE(undisturbed.retries.empty());
  // The evaluations do not suffice for the whole load step.
  std::int64_t enough = 20;
  History history;
  for (; enough < 200; ++enough) {
    history = {};
    try {
      solve(TimeMode::quasi_static, system, model, load, {.frames = 2, .evaluations = enough}, {}, history);
      break;
    } catch (const SolveError& error) {
      EXPECT_EQ(error.report.code, "no-equilibrium");
      EXPECT_THAT(error.report.why, HasSubstr("it recurred with steps of the load down to"));
      EXPECT_GE(history.retries.size(), 1u);
      EXPECT_LE(history.retries.size(), 4u);  // down to a sixteenth of the distance between two frames
    }
  }
  ASSERT_FALSE(history.retries.empty()) << enough;
  EXPECT_EQ(history.retries.front().code, "no-equilibrium");
  EXPECT_NEAR(history.force.back().force, undisturbed.force.back().force,
              2e-3 * undisturbed.force.back().force);
  EXPECT_EQ(history.force.back().depth, load.depth);
}

TEST(Guards, ChangeNoBitOfARunInWhichNoneFires) {
  const Model model = averaged_block(4);
  const ForceSystem system(model, brain);
  const Loading load = {.depth = 1e-3, .rate = 20e-3};
  for (const TimeMode time : {TimeMode::explicit_, TimeMode::quasi_static}) {
    History with, without;
    solve(time, system, model, load, {.frames = 3}, {}, with);
    solve(time, system, model, load, {.frames = 3, .guards = false}, {}, without);
    EXPECT_TRUE(with.retries.empty());
    ASSERT_EQ(with.force.size(), without.force.size());
    for (std::size_t k = 0; k < with.force.size(); ++k)
      EXPECT_EQ(with.force[k].force, without.force[k].force);
  }
}

}  // namespace
}  // namespace dimple::guards_test
