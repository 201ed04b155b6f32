// Texts of a run: its headline, and the lines below its picture.

#include "apps/run/run_words.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "apps/run/words.hpp"

namespace dimple {
namespace {

TEST(RunWords, OfASceneOfStepsAreItsLargestForceAndItsLast) {
  EXPECT_EQ(scene_title(0.0452, 1.5, "press", 0.0),
            "largest force 45.2 mN at 1.50 mm (step 'press'), 0 N at the end");
  EXPECT_EQ(scene_title(0.0452, 1.5, "press", 1e-6),
            "largest force 45.2 mN at 1.50 mm (step 'press'), < 0.1 mN at the end");
  EXPECT_EQ(scene_title(0.0452, 2.0, "pull", 0.0452),
            "45.2 mN at 2.00 mm (step 'pull'), the largest force and the last");
  EXPECT_EQ(scene_title(0.0452, 1.5, "press", 0.0, 0.0011),
            "largest force 45.2 mN at 1.50 mm (step 'press'), 0 N at the end, +- 1.1 (discretisation)");
}

TEST(RunWords, BelowThePictureAreModuliContactLoadsSupportsAndSteps) {
  Scene scene;
  Result result;
  result.tissues.material = {neo_hookean(210.0, 0.49, 1000.0)};
  EXPECT_EQ(scene_in_words(scene, result),
            (std::vector<std::string>{"material: neo-Hookean, mu 210 Pa, nu 0.49", "contact: bonded"}));
  result.loading.loads.gravity = Vec3(9.81, 0.0, 0.0);
  result.history.preload_displacement = 0.0299;
  result.loading.further = {{.name = "r", .node = {1, 2}, .hold = HeldSet::Hold::along}};
  result.loading.steps = {{.name = "slide", .moves = "", .displacement = Vec3(0.01, 0.0, 0.0)}};
  const std::vector<std::string> lines = scene_in_words(scene, result);
  ASSERT_EQ(lines.size(), 5u);
  EXPECT_EQ(lines[2], "loads: gravity 9.81 m/s2 (left); preload: largest displacement 29.90 mm");
  EXPECT_EQ(lines[3], "supports: r, 2 nodes sliding");
  EXPECT_EQ(lines[4], "steps: slide: the tool moves by (10, 0, 0) mm");
}

}  // namespace
}  // namespace dimple
