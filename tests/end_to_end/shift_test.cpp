// Tests of dimple shift: brain shift after a craniotomy, through the real program, on a block in place of a
// brain.

#include <map>

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

const std::string block_of_brain = DIMPLE_SAMPLE_DATA "/block_3mm.nrrd";  // 60 x 60 x 30 mm on z = 0
constexpr const char* opened = " --opening 0,0,30,15 --up superior --nodes 500 --mu 300 ";

Json shifted(const fs::path& folder, const std::string& options, const char* out) {
  const Ran ran = good(folder, "shift " + block_of_brain + " -o " + out + opened + options);
  return ran.code == 0 ? summary_of(folder / out) : Json();
}

TEST(Shift, GrowsWithTheFluidThatIsLostAndFallsAlongGravity) {
  const fs::path folder = fresh_folder();
  double before = 0.0;
  for (const char* lost : {"20%", "60%", "100%"}) {
    const Json summary = shifted(folder, std::string("-q --fluid-lost ") + lost, lost),
               &shift = summary["shift"];
    EXPECT_NEAR(summary["loads"]["settled_mm"], shift["largest_of_all_mm"], 0.006);
    const double most = shift["largest_at_opening_mm"];
    EXPECT_GT(most, before) << lost;
    EXPECT_GT(shift["along_gravity_mm"], 0.9 * most) << lost;
    before = most;
  }
}

// Openings narrower than the surface's triangles work; an opening that opens nothing is refused.
TEST(Shift, SaysTheShiftAtTheMiddleOfTheOpeningFirstAndTheLargestThere) {
  const fs::path folder = fresh_folder();
  expect_refusal(dimple(folder, "shift " + block_of_brain +
                                    " -o out --opening 1,1,30,0.6 --up superior --nodes 500 --mu 300 -q"),
                 4, {"opens no part of the wall"});
  for (const char* opening : {"0,0,30,15", "4,-3,30,10", "1,1,30,2"}) {
    const Ran ran = good(folder, "shift " + block_of_brain + " --force -o out --opening " + opening +
                                     " --up superior --nodes 500 --mu 300 -q --tables");
    const Json shift = summary_of(folder / "out")["shift"];
    const double middle = shift["middle_mm"];
    EXPECT_EQ(middle, shift["profile"][0]["shift_mm"].get<double>());
    EXPECT_GT(middle, 0.5);
    EXPECT_GT(shift["largest_at_opening_mm"], 0.8 * middle) << opening;
    EXPECT_EQ(ran.out.rfind("shift at the middle of the opening ", 0), 0u) << ran.out;
    EXPECT_THAT(ran.out, HasSubstr("; largest at the opening "));
  }
}

// The point is given as numbers, and as 3D Slicer writes it in either space.
TEST(Shift, RepeatsOpeningAndTargetsWithTheirSidesAndReadsMarkups) {
  const fs::path folder = fresh_folder();
  std::ofstream(folder / "t.fcsv") << "# Markups fiducial file version = 4.11\n# CoordinateSystem = RAS\n"
                                      "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc\n"
                                      "1,-5,-10,20,0,0,0,1,1,1,0,F-1,\n";
  std::ofstream(folder / "t.mrk.json")
      << R"({"markups": [{"type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm",
            "controlPoints": [{"id": "1", "label": "F-1", "position": [5, 10, 20]}]}]})";
  std::string numbers;
  for (const char* target : {"5,10,20", "t.fcsv", "t.mrk.json"}) {
    const Ran ran = good(folder, "shift " + block_of_brain + " -o out --force --tables" + opened +
                                     "--set accuracy.band=off --target " + target);
    expect_words(ran.err, {"opening  (0.0, 0.0, 30.0) mm, of 15.00 mm radius: ", "superior of the brain's",
                           "target   (5.0, 10.0, 20.0) mm: ", " mm left, ", " mm posterior, "});
    const std::string table = text_of(folder / "out" / "targets.csv");
    if (numbers.empty()) numbers = table;
    EXPECT_EQ(table, numbers) << target;
  }
  const auto refused = [&](const char* content, const char* word) {
    std::ofstream(folder / "bad.fcsv") << content;
    ends_with(folder, 3, "shift " + block_of_brain + " -o no" + opened + "--target bad.fcsv", {word});
  };
  refused("# CoordinateSystem = IJK\n1,0,0,20\n", "the space 'IJK'");
  refused("# CoordinateSystem = LPS\n1,0,up,20\n", "'up' is not a coordinate");
  refused("# CoordinateSystem = LPS\n", "no point is in the file");
}

