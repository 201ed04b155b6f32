#include "apps/pipeline.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/global_control.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <functional>
#include <nlohmann/json.hpp>

#include "apps/checkpoint.hpp"
#include "apps/log.hpp"
#include "apps/results.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "solver/implicit.hpp"
#include "solver/relax.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

class Stopwatch {
 public:
  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

std::string place(const Vec3& mm) {
  const auto tenths = [](double x) { return std::round(10.0 * x) / 10.0 + 0.0; };  // no minus zeros
  return fmt::format("({:.1f}, {:.1f}, {:.1f}) mm", tenths(mm.x()), tenths(mm.y()), tenths(mm.z()));
}

Json three(const Vec3& v) {
  return Json::array({v.x(), v.y(), v.z()});
}

// "2 (right_hemisphere)"
std::string in_words(const LabelMeasure& label) {
  return label.name.empty() ? std::to_string(label.value) : fmt::format("{} ({})", label.value, label.name);
}

std::string in_words(const std::vector<LabelMeasure>& labels) {
  constexpr std::size_t most = 12;
  std::vector<std::string> words;
  for (const LabelMeasure& label : labels)
    if (words.size() < most) words.push_back(in_words(label));
  return fmt::format("{}{}", fmt::join(words, ", "),
                     labels.size() > most ? fmt::format(" and {} more", labels.size() - most) : "");
}

// Labels given by number or name, as numbers; `present`: those of the image.
std::vector<int> chosen_labels(const LabelImage& image, const std::vector<LabelMeasure>& present,
                               const std::vector<std::string>& wanted) {
  std::vector<int> result;
  for (const std::string& word : wanted) {
    if (!word.empty() && word.find_first_not_of("0123456789") == std::string::npos && word.size() < 10) {
      result.push_back(std::stoi(word));
      continue;
    }
    const auto same = [](const std::string& a, const std::string& b) {
      return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                        [](unsigned char x, unsigned char y) { return std::tolower(x) == std::tolower(y); });
    };
    std::vector<std::string> known;
    bool found = false;
    for (const auto& [value, name] : image.names) {
      known.push_back(name);
      if (!same(name, word)) continue;
      result.push_back(value);
      found = true;
    }
    if (!found)
      throw InputError({.fact = fmt::format("no label is called '{}'{}", word, did_you_mean(word, known)),
                        .where = "--label (image.label)",
                        .why = known.empty() ? std::string("the image has no label names")
                                             : fmt::format("the image names {}", fmt::join(known, ", ")),
                        .remedy = "choose by number, or give names with --label-names; `dimple info IMAGE` "
                                  "shows what there is"});
  }
  for (const int value : result)
    if (std::none_of(present.begin(), present.end(), [&](const LabelMeasure& m) { return m.value == value; }))
      throw InputError({.fact = fmt::format("no voxel has label {}", value),
                        .where = "--label (image.label)",
                        .why = fmt::format("the image holds {}", in_words(present)),
                        .remedy = "choose one of these with --label"});
  return result;
}

// Label of the voxel at a place in the surface's frame; outside, or on background, of the nearest foreground
// voxel within two voxels: the smooth surface runs a little outside of the labels.
LabelAt label_finder(const LabelImage& image, const BodySurface& body) {
  const Eigen::Affine3d to_voxel = image.to_world.inverse() * body.to_world();
  return [&image, to_voxel](const Vec3& x) {
    const Vec3 v = to_voxel * x;
    const Eigen::Matrix<Index, 3, 1> at = v.array().round().cast<Index>();
    int best = 0;
    double nearest = std::numeric_limits<double>::infinity();
    for (Index reach = 0; reach <= 2 && best == 0; ++reach)
      for (Index k = at[2] - reach; k <= at[2] + reach; ++k)
        for (Index j = at[1] - reach; j <= at[1] + reach; ++j)
          for (Index i = at[0] - reach; i <= at[0] + reach; ++i) {
            if (i < 0 || j < 0 || k < 0 || i >= image.size[0] || j >= image.size[1] || k >= image.size[2])
              continue;
            const int label = image.at(i, j, k);
            const double away =
                (Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)) - v)
                    .squaredNorm();
            if (label == 0 || away >= nearest) continue;
            nearest = away;
            best = label;
          }
    return best;
  };
}

// What is wrong with the materials is said before anything is built.
void check_materials(const std::vector<Material>& materials, const std::string& scheme) {
  const Material& m = materials.front();
  if (scheme != "converging" && (materials.size() > 1 || !is_plain(m)))
    throw UsageError({.fact = "the paper's scheme knows one neo-Hookean tissue only",
                      .where = "--scheme horton2007",
                      .why = "it is kept as it was printed, for comparison",
                      .remedy = "leave --scheme out for other laws, viscoelastic and several tissues"});
  if (scheme == "converging" && is_as_printed(m))
    throw UsageError({.fact = "the printed stress goes with the paper's scheme only",
                      .where = "--stress printed",
                      .why = "the converging scheme is made of energies, and the printed stress has none",
                      .remedy = "add --scheme horton2007"});
}

// A label that config.tissue names, as a number; -1 if it is neither a number nor a known name.
int number_of(const std::string& label, const std::map<std::string, int>& names) {
  if (!label.empty() && label.find_first_not_of("0123456789") == std::string::npos && label.size() < 10)
    return std::stoi(label);
  const auto known = names.find(label);
  return known == names.end() ? -1 : known->second;
}

// config.tissue's labels as numbers.
Tissues tissues_of(const Config& config, const ModelFiles& files) {
  Tissues tissues{materials_of(config), Eigen::VectorXi::Zero(files.model.point_count())};
  int number = 0;
  for (const auto& [label, differing] : config.tissue) {
    ++number;
    const int value = number_of(label, files.label_names);
    Index count = 0;
    for (Index q = 0; q < files.model.point_count(); ++q)
      if (files.model.label[q] == value) {
        tissues.of_point[q] = number;
        ++count;
      }
    if (count == 0)
      throw InputError(
          {.fact = fmt::format("no tissue of the model has label '{}'", label),
           .where = fmt::format("tissue.{}", label),
           .why = "no integration point lies in it",
           .remedy =
               "`dimple info IMAGE` shows the labels; take them all with --label, or leave --label out; "
               "a model made without tissues knows only one"});
  }
  return tissues;
}

