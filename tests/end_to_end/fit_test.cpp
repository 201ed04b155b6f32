// `dimple fit` and `dimple run --compare` through the real program.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "io/table.hpp"
#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using testing::HasSubstr;

class Fit : public InFolder {
 protected:
  const std::string block = std::string(DIMPLE_SAMPLE_DATA) + "/block_3mm.nrrd";

  Json summary(const std::string& out) const { return Json::parse(text_of(folder / out / "summary.json")); }
};

TEST_F(Fit, FindsTheModulusOfACurveMadeWithAnotherCloud) {
  good("run " + block +
       " -o made --write force --nodes 2000 --seed 2 --mu 300 --depth 4mm --frames 8 --band off");
  const Ran ran = good("fit " + block + " -o out --curve made/force.csv");
  EXPECT_THAT(ran.out, testing::MatchesRegex("mu [0-9.]+ Pa, [0-9.]+ to [0-9.]+ \\(noise \\+-[0-9.]+ %, "
                                             "discretisation \\+-[0-9.]+ %\\)\tout\n"));
  EXPECT_THAT(ran.err, HasSubstr("the band leaves out the base"));
  const Json s = summary("out");
  EXPECT_NEAR(s["mu_Pa"].get<double>(), 300.0, 6.0);
  EXPECT_LT(s["mu_low_Pa"].get<double>(), 300.0);
  EXPECT_GT(s["mu_high_Pa"].get<double>(), 300.0);
  EXPECT_EQ(s["runs"], 1);
  EXPECT_EQ(s["depth_mm"], 4.0);
  for (const char* name : {"fit.png", "fit.svg", "fitted.toml"})
    EXPECT_GT(fs::file_size(folder / "out" / name), 100u) << name;
  const Table table = read_csv(folder / "out" / "fit.csv");
  EXPECT_THAT(table.header, testing::ElementsAre("indentation_mm", "measured_N", "model_N", "residual_N"));

  // What was fitted runs again and gives the curve that was fitted.
  good("run --config out/fitted.toml -o again --write force --band off --compare made/force.csv");
  EXPECT_NEAR(read_csv(folder / "again" / "force.csv").find("force_N")->back(), table.find("model_N")->back(),
              1e-3 * table.find("model_N")->back());
  EXPECT_NEAR(summary("again")["compare"]["mean_ratio"].get<double>(), 1.0, 0.02);
  good("fit " + block + " -o out --curve made/force.csv -q");
}

TEST_F(Fit, FindsOgdensExponentOfACurveMadeWithAnotherCloud) {
  const std::string cloud = " --nodes 300 --frames 3";
  good("run " + block + " -o made --write force --seed 2 --depth 5mm" + cloud +
       " --set material.ogden_mu_Pa=300 --set material.ogden_alpha=-4.7");
  good("fit " + block + " -o out --curve made/force.csv --of mu,alpha" + cloud);
  const Json s = summary("out");
  EXPECT_NEAR(s["numbers"]["alpha"]["value"].get<double>(), -4.7, 0.47) << s;
  EXPECT_NEAR(s["mu_Pa"].get<double>(), 300.0, 30.0);
  EXPECT_LE(s["runs"].get<int>(), 25);
  EXPECT_EQ(s["band_of"], "noise alone") << "300 nodes are too few for a band";
  EXPECT_THAT(s["discretisation_unknown"].get<std::string>(), HasSubstr("from 1000 nodes on"));
}

