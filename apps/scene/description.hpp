#pragma once

#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "apps/scene/option.hpp"

namespace dimple {

struct Config;

/// Options of a run as they were given, each with where it was. Their words and numbers are read in this
/// folder alone (config.hpp); all else asks for the scene that they describe: resolve().
struct Description {
  Description();  ///< all options have their usual values
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
/// Puts numbers that were computed in place of those of an option, in its unit, without a check of their
/// range. An empty `source` leaves the option the one it has.
void put_numbers(Description& description, const std::string& key, const std::vector<double>& numbers,
                 const std::string& source = {});
/// Reads a TOML file over what is there. Throws UsageError, InputError.
void read_config(Description& description, const std::filesystem::path& file);

/// Completes the options once all are set: numbers that follow from others are put in their place. A preset's
/// numbers stand where nobody has given others; Young's modulus becomes the shear modulus E / (2 (1 + nu)).
/// Ogden moduli are scaled to a shear modulus that was given beside a preset's, and else add up to it. The
/// depth of a scene of steps follows from them. Throws UsageError: two of these were given that contradict
/// each other.
void complete(Description& description);
/// Completes options of all cases of a table, each of which may say otherwise. Throws as complete() does.
void complete_for_all_cases(Description& description);

/// File of the label image; empty if none was given.
std::string image_file(const Description& description);
/// Value of the option of that key, with or without its unit suffix. Needs: an option of no named section.
OptionValue value_of(const Description& description, const std::string& key);
/// Where an option was given ("config.toml, line 3", "--nodes", "nodes=" of Python); empty: nowhere.
std::string source_of(const Description& description, const std::string& key);
/// Whether anybody has chosen the option of that key: not where a file of all options states what is usual.
bool was_given(const Description& description, const std::string& key);
/// Whether the number of nodes is the usual one: neither it nor a spacing was given.
bool default_nodes(const Description& description);

/// All options as TOML, each line with where its value came from. `notes`: key -> what was chosen.
std::string to_toml(const Description& description, const std::map<std::string, std::string>& notes);
/// Each option as it stands in that file, by key, but for the path of the image.
std::map<std::string, std::string> option_values(const Description& description);
/// The same of such a file. Throws UsageError, InputError.
std::map<std::string, std::string> option_values_in(const std::filesystem::path& file);

/// The key of the option that somebody calls `name`, as the head of a column: its key, with or without
/// section and unit ("material.mu_Pa", "mu"), or its flag ("indent-at", "indent_at"). Throws UsageError:
/// there is none, with a suggestion from these names and from `others`.
std::string option_named(const std::string& name, const std::string& source,
                         const std::vector<std::string>& others);

/// The reference of all options: key, unit, default, range, meaning.
std::string option_reference();

}  // namespace dimple
