// Scenes of several steps, from the words of a user to the files of a run.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "io/table.hpp"
#include "io/types.hpp"
#include "tests/end_to_end/program.hpp"
#include "tests/end_to_end/whole_files.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using testing::HasSubstr;

class SceneOfSteps : public testing::Test {
 protected:
  const fs::path folder = fresh_folder();
  const std::string scene = " --base inferior --indent-at 0,0,top --nodes 600 --mu 2kPa -q";

  void SetUp() override {
    ASSERT_EQ(dimple(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3 -q").code, 0);
  }
  void write_scene(const std::string& text) const { std::ofstream(folder / "scene.toml") << text; }
  Json run(const std::string& options, const std::string& out = "out") const {
    const Ran ran = dimple(folder, "run block.nrrd --force -o " + out + scene + options);
    EXPECT_EQ(ran.code, 0) << options << '\n' << ran.err;
    return Json::parse(text_of(folder / out / "summary.json"));
  }
  void refused(const std::string& arguments, const std::vector<std::string>& words) const {
    const Ran ran = dimple(folder, arguments);
    EXPECT_EQ(ran.code, 2) << arguments << '\n' << ran.err;
    for (const char* part : {"dimple: ", "\n  where: ", "\n  why:   ", "\n  try:   "})
      EXPECT_THAT(ran.err, HasSubstr(part));
    for (const std::string& word : words) EXPECT_THAT(ran.err, HasSubstr(word)) << arguments;
  }
};

// Steps are done in the order of their lines, whatever their names.
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
  EXPECT_NEAR(summary["scene"][0]["indentation_mm"].get<double>(), 2.0, 1e-9);
  EXPECT_NEAR(summary["indentation_mm"].get<double>(), 2.0, 1e-9);
  EXPECT_NEAR(summary["supports"]["retractor"]["moved_mm"][0].get<double>(), 1.5, 1e-9);
  EXPECT_EQ(summary["force_N"], summary["scene"][1]["force_N"]);
  EXPECT_NE(summary["scene"][0]["force_N"], summary["scene"][1]["force_N"]);
  EXPECT_THAT(summary["band"]["unknown"].get<std::string>(), HasSubstr("once"));
  const Table curve = read_csv(folder / "out" / "force.csv");
  for (std::size_t k = 1; k < curve.column[0].size(); ++k)
    EXPECT_GT(curve.find("time_s")->at(k), curve.find("time_s")->at(k - 1));
  EXPECT_NEAR(curve.find("time_s")->back(), 3.5, 1e-9);

  const std::string before = text_of(folder / "out" / "force.csv");
  EXPECT_THAT(text_of(folder / "out" / "config.resolved.toml"), HasSubstr("[step.\"second_press\"]"));
  EXPECT_EQ(dimple(folder, "run --config out/config.resolved.toml -o again -q").code, 0);
  EXPECT_EQ(text_of(folder / "again" / "force.csv"), before);
}

TEST_F(SceneOfSteps, ThePushOfOneStepIsTheRunWithoutSteps) {
  const double plain = run(" --depth 2mm --write force --band off")["force_N"];
  const double stepped = run(" --set step.press.move=2mm --write force")["force_N"];
  EXPECT_EQ(plain, stepped);
}

TEST_F(SceneOfSteps, TwoWaysInTheSameDirectionAreAsDeepAsBothTogether) {
  const Json once = run(" --set step.a.move=0,0,-2 --write force"),
             twice = run(" --set step.a.move=0,0,-1 --set step.b.move=0,0,-1 --write force"),
             aside = run(" --set step.a.move=0,0,-2 --set step.b.move=1,0,0 --write force");
  for (const Json* summary : {&once, &twice, &aside})
    EXPECT_EQ((*summary)["requested"]["depth_mm"].get<double>(), 2.0);
  EXPECT_NEAR(twice["force_N"].get<double>(), once["force_N"].get<double>(),
              1e-3 * once["force_N"].get<double>());
}

TEST_F(SceneOfSteps, ADraggedToolIsPulledBack) {
  const Json summary = run(" --set step.press.move=2mm --set step.drag.move=1,0,0 --write all");
  const auto on_tool = summary["scene"][1]["force_on_tool_N"].get<std::vector<double>>();
  EXPECT_LT(on_tool[0], -0.1 * std::abs(on_tool[2]));
  const Table curve = read_csv(folder / "out" / "force.csv");
  ASSERT_NE(curve.find("aside_x_mm"), nullptr);
  EXPECT_NEAR(curve.find("aside_x_mm")->back(), 1.0, 1e-9);
  EXPECT_NEAR(curve.find("aside_z_mm")->back(), 0.0, 1e-9);
  EXPECT_NEAR(summary["indentation_mm"].get<double>(), 2.0, 1e-9);
}

TEST_F(SceneOfSteps, StepsOfOneLineAreDoneInItsOrder) {
  write_scene("step = { press = { move_mm = [1] }, aside = { move_mm = [0.5, 0, 0] } }\n");
  const Json scene = run(" --config scene.toml --write force")["scene"];
  ASSERT_EQ(scene.size(), 2u);
  EXPECT_EQ(scene[0]["name"], "press");
}

// What bounds the search for equilibrium grows with the scene.
TEST_F(SceneOfSteps, ALongSceneEndsAsItsFirstStepsDo) {
  std::string steps = " --write force --set solver.evaluations=100";
  for (const char* name : {"1", "2", "3", "4", "5", "6"})
    steps += std::string(" --set step.press") + name + ".move=0.5mm --set step.lift" + name + ".move=-0.5mm";
  const Json scene = run(steps)["scene"];
  ASSERT_EQ(scene.size(), 12u);
  const double first = scene[0]["force_N"], last = scene[10]["force_N"];
  EXPECT_NEAR(last, first, 1e-3 * first);
}

TEST_F(SceneOfSteps, WhatMakesNoSceneIsRefusedInWords) {
  const std::string all = "run block.nrrd -o out" + scene;
  refused(all + " --set step.a.moves=retractor --set step.a.move=1,0,0",
          {"step.a.moves", "which is not there"});
  refused(all + " --set step.a.move=1,2", {"step.a.move_mm", "2 numbers"});
  refused(all + " --set step.a.move=0,0,0", {"moves by nothing"});
  refused(all + " --set step.a.moves=tool", {"moves nothing"});
  refused(all + " --set step.a.move=2 --depth 3mm", {"a depth of 3", "steps", "--depth"});
  refused(all + " --set step.a.move=2 --time explicit", {"inertia", "solver.time"});
  refused(all + " --set step.a.move=2 --rate 10m/s", {"too fast"});
  refused(all + " --set step.a.move=1,0,0 --contact frictionless", {"frictionless"});
  refused(all + " --set step.a.move=-1 --contact frictionless", {"frictionless", "pulls"});
  refused(all + " --set step.a.move=2 --compare horton2007", {"--compare", "steps"});
  refused(all + " --set step.a.move=2 --explain", {"--explain", "steps"});
  refused(
      "run block.nrrd -o out --set support.r.on=20,0,30,8 --set support.r.move=1,0,0 --set step.a.move=2 -q",
      {"support.r.move_mm", "one thing moves at a time"});
  refused("export block.nrrd -o out.inp --set step.a.move=2 -q", {"dimple export takes no steps"});
  refused(all + " --set step.a.mvoe=2", {"step.a.mvoe"});
  EXPECT_FALSE(fs::exists(folder / "out" / "force.csv"));
}

}  // namespace
}  // namespace dimple
