// Rotation of a tool in a step of a scene, through the real program.

#include <Eigen/Geometry>
#include <numbers>

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

const std::string scene =
    "run block.nrrd -q --base inferior --indent-at 0,0,top --nodes 700 --mu 2kPa --band off --frames 2 "
    "--set step.press.move=1.5mm";
const std::string rod = " --tool capsule:3mm,length=30mm";

fs::path with_block() {
  const fs::path folder = fresh_folder();
  good(folder, "phantom block.nrrd --shape block --size 40,40,20 --spacing 2 -q");
  return folder;
}

// Summary of the scene under the rod, run into out/.
Json summary_with(const fs::path& folder, const std::string& options) {
  good(folder, scene + rod + " -o out --force --write force" + options);
  return summary_of(folder / "out");
}

TEST(SceneWithATurn, IsSaidInEachStepAndDrawnInItsPoseAndGivesTheSameBytesAgain) {
  const fs::path folder = with_block();
  const Json summary = summary_with(folder,
                                    ",surface --threads 1 --friction 0.2 --set step.turn.turn=0,0.2618rad,0"),
             step = summary["scene"][1];
  EXPECT_FALSE(summary["scene"][0].contains("turn_deg"));
  EXPECT_NEAR(step["turn_deg"][1], 15.0, 1e-3);
  EXPECT_NEAR(step["turned_deg"][1], 15.0, 1e-3);
  EXPECT_NEAR(step["indentation_mm"], 1.5, 1e-9) << "it turns about its tip";
  EXPECT_LT(summary["energy_error"], 0.01);
  const Table curve = read_csv(folder / "out" / "force.csv");
  EXPECT_NEAR(curve.find("turned_y_deg")->back(), 15.0, 1e-3);
  EXPECT_EQ(curve.find("turned_y_deg")->front(), 0.0);
  EXPECT_NEAR(curve.find("turned_x_deg")->back(), 0.0, 1e-9);

  // The upper end leans towards the patient's left; the tip is where it was pressed to.
  const Json tip = summary["tool"]["first_touch_mm"];
  const SurfaceFile first = read_vtp(folder / "out" / "tool" / "tool_0000.vtp"),
                    last = read_vtp(folder / "out" / "tool" / "tool_0002.vtp");
  const Index top = first.position_mm.cols() - 1;
  EXPECT_NEAR(first.position_mm(0, top), tip[0], 0.01);
  const double angle = 15.0 * std::numbers::pi / 180.0;
  EXPECT_NEAR(last.position_mm(0, top), tip[0].get<double>() + 30.0 * std::sin(angle), 0.01);
  EXPECT_NEAR(last.position_mm(2, top), tip[2].get<double>() - 1.5 + 30.0 * std::cos(angle), 0.01);
  EXPECT_NEAR(last.position_mm(2, 0), tip[2].get<double>() - 1.5, 0.01);

  good(folder, "run block.nrrd --config out/config.resolved.toml -o again -q --threads 2");
  for (const char* file : {"force.csv", "energy.csv"})
    EXPECT_EQ(text_of(folder / "out" / file), text_of(folder / "again" / file));
}

const std::string posed =
    "run block.nrrd -q --base inferior --indent-at 0,0,top --nodes 500 --mu 2kPa --band off "
    "--frames 2 --write force -o posed --force --poses poses.csv";

