#pragma once

#include <map>
#include <string>

namespace dimple {

/// What one file or one command line has set, so that no option gets two values.
class GivenOnce {
 public:
  /// `key`: with its unit or without. Throws UsageError: its option was set before, to another text; or there
  /// is no such option.
  void add(const std::string& key, const std::string& text, const std::string& source);

 private:
  struct Given {
    std::string key, text, source;
  };
  std::map<std::string, Given> of_option_;
};

}  // namespace dimple
