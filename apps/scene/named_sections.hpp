#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "apps/scene/config.hpp"

namespace dimple {

/// Kind of section whose members are named by the user: [load.pressure.NAME].
struct NamedSection {
  std::string_view section;  ///< "load.pressure"; messages call a member by the last part
  std::string_view example;  ///< option of a member, as --set accepts it
  /// Options of a member, with keys from the last part of the section on: "pressure.on". Adds a member that
  /// is missing.
  std::function<std::vector<Option>(Config& config, const std::string& name)> options_of;
  std::function<std::vector<std::string>(const Config& config)> names;  ///< in the order of a file of options
};

/// All named sections, in the order of a file of options. A new kind of section is one more row.
const std::vector<NamedSection>& named_sections();

/// True if `section` is one of them: "load.pressure".
bool is_named_section(std::string_view section);

/// Option of a member by its complete key, with or without its unit; adds a member that is missing. Nothing:
/// the key is of no named section. Throws UsageError: the section has no such option.
std::optional<Option> named_option(Config& config, const std::string& key, const std::string& source);

/// Options of all members, with their complete keys.
std::vector<std::pair<std::string, Option>> named_options(Config& config);

}  // namespace dimple
