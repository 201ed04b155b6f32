// `dimple stress` through the real program.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>
#include <tuple>

#include "io/file.hpp"
#include "tests/end_to_end/program.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const std::string small_map =
    "stress -o out --x material.nu=0.3,0.499 --y cloud.nodes=150,200 --finest 400,300 --schemes converging "
    "--set load.depth=1mm --set solver.frames=2";

int counted(const Ran& ran, const std::string& what) {
  return nlohmann::json::parse(ran.out).at(what).get<int>();
}

TEST(Stress, DrawsAMapOfTwoOptionsWithACodeForEveryCell) {
  const fs::path folder = fresh_folder();
  const Ran ran = dimple(folder,
                         "stress -o out --x material.nu=0.3,0.499 --y load.depth=1mm,2mm --finest 400,300 "
                         "--set cloud.nodes=200");
  ASSERT_EQ(ran.code, 0) << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("survive"));
  const std::string csv = text_of(folder / "out" / "stress_own.csv");
  EXPECT_THAT(csv, testing::StartsWith("scheme,material.nu,load.depth_mm,code,"));
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 1 + 2 * 2 * 2) << csv;
  for (const char* words : {"converging,0.3,1mm,", "horton2007,0.499,2mm,", "--set cloud.nodes=200"})
    EXPECT_THAT(csv, HasSubstr(words));
  const std::string svg = text_of(folder / "out" / "stress_own.svg");
  for (const char* words :
       {"material.nu and load.depth_mm: converging", "horton2007", "0.499", "2mm", "cells"})
    EXPECT_THAT(svg, HasSubstr(words));
  EXPECT_GT(fs::file_size(folder / "out" / "stress_own.png"), 1000u);
  EXPECT_THAT(text_of(folder / "out" / "stress.csv"), HasSubstr("own,converging,4,"));
}

TEST(Stress, ASecondCallRunsNothingThatIsThere) {
  const fs::path folder = fresh_folder();
  const Ran first = dimple(folder, small_map + " --json");
  ASSERT_EQ(first.code, 0) << first.err;
  EXPECT_EQ(counted(first, "runs"), counted(first, "now"));
  const std::string csv = text_of(folder / "out" / "stress_own.csv");
  const Ran second = dimple(folder, small_map + " --json");
  ASSERT_EQ(second.code, 0) << second.err;
  EXPECT_EQ(counted(second, "now"), 0);
  EXPECT_EQ(text_of(folder / "out" / "stress_own.csv"), csv);
  // One more column: its runs only.
  std::string wider = small_map;
  wider.replace(wider.find("0.3,0.499"), 9, "0.3,0.45,0.499");
  const Ran third = dimple(folder, wider + " --json");
  ASSERT_EQ(third.code, 0) << third.err;
  EXPECT_EQ(counted(third, "now"), counted(third, "runs") - counted(first, "runs"));
  // Other settings: what is there belongs to others.
  const Ran fourth = dimple(folder, small_map + " --json --set material.mu=300");
  ASSERT_EQ(fourth.code, 0) << fourth.err;
  EXPECT_EQ(counted(fourth, "now"), counted(fourth, "runs"));
}

TEST(Stress, GivesTheSameBytesWhateverTheThreadsAndInterruptions) {
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, small_map + " --threads 1").code, 0);
  const std::string csv = text_of(folder / "out" / "stress_own.csv");
  const std::string svg = text_of(folder / "out" / "stress_own.svg");
  fs::rename(folder / "out", folder / "first");
  std::vector<std::string> words;
  std::istringstream text(small_map + " --threads 2");
  for (std::string word; text >> word;) words.push_back(word);
  {
    Program program(folder, words);
    while (program.running() && program.err_so_far().find("finished") == std::string::npos)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    program.send(SIGINT);
    const Ran ran = program.wait();
    EXPECT_THAT(ran.code, testing::AnyOf(130, 0)) << ran.err;
  }
  ASSERT_EQ(dimple(folder, words).code, 0);
  EXPECT_EQ(text_of(folder / "out" / "stress_own.csv"), csv);
  EXPECT_EQ(text_of(folder / "out" / "stress_own.svg"), svg);
}

TEST(Stress, SweepsTheScenesOfAnImage) {
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom brain.nrrd --spacing 3").code, 0);
  const Ran ran =
      dimple(folder,
             "stress brain.nrrd -o out --x cloud.jitter=0,0.5 --y cloud.nodes=200,300 --finest 500 "
             "--schemes converging --set load.depth=1mm --set solver.frames=2");
  ASSERT_EQ(ran.code, 0) << ran.err;
  EXPECT_THAT(text_of(folder / "out" / "stress_own.csv"), HasSubstr("dimple run brain.nrrd -o out --set"));
}

TEST(Stress, ARunWithoutTimeOrWithoutAModelIsACellWithItsCode) {
  const fs::path folder = fresh_folder();
  const Ran late = dimple(folder, small_map + " --limit 0.001");
  ASSERT_EQ(late.code, 0) << late.err;
  EXPECT_THAT(late.out, HasSubstr("0 of   4 survive: time-out 4"));
  // With more time they are run again.
  EXPECT_THAT(dimple(folder, small_map).out, testing::Not(HasSubstr("time-out")));
  // A circle larger than the block has no model.
  const Ran none = dimple(
      folder,
      "stress -o none --x boundary.indenter_diameter=10,90 --y cloud.nodes=150,200 --schemes converging "
      "--finest 300 --set load.depth=1mm --set solver.frames=2");
  ASSERT_EQ(none.code, 0) << none.err;
  EXPECT_THAT(text_of(folder / "none" / "stress_own.csv"), HasSubstr("converging,90,150,no-model,"));
}

