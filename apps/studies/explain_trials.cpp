#include "apps/studies/explain_trials.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "apps/run/error_bounds.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/tool_words.hpp"
#include "io/digits.hpp"
#include "preprocess/image/change_image.hpp"

namespace dimple {
namespace {

using Kind = Alternative::Kind;

constexpr double far_radii = 5.0;           // of the tool or patch: tissue beyond is removed
constexpr double small_depth_radii = 0.01;  // depth of small strain: the force is proportional to the depth
constexpr double tool_step_mm = 1.0;

std::string vector_text(const Vec3& v) {
  return fmt::format("{:.9g},{:.9g},{:.9g}", v.x(), v.y(), v.z());
}

// Centre of the tool in the image [m].
Vec3 centre_in_image(const LoadedModel& found) {
  return found.unloaded ? found.unloaded->imaged_centre : found.model.tool.centre;
}

// Adds a trial. `all`: text for the bar of several such changes, if it differs from `instead`.
template <class Change>
void add(std::vector<Trial>& trials, const Unchanged& u, const std::string& what, const std::string& all,
         const std::string& instead, Kind kind, Change change) {
  Trial trial{what, instead, all.empty() ? instead : all, kind, {.scene = u.held}};
  change(trial.given);
  trials.push_back(std::move(trial));
}

// Trials of the discretisation of the same case.
void add_discretisation(std::vector<Trial>& trials, const Unchanged& u) {
  const Scene& scene = u.scene;
  for (const int more : {1, 2})
    add(trials, u, "cloud", "two other random node sets",
        fmt::format("seed {} instead of {}", scene.node_set.seed + more, scene.node_set.seed), Kind::node_set,
        [&](Case& c) { c.scene.node_set.seed += more; });
  add(trials, u, "number of nodes", "",
      fmt::format("{} instead of {}", 2 * scene.node_set.nodes, scene.node_set.nodes), Kind::node_set,
      [](Case& c) { c.scene.node_set.nodes *= 2; });

  const double ratio = scheme_of(scene).points_per_node;
  add(trials, u, "integration points", "",
      fmt::format("{} per node instead of {}", plain(2.0 * ratio), plain(ratio)), Kind::node_set,
      [&](Case& c) {
        c.scene.grid.points = 0;
        c.scene.grid.ratio = 2.0 * ratio;
      });
  const double tolerance = scene.solver.tolerance;
  add(trials, u, "equilibrium", "",
      fmt::format("to {} of the reactions instead of {}", plain(0.1 * tolerance), plain(tolerance)),
      Kind::node_set, [&](Case& c) { c.scene.solver.tolerance = std::max(0.1 * tolerance, 1e-8); });
  const double step = longest_step_radii(scene);
  add(trials, u, "steps of the load", "",
      fmt::format("{:g} instead of {:g} radii of the {}", 0.5 * step, step, u.tool_name()), Kind::node_set,
      [&](Case& c) { c.scene.solver.step_radii = std::max(0.5 * step, 0.001); });
}

void add_contact(std::vector<Trial>& trials, const Unchanged& u) {
  const bool bonded = u.scene.contact == Contact::bonded;
  if (const RigidBody* indenter = u.indenter())
    for (const ToolChoice& choice : tool_choices(indenter->shape, indenter->friction))
      add(trials, u, choice.what, choice.all, choice.instead, Kind::doubt, [&](Case& c) {
        c.change.tool = choice.shape;
        c.scene.friction = choice.friction;
      });
  else
    add(trials, u, "contact", "",
        bonded ? "frictionless instead of bonded" : "bonded instead of frictionless", Kind::doubt,
        [&](Case& c) { c.scene.contact = bonded ? Contact::frictionless : Contact::bonded; });
}

// Trials of the height of the base.
void add_base(std::vector<Trial>& trials, const Unchanged& u) {
  if (!u.scene.base_is_held) return;
  const Boundary& boundary = u.found.report.boundary;
  const std::vector<double> heights =
      boundary.flat_base ? std::vector<double>{boundary.height / 6.0}
                         : std::vector<double>{0.5 * boundary.base_depth, 1.5 * boundary.base_depth};
  for (const double height : heights)
    add(trials, u, "base",
        heights.size() < 2 ? ""
                           : fmt::format("held to {:.1f} or {:.1f} mm instead of {:.1f} mm", heights[0],
                                         heights[1], boundary.base_depth),
        fmt::format("held to {:.1f} mm instead of {:.1f} mm", height, boundary.base_depth), Kind::doubt,
        [&](Case& c) { c.scene.boundary.base_depth_mm = height; });
}

void add_tool_place(std::vector<Trial>& trials, const Unchanged& unchanged) {
  const auto& tool = unchanged.found.model.tool;
  const Vec3 centre = centre_in_image(unchanged.found);
  Index axis = 0;
  tool.approach.cwiseAbs().minCoeff(&axis);
  const Vec3 u = (Vec3::Unit(axis) - tool.approach[axis] * tool.approach).normalized(),
             v = tool.approach.cross(u);
  for (const Vec3& step : {u, Vec3(-u), v, Vec3(-v)}) {
    const Vec3 shown = step.array() + 0.0;  // no -0
    add(trials, unchanged, unchanged.indenter() ? "tool's place" : "circle",
        fmt::format("moved by {:g} mm in four directions", tool_step_mm),
        fmt::format("moved by {:g} mm along ({:+.1f}, {:+.1f}, {:+.1f})", tool_step_mm, shown.x(), shown.y(),
                    shown.z()),
        Kind::doubt,
        [&](Case& c) { c.scene.boundary.indent_at = vector_text(1e3 * centre + tool_step_mm * step); });
  }
}

// Trials of the body's boundary: its segmentation, and the surface made from it.
void add_shape(std::vector<Trial>& trials, const Unchanged& u) {
  for (const double outward : {0.5, -0.5})
    add(trials, u, "segmentation", "half a voxel larger or smaller",
        fmt::format("half a voxel {}", outward > 0.0 ? "larger" : "smaller"), Kind::doubt,
        [&](Case& c) { c.change.outward_voxels = outward; });
  const double smoothing_mm = u.found.segment.smoothing_mm;
  for (const double smoothing : {0.5, 2.0})
    add(trials, u, "surface",
        fmt::format("smoothed by {:.2f} or {:.2f} mm instead of {:.2f} mm", 0.5 * smoothing_mm,
                    2.0 * smoothing_mm, smoothing_mm),
        fmt::format("smoothed by {:.2f} mm instead of {:.2f} mm", smoothing * smoothing_mm, smoothing_mm),
        Kind::doubt, [&](Case& c) { c.change.smoothing = smoothing; });
  add(trials, u, "voxels", "", "twice as large", Kind::simplification,
      [](Case& c) { c.change.image = in_double_voxels; });
}

void add_folds(std::vector<Trial>& trials, const Unchanged& u) {
  const auto change = [&](double close_mm) {
    return [&u, close_mm](Case& c) {
      c.scene.image.close_mm = close_mm;
      // The remaining folds decide whether contact between them is computed; a body imaged under its loads
      // keeps the choice of the unchanged case.
      if (!u.found.unloaded) c.scene.self_contact = u.scene.self_contact;
    };
  };
  if (const double closed_mm = u.scene.image.close_mm; closed_mm > 0.0)
    add(trials, u, "folds", "",
        fmt::format("open instead of closed below {} mm, at the same place", plain(closed_mm)), Kind::doubt,
        change(0.0));
  else
    add(trials, u, "folds", "", fmt::format("closed below {} mm, at the same place", plain(narrow_gap_mm)),
        Kind::doubt, change(narrow_gap_mm));
  if (!(u.found.facing_fraction > most_facing) || u.found.time != TimeMode::quasi_static) return;
  const bool folds_in_contact = u.found.loading.folds != nullptr;
  add(trials, u, "walls of folds", "",
      folds_in_contact ? "pass through each other" : "come into contact where they close, without friction",
      Kind::doubt, [folds_in_contact](Case& c) {
        c.scene.self_contact = folds_in_contact ? Scene::SelfContact::off : Scene::SelfContact::on;
      });
}

void add_small_strain(std::vector<Trial>& trials, const Unchanged& u) {
  const double depth_mm = u.scene.depth_mm, small_mm = small_depth_radii * u.radius_mm();
  // With a contacting tool, the force is not proportional to the depth at small strain either.
  if (u.indenter() || !(small_mm < depth_mm) || u.found.time != TimeMode::quasi_static) return;
  add(trials, u, "strain", "", "small instead of large", Kind::simplification, [&](Case& c) {
    // Supports move in proportion to the depth.
    for (Scene::Support& support : c.scene.supports)
      for (double& component : support.move_mm) component *= small_mm / depth_mm;
    c.scene.depth_mm = small_mm;
    c.scene.solver.frames = 1;
  });
  trials.back().linear = true;
}

void add_far_tissue(std::vector<Trial>& trials, const Unchanged& u) {
  const double away = far_radii * u.radius_mm();
  add(trials, u, "far tissue", "",
      fmt::format("cut away beyond {:.0f} mm of the {}'s axis", away, u.tool_name()), Kind::simplification,
      [&](Case& c) {
        const std::vector<int> labels = u.found.segment.labels;
        const Boundary& boundary = u.found.report.boundary;
        const Vec3 centre = 1e3 * centre_in_image(u.found), approach = u.found.model.tool.approach;
        const LabelImage near = without_far_tissue(u.found.image, centre, approach, away);
        // Without its lowest part, the body is held up to the same height as before.
        if (!boundary.flat_base)
          c.scene.boundary.base_depth_mm = std::max(
              boundary.base_depth - reach_of(u.found.image, labels, u.down) + reach_of(near, labels, u.down),
              0.1);
        c.change.image = [=](const LabelImage& image) {
          return without_far_tissue(image, centre, approach, away);
        };
      });
}

void add_poisson_ratio(std::vector<Trial>& trials, const Unchanged& u) {
  if (u.scene.material.preset != "none") return;
  constexpr double nearly = 0.49, more_nearly = 0.499;
  const double nu = u.scene.material.nu > 0.5 * (nearly + more_nearly) ? nearly : more_nearly;
  add(trials, u, "Poisson's ratio", "",
      fmt::format("{} instead of {}", plain(nu), plain(u.scene.material.nu)), Kind::simplification,
      [&](Case& c) {
        c.scene.material.nu = nu;
        for (TissueOfLabel& tissue : c.scene.tissues)
          if (!tissue.has_own_nu) tissue.numbers.nu = nu;
      });
}

// Trials of the rigid walls: without them, and with friction.
void add_walls(std::vector<Trial>& trials, const Unchanged& u) {
  if (u.scene.walls.empty()) return;
  add(trials, u, "walls", "", "none", Kind::simplification, [](Case& c) { c.scene.walls.clear(); });
  add(trials, u, "walls' friction", "", "0.3", Kind::doubt, [](Case& c) {
    for (Scene::Wall& wall : c.scene.walls) wall.friction = 0.3;
  });
}

void add_inertia(std::vector<Trial>& trials, const Unchanged& u) {
  if (u.found.time == TimeMode::quasi_static) return;
  add(trials, u, "inertia", "", "neglected", Kind::simplification,
      [](Case& c) { c.scene.solver.time = Scene::Numerics::Time::quasi_static; });
}

void add_one_material(std::vector<Trial>& trials, const Unchanged& u) {
  if (u.scene.tissues.empty()) return;
  add(trials, u, "tissues", "", "all of one material", Kind::simplification,
      [](Case& c) { c.scene.tissues.clear(); });
}

}  // namespace

Scene pinned(Scene scene, const LoadedModel& found, const Vec3& down) {
  const auto& tool = found.model.tool;
  scene.boundary.indent_at = vector_text(1e3 * centre_in_image(found));
  scene.boundary.direction = vector_text(tool.approach);
  scene.boundary.base = vector_text(down);
  if (scene.solver.time == Scene::Numerics::Time::automatic)
    scene.solver.time = found.time == TimeMode::quasi_static ? Scene::Numerics::Time::quasi_static
                                                             : Scene::Numerics::Time::explicit_;
  if (scene.self_contact == Scene::SelfContact::automatic)
    scene.self_contact = found.loading.folds ? Scene::SelfContact::on : Scene::SelfContact::off;
  return scene;
}

std::vector<Trial> trials_of(const Unchanged& unchanged) {
  std::vector<Trial> trials;
  add_discretisation(trials, unchanged);
  add_contact(trials, unchanged);
  add_base(trials, unchanged);
  add_tool_place(trials, unchanged);
  add_shape(trials, unchanged);
  add_folds(trials, unchanged);
  add_small_strain(trials, unchanged);
  add_far_tissue(trials, unchanged);
  add_poisson_ratio(trials, unchanged);
  add_walls(trials, unchanged);
  add_inertia(trials, unchanged);
  add_one_material(trials, unchanged);
  return trials;
}

std::string left_out(const Trial& trial, const LoadedModel& now, const LoadedModel& found) {
  if (trial.what == "folds" && trial.given.scene.image.close_mm > 0.0 && now.closed_mm3 == 0.0)
    return "no gap is that narrow";
  if (const Scene& scene = trial.given.scene;
      trial.what == "far tissue" &&
      !(scene.supports.empty() && scene.pressures.empty() && scene.walls.empty()))
    return "supports, pressures and walls would be where it is cut";
  if (trial.what == "far tissue" && now.segment.voxel_volume_mm3 == found.segment.voxel_volume_mm3)
    return "no tissue is that far away";
  return {};
}

std::vector<ToolChoice> tool_choices(const ToolShape& shape, double friction) {
  std::vector<ToolChoice> choices;
  constexpr double any = std::numeric_limits<double>::infinity(), rounding = 1e-9;
  const std::vector<ToolLength> lengths = lengths_of(shape);
  for (std::size_t k = 0; k < lengths.size(); ++k)
    for (const double sign : {1.0, -1.0}) {
      const ToolLength& length = lengths[k];
      const double other = std::clamp(length.value * (1.0 + sign * length.doubt), length.least, length.most);
      if (std::abs(other - length.value) <= rounding * length.value) continue;
      choices.push_back(
          {"tool's " + length.name, fmt::format("{:g} % larger or smaller", 100.0 * length.doubt),
           fmt::format("{} instead of {}", length.in_words(other), length.in_words(length.value)),
           with_length(shape, k, other), friction});
    }

  std::vector<std::string> others;
  for (const auto& [value, word] : {std::pair{0.0, "none"}, {0.3, "0.3"}, {any, "stuck"}})
    if (value != friction) {
      others.emplace_back(word);
      choices.push_back(
          {"friction",
           {},
           fmt::format("{} instead of {}", friction_in_words(value), friction_in_words(friction)),
           shape,
           value});
    }
  const std::string last = others.back();
  others.pop_back();
  for (ToolChoice& choice : choices)
    if (choice.all.empty()) choice.all = fmt::format("{} or {}", fmt::join(others, ", "), last);
  return choices;
}

}  // namespace dimple
