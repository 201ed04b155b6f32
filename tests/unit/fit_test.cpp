// Fits of a material to a curve, on numbers alone: no simulation.

#include "apps/studies/fit.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "apps/run/compare.hpp"
#include "apps/run/tool.hpp"
#include "io/error.hpp"
#include "io/table.hpp"
#include "tests/helpers/draw.hpp"
#include "tests/helpers/folder.hpp"
#include "tests/helpers/report.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

std::vector<double> depths(int count) {
  std::vector<double> result;
  for (int k = 1; k <= count; ++k) result.push_back(8e-3 * k / count);
  return result;
}

// Forces for 1 Pa whose curve bends according to `alpha`.
std::vector<double> bent(const std::vector<double>& depth, double alpha) {
  std::vector<double> force;
  for (const double d : depth) force.push_back(0.05 * d * std::exp(20.0 * alpha * d));
  return force;
}

/// Exponent of Ogden's law as an unknown of the fit.
const FitParameter exponent{
    .name = "alpha", .unit = "", .start = 2.0, .least = 0.5, .most = 30.0, .logarithmic = true};

std::vector<double> times(double factor, std::vector<double> force) {
  for (double& f : force) f *= factor;
  return force;
}

std::vector<double> noisy(std::vector<double> force, double sigma, Draw& draw) {
  for (double& f : force) f += sigma * draw.gaussian();
  return force;
}

TEST(Fit, TheErrorBoundsOfNoiseHoldTheModulusIn95Of100Draws) {
  Draw draw{std::mt19937_64(7)};
  for (const int rows : {3, 16, 200}) {
    const std::vector<double> depth = depths(rows), unit = bent(depth, 1.0);
    const std::vector<double> truth = times(300.0, unit);
    int held = 0;
    for (int k = 0; k < 1000; ++k) {
      const CurveFit fit =
          fit_curve(depth, noisy(truth, 0.03 * truth.back(), draw), {}, [&](const auto&) { return unit; });
      held += std::abs(fit.number[0].value - 300.0) <= fit.number[0].noise;
    }
    EXPECT_NEAR(held, 950, 25) << rows << " rows";
  }
}

TEST(Fit, FindsAnExponentInAdditionToTheModulusAndItsErrorBoundsHoldIt) {
  Draw draw{std::mt19937_64(8)};
  const std::vector<double> depth = depths(40);
  const std::vector<double> truth = times(300.0, bent(depth, 4.7));
  const UnitForces model = [&](const std::vector<double>& numbers) { return bent(depth, numbers[0]); };
  const CurveFit exact = fit_curve(depth, truth, {exponent}, model);
  EXPECT_NEAR(exact.number[0].value, 300.0, 0.3);
  EXPECT_NEAR(exact.number[1].value, 4.7, 0.01);
  EXPECT_TRUE(exact.converged);
  EXPECT_LE(exact.runs, 24);
  int held = 0;
  for (int k = 0; k < 400; ++k) {
    const CurveFit fit = fit_curve(depth, noisy(truth, 0.01 * truth.back(), draw), {exponent}, model);
    held += std::abs(fit.number[1].value - 4.7) <= fit.number[1].noise;
  }
  EXPECT_NEAR(held, 380, 14);
}

TEST(Fit, SaysWhatACurveDoesNotDetermine) {
  const std::vector<double> depth = depths(20);
  std::vector<double> truth = bent(depth, 0.0);
  const FitParameter unseen{.name = "g", .unit = "", .start = 0.5, .least = 0.01, .most = 0.99};
  CurveFit blind = fit_curve(depth, truth, {unseen}, [&](const auto&) { return truth; });
  EXPECT_THAT(conclude(blind, true), testing::Contains(HasSubstr("does not determine g")));
  EXPECT_FALSE(blind.number[1].determined);
  // The curve bends less than any of the law.
  CurveFit at_limit = fit_curve(depth, truth, {exponent},
                                [&](const std::vector<double>& numbers) { return bent(depth, numbers[0]); });
  EXPECT_THAT(conclude(at_limit, true), testing::Contains(HasSubstr("ran to its limit")));
}

TEST(Fit, NeverRunsTheModelMoreOftenThanItMay) {
  const std::vector<double> depth = depths(20), truth = bent(depth, 25.0);
  int runs = 0;
  FitParameter low = exponent;
  low.start = 0.6;
  const CurveFit fit = fit_curve(
      depth, truth, {low},
      [&](const std::vector<double>& numbers) { return ++runs, bent(depth, numbers[0]); }, 5);
  EXPECT_LE(runs, 5);
  EXPECT_EQ(fit.runs, runs);
  EXPECT_FALSE(fit.converged);
}

