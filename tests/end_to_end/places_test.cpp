// Places for the tool as the program lists them, and its messages about impossible places.

#include "io/label_image.hpp"
#include "tests/end_to_end/in_folder.hpp"
#include "tests/helpers/image.hpp"

namespace dimple {
namespace {

class Places : public InFolder {};

std::string coordinates(const Json& place) {
  const Json& x = place.at("centre_mm");
  return fmt::format("{},{},{}", x[0].get<double>(), x[1].get<double>(), x[2].get<double>());
}

TEST_F(Places, OfThePhantomAreListedInWordsAndAsJsonAndARunTakesThem) {
  good("phantom brain.nrrd --spacing 3");
  const Json listed = Json::parse(good("places brain.nrrd --json").out);
  ASSERT_EQ(listed.at("sides").size(), 6u);
  const Json& first = listed.at("sides").at(0);
  EXPECT_EQ(first.at("from"), "superior");
  EXPECT_EQ(first.at("base"), "inferior");
  EXPECT_EQ(first.at("verdict"), "good");
  EXPECT_EQ(listed.at("sides").at(5).at("verdict"), "refused");
  EXPECT_EQ(listed.at("sides").at(5).at("reason"), "on the fixed base");
  EXPECT_EQ(listed.at("circle_diameter_mm"), 10.0);
  const std::string table = good("places brain.nrrd").out;
  expect_words(table, {"tool from", "superior", "anterior", "posterior", "left", "right", "inferior",
                       "refused: on the fixed base", "places examined on the superior side are good"});

  // The first place is the default of a run; the others are accepted as printed.
  good("model brain.nrrd -o own --nodes 500 -q");
  EXPECT_THAT(text_of(folder / "own" / "model.toml"), HasSubstr("superior side, opposite to the base"));
  ASSERT_FALSE(listed.at("others").empty());
  for (std::size_t k = 0; k < std::min<std::size_t>(3, listed.at("others").size()); ++k) {
    const Json& place = listed.at("others").at(k);
    const Ran ran = good("model brain.nrrd -o other --force --nodes 500 --indent-at " + coordinates(place));
    EXPECT_EQ(place.at("verdict") == "good", ran.err.find("little room") == std::string::npos) << ran.err;
  }
}

TEST_F(Places, OnEachSideAreTakenWithTheBaseNextToThemAndTheDirectionFromThere) {
  good("phantom brain.nrrd --spacing 3");
  const Json listed = Json::parse(good("places brain.nrrd --json").out);
  EXPECT_THAT(good("places brain.nrrd").out, HasSubstr("x,y,z (LPS, mm) with the base"));
  int others = 0;
  for (const Json& side : listed.at("sides")) {
    if (side.at("verdict") == "refused") continue;
    const std::string place = "model brain.nrrd -o out --force --nodes 500 --indent-at=" + coordinates(side),
                      base = " --base " + side.at("base").get<std::string>();
    const Json& approach = side.at("push");
    const std::string displacement = fmt::format(" --direction={},{},{}", approach[0].get<double>(),
                                                 approach[1].get<double>(), approach[2].get<double>());
    EXPECT_THAT(good(place + base + displacement).err, HasSubstr("as requested; projected 0.0 mm"));
    if (side.at("from") == "superior") continue;
    // From above the slope there is too steep, or nearly so.
    const Ran ran = dimple(folder, place);
    if (ran.code == 0) {
      EXPECT_THAT(ran.err, HasSubstr("little room"));
      continue;
    }
    ++others;
    EXPECT_THAT(ran.err, HasSubstr("extends beyond the organ's edge"));
  }
  EXPECT_GE(others, 2);
}

TEST_F(Places, OfAToolAreThoseThatItsRunTakes) {
  good("phantom brain.nrrd --spacing 3");
  const std::string tool = " --tool sphere:6mm --depth 2mm ";
  const Json listed = Json::parse(good("places brain.nrrd --json" + tool).out);
  EXPECT_EQ(listed.at("tool"), "sphere:6mm");
  EXPECT_EQ(listed.at("circle_diameter_mm"), 12.0);
  EXPECT_THAT(good("places brain.nrrd" + tool).out,
              HasSubstr("Places for the tool sphere:6mm, pressed in by 2.00 mm"));
  for (const Json& side : listed.at("sides")) {
    if (side.at("verdict") == "refused") continue;
    const Json& x = side.at("centre_mm");
    const Ran ran = good("run brain.nrrd -o out --force --nodes 500 --frames 1 --band off --write force " +
                         tool + "--indent-at " + side.at("from").get<std::string>());
    std::smatch said;
    ASSERT_TRUE(std::regex_search(ran.err, said,
                                  std::regex("contact  .* at \\(([-0-9.]+), ([-0-9.]+), ([-0-9.]+)\\) mm")))
        << ran.err;
    for (std::size_t d = 0; d < 3; ++d) EXPECT_NEAR(std::stod(said[d + 1]), x[d], 0.1) << side.at("from");
  }
}

TEST_F(Places, OfAPatchThatJustFitsAFaceAreFound) {
  good("phantom cube.nrrd --shape block --size 40,40,40 --spacing 2");
  for (const char* width : {"33mm", "36mm", "39mm"})
    good(std::string("model cube.nrrd -o out --force --nodes 300 -q --indenter-diameter ") + width);
  EXPECT_EQ(dimple(folder, "model cube.nrrd -o out --force --nodes 300 -q --indenter-diameter 42mm").code, 4);
}

TEST_F(Places, OnAPieceThatWasDroppedAreRefusedWithThatReason) {
  const auto of_two = [](Index i, Index j, Index k) {
    return i >= 2 && i < 56 && (i < 20 || i >= 26) && j >= 2 && j < 22 && k >= 2 && k < 22;
  };
  write_label_image(folder / "two.nrrd", image_of({60, 24, 24}, Vec3::Constant(1.5), of_two));
  ends_with(folder, 4, "run two.nrrd -o out --force --nodes 300 -q --indent-at 16,18,top",
            {"the labels form 2 pieces, and all but the largest were dropped"});
}

// A column pressed on its end deforms over its whole length.
TEST_F(Places, AnOrganThatMovesAsABodyFarFromTheToolIsWarnedOf) {
  good("phantom tall.nrrd --shape block --size 30,30,90 --spacing 2");
  good("phantom low.nrrd --shape block --size 60,60,40 --spacing 2");
  const std::string scene = " --base inferior --depth 2mm --nodes 600 --band off --write force";
  const std::string moves = "far from the tool the organ moves as a rigid body";
  const Ran down = good("run tall.nrrd -o tall --indenter-diameter 8" + scene);
  EXPECT_THAT(down.err, HasSubstr(moves));
  EXPECT_THAT(down.err, HasSubstr("--base-depth"));
  EXPECT_THAT(good("run low.nrrd -o low" + scene).err, Not(HasSubstr(moves)));
}

// A post of 12 mm has an arm of 9 mm thickness over empty space: the arm bends under a load from above.
TEST_F(Places, OnAPartThatSwingsAreWarnedOfWithNumbersAndABetterPlace) {
  const auto of_both = [](Index i, Index j, Index k) {
    const bool inside = i >= 2 && j >= 2 && k >= 2 && i < 42 && j < 22 && k < 32;
    const bool block = k < 14, arm = j < 12 && i < 30 && (k >= 26 || i < 10);
    return inside && (block || arm);
  };
  write_label_image(folder / "arm.nrrd", image_of({44, 24, 34}, Vec3::Constant(1.5), of_both));
  const std::string scene =
      " --base inferior --indenter-diameter 6 --depth 2mm --frames 4 --nodes 1000 --band off --write force";
  const Ran arm = good("run arm.nrrd -o arm --indent-at 33,9,48" + scene);
  std::smatch said;
  ASSERT_TRUE(std::regex_search(
      arm.err, said,
      std::regex(
          "free to bend: ([0-9.]+) mm of tissue along the approach direction under a contact patch of 6 mm")))
      << arm.err;
  EXPECT_NEAR(std::stod(said[1]), 9.0, 0.5);
  ASSERT_TRUE(
      std::regex_search(arm.err, said, std::regex("the next better place is .*--indent-at ([-0-9.,]+)")))
      << arm.err;
  const std::string better = said[1];
  ASSERT_TRUE(std::regex_search(arm.err, said,
                                std::regex("([0-9]+) % of the indentation bends the part under the tool")))
      << arm.err;
  EXPECT_GT(std::stod(said[1]), 50.0);
  EXPECT_LT(std::stod(said[1]), 105.0);
  const Ran block = good("run arm.nrrd -o block --indent-at " + better + scene);
  EXPECT_THAT(block.err, Not(HasSubstr("bend")));
  // The tool's default place is on the block too.
  const Ran own = good("run arm.nrrd -o own" + scene);
  EXPECT_THAT(own.err, Not(HasSubstr("bend")));
}

}  // namespace
}  // namespace dimple