// What of an image is to be the body.
struct Taken {
  std::vector<int> chosen;  // by --label; none: all
  std::vector<LabelMeasure> labels;
};

Taken take_labels(const Config& config, const LabelImage& image, const std::map<std::string, int>& names) {
  for (const std::string& warning : image.warnings) warn(warning);
  const std::vector<LabelMeasure> present = measure_labels(image);
  Taken taken{.chosen = chosen_labels(image, present, config.image.label), .labels = {}};
  for (const LabelMeasure& label : present)
    if (taken.chosen.empty() ||
        std::find(taken.chosen.begin(), taken.chosen.end(), label.value) != taken.chosen.end())
      taken.labels.push_back(label);
  const auto has = [](const std::vector<LabelMeasure>& labels, int value) {
    return std::any_of(labels.begin(), labels.end(), [&](const auto& m) { return m.value == value; });
  };
  for (const auto& [label, differing] : config.tissue)
    if (const int value = number_of(label, names); !has(taken.labels, value))
      throw InputError(
          {.fact = fmt::format("no part of the body has label '{}'", label),
           .where = fmt::format("tissue.{}", label),
           .why = has(present, value) ? "--label leaves it out" : "the image has no such label",
           .remedy =
               "`dimple info IMAGE` shows the labels; take several with --label 1,2, or leave --label out"});
  return taken;
}

void say_labels(const Config& config, const std::vector<int>& chosen, const std::vector<LabelMeasure>& taken,
                const std::map<std::string, int>& names) {
  say(fmt::format("labels   {}: {}", chosen.empty() ? "all" : "chosen", in_words(taken)));
  std::vector<LabelMeasure> alike;  // of the one material that config.material is
  for (const LabelMeasure& label : taken)
    if (std::none_of(config.tissue.begin(), config.tissue.end(),
                     [&](const auto& tissue) { return number_of(tissue.first, names) == label.value; }))
      alike.push_back(label);
  if (chosen.empty() && alike.size() > 1)
    warn(
        fmt::format("{} labels are welded into one body of one material, as no --label was given: {}; choose "
                    "with --label {}, or "
                    "give one a material of its own, as in --set tissue.{}.mu=300Pa",
                    alike.size(), in_words(alike), alike.front().value, alike.back().value));
}

void say_default_stiffness(const Config& config) {
  if (default_stiffness(config))
    say(fmt::format(
        "material mu {:.4g} Pa is swine brain (Horton et al. 2007), taken because none was given; other "
        "tissues need --mu, --young or --preset",
        config.material.mu_Pa));
}

struct Prepared {
  ModelFiles files;
  ModelReport report;
  SegmentReport segment;
  std::map<std::string, std::string> notes;  // option key -> what was chosen
  std::vector<LabelMeasure> labels;          // taken
  LabelImage image;
  double read_s = 0.0, build_s = 0.0;
  Stages stages;
};

Json stages_json(const Stages& stages) {
  Json result = Json::object();
  for (const auto& [name, s] : stages.seconds()) result[name] = s;
  return result;
}

Prepared prepare(const Config& config) {
  if (config.image.file.empty())
    throw UsageError({.fact = "no label image was given",
                      .where = "command line",
                      .why = "there is nothing to work on",
                      .remedy = "give one: dimple run IMAGE -o OUT"});
  check_materials(materials_of(config), config.scheme.name);
  Prepared result;
  Stopwatch reading;
  doing("reading " + config.image.file);
  result.image = read_label_image(config.image.file, config.image.label_names);
  const LabelImage& image = result.image;
  for (const auto& [value, name] : image.names) result.files.label_names[name] = value;
  const auto [labels, taken] = take_labels(config, image, result.files.label_names);
  result.labels = taken;
  result.read_s = reading.seconds();
  result.stages.done("read");
  say(fmt::format("image    {}: {}, {} x {} x {} voxels of {:.4g} x {:.4g} x {:.4g} mm, axes {}",
                  config.image.file, image.format, image.stored_size[0], image.stored_size[1],
                  image.stored_size[2], image.stored_spacing.x(), image.stored_spacing.y(),
                  image.stored_spacing.z(), image.orientation));
  say_labels(config, labels, taken, result.files.label_names);
  say_default_stiffness(config);

  doing("drawing the surface");
  Stopwatch building;
  ModelOptions options = model_options(config);
  options.boundary.voxel_mm = image.spacing().maxCoeff();
  SegmentedBody body =
      make_body_surface(image, labels, {.indenter_diameter_mm = options.boundary.indenter_diameter_mm});
  result.stages.done("surface");
  result.segment = body.report;
  const SegmentReport& segment = result.segment;
  for (const std::string& warning : segment.warnings) warn(warning);
  if (segment.pieces > 1)
    say(fmt::format("organ    {} pieces: kept the largest, dropped {:.2f} cm3 ({:.2f} %)", segment.pieces,
                    segment.dropped_volume_mm3 / 1e3,
                    100.0 * segment.dropped_volume_mm3 / segment.label_volume_mm3));
  if (segment.dropped_volume_mm3 > 0.05 * segment.label_volume_mm3)
    warn(fmt::format(
        "{:.1f} % of the labelled volume lies in pieces that do not touch the largest and was dropped",
        100.0 * segment.dropped_volume_mm3 / segment.label_volume_mm3));
  say(fmt::format(
      "organ    {:.2f} cm3, surface {:.1f} cm2 ({} triangles, drawn {:.2f} mm apart, smoothed by {:.2f} mm; "
      "encloses the voxels' volume to {:+.2f} %)",
      segment.voxel_volume_mm3 / 1e3, body.surface.area() / 1e2, body.surface.triangles().cols(),
      segment.step_mm, segment.smoothing_mm,
      100.0 * (body.surface.volume() / segment.voxel_volume_mm3 - 1.0)));
  doing("placing nodes and points");
  // Cells are split where tissues meet; where all labels are of one tissue their borders mean nothing.
  BuiltModel built = build_model(body.surface, options,
                                 config.tissue.empty() ? LabelAt{} : label_finder(image, body.surface));
  result.report = built.report;
  result.stages.add(built.report.stages);
  const ModelReport& report = result.report;
  for (const std::string& warning : report.boundary.warnings) warn(warning);
  result.build_s = building.seconds();
  say(fmt::format(
      "nodes    {} ({} on the surface), {:.3f} mm apart{}{}; nearest node {:.2f} +- {:.2f}, at least {:.2f}, "
      "largest gap {:.2f} spacings",
      built.model.node_count(), report.surface_nodes, report.spacing_mm,
      options.cloud.spacing_mm > 0.0 ? "" : " for this number",
      report.rim_spacing_mm < report.spacing_mm ? fmt::format(", {:.3f} mm at the rim", report.rim_spacing_mm)
                                                : "",
      report.evenness.mean, report.evenness.spread * report.evenness.mean, report.evenness.minimum,
      report.evenness.fill));
  say(fmt::format(
      "points   {} in cells of {}{:.3f} mm, {} clipped by the surface, {} slivers merged; volume {:.2f} cm3, "
      "{:+.3f} % of the organ's",
      built.model.point_count(), options.averaged_cells ? "up to " : "", report.cell_mm, report.clipped,
      report.merged, report.grid_volume_mm3 / 1e3,
      100.0 * (report.grid_volume_mm3 / segment.voxel_volume_mm3 - 1.0)));
  say(fmt::format("base     {} nodes: {}", built.model.base.size(), report.boundary.base_reason));
  say(fmt::format("circle   {} nodes, {} on its rim, {:.1f} mm across at {}: {}", report.circle_nodes,
                  report.rim_nodes, 2e3 * built.model.tool.radius, place(built.model.tool.centre * 1e3),
                  report.boundary.circle_reason));

  const std::string centre = place(built.model.tool.centre * 1e3);
  const Vec3& push = built.model.tool.push;
  result.notes = {
      {"cloud.spacing_mm", fmt::format("{:.4f} mm", report.spacing_mm)},
      {"cloud.nodes", fmt::format("{} nodes", built.model.node_count())},
      {"grid.points", fmt::format("{} points", built.model.point_count())},
      {"boundary.base", report.boundary.base_reason},
      {"boundary.base_depth_mm", fmt::format("{:.3f} mm", report.boundary.base_depth)},
      {"boundary.indent_at", fmt::format("{}: {}", centre, report.boundary.circle_reason)},
      {"boundary.direction", fmt::format("({:.4f}, {:.4f}, {:.4f})", push.x(), push.y(), push.z())},
      {"image.label", in_words(result.labels)}};

  ModelFiles& files = result.files;
  files.model = std::move(built.model);
  files.support = support_options(config);
  files.scheme = config.scheme.name;
  files.surface.position_mm = body.surface.to_world() * body.surface.vertex().colwise().homogeneous();
  files.surface.triangles = body.surface.triangles();
  files.provenance = {{"image", config.image.file},
                      {"image_sha256", sha256_of_file(config.image.file)},
                      {"labels", result.notes["image.label"]},
                      {"base", report.boundary.base_reason},
                      {"circle", report.boundary.circle_reason},
                      {"dimple", DIMPLE_VERSION}};
  return result;
}

