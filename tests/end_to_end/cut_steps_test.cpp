// Scenes with steps that cut the body, at rest and deformed, through the real program.

#include <iostream>

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

const std::string block = DIMPLE_SAMPLE_DATA "/block_3mm.nrrd";       // 60 x 60 x 30 mm, patch at (0, 0, 30)
const std::string two = DIMPLE_SAMPLE_DATA "/two_labels_3mm.nii.gz";  // the lower half and the upper half
const std::string disc = "plane:10,0,15,1,0,0.2,radius=12mm";
const std::string press = " --set step.press.move=2mm ", deeper = " --set step.deeper.move=1mm ";

class StepsThatCut : public testing::Test {
 protected:
  const fs::path folder = fresh_folder();

  Json run(const std::string& out, const std::string& options, const std::string& image = block) const {
    const Ran ran = dimple(folder, "run " + image + " -q --nodes 800 -o " + out + options);
    EXPECT_EQ(ran.code, 0) << options << '\n' << ran.err;
    return ran.code == 0 ? summary_of(folder / out) : Json();
  }
  Json quick(const std::string& out, const std::string& options, const std::string& image = block) const {
    return run(out, " --write force --frames 2" + options, image);
  }
  Table curve(const std::string& out, const char* file = "force.csv") const {
    return read_csv(folder / out / file);
  }
};

bool all_scenes() {
  const char* all = std::getenv("DIMPLE_ALL_SCENES");
  return all && std::string(all) == "1";
}

double last(const Table& table, const char* column) {
  return table.find(column)->back();
}

TEST_F(StepsThatCut, BeforeAnythingHasMovedAreTheBodyCutAtRestToTheBit) {
  const Json step = quick("step", " --set step.slit.cut=" + disc + "" + press);
  quick("rest", " --cut " + disc + "" + press);
  EXPECT_EQ(text_of(folder / "step" / "force.csv"), text_of(folder / "rest" / "force.csv"));
  ASSERT_EQ(step["scene"].size(), 2U);
  EXPECT_EQ(step["scene"][0]["name"], "slit");
  EXPECT_GT(step["scene"][0]["area_mm2"], 400.0);
}

// The state of elastic tissue under a bonded tool does not depend on the load path. The run's folder holds
// the blade in the body at rest.
TEST_F(StepsThatCut, InADeformedStateAreTheBodyThatHasThatSlitFromTheStart) {
  const Json step = quick("step", press + "--set step.slit.cut=" + disc + "" + deeper);
  const Json& cut = step["scene"][1];
  quick("whole", press);
  quick("slit", " --cut step/cuts/cut_0001.vtp" + press);
  const double force = last(curve("slit"), "force_N");
  EXPECT_NEAR(cut["force_N"], force, 0.001 * force);
  EXPECT_LT(force, 0.97 * cut["force_before_N"].get<double>());
  const double deep = quick("deep", " --cut step/cuts/cut_0001.vtp" + press + deeper)["force_N"];
  EXPECT_NEAR(step["force_N"], deep, 0.001 * deep);
  // The released energy is the difference of the two bodies, and the energy balance contains it.
  const double apart =
      last(curve("whole", "energy.csv"), "stored_J") - last(curve("slit", "energy.csv"), "stored_J");
  EXPECT_NEAR(cut["released_J"], apart, 0.01 * apart);
  EXPECT_NEAR(last(curve("step", "energy.csv"), "dissipated_J"), apart, 0.01 * apart);
  EXPECT_LT(step["energy_error"], 0.002);
  EXPECT_NEAR(cut["released_J_per_m2"], 1e6 * cut["released_J"].get<double>() / cut["area_mm2"].get<double>(),
              1e-12);
  // This blade differs from one at the same place of the body at rest.
  const Json undeformed = quick("at_rest", " --cut " + disc + "" + press);
  EXPECT_GT(std::abs(undeformed["force_N"].get<double>() - force), 0.002 * force);
}

TEST_F(StepsThatCut, AfterUnloadingAreTheBodyCutAtRest) {
  const Json step = quick(
      "step", press + "--set step.lift.move=-2mm --set step.slit.cut=" + disc + " --set step.again.move=2mm");
  const double undeformed = quick("rest", " --cut " + disc + "" + press)["force_N"];
  EXPECT_NEAR(step["force_N"], undeformed, 0.001 * undeformed);
  EXPECT_NEAR(step["scene"][2]["released_J"], 0.0, 1e-12);
}

