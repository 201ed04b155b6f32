// Tests of `dimple fit` and `dimple run --compare` through the real program.

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

class Fit : public InFolder {
 protected:
  const std::string block = std::string(DIMPLE_SAMPLE_DATA) + "/block_3mm.nrrd";
};

TEST_F(Fit, FindsTheModulusOfACurveMadeWithOtherNodes) {
  good("run " + block +
       " -o made --write force --nodes 2000 --seed 2 --mu 300 --depth 4mm --frames 8 --band off");
  const Ran ran = good("fit " + block + " -o out --curve made/force.csv");
  EXPECT_THAT(ran.out, testing::MatchesRegex("mu [0-9.]+ Pa, [0-9.]+ to [0-9.]+ \\(noise \\+-[0-9.]+ %, "
                                             "discretisation \\+-[0-9.]+ %\\); mu [0-9.]+ to [0-9.]+ Pa with "
                                             "the first contact 0.10 mm off\tout\n"));
  EXPECT_THAT(ran.err, HasSubstr("the error bounds exclude the base"));
  const Json s = summary("out");
  EXPECT_NEAR(s["mu_Pa"], 300.0, 6.0);
  EXPECT_LT(s["mu_low_Pa"], 300.0);
  EXPECT_GT(s["mu_high_Pa"], 300.0);
  EXPECT_EQ(s["runs"], 1);
  EXPECT_EQ(s["depth_mm"], 4.0);
  for (const char* name : {"fit.png", "fit.svg", "fitted.toml"})
    EXPECT_GT(fs::file_size(folder / "out" / name), 100u) << name;
  const Table table = read_csv(folder / "out" / "fit.csv");
  EXPECT_THAT(table.header, testing::ElementsAre("indentation_mm", "measured_N", "model_N", "residual_N"));

  // A run with the fitted options reproduces the fitted curve.
  good("run --config out/fitted.toml -o again --write force --band off --compare made/force.csv");
  EXPECT_NEAR(read_csv(folder / "again" / "force.csv").find("force_N")->back(), table.find("model_N")->back(),
              1e-3 * table.find("model_N")->back());
  EXPECT_NEAR(summary("again")["compare"]["mean_ratio"], 1.0, 0.02);
  good("fit " + block + " -o out --curve made/force.csv -q --force");
}

// ---------------------------------------------------------------------------------------- contacting tool

// Force of a sphere [N] on a half-space of 231 Pa and nu 0.499 (Sneddon 1965, by its series), or on a layer
// that is stiffer by a factor.
double on_half_space(double radius, double depth) {
  const double x = depth / radius, plane_modulus = 2.0 * 231.0 / (1.0 - 0.499);
  return 4.0 / 3.0 * plane_modulus * std::sqrt(radius) * std::pow(depth, 1.5) *
         (1.0 - x / 10.0 - x * x / 840.0);
}

// The contact is a hundredth as wide as the block is thick; such forces are within 2 % of finite elements.
TEST_F(Fit, OfASphereGivesTheModulusOfSneddonsHalfSpaceBack) {
  good("phantom big.nrrd --shape block --size 100,100,50 --spacing 2 -q");
  std::ofstream curve(folder / "curve.csv");
  curve << "indentation_mm,force_N\n";
  curve << 0.001 << ',' << on_half_space(5e-3, 1e-6) << '\n';
  for (int k = 1; k <= 6; ++k) curve << 0.01 * k << ',' << on_half_space(5e-3, 1e-5 * k) << '\n';
  curve.close();
  const Ran ran = good("fit big.nrrd -o out --curve curve.csv --tool sphere:5mm --nu 0.499 --nodes 800");
  EXPECT_THAT(ran.out,
              testing::MatchesRegex("mu [0-9.]+ Pa, [0-9.]+ to [0-9.]+ by noise only \\(.*discretisation "
                                    "unknown\\); mu [0-9.]+ to [0-9.]+ Pa with the first contact "
                                    "0.0150 mm off\tout\n"));
  EXPECT_THAT(ran.err, HasSubstr("check    the formula of Hertz and Sneddon for a half-space"));
  const Json s = summary("out");
  EXPECT_NEAR(s["mu_Pa"], 231.0, 0.02 * 231.0);
  EXPECT_NEAR(s["half_space_check"]["mu_Pa"], 231.0, 1e-3 * 231.0);
  EXPECT_GT(s["half_space_check"]["thickness_in_contact_radii"], 80.0);
  // Before the first equilibrium, too, the force grows as depth^1.5 and not linearly.
  const Table rows = read_csv(folder / "out" / "fit.csv");
  EXPECT_NEAR(rows.find("model_N")->front() / rows.find("measured_N")->front(), 1.0, 0.3);
}

