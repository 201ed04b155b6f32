// Errors of the force for real organs, odd bodies and slits, in addition to the block.
//
//   dimple_organs FOLDER [--data DIR] [--bodies A,B] [--nodes 1000,2000] [--seeds N] [--depth MM] [--frames
//   N]
//                 [--sensitivity]
//
// Writes organs_forces.csv: a row for each body, number of nodes, seed and depth. Writes organs.csv: errors
// of the means over the seeds against the finite elements of tests/verification/reference at 2 and 4 mm.
// Bodies without an image are left out with a message. --sensitivity halves and doubles each constant of the
// scheme instead, and writes sensitivity.csv.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <filesystem>
#include <functional>
#include <map>
#include <numeric>
#include <optional>
#include <sstream>

#include "apps/run/stopwatch.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/label_image.hpp"
#include "preprocess/build_model.hpp"
#include "preprocess/image/phantom.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

struct Body {
  std::string name;
  std::function<SegmentedBody()> surface;
  BoundaryOptions boundary = {};
  double depth_mm = 4.0;
  std::string image = {};  // below --data
  bool two_tissues = false;
  // First fields of its rows in a table of tests/verification/reference; depth, force and, if available, the
  // uncertainty follow.
  std::string reference = {}, rows = {};
  double known_to_percent = 0.0;
};

const BoundaryOptions on_top = {.base = "inferior", .indent_at = "0,0,top", .indenter_diameter_mm = 10.0};

BoundaryOptions on_top_with(double diameter_mm, const std::string& at = "0,0,top") {
  BoundaryOptions options = on_top;
  options.indenter_diameter_mm = diameter_mm;
  options.indent_at = at;
  return options;
}

std::vector<Body> bodies(const fs::path& data) {
  const auto exact = [](auto make) { return [make] { return SegmentedBody{make(), {}}; }; };
  const auto block = [&](double x, double y, double z) {
    return exact([=] { return block_surface({-x / 2, -y / 2, 0}, {x / 2, y / 2, z}); });
  };
  const auto ellipsoid = exact([] { return cut_ellipsoid_surface({46.25, 31.25, 16.7647}, -11.7353); });
  const auto from_file = [&](const std::string& name, std::vector<int> labels) {
    return [=] { return make_body_surface(read_label_image(data / name), labels); };
  };
  const auto compared = [](Body body, const std::string& file, const std::string& rows,
                           double known_to_percent) {
    body.reference = file, body.rows = rows, body.known_to_percent = known_to_percent;
    return body;
  };
  std::vector<Body> list = {
      compared({"scene_a", block(60, 60, 30), on_top}, "block.csv", "", 1.0),
      compared({"scene_b", ellipsoid, on_top}, "cut_ellipsoid.csv", "", 1.5),
      compared({"ellipsoid_15", ellipsoid, on_top_with(10.0, "15,0,top")}, "ellipsoid_15.csv", "", 2.0),
      compared({"ellipsoid_25", ellipsoid, on_top_with(10.0, "25,0,top")}, "ellipsoid_25.csv", "", 2.0),
      compared({"block_100_100_20", block(100, 100, 20), on_top_with(12.0)}, "blocks.csv", "100,20,12,0.6,",
               1.5),
      compared({"block_40", block(40, 40, 40), on_top_with(20.0), 8.0}, "blocks.csv", "40,40,20,1.2,", 1.5),
      compared({"layer_10", block(60, 60, 10), on_top}, "blocks.csv", "60,10,10,0.6,", 1.5),
      compared({"layer_15", block(60, 60, 15), on_top}, "blocks.csv", "60,15,10,0.6,", 1.5)};
  for (const double gap : {1.0, 3.0, 8.0})
    for (const double width : {0.5, 1.0, 2.0})
      list.push_back(compared({fmt::format("slit_{:g}_gap_{:g}", width, gap), exact([=] {
                                 return slit_block_surface({60, 60, 30}, 5.0 + gap, width, 25.0);
                               }),
                               on_top},
                              "slits.csv", fmt::format("{:g},{:g},", width, gap), 1.5));
  Body two_labels = {"two_labels", [] { return make_body_surface(make_phantom({.two_labels = true}), {}); }};
  two_labels.two_tissues = true;
  list.push_back(compared(two_labels, "two_labels.csv", "", 2.0));
  list.push_back({"phantom_brain", [] { return make_body_surface(make_phantom({}), {}); }, {}});
  // Same position of the tool as in the reference computations: on the organ's own flat or broadest side.
  const auto add_file = [&](const std::string& name, const std::string& file, std::vector<int> labels,
                            const std::string& at = "opposite") {
    const std::string in_table = name == "right_lung" ? "lung" : name == "human_brain" ? "brain" : name;
    list.push_back(
        compared({name, from_file(file, std::move(labels)), {.base = "organ", .indent_at = at}, 4.0, file},
                 in_table + ".csv", "", 3.0));
  };
  add_file("heart", "heart_ct_1.5mm.nii.gz", {}, "26.308587,-165.268872,714.798895");
  add_file("liver", "abdomen_mr_3mm.nii.gz", {5}, "-95.399296,-33.354610,27.513709");
  add_file("right_lung", "lung_ct_aniso.mha", {}, "2.357415,-115.842175,-1245.037788");
  add_file("chest_right_lung", "chest_ct_10mm.seg.nrrd", {5}, "4.4,-61.4,-149.4");
  add_file("human_brain", "human_brain_mri_2mm.nrrd", {}, "-15.0,5.7,-46.6");
  return list;
}

