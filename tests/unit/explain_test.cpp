// Changes that --explain makes to a contacting tool, and their effect on its force with few nodes. The
// program itself uses more nodes: see contacting_tool_test.

#include "apps/studies/explain.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <map>

#include "apps/run/tool.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "tests/helpers/folder.hpp"
#include "tests/helpers/scene_with.hpp"

namespace dimple {
namespace {

using testing::ElementsAre;

constexpr double no_slip_friction = std::numeric_limits<double>::infinity();

// Lines "choice: instead".
std::vector<std::string> lines(const ToolShape& shape, double friction) {
  std::vector<std::string> result;
  for (const ToolChoice& choice : tool_choices(shape, friction))
    result.push_back(choice.what + ": " + choice.instead);
  return result;
}

TEST(ToolChoices, AreOfWhatTheToolHas) {
  EXPECT_THAT(
      lines(sphere_shape(5e-3), 0.0),
      ElementsAre("tool's radius: 5.10 mm instead of 5.00 mm", "tool's radius: 4.90 mm instead of 5.00 mm",
                  "friction: with friction 0.3 instead of without friction",
                  "friction: without slip instead of without friction"));
  const ToolShape punch = punch_shape(5e-3, 1e-3);
  EXPECT_THAT(
      lines(punch, 0.3),
      ElementsAre("tool's radius: 5.10 mm instead of 5.00 mm", "tool's radius: 4.90 mm instead of 5.00 mm",
                  "tool's edge: 1.20 mm instead of 1.00 mm", "tool's edge: 0.80 mm instead of 1.00 mm",
                  "friction: without friction instead of with friction 0.3",
                  "friction: without slip instead of with friction 0.3"));
  const ToolShape drawn = drawn_shape(std::make_shared<const ToolMesh>());
  EXPECT_THAT(lines(drawn, no_slip_friction),
              ElementsAre("friction: without friction instead of without slip",
                          "friction: with friction 0.3 instead of without slip"));
}

TEST(ToolChoices, ChangeOneThingAlone) {
  const ToolShape punch = punch_shape(5e-3, 1e-3);
  for (const ToolChoice& choice : tool_choices(punch, 0.2)) {
    const int changes =
        (choice.shape.radius != punch.radius) + (choice.shape.edge != punch.edge) + (choice.friction != 0.2);
    EXPECT_EQ(changes, 1) << choice.what << choice.instead;
    if (choice.what == "friction") EXPECT_EQ(choice.all, "none, 0.3 or stuck");
  }
  EXPECT_EQ(tool_choices(punch, 0.0).back().all, "0.3 or stuck");
}

TEST(ToolChoices, AreNeverALengthThatAToolCannotHave) {
  const ToolShape ball_end = punch_shape(5e-3, 5e-3), sharp = punch_shape(5e-3, 0.5e-3),
                  ball = capsule_shape(5e-3, 10e-3);
  for (const ToolShape& shape : {ball_end, sharp, ball})
    for (const ToolChoice& choice : tool_choices(shape, 0.0)) {
      EXPECT_LE(choice.shape.edge, choice.shape.radius) << choice.instead;
      if (shape.edge > 0.0) EXPECT_GE(choice.shape.edge, (1.0 - 0.021) * sharpest_edge * choice.shape.radius);
      if (shape.length > 0.0) EXPECT_GE(choice.shape.length, 2.0 * choice.shape.radius);
    }
  EXPECT_EQ(lines(ball_end, 0.0).size(), 4u) << "wider, a sharper edge, two frictions";
  EXPECT_EQ(lines(ball, 0.0).size(), 3u);
}

// The explanation is stopped before the base is changed: all of it takes a minute in the program.
TEST(Explain, OfASphereReportsWhatItsRadiusDoesOnTheSameNodesAndWhatFrictionDoes) {
  const Scene scene = scene_with({{"image.file", DIMPLE_SAMPLE_DATA "/block_3mm.nrrd"},
                                  {"tool.shape", "sphere:5mm"},
                                  {"load.depth_mm", "1"}});
  const Explanation explanation = explain(scene, 400, [](const std::string& line) {
    if (line.find("without slip instead") != std::string::npos) ask_to_stop(StopReason::interrupted);
  });
  forget_stop();
  std::map<std::string, double> effect;
  for (const Alternative& a : explanation.alternatives) {
    EXPECT_EQ(a.failed, "") << a.what;
    effect[a.what + ": " + a.instead] = a.effect;
  }
  EXPECT_EQ(effect.count("contact: frictionless instead of bonded"), 0u) << "that is the circle's";
  // The force is nearly proportional to the square root of the radius; the block is 18 contact radii thick.
  const ToolShape sphere = sphere_shape(5e-3), larger = sphere_shape(5.1e-3);
  const double up = *half_space_force(larger, 1e-3) / *half_space_force(sphere, 1e-3) - 1.0;
  EXPECT_NEAR(up, 0.01, 1e-3);
  EXPECT_NEAR(effect.at("tool's radius: 5.10 mm instead of 5.00 mm"), up, 0.5 * up);
  EXPECT_NEAR(effect.at("tool's radius: 4.90 mm instead of 5.00 mm"), -up, 0.5 * up);
  const double frictional = effect.at("friction: with friction 0.3 instead of without friction"),
               no_slip = effect.at("friction: without slip instead of without friction");
  EXPECT_GT(frictional, 0.0);
  EXPECT_LT(frictional, 0.03);
  EXPECT_NEAR(no_slip, frictional, 0.01);
  EXPECT_TRUE(effect.count("steps of the load: 0.05 instead of 0.1 radii of the tool"));

  const std::filesystem::path folder = fresh_folder();
  write_explanation(folder, explanation, "block");
  const std::string picture = read_file(folder / "explain.svg");
  for (const char* bar : {">tool's radius<", ">2 % larger or smaller<", ">friction<", ">0.3 or stuck<"})
    EXPECT_TRUE(picture.find(bar) != std::string::npos) << bar;
  EXPECT_EQ(picture.find("circle"), std::string::npos);
}

TEST(Explain, SaysInItsChartTheDepthOfAnEffectAboveTheRunsOwn) {
  Explanation e;
  e.force = 0.0472, e.depth_mm = 5.0, e.nodes = 1000, e.noise = 0.01;
  e.alternatives.push_back({.what = "contact",
                            .instead = "frictionless instead of bonded",
                            .all = "frictionless",
                            .depth_mm = 3.75,
                            .effect = -0.127,
                            .deeper = "the tissue passed a limit point deeper"});
  e.alternatives.push_back(
      {.what = "base", .instead = "held to 15 mm", .all = "held less", .depth_mm = 5.0, .effect = -0.05});
  const std::filesystem::path folder = fresh_folder();
  write_explanation(folder, e, "block");
  const std::string picture = read_file(folder / "explain.svg");
  for (const char* note : {">frictionless, at 3.75 mm<", ">held less<"})
    EXPECT_TRUE(picture.find(note) != std::string::npos) << note;
}

}  // namespace
}  // namespace dimple
