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
#include "apps/run/other_tools.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/unless_stopped.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
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

Tried run(const Case& given, const std::vector<double>& depths_mm) {
  const Stopwatch whole;
  Tried tried;
  double gave_way_mm = INFINITY;
  const RunObserver observer{.march = {.sample = [&](const ForceSample& sample, const History& history) {
                               if (!(gave_way_mm < INFINITY) && has_limit_point(history))
                                 gave_way_mm = 1e3 * sample.depth;
                               return stop_asked() == StopReason::none;
                             }}};
  try {
    unless_stopped([&] { simulate(given, observer, tried.result); });
  } catch (const SolveError&) {
    tried.force = forces_at(tried.result.history.force, depths_mm);
    if (tried.force.empty()) throw;
    tried.deeper = "no equilibrium was found deeper";
  }
  if (tried.result.history.interrupted) throw Stopped(stop_asked());
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
  tried.seconds = whole.seconds();
  return tried;
}

std::string vector_text(const Vec3& v) {
  return fmt::format("{:.9g},{:.9g},{:.9g}", v.x(), v.y(), v.z());
}

// The scene as it was found, with its places as numbers: a change of the body does not move the tool.
Config pinned(Config config, const Result& found, const Vec3& down) {
  const auto& tool = found.model.tool;
  config.boundary.indent_at = vector_text(1e3 * tool.centre);
  config.boundary.direction = vector_text(tool.push);
  config.boundary.base = vector_text(down);
  if (config.solver.time == "auto")
    config.solver.time = found.time == TimeMode::quasi_static ? "quasi-static" : "explicit";
  return config;
}

// What is rigid beside the body: not there, and with friction.
template <class Add>
void add_walls(const Add& add) {
  add("walls", "", "none", Kind::simplification, [](Case& c) {
    c.config.wall.clear();
    c.config.load.wall = "none";
  });
  const std::string friction = "0.3";
  add("walls' friction", "", friction, Kind::doubt, [&](Case& c) {
    for (const auto& [name, wall] : walls_named(c.config)) c.config.wall[name].friction = friction;
  });
}

