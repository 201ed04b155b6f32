// Successful runs of the program: files, output, and the same bits each time.

#include <cstring>

#include "io/label_image.hpp"
#include "tests/end_to_end/in_folder.hpp"
#include "tests/helpers/image.hpp"

namespace dimple {
namespace {

// Coarse and fast, about a second each; 400 and 500 nodes in a swine brain are 6 to 7 mm apart.
const std::string node_set = " --nodes 500";
// Slow enough to keep the wave of the sudden start, proportional to the rate, below the force.
const std::string load = " --depth 0.5mm --rate 5mm/s --frames 4";
const std::string tables_alone = load + " --write force";  // for tests of the tables alone

class Run : public InFolder {
 protected:
  void SetUp() override { good("phantom brain.nrrd --spacing 3"); }

  std::string force(const std::string& out) const {
    const std::string curve = text(fs::path(out) / "force.csv");
    EXPECT_THAT(curve, testing::StartsWith("time_s,indentation_mm,force_N"));
    return curve;
  }
  /// Content of force.csv without the column of the image, which a model's files do not hold.
  std::string without_image_error(const std::string& out) const {
    std::istringstream lines(force(out));
    std::string result;
    std::ptrdiff_t column = -1;
    for (std::string line; std::getline(lines, line);) {
      std::vector<std::string> field;
      std::istringstream fields(line);
      for (std::string text; std::getline(fields, text, ',');) field.push_back(text);
      if (column < 0) column = std::find(field.begin(), field.end(), "image_half_N") - field.begin();
      if (column == std::ssize(field)) return "no column image_half_N";
      field.erase(field.begin() + column);
      for (std::size_t k = 0; k < field.size(); ++k) result += (k > 0 ? "," : "") + field[k];
      result += '\n';
    }
    return result;
  }
  double last_force(const std::string& out) const { return end_of(folder / out); }
};

/// Paths of the frames that a .pvd lists; each must exist.
std::vector<fs::path> frames_of(const fs::path& pvd) {
  const std::string text = text_of(pvd);
  const std::regex file("file=\"([^\"]+)\"");
  std::vector<fs::path> frames;
  for (std::sregex_iterator m(text.begin(), text.end(), file), end; m != end; ++m) {
    frames.push_back(pvd.parent_path() / (*m)[1].str());
    EXPECT_TRUE(fs::is_regular_file(frames.back())) << frames.back();
  }
  return frames;
}

TEST_F(Run, GoesFromImageToForceStepByStep) {
  EXPECT_EQ(good("phantom other.nrrd --spacing 3").out, "other.nrrd\n");
  const Ran info = good("info brain.nrrd");
  expect_words(info.out, {"left_hemisphere", "right_hemisphere", "LPS", "3 x 3 x 3 mm", "volume", "cm3"});

  good("model brain.nrrd -o model" + node_set);
  for (const char* name : {"model.toml", "nodes.vtu", "points.vtu", "surface.vtp", "label.vti"})
    EXPECT_TRUE(fs::is_regular_file(folder / "model" / name)) << name;

  const Ran solve = good("solve model -o out" + load);
  EXPECT_TRUE(
      std::regex_match(solve.out, std::regex("[0-9.]+ mN at 0.50 mm, no error estimate: a model's files hold "
                                             "one set of nodes, and the estimate needs two\tout\n")))
      << solve.out;
  for (const char* name :
       {"summary.json", "config.resolved.toml", "force.csv", "energy.csv", "overview.png", "label.vti"})
    EXPECT_GT(fs::file_size(folder / "out" / name), 0u) << name;
  for (const char* name : {"nodes.pvd", "surface.pvd", "section.pvd", "tool.pvd"})
    EXPECT_EQ(frames_of(folder / "out" / name).size(), 5u) << name;
  EXPECT_EQ(frames_of(folder / "out" / "points.pvd").size(), 1u) << "the last";
  EXPECT_EQ(summary("out").at("status"), "finished");
  EXPECT_GT(summary("out").at("force_N"), 0.0);
  EXPECT_EQ(text_of(folder / "out" / "overview.png").substr(1, 3), "PNG");
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    EXPECT_THAT(entry.path().string(), Not(HasSubstr(".part"))) << "left over: " << entry.path();
}

TEST_F(Run, IsModelAndSolveBitForBitAndPrintsJsonAloneOnRequest) {
  const Ran made = good("model brain.nrrd -o model --quiet --json" + node_set),
            solved = good("solve model -o two_steps --quiet" + load),
            run = good("run brain.nrrd -o one_step --quiet --json" + node_set + load);
  for (const Ran* ran : {&made, &solved, &run}) EXPECT_EQ(ran->err, "");
  EXPECT_EQ(Json::parse(made.out).at("counts").at("nodes"), 500);
  EXPECT_EQ(Json::parse(run.out), summary("one_step"));
  EXPECT_EQ(Json::parse(good("info brain.nrrd --json").out).at("labels").size(), 2u);
  EXPECT_EQ(force("two_steps"), without_image_error("one_step"));
  EXPECT_EQ(text("model/nodes.vtu"), text("one_step/model/nodes.vtu"));
  good("solve one_step/model -o again" + load);
  EXPECT_EQ(force("again"), without_image_error("one_step"));
}

TEST_F(Run, IsRepeatedBitForBitByTheConfigurationItWrote) {
  good(
      "run brain.nrrd -o first --set material.mu=0.3kPa --nu 0.49 --density 1.04g/cm3 --seed 3 --safety 0.8"
      " --indent-at superior,left --label left_hemisphere,2" +
      node_set + tables_alone);
  good("run --config first/config.resolved.toml -o second");
  EXPECT_EQ(force("first"), force("second"));
  EXPECT_THAT(text_of(folder / "second" / "config.resolved.toml"), HasSubstr("mu_Pa = 300.0"));
  good("run --config first/config.resolved.toml -o third --mu 600");  // the command line wins
  EXPECT_NE(force("first"), force("third"));
  EXPECT_NEAR(last_force("third") / last_force("first"), 2.0, 0.5);
}

// The load is slow enough for equilibrium, for which the error bounds are calibrated.
const std::string slow_load = " --depth 1mm --frames 4 --write force,picture";

TEST_F(Run, ReportsItsForceWithItsErrorBounds) {
  const Ran ran = good("run brain.nrrd -o out --nodes 1000" + slow_load);
  std::smatch reported;
  const std::regex line(
      "([0-9.]+) mN at 1.00 mm, ([0-9.]+) to ([0-9.]+) \\(discretisation\\), \\+- [0-9.]+ \\(image "
      "resolution\\)\tout\n");
  ASSERT_TRUE(std::regex_match(ran.out, reported, line)) << ran.out;
  const Table curve = read_csv(folder / "out" / "force.csv");
  ASSERT_NE(curve.find("low_N"), nullptr);
  const double low = curve.find("low_N")->back(), force = last_force("out"),
               high = curve.find("high_N")->back();
  EXPECT_NEAR(std::stod(reported[2]), 1e3 * low, 5.01e-2);
  EXPECT_NEAR(std::stod(reported[3]), 1e3 * high, 5.01e-2);
  EXPECT_LT(low, force);
  EXPECT_NEAR(high - force, force - low, 1e-12);
  EXPECT_DOUBLE_EQ(summary("out").at("band").at("low_N").get<double>(), low);
  EXPECT_EQ(summary("out").at("band").at("coarser_nodes"), 500);

  good("run brain.nrrd -o without --nodes 1000 --band off" + slow_load);
  EXPECT_EQ(last_force("without"), force) << "the band changes no force";
  EXPECT_EQ(read_csv(folder / "without" / "force.csv").find("low_N"), nullptr);

  good("run brain.nrrd -o finer --nodes 8000 --band off" + slow_load);
  EXPECT_GT(last_force("finer"), low);
  EXPECT_LT(last_force("finer"), high);
}

TEST_F(Run, SaysWhyItsErrorBoundsAreUnknown) {
  const std::map<std::string, std::string> why = {
      {"--nodes 999", "not calibrated below 1000 nodes"},
      {"--nodes 1000 --rim 0.1", "default --rim"},
      {"--nodes 1000 --time explicit --rate 20mm/s", "not calibrated for dynamics"},
      {"--nodes 1000 --contact frictionless", "frictionless contact patch"},
      {"--nodes 1000 --preset miller_chinzei_2002", "viscoelastic tissue"},
      {"--nodes 1000 --nu 0.4", "nu outside 0.45 to 0.499"}};
  for (const auto& [options, reason] : why) {
    const Ran ran = good("run brain.nrrd --force -o out -q " + options + slow_load);
    EXPECT_THAT(ran.out, HasSubstr("no error estimate: "));
    EXPECT_THAT(ran.out, HasSubstr(reason));
    EXPECT_THAT(summary("out").at("band").at("unknown").get<std::string>(), HasSubstr(reason));
  }
}

// Error bounds are calibrated up to 1.7 radii; 1.6 is within.
TEST_F(Run, HasNoErrorBoundsDeeperThanTheyWereMeasured) {
  const std::string scene = "run brain.nrrd --nodes 1000 --indenter-diameter 8 --frames 4 --write force -q";
  good(scene + " -o within --depth 6.4mm");
  EXPECT_TRUE(summary("within").at("band").contains("half_N")) << summary("within").at("band").dump();
  good(scene + " -o deeper --depth 7mm");
  EXPECT_THAT(summary("deeper").at("band").value("unknown", ""), HasSubstr("above 1.7 radii"))
      << summary("deeper").at("band").dump();
  EXPECT_EQ(read_csv(folder / "deeper" / "force.csv").find("low_N"), nullptr);
}

// Metres per second in place of millimetres: few rows and a force of inertia alone once gave no warning.
TEST_F(Run, TooFastForEquilibriumIsSampledAndWarnsWhereTheBaseDoesNotBearTheForce) {
  const Ran ran =
      good("run brain.nrrd -o out --nodes 400 --depth 1mm --rate 1m/s --frames 2 --write force --band off");
  EXPECT_GE(read_csv(folder / "out" / "force.csv").rows(), 20u);
  const std::string inertia = "the force includes inertia";
  EXPECT_THAT(ran.err, HasSubstr("warning: " + inertia));
  EXPECT_THAT(summary("out").at("warnings").dump(), HasSubstr(inertia));
}

TEST_F(Run, AsksForTheUnitOfNumbersThatLookLikeMetresOrKilopascals) {
  const std::string scene = "run brain.nrrd -o out --force --nodes 400 --frames 1 --write force --band off ";
  const std::string question = "check the units of ";
  for (const auto& [numbers, of] : std::vector<std::pair<std::string, std::string>>{
           {"--depth 0.008", "--depth"},
           {"--depth 1mm --mu 0.21", "the material"},
           {"--depth 1mm --membrane 0.1:400", "the membrane 'surface'"},
           {"--depth 1mm --membrane 0.0001:400kPa", "the membrane 'surface'"}}) {
    const Ran ran = good(scene + numbers);
    EXPECT_THAT(ran.err, HasSubstr(question + of)) << numbers;
    EXPECT_THAT(summary("out").at("warnings").dump(), HasSubstr(question + of)) << numbers;
  }
  EXPECT_THAT(good(scene + "--depth 1mm --membrane 0.1mm:400kPa").err, Not(HasSubstr(question)));
  ends_with(folder, 2, "run brain.nrrd -o small --tool sphere:0.005 --depth 1", {"are the units of --tool"});
}

// The base bears the tool's force: up to the residual in equilibrium, up to vibrations otherwise.
TEST_F(Run, RestsOnItsBaseWithTheForceOnTheTool) {
  const std::string scene =
      "run brain.nrrd --nodes 400 --depth 1mm --frames 2 --write force,nodes,surface -q";
  const std::map<std::string, double> directions = {{"--time quasi-static", 2e-3},
                                                    {"--time explicit --rate 4mm/s --damping 60", 0.05}};
  for (const auto& [displacement, within] : directions) {
    SCOPED_TRACE(displacement);
    good(scene + " --force -o out " + displacement);
    const Json json = summary("out");
    const double force = json.at("force_N");
    EXPECT_GT(force, 0.0);
    EXPECT_NEAR(json.at("base_force_N"), force, within * force);
    if (displacement == "--time quasi-static") {
      EXPECT_LE(json.at("residual"), 1e-4);
    }
    // Nodal reactions agree.
    const std::vector<fs::path> frames = frames_of(folder / "out" / "nodes.pvd");
    const PointFile nodes = read_vtu(frames.back());
    const Field &reaction = *nodes.find("reaction_N"), &set = *nodes.find("node_set");
    const auto approach = json.at("counts").at("push").get<std::vector<double>>();
    double on_tool = 0.0, on_base = 0.0;
    for (Index a = 0; a < reaction.values.cols(); ++a) {
      const double along = reaction.values.col(a).dot(Vec3(approach[0], approach[1], approach[2]));
      if (set.values(0, a) == 2.0) on_tool += along;
      if (set.values(0, a) == 1.0) on_base -= along;
    }
    EXPECT_NEAR(on_tool, force, 1e-4 * force);
    // The tool's file has its displacement, and the body's weight follows from its volume.
    const std::vector<fs::path> tools = frames_of(folder / "out" / "tool.pvd");
    const Vec3 displacement =
        (read_vtp(tools.back()).position_mm - read_vtp(tools.front()).position_mm).rowwise().mean();
    EXPECT_LT((displacement - Vec3(approach[0], approach[1], approach[2])).norm(), 1e-3)
        << displacement.transpose();
    EXPECT_NEAR(json.at("mass_g"), 1e-3 * json.at("volume_mm3").get<double>(), 1e-3);
    EXPECT_NEAR(on_base, json.at("base_force_N"), 1e-4 * force);
  }
}

// README.md shows this number at its head.
TEST_F(Run, OfTheDefaultPhantomGivesTheForceThatTheReadmeShows) {
  good("phantom default.nrrd");
  const Ran ran = good("run default.nrrd -o out --band off --write force");
  EXPECT_THAT(ran.out, HasSubstr("76.5 mN at 8.00 mm"));
  EXPECT_NEAR(summary("out").at("force_N"), 0.0765, 5e-5);
  EXPECT_EQ(summary("out").at("counts").at("nodes"), 1500);
  EXPECT_THAT(text_of(fs::path(DIMPLE_SOURCE) / "README.md"), HasSubstr("76.5 mN at 8.00 mm"));
}

TEST_F(Run, ForAnAccuracyIsThatOfTheFewestNodesOfItsRefinement) {
  const Ran ran = good("run brain.nrrd -o out --accuracy 6%" + slow_load);
  const Json levels = summary("out").at("ladder");
  ASSERT_GE(levels.size(), 2u);
  EXPECT_EQ(levels.front().at("nodes"), 500);
  EXPECT_TRUE(levels.front().at("half_N").is_null()) << "one cloud has no band";
  EXPECT_LE(levels.back().at("half_N"), 0.06 * last_force("out"));
  for (std::size_t k = 1; k + 1 < levels.size(); ++k)
    EXPECT_GT(levels[k].at("half_N"), 0.06 * levels[k].at("force_N").get<double>());
  EXPECT_THAT(ran.err, HasSubstr("refine   level 1, 500 nodes: "));
  for (const char* name : {"overview.png", "force.csv"})
    EXPECT_GT(fs::file_size(folder / "out" / name), 0u) << name;

  const std::string nodes = std::to_string(levels.back().at("nodes").get<int>());
  good("run brain.nrrd -o plain --nodes " + nodes + slow_load);
  EXPECT_EQ(last_force("plain"), last_force("out"));

  const Ran in_time = good("run brain.nrrd -o in_time --budget 0.01s" + slow_load);
  EXPECT_EQ(summary("in_time").at("ladder").size(), 1u) << "there is one cloud in any case";
  EXPECT_THAT(in_time.out, HasSubstr("no error estimate"));
  good("run brain.nrrd -o by_force --accuracy 1N" + slow_load);
  EXPECT_EQ(summary("by_force").at("ladder").size(), 2u) << "the first cloud that has a band";
}

TEST_F(Run, ForAnAccuracyThatFinerNodesCannotReachHasTheErrorBoundsOfTheCoarserOnes) {
  good("phantom small.nrrd --size 52,70,26 --spacing 1.5");
  const Ran ran = good("run small.nrrd -o out --accuracy 5% --write force");
  const Json reported = summary("out"), levels = reported.at("ladder");
  ASSERT_GE(levels.size(), 2u) << ran.err;
  EXPECT_TRUE(ran.err.find("with 4000 nodes: the tissue passed a limit point") != std::string::npos ||
              ran.err.find("with 4000 nodes: no equilibrium was found") != std::string::npos)
      << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("was not reached: the error is +- "));
  EXPECT_THAT(ran.err, Not(HasSubstr("half the error needs"))) << "finer clouds end";
  EXPECT_EQ(levels.back().at("force_N").get<double>(), last_force("out")) << "of the finest";
  EXPECT_GT(levels.back().at("nodes"), levels.front().at("nodes").get<int>());
  EXPECT_GT(levels.back().at("half_N"), 0.05 * last_force("out"));
  EXPECT_EQ(reported.at("band").at("coarser_nodes"), levels.front().at("nodes"));
}

TEST_F(Run, ForTheAccuracyOfADisplacementClimbsUntilItsErrorBoundsAreAsNarrow) {
  const std::string place = " --quantity displacement@13.9,0,20";
  const Ran ran = good("run brain.nrrd -o out --accuracy 10%" + place + slow_load);
  const Json moved = summary("out").at("displacement"), levels = summary("out").at("ladder");
  ASSERT_GE(levels.size(), 2u);
  EXPECT_TRUE(levels.front().at("half_mm").is_null()) << "one cloud has no band";
  EXPECT_GT(moved.at("half_mm"), 0.0);
  EXPECT_LE(moved.at("half_mm"), 0.1 * moved.at("length_mm").get<double>());
  EXPECT_THAT(ran.out, HasSubstr("moved by"));
  EXPECT_THAT(ran.out, HasSubstr("(discretisation)"));
  good("run brain.nrrd -o by_length --accuracy 1mm" + place + slow_load);
  EXPECT_EQ(summary("by_length").at("ladder").size(), 2u) << "the first cloud that has a band";
  ends_with(folder, 2, "run brain.nrrd -o no --accuracy 1mN" + place, {"not one of its units"});
}

TEST_F(Run, ReportsWhatItsForceDependsOn) {
  const std::string sample = std::string(DIMPLE_SAMPLE_DATA) + "/block_3mm.nrrd";
  const std::string line =
      "run " + sample + " -o out --nodes 1000 --depth 3mm --frames 4 --band off --write report";
  const Ran ran = good(line + " --explain");
  EXPECT_THAT(text_of(folder / "out/report.html"), HasSubstr("What the force depends on: "))
      << "the chart is in the page";
  for (const char* name : {"explain.csv", "explain.md", "explain.png", "explain.svg"})
    EXPECT_GT(fs::file_size(folder / "out" / name), 0u) << name;
  EXPECT_THAT(ran.err, HasSubstr("explain  "));

  // Values: choice -> least and largest effect [%], in the order of the lines.
  std::istringstream lines(text_of(folder / "out/explain.csv"));
  std::string row;
  std::getline(lines, row);
  EXPECT_EQ(row, "choice,instead,kind,indentation_mm,force_N,effect_percent,wall_s,verdict");
  std::map<std::string, std::pair<double, double>> effect;
  std::vector<std::string> order;
  const std::regex fields("\"([^\"]*)\",\"([^\"]*)\",([a-z]+),([^,]*),([^,]*),([^,]*),.*");
  for (std::smatch field; std::getline(lines, row);) {
    ASSERT_TRUE(std::regex_match(row, field, fields)) << row;
    const std::string what = field[1];
    ASSERT_FALSE(field[6].str().empty()) << row << ": no force";
    const double percent = std::stod(field[6]);
    if (!effect.count(what)) effect[what] = {percent, percent}, order.push_back(what);
    effect[what] = {std::min(effect[what].first, percent), std::max(effect[what].second, percent)};
  }
  for (const char* what :
       {"cloud", "number of nodes", "integration points", "equilibrium", "steps of the load", "contact",
        "base", "circle", "segmentation", "surface", "voxels", "strain", "far tissue", "Poisson's ratio"})
    EXPECT_TRUE(effect.count(what)) << what;
  EXPECT_FALSE(effect.count("folds")) << "a block has none";
  const auto size = [&](const std::string& what) {
    return std::max(std::abs(effect[what].first), std::abs(effect[what].second));
  };
  for (std::size_t k = 1; k < order.size(); ++k) EXPECT_GE(size(order[k - 1]), size(order[k])) << order[k];
  EXPECT_LT(effect["contact"].second, -1.0) << "what slides is softer";
  EXPECT_LT(effect["Poisson's ratio"].second, 0.0) << "and what may be compressed";
  EXPECT_LT(effect["far tissue"].second, 0.0) << "and what has less around it";
  for (const char* what : {"equilibrium", "steps of the load"}) EXPECT_LT(size(what), 0.1) << what;

  // The force is that of the plain run, and a run without the flag removes older explanations.
  good(line + " --force -q");
  EXPECT_FALSE(fs::exists(folder / "out/explain.md"));
}

TEST_F(Run, IsProportionalToAModulusThatIsKnownToAFraction) {
  const Ran ran = good("run brain.nrrd -o out --mu 210Pa+-30%" + node_set + slow_load);
  EXPECT_THAT(ran.out, HasSubstr("(mu +- 30 %)"));
  const Table curve = read_csv(folder / "out" / "force.csv");
  good("run brain.nrrd -o stiff --mu 273Pa" + node_set + slow_load);
  EXPECT_NEAR(curve.find("mu_high_N")->back() / last_force("stiff"), 1.0, 2e-4);
  good("run brain.nrrd -o soft --mu 147Pa" + node_set + slow_load);
  EXPECT_NEAR(curve.find("mu_low_N")->back() / last_force("soft"), 1.0, 2e-4);
  EXPECT_DOUBLE_EQ(summary("out").at("band_of_mu").at("low_N").get<double>(), curve.find("mu_low_N")->back());
}

TEST_F(Run, WritesTheSameFilesInParallelToTheMarchAsWithOneThread) {
  for (const char* threads : {"1", "2", "3"})
    good("run brain.nrrd -o threads" + std::string(threads) + node_set + load + " --threads " + threads);
  int frames = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder / "threads1")) {
    const std::string file = entry.path().filename().string();
    if (!entry.is_regular_file() || file == "summary.json" || file == "overview.png" || file == "report.html")
      continue;  // these report times
    const fs::path name = entry.path().lexically_relative(folder / "threads1");
    frames += name.string().find("_000") != std::string::npos;
    for (const char* other : {"threads2", "threads3"})
      EXPECT_TRUE(text_of(entry.path()) == text_of(folder / other / name)) << other << ": " << name;
  }
  EXPECT_EQ(frames, 4 * 5 + 1) << "of the points the last";
}

