#include "apps/scene/tool_words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <numbers>
#include <vector>

#include "apps/scene/option.hpp"
#include "apps/scene/option_word.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/surface_mesh.hpp"

namespace dimple {
namespace {

// Kind of tool with lengths and angles: its form, maker and description. A new shape is one more row.
struct ToolKind {
  WordForm form;
  ToolShape (*make)(const std::vector<double>& lengths);
  std::string (*words)(const ToolShape& shape);
  std::vector<double> doubt;       // relative uncertainty of each number; 0: certain
  bool has_error_estimate = true;  // the estimates were calibrated with it
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
  length.least_of_first = 2.0;  // the two round ends
  const WordNumber angle{"angle", "deg", std::numbers::pi / 180.0, 5.0, 85.0},
      tip = length_number("tip", 1e-3, largest_mm);
  WordNumber shaft = radius;
  shaft.usual = 5e-3;
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
           {well_known, 0.0}},
          {{"cone", {angle}, "cone:30deg,tip=0.5mm", {tip, shaft}},
           [](const std::vector<double>& l) { return cone_shape(l[0], l[1], l[2]); },
           [](const ToolShape& s) {
             return fmt::format("a cone of {:g} deg from its axis with a tip of {} and a radius of {}",
                                s.numbers[0] * 180.0 / std::numbers::pi, length_words(s.numbers[1]),
                                length_words(s.radius));
           },
           {well_known, hardly_known, 0.0},
           false}};
}

const std::vector<ToolKind>& tool_kinds() {
  static const std::vector<ToolKind> kinds = make_tool_kinds();
  return kinds;
}

// Kind of a shape by name; null: it has no lengths.
const ToolKind* kind_of(const std::string& name) {
  const std::vector<ToolKind>& kinds = tool_kinds();
  const auto found =
      std::find_if(kinds.begin(), kinds.end(), [&](const ToolKind& kind) { return kind.form.kind == name; });
  return found == kinds.end() ? nullptr : &*found;
}

WordTable make_tool_words() {
  WordTable table{"the tool",
                  {{"circle"}},
                  fmt::format("it is circle, or the shape of a contacting tool; a mesh is read from {} files",
                              surface_suffixes),
                  true};
  for (const ToolKind& kind : tool_kinds()) table.forms.push_back(kind.form);
  return table;
}

// Mesh of a file, read and checked once: that may take a second, and many callers use it.
std::shared_ptr<const ToolMesh> drawn_in(const std::filesystem::path& file) {
  static std::mutex one_at_a_time;
  static std::map<std::pair<std::string, std::filesystem::file_time_type>, std::shared_ptr<const ToolMesh>>
      known;
  constexpr std::size_t most_known = 8;
  const std::lock_guard<std::mutex> lock(one_at_a_time);
  std::error_code missing;  // the reader reports it
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

std::optional<ToolShape> tool_named(const std::string& shape, const std::string& option) {
  static const WordTable words = make_tool_words();
  const OptionWord word = parse_word(words, shape, option);
  if (word.kind == "file") return drawn_shape(drawn_in(word.name.front()));
  const ToolKind* kind = kind_of(word.kind);
  return kind ? std::optional(kind->make(word.number)) : std::nullopt;
}

std::vector<std::string> tool_examples() {
  std::vector<std::string> examples;
  for (const ToolKind& kind : tool_kinds()) examples.push_back(kind.form.example);
  return examples;
}

bool has_error_estimate(const ToolShape& shape) {
  const ToolKind* kind = kind_of(shape.kind);
  return kind && kind->has_error_estimate;
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
                       .unit = of[k].unit,
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

double ToolLength::in_unit(double of_value) const {
  return unit == "mm" ? 1e3 * of_value : of_value * 180.0 / std::numbers::pi;
}

std::string ToolLength::in_words(double of_value) const {
  return unit == "mm" ? length_words(of_value) : fmt::format("{:.1f} {}", in_unit(of_value), unit);
}

double friction_named(const std::string& friction, const std::string& option) {
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
  return std::isinf(friction) ? "without slip" : fmt::format("with friction {:g}", friction);
}

std::string in_words(const ToolShape& shape) {
  if (const ToolKind* kind = kind_of(shape.kind)) return kind->words(shape);
  if (!shape.mesh) return shape.field ? "a wall" : "a plane";
  return fmt::format("the tool of {}, {} wide and {} long", shape.mesh->name, length_words(shape.mesh->width),
                     length_words(shape.mesh->length));
}

}  // namespace dimple
