// Calibration of the error bounds of a force. Measures how far forces of coarse discretisations are from
// those of discretisations many times finer, on scenes drawn at random.
//
//   dimple_calibrate FOLDER --data DIR [--atlases DIR] [--scenes 285] [--from 1] [--finer 32000] [--points]
//   [--again]
//
// Writes error_scenes.csv, a row for each scene, number of nodes and depth. Scenes 51 to 120 and 166 to 225
// are held out to test the bounds; the others give the multipliers. No organ is in both. Scenes from 256 on
// are folded brains of atlases, such as Debian's mricron-data has in /usr/share/mricron/templates. Scenes
// from 2001 on have large bodies and those from 3001 on thin ones (--from 2001 --scenes 2016). A scene that
// the file holds is not computed again, so an interrupted study continues. --finer adds a discretisation of
// so many nodes to scenes that have one of half as many. --points writes band_points.csv, the displacements
// of a random point of each scene's body. --bodies writes band_bodies.csv, the dimensions of each body under
// the patch. Three tables follow from these, and --again makes them alone. band_coverage.csv: how often the
// bounds contain the truth; band_goals.csv: the cost of a requested accuracy; band_misses.csv: each bound
// that fails.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include "apps/run/error_bounds.hpp"
#include "apps/run/grading.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/stopwatch.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/label_image.hpp"
#include "preprocess/build_model.hpp"
#include "preprocess/image/phantom.hpp"
#include "preprocess/supports/support.hpp"
#include "solver/solve.hpp"
#include "tests/bench/calibration_scenes.hpp"
#include "tests/helpers/draw.hpp"
#include "tests/helpers/error_scenes.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr std::array<Index, 5> level_nodes = {500, 1000, 2000, 4000, 8000};
constexpr Index finest = truth_nodes;
constexpr int frames = 4;
constexpr std::int64_t most_evaluations = 2000;  // of the force, for one curve

constexpr const char* header =
    "scene,set,body,base,indent_at,facing_share,diameter_mm,nu,law,nodes,indentation_mm,force_N,build_s,"
    "solve_s\n";

constexpr const char* points_header =
    "scene,set,body,facing_share,nodes,x_mm,y_mm,z_mm,indentation_mm,u_x_mm,u_y_mm,u_z_mm\n";

// Random point inside the body near the bonded patch, such as a user's target.
Vec3 random_place(const CalibrationScene& scene, const BodySurface& body, const Vec3& bonded_patch) {
  Draw draw{std::mt19937_64(static_cast<std::uint64_t>(scene.number) + 1'000'000)};
  const double near = 3e-3 * scene.boundary.indenter_diameter_mm;
  Vec3 place = Vec3::Zero();
  for (int tried = 0; tried < 100'000; ++tried) {
    const Vec3 there(draw.between(body.lower().x(), body.upper().x()),
                     draw.between(body.lower().y(), body.upper().y()),
                     draw.between(body.lower().z(), body.upper().z()));
    place = body.to_world() * there * 1e-3;
    if ((place - bonded_patch).norm() < near && body.contains(there)) break;
  }
  return place;
}