Json labels_json(const std::vector<LabelMeasure>& labels) {
  Json result = Json::array();
  for (const LabelMeasure& l : labels)
    result.push_back(
        {{"value", l.value}, {"name", l.name}, {"voxels", l.voxels}, {"volume_mm3", l.volume_mm3}});
  return result;
}

Json cavities_json(const std::vector<Cavity>& cavities) {
  Json list = Json::array();
  for (const Cavity& c : cavities)
    list.push_back({{"volume_mm3", c.volume_mm3}, {"centre_mm", three(c.centre_mm)}, {"filled", c.filled}});
  return list;
}

Json model_json(const Prepared& p) {
  const ModelReport& r = p.report;
  return {{"organ_volume_mm3", p.segment.voxel_volume_mm3},
          {"surface_volume_mm3", r.surface_volume_mm3},
          {"grid_volume_mm3", r.grid_volume_mm3},
          {"pieces", p.segment.pieces},
          {"dropped_volume_mm3", p.segment.dropped_volume_mm3},
          {"cavities", cavities_json(p.segment.cavities)},
          {"surface_step_mm", p.segment.step_mm},
          {"smoothing_mm", p.segment.smoothing_mm},
          {"node_spacing_mm", r.spacing_mm},
          {"rim_spacing_mm", r.rim_spacing_mm},
          {"cell_mm", r.cell_mm},
          {"evenness",
           {{"nearest_mean", r.evenness.mean},
            {"nearest_spread", r.evenness.spread},
            {"nearest_min", r.evenness.minimum},
            {"fill_distance", r.evenness.fill}}},
          {"circle_rim_nodes", r.rim_nodes},
          {"base_reason", r.boundary.base_reason},
          {"circle_reason", r.boundary.circle_reason},
          {"image_read_s", p.read_s},
          {"model_build_s", p.build_s}};
}

Json counts_json(const Model& model) {
  return {{"nodes", model.node_count()},
          {"integration_points", model.point_count()},
          {"base_nodes", model.base.size()},
          {"circle_nodes", model.indenter.size()},
          {"circle_centre_mm", three(model.tool.centre * 1e3)},
          {"push", three(model.tool.push)},
          {"circle_diameter_mm", 2e3 * model.tool.radius}};
}

Json report_json(const Report& r) {
  return {{"code", r.code}, {"fact", r.fact}, {"where", r.where}, {"why", r.why}, {"remedy", r.remedy}};
}

// On one line, beside the others of a run that goes on.
std::string in_words(const Finding& finding) {
  const Report& r = finding.report;
  return fmt::format("{} ({}); {}; try: {} [{}]", r.fact, r.where, r.why, r.remedy, r.code);
}

double poisson_ratio(const Material& m) {
  return (3.0 * m.kappa - 2.0 * m.mu) / (2.0 * (3.0 * m.kappa + m.mu));
}

