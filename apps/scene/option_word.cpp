#include "apps/scene/option_word.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "apps/scene/config.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/surface_mesh.hpp"
#include "io/text.hpp"
#include "preprocess/scene/sides.hpp"

namespace dimple {
namespace {

// Form as text: "punch:radius,edge=..."
std::string pattern_of(const WordForm& form) {
  std::vector<std::string> parts;
  if (!form.names.empty()) parts.push_back(form.names);
  for (const WordNumber& number : form.numbers) parts.push_back(number.name);
  for (const WordNumber& key : form.keys)
    parts.push_back(key.usual ? fmt::format("[{}=...]", key.name) : key.name + "=...");
  const std::string joined = fmt::format("{}", fmt::join(parts, std::string(1, form.between)));
  return form.kind.empty() || parts.empty() ? form.kind + joined : form.kind + form.after_kind + joined;
}

bool begins_a_number(const std::string& text) {
  return text.find_first_of("+-.0123456789") == 0;
}

std::string kind_in(const std::string& text, const WordForm& form) {
  return std::string(trimmed(text.substr(0, text.find(form.after_kind))));
}

bool fits(const WordForm& form, const OptionWord& word) {
  if (!form.kind.empty()) return kind_in(word.text, form) == form.kind;
  const std::string first(trimmed(word.text.substr(0, word.text.find(form.between))));
  if (form.is_side && side_named(first, word.where)) return true;
  return form.numbers.size() > 0 && begins_a_number(first);
}

double number_of(const OptionWord& word, const WordForm& form, const WordNumber& number,
                 const std::string& text) {
  double value = 0.0;
  if (number.needs_unit && !text.ends_with(number.unit))
    refuse_word(word, fmt::format("has '{}' for its {}", text, number.name),
                fmt::format("it is given in {}", number.unit));
  set_value({.key = fmt::format("{}: {}", word.subject, number.name),
             .unit = number.unit,
             .value = &value,
             .least = number.least,
             .most = number.most,
             .least_excluded = number.least_excluded,
             .help = pattern_of(form)},
            text, word.where);
  return number.scale * value + 0.0;  // no -0
}

// Checks bounds that depend on the first number.
void check_against_first(const OptionWord& word, const WordForm& form, const WordNumber& number,
                         double value) {
  constexpr double rounding = 1e-9;
  const double first = word.number.front(), least = number.least_of_first * first,
               most = number.most_of_first * first;
  if (value >= least * (1.0 - rounding) && value <= most * (1.0 + rounding)) return;
  const auto shown = [&](double x) { return plain(x / number.scale) + number.unit; };
  refuse_word(word, fmt::format("has {}={}", number.name, shown(value)),
              fmt::format("with a {} of {} it is {}", form.numbers.front().name, shown(first),
                          std::isfinite(most) ? fmt::format("{} to {}", shown(least), shown(most))
                                              : shown(least) + " or more"));
}

void read_keys(OptionWord& word, const WordForm& form, const std::vector<std::string>& given) {
  std::vector<std::optional<double>> value(form.keys.size());
  for (const std::string& part : given) {
    const std::size_t equals = part.find('=');
    const std::string name(trimmed(part.substr(0, equals)));
    const auto key = std::find_if(form.keys.begin(), form.keys.end(),
                                  [&](const WordNumber& one) { return one.name == name; });
    if (key == form.keys.end())
      refuse_word(word, fmt::format("does not take '{}'", name),
                  fmt::format("it is written as {}", pattern_of(form)));
    auto& its = value[static_cast<std::size_t>(key - form.keys.begin())];
    if (its) refuse_word(word, fmt::format("has two values of {}", name), "it has one");
    its = number_of(word, form, *key, std::string(trimmed(part.substr(equals + 1))));
    if (key->least_of_first > 0.0) check_against_first(word, form, *key, *its);
  }
  for (std::size_t k = 0; k < value.size(); ++k) {
    if (!value[k] && !form.keys[k].usual)
      refuse_word(word, fmt::format("has no {}", form.keys[k].name),
                  fmt::format("it is written as {}", pattern_of(form)));
    word.number.push_back(value[k] ? *value[k] : *form.keys[k].usual);
  }
}

void read_numbers(OptionWord& word, const WordForm& form, std::vector<std::string> parts) {
  const auto of_keys = std::stable_partition(parts.begin(), parts.end(), [](const std::string& part) {
    return part.find('=') == std::string::npos;
  });
  const std::vector<std::string> given(of_keys, parts.end());
  parts.erase(of_keys, parts.end());
  if (form.is_side && !parts.empty())
    if (const auto side = side_named(parts.front(), word.where)) {
      word.is_side = true;
      word.number.assign(side->begin(), side->end());
      parts.erase(parts.begin());
    }
  const std::size_t before = word.number.size();
  if (parts.size() + before != std::max(form.numbers.size(), before))
    refuse_word(word,
                parts.empty() ? "has no number"
                              : fmt::format("has {} number{}", parts.size(), parts.size() > 1 ? "s" : ""),
                fmt::format("it is written as {}", pattern_of(form)));
  for (std::size_t k = before; k < form.numbers.size(); ++k)
    word.number.push_back(number_of(word, form, form.numbers[k], parts[k - before]));
  read_keys(word, form, given);
}

}  // namespace

std::vector<std::string> parts_between(const std::string& text, char separator) {
  std::vector<std::string> parts;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(separator, begin), text.size());
    if (std::string part(trimmed(text.substr(begin, end - begin))); !part.empty())
      parts.push_back(std::move(part));
    begin = end + 1;
  }
  return parts;
}

