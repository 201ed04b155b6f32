// Tests of dimple run --tool: a rigid tool in frictionless contact, through the real program.

#include <numbers>

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

constexpr const char* quick = " -q --nodes 800 --depth 2mm --frames 2";

const char* const shared_data = std::getenv("DIMPLE_SHARED_DATA");
constexpr const char* without_shared_data = "skipped: DIMPLE_SHARED_DATA names no folder with label images";

std::vector<std::string> run_of_shared(const char* image, const std::string& options) {
  std::vector<std::string> words = words_of("-o out -q --write force " + options);
  words.insert(words.begin(), {"run", fs::path(shared_data) / image});
  return words;
}

fs::path with_phantom() {
  const fs::path folder = fresh_folder();
  good(folder, "phantom brain.nrrd --spacing 2 -q");
  return folder;
}

TEST(ContactingTool, ARodIsSofterThanASphereAndASphereThanTheBondedPatch) {
  const fs::path folder = with_phantom();
  double before = 0.0;
  for (const char* tool : {"capsule:2mm,length=20mm", "sphere:5mm", "circle"}) {
    good(folder, std::string("run brain.nrrd -o out --force --write force --tool ") + tool + quick);
    const auto summary = summary_of(folder / "out");
    const double force = summary["force_N"];
    EXPECT_GT(force, before) << tool;
    before = force;
    if (std::string(tool) == "circle") continue;
    EXPECT_GT(summary["tool"]["samples_in_contact"], 3);
    EXPECT_FALSE(summary["counts"].contains("circle_nodes"));
    EXPECT_TRUE(summary["band"].contains("unknown"));
    const Table curve = read_csv(folder / "out" / "force.csv");
    for (const double f : *curve.find("force_N")) EXPECT_GE(f, 0.0);
  }
}

// The contact files must agree with the force curve.
TEST(ContactingTool, SaysAtEachFrameWhatItDoesToEachPartOfTheSurface) {
  const fs::path folder = with_phantom();
  for (const bool frictional : {false, true}) {
    good(folder, std::string("run brain.nrrd -o out --force --write surface --tool sphere:5mm --band off") +
                     (frictional ? " --friction 0.5" : "") + quick);
    const auto tool = summary_of(folder / "out").at("tool");
    const Table curve = read_csv(folder / "out" / "force.csv");
    ASSERT_TRUE(fs::exists(folder / "out" / "contact.pvd"));
    double before = 0.0, slid_before = 0.0;
    for (const int frame : {0, 1, 2}) {
      SCOPED_TRACE(frame);
      const PointFile file = read_vtu(folder / "out" / "contact" / fmt::format("contact_{:04d}.vtu", frame));
      const auto of = [&](const char* name) { return file.find(name)->values; };
      const Vec3 on_body = of("force_N").rowwise().sum();
      const std::vector<double>&depth = *curve.find("indentation_mm"), &z = *curve.find("force_z_N");
      const auto at = std::find_if(depth.begin(), depth.end(), [&](double d) { return d > frame - 1e-6; });
      EXPECT_NEAR(on_body.z(), -z[static_cast<std::size_t>(at - depth.begin())], 1e-5 * std::abs(z.back()));
      const Index in_contact = (of("contact").array() > 0.0).count();
      EXPECT_EQ(in_contact == 0, frame == 0);
      EXPECT_GE(of("pressure_Pa").minCoeff(), 0.0);
      EXPECT_GE(of("pressure_Pa").maxCoeff(), before);
      before = of("pressure_Pa").maxCoeff();
      EXPECT_EQ((of("contact").array() == 2.0).any(), frictional && frame > 0);
      EXPECT_EQ(file.find("slid_mm") != nullptr, frictional);
      if (frictional) {
        const double slid = of("slid_mm").sum();  // a point that slid farthest may be held by now
        EXPECT_EQ(slid > slid_before + 1e-3, frame > 0) << slid;
        EXPECT_LT(of("slid_mm").maxCoeff(), frame + 1e-9) << "than the tool's own way";
        slid_before = slid;
        for (Index s = 0; s < file.position_mm.cols(); ++s)
          if (of("contact")(0, s) == 0.0) EXPECT_EQ(of("slid_mm")(0, s), 0.0);
      }
      if (frame < 2) continue;
      EXPECT_EQ(file.position_mm.cols(), tool.at("contact_samples"));
      EXPECT_EQ(in_contact, tool.at("samples_in_contact"));
      EXPECT_NEAR(before, tool.at("largest_pressure_Pa"), 1e-5 * before);
      double area = 0.0, held = 0.0;
      for (Index s = 0; s < file.position_mm.cols(); ++s) {
        area += of("contact")(0, s) > 0.0 ? of("area_mm2")(0, s) : 0.0;
        held += of("contact")(0, s) == 2.0 ? of("area_mm2")(0, s) : 0.0;
      }
      if (frictional) EXPECT_NEAR(held, tool.at("sticking_area_mm2"), 1e-5 * area);
      EXPECT_NEAR(area, tool.at("contact_area_mm2"), 1e-5 * area);
      EXPECT_LT(before, 4.0 * on_body.norm() / (1e-6 * area))
          << "the middle of a contact bears some twice its mean";
    }
  }
  // A later run with the bonded patch removes these files.
  good(folder, std::string("run brain.nrrd -o out --force --write surface --band off") + quick);
  EXPECT_FALSE(fs::exists(folder / "out" / "contact.pvd"));
  EXPECT_FALSE(fs::exists(folder / "out" / "contact"));
}

