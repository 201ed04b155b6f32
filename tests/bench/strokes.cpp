// A body that is cut while a tool is in it: how long a stroke takes, and what the frames do meanwhile.
//
//   dimple_strokes FOLDER IMAGE...   [--strokes 200] [--nodes 2000] [--growth BLOCK]
//
// strokes.csv: of each random stroke of 10 mm beside a tool that is pressed, ten on each body, how long it
// took until frames followed the cut body, the frames meanwhile, forces, and whether a frame was bad: no
// number, pushed the wrong way, or moved by more than 2.5 depths of the tool. --growth: strokes_growth.csv,
// cuts of several lengths in clouds of up to 100,000 nodes of that image, near the blade alone and looked for
// everywhere, and whether all bits are the same. Nothing else should run on the machine.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <thread>

#include "apps/run/live.hpp"
#include "apps/run/stopwatch.hpp"
#include "io/error.hpp"
#include "io/label_image.hpp"
#include "io/table.hpp"
#include "preprocess/build_model.hpp"
#include "preprocess/surface/cut.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

double quantile(std::vector<double> v, double q) {
  if (v.empty()) return 0.0;
  std::sort(v.begin(), v.end());
  return v[std::min(v.size() - 1, static_cast<std::size_t>(q * static_cast<double>(v.size())))];
}

// A place on the body as it now is [m], next to `near` at rest.
Vec3 place_on(const LiveTool& tool, const Vec3& near) {
  const BodySurface& surface = tool.organ->organ->body->surface;
  const Vec3 rest =
      1e-3 * (surface.to_world() * surface.closest(surface.to_world().inverse() * (1e3 * near)).place);
  const Points& X = tool.session->model().X;
  Index node = 0;
  (X.colwise() - rest).colwise().squaredNorm().minCoeff(&node);
  return rest + tool.session->nodal_parameters().col(node);
}

// 10 mm long, 4 to 10 deep, beside the tool: half of it is as long as the tool is wide to a side.
Stroke random_stroke(const LiveTool& tool, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  const ToolPlace at = tool.session->tool();
  const Vec3 e = at.push.unitOrthogonal(), g = at.push.cross(e);
  const double around = 2.0 * std::numbers::pi * unit(random), turn = 2.0 * std::numbers::pi * unit(random);
  const Vec3 middle =
      at.centre + (2.2 + unit(random)) * at.radius * (std::cos(around) * e + std::sin(around) * g);
  const Vec3 half = 5e-3 * (std::cos(turn) * e + std::sin(turn) * g);
  return {place_on(tool, middle - half), place_on(tool, middle + half), 4e-3 + 6e-3 * unit(random)};
}

struct Tally {
  Table table{.header = {"stroke", "nodes", "cut", "made_ms", "first_force_ms", "frames", "slowest_frame_ms",
                         "area_mm2", "depth_mm", "before_mN", "after_mN", "bad_frames"},
              .column = std::vector<std::vector<double>>(12)};
  std::vector<double> made_ms, frame_ms;
  int cut = 0, bad = 0;
};

// Frames at 25 a second, as a window has them, for 0.6 s and until all of the stroke is made.
void one_stroke(LiveTool& tool, double depth, std::mt19937& random, int number, Tally& tally) {
  constexpr double period = 0.04, for_solving = 0.7, each = 0.6, longest = 5.0;
  const double before = tool.frame.force;
  const std::size_t done = tool.cuts.size();
  cut(tool, random_stroke(tool, random), true);
  const Stopwatch since;
  double first_force = 0.0, slowest = 0.0;
  int frames = 0, bad = 0;
  while (since.seconds() < longest) {
    const Stopwatch watch;
    const LiveFrame frame = move_depth(tool, depth, {.seconds = for_solving * period}, period);
    const double took = watch.seconds();
    ++frames;
    slowest = std::max(slowest, took);
    tally.frame_ms.push_back(1e3 * took);
    const double farthest = tool.session->nodal_parameters().colwise().norm().maxCoeff();
    if (!std::isfinite(frame.force) || frame.force < -1e-6 || farthest > 2.5 * std::max(frame.depth, 1e-9)) {
      ++bad;
      fmt::print("bad frame: {} mm, {} N, farthest {} mm\n", 1e3 * frame.depth, frame.force, 1e3 * farthest);
    }
    const bool is_made = tool.cuts.size() > done;
    if (is_made && frame.tool == LiveFrame::Tool::there && first_force == 0.0) first_force = since.seconds();
    if (is_made && !tool.opening.valid() && since.seconds() > each) break;
    std::this_thread::sleep_for(std::chrono::duration<double>(std::max(0.0, period - watch.seconds())));
  }
  if (tool.cuts.size() == done) throw std::runtime_error("a stroke was not made within 5 s");
  const CutRecord& record = tool.cuts.back();
  const bool is_cut = record.why.empty();
  if (!is_cut) fmt::print("{}: {}\n", in_words(record.stroke), record.why);
  tally.cut += is_cut;
  tally.bad += bad;
  if (is_cut) tally.made_ms.push_back(1e3 * record.seconds);
  const double row[] = {static_cast<double>(number),
                        static_cast<double>(tool.session->model().node_count()),
                        is_cut ? 1.0 : 0.0,
                        1e3 * record.seconds,
                        1e3 * first_force,
                        static_cast<double>(frames),
                        1e3 * slowest,
                        1e6 * record.area,
                        1e3 * tool.frame.depth,
                        1e3 * before,
                        1e3 * tool.frame.force,
                        static_cast<double>(bad)};
  for (std::size_t c = 0; c < tally.table.column.size(); ++c) tally.table.column[c].push_back(row[c]);
}

