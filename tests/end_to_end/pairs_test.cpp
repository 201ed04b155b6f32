// Test of the table of incompatible features (apps/scene/compatibility.hpp). Each pair of features, and of a
// feature and a driver, is computed or refused in the table's words. Drivers and features with files use the
// real program; other pairs run in memory, on an organ that is read once.

#include <algorithm>
#include <cctype>
#include <cmath>
#include <optional>
#include <utility>

#include "apps/run/organ.hpp"
#include "apps/run/verdict.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/scene/resolve.hpp"
#include "preprocess/image/phantom.hpp"
#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

using Options = std::vector<std::pair<std::string, std::string>>;

// A block of 60 x 60 x 30 mm on its inferior face, with the tool in the middle of the superior one.
const Options block_scene = {{"boundary.base", "inferior"}, {"boundary.indent_at", "0,0,top"},
                             {"cloud.nodes", "400"},        {"solver.frames", "1"},
                             {"load.depth_mm", "1"},        {"material.mu_Pa", "2000"},
                             {"output.write", "force"},     {"accuracy.band", "off"}};
const std::string slit = "plane:10,0,20,1,0,0,radius=5mm", later_slit = "plane:-10,0,20,1,0,0,radius=5mm";
const Options press = {{"step.press.move_mm", "1"}};
const Options side_wall = {{"wall.side.shape", "plane:30,0,0,-1,0,0"}};
const Options other_tool = {{"tool.other.shape", "sphere:4mm"}, {"tool.other.at_mm", "18,0,30"}};

Options with(Options options, const Options& more) {
  options.insert(options.end(), more.begin(), more.end());
  return options;
}

// Options that request a feature. Empty if the feature is a default or a driver.
Options asking_for(Feature feature) {
  switch (feature) {
    case Feature::bonded_patch:
    case Feature::converging_scheme:
      return {};
    case Feature::contacting_tool:
      return {{"tool.shape", "sphere:5mm"}};
    case Feature::friction:
      return {{"tool.friction", "0.3"}};
    case Feature::further_friction:
      return with(side_wall, {{"wall.side.friction", "0.2"}});
    case Feature::chosen_contact:
      return {{"load.contact", "bonded"}};
    case Feature::chosen_diameter:
      return {{"boundary.indenter_diameter_mm", "12"}};
    case Feature::frictionless:
      return {{"load.contact", "frictionless"}};
    case Feature::sideways:
      return with(press, {{"step.aside.move_mm", "1,0,0"}});
    case Feature::turning:
      return with(press, {{"tool.shape", "sphere:5mm"}, {"step.turn.turn_deg", "0,10,0"}});
    case Feature::further_tool:
      return other_tool;
    case Feature::moving_further_tool:
      return with(other_tool, {{"tool.other.move_mm", "1"}});
    case Feature::fluid_lost:
      return {{"load.fluid_lost", "superior,50%"}};
    case Feature::gravity:
      return {{"load.gravity", "0,0,-2"}};
    case Feature::pressure:
      return {{"load.pressure.csf.pressure_Pa", "50"}, {"load.pressure.csf.on", "anterior"}};
    case Feature::body_force:
      return {{"load.body_force.pull.force_N_per_m3", "0,0,-1000"},
              {"load.body_force.pull.gradient_N_per_m4", "0,0,0,0,0,0,2e4,0,0"}};
    case Feature::membrane:
      return {{"load.membrane", "0.1mm:50kPa"}};
    case Feature::tension:
      return {{"membrane.pia.tension_N_per_m", "1"}};
    case Feature::free_base:
      return {
          {"boundary.base_hold", "none"}, {"wall.bed.shape", "plane:0,0,0,0,0,1"}, {"support.s.on", "left"}};
    case Feature::wall:
      return side_wall;
    case Feature::wall_at_gap:
      return with(side_wall, {{"wall.side.gap", "0.5"}});
    case Feature::support:
      return {{"support.s.on", "left"}};
    case Feature::moving_support:
      return {{"support.s.on", "left"}, {"support.s.move_mm", "0.5,0,0"}};
    case Feature::steps:
      return press;
    case Feature::cut:
      return {{"image.cut", slit}};
    case Feature::cut_step:
      return with({{"step.slit.cut", later_slit}}, press);
    case Feature::cut_after_step:
      return with(press, {{"step.slit.cut", later_slit}});
    case Feature::grid_images:
      return {{"output.write", "images"}};
    case Feature::warped_images:
      return {{"output.warp", "block.nrrd"}};
    case Feature::followed_place:
      return {{"accuracy.quantity", "displacement@0,0,15"}};
    case Feature::self_contact:
      return {{"load.self_contact", "on"}};
    case Feature::imaged_loaded:
      return {{"load.imaged", "loaded"}, {"load.gravity", "0,0,-2"}};
    case Feature::paper_scheme:
      return {{"scheme.name", "horton2007"}, {"load.rate_mm_per_s", "20"}};
    case Feature::inertia:
      return {{"solver.time", "explicit"}, {"load.rate_mm_per_s", "20"}};
    case Feature::viscous:
      return {{"material.prony_g", "0.3"}, {"material.prony_tau_s", "1"}};
    case Feature::tissues:
      return {{"tissue.1.mu_Pa", "3000"}};
    case Feature::other_law:
    case Feature::ogden:
      return {{"material.ogden_mu_Pa", "2000"}, {"material.ogden_alpha", "-4.7"}};
    case Feature::mooney:
      return {{"material.mooney_c01_Pa", "500"}};
    case Feature::printed_stress:
      return {{"material.stress", "printed"}, {"solver.damping_per_s", "20"}};
    case Feature::preset:
      return {{"material.preset", "horton_2007"}};
    case Feature::uncertain_mu:
      return {{"material.mu_spread_percent", "10"}};
    case Feature::accuracy:
      return {{"accuracy.budget_s", "0.001"}};
    case Feature::comparison:
      return {{"output.compare", "curve.csv"}};
    case Feature::paper_comparison:
      return {{"output.compare", "horton2007"}};
    case Feature::run:
    case Feature::solve:
    case Feature::solve_in_memory:
    case Feature::model:
    case Feature::model_in_memory:
    case Feature::explain:
    case Feature::fit:
    case Feature::export_mesh:
    case Feature::by_hand:
    case Feature::contacting_tool_by_hand:
    case Feature::session:
    case Feature::shift:
    case Feature::places:
    case Feature::error_bounds:
    case Feature::proportional_force:
      return {};
  }
  return {};
}

