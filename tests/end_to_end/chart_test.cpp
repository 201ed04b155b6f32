// `dimple export` and `dimple chart` through the real program.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "io/element_files.hpp"
#include "io/file.hpp"
#include "tests/end_to_end/program.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using testing::ContainsRegex;
using testing::HasSubstr;
using testing::Not;

TEST(Export, WritesTheSameSceneForBothPrograms) {
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3").code, 0);
  const std::string scene = " --nodes 500 --frames 2 --depth 1mm --indent-at 0,0,top --base inferior";
  const Ran inp = dimple(folder, "export block.nrrd -o block.inp" + scene);
  ASSERT_EQ(inp.code, 0) << inp.err;
  ASSERT_EQ(dimple(folder, "export block.nrrd -o again.feb --format febio" + scene).code, 0);
  const std::string text = text_of(folder / "block.inp");
  EXPECT_THAT(text, HasSubstr("block.nrrd, indented by 1 mm (bonded)"));
  EXPECT_THAT(text, HasSubstr("circle, 3, 3, -1\n"));
  EXPECT_THAT(text_of(folder / "again.feb"), HasSubstr("<value lc=\"1\">-1</value>"));
}

TEST(Export, CalculixGivesTheForceOfTissueThatDoesNotLock) {
  if (std::system("command -v ccx > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "CalculiX is not installed (Debian: calculix-ccx)";
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3").code, 0);
  const std::string scene =
      "export block.nrrd -o block.inp --nodes 2000 --frames 2 --depth 1mm --indent-at 0,0,top --base "
      "inferior "
      "--elements tetrahedra";
  // At nu 0.3 ten-node tetrahedra do not lock; hexahedra: 0.00721 N at 1 mm, tests/verification/reference.
  ASSERT_EQ(dimple(folder, scene + " --nu 0.3").code, 0);
  ASSERT_EQ(std::system(("cd '" + folder.string() + "' && ccx block > words.txt 2>&1").c_str()), 0);
  const auto forces = calculix_forces(read_file(folder / "block.dat"), -Vec3::UnitZ());
  ASSERT_EQ(forces.size(), 2u);
  EXPECT_NEAR(forces[1], 0.00721, 0.0008);
  EXPECT_NEAR(forces[0], 0.5 * forces[1], 0.0003);
}

TEST(Export, CalculixsHexahedraDoNotLock) {
  if (std::system("command -v ccx > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "CalculiX is not installed (Debian: calculix-ccx)";
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3").code, 0);
  ASSERT_EQ(dimple(folder,
                   "export block.nrrd -o block.inp --nodes 1000 --frames 1 --depth 1mm --indent-at 0,0,top "
                   "--base inferior")
                .code,
            0);
  ASSERT_EQ(std::system(("cd '" + folder.string() + "' && ccx block > words.txt 2>&1").c_str()), 0);
  const auto forces = calculix_forces(read_file(folder / "block.dat"), -Vec3::UnitZ());
  ASSERT_EQ(forces.size(), 1u);
  EXPECT_NEAR(forces[0], 0.00975, 0.10 * 0.00975);
}

TEST(Export, RefusesWhatItCannotSay) {
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3").code, 0);
  const Ran format = dimple(folder, "export block.nrrd -o a.inp --format ansys");
  EXPECT_EQ(format.code, 2);
  EXPECT_THAT(format.err, HasSubstr("'ansys' is no format"));
  const Ran name = dimple(folder, "export block.nrrd -o a.txt");
  EXPECT_EQ(name.code, 2);
  EXPECT_THAT(name.err, HasSubstr("does not say for which program"));
  const Ran elements = dimple(folder, "export block.nrrd -o a.inp --elements pyramids");
  EXPECT_EQ(elements.code, 2);
  EXPECT_THAT(elements.err, HasSubstr("'pyramids' are no elements"));
  const Ran ogden =
      dimple(folder, "export block.nrrd -o a.inp --set material.prony_g=0.5 --set material.prony_tau_s=1");
  EXPECT_EQ(ogden.code, 2);
  EXPECT_THAT(ogden.err, HasSubstr("only one neo-Hookean tissue"));
  EXPECT_FALSE(fs::exists(folder / "a.inp"));
}

TEST(Chart, DrawsASmallOneOfAnImageAndAScene) {
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom brain.nrrd --spacing 3").code, 0);
  const std::string command =
      "chart brain.nrrd -o out --only b,image --nodes 300,400 --schemes converging --time quasi-static "
      "--calculix none --goals none";
  const Ran ran = dimple(folder, command);
  ASSERT_EQ(ran.code, 0) << ran.err;
  const std::string csv = text_of(folder / "out" / "chart.csv");
  EXPECT_THAT(csv, HasSubstr("b,dimple,converging,quasi-static,300,"));
  EXPECT_THAT(csv, HasSubstr("difference from 400 nodes"));
  EXPECT_THAT(csv, Not(ContainsRegex("image,[^\n]*,1,\"difference"))) << "on a front without a reference";
  const std::string svg = text_of(folder / "out" / "chart.svg");
  for (const char* words : {"converging 300", "real time, 8 s", "Pareto front", "as reported", "[s]", "[%]",
                            "difference from our own finest run, 400 nodes", "That run is no reference"})
    EXPECT_THAT(svg, HasSubstr(words));
  EXPECT_GT(fs::file_size(folder / "out" / "chart.png"), 1000u);
  EXPECT_THAT(ran.err, HasSubstr("error"));
  EXPECT_EQ(dimple(folder, command + " -q").code, 0) << "a second time";
}

TEST(Chart, ComparesAnImageWithItsOwnReferenceToTheDepthsThatItHas) {
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3").code, 0);
  write_file(folder / "known.csv", "indentation_mm,force_N\n1,0.00975\n2,0.0193\n3,0.0288\n4,0.0381\n");
  const std::string command =
      "chart block.nrrd -o out --only image --nodes 400 --schemes converging --time quasi-static --calculix "
      "none --goals 10%";
  const Ran ran = dimple(folder, command + " --reference known.csv");
  ASSERT_EQ(ran.code, 0) << ran.err;
  const std::string csv = text_of(folder / "out" / "chart.csv");
  EXPECT_THAT(csv,
              ContainsRegex(
                  "image,dimple,converging,quasi-static,400,[^\n]*,1,0,,0,\"known.csv\",\"ok\",0.0[^\n]*,,,,\n"))
      << "400 nodes have no band";
  EXPECT_THAT(csv, ContainsRegex("image,dimple,accuracy 10%,quasi-static,[0-9]+,[^\n]*,0,0.0[0-9]+,1,\"known.csv\",\"ok\""))
      << "which states its error, and nothing else does";
  const std::string svg = text_of(folder / "out" / "chart.svg");
  for (const char* words :
       {"error against wall time", "against known.csv", "1, 2, ... 4 mm", "real time, 4 s", "accuracy 10%",
        "stated error against wall time"})
    EXPECT_THAT(svg, HasSubstr(words));
  write_file(folder / "half.csv", "indentation_mm,force_N\n0.5,0.005\n");
  const Ran half = dimple(folder, command + " --reference half.csv");
  EXPECT_EQ(half.code, 3);
  EXPECT_THAT(half.err, HasSubstr("no force at 1 mm"));
}

TEST(Chart, RefusesBeforeTheFirstRun) {
  const fs::path folder = fresh_folder();
  const std::vector<std::pair<std::string, std::string>> wrong = {
      {"--only a,c", "'c' is not known"},
      {"--only image", "no label image was given"},
      {"--reference known.csv", "a reference was given, but no label image"},
      {"--nodes 50", "50 nodes are too few"},
      {"--goals 5%,much", "accuracy.goal = much is not allowed"},
      {"--elements pyramids", "'pyramids' is not known"},
      {"--time slow", "'slow' is not known"},
      {"--febio no/such/febio4", "there is no program no/such/febio4"},
      {"--calculix no/such/ccx", "there is no program no/such/ccx"}};
  for (const auto& [option, words] : wrong) {
    const Ran ran = dimple(folder, "chart -o out " + option);
    EXPECT_EQ(ran.code, 2) << option;
    EXPECT_THAT(ran.err, HasSubstr(words)) << option;
    EXPECT_FALSE(fs::exists(folder / "out")) << option;
  }
}

}  // namespace
}  // namespace dimple
