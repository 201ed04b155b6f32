#include "apps/studies/stress_maps.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <sstream>

#include "io/error.hpp"

namespace dimple {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// Even steps down into a block of 30 mm.
StressAxis depths(int count, double deepest_mm) {
  StressAxis axis{
      .key = "load.depth_mm", .label = "indentation [mm], and as a part of the height", .values = {}};
  for (int k = 1; k <= count; ++k) {
    const double depth = deepest_mm * k / count;
    axis.values.push_back(fmt::format("{}", depth));
    axis.ticks.push_back(fmt::format("{} mm, {:.0f} %", depth, 100.0 * depth / 30.0));
  }
  return axis;
}

// Where waves are followed, 2 mm/s is slow, too: what the start excites stays below a per cent of the force.
std::vector<std::pair<std::string, std::string>> scene(
    std::vector<std::pair<std::string, std::string>> special) {
  std::vector<std::pair<std::string, std::string>> all = {
      {"boundary.base", "inferior"}, {"boundary.indent_at", "0,0,top"}, {"load.rate_mm_per_s", "2"}};
  all.insert(all.end(), special.begin(), special.end());
  return all;
}

double kink_at(const StressRun& run, std::size_t k) {
  // F(k+1) is frame k + 1; frame 0 is at rest.
  const auto F = [&](std::size_t n) { return n == 0 ? 0.0 : run.frames[n - 1].force_N; };
  if (k < 2) return 0.0;
  const double slope = std::abs(F(k + 1)) / static_cast<double>(k + 1);
  return std::abs(F(k + 1) - 3.0 * F(k) + 3.0 * F(k - 1) - F(k - 2)) / std::max(slope, 1e-300);
}

// All but the comparison with a finer run; empty: nothing is wrong.
std::string own_fault(const StressRun& run, std::size_t last, double circle_radius_mm, StressVerdict& v) {
  if (run.frames.size() < last) return run.ended.empty() ? "crashed" : run.ended;
  for (std::size_t n = 1; n <= last; ++n) {
    const StressFrame& f = run.frames[n - 1];
    if (!std::isfinite(f.force_N) || !std::isfinite(f.energy_error) || !std::isfinite(f.J_min))
      return "non-finite";
    if (n >= 3) v.kink = std::max(v.kink, kink_at(run, n - 1));
  }
  const StressFrame& f = run.frames[last - 1];
  v.energy_error = f.energy_error;
  v.J_min = f.J_min;
  v.inverted = f.inverted;
  v.inverted_mm3 = f.inverted_mm3;
  const double half_ball = 2.0 / 3.0 * std::numbers::pi * std::pow(circle_radius_mm, 3);
  if (v.energy_error > survival::energy) return "energy";
  if (v.inverted_mm3 > survival::inverted * half_ball) return "inverted";
  if (v.kink > survival::kink) return "kinked";
  return {};
}

}  // namespace