// A constant of the scheme times a factor.
struct Variation {
  std::string constant;
  double factor = 1.0;
};

struct Constant {
  std::string name, meaning;
  std::function<double&(ModelOptions&)> of;
};

const std::vector<Constant>& constants() {
  static const std::vector<Constant> list = {
      {"rim", "spacing on the rim / far away",
       [](ModelOptions& o) -> double& { return o.node_set.grading.patch_edge; }},
      {"least", "least spacing on the rim, in radii",
       [](ModelOptions& o) -> double& { return o.node_set.grading.least; }},
      {"reach", "distance from the rim where the far spacing is reached, in radii",
       [](ModelOptions& o) -> double& { return o.node_set.grading.reach; }},
      {"load_exponent", "of the load path's factor",
       [](ModelOptions& o) -> double& { return o.node_set.grading.load_exponent; }},
      {"load_slope", "of that factor, per reach",
       [](ModelOptions& o) -> double& { return o.node_set.grading.load_slope; }},
      {"points_per_node", "integration points per node",
       [](ModelOptions& o) -> double& { return o.grid.ratio; }},
      {"density_rim", "points per node at the rim over that far away",
       [](ModelOptions& o) -> double& { return o.grid.density.patch_edge; }},
      {"radius_factor", "radius of a support, in spacings",
       [](ModelOptions& o) -> double& { return o.scheme.support.radius_factor; }},
      {"interpolation", "of the weight at prescribed nodes",
       [](ModelOptions& o) -> double& { return o.scheme.support.interpolation; }}};
  return list;
}

void vary(ModelOptions& options, const Variation& variation) {
  for (const Constant& constant : constants())
    if (constant.name == variation.constant) constant.of(options) *= variation.factor;
}

struct Options {
  fs::path folder, data;
  Variation varied = {};
  std::vector<std::string> bodies;
  std::vector<Index> nodes = {1000, 2000, 4250};
  int seeds = 1, frames = 4;
  double depth_mm = 0.0;  // 0: each body's own
};

// Forces of a body: nodes, seed -> depth in mm -> N.
using Forces = std::map<std::pair<Index, int>, std::map<double, double>>;

