#include "apps/studies/accuracy_chart.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

#include "apps/run/results.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/studies/converge.hpp"
#include "apps/studies/peer_mesh.hpp"
#include "apps/studies/run_program.hpp"
#include "apps/studies/scenes.hpp"
#include "io/draw/chart.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/label_image.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr int most_depths = 8;  // 1, 2, ... mm
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// Horton, Wittek, Miller, MICCAI 2007, section 5: 0.131 N computed; 0.181 and 0.125 N measured at the two
// hemispheres of a swine brain, 0.153 N in the mean; 55 s on a 3 GHz Pentium 4.
constexpr double paper_s = 55.0, paper_error = 1.0 - 0.131 / (0.5 * (0.181 + 0.125));

// One scene as it is run.
struct Subject {
  std::string name, title;
  std::vector<std::string> subtitle;
  Config config;
  std::vector<double> reference;  // [N] at the depths; empty: the finest own run
  std::string reference_name;
  std::size_t depths = 8;  // 1, 2, ... mm, a second each
};

bool among(const std::string& word, const std::vector<std::string>& words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

void check_words(const std::vector<std::string>& given, const std::vector<std::string>& known,
                 const std::string& option) {
  for (const std::string& word : given)
    if (!among(word, known))
      throw UsageError({.fact = fmt::format("'{}' is not known{}", word, did_you_mean(word, known)),
                        .where = option,
                        .why = fmt::format("it takes {}", fmt::join(known, ", ")),
                        .remedy = "choose among these"});
}

fs::path program_asked_for(const std::string& given, const std::string& option) {
  const fs::path found = find_program(given);
  if (found.empty())
    throw UsageError({.fact = fmt::format("there is no program {}", given),
                      .where = option,
                      .why = "it is not there, or may not be executed",
                      .remedy = fmt::format("give the path of the program, or leave {} out", option)});
  return found;
}

std::vector<double> whole_millimetres(std::size_t depths) {
  std::vector<double> result(depths);
  std::iota(result.begin(), result.end(), 1.0);
  return result;
}

// Forces at 1, 2, ... mm, as many as the table has from the first on.
std::vector<double> reference_of(const fs::path& file) {
  const Table table = read_csv(file);
  const auto* depth = table.find("indentation_mm");
  std::size_t rows = 0;
  while (depth && rows < most_depths && std::any_of(depth->begin(), depth->end(), [&](double d) {
           return std::abs(d - static_cast<double>(rows + 1)) < 1e-6;
         }))
    ++rows;
  if (depth && rows == 0)
    throw InputError({.fact = "the reference has no force at 1 mm",
                      .where = file.string(),
                      .why = "the chart compares at 1, 2, ... mm",
                      .remedy = "give a table with a row for each of them, to 8 mm at most"});
  return reference_at(file, whole_millimetres(rows));
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return 0.5 * (values[(values.size() - 1) / 2] + values[values.size() / 2]);
}

// Half the band at the deepest as a part of the force there; not a number where there is none.
double stated(const Band& band, const History& history) {
  return band.known() ? band.half.back() / std::abs(history.force.back().force) : nan;
}

AccuracyPoint own_point(const Subject& subject, const std::string& scheme, const std::string& time,
                        Index nodes, int repeat) {
  AccuracyPoint point{.scene = subject.name,
                      .program = "dimple",
                      .scheme = scheme,
                      .time = time,
                      .nodes = nodes,
                      .depths = subject.depths};
  Config config = subject.config;
  config.scheme.name = scheme;
  config.solver.time = time;
  config.cloud.nodes = nodes;
  config.cloud.spacing_mm = 0.0;
  std::vector<double> build, solve, band;
  const bool with_band = scheme == Config{}.scheme.name && time == "quasi-static";
  try {
    for (int run = 0; run < repeat; ++run) {
      // Another cloud each time: a single one may be right by luck.
      config.cloud.seed = subject.config.cloud.seed + run;
      const Measured m = measure(config, with_band);
      point.points = m.points;
      band.push_back(m.band.seconds);
      point.stated = std::fmax(point.stated, stated(m.band, m.history));
      build.push_back(m.build_s);
      solve.push_back(m.solve_s);
      point.runs.push_back(forces_at(m.history.force, whole_millimetres(subject.depths)));
    }
    point.build_s = median(build);
    point.solve_s = median(solve);
    point.band_s = median(band);
  } catch (const Error& error) {  // Stopped too: it is "interrupted"
    point.status = error.report.fact;
  }
  return point;
}

constexpr const char* dial =
    "accuracy";  // the scheme of a point for which an accuracy was asked for, not nodes

// The ladder for an accuracy, all its clouds together.
AccuracyPoint dial_point(const Subject& subject, const std::string& goal, int repeat) {
  AccuracyPoint point{.scene = subject.name,
                      .program = "dimple",
                      .scheme = fmt::format("{} {}", dial, goal),
                      .time = "quasi-static",
                      .depths = subject.depths};
  Config config = subject.config;
  config.accuracy.goal = goal;
  std::vector<double> solve;
  try {
    for (int run = 0; run < repeat; ++run) {
      config.cloud.seed = subject.config.cloud.seed + run;
      const Stopwatch whole;
      const Result result = simulate({.config = config});
      stop_if_asked();
      solve.push_back(whole.seconds());
      point.nodes = std::max(point.nodes, result.model.node_count());
      point.points = std::max(point.points, result.model.point_count());
      point.runs.push_back(forces_at(result.history.force, whole_millimetres(subject.depths)));
      const double half = stated(result.band, result.history), force = result.history.force.back().force;
      point.stated = std::fmax(point.stated, half);
      if (point.status == "ok" && !(half * force <= goal_of(config)->half_width(force)))
        point.status = fmt::format("not reached: half the band is {:.1f} %", 100.0 * half);
    }
    point.solve_s = median(solve);
  } catch (const Error& error) {  // Stopped too: it is "interrupted"
    point.status = error.report.fact;
  }
  return point;
}

struct Peer {
  std::string name, scheme, title, elements;
  fs::path program;
};

AccuracyPoint peer_point(const Subject& subject, const Peer& peer, Index nodes,
                         const AccuracyOptions& options, const fs::path& folder) {
  AccuracyPoint point{.scene = subject.name,
                      .program = peer.name,
                      .scheme = peer.scheme,
                      .time = "quasi-static",
                      .nodes = nodes,
                      .depths = subject.depths};
  const int threads =
      static_cast<int>(tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));
  const bool calculix = peer.name == "calculix";
  const fs::path input = folder / (calculix ? "peer.inp" : "peer.feb");
  Config config = subject.config;
  config.cloud.nodes = nodes;
  config.cloud.spacing_mm = 0.0;
  std::vector<double> build, solve;
  try {
    for (int run = 0; run < options.repeat; ++run) {
      fs::remove_all(folder);
      make_folder(folder);
      const auto start = std::chrono::steady_clock::now();
      const ElementModel model = element_model(config, peer.name, peer.elements);
      write_file(input, calculix ? calculix_input(model) : febio_input(model));
      build.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
      point.nodes = model.X.cols();
      point.points = model.elements.cols() * (model.elements.rows() == 10 && calculix ? 4 : 8);
      const ProgramRun ran =
          run_program(calculix ? std::vector<std::string>{peer.program, "peer"}
                               : std::vector<std::string>{peer.program, "-i", "peer.feb", "-nosplash"},
                      folder, "words.txt", options.peer_limit_s, threads,
                      [] { return stop_asked() != StopReason::none; });
      solve.push_back(ran.seconds);
      const fs::path results = folder / (calculix ? "peer.dat" : febio_forces_file);
      std::vector<double> force;
      if (fs::exists(results))
        force = calculix ? calculix_forces(read_file(results), model.push)
                         : febio_forces(read_file(results), model.push, static_cast<int>(subject.depths));
      if (ran.interrupted)
        point.status = "interrupted";
      else if (ran.out_of_time)
        point.status = fmt::format("stopped after {:.3g} s at {} of {} depths", options.peer_limit_s,
                                   force.size(), subject.depths);
      else if (force.size() < subject.depths)
        point.status =
            fmt::format("ended with code {} after {} of {} depths", ran.code, force.size(), subject.depths);
      point.runs.push_back(force);
      if (point.status != "ok") break;
    }
    point.build_s = median(build);
    point.solve_s = median(solve);
  } catch (const Error& error) {  // Stopped too: it is "interrupted"
    point.status = error.report.fact;
  }
  std::error_code ignored;
  fs::remove_all(folder, ignored);
  return point;
}