// The layer is bonded to its base; the contact radius is 0.1 to 0.3 of its thickness. The factors are those
// of the integral equation (contact_test). The curve assumes small strains and the model does not: 3 % here.
TEST_F(Fit, OnALayerGivesItsModulusWhereTheFormulaOfAHalfSpaceIsFarTooHigh) {
  good("phantom layer.nrrd --shape block --size 80,80,10 -q");
  std::ofstream curve(folder / "curve.csv");
  curve << "indentation_mm,force_N\n";
  for (const auto& [chi, factor] : {std::pair{0.1, 1.1288}, {0.2, 1.2972}, {0.3, 1.5167}})
    curve << 5.0 * chi * chi << ',' << factor * on_half_space(20e-3, 5e-3 * chi * chi) << '\n';
  curve.close();
  good("fit layer.nrrd -o out --curve curve.csv --tool sphere:20mm --nu 0.499 --nodes 600");
  const Json s = summary("out");
  EXPECT_NEAR(s["mu_Pa"], 231.0, 0.05 * 231.0);
  EXPECT_GT(s["half_space_check"]["mu_Pa"], 1.4 * 231.0);
  EXPECT_NE(s["mu_Pa"], s["half_space_check"]["mu_Pa"]);
}

TEST_F(Fit, OfAContactingToolFindsTheModulusThatItsOwnRunWasGivenWithFrictionAndWithout) {
  for (const char* tool : {"sphere:5mm", "sphere:5mm --friction 0.3 --set solver.tolerance=1e-5",
                           "capsule:3mm,length=20mm --friction stick --set solver.tolerance=1e-5"}) {
    SCOPED_TRACE(tool);
    const std::string scene = std::string(" --nodes 400 --time quasi-static --tool ") + tool;
    good("run " + block + " -o made --force --write force --mu 1Pa --depth 2mm --band off" + scene);
    good("fit " + block + " -o out --force --curve made/force.csv" + scene);
    const Json s = summary("out");
    // The fit's own run has another modulus, not a power of two times this one. Its equilibria differ within
    // their tolerance.
    EXPECT_NEAR(s["mu_Pa"], 1.0, 1e-5);
    EXPECT_EQ(s["runs"], 1);
    // The force grows as depth^1.5, so a tenth of 2 mm changes it by some 7 %.
    EXPECT_NEAR(s["first_touch"]["mu_if_earlier_Pa"], 0.92, 0.03);
    EXPECT_NEAR(s["first_touch"]["mu_if_later_Pa"], 1.09, 0.03);
    EXPECT_THAT(s["not_in_the_band"].get<std::string>(), HasSubstr("its first contact"));
  }
  good("run --config out/fitted.toml -o again --write force --band off --compare made/force.csv");
  EXPECT_NEAR(summary("again")["compare"]["mean_ratio"], 1.0, 1e-5);
}

TEST_F(Fit, FindsTheFirstContactOfASphereWhereItIsRequestedAndElseSaysHowMuchThatMatters) {
  const std::string scene = " --nodes 1000 --time quasi-static --tool sphere:5mm";
  good("run " + block + " -o made --write force --mu 300 --depth 3mm --band off" + scene);
  const Table made = read_csv(folder / "made" / "force.csv");
  std::ofstream moved(folder / "moved.csv");
  moved << "indentation_mm,force_N\n";
  for (std::size_t k = 1; k < made.rows(); ++k)
    moved << (*made.find("indentation_mm"))[k] - 0.1 << ',' << (*made.find("force_N"))[k] << '\n';
  moved.close();
  good("fit " + block + " -o out --curve moved.csv" + scene);
  const Json without = summary("out");
  EXPECT_GT(without["mu_Pa"], 312.0);
  EXPECT_NEAR(without["first_touch"]["mu_if_earlier_Pa"], 300.0, 9.0);
  const Ran ran = good("fit " + block + " -o touch --curve moved.csv --of mu,touch" + scene);
  EXPECT_THAT(ran.out, HasSubstr("touch -0."));
  const Json with = summary("touch");
  EXPECT_NEAR(with["mu_Pa"], 300.0, 12.0);
  EXPECT_NEAR(with["numbers"]["touch"]["value"], -0.1, 0.05);
  EXPECT_EQ(with["runs"], 1);
  EXPECT_FALSE(with.contains("first_touch")) << "it was looked for";
  const std::string fitted = text_of(folder / "touch" / "fitted.toml");  // up to the depth reached
  EXPECT_NEAR(std::stod(fitted.substr(fitted.find("\ndepth_mm = ") + 12)), 3.0, 0.05);
}