std::string describe(const Tissues& tissues, std::size_t t) {
  const Material& m = tissues.material[t];
  const LawWords words = words_of(m);
  std::string law = words.title;
  for (const auto& term : words.terms) {
    std::vector<std::string> numbers;
    for (const auto& [name, value] : term)
      numbers.push_back(fmt::format("{:.6g}{}", value, name.ends_with("_Pa") ? " Pa" : ""));
    law += fmt::format(" ({})", fmt::join(numbers, ", "));
  }
  for (const PronyTerm& term : m.prony) law += fmt::format(", {:.3g} relaxing in {:.3g} s", term.g, term.tau);
  return fmt::format(
      "material {}{}: mu {:.6g} Pa, nu {:.6g} (kappa {:.6g} Pa), density {:.6g} kg/m3; waves {:.2f} and "
      "{:.3f} m/s",
      t == 0 ? "" : fmt::format("of {} points, ", (tissues.of_point.array() == static_cast<int>(t)).count()),
      law, m.mu, poisson_ratio(m), m.kappa, m.density, pressure_wave_speed(m), shear_wave_speed(m));
}

// The same for programs; `label` is empty for that of all labels without one of their own.
Json material_json(const Material& m, const std::string& label, Index points, bool is_default) {
  const LawWords law = words_of(m);
  Json terms = Json::array(), relaxing = Json::array();
  for (const auto& term : law.terms) {
    Json numbers = Json::object();
    for (const auto& [name, value] : term) numbers[name] = value;
    terms.push_back(numbers);
  }
  for (const PronyTerm& term : m.prony) relaxing.push_back({{"g", term.g}, {"tau_s", term.tau}});
  Json result = {{"label", label.empty() ? "all others" : label},
                 {"points", points},
                 {"law", law.name},
                 {"mu_Pa", m.mu},
                 {"nu", poisson_ratio(m)},
                 {"kappa_Pa", m.kappa},
                 {"density_kg_per_m3", m.density},
                 {"default", is_default}};
  if (!terms.empty()) result[law.name] = terms;
  if (!relaxing.empty()) result["prony"] = relaxing;
  return result;
}

Json materials_json(const Config& config, const Tissues& tissues) {
  Json result = Json::array();
  auto own = config.tissue.begin();
  for (std::size_t t = 0; t < tissues.material.size(); ++t) {
    const auto points = (tissues.of_point.array() == static_cast<int>(t)).count();
    result.push_back(material_json(tissues.material[t], t == 0 ? "" : (own++)->first, points,
                                   t == 0 && default_stiffness(config)));
  }
  return result;
}

SurfacePieces surface_of(const ModelFiles& files) {
  if (files.surface.triangles.cols() == 0 || files.model.spread.cols() == 0) return {};
  return pieces_of(files.surface.position_mm * 1e-3, files.surface.triangles, files.model);
}

Eigen::VectorXd density_of(const Model& model, const Tissues& tissues) {
  Eigen::VectorXd density(model.point_count());
  for (Index q = 0; q < density.size(); ++q)
    density[q] = tissues.material[static_cast<std::size_t>(tissues.of_point[q])].density;
  return density;
}

Precision precision_of(const Config& config) {
  return config.solver.precision == "single" ? Precision::single_ : Precision::double_;
}

void require_room_beneath(const Config& config, const Model& model) {
  const double beneath =
      (model.X.transpose() * model.tool.push).maxCoeff() - model.tool.centre.dot(model.tool.push);
  if (loading_of(config).depth >= beneath)
    throw ModelError(
        {.fact =
             fmt::format("an indentation of {:.3g} mm is deeper than the organ beneath the circle, {:.3g} mm",
                         config.load.depth_mm, 1e3 * beneath),
         .where = "--depth (load.depth_mm)",
         .why = "the tool would come out on the other side",
         .remedy = "give a smaller --depth, or another place with --indent-at"});
}

enum class TimeMode { quasi_static, dynamic, explicit_ };

// Inertia plays no part when the load lasts for many of the shear waves' ways through the organ; and where it
// is followed nevertheless, steps as long as the body's own swings are enough. A shorter load excites shorter
// waves.
TimeMode choose_time(const Config& config, const Model& model, const Tissues& tissues, bool is_converging) {
  const std::string& asked = config.solver.time;
  if (asked == "quasi-static") return TimeMode::quasi_static;
  if (asked == "explicit" || !is_converging) return TimeMode::explicit_;
  const double waves = loading_of(config).duration() / shear_crossing_time(tissues, model);
  const bool slow = waves >= slow_load;
  const TimeMode mode = !slow             ? TimeMode::explicit_
                        : asked == "auto" ? TimeMode::quasi_static
                                          : TimeMode::dynamic;
  say(fmt::format("time     {}: the load lasts {:.3g} times a shear wave's way through the organ",
                  !slow             ? "every wave"
                  : asked == "auto" ? "quasi-static"
                                    : "dynamic, in steps of the body's own swings",
                  waves));
  return mode;
}

void solve_by(TimeMode mode, const ForceSystem& system, const Model& model, const Loading& loading,
              const SolverOptions& options, const Observer& observer, History& history,
              const State* from = nullptr) {
  switch (mode) {
    case TimeMode::quasi_static:
      return load_slowly(system, model, loading, options, observer, history, from);
    case TimeMode::dynamic:
      return simulate_implicitly(system, model, loading, options, observer, history, from);
    case TimeMode::explicit_:
      return simulate(system, model, loading, options, observer, history, from);
  }
}

// What an earlier run of the same image or model, by the same options, has left finished. Throws UsageError:
// it was another run.
Outcome finished_already(const fs::path& folder, const Config& config, const std::string& input_key,
                         const std::string& input_sha256) {
  Outcome outcome;
  outcome.summary_json = read_file(folder / "summary.json");
  Config before;
  read_config(before, folder / "config.resolved.toml");
  const Json summary = Json::parse(outcome.summary_json, nullptr, false);
  require_same_run({summary.value("version", ""), option_values(before), summary.value(input_key, "")},
                   {DIMPLE_VERSION, option_values(config), input_sha256});
  std::error_code ignored;
  fs::remove(folder / checkpoint_file, ignored);  // if it was killed between the last file and this
  remove_temporaries_in(folder);
  outcome.headline = fmt::format("{:.4f} N at {:.2f} mm", summary.value("force_N", 0.0),
                                 summary.value("indentation_mm", 0.0));
  say(fmt::format("resume   {} holds the finished run: nothing to do", folder.string()));
  return outcome;
}

struct SolveInput {
  const Config& config;
  ModelFiles& files;
  Json summary;                    // what is known already
  std::function<void()> begin;     // nothing is written before the model and the load are accepted
  std::vector<std::string> facts;  // for the picture
  std::map<std::string, std::string> notes;
  std::string subject;
  RunIdentity identity;
  std::optional<Checkpoint> resumed;
  Stages stages = {};
  double read_s = 0.0, build_s = 0.0;
  Stopwatch whole = {};
};