void set_errors(std::vector<AccuracyPoint>& points, const Subject& subject,
                const std::vector<double>& reference) {
  for (AccuracyPoint& p : points) {
    if (p.scene != subject.name) continue;
    p.error = p.error_last = nan;
    if (reference.empty()) continue;
    for (const std::vector<double>& force : p.runs)
      for (std::size_t k = 0; k < std::min(force.size(), reference.size()); ++k) {
        const double error = std::abs(force[k] / reference[k] - 1.0);
        p.error = std::fmax(p.error, error);
        if (k + 1 == reference.size()) p.error_last = std::fmax(p.error_last, error);
      }
  }
}

// Only runs that went the whole way have a place in the picture.
bool complete(const AccuracyPoint& p) {
  return p.status == "ok" && !p.runs.empty() && p.runs.front().size() == p.depths && p.error > 0.0;
}

bool states_its_error(const AccuracyPoint& p) {
  return p.status == "ok" && std::isfinite(p.stated);
}

// `known`: there is a reference. Differences between our own runs say nothing of whose are right.
void mark_front(std::vector<AccuracyPoint>& points, const std::string& scene, bool known) {
  std::vector<double> cost, error, cost_with_band, stated;
  for (AccuracyPoint& p : points) {
    const bool here = p.scene == scene;
    if (here) p.on_front = p.on_stated_front = false;
    cost.push_back(here && known && complete(p) ? p.wall_s() : nan);
    error.push_back(p.error);
    cost_with_band.push_back(here && states_its_error(p) ? p.wall_s() + p.band_s : nan);
    stated.push_back(p.stated);
  }
  for (const std::size_t k : pareto_front(cost, error)) points[k].on_front = true;
  for (const std::size_t k : pareto_front(cost_with_band, stated)) points[k].on_stated_front = true;
}