TEST_F(Run, WritesWhatIsRequestedAndTheSameForce) {
  const auto files = [&](const std::string& out) {
    std::set<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder / out))
      names.insert(entry.path().filename().string());
    return names;
  };
  const std::set<std::string> always = {".dimple_files", "config.resolved.toml", "energy.csv", "force.csv",
                                        "summary.json"};
  good("run brain.nrrd -o all" + node_set + load);
  good("run brain.nrrd -o little --write force" + node_set + load);
  EXPECT_EQ(files("little"), always);
  EXPECT_EQ(force("little"), force("all"));

  good("run brain.nrrd -o some --write surface,picture" + node_set + load);
  std::set<std::string> expected = always;
  expected.insert(
      {"overview.png", "surface", "surface.pvd", "section", "section.pvd", "tool", "tool.pvd", "view.py"});
  EXPECT_EQ(files("some"), expected);
  EXPECT_EQ(text_of(folder / "some" / "surface" / "surface_0004.vtp"),
            text_of(folder / "all" / "surface" / "surface_0004.vtp"));
  good("run brain.nrrd -o fine --write surface,points,fine" + node_set + load);
  EXPECT_EQ(frames_of(folder / "fine" / "points.pvd").size(), 5u);
  EXPECT_EQ(read_vtp(folder / "fine" / "surface" / "surface_0004.vtp").triangles.cols(),
            read_vtp(folder / "all" / "model" / "surface.vtp").triangles.cols());
  const SurfaceFile packed = read_vtp(folder / "all" / "section" / "section_0004.vtp"),
                    fine = read_vtp(folder / "fine" / "section" / "section_0004.vtp");
  EXPECT_EQ(packed.position_mm, fine.position_mm);
  EXPECT_EQ(packed.fields.at(0).values, fine.fields.at(0).values) << "displacements";
  EXPECT_EQ(force("fine"), force("all"));

  good("run --config some/config.resolved.toml -o again");
  EXPECT_EQ(files("again"), expected);

  good("solve all/model -o solved --write points" + load);
  expected = always;
  expected.insert({"points", "points.pvd"});
  EXPECT_EQ(files("solved"), expected);
  EXPECT_EQ(force("solved"), without_image_error("all"));
  good("run brain.nrrd -o all --force --write force" + node_set + load);
  EXPECT_EQ(files("all"), always) << "an earlier run's files are gone";
}

