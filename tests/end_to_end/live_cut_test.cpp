// Cuts while a tool is in the body, through the real program.

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

const std::string block = DIMPLE_SAMPLE_DATA "/block_3mm.nrrd";
const char* const stroke_columns = "time_s,from_x_mm,from_y_mm,from_z_mm,to_x_mm,to_y_mm,to_z_mm,depth_mm\n";

// Path to 2 mm depth, held there during the strokes, off the body, and in again.
void write_script(const fs::path& folder, const std::string& strokes) {
  std::ofstream(folder / "path.csv") << "time_s,depth_mm\n0,0\n0.4,2\n1,2\n1.2,-0.5\n1.6,2\n1.8,2\n";
  std::ofstream(folder / "strokes.csv") << stroke_columns << strokes;
}

Ran poke(const fs::path& folder, const std::string& options, const std::string& record) {
  return dimple(folder, "poke " + block +
                            " --script path.csv --strokes strokes.csv --nodes 1500 --evaluations 12 " +
                            "--record " + record + " " + options);
}

double at_time(const Table& recorded, const char* name, double time) {
  for (std::size_t k = 0; k < recorded.rows(); ++k)
    if (std::abs((*recorded.find("time_s"))[k] - time) < 1e-6) return (*recorded.find(name))[k];
  return std::nan("");
}

// The bonded patch of the block is at the origin, 5 mm wide.
TEST(LiveCut, NextToTheToolSoftensTheBodyForGoodAndAlikeWithAnyNumberOfThreads) {
  const fs::path folder = fresh_folder();
  write_script(folder, "0.8,9,-8,29,9,8,29,12\n");
  for (const char* threads : {"1", "2"})
    ASSERT_EQ(poke(folder, std::string("-q --threads ") + threads, std::string("live") + threads).code, 0);
  EXPECT_EQ(text_of(folder / "live1" / "forces.csv"), text_of(folder / "live2" / "forces.csv"));
  EXPECT_EQ(text_of(folder / "live1" / "cuts.csv"), text_of(folder / "live2" / "cuts.csv"));
  const Table recorded = read_csv(folder / "live1" / "forces.csv"),
              cuts = read_csv(folder / "live1" / "cuts.csv");
  ASSERT_EQ(cuts.rows(), 1u);
  EXPECT_EQ((*cuts.find("cut"))[0], 1.0);
  EXPECT_GE((*cuts.find("nodes"))[0], 2.0);
  EXPECT_NEAR((*cuts.find("area_mm2"))[0], 16.0 * 12.0, 0.3 * 16.0 * 12.0);
  const double before = at_time(recorded, "force_N", 0.76), after = at_time(recorded, "force_N", 1.0),
               again = at_time(recorded, "force_N", 1.8);
  EXPECT_LT(after, 0.99 * before);
  EXPECT_GT(after, 0.8 * before);
  EXPECT_EQ(at_time(recorded, "force_N", 1.2), 0.0) << "lifted off";
  EXPECT_NEAR(again, after, 1e-3 * after) << "the cut stays";
  EXPECT_EQ(at_time(recorded, "band_known", 0.76), 1.0);
  EXPECT_EQ(at_time(recorded, "band_known", 1.0), 0.0);
}

TEST(LiveCut, UnderASphereInContactChangesItsForceToo) {
  const fs::path folder = fresh_folder();
  write_script(folder, "0.8,7,-8,29,7,8,29,12\n");
  ASSERT_EQ(poke(folder, "-q --tool sphere:5mm", "live").code, 0);
  const Table recorded = read_csv(folder / "live" / "forces.csv");
  const double before = at_time(recorded, "force_N", 0.76), after = at_time(recorded, "force_N", 1.0);
  EXPECT_LT(after, 0.99 * before);
  EXPECT_GT(after, 0.5 * before);
}