// Pairs that are refused because of a value, not by the table.
struct OfValues {
  Feature one, other;
  const char* words;
};
const OfValues of_values[] = {
    {Feature::viscous, Feature::accuracy, "not calibrated for viscoelastic tissue"},
    {Feature::uncertain_mu, Feature::fit, "follows from the curve"},
};

// Beginning of a command, and properties of its results.
struct Driver {
  Feature feature;
  const char* command;
  bool has_force;
  bool is_quick;  // otherwise only what the table refuses is requested
  Options needs = {};
};
const Driver drivers[] = {
    {Feature::run, "run block.nrrd -o out --force -q", true, true},
    {Feature::solve, "solve model -o out --force -q", true, true},
    {Feature::model, "model block.nrrd -o made --force -q", false, true},
    {Feature::fit, "fit block.nrrd -o fitted --curve curve.csv --force -q", false, true},
    {Feature::export_mesh, "export block.nrrd -o block.inp --force -q", false, true},
    {Feature::by_hand, "poke block.nrrd --script path.csv -q", false, true},
    {Feature::by_hand, "poke block.nrrd --script path.csv -q", false, false, {{"tool.shape", "sphere:5mm"}}},
    {Feature::places, "places block.nrrd -q", false, true},
    {Feature::explain, "run block.nrrd -o out --force -q --explain", true, false},
    {Feature::shift, "shift block.nrrd -o out --force -q --opening 0,0,30,15 --up superior", false, false},
};

// Combines the options; empty if they contradict each other.
std::optional<Options> together(const Options& one, const Options& other) {
  Options all = one;
  for (const auto& [key, text] : other) {
    const auto there =
        std::find_if(all.begin(), all.end(), [&](const auto& option) { return option.first == key; });
    if (there == all.end())
      all.emplace_back(key, text);
    else if (there->second != text)
      return std::nullopt;
  }
  return all;
}

// Options of the block scene without those that `requested` replaces or determines.
Options on_the_block(const Options& requested, Feature driver) {
  const auto asks = [&](const std::string& beginning) {
    return std::any_of(requested.begin(), requested.end(),
                       [&](const auto& option) { return option.first.starts_with(beginning); });
  };
  const bool fits = driver == Feature::fit, shifts = driver == Feature::shift;
  Options all;
  for (const auto& option : block_scene) {
    const std::string& key = option.first;
    const bool follows =
        (key == "load.depth_mm" && (asks("step.") || fits || shifts)) ||
        (key == "material.mu_Pa" && (asks("material.ogden") || asks("material.preset") || fits)) ||
        (key == "cloud.nodes" && asks("accuracy.budget")) || (key == "output.write" && shifts);
    if (!asks(key) && !follows) all.push_back(option);
  }
  return with(all, requested);
}