std::string csv(const std::vector<AccuracyPoint>& points, const std::vector<Subject>& subjects) {
  std::string text =
      "scene,program,scheme,time,nodes,points,build_s,solve_s,wall_s,largest_error,error_at_the_end,on_front,"
      "band_s,stated_error,on_stated_front,compared_with,status";
  for (int k = 1; k <= most_depths; ++k) text += fmt::format(",force_{}_mm_N", k);  // of the first cloud
  text += "\n";
  const auto number = [](double value) { return std::isfinite(value) ? fmt::format("{:.6g}", value) : ""; };
  for (const AccuracyPoint& p : points) {
    const auto subject =
        std::find_if(subjects.begin(), subjects.end(), [&](const Subject& s) { return s.name == p.scene; });
    text += fmt::format("{},{},{},{},{},{},{:.4g},{:.4g},{:.4g},{},{},{},{:.4g},{},{},{},{}", p.scene,
                        p.program, p.scheme, p.time, p.nodes, p.points, p.build_s, p.solve_s, p.wall_s(),
                        number(p.error), number(p.error_last), p.on_front ? 1 : 0, p.band_s, number(p.stated),
                        p.on_stated_front ? 1 : 0, csv_field(subject->reference_name), csv_field(p.status));
    const std::vector<double> force = p.runs.empty() ? std::vector<double>{} : p.runs.front();
    for (std::size_t k = 0; k < most_depths; ++k)
      text += fmt::format(",{}", k < force.size() ? number(force[k]) : "");
    text += "\n";
  }
  return text;
}

// Lines that belong together, in the order of the legend; the same look in every panel.
struct Family {
  std::string program, scheme, time, name, short_name;
  int colour;
  bool hollow = false;
};
const std::vector<Family> families = {
    {"dimple", "converging", "quasi-static", "converging, quasi-static", "converging", 0},
    {"dimple", dial, "quasi-static", "an accuracy asked for: all clouds of its ladder", "", 2},
    {"dimple", "converging", "dynamic", "converging, dynamic", "converging, dynamic", 5},
    {"dimple", "horton2007", "dynamic", "horton2007, dynamic", "horton2007", 1},
    {"calculix", "C3D20R", "quasi-static", "CalculiX, hexahedra (C3D20R)", "CalculiX", 3},
    {"calculix", "C3D10", "quasi-static", "CalculiX, tetrahedra (C3D10)", "C3D10", 3, true},
    {"febio", "hex8", "quasi-static", "FEBio, hexahedra (hex8, mixed)", "FEBio", 4},
    {"febio", "tet10", "quasi-static", "FEBio, tetrahedra (tet10, mixed)", "tet10", 4, true}};