TEST(ContactingTool, WithoutSlipTheBodyGoesBackToWhereItWas) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom block.nrrd --shape block --size 60,60,30 -q");
  good(folder,
       "run block.nrrd -o out --tool sphere:5mm --friction stick --nodes 1500 --write force "
       "--band off -q --set step.press.move=2mm --set step.slide.move=2,0,0 --set "
       "step.back.move=-2,0,0");
  const Table curve = read_csv(folder / "out" / "force.csv");
  const std::vector<double>&t = *curve.find("time_s"), &x = *curve.find("force_x_N"),
        &z = *curve.find("force_z_N");
  const auto at = [&](double time) {
    return static_cast<std::size_t>(
        std::find_if(t.begin(), t.end(), [&](double s) { return s > time - 1e-6; }) - t.begin());
  };
  EXPECT_GT(-x[at(4.0)], 0.9 * z[at(4.0)]) << "it is drawn along";
  EXPECT_LT(std::abs(x.back()), 0.02 * z.back());
  EXPECT_NEAR(z.back(), z[at(2.0)], 0.01 * z.back());
}

TEST(ContactingTool, IsNeverWhereAnotherOneIs) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3 -q");
  const std::string two = "run block.nrrd -o out --tool sphere:5mm --write force --nodes 800 -q --depth ";
  const std::string other = " --set tool.o.shape=sphere:5mm --set tool.o.at=";
  ends_with(folder, 2, two + "1mm" + other + "6,0,30", {"would both be at"});
  ends_with(folder, 5, two + "1mm" + other + "11,0,30 --set tool.o.move=-4,0,-1", {"tools-overlap"});
  // The remaining results are those of the last accepted equilibrium.
  const auto until_then = summary_of(folder / "out");
  const Table curve = read_csv(folder / "out" / "force.csv");
  EXPECT_EQ(until_then.at("force_N"), curve.find("force_N")->back());
  for (const char* axis : {"x", "y", "z"})
    EXPECT_EQ(until_then["other_tools"]["o"]["force_on_tool_N"][static_cast<std::size_t>(*axis - 'x')],
              curve.find(fmt::format("o_force_{}_N", axis))->back());
  good(folder, two + "1mm --force" + other + "14,0,30 --set tool.o.move=1,0,-1 --set tool.o.friction=0.3");
  const auto next_to = summary_of(folder / "out").at("other_tools").at("o");
  EXPECT_GT(next_to.at("friction_heat_J"), 0.0);
  EXPECT_NEAR(next_to.at("slipping_area_mm2").get<double>() + next_to.at("sticking_area_mm2").get<double>(),
              next_to.at("contact_area_mm2"), 1e-6);
  // The moment about the tip: friction acts a little above it, so it is at most the force times the radius.
  double force = 0.0, moment = 0.0;
  for (const int k : {0, 1, 2}) {
    force += std::pow(next_to.at("force_on_tool_N")[k].get<double>(), 2);
    moment += std::pow(next_to.at("moment_on_tool_Nm")[k].get<double>(), 2);
  }
  EXPECT_GT(moment, 0.0);
  EXPECT_LT(std::sqrt(moment), 5e-3 * std::sqrt(force));
}

// The edge of the punch meets a slope, and the nodes are too far apart for so small an edge.
TEST(ContactingTool, APunchThatTheSurfacePenetratesEndsWithAReasonAndNotWithAForce) {
  const fs::path folder = with_phantom();
  ends_with(folder, 5, std::string("run brain.nrrd -o out --write force --tool punch:5mm,edge=0.5mm") + quick,
            {"penetration"});
}

TEST(ContactingTool, IsRefusedOnAnyPathThatPressesItInByMoreThanItsLength) {
  std::vector<RefusedLine> lines;
  for (const char* displacement :
       {"--depth 12mm", "--set step.a.move=12mm", "--set step.a.move=0,0,-6 --set step.b.move=0,0,-6",
        "--set step.a.move=5mm --set step.b.move=0,0,-7"})
    lines.push_back({2, displacement, {"is 10.00 mm long"}});
  expect_refusals(with_phantom(), "run brain.nrrd -o out --nodes 600 --tool capsule:2mm,length=10mm", lines);
}

TEST(ContactingTool, GoesInByAFractionOfItsRadiusWhereNoDepthIsGivenAndSaysSo) {
  const fs::path folder = with_phantom();
  const Ran ran =
      good(folder, "run brain.nrrd -o out --write force --tool sphere:2mm --nodes 800 --frames 2");
  expect_words(ran.err, {"1.60 mm, 0.8 of its radius, as no --depth was given"});
  EXPECT_NEAR(summary_of(folder / "out")["requested"]["depth_mm"].get<double>(), 1.6, 1e-12);
  // The file of options states all of them, among them the default displacement of the bonded patch.
  good(folder, "run brain.nrrd --config out/config.resolved.toml -o again -q");
  EXPECT_EQ(text_of(folder / "out" / "force.csv"), text_of(folder / "again" / "force.csv"));
  // A given depth is used even if it is the default of the bonded patch.
  EXPECT_EQ(dimple(folder, "run brain.nrrd -o deep --tool sphere:2mm --depth 8mm -q").code, 2);
}