TEST(Fit, ResidualsThatRememberWidenTheErrorBounds) {
  const std::vector<double> depth = depths(100), unit = bent(depth, 1.0);
  std::vector<double> wavy = unit, alternating = unit;
  for (std::size_t k = 0; k < unit.size(); ++k) {
    const double off = 0.02 * unit.back() * std::sin(0.06 * static_cast<double>(k));
    wavy[k] += off;
    alternating[k] += k % 2 == 0 ? off : -off;
  }
  const auto same = [&](const auto&) { return unit; };
  const CurveFit smooth = fit_curve(depth, wavy, {}, same), rough = fit_curve(depth, alternating, {}, same);
  EXPECT_GT(smooth.memory, 0.9);
  EXPECT_LT(rough.memory, 0.0);
  EXPECT_GT(smooth.number[0].noise, 4.0 * rough.number[0].noise);
}

TEST(Fit, AModulusAloneLiesBetweenWhatBothErrorBoundsOfTheForceGive) {
  const std::vector<double> depth = depths(10), unit = bent(depth, 1.0);
  CurveFit fit = fit_curve(depth, unit, {}, [&](const auto&) { return unit; });
  add_discretisation(fit, depth, 0.05);
  EXPECT_NEAR(fit.number[0].value, 1.0, 1e-12);
  EXPECT_NEAR(fit.number[0].discretisation, 1.0 / 0.95 - 1.0, 1e-12);
}

// Force on a round tip at depth d in tissue of 1 Pa.
std::vector<double> of_a_sphere(const std::vector<double>& depth, double indenter = 0.0) {
  std::vector<double> force;
  for (const double d : depth) force.push_back(0.2 * std::pow(std::max(0.0, d - indenter), 1.5));
  return force;
}

TEST(Fit, SaysWhatTheModulusWouldBeHadTheToolMadeContactEarlierOrLater) {
  const std::vector<double> depth = depths(20), unit = of_a_sphere(depth);
  const double off = off_first_contact(depth.back());
  EXPECT_DOUBLE_EQ(off, 1e-4);
  EXPECT_DOUBLE_EQ(off_first_contact(2e-4), 0.5e-4);
  for (const double indenter : {-off, off}) {  // place of first contact of the measured curve, with 300 Pa
    const std::vector<double> measured = times(300.0, of_a_sphere(depth, indenter));
    CurveFit fit = fit_curve(depth, measured, {}, [&](const auto&) { return unit; });
    const double found = fit.number[0].value;
    EXPECT_GT(std::abs(found - 300.0), 4.0);
    const auto model = [&](double at) { return times(found, of_a_sphere(depth, at)); };
    add_first_contact(fit, measured, model(-off), model(off));
    EXPECT_NEAR(indenter < 0.0 ? fit.number[0].earlier : fit.number[0].later, 300.0, 1e-9);
  }
}

TEST(Fit, SeveralNumbersChangeWithTheFirstContactAsASecondFitSays) {
  const std::vector<double> depth = depths(40);
  const auto later_by = [&](double off) {
    std::vector<double> moved = depth;
    for (double& d : moved) d -= off;
    return moved;
  };
  const std::vector<double> measured = times(300.0, bent(depth, 4.7));
  constexpr double off = 1e-5;
  const auto fitted_at = [&](double later) {
    return fit_curve(depth, measured, {exponent},
                     [&](const std::vector<double>& numbers) { return bent(later_by(later), numbers[0]); });
  };
  CurveFit fit = fitted_at(0.0);
  const auto model = [&](double later) {
    return times(fit.number[0].value, bent(later_by(later), fit.number[1].value));
  };
  add_first_contact(fit, measured, model(-off), model(off));
  const CurveFit earlier = fitted_at(-off), later = fitted_at(off);
  for (const std::size_t k : {0u, 1u}) {
    const double up = later.number[k].value - fit.number[k].value;
    EXPECT_NEAR(fit.number[k].later - fit.number[k].value, up, 0.1 * std::abs(up)) << fit.number[k].name;
    EXPECT_NEAR(fit.number[k].earlier - fit.number[k].value, earlier.number[k].value - fit.number[k].value,
                0.1 * std::abs(up));
  }
}