TEST_F(Fit, OfAContactingToolHasErrorBoundsWhereItsForceHasThem) {
  good("run " + block +
       " -o made --write force --mu 300 --nodes 2000 --seed 2 --tool sphere:5mm --depth 2mm --band off");
  good("fit " + block + " -o out --curve made/force.csv --tool sphere:5mm --nodes 1500");
  const Json s = summary("out");
  EXPECT_EQ(s["band_of"], "noise and discretisation");
  EXPECT_LT(s["mu_low_Pa"], 300.0);
  EXPECT_GT(s["mu_high_Pa"], 300.0);
  EXPECT_LT(s["discretisation_share"], 0.15) << "as much as the depths say that bear the force";
}

// The curve with half, once and twice its force, in micrometres and millinewtons; the third ends earlier.
TEST_F(Fit, OfManySamplesGivesEachItsModulusAndTheLimitOfGentsLaw) {
  const std::string scene = " --nodes 400 --time quasi-static --tool sphere:8mm";
  good("run " + block +
       " -o made --write force --mu 300 --depth 4mm --frames 12 --band off --set material.gent_limit=0.9" +
       scene);
  const Table made = read_csv(folder / "made" / "force.csv");
  std::ofstream curves(folder / "curves.csv");
  curves << "sample,indentation_um,force_mN\n";
  for (const auto& [sample, factor, rows] :
       {std::tuple{7, 0.5, made.rows()}, {8, 1.0, made.rows()}, {9, 2.0, made.rows() - 3}})
    for (std::size_t k = 0; k < rows; ++k)
      curves << sample << ',' << 1e3 * (*made.find("indentation_mm"))[k] << ','
             << 1e3 * factor * (*made.find("force_N"))[k] << '\n';
  curves << "9,100,0\n";  // its tool goes back
  curves.close();
  const Ran ran =
      good("fit " + block + " -o gent --curve curves.csv --of mu,limit --set accuracy.band=off" + scene);
  EXPECT_THAT(ran.out, HasSubstr("3 samples: median mu"));
  EXPECT_THAT(ran.err, HasSubstr("left out in 1 of 3 samples"));
  const Table fits = read_csv(folder / "gent" / "fits.csv");
  ASSERT_EQ(fits.rows(), 3u);
  EXPECT_THAT(*fits.find("sample"), testing::ElementsAre(7.0, 8.0, 9.0));
  for (std::size_t k = 0; k < 3; ++k) {
    // The curve is made with one value of the limit, and fitted between those of the grid.
    EXPECT_NEAR((*fits.find("mu_Pa"))[k],
                300.0 * (k == 0   ? 0.5
                         : k == 1 ? 1.0
                                  : 2.0),
                k == 2 ? 18.0 : 4.5)
        << k;
    EXPECT_NEAR((*fits.find("limit"))[k], 0.9, 0.05) << k;
    EXPECT_LT((*fits.find("rms_of_largest_force"))[k], 2e-3) << k;
  }
  good("fit " + block + " -o plain --curve curves.csv --set accuracy.band=off" + scene);
  const Table plain = read_csv(folder / "plain" / "fits.csv");
  EXPECT_NEAR((*plain.find("mu_Pa"))[1], 2.0 * (*plain.find("mu_Pa"))[0], 1e-6 * (*plain.find("mu_Pa"))[1]);
  EXPECT_GT((*plain.find("rms_of_largest_force"))[1], 3.0 * (*fits.find("rms_of_largest_force"))[1]);
  EXPECT_EQ(summary("plain")["samples_without_fit"], 0);
  // One sample alone is fitted as a curve is; the row after its largest depth is named in millimetres.
  write("back.csv", "indentation_mm,force_N\n1,0.01\n2,0.03\n3,0.06\n1,0\n");
  EXPECT_THAT(good("fit " + block + " -o back --curve back.csv --set accuracy.band=off" + scene).err,
              HasSubstr("after the largest depth of 3 mm"));
  refused(2, "fit " + block + " -o no --curve curves.csv --of mu,g,tau" + scene,
          {"a Prony term is sought for many"});
  refused(3, "run " + block + " -o no --compare curves.csv" + scene, {"the file holds 3 curves"});
  refused(2,
          "fit " + block +
              " -o no --curve curves.csv --set accuracy.band=off --nodes 400 --tool sphere:8mm --rate 2m/s",
          {"inertia is not negligible", "Gent's law"});
  EXPECT_FALSE(fs::exists(folder / "no" / "fits.csv"));
}

