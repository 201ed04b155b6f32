// Contacts that are small beside the tool and the body, with the nodes that the program takes by itself,
// against finite elements (reference/contact.py small).

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>

#include "tests/verification/pressed_cylinder.hpp"

namespace dimple {
namespace {

using namespace pressed_cylinder;

// Errors of the force by depth [mm]. The sphere comes along a line that is `tilt` [degrees] off the normal:
// without friction it goes into a large body by the share cos(tilt) of its way, and its force has that share
// along the push.
std::map<double, double> errors(const SmallContact& known, double tilt) {
  const double cosine = std::cos(tilt * std::numbers::pi / 180.0);
  Pressing scene = known.scene();
  scene.depth_mm /= cosine;
  scene.tilt = tilt;
  const Pressed found = pressed(scene);
  std::map<double, double> result;
  for (const auto& [depth, force] : known.force)
    for (const ForceSample& sample : found.history.force)
      if (std::abs(1e3 * sample.depth * cosine - depth) < 1e-5)
        result[depth] = sample.force / cosine / force - 1.0;
  return result;
}

void print(double share, int radii, const std::map<double, double>& error) {
  std::printf("depth/R %.2f, %2d contact radii thick:", share, radii);
  for (const auto& [depth, off] : error) std::printf(" %+.2f", 100.0 * off);
  std::printf(" %%\n");
}

class SmallContactOf : public testing::TestWithParam<std::pair<double, int>> {};

TEST_P(SmallContactOf, HasTheForceOfFiniteElementsWithTheNodesThatAreTakenByItself) {
  const auto [share, radii] = GetParam();
  const SmallContact known = small_contacts().at(GetParam());
  const std::map<double, double> error = errors(known, 0.0);
  print(share, radii, error);
  ASSERT_EQ(error.size(), 8u);
  for (const auto& [depth, off] : error)  // the first eighth's contact is a third as wide as the last
    EXPECT_NEAR(off, 0.0, depth > 0.2 * known.scene().depth_mm ? 0.02 : 0.05) << depth << " mm";
}
INSTANTIATE_TEST_SUITE_P(Spheres, SmallContactOf, testing::ValuesIn([] {
                           std::vector<std::pair<double, int>> all;
                           // Those in large bodies, where the contact is smallest beside the nodes; all:
                           // DIMPLE_ALL_SCENES.
                           for (const auto& [key, known] : small_contacts())
                             if (key.second == 40 || std::getenv("DIMPLE_ALL_SCENES")) all.push_back(key);
                           return all;
                         }()));

TEST(SmallContactOnASlope, IsFollowedWhereTheSphereTouchesAndNotOnItsAxis) {
  const std::map<double, double> error = errors(small_contacts().at({0.1, 40}), 20.0);
  print(0.1, 40, error);
  ASSERT_EQ(error.size(), 8u);
  for (const auto& [depth, off] : error) EXPECT_NEAR(off, 0.0, depth > 0.1 ? 0.02 : 0.05) << depth << " mm";
}

}  // namespace
}  // namespace dimple
