// `dimple verify`, as its users start it.

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/end_to_end/program.hpp"

namespace dimple {
namespace {

TEST(Verify, ListsItsCases) {
  const Ran ran = dimple(fresh_folder(), "verify --list");
  EXPECT_EQ(ran.code, 0) << ran.err;
  for (const char* name : {"homogeneous", "hayes", "scene_a", "scene_b", "cook"})
    EXPECT_NE(ran.out.find(name), std::string::npos) << name;
}

TEST(Verify, ComputesOneCaseAndWritesItsTables) {
  const auto folder = fresh_folder();
  const Ran ran = dimple(folder, "verify --case viscoelastic -o out -q");
  EXPECT_EQ(ran.code, 0) << ran.err;
  EXPECT_NE(ran.out.find("shear stress after 2 s"), std::string::npos) << ran.out;
  EXPECT_EQ(text_of(folder / "out" / "verify.csv").rfind("name,case,ours,reference", 0), 0u);
  EXPECT_EQ(text_of(folder / "out" / "verify.md").rfind("| case |", 0), 0u);
}

TEST(Verify, PrintsJson) {
  const Ran ran = dimple(fresh_folder(), "verify --case viscoelastic --json -q");
  EXPECT_EQ(ran.code, 0) << ran.err;
  const auto json = nlohmann::json::parse(ran.out);
  EXPECT_EQ(json["status"], "ok");
  EXPECT_EQ(json["cases"].size(), 6u);
}

TEST(Verify, RefusesACaseThatItDoesNotKnow) {
  const Ran ran = dimple(fresh_folder(), "verify --case viscoelasticity");
  EXPECT_EQ(ran.code, 2);
  EXPECT_NE(ran.err.find("viscoelastic"), std::string::npos) << ran.err;
}

}  // namespace
}  // namespace dimple