TEST(ContactingTool, HasErrorBoundsAroundItsForceAtEveryDepth) {
  const fs::path folder = with_phantom();
  good(folder, "run brain.nrrd -o out --write force --tool sphere:5mm --depth 2mm --frames 4 -q");
  const Table curve = read_csv(folder / "out" / "force.csv");
  const auto &force = *curve.find("force_N"), &low = *curve.find("low_N"), &high = *curve.find("high_N");
  ASSERT_GT(force.size(), 3u);
  std::vector<double> fraction;
  for (std::size_t k = 1; k < force.size(); ++k) {
    EXPECT_NEAR(0.5 * (high[k] + low[k]), force[k], 1e-9 * force[k]);
    fraction.push_back(0.5 * (high[k] - low[k]) / force[k]);
    EXPECT_GT(fraction.back(), 0.01);
    EXPECT_LT(fraction.back(), 0.2);
  }
  EXPECT_GT(fraction.front(), fraction.back()) << "where fewer nodes touch less is known";
}

// Node sets in which first contact was at a node much stiffer than its neighbours.
TEST(ContactingTool, FindsItsFirstContactWithALiverOfFewNodes) {
  if (!shared_data) GTEST_SKIP() << without_shared_data;
  good(fresh_folder(), run_of_shared("abdomen_mr_3mm.nii.gz",
                                     "--label 5 --tool sphere:2mm --nodes 750 --set accuracy.band=off"));
}

TEST(ContactingTool, MayBeWiderThanTheOrganAsItsContactFindsRoom) {
  const fs::path folder = with_phantom();
  good(folder,
       "run brain.nrrd -o out --write force --tool sphere:100mm --depth 0.5mm --nodes 800 --frames 2 -q");
}

// Writes a ball as text STL, 10 mm wide, without its last triangles.
void write_ball(const fs::path& file, int without = 0, bool inward = false) {
  constexpr int sides = 60, rings = sides / 2;
  const auto at = [&](int r, int k) {
    const double polar = std::numbers::pi * r / rings, around = 2.0 * std::numbers::pi * (k % sides) / sides;
    return fmt::format("vertex {:.9g} {:.9g} {:.9g}\n", 5.0 * std::sin(polar) * std::cos(around),
                       5.0 * std::sin(polar) * std::sin(around), 5.0 * std::cos(polar));
  };
  std::vector<std::string> faces;
  for (int r = 0; r < rings; ++r)
    for (int k = 0; k < sides; ++k) {
      const int a = inward ? k + 1 : k, b = inward ? k : k + 1;
      if (r > 0) faces.push_back(at(r, a) + at(r + 1, k) + at(r, b));
      if (r + 1 < rings) faces.push_back(at(r, k + 1) + at(r + 1, a) + at(r + 1, b));
    }
  std::ofstream out(file);
  out << "solid ball\n";
  for (std::size_t t = 0; t + static_cast<std::size_t>(without) < faces.size(); ++t)
    out << "facet normal 0 0 0\nouter loop\n" << faces[t] << "endloop\nendfacet\n";
  out << "endsolid ball\n";
}

TEST(ContactingTool, MayBeDrawnAndABallThatWasIsASphere) {
  const fs::path folder = with_phantom();
  write_ball(folder / "ball.stl");
  std::vector<double> force;
  for (const char* tool : {"ball.stl", "sphere:5mm"}) {
    good(folder,
         std::string("run brain.nrrd -o out --force --write force,picture,surface --tool ") + tool + quick);
    const auto summary = summary_of(folder / "out");
    force.push_back(summary["force_N"]);
    if (force.size() > 1) continue;
    EXPECT_EQ(summary["tool"]["file"], "ball.stl");
    EXPECT_NEAR(summary["tool"]["volume_mm3"], 523.6, 5.0);
    EXPECT_NE(summary["band"]["unknown"].get<std::string>(), "");
  }
  EXPECT_NEAR(force[0], force[1], 0.02 * force[1]);
  // The sphere's curve is fitted with the ball, for which no half-space formula is available.
  const Ran fit = good(folder,
                       "fit brain.nrrd -o fit --curve out/force.csv --tool ball.stl --nodes 800 -q "
                       "--time quasi-static");
  const auto fitted = summary_of(folder / "fit");
  EXPECT_NEAR(fitted["mu_Pa"], 210.0, 0.02 * 210.0);
  EXPECT_FALSE(fitted.contains("half_space_check"));
  EXPECT_NE(fitted["discretisation_unknown"].get<std::string>(), "");
}

TEST(ContactingTool, WhoseTrianglesFaceInwardIsTurnedAndSaysSo) {
  const fs::path folder = with_phantom();
  write_ball(folder / "ball.stl");
  write_ball(folder / "inward.stl", 0, true);
  const std::string run = "run brain.nrrd --write force --nodes 800 --depth 1mm --frames 1 --tool ";
  const Ran right = dimple(folder, run + "ball.stl -o right"),
            turned = dimple(folder, run + "inward.stl -o turned");
  ASSERT_EQ(turned.code, 0) << turned.err;
  EXPECT_THAT(right.err, Not(HasSubstr("faced inward")));
  EXPECT_THAT(turned.err, HasSubstr("faced inward"));
}

