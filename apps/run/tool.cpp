#include "apps/run/tool.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <vector>

#include "apps/run/steps.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/surface_mesh.hpp"
#include "io/text.hpp"

namespace dimple {
namespace {

constexpr const char* forms = "sphere:5mm, punch:5mm,edge=1mm, capsule:2mm,length=20mm or probe.stl";
constexpr double usual_depth = 0.8;           // of the radius
constexpr double power_of_a_round_tip = 1.5;  // Hertz
const std::string by_tool = "the tool";

// A shape as it was written, and the option that it stands in.
struct Asked {
  const std::string& shape;
  std::string option;
};

[[noreturn]] void refuse(const Asked& tool, const std::string& fact, const std::string& why,
                         const std::string& remedy) {
  throw UsageError({.fact = fmt::format("the tool '{}' {}", tool.shape, fact),
                    .where = tool.option,
                    .why = why,
                    .remedy = remedy});
}

// [m], in the units that every option of a length takes.
double length_of(const Asked& tool, const std::string& text) {
  if (text.empty())
    refuse(tool, "lacks a length", "its lengths say how large it is",
           fmt::format("give for instance {}", forms));
  double mm = 0.0;
  set_value({.key = "tool.shape",
             .flag = "--tool",
             .unit = "mm",
             .value = &mm,
             .most = 1000.0,
             .least_excluded = true,
             .help = "a length of the tool"},
            text, tool.option);
  return 1e-3 * mm;
}

struct Words {
  std::string kind, radius;
  std::vector<std::pair<std::string, std::string>> more;
};

Words words_of(const std::string& text) {
  const std::size_t colon = text.find(':');
  Words words{.kind = std::string(trimmed(text.substr(0, colon))), .radius = {}, .more = {}};
  if (colon == std::string::npos) return words;
  std::string rest = text.substr(colon + 1);
  for (bool first = true; !rest.empty(); first = false) {
    const std::size_t comma = rest.find(',');
    const std::string part(trimmed(rest.substr(0, comma)));
    rest = comma == std::string::npos ? "" : rest.substr(comma + 1);
    const std::size_t equals = part.find('=');
    if (first)
      words.radius = part;
    else
      words.more.emplace_back(
          std::string(trimmed(part.substr(0, equals))),
          equals == std::string::npos ? "" : std::string(trimmed(part.substr(equals + 1))));
  }
  return words;
}

// The one further length that a shape takes.
double further(const Asked& tool, const Words& words, const std::string& name) {
  if (words.more.size() != 1 || words.more.front().first != name)
    refuse(tool, fmt::format("is not written as {}:RADIUS,{}=LENGTH", words.kind, name),
           fmt::format("a {} has a radius and one more length, {}", words.kind, name),
           fmt::format("give for instance {}", forms));
  return length_of(tool, words.more.front().second);
}

ToolShape shape_of(const Asked& tool, const Words& words) {
  ToolShape shape{.kind = ToolShape::Kind::sphere, .radius = length_of(tool, words.radius)};
  if (words.kind == "sphere") {
    if (!words.more.empty())
      refuse(tool, "is not written as sphere:RADIUS", "a sphere has one length, its radius",
             "give for instance sphere:5mm");
    return shape;
  }
  if (words.kind == "punch") {
    shape.kind = ToolShape::Kind::punch;
    shape.edge = further(tool, words, "edge");
    constexpr double rounding = 1e-9;
    if (shape.edge > shape.radius * (1.0 + rounding) ||
        shape.edge < sharpest_edge * shape.radius * (1.0 - rounding))
      refuse(
          tool, fmt::format("has an edge of {}", length_in_words(1e3 * shape.edge)),
          fmt::format("it is rounded by {:g} radii at least, for the pressure at a sharp edge is unbounded, "
                      "and by a radius at most",
                      sharpest_edge),
          fmt::format("give edge={}mm to {}mm", plain(1e3 * sharpest_edge * shape.radius),
                      plain(1e3 * shape.radius)));
    return shape;
  }
  shape.kind = ToolShape::Kind::capsule;
  shape.length = further(tool, words, "length");
  if (shape.length < 2.0 * shape.radius)
    refuse(tool, fmt::format("is {} long", length_in_words(1e3 * shape.length)),
           "with both its round ends it is two radii long at least",
           fmt::format("give length={}mm or more", plain(2e3 * shape.radius)));
  return shape;
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
  if (is_surface_file(shape)) {
    auto mesh = drawn_in(shape);
    const double radius = 0.5 * mesh->width;
    return ToolShape{.kind = ToolShape::Kind::drawn, .radius = radius, .mesh = std::move(mesh)};
  }
  const Words words = words_of(shape);
  const Asked tool{shape, option};
  if (words.kind == "circle" && words.radius.empty()) return std::nullopt;
  if (words.kind != "sphere" && words.kind != "punch" && words.kind != "capsule")
    refuse(
        tool, "is not known",
        fmt::format("it is circle, or a shape that touches; a mesh is read from {} files", surface_suffixes),
        fmt::format("give circle, {}", forms));
  return shape_of(tool, words);
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
  const std::string radius = length_in_words(1e3 * shape.radius);
  switch (shape.kind) {
    case ToolShape::Kind::punch:
      return fmt::format("a flat punch of {} radius with an edge of {}", radius,
                         length_in_words(1e3 * shape.edge));
    case ToolShape::Kind::capsule:
      return fmt::format("a round-ended rod of {} radius, {} long", radius,
                         length_in_words(1e3 * shape.length));
    case ToolShape::Kind::drawn:
      return fmt::format("the tool of {}, {} wide and {} long", shape.mesh->name,
                         length_in_words(1e3 * shape.mesh->width), length_in_words(1e3 * shape.mesh->length));
    case ToolShape::Kind::plane:
      return "a plane";
    case ToolShape::Kind::field:
      return "a wall";
    case ToolShape::Kind::sphere:
      break;
  }
  return fmt::format("a sphere of {} radius", radius);
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
  if (!tool || 1e-3 * depth_mm <= length_of_tool(*tool)) return;
  constexpr double smallest_mm = 0.05;  // radius of what indents soft tissue
  const bool looks_like_metres = 1e3 * tool->radius < smallest_mm;
  throw UsageError(
      {.fact = fmt::format("the tool is to be pushed in by {}, and is {} long", length_in_words(depth_mm),
                           length_in_words(1e3 * length_of_tool(*tool))),
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
  const double known = tool.mesh ? std::min(2.0 * tool.mesh->width, tool.mesh->length) : length_of_tool(tool);
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
  return tool && (tool->kind == ToolShape::Kind::punch || tool->mesh) ? 4000 : 0;
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
