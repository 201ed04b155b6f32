// Dynamics against a known vibration: a round rod, held below, in torsion about its axis.

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "preprocess/build_model.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/shapes.hpp"
#include "tests/helpers/system.hpp"

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;

constexpr double radius_mm = 10.0, height_mm = 40.0;
const Material tissue = neo_hookean(210.0, 0.45, 1000.0);
/// Period of the first mode, u = r sin(pi z / 2H) along the hoop, which leaves the rod's sides free of
/// stress: 4 H / c. Love, A Treatise on the Mathematical Theory of Elasticity, section 200.
const double period = 4e-3 * height_mm / shear_wave_speed(tissue);

struct Swing {
  std::vector<double> t, part;  // of the mode, 1 at first
  /// Time of the nth zero crossing.
  double passes(int n) const {
    for (std::size_t k = 1; k < t.size(); ++k)
      if (part[k - 1] * part[k] <= 0.0 && --n == 0)
        return t[k - 1] + (t[k] - t[k - 1]) * part[k - 1] / (part[k - 1] - part[k]);
    return std::nan("");
  }
  double at(double time) const {
    for (std::size_t k = 1; k < t.size(); ++k)
      if (t[k] >= time) return part[k - 1] + (part[k] - part[k - 1]) * (time - t[k - 1]) / (t[k] - t[k - 1]);
    return std::nan("");
  }
};

// Vibration from the mode's shape, a hundred micrometres at most; no tool is in contact with the rod.
Swing swing(double damping) {
  ModelOptions options;
  options.node_set.count = 2500;
  options.node_set.grading = {};  // even
  options.boundary = {.base = "inferior", .indent_at = "0,0,top", .indenter_diameter_mm = 8.0};
  Model model = build_model(cylinder_surface(radius_mm, height_mm), options).model;
  model.bonded_patch.clear();
  const ForceSystem system(model, tissue, Precision::double_);
  MarchState start;
  const Index n = model.node_count();
  start.u = start.v = Nodal::Zero(4, n);
  Nodal mode = start.u;
  for (Index a = 0; a < n; ++a) {
    const Vec3 x = model.X.col(a);
    mode.col(a).head<3>() =
        Vec3(-x.y(), x.x(), 0.0) * std::sin(0.5 * std::numbers::pi * x.z() / (1e-3 * height_mm));
  }
  start.u = 1e-3 * mode;
  ForceState forces(system);
  const Constraints held = make_constraints(model, Contact::bonded);
  start.past = forces.past();
  start.safety = 0.9;
  start.dt_stable = testing_bodies::stable_step(forces.system(), model, model.mass, held, start.u).dt;

  Swing result;
  const auto part = [&](const Nodal& u) {
    return (u.cwiseProduct(mode).colwise().sum() * model.mass).value() /
           (1e-3 * (mode.colwise().squaredNorm() * model.mass).value());
  };
  Observer observer;
  observer.frame = [&](const Frame& frame) {
    result.t.push_back(frame.t);
    result.part.push_back(part(frame.u));
  };
  result.t.push_back(0.0);
  result.part.push_back(1.0);
  History history;
  const double duration = 1.3 * period, depth = 1e-12;
  const Loading still = {.depth = depth, .rate = depth / duration};
  const SolverOptions how = {.damping = damping, .frames = 78};
  solve(TimeMode::explicit_, system, model, still, how, observer, history, &start);
  return result;
}

TEST(Vibration, OfATwistedRodHasThePeriodOfItsShearWave) {
  const Swing free = swing(0.0);
  const double ours = 2.0 * (free.passes(2) - free.passes(1));
  RecordProperty("period_error", std::to_string(ours / period - 1.0));
  EXPECT_NEAR(ours, period, 0.02 * period);
  EXPECT_NEAR(free.at(0.5 * ours), -1.0, 0.02);
  EXPECT_NEAR(free.at(ours), 1.0, 0.03) << "nothing damps it";
}

// u'' + c u' + omega^2 u = 0, released at rest: the amplitude is exp(-c T / 2) after a period T, which is
// longer by 1 / sqrt(1 - (c / 2 omega)^2).
TEST(Vibration, IsDampedAsMassProportionalDampingSays) {
  // Frequency of the discretised rod; the test above states its accuracy.
  const Swing free = swing(0.0);
  const double own = 2.0 * (free.passes(2) - free.passes(1)), omega = 2.0 * std::numbers::pi / own,
               c = 2.0 / own;
  const double longer = own / std::sqrt(1.0 - std::pow(0.5 * c / omega, 2));
  const Swing damped = swing(c);
  EXPECT_NEAR(2.0 * (damped.passes(2) - damped.passes(1)), longer, 0.02 * longer);
  EXPECT_NEAR(damped.at(longer), std::exp(-0.5 * c * longer), 0.02);
}

}  // namespace
}  // namespace dimple
