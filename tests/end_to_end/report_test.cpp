// Content of report.html in a browser: its numbers are the summary's, and it loads nothing from elsewhere.
// Without 3D graphics, or in print, pictures and numbers are still there.

#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/picture_pixels.hpp"

namespace dimple {
namespace {

// Path of a program; empty if there is none.
std::string program_named(const std::string& name) {
  std::istringstream path(std::getenv("PATH") ? std::getenv("PATH") : "");
  for (std::string folder; std::getline(path, folder, ':');)
    if (fs::exists(fs::path(folder) / name)) return (fs::path(folder) / name).string();
  return {};
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
  return text;
}

/// Value of a key such as "counts.circle_centre_mm.0".
const Json& found(const Json& summary, const std::string& key) {
  return summary.at(Json::json_pointer("/" + replaced(key, ".", "/")));
}

class Report : public InFolder {
 protected:
  const std::string browser = program_named("chromium");

  void SetUp() override {
    if (browser.empty())
      GTEST_SKIP() << "no browser is installed, so the page is not opened (Debian: chromium)";
    good("phantom brain.nrrd --spacing 3");
  }
  void run(const std::string& options = "") const {
    good("run brain.nrrd -o out --nodes 1000 --depth 4mm --frames 4" + options);
  }
  Ran browse(const std::vector<std::string>& how) const {
    std::vector<std::string> words = {"--headless",
                                      "--no-sandbox",
                                      "--disable-gpu",
                                      "--disable-quic",
                                      "--no-first-run",
                                      "--disable-background-networking",
                                      "--disable-component-update",
                                      "--disable-sync",
                                      "--host-resolver-rules=MAP * ~NOTFOUND",
                                      "--virtual-time-budget=5000",
                                      "--user-data-dir=" + (folder / "profile").string()};
    words.insert(words.end(), how.begin(), how.end());
    words.push_back("file://" + (folder / "out" / "report.html").string());
    return Program(folder, words, browser).wait();
  }
  std::string shown(const std::vector<std::string>& how = {"--disable-3d-apis"}) const {
    std::vector<std::string> words = how;
    words.push_back("--dump-dom");
    const std::string page = browse(words).out;
    EXPECT_THAT(page, Not(HasSubstr(" data-problem=\""))) << "a part was not drawn";
    EXPECT_TRUE(std::regex_search(page.substr(0, 300), std::regex("<html[^>]*class=\"[a-z ]*ready")));
    return page;
  }
};

// Keys of the numbers that the page shows; each marked number must be the summary's.
std::set<std::string> keys_shown(const std::string& page, const Json& numbers) {
  const std::regex mark("<span([^>]*) ?data-key=\"([^\"]+)\"(?: data-scale=\"([^\"]+)\")?>([^<]*)</span>");
  std::set<std::string> keys;
  for (std::sregex_iterator m(page.begin(), page.end(), mark), end; m != end; ++m) {
    const std::string key = (*m)[2], scale = (*m)[3];
    std::string text = replaced(replaced((*m)[4], "&lt;", "<"), "&gt;", ">");
    text = replaced(text, "&amp;", "&");
    SCOPED_TRACE(key + ": " + text);
    keys.insert(key);
    const Json& value = found(numbers, key);
    if (scale.empty()) {
      EXPECT_EQ(text, value.is_string() ? value.get<std::string>() : value.dump());
      continue;
    }
    text = replaced(text, "\xE2\x88\x92", "-");
    const double exact = value.get<double>() * std::stod(scale);
    if (text.starts_with("< ")) {
      EXPECT_LT(std::abs(exact), std::stod(text.substr(2)));
      EXPECT_NE(exact, 0.0);
      continue;
    }
    const std::size_t power = text.find('e'), point = text.find('.');
    const double places =
        point == std::string::npos ? 0.0 : static_cast<double>(std::min(power, text.size()) - point - 1);
    const double last =
        std::pow(10.0, -places + (power == std::string::npos ? 0.0 : std::stod(text.substr(power + 1))));
    EXPECT_NEAR(std::stod(text), exact, 0.5000001 * last);
  }
  return keys;
}

TEST_F(Report, ShowsTheNumbersOfTheSummaryAndNoOthersAndAsksNobodyForAnything) {
  std::ofstream(folder / "measured.csv") << "indentation_mm,force_N\n1,0.01\n2,0.02\n4,0.05\n";
  run(" --compare measured.csv");
  const Json numbers = summary();
  EXPECT_EQ(held_by(text("out/report.html"), "dimple-summary"), numbers);
  EXPECT_LT(fs::file_size(folder / "out" / "report.html"), 4'000'000u);

  const fs::path log = folder / "net.json";
  const std::set<std::string> keys =
      keys_shown(shown({"--disable-3d-apis", "--log-net-log=" + log.string()}), numbers);
  for (const char* key :
       {"force_N", "indentation_mm", "band.low_N", "band.high_N", "verdict.image.value",
        "verdict.model.value", "verdict.equilibrium.value", "verdict.energy.value", "verdict.accuracy.value",
        "verdict.accuracy.word", "warnings.0", "material.0.mu_Pa", "counts.nodes", "model.base_reason",
        "model.circle_reason", "total_wall_s", "compare.ratio_at_end", "image_sha256", "version"})
    EXPECT_TRUE(keys.contains(key)) << key;
  EXPECT_TRUE(keys.contains("image_error.half_N"));

  const std::string requested = text_of(log), page = text("out/report.html");
  ASSERT_FALSE(requested.empty());
  const std::regex initiated("\"initiator\":\"(file|null)[^\"]*\"[^}]*\"url\":\"(https?|wss?):[^\"]*\"");
  EXPECT_FALSE(std::regex_search(requested, initiated));
  EXPECT_THAT(page, HasSubstr("default-src 'none'")) << "the browser would refuse it too";
  EXPECT_FALSE(
      std::regex_search(page.substr(0, page.find("dimple-data")), std::regex("(src|href)=\"?https?:")));
}

TEST_F(Report, OfABrainShiftShowsItsNumbers) {
  good(
      "shift brain.nrrd -o out --opening 0,0,40,20 --up superior --nodes 600 --mu 200 "
      "--gap 0.2 --target 0,0,5");
  const Json numbers = summary();
  EXPECT_EQ(held_by(text("out/report.html"), "dimple-summary"), numbers);
  const std::set<std::string> keys = keys_shown(shown(), numbers);
  for (const char* key :
       {"shift.middle_mm", "shift.largest_at_opening_mm", "shift.along_gravity_mm",
        "shift.targets.0.shift_mm", "shift.profile.0.shift_mm", "shift.band", "shift.assumed.0",
        "shift.left_out", "walls.skull.force_size_N", "walls.skull.largest_penetration_mm",
        "material.0.mu_Pa", "counts.nodes", "total_wall_s"})
    EXPECT_TRUE(keys.contains(key)) << key;
}

TEST_F(Report, OfTwoToolsInContactWithACutBodyNextToAWallShowsTheNumbersOfAll) {
  run(" --tool sphere:5mm --cut line:12,-20,25,12,20,25,depth=10mm --wall around:0.2mm --set "
      "tool.other.shape=sphere:4mm --set tool.other.at=-20,0,25 --set tool.other.move=1mm");
  const Json numbers = summary();
  ASSERT_GT(numbers["walls"]["wall"]["places_that_touch"], 0);
  const std::string page = shown();
  const std::set<std::string> keys = keys_shown(page, numbers);
  for (const char* key :
       {"tool.words", "tool.first_touch_mm.2", "tool.contact_area_mm2", "tool.samples_in_contact",
        "tool.largest_pressure_Pa", "tool.largest_penetration_mm", "other_tools.other.force_size_N",
        "walls.wall.force_size_N", "model.cut.area_mm2", "model.cut.removed_mm3", "contact"})
    EXPECT_TRUE(keys.contains(key)) << key;
  EXPECT_FALSE(keys.contains("counts.circle_nodes"));
  EXPECT_THAT(page, Not(HasSubstr("class=\"mark node circle\"")));
  EXPECT_TRUE(std::regex_search(page, std::regex("<path class=\"wall\" d=\"M[0-9]")))
      << "and where the wall stands";
}

TEST_F(Report, TurnsTheBodyWithWebGLAndShowsAPictureWithout) {
  run();
  const std::string flat = shown();
  EXPECT_THAT(flat, HasSubstr("class=\"drawn\" src=\"data:image/png;base64,"));
  EXPECT_TRUE(std::regex_search(flat.substr(0, 300), std::regex("<html[^>]*class=\"flat")));
  EXPECT_THAT(flat, Not(HasSubstr("class=\"view3d\"")));
  const std::string solid =
      shown({"--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"});
  EXPECT_THAT(solid, HasSubstr("class=\"view3d\""));
  EXPECT_FALSE(std::regex_search(solid.substr(0, 300), std::regex("<html[^>]*flat")));
}

TEST_F(Report, ShowsTheToolInItsColourAndNamesItBelowTheBody) {
  run(" --write surface,report");
  const std::vector<std::string> with_webgl = {"--use-gl=angle", "--use-angle=swiftshader",
                                               "--enable-unsafe-swiftshader"};
  EXPECT_TRUE(std::regex_search(
      shown(with_webgl),
      std::regex(
          "class=\"mark tool\"></span>tool, <span class=\"quantity\"><span[^>]*counts.circle_diameter_mm")));
  std::vector<std::string> words = with_webgl;
  words.insert(words.end(), {"--window-size=1000,2600", "--screenshot=" + (folder / "page.png").string()});
  browse(words);
  const auto is_tool = [](int r, int g, int b) { return g > r + 30 && b > r + 35 && std::abs(g - b) < 25; };
  const auto is_black = [](int r, int g, int b) { return r < 20 && g < 20 && b < 20; };
  EXPECT_GT(fraction_of_pixels(folder / "page.png", is_tool), 4e-4);
  EXPECT_LT(fraction_of_pixels(folder / "page.png", is_black), 1e-4)
      << "words are dark grey, and nothing is black";
}

TEST_F(Report, HoldsTheToolThatTheFilesForParaViewHold) {
  run(" --write surface,report");
  const Json tool = held_by(text("out/report.html"), "dimple-data").at("tool");
  const SurfaceFile file = read_vtp(folder / "out" / "tool" / "tool_0000.vtp");
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(tool.at("low_mm").at(static_cast<std::size_t>(c)).get<double>(),
                file.position_mm.row(c).minCoeff(), 1e-5);
  EXPECT_EQ(tool.at("triangles").get<std::string>().size(),
            static_cast<std::size_t>(8 * ((file.triangles.size() * 2 + 5) / 6)));
}

TEST_F(Report, MovesTheToolAsTheStepsDoAndSaysItsDepth) {
  run(" --tool sphere:5mm --set step.press.move=4mm --set step.slide.move=3,0,0");
  const Json frames = held_by(text("out/report.html"), "dimple-data")["body"]["frames"];
  const Json& last = frames.back();
  EXPECT_NEAR(last["depth_mm"], 4.0, 1e-6);
  EXPECT_NEAR(last["tool_mm"][0], 3.0, 1e-6);
  EXPECT_NEAR(last["tool_mm"][2], -4.0, 1e-6);
  EXPECT_EQ(frames.front()["depth_mm"], 0.0);
}

TEST_F(Report, ShowsTheToolWhereGravityHasCarriedItsPatch) {
  run(" --gravity left --mu 2kPa --band off");
  const Json moved = summary()["loads"]["circle_moved_mm"];
  ASSERT_GT(std::abs(moved[0].get<double>()), 0.2);
  const Json frames = held_by(text("out/report.html"), "dimple-data")["body"]["frames"];
  EXPECT_NEAR(frames.front()["tool_mm"][0], moved[0], 1e-6);
}

TEST_F(Report, OfASceneOfStepsUnderLoadsShowsEachOfThem) {
  good("phantom block.nrrd --shape block --size 60,60,30 --spacing 3");
  good(
      "run block.nrrd -o out --base inferior --indent-at 0,0,top --nodes 600 --mu 2kPa "
      "--tool sphere:3mm --friction 0.3 --gravity left --membrane 0.1mm:4kPa --set "
      "load.pressure.csf.pressure=200Pa --set support.r.on=right --set "
      "support.r.hold=sliding --set step.press.move=1.5mm --set step.slide.move=0,0,6");
  const std::string page = shown();
  const std::set<std::string> keys = keys_shown(page, summary());
  for (const char* key :
       {"loads.gravity_m_per_s2.0", "loads.pressure_Pa.csf", "loads.settled_mm", "membranes.surface.mu_Pa",
        "membranes.surface.thickness_mm", "supports.r.nodes", "supports.r.force_N.0", "material.0.mu_Pa",
        "contact", "largest_force.force_N", "largest_force.step", "force_N", "scene.0.largest_force_N",
        "scene.1.lateral_force_N", "scene.1.time_s"})
    EXPECT_TRUE(keys.contains(key)) << key;
  EXPECT_THAT(page, HasSubstr("<h2>Force over time</h2>"));
  EXPECT_TRUE(std::regex_search(page, std::regex("<path class=\"lateral\" d=\"M[0-9]")));
}

// The bounds of the last force alone would be taken for those of the largest.
TEST_F(Report, OfASceneOfStepsSaysTheErrorOfAllItsForces) {
  good(
      "run brain.nrrd -o out --nodes 1500 --frames 4 --tool sphere:6mm --set step.press.move=2mm "
      "--set step.lift.move=-4mm");
  const std::set<std::string> keys = keys_shown(shown(), summary());
  EXPECT_TRUE(keys.contains("band.half_N"));
  EXPECT_FALSE(keys.contains("band.low_N"));
}

TEST_F(Report, PrintsItsVerdict) {
  run();
  const fs::path pdf = folder / "report.pdf";
  browse({"--disable-3d-apis", "--print-to-pdf=" + pdf.string()});
  ASSERT_TRUE(text_of(pdf).starts_with("%PDF"));
  const std::string reader = program_named("pdftotext");
  if (reader.empty())
    GTEST_SKIP() << "pdftotext is not installed, so the words on paper are not read (Debian: poppler-utils)";
  const std::string words = Program(folder, {pdf.string(), "-"}, reader).wait().out;
  expect_words(words, {"Image", "Model", "Equilibrium", "Energy", "Accuracy", "at 4.00 mm"});
}

TEST_F(Report, IsWrittenWithoutAnImageToo) {
  good("model brain.nrrd -o model --nodes 1000");
  good("solve model -o out --depth 2mm --frames 2 --write report");
  EXPECT_THAT(shown(), HasSubstr("no image was read"));
}

}  // namespace
}  // namespace dimple