Scene described(const Options& options) {
  Description description;
  for (const auto& [key, text] : options) set_option(description, key, text, "--set");
  complete(description);
  return resolve(description);
}

// Report of a contradiction between the values of two features, such as the numbers of two laws.
std::optional<Report> values_say(const Options& options) {
  try {
    (void)described(options);
  } catch (const UsageError& error) {
    return error.report;
  }
  return std::nullopt;
}

// First row of the table that refuses this scene, if any. Some drivers count as two features.
std::optional<Report> table_says(const Scene& scene, Feature driver) {
  if (std::optional<Report> clash = clash_of(scene, driver)) return clash;
  if (driver == Feature::model) return clash_of(scene, Feature::model_in_memory);
  if (driver == Feature::by_hand && features_of(scene).has(Feature::contacting_tool))
    return clash_of(scene, Feature::contacting_tool_by_hand);
  if (driver == Feature::explain) return clash_of(scene, Feature::run);
  // A model has its own scheme, here the converging one, like the configuration.
  if (driver == Feature::solve && features_of(scene).has(Feature::printed_stress))
    return clash_of(scene, Feature::run);
  return std::nullopt;
}

// Files are read and written by the program alone; the surface of a body depends on the patch diameter.
bool needs_program(Feature feature) {
  switch (feature) {
    case Feature::chosen_diameter:
    case Feature::grid_images:
    case Feature::warped_images:
    case Feature::accuracy:
    case Feature::comparison:
    case Feature::paper_comparison:
      return true;
    default:
      return false;
  }
}

// Relative error of the trapezoidal rule with so many load steps in the work of a Hertzian force, which grows
// as depth^1.5.
double trapezoidal_error(std::size_t steps) {
  double sum = 0.5;
  for (std::size_t k = 1; k < steps; ++k)
    sum += std::pow(static_cast<double>(k) / static_cast<double>(steps), 1.5);
  return 2.5 * sum / static_cast<double>(steps) - 1.0;
}

class Pairs : public testing::TestWithParam<Feature> {
 protected:
  const fs::path folder = fresh_folder();

