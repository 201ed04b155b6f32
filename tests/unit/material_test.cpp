#include "solver/material.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "io/error.hpp"
#include "tests/helpers/material.hpp"
#include "tests/helpers/report.hpp"

namespace dimple::material_test {
namespace {

using namespace testing_bodies;

const Material swine_brain = neo_hookean(210.0, 0.499, 1000.0);
const Material one_term = ogden({{842.0, -4.7}}, 0.499, 1000.0);
const Material two_terms = ogden({{300.0, -8.0}, {120.0, 3.0}}, 0.49, 1000.0);
/// Ogden's 1972 fit to rubber in this convention, mu_p alpha_p / 2, a thousand times softer.
const Material three_terms = ogden({{409.5, 1.3}, {3.0, 5.0}, {10.0, -2.0}}, 0.49, 1000.0);
const Material two_invariants = mooney_rivlin(60.0, 45.0, 0.499, 1000.0);
const Material limited = gent(120.0, 2.0, 0.499, 1000.0);
const std::array laws{swine_brain, one_term, two_terms, three_terms, two_invariants, limited};
const std::array ogden_laws{one_term, two_terms, three_terms};

const std::vector<OgdenTerm>& terms_of(const Material& m) {
  static const std::vector<OgdenTerm> none;
  const Ogden* law = std::get_if<Ogden>(&m.law);
  return law ? law->terms : none;
}

Material relaxing(Material material) {
  material.prony = {{0.450, 0.5}, {0.365, 50.0}};
  return material;
}

double relaxation(const Material& material, double t) {
  double g = 1.0;
  for (const PronyTerm& term : material.prony) g += term.g * (std::exp(-t / term.tau) - 1.0);
  return g;
}

class Random {
 public:
  explicit Random(unsigned seed) : generator_(seed) {}
  double between(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(generator_);
  }
  Mat3 matrix(double size) {
    return Mat3::NullaryExpr([&] { return between(-size, size); });
  }
  Mat3 rotation() {
    std::normal_distribution<double> normal;
    Eigen::Quaterniond q;
    for (double& part : q.coeffs()) part = normal(generator_);
    return q.normalized().toRotationMatrix();
  }