TEST_F(Fit, RefusesWhatItCannotDo) {
  std::ofstream(folder / "good.csv") << "indentation_mm,force_N\n0,0\n1,0.01\n2,0.02\n3,0.03\n";
  std::ofstream(folder / "one.csv") << "indentation_mm,force_N\n0,0\n1,0.01\n";
  std::ofstream(folder / "bad.csv") << "indentation,force_N\n1,0.01\n2,0.02\n";
  std::ofstream(folder / "nan.csv") << "indentation_mm,force_N\n1,nan\n2,0.02\n";
  std::ofstream(folder / "time.csv") << "indentation_mm,force_N,time_s\n1,0.01,1\n2,0.02,2\n3,0.03,9\n";
  const auto refused = [&](const std::string& arguments, int code, const std::string& word) {
    SCOPED_TRACE(arguments);
    const Ran ran = dimple(folder, "fit " + block + " -o out --nodes 300 " + arguments);
    EXPECT_EQ(ran.code, code) << ran.err;
    EXPECT_THAT(ran.err, HasSubstr(word));
    EXPECT_FALSE(fs::exists(folder / "out" / "fit.csv"));
  };
  refused("--curve nothere.csv", 3, "nothere.csv");
  refused("--curve bad.csv", 3, "no column indentation_mm");
  refused("--curve nan.csv", 3, "nan");
  refused("--curve one.csv", 3, "1 row");
  refused("--curve time.csv", 3, "constant speed");
  refused("--curve good.csv --of mu,g,tau", 3, "no column time_s");
  refused("--curve good.csv --of nu", 2, "--of");
  refused("--curve good.csv --depth 3mm", 2, "as deep as the curve");
  refused("--curve good.csv --mu 200", 2, "what is looked for");
  refused("--curve good.csv --time explicit", 2, "inertia");
  refused("--curve good.csv --set tissue.1.mu=900Pa", 2, "several tissues");
  refused("--curve horton2007", 2, "never tuned");
  refused("", 2, "--curve");
}

TEST_F(Fit, NeverTakesTheFolderOfARun) {
  std::ofstream(folder / "good.csv") << "indentation_mm,force_N\n0,0\n1,0.01\n2,0.02\n";
  good("run " + block + " -o out --write force --nodes 300 --depth 1mm --frames 1");
  const std::string before = text_of(folder / "out" / "summary.json");
  EXPECT_EQ(dimple(folder, "fit " + block + " -o out --nodes 300 --curve good.csv").code, 6);
  EXPECT_EQ(text_of(folder / "out" / "summary.json"), before);
}

TEST_F(Fit, ARunDrawsAMeasuredCurveBesideItsOwnAndChangesNothingElse) {
  const std::string run = "run " + block + " --nodes 500 --depth 1mm --frames 2";
  good(run + " -o plain --write picture");
  std::ofstream(folder / "measured.csv") << "indentation_mm,force_mN\n0,0\n0.5,6\n1,11\n2,30\n1,10\n";
  const Ran ran = good(run + " -o out --write picture --compare measured.csv");
  EXPECT_THAT(ran.err, HasSubstr("compare  measured.csv: measured / ours 1."));
  EXPECT_THAT(ran.err, HasSubstr("1 row deeper than this run is not compared"));
  EXPECT_THAT(ran.err, HasSubstr("1 of 5 rows"));
  EXPECT_EQ(text_of(folder / "out" / "force.csv"), text_of(folder / "plain" / "force.csv"));
  EXPECT_NE(text_of(folder / "out" / "overview.png"), text_of(folder / "plain" / "overview.png"));
  const Table table = read_csv(folder / "out" / "compare.csv");
  EXPECT_EQ(table.rows(), 2u);
  const Json compared = summary("out")["compare"];
  EXPECT_EQ(compared["file"], "measured.csv");
  EXPECT_EQ(compared["depth_mm"], 1.0);
  EXPECT_TRUE(compared["inside_band"].is_null()) << "500 nodes have no band";
  EXPECT_FALSE(summary("plain").contains("compare"));

  good(run + " -o out --force --write force");
  EXPECT_FALSE(fs::exists(folder / "out" / "compare.csv"));
}

TEST_F(Fit, ARunRefusesABadCurveBeforeItReadsTheImage) {
  std::ofstream(folder / "bad.csv") << "indentation_mm,force\n1,0.01\n2,0.02\n";
  const Ran ran = dimple(folder, "run nothere.nrrd -o out --compare bad.csv");
  EXPECT_EQ(ran.code, 3);
  EXPECT_THAT(ran.err, HasSubstr("no column force_N"));
  const Ran paper =
      good("run " + block + " -o paper --write force --nodes 300 --frames 2 --compare horton2007");
  EXPECT_THAT(paper.err, HasSubstr("left hemisphere"));
}

}  // namespace
}  // namespace dimple
