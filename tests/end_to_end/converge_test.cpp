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
  // Coarse clouds against the verification block's reference, known to 1 %: hundreds of nodes are a few per
  // cent off.
  for (std::size_t k = 0; k < table.rows(); ++k) {
    const double known = (*table.find("reference_N"))[k];
    EXPECT_NEAR((*table.find("force_N"))[k], known, 0.15 * known);
  }
  for (const char* name : {"convergence.md", "convergence.png", "convergence.svg"})
    EXPECT_GT(fs::file_size(folder / "out" / name), 100u) << name;
  EXPECT_EQ(dimple(folder, command + " -q").code, 0) << "a second time";
}

// A run in time has a sample for each hundredth of a second and not for each depth.
TEST(Converge, ComparesRunsInTimeAtTheirDepths) {
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3").code, 0);
  std::ofstream(folder / "known.csv") << "indentation_mm,force_N\n0.5,0.0049\n1,0.0098\n";
  const Ran ran =
      dimple(folder,
             "converge block.nrrd -o out --sizes 300,600 --densities 1 --seeds 1 --depth 1mm --rate 10mm/s "
             "--frames 2 --scheme horton2007 --reference known.csv");
  ASSERT_EQ(ran.code, 0) << ran.err;
  const Table table = read_csv(folder / "out" / "convergence.csv");
  const auto &depth = *table.find("indentation_mm"), &force = *table.find("force_N");
  ASSERT_EQ(table.rows(), 4u);
  for (std::size_t k = 0; k < table.rows(); k += 2) {
    EXPECT_EQ(depth[k], 0.5);
    EXPECT_NEAR(force[k], 0.5 * force[k + 1], 0.1 * force[k + 1]);
  }
}

TEST(Converge, RefusesAComparisonOfOneSize) {
  const fs::path folder = fresh_folder();
  const Ran ran = dimple(folder, "converge block.nrrd -o out --sizes 300");
  EXPECT_EQ(ran.code, 2);
  EXPECT_NE(ran.err.find("at least two cloud sizes"), std::string::npos) << ran.err;
}

}  // namespace
}  // namespace dimple