/// Writes a block of 60 x 60 x 30 mm in voxels of 1.5 mm; three slits 3 mm wide go 18 mm into its left side.
void write_comb(const fs::path& file) {
  const auto label = [](Index i, Index j, Index k) {
    const bool block = i >= 2 && i < 42 && j >= 2 && j < 42 && k >= 2 && k < 22;
    return block && !(i >= 30 && k % 6 >= 4);
  };
  write_label_image(file, image_of({44, 44, 24}, Vec3::Constant(1.5), label));
}

TEST_F(Run, HasTheFoldsOfAFoldedBodyInContactUnlessTheyAreToPassOrInertiaTakesPart) {
  write_comb(folder / "comb.nrrd");
  const std::string scene = " --depth 2mm --frames 2";  // gaps up to twice the depth are checked
  good("run comb.nrrd -o touching --nodes 4000 --write model" + scene);
  const Json in_contact = summary("touching");
  EXPECT_GT(in_contact.at("self_contact").at("places"), 100);
  EXPECT_LT(in_contact.at("band").at("low_N"), in_contact.at("force_N").get<double>());
  good("solve touching/model -o solved --write force" + scene);
  EXPECT_EQ(summary("solved").at("force_N"), in_contact.at("force_N"));
  EXPECT_EQ(summary("solved").at("self_contact"), in_contact.at("self_contact"));
  for (const char* otherwise :
       {"--self-contact off", "--rate 1000", "--scheme horton2007", "--close 4mm", "--nu 0.3"}) {
    const std::string out = "other";
    good("run comb.nrrd --force -o " + out +
         " --nodes 1000 --band off --write force --depth 0.1mm --frames 1 " + otherwise);
    EXPECT_FALSE(summary(out).contains("self_contact")) << otherwise;
  }
  // A phantom has a single fissure, which does not count as a folded body.
  good("phantom fissure.nrrd --spacing 1.5");
  good("run fissure.nrrd -o phantom --nodes 600 --band off --write force --depth 4mm --frames 1");
  EXPECT_FALSE(summary("phantom").contains("self_contact"));
}

