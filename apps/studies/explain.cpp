#include "apps/studies/explain.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <tuple>

#include "apps/run/band.hpp"
#include "apps/run/folds.hpp"
#include "apps/run/membranes.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/other_tools.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/unless_stopped.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/compatibility.hpp"
#include "io/digits.hpp"
#include "io/draw/chart.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"
#include "preprocess/image/change_image.hpp"

namespace dimple {
namespace {

using Kind = Alternative::Kind;

constexpr int frames = 4;
constexpr double far_radii = 5.0;           // of the circle: tissue beyond is cut away
constexpr double small_depth_radii = 0.01;  // where a strain is small: the force is proportional to the depth
constexpr double tool_step_mm = 1.0;
constexpr double few_noises = 3.0;
constexpr Index most_nodes_to_explain = 6000;  // some two minutes

struct Trial {
  std::string what, instead, all;
  Kind kind;
  Case given;
  bool linear = false;  // its force is that of one small depth, and proportional to the depth
};

// A case and its forces, as deep as there are any.
struct Tried {
  Result result;
  std::vector<double> force;  // [N] at each of the depths
  std::string deeper;         // why not at all of them
  double seconds = 0.0;
};

bool has_limit_point(const History& history) {
  return std::any_of(history.guards.begin(), history.guards.end(),
                     [](const Finding& f) { return f.report.code == "limit-point"; });
}

// Force [N] at each of the depths, ascending, between the samples on both sides; as many as the samples
// reach.
std::vector<double> forces_at(const std::vector<ForceSample>& samples, const std::vector<double>& depths_mm) {
  std::vector<double> result;
  for (const double mm : depths_mm) {
    const double depth = 1e-3 * mm;
    const auto after = std::find_if(samples.begin(), samples.end(),
                                    [&](const ForceSample& s) { return s.depth >= depth * (1.0 - 1e-9); });
    if (after == samples.end()) break;
    if (after == samples.begin()) {
      result.push_back(after->force);
      continue;
    }
    const ForceSample& before = *std::prev(after);
    const double share = (depth - before.depth) / (after->depth - before.depth);
    result.push_back(before.force + std::min(share, 1.0) * (after->force - before.force));
  }
  return result;
}

// What the run would have taken by itself: it may have had parts of its model from another.
double seconds_by_itself(const Result& result) {
  return result.read_s + result.build_s + result.complete_s + result.solve_s;
}

Tried run(const Case& given, const std::vector<double>& depths_mm) {
  Tried tried;
  double gave_way_mm = INFINITY;  // nothing deeper is compared
  const RunObserver observer{.march = {.sample = [&](const ForceSample& sample, const History& history) {
                               const double mm = 1e3 * sample.depth;
                               if (has_limit_point(history)) gave_way_mm = std::min(gave_way_mm, mm);
                               const bool enough = gave_way_mm < INFINITY && mm > depths_mm.front() - 1e-6;
                               return !enough && stop_asked() == StopReason::none;
                             }}};
  try {
    unless_stopped([&] { simulate(given, observer, tried.result); });
  } catch (const SolveError&) {
    tried.force = forces_at(tried.result.history.force, depths_mm);
    if (tried.force.empty()) throw;
    tried.deeper = "no equilibrium was found deeper";
  }
  if (stop_asked() != StopReason::none) throw Stopped(stop_asked());
  tried.force = forces_at(tried.result.history.force, depths_mm);
  while (tried.force.size() > 1 && depths_mm[tried.force.size() - 1] > gave_way_mm - 1e-6) {
    tried.force.pop_back();
    tried.deeper = "the tissue gave way deeper";
  }
  if (tried.force.empty())
    throw SolveError({.fact = "there is no force at " + length_in_words(depths_mm.front()),
                      .where = "--explain",
                      .why = "the load ends before",
                      .remedy = "give a larger --depth"});
  tried.seconds = seconds_by_itself(tried.result);
  return tried;
}

std::string vector_text(const Vec3& v) {
  return fmt::format("{:.9g},{:.9g},{:.9g}", v.x(), v.y(), v.z());
}

// [m]
Vec3 centre_in_image(const Result& found) {
  return found.unloaded ? found.unloaded->imaged_centre : found.model.tool.centre;
}

// The scene as it was found, with its places as numbers: a change of the body does not move the tool.
Scene pinned(Scene scene, const Result& found, const Vec3& down) {
  const auto& tool = found.model.tool;
  scene.boundary.indent_at = vector_text(1e3 * centre_in_image(found));
  scene.boundary.direction = vector_text(tool.push);
  scene.boundary.base = vector_text(down);
  if (scene.solver.time == Scene::Numerics::Time::automatic)
    scene.solver.time = found.time == TimeMode::quasi_static ? Scene::Numerics::Time::quasi_static
                                                             : Scene::Numerics::Time::explicit_;
  if (scene.self_contact == Scene::SelfContact::automatic)
    scene.self_contact = found.loading.folds ? Scene::SelfContact::on : Scene::SelfContact::off;
  return scene;
}

// What trials are made from: the case, the same with its places as numbers, and what was found with it.
struct Unchanged {
  const Scene& scene;
  const Scene& held;
  const Result& found;
  Vec3 down;