TEST(ContactingTool, AFileThatIsNoToolIsRefusedWithThePlaceBeforeAnythingIsBuilt) {
  const fs::path folder = with_phantom();
  write_ball(folder / "open.stl", 1);
  std::ofstream(folder / "words.STL") << "solid\nfacet normal 0 0 0\n outer loop\n  vertex 0 0 much\n";
  const std::string run = "run brain.nrrd -o out --tool";
  expect_refusals(folder, run,
                  {{3, "open.stl", {"has an open border of 3 edges"}},
                   {3, "words.STL", {"words.STL cannot be read"}},
                   {3, "nowhere.stl", {"nowhere.stl"}}});
  EXPECT_THAT(dimple(folder, run + " words.STL").err, Not(HasSubstr("vtk")));
  EXPECT_FALSE(fs::exists(folder / "out"));
}

TEST(ContactingTool, GoesInStepsAsItsConfigurationSaysAndGivesTheSameBytesAgain) {
  const fs::path folder = with_phantom();
  const std::string scene =
      "run brain.nrrd --write force --nodes 1000 --frames 3 --tool sphere:5mm --friction 0.2 "
      "--set step.press.move=1mm --set step.slide.move=2,0,0 --set step.lift.move=-3mm";
  const Ran ran = good(folder, scene + " -o out --threads 1");
  EXPECT_THAT(ran.err, HasSubstr("the tool lost contact: the last contact"));
  const auto summary = summary_of(folder / "out");
  EXPECT_TRUE(summary["band"].contains("unknown"));
  const Table curve = read_csv(folder / "out" / "force.csv");
  double largest = 0.0;
  for (std::size_t k = 0; k < curve.rows(); ++k) {
    const double force = curve.find("force_N")->at(k);
    EXPECT_GE(force, 0.0);
    largest = std::max(largest, force);
  }
  EXPECT_EQ(curve.find("aside_x_mm")->back(), 2.0);
  EXPECT_NEAR(curve.find("indentation_mm")->back(), -2.0, 1e-9);
  EXPECT_LT(curve.find("force_N")->back(), 1e-5 * largest);
  good(folder, "run brain.nrrd --config out/config.resolved.toml -o again -q --threads 2");
  for (const char* file : {"force.csv", "energy.csv"})
    EXPECT_EQ(text_of(folder / "out" / file), text_of(folder / "again" / file));
}

// A body at rest with the tool outside is in equilibrium, and no search is needed.
TEST(ContactingTool, APunchThatIsLiftedLeavesABlockWithoutALimitPoint) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom block.nrrd --shape block --size 40,40,20 --spacing 1.5 -q");
  good(folder,
       "run block.nrrd -o out -q --write force --base inferior --indent-at 0,0,top --nodes 800 "
       "--band off --tool punch:5mm,edge=1mm --set step.1press.move=2mm --set step.2lift.move=-3mm");
  const auto summary = summary_of(folder / "out");
  for (const auto& guard : summary["guards"]) EXPECT_EQ(guard["code"], "penetration") << guard;
  EXPECT_TRUE(summary["retries"].empty()) << summary["retries"];
  EXPECT_EQ(summary["tool"]["samples_in_contact"], 0);
  const Table curve = read_csv(folder / "out" / "force.csv"),
              energy = read_csv(folder / "out" / "energy.csv");
  const std::vector<double>&force = *curve.find("force_N"), &depth = *curve.find("indentation_mm");
  double most = 0.0;
  for (std::size_t k = 0; k < force.size(); ++k) {
    if (depth[k] > 0.5) EXPECT_GT(force[k], 0.0) << "it does not leave before it is lifted that far";
    if (depth[k] < 0.0) EXPECT_EQ(force[k], 0.0) << depth[k];
  }
  for (const double work : *energy.find("external_work_J")) most = std::max(most, work);
  EXPECT_EQ(energy.find("stored_J")->back(), 0.0);
  EXPECT_LT(std::abs(energy.find("error_J")->back()), 0.02 * most);
}

TEST(ContactingTool, ThatIsOnlyPulledAwayIsSaidNeverToBeInContact) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom block.nrrd --shape block --size 40,40,20 --spacing 2 -q");
  const Ran ran = good(folder,
                       "run block.nrrd -o out --write force --base inferior --indent-at 0,0,top --nodes 600 "
                       "--band off --tool sphere:5mm --set step.pull.move=-0.2mm");
  EXPECT_THAT(ran.err, HasSubstr("the tool never makes contact"));
}