const std::vector<StressMap>& stress_maps() {
  static const std::vector<std::string> clouds = {"250", "500", "1000", "2000"};
  static const std::vector<StressMap> maps = {
      {.name = "depth-nu",
       .title = "Depth and Poisson's ratio",
       .scene = "block 60 x 60 x 30 mm, circle of 10 mm, bonded; 2000 nodes; at most 3000 evaluations an "
                "equilibrium",
       .x = {.key = "material.nu",
             .label = "Poisson's ratio",
             .values = {"0.3", "0.45", "0.49", "0.499", "0.4999"}},
       .y = depths(14, 21.0),
       .settings = scene({{"cloud.nodes", "2000"}, {"solver.evaluations", "3000"}})},
      {.name = "support-nodes",
       .title = "Support size and node spacing",
       .scene = "block 60 x 60 x 30 mm, circle of 10 mm, bonded, 4 mm deep",
       .x = {.key = "support.radius_factor",
             .label = "support radius, in node spacings",
             .values = {"1.2", "1.4", "1.6", "1.8", "2.2", "3"}},
       .y = {.key = "cloud.nodes", .label = "nodes", .values = clouds},
       .settings = scene({{"load.depth_mm", "4"}, {"solver.frames", "8"}})},
      {.name = "jitter-points",
       .title = "Irregularity of the cloud and integration points per node",
       .scene = "block 60 x 60 x 30 mm, circle of 10 mm, bonded, 4 mm deep; 1000 nodes",
       .x = {.key = "grid.ratio",
             .label = "integration points per node",
             .values = {"0.7", "1.5", "2.5", "4", "7", "12"}},
       .y = {.key = "cloud.jitter",
             .label = "nodes moved by up to this part of their spacing",
             .values = {"0", "0.1", "0.2", "0.35", "0.5"}},
       .settings = scene({{"cloud.nodes", "1000"}, {"load.depth_mm", "4"}, {"solver.frames", "8"}})},
      {.name = "step-depth",
       .title = "Time step and depth, explicit dynamics",
       .scene = "block 60 x 60 x 30 mm, circle of 10 mm, bonded, --time explicit --damping 5; 2000 nodes",
       .x = {.key = "solver.safety",
             .label = "time step, as a part of the stable step that was estimated",
             .values = {"0.6", "0.9", "1", "1.05", "1.2", "2"}},
       .y = depths(10, 10.0),
       .settings = scene({{"cloud.nodes", "2000"},
                          {"solver.time", "explicit"},
                          {"solver.damping_per_s", "5"},
                          {"load.rate_mm_per_s", "1"}})},
      {.name = "circle-nodes",
       .title = "Size of the indenter and node spacing",
       .scene = "block 60 x 60 x 30 mm, bonded, 2 mm deep",
       .x = {.key = "boundary.indenter_diameter_mm",
             .label = "diameter of the circle [mm]",
             .values = {"2", "4", "6", "10", "20", "40"}},
       .y = {.key = "cloud.nodes", .label = "nodes", .values = clouds},
       .settings = scene({{"load.depth_mm", "2"}, {"solver.frames", "8"}})},
      {.name = "layer-nodes",
       .title = "Thin layers and node spacing",
       .scene = "layer of 40 x 40 mm, held below, circle of 10 mm, bonded, 0.2 mm deep",
       .x = {.key = "phantom.height_mm",
             .label = "height of the layer [mm]",
             .values = {"1", "2", "3", "5", "10", "20"}},
       .y = {.key = "cloud.nodes", .label = "nodes", .values = clouds},
       .settings = scene({{"load.depth_mm", "0.2"}, {"solver.frames", "4"}, {"load.rate_mm_per_s", "0.2"}}),
       .block_mm = {40.0, 40.0, 20.0}},
  };
  return maps;
}

void check_axis(const StressAxis& axis, const std::string& flag) {
  const auto refuse = [&](const std::string& fact, const std::string& why) {
    throw UsageError({.fact = fact,
                      .where = flag,
                      .why = why,
                      .remedy = fmt::format("for instance {} material.nu=0.3,0.45,0.499", flag)});
  };
  if (axis.values.size() < 2)
    refuse(fmt::format("{} has {} value{}", axis.key, axis.values.size(), axis.values.size() == 1 ? "" : "s"),
           "a side of a map has at least two");
  if (std::set<std::string>(axis.values.begin(), axis.values.end()).size() < axis.values.size())
    refuse(fmt::format("a value of {} is given twice", axis.key), "each is a column or row of its own");
  if (axis.is_height()) return;
  std::vector<double> depth;
  for (const std::string& value : axis.values) {
    Config scratch;
    set_option(scratch, axis.key, value, flag);
    depth.push_back(scratch.load.depth_mm);
  }
  if (!axis.is_depth()) return;
  for (std::size_t k = 0; k < depth.size(); ++k) {
    const double even = depth.back() * static_cast<double>(k + 1) / static_cast<double>(depth.size());
    if (std::abs(depth[k] - even) > 1e-6 * depth.back())
      refuse(
          fmt::format("the depths are not even steps: {} where {:.6g} mm is expected", axis.values[k], even),
          "all of them come from one run, whose frames are evenly apart");
  }
}