// What is to be resumed in the folder, if anything. Throws UsageError: it was another run.
std::optional<Checkpoint> resumed_in(const ResultFolder& folder, const RunIdentity& identity) {
  if (!folder.resumable()) return std::nullopt;
  Checkpoint checkpoint = read_checkpoint(folder.path() / checkpoint_file);
  require_same_run(checkpoint.run, identity);
  return checkpoint;
}

Outcome solve_in(const fs::path& folder, SolveInput in) {
  const Config& config = in.config;
  Checkpoint kept{
      .run = in.identity, .model_sha256 = sha256_of_model(in.files), .frame_time_s = {}, .state = {}};
  if (in.resumed && in.resumed->model_sha256 != kept.model_sha256)
    throw InputError(
        {.fact = "the model has not come out as it was when the run began",
         .where = "--resume",
         .why = "another build of the program, or another processor, computes a little otherwise",
         .remedy = "start anew with --force, or resume where the run was begun"});
  Model& model = in.files.model;
  require_room_beneath(config, model);
  Stopwatch preparing;
  const Tissues tissues = tissues_of(config, in.files);
  const bool is_converging = in.files.scheme == "converging";
  const Material& material = tissues.material.front();
  const SurfacePieces pieces = surface_of(in.files);
  in.stages.add("surface pieces", preparing.seconds());
  doing("finding supports");
  const auto [support, consistency, stages] =
      complete_model(model, in.files.support, tissues.of_point, density_of(model, tissues), pieces);
  in.stages.add(stages);
  say(fmt::format(
      "support  {} basis, {} weight, radius {:.2f} spacings: {} to {} nodes per point, mean {:.1f}; {} grown "
      "for conditioning",
      basis_word(in.files.support.basis), weight_word(in.files.support.weight),
      in.files.support.effective_radius_factor(), support.fewest, support.most, support.mean, support.grown));
  detail(fmt::format("support  linear fields reproduced to {:.1e}; worst pivot ratio {:.1e}",
                     support.linear_error, support.worst_pivot_ratio));
  if (consistency.iterations > 0)
    detail(fmt::format(
        "patch    forces of a constant pressure: {:.1e} off before, {:.1e} after a change of gradients by at "
        "most {:.2f} of a cell's largest",
        consistency.before, consistency.after, consistency.largest_change));
  else if (is_converging)
    warn("without a surface the gradients are not made consistent: forces at high pressure are too low");
  say(fmt::format("mass     {:.2f} g in all, {:.3g} to {:.3g} g per node", model.mass.sum() * 1e3,
                  model.mass.minCoeff() * 1e3, model.mass.maxCoeff() * 1e3));
  const Loading loading = loading_of(config);
  const SolverOptions options = solver_options(config);
  std::vector<Finding> findings = check_model(model, support, loading.depth);
  for (const Finding& finding : findings) warn(in_words(finding));
  for (std::size_t t = 0; t < tissues.material.size(); ++t) say(describe(tissues, t));
  const TimeMode mode = choose_time(config, model, tissues, is_converging);
  const bool quasi_static = mode == TimeMode::quasi_static;
  say(fmt::format("load     {:.3g} mm at {:.3g} mm/s: {:.3g} s, {}, {}", config.load.depth_mm,
                  config.load.rate_mm_per_s, loading.duration(), config.load.contact,
                  quasi_static                ? fmt::format("equilibrium at {} depths", options.frames)
                  : mode == TimeMode::dynamic ? "with inertia, by implicit steps"
                                              : "every wave followed, by central differences"));
  if (is_as_printed(material)) {
    warn("the printed stress has no energy: energy.csv shows that of the consistent form");
    if (options.damping == 0.0)
      warn(
          "the printed stress does work on closed paths, so undamped vibration grows: give --damping, for "
          "instance 20");
  }
  const double prepare_s = preparing.seconds();
  Stopwatch beginning;
  stop_if_asked();
  doing("writing the model");
  in.begin();
  double writing_s = beginning.seconds();
  doing("");
  Stopwatch readying;
  const ForceSystem system(model, tissues, precision_of(config));
  model.dphi.resize(3, 0);  // the system has its own, in its layout
  ResultWriter writer(folder, model, in.files.surface, in.files.support);
  give_back_memory();
  stop_if_asked();
  in.build_s += prepare_s + readying.seconds();

  History history;
  Progress progress("solve");
  Stopwatch solving;
  const double begin_s = writing_s;
  double solve_s_before = 0.0, writing_s_before = 0.0;
  writing_s = 0.0;
  if (in.resumed) {
    solve_s_before = in.resumed->solve_wall_s;
    writing_s_before = in.resumed->write_wall_s;
    writer.resume(in.resumed->frame_time_s);
    say(fmt::format(
        "resume   after {} frames, at {:.2f} mm", in.resumed->frame_time_s.size(),
        in.resumed->state.history.force.empty() ? 0.0 : 1e3 * in.resumed->state.history.force.back().depth));
  }
  // Where the run stands is kept now and then, within a hundredth of its time.
  Stopwatch since_kept;
  double keeping_s = 0.0;
  const Observer observer = {
      .frame =
          [&](const Frame& frame) {
            Stopwatch writing;
            writer.frame(frame);
            give_back_memory();
            writing_s += writing.seconds();
          },
      .sample =
          [&](const ForceSample& now, const History& h) {
            progress.update(
                now.depth / loading.depth,
                quasi_static
                    ? fmt::format("{:.2f} mm, {:.5f} N, {} evaluations", 1e3 * now.depth, now.force, h.steps)
                    : fmt::format("t {:.2f} s, {:.2f} mm, {:.5f} N, step {:.3g} us", now.t, 1e3 * now.depth,
                                  now.force, 1e6 * h.dt_smallest));
            return stop_asked() == StopReason::none;
          },
      .between_steps =
          [&](const std::function<State()>& state) {
            if (since_kept.seconds() < std::max(0.2, 100.0 * keeping_s)) return;
            Stopwatch writing;
            kept.state = state();
            kept.frame_time_s = writer.frame_time_s();
            kept.solve_wall_s = solve_s_before + solving.seconds() - writing_s;
            kept.write_wall_s = writing_s_before + writing_s;
            write_checkpoint(folder / checkpoint_file, kept);
            since_kept = {};
            keeping_s = writing.seconds();
            writing_s += keeping_s;
          },
      .retry =
          [&](const Retry& retry) {
            progress.finish();
            say(fmt::format("retry    {}, at {:.3f} mm ({}): {}", history.retries.size(), 1e3 * retry.depth,
                            retry.code, retry.what));
          }};
  // What there is until then is written before a failure is passed on.
  std::exception_ptr failure;
  Report reason;
  try {
    solve_by(mode, system, model, loading, options, observer, history,
             in.resumed ? &in.resumed->state : nullptr);
  } catch (const Stopped&) {
    history.interrupted = true;
  } catch (const Error& error) {
    // What breaks while everything is being stopped is a consequence of that.
    if (stop_asked() == StopReason::none) {
      failure = std::current_exception();
      reason = error.report;
    } else {
      history.interrupted = true;
    }
  }
  progress.finish();
  for (const Finding& finding : history.guards) warn(in_words(finding));
  findings.insert(findings.end(), history.guards.begin(), history.guards.end());
  // Stopped before there was anything to keep.
  if (history.interrupted && (history.force.empty() || writer.frame_time_s().empty()))
    throw Stopped(stop_asked());
  const double solve_s_here = solving.seconds() - writing_s, solve_s = solve_s_before + solve_s_here;
  writing_s += begin_s;
  Stopwatch ending;
  doing("writing results");
  writer.tables(history);

  Outcome outcome;
  outcome.interrupted = history.interrupted;
  const std::string status = failure ? "failed" : history.interrupted ? "interrupted" : "finished";
  const double reached = history.force.empty() ? 0.0 : 1e3 * history.force.back().depth;
  const double force = history.force.empty() ? 0.0 : history.force.back().force;
  const double evaluations = static_cast<double>(history.steps + history.extra_evaluations);
  double energy_error = 0.0, energy_scale = 0.0;
  for (const EnergySample& e : history.energy) {
    energy_error = std::max(energy_error, std::abs(e.error()));
    energy_scale = std::max(energy_scale, std::abs(e.external));
  }

  Json& summary = in.summary;
  summary["status"] = status;
  if (history.interrupted) {
    reason = Stopped(stop_asked()).report;
    outcome.ended_by =
        fmt::format("{} at {:.3g} of {:.3g} mm, after {:.1f} s; --resume goes on from there [{}]",
                    reason.fact, reached, config.load.depth_mm, in.whole.seconds(), reason.code);
  }
  if (failure || history.interrupted) summary["failure"] = report_json(reason);
  summary["exit_code"] = static_cast<int>(failure               ? ExitCode::solve
                                          : history.interrupted ? ExitCode::interrupted
                                                                : ExitCode::ok);
  summary["version"] = DIMPLE_VERSION;
  summary["scheme"] = in.files.scheme;
  summary["time"] = quasi_static ? "quasi-static" : mode == TimeMode::dynamic ? "dynamic" : "explicit";
  summary["precision"] = config.solver.precision;
  summary["requested"] = {{"depth_mm", config.load.depth_mm},
                          {"rate_mm_per_s", config.load.rate_mm_per_s},
                          {"frames", config.solver.frames}};
  summary["contact"] = config.load.contact;
  summary["material"] = materials_json(config, tissues);
  summary["counts"] = counts_json(model);
  summary["support"] = {{"fewest", support.fewest},
                        {"most", support.most},
                        {"mean", support.mean},
                        {"grown", support.grown},
                        {"worst_pivot_ratio", support.worst_pivot_ratio},
                        {"linear_error", support.linear_error}};
  summary["consistency"] = {
      {"before", consistency.before}, {"after", consistency.after}, {"iterations", consistency.iterations}};
  summary["volume_mm3"] = model.volume.sum() * 1e9;
  summary["mass_g"] = model.mass.sum() * 1e3;
  summary["indentation_mm"] = reached;
  summary["force_N"] = force;
  summary["base_force_N"] = history.force.empty() ? 0.0 : history.force.back().base_force;
  summary["stable_step_s"] = history.dt_stable_first;
  summary["time_step_s"] = history.dt_first;
  summary["smallest_time_step_s"] = history.dt_smallest;
  summary["steps"] = quasi_static ? 0 : history.steps;
  summary["residual"] = history.residual;
  summary["most_inverted_points"] = history.inverted;  // at any depth; guards tell of the worst one
  summary["force_evaluations"] = history.steps + history.extra_evaluations;
  summary["J_min"] = history.J_min;
  summary["energy_error"] = energy_scale > 0.0 ? energy_error / energy_scale : 0.0;
  summary["momentum_error"] = history.momentum_error;
  const double ms_per_evaluation = evaluations > 0.0 ? 1e3 * solve_s / evaluations : 0.0,
               times_real = solve_s > 0.0 ? reached / config.load.rate_mm_per_s / solve_s : 0.0;
  write_file(folder / "config.resolved.toml", to_toml(config, in.notes));
  outcome.headline = fmt::format("{:.4f} N at {:.2f} mm", force, reached);
  if (!history.force.empty()) {
    if (quasi_static)
      in.facts.push_back(
          fmt::format("equilibrium at {} depths: {} force evaluations, {:.2f} ms each, {:.1f} s",
                      options.frames, history.steps, ms_per_evaluation, solve_s));
    else
      in.facts.push_back(fmt::format(
          "{} steps of {:.3g} us (stable {:.3g} us), {:.2f} ms each, {:.1f} s: {:.2f} x real time",
          history.steps, 1e6 * history.dt_first, 1e6 * history.dt_stable_first, ms_per_evaluation, solve_s,
          times_real));
    if (quasi_static)
      say(fmt::format(
          "done     {} force evaluations, {:.3f} ms each; unbalanced {:.1e} of the reactions, base "
          "carries {:.4f} N",
          history.steps, ms_per_evaluation, history.residual, summary["base_force_N"].get<double>()));
    else
      say(fmt::format(
          "done     {} steps of {:.3g} us, {:.3f} ms each, {:.2f} x real time; energy error {:.2g} "
          "%, base carries {:.4f} N",
          history.steps, 1e6 * history.dt_first, ms_per_evaluation, times_real,
          100.0 * summary["energy_error"].get<double>(), summary["base_force_N"].get<double>()));
  }
  // Who is asked to end has not always the time for a picture.
  if (!history.force.empty() && !history.interrupted)
    writer.overview(history,
                    fmt::format("{}: {}{}", in.subject, outcome.headline,
                                status == "finished" ? "" : " (" + status + ")"),
                    in.facts);
  writing_s += ending.seconds();
  say(fmt::format(
      "time     {:.1f} s in all: {:.1f} reading, {:.1f} building the model, {:.1f} solving, {:.1f} "
      "writing",
      in.whole.seconds(), in.read_s, in.build_s, solve_s_here, writing_s));
  summary["preprocess_wall_s"] = stages_json(in.stages);
  summary["prepare_wall_s"] = prepare_s;
  summary["solve_wall_s"] = solve_s;
  summary["write_wall_s"] = writing_s_before + writing_s;
  summary["total_wall_s"] = in.whole.seconds();
  summary["ms_per_step"] = ms_per_evaluation;
  summary["real_time_factor"] = times_real;
  summary["threads"] = tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
  summary["warnings"] = warnings_so_far();
  summary["guards"] = Json::array();
  for (const Finding& finding : findings) {
    Json entry = report_json(finding.report);
    entry["worst"] = finding.worst;
    summary["guards"].push_back(entry);
  }
  summary["retries"] = Json::array();
  for (const Retry& retry : history.retries)
    summary["retries"].push_back({{"code", retry.code}, {"at_mm", 1e3 * retry.depth}, {"what", retry.what}});
  outcome.summary_json = summary.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
  // The last file: a folder with it is complete. Then there is nothing to go on with.
  write_file(folder / "summary.json", outcome.summary_json);
  if (!failure && !history.interrupted) {
    std::error_code ignored;
    fs::remove(folder / checkpoint_file, ignored);
  }
  if (failure) std::rethrow_exception(failure);
  return outcome;
}

}  // namespace