TEST_F(Run, ReportsNarrowFoldsAndClosesThemOnRequest) {
  write_comb(folder / "comb.nrrd");
  // With 600 nodes every second or third discretisation of the open comb finds no equilibrium.
  const std::string scene = " --nodes 1000 --depth 1mm --frames 2 --write model";
  const Ran open = good("run comb.nrrd -o open" + scene);
  const auto warns = [](const Ran& ran) {
    return ran.err.find("of the surface faces another part of it across a gap of less than 4 mm") !=
               std::string::npos &&
           ran.err.find("--close 4mm") != std::string::npos;
  };
  EXPECT_TRUE(warns(open)) << open.err;
  EXPECT_GT(summary("open").at("model").at("facing_share"), 0.2);
  EXPECT_EQ(summary("open").at("model").at("closed_volume_mm3"), 0.0);
  EXPECT_THAT(open.err, HasSubstr("come into contact in equilibrium"));

  const Ran closed = good("run comb.nrrd -o closed --close 4mm" + scene);
  EXPECT_FALSE(warns(closed)) << closed.err;
  EXPECT_TRUE(std::regex_search(
      closed.err, std::regex("closed   gaps narrower than 4 mm: [0-9.]+ cm3 added \\([0-9.]+ %\\)")))
      << closed.err;
  const Json model = summary("closed").at("model");
  EXPECT_LT(model.at("facing_share"), 0.02);
  EXPECT_NEAR(model.at("closed_volume_mm3"), 3 * 3.0 * 60 * 18, 1500.0);
  EXPECT_NEAR(model.at("organ_volume_mm3"), 60 * 60 * 30, 1500.0);
  EXPECT_THAT(text_of(folder / "closed" / "model" / "model.toml"), HasSubstr("gaps narrower than 4 mm"));

  const Ran plain = good("run brain.nrrd -o plain" + scene);
  EXPECT_FALSE(warns(plain)) << plain.err;
  EXPECT_THAT(good("model comb.nrrd -o thin --nodes 600 --close 2mm").err, HasSubstr("closes nothing"));
}

