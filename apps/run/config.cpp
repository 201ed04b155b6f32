#include "apps/run/config.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <toml++/toml.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>
#include <sstream>

#include "apps/run/given_once.hpp"
#include "apps/run/option_word.hpp"
#include "apps/run/other_tools.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/tool.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/text.hpp"

namespace dimple {

std::string without_unit(const Option& option) {
  static const std::map<std::string, std::string> suffix = {
      {"mm", "_mm"},       {"Pa", "_Pa"}, {"mm/s", "_mm_per_s"}, {"kg/m3", "_kg_per_m3"}, {"1/s", "_per_s"},
      {"N/m", "_N_per_m"}, {"s", "_s"},   {"deg", "_deg"},       {"J/m2", "_J_m2"},       {"%", "_percent"}};
  const auto found = suffix.find(option.unit);
  if (found == suffix.end() || !option.key.ends_with(found->second)) return option.key;
  return option.key.substr(0, option.key.size() - found->second.size());
}

namespace {

// What a number may be written in, as multiples of the option's own unit. Three dozen characters of table;
// the unit libraries at hand bring hundreds of units and no such list to print in a message.
const std::map<std::string, std::map<std::string, double>>& unit_table() {
  static const std::map<std::string, std::map<std::string, double>> table = {
      {"mm", {{"mm", 1.0}, {"cm", 10.0}, {"m", 1000.0}, {"um", 1e-3}}},
      {"Pa", {{"Pa", 1.0}, {"kPa", 1e3}, {"MPa", 1e6}}},
      {"mm/s", {{"mm/s", 1.0}, {"cm/s", 10.0}, {"m/s", 1000.0}}},
      {"kg/m3", {{"kg/m3", 1.0}, {"g/cm3", 1000.0}, {"g/ml", 1000.0}}},
      {"1/s", {{"1/s", 1.0}, {"Hz", 1.0}, {"kHz", 1000.0}}},
      {"s", {{"s", 1.0}, {"ms", 1e-3}, {"min", 60.0}, {"h", 3600.0}}},
      {"%", {{"%", 1.0}}},
      {"deg", {{"deg", 1.0}, {"rad", 180.0 / std::numbers::pi}}},
      {"N", {{"N", 1.0}, {"mN", 1e-3}, {"uN", 1e-6}}},
      {"N/m", {{"N/m", 1.0}, {"mN/m", 1e-3}}},
      {"J/m2", {{"J/m2", 1.0}, {"kJ/m2", 1e3}}},
  };
  return table;
}

// Before the name of the preset that a number is of.
const std::string of_preset = "preset ";

// A flag of the command line, or a keyword of Python: "--mu", "mu_Pa=".
bool is_of_caller(const std::string& source) {
  return source.starts_with("--") || source.ends_with("=");
}

[[noreturn]] void refuse(const Option& option, const std::string& text, const std::string& source,
                         const std::string& why) {
  std::string range;
  if (!option.choices.empty()) {
    range = fmt::format("{} of {}",
                        std::holds_alternative<std::vector<std::string>*>(option.value) ? "some" : "one",
                        fmt::join(option.choices, ", "));
  } else if (std::holds_alternative<std::vector<double>*>(option.value)) {
    range = fmt::format("numbers{}, separated by commas", option.unit.empty() ? "" : " in " + option.unit);
  } else if (std::holds_alternative<std::vector<std::string>*>(option.value)) {
    range = "words, separated by commas";
  } else if (!std::holds_alternative<std::string*>(option.value)) {
    range =
        !std::isfinite(option.least)
            ? std::string("a number")
            : fmt::format("a number {} {}{}{}", option.least_excluded ? "above" : "from", plain(option.least),
                          !std::isfinite(option.most) ? ""
                          : option.least_excluded     ? ", at most " + plain(option.most)
                                                      : " to " + plain(option.most),
                          option.unit.empty() ? "" : " " + option.unit);
  }
  throw UsageError({.fact = fmt::format("{} = {} is not allowed", option.key, text),
                    .where = source,
                    .why = why,
                    .remedy = fmt::format("{}: give {}", option.help, range)});
}

void assign_number(const Option& option, double value, const std::string& text, const std::string& source) {
  if (!std::isfinite(value)) refuse(option, text, source, "it is not a finite number");
  if (value < option.least || value > option.most || (option.least_excluded && value == option.least))
    refuse(option, text, source, "it is out of range");
  if (auto* real = std::get_if<double*>(&option.value)) {
    **real = value;
  } else {
    if (value != std::round(value)) refuse(option, text, source, "it is not a whole number");
    **std::get_if<std::int64_t*>(&option.value) = static_cast<std::int64_t>(value);
  }
}

double parse_quantity(const Option& option, const std::string& text, const std::string& source) {
  const std::string t(trimmed(text));
  double value = 0.0;
  const char* begin = t.data() + (t.starts_with('+') ? 1 : 0);
  const auto [end, error] = std::from_chars(begin, t.data() + t.size(), value);
  if (error != std::errc{}) refuse(option, text, source, "it is not a number");
  const std::string unit(trimmed(std::string(end, t.data() + t.size())));
  if (unit.empty()) return value;
  const auto table = unit_table().find(option.unit);
  if (table == unit_table().end())
    refuse(option, text, source, fmt::format("'{}' follows the number, but this option has no unit", unit));
  const auto factor = table->second.find(unit);
  if (factor == table->second.end()) {
    std::vector<std::string> known;
    for (const auto& [name, unused] : table->second) known.push_back(name);
    refuse(option, text, source,
           fmt::format("'{}' is not one of its units ({})", unit, fmt::join(known, ", ")));
  }
  return value * factor->second;
}

// "1cm,2cm,30mm" -> "10,20,30": a place is kept in mm. Parts that are no lengths stay as they are.
std::string place_in_mm(const std::string& text) {
  std::string result;
  for (const std::string& part : parts_between(text, ',')) {
    double value = 0.0;
    const auto [end, error] = std::from_chars(part.data(), part.data() + part.size(), value);
    const auto unit =
        unit_table().at("mm").find(std::string(trimmed(std::string(end, part.data() + part.size()))));
    const bool length = error == std::errc{} && unit != unit_table().at("mm").end();
    result += (result.empty() ? "" : ",") + (length ? fmt::format("{}", value * unit->second) : part);
  }
  return result;
}

void assign_text(const Option& option, const std::string& text, const std::string& source) {
  if (!is_utf8(text))
    throw UsageError({.fact = fmt::format("{} = {} is not UTF-8", option.key, text),
                      .where = source,
                      .why = "a run repeats every name in config.resolved.toml, which is UTF-8",
                      .remedy = "rename the file, or save the table as UTF-8"});
  if (auto* word = std::get_if<std::string*>(&option.value)) {
    if (!option.choices.empty() &&
        std::find(option.choices.begin(), option.choices.end(), text) == option.choices.end())
      refuse(option, text, source, "it is not one of the words allowed" + did_you_mean(text, option.choices));
    **word = text;
  } else if (auto* list = std::get_if<std::vector<std::string>*>(&option.value)) {
    **list = parts_between(text, ',');
    if (option.choices.empty()) return;
    if ((*list)->empty()) refuse(option, text.empty() ? "nothing" : text, source, "the list is empty");
    for (const std::string& part : **list)
      if (std::find(option.choices.begin(), option.choices.end(), part) == option.choices.end())
        refuse(
            option, text, source,
            fmt::format("'{}' is not one of the words allowed{}", part, did_you_mean(part, option.choices)));
  } else if (auto* numbers = std::get_if<std::vector<double>*>(&option.value)) {
    std::vector<double> read;
    for (const std::string& part : parts_between(text, ',')) {
      read.push_back(parse_quantity(option, part, source) +
                     0.0);  // no -0, which is written as a whole number
      if (!std::isfinite(read.back())) refuse(option, part, source, "it is not a finite number");
    }
    **numbers = std::move(read);
  } else {
    assign_number(option, parse_quantity(option, text, source), text, source);
  }
}

Option* find(std::vector<Option>& options, const std::string& key) {
  for (Option& option : options)
    if (option.key == key || without_unit(option) == key) return &option;
  return nullptr;
}

[[noreturn]] void unknown_key(std::vector<Option>& options, const std::string& key, const std::string& source,
                              std::vector<std::string> known = {}) {
  for (const Option& option : options) known.push_back(option.key);
  for (const Option& option : options) known.push_back(without_unit(option));
  // Other names of the same, which spelling alone does not lead to.
  static const std::map<std::string, std::string> synonyms = {{"e", "material.young"},
                                                              {"e_pa", "material.young"},
                                                              {"youngs_modulus", "material.young"},
                                                              {"young_modulus", "material.young"},
                                                              {"elastic_modulus", "material.young"},
                                                              {"g", "material.mu"},
                                                              {"shear_modulus", "material.mu"},
                                                              {"poisson", "material.nu"},
                                                              {"poisson_ratio", "material.nu"},
                                                              {"rho", "material.density"}};
  const auto synonym = synonyms.find(lower(key.substr(key.rfind('.') + 1)));
  const auto without_section = std::find_if(known.begin(), known.end(), [&](const std::string& one) {
    return one.find('.') != std::string::npos && one.substr(one.rfind('.') + 1) == key;
  });
  const std::string meant = synonym != synonyms.end() ? fmt::format(", did you mean '{}'?", synonym->second)
                            : without_section != known.end()
                                ? fmt::format(", did you mean '{}'?", *without_section)
                                : did_you_mean(key, known);
  throw UsageError({.fact = fmt::format("there is no option '{}'{}", key, meant),
                    .where = source,
                    .why = "keys are section.name, in lower case",
                    .remedy = "see `dimple options` for all of them"});
}

std::string toml_value(const Option& option) {
  if (auto* real = std::get_if<double*>(&option.value)) {
    const std::string s = fmt::format("{}", **real);  // shortest form that reads back to the same bits
    return s.find_first_of(".en") == std::string::npos ? s + ".0" : s;
  }
  if (auto* whole = std::get_if<std::int64_t*>(&option.value)) return fmt::format("{}", **whole);
  if (auto* word = std::get_if<std::string*>(&option.value)) return toml_string(**word);
  if (auto* numbers = std::get_if<std::vector<double>*>(&option.value))
    return fmt::format("[{}]", fmt::join(**numbers, ", "));
  std::vector<std::string> items;
  for (const std::string& item : **std::get_if<std::vector<std::string>*>(&option.value))
    items.push_back(toml_string(item));
  return fmt::format("[{}]", fmt::join(items, ", "));
}

}  // namespace

std::vector<std::pair<std::string, Config::Step>> steps_in_order(const Config& config) {
  std::vector<std::pair<std::string, Config::Step>> steps(config.step.begin(), config.step.end());
  std::sort(steps.begin(), steps.end(),
            [](const auto& a, const auto& b) { return a.second.order < b.second.order; });
  return steps;
}

std::vector<std::pair<std::string, Config::Step>> moving_steps(const Config& config) {
  auto steps = steps_in_order(config);
  std::erase_if(steps, [](const auto& step) { return !step.second.cut.empty(); });
  return steps;
}

namespace {

// What a name of one's own stands for, below a section: "load.pressure.csf.on".
template <class Named>
struct NamedSection {
  std::map<std::string, Named>& named;
  std::string_view section, what, example;