Outcome make_model(const Config& config, const fs::path& folder, Existing existing) {
  forget_warnings();
  const Stopwatch whole;
  ResultFolder results(folder, existing);
  if (existing == Existing::refuse && fs::exists(folder / "model.toml"))
    throw OutputError({.fact = fmt::format("{} holds a model already", folder.string()),
                       .where = "-o",
                       .why = "it would be lost",
                       .remedy = "give another folder with -o, or --force to replace it"});
  Prepared prepared = prepare(config);
  // Supports are found again when the model is solved; here only to refuse a model that cannot be.
  doing("finding supports");
  Stages stages;
  const SurfacePieces pieces = surface_of(prepared.files);
  stages.done("surface pieces");
  const Completion completion = complete_model(
      prepared.files.model, prepared.files.support, Eigen::VectorXi::Zero(prepared.files.model.point_count()),
      Eigen::VectorXd::Constant(prepared.files.model.point_count(), 1000.0), pieces);
  const SupportReport& support = completion.support;
  stages.add(completion.stages);
  prepared.stages.add(stages);
  stop_if_asked();
  const double before_writing_s = whole.seconds();
  doing("writing the model");
  results.prepare();
  std::error_code ignored;
  fs::remove(folder / "model.toml", ignored);  // it comes last: with it the model is complete
  write_vti(folder / "label.vti", prepared.image);
  write_model(folder, prepared.files);
  const double in_all_s = whole.seconds();
  say(fmt::format("time     {:.1f} s in all: {:.1f} reading, {:.1f} building the model, {:.1f} writing",
                  in_all_s, prepared.read_s, before_writing_s - prepared.read_s,
                  in_all_s - before_writing_s));
  Json summary = model_json(prepared);
  summary["version"] = DIMPLE_VERSION;
  summary["image"] = config.image.file;
  summary["labels"] = labels_json(prepared.labels);
  summary["scheme"] = prepared.files.scheme;
  summary["consistency"] = {{"before", completion.consistency.before},
                            {"after", completion.consistency.after},
                            {"iterations", completion.consistency.iterations}};
  summary["preprocess_wall_s"] = stages_json(prepared.stages);
  summary["counts"] = counts_json(prepared.files.model);
  summary["support"] = {
      {"fewest", support.fewest}, {"most", support.most}, {"mean", support.mean}, {"grown", support.grown}};
  summary["warnings"] = warnings_so_far();
  return {.summary_json = summary.dump(2, ' ', false, Json::error_handler_t::replace) + "\n",
          .headline = fmt::format("{} nodes, {} integration points", prepared.files.model.node_count(),
                                  prepared.files.model.point_count())};
}