// A point slips from its place of first contact; load steps are short enough to resolve this.
TEST(ContactingTool, HasTheFrictionOfShorterStepsFromItsFirstContact) {
  const fs::path folder = with_phantom();
  std::vector<double> force;
  for (const char* steps : {"0", "0.025"}) {
    good(folder, std::string("run brain.nrrd -o out --force --write force --tool sphere:5mm --band off "
                             "--friction 0.3 -q --nodes 1000 --depth 2mm --set solver.step_radii=") +
                     steps);
    force.push_back(summary_of(folder / "out")["force_N"]);
  }
  EXPECT_NEAR(force[0] / force[1], 1.0, 0.004);
  const auto tool = summary_of(folder / "out")["tool"];
  EXPECT_EQ(tool["friction"], 0.3);
  EXPECT_GT(tool["sticking_area_mm2"], 0.0);
  EXPECT_GE(tool["slipping_area_mm2"], 0.0);
  EXPECT_GT(tool["lateral_force_N"], 0.0);
  EXPECT_THAT(text_of(folder / "out" / "config.resolved.toml"), HasSubstr("friction = \"0.3\""));
  ends_with(folder, 2, "run brain.nrrd -o out --force --set solver.step_radii=1e-4",
            {"steps of the load of 0.0001 radii"});
}

// At the end of the first increment, friction and normal force are tiny; their residual looked worse than
// that of a state without contact.
TEST(ContactingTool, ThatHasComeInByHardlyAnythingFindsItsFirstForce) {
  if (!shared_data) GTEST_SKIP() << without_shared_data;
  const fs::path folder = fresh_folder();
  good(folder,
       run_of_shared("heart_ct_1.5mm.nii.gz", "--band off --tool sphere:5mm --friction 0.3 --depth 4mm"));
  EXPECT_TRUE(summary_of(folder / "out")["retries"].empty());
}

// A small sphere slides over a liver of 3 mm voxels, away from the fine nodes.
TEST(ContactingTool, WhoseForceJumpsAsItSlidesSaysSo) {
  if (!shared_data) GTEST_SKIP() << without_shared_data;
  const fs::path folder = fresh_folder();
  good(folder, run_of_shared("abdomen_mr_3mm.nii.gz",
                             "--label 5 --band off --nodes 1000 --nu 0.4925 --tool sphere:2.59mm "
                             "--indent-at=-87.4,-27.2,29.3 --base=-0.09607,-0.2448,0.9648 "
                             "--direction=-0.09925,-0.2545,0.962 --set step.1press.move=0.365mm "
                             "--set step.2slide.move=8.1,0,0"));
  const auto summary = summary_of(folder / "out");
  bool reported = false;
  for (const auto& guard : summary["guards"]) reported |= guard["code"] == "jagged";
  EXPECT_TRUE(reported) << summary["guards"];
}

TEST(ContactingTool, IsTooFastOnlyAtARateThatSomebodyRequested) {
  const fs::path folder = with_phantom();
  const std::string shallow =
      "run brain.nrrd --write force --tool sphere:5mm -q --nodes 800 --depth 0.5mm --frames 2";
  good(folder, shallow + " -o slow");
  ends_with(folder, 2, shallow + " -o fast --rate 100mm/s", {"too fast"});
}

TEST(ContactingTool, FrictionAndShapesThatAreNoneAreRefused) {
  std::vector<RefusedLine> lines;
  for (const char* none : {"rough", "-0.1", "11"})
    lines.push_back({2, std::string("sphere:5mm --friction=") + none, {"--friction"}});
  for (const char* shape :
       {"cube:5mm", "sphere", "sphere:0mm", "sphere:5kg", "sphere:5mm,edge=1mm", "punch:5mm",
        "punch:5mm,edge=0.1mm", "punch:5mm,edge=6mm", "capsule:2mm,length=3mm"})
    lines.push_back({2, shape, {"tool.shape"}});
  expect_refusals(fresh_folder(), "run nowhere.nrrd -o out --tool", lines);
}

// A block that its weight bends sideways by a sixth of its height has the force of the upright block.
TEST(ContactingTool, IsWhereLoadsHaveMovedThePlaceBeneathItAndBearsThemOnlyAsTheyChangeTheTissue) {
  const fs::path folder = fresh_folder();
  const std::string scene =
      "run " DIMPLE_SAMPLE_DATA "/block_3mm.nrrd -o out --force --write force --band off --tool sphere:5mm ";
  const auto ran = [&](const std::string& loads) {
    good(folder, scene + loads + quick);
    return summary_of(folder / "out");
  };
  const auto plain = ran(""), aside = ran("--gravity 2,0,0"), weak = ran("--gravity 0,0,-1e-6"),
             held = ran("--set support.left.on=left --set support.right.on=right");
  const auto tip = [](const nlohmann::json& of, int axis) {
    return of["tool"]["first_touch_mm"][axis].get<double>();
  };
  const auto force = [](const nlohmann::json& of) { return of["force_N"].get<double>(); };
  EXPECT_NEAR(tip(aside, 0) - tip(plain, 0), 5.0, 0.3);
  EXPECT_NEAR(tip(aside, 1), tip(plain, 1), 0.3);
  EXPECT_NEAR(force(aside), force(plain), 0.01 * force(plain));
  EXPECT_NEAR(tip(weak, 2), tip(plain, 2), 1e-3);
  EXPECT_NEAR(force(weak), force(plain), 1e-3 * force(plain));
  EXPECT_GT(force(held), force(plain));
  EXPECT_LT(force(held), 1.05 * force(plain));
  EXPECT_EQ(held["supports"].size(), 2U);
  EXPECT_TRUE(aside["band"].contains("unknown"));
}