 private:
  std::mt19937 generator_;
};

/// Two hundred F with J from -0.5 to 3; every fourth has two equal stretches, every fourth three, some J = 0.
std::vector<Mat3> many_deformation_gradients() {
  Random random(29);
  std::vector<Mat3> result;
  while (result.size() < 200) {
    const std::size_t kind = result.size() % 4;
    Vec3 l(random.between(0.3, 1.8), random.between(0.3, 1.8), random.between(-0.6, 1.8));
    if (kind == 1) l[1] = l[0];
    if (kind == 2) l = Vec3::Constant(l[0]).cwiseProduct(Vec3(1, 1, l[2] < 0 && l[0] < 0.75 ? -1 : 1));
    if (result.size() % 20 == 3) l[2] = 0.0;
    if (result.size() % 20 == 7) l[2] = random.between(-0.05, 0.05);
    if (l.prod() <= -0.5 || l.prod() >= 3.0) continue;
    result.push_back(random.rotation() * l.asDiagonal() * random.rotation());
  }
  return result;
}

template <typename Energy>
Mat3 slope_of(const Energy& W, const Mat3& F, double h) {
  Mat3 slope;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      Mat3 plus = F, minus = F;
      plus(i, j) += h;
      minus(i, j) -= h;
      slope(i, j) = (W(plus) - W(minus)) / (2.0 * h);
    }
  return slope;
}

TEST(Material, StressIsTheDerivativeOfTheEnergyAlsoThroughInversion) {
  // The truncation error h^2 and the rounding error 1e-16 / h of W balance near h = 1e-5.
  for (const Material& m : laws)
    for (const Mat3& F : many_deformation_gradients()) {
      const Mat3 P = distortional_stress(m, F), total = pk1_stress(m, F);
      ASSERT_TRUE(P.allFinite());
      const auto distortion = [&](const Mat3& at) { return distortional_energy(m, at); };
      const auto energy = [&](const Mat3& at) { return strain_energy(m, at); };
      const double scale = P.norm() + m.mu;
      EXPECT_LT((P - slope_of(distortion, F, 1e-5)).norm(), 2e-6 * scale) << "J = " << F.determinant();
      EXPECT_LT((total - slope_of(energy, F, 1e-5)).norm(), 2e-6 * (total.norm() + scale))
          << "J = " << F.determinant();
    }
}

TEST(Material, IsFiniteForAnyDeformation) {
  Random random(31);
  for (const Material& m : laws)
    for (const Mat3& F : {Mat3(Mat3::Zero()), Mat3(-Mat3::Identity()), Mat3(-3.0 * Mat3::Identity()),
                          Mat3(Vec3(1, 0, 0).asDiagonal()), Mat3(Vec3(1, 1, 0).asDiagonal()),
                          Mat3(Vec3(1e-9, 1e-9, 1e3).asDiagonal()), random.matrix(10.0)}) {
      EXPECT_TRUE(std::isfinite(strain_energy(m, F)));
      EXPECT_TRUE(pk1_stress(m, F).allFinite());
      EXPECT_TRUE(distortional_second_stress(m, F).allFinite());
    }
}

TEST(Material, AnInvertedPointIsDrivenBack) {
  // The distortional stress alone suffices, without kappa.
  for (const Material& m : {swine_brain, one_term, two_terms, three_terms, two_invariants, limited,
                            ogden({{1430.0, -19.0}}, 0.499, 1000.0)})
    for (const double across : {0.6, 0.8, 1.0, 1.5})
      for (double l = -1.0; l <= 0.1; l += 0.01) {
        const Mat3 F = Vec3(1.0, across, l).asDiagonal();
        EXPECT_LT(distortional_stress(m, F)(2, 2), 0.0) << "stretches 1, " << across << ", " << l;
      }
}

TEST(Material, TheStiffnessIsContinuousWhereTheEnergyIsExtended) {
  const double h = 1e-5;
  for (const Material& m : laws) {
    // Isochoric with one stretch at the limit of a law, or J = 0.05 or 0.2.
    std::vector<Mat3> joints{std::cbrt(0.05) * Mat3::Identity(), std::cbrt(0.2) * Mat3::Identity(),
                             Vec3(1.25, 0.8, 0.2).asDiagonal()};
    if (const Gent* law = std::get_if<Gent>(&m.law)) {  // simple shear has tr C - 3 = gamma^2
      joints.push_back(Mat3::Identity());
      joints.back()(0, 2) = std::sqrt(0.98 * law->limit);
    }
    for (const OgdenTerm& term : terms_of(m)) {
      const double l0 = term.alpha < 0.0 ? std::pow(1e3, 1.0 / (term.alpha - 2.0)) : 0.1;
      joints.push_back(Vec3(2.0, 0.5 / l0, l0).asDiagonal());
    }
    for (const Mat3& F : joints) {
      const Mat3 step = h * Mat3(Vec3(0, 0, 1).asDiagonal());
      const Mat3 P = distortional_stress(m, F);
      const Mat3 above = (distortional_stress(m, F + step) - P) / h;
      const Mat3 below = (P - distortional_stress(m, F - step)) / h;
      // One-sided differences have errors of h times the third derivative, some hundreds of the second.
      EXPECT_LT((above - below).norm(), 1e3 * h * (above.norm() + m.mu)) << F.diagonal().transpose();
    }
  }
}

TEST(Material, GentsLawHasItsClosedFormsAndStiffensTowardsItsLimit) {
  // Gent 1996, with I1 - 3 of each motion: s = mu (...) / (1 - (I1 - 3) / Jm).
  const double mu = limited.mu, Jm = std::get<Gent>(limited.law).limit;
  for (const double l : {0.55, 0.8, 1.0, 1.3, 1.9}) {
    const double across = 1.0 / std::sqrt(l), I1 = l * l + 2.0 / l;
    const Mat3 F = Vec3(l, across, across).asDiagonal(),
               sigma = distortional_stress(limited, F) * F.transpose();
    EXPECT_NEAR(sigma(0, 0) - sigma(1, 1), mu * (l * l - 1.0 / l) / (1.0 - (I1 - 3.0) / Jm), 1e-11 * mu) << l;
    EXPECT_NEAR(distortional_energy(limited, F), -0.5 * mu * Jm * std::log(1.0 - (I1 - 3.0) / Jm), 1e-11 * mu)
        << l;
  }
  for (const double gamma : {-1.2, -0.3, 0.1, 0.9, 1.39}) {
    Mat3 F = Mat3::Identity();
    F(0, 1) = gamma;
    const Mat3 sigma = distortional_stress(limited, F) * F.transpose();
    EXPECT_NEAR(sigma(0, 1), mu * gamma / (1.0 - gamma * gamma / Jm),
                1e-11 * mu / (1.0 - gamma * gamma / Jm));
  }
  for (const double l : {0.4, 0.7, 1.2, 2.0}) {  // confined
    const double x = std::pow(l, -2.0 / 3.0) * (2.0 + l * l) - 3.0;
    const double slope = -2.0 / 3.0 * std::pow(l, -5.0 / 3.0) * (2.0 + l * l) + 2.0 * std::cbrt(l);
    const Mat3 F = Vec3(1.0, 1.0, l).asDiagonal();
    EXPECT_NEAR(distortional_stress(limited, F)(2, 2), 0.5 * mu * slope / (1.0 - x / Jm), 1e-11 * mu) << l;
  }
  // Without a limit it is neo-Hookean; beyond its limit the stress grows on and stays finite.
  const Mat3 F = Vec3(1.2, 0.9, 1.0).asDiagonal();
  EXPECT_LT((distortional_stress(gent(120.0, 1e9, 0.499, 1000.0), F) -
             distortional_stress(neo_hookean(120.0, 0.499, 1000.0), F))
                .norm(),
            1e-6 * mu);
  double last = 0.0;
  for (double gamma = 1.3; gamma < 3.0; gamma += 0.05) {
    Mat3 at = Mat3::Identity();
    at(0, 1) = gamma;
    const double stress = (distortional_stress(limited, at) * at.transpose())(0, 1);
    EXPECT_GT(stress, last);
    last = stress;
  }
}

TEST(Material, IsStressFreeAtRest) {
  for (const Material& m : laws) {
    EXPECT_LT(pk1_stress(m, Mat3::Identity()).norm(), 1e-12 * m.mu);
    EXPECT_LT(distortional_second_stress(m, Mat3::Identity()).norm(), 1e-12 * m.mu);
    EXPECT_EQ(strain_energy(m, Mat3::Identity()), 0.0);
  }
}

TEST(Material, KnowsNoDirectionOfSpaceNorOfItself) {
  Random random(37);
  for (const Material& m : laws)
    for (const Mat3& F : many_deformation_gradients()) {
      const Mat3 R = random.rotation(), Q = random.rotation(), P = distortional_stress(m, F);
      const double rounding =
          1e-10 * (P.norm() + m.mu);  // of the powers, |alpha| to the second at small stretches
      EXPECT_LT((distortional_stress(m, R * F) - R * P).norm(), rounding);
      EXPECT_LT((distortional_stress(m, F * Q) - P * Q).norm(), rounding);
      EXPECT_LT((P * F.transpose() - F * P.transpose()).norm(), rounding);  // J sigma is symmetric
      EXPECT_NEAR(distortional_energy(m, R * F * Q), distortional_energy(m, F),
                  1e-10 * (distortional_energy(m, F) + m.mu));
    }
}

TEST(Material, TheSecondStressIsTheFirstPulledBack) {
  for (const Material& m : laws)
    for (const Mat3& F : many_deformation_gradients()) {
      const Mat3 S = distortional_second_stress(m, F), P = distortional_stress(m, F);
      EXPECT_LT((S - S.transpose()).norm(), 1e-12 * (S.norm() + m.mu));
      if (std::abs(F.determinant()) < 0.05) continue;
      EXPECT_LT((F * S - P).norm(), 1e-10 * (S.norm() + m.mu)) << "J = " << F.determinant();
    }
}

TEST(Material, AnOgdenTermOfExponentTwoAndTheFirstInvariantAloneAreNeoHookean) {
  for (const Material& same :
       {ogden({{210.0, 2.0}}, 0.499, 1000.0), mooney_rivlin(105.0, 0.0, 0.499, 1000.0)}) {
    EXPECT_EQ(same.mu, swine_brain.mu);
    EXPECT_EQ(same.kappa, swine_brain.kappa);
    for (const Mat3& F : many_deformation_gradients()) {
      const Mat3 P = distortional_stress(swine_brain, F);
      EXPECT_LT((distortional_stress(same, F) - P).norm(), 1e-12 * (P.norm() + same.mu));
      EXPECT_NEAR(distortional_energy(same, F), distortional_energy(swine_brain, F),
                  1e-12 * (distortional_energy(swine_brain, F) + same.mu));
    }
  }
}

// P_i = mu J^(-2/3) (l_i - I_1 / (3 l_i)) + kappa J (J - 1) / l_i; a force-free state is a root of it.
TEST(NeoHookean, PrincipalStressesHaveTheirClosedForm) {
  Random random(53);
  for (const Material& m : {swine_brain, Material{.mu = 1006.7114, .kappa = 50'000.0, .density = 1000.0}})
    for (int k = 0; k < 100; ++k) {
      const Vec3 l(random.between(0.6, 2.0), random.between(0.6, 2.0), random.between(0.6, 2.0));
      const double J = l.prod();
      const Vec3 distortion = m.mu * std::pow(J, -2.0 / 3.0) * (l - l.squaredNorm() / 3.0 * l.cwiseInverse()),
                 dilation = m.kappa * J * (J - 1.0) * l.cwiseInverse();
      const Mat3 P = pk1_stress(m, l.asDiagonal());
      EXPECT_LT((P - Mat3((distortion + dilation).asDiagonal())).norm(), 1e-12 * (m.mu + dilation.norm()));
    }
}

TEST(NeoHookean, ThePrintedStressIsMuAtRestAndDiffersByItsMissingTerms) {
  Material printed = swine_brain;
  printed.law = PrintedNeoHookean{};
  EXPECT_LT((pk1_stress(printed, Mat3::Identity()) - printed.mu * Mat3::Identity()).norm(),
            1e-12 * printed.mu);
  // Reference: S = lambda J (J - 1) C^-1 + mu J^(-2/3) I, as in section 3.3 of the paper.
  const Mat3 F = (Mat3() << 0.9, 0.2, -0.1, 0.05, 1.1, 0.15, 0.1, -0.2, 0.97).finished();
  const Mat3 C = F.transpose() * F;
  const double J = F.determinant(), lambda = 2.0 * 210.0 * 0.499 / 0.002;
  const Mat3 S = lambda * J * (J - 1.0) * C.inverse() + 210.0 * std::pow(J, -2.0 / 3.0) * Mat3::Identity();
  EXPECT_LT((pk1_stress(printed, F) - F * S).norm(), 1e-9 * (F * S).norm());  // lambda's lost digits
}

TEST(NeoHookean, WavesHaveTheSpeedsOfTheirModuli) {
  EXPECT_NEAR(pressure_wave_speed(swine_brain), 10.257, 5e-4);
  EXPECT_NEAR(shear_wave_speed(swine_brain), 0.4583, 5e-5);
}

/// Nominal stresses of an incompressible body, free of force along the third axis.
Vec3 nominal(const Material& m, const Vec3& l) {
  const Vec3 P = distortional_stress(m, l.asDiagonal()).diagonal();
  const double pressure = l[2] * P[2];
  return P - pressure * l.cwiseInverse();
}

template <typename Term>
double sum_of(const Material& m, const Term& term) {
  double sum = 0.0;
  for (const OgdenTerm& t : terms_of(m)) sum += 2.0 * t.mu / t.alpha * term(t.alpha);
  return sum;
}

TEST(Material, IncompressibleStatesHaveOgdensClosedForms) {
  for (const Material& m : ogden_laws)
    for (const double l : {0.4, 0.6, 0.7, 0.9, 0.999, 1.1, 1.35, 2.0}) {
      if (&m != &ogden_laws.back() && (l < 0.55 || l > 1.35)) continue;  // there the energy is extended
      SCOPED_TRACE(testing::Message() << terms_of(m).size() << " terms, stretch " << l);
      const auto difference = [&](double of) {
        return [=](double a) { return std::pow(l, a - 1.0) - std::pow(l, of * a - 1.0); };
      };
      const double uniaxial = sum_of(m, difference(-0.5)), equibiaxial = sum_of(m, difference(-2.0));
      const double pure_shear = sum_of(m, difference(-1.0));
      const double across = sum_of(m, [&](double a) { return 1.0 - std::pow(l, -a); });
      const double rounding = 1e-12 * m.mu * std::pow(std::min(l, 1.0 / (l * l)), -10.0);

      EXPECT_NEAR(nominal(m, {l, 1.0 / std::sqrt(l), 1.0 / std::sqrt(l)})[0], uniaxial, rounding);
      EXPECT_NEAR(nominal(m, {l, l, 1.0 / (l * l)})[0], equibiaxial, rounding);
      EXPECT_NEAR(nominal(m, {l, 1.0, 1.0 / l})[0], pure_shear, rounding);
      EXPECT_NEAR(nominal(m, {l, 1.0, 1.0 / l})[1], across, rounding);
    }
}

TEST(Material, IncompressibleStatesHaveMooneysAndRivlinsClosedForms) {
  const double c10 = 60.0, c01 = 45.0;
  EXPECT_EQ(two_invariants.mu, 210.0);
  EXPECT_EQ(two_invariants.kappa, swine_brain.kappa);
  for (const double l : {0.4, 0.6, 0.9, 0.999, 1.1, 1.35, 2.0, 3.0}) {
    SCOPED_TRACE(l);
    const double l2 = l * l, rounding = 1e-11 * two_invariants.mu * std::max(l2, 1.0 / (l2 * l2 * l));
    EXPECT_NEAR(nominal(two_invariants, {l, 1.0 / std::sqrt(l), 1.0 / std::sqrt(l)})[0],
                2.0 * (c10 + c01 / l) * (l - 1.0 / l2), rounding);
    EXPECT_NEAR(nominal(two_invariants, {l, l, 1.0 / l2})[0],
                2.0 * (c10 + c01 * l2) * (l - 1.0 / (l2 * l2 * l)), rounding);
    EXPECT_NEAR(nominal(two_invariants, {l, 1.0, 1.0 / l})[0], 2.0 * (c10 + c01) * (l - 1.0 / (l2 * l)),
                rounding);
  }
}

TEST(Material, SaysItsLawAndItsNumbers) {
  EXPECT_EQ(words_of(swine_brain).name, "neo-hookean");
  EXPECT_TRUE(words_of(swine_brain).terms.empty());
  EXPECT_EQ(words_of(neo_hookean(210.0, 0.499, 1000.0, true)).title, "neo-Hookean as printed");
  const LawWords two = words_of(two_terms);
  EXPECT_EQ(two.name, "ogden");
  ASSERT_EQ(two.terms.size(), 2u);
  EXPECT_EQ(two.terms[1][0], (std::pair<std::string, double>("mu_Pa", 120.0)));
  EXPECT_EQ(two.terms[1][1], (std::pair<std::string, double>("alpha", 3.0)));
  EXPECT_EQ(words_of(two_invariants).terms.at(0).at(0).second, 60.0);
}

TEST(Material, SmallStrainsSeeTheSumOfTheModuli) {
  const double small = 1e-6;  // relative difference of the answers
  for (const Material& m : laws) {
    Mat3 sheared = Mat3::Identity();
    sheared(0, 1) = small;
    EXPECT_NEAR(pk1_stress(m, sheared)(0, 1) / small, m.mu, 1e-5 * m.mu);
    EXPECT_NEAR(pk1_stress(m, (1.0 + small) * Mat3::Identity())(0, 0) / (3.0 * small), m.kappa,
                1e-5 * m.kappa);
  }
  EXPECT_DOUBLE_EQ(three_terms.mu, 422.5);
  EXPECT_NEAR(one_term.kappa, 2.0 * 842.0 * 1.499 / (3.0 * 0.002), 1e-6);
}

/// Work done on a loop F(t) = I + sin t A + (1 - cos t) B, and the sum of the sizes of its parts.
template <typename Stress>
std::array<double, 2> work_round_a_loop(const Stress& P, const Mat3& A, const Mat3& B, int steps) {
  std::array<double, 2> work{};
  for (int k = 0; k < steps; ++k) {
    const double t = 2.0 * std::numbers::pi * k / steps, dt = 2.0 * std::numbers::pi / steps;
    const Mat3 F = Mat3::Identity() + std::sin(t) * A + (1.0 - std::cos(t)) * B;
    const double part = P(F).cwiseProduct(std::cos(t) * A + std::sin(t) * B).sum() * dt;
    work[0] += part;
    work[1] += std::abs(part);
  }
  return work;
}

TEST(Material, NoWorkIsGainedOnAClosedPath) {
  Random random(17);
  for (const Material& m : laws) {
    const auto P = [&](const Mat3& F) { return pk1_stress(m, F); };
    for (int loop = 0; loop < 10; ++loop) {  // smooth and periodic: the rectangle rule has every digit
      const auto [gained, turned_over] = work_round_a_loop(P, random.matrix(0.08), random.matrix(0.08), 400);
      EXPECT_LT(std::abs(gained), 1e-10 * turned_over);
    }
    // This loop goes through inversion, where the stress has two derivatives only: J falls to -1.
    const Mat3 A = random.matrix(0.3), B = random.matrix(0.1) - Mat3(Vec3(1, 0, 0).asDiagonal());
    const auto [gained, turned_over] = work_round_a_loop(P, A, B, 4000);
    EXPECT_LT(std::abs(gained), 1e-7 * turned_over);
  }
}

/// Drives one point of a viscoelastic solid and returns its stress at the end of every step.
struct Specimen {
  ViscousHistory history;

  explicit Specimen(const Material& m) : history(m, 1) {}
  Mat3 stress(const Mat3& F) const {
    return history.step.c * distortional_stress(history.material, F) + F * history.K(0);
  }
  Mat3 advance(double dt, const Mat3& F) {
    history.begin_step(dt);
    const Mat3 P = stress(F);
    history.accept(0, F);
    return P;
  }
};

const Mat3 squeezed = (Mat3() << 0.8, 0.3, 0.0, 0.0, 1.1, -0.2, 0.1, 0.0, 1.05).finished();

TEST(Viscoelasticity, StressRelaxesAsThePronySeriesSays) {
  for (const Material& m : laws) {
    Specimen specimen(relaxing(m));
    const Mat3 P0 = distortional_stress(m, squeezed);
    EXPECT_LT((specimen.advance(0.0, squeezed) - P0).norm(), 1e-12 * P0.norm());
    double t = 0.0;
    for (const double dt : {1e-6, 0.01, 0.5, 0.5, 3.0, 100.0, 1e4}) {  // exact for any step
      t += dt;
      const Mat3 P = specimen.advance(dt, squeezed);
      EXPECT_LT((P - relaxation(specimen.history.material, t) * P0).norm(), 1e-12 * P0.norm()) << "at " << t;
    }
  }
}

TEST(Viscoelasticity, ARampHasTheHereditaryIntegralOfItsRate) {
  // tau = mu rate (g_inf t + sum g_i tau_i (1 - exp(-t / tau_i))); strains of 1e-6 give six digits and more.
  const double rate = 1e-6, duration = 1.0;
  for (const Material& elastic : laws)
    for (const int steps : {1, 7, 100}) {
      const Material m = relaxing(elastic);
      Specimen specimen(m);
      for (int k = 1; k <= steps; ++k) {
        const double t = duration * k / steps;
        double integral = relaxation(m, std::numeric_limits<double>::infinity()) * t;
        for (const PronyTerm& term : m.prony) integral += term.g * term.tau * (1.0 - std::exp(-t / term.tau));
        Mat3 F = Mat3::Identity();
        F(0, 1) = rate * t;
        const double tau = specimen.advance(duration / steps, F)(0, 1);
        EXPECT_NEAR(tau, m.mu * rate * integral, 1e-5 * m.mu * rate * integral);
      }
    }
}

TEST(Viscoelasticity, ManyStepsAndFewAgreeToTheSecondOrder) {
  const auto end_of = [](const Material& m, int steps) {
    Specimen specimen(m);
    Mat3 P = Mat3::Zero();
    for (int k = 1; k <= steps; ++k) {
      const double s = static_cast<double>(k) / steps;
      P = specimen.advance(2.0 / steps, Mat3::Identity() + s * s * (squeezed - Mat3::Identity()));
    }
    return P;
  };
  for (const Material& elastic : laws) {
    const Material m = relaxing(elastic);
    const Mat3 exact = end_of(m, 5120);
    const double coarse = (end_of(m, 20) - exact).norm(), fine = (end_of(m, 40) - exact).norm();
    EXPECT_LT(coarse, 2e-3 * exact.norm());
    EXPECT_NEAR(coarse / fine, 4.0, 0.2);
  }
}

TEST(Viscoelasticity, CyclesAreLossyAtAnyFrequency) {
  Random random(41);
  for (const Material& elastic : laws)
    for (const double period : {1e-3, 0.1, 3.0, 300.0, 1e5}) {
      Specimen specimen(relaxing(elastic));
      const Mat3 A = random.matrix(0.15), B = random.matrix(0.15);
      const int steps = 200;
      for (int cycle = 0; cycle < 3; ++cycle) {
        double work = 0.0, turned_over = 0.0;
        Mat3 F = Mat3::Identity(), P = specimen.stress(F);
        for (int k = 1; k <= steps; ++k) {
          const double t = 2.0 * std::numbers::pi * k / steps;
          const Mat3 next = Mat3::Identity() + std::sin(t) * A + (1.0 - std::cos(t)) * B;
          const Mat3 P_next = specimen.advance(period / steps, next);
          const double part = 0.5 * (P + P_next).cwiseProduct(next - F).sum();
          work += part;
          turned_over += std::abs(part);
          F = next;
          P = P_next;
        }
        EXPECT_GT(work, period == 0.1 || period == 3.0 ? 0.0 : -1e-3 * turned_over)  // 200 trapezia
            << "period " << period;
      }
    }
}

TEST(Viscoelasticity, SmallCyclesLoseWhatTheLossModulusSays) {
  // Dissipation per cycle and volume, after transients: pi gamma^2 mu sum_i g_i w tau_i / (1 + (w tau_i)^2).
  Material m = neo_hookean(842.0, 0.499, 1000.0);
  m.prony = {{0.3, 0.5}, {0.2, 0.05}};
  const double gamma = 1e-5, omega = 4.0;
  double loss = 0.0;
  for (const PronyTerm& term : m.prony)
    loss += std::numbers::pi * gamma * gamma * m.mu * term.g * omega * term.tau /
            (1.0 + omega * omega * term.tau * term.tau);

  Specimen specimen(m);
  const int steps = 2000;
  double work = 0.0, tau = 0.0;
  for (int cycle = 0; cycle < 10; ++cycle) {
    work = 0.0;
    for (int k = 1; k <= steps; ++k) {
      const double before = gamma * std::sin(2.0 * std::numbers::pi * (k - 1) / steps);
      Mat3 F = Mat3::Identity();
      F(0, 1) = gamma * std::sin(2.0 * std::numbers::pi * k / steps);
      const double now = specimen.advance(2.0 * std::numbers::pi / omega / steps, F)(0, 1);
      work += 0.5 * (tau + now) * (F(0, 1) - before);
      tau = now;
    }
  }
  EXPECT_NEAR(work, loss, 1e-4 * loss);
}

TEST(Viscoelasticity, NoTimeIsInstantaneousAndAllTimeIsRelaxed) {
  const Material m = relaxing(one_term);
  const PronyStep none = prony_step(m, 0.0);
  EXPECT_EQ(none.c, 1.0);
  EXPECT_THAT(none.e, testing::ElementsAre(1.0, 1.0));
  EXPECT_THAT(none.ga, testing::ElementsAre(0.450, 0.365));

  const PronyStep all = prony_step(m, std::numeric_limits<double>::infinity());
  EXPECT_NEAR(all.c, 0.185, 1e-15);
  EXPECT_THAT(all.e, testing::ElementsAre(0.0, 0.0));
  EXPECT_THAT(all.ga, testing::ElementsAre(0.0, 0.0));

  const PronyStep short_one = prony_step(m, 1e-12);  // no digits lost in 1 - exp(-x)
  EXPECT_NEAR(1.0 - short_one.c, 0.5e-12 * (0.450 / 0.5 + 0.365 / 50.0), 1e-15);

  Specimen specimen(m);
  specimen.advance(0.0, squeezed);
  const Mat3 P0 = distortional_stress(m, squeezed);
  const Mat3 relaxed = specimen.advance(std::numeric_limits<double>::infinity(), squeezed);
  EXPECT_LT((relaxed - 0.185 * P0).norm(), 1e-12 * P0.norm());
}

TEST(Viscoelasticity, WithoutAPronySeriesItIsElasticity) {
  Specimen specimen(one_term);
  for (const double dt : {0.0, 0.1, 1e6}) {
    const Mat3 P = specimen.advance(dt, squeezed);
    EXPECT_EQ(P, distortional_stress(one_term, squeezed));
  }
}

TEST(Viscoelasticity, AStepMayBeTriedAgainWithAnotherLength) {
  Specimen once(relaxing(one_term)), twice(relaxing(one_term));
  once.advance(0.3, squeezed);
  twice.advance(0.3, squeezed);
  twice.history.begin_step(10.0);
  twice.stress(2.0 * squeezed);
  EXPECT_EQ(once.advance(0.2, Mat3::Identity()), twice.advance(0.2, Mat3::Identity()));
}

TEST(Viscoelasticity, AStepsStressIsTheDerivativeOfItsEnergy) {
  for (const Material& elastic : laws) {
    const Material m = relaxing(elastic);
    Specimen specimen(m);
    specimen.advance(0.3, squeezed);
    specimen.history.begin_step(0.2);
    const Mat3 K = specimen.history.K(0), F = squeezed.transpose();
    const auto energy = [&](const Mat3& at) {
      return specimen.history.step.c * distortional_energy(m, at) +
             0.5 * K.cwiseProduct(at.transpose() * at).sum();
    };
    EXPECT_LT((specimen.stress(F) - slope_of(energy, F, 1e-5)).norm(),
              1e-7 * (specimen.stress(F).norm() + m.mu));
  }
}

TEST(Viscoelasticity, ATurnOfTheBodyTurnsItsStressAndItsPast) {
  Random random(43);
  const Material m = relaxing(one_term);
  const Mat3 R = random.rotation();
  Specimen still(m), turning(m);
  still.advance(0.4, squeezed);
  turning.advance(0.4, squeezed);
  const Mat3 P = still.advance(0.4, squeezed), turned = turning.advance(0.4, R * squeezed);
  EXPECT_LT((turned - R * P).norm(), 1e-12 * P.norm());
}

TEST(MaterialPreset, HasThePapersNumbers) {
  const Material horton = material_from(numbers_of_preset("horton_2007"));
  EXPECT_EQ(horton.mu, 210.0);
  EXPECT_NEAR(horton.kappa, 104'930.0, 1e-6);
  EXPECT_TRUE(std::holds_alternative<NeoHookean>(horton.law) && horton.prony.empty());

  const Material miller = material_from(numbers_of_preset("miller_chinzei_2002"));
  EXPECT_EQ(miller.mu, 842.0);
  EXPECT_EQ(terms_of(miller).at(0).alpha, -4.7);
  EXPECT_NEAR(relaxation(miller, std::numeric_limits<double>::infinity()), 0.185, 1e-15);
}

TEST(MaterialPreset, AnUnknownNameIsAnsweredWithAllNames) {
  expect_error<UsageError>([] { numbers_of_preset("jelly"); },
                           {.fact = "jelly", .remedy = "horton_2007, miller_chinzei_2002"});
}

}  // namespace
}  // namespace dimple::material_test