Outcome solve_model(const Config& config, const fs::path& model, const fs::path& folder, Existing existing) {
  forget_warnings();
  const Stopwatch whole;
  ResultFolder results(folder, existing);
  ModelFiles files = read_model(model);
  const double read_s = whole.seconds();
  check_materials(materials_of(config), files.scheme);
  const RunIdentity identity{DIMPLE_VERSION, option_values(config), sha256_of_model(files)};
  if (existing == Existing::resume && results.finished())
    return finished_already(folder, config, "model_sha256", identity.input_sha256);
  std::optional<Checkpoint> resumed = resumed_in(results, identity);
  for (const std::string& note : files.notes) warn(note);
  say_default_stiffness(config);
  const fs::path model_folder = fs::is_directory(model) ? model : model.parent_path();
  Json summary;
  summary["made_from"] = files.provenance;
  summary["model_sha256"] = identity.input_sha256;
  SolveInput input{.config = config,
                   .files = files,
                   .summary = summary,
                   .begin =
                       [&] {
                         results.prepare(model_folder);
                         const fs::path label = model_folder / "label.vti";
                         if (fs::exists(label)) write_file(folder / "label.vti", read_file(label));
                       },
                   .facts = {},
                   .notes = {},
                   .subject = model.filename().string(),
                   .identity = identity,
                   .resumed = std::move(resumed),
                   .read_s = read_s,
                   .whole = whole};
  for (const char* key : {"image", "base", "circle"})
    if (const auto found = files.provenance.find(key); found != files.provenance.end())
      input.facts.push_back(fmt::format("{}: {}", key, found->second));
  return solve_in(folder, std::move(input));
}

