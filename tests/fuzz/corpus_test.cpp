// Runs the kept inputs through the fuzzers' entry points, without clang or sanitizers.

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

#include "tests/fuzz/targets.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

class Readers : public testing::TestWithParam<FuzzTarget> {};

TEST_P(Readers, ReadOrRefuseEveryKeptInput) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(fs::path(DIMPLE_FUZZ_CORPUS) / GetParam().name))
    files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  EXPECT_GE(files.size(), 5u);
  for (const fs::path& file : files) {
    SCOPED_TRACE(file);
    std::ifstream in(file, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(in), {}};
    EXPECT_NO_THROW(GetParam().run(bytes));
  }
}

INSTANTIATE_TEST_SUITE_P(All, Readers, testing::ValuesIn(fuzz_targets().begin(), fuzz_targets().end()),
                         [](const auto& target) { return std::string(target.param.name); });

}  // namespace
}  // namespace dimple
