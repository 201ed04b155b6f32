#pragma once

#include <map>
#include <string>

namespace dimple {

/// Options that one file or one command line has set; it refuses a second value.
class GivenOnce {
 public:
  /// Adds an option. `key`: with or without its unit. Throws UsageError: it was set before, to another text,
  /// or does not exist.
  void add(const std::string& key, const std::string& text, const std::string& source);

 private:
  struct Given {
    std::string key, text, source;
  };
  std::map<std::string, Given> of_option_;
};

}  // namespace dimple