// Each choice is a separate run: half a minute in all.
TEST(ContactingTool, IsExplainedByItsOwnChoicesAndNoneOfThePatch) {
  const fs::path folder = fresh_folder();
  const std::string tool = " --tool punch:5mm,edge=2mm --depth 1.5mm";
  EXPECT_EQ(dimple(folder, "run nowhere.nrrd -o out --explain" + tool).code, 3)
      << "it is the image that lacks";
  if (!std::getenv("DIMPLE_ALL_SCENES")) GTEST_SKIP() << "skipped: the runs, without DIMPLE_ALL_SCENES";
  good(folder, "run " DIMPLE_SAMPLE_DATA "/block_3mm.nrrd -o out --band off --explain" + tool);
  std::set<std::string> choices;
  for (const TextTable::Row& row : read_text_csv(folder / "out" / "explain.csv").row) {
    EXPECT_NE(row.field[5], "") << row.field[0] << ", " << row.field[1] << ": " << row.field[7];
    choices.insert(row.field[0]);
  }
  EXPECT_EQ(choices, (std::set<std::string>{"Poisson's ratio", "base", "cloud", "equilibrium", "far tissue",
                                            "friction", "integration points", "number of nodes",
                                            "segmentation", "steps of the load", "surface", "tool's edge",
                                            "tool's place", "tool's radius", "voxels"}));
}

// A wall of tissue, 16 mm thick, on its base; two spheres approach it from both sides.
struct Pinched {
  fs::path folder = fresh_folder();
  Pinched() { good(folder, "phantom wall.nrrd --shape block --size 16,60,40 --spacing 2 -q"); }
  nlohmann::json run(const std::string& more) const {
    good(folder,
         "run wall.nrrd -o out --force -q --write force --nodes 1500 --frames 2 --base inferior "
         "--tool sphere:5mm --indent-at=-8,0,28 --direction 1,0,0 " +
             more);
    return summary_of(folder / "out");
  }
};
constexpr const char* other = "--set tool.other.shape=sphere:5mm --set tool.other.at=8,0,28 ";

TEST(SeveralTools, ThatPinchAWallPressItAlikeFromBothSidesAndHarderThanOneByItself) {
  const Pinched wall;
  const double alone = wall.run("--depth 2mm")["force_N"];
  const auto both = wall.run(std::string("--depth 2mm ") + other + "--set tool.other.move=2mm");
  const double force = both["force_N"];
  EXPECT_GT(force, 1.2 * alone) << "one by itself bends the wall";
  const auto on_other = both["other_tools"]["other"]["force_on_tool_N"];
  EXPECT_NEAR(on_other[0].get<double>() / force, 1.0, 0.03);
  EXPECT_NEAR(on_other[0].get<double>() / both["force_on_tool_N"][0].get<double>(), -1.0, 0.03);
  EXPECT_NEAR(both["base_force_N"], 0.0, 0.03 * force);
  EXPECT_TRUE(both["band"].contains("unknown"));
  // A tool at rest is pressed by the wall that moves towards it, less than a moving one.
  const auto is_fixed = wall.run(std::string("--depth 2mm ") + other);
  const double on_it = is_fixed["other_tools"]["other"]["force_on_tool_N"][0];
  EXPECT_GT(on_it, 0.01 * force);
  EXPECT_LT(on_it, 0.9 * force);
  EXPECT_GE(is_fixed["force_N"], 0.99 * alone);
  // Its warning follows the rule for the measured tool, whose warning names its own force.
  ASSERT_GT(both["other_tools"]["other"]["largest_penetration_mm"], 5e-3) << "a thousandth of its radius";
  expect_words(both["guards"].dump(), {"tool-penetration"});
  // Without friction, one tool after the other gives the same forces.
  const auto steps =
      wall.run(std::string(other) + "--set step.a.moves=other --set step.a.move=2mm --set step.b.move=2mm");
  const double last = steps["other_tools"]["other"]["force_on_tool_N"][0];
  EXPECT_NEAR(last / on_other[0].get<double>(), 1.0, 5e-3);
  EXPECT_NEAR(steps["force_N"].get<double>() / force, 1.0, 5e-3);
}

// Without refined nodes there, the surface penetrates the tool between them while no sample is in contact.
TEST(SeveralTools, ThatNoNodesWereMadeForEndARun) {
  const fs::path folder = fresh_folder();
  const std::string block = DIMPLE_SAMPLE_DATA "/block_3mm.nrrd";
  good(folder, "model " + block + " -o model -q --nodes 800");
  ends_with(folder, 5,
            "solve model -o out -q --depth 2mm --set tool.other.shape=sphere:4mm --set "
            "tool.other.at=20,0,30 --set tool.other.move=1mm",
            {"made with all of its tools"});
}

