#pragma once

#include <span>
#include <string_view>

namespace dimple {

/// A reader of the product, given the bytes of a file. It returns if they are read into something valid or
/// refused with a message. Anything else (a crash, another exception, an inconsistent result) is a finding.
struct FuzzTarget {
  std::string_view name;
  void (*run)(std::string_view bytes);
};

std::span<const FuzzTarget> fuzz_targets();

}  // namespace dimple
