// How far the drawn surface of a label image lies from the exact body that was voxelised.
//
//   dimple_surface [FOLDER] [--way NAME] [--quick] [--projected] [--body TEXT] [--draw] [--again]
//
// Writes FOLDER/surface.csv: one row for each way (algorithm), body and slice thickness, with the mean and
// the worst of each error over the placements of the body on the grid. FOLDER is by default
// tests/bench/results. Rows of the same way, body and slices are replaced; all others stay. So the results of
// several builds can be collected in one table:
//
//   --way fitted           make_body_surface() of this build; so does any other name but these:
//   --way averaged         means over neighbours, the surface of earlier versions
//   --way antialias        the level set of Whitaker (2000) by ITK, which ends at its default change of 0.07
//   --way antialias:0.01   the same with another change in the last iteration
//   --way net              a net of constrained vertices whose curvature is smoothed
//
// --quick measures some bodies in 3 offsets and 2 orientations, and writes surface_quick.csv. --projected
// moves the vertices onto the exact surface first, so that what remains is the error of the measures, and
// writes surface_projected.csv. --body measures only bodies whose name contains TEXT. --draw draws
// surface.svg from all rows. --again prints and draws the table without a run. Lengths are in voxels of the
// finest axis, which are 1 mm; slices are 1 or 4 voxels thick. The whole takes about a minute, --quick 10 s.
// surface_bodies.cpp lists the bodies, surface_measures.hpp says what is measured.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "apps/run/stopwatch.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "preprocess/surface/label_surface.hpp"
#include "tests/bench/picture.hpp"
#include "tests/bench/surface_alternatives.hpp"
#include "tests/bench/surface_bodies.hpp"
#include "tests/bench/surface_measures.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

// A way draws the surface of an image: a closed mesh in LPS [mm].
using Way = std::function<TriangleMesh(const LabelImage&)>;

TriangleMesh body_surface(const LabelImage& image) {
  // The tool's default diameter of 10 mm with voxels of 1 mm gives a lattice step of one voxel.
  const SegmentedBody body = make_body_surface(image, {});
  return {body.surface.to_world() * body.surface.vertex(), body.surface.triangles()};
}

Way way_of(const std::string& name) {
  constexpr int net_iterations = 300;
  if (name == "net") return [](const LabelImage& image) { return constrained_net(image, net_iterations); };
  if (name == "averaged") return averaged_net;
  const std::string itk = "antialias";
  double rms_change = 0.07;  // ITK's default
  if (name.starts_with(itk + ":"))
    rms_change = std::stod(name.substr(itk.size() + 1));
  else if (name != itk)
    return body_surface;
  return [rms_change](const LabelImage& image) { return antialiased_surface(image, rms_change); };
}

struct Column {
  const char *name, *unit;
  double SurfaceErrors::*value;
};
constexpr std::array columns = {Column{"mean", "voxels", &SurfaceErrors::mean},
                                Column{"rms", "voxels", &SurfaceErrors::rms},
                                Column{"largest", "voxels", &SurfaceErrors::largest},
                                Column{"edge_largest", "voxels", &SurfaceErrors::edge_largest},
                                Column{"normal_rms", "degrees", &SurfaceErrors::normal_rms},
                                Column{"normal_largest", "degrees", &SurfaceErrors::normal_largest},
                                Column{"curvature_rms", "radii", &SurfaceErrors::curvature_rms},
                                Column{"volume", "percent", &SurfaceErrors::volume},
                                Column{"voxel_volume", "percent", &SurfaceErrors::voxel_volume},
                                Column{"top_mean", "voxels", &SurfaceErrors::top_mean},
                                Column{"top_rms", "voxels", &SurfaceErrors::top_rms},
                                Column{"top_within_slice", "voxels", &SurfaceErrors::top_within},
                                Column{"top_across_slices", "voxels", &SurfaceErrors::top_across}};

