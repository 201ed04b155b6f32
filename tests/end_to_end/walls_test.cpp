// Tests of dimple run --wall: rigid walls around the body, through the real program.

#include "io/label_image.hpp"
#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

constexpr const char* quick_wall = " --write force --nodes 600 --depth 3mm --frames 1 --band off ";
const std::string body = DIMPLE_SAMPLE_DATA "/block_3mm.nrrd";  // 60 x 60 x 30 mm, patch at (0, 0, 30)
const std::string halves = DIMPLE_SAMPLE_DATA "/two_labels_3mm.nii.gz";

Json walled(const fs::path& folder, const std::string& image, const std::string& options, const char* out) {
  const Ran ran = good(folder, "run " + image + " -o " + out + quick_wall + options);
  return ran.code == 0 ? summary_of(folder / out) : Json();
}

TEST(Wall, OnFourSidesMakesABlockStifferAndIsPressedOutward) {
  const fs::path folder = fresh_folder();
  const double free = walled(folder, body, "-q", "free")["force_N"];
  const std::string sides =
      "--set wall.left.shape=plane:30,0,0,-1,0,0 --set wall.right.shape=plane:-30,0,0,1,0,0 "
      "--set wall.front.shape=plane:0,-30,0,0,1,0 --wall plane:0,30,0,0,-1,0 ";
  const Json confined = walled(folder, body, sides + "--threads 2", "confined");
  EXPECT_GT(confined["force_N"], 1.02 * free);
  const Json& walls = confined["walls"];
  ASSERT_EQ(walls.size(), 4u);
  EXPECT_GT(walls["left"]["force_N"][0], 0.0);
  EXPECT_LT(walls["right"]["force_N"][0], 0.0);
  EXPECT_LT(walls["front"]["force_N"][1], 0.0);
  EXPECT_GT(walls["wall"]["force_N"][1], 0.0);
  EXPECT_EQ(walls["left"]["force_N"][2].get<double>(), 0.0) << "without friction";
  EXPECT_LT(walls["left"]["largest_penetration_mm"], 0.5);
  walled(folder, body, "-q --config confined/config.resolved.toml --threads 1", "again");
  EXPECT_EQ(text_of(folder / "confined" / "force.csv"), text_of(folder / "again" / "force.csv"));
}

TEST(Wall, ThatIsNotReachedChangesNothingAndSaysSo) {
  const fs::path folder = fresh_folder();
  walled(folder, body, "-q", "free");
  const Ran ran = good(folder, "run " + body + " -o far" + quick_wall + "--wall around:5mm");
  EXPECT_THAT(ran.err, HasSubstr("wall: not in contact at the end"));
  const Json far = summary_of(folder / "far");
  EXPECT_EQ(far["walls"]["wall"]["places_that_touch"], 0);
  const Json alone = summary_of(folder / "free");
  EXPECT_NEAR(far["force_N"], alone["force_N"], 1e-3 * alone["force_N"].get<double>());
}

// A wall holds the body alone.
TEST(Wall, ThatTheToolGoesThroughIsWarnedOfUnlessItIsOpenThere) {
  const fs::path folder = fresh_folder();
  const auto said = [&](const std::string& options) {
    return dimple(folder, "run " + body + " -o out --force --write force --nodes 600 --frames 1 --band off " +
                              options)
        .err;
  };
  const std::string through = "passes through it: walls act on the body only", around = "--wall around:1mm ",
                    ball = "--tool sphere:5mm --depth 2mm ";
  for (const std::string& tool : {std::string("--depth 2mm "), ball}) {
    EXPECT_THAT(said(around + tool), HasSubstr(through)) << tool;
    EXPECT_THAT(said(around + tool + "--set wall.wall.opening=0,0,36,20"), Not(HasSubstr(through))) << tool;
    EXPECT_THAT(said("--wall plane:-31,0,0,1,0,0 " + tool), Not(HasSubstr(through))) << tool;
  }
  EXPECT_THAT(
      said("--tool sphere:5mm --wall plane:31,0,0,-1,0,0 --set step.a.move=1mm --set step.b.move=28,0,1"),
      HasSubstr(through))
      << "where it goes later";
  const std::string two =
      said(ball + "--set wall.floor.shape=plane:-31,0,0,1,0,0 --set wall.lid.shape=plane:0,0,30.5,0,0,-1");
  EXPECT_THAT(two, HasSubstr("inside of the wall 'lid'"));
  EXPECT_THAT(two, HasSubstr("--set wall.lid.opening"));
  const std::string lid =
      "--depth 2mm --set wall.lid.shape=plane:0,0,30.5,0,0,-1 --set wall.lid.opening=0,0,30,";
  EXPECT_THAT(said(lid + "2"), HasSubstr(through)) << "the circle is wider than that";
  EXPECT_THAT(said(lid + "20"), Not(HasSubstr(through)));
}