// Results of one scene for each of these numbers of nodes: a row for each depth in `forces`, and in `points`
// if requested. Empty if the first discretisation is refused, since the others are then of no use.
struct Rows {
  std::string forces, points;
};
Rows measure(const CalibrationScene& scene, const std::vector<Index>& sizes, bool with_points) {
  const SegmentedBody body = scene.surface();
  const double facing = facing_fraction(body.surface, narrow_gap_mm);
  std::optional<LabelImage> labels;
  if (scene.core) labels = make_phantom(phantom_with_core);
  TissueOptions tissues;
  std::vector<Material> materials = {material_of(scene, 210.0)};
  if (scene.core) {
    tissues = {.of_label = {{3, 1}}, .density = {1000.0, 1000.0}};
    materials.push_back(material_of(scene, 840.0));
  }
  Rows rows;
  std::optional<Vec3> place;
  for (const Index nodes : sizes) {
    ModelOptions options;
    options.node_set.count = nodes;
    options.boundary = scene.boundary;
    if (scene.number >= first_large) grade_to_size(body.surface, options);
    try {
      const Stopwatch building;
      const BuiltModel built = build_model(body.surface, options, tissues,
                                           labels ? label_finder(*labels, body.surface) : LabelAt{});
      const double built_s = building.seconds();
      const Stopwatch solving;
      // After guards have intervened a march continues in short steps, some for ten minutes.
      Observer observer{
          .sample = [](const ForceSample&, const History& h) { return h.evaluations < most_evaluations; }};
      if (with_points) {
        if (!place) place = random_place(scene, body.surface, built.model.tool.centre);
        observer.frame = [&, at = inner_interpolation(built.model, *place)](const Frame& frame) {
          const Vec3 u = at(frame.u.topRows<3>()).col(0) * 1e3;
          if (frame.number > 0)
            rows.points +=
                fmt::format("{},{},\"{}\",{:.3f},{},{:.2f},{:.2f},{:.2f},{:.6g},{:.7g},{:.7g},{:.7g}\n",
                            scene.number, set_of(scene), scene.body, facing, nodes, 1e3 * place->x(),
                            1e3 * place->y(), 1e3 * place->z(), 1e3 * frame.depth, u.x(), u.y(), u.z());
        };
      }
      const Tissues materials_of_points{materials, built.model.tissue};
      const Loading loading{.depth = 1e-3 * scene.depth_mm};
      const ForceSystem system(built.model, materials_of_points, Precision::single_);
      History history;
      // A run has no error bounds if dynamics is chosen, so scenes drawn later are always quasi-static.
      const TimeMode time = scene.number >= first_large
                                ? TimeMode::quasi_static
                                : choose_time(built.model, materials_of_points, loading);
      solve(time, system, built.model, loading, {.frames = frames, .evaluations = 600}, observer, history);
      if (history.interrupted)
        throw SolveError({.fact = fmt::format("no end after {} evaluations", most_evaluations),
                          .where = "the march",
                          .why = "a guard has shortened its steps",
                          .remedy = "leave this scene out"});
      const double solved_s = solving.seconds();
      int frame = 1;  // between frames each discretisation has its own equilibria
      for (const ForceSample& sample : history.force)
        if (std::abs(1e3 * sample.depth - frame * scene.depth_mm / frames) < 1e-6 && frame++ > 0)
          rows.forces +=
              fmt::format("{},{},\"{}\",{},\"{}\",{:.3f},{:.2f},{:g},{},{},{:.6g},{:.7g},{:.3g},{:.3g}\n",
                          scene.number, set_of(scene), scene.body, scene.boundary.base,
                          scene.boundary.indent_at, facing, scene.boundary.indenter_diameter_mm, scene.nu,
                          scene.law, nodes, 1e3 * sample.depth, sample.force, built_s, solved_s);
    } catch (const Error& error) {
      fmt::print("{}: {}, {} nodes: {}\n", scene.number, scene.body, nodes, error.report.fact);
      if (nodes == sizes.front()) return {};
    }
  }
  return rows;
}