StressAxis stress_axis(const std::string& text, const std::string& flag) {
  const auto equals = text.find('=');
  if (equals == std::string::npos)
    throw UsageError({.fact = fmt::format("'{}' is not key=value,value", text),
                      .where = flag,
                      .why = "there is no =",
                      .remedy = fmt::format("for instance {} material.nu=0.3,0.45,0.499", flag)});
  StressAxis axis{.key = text.substr(0, equals), .values = {}};
  std::stringstream parts(text.substr(equals + 1));
  for (std::string part; std::getline(parts, part, ',');) axis.values.push_back(part);
  if (axis.is_height()) {
    check_axis(axis, flag);
    return axis;
  }
  // The whole key, also where it was given without its unit; an unknown one is refused.
  Config scratch;
  set_option(scratch, axis.key, axis.values.empty() ? "" : axis.values.front(), flag);
  axis.key = scratch.source.begin()->first;
  check_axis(axis, flag);
  axis.label = axis.key;
  return axis;
}

bool is_physical(const std::string& key) {
  static const std::set<std::string> numerical = {"scheme", "cloud", "grid", "support", "solver"};
  return !numerical.contains(key.substr(0, key.find('.')));
}

Config finest_of(const Config& config, Index nodes) {
  Config fine;
  fine.image = config.image;
  fine.boundary = config.boundary;
  fine.material = config.material;
  fine.tissue = config.tissue;
  fine.load = config.load;
  fine.solver.frames = config.solver.frames;
  fine.solver.evaluations = config.solver.evaluations;
  fine.cloud.nodes = nodes;
  return fine;
}

StressVerdict judge(const StressRun& run, const std::vector<StressRun>& finest, std::size_t last,
                    bool at_last_only, double circle_radius_mm) {
  StressVerdict v{.code = {}, .force_N = nan, .reference_N = nan};
  if (run.frames.size() >= last) v.force_N = run.frames[last - 1].force_N;
  const auto reference = std::find_if(finest.begin(), finest.end(), [&](const StressRun& r) {
    StressVerdict unused;
    return own_fault(r, last, circle_radius_mm, unused).empty();
  });
  if (reference != finest.end()) {
    v.reference_N = reference->frames[last - 1].force_N;
    v.reference_nodes = reference->nodes;
    for (std::size_t n = at_last_only ? last : 1; n <= std::min(last, run.frames.size()); ++n) {
      const double error = run.frames[n - 1].force_N / reference->frames[n - 1].force_N - 1.0;
      if (!(std::abs(error) <= std::abs(v.error))) v.error = error;
    }
  }
  v.code = own_fault(run, last, circle_radius_mm, v);
  if (!v.code.empty()) return v;
  if (reference == finest.end())
    v.code = "unchecked";
  else if (!(std::abs(v.error) <= survival::error))
    v.code = "inaccurate";
  else
    v.code = v.inverted > 0 ? "ok-rim" : "ok";
  return v;
}

bool survived(const std::string& code) {
  return code.starts_with("ok");
}

std::string meaning_of(const std::string& code) {
  static const std::map<std::string, std::string> meaning = {
      {"ok", "survived: finished, smooth, energy balanced, det F > 0, force within 5 % of the finest"},
      {"ok-rim",
       "survived, but some points at the rim are inverted: below 1 % of the half ball under the circle"},
      {"inaccurate", "the force differs by over 5 % from the finest stable run of the same case"},
      {"inverted", "points are inverted: over 1 % of the half ball under the circle, or the run stopped"},
      {"kinked", "the force curve bends or drops: its slope changes suddenly by over 25 % of the mean slope"},
      {"energy", "over 2 % of the tool's work is not accounted for, or the run stopped for it"},
      {"unchecked", "no finer run is stable here"},
      {"non-finite", "a number is no longer one"},
      {"no-equilibrium", "the iteration for an equilibrium or a step did not converge"},
      {"no-model", "the model could not be built"},
      {"time-out", "not finished within the time limit"},
      {"crashed", "the program died"},
      {"volume", "volume far from that at rest, though nearly incompressible"},
      {"kinetic", "waves where the answer should be static"},
      {"jagged", "the force jumps from sample to sample"},
      {"time-step", "the time step is above the stable one"},
      {"conditioning", "moment matrices near singular"},
      {"supports", "points that see too few nodes"},
      {"circle-nodes", "too few nodes under the circle"},
      {"hourglass", "deformation that the points do not see"}};
  const auto found = meaning.find(code);
  return found == meaning.end() ? "the run failed" : found->second;
}

}  // namespace dimple