TEST_F(Run, SolvesTwoPlainListsOfLocations) {
  good("model brain.nrrd -o model --scheme horton2007" + node_set);
  good("solve model -o from_vtu" + tables_alone);
  const auto list = [&](const PointFile& points, const std::vector<std::string>& columns) {
    Table table{.header = {"x_mm", "y_mm", "z_mm"}, .column = {}};
    for (Index d = 0; d < 3; ++d) {
      const Eigen::VectorXd row = points.position_mm.row(d).transpose();
      table.column.emplace_back(row.begin(), row.end());
    }
    for (const std::string& column : columns) {
      const Eigen::VectorXd row = points.find(column)->values.row(0).transpose();
      table.header.push_back(column);
      table.column.emplace_back(row.begin(), row.end());
    }
    return table;
  };
  const PointFile nodes = read_vtu(folder / "model" / "nodes.vtu"),
                  points = read_vtu(folder / "model" / "points.vtu");
  std::string toml = text_of(folder / "model" / "model.toml");
  toml = std::regex_replace(toml, std::regex("nodes.vtu"), "nodes.csv");
  toml = std::regex_replace(toml, std::regex("points.vtu"), "points.csv");
  toml = std::regex_replace(toml, std::regex("surface = [^\n]*"), "");

  fs::create_directories(folder / "full");  // with all fields of the .vtu files: the same bits
  write_csv(folder / "full" / "nodes.csv", list(nodes, {"spacing_mm", "node_set"}));
  write_csv(folder / "full" / "points.csv", list(points, {"volume_mm3"}));
  std::ofstream(folder / "full" / "model.toml") << toml;
  good("solve full -o from_full" + tables_alone);
  EXPECT_EQ(force("from_full"), force("from_vtu"));

  fs::create_directories(folder / "plain");  // positions alone: missing data are assumed, with a warning
  write_csv(folder / "plain" / "nodes.csv", list(nodes, {}));
  write_csv(folder / "plain" / "points.csv", list(points, {}));
  std::ofstream(folder / "plain" / "model.toml") << toml;
  const Ran ran = good("solve plain -o from_plain" + tables_alone);
  expect_words(ran.err, {"warning", "no spacing", "no volume", "no node_set", "the force includes inertia"});
  EXPECT_GT(last_force("from_plain"), 0.0);
  EXPECT_EQ(summary("from_plain").at("warnings").size(), 4u + summary("from_plain").at("guards").size());
}