  void SetUp() override {
    ASSERT_EQ(dimple(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3 -q").code, 0);
    // The number of nodes is the default for a further tool without a model; points have their label.
    ASSERT_EQ(dimple(folder,
                     "model block.nrrd -o model --base inferior --indent-at 0,0,top --nodes 800 -q "
                     "--set tissue.1.mu=3kPa")
                  .code,
              0);
    std::ofstream(folder / "curve.csv") << "indentation_mm,force_N\n0,0\n0.5,0.05\n1,0.1\n";
    std::ofstream(folder / "path.csv") << "time_s,depth_mm\n0,0\n0.2,0.5\n";
  }

  Ran ran(const std::vector<std::string>& line) const {
    Ran ran = dimple::dimple(folder, line);
    EXPECT_LT(ran.cpu_s, cpu_of(10.0));
    return ran;
  }

  void expect_in_words(const Ran& ran, const std::string& words) const {
    EXPECT_EQ(ran.code, static_cast<int>(ExitCode::usage)) << ran.err;
    EXPECT_THAT(ran.err, HasSubstr(words));
  }

  void expect_refused(const Ran& ran, const Report& report) const {
    expect_in_words(ran, "dimple: " + report.fact);
    for (const std::string& words :
         {"\n  where: " + report.where, "\n  why:   " + report.why, "\n  try:   " + report.remedy})
      EXPECT_THAT(ran.err, HasSubstr(words));
  }

  void expect_computed(const Ran& ran, const Driver& driver) const {
    EXPECT_EQ(ran.code, 0) << ran.err;
    if (ran.code != 0 || !driver.has_force) return;
    const Json summary = Json::parse(text_of(folder / "out" / "summary.json"));
    EXPECT_TRUE(summary.at("force_N").is_number()) << "a force that is not finite is null";
  }

  // Computes the scene in memory; throws like simulate().
  static Result solved_in_memory(const Scene& now) {
    static const LabelImage image =
        make_phantom({.shape = "block", .size_mm = {60.0, 60.0, 30.0}, .spacing_mm = 3.0});
    static const PreparedOrgan organ = read_once({.scene = described(block_scene), .image = &image}, {});
    return simulate({.scene = now, .image = &image, .organ = &organ});
  }

  // Expects that the energy balance closes within the guard's limit or the error of few load steps. The
  // balance of relaxing tissue counts no dissipation, and the paper's printed stress follows from no energy:
  // the verdict must report that.
  static void expect_closed_books(const Scene& now, const Result& result) {
    const auto energy = verdict_of(now, result, "finished").at("energy");
    const double value = 0.01 * energy.at("value").get<double>();
    if (const Features has = features_of(now);
        has.has(Feature::viscous) || has.has(Feature::printed_stress)) {
      EXPECT_TRUE(value <= energy_to_check || energy.at("word") != "good") << energy;
      return;
    }
    EXPECT_LE(value, std::max(energy_to_check, trapezoidal_error(result.history.force.size() - 1))) << energy;
  }

  // A pair in the table is refused in its words. Any other has a finite force and a closed energy balance.
  void expect_in_memory(const Scene& now, const std::optional<Report>& refused) const {
    try {
      const Result result = solved_in_memory(now);
      EXPECT_FALSE(refused) << refused->fact;
      EXPECT_TRUE(std::isfinite(result.history.force.back().force));
      expect_closed_books(now, result);
    } catch (const Error& error) {
      ASSERT_TRUE(refused) << error.report.fact << "\n" << error.report.why;
      EXPECT_EQ(error.report.fact, refused->fact);
      EXPECT_EQ(error.report.where, refused->where);
      EXPECT_EQ(error.report.why, refused->why);
      EXPECT_EQ(error.report.remedy, refused->remedy);
    }
  }

  // Tests one or two features with a driver; a driver may itself be the second feature.
  void expect_together(Feature one, Feature other, const Driver& driver) const {
    const auto requested = together(asking_for(one), is_driver(other) ? driver.needs : asking_for(other));
    if (!requested) return;
    const Options options = on_the_block(*requested, driver.feature);
    std::vector<std::string> line = dimple::words_of(std::string(driver.command));
    for (const auto& [key, text] : options) line.insert(line.end(), {"--set", key + "=" + text});
    SCOPED_TRACE(testing::Message() << dimple::words_of(one).name << " with " << dimple::words_of(other).name
                                    << ": " << testing::PrintToString(line));
    const std::optional<Report> contradiction = values_say(options);
    if (contradiction) return expect_in_words(ran(line), contradiction->fact);
    const Scene scene = described(options);
    const Features there = features_of(scene);
    if (!there.has(one) || (!is_driver(other) && !there.has(other))) return;
    for (const OfValues& known : of_values)
      if ((known.one == one && known.other == other) || (known.one == other && known.other == one))
        return expect_in_words(ran(line), known.words);
    const std::optional<Report> refused = table_says(scene, driver.feature);
    if (!is_driver(other) && !needs_program(one) && !needs_program(other))
      return expect_in_memory(scene, refused);
    if (refused)
      expect_refused(ran(line), *refused);
    else if (driver.is_quick)
      expect_computed(ran(line), driver);
  }
};

TEST_P(Pairs, OfAFeatureAreComputedOrRefusedByTheTable) {
  const Feature one = GetParam();
  const Driver& run = drivers[0];
  for (std::size_t k = static_cast<std::size_t>(one) + 1; k < feature_count; ++k)
    if (const Feature other = static_cast<Feature>(k); !is_driver(other) && !asking_for(other).empty())
      expect_together(one, other, run);
  for (const Driver& driver : drivers) expect_together(one, driver.feature, driver);
}

std::vector<Feature> all_requests() {
  std::vector<Feature> all;
  for (std::size_t k = 0; k < feature_count; ++k)
    if (const Feature feature = static_cast<Feature>(k); !asking_for(feature).empty()) all.push_back(feature);
  return all;
}

std::string as_identifier(const testing::TestParamInfo<Feature>& info) {
  std::string name = dimple::words_of(info.param).name;
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) == 0; }, '_');
  return name;
}

INSTANTIATE_TEST_SUITE_P(Each, Pairs, testing::ValuesIn(all_requests()), as_identifier);

TEST(TableOfPairs, IsListedByTheProgramWithItsReasons) {
  const Ran ran = dimple(fresh_folder(), "options --pairs");
  EXPECT_EQ(ran.code, 0) << ran.err;
  std::string words;  // without line breaks
  for (const char c : ran.out)
    if (const bool blank = c == ' ' || c == '\n'; !blank || !words.ends_with(' ')) words += blank ? ' ' : c;
  for (const Clash& row : clashes()) EXPECT_THAT(words, HasSubstr(row.why));
}

}  // namespace
}  // namespace dimple
