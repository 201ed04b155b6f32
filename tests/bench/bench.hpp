#pragma once

#include <benchmark/benchmark.h>

#include <string>
#include <vector>

namespace dimple {

/// Functions that register benchmarks; names are kind/what/size/threads.
void register_roofs();
void register_forces();
void register_stages();

/// Sizes that roof/read_* reads: of all threads together, or of each.
struct Memory {
  const char* name;
  std::size_t bytes;
  bool each_thread;
};
std::vector<Memory> memories();

/// "1_thread", "2_threads".
inline std::string threads_word(int count) {
  return std::to_string(count) + (count == 1 ? "_thread" : "_threads");
}

/// Medians and their spread, printed as they are measured and written as CSV at the end.
class Results : public benchmark::ConsoleReporter {
 public:
  Results();
  bool ReportContext(const Context& context) override;
  void ReportRuns(const std::vector<Run>& runs) override;
  /// Writes folder/<name of the processor>.csv and returns its path. The header has the program's `version`
  /// and `facts`, lines that begin with #.
  std::string write(const std::string& folder, const std::string& version, const std::string& facts) const;

 private:
  struct Line {
    std::string name;
    double time_us = 0.0, spread = 0.0, bytes_per_second = 0.0, flops = 0.0;
  };
  std::vector<Line> lines_;
  Line& line(const std::string& name);
};

}  // namespace dimple
