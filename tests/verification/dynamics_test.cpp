// Marching in time against what is known of waves, of energy, and of a step that is halved.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "io/error.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/block.hpp"
#include "tests/helpers/report.hpp"
#include "tests/helpers/system.hpp"

namespace dimple {
namespace {

using namespace testing_bodies;
using Nodal = ForceSystem::Nodal;

// Kick by half a step, move, kick by half a step: velocities at whole steps, so that energies need no
// averaging.
void march(ForceState& forces, const Model& model, const Constraints& constraints, double dt, Nodal& u,
           Nodal& v, Nodal& f) {
  const auto kick = [&] {
    for (Index a = 0; a < u.cols(); ++a)
      v.col(a) -= constraints.project(a, f.col(a)) * (0.5 * dt / model.mass[a]);
  };
  kick();
  u += dt * v;
  ASSERT_TRUE(forces.internal_force(u, f).ok());
  kick();
}

TEST(Verification, FreeVibrationKeepsItsEnergyOverTenThousandSteps) {
  const Model model = block(3);
  const ForceSystem system(model, neo_hookean(210.0, 0.49, 1000.0));
  ForceState forces(system);
  const Constraints constraints = make_constraints(model, Contact::bonded);
  Nodal u = Nodal::Zero(4, model.node_count()), v = u, f = u;
  for (Index a = 0; a < u.cols(); ++a)  // bent by a tenth of its height, and let go
    u.col(a) = constraints.project(a, Eigen::Vector4d(2e-3 * std::pow(model.X(2, a) / 20e-3, 2), 0, 0, 0));
  forces.internal_force(u, f);
  const double dt = 0.2 * testing_bodies::stable_step(forces.system(), model, model.mass, constraints, u).dt;
  const double start = forces.stored_energy(u);
  // The energy of central differences oscillates by (omega dt)^2 / 4 about one that stays: means over a
  // thousand steps.
  std::array<double, 10> mean{};
  double most_kinetic = 0.0;
  for (std::size_t step = 0; step < 10'000; ++step) {
    march(forces, model, constraints, dt, u, v, f);
    if (step % 5 != 0) continue;
    double kinetic = 0.0;
    for (Index a = 0; a < u.cols(); ++a) kinetic += 0.5 * model.mass[a] * v.col(a).squaredNorm();
    most_kinetic = std::max(most_kinetic, kinetic);
    mean[step / 1000] += (kinetic + forces.stored_energy(u)) / 200.0;
  }
  const auto [least, most] = std::minmax_element(mean.begin(), mean.end());
  RecordProperty("energy_drift", std::to_string((*most - *least) / start));
  EXPECT_LT(*most - *least, 1e-3 * start);
  EXPECT_GT(most_kinetic, 0.3 * start);  // it did vibrate
}

// A layer that is held below, free above and moves along one direction only: its lowest mode is a quarter of
// a wave, and lasts 4 H / c.
double period_of_quarter_wave(const Model& model, const Material& material, int direction) {
  const ForceSystem system(model, material);
  ForceState forces(system);
  Nodal u = Nodal::Zero(4, model.node_count()), v = u, f = u;
  const Constraints constraints(model.node_count(), {{.name = "base", .node = model.base}});
  const double dt = 0.5 * testing_bodies::stable_step(forces.system(), model, model.mass, constraints, u).dt,
               height = 20e-3;
  Eigen::VectorXd mode(model.node_count());
  for (Index a = 0; a < u.cols(); ++a) mode[a] = std::sin(0.5 * std::numbers::pi * model.X(2, a) / height);
  u.row(direction) = 1e-6 * mode.transpose();
  forces.internal_force(u, f);
  const auto part = [&] { return u.row(direction).dot(mode.cwiseProduct(model.mass)); };
  double before = part();
  int passed = 0;
  double first = 0.0;
  for (int step = 1; step < 100'000; ++step) {
    for (int i = 0; i < 3; ++i)
      if (i != direction) f.row(i).setZero();
    for (Index a = 0; a < u.cols(); ++a) v.col(a) -= constraints.project(a, f.col(a)) * (dt / model.mass[a]);
    u += dt * v;
    forces.internal_force(u, f);
    const double now = part();
    if (before > 0.0 && now <= 0.0) {
      const double t = dt * (step - 1 + before / (before - now));
      if (++passed == 1) first = t;
      if (passed == 4) return (t - first) / 3.0;
    }
    before = now;
  }
  return std::nan("");
}

TEST(Verification, PressureAndShearWavesTravelAtTheirSpeeds) {
  const Model model = block(8, 0.2, 1.5);
  const Material material = neo_hookean(210.0, 0.499, 1000.0);
  const double pressure = 4.0 * 20e-3 / period_of_quarter_wave(model, material, 2);
  const double shear = 4.0 * 20e-3 / period_of_quarter_wave(model, material, 0);
  RecordProperty("pressure_wave_speed", std::to_string(pressure));
  RecordProperty("shear_wave_speed", std::to_string(shear));
  // Lumped masses and nodes 2.5 mm apart on a wave of 80 mm.
  EXPECT_NEAR(pressure, pressure_wave_speed(material), 0.03 * pressure_wave_speed(material));
  EXPECT_NEAR(shear, shear_wave_speed(material), 0.03 * shear_wave_speed(material));
}

History indent(const Model& model, const Loading& loading, const SolverOptions& options) {
  History history;
  solve(TimeMode::explicit_, ForceSystem(model, neo_hookean(210.0, 0.49, 1000.0)), model, loading, options,
        {}, history);
  return history;
}

TEST(Verification, ASlowPushGivesTheSameForceWithHalfTheTimeStep) {
  const Model model = block(5);
  const Loading slow = {.depth = 1e-3, .rate = 1e-3};
  const double whole = indent(model, slow, {.safety = 0.8, .damping = 60.0, .frames = 2}).force.back().force;
  const double half = indent(model, slow, {.safety = 0.4, .damping = 60.0, .frames = 2}).force.back().force;
  RecordProperty("step_error", std::to_string(std::abs(whole - half) / half));
  EXPECT_NEAR(whole, half,
              1e-3 * half);  // the step's own error is some parts in a million once waves have died
}

TEST(Verification, EnergyErrorFallsWithTheStep) {
  const Model model = block(5);
  const Loading loading = {.depth = 1e-3, .rate = 10e-3};
  const auto error = [&](double safety) {
    const History history = indent(model, loading, {.safety = safety, .frames = 2, .energy_rate = 200.0});
    double worst = 0.0, most = 0.0;
    for (const EnergySample& e : history.energy) {
      worst = std::max(worst, std::abs(e.error()));
      most = std::max(most, e.external);
    }
    return worst / most;
  };
  const double whole = error(0.8), quarter = error(0.2);
  RecordProperty("energy_error_0.8", std::to_string(whole));
  RecordProperty("energy_error_0.2", std::to_string(quarter));
  EXPECT_LT(whole, 0.02);
  EXPECT_LT(quarter, 0.5 * whole);
}

TEST(Verification, APushThroughTheBlockStopsAndSaysWhereAndWhatToDo) {
  const Model model = block(6);
  expect_error<SolveError>(
      [&] { indent(model, {.depth = 60e-3, .rate = 1.0}, {.frames = 4}); },  // thrice the block's height
      {.where = "indentation", .remedy = "--depth", .code = "inverted"});
}

}  // namespace
}  // namespace dimple