ChartSeries front_through(std::vector<std::array<double, 2>> points) {
  ChartSeries front{.name = "Pareto front", .line = true, .markers = false, .dashed = true, .colour = 6};
  std::sort(points.begin(), points.end());
  for (const auto& [x, y] : points) {
    // Steps: for this much time, no better than the last one.
    if (!front.x.empty()) {
      front.x.push_back(x);
      front.y.push_back(front.y.back());
    }
    front.x.push_back(x);
    front.y.push_back(y);
  }
  return front;
}

Chart panel(const Subject& subject, const std::vector<AccuracyPoint>& points) {
  const bool known = !subject.reference.empty();
  Chart chart{
      .title = subject.title,
      .subtitle = subject.subtitle,
      .x_label = "wall time, from the image to the force curve [s]",
      .y_label = known
                     ? fmt::format("largest error of the force at 1, 2, ... {} mm [%]", subject.depths)
                     : fmt::format("largest difference from that run at 1, 2, ... {} mm [%]", subject.depths),
      .log_x = true,
      .log_y = true};
  // What came to no point is said.
  for (const AccuracyPoint& p : points)
    if (p.scene == subject.name && p.status != "ok")
      chart.subtitle.push_back(
          fmt::format("No point for {} ({}) with {} nodes: {}", p.program, p.scheme, p.nodes, p.status));
  std::vector<std::array<double, 2>> best;
  for (const AccuracyPoint& p : points)
    if (p.scene == subject.name && p.on_front) best.push_back({p.wall_s(), 100.0 * p.error});
  if (known) chart.series.push_back(front_through(best));
  for (const Family& family : families) {
    ChartSeries series{.name = family.name, .hollow = family.hollow, .colour = family.colour};
    for (const AccuracyPoint& p : points) {
      const bool belongs = family.scheme == dial ? p.scheme.starts_with(dial) : p.scheme == family.scheme;
      if (p.scene != subject.name || p.program != family.program || !belongs || p.time != family.time ||
          !complete(p))
        continue;
      series.x.push_back(p.wall_s());
      series.y.push_back(100.0 * p.error);
      series.label.push_back(family.scheme == dial ? p.scheme
                                                   : fmt::format("{} {}", family.short_name, p.nodes));
    }
    if (!series.x.empty()) chart.series.push_back(series);
  }
  const auto load_s = static_cast<double>(subject.depths);
  chart.lines = {{.vertical = true, .at = load_s, .text = fmt::format("real time, {:g} s", load_s)}};
  if (!known) return chart;
  if (subject.name != "image")
    chart.series.push_back({.name = "Horton et al. 2007, as reported",
                            .x = {paper_s},
                            .y = {100.0 * paper_error},
                            .label = {"Horton 2007, as reported: 55 s"},
                            .line = false,
                            .hollow = true,
                            .colour = 7});
  chart.lines.push_back({.vertical = false, .at = 2.0, .text = "2 %"});
  return chart;
}

// What runs say of their own error. No other program says anything.
Chart stated_panel(const Subject& subject, const std::vector<AccuracyPoint>& points) {
  Chart chart{.title = subject.title.substr(0, subject.title.rfind(": ")) + ": stated error against wall time",
              .subtitle = {fmt::format("half the band of the force at {} mm; the time includes all clouds that it takes. No "
                                       "other program in the chart states its error",
                                       subject.depths)},
              .x_label = "wall time, from the image to the force curve with its band [s]",
              .y_label = "half the band's width [% of the force]",
              .log_x = true,
              .log_y = true};
  std::vector<std::array<double, 2>> best;
  ChartSeries single{.name = "a number of nodes asked for", .colour = 0},
      asked{.name = "an accuracy asked for", .colour = 2};
  for (const AccuracyPoint& p : points) {
    if (p.scene != subject.name || !states_its_error(p)) continue;
    const bool is_dial = p.scheme.starts_with(dial);
    const double x = p.wall_s() + p.band_s, y = 100.0 * p.stated;
    ChartSeries& series = is_dial ? asked : single;
    series.x.push_back(x);
    series.y.push_back(y);
    series.label.push_back(is_dial ? p.scheme : fmt::format("{} nodes", p.nodes));
    if (p.on_stated_front) best.push_back({x, y});
  }
  chart.series.push_back(front_through(best));
  for (ChartSeries& series : {std::ref(single), std::ref(asked)})
    if (!series.x.empty()) chart.series.push_back(std::move(series));
  return chart;
}