// The ParaView file shows the tools; the page has their forces.
TEST(SeveralTools, AreDrawnEachWhereItIs) {
  const fs::path folder = fresh_folder();
  const std::string scene =
      "run " DIMPLE_SAMPLE_DATA
      "/block_3mm.nrrd -o out -q --band off --nodes 500 --frames 2 --depth 2mm --tool "
      "sphere:5mm --set tool.other.shape=sphere:4mm --set tool.other.at=18,0,30 --set tool.other.move=";
  for (const double displacement : {0.0, 1.0}) {
    good(folder, scene + fmt::format("{}mm --force", displacement));
    for (const auto& [file, fraction] : {std::pair{"tool_0000.vtp", 0.0}, {"tool_0002.vtp", 1.0}}) {
      const Points at = read_vtp(folder / "out" / "tool" / file).position_mm;
      const Index each = at.cols() / 2;
      EXPECT_NEAR(at.leftCols(each).row(2).minCoeff(), 30.0 - 2.0 * fraction, 0.9) << file;
      const Points other = at.rightCols(each);
      EXPECT_NEAR(other.row(2).minCoeff(), 30.0 - displacement * fraction, 0.9) << file;
      EXPECT_NEAR(other.row(0).mean(), 18.0, 0.5) << file;
      EXPECT_NEAR(other.row(0).maxCoeff() - other.row(0).minCoeff(), 8.0, 0.05) << file;
    }
    EXPECT_THAT(text_of(folder / "out" / "report.html"), HasSubstr("other_tools"));
  }
}

// Table, summary and surface files must give the same forces.
TEST(SeveralTools, AndWallsHaveTheirForcesAtEachDepthInTheTableAndAtEachPartOfTheSurface) {
  const fs::path folder = fresh_folder();
  good(folder,
       "run " DIMPLE_SAMPLE_DATA
       "/block_3mm.nrrd -o out -q --band off --write surface --nodes 600 --frames 2 --depth 2mm --tool "
       "sphere:5mm --set tool.other.shape=sphere:4mm --set tool.other.at=18,0,30 --set "
       "tool.other.move=1mm --set tool.other.friction=0.3 --wall around:0.2mm");
  const auto summary = summary_of(folder / "out");
  const auto& other = summary["other_tools"]["other"];
  const Table curve = read_csv(folder / "out" / "force.csv");
  EXPECT_EQ(curve.find("wall_moment_x_Nm"), nullptr) << "about no place that anybody knows";
  double worst = 0.0;
  for (const int frame : {0, 1, 2}) {
    SCOPED_TRACE(frame);
    const std::vector<double>& depth = *curve.find("indentation_mm");
    const auto row = static_cast<std::size_t>(
        std::find_if(depth.begin(), depth.end(), [&](double d) { return d > frame - 1e-6; }) - depth.begin());
    ASSERT_LT(row, depth.size());
    const PointFile file = read_vtu(folder / "out" / "contact" / fmt::format("contact_{:04d}.vtu", frame));
    const Eigen::MatrixXd &force = file.find("force_N")->values, &by = file.find("touched_by")->values;
    for (const auto& [number, name] : {std::pair{0, ""}, {1, "other_"}, {2, "wall_"}}) {
      Vec3 on_body = Vec3::Zero();
      for (Index s = 0; s < force.cols(); ++s)
        if (by(0, s) == number) on_body += force.col(s);
      for (const int axis : {0, 1, 2}) {
        const double written = (*curve.find(fmt::format("{}force_{}_N", name, "xyz"[axis])))[row];
        EXPECT_NEAR(on_body[axis], -written, 1e-8) << name;
        if (frame == 2 && number == 1)
          EXPECT_EQ(written, other["force_on_tool_N"][static_cast<std::size_t>(axis)]);
        worst = std::max(worst, number == 2 ? std::abs(written) : 0.0);
      }
      if (number == 1) EXPECT_EQ(frame == 0, on_body.isZero(0.0)) << "it presses from the first depth on";
    }
    EXPECT_EQ(by.maxCoeff(), 2.0);
  }
  EXPECT_GT(worst, 0.0) << "a block that swells sideways touches what is around it";
  for (const char* axis : {"x", "y", "z"})
    EXPECT_EQ(curve.find(fmt::format("other_moment_{}_Nm", axis))->back(),
              other["moment_on_tool_Nm"][static_cast<std::size_t>(*axis - 'x')]);
}

// The bonded patch holds nodes; other contacts are still in the files.
TEST(SeveralTools, InAdditionToThePatchHaveFilesOfTheirContactToo) {
  const fs::path folder = fresh_folder();
  good(folder, "run " DIMPLE_SAMPLE_DATA
               "/block_3mm.nrrd -o out -q --band off --write surface --nodes 600 --frames 1 "
               "--depth 2mm --wall around:0.2mm");
  const PointFile file = read_vtu(folder / "out" / "contact" / "contact_0001.vtu");
  const auto summary = summary_of(folder / "out");
  EXPECT_EQ(file.position_mm.cols(), summary["walls"]["wall"]["places"]);
  EXPECT_TRUE((file.find("touched_by")->values.array() == 1.0).all());
  EXPECT_EQ(file.find("slid_mm"), nullptr) << "without friction";
}