  // Of a key that is one of those; the name need not be there yet.
  std::optional<Option> option_of(const std::string& key, const std::string& source) const {
    const auto dot = key.rfind('.');
    if (!key.starts_with(section) || dot < section.size()) return std::nullopt;
    const std::string name = key.substr(section.size(), dot - section.size()), own(what);
    if (name.empty())
      throw UsageError({.fact = fmt::format("'{}' names no option of a {}", key, what),
                        .where = source,
                        .why = fmt::format("keys are {}name.option", section),
                        .remedy = std::string(example)});
    if (name.find('.') != std::string::npos)
      throw UsageError(
          {.fact = fmt::format("a {} is called '{}', and a name holds no dot", own, name),
           .where = source,
           .why = fmt::format("dots part keys: {}name.option, here and in summary.json's own paths", section),
           .remedy = std::string(example)});
    std::vector<Option> options = options_of(named[name]);
    Option* option = find(options, own + key.substr(dot));
    if (!option) {
      for (Option& one : options) one.key = fmt::format("{}{}{}", section, name, one.key.substr(own.size()));
      unknown_key(options, key, source);
    }
    return *option;
  }
  // The key of each option as it is written, and the option.
  std::vector<std::pair<std::string, Option>> all() const {
    std::vector<std::pair<std::string, Option>> result;
    for (auto& [name, its] : named)
      for (const Option& option : options_of(its))
        result.emplace_back(fmt::format("{}{}{}", section, name, option.key.substr(option.key.find('.'))),
                            option);
    return result;
  }
};

NamedSection<Config::Pressure> pressures_of(Config& config) {
  return {config.pressure, "load.pressure.", "pressure",
          "for instance --set load.pressure.csf.pressure=500Pa"};
}
NamedSection<Config::Film> membranes_of(Config& config) {
  return {config.membrane, "membrane.", "membrane", "for instance --set membrane.pia.thickness=0.1mm"};
}
NamedSection<Config::Wall> walls_of(Config& config) {
  return {config.wall, "wall.", "wall", "for instance --set wall.skull.shape=label:skull"};
}
NamedSection<Config::Held> supports_of(Config& config) {
  return {config.held, "support.", "support", "for instance --set support.retractor.on=left"};
}

NamedSection<Config::OtherTool> tools_of(Config& config) {
  return {config.other_tool, "tool.", "tool", "for instance --set tool.left.shape=sphere:4mm"};
}

NamedSection<Config::Step> steps_of(Config& config) {
  return {config.step, "step.", "step", "for instance --set step.press.move=4mm"};
}

std::optional<Option> named_option(Config& config, const std::string& key, const std::string& source) {
  if (auto option = pressures_of(config).option_of(key, source)) return option;
  if (auto option = membranes_of(config).option_of(key, source)) return option;
  if (auto option = walls_of(config).option_of(key, source)) return option;
  if (auto option = supports_of(config).option_of(key, source)) return option;
  if (auto option = tools_of(config).option_of(key, source)) return option;
  const int before = static_cast<int>(config.step.size());
  auto option = steps_of(config).option_of(key, source);
  if (static_cast<int>(config.step.size()) > before)
    config.step[key.substr(5, key.rfind('.') - 5)].order = before;
  return option;
}

std::vector<std::pair<std::string, Option>> named_options(Config& config) {
  auto all = pressures_of(config).all(), membranes = membranes_of(config).all(),
       walls = walls_of(config).all(), supports = supports_of(config).all(), tools = tools_of(config).all(),
       steps = steps_of(config).all();
  for (const auto* further : {&membranes, &walls, &supports, &tools, &steps})
    all.insert(all.end(), further->begin(), further->end());
  return all;
}

// A file of all options holds both in one table.
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

// "tissue.2.mu" -> label "2" and "material.mu_Pa", checked as that option is.
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
                             "uncertainty would take several runs",
                      .remedy = "run it once with the smallest and once with the largest modulus"});
  std::vector<Option> options = options_of(scratch);
  config.tissue[label][find(options, "material." + key.substr(dot + 1))->key] = text;
  return true;
}

}  // namespace

