#pragma once

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>
#include <vector>

namespace dimple {

/// Wall time of the stages of making a model, in the order in which they came.
class StageTimes {
 public:
  /// Ends the stage of this name: the time since the last call, or since construction, is its own.
  void done(const std::string& name) {
    const auto now = Clock::now();
    add(name, std::chrono::duration<double>(now - last_).count());
    last_ = now;
  }
  void add(const std::string& name, double s) {
    const auto same =
        std::find_if(seconds_.begin(), seconds_.end(), [&](const auto& e) { return e.first == name; });
    if (same == seconds_.end())
      seconds_.emplace_back(name, s);
    else
      same->second += s;
  }
  void add(const StageTimes& other) {
    for (const auto& [name, s] : other.seconds_) add(name, s);
  }
  const std::vector<std::pair<std::string, double>>& seconds() const { return seconds_; }
  /// Time of one stage [s]; for an empty name, of all.
  double seconds(const std::string& of) const {
    double sum = 0.0;
    for (const auto& [name, s] : seconds_)
      if (of.empty() || name == of) sum += s;
    return sum;
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point last_ = Clock::now();
  std::vector<std::pair<std::string, double>> seconds_;
};

}  // namespace dimple