TEST(SeveralTools, ThatPinchAWallLiftItAlikeByFriction) {
  const Pinched wall;
  const auto lifted = wall.run(
      std::string(other) +
      "--friction 0.6 --set tool.other.friction=0.6 --set step.a.move=2mm --set step.b.moves=other --set "
      "step.b.move=2mm --set step.c.move=0,0,2 --set step.d.moves=other --set step.d.move=0,0,2");
  const auto on_tool = lifted["force_on_tool_N"],
             on_other = lifted["other_tools"]["other"]["force_on_tool_N"];
  EXPECT_NEAR(on_other[0].get<double>() / on_tool[0].get<double>(), -1.0, 0.03);
  EXPECT_NEAR(on_other[2].get<double>() / on_tool[2].get<double>(), 1.0, 0.05);
  EXPECT_LT(on_tool[2], 0.0) << "the wall hangs on them";
  EXPECT_LE(-on_tool[2].get<double>(), 0.6 * std::abs(on_tool[0].get<double>()))
      << "within Coulomb's cone, nearly";
}

TEST(SeveralTools, AreRefusedInWordsWhereWhatIsSaidOfThemMakesNoTool) {
  const fs::path folder = with_phantom();
  const std::string run = "run brain.nrrd -o out -q --tool sphere:5mm --depth 2mm",
                    at = "--set tool.other.at=0,0,60 ", there = at + "--set tool.other.shape=sphere:4mm ";
  const auto third = [](const std::string& name) {
    return "--set tool." + name + ".shape=sphere:4mm --set tool." + name + ".at=0,0,60 ";
  };
  expect_refusals(
      folder, run,
      {{2, at, {"the tool 'other' has no shape"}},
       {2, at + "--set tool.a.b.shape=sphere:4mm", {"a tool is called 'a.b', and a name has no dot"}},
       {2, at + "--set tool.other.shape=circle", {"the tool 'other' is a bonded indenter"}},
       {2, at + "--set tool.other.shape=sphere:0mm", {"tool.other.shape"}},
       {2, "--set tool.other.shape=sphere:4mm", {"the tool 'other' is nowhere"}},
       {2, there + "--set tool.other.friction=much", {"tool.other.friction"}},
       {2, there + "--set tool.other.move=1,2", {"moves by 2 numbers"}},
       {2, there + "--set tool.other.direction=0,0,0", {"all of them zero"}},
       {2, there + third("wall") + "--wall around:1mm", {"has the name of a support or a wall"}},
       {2, there + "--set wall.other.shape=around:2mm", {"has the name of a support or a wall"}},
       {2, there + third("tool"), {"has the name of the measured one"}},
       {2, there + third("base"), {"has the name of the fixed base"}}});
  expect_refusals(folder, "run brain.nrrd -o out -q --tool sphere:5mm",
                  {{2, there + "--set step.a.moves=othr --set step.a.move=1mm", {"did you mean 'other'"}},
                   {2,
                    "--set support.left.on=left --set wall.left.shape=around:2mm --set step.a.moves=left "
                    "--set step.a.move=1,0,0",
                    {"and a wall has that name too"}}});
  EXPECT_FALSE(fs::exists(folder / "out"));
  ends_with(folder, 4,
            "run brain.nrrd -o far -q --nodes 400 --tool sphere:5mm --depth 1mm --set "
            "tool.other.shape=sphere:4mm --set tool.other.at=0,0,160",
            {"the nearest place of the surface is"});
}

TEST(ContactingTool, HasAnErrorByTheImagesResolutionAndAWarningWhereThatIsMuch) {
  const fs::path folder = fresh_folder();
  const auto summary = [&](const std::string& words) {
    const Ran ran = good(folder, "run " + words +
                                     " -o out --force --nodes 800 --frames 1 --band off --depth 2mm --base "
                                     "inferior --indent-at 0,0,top");
    EXPECT_THAT(ran.out, HasSubstr(" (image resolution)\t"));
    auto reported = summary_of(folder / "out");
    reported["stderr"] = ran.err;
    const Table curve = read_csv(folder / "out" / "force.csv");
    EXPECT_DOUBLE_EQ(curve.find("image_half_N")->back(), reported["image_error"]["half_N"].get<double>());
    return reported;
  };
  const auto part = [](const nlohmann::json& reported) {
    return reported["image_error"]["half_N"].get<double>() / reported["force_N"].get<double>();
  };
  good(folder, "phantom plate.nrrd --shape block --size 60,60,8 --spacing 1 -q");
  const auto thin = summary("plate.nrrd --tool sphere:20mm --write force");
  EXPECT_GT(part(thin), 0.1);
  EXPECT_LT(part(thin), 0.2);
  EXPECT_THAT(thin["stderr"].get<std::string>(), HasSubstr("half a voxel changes the force by"));

  good(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 2 -q");
  const auto thick = summary("block.nrrd --tool sphere:5mm --write force");
  EXPECT_LT(part(thick), 0.03);
  EXPECT_THAT(thick["stderr"].get<std::string>(), Not(HasSubstr("half a voxel")));

  const auto bonded_patch = summary("block.nrrd --write model");
  EXPECT_EQ(bonded_patch["image_error"]["shape_N"], 0.0);
  const Ran solved = good(folder, "solve out/model -o solved --depth 1mm --frames 1 --write force");
  EXPECT_THAT(solved.out, Not(HasSubstr("image resolution")));
  EXPECT_EQ(summary_of(folder / "solved")["image_error"]["unknown"], "the model was made without its image");
}

}  // namespace
}  // namespace dimple
