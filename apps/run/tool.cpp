#include "apps/run/tool.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <vector>

#include "apps/run/option_word.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/surface_mesh.hpp"

namespace dimple {
namespace {

constexpr double usual_depth = 0.8;           // of the radius
constexpr double power_of_a_round_tip = 1.5;  // Hertz
const std::string by_tool = "the tool";

// A tool with lengths: how it is written, made and described. A new shape is one more row.
struct ToolKind {
  WordForm form;
  ToolShape (*make)(const std::vector<double>& lengths);
  std::string (*words)(const ToolShape& shape);
  std::vector<double> doubt;  // relative uncertainty of each length; 0: certain
};

std::string length_words(double metres) {
  return length_in_words(1e3 * metres);
}

std::vector<ToolKind> make_tool_kinds() {
  constexpr double well_known = 0.02, hardly_known = 0.2;
  constexpr double largest_mm = 1000.0;
  const WordNumber radius = length_number("radius", 1e-3, largest_mm);
  WordNumber edge = length_number("edge", 1e-3, largest_mm),
             length = length_number("length", 1e-3, largest_mm);
  edge.least_of_first = sharpest_edge, edge.most_of_first = 1.0;
  length.least_of_first = 2.0;  // both its round ends
  return {{{"sphere", {radius}, "sphere:5mm"},
           [](const std::vector<double>& l) { return sphere_shape(l[0]); },
           [](const ToolShape& s) { return fmt::format("a sphere of {} radius", length_words(s.radius)); },
           {well_known}},
          {{"punch", {radius}, "punch:5mm,edge=1mm", {edge}},
           [](const std::vector<double>& l) { return punch_shape(l[0], l[1]); },
           [](const ToolShape& s) {
             return fmt::format("a flat punch of {} radius with an edge of {}", length_words(s.radius),
                                length_words(s.edge));
           },
           {well_known, hardly_known}},
          {{"capsule", {radius}, "capsule:2mm,length=20mm", {length}},
           [](const std::vector<double>& l) { return capsule_shape(l[0], l[1]); },
           [](const ToolShape& s) {
             return fmt::format("a round-ended rod of {} radius, {} long", length_words(s.radius),
                                length_words(s.length));
           },
           {well_known, 0.0}}};
}

const std::vector<ToolKind>& tool_kinds() {
  static const std::vector<ToolKind> kinds = make_tool_kinds();
  return kinds;
}

// Null: a shape that has no lengths.
const ToolKind* kind_of(const std::string& name) {
  const std::vector<ToolKind>& kinds = tool_kinds();
  const auto found =
      std::find_if(kinds.begin(), kinds.end(), [&](const ToolKind& kind) { return kind.form.kind == name; });
  return found == kinds.end() ? nullptr : &*found;
}

WordTable make_tool_words() {
  WordTable table{
      "the tool",
      {{"circle"}},
      fmt::format("it is circle, or a shape that touches; a mesh is read from {} files", surface_suffixes),
      true};
  for (const ToolKind& kind : tool_kinds()) table.forms.push_back(kind.form);
  return table;
}

// A file is read and checked once: that may take a second, and many ask.
std::shared_ptr<const ToolMesh> drawn_in(const std::filesystem::path& file) {
  static std::mutex one_at_a_time;
  static std::map<std::pair<std::string, std::filesystem::file_time_type>, std::shared_ptr<const ToolMesh>>
      known;
  constexpr std::size_t most_known = 8;
  const std::lock_guard<std::mutex> lock(one_at_a_time);
  std::error_code missing;  // said by the reader
  const auto changed = std::filesystem::last_write_time(file, missing);
  const std::pair key{std::filesystem::absolute(file).string(), changed};
  if (known.size() >= most_known && !known.contains(key)) known.clear();
  std::shared_ptr<const ToolMesh>& mesh = known[key];
  if (!mesh) {
    const SurfaceFile surface = read_surface_mesh(file);
    mesh = std::make_shared<const ToolMesh>(
        tool_mesh(surface.position_mm, surface.triangles, file.filename().string()));
  }
  return mesh;
}

}  // namespace

std::optional<ToolShape> tool_of(const Config& config) {
  return tool_of(config.tool.shape, "--tool (tool.shape)");
}

double longest_step_radii(const Config& config) {
  constexpr double shortest = 0.001;
  const double step = config.solver.step_radii;
  if (step > 0.0 && step < shortest)
    throw UsageError(
        {.fact = fmt::format("steps of the load of {:g} radii are asked for", step),
         .where = "solver.step_radii",
         .why = fmt::format("the shortest are {:g} radii: a radius takes a thousand of them", shortest),
         .remedy = "give a longer one, or 0 for the usual"});
  return step > 0.0 ? step : longest_step(tool_of(config).has_value());
}

std::optional<ToolShape> tool_of(const std::string& shape, const std::string& option) {
  static const WordTable words = make_tool_words();
  const OptionWord word = parse_word(words, shape, option);
  if (word.kind == "file") return drawn_shape(drawn_in(word.name.front()));
  const ToolKind* kind = kind_of(word.kind);
  return kind ? std::optional(kind->make(word.number)) : std::nullopt;
}

std::vector<ToolLength> lengths_of(const ToolShape& shape) {
  const ToolKind* kind = kind_of(shape.kind);
  if (!kind) return {};
  const std::vector<WordNumber> of = joined(kind->form.numbers, kind->form.keys);
  std::vector<ToolLength> lengths;
  const double first = shape.numbers.front(), any = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < of.size(); ++k)
    lengths.push_back({.name = of[k].name,
                       .value = shape.numbers[k],
                       .doubt = kind->doubt[k],
                       .least = k == 0 ? 0.0 : of[k].least_of_first * first,
                       .most = k == 0 ? any : of[k].most_of_first * first});
  for (std::size_t k = 1; k < of.size(); ++k) {
    lengths[0].least = std::max(lengths[0].least, shape.numbers[k] / of[k].most_of_first);
    lengths[0].most = std::min(lengths[0].most, shape.numbers[k] / of[k].least_of_first);
  }
  return lengths;
}

