#pragma once

#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include "apps/run/model_options.hpp"
#include "apps/run/tool.hpp"
#include "io/table.hpp"
#include "tests/helpers/marched.hpp"
#include "tests/helpers/scene_with.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple::pressed_cylinder {

// A tool in contact with the top of a cylinder, as the program builds and solves it, and its finite elements
// (reference/axisymmetric_contact.cpp).

using Forces = std::map<double, double>;  // [N] at depths [mm]

struct Pressing {
  std::string name = {};  // in reference/contact.csv
  std::string tool = "sphere:5mm";
  double radius_mm = 30.0, height_mm = 30.0, nu = 0.499, depth_mm = 4.0;
  std::string friction = "0";
  Index nodes = 0;                  // 0: default number of the program
  std::optional<double> tilt = {};  // of the tool's line to the normal [degrees]
};

inline dimple::Scene described(const Pressing& scene) {
  OptionTexts options = {{"tool.shape", scene.tool},
                         {"tool.friction", scene.friction},
                         {"load.depth_mm", std::to_string(scene.depth_mm)},
                         {"boundary.base", "inferior"},
                         {"boundary.indent_at", "0,0,top"}};
  if (scene.nodes > 0) options["cloud.nodes"] = std::to_string(scene.nodes);
  if (scene.tilt) {
    const double angle = *scene.tilt * std::numbers::pi / 180.0;
    options["boundary.direction"] =
        std::to_string(std::sin(angle)) + ",0," + std::to_string(-std::cos(angle));
  }
  return scene_with(options);
}

struct Pressed {
  Model model;
  History history;
};

// Results for one tissue, with eight frames.
inline Pressed pressed(const Pressing& scene) {
  const dimple::Scene run = described(scene);
  Pressed result;
  result.model = build_model(cylinder_surface(scene.radius_mm, scene.height_mm), model_options(run)).model;
  const ForceSystem tissue(result.model, {{neo_hookean(210.0, scene.nu, 1000.0)}, result.model.tissue},
                           Precision::single_);
  Loading loading{.depth = 1e-3 * run.depth_mm};
  loading.indenter = indenter_of(run, result.model);
  result.history = marched(tissue, result.model, loading, {.frames = 8});
  return result;
}

#ifdef DIMPLE_REFERENCE_DIR
// Forces of a scene in contact.csv.
inline Forces reference_of(const std::string& name) {
  Forces result;
  for (const TextTable::Row& row : read_text_csv(DIMPLE_REFERENCE_DIR "/contact.csv").row)
    if (row.field[0] == name) result[std::stod(row.field[1])] = std::stod(row.field[2]);
  return result;
}

// Spheres of 5 mm on cylinders as high as wide, by depth / radius and body height / contact radius.
struct SmallContact {
  double height_mm = 0.0;
  Forces force = {};
  Pressing scene() const {
    return {.radius_mm = height_mm, .height_mm = height_mm, .depth_mm = force.rbegin()->first};
  }
};
inline std::map<std::pair<double, int>, SmallContact> small_contacts() {
  std::map<std::pair<double, int>, SmallContact> result;
  for (const TextTable::Row& row : read_text_csv(DIMPLE_REFERENCE_DIR "/small_contacts.csv").row) {
    SmallContact& one = result[{std::stod(row.field[0]), std::stoi(row.field[1])}];
    one.height_mm = std::stod(row.field[2]);
    one.force[std::stod(row.field[3])] = std::stod(row.field[4]);
  }
  return result;
}
#endif

}  // namespace dimple::pressed_cylinder