void set_option(Config& config, const std::string& key, const std::string& text, const std::string& source) {
  if (set_tissue(config, key, text, source)) return;
  if (const auto named = named_option(config, key, source)) {
    assign_text(*named, text, source);
    return refuse_names_of_options(config, source);
  }
  std::vector<Option> options = options_of(config);
  Option* option = find(options, key);
  if (!option) unknown_key(options, key, source);
  if (const auto spread = text.find("+-"); spread != std::string::npos && option->key == "material.mu_Pa") {
    set_option(config, "material.mu_spread_percent", text.substr(spread + 2), source);
    return set_option(config, key, text.substr(0, spread), source);
  }
  // A modulus given anew is not known as another in a file was.
  if (option->key == "material.mu_Pa" && is_of_caller(source))
    if (const auto before = config.source.find("material.mu_spread_percent");
        before != config.source.end() && !is_of_caller(before->second))
      config.material.mu_spread_percent = 0.0;
  const bool place = option->key == "boundary.indent_at" && text.find(',') != std::string::npos;
  assign_text(*option, place ? place_in_mm(text) : text, source);
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
  const Option* option = find(options, key);
  if (!option) unknown_key(options, key, source);
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
  const auto in_words = [](std::string text) {  // "--indent-at" and "indent_at" are one
    text.erase(0, text.find_first_not_of('-'));
    std::replace(text.begin(), text.end(), '-', '_');
    return text;
  };
  const auto without_section = [](const std::string& key) { return key.substr(key.find('.') + 1); };
  const std::string wanted = in_words(name);
  std::vector<std::string> known = others;
  const Option* by_its_end = nullptr;
  for (const Option& option : options) {
    const std::string flag = in_words(option.flag), bare = without_unit(option);
    if (wanted == option.key || wanted == bare || (!flag.empty() && wanted == flag)) return option.key;
    if (wanted == without_section(option.key) || wanted == without_section(bare)) by_its_end = &option;
    known.push_back(flag.empty() ? without_section(bare) : flag);
    known.push_back(without_section(option.key));
  }
  if (by_its_end) return by_its_end->key;
  unknown_key(options, name, source, std::move(known));
}

