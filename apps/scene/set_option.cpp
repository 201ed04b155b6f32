#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "apps/scene/named_sections.hpp"
#include "io/error.hpp"

namespace dimple {

std::vector<std::pair<std::string, StepText>> steps_in_order(const Config& config) {
  std::vector<std::pair<std::string, StepText>> steps(config.step.begin(), config.step.end());
  std::sort(steps.begin(), steps.end(),
            [](const auto& a, const auto& b) { return a.second.order < b.second.order; });
  return steps;
}

std::vector<std::pair<std::string, StepText>> moving_steps(const Config& config) {
  auto steps = steps_in_order(config);
  std::erase_if(steps, [](const auto& step) { return !step.second.cut.empty(); });
  return steps;
}

namespace {

// Refuses names that a file of all options could not hold, since names and options are in one table there.
void refuse_names_of_options(const Config& config, const std::string& source) {
  if (config.held.contains("radius_factor"))
    throw UsageError({.fact = "a support is named 'radius_factor'",
                      .where = source,
                      .why = "support.radius_factor is an option of the moving least squares",
                      .remedy = "give it another name, such as support.retractor"});
  for (const char* taken : {"shape", "friction"})
    if (config.other_tool.contains(taken))
      throw UsageError({.fact = fmt::format("a further tool is named '{}'", taken),
                        .where = source,
                        .why = fmt::format("tool.{} is an option of the tool itself", taken),
                        .remedy = "give it another name, such as tool.left"});
}

// Sets an option of a tissue: "tissue.2.mu" -> label "2" and "material.mu_Pa", with the same checks.
bool set_tissue(Config& config, const std::string& key, const std::string& text, const std::string& source) {
  if (!key.starts_with("tissue.")) return false;
  const auto dot = key.rfind('.');
  if (dot <= 7)
    throw UsageError({.fact = fmt::format("'{}' names no option of a tissue", key),
                      .where = source,
                      .why = "keys are tissue.label.option",
                      .remedy = "for instance --set tissue.2.mu=900Pa"});
  const std::string label = key.substr(7, dot - 7);
  Config scratch;
  set_option(scratch, "material." + key.substr(dot + 1), text, source);
  if (scratch.material.mu_spread_percent > 0.0)
    throw UsageError({.fact = fmt::format("tissue '{}' is given a modulus with an uncertainty", label),
                      .where = source,
                      .why = "the force of several tissues is proportional to no single modulus, so its "
                             "uncertainty needs several runs",
                      .remedy = "run once with the smallest and once with the largest modulus"});
  std::vector<Option> options = options_of(scratch);
  config.tissue[label][find_option(options, "material." + key.substr(dot + 1))->key] = text;
  return true;
}

}  // namespace

void set_option(Config& config, const std::string& key, const std::string& text, const std::string& source) {
  if (set_tissue(config, key, text, source)) return;
  if (const auto named = named_option(config, key, source)) {
    set_value(*named, text, source);
    return refuse_names_of_options(config, source);
  }
  std::vector<Option> options = options_of(config);
  Option* option = find_option(options, key);
  if (!option) refuse_key(options, key, source);
  if (const auto spread = text.find("+-"); spread != std::string::npos && option->key == "material.mu_Pa") {
    set_option(config, "material.mu_spread_percent", text.substr(spread + 2), source);
    return set_option(config, key, text.substr(0, spread), source);
  }
  // The uncertainty in a file does not apply to a modulus that the caller gives.
  if (option->key == "material.mu_Pa" && is_of_caller(source))
    if (const auto before = config.source.find("material.mu_spread_percent");
        before != config.source.end() && !is_of_caller(before->second))
      config.material.mu_spread_percent = 0.0;
  const bool place = option->key == "boundary.indent_at" && text.find(',') != std::string::npos;
  set_value(*option, place ? place_in_mm(text) : text, source);
  config.source[option->key] = source;
}

std::string full_key(const std::string& key, const std::string& source) {
  const auto name_ends = key.rfind('.');
  const auto without_section = [](const std::string& whole) { return whole.substr(whole.rfind('.')); };
  if (key.starts_with("tissue.") && name_ends > 7)
    return key.substr(0, name_ends) + without_section(full_key("material" + key.substr(name_ends), source));
  Config scratch;
  if (const auto named = named_option(scratch, key, source))
    return key.substr(0, name_ends) + without_section(named->key);
  std::vector<Option> options = options_of(scratch);
  const Option* option = find_option(options, key);
  if (!option) refuse_key(options, key, source);
  return option->key;
}

std::string option_named(const std::string& name, const std::string& source,
                         const std::vector<std::string>& others) {
  Config config;
  if (named_option(config, name, source)) return name;
  if (name.starts_with("tissue.") && name.rfind('.') > 7) {
    option_named("material." + name.substr(name.rfind('.') + 1), source, others);
    return name;
  }
  std::vector<Option> options = options_of(config);
  const auto in_words = [](std::string text) {  // "--indent-at" and "indent_at" are the same
    text.erase(0, text.find_first_not_of('-'));
    std::replace(text.begin(), text.end(), '-', '_');
    return text;
  };
  const auto without_section = [](const std::string& key) { return key.substr(key.find('.') + 1); };
  const std::string requested = in_words(name);
  std::vector<std::string> known = others;
  const Option* by_its_end = nullptr;
  for (const Option& option : options) {
    const std::string flag = in_words(option.flag), bare = without_unit(option);
    if (requested == option.key || requested == bare || (!flag.empty() && requested == flag))
      return option.key;
    if (requested == without_section(option.key) || requested == without_section(bare)) by_its_end = &option;
    known.push_back(flag.empty() ? without_section(bare) : flag);
    known.push_back(without_section(option.key));
  }
  if (by_its_end) return by_its_end->key;
  refuse_key(options, name, source, std::move(known));
}

std::map<std::string, std::string> option_values(const Description& description) {
  Config config = *description.options;
  std::map<std::string, std::string> values;
  for (const Option& option : options_of(config))
    if (option.key != "image.file") values[option.key] = toml_value(option);
  for (const auto& [label, differing] : config.tissue)
    for (const auto& [key, value] : differing)
      values[fmt::format("tissue.{}.{}", label, key.substr(key.find('.') + 1))] = value;
  for (const auto& [key, option] : named_options(config)) values[key] = toml_value(option);
  return values;
}

std::map<std::string, std::string> option_values_in(const std::filesystem::path& file) {
  Description description;
  read_config(description, file);
  return option_values(description);
}

std::string option_reference() {
  Config config;
  for (const NamedSection& section : named_sections()) section.options_of(config, "NAME");
  std::string text =
      "Options, as `--set key=value` or in a TOML file given with --config. Bare numbers are in the unit "
      "shown.\n\n";
  std::vector<std::pair<std::string, Option>> all;
  for (const Option& option : options_of(config)) all.emplace_back(option.key, option);
  const auto named = named_options(config);
  all.insert(all.end(), named.begin(), named.end());
  for (const auto& [key, option] : all) {
    std::string range;
    if (!option.choices.empty())
      range = fmt::format("{}", fmt::join(option.choices, " | "));
    else if (std::holds_alternative<double*>(option.value) ||
             std::holds_alternative<std::int64_t*>(option.value))
      range = fmt::format("{} {} ... {}{}", option.least_excluded ? "above" : "from", option.least,
                          option.most, option.unit.empty() ? "" : " " + option.unit);
    text += fmt::format("  {:<32} = {:<14} {}{}\n", key, toml_value(option), option.help,
                        range.empty() ? "" : fmt::format(" ({})", range));
  }
  return text;
}

Description::Description() : options(std::make_unique<Config>()) {}
Description::Description(const Description& other) : options(std::make_unique<Config>(*other.options)) {}
Description::~Description() = default;
Description& Description::operator=(const Description& other) {
  *options = *other.options;
  return *this;
}

void set_option(Description& description, const std::string& key, const std::string& text,
                const std::string& source) {
  set_option(*description.options, key, text, source);
}

void put_numbers(Description& description, const std::string& key, const std::vector<double>& numbers,
                 const std::string& source) {
  std::vector<Option> options = options_of(*description.options);
  const Option& option = *find_option(options, key);
  if (auto* list = std::get_if<std::vector<double>*>(&option.value))
    **list = numbers;
  else if (auto* whole = std::get_if<std::int64_t*>(&option.value))
    **whole = static_cast<std::int64_t>(numbers.at(0));
  else
    *std::get<double*>(option.value) = numbers.at(0);
  if (!source.empty()) description.options->source[option.key] = source;
}

void read_config(Description& description, const std::filesystem::path& file) {
  read_config(*description.options, file);
}

std::string image_file(const Description& description) {
  return description.options->image.file;
}

OptionValue value_of(const Description& description, const std::string& key) {
  Config config = *description.options;
  std::vector<Option> options = options_of(config);
  return std::visit([](const auto* value) -> OptionValue { return *value; },
                    find_option(options, key)->value);
}

std::string source_of(const Description& description, const std::string& key) {
  const auto source = description.options->source.find(key);
  return source == description.options->source.end() ? "" : source->second;
}

}  // namespace dimple