// The origin of the table is arbitrary: its first row is the tool at first contact.
TEST(PosesOfATool, AreTheStepsFromEachToTheNext) {
  const fs::path folder = with_block();
  const double half = 0.5 * 15.0 * std::numbers::pi / 180.0;
  std::ofstream file(folder / "poses.csv");
  file.precision(17);
  file << "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,5,6,70,1,0,0,0\n1,5,6,68.5,1,0,0,0\n"
       << "2,5,6,68.5,1,0,0,0\n3,5.25,6,68.5," << std::cos(half) << ",0," << std::sin(half) << ",0\n";
  file.close();
  good(folder, posed + rod);
  const std::string steps =
      "--set step.press.move=0,0,-1.5 --set step.press.time=1 --set step.stand.time=1 --set "
      "step.turn.turn=0,15,0 "
      "--set step.turn.move=0.25,0,0 --set step.turn.time=1";
  good(folder,
       "run block.nrrd -q --base inferior --indent-at 0,0,top --nodes 500 --mu 2kPa --band off "
       "--frames 2 --write force -o stepped " +
           steps + rod);
  const Table by_poses = read_csv(folder / "posed" / "force.csv"),
              by_steps = read_csv(folder / "stepped" / "force.csv");
  ASSERT_EQ(by_poses.rows(), by_steps.rows());
  for (const char* name : {"time_s", "indentation_mm", "aside_x_mm", "turned_y_deg", "force_N"})
    for (std::size_t k = 0; k < by_poses.rows(); ++k)
      EXPECT_NEAR((*by_poses.find(name))[k], (*by_steps.find(name))[k],
                  1e-4 * std::abs((*by_steps.find(name)).back()) + 1e-9)
          << name << " " << k;
  EXPECT_EQ(summary_of(folder / "posed")["scene"].size(), 3u) << "a row that goes nowhere holds it there";
  EXPECT_NEAR(by_poses.find("time_s")->back(), 3.0, 1e-9) << "as the table says";
  EXPECT_THAT(
      dimple(folder, std::string(posed).erase(posed.find(" -q"), 3) + rod).err,
      HasSubstr(
          "its first row, at (5.0, 6.0, 70.0) mm, is the first contact of the tool; time starts there"));
  good(folder, "run block.nrrd --config posed/config.resolved.toml -o again -q --write force");
  EXPECT_EQ(text_of(folder / "posed" / "force.csv"), text_of(folder / "again" / "force.csv"));
}

TEST(PosesOfATool, AreRefusedWhereTheyGiveNoPath) {
  const fs::path folder = with_block();
  const std::string places = "time_s,x_mm,y_mm,z_mm\n", turned = "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n";
  const auto refused = [&](const std::string& rows, const RefusedLine& line) {
    std::ofstream(folder / "poses.csv") << rows;
    expect_refusals(folder, posed + rod, {line});
  };
  refused("time_s,depth_mm\n0,0\n1,1\n", {3, "", {"a column of time_s, x_mm, y_mm, z_mm is missing"}});
  refused("time_s,x_mm,y_mm,z_mm,qw\n0,0,0,0,1\n1,0,0,-1,1\n", {3, "", {"a quaternion lacks a column"}});
  refused(turned + "0,0,0,0,1,0,0,0\n1,0,0,-1,2,0,0,0\n",
          {3, "", {"the quaternion in row 2 has the length 2"}});
  refused(turned + "0,0,0,0,1,0,0,0\n1,0,0,-1,1,0,0,0\n2,0,0,-1,0,0,1,0\n",
          {2, "", {"turns by 180 degrees"}});
  refused(places + "0,0,0,0\n", {3, "", {"there are 1 rows"}});
  refused(places + "0,0,0,0\n0,0,0,-1\n", {3, "", {"row 2 is at 0 s, the one before at 0 s"}});
  refused(places + "0,0,0,0\n1,0,0,0\n", {3, "", {"in one place all the time"}});
  const std::string displacement = places + "0,0,0,0\n1,0,0,-1\n";
  refused(displacement, {2, "--set step.a.move=1mm", {"moved by poses and by steps"}});
  refused(displacement, {2, "--rate 2mm/s", {"a rate is given, and poses"}});
  refused(displacement, {2, "--depth 2mm", {"poses, which are steps"}});
}

