#pragma once

#include <chrono>

namespace dimple {

/// Wall time since construction, plus `before` [s].
class Stopwatch {
 public:
  Stopwatch() = default;
  explicit Stopwatch(double before)
      : start_(std::chrono::steady_clock::now() -
               std::chrono::duration_cast<std::chrono::steady_clock::duration>(
                   std::chrono::duration<double>(before))) {}
  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace dimple