TEST(Fit, FindsTheFirstContactAlsoWhereThatIsTheCurvesZero) {
  Draw draw{std::mt19937_64(9)};
  const std::vector<double> depth = depths(40);
  const double far = 1e3 * farthest_first_contact(depth.back());
  const FitParameter place{
      .name = "touch", .unit = "mm", .start = 0.0, .least = -far, .most = far, .is_place = true};
  const UnitForces model = [&](const std::vector<double>& numbers) {
    return of_a_sphere(depth, 1e-3 * numbers[0]);
  };
  for (const double contact_mm : {-0.4, 0.0, 0.4}) {
    const std::vector<double> truth = times(300.0, of_a_sphere(depth, 1e-3 * contact_mm));
    CurveFit exact = fit_curve(depth, truth, {place}, model, 200);
    EXPECT_NEAR(exact.number[0].value, 300.0, 0.1) << contact_mm;
    EXPECT_NEAR(exact.number[1].value, contact_mm, 1e-3);
    CurveFit rough = fit_curve(depth, noisy(truth, 0.003 * truth.back(), draw), {place}, model, 200);
    EXPECT_THAT(conclude(rough, true), testing::IsEmpty()) << "a place at zero is as good as another";
    EXPECT_NEAR(rough.number[1].value, contact_mm, 2.0 * rough.number[1].noise);
    EXPECT_LT(rough.number[1].noise, 0.2);
  }
  std::vector<double> beyond = of_a_sphere(depth, 2.0 * 1e-3 * far);
  CurveFit at_limit = fit_curve(depth, beyond, {place}, model, 200);
  EXPECT_THAT(conclude(at_limit, true), testing::Contains(HasSubstr("touch ran to its limit")));
}

TEST(Fit, AModulusIsOffByTheFractionOfItsModelsForcesAsTheseWeigh) {
  const std::vector<double> depth = depths(10), unit = of_a_sphere(depth);
  std::vector<double> fraction, wrong = unit;
  for (std::size_t k = 0; k < depth.size(); ++k) {
    fraction.push_back(1e-4 / (depth[k] * 1e3));  // a slight contact is least accurate
    wrong[k] *= 1.0 + fraction[k];
  }
  const CurveFit right = fit_curve(depth, unit, {}, [&](const auto&) { return unit; }),
                 off = fit_curve(depth, unit, {}, [&](const auto&) { return wrong; });
  const double by = weighted_fraction(fraction, unit);
  EXPECT_NEAR(right.number[0].value / off.number[0].value - 1.0, by, 1e-3 * by);
  EXPECT_LT(by, 0.2 * fraction.front());
}

TEST(ContactForces, FollowAPowerOfTheDepthBetweenSamplesBeforeTheFirstAndBeyondTheLast) {
  for (const double power : {1.0, 1.5, 2.2}) {
    std::vector<ForceSample> samples = {{0.0, 0.0, 0.0, 0.0}};
    for (const double d : {0.5e-3, 1e-3, 2e-3}) samples.push_back({0.0, d, 3.0 * std::pow(d, power), 0.0});
    const std::vector<double> depth = {0.1e-3, 0.5e-3, 0.8e-3, 1.9e-3, 2.1e-3},
                              force = contact_forces(samples, depth);
    for (std::size_t k = 0; k < depth.size(); ++k)
      EXPECT_NEAR(force[k] / (3.0 * std::pow(depth[k], power)), 1.0, 1e-12) << depth[k];
  }
  // No contact, or none yet; a single sample follows the law of a round tip.
  EXPECT_THAT(contact_forces({{0.0, 1e-3, 8.0, 0.0}}, {-1e-3, 0.0, 0.25e-3}),
              testing::ElementsAre(0.0, 0.0, testing::DoubleNear(1.0, 1e-12)));
  EXPECT_THAT(contact_forces({{0.0, 0.0, 0.0, 0.0}}, {1e-3}), testing::ElementsAre(0.0));
}

TEST(Fit, RefusesFewerRowsThanItNeedsForcesThatFallAndAModulusThatNoTissueHas) {
  const std::vector<double> depth = depths(10), unit = bent(depth, 1.0);
  const std::vector<double> one = {8e-3};
  EXPECT_THROW(fit_curve(one, {0.1}, {}, [](const auto&) { return std::vector<double>{1.0}; }), InputError);
  for (const double factor : {-1.0, 1e300})
    EXPECT_THROW(fit_curve(depth, times(factor, unit), {}, [&](const auto&) { return unit; }), InputError);
}

// ---------------------------------------------------------------------------------------------- curve files

class CurveFile : public testing::Test {
 protected:
  const fs::path file = fresh_folder() / "measured.csv";
  MeasuredCurve read(const std::string& text) const {
    std::ofstream(file) << text;
    return read_measured_curve(file);
  }
  void refused(const std::string& text, const std::string& word) const {
    SCOPED_TRACE(text);
    const Report report = report_of<InputError>([&] { read(text); });
    EXPECT_THAT(report.fact + report.why, HasSubstr(word));
    EXPECT_FALSE(report.remedy.empty());
  }
};