void refuse_word(const OptionWord& word, const std::string& fact, const std::string& why,
                 const std::string& remedy) {
  throw UsageError({.fact = fmt::format("{} {}", word.subject, fact),
                    .where = word.where,
                    .why = why,
                    .remedy = remedy.empty() ? word.remedy : remedy});
}

OptionWord parse_word(const WordTable& table, const std::string& text, const std::string& where,
                      const std::string& of) {
  std::vector<std::string> examples, patterns;
  for (const WordForm& form : table.forms) {
    patterns.push_back(pattern_of(form));
    examples.push_back(form.example.empty() ? patterns.back() : form.example);
  }
  const std::string why_unknown =
      table.unknown.empty() ? fmt::format("it is given as {}", fmt::join(patterns, " or ")) : table.unknown;
  if (table.is_file) examples.emplace_back("a file such as drawn.stl");
  const std::string t(trimmed(text));
  OptionWord word{.text = t,
                  .where = where,
                  .subject = fmt::format("{} '{}'{}{}", table.what, t, of.empty() ? "" : " of ", of),
                  .remedy = fmt::format("give {}", fmt::join(examples, ", or "))};
  if (table.is_file && is_surface_file(t)) {
    word.kind = "file";
    word.name = {t};
    return word;
  }
  const auto form = std::find_if(table.forms.begin(), table.forms.end(),
                                 [&](const WordForm& one) { return fits(one, word); });
  if (form == table.forms.end()) refuse_word(word, "is not known", why_unknown);
  word.kind = form->kind;
  const std::size_t end = form->kind.empty() ? std::string::npos : t.find(form->after_kind);
  const std::string joined = form->kind.empty() ? t : end == std::string::npos ? "" : t.substr(end + 1);
  std::vector<std::string> parts = parts_between(joined, form->between);
  if (form->names.empty()) {
    read_numbers(word, *form, std::move(parts));
  } else {
    if (parts.empty()) refuse_word(word, fmt::format("names no {}", form->kind), why_unknown);
    word.name = std::move(parts);
  }
  return word;
}

WordNumber length_number(const std::string& name, double scale, double most_mm) {
  return {name, "mm", scale, 0.0, most_mm, true};
}

std::vector<WordNumber> place_numbers(double scale) {
  constexpr double far_mm = 1e6;
  return {{"x", "mm", scale, -far_mm, far_mm},
          {"y", "mm", scale, -far_mm, far_mm},
          {"z", "mm", scale, -far_mm, far_mm}};
}

std::vector<WordNumber> ball_numbers() {
  return joined(place_numbers(), {length_number("radius", 1.0, 1e6)});
}

std::vector<WordNumber> direction_numbers() {
  return {{"nx"}, {"ny"}, {"nz"}};
}

std::vector<WordNumber> joined(std::vector<WordNumber> first, const std::vector<WordNumber>& then) {
  first.insert(first.end(), then.begin(), then.end());
  return first;
}

}  // namespace dimple
