// `dimple converge` through the real program.

#include <gtest/gtest.h>

#include <fstream>

#include "io/table.hpp"
#include "tests/end_to_end/program.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

TEST(Converge, ComparesCloudsOfSeveralSizesDensitiesAndSeeds) {
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3").code, 0);
  std::ofstream(folder / "known.csv") << "indentation_mm,force_N\n0.5,0.0049\n1,0.0098\n";
  const std::string command =
      "converge block.nrrd -o out --sizes 300,600 --seeds 2 --depth 1mm --frames 2 --reference known.csv";
  const Ran ran = dimple(folder, command);
  ASSERT_EQ(ran.code, 0) << ran.err;
  EXPECT_NE(ran.out.find("difference from the reference"), std::string::npos) << ran.out;
  const Table table = read_csv(folder / "out" / "convergence.csv");
  EXPECT_EQ(table.rows(), 2u * 2u * 2u * 2u);  // sizes, densities, seeds, depths
  for (const double force : *table.find("force_N")) EXPECT_GT(force, 0.004);
  for (const char* name : {"convergence.md", "convergence.png", "convergence.svg"})
    EXPECT_GT(fs::file_size(folder / "out" / name), 100u) << name;
  EXPECT_EQ(dimple(folder, command + " -q").code, 0) << "a second time";
}

TEST(Converge, RefusesAComparisonOfOneSize) {
  const fs::path folder = fresh_folder();
  const Ran ran = dimple(folder, "converge block.nrrd -o out --sizes 300");
  EXPECT_EQ(ran.code, 2);
  EXPECT_NE(ran.err.find("at least two cloud sizes"), std::string::npos) << ran.err;
}

}  // namespace
}  // namespace dimple
