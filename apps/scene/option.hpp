#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <variant>
#include <vector>

namespace dimple {

/// Value of an option.
using OptionValue =
    std::variant<double, std::int64_t, std::string, std::vector<std::string>, std::vector<double>>;

/// Option, declared once: the help, the checks, the file format and `--set` follow from it.
struct Option {
  std::string key;        ///< "material.mu_Pa": section, name, unit
  std::string flag = {};  ///< "--mu" or empty
  std::string unit = {};  ///< "Pa" or empty; unit of bare numbers
  std::variant<double*, std::int64_t*, std::string*, std::vector<std::string>*, std::vector<double>*> value;
  double least = 0.0, most = 0.0;  ///< range of numbers, both allowed
  bool least_excluded = false;
  std::vector<std::string> choices = {};  ///< of a word, or of each word of a list, which is not empty;
                                          ///< empty: free text
  std::string stage = {};  ///< commands that have the flag: "model", "solve" (run has both), "run" (only
                           ///< run), "files" (run and solve)
  bool common = false;     ///< listed by `--help`; `--help-all` lists all
  std::vector<std::string> words = {};  ///< suggested values of free text; others are allowed
  std::string help = {};
};

/// All options of a run except those of named sections, with their defaults.
const std::vector<Option>& usual_options();

/// Key without its unit: "material.mu" for "material.mu_Pa".
std::string without_unit(const Option& option);

/// Sets an option from text: "300Pa", "superior", "1,Tumour". Throws UsageError: not a number, unknown unit,
/// out of range, not a choice. `source`: file and line, flag or keyword.
void set_value(const Option& option, const std::string& text, const std::string& source);
/// Sets a number; `text` is its form in messages.
void set_number(const Option& option, double value, const std::string& text, const std::string& source);
/// Throws UsageError that names the allowed values.
[[noreturn]] void refuse_value(const Option& option, const std::string& text, const std::string& source,
                               const std::string& why);

/// Option of a key with or without its unit; null: there is none.
Option* find_option(std::vector<Option>& options, const std::string& key);
/// Throws UsageError: there is no such key. Suggests one of the options or of `known`.
[[noreturn]] void refuse_key(std::vector<Option>& options, const std::string& key, const std::string& source,
                             std::vector<std::string> known = {});

/// Value in the syntax of a file of options.
std::string toml_value(const Option& option);

/// Position in mm: "10,20,30" for "1cm,2cm,30mm". Parts that are no lengths are unchanged.
std::string place_in_mm(const std::string& text);

/// True if the source is a flag of the command line or a keyword of Python: "--mu", "mu_Pa=".
bool is_of_caller(const std::string& source);

/// Suggestion ", did you mean ...?" of the closest word among `known`; empty if none is similar.
std::string did_you_mean(const std::string& word, const std::vector<std::string>& known);

}  // namespace dimple
