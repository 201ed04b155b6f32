// The solver against mechanics, on a jittered block without an image. Time integration against theory of
// waves, of energy, and of a halved step.

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
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

const Material tissue = neo_hookean(210.0, 0.499, 1000.0);

// Force scale of a stiff point alone, by which "zero" is measured.
double force_scale(const Model& model) {
  return tissue.kappa * model.volume.maxCoeff() * model.dphi.colwise().norm().maxCoeff();
}

// The stress is that of the law, whose closed forms are tested by NeoHookean.* in solver_test. It is
// checked at each point, and at the nodes, whose forces have the virial V P.
TEST(Verification, LinearFieldsAreReproducedByDphiAtEveryPoint) {
  const Model model = block();
  const Mat3 A = (Mat3() << 0.3, -0.1, 0.2, 0.05, -0.2, 0.4, 0.1, 0.6, -0.3).finished(),
             exact = Mat3::Identity() + A, law = pk1_stress(tissue, exact);
  const ForceSystem system(model, tissue);
  ForceState forces(system);
  Nodal f = Nodal::Zero(4, model.node_count());
  ASSERT_TRUE(forces.internal_force(affine(model, exact), f).ok());
  const auto F = forces.deformation_gradients(), P = forces.stresses();
  double error = 0.0, of_stress = 0.0;
  for (Index q = 0; q < F.cols(); ++q) {
    error = std::max(error, (Eigen::Map<const Mat3>(F.col(q).data()) - exact).cwiseAbs().maxCoeff());
    of_stress = std::max(of_stress, (Eigen::Map<const Mat3>(P.col(q).data()) - law).cwiseAbs().maxCoeff());
  }
  RecordProperty("largest_error", std::to_string(error));
  EXPECT_LT(error, 1e-10);
  EXPECT_LT(of_stress, 1e-8 * law.norm());
  EXPECT_LT((f.topRows<3>() * model.X.transpose() / model.volume.sum() - law).norm(), 1e-8 * law.norm());
}

TEST(Verification, RigidTranslationAndRotationGiveNoForce) {
  const Model model = block();
  const ForceSystem system(model, tissue);
  ForceState forces(system);
  Nodal f = Nodal::Zero(4, model.node_count());
  const Mat3 turn = (Mat3() << 0, -1, 0, 1, 0, 0, 0, 0, 1).finished();  // 90 degrees about z
  const Mat3 oblique = Eigen::AngleAxisd(1.1, Vec3(1, 2, 3).normalized()).toRotationMatrix();
  for (const Mat3& R : {Mat3(Mat3::Identity()), turn, oblique}) {
    Nodal u = affine(model, R);
    u.topRows<3>().colwise() += Vec3(0.1, -0.2, 0.3);
    forces.internal_force(u, f);
    EXPECT_LT(f.cwiseAbs().maxCoeff(), 1e-10 * force_scale(model));
  }
}

TEST(Verification, TheForceEqualsThePapersStrainDisplacementForm) {
  const Model model = block(4);
  const ForceSystem system(model, tissue);
  ForceState forces(system);
  const Nodal u = random_displacement(model, 2e-4);
  Nodal f = u;
  forces.internal_force(u, f);

  // Section 2.2 of the paper, literally: B_L (6 x 3n) with Voigt order 11, 22, 33, 12, 23, 13, and f = sum of
  // B_L^T S V. F and S = mu J^(-2/3) (I - tr C/3 C^-1) + kappa J (J - 1) C^-1 are written here independently.
  Points paper = Points::Zero(3, model.node_count());
  for (Index q = 0; q < model.point_count(); ++q) {
    Mat3 F = Mat3::Identity();
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
      F += u.col(model.support.member[k]).head<3>() * model.dphi.col(k).transpose();
    const Mat3 C = F.transpose() * F, inverse = C.inverse();
    const double J = F.determinant();
    const Mat3 S = tissue.mu * std::pow(J, -2.0 / 3.0) * (Mat3::Identity() - C.trace() / 3.0 * inverse) +
                   tissue.kappa * J * (J - 1.0) * inverse;
    const Eigen::Matrix<double, 6, 1> voigt =
        (Eigen::Matrix<double, 6, 1>() << S(0, 0), S(1, 1), S(2, 2), S(0, 1), S(1, 2), S(0, 2)).finished();
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k) {
      const Vec3 d = model.dphi.col(k);
      Eigen::Matrix<double, 6, 3> B;
      B << d.x(), 0, 0, 0, d.y(), 0, 0, 0, d.z(), d.y(), d.x(), 0, 0, d.z(), d.y(), d.z(), 0, d.x();
      paper.col(model.support.member[k]) += model.volume[q] * (B * F.transpose()).transpose() * voigt;
    }
  }
  EXPECT_LT((f.topRows<3>() - paper).cwiseAbs().maxCoeff(), 1e-12 * force_scale(model));
}