bool is_deep(double radii) {
  return radii > 1.0 + 1e-9;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

// Group of a scene in the tables; the second proof was drawn later and is listed apart.
std::string group_of(const ErrorScene& scene) {
  return scene.set != "proof" ? scene.set : scene.number < second_proof ? "first proof" : "second proof";
}
const std::vector<std::string> groups = {"calibration", "first proof", "second proof", "aside"},
                               extending = {"large", "thin"};

// Rows of band_coverage.csv: the error bounds compared with the truth, for each number of nodes. Bounds hold
// if they contain all possible values of the truth. `misses`: rows of band_misses.csv.
std::string coverage_of_error_bounds(const std::vector<ErrorScene>& scenes,
                                     const std::vector<std::string>& of_groups, std::string& misses) {
  std::string table;
  for (const std::string& group : of_groups) {
    for (const bool deep : {false, true})
      for (Index nodes = fewest_nodes_with_error_bounds(0.0); nodes <= finest_truth_nodes / error_compared;
           nodes *= 2) {
        std::vector<double> halves, errors;
        int held = 0;
        for (const ErrorScene& scene : scenes) {
          if (nodes < fewest_nodes_with_error_bounds(scene.facing_fraction) ||
              nodes > scene.truth / error_compared)
            continue;
          if (group_of(scene) != group || !scene.forces.contains(nodes) || !scene.forces.contains(nodes / 2))
            continue;
          const std::vector<ForceSample>& fine = scene.forces.at(nodes);
          const std::vector<double> half = error_bounds(scene, nodes, nodes / 2);
          if (half.empty() || fine.size() != scene.forces.at(scene.truth).size()) continue;
          double widest = 0.0, largest = 0.0;
          bool holds = true;
          std::string missed;
          for (std::size_t k = 1; k < fine.size(); ++k) {
            if (is_deep(fine[k].depth / scene.radius) != deep) continue;
            const double said = half[k] / std::abs(fine[k].force),
                         error = std::abs(scene_error(scene, nodes, k)),
                         error_most = error_at_most(scene, nodes, k);
            widest = said, largest = std::max(largest, error);
            holds = holds && error_most <= said;
            if (error_most > said)
              missed = fmt::format("{},{},\"{}\",{},{:.2f},{:.2f},{:.2f},{:.2f}\n", group, scene.number,
                                   scene.body, nodes, fine[k].depth / scene.radius, 100.0 * error,
                                   100.0 * (error_most - error), 100.0 * said);
          }
          if (!(widest > 0.0)) continue;
          if (group != "calibration") misses += missed;  // at the deepest of its depths
          halves.push_back(100.0 * widest);
          errors.push_back(100.0 * largest);
          held += holds;
        }
        if (halves.empty()) continue;
        table += fmt::format(
            "{},{},{},{},{:.0f},{:.1f},{:.1f}\n", group, deep ? "1 to 1.7 radii" : "to 1 radius", nodes,
            halves.size(), 100.0 * held / static_cast<double>(halves.size()), median(halves), median(errors));
      }
  }
  return table;
}

// Rows of a table by the number of their scene, without the header.
std::map<int, std::string> rows_by_scene(const fs::path& file) {
  std::map<int, std::string> rows;
  if (!fs::exists(file)) return rows;
  std::istringstream lines(read_file(file));
  std::string line;
  for (std::getline(lines, line); std::getline(lines, line);) rows[std::stoi(line)] = line + "\n";
  return rows;
}

// Writes band_bodies.csv: dimensions of each scene's body under the bonded patch. A row that the file holds
// is kept without reading its image. Other scenes without their image are left out.
void write_bodies(const fs::path& folder, const fs::path& data, const fs::path& atlases) {
  std::map<int, std::string> rows = rows_by_scene(folder / "band_bodies.csv");
  std::string csv =
      "scene,set,body,diameter_mm,thickness_radii,size_radii,voxel_radii,nu,tissues,stiffness_ratio\n";
  std::map<std::string, SegmentedBody> organs;  // common to many scenes
  const auto add = [&](const CalibrationScene& scene) {
    const std::string key =
        scene.image.empty() && !scene.core ? fmt::format("scene {}", scene.number) : scene.body;
    if (!organs.contains(key)) organs.emplace(key, scene.surface());
    const BodySurface& body = organs.at(key).surface;
    const double voxel = scene.core            ? phantom_with_core.spacing_mm
                         : scene.image.empty() ? scene.boundary.voxel_mm
                                               : read_label_image(scene.image).spacing().maxCoeff();
    const BodyUnderPatch seen = body_under_patch(body, find_boundary(body, scene.boundary), voxel);
    rows[scene.number] =
        fmt::format("{},{},\"{}\",{:.2f},{:.3f},{:.3f},{:.3f},{:g},{},{}\n", scene.number, set_of(scene),
                    scene.body, scene.boundary.indenter_diameter_mm, seen.thickness, seen.size, seen.voxel,
                    scene.nu, scene.core ? 2 : 1, scene.core ? 4 : 1);
  };
  for (const ErrorScene& known : error_scenes(folder / "band_scenes.csv")) {
    if (rows.contains(known.number)) continue;
    const CalibrationScene scene = scene_of(known.number, data, atlases);
    if (scene.image.empty() || fs::exists(scene.image)) add(scene);
  }
  for (const auto& [number, row] : rows) csv += row;
  write_file(folder / "band_bodies.csv", csv);
}

// Rows of band_goals.csv: the program's refinement for a requested accuracy, replayed with the recorded
// forces. Uses up to a quarter of the truth's nodes, on the proof's scenes from `first` on.
std::string cost_of_goals(const std::vector<ErrorScene>& scenes, int first, std::string& misses) {
  std::string table;
  std::map<int, double> seconds_for_5, seconds_for_2;  // of scenes
  for (const double goal : {0.05, 0.02, 0.01}) {
    int requested = 0, reached = 0, in_error_bounds = 0, in_goal = 0;
    std::vector<double> costs, sizes, times;
    for (const ErrorScene& scene : scenes) {
      if (scene.set != "proof" || scene.number < first) continue;
      ++requested;
      double seconds = 0.0;
      Index before = 0;
      const double radii = scene.forces.at(scene.truth).back().depth / scene.radius;
      const Index expected =
          expected_nodes(goal, scene.facing_fraction, floor_of_force({radii, scene.several_tissues}));
      for (Index nodes = nodes_of_first_level(expected); nodes <= scene.truth / error_compared;) {
        if (!scene.forces.contains(nodes)) {  // it was refused
          nodes *= 2;
          continue;
        }
        const std::vector<ForceSample>& fine = scene.forces.at(nodes);
        seconds += scene.seconds.at(nodes);
        const std::vector<double> half =
            before > 0 ? error_bounds(scene, nodes, before) : std::vector<double>();
        const double force = std::abs(fine.back().force);
        if (half.empty() || half.back() > goal * force) {
          before = nodes;
          nodes = half.empty() ? nodes_of_second_level(nodes, expected)
                               : nodes_of_next_level(nodes, half.back(), goal * force);
          continue;
        }
        ++reached;
        const std::size_t last = fine.size() - 1;
        const double error = std::abs(scene_error(scene, nodes, last)),
                     error_most = error_at_most(scene, nodes, last);
        in_error_bounds += error_most <= half.back() / force;
        in_goal += error_most <= goal;
        if (error_most > half.back() / force)
          misses += fmt::format("goal {:g} %,{},\"{}\",{},{:.2f},{:.2f},{:.2f},{:.2f}\n", 100.0 * goal,
                                scene.number, scene.body, nodes, radii, 100.0 * error,
                                100.0 * (error_most - error), 100.0 * half.back() / force);
        costs.push_back(seconds / scene.seconds.at(nodes));
        sizes.push_back(static_cast<double>(nodes));
        times.push_back(seconds);
        if (goal == 0.05) seconds_for_5[scene.number] = seconds;
        if (goal == 0.02) seconds_for_2[scene.number] = seconds;
        break;
      }
    }
    const auto fraction = [&](int count) { return reached > 0 ? 100.0 * count / reached : 0.0; };
    table += fmt::format("{},{:g},{},{},{:.0f},{:.0f},{:.0f},{:.1f},{:.1f}\n",
                         first < second_proof ? "both proofs" : "second proof", 100.0 * goal, requested,
                         reached, fraction(in_error_bounds), fraction(in_goal), median(sizes), median(costs),
                         median(times));
  }
  std::vector<double> ratios;
  for (const auto& [number, seconds] : seconds_for_2)
    if (seconds_for_5.contains(number)) ratios.push_back(seconds_for_5[number] / seconds);
  if (!ratios.empty())
    fmt::print("5 % costs {:.2f} of 2 % (median of the {} scenes that reach both)\n", median(ratios),
               ratios.size());
  return table;
}

// Rows of band_coverage.csv for displacements, with the largest possible error.
std::string coverage_of_points(const std::vector<PointScene>& scenes, double multiplier,
                               std::string& misses) {
  std::string table;
  for (const std::string set : {"calibration", "proof"})
    for (Index nodes = fewest_nodes_with_error_bounds(0.0); nodes <= point_truth / 4; nodes *= 2) {
      std::vector<double> halves, errors;
      int held = 0;
      for (const PointScene& scene : scenes) {
        if (scene.set != set) continue;
        for (const PointError& e : point_errors(scene)) {
          if (e.nodes != nodes) continue;
          const double half = multiplier * e.measure;
          held += e.error <= half;
          halves.push_back(100.0 * half / e.length);
          errors.push_back(100.0 * e.error / e.length);
          if (e.error > half && set == "proof")
            misses += fmt::format("displacement,{},,{},,{:.2f},,{:.2f}\n", scene.number, nodes, errors.back(),
                                  halves.back());
        }
      }
      if (!halves.empty())
        table +=
            fmt::format("{},displacement,{},{},{:.0f},{:.1f},{:.1f}\n", set, nodes, halves.size(),
                        100.0 * held / static_cast<double>(halves.size()), median(halves), median(errors));
    }
  return table;
}

void report(const fs::path& folder) {
  const std::vector<ErrorScene> scenes = error_scenes(folder / "band_scenes.csv");
  const ErrorScores scores = error_scores(scenes);
  fmt::print("multiplier of the force's bounds: {:.3f}, from {}\n", conformal(scores, 0.95, least_scenes),
             counted(scores, least_scenes));
  std::string coverage = "scenes,depth,nodes,bounds,held_percent,half_width_percent,error_percent\n",
              goals =
                  "scenes,goal_percent,count,reached,held_percent,within_goal_percent,nodes,cost_ratio,"
                  "seconds\n",
              misses =
                  "scenes,scene,body,nodes,depth_radii,error_percent,unsure_percent,half_width_percent\n",
              unlisted;
  coverage += coverage_of_error_bounds(scenes, groups, misses);
  goals += cost_of_goals(scenes, 1, misses);
  goals += cost_of_goals(scenes, second_proof, unlisted);
  coverage += coverage_of_error_bounds(scenes, extending, misses);
  if (const fs::path file = folder / "band_points.csv"; fs::exists(file)) {
    const std::vector<PointScene> points = point_scenes(file);
    const ErrorScores of_points = point_scores(points);
    const double multiplier = conformal(of_points, 0.95, least_points);
    fmt::print("multiplier of a displacement's bounds: {:.3f}, from {}\n", multiplier,
               counted(of_points, least_points));
    coverage += coverage_of_points(points, multiplier, misses);
  }
  write_file(folder / "band_coverage.csv", coverage);
  write_file(folder / "band_goals.csv", goals);
  write_file(folder / "band_misses.csv", misses);
  fmt::print("{}\n{}\n{}", coverage, goals, misses);
}

}  // namespace
}  // namespace dimple