// In the order in which they are run.
std::vector<Trial> trials_of(const Config& config, const Config& held, const Result& found,
                             const Vec3& down) {
  std::vector<Trial> trials;
  const auto add = [&](const char* what, const std::string& all, const std::string& instead, Kind kind,
                       auto change) {
    Trial trial{what, instead, all.empty() ? instead : all, kind, {.config = held}};
    change(trial.given);
    trials.push_back(std::move(trial));
  };
  const Boundary& boundary = found.report.boundary;
  const auto& tool = found.model.tool;
  const Touch* touch = found.loading.touch.get();
  const double radius_mm = 1e3 * (touch ? touch->shape.radius : tool.radius);
  const std::string name = touch ? "tool" : "circle";

  for (const int more : {1, 2})
    add("cloud", "two other random clouds",
        fmt::format("seed {} instead of {}", config.cloud.seed + more, config.cloud.seed), Kind::cloud,
        [&](Case& c) { c.config.cloud.seed += more; });
  add("number of nodes", "", fmt::format("{} instead of {}", 2 * config.cloud.nodes, config.cloud.nodes),
      Kind::cloud, [](Case& c) { c.config.cloud.nodes *= 2; });

  const double ratio = scheme_of(config).points_per_node;
  add("integration points", "", fmt::format("{} per node instead of {}", plain(2.0 * ratio), plain(ratio)),
      Kind::cloud, [&](Case& c) {
        c.config.grid.points = 0;
        c.config.grid.ratio = 2.0 * ratio;
      });
  const double tolerance = config.solver.tolerance;
  add("equilibrium", "",
      fmt::format("to {} of the reactions instead of {}", plain(0.1 * tolerance), plain(tolerance)),
      Kind::cloud, [&](Case& c) { c.config.solver.tolerance = std::max(0.1 * tolerance, 1e-8); });
  const double step = config.solver.step_radii;
  add("steps of the load", "", fmt::format("{:g} instead of {:g} radii of the {}", 0.5 * step, step, name),
      Kind::cloud, [&](Case& c) { c.config.solver.step_radii = std::max(0.5 * step, 0.001); });

  const bool bonded = config.load.contact == "bonded";
  if (touch)
    for (const ToolChoice& choice : tool_choices(touch->shape, touch->friction))
      add(choice.what, choice.all, choice.instead, Kind::doubt, [&](Case& c) {
        c.change.tool = choice.shape;
        c.config.tool.friction = choice.friction;
      });
  else
    add("contact", "", bonded ? "frictionless instead of bonded" : "bonded instead of frictionless",
        Kind::doubt, [&](Case& c) { c.config.load.contact = bonded ? "frictionless" : "bonded"; });

  const std::vector<double> heights =
      boundary.flat_base ? std::vector<double>{boundary.height / 6.0}
                         : std::vector<double>{0.5 * boundary.base_depth, 1.5 * boundary.base_depth};
  if (has_base(config))
    for (const double height : heights)
      add("base",
          heights.size() < 2 ? ""
                             : fmt::format("held to {:.1f} or {:.1f} mm instead of {:.1f} mm", heights[0],
                                           heights[1], boundary.base_depth),
          fmt::format("held to {:.1f} mm instead of {:.1f} mm", height, boundary.base_depth), Kind::doubt,
          [&](Case& c) { c.config.boundary.base_depth_mm = height; });

  Index axis = 0;
  tool.push.cwiseAbs().minCoeff(&axis);
  const Vec3 u = (Vec3::Unit(axis) - tool.push[axis] * tool.push).normalized(), v = tool.push.cross(u);
  for (const Vec3& step : {u, Vec3(-u), v, Vec3(-v)}) {
    const Vec3 shown = step.array() + 0.0;  // no -0
    add(touch ? "tool's place" : "circle", fmt::format("moved by {:g} mm in four directions", tool_step_mm),
        fmt::format("moved by {:g} mm along ({:+.1f}, {:+.1f}, {:+.1f})", tool_step_mm, shown.x(), shown.y(),
                    shown.z()),
        Kind::doubt,
        [&](Case& c) { c.config.boundary.indent_at = vector_text(1e3 * tool.centre + tool_step_mm * step); });
  }

  for (const double outward : {0.5, -0.5})
    add("segmentation", "half a voxel larger or smaller",
        fmt::format("half a voxel {}", outward > 0.0 ? "larger" : "smaller"), Kind::doubt,
        [&](Case& c) { c.change.outward_voxels = outward; });
  for (const double smoothing : {0.5, 2.0})
    add("surface",
        fmt::format("smoothed by {:.2f} or {:.2f} mm instead of {:.2f} mm", 0.5 * found.segment.smoothing_mm,
                    2.0 * found.segment.smoothing_mm, found.segment.smoothing_mm),
        fmt::format("smoothed by {:.2f} mm instead of {:.2f} mm", smoothing * found.segment.smoothing_mm,
                    found.segment.smoothing_mm),
        Kind::doubt, [&](Case& c) { c.change.smoothing = smoothing; });
  add("voxels", "", "twice as large", Kind::simplification,
      [](Case& c) { c.change.image = in_double_voxels; });
  if (config.image.close_mm > 0.0)
    add("folds", "", fmt::format("open instead of closed below {} mm", plain(config.image.close_mm)),
        Kind::doubt, [](Case& c) { c.config.image.close_mm = 0.0; });
  else
    add("folds", "", fmt::format("closed below {} mm", plain(narrow_gap_mm)), Kind::doubt,
        [](Case& c) { c.config.image.close_mm = narrow_gap_mm; });
  if (found.facing_share > most_facing && found.time == TimeMode::quasi_static && !folds_touch(config))
    add("walls of folds", "", "touch where they close, without friction", Kind::doubt,
        [](Case& c) { c.config.load.self_contact = "on"; });

  const double small_mm = small_depth_radii * radius_mm;
  // The force of a tool that touches is not proportional to its depth at small strain either.
  if (!touch && small_mm < config.load.depth_mm && found.time == TimeMode::quasi_static) {
    add("strain", "", "small instead of large", Kind::simplification, [&](Case& c) {
      // Supports come as far as they have when the tool is there.
      for (auto& [name, support] : c.config.held)
        for (double& way : support.move_mm) way *= small_mm / config.load.depth_mm;
      c.config.load.depth_mm = small_mm;
      c.config.solver.frames = 1;
    });
    trials.back().linear = true;
  }
  add("far tissue", "",
      fmt::format("cut away beyond {:.0f} mm of the {}'s axis", far_radii * radius_mm, name),
      Kind::simplification, [&](Case& c) {
        const std::vector<int> labels = found.segment.labels;
        const Vec3 centre = 1e3 * tool.centre, push = tool.push;
        const double away = far_radii * radius_mm;
        const LabelImage near = without_far_tissue(found.image, centre, push, away);
        // Without its lowest part the body is held as far up as before.
        if (!boundary.flat_base)
          c.config.boundary.base_depth_mm = std::max(
              boundary.base_depth - reach_of(found.image, labels, down) + reach_of(near, labels, down), 0.1);
        c.change.image = [=](const LabelImage& image) {
          return without_far_tissue(image, centre, push, away);
        };
      });
  if (config.material.preset == "none") {
    constexpr double nearly = 0.49, more_nearly = 0.499;
    const double nu = config.material.nu > 0.5 * (nearly + more_nearly) ? nearly : more_nearly;
    add("Poisson's ratio", "", fmt::format("{} instead of {}", plain(nu), plain(config.material.nu)),
        Kind::simplification, [&](Case& c) { c.config.material.nu = nu; });
  }
  const bool dynamic = found.time != TimeMode::quasi_static;
  if (has_walls(config)) add_walls(add);
  if (!touch && !has_walls(config))
    add("inertia", "", dynamic ? "neglected" : "included", dynamic ? Kind::simplification : Kind::doubt,
        [&](Case& c) { c.config.solver.time = dynamic ? "quasi-static" : "dynamic"; });
  if (!config.tissue.empty()) {
    add("tissues", "", "all of one material", Kind::simplification, [](Case& c) { c.config.tissue.clear(); });
  }
  return trials;
}

