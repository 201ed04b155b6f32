// Scenes of several steps, from a user's options to the files of a run.

#include "io/types.hpp"
#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/picture_pixels.hpp"
#include "tests/end_to_end/whole_files.hpp"

namespace dimple {
namespace {

class SceneOfSteps : public InFolder {
 protected:
  const std::string scene = " --base inferior --indent-at 0,0,top --nodes 600 --mu 2kPa -q";

  void SetUp() override { make_block(); }
  void write_scene(const std::string& text) const { std::ofstream(folder / "scene.toml") << text; }
  Json run(const std::string& options, const std::string& out = "out") const {
    good("run block.nrrd --force -o " + out + scene + options);
    return summary(out);
  }
};

// Steps are done in the order of their lines, not of their names.
constexpr const char* press_and_pull = R"([support.retractor]
on = "20,0,30,8"

[step.second_press]
move_mm = 2

[step.first_pull]
moves = "retractor"
move_mm = [1.5, 0, 0]
)";

TEST_F(SceneOfSteps, ATwoStepSceneRunsAndItsResolvedConfigurationRepeatsItToTheBit) {
  write_scene(press_and_pull);
  const Json summary = run(" --config scene.toml --write all");
  ASSERT_EQ(summary["scene"].size(), 2u);
  EXPECT_EQ(summary["scene"][0]["name"], "second_press");
  EXPECT_EQ(summary["scene"][1]["moves"], "retractor");
  EXPECT_NEAR(summary["scene"][0]["indentation_mm"], 2.0, 1e-9);
  EXPECT_NEAR(summary["indentation_mm"], 2.0, 1e-9);
  EXPECT_NEAR(summary["supports"]["retractor"]["moved_mm"][0], 1.5, 1e-9);
  EXPECT_EQ(summary["force_N"], summary["scene"][1]["force_N"]);
  EXPECT_NE(summary["scene"][0]["force_N"], summary["scene"][1]["force_N"]);
  EXPECT_THAT(summary["band"]["unknown"].get<std::string>(), HasSubstr("not calibrated for supports"));
  const Table curve = read_csv(folder / "out" / "force.csv");
  for (std::size_t k = 1; k < curve.column[0].size(); ++k)
    EXPECT_GT(curve.find("time_s")->at(k), curve.find("time_s")->at(k - 1));
  EXPECT_NEAR(curve.find("time_s")->back(), 3.5, 1e-9);

  const std::string before = text_of(folder / "out" / "force.csv");
  EXPECT_THAT(text_of(folder / "out" / "config.resolved.toml"), HasSubstr("[step.\"second_press\"]"));
  good("run --config out/config.resolved.toml -o again -q");
  EXPECT_EQ(text_of(folder / "again" / "force.csv"), before);
}

TEST_F(SceneOfSteps, ThePressOfOneStepIsTheRunWithoutSteps) {
  const double plain = run(" --depth 2mm --write force --band off")["force_N"];
  const double stepped = run(" --set step.press.move=2mm --write force")["force_N"];
  EXPECT_EQ(plain, stepped);
}

TEST_F(SceneOfSteps, TwoMovesInTheSameDirectionAreAsDeepAsBothTogether) {
  const Json once = run(" --set step.a.move=0,0,-2 --write force"),
             twice = run(" --set step.a.move=0,0,-1 --set step.b.move=0,0,-1 --write force"),
             aside = run(" --set step.a.move=0,0,-2 --set step.b.move=1,0,0 --write force");
  for (const Json* summary : {&once, &twice, &aside})
    EXPECT_EQ((*summary)["requested"]["depth_mm"].get<double>(), 2.0);
  EXPECT_NEAR(twice["force_N"], once["force_N"], 1e-3 * once["force_N"].get<double>());
}

TEST_F(SceneOfSteps, HasErrorBoundsOfItsLargestForceWithoutATurnOrALongSlide) {
  const auto run = [&](const std::string& steps) {
    good(
        "run block.nrrd --force -q -o out --base inferior --indent-at 0,0,top --nodes 1500 --write force "
        "--tool sphere:6mm --set step.press.move=2mm" +
        steps);
    return summary();
  };
  const Json slid = run(" --set step.slide.move=2,0,0 --set step.lift.move=-9mm");
  EXPECT_EQ(slid["force_N"], 0.0);
  const double half = slid["band"]["half_N"], largest = slid["largest_force"]["force_N"];
  EXPECT_GT(half, 0.01 * largest);
  EXPECT_LT(half, 0.2 * largest);
  EXPECT_EQ(slid["verdict"]["accuracy"]["unit"], "%");
  EXPECT_NEAR(slid["verdict"]["accuracy"]["value"], 100.0 * half / largest, 0.01 * 100.0 * half / largest);
  const Table curve = read_csv(folder / "out" / "force.csv");
  for (std::size_t k = 0; k < curve.column[0].size(); ++k) {
    const double force = curve.find("force_N")->at(k);
    EXPECT_LE(curve.find("low_N")->at(k), force);
    EXPECT_GE(curve.find("high_N")->at(k), force);
  }
  const auto unknown = [&](const std::string& steps) { return run(steps)["band"].value("unknown", ""); };
  EXPECT_THAT(unknown(" --set step.slide.move=4,0,0"), HasSubstr("more than 0.5 radii across"));
  EXPECT_THAT(unknown(" --set step.more.move=3.5mm"), HasSubstr("above 0.8 radii of the tool"));
  EXPECT_THAT(unknown(" --set step.lever.turn=0,10,0"), HasSubstr("a tool that turns"));
  EXPECT_THAT(
      unknown(" --set tool.other.shape=sphere:3mm --set tool.other.at=15,0,30 --set step.pinch.moves=other "
              "--set step.pinch.move=1mm"),
      HasSubstr("steps of anything but the tool"));
  EXPECT_THAT(unknown(" --set step.slit.cut=line:-9,9,30,9,9,30,depth=3mm"), HasSubstr("steps that cut"));
}

TEST_F(SceneOfSteps, SaysItsLargestForceWhereTheToolHasLeftTheBodyAgain) {
  const Ran ran = good("run block.nrrd -o out" + scene +
                       " --tool sphere:3mm --write picture,report --set step.press.move=1mm "
                       "--set step.lift.move=-3mm");
  const Json summary = summary_of(folder / "out");
  const Json &largest = summary["largest_force"], &steps = summary["scene"];
  EXPECT_NEAR(summary["force_N"], 0.0, 1e-12);
  EXPECT_EQ(largest["step"], "press");
  EXPECT_NEAR(largest["indentation_mm"], 1.0, 1e-9);
  EXPECT_NEAR(largest["time_s"], 1.0, 1e-9);
  EXPECT_EQ(largest["force_N"], steps[0]["force_N"]);
  EXPECT_EQ(largest["force_N"], steps[0]["largest_force_N"]);
  EXPECT_GE(steps[0]["lateral_force_N"], 0.0);
  EXPECT_THAT(ran.out, testing::StartsWith("largest force "));
  EXPECT_THAT(ran.out, HasSubstr(" mN at 1.00 mm (step 'press'), 0 N at the end"));
  const std::string page = text_of(folder / "out" / "report.html");
  EXPECT_THAT(page, HasSubstr("\"lateral_N\":["));
  EXPECT_THAT(page, Not(HasSubstr("[\"\\u003c 1\",\"N\""))) << "no force is less than 1 N but nothing";
  // The picture shows the frame with the largest force, with colours of displacements.
  const auto is_dark = [](int r, int g, int b) { return r > 55 && r < 160 && g < 60 && b > 70 && b < 125; };
  EXPECT_GT(fraction_of_pixels(folder / "out" / "overview.png", is_dark), 1e-4);
}

TEST_F(SceneOfSteps, ADraggedToolIsPulledBack) {
  const Json summary = run(" --set step.press.move=2mm --set step.drag.move=1,0,0 --write all");
  const auto on_tool = summary["scene"][1]["force_on_tool_N"].get<std::vector<double>>();
  EXPECT_LT(on_tool[0], -0.1 * std::abs(on_tool[2]));
  const Table curve = read_csv(folder / "out" / "force.csv");
  ASSERT_NE(curve.find("aside_x_mm"), nullptr);
  EXPECT_NEAR(curve.find("aside_x_mm")->back(), 1.0, 1e-9);
  EXPECT_NEAR(curve.find("aside_z_mm")->back(), 0.0, 1e-9);
  EXPECT_NEAR(summary["indentation_mm"], 2.0, 1e-9);
}

TEST_F(SceneOfSteps, StepsOfOneLineAreDoneInItsOrder) {
  write_scene("step = { press = { move_mm = [1] }, aside = { move_mm = [0.5, 0, 0] } }\n");
  const Json scene = run(" --config scene.toml --write force")["scene"];
  ASSERT_EQ(scene.size(), 2u);
  EXPECT_EQ(scene[0]["name"], "press");
}

// The limit of force evaluations grows with the length of the scene.
TEST_F(SceneOfSteps, ALongSceneEndsAsItsFirstStepsDo) {
  std::string steps = " --write force --set solver.evaluations=100";
  for (const char* name : {"1", "2", "3", "4", "5", "6"})
    steps += std::string(" --set step.press") + name + ".move=0.5mm --set step.lift" + name + ".move=-0.5mm";
  const Json scene = run(steps)["scene"];
  ASSERT_EQ(scene.size(), 12u);
  const double first = scene[0]["force_N"], last = scene[10]["force_N"];
  EXPECT_NEAR(last, first, 1e-3 * first);
}

// Lee and Radok 1960: at constant depth the contact is constant, and the force relaxes like the modulus. The
// first step is so fast that nothing relaxes during it.
TEST_F(SceneOfSteps, AToolThatIsHeldLosesItsForceAsTheTissuesModulusDoes) {
  const std::string held =
      " --write force --band off --set step.press.move=2mm --set "
      "step.press.time=0.001s --set step.hold.time=20s";
  const auto at_a_millisecond = [](const std::vector<double>& time) {
    return static_cast<std::size_t>(
        std::find_if(time.begin(), time.end(), [](double t) { return t > 0.00099; }) - time.begin());
  };
  for (const std::string tool : {"", " --tool sphere:5mm", " --tool sphere:5mm --friction 0.3"}) {
    SCOPED_TRACE(tool);
    const std::string words = held + tool;
    run(words + " --set material.prony_g=0.5 --set material.prony_tau_s=5");
    const Table curve = read_csv(folder / "out" / "force.csv");
    const std::vector<double>&time = *curve.find("time_s"), &force = *curve.find("force_N");
    const std::size_t pressed = at_a_millisecond(time);
    ASSERT_NEAR(time[pressed], 0.001, 1e-9);
    EXPECT_NEAR(time.back(), 20.001, 1e-9);
    ASSERT_GT(time.size(), pressed + 5);
    for (std::size_t k = pressed; k < time.size(); ++k)
      EXPECT_NEAR(force[k] / force[pressed], 0.5 + 0.5 * std::exp(-(time[k] - 0.001) / 5.0), 4e-3) << time[k];
    run(words);
    const Table elastic = read_csv(folder / "out" / "force.csv");
    EXPECT_EQ(elastic.find("time_s")->back(), time.back());
    const std::vector<double>& its = *elastic.find("force_N");
    EXPECT_NEAR(its.back() / its[at_a_millisecond(*elastic.find("time_s"))], 1.0, 1e-3);
  }
}

// A step's own time has the effect of the corresponding speed; the summary reports its end.
TEST_F(SceneOfSteps, LastAsLongAsTheySayAndRelaxMeanwhile) {
  const std::string tissue =
      " --write force --band off --set material.prony_g=0.5 --set material.prony_tau_s=5";
  const double slow = run(tissue + " --rate 0.1mm/s --set step.a.move=2mm")["force_N"];
  const Json timed = run(tissue + " --set step.a.move=2mm --set step.a.time=20s --set step.b.move=-1mm");
  EXPECT_NEAR(timed["scene"][0]["force_N"].get<double>() / slow, 1.0, 1e-6);
  EXPECT_NEAR(timed["scene"][0]["time_s"], 20.0, 1e-9);
  EXPECT_NEAR(timed["scene"][1]["time_s"], 21.0, 1e-9) << "at 1 mm/s, as nobody said otherwise";
  EXPECT_LT(slow, 0.9 * run(tissue + " --set step.a.move=2mm")["force_N"].get<double>());
  EXPECT_GT(timed["real_time_factor"], 0.0);
  EXPECT_THAT(timed["verdict"]["energy"]["reasons"].dump(), HasSubstr("relaxation"));
  const auto said = [&](const std::string& options) {
    return dimple(folder, "run block.nrrd -o out --force --write force --nodes 600" + options).err;
  };
  EXPECT_THAT(said(" --set step.quick.move=1mm --set step.quick.time=0.001s"),
              HasSubstr("'quick' lasts 0.001 s"));
  EXPECT_THAT(said(" --set step.slow.move=1mm --set step.slow.time=100s"), Not(HasSubstr("' lasts")));
  // A hold may name a tool that does not move.
  const Json named =
      run(" --write force --band off --tool sphere:5mm --set tool.o.shape=sphere:4mm --set "
          "tool.o.at=20,0,30 --set step.a.move=1mm --set step.b.moves=o --set step.b.time=5s");
  EXPECT_NEAR(named["scene"][1]["time_s"], 6.0, 1e-9);
}

// A tool in the air has no force and does no work.
TEST_F(SceneOfSteps, AToolThatHasLeftDoesNoWork) {
  run(" --tool sphere:5mm --friction 0.3 --write force --band off --set step.press.move=2mm --set "
      "step.slide.move=2,0,0 "
      "--set step.back.move=-2,0,0 --set step.lift.move=-3mm");
  const Table curve = read_csv(folder / "out" / "force.csv"),
              energy = read_csv(folder / "out" / "energy.csv");
  const std::vector<double>&times = *energy.find("time_s"), &work = *energy.find("external_work_J"),
        &depth = *energy.find("indentation_mm");
  const auto force_at = [&](double t) {
    const std::vector<double>& time = *curve.find("time_s");
    const auto row = std::min_element(time.begin(), time.end(),
                                      [&](double a, double b) { return std::abs(a - t) < std::abs(b - t); });
    return (*curve.find("force_N"))[static_cast<std::size_t>(row - time.begin())];
  };
  const double most = *std::max_element(work.begin(), work.end());
  std::size_t apart = 0;
  for (std::size_t k = 1; k < times.size(); ++k) {
    const double before = force_at(times[k - 1]), now = force_at(times[k]);
    if (before != 0.0 && now != 0.0) continue;
    ++apart;
    const double displacement = 1e-3 * (depth[k] - depth[k - 1]), done = work[k] - work[k - 1];
    EXPECT_LE(std::abs(done), std::abs(displacement) * std::max(before, now) + 1e-18) << k;
    EXPECT_GE(done * displacement, -1e-18) << "pushed it takes work, lifted it gives it back";
  }
  EXPECT_GT(apart, 2u);
  EXPECT_NEAR(work.back(), energy.find("dissipated_J")->back(), 0.05 * most) << "all of it went as heat";
}

TEST_F(SceneOfSteps, RequireALongToolOnlyWhereTheyPressItIn) {
  const std::string tool = " --tool sphere:3mm --write force --band off ";
  EXPECT_EQ(run(tool + "--set step.a.move=-8mm")["force_N"], 0.0);
  EXPECT_EQ(run(tool + "--set support.s.on=left --set step.a.moves=s --set step.a.move=7,0,0")["force_N"],
            0.0);
  for (const char* approach : {"8mm", "0,0,-8"})
    refused(2, "run block.nrrd --force -o deep" + scene + tool + "--set step.a.move=" + approach,
            {"pressed in by 8.00 mm, and is 6.00 mm long"});
}

TEST_F(SceneOfSteps, WhatMakesNoSceneIsRefusedInWords) {
  const std::string all = "run block.nrrd -o out" + scene + " --set";
  refuses(all, {{2, "step.a.move=1,2", {"step.a.move_mm", "2 numbers"}},
                {2, "step.a.move=0,0,0", {"moves by zero"}},
                {2, "step.a.move=1 --set step.a.time=-1s", {"step.time_s"}},
                {2,
                 "step.a.move=1 --set step.b.cut=plane:0,0,10,1,0,0,radius=5mm --set step.b.time=1s",
                 {"cuts, and lasts"}},
                {2, "step.a.move=2 --depth 3mm", {"a depth of 3", "steps", "--depth"}},
                {2, "step.a.move=2 --rate 10m/s", {"too fast"}},
                {2, "step.a.move=2 --set step.b.time=20s --rate 10m/s", {"too fast"}},
                {2, "step.a.move=-1 --contact frictionless", {"frictionless", "pulls"}}});
  refuses(all, {{2, "step.a.moves=retractor --set step.a.move=1,0,0", {"step.a.moves", "which is not there"}},
                {2, "step.a.moves=tool", {"moves nothing", "time_s alone to hold"}},
                {2, "step.a.time=5s", {"holds, and no step moves anything"}},
                {2, "step.a.mvoe=2", {"step.a.mvoe"}}});
  EXPECT_FALSE(fs::exists(folder / "out" / "force.csv"));
}

}  // namespace
}  // namespace dimple