void set_value(const Option& option, const std::string& text, const std::string& source) {
  assign_text(option, text, source);
}

namespace {

constexpr std::array keys_of_a_preset = {
    "material.mu_Pa",       "material.nu",          "material.density_kg_per_m3",
    "material.ogden_mu_Pa", "material.ogden_alpha", "material.mooney_c01_Pa",
    "material.prony_g",     "material.prony_tau_s"};

bool is_of_a_preset(const Option& option) {
  return std::find(keys_of_a_preset.begin(), keys_of_a_preset.end(), option.key) != keys_of_a_preset.end();
}

// How much an option was meant: 0, not at all, or as a file of all options states whatever nobody has chosen;
// 1, for all cases of a table, each of which may say otherwise; 2, in a file; 3, by the caller.
int weight_of(const Config& config, const std::string& key) {
  const auto source = config.source.find(key);
  if (source == config.source.end() || source->second.starts_with(of_preset)) return 0;
  if (source->second.starts_with(for_all_cases)) return 1;
  if (is_of_caller(source->second)) return 3;
  Config usual, own = config;
  std::vector<Option> all = options_of(own), as_usual = options_of(usual);
  return toml_value(*find(all, key)) == toml_value(*find(as_usual, key)) ? 0 : 2;
}

// Whether a number is of a preset that was there before.
bool was_of_a_preset(const Config& config, const std::string& key) {
  const auto source = config.source.find(key);
  return source != config.source.end() &&
         (source->second.starts_with(of_preset) || source->second.starts_with(for_all_cases + of_preset));
}

void take_preset(Config& config, bool young_given) {
  const std::string& preset = config.material.preset;
  const bool none = preset == "none";
  Config published;
  if (!none) static_cast<MaterialNumbers&>(published.material) = numbers_of_preset(preset);
  const int weight = weight_of(config, "material.preset");
  std::vector<Option> own = options_of(config), theirs = options_of(published);
  for (std::size_t k = 0; k < own.size(); ++k) {
    const std::string& key = own[k].key;
    if (!is_of_a_preset(own[k]) || (key == "material.mu_Pa" && young_given)) continue;
    if (none ? !was_of_a_preset(config, key) : weight_of(config, key) >= weight) continue;
    std::visit([&](auto* value) { *value = *std::get<decltype(value)>(theirs[k].value); }, own[k].value);
    if (none)
      config.source.erase(key);
    else
      config.source[key] = of_preset + preset;
  }
}

void resolve_young(Config& config) {
  auto& m = config.material;
  if (m.young_Pa == 0.0) return;
  const auto young = config.source.find("material.young_Pa"), mu = config.source.find("material.mu_Pa");
  if (weight_of(config, "material.mu_Pa") > 1)
    throw UsageError(
        {.fact = fmt::format("both a shear modulus, {} Pa, and Young's modulus, {} Pa, are given", m.mu_Pa,
                             m.young_Pa),
         .where = fmt::format("{} and {}", mu->second, young->second),
         .why = "one follows from the other: mu = E / (2 (1 + nu))",
         .remedy = "give one of --mu and --young; material.young_Pa = 0 takes back one from a file"});
  m.mu_Pa = m.young_Pa / (2.0 * (1.0 + m.nu));
  config.source["material.mu_Pa"] = fmt::format("Young's modulus {} Pa, {}", m.young_Pa, young->second);
  m.young_Pa = 0.0;
}

// Of Ogden's law the shear modulus is the sum of its moduli.
void match_ogden(Config& config, int weight_of_modulus) {
  auto& m = config.material;
  double sum = 0.0;
  for (const double mu : m.ogden_mu_Pa) sum += mu;
  constexpr double rounding = 1e-12;
  if (!(sum > 0.0) || std::abs(sum - m.mu_Pa) <= rounding * sum)
    return;  // what is no law is refused elsewhere
  const int weight = weight_of(config, "material.ogden_mu_Pa");
  if (weight == weight_of_modulus && weight > 0)
    throw UsageError(
        {.fact = fmt::format("both a shear modulus, {} Pa, and Ogden moduli that add up to {} Pa are given",
                             m.mu_Pa, sum),
         .where = fmt::format("{} and {}", config.source.at("material.mu_Pa"),
                              config.source.at("material.ogden_mu_Pa")),
         .why = "the moduli of Ogden's terms add up to the shear modulus",
         .remedy = "give one of them"});
  if (weight_of_modulus > weight) {
    for (double& mu : m.ogden_mu_Pa) mu *= m.mu_Pa / sum;
    config.source["material.ogden_mu_Pa"] += ", scaled to mu";
  } else {
    m.mu_Pa = sum;
    config.source["material.mu_Pa"] = "the sum of ogden_mu_Pa";
  }
}

// The number follows from the spacing; a number in the terminal takes back a spacing in a file.
void resolve_spacing(Config& config) {
  if (!(config.cloud.spacing_mm > 0.0)) return;
  const int nodes = weight_of(config, "cloud.nodes"), spacing = weight_of(config, "cloud.spacing_mm");
  if (nodes > spacing) config.cloud.spacing_mm = 0.0;
  const auto in_terminal = [&](const char* key) {
    const auto source = config.source.find(key);
    return source != config.source.end() && source->second.starts_with("--");
  };
  if (in_terminal("cloud.nodes") && in_terminal("cloud.spacing_mm"))
    throw UsageError({.fact = fmt::format("both {} nodes and a spacing of {} are asked for",
                                          config.cloud.nodes, length_in_words(config.cloud.spacing_mm)),
                      .where = fmt::format("{} and {}", config.source.at("cloud.nodes"),
                                           config.source.at("cloud.spacing_mm")),
                      .why = "one follows from the other",
                      .remedy = "give one of --nodes and --spacing"});
}

// What was said nearer to the terminal takes back the other.
void resolve_points(Config& config) {
  if (!(config.grid.points > 0) || !(config.grid.ratio > 0.0)) return;
  const int points = weight_of(config, "grid.points"), ratio = weight_of(config, "grid.ratio");
  if (points < ratio) config.grid.points = 0;
  if (points > ratio) config.grid.ratio = 0.0;
  if (points == ratio)
    throw UsageError({.fact = fmt::format("both {} integration points and {} of them per node are asked for",
                                          config.grid.points, plain(config.grid.ratio)),
                      .where = "--points (grid.points) and grid.ratio",
                      .why = "one follows from the other",
                      .remedy = "give one of them"});
}

}  // namespace