TEST(Verification, ForcesAndMomentsSumToZero) {
  const Model model = block();
  const ForceSystem system(model, tissue);
  ForceState forces(system);
  const Nodal u = random_displacement(model, 2e-4);
  Nodal f = u;
  forces.internal_force(u, f);
  Vec3 moment = Vec3::Zero();
  for (Index a = 0; a < model.node_count(); ++a)
    moment += (model.X.col(a) + u.col(a).head<3>()).cross(f.col(a).head<3>());
  EXPECT_LT(f.rowwise().sum().norm(), 1e-10 * force_scale(model));
  EXPECT_LT(moment.norm(), 1e-10 * force_scale(model) * 30e-3);
}

Mat3 diagonal(double a, double b, double c) {
  return Vec3(a, b, c).asDiagonal();
}

TEST(Verification, ABlockPressedBetweenFacesFindsTheHomogeneousStateByItself) {
  // Uniaxial compression by 10 %: boundary nodes are prescribed by the closed form, inner ones relax from
  // rest under damped central differences. The worst inner node's distance from the affine field is the
  // patch-test error.
  const Model model = block(6, 0.2, 2.0);
  const ForceSystem system(model, tissue);
  ForceState forces(system);
  const Nodal goal = affine(model, diagonal(1.05398672, 1.05398672, 0.9));
  const std::vector<bool> held = on_boundary(model);
  HeldSet faces{.name = "faces", .node = {}};
  for (std::size_t a = 0; a < held.size(); ++a)
    if (held[a]) faces.node.push_back(static_cast<Index>(a));
  const Constraints constraints(model.node_count(), {faces});
  const Nodal state = Nodal::Zero(4, model.node_count());
  const double dt =
      0.5 * testing_bodies::stable_step(forces.system(), model, model.mass, constraints, state).dt;
  Nodal u = goal, v = state, f = state;
  for (Index a = 0; a < u.cols(); ++a)
    if (!held[static_cast<std::size_t>(a)]) u.col(a) *= 0.9;  // not the solution
  for (int step = 0; step < 6000; ++step) {
    ASSERT_TRUE(forces.internal_force(u, f).ok());
    for (Index a = 0; a < u.cols(); ++a)
      if (!held[static_cast<std::size_t>(a)]) {
        v.col(a) = 0.99 * (v.col(a) - dt / model.mass[a] * f.col(a));
        u.col(a) += dt * v.col(a);
      }
  }
  const double error = (u - goal).cwiseAbs().maxCoeff() / goal.cwiseAbs().maxCoeff();
  RecordProperty("patch_error", std::to_string(error));
  EXPECT_LT(
      error,
      0.02);  // one point per cell does not integrate MLS gradients exactly; with exact ones it would be 0
}

History indent(const Model& model, const Loading& loading, const SolverOptions& options) {
  History history;
  solve(TimeMode::explicit_, ForceSystem(model, neo_hookean(210.0, 0.49, 1000.0)), model, loading, options,
        {}, history);
  return history;
}

// Largest error of the energy balance, relative to the tool's largest work.
double energy_error(const History& history) {
  double worst = 0.0, most = 0.0;
  for (const EnergySample& e : history.energy) {
    worst = std::max(worst, std::abs(e.error()));
    most = std::max(most, e.external);
  }
  return worst / most;
}

