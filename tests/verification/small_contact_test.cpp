// Contacts that are small compared with tool and body, with the program's default nodes, against finite
// elements (reference/contact.py small).

#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>

#include "tests/verification/pressed_cylinder.hpp"

namespace dimple {
namespace {

using namespace pressed_cylinder;

// Errors of the force by depth [mm]. The sphere moves along a line `tilt` [degrees] off the normal. Without
// friction its depth in a large body is cos(tilt) of the displacement, and so is the component of its force
// along the press direction.
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

void print(double fraction, int radii, const std::map<double, double>& error) {
  std::printf("depth/R %.2f, %2d contact radii thick:", fraction, radii);
  for (const auto& [depth, off] : error) std::printf(" %+.2f", 100.0 * off);
  std::printf(" %%\n");
}

class SmallContactOf : public testing::TestWithParam<std::pair<double, int>> {};

TEST_P(SmallContactOf, HasTheForceOfFiniteElementsWithTheNodesThatAreTakenByItself) {
  const auto [fraction, radii] = GetParam();
  const SmallContact known = small_contacts().at(GetParam());
  const std::map<double, double> error = errors(known, 0.0);
  print(fraction, radii, error);
  ASSERT_EQ(error.size(), 8u);
  for (const auto& [depth, off] : error)  // the contact at the first eighth is a third as wide as at the last
    EXPECT_NEAR(off, 0.0, depth > 0.2 * known.scene().depth_mm ? 0.02 : 0.05) << depth << " mm";
}
INSTANTIATE_TEST_SUITE_P(Spheres, SmallContactOf, testing::ValuesIn([] {
                           std::vector<std::pair<double, int>> all;
                           // Large bodies, in which contacts are smallest compared with the nodes; all with
                           // DIMPLE_ALL_SCENES.
                           for (const auto& [key, known] : small_contacts())
                             if (key.second == 40 || std::getenv("DIMPLE_ALL_SCENES")) all.push_back(key);
                           return all;
                         }()));

TEST(SmallContactOnASlope, IsFollowedWhereTheSphereHasContactAndNotOnItsAxis) {
  const std::map<double, double> error = errors(small_contacts().at({0.1, 40}), 20.0);
  print(0.1, 40, error);
  ASSERT_EQ(error.size(), 8u);
  for (const auto& [depth, off] : error) EXPECT_NEAR(off, 0.0, depth > 0.1 ? 0.02 : 0.05) << depth << " mm";
}

}  // namespace
}  // namespace dimple
