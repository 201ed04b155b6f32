#include <gtest/gtest.h>

#include <Eigen/LU>
#include <array>
#include <numbers>
#include <random>

#include "tests/helpers/material.hpp"

namespace dimple::neo_hookean_test {
namespace {

using namespace testing_bodies;

const Material swine_brain = neo_hookean(210.0, 0.499, 1000.0);
const Material softer_to_squeeze = {.mu = 1006.7114, .kappa = 50'000.0, .density = 1000.0};

Mat3 sheared_and_squeezed() {
  return (Mat3() << 0.9, 0.2, -0.1, 0.05, 1.1, 0.15, 0.1, -0.2, 0.97).finished();
}

TEST(NeoHookean, TheBulkModulusFollowsFromPoissonsRatio) {
  EXPECT_NEAR(swine_brain.kappa, 104'930.0,
              1e-6);  // 2 mu (1 + nu) / (3 (1 - 2 nu)), six digits of 1 - 2 nu lost
  EXPECT_NEAR(neo_hookean(300.0, 0.0, 1.0).kappa, 200.0, 1e-12);
}

TEST(NeoHookean, IsStressFreeAtRest) {
  EXPECT_LT(pk1_stress(swine_brain, Mat3::Identity()).cwiseAbs().maxCoeff(), 1e-12 * swine_brain.mu);
  EXPECT_EQ(strain_energy(swine_brain, Mat3::Identity()), 0.0);
}

TEST(NeoHookean, StressIsTheDerivativeOfTheEnergy) {
  // P = F S must equal dW/dF. Central differences in h lose half the digits of W.
  for (const Material& material : {swine_brain, softer_to_squeeze}) {
    const Mat3 F = sheared_and_squeezed();
    const Mat3 P = pk1_stress(material, F);
    const double h = 1e-6;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        SCOPED_TRACE(testing::Message() << "component (" << i << ", " << j << ")");
        Mat3 plus = F, minus = F;
        plus(i, j) += h;
        minus(i, j) -= h;
        const double slope = (strain_energy(material, plus) - strain_energy(material, minus)) / (2.0 * h);
        EXPECT_NEAR(P(i, j), slope, 1e-6 * P.norm());
      }
  }
}

TEST(NeoHookean, NoWorkIsGainedOnAClosedWay) {
  // F(t) round a loop, Gauss points exact for its smoothness: the sum of P : dF is the energy gained.
  std::mt19937 random(17);
  std::uniform_real_distribution<double> part(-0.08, 0.08);
  for (int loop = 0; loop < 10; ++loop) {
    const Mat3 A = Mat3::NullaryExpr([&] { return part(random); });
    const Mat3 B = Mat3::NullaryExpr([&] { return part(random); });
    double gained = 0.0, turned_over = 0.0;
    const int steps = 400;
    for (int k = 0; k < steps; ++k) {
      const double t = 2.0 * std::numbers::pi * k / steps, dt = 2.0 * std::numbers::pi / steps;
      const Mat3 F = Mat3::Identity() + std::sin(t) * A + (1.0 - std::cos(t)) * B;
      const double work =
          pk1_stress(swine_brain, F).cwiseProduct(std::cos(t) * A + std::sin(t) * B).sum() * dt;
      gained += work;
      turned_over += std::abs(work);
    }
    EXPECT_LT(std::abs(gained), 1e-10 * turned_over);
  }
}

TEST(NeoHookean, CauchyStressIsSymmetricAndTurnsWithTheBody) {
  const Mat3 F = sheared_and_squeezed(), sigma = cauchy_stress(swine_brain, F);
  EXPECT_LT((sigma - sigma.transpose()).norm(), 1e-13 * sigma.norm());
  const Mat3 R = (Mat3() << 0, -1, 0, 1, 0, 0, 0, 0, 1).finished();
  EXPECT_LT((cauchy_stress(swine_brain, R * F) - R * sigma * R.transpose()).norm(), 1e-12 * sigma.norm());
}

TEST(NeoHookean, ThePrintedStressIsMuAtRestAndDiffersByItsMissingTerms) {
  Material printed = swine_brain;
  printed.law = PrintedNeoHookean{};
  EXPECT_LT((pk1_stress(printed, Mat3::Identity()) - printed.mu * Mat3::Identity()).norm(),
            1e-12 * printed.mu);
  // S = lambda J (J - 1) C^-1 + mu J^(-2/3) I, as in section 3.3 of the paper.
  const Mat3 F = sheared_and_squeezed(), C = F.transpose() * F;
  const double J = F.determinant(), lambda = 2.0 * 210.0 * 0.499 / 0.002;
  const Mat3 S = lambda * J * (J - 1.0) * C.inverse() + 210.0 * std::pow(J, -2.0 / 3.0) * Mat3::Identity();
  EXPECT_LT((pk1_stress(printed, F) - F * S).norm(), 1e-9 * (F * S).norm());  // lambda's lost digits
}

struct State {
  Vec3 stretch;
  Vec3 nominal;  // principal values of P [Pa]
};

// Roots of the exact equations by bisection: nominal stresses of homogeneous states, eight digits.
TEST(NeoHookean, HomogeneousStatesHaveTheClosedFormStresses) {
  const auto check = [](const Material& material, const State& state) {
    const Mat3 P = pk1_stress(material, state.stretch.asDiagonal());
    // The table gives stretches to 1e-8, which kappa turns into stress.
    const double tolerance = 2e-8 * material.kappa + 1e-8 * state.nominal.norm();
    EXPECT_LT((P.diagonal() - state.nominal).cwiseAbs().maxCoeff(), tolerance) << state.stretch.transpose();
    EXPECT_EQ(P(0, 1), 0.0);
  };
  const auto uniaxial = [](double along, double across, double P) {
    return State{{along, across, across}, {P, 0, 0}};
  };
  for (const State& s : {uniaxial(0.5, 1.41338731, -734.590937), uniaxial(0.7, 1.19485433, -281.420556),
                         uniaxial(0.8, 1.11780652, -160.034907), uniaxial(0.9, 1.05398672, -70.216601),
                         uniaxial(1.1, 0.95355819, 57.403800), uniaxial(1.2, 0.91305541, 106.079134),
                         uniaxial(1.5, 0.81692674, 221.412756), uniaxial(2.0, 0.70792835, 366.809574),
                         State{{0.99, 1, 1}, {-1052.133060, -1037.404635, -1037.404635}},
                         State{{0.95, 1, 1}, {-5261.368254, -4977.112579, -4977.112579}},
                         State{{1.2, 1.2, 0.69532882}, {167.248656, 167.248656, 0}},
                         State{{0.8, 0.8, 1.55875399}, {-470.552306, -470.552306, 0}}})
    check(swine_brain, s);
  for (const State& s : {uniaxial(0.5, 1.40583200, -3503.558363), uniaxial(0.7, 1.19145481, -1342.510586),
                         uniaxial(0.9, 1.05303128, -334.761249), uniaxial(1.5, 0.82073098, 1050.715316),
                         uniaxial(2.0, 0.71503833, 1730.143138),
                         State{{0.95, 1, 1}, {-2571.276385, -2341.143716, -2341.143716}},
                         State{{1.2, 1.2, 0.70307979}, {786.845256, 786.845256, 0}}})
    check(softer_to_squeeze, s);
}

TEST(NeoHookean, SimpleShearHasItsNormalStresses) {
  for (const double gamma : {-0.3, 0.01, 0.4, 1.0}) {
    Mat3 F = Mat3::Identity();
    F(0, 1) = gamma;
    const Mat3 sigma = cauchy_stress(swine_brain, F);
    const double mu = swine_brain.mu, scale = 1e-12 * mu * (1.0 + gamma * gamma);
    EXPECT_NEAR(sigma(0, 1), mu * gamma, scale);
    EXPECT_NEAR(sigma(0, 0), 2.0 / 3.0 * mu * gamma * gamma, scale);
    EXPECT_NEAR(sigma(1, 1), -1.0 / 3.0 * mu * gamma * gamma, scale);
    EXPECT_NEAR(sigma(2, 2), -1.0 / 3.0 * mu * gamma * gamma, scale);
    EXPECT_NEAR(sigma(0, 2), 0.0, scale);
  }
}

TEST(NeoHookean, WavesHaveTheSpeedsOfTheirModuli) {
  EXPECT_NEAR(pressure_wave_speed(swine_brain), 10.257, 5e-4);
  EXPECT_NEAR(shear_wave_speed(swine_brain), 0.4583, 5e-5);
}

}  // namespace
}  // namespace dimple::neo_hookean_test
