// libFuzzer's entry: the target that the environment variable DIMPLE_FUZZ_TARGET names.

#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include "tests/fuzz/targets.hpp"

namespace {

const dimple::FuzzTarget* target = nullptr;

}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  const char* name = std::getenv("DIMPLE_FUZZ_TARGET");
  for (const auto& known : dimple::fuzz_targets())
    if (name && known.name == name) target = &known;
  if (target) return 0;
  std::fprintf(stderr, "set DIMPLE_FUZZ_TARGET to one of:");
  for (const auto& known : dimple::fuzz_targets())
    std::fprintf(stderr, " %.*s", static_cast<int>(known.name.size()), known.name.data());
  std::fprintf(stderr, "\n");
  std::exit(2);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  target->run({reinterpret_cast<const char*>(data), size});
  return 0;
}