// The motion is longer than the range of the samples for a straight tool, 4.5 mm.
TEST(SceneWithATurn, AboutAPlaceSinksAndGoesAsideAsThatSays) {
  const fs::path folder = with_block();
  const Json summary = summary_with(folder,
                                    " --set step.turn.turn=-15,0,0 --set step.turn.about=0,0,50 "
                                    "--set step.turn.move=0.3,0,-0.8");
  const auto tip = summary["tool"]["first_touch_mm"].get<std::vector<double>>();
  const Vec3 pressed(tip[0], tip[1], tip[2] - 1.5), about(0, 0, 50);
  const Vec3 turned =
      about + Eigen::AngleAxisd(-15.0 * std::numbers::pi / 180.0, Vec3::UnitX()) * (pressed - about);
  const Table curve = read_csv(folder / "out" / "force.csv");
  EXPECT_NEAR(curve.find("indentation_mm")->back(), tip[2] - turned.z() + 0.8, 1e-6);
  EXPECT_NEAR(curve.find("aside_x_mm")->back(), 0.3, 1e-6);
  EXPECT_NEAR(curve.find("aside_y_mm")->back(), turned.y() - pressed.y(), 1e-6);
  EXPECT_EQ(summary["scene"][1]["about_mm"][2], 50.0);
  EXPECT_GT(std::abs(turned.y()), 7.0);
  EXPECT_GT(summary["force_N"], 0.0);
}

TEST(SceneWithATurn, WhatMakesNoTurnIsRefusedInWords) {
  const fs::path folder = with_block();
  const std::string run = scene + " -o out --write force", turn = "--set step.t.turn=0,9,0 ";
  expect_refusals(
      folder, run + rod,
      {{2, "--set step.t.turn=0,91,0", {"step.t.turn_deg", "91 degrees", "90 degrees at most"}},
       {2, "--set step.t.turn=60,0,70", {"92.2 degrees"}},
       {2, "--set step.t.turn=20deg", {"1 numbers", "rotation vector"}},
       {2, "--set step.t.turn=0,nan,0", {"turn_deg", "finite"}},
       {2, "--set step.t.turn=0,20mm,0", {"turn_deg", "deg, rad"}},
       {2, "--set step.t.turn=0,0,0", {"turns by zero"}},
       {2, "--set step.t.about=0,0,40", {"step.t.about_mm", "does not turn"}},
       {2, turn + "--set step.t.about=0,40", {"step.t.about_mm", "2 numbers"}},
       {2, turn + "--set step.t.about=1e9,0,0", {"step 't'", "the body's size"}},
       {2, turn + "--set support.r.on=15,0,20,5 --set step.t.moves=r", {"turns 'r'", "translate"}},
       {2,
        turn + "--set tool.b.shape=sphere:3mm --set tool.b.at=15,0,20 --set step.t.moves=b",
        {"turns 'b'", "translate"}}});
  expect_refusals(
      folder, run + " --tool capsule:3mm,length=6mm",
      {{2, "--set step.more.move=3.5mm --set step.t.turn=0,60,0", {"along its axis", "longer tool"}}});
  expect_refusals(folder, "run block.nrrd -o out -q --tool sphere:5mm --write force",
                  {{2, turn, {"no step presses it in"}}});
  EXPECT_FALSE(fs::exists(folder / "out" / "force.csv"));
}

TEST(SceneWithATurn, UnderGravityIsTheSameToBothSidesAndUndoneByTheTurnBack) {
  const fs::path folder = with_block();
  const auto forces = [&](const std::string& turns) {
    std::vector<double> force;
    const Json summary = summary_with(folder, " --gravity inferior " + turns);
    for (const Json& step : summary.at("scene")) force.push_back(step.at("force_N"));
    return force;
  };
  const std::vector<double> there =
                                forces("--set step.there.turn=0,15deg,0 --set step.xback.turn=0,-15deg,0"),
                            mirrored = forces("--set step.there.turn=0,-15deg,0");
  ASSERT_EQ(there.size(), 3u);
  ASSERT_EQ(mirrored.size(), 2u);
  EXPECT_NEAR(there[2], there[0], 1e-3 * there[0]);
  EXPECT_NEAR(mirrored[1], there[1], 0.01 * there[1]);
  EXPECT_GT(there[1], 1.03 * there[0]) << "it presses with its side then";
}

}  // namespace
}  // namespace dimple
