// Tests of `dimple compare` through the real program.

#include "io/file.hpp"
#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

class Compare : public InFolder {
 protected:
  void SetUp() override {
    good("phantom body.nrrd --shape block --size 36,36,24 --spacing 3");
    run("body.nrrd", "a", "");
  }

  void run(const std::string& image, const std::string& out, const std::string& more) const {
    good("run " + image + " -o " + out +
         " --nodes 1000 --depth 1mm --frames 4 --indenter-diameter 10mm "
         "--write force --quiet" +
         more);
  }

  Json compared(const std::string& a, const std::string& b) const {
    const Ran ran = good("compare " + a + " " + b + " --json");
    return Json::parse(ran.out);
  }

  Ran refused(const std::string& a, const std::string& b, int code) const {
    const Ran ran = dimple(folder, "compare " + a + " " + b + " -o never.png");
    EXPECT_EQ(ran.code, code) << ran.err;
    EXPECT_EQ(ran.out, "");
    EXPECT_FALSE(fs::exists(folder / "never.png"));
    return ran;
  }
};

TEST_F(Compare, OfRunsThatWroteOtherFilesShowsNoDifference) {
  good(
      "run body.nrrd -o b --nodes 1000 --depth 1mm --frames 4 --indenter-diameter 10mm --write force,nodes "
      "-q");
  EXPECT_EQ(compared("a", "b")["differences"].size(), 0u);
}

// Below the first calibrated depth of a contacting tool the curve's lower bound is zero, and the upper one is
// farther from the force.
TEST_F(Compare, OfContactingToolsShowsTheBoundsOfTheirCurves) {
  for (const char* run : {"one", "other"})
    good(std::string(
             "run body.nrrd --nodes 1500 --depth 1mm --frames 4 --tool sphere:4mm --write force -q -o ") +
         run);
  const Json json = compared("one", "other");
  const Table ours = read_csv(folder / "one/force.csv");
  const std::size_t rows = ours.rows() - 1;  // without the row at rest
  ASSERT_EQ(json["at_depth"].size(), rows);
  for (std::size_t k = 0; k < rows; ++k)
    for (const char* bound : {"low_N", "high_N"})
      EXPECT_NEAR(json["at_depth"][k][std::string("a_") + bound], ours.find(bound)->at(k + 1),
                  1e-9 * ours.find("force_N")->at(k + 1))
          << bound;
  EXPECT_EQ(json["at_depth"][0]["b_low_N"], 0.0);
}

TEST_F(Compare, ShowsThatAnotherModulusIsTheOnlyDifference) {
  run("body.nrrd", "b", " --mu 315");
  const Json json = compared("a", "b");
  EXPECT_EQ(json["same_image"], true);
  ASSERT_EQ(json["differences"].size(), 1u) << json["differences"];
  EXPECT_EQ(json["differences"][0], Json({{"what", "material.mu_Pa"}, {"a", "210.0"}, {"b", "315.0"}}));
  ASSERT_EQ(json["at_depth"].size(), 4u);
  const Table ours = read_csv(folder / "a/force.csv");
  for (std::size_t k = 0; k < 4; ++k) {
    const Json row = json["at_depth"][k];
    EXPECT_NEAR(row["indentation_mm"], ours.find("indentation_mm")->at(k + 1), 1e-12);
    const std::pair<const char*, const char*> columns[] = {
        {"a_force_N", "force_N"}, {"a_low_N", "low_N"}, {"a_high_N", "high_N"}};
    for (const auto& [key, column] : columns)
      EXPECT_NEAR(row[key], ours.find(column)->at(k + 1), 1e-9 * ours.find("force_N")->at(k + 1)) << key;
    // The force is proportional to the modulus.
    EXPECT_NEAR(row["b_force_N"].get<double>() / row["a_force_N"].get<double>(), 1.5, 1e-3);
    EXPECT_EQ(row["bands_overlap"], false);
  }
  const Ran ran = good("compare a b -o both.png");
  EXPECT_THAT(ran.out, HasSubstr("B 50.0 % above A; the error bounds do not overlap"));
  EXPECT_THAT(ran.out,
              testing::ContainsRegex("at 1\\.00 mm: A [0-9]{1,2}\\.[0-9]+ mN, B [0-9]{2}\\.[0-9]+ mN"));
  EXPECT_THAT(ran.out, HasSubstr("differs  material.mu_Pa: A 210.0, B 315.0\n"));
  EXPECT_EQ(text_of(folder / "both.png").substr(1, 3), "PNG");
}