// A shift of 0.00 mm was once reported, with exit code 0.
TEST(Shift, AtAnOpeningBetweenTheSurfacesVerticesIsThatOfTheNearestOne) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom head.nrrd --shape cut-ellipsoid --size 140,170,120 --spacing 4");
  const auto with_radius = [&](const std::string& radius) {
    const Ran ran = good(folder,
                         "shift head.nrrd -o out --force --tables --nodes 800 --close 0 --up superior "
                         "--set accuracy.band=off --opening 24.3,0.9,66.9," +
                             radius);
    return std::pair(summary_of(folder / "out")["shift"],
                     ran.err.find("is between the vertices") != std::string::npos);
  };
  const auto [wide, is_wide_reported] = with_radius("6");
  const auto [narrow, is_narrow_reported] = with_radius("1.5");
  EXPECT_FALSE(is_wide_reported);
  EXPECT_TRUE(is_narrow_reported);
  const double shift = wide["largest_at_opening_mm"];
  EXPECT_GT(shift, 2.0);
  EXPECT_NEAR(narrow["largest_at_opening_mm"], shift, 0.2 * shift);
  EXPECT_FALSE(narrow["at_mm"].is_null());
}

// No tool could pass through the skull.
TEST(Shift, WithAnOpeningOnTheSideSaysNothingOfATool) {
  const fs::path folder = fresh_folder();
  const Ran ran =
      good(folder,
           "shift " + block_of_brain +
               " -o out --opening 30,0,15,12 --up left --nodes 500 --mu 300 --skull derived --density 500");
  const Json assumed = summary_of(folder / "out")["shift"]["assumed"];
  EXPECT_THAT(assumed.dump(), HasSubstr("given density of the tissue has no effect")) << assumed;
  EXPECT_THAT(ran.err, Not(HasSubstr("passes through")));
}

TEST(Shift, WritesTablesImagesPictureAndPageWithTheSameBytesForAnyThreadsAndTablesAloneOnRequest) {
  const fs::path folder = fresh_folder();
  const std::string targets = "-q --target 0,0,25 --target 10,10,10 ";
  const Json summary = shifted(folder, targets + "--threads 2", "two");
  shifted(folder, targets + "--threads 1", "one");
  for (const char* file : {"targets.csv", "profile.csv", "overview.png"})
    EXPECT_EQ(text_of(folder / "two" / file), text_of(folder / "one" / file)) << file;
  const std::string table = text_of(folder / "two" / "targets.csv");
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 3);
  EXPECT_THAT(table, HasSubstr("along_gravity_mm"));
  for (const char* file : {"surface.vtp", "nodes.vtu", "images/displacement_mm.nrrd", "images/labels.nrrd"})
    EXPECT_TRUE(fs::exists(folder / "two" / file)) << file;
  EXPECT_GE(summary["walls"]["skull"]["places_that_touch"], 0);
  expect_words(text_of(folder / "two" / "report.html"),
               {"data:image/png;base64,", "\"outline_at_end\"", "\"walls\":[", "--opening=0,0,30,15"});

  const Json& shift = summary["shift"];
  EXPECT_THAT(shift["left_out"].get<std::string>(), HasSubstr("falx"));
  EXPECT_FALSE(shift["assumed"].empty());
  EXPECT_GT(shift["targets"][0]["shift_mm"], 0.0);
  EXPECT_LT(shift["targets"][0]["shift_mm"], shift["largest_of_all_mm"].get<double>());
  EXPECT_THAT(shift["band"].get<std::string>(), testing::StartsWith("unknown"));
  double before = -1.0;
  for (const Json& place : shift["profile"]) {
    EXPECT_GT(place["depth_mm"], before);
    before = place["depth_mm"];
  }

  const Json few = shifted(folder, targets + "--tables", "few")["shift"];
  EXPECT_EQ(few["largest_at_opening_mm"], shift["largest_at_opening_mm"]);
  EXPECT_EQ(text_of(folder / "few" / "profile.csv"), text_of(folder / "two" / "profile.csv"));
  for (const char* file : {"images", "overview.png", "report.html"}) {
    EXPECT_TRUE(fs::exists(folder / "two" / file)) << file;
    EXPECT_FALSE(fs::exists(folder / "few" / file)) << file;
  }
}

