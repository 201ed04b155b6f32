#pragma once

#include <map>
#include <string>

#include "apps/scene/resolve.hpp"

namespace dimple {

/// Texts of options by key.
using OptionTexts = std::map<std::string, std::string>;

/// Scene with these options; all others have their usual values.
inline Scene scene_with(const OptionTexts& options) {
  Description description;
  for (const auto& [key, text] : options) set_option(description, key, text, "test");
  return resolve(description);
}

}  // namespace dimple
