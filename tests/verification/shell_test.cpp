// A soft sphere under its weight in a rigid spherical shell, held by frictionless contact alone, against
// finite elements (reference/sphere_in_shell.py).

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <numbers>
#include <string>

#include "io/table.hpp"
#include "preprocess/build_model.hpp"
#include "preprocess/scene/wall_field.hpp"
#include "preprocess/supports/wall_surface.hpp"
#include "solver/system.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

// Parameters of sphere_in_shell.py.
constexpr double radius = 20e-3, mu = 1000.0, density = 1000.0, gravity = 9.81;
constexpr int sides = 240;  // of the polygons that approximate the sphere's surface

// Row of the reference's table by its columns.
std::map<std::string, double> reference(double nu, double gap_mm) {
  const TextTable table = read_text_csv(DIMPLE_REFERENCE_DIR "/sphere_in_shell.csv");
  for (const TextTable::Row& row : table.row) {
    std::map<std::string, double> result;
    for (std::size_t k = 0; k < table.header.size(); ++k) result[table.header[k]] = std::stod(row.field[k]);
    if (result.at("nu") == nu && result.at("gap_mm") == gap_mm) return result;
  }
  return {};
}

// Distances inwards from a shell. The spline of a grid adds step^2 / 6 of the Laplacian, -2 / r.
std::shared_ptr<const DistanceGrid> shell_of(double inner_radius) {
  auto grid = std::make_shared<DistanceGrid>();
  grid->step = 0.5e-3;
  const double half = inner_radius + 5e-3;
  const auto n = static_cast<Index>(std::ceil(2.0 * half / grid->step)) + 1;
  grid->n = {n, n, n};
  grid->origin.setConstant(-half);
  for (Index k = 0; k < n; ++k)
    for (Index j = 0; j < n; ++j)
      for (Index i = 0; i < n; ++i) {
        const Vec3 steps = Eigen::Matrix<Index, 3, 1>(i, j, k).cast<double>();
        const double r = std::max((grid->origin + grid->step * steps).norm(), grid->step);
        grid->value.push_back(inner_radius - r + grid->step * grid->step / (3.0 * r));
      }
  return grid;
}

// Distances to a mesh of the shell, as the program stores the walls of labels and files.
std::shared_ptr<const DistanceGrid> drawn_shell_of(double inner_radius) {
  const double mm = 1e3 * inner_radius;
  const Vec3 corner = Vec3::Constant(mm + 4.5);
  return std::make_shared<DistanceGrid>(wall_field(
      cut_ellipsoid_surface(Vec3::Constant(mm), -mm + 1e-3, sides), true, -corner, corner, 0.2, 8.0));
}

// Sphere with uniform nodes, none of them held.
Model loose_sphere(Index nodes) {
  ModelOptions options;
  options.node_set.count = nodes;
  options.node_set.grading = {};
  options.boundary = {.base = "inferior", .indent_at = "0,0,top", .contact_radius_mm = 2.5};
  Model model =
      build_model(cut_ellipsoid_surface(Vec3::Constant(1e3 * radius), -19.999, sides), options).model;
  model.base.clear();
  model.bonded_patch.clear();
  return model;
}

// Fraction of the shell's upward force that acts within an angle [degrees] from its lowest point. A sample's
// force is spread over the pieces that it averages.
double carried_within(const System& system, double degrees) {
  const RigidContact& shell = *system.walls().front();
  const ContactSurface& surface = shell.body().surface;
  const Points place = surface.between + surface.at_between(system.step_start().u.topRows<3>());
  double within = 0.0, all = 0.0;
  for (Index k = 0; k < place.cols(); ++k) {
    const int s = surface.sample_of[k];
    const double up = surface.fraction[k] * shell.forces()[s] * shell.normals()(2, s);
    all += up;
    const double angle = 180.0 / std::numbers::pi * std::atan2(place.col(k).head<2>().norm(), -place(2, k));
    within += std::clamp((degrees - angle) / (360.0 / sides) + 0.5, 0.0, 1.0) * up;
  }
  return within / all;
}

struct Scene {
  double nu, gap_mm;
  bool drawn = false;
};
class SoftSphere : public testing::TestWithParam<Scene> {};

TEST_P(SoftSphere, SinksInARigidShellAsDeepAsFiniteElementsSay) {
  const auto [nu, gap_mm, drawn] = GetParam();
  const std::map<std::string, double> truth = reference(nu, gap_mm);
  ASSERT_FALSE(truth.empty());
  const Index nodes = std::getenv("DIMPLE_ALL_SCENES") ? 8000 : 4000;
  const Model model = loose_sphere(nodes);
  const ForceSystem tissue(model, {{neo_hookean(mu, nu, density)}, model.tissue});
  const double inner = radius + 1e-3 * gap_mm;
  const RigidBody shell{.shape = field_shape(drawn ? drawn_shell_of(inner) : shell_of(inner), radius),
                        .pose = {Vec3::Zero(), -Vec3::UnitZ()},
                        .surface = wall_surface(
                            model, [](const Vec3&, const Vec3&) { return true; }, 1500),
                        .motion = Vec3::Zero().eval(),
                        .name = "shell"};
  const auto system =
      make_system(tissue, model, Contact::bonded, {}, {.gravity = Vec3(0.0, 0.0, -gravity), .pressure = {}},
                  1e-4, nullptr, nullptr, {shell});
  const RigidContact& wall = *system->walls().front();
  const double weight = model.mass.sum() * gravity,
               sinks = -1e3 * system->step_start().u.row(2).dot(model.mass) / model.mass.sum(),
               sag = truth.at("mean_mm") - gap_mm, pressed = wall.forces().sum() / weight;
  std::printf("%td nodes: sag %+.2f %%, all that presses %+.2f %%; carried within 15 to 60 degrees", nodes,
              100.0 * (sinks - gap_mm - sag) / sag,
              100.0 * (pressed / truth.at("pressed_over_weight") - 1.0));
  for (const int degrees : {15, 30, 45, 60}) {
    const double off =
        carried_within(*system, degrees) - truth.at("carried_within_" + std::to_string(degrees));
    std::printf(" %+.4f", off);
    EXPECT_NEAR(off, 0.0, 0.01) << degrees;
  }
  std::printf(" of the weight\n");
  EXPECT_NEAR(sinks - gap_mm, sag, 0.02 * sag);
  EXPECT_NEAR(pressed, truth.at("pressed_over_weight"), 0.02 * pressed);
  const Vec3 force = wall.contact_summary().force / weight;
  EXPECT_NEAR(force.z(), -1.0, 1e-3) << "contact alone carries it";
  EXPECT_LT(force.head<2>().norm(), 1e-3);
}

INSTANTIATE_TEST_SUITE_P(OfTwoRatiosInTwoGaps, SoftSphere,
                         testing::Values(Scene{0.45, 0.5}, Scene{0.49, 0.5}, Scene{0.45, 1.0},
                                         Scene{0.49, 1.0}));
INSTANTIATE_TEST_SUITE_P(InAShellThatIsDrawn, SoftSphere,
                         testing::Values(Scene{0.45, 1.0, true}, Scene{0.49, 0.5, true}));

}  // namespace
}  // namespace dimple
