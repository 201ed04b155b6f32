#include <fmt/format.h>

#include <algorithm>
#include <new>
#include <vector>

#include "tests/bench/bench.hpp"
#include "tests/bench/roofs.hpp"

namespace dimple {
namespace {

// Each thread reads memory of its own.
void read_memory(benchmark::State& state, std::size_t bytes) {
  const std::size_t count = bytes / 512 * 64;
  auto* numbers =
      static_cast<std::int64_t*>(::operator new(count * sizeof(std::int64_t), std::align_val_t(64)));
  for (std::size_t k = 0; k < count; ++k) numbers[k] = static_cast<std::int64_t>(k);
  for (auto _ : state) benchmark::DoNotOptimize(read_all({numbers, count}));
  state.SetBytesProcessed(state.iterations() * static_cast<std::int64_t>(count * sizeof(std::int64_t)));
  ::operator delete(numbers, std::align_val_t(64));
}

void compute(benchmark::State& state, double (*operations)(std::int64_t)) {
  double done = 0.0;
  for (auto _ : state) done += operations(100'000);
  state.counters["FLOPS"] = benchmark::Counter(done, benchmark::Counter::kIsRate);
}

std::size_t cache(int level, std::size_t otherwise) {
  for (const auto& c : benchmark::CPUInfo::Get().caches)
    if (c.level == level && c.type != "Instruction") return static_cast<std::size_t>(c.size);
  return otherwise;
}

}  // namespace

std::vector<Memory> memories() {
  const std::size_t L2 = cache(2, 1 << 20), L3 = cache(3, 8 << 20);
  return {{"L2", L2 / 2, true},
          {"L3", std::min(4 * L2, L3 / 2), false},
          {"quarter_L3", L3 / 4, false},  // a virtual machine may have less of it than it reports
          {"half_L3", L3 / 2, false},
          {"DRAM", 4 * L3, false}};
}

void register_roofs() {
  const struct {
    const char* name;
    double (*operations)(std::int64_t);
  } units[] = {{"multiply_add_single", &multiply_add_single},
               {"multiply_add_double", &multiply_add_double},
               {"multiply_then_add_single", &multiply_then_add_single},
               {"multiply_then_add_double", &multiply_then_add_double}};
  for (const int threads : {1, 2}) {
    for (const Memory& m : memories()) {
      const std::size_t each = m.each_thread ? m.bytes : m.bytes / static_cast<std::size_t>(threads);
      benchmark::RegisterBenchmark(fmt::format("roof/read_{}/{}", m.name, threads_word(threads)).c_str(),
                                   &read_memory, each)
          ->Threads(threads)
          ->UseRealTime()
          ->Unit(benchmark::kMicrosecond);
    }
    for (const auto& u : units)
      benchmark::RegisterBenchmark(fmt::format("roof/{}/{}", u.name, threads_word(threads)).c_str(), &compute,
                                   u.operations)
          ->Threads(threads)
          ->UseRealTime()
          ->Unit(benchmark::kMicrosecond);
  }
}

}  // namespace dimple
