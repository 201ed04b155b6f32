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

/// One option, declared once: the help, the checks, the file format and `--set` are all made from it.
struct Option {
  std::string key;        ///< "material.mu_Pa": section, name, unit
  std::string flag = {};  ///< "--mu" or empty
  std::string unit = {};  ///< "Pa" or empty; bare numbers are in it
  std::variant<double*, std::int64_t*, std::string*, std::vector<std::string>*, std::vector<double>*> value;
  double least = 0.0, most = 0.0;  ///< range of numbers, both allowed
  bool least_excluded = false;
  std::vector<std::string> choices = {};  ///< of a word, or of each of a list, which then names one at least;
                                          ///< empty: free text
  std::string stage = {};  ///< which commands have the flag: "model", "solve" (run has both), "run" (that
                           ///< alone), "files" (run and solve)
  bool common = false;     ///< of those that `--help` lists; `--help-all` lists all
  std::vector<std::string> words = {};  ///< of free text, those that it is most often: offered, not demanded
  std::string help = {};
};

/// All options of a run but those of named sections, with their usual values.
const std::vector<Option>& usual_options();

/// "material.mu" of "material.mu_Pa"; a key without its unit at the end stays.
std::string without_unit(const Option& option);

/// Gives an option the value of a text: "300Pa", "superior", "1,Tumour". Throws UsageError: not a number,
/// unknown unit, out of range, not a choice. `source`: where it stands.
void set_value(const Option& option, const std::string& text, const std::string& source);
/// The same of a number, which `text` shows.
void set_number(const Option& option, double value, const std::string& text, const std::string& source);
/// Throws UsageError: what is allowed instead of the text.
[[noreturn]] void refuse_value(const Option& option, const std::string& text, const std::string& source,
                               const std::string& why);

/// Option of a key with or without its unit; null: there is none.
Option* find_option(std::vector<Option>& options, const std::string& key);
/// Throws UsageError: there is no such key, with a suggestion from those of the options and from `known`.
[[noreturn]] void refuse_key(std::vector<Option>& options, const std::string& key, const std::string& source,
                             std::vector<std::string> known = {});

/// Value as it stands in a file of options.
std::string toml_value(const Option& option);

/// "1cm,2cm,30mm" -> "10,20,30": a place is kept in mm. Parts that are no lengths stay as they are.
std::string place_in_mm(const std::string& text);

/// Whether it was a flag of the command line, or a keyword of Python: "--mu", "mu_Pa=".
bool is_of_caller(const std::string& source);

/// The word among `known` nearest to `word`, if it is near enough to have been meant, as ", did you mean
/// ...?".
std::string did_you_mean(const std::string& word, const std::vector<std::string>& known);

}  // namespace dimple