ToolShape with_length(const ToolShape& shape, std::size_t which, double length) {
  std::vector<double> lengths = shape.numbers;
  lengths[which] = length;
  return kind_of(shape.kind)->make(lengths);
}

double friction_of(const Config& config) {
  return friction_of(config.tool.friction, "--friction (tool.friction)");
}

double friction_of(const std::string& friction, const std::string& option) {
  if (friction == "stick") return std::numeric_limits<double>::infinity();
  double coefficient = 0.0;
  set_value({.key = option.starts_with("--") ? "tool.friction" : option,
             .flag = "--friction",
             .value = &coefficient,
             .most = 10.0,
             .help = "Coulomb's coefficient, or the word stick"},
            friction, option);
  return coefficient;
}

std::string friction_in_words(double friction) {
  if (friction == 0.0) return "without friction";
  return std::isinf(friction) ? "stuck where it has touched" : fmt::format("with friction {:g}", friction);
}

std::string in_words(const ToolShape& shape) {
  if (const ToolKind* kind = kind_of(shape.kind)) return kind->words(shape);
  if (!shape.mesh) return shape.field ? "a wall" : "a plane";
  return fmt::format("the tool of {}, {} wide and {} long", shape.mesh->name, length_words(shape.mesh->width),
                     length_words(shape.mesh->length));
}

namespace {

bool depth_is_of_tool(const Config& config) {
  const auto source = config.source.find("load.depth_mm");
  return source != config.source.end() && source->second.ends_with(by_tool);
}

}  // namespace

void resolve_depth(Config& config) {
  const std::optional<ToolShape> tool = tool_of(config);
  const bool is_given = config.source.count("load.depth_mm") > 0 && !depth_is_of_tool(config);
  if (!tool || is_given || !config.step.empty()) return;
  config.load.depth_mm = std::min(Config{}.load.depth_mm, usual_depth * 1e3 * tool->radius);
  config.source["load.depth_mm"] = by_tool;
}

std::string depth_of_tool_in_words(const Config& config) {
  if (!depth_is_of_tool(config)) return {};
  return fmt::format(
      ", pushed in by {}{}, as no --depth was given", length_in_words(config.load.depth_mm),
      config.load.depth_mm < Config{}.load.depth_mm ? fmt::format(", {:g} of its radius", usual_depth) : "");
}

