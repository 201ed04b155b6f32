// A body under a tool that is followed in bounded time: how far the forces are from those of equilibrium.
//
//   dimple_live FOLDER IMAGE...      [--seconds 60] [--jerks 1000]
//
// For each image, into FOLDER/live.csv: the error of the force over the evaluations of a frame; a scripted
// minute with 2000 nodes at 25 frames a second and with 1000 at 60; into live.md: random jerks. Nothing else
// should run on the machine.

#include <fmt/format.h>
#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <random>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/label_image.hpp"
#include "preprocess/build_model.hpp"
#include "solver/session.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

double wall() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
double processor() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

const Material brain = neo_hookean(210.0, 0.499, 1000.0);

Model model_of(const fs::path& image, Index nodes) {
  ModelOptions options;
  options.cloud.count = nodes;
  return build_model(read_label_image(image), {}, options).model;
}

// Depth over time [m, s].
struct Script {
  struct Moment {
    double depth;
    bool still;  // it has stood for a fifth of a second
  };
  std::vector<Moment> frame;
};

// Stops of 0.3 to 0.8 s at random depths, and the way between them at `speed` [m/s].
Script stops_and_ways(double seconds, double rate, double deepest, double speed, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  Script script;
  double depth = 0.0, to = 0.0, rest = 0.0, stood = 0.0;
  while (static_cast<double>(script.frame.size()) < seconds * rate) {
    if (depth != to) {
      const double step = speed / rate;
      depth = std::abs(to - depth) <= step ? to : depth + std::copysign(step, to - depth);
      stood = 0.0;
    } else if ((rest -= 1.0 / rate) < 0.0) {
      to = deepest * (0.05 + 0.95 * unit(random));
      rest = 0.3 + 0.5 * unit(random);
    } else {
      stood += 1.0 / rate;
    }
    script.frame.push_back({depth, stood >= 0.2});
  }
  return script;
}

// The converged force over the depth, by equilibria 0.1 mm apart.
struct Converged {
  std::vector<double> depth, force;
  Converged(const Model& model, double deepest) {
    Session session(model, {brain}, {.tolerance = 1e-5});
    depth = force = {0.0};
    try {
      for (double d = 1e-4; d < deepest + 1.5e-4; d += 1e-4) {
        session.equilibrate(d);
        depth.push_back(d);
        force.push_back(session.force());
      }
    } catch (const SolveError& error) {
      fmt::print("converged to {:.2f} mm: {}\n", 1e3 * depth.back(), error.report.fact);
    }
  }
  double operator()(double at) const {
    const auto last = static_cast<std::ptrdiff_t>(depth.size()) - 1;
    const auto k = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(at / 1e-4) - 1, 0,
                                              std::max<std::ptrdiff_t>(last - 3, 0));
    double sum = 0.0;
    for (std::ptrdiff_t i = k; i <= std::min(last, k + 3); ++i) {
      double weight = 1.0;
      for (std::ptrdiff_t j = k; j <= std::min(last, k + 3); ++j)
        if (j != i)
          weight *= (at - depth[static_cast<std::size_t>(j)]) /
                    (depth[static_cast<std::size_t>(i)] - depth[static_cast<std::size_t>(j)]);
      sum += weight * force[static_cast<std::size_t>(i)];
    }
    return sum;
  }
};

struct Measured {
  double still_95 = 0.0, still = 0.0, moving_95 = 0.0, moving = 0.0;  // share of the force at that depth
  double held = 0.0;    // share of frames whose error the stated one holds
  double stated = 0.0;  // its median
  double evaluations = 0.0, wall_ms = 0.0, processor_ms = 0.0, late = 0.0, slowest_ms = 0.0;
  double lag = 0.0;  // largest [mm]
};

double quantile(std::vector<double> v, double q) {
  if (v.empty()) return 0.0;
  std::sort(v.begin(), v.end());
  return v[std::min(v.size() - 1, static_cast<std::size_t>(q * static_cast<double>(v.size())))];
}

using Follow = std::function<LiveFrame(double depth)>;