void resolve_material(Config& config) {
  const int young = config.material.young_Pa > 0.0 ? weight_of(config, "material.young_Pa") : 0;
  const bool young_given = young > 0 && young >= weight_of(config, "material.preset");
  if (!young_given && config.material.preset != "none") config.material.young_Pa = 0.0;
  const int weight_of_modulus = std::max(weight_of(config, "material.mu_Pa"), young);
  take_preset(config, young_given);
  resolve_young(config);
  match_ogden(config, weight_of_modulus);
  resolve_steps(config);
  resolve_depth(config);
  resolve_spacing(config);
  resolve_points(config);
}

std::string beside_preset(const Config& config) {
  if (config.material.preset == "none") return {};
  Config own = config, published;
  static_cast<MaterialNumbers&>(published.material) = numbers_of_preset(config.material.preset);
  const std::vector<Option> ours = options_of(own), theirs = options_of(published);
  std::string text;
  for (std::size_t k = 0; k < ours.size(); ++k) {
    const std::string now = toml_value(ours[k]), then = toml_value(theirs[k]);
    if (!is_of_a_preset(ours[k]) || now == then) continue;
    const auto source = config.source.find(ours[k].key);
    text += fmt::format("{}{} {}{} in place of {}", text.empty() ? config.material.preset + ", but " : "; ",
                        ours[k].key.substr(ours[k].key.find('.') + 1), now,
                        source == config.source.end() ? "" : " (" + source->second + ")", then);
  }
  return text;
}

bool default_stiffness(const Config& config) {
  const auto& m = config.material;
  return m.preset == "none" && m.ogden_mu_Pa.empty() && m.mu_Pa == Config{}.material.mu_Pa &&
         config.source.count("material.mu_Pa") == 0;
}

bool default_nodes(const Config& config) {
  return config.cloud.nodes == Config{}.cloud.nodes && !(config.cloud.spacing_mm > 0.0) &&
         config.source.count("cloud.nodes") == 0;
}

namespace {

// A value as --set would have it.
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

// The options of a section that has a name of its own.
void set_all(Config& config, const std::string& section, const toml::node& node,
             const std::filesystem::path& file, GivenOnce& given) {
  const toml::table* table = node.as_table();
  std::vector<Option> options = options_of(config);
  if (!table) unknown_key(options, section, file.string());
  if (table->empty())
    throw UsageError({.fact = fmt::format("the section [{}] is empty", section),
                      .where = fmt::format("{}, line {}", file.string(), table->source().begin.line),
                      .why = "it would change nothing, and what it is to be is not known",
                      .remedy = "give it its options (`dimple options`), or leave it out"});
  for (const auto& [name, value] : *table) {
    const std::string key = fmt::format("{}.{}", section, name.str()), text = text_of_value(value),
                      place = fmt::format("{}, line {}", file.string(), value.source().begin.line);
    given.add(key, text, place);
    set_option(config, key, text, place);
  }
}

// A table of TOML has no order of its own: the lines have, and the places in them.
void read_steps(Config& config, const toml::table& table, const std::filesystem::path& file,
                GivenOnce& given) {
  const toml::node* section = table.get("step");
  if (!section) return;
  std::vector<Option> options = options_of(config);
  if (!section->is_table()) unknown_key(options, "step", file.string());
  std::vector<std::pair<std::string, const toml::node*>> steps;
  for (const auto& [name, node] : *section->as_table()) steps.emplace_back(name.str(), &node);
  std::sort(steps.begin(), steps.end(), [](const auto& a, const auto& b) {
    const toml::source_position x = a.second->source().begin, y = b.second->source().begin;
    return std::pair(x.line, x.column) < std::pair(y.line, y.column);
  });
  for (const auto& [name, node] : steps) set_all(config, "step." + name, *node, file, given);
}

}  // namespace