  const Touch* touch() const { return found.loading.touch.get(); }
  std::string tool_name() const { return touch() ? "tool" : "circle"; }
  double radius_mm() const { return 1e3 * (touch() ? touch()->shape.radius : found.model.tool.radius); }
};

// `all`: what the bar of several such changes says, where it is not the same.
template <class Change>
void add(std::vector<Trial>& trials, const Unchanged& u, const std::string& what, const std::string& all,
         const std::string& instead, Kind kind, Change change) {
  Trial trial{what, instead, all.empty() ? instead : all, kind, {.scene = u.held}};
  change(trial.given);
  trials.push_back(std::move(trial));
}

// Which only say how finely the same case is computed.
void add_discretisation(std::vector<Trial>& trials, const Unchanged& u) {
  const Scene& scene = u.scene;
  for (const int more : {1, 2})
    add(trials, u, "cloud", "two other random clouds",
        fmt::format("seed {} instead of {}", scene.cloud.seed + more, scene.cloud.seed), Kind::cloud,
        [&](Case& c) { c.scene.cloud.seed += more; });
  add(trials, u, "number of nodes", "",
      fmt::format("{} instead of {}", 2 * scene.cloud.nodes, scene.cloud.nodes), Kind::cloud,
      [](Case& c) { c.scene.cloud.nodes *= 2; });

  const double ratio = scheme_of(scene).points_per_node;
  add(trials, u, "integration points", "",
      fmt::format("{} per node instead of {}", plain(2.0 * ratio), plain(ratio)), Kind::cloud, [&](Case& c) {
        c.scene.grid.points = 0;
        c.scene.grid.ratio = 2.0 * ratio;
      });
  const double tolerance = scene.solver.tolerance;
  add(trials, u, "equilibrium", "",
      fmt::format("to {} of the reactions instead of {}", plain(0.1 * tolerance), plain(tolerance)),
      Kind::cloud, [&](Case& c) { c.scene.solver.tolerance = std::max(0.1 * tolerance, 1e-8); });
  const double step = longest_step_radii(scene);
  add(trials, u, "steps of the load", "",
      fmt::format("{:g} instead of {:g} radii of the {}", 0.5 * step, step, u.tool_name()), Kind::cloud,
      [&](Case& c) { c.scene.solver.step_radii = std::max(0.5 * step, 0.001); });
}

void add_contact(std::vector<Trial>& trials, const Unchanged& u) {
  const bool bonded = u.scene.contact == Contact::bonded;
  if (const Touch* touch = u.touch())
    for (const ToolChoice& choice : tool_choices(touch->shape, touch->friction))
      add(trials, u, choice.what, choice.all, choice.instead, Kind::doubt, [&](Case& c) {
        c.change.tool = choice.shape;
        c.scene.friction = choice.friction;
      });
  else
    add(trials, u, "contact", "",
        bonded ? "frictionless instead of bonded" : "bonded instead of frictionless", Kind::doubt,
        [&](Case& c) { c.scene.contact = bonded ? Contact::frictionless : Contact::bonded; });
}

// How far up the body is held.
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
  tool.push.cwiseAbs().minCoeff(&axis);
  const Vec3 u = (Vec3::Unit(axis) - tool.push[axis] * tool.push).normalized(), v = tool.push.cross(u);
  for (const Vec3& step : {u, Vec3(-u), v, Vec3(-v)}) {
    const Vec3 shown = step.array() + 0.0;  // no -0
    add(trials, unchanged, unchanged.touch() ? "tool's place" : "circle",
        fmt::format("moved by {:g} mm in four directions", tool_step_mm),
        fmt::format("moved by {:g} mm along ({:+.1f}, {:+.1f}, {:+.1f})", tool_step_mm, shown.x(), shown.y(),
                    shown.z()),
        Kind::doubt,
        [&](Case& c) { c.scene.boundary.indent_at = vector_text(1e3 * centre + tool_step_mm * step); });
  }
}

// Where the body ends: its segmentation, and how a surface is laid through it.
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
      // Whether they touch is decided by the folds that are left; a body that was imaged under its loads has
      // them pass.
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
  if (!(u.found.facing_share > most_facing) || u.found.time != TimeMode::quasi_static) return;
  const bool touch = u.found.loading.folds != nullptr;
  add(trials, u, "walls of folds", "",
      touch ? "pass through each other" : "touch where they close, without friction", Kind::doubt,
      [touch](Case& c) { c.scene.self_contact = touch ? Scene::SelfContact::off : Scene::SelfContact::on; });
}

