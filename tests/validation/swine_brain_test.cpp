// The swine brain of Horton et al. (2007), section 4: 89.9 g, 4250 nodes, 6371 integration points.

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/end_to_end/program.hpp"

namespace dimple {
namespace {

TEST(SwineBrain, HasThePapersSizeAtRestAndResistsTheIndenter) {
  const std::filesystem::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom brain.nrrd").code, 0);
  const Ran ran = dimple(folder,
                         "run brain.nrrd -o out --scheme horton2007 --nodes 4250 --depth 0.5mm --rate 5mm/s "
                         "--frames 1 --json -q");
  ASSERT_EQ(ran.code, 0) << ran.err;
  const auto summary = nlohmann::json::parse(ran.out);
  EXPECT_EQ(summary.at("status"), "finished");
  EXPECT_EQ(summary.at("counts").at("nodes"), 4250);
  EXPECT_NEAR(summary.at("counts").at("integration_points").get<double>(), 6371.0, 0.02 * 6371.0);
  const double organ = summary.at("model").at("organ_volume_mm3").get<double>();
  EXPECT_NEAR(summary.at("volume_mm3").get<double>(), organ, 0.005 * organ);
  EXPECT_GT(summary.at("mass_g").get<double>(), 86.0);
  EXPECT_LT(summary.at("mass_g").get<double>(), 90.0);
  EXPECT_NEAR(summary.at("indentation_mm").get<double>(), 0.5, 1e-9);
  // Half an ellipsoid of the same length, width and height, by axisymmetric finite elements: 10.0 mN/mm at
  // small depth. The paper's scheme has errors of tens of per cent of either sign at this size.
  EXPECT_NEAR(summary.at("force_N").get<double>(), 0.0050, 0.4 * 0.0050);
}

// Half an ellipsoid of this size: 9.90 mN at 1 mm, known to 0.2 %. The phantom differs: it has a fissure on
// top.
TEST(SwineBrain, ResistsAboutAsHalfAnEllipsoidOfItsSize) {
  const std::filesystem::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom brain.nrrd").code, 0);
  const Ran ran = dimple(folder, "run brain.nrrd -o out --depth 1mm --frames 1 --json -q");
  ASSERT_EQ(ran.code, 0) << ran.err;
  EXPECT_NEAR(nlohmann::json::parse(ran.out).at("force_N").get<double>(), 0.00990, 0.1 * 0.00990);
}

}  // namespace
}  // namespace dimple