Measured measure(const Script& script, const Converged& converged, const Follow& follow, double limit_s,
                 double least = 2e-4) {
  std::vector<double> still, moving, wall_ms, stated;
  Measured m;
  double held = 0.0, counted = 0.0;
  const double cpu = processor();
  for (const Script::Moment& now : script.frame) {
    const double t = wall();
    const LiveFrame frame = follow(now.depth);
    wall_ms.push_back(1e3 * (wall() - t));
    m.evaluations += static_cast<double>(frame.evaluations);
    m.lag = std::max(m.lag, 1e3 * std::abs(frame.depth - frame.asked));
    if (frame.depth < least || frame.asked < least) continue;
    const double true_force = converged(frame.asked), here = converged(frame.depth);
    (now.still ? still : moving).push_back(std::abs(frame.force - true_force) / true_force);
    ++counted;
    held += std::abs(frame.force - here) <= frame.error_at_depth;
    stated.push_back(frame.error_at_depth / here);
  }
  const auto frames = static_cast<double>(script.frame.size());
  m.processor_ms = 1e3 * (processor() - cpu) / frames;
  m.evaluations /= frames;
  m.wall_ms = quantile(wall_ms, 0.5);
  m.slowest_ms = quantile(wall_ms, 0.99);
  m.late = static_cast<double>(
               std::count_if(wall_ms.begin(), wall_ms.end(), [&](double w) { return w > 1e3 * limit_s; })) /
           frames;
  m.still_95 = quantile(still, 0.95), m.still = quantile(still, 1.0);
  m.moving_95 = quantile(moving, 0.95), m.moving = quantile(moving, 1.0);
  m.held = held / counted;
  m.stated = quantile(stated, 0.5);
  return m;
}

// A row of live.csv.
struct Row {
  std::string image, study, way;
  Index nodes = 0;
  double rate = 0.0;
  std::int64_t evaluations = 0;
  Measured m;
};
constexpr const char* header =
    "image,study,way,nodes,frames_per_s,evaluations_at_most,still_95_percent,still_largest_percent,moving_95_"
    "percent,"
    "moving_largest_percent,held_percent,stated_percent,evaluations,frame_ms,frame_99_ms,processor_ms,late_"
    "percent,"
    "largest_lag_mm\n";
std::string line_of(const Row& row) {
  const Measured& m = row.m;
  return fmt::format(
      "{},{},{},{},{:g},{},{:.3g},{:.3g},{:.3g},{:.3g},{:.4g},{:.3g},{:.3g},{:.3g},{:.3g},{:.3g},{:.3g},{:."
      "3g}\n",
      row.image, row.study, row.way, row.nodes, row.rate, row.evaluations, 100 * m.still_95, 100 * m.still,
      100 * m.moving_95, 100 * m.moving, 100 * m.held, 100 * m.stated, m.evaluations, m.wall_ms, m.slowest_ms,
      m.processor_ms, 100 * m.late, m.lag);
}

void tell(const std::string& what, const Measured& m) {
  fmt::print(
      "{:<28} still {:.2f} / {:.2f} %  moving {:.2f} / {:.2f} %  stated {:.2f} % held {:.1f} %  {:.1f} "
      "evaluations  {:.2f} ms ({:.2f} at 99 %, {:.2f} of the processor)  late {:.2f} %  lag {:.2f} mm\n",
      what, 100 * m.still_95, 100 * m.still, 100 * m.moving_95, 100 * m.moving, 100 * m.stated, 100 * m.held,
      m.evaluations, m.wall_ms, m.slowest_ms, m.processor_ms, 100 * m.late, m.lag);
  std::fflush(stdout);
}

void limits(const fs::path& image, Index nodes, std::vector<Row>& rows) {
  const Model model = model_of(image, nodes);
  const double deepest = model.tool.radius;
  const Converged converged(model, deepest);
  const double rate = 25.0;
  const Script script = stops_and_ways(20.0, rate, deepest, 0.01, 1);
  for (const std::int64_t n : {2, 3, 4, 6, 8, 12, 16, 24}) {
    Session session(model, {brain});
    const Measured m = measure(
        script, converged, [&](double d) { return session.follow(d, {.evaluations = n}); }, 1.0 / rate);
    tell(fmt::format("known states {}", n), m);
    rows.push_back({image.stem().string(), "ways", "known states", model.node_count(), rate, n, m});
  }
}