TEST_F(Compare, ARunIsItself) {
  const Ran ran = good("compare a a");
  EXPECT_EQ(ran.err, "");
  EXPECT_THAT(ran.out, HasSubstr("of the same image"));
  EXPECT_THAT(ran.out, HasSubstr("options  no difference\n"));
  EXPECT_THAT(ran.out, HasSubstr("the same force; the error bounds overlap"));
}

TEST_F(Compare, SaysHowManyNodesAnAccuracyHasTakenAndNotHowManyWereNotRequested) {
  good(
      "run body.nrrd -o b --depth 1mm --frames 4 --indenter-diameter 10mm --write force "
      "--quiet --accuracy 20%");
  const auto nodes = Json::parse(read_file(folder / "b/summary.json"))["counts"]["nodes"].get<int>();
  const std::string differences = compared("a", "b")["differences"].dump();
  EXPECT_THAT(differences, Not(HasSubstr("cloud.nodes")));
  EXPECT_EQ(differences.find("chosen nodes") != std::string::npos, nodes != 1000) << differences;
}

TEST_F(Compare, ErrorBoundsOverlapWhereTheyMeetAndNotBeyond) {
  // A larger modulus moves the second interval up; the bounds meet at this ratio of moduli.
  const Json own = compared("a", "a")["at_depth"][3];
  const double fraction = own["a_high_N"].get<double>() / own["a_force_N"].get<double>() - 1.0;
  const double in_contact = (1.0 + fraction) / (1.0 - fraction);
  run("body.nrrd", "near", " --mu " + std::to_string(210.0 * (1.0 + 0.95 * (in_contact - 1.0))));
  run("body.nrrd", "far", " --mu " + std::to_string(210.0 * (1.0 + 1.05 * (in_contact - 1.0))));
  EXPECT_EQ(compared("a", "near")["at_depth"][3]["bands_overlap"], true);
  EXPECT_EQ(compared("far", "a")["at_depth"][3]["bands_overlap"], false);
}

TEST_F(Compare, NeverTakesDifferentImagesForOneWithoutAWord) {
  good("phantom other.nrrd --shape block --size 36,36,27 --spacing 3");
  run("other.nrrd", "b", "");
  const Ran ran = good("compare a b --quiet");
  EXPECT_THAT(ran.out, HasSubstr("DIFFERENT images"));
  EXPECT_THAT(dimple(folder, "compare a b").err, HasSubstr("warning: the runs are of DIFFERENT images"));
  EXPECT_EQ(compared("a", "b")["same_image"], false);
  // A copy under another name is the same image.
  fs::copy_file(folder / "body.nrrd", folder / "renamed.nrrd");
  run("renamed.nrrd", "c", "");
  EXPECT_EQ(compared("a", "c")["same_image"], true);
  // A summary without the image's hash leaves `same_image` null.
  Json summary = Json::parse(text_of(folder / "c/summary.json"));
  summary.erase("image_sha256");
  write_file(folder / "c/summary.json", summary.dump());
  EXPECT_TRUE(compared("a", "c").at("same_image").is_null());
}