// The label's name is one that a shell would run.
TEST(Shift, IsRepeatedByTheCommandOnItsPageFromAnyFolder) {
  const fs::path folder = fresh_folder();
  std::ofstream(folder / "names.txt") << "1 255 0 0 1 1 1 \"my brain $(touch ran)\"\n";
  fs::copy_file(block_of_brain, folder / "block.nrrd");
  const Ran ran = good(folder, {"shift", "block.nrrd", "-o", "its results", "--label-names", "names.txt",
                                "--brain", "my brain $(touch ran)", "--opening", "0,0,30,15", "--up",
                                "superior", "--nodes", "500", "--mu", "300", "--target=-5,0,25", "-q"});
  const std::string page = text_of(folder / "its results" / "report.html");
  std::string command = held_by(page, "dimple-data").at("command");
  command.replace(command.find("&& dimple "), 10, "&& " DIMPLE_PROGRAM " ");
  fs::create_directories(folder / "elsewhere");
  const Ran again = Program(folder / "elsewhere", {"-c", command}, "/bin/sh").wait();
  ASSERT_EQ(again.code, 0) << command << '\n' << again.err;
  EXPECT_EQ(text_of(folder / "its results" / "targets.csv"), text_of(folder / "again" / "targets.csv"));
  for (const fs::path& where : {folder, folder / "elsewhere"}) EXPECT_FALSE(fs::exists(where / "ran"));
}

TEST(Shift, SaysByHowMuchItsNodesMayPutItOff) {
  const fs::path folder = fresh_folder();
  const auto with = [&](const std::string& nodes, const std::string& more = "") {
    good(folder, "shift " + block_of_brain + " -q --tables --force -o " + nodes +
                     " --opening 0,0,30,15 --up superior --mu 300 --target 0,0,25 --nodes " + nodes + more);
    return Json::parse(text_of(folder / nodes / "summary.json"))["shift"];
  };
  const Json shift = with("4000");
  const std::string table = text_of(folder / "4000" / "targets.csv");
  const Json half = with("2000"), off = with("4000", " --set accuracy.band=off");
  const double largest = shift["largest_at_opening_mm"];
  double change = std::abs(largest - half["largest_at_opening_mm"].get<double>());
  for (const char* list : {"targets", "profile"})
    for (std::size_t k = 0; k < shift[list].size(); ++k) {
      double sum = 0.0;
      for (int d = 0; d < 3; ++d)
        sum += std::pow(shift[list][k]["components_mm"][d].get<double>() -
                            half[list][k]["components_mm"][d].get<double>(),
                        2);
      change = std::max(change, std::sqrt(sum));
    }
  EXPECT_GT(change, 0.0);
  EXPECT_NEAR(shift["band_mm"], std::max(change, 0.25 * largest), 1e-3 * largest);
  EXPECT_THAT(table, HasSubstr(",band_mm"));
  EXPECT_EQ(half["band"], "unknown: not calibrated below 4000 nodes");
  EXPECT_TRUE(half["band_mm"].is_null());
  EXPECT_THAT(text_of(folder / "2000" / "targets.csv"), Not(HasSubstr("band_mm")));
  EXPECT_EQ(off["band"], "unknown: accuracy.band is off");
  EXPECT_EQ(off["largest_at_opening_mm"], largest);
}