// Whether the change has changed nothing: then it has nothing to say.
std::string left_out(const Trial& trial, const Result& now, const Result& found) {
  if (trial.what == "folds" && trial.given.config.image.close_mm > 0.0 && now.closed_mm3 == 0.0)
    return "no gap is that narrow";
  if (const Config& config = trial.given.config;
      trial.what == "far tissue" && !(config.held.empty() && config.pressure.empty() && !has_walls(config)))
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

Index nodes_to_explain(const Config& config, double facing_share) {
  return std::max(fewest_nodes_under_tool(config),
                  facing_share > most_facing ? Index{2000} : Config{}.cloud.nodes);
}

std::vector<ToolChoice> tool_choices(const ToolShape& shape, double friction) {
  std::vector<ToolChoice> choices;
  const std::string same = std::isinf(friction) ? "stick" : fmt::format("{}", friction);
  const auto add_length = [&](const char* what, double ToolShape::*length, double share, double least,
                              double most) {
    for (const double sign : {1.0, -1.0}) {
      ToolShape other = shape;
      other.*length = std::clamp(shape.*length * (1.0 + sign * share), least, most);
      if (other.*length == shape.*length) continue;
      choices.push_back({what, fmt::format("{:g} % larger or smaller", 100.0 * share),
                         fmt::format("{} instead of {}", length_in_words(1e3 * other.*length),
                                     length_in_words(1e3 * shape.*length)),
                         other, same});
    }
  };
  constexpr double well_known = 0.02, hardly_known = 0.2, any = std::numeric_limits<double>::infinity();
  if (!shape.mesh)
    add_length("tool's radius", &ToolShape::radius, well_known, shape.edge,
               shape.kind == ToolShape::Kind::capsule ? 0.5 * shape.length : any);
  if (shape.kind == ToolShape::Kind::punch)
    add_length("tool's edge", &ToolShape::edge, hardly_known, sharpest_edge * shape.radius, shape.radius);

  std::vector<std::string> others;
  for (const auto& [value, text, word] :
       {std::tuple{0.0, "0", "none"}, {0.3, "0.3", "0.3"}, {any, "stick", "stuck"}})
    if (value != friction) {
      others.emplace_back(word);
      choices.push_back(
          {"friction",
           {},
           fmt::format("{} instead of {}", friction_in_words(value), friction_in_words(friction)),
           shape,
           text});
    }
  const std::string last = others.back();
  others.pop_back();
  for (ToolChoice& choice : choices)
    if (choice.all.empty()) choice.all = fmt::format("{} or {}", fmt::join(others, ", "), last);
  return choices;
}

void check_explainable(const Config& config) {
  require_no_steps(config, "--explain");
  require_one_tool(config, "--explain");
  require_no_membranes(config, "--explain");
  if (config.scheme.name != Config{}.scheme.name)
    throw UsageError({.fact = "the comparisons of --explain need the converging scheme",
                      .where = "--explain and --scheme",
                      .why = "the error of the other scheme is larger than most effects that are compared",
                      .remedy = "leave one of them out"});
}

namespace {

// All comparisons with so many nodes; nothing, where these are too few: on a folded body, or because another
// random cloud has more effect than is to matter. Then `more` is how many to take, if it is asked for.
std::optional<Explanation> explain_with(Index nodes, Index* more, const Config& given,
                                        const std::function<void(const std::string&)>& progress) {
  const Stopwatch whole;
  Config config = given;
  config.accuracy = {};
  config.material.mu_spread_percent = 0.0;
  config.cloud.spacing_mm = 0.0;
  config.cloud.nodes = nodes;
  config.source["cloud.nodes"] = "explain";
  config.solver.frames = frames;
  const auto say = [&](const std::string& text) {
    if (progress) progress(text);
  };

  std::vector<double> depths_mm;
  for (int k = 1; k <= frames; ++k) depths_mm.push_back(config.load.depth_mm * k / frames);

  // simulate() lets go of the image, and cutting away what is far needs it.
  LabelImage image;
  Tried found =
      run({.config = config, .change = {.image = [&](const LabelImage& read) { return image = read; }}},
          depths_mm);
  if (const Index least = nodes_to_explain(config, found.result.facing_share); more && nodes < least) {
    *more = least;
    return std::nullopt;
  }
  found.result.image = std::move(image);
  const Vec3 down = found.result.model.axes * found.result.report.boundary.down;
  Explanation explanation{.nodes = config.cloud.nodes,
                          .depth_mm = depths_mm[found.force.size() - 1],
                          .force = found.force.back(),
                          .seconds = found.seconds};
  for (const Finding& finding : found.result.findings) explanation.warnings.push_back(in_words(finding));
  say(fmt::format("explain  unchanged: {} with {} nodes, {:.1f} s",
                  force_title(explanation.force, explanation.depth_mm), explanation.nodes, found.seconds));

  try {
    // Numbers in place of words can move the tool by a last digit, and a cloud with it: changes are measured
    // from there.
    const Config held = pinned(config, found.result, down);
    const Tried as_it_is = run({.config = held}, depths_mm);
    std::vector<double> mean = as_it_is.force;  // of the clouds so far
    int clouds = 1;
    for (const Trial& trial : trials_of(config, held, found.result, down)) {
      Alternative alternative{trial.what, trial.instead, trial.all, trial.kind};
      const Stopwatch trying;
      try {
        Tried now =
            run(trial.given, trial.linear ? std::vector{trial.given.config.load.depth_mm} : depths_mm);
        if (const std::string why = left_out(trial, now.result, found.result); !why.empty()) {
          say(fmt::format("explain  {}: {}", trial.what, why));
          continue;
        }
        if (trial.linear) {
          const double stiffness = now.force.front() / trial.given.config.load.depth_mm;
          now.force.clear();
          for (const double depth_mm : depths_mm) now.force.push_back(stiffness * depth_mm);
        }
        const bool same_cloud =
            trial.kind == Kind::cloud || same_nodes(now.result.model, as_it_is.result.model);
        const std::vector<double>& compared = same_cloud ? as_it_is.force : mean;
        std::size_t depths = std::min({now.force.size(), compared.size(), found.force.size()});
        // What is hardly more than clouds differ by is told from two.
        if (!same_cloud &&
            std::abs(now.force[depths - 1] / compared[depths - 1] - 1.0) < few_noises * explanation.noise) {
          Case again = trial.given;
          ++again.config.cloud.seed;
          const auto other = run(again, depths_mm);
          if (other.force.size() < depths) now.deeper = other.deeper;
          depths = std::min(depths, other.force.size());
          now.force.resize(depths);
          for (std::size_t k = 0; k < depths; ++k) now.force[k] = 0.5 * (now.force[k] + other.force[k]);
        }
        for (std::size_t k = 0; k < depths; ++k)
          alternative.effects.emplace_back(depths_mm[k], now.force[k] / compared[k] - 1.0);
        std::tie(alternative.depth_mm, alternative.effect) = alternative.effects.back();
        alternative.force = (1.0 + alternative.effect) * found.force[depths - 1];
        alternative.seconds = now.seconds;
        alternative.deeper = depths == now.force.size() ? now.deeper : "the unchanged run ends there";
        if (trial.what == "cloud") {
          mean.resize(std::min(mean.size(), now.force.size()));
          for (std::size_t k = 0; k < mean.size(); ++k) mean[k] += (now.force[k] - mean[k]) / (clouds + 1);
          ++clouds;
          explanation.noise = std::max(explanation.noise, std::abs(alternative.effect));
          if (more && explanation.noise > least_effect) {
            say(fmt::format(
                "explain  another random cloud changes the force by {:.1f} %: more nodes are taken",
                100.0 * explanation.noise));
            *more = std::min(2 * nodes, most_nodes_to_explain);
            return std::nullopt;
          }
        }
      } catch (const Stopped&) {
        throw;
      } catch (const Error& error) {
        alternative.failed = error.report.fact;
      }
      if (alternative.seconds == 0.0) alternative.seconds = trying.seconds();
      say(fmt::format(
          "explain  {}, {}: {}, {:.1f} s", trial.what, instead_of(alternative, explanation),
          alternative.failed.empty() ? with_sign(100.0 * alternative.effect) + " %" : alternative.failed,
          alternative.seconds));
      explanation.alternatives.push_back(std::move(alternative));
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

Explanation explain(const Config& config, Index nodes,
                    const std::function<void(const std::string&)>& progress) {
  check_explainable(config);
  if (nodes > 0) return *explain_with(nodes, nullptr, config, progress);
  const Stopwatch whole;
  for (Index more = nodes_to_explain(config, 0.0);;) {
    nodes = more;
    if (std::optional<Explanation> explanation =
            explain_with(nodes, nodes < most_nodes_to_explain ? &more : nullptr, config, progress)) {
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
    bar.low = std::min(bar.low, *row.effect);
    bar.high = std::max(bar.high, *row.effect);
  }
  write_file(folder / "explain.csv", csv);
  write_tornado_png(folder / "explain.png", {tornado});
  write_tornado_svg(folder / "explain.svg", {tornado});
  write_file(folder / "explain.md", text);
}

}  // namespace dimple