TEST_F(CurveFile, IsReadInEitherUnitOfForceFromContactToTheLargestDepth) {
  const MeasuredCurve curve =
      read("time_s,indentation_mm,force_mN\n0,-0.5,1\n1,0,0\n2,1,10\n3,2,30\n4,2,29\n5,1,5\n");
  EXPECT_THAT(curve.depth, testing::ElementsAre(1e-3, 2e-3));
  EXPECT_THAT(curve.force, testing::ElementsAre(testing::DoubleEq(0.01), testing::DoubleEq(0.03)));
  EXPECT_THAT(curve.time, testing::ElementsAre(2.0, 3.0));
  EXPECT_THAT(curve.left_out, HasSubstr("2 of 6 rows"));
  EXPECT_EQ(read("indentation_mm;force_N\n1;0.1\n").left_out, "");
}

TEST_F(CurveFile, IsRefusedWithItsReason) {
  refused("indentation_mm,force\n1,1\n", "no column force_N");
  refused("depth_m,force_N\n1,1\n", "no column indentation_mm");
  refused("indentation_mm,force_N,force_mN\n1,1,1000\n", "two columns of one quantity");
  refused("indentation_mm,force_N\n1,0.1\n3,0.3\n2,0.2\n4,0.4\n", "deeper ones follow");
  refused("indentation_mm,force_N\n1,0.1\n1,0.1\n2,0.2\n", "deeper ones follow");
  refused("indentation_mm,force_N\n1,0.1\n0,0\n2,0.2\n", "after deeper ones");
  refused("indentation_mm,force_N\n1,nan\n", "nan");
  refused("indentation_mm,force_N\n0,0\n", "above 0");
  refused("indentation_mm,force_N\n", "above 0");
  refused("indentation_mm,force_N\n1,-0.1\n2,-0.2\n", "resists");
  refused("indentation_mm,force_N\n1000,0.1\n8000,0.2\n", "deep");
}

TEST_F(CurveFile, GivesTheSpeedOfALinearRampWheneverTheClockWasStarted) {
  EXPECT_NEAR(ramp_rate(read("time_s,indentation_mm,force_N\n5,1,1\n5.5,2,2\n6,3,3\n")), 2e-3, 1e-12);
  EXPECT_THROW(ramp_rate(read("time_s,indentation_mm,force_N\n1,1,1\n2,2,2\n3,6,6\n")), InputError);
  EXPECT_THROW(ramp_rate(read("time_s,indentation_mm,force_N\n2,1,1\n1,2,2\n3,6,6\n")), InputError);
  EXPECT_THROW(ramp_rate(read("indentation_mm,force_N\n1,1\n2,2\n")), InputError);
}

// ---------------------------------------------------------------------------------------------- comparison

std::vector<ForceSample> line_to(double depth) {
  std::vector<ForceSample> samples;
  for (int k = 0; k <= 4; ++k) samples.push_back({0.0, depth * k / 4, 10.0 * depth * k / 4, 0.0});
  return samples;
}

TEST(Compare, ReportsHowTheMeasuredForcesAreToOursWhereBothAre) {
  const MeasuredCurve measured{.name = "m.csv", .depth = {1e-3, 2e-3, 5e-3}, .force = {0.012, 0.022, 1.0}};
  ErrorBounds error_bounds{.unknown = "", .half = {0.0, 0.001, 0.002, 0.003, 0.004}};
  const Comparison c = compare(measured, line_to(4e-3), error_bounds);
  EXPECT_EQ(c.force.size(), 2u);
  EXPECT_EQ(c.deeper, 1u);
  EXPECT_NEAR(c.at_end, 1.1, 1e-12);
  EXPECT_NEAR(c.mean, 0.034 / 0.030, 1e-12);
  EXPECT_NEAR(c.rms, 0.002, 1e-12);
  ASSERT_TRUE(c.inside_error_bounds);
  EXPECT_NEAR(*c.inside_error_bounds, 0.5, 1e-12);
  EXPECT_THAT(in_words(c), HasSubstr("measured / ours 1.10 at 2.00 mm, 1.13 on average over 2 depths"));
  EXPECT_THAT(in_words(c), HasSubstr("1 row deeper than this run is not compared"));
  EXPECT_FALSE(compare(measured, line_to(4e-3), {}).inside_error_bounds);
}

TEST(Compare, ThePapersSimulationIsInNoMean) {
  const Comparison c = compare(paper_curve(), line_to(8e-3), {});
  EXPECT_NEAR(c.at_end, (0.181 + 0.125) / 2 / 0.08, 1e-12);
  EXPECT_THAT(in_words(c), HasSubstr("their simulation 1.64"));
  EXPECT_TRUE(compare(paper_curve(), line_to(7e-3), {}).force.empty());
  EXPECT_THAT(in_words(compare(paper_curve(), line_to(7e-3), {})),
              HasSubstr("3 rows deeper than this run are not compared"));
}

}  // namespace
}  // namespace dimple