void read_config(Config& config, const std::filesystem::path& file) {
  toml::table table;
  try {
    table = toml::parse(read_file(file, most_bytes_of_text), file.string());
  } catch (const toml::parse_error& error) {
    throw UsageError(
        {.fact = fmt::format("{} is not valid TOML: {}", file.string(), error.description()),
         .where = fmt::format("line {}, column {}", error.source().begin.line, error.source().begin.column),
         .why = "the file cannot be read as a configuration",
         .remedy = "correct that line; strings need quotes, tables look like [material]"});
  }
  std::vector<Option> options = options_of(config);
  GivenOnce given;
  for (const auto& [section, node] : table) {
    const toml::table* entries = node.as_table();
    if (!entries) unknown_key(options, std::string(section.str()), file.string());
    for (const auto& [name, value] : *entries) {
      if (section.str() == "tissue") {
        set_all(config, "tissue." + std::string(name.str()), value, file, given);
        continue;
      }
      if (section.str() == "membrane" || section.str() == "wall" ||
          ((section.str() == "support" || section.str() == "tool") && value.is_table())) {
        set_all(config, fmt::format("{}.{}", section.str(), name.str()), value, file, given);
        continue;
      }
      if (section.str() == "step") continue;  // below, in the order of their lines
      if (section.str() == "load" && name.str() == "pressure") {
        const toml::table* pressures = value.as_table();
        if (!pressures) unknown_key(options, "load.pressure", file.string());
        for (const auto& [of, its] : *pressures)
          set_all(config, "load.pressure." + std::string(of.str()), its, file, given);
        continue;
      }
      const std::string key = std::string(section.str()) + "." + std::string(name.str());
      const std::string place = fmt::format("{}, line {}", file.string(), value.source().begin.line);
      Option* option = find(options, key);
      if (!option) unknown_key(options, key, place);
      given.add(key, text_of_value(value), place);
      const bool is_text = !std::holds_alternative<double*>(option->value) &&
                           !std::holds_alternative<std::int64_t*>(option->value);
      if (const auto text = value.value_exact<std::string>()) {
        set_option(config, option->key, *text, place);
      } else if (const toml::array* list = value.as_array(); list && is_text) {
        std::vector<std::string> items;
        for (const auto& item : *list) {
          if (const auto word = item.value_exact<std::string>())
            items.push_back(*word);
          else if (const auto number = item.value_exact<std::int64_t>())
            items.push_back(std::to_string(*number));
          else if (const auto real = item.value_exact<double>())
            items.push_back(fmt::format("{}", *real));
          else
            refuse(*option, "a list with something other than words and numbers", place, "it cannot be read");
        }
        assign_text(*option, fmt::format("{}", fmt::join(items, ",")), place);
      } else if (const auto number = value.value<double>(); number && !value.is_boolean() && !is_text) {
        assign_number(*option, *number, fmt::format("{}", *number), place);
      } else {
        std::ostringstream shown;
        value.visit([&](auto&& v) { shown << v; });
        refuse(*option, shown.str(), place,
               is_text ? "it must be a word in quotes"
                       : "it must be a number, or a number with its unit in quotes");
      }
      config.source[option->key] = place;
    }
  }
  read_steps(config, table, file, given);
}

namespace {

std::string as_table(const char* section, const std::string& name, const std::vector<Option>& options) {
  std::string text = fmt::format("\n[{}.{}]\n", section, toml_string(name));
  for (const Option& option : options)
    text += fmt::format("{} = {}\n", option.key.substr(option.key.find('.') + 1), toml_value(option));
  return text;
}

}  // namespace