TEST_F(StepsThatCut, NeitherMoveTheToolNorTheBaseNorLoseTheForce) {
  const std::string across = "--set step.slit.cut=line:-12,0,30,12,0,30,depth=12mm";
  const std::string sphere = " --tool sphere:5mm";
  const Json whole = quick("whole",
                           sphere + press + deeper + "--set step.aside.move=1,0,0 --set step.lift.move=-3mm"),
             step = quick("step", sphere + press + across + deeper +
                                      "--set step.aside.move=1,0,0 --set step.lift.move=-3mm");
  EXPECT_EQ(whole["tool"]["first_touch_mm"], step["tool"]["first_touch_mm"]);
  EXPECT_EQ(whole["counts"]["push"], step["counts"]["push"]);
  EXPECT_EQ(whole["counts"]["base_nodes"].get<int>() > 0, step["counts"]["base_nodes"].get<int>() > 0);
  const Json& scene = step["scene"];
  EXPECT_EQ(scene[1]["force_before_N"], scene[0]["force_N"]);
  EXPECT_EQ(scene[1]["indentation_mm"], scene[0]["indentation_mm"]);
  EXPECT_GT(scene[1]["force_N"], 0.6 * scene[0]["force_N"].get<double>());
  EXPECT_GT(scene[2]["force_N"], scene[1]["force_N"].get<double>());
  EXPECT_EQ(scene.back()["force_N"].get<double>(), 0.0) << "lifted off";
  EXPECT_NEAR(last(curve("step"), "aside_x_mm"), 1.0, 1e-9);
}

TEST_F(StepsThatCut, OneAfterTheOtherAreAllInTheBodyThatIsLeft) {
  const Json step = quick("step", press +
                                      "--set step.a.cut=line:-8,-20,30,-8,20,30,depth=10mm --set "
                                      "step.b.cut=line:-20,9,30,20,9,30,depth=10mm" +
                                      deeper);
  const double both =
      quick("rest", " --cut step/cuts/cut_0001.vtp;step/cuts/cut_0002.vtp" + press + deeper)["force_N"];
  EXPECT_NEAR(step["force_N"], both, 0.003 * both);
  EXPECT_NEAR(step["scene"][1]["area_mm2"].get<double>() + step["scene"][2]["area_mm2"].get<double>(),
              step["model"]["cut"]["area_mm2"], 1e-6);
}

// CGAL intersects two blades in an order that depends on addresses in memory.
TEST_F(StepsThatCut, ThatCrossAreTheSameBitsEachTime) {
  if (!all_scenes()) GTEST_SKIP() << "DIMPLE_ALL_SCENES=1 runs it";
  const std::string scene = press +
                            "--set step.a.cut=line:-8,-20,30,-8,20,30,depth=10mm --set "
                            "step.b.cut=line:-20,9,30,20,9,30,depth=10mm";
  std::set<std::string> curves;
  for (const char* out : {"a", "b", "c", "d"}) {
    quick(out, scene);
    curves.insert(text_of(folder / out / "force.csv"));
  }
  EXPECT_EQ(curves.size(), 1U);
}

TEST_F(StepsThatCut, ShowTheCutBodyInEachFrameFromThenOnAtATimeOfItsOwn) {
  run("out", " --frames 4 --write all" + press + "--set step.slit.cut=" + disc + "" + deeper);
  run("touching",
      " --frames 4 --write all --tool sphere:5mm" + press + "--set step.slit.cut=" + disc + "" + deeper);
  for (const char* series : {"out/nodes", "out/surface", "out/section", "out/tool", "touching/contact"}) {
    const std::string pvd = text_of(folder / (std::string(series) + ".pvd"));
    double before = -1.0;
    int frames = 0;
    const std::regex listed("timestep=\"([^\"]+)\".*file=\"([^\"]+)\"");
    for (std::sregex_iterator it(pvd.begin(), pvd.end(), listed), end; it != end; ++it, ++frames) {
      EXPECT_GT(std::stod((*it)[1]), before) << series;
      before = std::stod((*it)[1]);
      EXPECT_TRUE(fs::exists(folder / fs::path(series).parent_path() / (*it)[2].str())) << (*it)[2];
    }
    EXPECT_EQ(frames, 6) << series;
  }
  const auto size = [&](int frame) {
    return fs::file_size(folder / "out" / "surface" / ("surface_000" + std::to_string(frame) + ".vtp"));
  };
  EXPECT_NE(size(3), size(4));  // other triangles
  const Table force = curve("out");
  for (std::size_t k = 1; k < force.column[0].size(); ++k)
    EXPECT_GT(force.find("time_s")->at(k), force.find("time_s")->at(k - 1));
  const Ran again =
      good(folder, "run " + block + " --config out/config.resolved.toml -q -o again --threads 1");
  EXPECT_EQ(text_of(folder / "again" / "force.csv"), text_of(folder / "out" / "force.csv"));
  EXPECT_EQ(text_of(folder / "again" / "cuts" / "cut_0001.vtp"),
            text_of(folder / "out" / "cuts" / "cut_0001.vtp"));
  good(folder, "run " + block + " -q --force -o out --nodes 300 --depth 1mm --write force");
  EXPECT_FALSE(fs::exists(folder / "out" / "cuts")) << "a run that replaces another removes its blades";
}

