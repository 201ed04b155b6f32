#include "apps/scene/option.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

#include "apps/scene/option_word.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/text.hpp"

namespace dimple {

std::string without_unit(const Option& option) {
  static const std::map<std::string, std::string> suffix = {
      {"mm", "_mm"},     {"Pa", "_Pa"},       {"mm/s", "_mm_per_s"}, {"kg/m3", "_kg_per_m3"},
      {"1/s", "_per_s"}, {"N/m", "_N_per_m"}, {"N/m3", "_N_per_m3"}, {"N/m4", "_N_per_m4"},
      {"s", "_s"},       {"deg", "_deg"},     {"J/m2", "_J_m2"},     {"%", "_percent"}};
  const auto found = suffix.find(option.unit);
  if (found == suffix.end() || !option.key.ends_with(found->second)) return option.key;
  return option.key.substr(0, option.key.size() - found->second.size());
}

namespace {

// Units of a number, as multiples of the option's unit. A table of three dozen entries suffices: libraries
// for units have hundreds and no such list to print in a message.
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
      {"N/m3", {{"N/m3", 1.0}, {"kN/m3", 1e3}}},
      {"N/m4", {{"N/m4", 1.0}, {"kN/m4", 1e3}}},
      {"J/m2", {{"J/m2", 1.0}, {"kJ/m2", 1e3}}},
  };
  return table;
}

}  // namespace

[[noreturn]] void refuse_value(const Option& option, const std::string& text, const std::string& source,
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

void set_number(const Option& option, double value, const std::string& text, const std::string& source) {
  if (!std::isfinite(value)) refuse_value(option, text, source, "it is not a finite number");
  if (value < option.least || value > option.most || (option.least_excluded && value == option.least))
    refuse_value(option, text, source, "it is out of range");
  if (auto* real = std::get_if<double*>(&option.value)) {
    **real = value;
  } else {
    if (value != std::round(value)) refuse_value(option, text, source, "it is not a whole number");
    **std::get_if<std::int64_t*>(&option.value) = static_cast<std::int64_t>(value);
  }
}

namespace {

double parse_quantity(const Option& option, const std::string& text, const std::string& source) {
  const std::string t(trimmed(text));
  double value = 0.0;
  const char* begin = t.data() + (t.starts_with('+') ? 1 : 0);
  const auto [end, error] = std::from_chars(begin, t.data() + t.size(), value);
  if (error != std::errc{}) refuse_value(option, text, source, "it is not a number");
  const std::string unit(trimmed(std::string(end, t.data() + t.size())));
  if (unit.empty()) return value;
  const auto table = unit_table().find(option.unit);
  if (table == unit_table().end())
    refuse_value(option, text, source,
                 fmt::format("'{}' follows the number, but this option has no unit", unit));
  const auto factor = table->second.find(unit);
  if (factor == table->second.end()) {
    std::vector<std::string> known;
    for (const auto& [name, unused] : table->second) known.push_back(name);
    refuse_value(option, text, source,
                 fmt::format("'{}' is not one of its units ({})", unit, fmt::join(known, ", ")));
  }
  return value * factor->second;
}

}  // namespace

bool is_of_caller(const std::string& source) {
  return source.starts_with("--") || source.ends_with("=");
}

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

void set_value(const Option& option, const std::string& text, const std::string& source) {
  if (!is_utf8(text))
    throw UsageError({.fact = fmt::format("{} = {} is not UTF-8", option.key, text),
                      .where = source,
                      .why = "a run repeats every name in config.resolved.toml, which is UTF-8",
                      .remedy = "rename the file, or save the table as UTF-8"});
  if (auto* word = std::get_if<std::string*>(&option.value)) {
    if (!option.choices.empty() &&
        std::find(option.choices.begin(), option.choices.end(), text) == option.choices.end())
      refuse_value(option, text, source,
                   "it is not one of the words allowed" + did_you_mean(text, option.choices));
    **word = text;
  } else if (auto* list = std::get_if<std::vector<std::string>*>(&option.value)) {
    **list = parts_between(text, ',');
    if (option.choices.empty()) return;
    if ((*list)->empty()) refuse_value(option, text.empty() ? "nothing" : text, source, "the list is empty");
    for (const std::string& part : **list)
      if (std::find(option.choices.begin(), option.choices.end(), part) == option.choices.end())
        refuse_value(
            option, text, source,
            fmt::format("'{}' is not one of the words allowed{}", part, did_you_mean(part, option.choices)));
  } else if (auto* numbers = std::get_if<std::vector<double>*>(&option.value)) {
    std::vector<double> read;
    for (const std::string& part : parts_between(text, ',')) {
      read.push_back(parse_quantity(option, part, source) +
                     0.0);  // no -0, which would be written as an integer
      if (!std::isfinite(read.back())) refuse_value(option, part, source, "it is not a finite number");
    }
    **numbers = std::move(read);
  } else {
    set_number(option, parse_quantity(option, text, source), text, source);
  }
}

Option* find_option(std::vector<Option>& options, const std::string& key) {
  for (Option& option : options)
    if (option.key == key || without_unit(option) == key) return &option;
  return nullptr;
}

[[noreturn]] void refuse_key(std::vector<Option>& options, const std::string& key, const std::string& source,
                             std::vector<std::string> known) {
  for (const Option& option : options) known.push_back(option.key);
  for (const Option& option : options) known.push_back(without_unit(option));
  // Synonyms that are not similar in spelling.
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
    const std::string s = fmt::format("{}", **real);  // shortest text with the same bits
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

}  // namespace dimple
