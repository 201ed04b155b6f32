#include "apps/scene/named_sections.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "io/error.hpp"

namespace dimple {
namespace {

template <auto members>
NamedSection section_of(std::string_view section, std::string_view example) {
  return {section, example,
          [](Config& config, const std::string& name) { return options_of((config.*members)[name]); },
          [](const Config& config) {
            std::vector<std::string> names;
            for (const auto& [name, its] : config.*members) names.push_back(name);
            return names;
          }};
}

// Section of the steps, which keep the order in which they were given.
NamedSection section_of_steps() {
  return {"step", "step.press.move=4mm",
          [](Config& config, const std::string& name) {
            const int before = static_cast<int>(config.step.size());
            StepText& step = config.step[name];
            if (static_cast<int>(config.step.size()) > before) step.order = before;
            return options_of(step);
          },
          [](const Config& config) {
            std::vector<std::string> names;
            for (const auto& [name, its] : steps_in_order(config)) names.push_back(name);
            return names;
          }};
}

std::string_view last_part(std::string_view section) {
  return section.substr(section.rfind('.') + 1);  // all of it if there is no dot
}

// Option of a complete key, which begins with the section.
Option option_of(const NamedSection& section, Config& config, const std::string& key,
                 const std::string& source) {
  const auto begin = section.section.size() + 1, dot = key.rfind('.');
  const std::string_view what = last_part(section.section);
  const std::string name = dot > begin ? key.substr(begin, dot - begin) : "";
  const std::string remedy = fmt::format("for instance --set {}", section.example);
  if (name.empty())
    throw UsageError({.fact = fmt::format("'{}' names no option of a {}", key, what),
                      .where = source,
                      .why = fmt::format("keys are {}.name.option", section.section),
                      .remedy = remedy});
  if (name.find('.') != std::string::npos)
    throw UsageError(
        {.fact = fmt::format("a {} is called '{}', and a name has no dot", what, name),
         .where = source,
         .why = fmt::format("dots separate keys: {}.name.option, also in summary.json", section.section),
         .remedy = remedy});
  std::vector<Option> options = section.options_of(config, name);
  Option* option = find_option(options, fmt::format("{}{}", what, key.substr(dot)));
  if (!option) {
    for (Option& one : options)
      one.key = fmt::format("{}.{}{}", section.section, name, one.key.substr(what.size()));
    refuse_key(options, key, source);
  }
  return *option;
}

}  // namespace

const std::vector<NamedSection>& named_sections() {
  static const std::vector<NamedSection> sections = {
      section_of<&Config::pressure>("load.pressure", "load.pressure.csf.pressure=500Pa"),
      section_of<&Config::body_force>("load.body_force", "load.body_force.pull.force=0,0,-500"),
      section_of<&Config::membrane>("membrane", "membrane.pia.thickness=0.1mm"),
      section_of<&Config::wall>("wall", "wall.skull.shape=label:skull"),
      section_of<&Config::held>("support", "support.retractor.on=left"),
      section_of<&Config::other_tool>("tool", "tool.left.shape=sphere:4mm"),
      section_of_steps()};
  return sections;
}

bool is_named_section(std::string_view section) {
  const std::vector<NamedSection>& sections = named_sections();
  return std::any_of(sections.begin(), sections.end(),
                     [&](const NamedSection& one) { return one.section == section; });
}

std::optional<Option> named_option(Config& config, const std::string& key, const std::string& source) {
  for (const NamedSection& section : named_sections()) {
    const std::string begin = fmt::format("{}.", section.section);
    // "support.radius_factor" has no name between its section and its option.
    if (key.starts_with(begin) && key.rfind('.') >= begin.size())
      return option_of(section, config, key, source);
  }
  return std::nullopt;
}

std::vector<std::pair<std::string, Option>> named_options(Config& config) {
  std::vector<std::pair<std::string, Option>> all;
  for (const NamedSection& section : named_sections())
    for (const std::string& name : section.names(config))
      for (const Option& option : section.options_of(config, name))
        all.emplace_back(
            fmt::format("{}.{}{}", section.section, name, option.key.substr(option.key.find('.'))), option);
  return all;
}

}  // namespace dimple