TEST_F(Run, SaysEveryTenthWithoutATerminalIfDetailIsRequested) {
  const Ran run =
      good("run brain.nrrd -o out -v --write force --depth 8mm --set solver.step_radii=0.1" + node_set);
  EXPECT_THAT(run.err, Not(HasSubstr("\r")));
  EXPECT_THAT(run.err, Not(HasSubstr("\033")));
  for (int tenth = 1; tenth <= 10; ++tenth) {
    // The line reports progress rounded down.
    std::ostringstream line;
    line << "solving  " << tenth << "[0-9] %";
    EXPECT_TRUE(std::regex_search(run.err, std::regex(line.str()))) << line.str() << '\n' << run.err;
  }
}

TEST_F(Run, TakesALabelByNameOrByNumberAndNamesFromATable) {
  good("phantom brain.nii.gz --spacing 3");  // NIfTI has no names: they are in a file next to it
  const std::string few = " --nodes 400" + tables_alone;
  good("run brain.nrrd -o by_name --label Right_Hemisphere" + few);  // case does not matter
  good("run brain.nrrd -o by_number --label 2" + few);
  good("run brain.nii.gz -o named --label right_hemisphere --label-names brain.labels.txt" + few);
  good("run brain.nii.gz -o numbered --label 2" + few);
  EXPECT_EQ(force("by_name"), force("by_number"));
  EXPECT_EQ(force("named"), force("numbered"));
  good("run brain.nrrd -o both --label 1,2" + node_set + tables_alone);
  good("run brain.nrrd -o all" + node_set + tables_alone);
  EXPECT_EQ(force("both"), force("all"));
}

