#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "apps/scene/config.hpp"

namespace dimple {

/// Kind of section whose members have names that a user gives: [load.pressure.NAME].
struct NamedSection {
  std::string_view section;  ///< "load.pressure"; its last part is what a message calls a member
  std::string_view example;  ///< an option of a member, as --set takes it
  /// Options of the member of a name, with keys from the last part of the section on: "pressure.on". A member
  /// that is not there yet is made.
  std::function<std::vector<Option>(Config& config, const std::string& name)> options_of;
  std::function<std::vector<std::string>(const Config& config)> names;  ///< in the order of a file of options
};

/// All of them, in the order of a file of options. A new kind of section is one more row.
const std::vector<NamedSection>& named_sections();

/// True if one of them has this name: "load.pressure".
bool is_named_section(std::string_view section);

/// The option of a member by its whole key, with or without its unit; the member need not be there yet.
/// Nothing: the key is of no named section. Throws UsageError: the section has no such option.
std::optional<Option> named_option(Config& config, const std::string& key, const std::string& source);

/// Each option of each member by its whole key.
std::vector<std::pair<std::string, Option>> named_options(Config& config);

}  // namespace dimple