// The body is around the origin; cells of a grid counted from there never join to fewer than eight.
TEST(Wall, MayMakeContactInAsFewPlacesAsAreRequested) {
  const fs::path folder = fresh_folder();
  const Json summary = walled(folder, body, "-q --wall around:0.2mm --set wall.wall.places=10", "few");
  EXPECT_LE(summary["walls"]["wall"]["places"], 10);
  EXPECT_TRUE(std::isfinite(summary["walls"]["wall"]["largest_penetration_mm"].get<double>()));
  EXPECT_GT(summary["force_N"], 0.0);
}

TEST(Wall, OfALabelHoldsBackItsNeighbourThatIsPressedFromTheSide) {
  const fs::path folder = fresh_folder();
  const std::string lower = "-q --label 1 --base left ";  // label 2 is above label 1
  const Json free = walled(folder, halves, lower, "free"),
             next_to = walled(folder, halves, lower + "--wall label:2", "beside");
  const Json& wall = next_to["walls"]["wall"];
  EXPECT_GE(wall["places_that_touch"], 3);
  EXPECT_GT(wall["force_N"][2], 0.0) << "it is pushed up";
  EXPECT_GT(next_to["force_N"], 1.004 * free["force_N"].get<double>());
  // The coarser nodes of the error bounds need the label too.
  const Ran bounded = good(folder, "run " + halves + " -o bounds --nodes 1000 --depth 3mm --write force " +
                                       lower + "--wall label:2");
  EXPECT_THAT(bounded.out, HasSubstr("(discretisation)"));
}

TEST(Wall, OfTwoLabelsIsThatOfBothTogether) {
  const fs::path folder = fresh_folder();
  LabelImage image = read_label_image(halves);
  bool turn = false;
  for (dimple::Run& run : image.run)
    if (run.label == 2) run.label = (turn = !turn) ? 2 : 3;
  write_label_image(folder / "three.nrrd", image);
  const std::string lower = "-q --label 1 --base left --wall label:";
  walled(folder, halves, lower + "2", "one");
  walled(folder, "three.nrrd", lower + "3,2", "two");
  EXPECT_EQ(text_of(folder / "one" / "force.csv"), text_of(folder / "two" / "force.csv"));
}

TEST(Wall, IsRefusedWhereItCannotBeOrNothingLooksForIt) {
  const fs::path folder = fresh_folder();
  const std::string run = "run " + body + " -o out" + quick_wall + "--wall";
  expect_refusals(folder, run,
                  {{2, "nothing", {"this names no wall"}},
                   {2, "skull.vtk", {".obj and .vtp"}},
                   {2, "plane:1,2,3,0,0,0", {"has no normal"}},
                   {3, "label:9", {"no label '9'"}},
                   {3, "label:1", {"both the wall"}},
                   {3, "label:2,9", {"no label '"}},
                   {3, "no.stl", {"no.stl"}},
                   {4, "plane:20,0,0,-1,0,0", {"overlaps the body by"}},
                   {4, "plane:90,0,0,-1,0,0", {"no part of the body can reach the wall"}}});
  const std::string nothing = "opens no part of the wall near the body";
  expect_refusals(folder, run + " around:1mm --set",
                  {{2, "wall.wall.gap=1mm", {"two gaps"}},
                   {2, "wall.wall.friction=-1", {"friction"}},
                   {2, "wall.wall.opening=1,2,3", {"has 3 numbers"}},
                   {2, "wall.skull.friction=0.1", {"has no shape"}}});
  expect_refusals(folder, run + " plane:30.5,0,0,-1,0,0 --set",
                  {{4, "wall.wall.opening=0.03,0,0.015,0.014", {nothing}},
                   {4, "wall.wall.opening=300,0,15,14", {nothing}}});
  EXPECT_FALSE(fs::exists(folder / "out" / "force.csv"));
}

constexpr const char* next_to = "--wall plane:30.3,0,0,-1,0,0 --set wall.hull.shape=around:0.3mm ";

TEST(Wall, GoesInAFitThatFindsTheModulusOfItsOwnCurve) {
  const fs::path folder = fresh_folder();
  good(folder, "run " + body +
                   " -q --write force --nodes 600 --depth 3mm --frames 3 --band off "
                   "--mu 300 -o run " +
                   next_to);
  good(folder, "fit " + body + " -o fit -q --nodes 600 --curve run/force.csv " + next_to);
  const Json fit = summary_of(folder / "fit");
  EXPECT_NEAR(fit["mu_Pa"], 300.0, 3.0) << fit.dump(1);
}

