#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "apps/scene/option.hpp"

namespace dimple {

struct Config;

/// Options of a run as they were given, each with its source. Only this folder reads their texts and numbers
/// (config.hpp); other folders use the scene that resolve() makes of them.
struct Description {
  Description();  ///< all options have their defaults
  Description(const Description& other);
  Description& operator=(const Description& other);
  ~Description();
  std::unique_ptr<Config> options;  ///< never null
};

/// Sets one option from text ("300Pa", "superior", "1,Tumour"). `key` with or without its unit suffix.
/// Throws UsageError: unknown key (with a suggestion), not a number, unknown unit, out of range, not a
/// choice.
void set_option(Description& description, const std::string& key, const std::string& text,
                const std::string& source);
/// Replaces the numbers of an option by computed ones, in its unit, without a check of their range. An empty
/// `source` keeps the option's source.
void put_numbers(Description& description, const std::string& key, const std::vector<double>& numbers,
                 const std::string& source = {});
/// Sets the options in a TOML file; others keep their values. Throws UsageError, InputError.
void read_config(Description& description, const std::filesystem::path& file);

/// Completes the options once all are set: a preset's numbers replace defaults, Young's modulus becomes the
/// shear modulus E / (2 (1 + nu)). Ogden moduli are scaled to a shear modulus from a source of higher rank;
/// otherwise it is their sum. The depth of a scene of steps follows from them. Throws UsageError: two given
/// options contradict each other.
void complete(Description& description);
/// Completes options of all cases of a table; each case may override them. Throws as complete() does.
void complete_for_all_cases(Description& description);

/// File of the label image; empty if none was given.
std::string image_file(const Description& description);
/// Value of the option of that key, with or without its unit suffix. Precondition: not of a named section.
OptionValue value_of(const Description& description, const std::string& key);
/// Source of an option ("config.toml, line 3", "--nodes", "nodes=" of Python); empty: not given.
std::string source_of(const Description& description, const std::string& key);
/// True if the user chose the option of that key; false if a file of all options states its default.
bool was_given(const Description& description, const std::string& key);
/// True if the number of nodes is the default: neither it nor a spacing was given.
bool default_nodes(const Description& description);

/// All options as TOML, each with the source of its value. `notes`: key -> value chosen by the run.
std::string to_toml(const Description& description, const std::map<std::string, std::string>& notes);
/// Value of each option in that file, by key, without the path of the image.
std::map<std::string, std::string> option_values(const Description& description);
/// Options in such a file, by key. Throws UsageError, InputError.
std::map<std::string, std::string> option_values_in(const std::filesystem::path& file);

/// Key of an option, from the head of a column: its key, with or without section and unit ("material.mu_Pa",
/// "mu"), or its flag ("indent-at", "indent_at"). Throws UsageError with a suggestion, also from `others`:
/// there is none.
std::string option_named(const std::string& name, const std::string& source,
                         const std::vector<std::string>& others);

/// Reference of all options: key, unit, default, range, meaning.
std::string option_reference();

}  // namespace dimple