Outcome run(const Config& config, const fs::path& folder, Existing existing) {
  forget_warnings();
  const Stopwatch whole;
  ResultFolder results(folder, existing);
  RunIdentity identity{DIMPLE_VERSION, option_values(config), ""};
  std::optional<Checkpoint> resumed;
  if (existing == Existing::resume && !config.image.file.empty() &&
      (results.finished() || results.resumable())) {
    identity.input_sha256 = sha256_of_file(config.image.file);
    if (results.finished()) return finished_already(folder, config, "image_sha256", identity.input_sha256);
    resumed = resumed_in(results, identity);
  }
  Prepared prepared = prepare(config);
  identity.input_sha256 = prepared.files.provenance.at("image_sha256");
  Json summary;
  summary["image"] = config.image.file;
  summary["image_sha256"] = prepared.files.provenance.at("image_sha256");
  summary["labels"] = labels_json(prepared.labels);
  summary["model"] = model_json(prepared);
  SolveInput input{.config = config,
                   .files = prepared.files,
                   .summary = summary,
                   .begin =
                       [&] {
                         results.prepare();
                         write_model(folder / "model", prepared.files);
                         write_vti(folder / "label.vti", prepared.image);
                         prepared.image = {};  // nobody needs it any longer
                       },
                   .facts = {},
                   .notes = prepared.notes,
                   .subject = fs::path(config.image.file).filename().string(),
                   .identity = identity,
                   .resumed = std::move(resumed),
                   .stages = prepared.stages,
                   .read_s = prepared.read_s,
                   .build_s = prepared.build_s,
                   .whole = whole};
  const ModelReport& report = prepared.report;
  input.facts = {
      fmt::format("{:.1f} cm3; {} nodes {:.2f} mm apart ({} on the surface), {} integration points in cells "
                  "of {:.2f} mm",
                  prepared.segment.voxel_volume_mm3 / 1e3, prepared.files.model.node_count(),
                  report.spacing_mm, report.surface_nodes, prepared.files.model.point_count(),
                  report.cell_mm),
      fmt::format("base: {} nodes, {}", prepared.files.model.base.size(), report.boundary.base_reason),
      fmt::format("circle: {} nodes at {}, {}", report.circle_nodes,
                  place(prepared.files.model.tool.centre * 1e3), report.boundary.circle_reason)};
  return solve_in(folder, std::move(input));
}

Measured measure(const Config& config) {
  Stopwatch building;
  Prepared prepared = prepare(config);
  Model& model = prepared.files.model;
  const Tissues tissues = tissues_of(config, prepared.files);
  const bool is_converging = converging(config);
  complete_model(model, prepared.files.support, tissues.of_point, density_of(model, tissues),
                 surface_of(prepared.files));
  const ForceSystem system(model, tissues, precision_of(config));
  Measured result = {.nodes = model.node_count(),
                     .points = model.point_count(),
                     .spacing_mm = prepared.report.spacing_mm,
                     .rim_spacing_mm = prepared.report.rim_spacing_mm,
                     .history = {},
                     .build_s = building.seconds()};
  Stopwatch solving;
  const Observer observer = {.frame = {}, .sample = [](const ForceSample&, const History&) {
                               stop_if_asked();
                               return true;
                             }};
  solve_by(choose_time(config, model, tissues, is_converging), system, model, loading_of(config),
           solver_options(config), observer, result.history);
  if (result.history.interrupted) throw Stopped(stop_asked());  // no numbers of a part for those of the whole
  result.solve_s = solving.seconds();
  return result;
}

SegmentedBody segment(const Config& config) {
  if (config.image.file.empty())
    throw UsageError({.fact = "no label image was given",
                      .where = "command line",
                      .why = "there is nothing to work on",
                      .remedy = "give one: dimple export IMAGE -o FILE"});
  const LabelImage image = read_label_image(config.image.file, config.image.label_names);
  std::map<std::string, int> names;
  for (const auto& [value, name] : image.names) names[name] = value;
  const auto [labels, taken] = take_labels(config, image, names);
  say_labels(config, labels, taken, names);
  say_default_stiffness(config);
  return make_body_surface(image, labels, {.indenter_diameter_mm = config.boundary.indenter_diameter_mm});
}

void describe_image(const fs::path& file, const fs::path& label_names, bool as_json) {
  const LabelImage image = read_label_image(file, label_names);
  const std::vector<LabelMeasure> labels = measure_labels(image);
  if (as_json) {
    Json out = {{"file", file.string()},
                {"format", image.format},
                {"orientation", image.orientation},
                {"size", {image.stored_size[0], image.stored_size[1], image.stored_size[2]}},
                {"spacing_mm", three(image.stored_spacing)},
                {"labels", Json::array()},
                {"warnings", image.warnings}};
    for (const LabelMeasure& l : labels)
      out["labels"].push_back({{"value", l.value},
                               {"name", l.name},
                               {"voxels", l.voxels},
                               {"volume_mm3", l.volume_mm3},
                               {"centre_mm", three(l.centre_mm)},
                               {"pieces", l.pieces},
                               {"touches_border", l.touches_border}});
    // A file's name may be no UTF-8.
    fmt::print("{}\n", out.dump(2, ' ', false, Json::error_handler_t::replace));
    return;
  }
  fmt::print(
      "{}\n  format       {}\n  size         {} x {} x {} voxels\n  spacing      {:.6g} x {:.6g} x {:.6g} "
      "mm\n  axes run to  {}\n\n",
      file.string(), image.format, image.stored_size[0], image.stored_size[1], image.stored_size[2],
      image.stored_spacing.x(), image.stored_spacing.y(), image.stored_spacing.z(), image.orientation);
  fmt::print("{:>6}  {:<28} {:>12} {:>14}  {:<24}  {:>6}  {}\n", "label", "name", "voxels", "volume_mm3",
             "centre L, P, S [mm]", "pieces", "touches border");
  for (const LabelMeasure& l : labels)
    fmt::print("{:>6}  {:<28} {:>12} {:>14.1f}  {:<24}  {:>6}  {}\n", l.value, l.name, l.voxels, l.volume_mm3,
               fmt::format("{:.1f}, {:.1f}, {:.1f}", l.centre_mm.x(), l.centre_mm.y(), l.centre_mm.z()),
               l.pieces, l.touches_border ? "yes" : "no");
  for (const std::string& warning : image.warnings) warn(warning);
}

}  // namespace dimple