TEST_F(Run, TakesBothLabelsOfATwoLabelImageAsOneBody) {
  good("phantom two.seg.nrrd --shape block --size 60,60,30 --spacing 3 --two-labels");
  good("phantom one.seg.nrrd --shape block --size 60,60,30 --spacing 3");
  good("run two.seg.nrrd -o two" + node_set + tables_alone);
  good("run one.seg.nrrd -o one" + node_set + tables_alone);
  EXPECT_EQ(force("two"), force("one"));
  EXPECT_NEAR(summary("two").at("volume_mm3"), 60.0 * 60.0 * 30.0, 0.01 * 60.0 * 60.0 * 30.0);
}

TEST_F(Run, TakesAMaterialForEachLabelByNumberOrName) {
  good("phantom two.seg.nrrd --shape block --size 60,60,30 --spacing 3 --two-labels");
  const std::string shallow = " --nodes 400 --depth 0.5mm --frames 1 -q --write force";
  good("run two.seg.nrrd -o one" + shallow);
  const Ran by_number = good(
      "run two.seg.nrrd -o by_number --set tissue.2.mu=900 --nodes 400 --depth 0.5mm --frames 1 --write "
      "force");
  EXPECT_THAT(by_number.err, HasSubstr("material of label 2, "));
  const auto names = Json::parse(good("info two.seg.nrrd --json").out).at("labels");
  std::ofstream(folder / "tissues.toml") << "[tissue." << names[1].at("name") << "]\nmu_Pa = 900\n";
  good("run two.seg.nrrd -o by_name --config tissues.toml" + shallow);
  EXPECT_GT(last_force("by_number"), 1.2 * last_force("one"));
  EXPECT_EQ(force("by_name"), force("by_number"));
}

TEST_F(Run, OfTwoLabelsWithATissueEachIsABodyOfTwoTissuesAndHasErrorBounds) {
  good("phantom two.seg.nrrd --shape block --size 60,60,30 --spacing 3 --two-labels");
  good(
      "run two.seg.nrrd -o both --set tissue.1.mu=300 --set tissue.2.mu=900 --depth 1mm --frames 1 -q "
      "--write force");
  EXPECT_FALSE(summary("both").at("band").contains("unknown")) << summary("both").at("band");
  good(
      "run two.seg.nrrd -o far --set tissue.1.mu=100 --set tissue.2.mu=900 --depth 1mm --frames 1 -q --write "
      "force");
  EXPECT_TRUE(summary("far").at("band").contains("unknown")) << "nine times as stiff";
}

// A bonded disc of radius a on an incompressible half-space has stiffness 8 G a across its plane and 16/3 G a
// along it; on a body of ten diameters some per cent more.
TEST_F(Run, ATiltedApproachHasAlongTheSurfaceTwoThirdsOfTheForceAcross) {
  good("phantom large.nrrd --shape block --size 100,100,60 --spacing 4");
  good(
      "run large.nrrd -o out --indent-at 0,0,60 --direction 0.2,0,-1 --depth 0.1mm --frames 1 --write force "
      "--band off");
  const Json on_tool = summary("out").at("force_on_tool_N");
  const double moved = 0.1e-3 / std::sqrt(1.04), disc = 210.0 * 5e-3 * moved;
  EXPECT_NEAR(on_tool[2].get<double>() / (8.0 * disc), 1.05, 0.05) << "it is six diameters thick";
  EXPECT_NEAR(-on_tool[0].get<double>() / (16.0 / 3.0 * disc * 0.2), 1.0, 0.1);
  EXPECT_NEAR(on_tool[1], 0.0, 1e-2 * on_tool[2].get<double>());
}

