// Tests of `dimple export` through the real program.

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

// Forces [N] along -z, from the lines of CalculiX's FILE.dat that follow each "total force" [mN].
std::vector<double> forces_in(const fs::path& dat) {
  std::vector<double> forces;
  std::ifstream in(dat);
  for (std::string line; std::getline(in, line);) {
    if (line.find("total force") == std::string::npos) continue;
    double x = 0.0, y = 0.0, z = 0.0;
    if (in >> x >> y >> z) forces.push_back(-1e-3 * z);
  }
  return forces;
}

TEST(Export, WritesTheSameSceneForBothPrograms) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3");
  const std::string scene = " --nodes 500 --frames 2 --depth 1mm --indent-at 0,0,top --base inferior";
  const Ran inp = good(folder, "export block.nrrd -o block.inp" + scene);
  good(folder, "export block.nrrd -o again.feb --format febio" + scene);
  const std::string text = text_of(folder / "block.inp");
  EXPECT_THAT(text, HasSubstr("block.nrrd, indented by 1 mm (bonded)"));
  EXPECT_THAT(text, HasSubstr("circle, 3, 3, -1\n"));
  EXPECT_THAT(text_of(folder / "again.feb"), HasSubstr("<value lc=\"1\">-1</value>"));
}

TEST(Export, SaysWhereItsMeshIsNotTheBody) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom round.nrrd --shape cylinder -q");
  good(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3 -q");
  const std::string words = "the two are not the same body";
  EXPECT_THAT(dimple(folder, "export round.nrrd -o round.inp --nodes 500").err, HasSubstr(words));
  EXPECT_THAT(dimple(folder, "export block.nrrd -o block.inp --nodes 8000").err,
              testing::Not(HasSubstr(words)));
}

TEST(Export, SaysWhereItsElementsLock) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3 -q");
  for (const auto& [scene, locks] : {std::pair{"--nu 0.499", true}, {"--nu 0.45", false}})
    EXPECT_EQ(dimple(folder, std::string("export block.nrrd -o block.inp --nodes 600 ") + scene)
                      .err.find("tetrahedra lock") != std::string::npos,
              locks)
        << scene;
}

TEST(Export, OfTheSameSceneGivesTheSameBytesEachTime) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom brain.nrrd --spacing 3");
  std::string first;
  for (int time = 0; time < 4; ++time) {
    good(folder, "export brain.nrrd -o a.inp --nodes 2000");
    const std::string text = text_of(folder / "a.inp");
    if (time == 0) first = text;
    EXPECT_TRUE(text == first);
  }
}

TEST(Export, CalculixGivesTheForceOfTissueThatDoesNotLock) {
  if (std::system("command -v ccx > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "CalculiX is not installed (Debian: calculix-ccx)";
  const fs::path folder = fresh_folder();
  good(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3");
  const std::string scene =
      "export block.nrrd -o block.inp --nodes 2000 --frames 2 --depth 1mm --indent-at 0,0,top --base "
      "inferior";
  // At nu 0.3 ten-node tetrahedra do not lock. Hexahedra: 0.00721 N at 1 mm (hexahedra.csv).
  good(folder, scene + " --nu 0.3");
  ASSERT_EQ(std::system(("cd '" + folder.string() + "' && ccx block > words.txt 2>&1").c_str()), 0);
  const auto forces = forces_in(folder / "block.dat");
  ASSERT_EQ(forces.size(), 2u);
  EXPECT_NEAR(forces[1], 0.00721, 0.0008);
  EXPECT_NEAR(forces[0], 0.5 * forces[1], 0.0003);
}

TEST(Export, ReplacesNoFileOfOthersUnlessForced) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3 -q");
  for (const char* name : {"a.inp", "a.feb"}) {
    SCOPED_TRACE(name);
    const std::string line = std::string("export block.nrrd --nodes 500 -q -o ") + name;
    std::ofstream(folder / name) << "mine\n";
    ends_with(folder, 6, line, {std::string(name) + " exists and was not written by dimple"});
    EXPECT_EQ(text_of(folder / name), "mine\n");
    good(folder, line + " --force");
    EXPECT_NE(text_of(folder / name), "mine\n");
    EXPECT_EQ(dimple(folder, line).code, 0) << "one of its own";
  }
}

TEST(Export, RefusesWhatItCannotSay) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3");
  expect_refusals(
      folder, "export block.nrrd -o",
      {{2, "a.inp --format ansys", {"'ansys' is no format"}},
       {2, "a.txt", {"does not name a program's format"}},
       {2, "a.inp --elements hexahedra", {"there are no hexahedra to export", "ten-node tetrahedra"}}});
  EXPECT_FALSE(fs::exists(folder / "a.inp"));
}

}  // namespace
}  // namespace dimple