Forces measure(const Body& body, const Options& requested, std::string& csv) {
  Forces forces;
  if (!body.image.empty() && !fs::exists(requested.data / body.image)) {
    fmt::print("{}: left out, {} is not in --data\n", body.name, body.image);
    return forces;
  }
  const double depth = requested.depth_mm > 0.0 ? requested.depth_mm : body.depth_mm;
  const SegmentedBody segmented = body.surface();
  std::optional<LabelImage> image;
  if (body.two_tissues) image = make_phantom({.two_labels = true});
  for (const Index nodes : requested.nodes)
    for (int seed = 1; seed <= requested.seeds; ++seed) {
      ModelOptions options;
      options.node_set.count = nodes;
      options.node_set.seed = static_cast<std::uint64_t>(seed);
      options.boundary = body.boundary;
      vary(options, requested.varied);
      const Stopwatch building;
      try {
        TissueOptions tissues;
        std::vector<Material> material = {neo_hookean(210.0, 0.499, 1000.0)};
        if (image) {
          tissues = {.of_label = {{3, 1}}, .density = {1000.0, 1000.0}};
          material.push_back(neo_hookean(1050.0, 0.499, 1000.0));
        }
        BuiltModel built = build_model(segmented.surface, options, tissues,
                                       image ? label_finder(*image, segmented.surface) : LabelAt{});
        const double built_s = building.seconds();
        const ModelReport report = built.report;
        const std::size_t unconnected = built.model.support_report.unconnected.size();
        const Index points = built.model.point_count(), count = built.model.node_count();
        const Stopwatch solving;
        const History history = solve(built.model, {material, built.model.tissue}, {.depth = 1e-3 * depth},
                                      {.frames = requested.frames});
        const double solved_s = solving.seconds();
        std::string line = fmt::format("{:18} {:6} seed {} h {:.2f}/{:.2f}:", body.name, count, seed,
                                       report.patch_edge_spacing_mm, report.spacing_mm);
        int frame = 0;
        for (const ForceSample& sample : history.force) {
          const double requested_depth = depth * (frame + 1) / requested.frames;
          if (std::abs(1e3 * sample.depth - requested_depth) > 1e-6) continue;
          ++frame;
          forces[{nodes, seed}][requested_depth] = sample.force;
          line += fmt::format(" {:.3f}", 1e3 * sample.force);
          csv += fmt::format("{},{},{},{},{:.6g},{:.7g},{:.4g},{:.4g},{},{:.3g},{:.3g}\n", body.name, count,
                             points, seed, 1e3 * sample.depth, sample.force, report.patch_edge_spacing_mm,
                             report.spacing_mm, history.evaluations, built_s, solved_s);
        }
        fmt::print("{} mN; {} ev, {:.2f} + {:.2f} s, {} of {} unconnected\n", line, history.evaluations,
                   built_s, solved_s, unconnected, points);
      } catch (const Error& error) {
        fmt::print("{:18} {:6} seed {}: {}; {}; {}\n", body.name, nodes, seed, error.report.fact,
                   error.report.where, error.report.why);
      }
      std::fflush(stdout);
    }
  return forces;
}

struct Known {
  double force, percent;
};

// Forces of the finite elements by depth in mm. These tables have fields of text, which read_csv() does not
// accept.
std::map<double, Known> reference_of(const Body& body) {
  std::map<double, Known> result;
  if (body.reference.empty()) return result;
  std::istringstream lines(read_file(fs::path(DIMPLE_REFERENCE_DIR) / body.reference));
  for (std::string line; std::getline(lines, line);) {
    if (line.empty() || !line.starts_with(body.rows) || (body.rows.empty() && !std::isdigit(line.front())))
      continue;
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream fields(line.substr(body.rows.size()));
    double depth = 0.0, more = 0.0;
    Known known{0.0, body.known_to_percent};
    if (!(fields >> depth >> known.force)) continue;
    if (fields >> more && more < 100.0) known.percent = more;
    result[depth] = known;
  }
  return result;
}

struct SecondMoments {
  double mean = 0.0, scatter = 0.0;  // of forces: N; largest less smallest over the mean
};

SecondMoments over_seeds(const Forces& forces, Index nodes, double depth) {
  std::vector<double> all;
  for (const auto& [run, curve] : forces)
    if (const auto at = curve.find(depth); run.first == nodes && at != curve.end()) all.push_back(at->second);
  if (all.empty()) return {};
  const auto [least, most] = std::minmax_element(all.begin(), all.end());
  const double mean = std::accumulate(all.begin(), all.end(), 0.0) / static_cast<double>(all.size());
  return {mean, (*most - *least) / mean};
}

constexpr std::array depths = {2.0, 4.0};  // mm

void compare(const std::vector<std::pair<Body, Forces>>& measured, const Options& requested) {
  std::string table = "body,nodes,indentation_mm,difference_percent,scatter_percent,known_to_percent\n";
  for (const auto& [body, forces] : measured) {
    const std::map<double, Known> known = reference_of(body);
    if (forces.empty() || !known.contains(depths[0]) || !known.contains(depths[1])) continue;
    for (const Index n : requested.nodes)
      for (const double depth : depths) {
        const SecondMoments spread = over_seeds(forces, n, depth);
        if (!(spread.mean > 0.0)) continue;
        table += fmt::format("{},{},{:g},{:+.1f},{:.1f},{:.2g}\n", body.name, n, depth,
                             100.0 * (spread.mean / known.at(depth).force - 1.0), 100.0 * spread.scatter,
                             known.at(depth).percent);
      }
  }
  write_file(requested.folder / "organs.csv", table);
}