TEST_F(Fit, AsksForTheUnitsWhereItsModulusIsOfNoSoftTissue) {
  const std::string rows = "0.5,1.2\n1,4.4\n1.5,9.6\n2,16.8\n";
  std::ofstream(folder / "right.csv") << "indentation_mm,force_mN\n" << rows;
  std::ofstream(folder / "wrong.csv") << "indentation_mm,force_N\n" << rows;
  const std::string scene = "fit " + block + " --tool sphere:5mm --nodes 600 --curve ";
  const std::string asks = "is unusual for soft tissue";
  EXPECT_THAT(good(scene + "wrong.csv -o wrong").err, HasSubstr(asks));
  EXPECT_THAT(good(scene + "right.csv -o right").err, testing::Not(HasSubstr(asks)));
}

TEST_F(Fit, RefusesWhatItCannotDo) {
  write("good.csv", "indentation_mm,force_N\n0,0\n1,0.01\n2,0.02\n3,0.03\n");
  write("deep.csv", "indentation_mm,force_N\n0,0\n2,0.02\n4,0.06\n6,0.1\n");
  write("one.csv", "indentation_mm,force_N\n0,0\n1,0.01\n");
  write("bad.csv", "indentation,force_N\n1,0.01\n2,0.02\n");
  write("time.csv", "indentation_mm,force_N,time_s\n1,0.01,1\n2,0.02,2\n3,0.03,9\n");
  refuses("fit " + block + " -o out --nodes 300 --curve",
          {{3, "nothere.csv", {"nothere.csv"}},
           {3, "bad.csv", {"no column indentation_mm"}},
           {3, "one.csv", {"1 row"}},
           {3, "time.csv", {"constant speed"}},
           {3, "good.csv --of mu,g,tau", {"no column time_s"}},
           {2, "good.csv --of nu", {"--of"}},
           {2, "good.csv --depth 3mm", {"as deep as the curve"}},
           {2, "good.csv --mu 200", {"is the unknown"}},
           {2, "horton2007", {"for comparison only"}},
           {3, "deep.csv --tool sphere:2mm", {"the tool is 4.00 mm long"}},
           {2, "deep.csv --tool pyramid:2mm", {"is not known"}},
           {2, "deep.csv --tool sphere:5mm --depth 3mm", {"as deep as the curve"}}});
  refused(2, "fit " + block + " -o out --nodes 300", {"--curve"});
  EXPECT_FALSE(fs::exists(folder / "out" / "fit.csv"));
}

TEST_F(Fit, ARunDrawsAMeasuredCurveNextToItsOwnAndChangesNothingElse) {
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
  EXPECT_TRUE(compared.at("inside_band").is_null()) << "500 nodes have no band";
  EXPECT_FALSE(summary("plain").contains("compare"));

  good(run + " -o out --force --write force");
  EXPECT_FALSE(fs::exists(folder / "out" / "compare.csv"));
}

TEST_F(Fit, ARunRefusesABadCurveBeforeItReadsTheImage) {
  std::ofstream(folder / "bad.csv") << "indentation_mm,force\n1,0.01\n2,0.02\n";
  ends_with(folder, 3, "run nothere.nrrd -o out --compare bad.csv", {"no column force_N"});
  const Ran paper =
      good("run " + block + " -o paper --write force --nodes 300 --frames 2 --compare horton2007");
  EXPECT_THAT(paper.err, HasSubstr("left hemisphere"));
}

}  // namespace
}  // namespace dimple