// How much faster the quickest own run is that errs no more than another program's, where that is known.
std::string comparison(const std::vector<AccuracyPoint>& points, const std::vector<Subject>& subjects) {
  std::string text;
  for (const AccuracyPoint& peer : points) {
    const auto known = [&](const Subject& s) { return s.name == peer.scene && !s.reference.empty(); };
    if (peer.program == "dimple" || std::none_of(subjects.begin(), subjects.end(), known) || !complete(peer))
      continue;
    const AccuracyPoint* best = nullptr;
    for (const AccuracyPoint& own : points)
      if (own.scene == peer.scene && own.program == "dimple" && complete(own) && own.error <= peer.error &&
          (!best || own.wall_s() < best->wall_s()))
        best = &own;
    text +=
        fmt::format("scene {}: {} with {} nodes errs by {:.1f} % in {:.1f} s ({:.1f} s without the mesh); ",
                    peer.scene, peer.program, peer.nodes, 100.0 * peer.error, peer.wall_s(), peer.solve_s);
    text += best ? fmt::format("{} ({}) with {} nodes by {:.1f} % in {:.2f} s: {:.0f} times faster\n",
                               best->scheme, best->time, best->nodes, 100.0 * best->error, best->wall_s(),
                               peer.wall_s() / best->wall_s())
                 : "no run of ours errs less\n";
  }
  return text;
}

}  // namespace

std::vector<std::size_t> pareto_front(const std::vector<double>& cost, const std::vector<double>& error) {
  std::vector<std::size_t> order;
  for (std::size_t k = 0; k < cost.size(); ++k)
    if (std::isfinite(cost[k]) && std::isfinite(error[k])) order.push_back(k);
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return cost[a] != cost[b] ? cost[a] < cost[b] : error[a] != error[b] ? error[a] < error[b] : a < b;
  });
  std::vector<std::size_t> front;
  for (const std::size_t k : order) {
    const bool better = front.empty() || error[k] < error[front.back()];
    const bool equal = !front.empty() && error[k] == error[front.back()] && cost[k] == cost[front.back()];
    if (better || equal) front.push_back(k);
  }
  return front;
}

