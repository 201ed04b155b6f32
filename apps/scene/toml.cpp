#include <fmt/format.h>
#include <fmt/ranges.h>
#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <sstream>

#include "apps/scene/given_once.hpp"
#include "apps/scene/named_sections.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/text.hpp"

namespace dimple {

namespace {

// Value as a text that --set accepts.
std::string text_of_value(const toml::node& value) {
  std::ostringstream shown;
  if (const auto word = value.value_exact<std::string>())
    shown << *word;
  else if (const toml::array* list = value.as_array())
    for (std::size_t k = 0; k < list->size(); ++k) {
      shown << (k ? "," : "");
      (*list)[k].visit([&](auto&& v) { shown << v; });
    }
  else
    value.visit([&](auto&& v) { shown << v; });
  return shown.str();
}

// Sets the options of a named section.
void set_all(Config& config, const std::string& section, const toml::node& node,
             const std::filesystem::path& file, GivenOnce& given) {
  const toml::table* table = node.as_table();
  std::vector<Option> options = options_of(config);
  if (!table) refuse_key(options, section, file.string());
  if (table->empty())
    throw UsageError({.fact = fmt::format("the section [{}] is empty", section),
                      .where = fmt::format("{}, line {}", file.string(), table->source().begin.line),
                      .why = "an empty section has no effect",
                      .remedy = "give it its options (`dimple options`), or leave it out"});
  for (const auto& [name, value] : *table) {
    const std::string key = fmt::format("{}.{}", section, name.str()), text = text_of_value(value),
                      place = fmt::format("{}, line {}", file.string(), value.source().begin.line);
    given.add(key, text, place);
    set_option(config, key, text, place);
  }
}

// Reads the steps in the order of their lines and columns, as a table of TOML is not ordered.
void read_steps(Config& config, const toml::table& table, const std::filesystem::path& file,
                GivenOnce& given) {
  const toml::node* section = table.get("step");
  if (!section) return;
  std::vector<Option> options = options_of(config);
  if (!section->is_table()) refuse_key(options, "step", file.string());
  std::vector<std::pair<std::string, const toml::node*>> steps;
  for (const auto& [name, node] : *section->as_table()) steps.emplace_back(name.str(), &node);
  std::sort(steps.begin(), steps.end(), [](const auto& a, const auto& b) {
    const toml::source_position x = a.second->source().begin, y = b.second->source().begin;
    return std::pair(x.line, x.column) < std::pair(y.line, y.column);
  });
  for (const auto& [name, node] : steps) set_all(config, "step." + name, *node, file, given);
}

// Tables of the file. Throws UsageError: it is not TOML.
toml::table tables_of(const std::filesystem::path& file) {
  try {
    return toml::parse(read_file(file, most_bytes_of_text), file.string());
  } catch (const toml::parse_error& error) {
    throw UsageError(
        {.fact = fmt::format("{} is not valid TOML: {}", file.string(), error.description()),
         .where = fmt::format("line {}, column {}", error.source().begin.line, error.source().begin.column),
         .why = "the file cannot be read as a configuration",
         .remedy = "correct that line; strings need quotes, tables look like [material]"});
  }
}

// Items of a list, separated by commas.
std::string list_text(const Option& option, const toml::array& list, const std::string& place) {
  std::vector<std::string> items;
  for (const auto& item : list) {
    if (const auto word = item.value_exact<std::string>())
      items.push_back(*word);
    else if (const auto number = item.value_exact<std::int64_t>())
      items.push_back(std::to_string(*number));
    else if (const auto real = item.value_exact<double>())
      items.push_back(fmt::format("{}", *real));
    else
      refuse_value(option, "a list with something other than words and numbers", place, "it cannot be read");
  }
  return fmt::format("{}", fmt::join(items, ","));
}

// Reads one option of a section without a name.
void read_option(Config& config, std::vector<Option>& options, const std::string& key,
                 const toml::node& value, const std::filesystem::path& file, GivenOnce& given) {
  const std::string place = fmt::format("{}, line {}", file.string(), value.source().begin.line);
  Option* option = find_option(options, key);
  if (!option) refuse_key(options, key, place);
  given.add(key, text_of_value(value), place);
  const bool is_text = !std::holds_alternative<double*>(option->value) &&
                       !std::holds_alternative<std::int64_t*>(option->value);
  if (const auto text = value.value_exact<std::string>()) {
    set_option(config, option->key, *text, place);
  } else if (const toml::array* list = value.as_array(); list && is_text) {
    set_value(*option, list_text(*option, *list, place), place);
  } else if (const auto number = value.value<double>(); number && !value.is_boolean() && !is_text) {
    set_number(*option, *number, fmt::format("{}", *number), place);
  } else {
    std::ostringstream shown;
    value.visit([&](auto&& v) { shown << v; });
    refuse_value(
        *option, shown.str(), place,
        is_text ? "it must be a word in quotes" : "it must be a number, or a number with its unit in quotes");
  }
  config.source[option->key] = place;
}

}  // namespace

void read_config(Config& config, const std::filesystem::path& file) {
  const toml::table table = tables_of(file);
  std::vector<Option> options = options_of(config);
  GivenOnce given;
  for (const auto& [section, node] : table) {
    const toml::table* entries = node.as_table();
    if (!entries) refuse_key(options, std::string(section.str()), file.string());
    if (section.str() == "step") continue;  // below, in the order of their lines
    for (const auto& [name, value] : *entries) {
      const std::string key = fmt::format("{}.{}", section.str(), name.str());
      if (section.str() == "tissue" || (is_named_section(section.str()) && value.is_table()))
        set_all(config, key, value, file, given);
      else if (const toml::table* members = value.as_table(); members && is_named_section(key))
        for (const auto& [member, its] : *members)
          set_all(config, fmt::format("{}.{}", key, member.str()), its, file, given);
      else
        read_option(config, options, key, value, file, given);
    }
  }
  read_steps(config, table, file, given);
}

namespace {

std::string as_table(std::string_view section, const std::string& name, const std::vector<Option>& options) {
  std::string text = fmt::format("\n[{}.{}]\n", section, toml_string(name));
  for (const Option& option : options)
    text += fmt::format("{} = {}\n", option.key.substr(option.key.find('.') + 1), toml_value(option));
  return text;
}

}  // namespace

std::string to_toml(const Description& description, const std::map<std::string, std::string>& notes) {
  Config config = *description.options;
  std::string text = "# Every option of this run. `dimple run --config THIS -o OUT` repeats it bit by bit.\n";
  std::string section;
  for (const Option& option : options_of(config)) {
    const auto dot = option.key.find('.');
    if (option.key.substr(0, dot) != section) {
      section = option.key.substr(0, dot);
      text += fmt::format("\n[{}]\n", section);
    }
    const auto source = config.source.find(option.key);
    std::string comment = source == config.source.end() ? "default" : source->second;
    if (const auto note = notes.find(option.key); note != notes.end()) comment += "; " + note->second;
    text +=
        fmt::format("{} = {}  # {}\n", option.key.substr(dot + 1), toml_value(option), printable(comment));
  }
  for (const auto& [label, differing] : config.tissue) {
    text += fmt::format("\n[tissue.{}]\n", toml_string(label));
    for (const auto& [key, value] : differing)
      text += fmt::format("{} = {}\n", key.substr(key.find('.') + 1), toml_string(value));
  }
  for (const NamedSection& section : named_sections())
    for (const std::string& name : section.names(config))
      text += as_table(section.section, name, section.options_of(config, name));
  return text;
}

}  // namespace dimple