std::string header() {
  std::string text = "way,body,slices_voxels,radius_voxels,placements,refused,time_median_ms,vertices_peak";
  for (const Column& column : columns)
    text += fmt::format(",{0}_average_{1},{0}_worst_{1}", column.name, column.unit);
  return text + "\n";
}

double voxel_volume(const LabelImage& image) {
  std::int64_t voxels = 0;
  for (const Run& run : image.run) voxels += run.end - run.begin;
  return image.voxel_volume() * static_cast<double>(voxels);
}

// One placement of a body.
struct Measured {
  SurfaceErrors errors;
  double time_ms;
  Index vertices;
};

// Nothing if the way refuses the image: the body is too thin for the slices.
std::optional<Measured> measure(const ExactBody& body, const Placement& placement, const Vec3& spacing,
                                const Way& way, bool projected) {
  const LabelImage image = voxelised(body, placement, spacing);
  if (image.run.empty()) return {};
  const Stopwatch drawing;
  TriangleMesh mesh;
  try {
    mesh = way(image);
  } catch (const ModelError&) {
    return {};
  }
  const double time_ms = 1e3 * drawing.seconds();
  if (mesh.triangles.cols() == 0) return {};
  if (projected) project(mesh, body, placement);
  SurfaceErrors errors = errors_of(mesh, body, placement);
  errors.voxel_volume = 100.0 * (voxel_volume(image) / body.volume - 1.0);
  return Measured{errors, time_ms, mesh.vertex.cols()};
}

// All placements of a body.
struct Placements {
  std::vector<SurfaceErrors> errors;
  std::vector<double> time_ms;
  int refused = 0;
  Index vertices_peak = 0;
};

Placements measure_all(const ExactBody& body, double slice, const Way& way, bool projected, int offsets,
                       int turns) {
  Placements all;
  const Vec3 spacing(1.0, 1.0, slice);
  for (int turn = 0; turn < turns; ++turn)
    for (int offset = 0; offset < offsets; ++offset) {
      const Placement placement{grid_turn(turn), spacing.cwiseProduct(grid_offset(offset))};
      const std::optional<Measured> one = measure(body, placement, spacing, way, projected);
      if (!one) {
        ++all.refused;
        continue;
      }
      all.errors.push_back(one->errors);
      all.time_ms.push_back(one->time_ms);
      all.vertices_peak = std::max(all.vertices_peak, one->vertices);
    }
  return all;
}

// The average and the value of the largest magnitude, as two fields; empty where nothing was measured.
std::string average_and_worst(const std::vector<SurfaceErrors>& all, double SurfaceErrors::*value) {
  double sum = 0.0, worst = 0.0;
  int count = 0;
  for (const SurfaceErrors& errors : all) {
    const double here = errors.*value;
    if (std::isnan(here)) continue;
    sum += here;
    if (std::abs(here) > std::abs(worst)) worst = here;
    ++count;
  }
  return count > 0 ? fmt::format(",{:.4g},{:.4g}", sum / count, worst) : ",,";
}

std::string fields_of(const ExactBody& body, const Placements& all) {
  std::vector<double> time_ms = all.time_ms;
  std::sort(time_ms.begin(), time_ms.end());
  const double median_ms = time_ms.empty() ? 0.0 : time_ms[time_ms.size() / 2];
  std::string text =
      fmt::format(",{:g},{},{},{:.1f},{}", body.radius, static_cast<int>(time_ms.size()) + all.refused,
                  all.refused, median_ms, all.vertices_peak);
  for (const Column& column : columns) text += average_and_worst(all.errors, column.value);
  return text;
}

// Rows of the table by their first fields: way, body, slices.
using Table = std::vector<std::pair<std::string, std::string>>;

Table read_table(const fs::path& file) {
  Table table;
  if (!fs::exists(file)) return table;
  std::istringstream lines(read_file(file));
  std::string line;
  for (std::getline(lines, line); std::getline(lines, line);) {
    std::size_t end = 0;
    for (int field = 0; field < 3; ++field) end = line.find(',', end + 1);
    table.emplace_back(line.substr(0, end), line.substr(end));
  }
  return table;
}

