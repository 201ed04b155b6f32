// Membranes, from a user's options to the files of a run.

#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/whole_files.hpp"

namespace dimple {
namespace {

// A block of 60 x 60 x 30 mm with the tool in the middle of its superior face.
class AMembrane : public InFolder {
 protected:
  const std::string scene =
      " --base inferior --indent-at 0,0,top --frames 2 --mu 2kPa --nodes 700 --depth 2mm --write force";

  void SetUp() override { make_block(); }
  Json run(const std::string& options) const {
    good("run block.nrrd --force -q -o out" + scene + options);
    return summary();
  }
  double force(const std::string& options) const { return run(options)["force_N"].get<double>(); }
};

TEST_F(AMembrane, ByOneFlagIsTheOneOfThatNameInAFile) {
  const Json by_flag = run(" --membrane 0.1mm:400kPa");
  const std::string curve = text_of(folder / "out" / "force.csv");
  EXPECT_NEAR(by_flag["membranes"]["surface"]["stiffness_N_per_m"], 40.0, 1e-9);
  EXPECT_NEAR(by_flag["membranes"]["surface"]["area_mm2"], 14400.0, 0.1 * 14400.0) << "its edges are round";
  EXPECT_THAT(text_of(folder / "out" / "config.resolved.toml"), HasSubstr("membrane = \"0.1mm:400kPa\""));
  std::ofstream(folder / "pia.toml") << "[membrane.pia]\nthickness_mm = 0.1\nmu_Pa = 4e5\n";
  const Json by_file = run(" --config pia.toml");
  EXPECT_EQ(text_of(folder / "out" / "force.csv"), curve);
  EXPECT_EQ(by_file["membranes"]["pia"]["mu_Pa"], 4e5);
  EXPECT_EQ(by_file["membranes"]["pia"]["wrinkles"], true);
  run(" --config out/config.resolved.toml");
  EXPECT_EQ(text_of(folder / "out" / "force.csv"), curve) << "repeated by what the run has written";
}

TEST_F(AMembrane, NeverSoftensTheBodyAndResistsTheMoreTheMoreItCovers) {
  const std::string pia = " --set membrane.pia.thickness=0.1mm --set membrane.pia.mu=400kPa";
  const double bare = force(""), top = force(pia + " --set membrane.pia.on=superior"), all = force(pia);
  EXPECT_GT(top, 1.01 * bare);
  EXPECT_GT(all, top);
  EXPECT_GE(force(pia + " --set membrane.pia.on=inferior"), 0.9999 * bare) << "on the base it does nothing";
  EXPECT_LT(force(pia + " --set membrane.pia.on=inferior"), 1.01 * bare);
  EXPECT_GT(force(" --set membrane.skin.tension=2N/m"), bare);
}

TEST_F(AMembrane, WithoutTensionLeavesTheBodyWhereItIsAndWithTensionDrawsItTogether) {
  EXPECT_FALSE(run(" --membrane 0.1mm:400kPa").contains("loads"));
  EXPECT_GT(run(" --set membrane.skin.tension=2N/m")["loads"]["settled_mm"], 0.01);
}

// The membrane is a thousand times as stiff within its plane as across it, where a sphere presses. The
// displacement by a contact force does not follow from the in-plane stiffness; once no equilibrium was found.
TEST_F(AMembrane, AsStiffAsAPiaIsPressedInByASphere) {
  const std::string sphere = " --tool sphere:5mm", film = " --membrane 1mm:400kPa";
  const double bare = force(sphere);
  const Json covered = run(sphere + film);
  const double known = covered["force_N"].get<double>();
  EXPECT_GT(known, 1.5 * bare);
  EXPECT_LT(known, 4.0 * bare);
  EXPECT_NEAR(force(sphere + film + " --set solver.step_radii=0.05"), known, 0.01 * known);
  EXPECT_NEAR(force(sphere + film + " --friction 0.3"), known, 0.05 * known);
}

// Its tension does no work on tissue that does not move with it, and with nu 0 no pressures are solved for.
TEST_F(AMembrane, OfWeakTensionComesToRestOnTissueOfAnyRatio) {
  const double bare = force(" --nu 0");
  EXPECT_NEAR(force(" --nu 0 --set membrane.skin.tension=0.001N/m"), bare, 0.01 * bare);
}

TEST_F(AMembrane, IsReportedAndItsErrorBoundsAreUnknown) {
  const Ran ran = good("run block.nrrd -o out" + scene + " --membrane 0.1mm:400kPa");
  EXPECT_THAT(ran.err, HasSubstr("membrane surface: 0.10 mm of 400 kPa (40.0 N/m), on "));
  EXPECT_THAT(ran.out, HasSubstr("no error estimate: not calibrated for membranes"));
}

TEST_F(AMembrane, GivesTheSameBitsWithAnyNumberOfThreads) {
  std::string one;
  for (const char* threads : {"1", "2", "3"}) {
    run(std::string(" --membrane 0.1mm:1.2MPa --threads ") + threads);
    const std::string curve = text_of(folder / "out" / "force.csv");
    if (one.empty()) one = curve;
    EXPECT_EQ(curve, one) << threads;
  }
}

TEST_F(AMembrane, ThatIsNotUnderstoodIsRefusedInWords) {
  const std::string start = "run block.nrrd -o no -q";
  refuses(start + " --membrane", {{2, "0.1mm", {"'0.1mm'", "thickness:shear modulus", "0.1mm:400kPa"}},
                                  {2, "400kPa:0.1mm", {"400kPa is not allowed", "--membrane"}},
                                  {2, "0:400kPa", {"'surface'", "has no thickness"}},
                                  {2, "0.1mm:4kPa --set membrane.surface.tension=1N/m", {"is given twice"}}});
  refuses(start + " --set", {{2, "membrane.pia.thickness=0.1mm", {"'pia'", "has no modulus"}},
                             {2, "membrane.pia.on=all", {"neither stiffness nor tension"}},
                             {2, "membrane.pia.tension=-2N/m", {"tension_N_per_m = -2N/m is not allowed"}},
                             {2, "membrane.pia.tension=2kPa", {"'kPa' is not one of its units"}},
                             {2, "membrane.pia.thicknes=1", {"there is no option 'membrane.pia.thicknes'"}}});
  refuses(start + " --set membrane.pia.tension=2N/m --set",
          {{2, "membrane.pia.on=lleft", {"'lleft'", "names no part of the surface"}},
           {2, "membrane.pia.on=500,0,0,1", {"meets no part of the surface"}}});
  EXPECT_FALSE(fs::exists(folder / "no" / "force.csv"));
}

}  // namespace
}  // namespace dimple