int main(int argc, char** argv) try {
  namespace fs = std::filesystem;
  fs::path folder, data, atlases;
  int scenes = 285, first = 1;
  CLI::App app("Scenes at random, from which the band of a force is taken and on which it is proved");
  app.add_option("folder", folder, "for tables")->required();
  app.add_option("--data", data, "folder of the label images");
  app.add_option("--atlases", atlases, "folder of the folded brains");
  app.add_option("--scenes", scenes, "how many");
  app.add_option("--from", first, "the first to be computed");
  bool again = false, points = false, bodies = false;
  dimple::Index finer = 0;
  app.add_option("--finer", finer, "a cloud of so many nodes, on scenes that hold one of half as many");
  app.add_flag("--points", points, "displacements of a random place, instead of forces");
  app.add_flag("--bodies", bodies, "what each scene's circle sees of its body, without a run");
  app.add_flag("--again", again, "tables of band_scenes.csv, without a run");
  CLI11_PARSE(app, argc, argv);
  dimple::make_folder(folder);
  const fs::path file = folder / (points ? "band_points.csv" : "band_scenes.csv");
  std::string csv = fs::exists(file) ? dimple::read_file(file)
                    : points         ? dimple::points_header
                                     : dimple::header;
  std::vector<dimple::Index> sizes(dimple::level_nodes.begin(), dimple::level_nodes.end());
  if (points)
    std::reverse(sizes.begin(), sizes.end());
  else
    sizes.insert(sizes.begin(), dimple::finest);
  if (first >= dimple::first_large)  // the truth, and the numbers around the default
    sizes = {dimple::finest, dimple::finest / 2, 500, 1000, 2000};
  if (bodies) dimple::write_bodies(folder, data, atlases);
  again = again || bodies;
  std::set<int> done;  // also with the finer nodes
  if (finer > 0) {
    sizes = {finer};
    for (const dimple::ErrorScene& scene : dimple::error_scenes(file))
      if (scene.forces.contains(finer) || !scene.forces.contains(finer / 2)) done.insert(scene.number);
  }
  for (int number = first; !again && number <= scenes; ++number) {
    const bool there = csv.find(fmt::format("\n{},", number)) != std::string::npos;
    if (there != (finer > 0) || done.contains(number)) continue;
    const dimple::CalibrationScene scene = dimple::scene_of(number, data, atlases);
    if (!scene.image.empty() && !fs::exists(scene.image)) {
      fmt::print("{}: left out, {} is not there\n", scene.body, scene.image.string());
      continue;
    }
    const dimple::Stopwatch whole;
    const auto [forces, places] = dimple::measure(scene, sizes, points);
    csv += points ? places : forces;
    dimple::write_file(file, csv);
    fmt::print("{}: {}, {:.1f} s\n", number, scene.body, whole.seconds());
    std::fflush(stdout);
  }
  dimple::report(folder);
} catch (const dimple::Error& error) {
  fmt::print(stderr, "{}\n{}\n", error.report.fact, error.report.remedy);
  return static_cast<int>(error.code);
}