void minute(const fs::path& image, Index nodes, double rate, double seconds, std::vector<Row>& rows) {
  const Model model = model_of(image, nodes);
  const double deepest = model.tool.radius;
  const Converged converged(model, deepest);
  const Script script = stops_and_ways(seconds, rate, deepest, 0.01, 1);
  Session session(model, {brain});
  const FrameLimit how{.seconds = 1.0 / rate};
  const Measured m = measure(
      script, converged, [&](double d) { return session.follow(d, how); }, 1.0 / rate);
  tell(fmt::format("{} nodes, {:.0f} fps", model.node_count(), rate), m);
  rows.push_back({image.stem().string(), "minute", "known states", model.node_count(), rate, 0, m});
}

std::string jerks(const fs::path& image, Index nodes, double rate, std::int64_t evaluations, int count) {
  const Model model = model_of(image, nodes);
  const double height =
      (model.X.transpose() * model.tool.push).maxCoeff() - model.tool.centre.dot(model.tool.push);
  const double deepest = 0.6 * height;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  Session session(model, {brain});
  double depth = 0.0;
  int frames = 0, there = 0, lags = 0, stopped = 0, bad = 0, frozen = 0, still = 0;
  double last = 0.0, farthest = 0.0, slowest = 0.0;
  for (int k = 0; k < count; ++k) {
    const double to = deepest * unit(random) * (unit(random) < 0.1 ? 0.0 : 1.0),
                 speed = 0.05 * (0.1 + 0.9 * unit(random));
    const int hold = static_cast<int>(unit(random) * 8);
    for (int h = 0; depth != to || h < hold;) {
      if (depth != to) {
        const double step = speed / rate;
        depth = std::abs(to - depth) <= step ? to : depth + std::copysign(step, to - depth);
      } else
        ++h;
      const double t = wall();
      const LiveFrame f = session.follow(depth, {.evaluations = evaluations});
      slowest = std::max(slowest, wall() - t);
      ++frames;
      there += f.tool == LiveFrame::Tool::there, lags += f.tool == LiveFrame::Tool::lags,
          stopped += f.tool == LiveFrame::Tool::stopped;
      const double furthest = session.nodal_parameters().colwise().norm().maxCoeff();
      const bool wrong =
          !std::isfinite(f.force) || f.force < -1e-6 || furthest > 2.5 * std::max(f.depth, 1e-9);
      if (wrong)
        fmt::print("bad frame: asked {} at {} force {} furthest {}\n", f.asked, f.depth, f.force, furthest);
      bad += wrong;
      still = f.depth == last && f.asked < last - 1e-6 ? still + 1 : 0;  // it does not even go back
      frozen += still > 2;
      last = f.depth;
      farthest = std::max(farthest, f.depth);
    }
  }
  return fmt::format(
      "{} nodes, {} jerks to {:.1f} mm ({:.1f} mm thick), {} frames: there {}, lags {}, stopped {}, bad {}, "
      "frozen {}; "
      "deepest {:.2f} mm; slowest {:.1f} ms\n",
      model.node_count(), count, 1e3 * deepest, 1e3 * height, frames, there, lags, stopped, bad, frozen,
      1e3 * farthest, 1e3 * slowest);
}

}  // namespace
}  // namespace dimple

int main(int count, char** argument) {
  namespace fs = std::filesystem;
  CLI::App app("A tool that is followed in bounded time.");
  fs::path folder;
  std::vector<std::string> images;
  double seconds = 60.0;
  int jerks = 1000;
  app.add_option("FOLDER", folder)->required();
  app.add_option("IMAGE", images);
  app.add_option("--seconds", seconds);
  app.add_option("--jerks", jerks);
  CLI11_PARSE(app, count, argument);
  try {
    std::vector<dimple::Row> rows;
    std::string words = "Jerks, beside live.csv.\n";
    for (const std::string& image : images) {
      fmt::print("{}\n", image);
      dimple::limits(image, 2000, rows);
      dimple::minute(image, 2000, 25.0, seconds, rows);
      dimple::minute(image, 1000, 60.0, seconds, rows);
      words += fmt::format("\n{}:\n\n", fs::path(image).stem().string());
      const auto say = [&](const std::string& line) {
        fmt::print("{}", line);
        words += "- " + line;
      };
      say(dimple::jerks(image, 1000, 25.0, 8, jerks));
    }
    std::string csv = dimple::header;
    for (const dimple::Row& row : rows) csv += dimple::line_of(row);
    dimple::write_file(folder / "live.csv", csv);
    dimple::write_file(folder / "live.md", words);
  } catch (const dimple::Error& error) {
    fmt::print(stderr, "error: {}: {}\n", error.what(), error.report.where);
    return 1;
  }
}
