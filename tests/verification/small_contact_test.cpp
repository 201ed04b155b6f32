// Contacts that are small beside the tool and the body, with the nodes that the program takes by itself,
// against finite elements (reference/contact.py small).

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <numbers>

#include "apps/scene/config.hpp"
#include "apps/run/tool.hpp"
#include "io/table.hpp"
#include "preprocess/build_model.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

struct Scene {
  double height_mm = 0.0;          // and radius of the cylinder
  std::map<double, double> force;  // [N] at depths [mm]
  double depth_mm() const { return force.rbegin()->first; }
};

// By depth / radius and thickness / radius of the contact.
std::map<std::pair<double, int>, Scene> scenes() {
  std::map<std::pair<double, int>, Scene> result;
  for (const TextTable::Row& row : read_text_csv(DIMPLE_REFERENCE_DIR "/small_contacts.csv").row) {
    Scene& scene = result[{std::stod(row.field[0]), std::stoi(row.field[1])}];
    scene.height_mm = std::stod(row.field[2]);
    scene.force[std::stod(row.field[3])] = std::stod(row.field[4]);
  }
  return result;
}

// Errors of the force by depth [mm]. The sphere comes along a line that is `tilt` [degrees] off the normal:
// without friction it goes into a large body by the share cos(tilt) of its way, and its force has that share
// along the push.
std::map<double, double> errors(const Scene& scene, double tilt) {
  const double cosine = std::cos(tilt * std::numbers::pi / 180.0),
               sine = std::sin(tilt * std::numbers::pi / 180.0);
  Config config;
  const auto set = [&](const char* key, const std::string& value) { set_option(config, key, value, "test"); };
  set("tool.shape", "sphere:5mm");
  set("load.depth_mm", std::to_string(scene.depth_mm() / cosine));
  set("boundary.base", "inferior");
  set("boundary.indent_at", "0,0,top");
  set("boundary.direction", std::to_string(sine) + ",0," + std::to_string(-cosine));
  const BuiltModel built =
      build_model(cylinder_surface(scene.height_mm, scene.height_mm), model_options(config));
  const ForceSystem tissue(built.model, {{neo_hookean(210.0, 0.499, 1000.0)}, built.model.tissue},
                           Precision::single_);
  Loading loading{.depth = 1e-3 * config.load.depth_mm};
  loading.touch = touch_of(config, built.model);
  History history;
  solve(TimeMode::quasi_static, tissue, built.model, loading, {.frames = 8}, {}, history);
  std::map<double, double> result;
  for (const auto& [depth, force] : scene.force)
    for (const ForceSample& sample : history.force)
      if (std::abs(1e3 * sample.depth * cosine - depth) < 1e-5)
        result[depth] = sample.force / cosine / force - 1.0;
  return result;
}

void print(double share, int radii, const std::map<double, double>& error) {
  std::printf("depth/R %.2f, %2d contact radii thick:", share, radii);
  for (const auto& [depth, off] : error) std::printf(" %+.2f", 100.0 * off);
  std::printf(" %%\n");
}

class SmallContact : public testing::TestWithParam<std::pair<double, int>> {};

TEST_P(SmallContact, HasTheForceOfFiniteElementsWithTheNodesThatAreTakenByItself) {
  const auto [share, radii] = GetParam();
  const Scene scene = scenes().at(GetParam());
  const std::map<double, double> error = errors(scene, 0.0);
  print(share, radii, error);
  ASSERT_EQ(error.size(), 8u);
  for (const auto& [depth, off] : error)  // the first eighth's contact is a third as wide as the last
    EXPECT_NEAR(off, 0.0, depth > 0.2 * scene.depth_mm() ? 0.02 : 0.05) << depth << " mm";
}
INSTANTIATE_TEST_SUITE_P(Spheres, SmallContact, testing::ValuesIn([] {
                           std::vector<std::pair<double, int>> all;
                           // Those in large bodies, where the contact is smallest beside the nodes; all:
                           // DIMPLE_ALL_SCENES.
                           for (const auto& [key, scene] : scenes())
                             if (key.second == 40 || std::getenv("DIMPLE_ALL_SCENES")) all.push_back(key);
                           return all;
                         }()));

TEST(SmallContactOnASlope, IsFollowedWhereTheSphereTouchesAndNotOnItsAxis) {
  const std::map<double, double> error = errors(scenes().at({0.1, 40}), 20.0);
  print(0.1, 40, error);
  ASSERT_EQ(error.size(), 8u);
  for (const auto& [depth, off] : error) EXPECT_NEAR(off, 0.0, depth > 0.1 ? 0.02 : 0.05) << depth << " mm";
}

}  // namespace
}  // namespace dimple