void set_row(Table& table, const std::string& key, const std::string& fields) {
  const auto row = std::find_if(table.begin(), table.end(), [&](const auto& r) { return r.first == key; });
  if (row != table.end())
    row->second = fields;
  else
    table.emplace_back(key, fields);
}

void write_table(const fs::path& file, const Table& table) {
  std::string text = header();
  for (const auto& [key, fields] : table) text += key + fields + "\n";
  write_file(file, text);
}

// One row, its fields by their names.
using Row = std::map<std::string, std::string>;
std::vector<Row> rows_of(const Table& table) {
  const auto split = [](const std::string& line) {
    std::vector<std::string> fields;
    std::istringstream stream(line);
    for (std::string field; std::getline(stream, field, ',');) fields.push_back(field);
    return fields;
  };
  std::string first = header();
  first.pop_back();
  const std::vector<std::string> names = split(first);
  std::vector<Row> rows;
  for (const auto& [key, fields] : table) {
    std::vector<std::string> values = split(key + fields);
    values.resize(names.size());
    Row& row = rows.emplace_back();
    for (std::size_t f = 0; f < names.size(); ++f) row[names[f]] = values[f];
  }
  return rows;
}

double number(const Row& row, const std::string& field) {
  const std::string& text = row.at(field);
  return text.empty() ? not_measured : std::stod(text);
}

// The worst error at the six extreme points.
double worst_top(const Row& row) {
  const double within = number(row, "top_within_slice_worst_voxels");
  const double across = number(row, "top_across_slices_worst_voxels");
  return std::abs(within) > std::abs(across) ? within : across;
}

std::string cell(double value, int digits) {
  return std::isnan(value) ? "-" : fmt::format("{:.{}f}", value, digits);
}

// Worst over the placements, but for the columns that say otherwise.
void print_table(const std::vector<Row>& rows) {
  constexpr const char* format =
      "{:20} {:16} {:>2} {:>3} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>7} {:>7}\n";
  fmt::print(format, "way", "body", "dk", "n", "top", "topk", "topavg", "mean", "rms", "most", "edge",
             "n rms", "n most", "H rms", "vol %", "ms");
  for (const Row& row : rows) {
    const auto worst = [&](const std::string& name, const char* unit, int digits) {
      return cell(number(row, fmt::format("{}_worst_{}", name, unit)), digits);
    };
    fmt::print(format, row.at("way"), row.at("body"), row.at("slices_voxels"),
               fmt::format("{:g}", number(row, "placements") - number(row, "refused")),
               worst("top_within_slice", "voxels", 3), worst("top_across_slices", "voxels", 3),
               cell(number(row, "top_mean_average_voxels"), 3), worst("mean", "voxels", 3),
               worst("rms", "voxels", 3), worst("largest", "voxels", 3), worst("edge_largest", "voxels", 3),
               worst("normal_rms", "degrees", 2), worst("normal_largest", "degrees", 1),
               worst("curvature_rms", "radii", 3), worst("volume", "percent", 2),
               cell(number(row, "time_median_ms"), 1));
  }
  fmt::print(
      "\ndk: slice thickness; n: placements; lengths in voxels, worst over the placements: top: error of the "
      "extreme\npoints within slices, topk: across them (topavg: average of all); mean, rms, most: distance "
      "more than 2 voxels\nfrom sharp edges, edge: near them; n: angle of normals in degrees; H: mean "
      "curvature times local radius.\n");
}