void add_small_strain(std::vector<Trial>& trials, const Unchanged& u) {
  const double depth_mm = u.scene.depth_mm, small_mm = small_depth_radii * u.radius_mm();
  // The force of a tool that touches is not proportional to its depth at small strain either.
  if (u.touch() || !(small_mm < depth_mm) || u.found.time != TimeMode::quasi_static) return;
  add(trials, u, "strain", "", "small instead of large", Kind::simplification, [&](Case& c) {
    // Supports come as far as they have when the tool is there.
    for (Scene::Support& support : c.scene.supports)
      for (double& way : support.move_mm) way *= small_mm / depth_mm;
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
        const Vec3 centre = 1e3 * centre_in_image(u.found), push = u.found.model.tool.push;
        const LabelImage near = without_far_tissue(u.found.image, centre, push, away);
        // Without its lowest part the body is held as far up as before.
        if (!boundary.flat_base)
          c.scene.boundary.base_depth_mm = std::max(
              boundary.base_depth - reach_of(u.found.image, labels, u.down) + reach_of(near, labels, u.down),
              0.1);
        c.change.image = [=](const LabelImage& image) {
          return without_far_tissue(image, centre, push, away);
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

// What is rigid beside the body: not there, and with friction.
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

// In the order in which they are run.
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

// Whether the change has changed nothing: then it has nothing to say.
std::string left_out(const Trial& trial, const Result& now, const Result& found) {
  if (trial.what == "folds" && trial.given.scene.image.close_mm > 0.0 && now.closed_mm3 == 0.0)
    return "no gap is that narrow";
  if (const Scene& scene = trial.given.scene;
      trial.what == "far tissue" &&
      !(scene.supports.empty() && scene.pressures.empty() && scene.walls.empty()))
    return "supports, pressures and walls would lie where it is cut";
  if (trial.what == "far tissue" && now.segment.voxel_volume_mm3 == found.segment.voxel_volume_mm3)
    return "no tissue lies that far away";
  return {};
}

bool same_nodes(const Model& a, const Model& b) {
  return a.node_count() == b.node_count() && a.X == b.X;
}

}  // namespace

void sort_by_effect(std::vector<Alternative>& alternatives) {
  std::map<std::string, double> largest;
  for (const Alternative& a : alternatives)
    if (a.failed.empty()) largest[a.what] = std::max(largest[a.what], std::abs(a.effect));
  std::stable_sort(alternatives.begin(), alternatives.end(), [&](const Alternative& a, const Alternative& b) {
    if (a.failed.empty() != b.failed.empty()) return a.failed.empty();
    const double x = largest[a.what], y = largest[b.what];
    return x != y ? x > y : a.what < b.what;
  });
}

namespace {

std::string instead_of(const Alternative& a, const Explanation& e) {
  if (!a.failed.empty() || !(a.depth_mm < e.depth_mm)) return a.instead;
  return fmt::format("{} (at {}: {})", a.instead, length_in_words(a.depth_mm), a.deeper);
}

}  // namespace

const char* word_of(Kind kind) {
  return kind == Kind::cloud ? "discretisation" : kind == Kind::doubt ? "doubt" : "simplification";
}

Index nodes_to_explain(const Scene& scene, double facing_share) {
  return std::max(fewest_nodes_under_tool(scene),
                  facing_share > most_facing ? Index{2000} : Scene::Cloud{}.nodes);
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

namespace {

// The case that is explained, with so many nodes.
Scene config_to_explain(Scene scene, Index nodes) {
  scene.goal.reset();
  scene.followed.reset();
  scene.band = true;
  scene.material.mu_spread = 0.0;
  scene.cloud.spacing_mm = 0.0;
  scene.cloud.nodes = nodes;
  scene.given.nodes = true;
  scene.solver.frames = frames;
  return scene;
}

// What a trial is compared with.
struct ForceReference {
  const std::vector<double>& depths_mm;
  const Scene& held;
  const ReadOrgan& organ;  // of the case as it was given, and what was made of it with its places as numbers
  const Tried& found;      // as the case was given
  const Tried& as_it_is;   // the same with its places as numbers
  std::vector<double> mean;  // force [N] of the clouds so far
  int clouds = 1;
};

void take_into_mean(ForceReference& reference, const std::vector<double>& force) {
  std::vector<double>& mean = reference.mean;
  mean.resize(std::min(mean.size(), force.size()));
  for (std::size_t k = 0; k < mean.size(); ++k) mean[k] += (force[k] - mean[k]) / (reference.clouds + 1);
  ++reference.clouds;
}

// A force that is proportional to the depth, at each of the depths.
std::vector<double> proportional(const Tried& now, double depth_mm, const std::vector<double>& depths_mm) {
  const double stiffness = now.force.front() / depth_mm;
  std::vector<double> force;
  for (const double d : depths_mm) force.push_back(stiffness * d);
  return force;
}

// Another random cloud of the same trial, and the mean of both in the place of the first: at as many depths
// as both reach.
std::size_t average_with_another_cloud(Tried& now, const Case& given, const std::vector<double>& depths_mm,
                                       std::size_t depths) {
  ReadOrgan same = *given.organ;
  same.made = made_in(given.scene, now.result);
  Case again = given;
  again.organ = &same;
  ++again.scene.cloud.seed;
  const auto other = run(again, depths_mm);
  if (other.force.size() < depths) now.deeper = other.deeper;
  depths = std::min(depths, other.force.size());
  now.force.resize(depths);
  for (std::size_t k = 0; k < depths; ++k) now.force[k] = 0.5 * (now.force[k] + other.force[k]);
  return depths;
}

// Its forces beside those of the reference.
void compare(Alternative& alternative, const Trial& trial, const Case& given, Tried& now,
             const ForceReference& reference, double noise) {
  const bool same_cloud =
      trial.kind == Kind::cloud || same_nodes(now.result.model, reference.as_it_is.result.model);
  const std::vector<double>& compared = same_cloud ? reference.as_it_is.force : reference.mean;
  std::size_t depths = std::min({now.force.size(), compared.size(), reference.found.force.size()});
  // What is hardly more than clouds differ by is told from two.
  if (!same_cloud && std::abs(now.force[depths - 1] / compared[depths - 1] - 1.0) < few_noises * noise)
    depths = average_with_another_cloud(now, given, reference.depths_mm, depths);
  for (std::size_t k = 0; k < depths; ++k)
    alternative.effects.emplace_back(reference.depths_mm[k], now.force[k] / compared[k] - 1.0);
  std::tie(alternative.depth_mm, alternative.effect) = alternative.effects.back();
  alternative.force = (1.0 + alternative.effect) * reference.found.force[depths - 1];
  alternative.seconds = now.seconds;
  alternative.deeper = depths == now.force.size() ? now.deeper : "the unchanged run ends there";
}

using Say = std::function<void(const std::string&)>;

// Whether a case has the body of another: its image is read no other way, and its surface laid likewise.
bool has_same_body(const Case& a, const Scene& b) {
  const BodyChange& change = a.change;
  return !change.image && change.smoothing == 1.0 && change.outward_voxels == 0.0 &&
         a.scene.image.close_mm == b.image.close_mm;
}

// Runs it and compares; of a trial that fails, why. Nothing, where it has nothing to say.
std::optional<Alternative> try_out(const Trial& trial, ForceReference& reference, double noise,
                                   const Say& say) {
  Alternative alternative{trial.what, trial.instead, trial.all, trial.kind};
  const Stopwatch trying;
  try {
    const double depth_mm = trial.given.scene.depth_mm;
    Case given = trial.given;
    std::optional<ReadOrgan> changed;
    if (!has_same_body(given, reference.held)) unless_stopped([&] { changed = read_once(given, {}); });
    given.organ = changed ? &*changed : &reference.organ;
    Tried now = run(given, trial.linear ? std::vector{depth_mm} : reference.depths_mm);
    if (const std::string why = left_out(trial, now.result, reference.found.result); !why.empty()) {
      say(fmt::format("explain  {}: {}", trial.what, why));
      return std::nullopt;
    }
    if (trial.linear) now.force = proportional(now, depth_mm, reference.depths_mm);
    compare(alternative, trial, given, now, reference, noise);
    if (trial.what == "cloud") take_into_mean(reference, now.force);
  } catch (const Stopped&) {
    throw;
  } catch (const Error& error) {
    alternative.failed = error.report.fact;
  }
  if (alternative.seconds == 0.0) alternative.seconds = trying.seconds();
  return alternative;
}

void say_alternative(const Alternative& a, const Explanation& explanation, const Say& say) {
  say(fmt::format("explain  {}, {}: {}, {:.1f} s", a.what, instead_of(a, explanation),
                  a.failed.empty() ? with_sign(100.0 * a.effect) + " %" : a.failed, a.seconds));
}

// All comparisons with so many nodes; nothing, where these are too few: on a folded body, or because another
// random cloud has more effect than is to matter. Then `more` is how many to take, if it is asked for.
std::optional<Explanation> explain_with(Index nodes, Index* more, const Scene& given, const Say& progress) {
  const Stopwatch whole;
  const Scene scene = config_to_explain(given, nodes);
  const Say say = [&](const std::string& text) {
    if (progress) progress(text);
  };
  std::vector<double> depths_mm;
  for (int k = 1; k <= frames; ++k) depths_mm.push_back(scene.depth_mm * k / frames);

  ReadOrgan organ = read_once({.scene = scene}, {});
  Tried found = run({.scene = scene, .organ = &organ}, depths_mm);
  found.result.image = organ.read.image;  // which simulate() lets go of
  if (const Index least = nodes_to_explain(scene, found.result.facing_share); more && nodes < least) {
    *more = least;
    return std::nullopt;
  }
  const Vec3 down = found.result.model.axes * found.result.report.boundary.down;
  Explanation explanation{.nodes = scene.cloud.nodes,
                          .depth_mm = depths_mm[found.force.size() - 1],
                          .force = found.force.back(),
                          .seconds = found.seconds};
  for (const Finding& finding : found.result.findings) explanation.warnings.push_back(in_words(finding));
  say(fmt::format("explain  unchanged: {} with {} nodes, {:.1f} s",
                  force_title(explanation.force, explanation.depth_mm), explanation.nodes, found.seconds));

  try {
    // Numbers in place of words can move the tool by a last digit, and a cloud with it: changes are measured
    // from there.
    const Scene held = pinned(scene, found.result, down);
    const Tried as_it_is = run({.scene = held, .organ = &organ}, depths_mm);
    organ.made = made_in(held, as_it_is.result);
    ForceReference reference{.depths_mm = depths_mm,
                             .held = held,
                             .organ = organ,
                             .found = found,
                             .as_it_is = as_it_is,
                             .mean = as_it_is.force};
    for (const Trial& trial : trials_of({scene, held, found.result, down})) {
      std::optional<Alternative> alternative = try_out(trial, reference, explanation.noise, say);
      if (!alternative) continue;
      if (trial.what == "cloud" && alternative->failed.empty()) {
        explanation.noise = std::max(explanation.noise, std::abs(alternative->effect));
        if (more && explanation.noise > least_effect) {
          say(fmt::format("explain  another random cloud changes the force by {:.1f} %: more nodes are taken",
                          100.0 * explanation.noise));
          *more = std::min(2 * nodes, most_nodes_to_explain);
          return std::nullopt;
        }
      }
      say_alternative(*alternative, explanation, say);
      explanation.alternatives.push_back(*std::move(alternative));
    }
  } catch (const Stopped& stopped) {
    if (explanation.alternatives.empty()) throw;
    explanation.ended_by = stopped.report.fact;
  }
  sort_by_effect(explanation.alternatives);
  explanation.total_s = whole.seconds();
  return explanation;
}

}  // namespace

Explanation explain(const Scene& scene, Index nodes,
                    const std::function<void(const std::string&)>& progress) {
  check_pairs(scene, Feature::explain);
  if (nodes > 0) return *explain_with(nodes, nullptr, scene, progress);
  const Stopwatch whole;
  for (Index more = nodes_to_explain(scene, 0.0);;) {
    nodes = more;
    if (std::optional<Explanation> explanation =
            explain_with(nodes, nodes < most_nodes_to_explain ? &more : nullptr, scene, progress)) {
      explanation->total_s = whole.seconds();
      return *std::move(explanation);
    }
  }
}

std::string verdict(const Explanation& explanation, const Alternative& a) {
  if (!a.failed.empty()) return "no force: " + a.failed;
  if (std::abs(a.effect) > threshold(explanation)) return "matters";
  return a.kind == Kind::simplification && a.seconds < explanation.seconds ? "free" : "no matter";
}

namespace {

// What the table has of a comparison.
ChoiceTable::Row row_of(const Explanation& e, const Alternative& a) {
  const bool there = a.failed.empty();
  return {.what = a.what,
          .instead = instead_of(a, e),
          .all = a.all,
          .at = there && a.depth_mm < e.depth_mm ? "at " + length_in_words(a.depth_mm) : "",
          .kind = a.kind,
          .effect = there ? std::optional(100.0 * a.effect) : std::nullopt,
          .csv = fmt::format("{},{},{},{:g},{},{},{:.3g},{}", csv_field(a.what), csv_field(a.instead),
                             word_of(a.kind), a.depth_mm, there ? fmt::format("{:.6g}", a.force) : "",
                             there ? fmt::format("{:.4g}", 100.0 * a.effect) : "", a.seconds,
                             csv_field(verdict(e, a))),
          .verdict = verdict(e, a),
          .seconds = a.seconds};
}

}  // namespace

void write_explanation(const std::filesystem::path& folder, const Explanation& e,
                       const std::string& subject) {
  const std::string unchanged = fmt::format("{} with {} nodes", force_title(e.force, e.depth_mm), e.nodes);
  ChoiceTable table{
      .text = fmt::format(
          "{}: {}, in {:.1f} s. Each line repeats that run with one choice changed. Effects below {:.1f} % "
          "do "
          "not matter: "
          "another random cloud of nodes changes the force by {:.1f} %. By default a run makes none of the "
          "simplifications.\n\n",
          subject, unchanged, e.seconds, 100.0 * threshold(e), 100.0 * e.noise),
      .effect = "effect on the force, %",
      .csv_header = "choice,instead,kind,indentation_mm,force_N,effect_percent,wall_s,verdict",
      .title = fmt::format("What the force depends on: {}", subject),
      .subtitle = {fmt::format("{}; each bar repeats that run with one choice changed; {:.0f} s in all",
                               unchanged, e.total_s)},
      .axis = "effect on the force [%]",
      .shade = 100.0 * threshold(e),
      .shade_text = fmt::format("below {:.1f} %: no matter", 100.0 * threshold(e))};
  if (!e.run.empty()) {
    table.text =
        fmt::format("The run: {}. The comparisons: {}, so that the cloud of nodes does not decide them.\n\n",
                    e.run, unchanged) +
        table.text;
    table.subtitle.push_back("the run that this explains: " + e.run);
  }
  for (const std::string& warning : e.warnings)
    table.text = "Of the unchanged run: " + warning + ".\n\n" + table.text;
  if (!e.ended_by.empty()) table.text = "Some choices are missing: " + e.ended_by + ".\n\n" + table.text;
  for (const Alternative& a : e.alternatives) table.rows.push_back(row_of(e, a));
  write_choices(folder, table);
}

void write_choices(const std::filesystem::path& folder, const ChoiceTable& table) {
  // write_csv() takes numbers alone.
  std::string csv = table.csv_header + "\n";
  std::string text = table.text + fmt::format(
                                      "| choice | instead | kind | {} | s | "
                                      "|\n|---|---|---|---:|---:|---|\n",
                                      table.effect);
  std::map<std::string, std::size_t> place;
  Tornado tornado{.title = table.title,
                  .subtitle = table.subtitle,
                  .x_label = table.axis,
                  .shade = table.shade,
                  .shade_text = table.shade_text,
                  .legend = {{0, "not known from the image"}, {2, "the discretisation"}}};
  for (const ChoiceTable::Row& row : table.rows) {
    csv += row.csv + "\n";
    text += fmt::format("| {} | {} | {} | {} | {:.1f} | {} |\n", row.what, row.instead, word_of(row.kind),
                        row.effect ? with_sign(*row.effect) : "", row.seconds, row.verdict);
    if (row.kind == Kind::simplification) tornado.legend[1] = "could be left out";
    if (!row.effect) continue;
    const auto [at, is_new] = place.emplace(row.what, tornado.rows.size());
    if (is_new)
      tornado.rows.push_back({.name = row.what,
                              .note = row.all,
                              .colour = row.kind == Kind::cloud   ? 2
                                        : row.kind == Kind::doubt ? 0
                                                                  : 1});
    Tornado::Row& bar = tornado.rows[at->second];
    if (!row.at.empty() && bar.note.find(row.at) == std::string::npos)
      bar.note += (bar.note.empty() ? "" : ", ") + row.at;
    bar.low = std::min(bar.low, *row.effect);
    bar.high = std::max(bar.high, *row.effect);
  }
  write_file(folder / "explain.csv", csv);
  for (const char* name : {"explain.png", "explain.svg"}) write_tornado(folder / name, {tornado});
  write_file(folder / "explain.md", text);
}

}  // namespace dimple