TEST(LiveCut, ThatMissesTheBodyOrPartsAPieceOffIsNotMadeAndSaidSo) {
  const fs::path folder = fresh_folder();
  write_script(folder, "0.8,9,-8,80,9,8,80,5\n0.9,32,-60,22,32,60,22,90\n");
  const Ran ran = poke(folder, "-q --tool sphere:5mm", "live");  // holds no nodes
  ASSERT_EQ(ran.code, 0) << ran.err;
  const Table recorded = read_csv(folder / "live" / "forces.csv"),
              cuts = read_csv(folder / "live" / "cuts.csv");
  EXPECT_EQ((*cuts.find("cut"))[0] + (*cuts.find("cut"))[1], 0.0);
  EXPECT_EQ(at_time(recorded, "force_N", 0.76), at_time(recorded, "force_N", 1.0));
  EXPECT_THAT(ran.out, HasSubstr("not cut: the blade meets no tissue"));
  EXPECT_THAT(ran.out, HasSubstr("from every held part"));
}

TEST(LiveCut, UnderTheBondedPatchOrAfterTheEndOfThePathIsNotMadeAndSaidSo) {
  const fs::path folder = fresh_folder();
  write_script(folder, "0.8,1,-8,29,1,8,29,5\n7,9,-8,29,9,8,29,5\n");
  const Ran ran = poke(folder, "-q", "live");
  ASSERT_EQ(ran.code, 0) << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("not cut: the cut passes under the bonded patch"));
  EXPECT_THAT(ran.out, HasSubstr("not cut: the path ended before its time"));
  EXPECT_EQ(read_csv(folder / "live" / "cuts.csv").rows(), 2u);
}

// The discretisation made for a second contact place is cut too.
TEST(LiveCut, StaysWhereTheToolComesDownAtAnotherPlace) {
  const fs::path folder = fresh_folder();
  std::ofstream(folder / "path.csv")
      << "time_s,x_mm,y_mm,z_mm\n0,0,0,32\n0.4,0,0,29\n0.8,0,0,33\n1.2,-12,0,33\n"
      << "1.6,-12,0,28.5\n2,-12,0,28.5\n";
  const auto last_force = [&](const std::string& strokes, const std::string& record) {
    std::ofstream(folder / "strokes.csv") << stroke_columns << strokes;
    const Ran ran = poke(folder, "-q", record);
    EXPECT_EQ(ran.code, 0) << ran.err;
    return read_csv(folder / record / "forces.csv").find("force_N")->back();
  };
  const double cut = last_force("0.5,-19,-8,29,-19,8,29,12\n", "cut"), whole = last_force("", "whole");
  EXPECT_LT(cut, 0.99 * whole);
  EXPECT_GT(cut, 0.7 * whole);
}

TEST(LiveCut, IsRefusedWhereItsFileOrItsBladeSaysNothing) {
  const fs::path folder = fresh_folder();
  const auto refused = [&](const std::string& strokes, int code, const std::string& words) {
    write_script(folder, strokes);
    const Ran ran = poke(folder, "-q --force", "live");
    EXPECT_EQ(ran.code, code) << words;
    EXPECT_THAT(ran.err, HasSubstr(words));
  };
  refused("0.8,9,-8,29,9,8,29,0\n", 3, "the stroke in row 1 has no depth");
  refused("0.8,9,-8,29,9,-8,29,5\n", 3, "the stroke in row 1 has no length");
  refused("0.8,9,-8,29,9,8,29,5\n0.5,9,-8,29,9,8,29,5\n", 3, "row 2 is at 0.5 s, the one before at 0.8 s");
  std::ofstream(folder / "strokes.csv") << "time_s,depth_mm\n0,5\n";
  const Ran columns = poke(folder, "-q --force", "live");
  EXPECT_THAT(columns.err, HasSubstr("there is no column from_x_mm"));
  refused("0.8,9e12,-8,29,9,8,29,5\n", 3, "more than 1 km away");
  ends_with(folder, 2, "poke " + block + " --strokes strokes.csv --socket s", {"strokes have times"});
  ends_with(folder, 2, "poke " + block + " --script path.csv --tool scalpel", {"--tool scalpel:12mm"});
  write_script(folder, "0.8,9,-8,29,9,8,29,5\n");
  const Ran relaxes =
      poke(folder, "-q --force --set material.prony_g=0.5 --set material.prony_tau=1s", "live");
  EXPECT_THAT(relaxes.out, HasSubstr("tissue that relaxes is not cut")) << relaxes.err;
}

}  // namespace
}  // namespace dimple