TEST_F(StepsThatCut, TakeOutALabelWhereverItHasGone) {
  const std::string held = " --base inferior --indent-at 0,0,top --tool sphere:5mm";
  const Json info = Json::parse(dimple(folder, "info " + two + " --json").out);
  const std::string lower = std::to_string(info["labels"][0]["value"].get<int>());
  ends_with(folder, 4,
            "run " + two + " -q --nodes 800 --write force -o falls" + held + press +
                "--set step.out.cut=label:" + lower,
            {"step.out.cut"});
}

// At rest the second blade is in the gap of the first, up to rounding.
TEST_F(StepsThatCut, WhereAnotherHasGoneSayThatTheyOpenHardlyAnythingAndChangeNothing) {
  if (!all_scenes()) GTEST_SKIP() << "DIMPLE_ALL_SCENES=1 runs it";
  const std::string first = press + "--set step.a.cut=" + disc;
  quick("first", first);
  const Json step = quick("out", first +
                                     " --set step.lift.move=-2mm --set step.b.cut=first/cuts/cut_0001.vtp "
                                     "--set step.again.move=2mm");
  EXPECT_THAT(step["warnings"].dump(), HasSubstr("overlaps another cut"));
  EXPECT_LT(step["scene"][3]["area_mm2"], 0.1);
  const double before = step["scene"][1]["force_N"], after = step["force_N"];
  EXPECT_NEAR(after, before, 0.01 * before);
}

TEST_F(StepsThatCut, ThatCannotBeMadeLeaveTheCurveUntilThenAndSayWhy) {
  const struct {
    const char* cut;
    const char* words;
  } refused[] = {{"plane:200,0,0,1,0,0", "meets no tissue"},
                 {"plane:0,0,15,0,0,1", "separated from the base"},
                 {"line:-9,-20,28,9,20,28,depth=10mm", "passes under the bonded patch"},
                 {"label:nowhere", "no label is called"}};
  for (const auto& [cut, words] : refused) {
    const Ran ran = dimple(folder, "run " + block + " -q --force --write force --nodes 400 -o out" + press +
                                       "--set step.slit.cut=" + cut + deeper);
    EXPECT_TRUE(ran.code == 4 || ran.code == 3) << cut << ran.err;
    EXPECT_THAT(ran.err, HasSubstr(words));
    EXPECT_THAT(ran.err, HasSubstr("step.slit.cut")) << "where";
    const Json summary = summary_of(folder / "out");
    EXPECT_EQ(summary["status"], "failed");
    EXPECT_EQ(summary["exit_code"], ran.code);
    EXPECT_NEAR(summary["indentation_mm"], 2.0, 1e-9);
    EXPECT_GT(summary["force_N"], 0.0);
    EXPECT_NEAR(last(curve("out"), "indentation_mm"), 2.0, 1e-9);
  }
}

TEST_F(StepsThatCut, ThatNothingCanBeMadeOfAreRefusedBeforeAnythingIsBuilt) {
  const std::string cut = "--set step.slit.cut=" + disc;
  expect_refusals(folder, "run " + block + " -o out",
                  {{2, cut, {"no step moves anything"}},
                   {2, press + cut + " --set step.slit.move=1mm", {"cuts and moves something"}},
                   {2, press + "--set step.slit.cut=hatchet:1,2", {"is not known"}},
                   {2, press + "--set step.slit.cut=;", {"is empty"}},
                   {2, press + "--set step.press.toughness_J_m2=3", {"cuts nothing"}},
                   {2, press + cut + " --tool sphere:5mm --friction 0.3", {"friction"}}});
  EXPECT_FALSE(fs::exists(folder / "out"));
}

TEST_F(StepsThatCut, HaveTheWorkOfTheirBladeByTheBalanceOfEnergyWhereAToughnessIsGiven) {
  const Json step = quick("out", press + "--set step.slit.cut=" + disc + " --set step.slit.toughness_J_m2=2");
  const Json& cut = step["scene"][1];
  EXPECT_NEAR(cut["work_of_blade_J"], 2e-6 * cut["area_mm2"].get<double>() - cut["released_J"].get<double>(),
              1e-12);
  const Json tear = quick("tear", press + "--set step.slit.cut=" + disc + " --set step.slit.toughness=1e-6");
  EXPECT_EQ(tear["scene"][1]["work_of_blade_J"].get<double>(), 0.0) << "the tissue gives more than it takes";
  EXPECT_FALSE(
      quick("none", press + "--set step.slit.cut=" + disc + "")["scene"][1].contains("work_of_blade_J"));
}

}  // namespace
}  // namespace dimple
