#include "apps/run/verdict.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "apps/run/report.hpp"

namespace dimple {
namespace {

using Json = nlohmann::ordered_json;

LabelMeasure label_of(double volume_mm3) {
  LabelMeasure label;
  label.volume_mm3 = volume_mm3;
  return label;
}

// A body of 1000 mm3 whose run ended well: every word is "good".
Result good_run() {
  Result result;
  result.labels.push_back(label_of(1000.0));
  result.segment.voxel_volume_mm3 = 1000.0;
  result.model.X = Points::Zero(3, 2000);
  result.model.volume = Eigen::VectorXd::Constant(10, 100e-9);
  result.history.force = {{0.0, 0.0, 0.0, 0.0}, {1.0, 1e-3, 0.05, 0.05}};
  result.error_bounds.unknown.clear();
  result.error_bounds.half = {0.0, 0.002};
  return result;
}

std::string words(const Result& result, const Scene& scene = {}, const std::string& status = "finished") {
  std::string all;
  for (const auto& answer : verdict_of(scene, result, status)) all += answer["word"].get<std::string>() + " ";
  return all;
}

Finding finding(const std::string& code) {
  Finding fired;
  fired.report.code = code;
  return fired;
}

TEST(Verdict, IsGoodWhereNothingSpeaksAgainstIt) {
  EXPECT_EQ(words(good_run()), "good good good good good ");
  EXPECT_NEAR(verdict_of({}, good_run(), "finished")["accuracy"]["value"].get<double>(), 4.0, 1e-12);
}

TEST(Verdict, AGuardSpeaksToItsOwnQuestionAlone) {
  const std::pair<const char*, const char*> guards[] = {{"supports", "good check good good good "},
                                                        {"limit-point", "good good check good good "},
                                                        {"penetration", "good good check good good "},
                                                        {"tool-penetration", "good good check good good "},
                                                        {"wall-penetration", "good good check good good "},
                                                        {"tool-left", "good good check good good "},
                                                        {"energy", "good good good check good "}};
  for (const auto& [code, expected] : guards) {
    Result result = good_run();
    result.findings.push_back(finding(code));
    EXPECT_EQ(words(result), expected) << code;
    result.findings.back().is_minor = true;
    EXPECT_EQ(words(result), words(good_run())) << code;
  }
}

TEST(Verdict, AFewInvertedPointsAtAPatchEdgeAreNoReasonButARetryForThemIs) {
  Result result = good_run();
  result.findings.push_back(finding("inverted"));
  EXPECT_EQ(words(result), "good good good good good ");
  result.history.retries.push_back({"inverted", 1e-3, "a smaller step"});
  EXPECT_EQ(words(result), "good good check good good ");
}

TEST(Verdict, PointsWithoutStressAreCountedAndTheModelIsNotGood) {
  Result result = good_run();
  result.findings.push_back(finding("stress"));
  result.findings.back().worst = 12.0;
  result.findings.back().is_minor = true;
  EXPECT_EQ(words(result), "good check good good good ");
  EXPECT_EQ(verdict_of({}, result, "finished")["model"]["reasons"],
            Json({"12 points without stress: det F below 0.2"}));
}

TEST(Verdict, APartOfTheLabelsThatIsNotInTheBodyIsToBeLookedAt) {
  Result result = good_run();
  result.labels.push_back(label_of(50.0));  // 4.8 % are not in it
  EXPECT_EQ(words(result), "good good good good good ");
  result.labels.push_back(label_of(10.0));  // 5.7 %
  EXPECT_EQ(words(result), "check good good good good ");
}

TEST(Verdict, MoreThanWasLabelledIsSaidToBeWhatWasFilledAndClosed) {
  const auto of = [](const Result& r) {
    return verdict_of({}, r, "finished")["image"]["of"].get<std::string>();
  };
  Result result = good_run();
  EXPECT_EQ(of(result), "of the labelled volume is in the body");
  result.segment.voxel_volume_mm3 = 1010.0;
  result.segment.cavities.push_back({.volume_mm3 = 8.0, .centre_mm = Vec3::Zero(), .filled = true});
  result.segment.cavities.push_back({.volume_mm3 = 500.0, .centre_mm = Vec3::Zero(), .filled = false});
  result.closed_mm3 = 2.0;
  EXPECT_EQ(of(result), "of the labelled volume: 8.00 mm3 of cavities filled, 2.00 mm3 of gaps closed");
  result.segment.dropped_volume_mm3 = 1500.0;
  EXPECT_EQ(of(result).substr(of(result).rfind(',')), ", 1.50 cm3 of other pieces dropped");
}

// The order and direction of a body's axes are arbitrary.
TEST(Report, AxesAreTurnedByWhatIsObliqueAndNotByTheirOrder) {
  Mat3 swapped;
  swapped << 0, 0, -1, 1, 0, 0, 0, 1, 0;
  EXPECT_NEAR(tilt_degrees(Mat3::Identity()), 0.0, 1e-6);
  EXPECT_NEAR(tilt_degrees(swapped), 0.0, 1e-6);
  const Mat3 turn = Eigen::AngleAxisd(0.2, Vec3(1.0, 2.0, 3.0).normalized()).toRotationMatrix();
  EXPECT_NEAR(tilt_degrees(turn), tilt_degrees(turn * swapped), 1e-6);
  const Mat3 about_x = Eigen::AngleAxisd(0.2, Vec3::UnitX()).toRotationMatrix();
  EXPECT_NEAR(tilt_degrees(about_x * swapped), 0.2 * 180.0 / M_PI, 1e-6);
}

TEST(Verdict, IntegrationPointsMustFillTheBody) {
  Result result = good_run();
  result.model.volume *= 0.994;
  EXPECT_EQ(words(result), "good check good good good ");
}

TEST(Verdict, ErrorBoundsAreToBeLookedAtAboveATenthAndBadAboveAQuarterOfTheForce) {
  Result result = good_run();
  result.error_bounds.half.back() = 0.0049;
  EXPECT_EQ(words(result), "good good good good good ");
  result.error_bounds.half.back() = 0.0051;
  EXPECT_EQ(words(result), "good good good good check ");
  result.error_bounds.half.back() = 0.0126;
  EXPECT_EQ(words(result), "good good good good bad ");
}

TEST(Verdict, HoldsErrorBoundsToTheRequestedAccuracy) {
  Scene scene;
  scene.goal = Goal{.text = "3%", .fraction = 0.03};
  EXPECT_EQ(words(good_run(), scene), "good good good good check ");
  scene.goal = Goal{.text = "2.1mN", .absolute = 2.1e-3};
  EXPECT_EQ(words(good_run(), scene), "good good good good good ");
}

TEST(Verdict, WithoutErrorBoundsSaysWhyThereAreNone) {
  Result result = good_run();
  result.error_bounds.unknown = "supports are other than the default";
  const Json accuracy = verdict_of({}, result, "finished")["accuracy"];
  EXPECT_EQ(accuracy["word"], "check");
  EXPECT_EQ(accuracy["reasons"], Json::array({"supports are other than the default"}));
  EXPECT_EQ(accuracy["value"], 2000.0);
  EXPECT_EQ(accuracy["unit"], "nodes");
}

TEST(Verdict, ARunThatFailedIsNotInEquilibrium) {
  EXPECT_EQ(words(good_run(), {}, "failed"), "good good bad good good ");
  EXPECT_EQ(words(good_run(), {}, "interrupted"), "good good check good good ");
}

TEST(Verdict, WithoutAnEquilibriumHasNoNumberOfHowFarItWasFromOne) {
  Result result = good_run();
  EXPECT_TRUE(verdict_of({}, result, "failed")["equilibrium"]["value"].is_number())
      << "of those that were found";
  result.history.force.resize(1);  // at rest
  EXPECT_TRUE(verdict_of({}, result, "failed")["equilibrium"]["value"].is_null());
}

TEST(Verdict, ANumberThatIsNoneIsNeverGood) {
  Result result = good_run();
  result.model.volume[0] = std::nan("");
  result.error_bounds.half.back() = std::nan("");
  EXPECT_EQ(words(result), "good check good good bad ");
}

TEST(Verdict, InDynamicsTheBaseMustCarryWhatTheToolPresses) {
  Result result = good_run();
  result.time = TimeMode::explicit_;
  result.history.force.back().base_force = 0.04;
  const auto equilibrium = verdict_of({}, result, "finished")["equilibrium"];
  EXPECT_NEAR(equilibrium["value"].get<double>(), 20.0, 1e-12);
  EXPECT_EQ(equilibrium["word"], "check") << "a fifth of the force is inertia";
  result.history.force.back().base_force = 0.048;
  EXPECT_EQ(verdict_of({}, result, "finished")["equilibrium"]["word"], "good");
  result.history.force.back().depth = 1e-3;
  result.history.force.back().force = result.history.force.back().base_force = -0.05;
  EXPECT_EQ(verdict_of({}, result, "finished")["equilibrium"]["word"], "check") << "it pulls the tool in";
}

}  // namespace
}  // namespace dimple