// Changes of the mean force over the seeds when each constant is halved and doubled.
void measure_sensitivity(const std::vector<Body>& list, const Options& requested) {
  std::vector<Variation> runs = {{"none", 1.0}};
  for (const Constant& constant : constants())
    for (const double factor : {0.5, 2.0}) runs.push_back({constant.name, factor});
  std::string csv =
      "constant,value,factor,body,nodes,indentation_mm,force_N,scatter_percent,change_percent,difference_"
      "percent\n";
  std::map<std::string, Forces> plain;
  const Index nodes = requested.nodes.front();
  for (const Variation& variation : runs) {
    ModelOptions options;
    double value = 0.0;
    for (const Constant& constant : constants())
      if (constant.name == variation.constant) value = constant.of(options);
    for (const Body& body : list) {
      Options here = requested;
      here.nodes = {nodes};
      here.varied = variation;
      std::string unused;
      const Forces forces = measure(body, here, unused);
      if (variation.constant == "none") plain[body.name] = forces;
      const std::map<double, Known> known = reference_of(body);
      for (const double depth : depths) {
        const SecondMoments now = over_seeds(forces, nodes, depth),
                            before = over_seeds(plain[body.name], nodes, depth);
        if (!(now.mean > 0.0 && before.mean > 0.0)) continue;
        const double change = 100.0 * (now.mean / before.mean - 1.0);
        const double off = known.contains(depth) ? 100.0 * (now.mean / known.at(depth).force - 1.0) : 0.0;
        csv += fmt::format("{},{:g},{:g},{},{},{:g},{:.6g},{:.2f},{:.2f},{}\n", variation.constant, value,
                           variation.factor, body.name, nodes, depth, now.mean, 100.0 * now.scatter, change,
                           known.contains(depth) ? fmt::format("{:.2f}", off) : "");
      }
    }
    write_file(requested.folder / "sensitivity.csv", csv);
  }
}

}  // namespace
}  // namespace dimple

int main(int argc, char** argv) try {
  dimple::Options requested;
  CLI::App app("Forces of many bodies over the number of nodes");
  app.add_option("folder", requested.folder, "for tables")->required();
  app.add_option("--data", requested.data, "folder of the label images");
  app.add_option("--bodies", requested.bodies, "some of them only")->delimiter(',');
  app.add_option("--nodes", requested.nodes)->delimiter(',');
  app.add_option("--seeds", requested.seeds);
  app.add_option("--frames", requested.frames);
  app.add_option("--depth", requested.depth_mm, "mm");
  bool sensitivity = false;
  app.add_flag("--sensitivity", sensitivity,
               "each constant halved and doubled, with the first number of nodes");
  CLI11_PARSE(app, argc, argv);
  std::string csv =
      "body,nodes,points,seed,indentation_mm,force_N,rim_spacing_mm,far_spacing_mm,evaluations,build_s,solve_"
      "s\n";
  dimple::make_folder(requested.folder);
  std::vector<std::pair<dimple::Body, dimple::Forces>> measured;
  std::vector<dimple::Body> list = dimple::bodies(requested.data);
  std::erase_if(list, [&](const dimple::Body& body) {
    return !requested.bodies.empty() &&
           std::none_of(requested.bodies.begin(), requested.bodies.end(),
                        [&](const std::string& name) { return body.name.starts_with(name); });
  });
  if (sensitivity) {
    dimple::measure_sensitivity(list, requested);
    return 0;
  }
  for (const dimple::Body& body : list) {
    measured.emplace_back(body, dimple::measure(body, requested, csv));
    dimple::write_file(requested.folder / "organs_forces.csv", csv);
  }
  dimple::compare(measured, requested);
} catch (const dimple::Error& error) {
  fmt::print(stderr, "{}\n{}\n", error.report.fact, error.report.remedy);
  return static_cast<int>(error.code);
}