TEST_F(Compare, WithoutErrorBoundsItIsNotKnownWhetherTheyOverlap) {
  run("body.nrrd", "b", " --band off");
  const Json row = compared("a", "b")["at_depth"][3];
  EXPECT_TRUE(row.at("bands_overlap").is_null());
  EXPECT_TRUE(row.at("b_low_N").is_null());
  EXPECT_THAT(dimple(folder, "compare a b").out, HasSubstr("B has no error estimate"));
}

TEST_F(Compare, RefusesASceneWhoseToolGoesBackOrAside) {
  good(
      "run body.nrrd -o scene --nodes 1000 --indenter-diameter 10mm --write force --quiet "
      "--set step.press.move=1mm --set step.drag.move=1,0,0");
  EXPECT_THAT(refused("a", "scene", 3).err, HasSubstr("is a scene of steps"));
  EXPECT_THAT(refused("scene", "scene", 3).err, HasSubstr("is a scene of steps"));
}

TEST_F(Compare, RefusesWhatIsNoFinishedRun) {
  EXPECT_THAT(refused("a", "nowhere", 3).err, HasSubstr("there is no folder nowhere"));
  fs::create_directory(folder / "empty");
  EXPECT_THAT(refused("empty", "a", 3).err, HasSubstr("empty holds no run"));
  good("model body.nrrd -o model --nodes 300");
  EXPECT_THAT(refused("a", "model", 3).err, HasSubstr("model holds no run"));
  const std::string summary = text_of(folder / "a/summary.json");
  const auto as = [&](const std::string& key, const Json& value) {
    Json changed = Json::parse(summary);
    changed[key] = value;
    fs::remove_all(folder / "changed");
    fs::copy(folder / "a", folder / "changed");
    write_file(folder / "changed/summary.json", changed.dump());
  };
  as("status", "interrupted");
  EXPECT_THAT(refused("a", "changed", 3).err, HasSubstr("the run in changed is not finished"));
  as("force_N", 1.0);
  EXPECT_THAT(refused("changed", "a", 3).err, HasSubstr("not of one run"));
  as("force_N", nullptr);
  EXPECT_THAT(refused("changed", "a", 3).err, HasSubstr("changed holds no run"));
  write_file(folder / "changed/summary.json", "no JSON");
  EXPECT_THAT(refused("changed", "a", 3).err, HasSubstr("changed holds no run"));
  ends_with(folder, 2, "compare a a -o picture.txt", {".png or .svg"});
}

TEST_F(Compare, SaysWhatACutHasReleasedAsTheWorkBetweenTheTwoCurves) {
  run("body.nrrd", "cut", " --cut plane:0,0,16,0,0,1,radius=10mm");
  const Json reported = compared("a", "cut");
  const auto work = [&](const char* which) {
    double sum = 0.0, depth = 0.0, force = 0.0;
    for (const Json& row : reported["at_depth"]) {
      const double next = 1e-3 * row["indentation_mm"].get<double>(), its = row[which];
      sum += 0.5 * (next - depth) * (its + force);
      depth = next, force = its;
    }
    return sum;
  };
  const Json& released = reported["released_by_cut"];
  const double expected = work("a_force_N") - work("b_force_N"), area = released["area_mm2"];
  EXPECT_GT(expected, 0.0);
  EXPECT_NEAR(released["energy_J"], expected, 0.02 * work("a_force_N"));
  EXPECT_NEAR(area, 3.14159 * 100.0, 10.0);
  EXPECT_NEAR(released["energy_per_area_J_m2"].get<double>() * 1e-6 * area, released["energy_J"], 1e-12);
  EXPECT_EQ(compared("cut", "a")["released_by_cut"], released);
  EXPECT_THAT(dimple(folder, "compare a cut").out, HasSubstr("J/m2"));
  run("body.nrrd", "softer", " --cut plane:0,0,16,0,0,1,radius=10mm --mu 100");
  EXPECT_FALSE(compared("a", "softer").contains("released_by_cut")) << "another tissue";
}

}  // namespace
}  // namespace dimple
