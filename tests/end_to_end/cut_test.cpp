// Tests of dimple run --cut: a body is cut, or a part of it taken out, before the load, through the real
// program.

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

constexpr const char* quick = " -q --write force --nodes 1000 --depth 2mm --frames 2 --band off ";
const std::string block = DIMPLE_SAMPLE_DATA "/block_3mm.nrrd";  // 60 x 60 x 30 mm, patch at (0, 0, 30)
const std::string two = DIMPLE_SAMPLE_DATA "/two_labels_3mm.nii.gz";

Json run_of(const fs::path& folder, const std::string& image, const std::string& options, const char* out) {
  const Ran ran = good(folder, "run " + image + " -o " + out + quick + options);
  return ran.code == 0 ? summary_of(folder / out) : Json();
}

void write_cube(const fs::path& file) {
  std::ofstream(file) << "v 12 -6 20\nv 24 -6 20\nv 24 6 20\nv 12 6 20\nv 12 -6 40\nv 24 -6 40\nv 24 6 "
                         "40\nv 12 6 40\nf 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
}

TEST(Cut, NextToTheBondedPatchMakesItSofterTheNearerItIs) {
  const fs::path folder = fresh_folder();
  double before = 0.0;
  for (const char* cut :
       {"", "--cut line:20,-35,30,20,35,30,depth=20mm", "--cut line:8,-35,30,8,35,30,depth=20mm",
        "--cut line:8,-35,30,8,35,30,depth=20mm;line:-8,-35,30,-8,35,30,depth=20mm"}) {
    const Json summary = run_of(folder, block, cut, ("out" + std::to_string(before)).c_str());
    const double force = summary["force_N"];
    if (before > 0.0) {
      EXPECT_LT(force, 0.999 * before) << cut;
      const Json& of = summary["model"]["cut"];
      EXPECT_NEAR(of["removed_mm3"], 0.5 * of["area_mm2"].get<double>(), 1e-6);
      EXPECT_NEAR(summary["model"]["surface_volume_mm3"].get<double>() + of["removed_mm3"].get<double>(),
                  108e3, 108.0);
    }
    before = force;
  }
}

TEST(Cut, LeavesBaseAndToolWhereTheyWereOnTheWholeBody) {
  const fs::path folder = fresh_folder();
  const Json whole = run_of(folder, block, "", "whole"),
             cut = run_of(folder, block, "--cut plane:15,0,30,1,0,0.2,radius=12mm", "cut");
  EXPECT_EQ(whole["counts"]["circle_centre_mm"], cut["counts"]["circle_centre_mm"]);
  EXPECT_EQ(whole["counts"]["push"], cut["counts"]["push"]);
}

TEST(Cut, ByALineBeneathTheSurfaceOpensItFromTheOutside) {
  const fs::path folder = fresh_folder();
  const Json cut = run_of(folder, block, "--cut line:20,-20,25,20,20,25,depth=10mm", "out")["model"]["cut"];
  // The smooth surface around the voxels is between 30.0 and 30.7 mm high.
  EXPECT_GT(cut["area_mm2"], 40.0 * (10.0 + 5.0));
  EXPECT_LT(cut["area_mm2"], 40.0 * (10.0 + 5.7));
}

TEST(Cut, OfALabelIsTheBodyOfTheOthers) {
  const fs::path folder = fresh_folder();
  const Json info = Json::parse(dimple(folder, "info " + two + " --json").out);
  const Json& gone = info["labels"][1];
  const std::string name = std::to_string(gone["value"].get<int>()),
                    stays = std::to_string(info["labels"][0]["value"].get<int>());
  const Json cut = run_of(folder, two, "--cut label:" + name, "cut"),
             other = run_of(folder, two, "--label " + stays, "other");
  EXPECT_EQ(cut["force_N"], other["force_N"]);
  EXPECT_EQ(cut["model"]["cut"]["labels_taken_out"][0]["volume_mm3"], gone["volume_mm3"]);
}