TEST(Verification, EnergyIsBalancedOverARun) {
  const Model model = block();
  const History history = indent(model, {.depth = 2e-3, .rate = 10e-3}, {.frames = 4});
  RecordProperty("energy_error", std::to_string(energy_error(history)));
  EXPECT_LT(energy_error(history), 2e-4);  // 6e-5: half a step between force and displacement
}

// Reported forces agree with the motion: their impulse moves the mass of the free nodes, step by step as in
// central differences.
TEST(Verification, ToolAndBaseGiveTheTissueTheMotionThatItHas) {
  const Model model = block();
  const ForceSystem system(model, neo_hookean(210.0, 0.49, 1000.0));
  ForceState forces(system);
  const Constraints constraints = make_constraints(model, Contact::bonded);
  double moved = 0.0;  // sum of mass times displacement along the press direction [kg m]
  const Observer observer = {.frame =
                                 [&](const Frame& frame) {
                                   moved = 0.0;
                                   for (Index a = 0; a < model.node_count(); ++a)
                                     if (constraints.is_free(a))
                                       moved +=
                                           model.mass[a] * frame.u.col(a).head<3>().dot(model.tool.approach);
                                 },
                             .sample = {}};
  History history;
  solve(TimeMode::explicit_, system, model, {.depth = 2e-3, .rate = 10e-3}, {.frames = 1, .sample_rate = 1e9},
        observer, history);
  double momentum = 0.0, displacement = 0.0;
  ASSERT_EQ(history.force.size(), static_cast<std::size_t>(history.evaluations) + 1);
  for (std::size_t k = 0; k + 1 < history.force.size(); ++k) {
    const double dt = history.force[k + 1].t - history.force[k].t;
    momentum += (k == 0 ? 0.5 : 1.0) * dt * (history.force[k].force - history.force[k].base_force);
    displacement += dt * momentum;
  }
  EXPECT_GT(moved, 0.0);
  EXPECT_NEAR(displacement, moved, 1e-9 * moved);
}

TEST(Verification, TheBaseCarriesWhatTheIndenterGives) {
  const Model model = block();
  const History history = indent(model, {.depth = 2e-3, .rate = 2e-3}, {.damping = 20.0, .frames = 4});
  const ForceSample& end = history.force.back();
  EXPECT_GT(end.force, 0.0);
  EXPECT_NEAR(end.base_force, end.force, 0.01 * end.force);
}

TEST(Verification, TheRunIsTheSameForAnyNumberOfThreads) {
  const Model model = block(5);
  std::vector<History> histories;
  for (const std::size_t threads : {1, 2, 3}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    histories.push_back(indent(model, {.depth = 0.5e-3, .rate = 10e-3}, {.frames = 2}));
  }
  for (const History& h : histories) {
    ASSERT_EQ(h.force.size(), histories[0].force.size());
    for (std::size_t k = 0; k < h.force.size(); ++k) {
      EXPECT_EQ(h.force[k].force, histories[0].force[k].force);
      EXPECT_EQ(h.force[k].base_force, histories[0].force[k].base_force);
    }
  }
}

TEST(Verification, AFrictionlessPatchHasNoLateralForceInEquilibrium) {
  const Model model = block();
  const ForceSystem system(model, neo_hookean(210.0, 0.49, 1000.0));
  ForceState forces(system);
  double sideways = 0.0, along = 0.0;
  History history;
  const Observer observer = {.frame =
                                 [&](const Frame& frame) {
                                   sideways = along = 0.0;
                                   for (const Index a : model.bonded_patch) {
                                     sideways = std::max(sideways, frame.f.col(a).head<2>().norm());
                                     along = std::max(along, std::abs(frame.f(2, a)));
                                   }
                                 },
                             .sample = {}};
  solve(TimeMode::explicit_, system, model, {.depth = 1e-3, .rate = 1e-3, .contact = Contact::frictionless},
        {.damping = 40.0, .frames = 2}, observer, history);
  EXPECT_GT(along, 0.0);
  EXPECT_LT(sideways, 0.01 * along);
}