TEST(Stress, DeepBelowASharpRimPointsTurnInsideOut) {
  const fs::path folder = fresh_folder();
  const Ran ran = dimple(folder,
                         "stress -o out --x material.nu=0.3,0.499 --y load.depth=10.5mm,21mm --finest 600 "
                         "--schemes converging --set cloud.nodes=300");
  ASSERT_EQ(ran.code, 0) << ran.err;
  const std::string csv = text_of(folder / "out" / "stress_own.csv");
  EXPECT_THAT(csv, HasSubstr("converging,0.3,21mm,inverted,"));
  EXPECT_THAT(csv, testing::Not(HasSubstr("converging,0.3,10.5mm,inverted,")));
}

TEST(Stress, ATimeStepAboveTheStableOneIsTakenBackAndItsCellIsThatOfTheShorterStep) {
  const fs::path folder = fresh_folder();
  const Ran ran =
      dimple(folder,
             "stress -o out --x solver.safety=0.9,2 --y cloud.nodes=150,200 --finest 300 --schemes "
             "horton2007 --set load.depth=0.2mm --set solver.frames=2");
  ASSERT_EQ(ran.code, 0) << ran.err;
  const std::string csv = text_of(folder / "out" / "stress_own.csv");
  const auto row = [&](const std::string& safety) {
    const auto at = csv.find("\nhorton2007," + safety + ",200,");
    return at == std::string::npos ? std::string() : csv.substr(at + 1, csv.find('\n', at + 1) - at - 1);
  };
  const auto column = [](const std::string& text, int number) {
    std::istringstream in(text);
    std::string cell;
    for (int k = 0; k <= number; ++k) std::getline(in, cell, ',');
    return cell;
  };
  constexpr int code = 3, force = 4, retries = 15;
  EXPECT_EQ(column(row("2"), code), column(row("0.9"), code));
  EXPECT_NEAR(std::stod(column(row("2"), force)), std::stod(column(row("0.9"), force)),
              2e-3 * std::stod(column(row("0.9"), force)));
  EXPECT_EQ(column(row("0.9"), retries), "0");
  EXPECT_EQ(column(row("2"), retries), "1");
}

TEST(Stress, RefusesBeforeTheFirstRun) {
  const fs::path folder = fresh_folder();
  ASSERT_EQ(dimple(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3").code, 0);
  const std::string axes = " --x material.nu=0.3,0.4 --y cloud.nodes=200,300";
  const std::vector<std::tuple<std::string, int, std::string>> wrong = {
      {"stress", 2, "no folder for the maps"},
      {"stress -o out --map depht-nu", 2, "there is no map 'depht-nu', did you mean 'depth-nu'?"},
      {"stress -o out --x material.nu=0.3,0.4", 2, "a map of one side"},
      {"stress -o out --x material.nu=0.3,0.4 --y material.nu=0.3,0.4", 2, "both axes are material.nu"},
      {"stress -o out --x material.nu=0.3,0.8 --y cloud.nodes=200,300", 2,
       "material.nu = 0.8 is not allowed"},
      {"stress -o out --map depth-nu" + axes, 2, "both a map's name and axes"},
      {"stress block.nrrd -o out", 2, "an image was given, but no axes"},
      {"stress block.nrrd -o out --x phantom.height_mm=5,10 --y cloud.nodes=200,300", 2,
       "the height of an image cannot be swept"},
      {"stress gone.nrrd -o out" + axes, 3, "gone.nrrd"},
      {"stress -o out --schemes horton" + axes, 2, "'horton' is not known"},
      {"stress -o out --finest 50" + axes, 2, "50 nodes are too few"},
      {"stress -o out --limit 0" + axes, 2, "--limit"},
      {"stress -o . " + axes, 6, "not results of dimple stress"}};
  for (const auto& [command, code, words] : wrong) {
    const Ran ran = dimple(folder, command);
    EXPECT_EQ(ran.code, code) << command << "\n" << ran.err;
    EXPECT_THAT(ran.err, HasSubstr(words)) << command;
    EXPECT_EQ(fs::exists(folder / "out"), code == 3)
        << command << ": one word of what is wrong with the image";
    fs::remove_all(folder / "out");
  }
}

TEST(Stress, WhatARunRefusesIsSaidOnceInItsWords) {
  const fs::path folder = fresh_folder();
  const Ran ran = dimple(folder,
                         "stress -o out --x material.nu=0.3,0.4 --y cloud.nodes=200,300 --finest 300 "
                         "--set image.label=7");
  EXPECT_EQ(ran.code, 3) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("no voxel has label 7"));
}

TEST(Stress, ListsItsMaps) {
  const fs::path folder = fresh_folder();
  const Ran ran = dimple(folder, "stress --list");
  EXPECT_EQ(ran.code, 0);
  for (const char* name :
       {"depth-nu", "support-nodes", "jitter-points", "step-depth", "circle-nodes", "layer-nodes"})
    EXPECT_THAT(ran.out, HasSubstr(name));
}

}  // namespace
}  // namespace dimple
