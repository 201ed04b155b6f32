// How far the force is from its limit, body by body: real organs, odd bodies and slits, and not only the block.
//
//   dimple_organs FOLDER [--data DIR] [--bodies A,B] [--nodes 1000,2000] [--seeds N] [--depth MM] [--frames N]
//
// Writes forces.csv: a row for each body, number of nodes, seed and depth. Bodies whose images are not there are
// left out, in words.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <functional>
#include <optional>

#include "apps/run/stopwatch.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/label_image.hpp"
#include "preprocess/build_model.hpp"
#include "preprocess/phantom.hpp"
#include "preprocess/shapes.hpp"
#include "solver/solve.hpp"

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
  std::vector<Body> list = {{"scene_a", block(60, 60, 30), on_top},
                            {"scene_b", ellipsoid, on_top},
                            {"ellipsoid_15", ellipsoid, on_top_with(10.0, "15,0,top")},
                            {"ellipsoid_25", ellipsoid, on_top_with(10.0, "25,0,top")},
                            {"block_100_100_20", block(100, 100, 20), on_top_with(12.0), 4.0},
                            {"block_40", block(40, 40, 40), on_top_with(20.0), 8.0},
                            {"layer_10", block(60, 60, 10), on_top},
                            {"layer_15", block(60, 60, 15), on_top}};
  for (const double gap : {1.0, 3.0, 8.0})
    for (const double width : {0.5, 1.0, 2.0})
      list.push_back({fmt::format("slit_{:g}_gap_{:g}", width, gap), exact([=] {
                        return slit_block_surface({60, 60, 30}, 5.0 + gap, width, 25.0);
                      }),
                      on_top});
  list.push_back({"two_labels",
                  [] { return make_body_surface(make_phantom({.two_labels = true}), {}); },
                  {},
                  4.0,
                  {},
                  true});
  list.push_back({"phantom_brain", [] { return make_body_surface(make_phantom({}), {}); }, {}});
  const auto add_file = [&](const std::string& name, const std::string& file, std::vector<int> labels) {
    list.push_back({name, from_file(file, std::move(labels)), {}, 4.0, file});
  };
  add_file("heart", "heart_ct_1.5mm.nii.gz", {});
  add_file("liver", "abdomen_mr_3mm.nii.gz", {5});
  add_file("right_lung", "lung_ct_aniso.mha", {});
  add_file("chest_right_lung", "chest_ct_10mm.seg.nrrd", {5});
  add_file("human_brain", "human_brain_mri_2mm.nrrd", {});
  return list;
}

struct Options {
  fs::path folder, data;
  std::vector<std::string> bodies;
  std::vector<Index> nodes = {1000, 2000, 4250};
  int seeds = 1, frames = 4;
  double depth_mm = 0.0;  // 0: each body's own
};

void measure(const Body& body, const Options& wanted, std::string& csv) {
  if (!body.image.empty() && !fs::exists(wanted.data / body.image)) {
    fmt::print("{}: left out, {} is not in --data\n", body.name, body.image);
    return;
  }
  const double depth = wanted.depth_mm > 0.0 ? wanted.depth_mm : body.depth_mm;
  const SegmentedBody segmented = body.surface();
  std::optional<LabelImage> image;
  if (body.two_tissues) image = make_phantom({.two_labels = true});
  for (const Index nodes : wanted.nodes)
    for (int seed = 1; seed <= wanted.seeds; ++seed) {
      ModelOptions options;
      options.cloud.count = nodes;
      options.cloud.seed = static_cast<std::uint64_t>(seed);
      options.boundary = body.boundary;
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
        const Index unconnected = built.model.support_report.unconnected;
        const Index points = built.model.point_count(), count = built.model.node_count();
        const Stopwatch solving;
        const History history = solve(built.model, {material, built.model.tissue}, {.depth = 1e-3 * depth},
                                      {.frames = wanted.frames});
        const double solved_s = solving.seconds();
        std::string line = fmt::format("{:18} {:6} seed {} h {:.2f}/{:.2f}:", body.name, count, seed,
                                       report.rim_spacing_mm, report.spacing_mm);
        int frame = 0;
        for (const ForceSample& sample : history.force) {
          const double wanted_depth = depth * (frame + 1) / wanted.frames;
          if (std::abs(1e3 * sample.depth - wanted_depth) > 1e-6) continue;
          ++frame;
          line += fmt::format(" {:.3f}", 1e3 * sample.force);
          csv += fmt::format("{},{},{},{},{:.6g},{:.7g},{:.4g},{:.4g},{},{:.3g},{:.3g}\n", body.name, count,
                             points, seed, 1e3 * sample.depth, sample.force, report.rim_spacing_mm,
                             report.spacing_mm, history.steps, built_s, solved_s);
        }
        fmt::print("{} mN; {} ev, {:.2f} + {:.2f} s, {} of {} unconnected\n", line, history.steps, built_s,
                   solved_s, unconnected, points);
      } catch (const Error& error) {
        fmt::print("{:18} {:6} seed {}: {}; {}; {}\n", body.name, nodes, seed, error.report.fact,
                   error.report.where, error.report.why);
      }
      std::fflush(stdout);
    }
}

}  // namespace
}  // namespace dimple

int main(int argc, char** argv) try {
  dimple::Options wanted;
  CLI::App app("Forces of many bodies over the number of nodes");
  app.add_option("folder", wanted.folder, "for forces.csv")->required();
  app.add_option("--data", wanted.data, "folder of the label images");
  app.add_option("--bodies", wanted.bodies, "some of them only")->delimiter(',');
  app.add_option("--nodes", wanted.nodes)->delimiter(',');
  app.add_option("--seeds", wanted.seeds);
  app.add_option("--frames", wanted.frames);
  app.add_option("--depth", wanted.depth_mm, "mm");
  CLI11_PARSE(app, argc, argv);
  std::string csv =
      "body,nodes,points,seed,indentation_mm,force_N,rim_spacing_mm,far_spacing_mm,evaluations,build_s,solve_"
      "s\n";
  dimple::make_folder(wanted.folder);
  for (const dimple::Body& body : dimple::bodies(wanted.data)) {
    if (!wanted.bodies.empty() &&
        std::none_of(wanted.bodies.begin(), wanted.bodies.end(),
                     [&](const std::string& name) { return body.name.starts_with(name); }))
      continue;
    dimple::measure(body, wanted, csv);
    dimple::write_file(wanted.folder / "forces.csv", csv);
  }
} catch (const dimple::Error& error) {
  fmt::print(stderr, "{}\n{}\n", error.report.fact, error.report.remedy);
  return static_cast<int>(error.code);
}