TEST(Cut, ThatPartsTheBodySaysWhatIsLeftOutAndRefusesAToolOnWhatNothingHolds) {
  const fs::path folder = fresh_folder();
  good(folder, "run " + block + " -o out --cut plane:12,0,0,1,0,0" + quick);
  const Json cut = summary_of(folder / "out")["model"]["cut"];
  ASSERT_EQ(cut["parted"].size(), 1U);
  EXPECT_NEAR(cut["parted"][0]["volume_mm3"], 17.75 * 1800.0, 0.02 * 17.75 * 1800.0);
  EXPECT_NEAR(cut["parted"][0]["centre_mm"][0], 21.1, 0.3);
  EXPECT_THAT(summary_of(folder / "out")["warnings"].dump(), HasSubstr("it is left out"));
  const Json image = summary_of(folder / "out")["verdict"]["image"];  // a requested cut is no doubt
  EXPECT_EQ(image["word"], "good") << image;
  EXPECT_THAT(image["of"].get<std::string>(), HasSubstr("cut away"));
  ends_with(folder, 4, "run " + block + " -o falls --cut plane:0,0,12,0,0,1" + quick,
            {"separated from the base"});
}

TEST(Cut, ThatReachesToWhereNodesAreTooFarApartToKeepItOpenSaysSo) {
  const fs::path folder = fresh_folder();
  const std::string far = "--cut plane:22,0,15,1,0,0,radius=20mm ";
  const auto warned = [](const Json& summary) {
    return summary["warnings"].dump().find("a cut extends to nodes") != std::string::npos;
  };
  EXPECT_TRUE(warned(run_of(folder, block, far + "--set image.cut_gap=0.2mm", "coarse")));
  EXPECT_FALSE(warned(run_of(folder, block, far + "--set image.cut_gap=1mm", "wide")));
}

// The test uses a square sheet and a closed cube, as another program may have drawn them.
TEST(Cut, ByADrawnSheetIsThatByTheSamePlaneAndAClosedOneIsTakenOutWhole) {
  const fs::path folder = fresh_folder();
  std::ofstream(folder / "sheet.obj") << "v 9 -20 10\nv 9 20 10\nv 9 20 40\nv 9 -20 40\nf 1 2 3 4\n";
  write_cube(folder / "cube.obj");
  const auto finer = [&](const std::string& cut,
                         const std::string& out) {  // with 1000 nodes seeds differ by 2 %
    good(folder, "run " + block +
                     " -q --write force --nodes 2000 --depth 2mm --frames 2 "
                     "--band off --cut " +
                     cut + " -o " + out);
    return summary_of(folder / out);
  };
  const Json sheet = finer("sheet.obj", "sheet"), line = finer("line:9,-20,30,9,20,30,depth=20mm", "line");
  EXPECT_NEAR(sheet["force_N"], line["force_N"], 0.005 * line["force_N"].get<double>());
  const Ran region = good(folder, "run " + block +
                                      " --write force --nodes 1000 --depth 2mm --frames 2 --band off "
                                      "--cut cube.obj -o cube");
  EXPECT_THAT(region.err, HasSubstr("cm3 removed"));
  const Json cube = summary_of(folder / "cube");
  EXPECT_NEAR(cube["model"]["cut"]["removed_mm3"], 1440.0, 0.05 * 1440.0);
}

TEST(Cut, ThatIsNoneIsRefusedByWhatIsWrongWithIt) {
  const fs::path folder = fresh_folder();
  std::ofstream(folder / "broken.stl") << "dear";
  std::ofstream(folder / "metres.obj") << "v .009 -.02 .01\nv .009 .02 .01\nv .009 .02 .04\nf 1 2 3\n";
  expect_refusals(folder, "run " + block + " -o out" + quick + "--cut",
                  {{2, "hatchet:1,2,3", {"is not known"}},
                   {2, "sheet.ply", {".obj and .vtp"}},
                   {2, "plane:1,2,3,0,0,0", {"has no normal"}},
                   {2, "line:0,0,30,0,0,30,depth=5mm", {"begins where it ends"}},
                   {2, "line:0,0,30,10,0,30,depth=-5mm", {"depth = -5mm is not allowed"}},
                   {3, "label:tumour", {"no label is called 'tumour'"}},
                   {3, "label:block", {"nothing of the body is left"}},
                   {3, "broken.stl", {"is no STL file"}},
                   {3, "nowhere.stl", {"nowhere.stl"}},
                   {2, "metres.obj", {"is 0.0400 mm long or deep"}},
                   {2, "plane:20,0,30,1,0,0,radius=0.012", {"is 0.0240 mm long or deep"}},
                   {2, "line:20,-15,30,20,15,30,depth=0.012", {"is 0.0120 mm long or deep"}},
                   {4, "plane:200,0,0,1,0,0", {"meets no tissue"}},
                   {4, "line:-9,-20,30,9,20,30,depth=10mm", {"passes under the bonded patch"}},
                   {4, "plane:0,0,30.7,1,0.3,0,radius=3mm", {"passes under the bonded patch"}}});
  EXPECT_FALSE(fs::exists(folder / "out" / "force.csv"));
}