std::string to_toml(const Config& config, const std::map<std::string, std::string>& notes) {
  Config copy = config;
  std::string text = "# Every option of this run. `dimple run --config THIS -o OUT` repeats it bit by bit.\n";
  std::string section;
  for (const Option& option : options_of(copy)) {
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
  for (auto [name, pressure] : config.pressure) text += as_table("load.pressure", name, options_of(pressure));
  for (auto [name, film] : config.membrane) text += as_table("membrane", name, options_of(film));
  for (auto [name, wall] : config.wall) text += as_table("wall", name, options_of(wall));
  for (auto [name, held] : config.held) text += as_table("support", name, options_of(held));
  for (auto [name, tool] : config.other_tool) text += as_table("tool", name, options_of(tool));
  for (auto [name, step] : steps_in_order(config)) text += as_table("step", name, options_of(step));
  return text;
}

std::map<std::string, std::string> option_values(const Config& config) {
  Config copy = config;
  std::map<std::string, std::string> values;
  for (const Option& option : options_of(copy))
    if (option.key != "image.file") values[option.key] = toml_value(option);
  for (const auto& [label, differing] : config.tissue)
    for (const auto& [key, value] : differing)
      values[fmt::format("tissue.{}.{}", label, key.substr(key.find('.') + 1))] = value;
  for (const auto& [key, option] : named_options(copy)) values[key] = toml_value(option);
  return values;
}

std::string option_reference() {
  Config config;
  config.pressure["NAME"];
  config.membrane["NAME"];
  config.wall["NAME"];
  config.held["NAME"];
  config.other_tool["NAME"];
  config.step["NAME"];
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

std::string did_you_mean(const std::string& word, const std::vector<std::string>& known) {
  std::string best;
  std::size_t least = std::max<std::size_t>(2, word.size() / 3) + 1;
  for (const std::string& candidate : known) {
    std::vector<std::size_t> row(candidate.size() + 1);
    for (std::size_t j = 0; j < row.size(); ++j) row[j] = j;
    for (std::size_t i = 0; i < word.size(); ++i) {
      std::size_t diagonal = row[0];
      row[0] = i + 1;
      for (std::size_t j = 0; j < candidate.size(); ++j) {
        const std::size_t keep = diagonal + (word[i] == candidate[j] ? 0 : 1);
        diagonal = row[j + 1];
        row[j + 1] = std::min({keep, row[j] + 1, row[j + 1] + 1});
      }
    }
    if (row.back() < least) {
      least = row.back();
      best = candidate;
    }
  }
  return best.empty() ? "" : fmt::format(", did you mean '{}'?", best);
}

Scheme scheme_of(const Config& c) {
  Scheme scheme = *scheme_named(c.scheme.name);  // one of the option's choices
  if (c.cloud.rim > 0.0) {
    scheme.grading.rim = c.cloud.rim;
    scheme.grading.least = 0.0;
  }
  if (c.grid.ratio > 0.0) scheme.points_per_node = c.grid.ratio;
  if (c.support.radius_factor > 0.0) scheme.support.radius_factor = c.support.radius_factor;
  return scheme;
}

bool has_loads(const Config& config) {
  return config.load.gravity != "none" || config.load.fluid_lost != "none" || !config.pressure.empty();
}

bool was_given(const Config& config, const char* key) {
  return weight_of(config, key) > 0;
}

bool has_membranes(const Config& config) {
  return config.load.membrane != "none" || !config.membrane.empty();
}

bool has_walls(const Config& config) {
  return config.load.wall != "none" || !config.wall.empty();
}

bool has_base(const Config& config) {
  return config.boundary.base_hold != "none";
}

bool has_tool_alone(const Config& config) {
  return has_base(config) && !has_loads(config) && !has_membranes(config) && !has_walls(config) &&
         config.held.empty() && config.other_tool.empty() && config.step.empty();
}

double force_spread(const Config& config) {
  return 0.01 * config.material.mu_spread_percent;
}

std::optional<Goal> goal_of(const Config& config) {
  const std::string& text = config.accuracy.goal;
  Goal goal{.budget_s = config.accuracy.budget_s};
  if (text.empty() && !(goal.budget_s > 0.0)) return std::nullopt;
  const Config usual;
  const std::map<std::string, bool> other_than_usual = {
      {"cloud.nodes", config.cloud.nodes != usual.cloud.nodes},
      {"cloud.spacing_mm", config.cloud.spacing_mm != usual.cloud.spacing_mm}};
  for (const auto& [key, is_other] : other_than_usual)  // a file of all options states the usual ones too
    if (const auto source = config.source.find(key);
        source != config.source.end() && (is_other || is_of_caller(source->second)))
      throw UsageError(
          {.fact = "both an accuracy and a number of nodes are asked for",
           .where = fmt::format("{} and {}", source->second, text.empty() ? "--budget" : "--accuracy"),
           .why = "the nodes follow from the accuracy",
           .remedy = "leave one of them out"});
  if (text.empty()) return goal;
  const bool of_place = followed_place(config).has_value();
  const std::string unit = of_place ? "mm" : "N";
  const bool is_absolute = text.find(of_place ? 'm' : 'N') != std::string::npos;
  double value = 0.0;
  set_value({.key = "accuracy.goal",
             .flag = "--accuracy",
             .unit = is_absolute ? unit : "%",
             .value = &value,
             .most = is_absolute ? 1e6 : 100.0,
             .least_excluded = true,
             .help = is_absolute ? "largest error"
                                 : fmt::format("largest error, as 2% or {}", of_place ? "0.1mm" : "1mN")},
            text, "--accuracy (accuracy.goal)");
  (is_absolute ? goal.absolute : goal.share) = !is_absolute ? 0.01 * value : of_place ? 1e-3 * value : value;
  if (const double least = band_floor(config)(most_nodes_for_accuracy);
      !of_place && goal.share > 0.0 && goal.share < least)
    throw UsageError(
        {.fact = fmt::format("an accuracy of {} is asked for", text),
         .where = "--accuracy (accuracy.goal)",
         .why = fmt::format(
             "the error of this load cannot be shown to be below {:.2g} %: two clouds agree that well "
             "by chance",
             100.0 * least),
         .remedy = "ask for less accuracy, or for less depth than the circle's radius"});
  return goal;
}

FloorOfBand band_floor(const Config& config) {
  if (followed_place(config)) return floor_of_displacement();
  return floor_of_force(
      {2.0 * config.load.depth_mm / config.boundary.indenter_diameter_mm, !config.tissue.empty()});
}

std::optional<Vec3> followed_place(const Config& config) {
  const OptionWord word = parse_word({"the quantity",
                                      {{"force"},
                                       {.kind = "displacement",
                                        .numbers = place_numbers(1e-3),
                                        .example = "displacement@12,-30,45",
                                        .after_kind = '@'}}},
                                     config.accuracy.quantity, "--quantity (accuracy.quantity)");
  return word.number.empty() ? std::nullopt : std::optional(word.three());
}

ModelOptions model_options(const Config& c) {
  ModelOptions options = options_of(scheme_of(c));
  options.cloud.count = c.cloud.nodes;
  options.cloud.spacing_mm = c.cloud.spacing_mm;
  options.cloud.seed = static_cast<std::uint64_t>(c.cloud.seed);
  options.cloud.jitter = c.cloud.jitter;
  options.grid.count = c.grid.points;
  options.boundary = {.base = c.boundary.base,
                      .base_depth_mm = c.boundary.base_depth_mm,
                      .indent_at = c.boundary.indent_at,
                      .indenter_diameter_mm = c.boundary.indenter_diameter_mm,
                      .direction = c.boundary.direction};
  options.boundary.other_tools = places_of_other_tools(c);
  if (const std::optional<ToolShape> tool = tool_of(c)) {
    options.boundary.indenter_diameter_mm = 2e3 * tool->radius;
    options.boundary.contact_radius_mm = 1e3 * contact_radius(*tool, 1e-3 * c.load.depth_mm);
    // What a step goes along the push, which is not known yet, needs no other nodes.
    for (const Vec3& come : way_of_tool(c, Vec3::Zero())) options.boundary.way_of_tool.push_back(1e3 * come);
    if (turns(c))
      options.boundary.way_of_turning_tool = [c](const Vec3& push, const Vec3& place_mm) {
        std::vector<Vec3> way;
        for (const Vec3& come : swept(c, {.centre = 1e-3 * place_mm, .push = push}))
          way.push_back(1e3 * come);
        return way;
      };
    GradingOptions& grading = options.cloud.grading;
    grading.whole_circle = !(tool->edge > 0.0);
    // A bonded rim tears finer nodes apart; a round tool's first touch is small beside its last.
    if (grading.whole_circle) {
      grading.least = std::min(grading.least, 0.08);
      options.boundary.height_of_tool = [shape = *tool](double r) {
        return 1e3 * height_of_tool(shape, 1e-3 * r);
      };
    }
    if (tool->edge > 0.0)
      grading.least = std::min(grading.least, 0.25 * 1e3 * tool->edge / options.boundary.contact_radius_mm);
  }
  return options;
}

Precision precision_of(const Config& c) {
  return c.solver.precision == "single" ? Precision::single_ : Precision::double_;
}

Material material_of(const Config& c) {
  return material_from(c.material, c.material.stress == "printed");
}

std::vector<Material> materials_of(const Config& c) {
  std::vector<Material> result = {material_of(c)};
  for (const auto& [label, differing] : c.tissue) {
    Config own = c;
    own.tissue.clear();
    own.source.clear();
    if (c.material.preset != "none" && differing.contains("material.preset"))
      static_cast<MaterialNumbers&>(own.material) = {};
    for (const auto& [key, text] : differing) set_option(own, key, text, "tissue." + label);
    resolve_material(own);
    try {
      result.push_back(material_of(own));
    } catch (UsageError& error) {
      error.report.where = fmt::format("[tissue.{}]", label);
      throw;
    }
  }
  return result;
}

Vec3 gravity_of(const Config& config) {
  if (config.load.gravity == "none") return Vec3::Zero();
  const OptionWord word =
      parse_word({"gravity",
                  {{.numbers = direction_numbers(), .example = "inferior, or 0,0,-9.81", .is_side = true}},
                  "it is a side of the patient, towards which 9.81 m/s2 pull, or three numbers in m/s2"},
                 config.load.gravity, "--gravity (load.gravity)");
  if (!(word.three().norm() < 1e5)) refuse_word(word, "is out of range", "its size is below 100000 m/s2");
  return word.is_side ? Vec3(9.81 * word.three()) : word.three();
}

Loading loading_of(const Config& c) {
  return {.depth = 1e-3 * c.load.depth_mm,
          .rate = 1e-3 * c.load.rate_mm_per_s,
          .contact = c.load.contact == "bonded" ? Contact::bonded : Contact::frictionless,
          .loads = {.gravity = gravity_of(c), .pressure = {}, .membrane = {}}};
}

SolverOptions solver_options(const Config& c) {
  constexpr double fewest_samples = 20.0;  // of a load that is shorter than the usual rate takes for them
  const double least_rate = was_given(c, "solver.sample_rate_per_s")
                                ? 0.0
                                : fewest_samples * c.load.rate_mm_per_s / c.load.depth_mm;
  return {.safety = c.solver.safety,
          .damping = c.solver.damping_per_s,
          .frames = static_cast<int>(c.solver.frames),
          .step_radii = c.solver.step_radii,
          .sample_rate = std::max(c.solver.sample_rate_per_s, least_rate),
          .tolerance = c.solver.tolerance,
          .evaluations = c.solver.evaluations};
}

}  // namespace dimple
