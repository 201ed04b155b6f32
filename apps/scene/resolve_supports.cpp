#include <fmt/format.h>

#include <algorithm>

#include "apps/scene/resolve_parts.hpp"
#include "apps/scene/surface_part.hpp"
#include "apps/scene/tool_words.hpp"
#include "io/error.hpp"
#include "solver/guards.hpp"

namespace dimple {
namespace {

constexpr std::size_t most_supports = 28;  // each has a bit of node_flags

Report support_report(const std::string& name, const char* key, const std::string& fact,
                      const std::string& why, const std::string& remedy) {
  return {.fact = fmt::format("the support '{}' {}", name, fact),
          .where = fmt::format("support.{}.{}", name, key),
          .why = why,
          .remedy = remedy};
}

OptionWord word_of_support(const std::string& name, const SupportText& held) {
  std::vector<WordForm> forms = forms_of_surface_part();
  forms.push_back({.kind = "label", .between = '\0', .names = "NAME"});
  return parse_word({"the place", std::move(forms), "this names no part of the body"}, held.on,
                    fmt::format("support.{}.on", name), fmt::format("the support '{}'", name));
}
void check(const std::string& name, const SupportText& held) {
  if (name == base_set || name == "tool")
    throw UsageError({.fact = fmt::format("a support is named '{}'", name),
                      .where = fmt::format("support.{}", name),
                      .why = "supports are reported and moved by name, and the body has that name already",
                      .remedy = "name it differently"});
  if (held.on.empty())
    throw UsageError(support_report(name, "on", "is nowhere", "a support is a part of the body",
                                    "give a side such as left, a ball x,y,z,radius in mm, or label:NAME"));
  if (word_of_support(name, held).kind == "label" && held.hold == "sliding")
    throw UsageError(support_report(name, "hold", "slides, and is the tissue of a label",
                                    "tissue slides along a surface, and inner tissue has none",
                                    "give hold = \"fixed\", or a side or a ball in place of the label"));
  if (held.move_mm.size() != 3)
    throw UsageError(support_report(name, "move_mm", fmt::format("moves by {} numbers", held.move_mm.size()),
                                    "a displacement has three components, LPS",
                                    "give x,y,z in mm, such as 3,0,0"));
}

Report tool_report(const std::string& name, const char* key, const std::string& fact, const std::string& why,
                   const std::string& remedy) {
  return {.fact = fmt::format("the tool '{}' {}", name, fact),
          .where = fmt::format("tool.{}.{}", name, key),
          .why = why,
          .remedy = remedy};
}

ToolShape shape_of(const std::string& name, const FurtherToolText& tool) {
  const auto refuse = [&](const std::string& fact) {
    throw UsageError(tool_report(name, "shape", fact, "a further tool makes contact and holds no nodes",
                                 "give for instance shape = \"sphere:4mm\""));
  };
  if (tool.shape.empty()) refuse("has no shape");
  const auto shape = tool_named(tool.shape, fmt::format("tool.{}.shape", name));
  if (!shape) refuse("is a bonded indenter");
  return *shape;
}

void check(const std::string& name, const FurtherToolText& tool) {
  if (tool.at_mm.size() != 3)
    throw UsageError(tool_report(
        name, "at_mm", tool.at_mm.empty() ? "is nowhere" : fmt::format("is at {} numbers", tool.at_mm.size()),
        "its place has three coordinates, LPS in mm",
        "give for instance at_mm = [12, -40, 30], on the surface or near to it"));
  const bool is_zero =
      std::all_of(tool.direction.begin(), tool.direction.end(), [](double d) { return d == 0.0; });
  if (!tool.direction.empty() && (tool.direction.size() != 3 || is_zero))
    throw UsageError(tool_report(
        name, "direction",
        fmt::format("points along {} numbers{}", tool.direction.size(), is_zero ? ", all of them zero" : ""),
        "a direction has three components, LPS", "give x,y,z, or leave it out"));
  if (tool.move_mm.size() != 1 && tool.move_mm.size() != 3)
    throw UsageError(tool_report(name, "move_mm", fmt::format("moves by {} numbers", tool.move_mm.size()),
                                 "it moves by x,y,z in LPS, or by one number along its approach direction",
                                 "give for instance move_mm = 2"));
}

}  // namespace

std::vector<Scene::Support> supports_named(const std::map<std::string, SupportText>& texts) {
  std::vector<Scene::Support> supports;
  for (const auto& [name, text] : texts) {
    check(name, text);
    const OptionWord word = word_of_support(name, text);
    Scene::Support support{.name = name, .on_words = text.on};
    if (word.kind == "label")
      support.label = word.name.front();
    else
      support.part = surface_part_of(word);
    support.slides = text.hold == "sliding";
    support.move_mm = text.move_mm;
    supports.push_back(std::move(support));
  }
  if (supports.size() > most_supports)
    throw UsageError({.fact = fmt::format("{} supports are given", supports.size()),
                      .where = "support",
                      .why = fmt::format("the results have room for at most {}", most_supports),
                      .remedy = "join some that are held alike"});
  return supports;
}

std::vector<Scene::FurtherTool> further_tools_named(const std::map<std::string, FurtherToolText>& texts) {
  std::vector<Scene::FurtherTool> tools;
  for (const auto& [name, text] : texts) {
    Scene::FurtherTool tool{.name = name, .shape = shape_of(name, text)};
    tool.friction = friction_named(text.friction, fmt::format("tool.{}.friction", name));
    check(name, text);
    tool.at_mm = Vec3(text.at_mm.data());
    if (!text.direction.empty()) tool.direction = Vec3(text.direction.data());
    tool.move_mm = text.move_mm;
    tools.push_back(std::move(tool));
  }
  return tools;
}

void check_names(const Scene& scene) {
  for (const Scene::FurtherTool& tool : scene.further_tools) {
    const std::string& name = tool.name;
    if (name == "tool" || name == base_set)
      throw UsageError(tool_report(
          name, "shape",
          name == base_set ? "has the name of the fixed base" : "has the name of the measured one",
          "bodies are reported and moved by name", "name it differently"));
    if (named(scene.supports, name) || named(scene.walls, name))
      throw UsageError(tool_report(name, "shape", "has the name of a support or a wall",
                                   "bodies are reported and moved by name", "name them differently"));
  }
}

}  // namespace dimple