void require_tool_as_long(const Config& config, double depth_mm) {
  const std::optional<ToolShape> tool = tool_of(config);
  if (!tool || 1e-3 * depth_mm <= tool->length) return;
  constexpr double smallest_mm = 0.05;  // radius of what indents soft tissue
  const bool looks_like_metres = 1e3 * tool->radius < smallest_mm;
  throw UsageError(
      {.fact = fmt::format("the tool is to be pushed in by {}, and is {} long", length_in_words(depth_mm),
                           length_in_words(1e3 * tool->length)),
       .where = config.step.empty() ? "--depth (load.depth_mm)" : "step",
       .why = looks_like_metres ? fmt::format("its radius is {}: are the units of --tool those of its "
                                              "numbers? A bare number is in mm",
                                              length_in_words(1e3 * tool->radius))
                                : "what holds it at its upper end is not modelled",
       .remedy = looks_like_metres ? "give the radius in millimetres or with its unit, as --tool sphere:5mm"
                                   : "give a smaller --depth, or a longer tool"});
}

void require_tool_as_long_turned(const Config& config, double below) {
  const ToolShape tool = tool_of(config).value();
  const double known = tool.mesh ? std::min(2.0 * tool.mesh->width, tool.mesh->length) : tool.length;
  if (below <= known) return;
  throw UsageError({.fact = fmt::format(
                        "the tool turns until {} of it, along its axis, lie below its first touch, and its "
                        "surface is known to {} above its tip",
                        length_in_words(1e3 * below), length_in_words(1e3 * known)),
                    .where = "step",
                    .why = tool.mesh ? "a tool that was drawn is sampled to two widths above its tip"
                                     : "what holds it at its upper end is not modelled",
                    .remedy = "turn it less, press it in less, or give a longer tool"});
}

void check_tool(const Config& config) {
  longest_step_radii(config);
  // Steps may go aside or away: how deep they push is known where the push is (require_room_beneath()).
  if (config.step.empty()) require_tool_as_long(config, config.load.depth_mm);
}

Index fewest_nodes_under_tool(const Config& config) {
  const std::optional<ToolShape> tool = tool_of(config);
  return tool && (tool->edge > 0.0 || tool->mesh) ? 4000 : 0;
}

std::vector<double> forces_of_touch(const std::vector<ForceSample>& curve, const std::vector<double>& depth) {
  std::vector<double> log_depth, log_force;
  for (const ForceSample& sample : curve)
    if (sample.depth > 0.0 && sample.force > 0.0) {
      log_depth.push_back(std::log(sample.depth));
      log_force.push_back(std::log(sample.force));
    }
  std::vector<double> force;
  for (const double d : depth) {
    if (!(d > 0.0) || log_depth.empty()) {
      force.push_back(0.0);
      continue;
    }
    const double x = std::log(d);
    const auto found = std::lower_bound(log_depth.begin(), log_depth.end(), x) - log_depth.begin();
    const std::size_t after = std::clamp<std::size_t>(static_cast<std::size_t>(found), 1,
                                                      std::max<std::size_t>(log_depth.size() - 1, 1));
    const double power = log_depth.size() < 2 ? power_of_a_round_tip
                                              : (log_force[after] - log_force[after - 1]) /
                                                    (log_depth[after] - log_depth[after - 1]);
    force.push_back(std::exp(log_force[after - 1] + power * (x - log_depth[after - 1])));
  }
  return force;
}

double reach_of_contact(const ToolShape& shape, double depth) {
  return shape.radius + std::max(0.5 * shape.radius, depth);
}

std::shared_ptr<const Touch> touch_of(const Config& config, const Model& model) {
  const std::optional<ToolShape> shape = tool_of(config);
  return shape ? touch_of(config, model, *shape) : nullptr;
}

std::shared_ptr<const Touch> touch_of(const Config& config, const Model& model, const ToolShape& shape) {
  auto touch = std::make_shared<Touch>();
  touch->shape = shape;
  touch->surface =
      contact_surface(model, reach_of_contact(shape, 1e-3 * config.load.depth_mm),
                      turns(config) ? swept(config, model.tool) : way_of_tool(config, model.tool.push));
  touch->pose = first_touch(shape, model.tool, touch->surface);
  touch->friction = friction_of(config);
  return touch;
}

}  // namespace dimple
