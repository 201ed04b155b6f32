// Time of each stage on a block of 60 x 60 x 30 mm. A plain reference of the force and the limits of the
// processor are measured for comparison.
//
//   dimple_bench                                     five repetitions of all
//   dimple_bench --benchmark_filter=force/           some
//   dimple_bench --results=tests/bench/results --version=$(git describe --always --dirty)
//
// All options of Google Benchmark are accepted.

#include <fmt/format.h>

#include <cstring>
#include <vector>

#include "io/error.hpp"
#include "tests/bench/bench.hpp"
#include "tests/bench/scene.hpp"

int main(int count, char** argument) {
  std::string folder, version = "unknown";
  static char defaults[][48] = {"--benchmark_repetitions=5", "--benchmark_report_aggregates_only=true",
                                "--benchmark_min_time=0.1"};
  std::vector<char*> remaining = {argument[0], defaults[0], defaults[1], defaults[2]};
  for (int k = 1; k < count; ++k) {
    const std::string text = argument[k];
    if (text.rfind("--results=", 0) == 0)
      folder = text.substr(std::strlen("--results="));
    else if (text.rfind("--version=", 0) == 0)
      version = text.substr(std::strlen("--version="));
    else
      remaining.push_back(argument[k]);
  }
  int remaining_count = static_cast<int>(remaining.size());
  benchmark::Initialize(&remaining_count, remaining.data());
  if (benchmark::ReportUnrecognizedArguments(remaining_count, remaining.data())) return 2;
  try {
    dimple::scene("converging", 4250);  // compares the product's force with the reference's
    dimple::register_roofs();
    dimple::register_forces();
    dimple::register_stages();
    dimple::Results results;
    benchmark::RunSpecifiedBenchmarks(&results);
    if (!folder.empty()) fmt::print("results: {}\n", results.write(folder, version, dimple::scene_facts()));
  } catch (const dimple::Error& error) {
    fmt::print(stderr, "error: {}\n", error.what());
    return 1;
  }
}
