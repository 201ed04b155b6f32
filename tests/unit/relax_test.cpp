#include "solver/equilibrium/relax.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/march/quasi_static.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/arch.hpp"
#include "tests/helpers/report.hpp"
#include "tests/helpers/system.hpp"

namespace dimple::relax_test {
namespace {

using namespace testing_bodies;
using Nodal = ForceSystem::Nodal;

TEST(Relaxation, EndsInEquilibriumWithWhatIsHeldInPlace) {
  const Model model = averaged_block();
  const ForceSystem system(model, neo_hookean(210.0, 0.49, 1000.0));
  const Constraints constraints = make_constraints(model, Contact::bonded);
  Nodal u = Nodal::Zero(4, model.node_count()), f = u;
  constraints.prescribe(u, 1e-3);
  System body(system, model, constraints);
  const Relaxed relaxed = Relaxation(body)(u, f, {.tolerance = 1e-6});
  EXPECT_LT(relaxed.residual, 1e-6);
  double bonded_patch = 0.0, base = 0.0, unbalanced = 0.0;
  for (Index a = 0; a < model.node_count(); ++a) unbalanced += constraints.project(a, f.col(a)).squaredNorm();
  const Eigen::Vector4d approach = padded(model.tool.approach);
  for (const Index a : model.bonded_patch) {
    bonded_patch += f.col(a).dot(approach);
    EXPECT_EQ(u.col(a), approach * 1e-3);
  }
  for (const Index a : model.base) base -= f.col(a).dot(approach);
  EXPECT_GT(bonded_patch, 0.0);
  EXPECT_NEAR(base, bonded_patch, 1e-5 * bonded_patch);
  EXPECT_LT(std::sqrt(unbalanced), 1e-5 * bonded_patch);
}

TEST(Relaxation, OfADeadLoadHangsItOnTheBase) {
  const Model model = averaged_block();
  const ForceSystem system(model, neo_hookean(210.0, 0.45, 1000.0));
  const Constraints constraints(model.node_count(), {{.name = "base", .node = model.base}});
  Nodal u = Nodal::Zero(4, model.node_count()), f = u, weight = u;
  for (Index a = 0; a < model.node_count(); ++a) weight(2, a) = 0.05 * 9.81 * model.mass[a];
  ForceTerms loads;
  loads.push_back(dead_load(weight));
  System body(system, model, constraints, std::move(loads));
  Relaxation relax(body);
  relax(u, f, {.tolerance = 1e-6});
  double base = 0.0;
  for (const Index a : model.base) base += f(2, a);
  EXPECT_NEAR(base, -weight.row(2).sum(), 1e-4 * weight.row(2).sum());
  EXPECT_GT(u.row(2).maxCoeff(), 0.0);
}

TEST(Relaxation, SaysWhereItGaveUp) {
  const Model model = averaged_block();
  const ForceSystem system(model, neo_hookean(210.0, 0.499, 1000.0));
  const Constraints constraints = make_constraints(model, Contact::bonded);
  Nodal u = Nodal::Zero(4, model.node_count()), f = u;
  constraints.prescribe(u, 1e-3);
  System body(system, model, constraints);
  const Relaxation relax(body);
  expect_error<SolveError>([&] { relax(u, f, {.tolerance = 1e-6, .evaluations = 5}); },
                           {.fact = "no equilibrium"});
}

TEST(LoadSlowly, GivesTheForceThatSlowDampedMotionEndsIn) {
  const Model model = averaged_block(5);
  const Material tissue = neo_hookean(210.0, 0.45, 1000.0);
  const Loading loading = {.depth = 1e-3, .rate = 1e-3};
  const History still = marched(TimeMode::quasi_static, model, tissue, loading, {.frames = 2}),
                moving = marched(TimeMode::explicit_, model, tissue, loading, {.damping = 20.0, .frames = 2});
  ASSERT_EQ(still.force.back().depth, loading.depth);
  EXPECT_NEAR(still.force.back().force, moving.force.back().force, 0.01 * moving.force.back().force);
  EXPECT_NEAR(still.energy.back().external, still.energy.back().stored, 0.01 * still.energy.back().stored);
}

// Work is the area under a curve of few equilibria. Straight lines would make it half a per cent too large
// for a force proportional to depth^2, and parabolas of wrong curvature one per cent.
TEST(LoadSlowly, DoesTheWorkThatStiffeningTissueStores) {
  const Model model = averaged_block();
  const History history = marched(TimeMode::quasi_static, model, ogden({{210.0, -30.0}}, 0.49, 1000.0),
                                  {.depth = 2.5e-3, .rate = 1e-3}, {.frames = 1, .step_radii = 0.05});
  ASSERT_EQ(history.force.back().depth, 2.5e-3);
  const EnergySample& end = history.energy.back();
  EXPECT_GT(history.force.back().force * 2.5e-3, 2.3 * end.stored)
      << "a curve that is straight would tell nothing";
  EXPECT_NEAR(end.external, end.stored, 2e-3 * end.stored);
}

// The number must not grow with the bulk modulus: pressures are separate unknowns for this purpose.
TEST(LoadSlowly, NeedsFewEvaluationsHoweverIncompressibleTheTissueIs) {
  const Model model = averaged_block();
  for (const double nu : {0.45, 0.49, 0.499, 0.4999}) {
    const History history = marched(TimeMode::quasi_static, model, neo_hookean(210.0, nu, 1000.0),
                                    {.depth = 1e-3, .rate = 1e-3}, {.frames = 2});
    EXPECT_LT(history.evaluations, 80) << "nu " << nu;
    EXPECT_LT(history.residual, 1e-4) << "nu " << nu;
  }
}

TEST(LoadSlowly, EndsWhereDynamicRelaxationDoes) {
  const Model model = averaged_block();
  const ForceSystem system(model, neo_hookean(210.0, 0.499, 1000.0));
  const Constraints constraints = make_constraints(model, Contact::bonded);
  History mixed;
  solve(TimeMode::quasi_static, system, model, {.depth = 1e-3, .rate = 1e-3},
        {.frames = 1, .tolerance = 1e-5}, {}, mixed);
  // The mixed iteration needs averaged gradients, so the other solver gets a model without them.
  Model plain = model;
  plain.scheme.averaged_gradients = false;
  Nodal u = Nodal::Zero(4, model.node_count()), f = u;
  constraints.prescribe(u, 1e-3);
  System body(system, plain, constraints);
  const Relaxed relaxed = Relaxation(body)(u, f, {.tolerance = 1e-5});
  double force = 0.0;
  for (const Index a : model.bonded_patch) force += f.col(a).dot(padded(model.tool.approach));
  EXPECT_GT(relaxed.evaluations, 2 * mixed.evaluations);
  EXPECT_NEAR(mixed.force.back().force, force, 1e-3 * force);
}

// In F = I + H float keeps few digits of small strains: the stress must not be computed from F.
TEST(LoadSlowly, SinglePrecisionFindsTheForceOfMovesOfTwoMicrometres) {
  const Model model = averaged_block();
  std::vector<double> force;
  for (const Precision precision : {Precision::double_, Precision::single_}) {
    const History history = marched(TimeMode::quasi_static, model, neo_hookean(210.0, 0.499, 1000.0),
                                    {.depth = 1e-5, .rate = 1e-6}, {.frames = 5}, precision);
    EXPECT_LT(history.evaluations, 200);
    force.push_back(history.force.back().force);
  }
  EXPECT_NEAR(force[1], force[0], 1e-4 * force[0]);
}

TEST(LoadSlowly, SinglePrecisionFindsTheForceOfLayersAThousandTimesAsStiff) {
  const Model model = averaged_block(6, 0.2, 1.8, [](const Vec3& x) { return x.z() < 10e-3 ? 0 : 1; });
  for (const bool stiff_below : {true, false}) {
    const Material soft = neo_hookean(210.0, 0.499, 1000.0), stiff = neo_hookean(210e3, 0.499, 1000.0);
    std::vector<double> force;
    for (const Precision precision : {Precision::double_, Precision::single_}) {
      const History history =
          marched(TimeMode::quasi_static, model,
                  Tissues{{stiff_below ? stiff : soft, stiff_below ? soft : stiff}, model.tissue},
                  {.depth = 1e-3, .rate = 1e-4}, {.frames = 2}, precision);
      force.push_back(history.force.back().force);
    }
    EXPECT_NEAR(force[1], force[0], 1e-3 * force[0]);
  }
}

TEST(LoadSlowly, LetsAViscoelasticBlockRelax) {
  const Model model = averaged_block(5);
  Material material = neo_hookean(210.0, 0.45, 1000.0);
  material.kappa = 1e5;
  const Loading slow = {.depth = 0.5e-3, .rate = 1e-4};  // thousands of relaxation times
  const auto force = [&] {
    return marched(TimeMode::quasi_static, model, material, slow, {.frames = 2}).force.back().force;
  };
  const double elastic = force();
  material.prony = {{0.5, 1e-3}};
  EXPECT_NEAR(force(), 0.5 * elastic, 0.02 * elastic);
}

Tissues stiff_arch_soft_pad(const Model& model) {
  return {{neo_hookean(2000.0, 0.45, 1000.0), neo_hookean(120.0, 0.45, 1000.0)}, model.label};
}
const Finding* with_code(const History& history, const std::string& code) {
  for (const Finding& finding : history.guards)
    if (finding.report.code == code) return &finding;
  return nullptr;
}

// The residual error of each equilibrium, 1e-4 here, must not be amplified by the extrapolation.
TEST(Predictor, FollowsACubicThroughEvenPointsAndIsNotLedAstrayByShortOnes) {
  const auto ahead = [&](const std::vector<std::pair<double, double>>& known, double x) {
    Predictor path(4);
    for (const auto& [from, y] : known)
      path.push(from, ForceSystem::Nodal::Constant(4, 1, y), Eigen::VectorXd::Constant(1, 2.0 * from));
    ForceSystem::Nodal u(4, 1);
    Eigen::VectorXd lambda(1);
    path.extrapolate(x, u, lambda);
    EXPECT_NEAR(lambda[0], 2.0 * x, 1e-12) << "which is a line";
    return u(0, 0);
  };
  const auto cubic = [](double x) { return x * (1.0 + x * (0.5 - 0.1 * x)); };
  EXPECT_NEAR(ahead({{1, cubic(1)}, {2, cubic(2)}, {3, cubic(3)}, {4, cubic(4)}}, 5), cubic(5), 1e-12);
  const double off = 1e-4;
  const std::vector<double> short_first = {0.0, 1.0 / 7.0, 3.0 / 7.0, 1.0};
  std::vector<std::pair<double, double>> known;
  for (std::size_t k = 0; k < short_first.size(); ++k)
    known.emplace_back(short_first[k], short_first[k] + (k % 2 == 0 ? off : -off));
  EXPECT_NEAR(ahead(known, 2.0), 2.0, 10.0 * off);
}

// At some 12.1 mm the arch snaps through: it moves 5 mm while the tool does not move.
TEST(LoadSlowly, PassesALimitPointToTheBranchOfTheMotionAndSaysWhere) {
  const Model model = arch_under_a_pad();
  const ForceSystem system(model, stiff_arch_soft_pad(model));
  const Loading loading = {.depth = 14e-3, .rate = 1e-3};
  History moving;
  // Damping stops the vibration after the snap; the drag itself is 1e-3 of the force.
  solve(TimeMode::explicit_, system, model, loading, {.damping = 8.0, .frames = 14}, {}, moving);
  const double end = moving.force.back().force;
  double largest = 0.0;
  for (const ForceSample& sample : moving.force) largest = std::max(largest, sample.force);
  for (const int frames : {7, 14, 28}) {
    SCOPED_TRACE(frames);
    History history;
    solve(TimeMode::quasi_static, system, model, loading, {.frames = frames}, {}, history);
    EXPECT_NEAR(history.force.back().force, end, 0.01 * largest);
    EXPECT_LT(history.evaluations, 60 * steps_of_load(model, loading, {}))
        << "what a run may take on the average";
    EXPECT_LT(history.residual, 1e-4);
    EXPECT_NEAR(history.energy.back().error(), 0.0, 0.02 * history.energy.back().external);
    EXPECT_GT(history.energy.back().dissipated, 0.05 * history.energy.back().external);
    const Finding* found = with_code(history, "limit-point");
    ASSERT_NE(found, nullptr);
    EXPECT_GT(found->worst, 4.0) << "mm that a node jumps";
    EXPECT_NE(found->report.where.find("mm; node"), std::string::npos) << found->report.where;
  }
}

TEST(LoadSlowly, FindsNoLimitPointWhereThereIsNone) {
  const Model model = arch_under_a_pad();
  const History history = marched(TimeMode::quasi_static, model, stiff_arch_soft_pad(model),
                                  {.depth = 11.5e-3, .rate = 1e-3}, {.frames = 23});
  EXPECT_EQ(with_code(history, "limit-point"), nullptr) << "the force falls, but the path goes on";
  EXPECT_EQ(history.energy.back().dissipated, 0.0);
}

// The evaluations do not suffice for the snap.
TEST(LoadSlowly, EndsWithinItsBoundWhereItGetsNoFurther) {
  const Model model = arch_under_a_pad();
  const ForceSystem system(model, stiff_arch_soft_pad(model));
  const Loading loading = {.depth = 14e-3, .rate = 1e-3};
  const SolverOptions options = {.frames = 14, .evaluations = 150};
  History history;
  expect_error<SolveError>(
      [&] { solve(TimeMode::quasi_static, system, model, loading, options, {}, history); },
      {.why = "evaluations in all", .code = "limit-point"});
  EXPECT_LE(history.evaluations, 150 + 60 * steps_of_load(model, loading, options));
  EXPECT_NEAR(history.force.back().depth, 12e-3, 0.3e-3) << "what was found until then stays";
  for (const Retry& retry : history.retries) EXPECT_GE(retry.depth, 11e-3);
}

TEST(LoadSlowly, EndsWithinItsBoundWhereOneLayerIsAThousandTimesStifferThanTheOther) {
  const Model model = averaged_block(6, 0.2, 1.8, [](const Vec3& x) { return x.z() > 10e-3 ? 1 : 0; });
  for (const double soft : {1.0, 1000.0}) {
    const History history = marched(
        TimeMode::quasi_static, model,
        Tissues{{neo_hookean(1000.0 / soft, 0.499, 1000.0), neo_hookean(soft, 0.499, 1000.0)}, model.label},
        {.depth = 4e-3, .rate = 1e-3}, {.frames = 8});
    EXPECT_LT(history.evaluations, 1000) << soft;
  }
}

// From then on every query reports a stop: within the next equilibrium, or step.
TEST(EveryMarch, StoppedOnRequestKeepsWhatItHas) {
  const Model model = averaged_block(4);
  const ForceSystem system(model, neo_hookean(210.0, 0.49, 1000.0));
  for (const TimeMode time : {TimeMode::quasi_static, TimeMode::explicit_}) {
    for (const std::size_t after : {0, 3}) {
      forget_stop();
      if (after == 0) ask_to_stop(StopReason::interrupted);
      const Observer observer = {.frame = {}, .sample = [&](const ForceSample&, const History& history) {
                                   if (history.force.size() == after + 1)
                                     ask_to_stop(StopReason::out_of_time);
                                   return true;
                                 }};
      History history;
      EXPECT_NO_THROW(
          solve(time, system, model, {.depth = 2e-3, .rate = 4e-3}, {.frames = 8}, observer, history));
      EXPECT_TRUE(history.interrupted);
      EXPECT_EQ(stop_requested(), after == 0 ? StopReason::interrupted : StopReason::out_of_time);
      EXPECT_LE(history.force.size(), after + 1);
      if (after > 0) {
        EXPECT_GE(history.force.size(), after);
      }
    }
  }
  forget_stop();
}

// In every time mode a body under its weight resists the tool like one in equilibrium.
TEST(EveryMarch, OfABodyUnderGravityEndsAtTheForceOfItsEquilibrium) {
  const Model model = averaged_block(4);
  const ForceSystem system(model, neo_hookean(210.0, 0.49, 1000.0));
  const Loading loading = {
      .depth = 1e-3, .rate = 2e-3, .loads = {.gravity = Vec3(0.0, 0.0, -3.0), .pressure = {}}};
  double still = 0.0, base = 0.0, undeformed = 0.0;
  for (const TimeMode time : {TimeMode::quasi_static, TimeMode::explicit_}) {
    History history;
    solve(time, system, model, loading, {.damping = 30.0, .frames = 4}, {}, history);
    ASSERT_FALSE(history.force.empty());
    const ForceSample &first = history.force.front(), &last = history.force.back();
    if (time == TimeMode::quasi_static) still = last.force, base = first.base_force;
    EXPECT_NEAR(last.force, still, 0.03 * still) << name_of(time);
    EXPECT_NEAR(first.base_force, base, 0.01 * base) << name_of(time) << ": the bed bears the weight";
    // The work of gravity before the run does not count as energy of the run; the energy that it stored does.
    const double stored = history.energy.front().stored;
    EXPECT_GT(stored, 0.0) << name_of(time);
    if (time == TimeMode::quasi_static) undeformed = stored;
    EXPECT_NEAR(stored, undeformed, 0.01 * undeformed) << name_of(time);
    EXPECT_GT(history.preload_displacement, 1e-5);
  }
}

// A tissue of Poisson's ratio 0 keeps the search from solving for pressures; then none are held.
TEST(EveryMarch, OfABodyUnderGravityHasTheVolumeOfATissueNextToOneThatHoldsNone) {
  const Model model = averaged_block(4, 0.2, 1.8, [](const Vec3& x) { return x.z() > 10e-3 ? 1 : 0; });
  const ForceSystem system(
      model, Tissues{{neo_hookean(210.0, 0.49, 1000.0), neo_hookean(210.0, 0.0, 1000.0)}, model.label});
  const Loading loading = {
      .depth = 1e-3, .rate = 2e-3, .loads = {.gravity = Vec3(0.0, 0.0, -3.0), .pressure = {}}};
  History still, waves;
  solve(TimeMode::quasi_static, system, model, loading, {.frames = 4}, {}, still);
  solve(TimeMode::explicit_, system, model, loading, {.damping = 30.0, .frames = 4}, {}, waves);
  const double force = waves.force.back().force;
  EXPECT_NEAR(still.force.back().force, force, 0.03 * force);
}

// Gravity along the surface moves the patch sideways before the tool moves. The moment is about its displaced
// middle, and that of bonded forces about the middle of its nodes.
TEST(EveryMarch, OfABodyThatGravityCarriesHasTheMomentAboutTheFirstContact) {
  const Model model = averaged_block(4);
  const ForceSystem tissue(model, neo_hookean(210.0, 0.49, 1000.0));
  const auto body =
      make_system(tissue, model, Contact::bonded, {}, {.gravity = Vec3(6.0, 0.0, 0.0), .pressure = {}});
  Nodal u = body->step_start().u, f = u;
  Eigen::VectorXd lambda = body->step_start().lambda;
  body->set({.depth = 1e-3}, u);
  ASSERT_TRUE(Relaxation(*body)(u, f, {}, &lambda).converged);
  Vec3 undeformed = Vec3::Zero(), now = undeformed, force = undeformed, moment = undeformed;
  for (const Index a : model.bonded_patch) {
    undeformed += model.X.col(a) / static_cast<double>(model.bonded_patch.size());
    now += (model.X.col(a) + u.col(a).head<3>()) / static_cast<double>(model.bonded_patch.size());
  }
  ASSERT_GT(std::abs((now - undeformed).x()), 0.02 * model.tool.radius) << "it is carried";
  const Vec3 about = model.tool.centre + now - undeformed;
  for (const Index a : model.bonded_patch) {
    const Vec3 on_tool = -f.col(a).head<3>();
    force += on_tool;
    moment += (model.X.col(a) + u.col(a).head<3>() - about).cross(on_tool);
  }
  const Wrench wrench = body->on_tool(u, f);
  EXPECT_LT((wrench.head<3>() - force).norm(), 1e-9 * force.norm());
  EXPECT_LT((wrench.tail<3>() - moment).norm(), 1e-6 * force.norm() * model.tool.radius);
}

TEST(StiffnessRowSums, BoundTheStiffnessFromAbove) {
  // With row sums as masses no frequency exceeds 1 by much: the stable step is at least 2.
  const Model model = averaged_block();
  const Material material = neo_hookean(210.0, 0.499, 1000.0);
  const ForceSystem system(model, material);
  ForceState forces(system);
  const Eigen::VectorXd mass = stiffness_row_sums(system, model);
  EXPECT_GT(mass.minCoeff(), 0.0);
  EXPECT_GT(
      testing_bodies::stable_step(forces.system(), model, mass, make_constraints(model, Contact::bonded),
                                  Nodal::Zero(4, model.node_count()))
          .dt,
      2.0);
}

}  // namespace
}  // namespace dimple::relax_test