TEST(Verification, TheStableStepIsTheOneOfTheHighestFrequency) {
  // Reference: dense eigenvalues of M^-1 K, K by differences of the force, on a small block.
  const Model model = block(2, 0.1, 1.5, {.radius_factor = 2.0});
  const ForceSystem system(model, tissue);
  ForceState forces(system);
  const Constraints constraints = make_constraints(model, Contact::bonded);
  const Index n = model.node_count();
  Nodal state = Nodal::Zero(4, n), plus = state, minus = state;
  Eigen::MatrixXd K(3 * n, 3 * n);
  for (Index a = 0; a < n; ++a)
    for (int i = 0; i < 3; ++i) {
      Nodal u = state;
      u(i, a) = 1e-8;
      forces.internal_force(u, plus);
      u(i, a) = -1e-8;
      forces.internal_force(u, minus);
      for (Index b = 0; b < n; ++b)
        for (int j = 0; j < 3; ++j) {
          const bool free = constraints.is_free(a) && constraints.is_free(b);
          K(3 * b + j, 3 * a + i) =
              free ? (plus(j, b) - minus(j, b)) / 2e-8 / std::sqrt(model.mass[a] * model.mass[b]) : 0.0;
        }
    }
  const double omega2 =
      Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(0.5 * (K + K.transpose())).eigenvalues().maxCoeff();
  const StableStep step = testing_bodies::stable_step(forces.system(), model, model.mass, constraints, state);
  EXPECT_TRUE(step.converged);
  EXPECT_NEAR(step.dt, 2.0 / std::sqrt(omega2), 2e-3 * step.dt);
  EXPECT_LE(step.dt, 2.0 / std::sqrt(omega2) * (1.0 + 1e-6));
}

// One step: kick by half a step, move, kick by half a step. Velocities at whole steps need no averaging for
// energies.
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
  for (Index a = 0; a < u.cols(); ++a)  // bent by a tenth of its height, and released
    u.col(a) = constraints.project(a, Eigen::Vector4d(2e-3 * std::pow(model.X(2, a) / 20e-3, 2), 0, 0, 0));
  forces.internal_force(u, f);
  const double dt = 0.2 * testing_bodies::stable_step(forces.system(), model, model.mass, constraints, u).dt;
  const double start = forces.stored_energy(u);
  // The energy of central differences oscillates by (omega dt)^2 / 4 about a constant: means over a thousand
  // steps are used.
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
  EXPECT_GT(most_kinetic, 0.3 * start);
}

// Period of a layer held below, free above, that moves along one direction only. Its lowest mode is a quarter
// of a wave, with period 4 H / c.
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
  // Tolerance for lumped masses and nodes 2.5 mm apart on a wave of 80 mm.
  EXPECT_NEAR(pressure, pressure_wave_speed(material), 0.03 * pressure_wave_speed(material));
  EXPECT_NEAR(shear, shear_wave_speed(material), 0.03 * shear_wave_speed(material));
}

TEST(Verification, ASlowPressGivesTheSameForceWithHalfTheTimeStep) {
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
    return energy_error(indent(model, loading, {.safety = safety, .frames = 2, .energy_rate = 200.0}));
  };
  const double whole = error(0.8), quarter = error(0.2);
  RecordProperty("energy_error_0.8", std::to_string(whole));
  RecordProperty("energy_error_0.2", std::to_string(quarter));
  EXPECT_LT(whole, 0.02);
  EXPECT_LT(quarter, 0.5 * whole);
}

TEST(Verification, APressThroughTheBlockStopsAndSaysWhereAndWhatToDo) {
  const Model model = block(6);
  expect_error<SolveError>(
      [&] { indent(model, {.depth = 60e-3, .rate = 1.0}, {.frames = 4}); },  // thrice the block's height
      {.where = "indentation", .remedy = "--depth", .code = "inverted"});
}

}  // namespace
}  // namespace dimple