// Errors of balls and ellipsoids against their radius, for each way.
Plot plot_of(const std::vector<Row>& rows, const std::string& slices, const std::string& title,
             const std::function<double(const Row&)>& value) {
  Plot plot{.title = fmt::format("{}, slices {} voxel{} thick", title, slices, slices == "1" ? "" : "s"),
            .subtitle = {"worst over the placements; filled: balls, hollow and dashed: ellipsoids"},
            .x_label = "radius [voxels]",
            .y_label = "error [voxels]",
            .log_x = true,
            .log_y = true};
  std::vector<std::string> ways;
  std::map<std::string, std::size_t> series_of;
  for (const Row& row : rows) {
    const std::string &body = row.at("body"), &way = row.at("way");
    const bool ball = body.starts_with("ball");
    if (row.at("slices_voxels") != slices || (!ball && !body.starts_with("ellipsoid"))) continue;
    if (std::find(ways.begin(), ways.end(), way) == ways.end()) ways.push_back(way);
    const auto colour = static_cast<int>(std::find(ways.begin(), ways.end(), way) - ways.begin());
    const std::string name = fmt::format("{}, {}", way, ball ? "balls" : "ellipsoids");
    if (series_of.emplace(name, plot.series.size()).second)
      plot.series.push_back({.name = name, .dashed = !ball, .hollow = !ball, .colour = colour});
    PlotSeries& series = plot.series[series_of.at(name)];
    series.x.push_back(number(row, "radius_voxels"));
    series.y.push_back(std::abs(value(row)));
  }
  return plot;
}

void draw(const fs::path& folder, const std::string& name, const std::vector<Row>& rows) {
  const auto rms = [](const Row& row) { return number(row, "rms_worst_voxels"); };
  std::vector<Plot> panels;
  for (const std::string slices : {"1", "4"}) {
    panels.push_back(plot_of(rows, slices, "Extreme points along the grid's axes", worst_top));
    panels.push_back(plot_of(rows, slices, "Root mean square distance from the exact surface", rms));
  }
  write_plots(folder, name, panels, 2);
}

struct Options {
  fs::path folder = DIMPLE_BENCH_RESULTS;
  std::string way = "fitted", body;
  bool quick = false, projected = false, draw = false, again = false;
};

void measure_bodies(const Options& options, const fs::path& file, Table& table) {
  constexpr int quick_offsets = 3, quick_turns = 2;
  const Way way = way_of(options.way);
  for (const double slice : {1.0, 4.0})
    for (const auto& [body, all_offsets, all_turns, quick] : surface_studies()) {
      if (body.name.find(options.body) == std::string::npos || (options.quick && !quick)) continue;
      const int offsets = options.quick ? std::min(all_offsets, quick_offsets) : all_offsets;
      const int turns = options.quick ? std::min(all_turns, quick_turns) : all_turns;
      set_row(table, fmt::format("{},{},{:g}", options.way, body.name, slice),
              fields_of(body, measure_all(body, slice, way, options.projected, offsets, turns)));
      write_table(file, table);
    }
}

void report(const Options& options) {
  const std::string name = options.projected ? "surface_projected"
                           : options.quick   ? "surface_quick"
                                             : "surface";
  make_folder(options.folder);
  const fs::path file = options.folder / (name + ".csv");
  Table table = read_table(file);
  if (!options.again) measure_bodies(options, file, table);
  std::vector<Row> rows = rows_of(table);
  if (options.draw) draw(options.folder, name, rows);
  if (!options.again) std::erase_if(rows, [&](const Row& row) { return row.at("way") != options.way; });
  print_table(rows);
}

}  // namespace
}  // namespace dimple

int main(int argc, char** argv) try {
  dimple::Options options;
  CLI::App app("Distance of the drawn surface from the exact body, for bodies in closed form");
  app.add_option("folder", options.folder, "for table and picture");
  app.add_option("--way", options.way, "name of the algorithm in the table; see the head of surface.cpp");
  app.add_option("--body", options.body, "only bodies whose name contains this");
  app.add_flag("--quick", options.quick, "some bodies in a few placements");
  app.add_flag("--projected", options.projected, "measure the vertices moved onto the exact surface");
  app.add_flag("--draw", options.draw, "draw the table");
  app.add_flag("--again", options.again, "print and draw the table, without a run");
  CLI11_PARSE(app, argc, argv);
  dimple::report(options);
} catch (const dimple::Error& error) {
  fmt::print(stderr, "{}\n{}\n", error.report.fact, error.report.remedy);
  return static_cast<int>(error.code);
}