TEST(Shift, ThatIsStoppedWhileItsNodesAreComparedKeepsWhatItHasFound) {
  const fs::path folder = fresh_folder();
  const std::string scene =
      "shift " + block_of_brain +
      " --tables --opening 0,0,30,15 --up superior --mu 300 --target 0,0,25 --nodes 4000 ";
  const auto reported = [&](const char* out) { return summary_of(folder / out); };
  good(folder, scene + "-q -o whole --set accuracy.band=off");
  {
    Program program(folder, words_of(scene + "-o out"));
    while (program.running() && program.err_so_far().find("net force") == std::string::npos)
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    ASSERT_TRUE(program.running()) << program.err_so_far();
    program.send(SIGINT);
    EXPECT_EQ(program.wait().code, 130);
  }
  EXPECT_EQ(reported("out")["status"], "interrupted");
  EXPECT_EQ(reported("out")["shift"]["band"], "unknown: the run was stopped first");
  for (const char* list : {"targets", "profile"})
    EXPECT_EQ(reported("out")["shift"][list], reported("whole")["shift"][list]) << list;
  EXPECT_EQ(text_of(folder / "out" / "targets.csv"), text_of(folder / "whole" / "targets.csv"));
}

TEST(Shift, IsExplainedByOneDoubtAtATimeInMillimetres) {
  const fs::path folder = fresh_folder();
  const Json summary = shifted(folder, "-q --explain", "out");
  std::istringstream rows(text_of(folder / "out" / "explain.csv"));
  std::string row;
  std::getline(rows, row);
  EXPECT_EQ(row, "choice,instead,kind,change_mm,elsewhere_mm,wall_s,verdict");
  std::map<std::string, double> of;  // by choice and its alternative
  while (std::getline(rows, row)) {
    std::smatch cell;
    const std::regex cells("\"([^\"]*)\",\"([^\"]*)\",[a-z]+,([^,]*),.*");
    ASSERT_TRUE(std::regex_match(row, cell, cells)) << row;
    if (cell[3] != "") of[cell[1].str() + ": " + cell[2].str()] = std::stod(cell[3]);
  }
  const double shift = summary["shift"]["largest_at_opening_mm"];
  EXPECT_GT(of.at("shear modulus: 150 Pa instead of 300 Pa"), 0.05 * shift);
  EXPECT_LT(of.at("shear modulus: 600 Pa instead of 300 Pa"), -0.1 * shift);
  EXPECT_LT(of.at("fluid lost: 40 % instead of 60 %"), 0.0);
  EXPECT_GT(of.at("fluid lost: 80 % instead of 60 %"), 0.0);
  for (const char* doubt :
       {"gap: 4 mm instead of 2 mm", "friction at the skull: 0.3 instead of none",
        "opening: radius 20 mm instead of 15 mm", "direction of up: tilted by 15 degrees, left",
        "number of nodes: 1000 instead of 500"})
    EXPECT_TRUE(of.contains(doubt)) << doubt;
  EXPECT_THAT(text_of(folder / "out" / "report.html"), HasSubstr("What the shift depends on"));
  EXPECT_GT(summary["parts_wall_s"]["comparing"], 0.0);
}

TEST(Shift, IsRefusedBeforeAnythingIsBuiltWhereItIsNotUnderstood) {
  const fs::path folder = fresh_folder();
  const auto refused = [&](const std::string& options, const std::string& fact) {
    const Ran ran = dimple(folder, "shift " + block_of_brain + " -o out " + options);
    EXPECT_NE(ran.code, 0) << options;
    EXPECT_THAT(ran.err, HasSubstr(fact)) << options;
  };
  refused("--up superior", "--opening");
  refused("--opening 0,0,90,15 --up 0,0,1e300", "from the brain's surface");  // direction of any length
  refused("--opening 0,0,30 --up superior", "has 3 numbers");
  refused("--opening 0,0,30,0 --up superior", "radius = 0 is not allowed");
  refused("--opening 0,0,30,15 --up 0,0,0", "no direction");
  refused("--opening 0,0,30,15 --up up", "'up' is no side of the patient");
  const std::string well = "--opening 0,0,30,15 --up superior ";
  for (const auto& [option, fact] : {std::pair{"--fluid-lost 60", "give 60%"},
                                     {"--fluid-lost 0%", "0"},
                                     {"--target 0,0", "has 2 numbers"},
                                     {"--target 0,0,60", "outside of the brain"},
                                     {"--skull 7", "no label '7'"},
                                     {"--gap wide", "--gap"}})
    refused(well + option, fact);
}

}  // namespace
}  // namespace dimple