TEST(Wall, GoesInASceneOfStepsAndNoStepMovesIt) {
  const fs::path folder = fresh_folder();
  const std::string press =
      " -q --write force --nodes 600 --band off --set step.a.move=2 --set step.b.move=-1 ";
  good(folder, "run " + body + " -o out" + press + next_to);
  const Json scene = summary_of(folder / "out");
  EXPECT_EQ(scene["scene"].size(), 2u);
  EXPECT_TRUE(scene["walls"].contains("hull"));
  const Ran ran = dimple(
      folder, "run " + body + " -o no" + press + next_to + "--set step.c.move=1,0,0 --set step.c.moves=hull");
  EXPECT_NE(ran.code, 0);
  EXPECT_THAT(ran.err, HasSubstr("step.c.moves"));
}

TEST(Wall, IsOneOfTheChoicesThatExplainChanges) {
  if (!std::getenv("DIMPLE_ALL_SCENES")) GTEST_SKIP() << "skipped: 15 s, without DIMPLE_ALL_SCENES";
  const fs::path folder = fresh_folder();
  good(folder, "run " + body +
                   " -q --write force --nodes 600 --depth 2mm --frames 1 --explain "
                   "--wall plane:30.3,0,0,-1,0,0 -o out");
  const std::string table = text_of(folder / "out" / "explain.csv");
  expect_words(table, {"\"walls\",\"none\"", "\"walls' friction\",\"0.3\""});
  EXPECT_THAT(table, Not(HasSubstr("far tissue"))) << "the wall would stand where it is cut";
  EXPECT_THAT(table, Not(HasSubstr("inertia"))) << "which takes no walls";
}

const std::string bed = "--base-hold none --wall plane:0,0,0,0,0,1 ";  // below the block

TEST(Bed, CarriesABodyUnderTheToolAndYieldsMoreThanAHeldBase) {
  const fs::path folder = fresh_folder();
  const double held = walled(folder, body, "-q", "held")["force_N"];
  const Json lies = walled(folder, body, "-q " + bed, "lies");
  const double force = lies["force_N"];
  EXPECT_LT(force, 0.99 * held) << "its lower face slides";
  EXPECT_GT(force, 0.7 * held);
  const Json& wall = lies["walls"]["wall"];
  EXPECT_NEAR(wall["force_N"][2], -force, 0.01 * force) << "all of it goes into the bed";
  EXPECT_EQ(lies["counts"]["base_nodes"], 0);
  const double no_slip =
      walled(folder, body, "-q " + bed + "--set wall.wall.friction=stick", "sticks")["force_N"];
  EXPECT_GT(no_slip, force);
  EXPECT_LT(no_slip, 1.01 * held) << "and its rim may still come off";
}

// A part of the base that is not held may be held by a support.
TEST(Bed, MayBeWhereTheBodyIsHeldTooByASupport) {
  const fs::path folder = fresh_folder();
  const Json lies =
      walled(folder, body, "-q --contact frictionless --set support.s.on=0,0,0,8 " + bed, "lies");
  EXPECT_GT(lies["supports"]["s"]["nodes"], 0);
  EXPECT_GT(lies["force_N"], 0.0);
}

TEST(Bed, IsWarnedOfWhereSupportsAndNoWallsCarryTheTool) {
  const fs::path folder = fresh_folder();
  const std::string supported = "run " + body + " -o out --force" + quick_wall +
                                "--base-hold none --wall plane:30,0,0,-1,0,0 --set support.s.on=inferior",
                    words = "of the tool's force and the supports the rest, although the base is free";
  EXPECT_THAT(good(folder, supported).err, HasSubstr(words));
  EXPECT_THAT(good(folder, supported + " --base inferior").err, Not(HasSubstr(words))) << "it was chosen";
  EXPECT_THAT(good(folder, "run " + body + " -o lies" + quick_wall + bed).err, Not(HasSubstr(words)));
}

TEST(Bed, ThatTheBodyDoesNotLieOnIsNamedAsWhatItLacks) {
  const fs::path folder = fresh_folder();
  ends_with(folder, 5, "run " + std::string(body) + " -o out -q --base-hold none --wall plane:0,0,-1,0,0,1",
            {"only walls hold the body", "place a wall in contact with it"});
}

TEST(Bed, IsRefusedWhereNothingCarriesTheBodyOrHoldsItSideways) {
  const fs::path folder = fresh_folder();
  const std::string run = "run " + body + " -o out" + quick_wall;
  expect_refusals(
      folder, run,
      {{2, "--base-hold none", {"nothing supports the body"}}, {2, "--base-hold loose", {"--base-hold"}}});
  std::vector<RefusedLine> lines;
  for (const char* loose : {"--contact frictionless", "--tool sphere:10mm", "--gravity inferior",
                            "--gravity inferior --set wall.wall.friction=stick",
                            "--gravity inferior --set support.s.on=left --set support.s.hold=sliding"})
    lines.push_back({2, loose, {"nothing holds the body sideways"}});
  expect_refusals(folder, run + bed, lines);
}

}  // namespace
}  // namespace dimple