Outcome accuracy_chart(const Config& config, const AccuracyOptions& options, const fs::path& folder,
                       const std::function<void(const std::string&)>& progress) {
  check_words(options.only, {"a", "b", "image"}, "--only");
  check_words(options.schemes, {"converging", "horton2007"}, "--schemes");
  check_words(options.times, {"quasi-static", "dynamic"}, "--time");
  check_words(options.peer_elements, {"hexahedra", "tetrahedra"}, "--elements");
  for (const Index nodes : options.nodes)
    if (nodes < 100)
      throw UsageError({.fact = fmt::format("{} nodes are too few", nodes),
                        .where = "--nodes",
                        .why = "a cloud has at least 100",
                        .remedy = "for instance --nodes 500,1000,2000"});
  for (const std::string& goal : options.goals) {
    Config asked;
    asked.accuracy.goal = goal;
    asked.load.depth_mm = 1.0;  // at which all that are meant at all are allowed
    goal_of(asked);
  }
  if (options.nodes.empty() || options.repeat < 1)
    throw UsageError({.fact = "a chart needs at least one cloud size and one run of it",
                      .where = "--nodes, --repeat",
                      .why = "there would be no point",
                      .remedy = "for instance --nodes 500,1000,2000"});
  const auto wanted = [&](const std::string& scene) {
    return options.only.empty() || among(scene, options.only);
  };
  if (config.image.file.empty() && among("image", options.only))
    throw UsageError({.fact = "no label image was given",
                      .where = "--only image",
                      .why = "there is nothing to run",
                      .remedy = "give one: dimple chart IMAGE -o OUT"});
  if (config.image.file.empty() && !options.reference.empty())
    throw UsageError({.fact = "a reference was given, but no label image that it is of",
                      .where = "--reference",
                      .why = "the two scenes have references of their own",
                      .remedy = "give the image: dimple chart IMAGE -o OUT --reference FILE"});
  std::vector<Peer> peers;
  if (options.calculix == "ccx" && find_program("ccx").empty())
    progress("CalculiX is not installed (apt install calculix-ccx) and is left out");
  else if (options.calculix != "none")
    for (const std::string& elements : options.peer_elements)
      peers.push_back({"calculix", elements == "hexahedra" ? "C3D20R" : "C3D10", "CalculiX", elements,
                       program_asked_for(options.calculix, "--calculix")});
  if (!options.febio.empty())
    for (const std::string& elements : options.peer_elements)
      peers.push_back({"febio", elements == "hexahedra" ? "hex8" : "tet10", "FEBio", elements,
                       program_asked_for(options.febio, "--febio")});
  check_result_folder(folder);
  std::optional<LabelImage> given;
  if (wanted("image") && !config.image.file.empty())
    given = read_label_image(config.image.file, config.image.label_names);
  const std::vector<double> known =
      options.reference.empty() ? std::vector<double>{} : reference_of(options.reference);
  stop_if_asked();
  make_folder(folder);
  const FolderLock lock(folder);
  remove_temporaries_in(folder);
  remove_word(folder);
  write_file(folder / "chart.csv", csv({}, {}));  // the folder is ours from here on

  const int threads =
      static_cast<int>(tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));
  const std::string how =
      fmt::format("circle of 10 mm, bonded, 8 mm deep in 8 s; {} threads, {}", threads,
                  options.repeat > 1 ? fmt::format("{} clouds each: median time, worst error", options.repeat)
                                     : "one run each");
  const std::string paper =
      "Horton et al. 2007, as reported for another body, a swine brain: 0.131 N computed, 0.181 and 0.125 N "
      "measured; 3 GHz Pentium 4";
  std::vector<Subject> subjects;
  for (const Scene& scene : {scene_a(), scene_b()}) {
    if (!wanted(scene.name)) continue;
    Subject subject{.name = scene.name,
                    .title = scene.title + ": error against wall time",
                    .subtitle = {"against mixed finite elements; " + how, paper},
                    .config = {},
                    .reference = {scene.reference.begin(), scene.reference.end()},
                    .reference_name = fmt::format("{}, to +-{:.2g} % at 8 mm", scene.source.front(),
                                                  100.0 * scene.known_to.back())};
    const fs::path file = folder / fmt::format("scene_{}.nrrd", scene.name);
    write_label_image(file, make_phantom(scene.phantom));
    subject.config.image.file = file.string();
    subject.config.boundary.base = "inferior";
    subject.config.boundary.indent_at = "0,0,top";
    subject.config.solver.frames = most_depths;
    subjects.push_back(subject);
  }
  if (given) {
    Subject subject{
        .name = "image",
        .title = fs::path(config.image.file).filename().string() + ": difference against wall time",
        .subtitle = {},
        .config = config,
        .reference = {},
        .reference_name = ""};
    if (!known.empty()) {
      subject.title = fs::path(config.image.file).filename().string() + ": error against wall time";
      subject.subtitle = {fmt::format("against {}; circle of {:g} mm, bonded, {} mm deep; {} threads",
                                      options.reference.filename().string(),
                                      config.boundary.indenter_diameter_mm, known.size(), threads)};
      subject.reference = known;
      subject.reference_name = options.reference.filename().string();
      subject.depths = known.size();
    }
    subject.config.load.depth_mm = static_cast<double>(subject.depths);
    subject.config.load.rate_mm_per_s = 1.0;
    subject.config.solver.frames = static_cast<int>(subject.depths);
    subjects.push_back(subject);
  }

  std::vector<AccuracyPoint> points;
  bool interrupted = false;
  std::vector<Index> nodes = options.nodes;
  std::sort(nodes.begin(), nodes.end());
  const auto sizes = [&](const std::string& time) {
    if (time != "dynamic") return nodes;
    std::vector<Index> some = options.dynamic_nodes;
    if (some.empty())
      for (const Index count : nodes)
        if (count <= 4250) some.push_back(count);
    std::sort(some.begin(), some.end());
    return some;
  };
  if (options.dynamic_nodes.empty() && among("dynamic", options.times) && nodes.back() > 4250)
    progress("dynamic runs: up to 4250 nodes (--dynamic-nodes: others)");
  const auto note = [&](Subject& subject, AccuracyPoint point) {
    points.push_back(std::move(point));
    std::vector<double> reference = subject.reference;
    AccuracyPoint* finest = nullptr;
    if (reference.empty()) {
      // Of two with as many nodes the first: quasi-static comes before dynamic.
      for (AccuracyPoint& p : points)
        if (p.scene == subject.name && p.program == "dimple" && p.scheme == "converging" &&
            p.status == "ok" && p.runs.front().size() == p.depths && (!finest || p.nodes > finest->nodes))
          finest = &p;
      if (finest) {
        reference = finest->runs.front();
        subject.reference_name = fmt::format("difference from {} nodes", finest->nodes);
        subject.subtitle = {
            fmt::format("difference from our own finest run, {} nodes (converging, {}: {:.4f} N at "
                        "8 mm), whose cloud has no point; {}",
                        finest->nodes, finest->time, reference.back(), how),
            "That run is no reference: how far it is itself from the converged force is not known."};
      }
    }
    set_errors(points, subject, reference);
    // Nor has the same cloud followed in time: it shares the errors of what it would be compared with.
    if (finest)
      for (AccuracyPoint& p : points)
        if (p.scene == subject.name && p.scheme == finest->scheme && p.nodes == finest->nodes)
          p.error = p.error_last = nan;
    mark_front(points, subject.name, !subject.reference.empty());
    write_file(folder / "chart.csv", csv(points, subjects));  // after every run: a long chart may be stopped
    const AccuracyPoint& p = points.back();
    progress(fmt::format(
        "{:<5} {:<8} {:<10} {:<12} {:>6} nodes: {}", p.scene, p.program, p.scheme, p.time, p.nodes,
        p.status != "ok" ? p.status
        : std::isnan(p.error)
            ? fmt::format("{:.2f} s, {} at the end", p.wall_s(),
                          force_in_words(p.runs.front().back()))
            : fmt::format("{:.2f} s, {} {:.2f} % at most, {:.2f} % at the end", p.wall_s(),
                          finest ? "difference" : "error", 100.0 * p.error, 100.0 * p.error_last)));
    interrupted = stop_asked() != StopReason::none;
  };
  for (Subject& subject : subjects) {
    for (const Family& family : families) {
      if (family.program != "dimple" || family.scheme == dial || !among(family.scheme, options.schemes) ||
          !among(family.time, options.times))
        continue;
      for (const Index count : sizes(family.time))
        if (!interrupted)
          note(subject, own_point(subject, family.scheme, family.time, count, options.repeat));
    }
    for (const std::string& goal : options.goals)
      if (!interrupted) note(subject, dial_point(subject, goal, options.repeat));
    for (const Peer& peer : peers)
      for (const Index count : options.peer_nodes) {
        if (interrupted) break;
        note(subject, peer_point(subject, peer, count, options, folder / "peer"));
        // A finer mesh would take longer still.
        if (points.back().status.rfind("stopped", 0) == 0) break;
      }
  }

  std::vector<Chart> panels;
  for (const Subject& subject : subjects) {
    panels.push_back(panel(subject, points));
    const auto of_it = [&](const AccuracyPoint& p) { return p.scene == subject.name && states_its_error(p); };
    if (std::any_of(points.begin(), points.end(), of_it)) panels.push_back(stated_panel(subject, points));
  }
  write_chart_png(folder / "chart.png", panels);
  write_chart_svg(folder / "chart.svg", panels);
  Outcome outcome;
  const auto drawn = std::count_if(points.begin(), points.end(), complete);
  outcome.headline =
      fmt::format("{}{} of {} runs in the chart", comparison(points, subjects), drawn, points.size());
  outcome.summary_json = fmt::format("{{\"status\": \"{}\", \"runs\": {}, \"in_the_chart\": {}}}\n",
                                     interrupted ? "interrupted" : "finished", points.size(), drawn);
  outcome.interrupted = interrupted;
  if (interrupted)
    outcome.ended_by = fmt::format("{}; chart.csv has the {} runs until then",
                                   Stopped(stop_asked()).report.fact, points.size());
  return outcome;
}

}  // namespace dimple