TEST_F(Run, SaysWhatWasRequestedAndEveryWarning) {
  const Ran ran = good("run brain.nrrd -o out --contact frictionless --mu 0.3kPa" + node_set + tables_alone);
  const Json json = summary("out");
  EXPECT_EQ(json.at("exit_code"), 0);
  EXPECT_EQ(json.at("requested").at("depth_mm"), 0.5);
  EXPECT_EQ(json.at("contact"), "frictionless");
  EXPECT_EQ(json.at("scheme"), "converging");
  ASSERT_EQ(json.at("labels").size(), 2u);
  EXPECT_EQ(json.at("labels")[1].at("value"), 2);
  EXPECT_EQ(json.at("labels")[1].at("name"), "right_hemisphere");
  const Json material = json.at("material").at(0);
  EXPECT_EQ(material.at("mu_Pa"), 300.0);
  EXPECT_NEAR(material.at("nu"), 0.499, 1e-9);
  EXPECT_EQ(material.at("law"), "neo-hookean");
  EXPECT_EQ(material.at("default"), false);
  EXPECT_EQ(material.at("points"), json.at("counts").at("integration_points"));
  for (const char* part : {"kappa_Pa", "density_kg_per_m3"}) EXPECT_GT(material.at(part), 0.0);

  // All warnings of the summary are on stderr, guards among them.
  std::size_t printed = 0;
  for (std::size_t at = 0; (at = ran.err.find("warning: ", at)) != std::string::npos; ++at) ++printed;
  EXPECT_EQ(json.at("warnings").size(), printed);
  for (const Json& warning : json.at("warnings"))
    EXPECT_THAT(ran.err, HasSubstr("warning: " + warning.get<std::string>())) << warning;
  for (const Json& guard : json.at("guards")) {
    const std::string code = "[" + guard.at("code").get<std::string>() + "]";
    EXPECT_TRUE(std::any_of(json.at("warnings").begin(), json.at("warnings").end(), [&](const Json& warning) {
      return warning.get<std::string>().find(code) != std::string::npos;
    })) << code;
  }
  EXPECT_THAT(ran.err, HasSubstr("labels   all: 1 (left_hemisphere), 2 (right_hemisphere)"));
  EXPECT_THAT(ran.err, HasSubstr("2 labels are merged into one body with one material"));
  // A part that takes longer than the line's last digit is listed; on a quiet machine some are shorter.
  std::smatch line;
  ASSERT_TRUE(std::regex_search(ran.err, line, std::regex("time     ([0-9.]+) s: ([^\n]*)"))) << ran.err;
  const double last_digit_s = std::stod(line.str(1)) < 10.0 ? 0.01 : 0.1;
  for (const auto& [part, wall_s] : json.at("parts_wall_s").items()) {
    if (wall_s.get<double>() < 1.01 * last_digit_s) continue;
    EXPECT_TRUE(std::regex_search(line.str(2), std::regex("[0-9.]+ " + part))) << part << ": " << line.str(0);
  }
  for (const char* part : {"surface", "cloud", "supports", "solving", "writing"})
    EXPECT_GT(json.at("parts_wall_s").at(part), 0.0) << part;
  EXPECT_THAT(ran.err, Not(HasSubstr("swine brain")));

  const Ran one = good("run brain.nrrd -o one --label 2 --nodes 400" + tables_alone);
  EXPECT_THAT(one.err, Not(HasSubstr("labels are merged into one body")));
  EXPECT_THAT(one.err, HasSubstr("labels   chosen: 2 (right_hemisphere)"));
  EXPECT_THAT(one.err, HasSubstr("mu 210 Pa of swine brain"));
  EXPECT_EQ(summary("one").at("material").at(0).at("default"), true);
}

TEST_F(Run, TakesYoungsModulusInPlaceOfTheShearModulus) {
  const std::string quick = " --nodes 400 --depth 0.5mm --frames 1 -q --nu 0.45 --write force";
  good("run brain.nrrd -o young --young 0.58kPa" + quick);
  good("run brain.nrrd -o mu --mu 200" + quick);
  EXPECT_EQ(force("young"), force("mu"));
  good("run --config young/config.resolved.toml -o again -q");
  EXPECT_EQ(force("again"), force("young"));
  good("run brain.nrrd -o tissue --set tissue.2.young=580 --set tissue.1.mu=200" + quick);
  EXPECT_EQ(summary("tissue").at("material").at(2).at("mu_Pa"), 200.0);
}

TEST_F(Run, MakesPhantomsWhoseLengthsHaveUnits) {
  good("phantom one.nrrd --shape block --size 40,30,20 --spacing 2");
  good("phantom other.nrrd --shape block --size 4cm,30mm,0.02m --spacing 2mm");
  EXPECT_EQ(text_of(folder / "one.nrrd"), text_of(folder / "other.nrrd"));
  for (const char* wrong : {"--spacing 2kPa", "--spacing -1", "--size 40,30", "--size 4,4,4s"})
    EXPECT_EQ(dimple(folder, "phantom third.nrrd " + std::string(wrong)).code, 2) << wrong;
  refused(2, "phantom round.nrrd --shape cylinder --size 30,20,10",
          {"a cylinder is 30 mm wide and 20 mm deep"});
}

TEST_F(Run, MakesABlockOfWholeVoxelsAndSaysSoWhereItIsNotWhatWasRequested) {
  EXPECT_EQ(good("phantom even.nrrd --shape block --size 60,60,30 --spacing 3").err, "");
  const Ran odd = good("phantom odd.nrrd --shape block --size 61,60,31 --spacing 3 --json");
  EXPECT_THAT(odd.err, HasSubstr("the block is 63 x 60 x 30 mm: whole voxels of 3 mm, not 61 x 60 x 31 mm"));
  const Json brain = Json::parse(good("phantom long.nrrd --size 40,60,20 --spacing 2 --json").out);
  EXPECT_LT(brain["size"][0], brain["size"][1].get<int>()) << "40 mm along L, 60 mm along P";
  EXPECT_EQ(Json::parse(odd.out)["labels"], Json::parse(good("info odd.nrrd --json").out)["labels"]);
}

}  // namespace
}  // namespace dimple