TEST(Cut, ByASheetThatWasDrawnInCentimetresIsWarnedOfAndOneInMillimetresIsNot) {
  const fs::path folder = fresh_folder();
  std::ofstream(folder / "cm.obj") << "v .9 -1.5 1\nv .9 1.5 1\nv .9 1.5 4\nv .9 -1.5 4\nf 1 2 3 4\n";
  std::ofstream(folder / "mm.obj") << "v 9 -15 10\nv 9 15 10\nv 9 15 40\nv 9 -15 40\nf 1 2 3 4\n";
  const auto warnings = [&](const std::string& sheet) {
    return run_of(folder, block, "--cut " + sheet, "out")["warnings"].dump();
  };
  EXPECT_THAT(warnings("cm.obj"), HasSubstr("scale it if it is in metres"));
  EXPECT_THAT(warnings("mm.obj --force"), Not(HasSubstr("scale it if")));
}

TEST(Cut, UnderAContactingToolIsPressedOnBothFacesAndMakesTheBodySofter) {
  const fs::path folder = fresh_folder();
  const std::string sphere = "--tool sphere:5mm ";
  const double whole = run_of(folder, block, sphere, "whole")["force_N"];
  const double cut =
      run_of(folder, block, sphere + "--cut line:-15,0,30,15,0,30,depth=15mm", "cut")["force_N"];
  EXPECT_LT(cut, 0.99 * whole);
  EXPECT_GT(cut, 0.5 * whole);
}

TEST(Cut, HasFacesThatBearNoMembraneAndAreOnNoSideOfTheBody) {
  const fs::path folder = fresh_folder();
  const std::string across = " --cut plane:12,0,20,1,0,0,radius=25mm";
  const std::string film = "--membrane 0.1mm:40kPa";
  const auto area_of = [](const Json& run) { return run["membranes"]["surface"]["area_mm2"].get<double>(); };
  const double whole = area_of(run_of(folder, block, film, "film")),
               cut = area_of(run_of(folder, block, film + across, "cut_film"));
  EXPECT_LT(cut, whole);
  EXPECT_GT(cut, whole - 0.5 * 60.0 - 2.0 * 0.5 * 30.0 - 5.0);  // the gap's mouth on the top and the sides

  const std::string held = "--set support.wall.on=left --set support.wall.hold=sliding";
  const Json wall = run_of(folder, block, held, "held")["supports"]["wall"],
             next_to = run_of(folder, block, held + across, "cut_held")["supports"]["wall"];
  EXPECT_LT(next_to["nodes"], 1.5 * wall["nodes"].get<double>());
}

TEST(Cut, TakesWhatIsCutOutFromTheDeformedLabelsToo) {
  const fs::path folder = fresh_folder();
  write_cube(folder / "cube.obj");
  const auto run = [&](const std::string& image, const std::string& cut, const std::string& out) {
    good(folder, "run " + image +
                     " -q --write force,images --nodes 1000 --depth 2mm --frames 1 "
                     "--band off --cut " +
                     cut + " -o " + out);
    return summary_of(folder / out);
  };
  const Json cube = run(block, "cube.obj", "cube");
  const double removed = cube["model"]["cut"]["removed_mm3"],
               remaining = cube["images"]["labels_at_rest_mm3"];
  EXPECT_NEAR(remaining, 108e3 - removed, 0.3 * removed);  // voxels of 3 mm
  EXPECT_NEAR(cube["images"]["labels_mm3"], remaining, 0.02 * remaining);

  const Json info = Json::parse(dimple(folder, "info " + two + " --json").out);
  const int gone = info["labels"][1]["value"];
  run(two, "label:" + std::to_string(gone), "label");
  const Json after = Json::parse(dimple(folder, "info label/images/labels.nii.gz --json").out);
  ASSERT_EQ(after["labels"].size(), 1U);
  EXPECT_NE(after["labels"][0]["value"].get<int>(), gone);
}