void strokes(const fs::path& image, Index nodes, int count, const fs::path& file) {
  constexpr int each = 10;
  Config config;
  config.image.file = image.string();
  const LiveOrgan organ = read_live_organ(config);
  std::mt19937 random(11);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  Tally tally;
  for (int done = 0; done < count; done += each) {
    LiveTool tool = make_live_tool(organ, nodes);
    const double depth = (0.2 + 0.5 * unit(random)) * tool.session->tool().radius;
    for (int k = 1; k <= 20; ++k) move_depth(tool, depth * k / 20.0, {.evaluations = 20});
    for (int k = 0; k < each; ++k) one_stroke(tool, depth, random, done + k, tally);
  }
  write_csv(file, tally.table);
  fmt::print(
      "{}: {} nodes, {} strokes, {} cut; followed after {:.0f} ms in the middle, {:.0f} in 90 %, {:.0f} at "
      "most; "
      "frames meanwhile {:.1f} ms in 99 %, {:.1f} at most; {} bad frames\n",
      image.filename().string(), nodes, count, tally.cut, quantile(tally.made_ms, 0.5),
      quantile(tally.made_ms, 0.9), quantile(tally.made_ms, 1.0), quantile(tally.frame_ms, 0.99),
      quantile(tally.frame_ms, 1.0), tally.bad);
}

bool same_bits(const Model& a, const Model& b) {
  bool same = a.X == b.X && a.point == b.point && a.volume == b.volume &&
              a.support.offset == b.support.offset && a.support.member == b.support.member &&
              a.dphi == b.dphi && a.mass == b.mass && a.patches.psi == b.patches.psi &&
              a.patches.of_point.member == b.patches.of_point.member;
  for (std::size_t t = 0; t < a.variance.size(); ++t)
    same =
        same && a.variance[t].rows.member == b.variance[t].rows.member && a.variance[t].K == b.variance[t].K;
  return same;
}

void growth(const fs::path& image, const fs::path& file) {
  Table table{
      .header = {"nodes", "length_mm", "points_changed", "near_s", "everywhere_s", "model_s", "same_bits"},
      .column = std::vector<std::vector<double>>(7)};
  for (const Index nodes : {2000, 10000, 30000, 100000}) {
    ModelOptions options;
    options.cloud.count = nodes;
    const Stopwatch making;
    const Model model = build_model(read_label_image(image), {}, options).model;
    const double model_s = making.seconds();
    std::vector<Index> held = model.base;
    held.insert(held.end(), model.circle.begin(), model.circle.end());
    for (const double length : {5e-3, 10e-3, 20e-3, 40e-3}) {
      const Vec3 e = model.tool.push.unitOrthogonal(), g = model.tool.push.cross(e);
      const Vec3 x = model.tool.centre + 1.6 * model.tool.radius * e - 0.5 * length * g;
      const TriangleMesh blade = swept_sheet(1e3 * x, 1e3 * (x + length * g), model.tool.push, 1.0, 8.0, 1.0);
      const auto sheet = std::make_shared<const Sheet>(1e-3 * blade.vertex, blade.triangles);
      const Stopwatch near;
      const SheetCut cut = cut_by_sheet(model, sheet, {1000.0}, held);
      const double near_s = near.seconds();
      const Stopwatch whole;
      const SheetCut all = cut_by_sheet(model, sheet, {1000.0}, held, Looked::everywhere);
      const double row[] = {static_cast<double>(model.node_count()),
                            1e3 * length,
                            static_cast<double>(cut.changed),
                            near_s,
                            whole.seconds(),
                            model_s,
                            same_bits(cut.model, all.model) ? 1.0 : 0.0};
      for (std::size_t c = 0; c < table.column.size(); ++c) table.column[c].push_back(row[c]);
      fmt::print(
          "{} nodes, {} mm: {} points changed; {:.3f} s near the blade, {:.3f} s everywhere, {:.2f} s the "
          "model; same bits: {}\n",
          row[0], row[1], row[2], row[3], row[4], row[5], row[6] > 0.0);
      std::fflush(stdout);
    }
  }
  write_csv(file, table);
}

}  // namespace
}  // namespace dimple

int main(int count, char** argument) {
  namespace fs = std::filesystem;
  CLI::App app("A body that is cut while a tool is in it.");
  fs::path folder, block;
  std::vector<std::string> images;
  int number = 200;
  std::int64_t nodes = 2000;
  app.add_option("FOLDER", folder)->required();
  app.add_option("IMAGE", images);
  app.add_option("--strokes", number);
  app.add_option("--nodes", nodes);
  app.add_option("--growth", block);
  CLI11_PARSE(app, count, argument);
  try {
    for (const std::string& image : images) {
      std::string name = fs::path(image).filename().string();
      name = name.substr(0, name.find_first_of("._"));
      dimple::strokes(image, nodes, number, folder / fmt::format("strokes_{}.csv", name));
    }
    if (!block.empty()) dimple::growth(block, folder / "strokes_growth.csv");
  } catch (const dimple::Error& error) {
    fmt::print(stderr, "error: {}: {}\n", error.what(), error.report.where);
    return 1;
  } catch (const std::exception& error) {
    fmt::print(stderr, "error: {}\n", error.what());
    return 1;
  }
}