TEST(Cut, ThatTheLoadClosesSaysThatItsFacesPassThroughEachOtherAndOneThatOpensDoesNot) {
  const fs::path folder = fresh_folder();
  const auto closes = [&](const std::string& options, const char* out) {
    const Json run = run_of(folder, block, options, out);
    return run["warnings"].dump().find("its faces pass through each other") != std::string::npos;
  };
  const std::string beneath = "--cut plane:0,0,24,0,0,1,radius=8mm ";
  EXPECT_TRUE(closes(beneath, "pressed"));
  EXPECT_FALSE(closes(beneath + "--set image.cut_gap=4mm", "wide"));
  const std::string lifted = std::string(quick).substr(0, std::string(quick).find("--depth"));
  good(folder, "run " + block + " -o lifted --band off --set step.lift.move=-2mm " + beneath + lifted);
  EXPECT_THAT(text_of(folder / "lifted" / "summary.json"), Not(HasSubstr("pass through each other")));
}

TEST(SelfContact, OfACutUnderTheToolCarriesNearlyAsMuchAsTheWholeBodyAndNeverMore) {
  const fs::path folder = fresh_folder();
  const std::string flat = "--cut plane:0,0,20,0,0,1,radius=20mm --set image.cut_gap_mm=0.3 ";
  const double whole = run_of(folder, block, "", "whole")["force_N"],
               open = run_of(folder, block, flat, "open")["force_N"];
  const Json closed = run_of(folder, block, flat + "--self-contact on --threads 2", "closed");
  const double in_contact = closed["force_N"];
  EXPECT_LT(open, 0.6 * whole);
  EXPECT_GT(in_contact, 0.8 * whole);
  EXPECT_LT(in_contact, whole);
  const Json& contact = closed["self_contact"];
  EXPECT_NEAR(contact["sum_of_forces_N"], in_contact, 0.3 * in_contact);
  EXPECT_LT(contact["largest_penetration_mm"], 0.3) << "the gap; open, they pass by 3 mm";
  good(folder, "run " + block + " --config closed/config.resolved.toml -o again -q --threads 1");
  EXPECT_EQ(text_of(folder / "closed" / "force.csv"), text_of(folder / "again" / "force.csv"));
}

TEST(Cut, UnderGravityCountsTheBendingOfTheFlapFromWhereTheBodyCameToRest) {
  const fs::path folder = fresh_folder();
  const Ran ran =
      good(folder, "run " + block +
                       " -o out --write force --nodes 1000 --depth 1mm --frames 1 --band off --mu 500 "
                       "--gravity inferior --cut plane:0,0,22,0,0,1,radius=14mm");
  const std::size_t at = ran.err.find(" % of the indentation bends");
  ASSERT_NE(at, std::string::npos) << ran.err;
  const double percent = std::stod(ran.err.substr(ran.err.rfind(' ', at - 1)));
  EXPECT_GT(percent, 50.0);
  EXPECT_LE(percent, 100.0) << "at rest the flap has sunk already";
}

TEST(SelfContact, OfABodyThatNowhereFacesItselfSaysThatNoContactIsPossible) {
  const fs::path folder = fresh_folder();
  const Ran ran = good(folder, "run " + block +
                                   " -o out --write force --nodes 300 --depth 1mm --frames 1 --band off "
                                   "--self-contact on");
  EXPECT_THAT(ran.err, HasSubstr("no contact possible"));
  EXPECT_FALSE(summary_of(folder / "out").contains("self_contact"));
}

}  // namespace
}  // namespace dimple
