#include "apps/studies/converge.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/run/results.hpp"
#include "io/draw/chart.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

// It is digits that are compared.
std::string with_a_digit_more(double force_N) {
  Written written = force_written(force_N);
  ++written.decimals;
  return written(force_N);
}

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct Study {
  Index nodes = 0;
  double density = 1.0;
  std::int64_t seed = 0;
  Measured measured;
  std::vector<double> force;  // [N] at the depths
};

// Of all runs; most say the same.
std::vector<std::string> distinct_warnings(const std::vector<Study>& runs) {
  std::vector<std::string> result;
  for (const Study& run : runs)
    for (const std::string& warning : run.measured.warnings)
      if (std::find(result.begin(), result.end(), warning) == result.end()) result.push_back(warning);
  return result;
}

// `force`: at even depths, the first of them one step from rest.
double kink(std::vector<double> force) {
  force.insert(force.begin(), 0.0);
  double largest = 0.0;
  for (std::size_t k = 1; k + 1 < force.size(); ++k)
    largest = std::max(largest, std::abs(force[k + 1] - 2.0 * force[k] + force[k - 1]));
  return largest / std::abs(force.back());
}

// Over the seeds of one cloud size and density.
struct Group {
  Group(Index n, double d) : nodes(n), density(d) {}
  Index nodes;
  double density;
  double points = 0.0, spacing = 0.0, rim = 0.0, evaluations = 0.0, seconds = 0.0, worst_kink = 0.0;
  std::vector<double> mean, scatter;  // per depth; scatter as a part of the mean
};

std::vector<Group> grouped(const std::vector<Study>& runs, std::size_t levels) {
  std::vector<Group> groups;
  for (const Study& run : runs) {
    if (groups.empty() || groups.back().nodes != run.nodes || groups.back().density != run.density)
      groups.emplace_back(run.nodes, run.density);
  }
  for (Group& g : groups) {
    std::vector<const Study*> members;
    for (const Study& run : runs)
      if (run.nodes == g.nodes && run.density == g.density) members.push_back(&run);
    const auto count = static_cast<double>(members.size());
    for (const Study* run : members) {
      g.points += static_cast<double>(run->measured.points) / count;
      g.spacing += run->measured.spacing_mm / count;
      g.rim += run->measured.rim_spacing_mm / count;
      g.evaluations += static_cast<double>(run->measured.history.steps) / count;
      g.seconds += (run->measured.build_s + run->measured.solve_s) / count;
      g.worst_kink = std::max(g.worst_kink, kink(run->force));
    }
    for (std::size_t k = 0; k < levels; ++k) {
      double sum = 0.0, low = std::numeric_limits<double>::infinity(), high = -low;
      for (const Study* run : members) {
        sum += run->force[k] / count;
        low = std::min(low, run->force[k]);
        high = std::max(high, run->force[k]);
      }
      g.mean.push_back(sum);
      g.scatter.push_back((high - low) / sum);
    }
  }
  return groups;
}

}  // namespace

std::vector<double> reference_at(const fs::path& file, const std::vector<double>& depths) {
  const Table table = read_csv(file);
  const auto* depth = table.find("indentation_mm");
  const auto* force = table.find("force_N");
  if (!depth || !force)
    throw InputError({.fact = "there is no column indentation_mm or force_N",
                      .where = file.string(),
                      .why = "a reference is a force at each of several depths",
                      .remedy = "name the columns indentation_mm,force_N"});
  std::vector<double> result;
  for (const double d : depths) {
    const auto at =
        std::find_if(depth->begin(), depth->end(), [&](double x) { return std::abs(x - d) < 1e-6; });
    if (at == depth->end())
      throw InputError({.fact = fmt::format("the reference has no force at {:.4g} mm", d),
                        .where = file.string(),
                        .why = "the study compares at each frame's depth",
                        .remedy = "choose --depth and --frames so that every frame has a row there"});
    result.push_back((*force)[static_cast<std::size_t>(at - depth->begin())]);
  }
  return result;
}

std::vector<double> forces_at(const std::vector<ForceSample>& samples, const std::vector<double>& depths_mm) {
  std::vector<double> result;
  for (const double mm : depths_mm) {
    const double depth = 1e-3 * mm;
    const auto after = std::find_if(samples.begin(), samples.end(),
                                    [&](const ForceSample& s) { return s.depth >= depth * (1.0 - 1e-9); });
    if (after == samples.end()) break;
    if (after == samples.begin()) {
      result.push_back(after->force);
      continue;
    }
    const ForceSample& before = *std::prev(after);
    const double share = (depth - before.depth) / (after->depth - before.depth);
    result.push_back(before.force + std::min(share, 1.0) * (after->force - before.force));
  }
  return result;
}

Outcome converge(const Config& config, const ConvergenceOptions& options, const fs::path& folder,
                 const std::function<void(const std::string&)>& progress) {
  if (options.nodes.size() < 2 || options.densities.empty() || options.seeds < 1)
    throw UsageError({.fact = "a study needs at least two cloud sizes, one density and one seed",
                      .where = "--sizes, --densities, --seeds",
                      .why = "convergence is a comparison",
                      .remedy = "for instance --sizes 1000,2000,4000"});
  check_result_folder(folder);
  std::optional<FolderLock> lock;
  if (fs::is_directory(folder)) lock.emplace(folder);
  std::vector<double> depths;
  for (int k = 1; k <= config.solver.frames; ++k)
    depths.push_back(config.load.depth_mm * k / static_cast<double>(config.solver.frames));
  std::vector<double> reference;
  if (!options.reference.empty()) reference = reference_at(options.reference, depths);

  Table table{.header = {"nodes", "points", "density", "seed", "spacing_mm", "rim_spacing_mm",
                         "indentation_mm", "force_N", "evaluations", "wall_s"},
              .column = {}};
  if (!reference.empty()) table.header.push_back("reference_N");
  table.column.resize(table.header.size());
  std::vector<Study> runs;
  std::string ended_by;
  for (const Index nodes : options.nodes)
    for (const double density : options.densities)
      for (int seed = 0; seed < options.seeds && ended_by.empty(); ++seed) try {
          Config own = config;
          own.cloud.nodes = nodes;
          own.cloud.spacing_mm = 0.0;
          own.cloud.seed = config.cloud.seed + seed;
          own.grid.points = 0;
          own.grid.ratio = model_options(config).grid.ratio * density;
          const Measured m = measure(own);
          if (runs.empty()) {  // image and options have proved good
            make_folder(folder);
            if (!lock) lock.emplace(folder);
            remove_temporaries_in(folder);
            remove_word(folder);
          }
          const std::vector<double> force = forces_at(m.history.force, depths);
          runs.push_back({nodes, density, own.cloud.seed, m, force});
          for (std::size_t k = 0; k < depths.size(); ++k) {
            std::vector<double> row = {static_cast<double>(m.nodes),
                                       static_cast<double>(m.points),
                                       density,
                                       static_cast<double>(own.cloud.seed),
                                       m.spacing_mm,
                                       m.rim_spacing_mm,
                                       depths[k],
                                       force[k],
                                       static_cast<double>(m.history.steps),
                                       m.build_s + m.solve_s};
            if (!reference.empty()) row.push_back(reference[k]);
            for (std::size_t c = 0; c < row.size(); ++c) table.column[c].push_back(row[c]);
          }
          write_csv(folder / "convergence.csv", table);  // after every run: a long study may be stopped
          progress(fmt::format("{:>6} nodes, {:>7} points, seed {}: {} at {:.3g} mm, {:.1f} s", m.nodes,
                               m.points, own.cloud.seed, with_a_digit_more(force.back()), depths.back(),
                               m.build_s + m.solve_s));
        } catch (const Stopped& stopped) {
          if (runs.empty()) throw;  // nothing to keep
          ended_by = fmt::format("{}; convergence.csv has the {} runs until then [{}]", stopped.report.fact,
                                 runs.size(), stopped.report.code);
        }
  for (const std::string& warning : distinct_warnings(runs)) progress("warning: " + warning);
  if (!ended_by.empty())
    return {.summary_json = Json({{"status", "interrupted"}, {"runs", runs.size()}}).dump() + "\n",
            .headline = fmt::format("{} runs", runs.size()),
            .interrupted = true,
            .ended_by = ended_by};

  const std::vector<Group> groups = grouped(runs, depths.size());
  const auto partner = [&](const Group& g) -> const Group* {
    for (const Group& other : groups)
      if (other.nodes == g.nodes && std::abs(other.density - 2.0 * g.density) < 1e-9) return &other;
    return nullptr;
  };
  const Group& finest = groups.back();
  const std::vector<double>& against = reference.empty() ? finest.mean : reference;
  std::string text = fmt::format(
      "| nodes | points | spacing far / rim mm | difference from {} at {} mm, % | seeds scatter %, at most | "
      "doubling the "
      "points, %, at most | kink %, at most | evaluations | s |\n|---|---|---|---|---|---|---|---|---|\n",
      reference.empty() ? "the finest" : "the reference", fmt::join(depths, ", "));
  double worst_scatter = 0.0;
  for (const Group& g : groups) {
    std::vector<std::string> errors;
    double scatter = 0.0, doubling = 0.0;
    for (std::size_t k = 0; k < depths.size(); ++k) {
      errors.push_back(fmt::format("{:+.2f}", 100.0 * (g.mean[k] / against[k] - 1.0)));
      scatter = std::max(scatter, 100.0 * g.scatter[k]);
      if (const Group* twice = partner(g))
        doubling = std::max(doubling, std::abs(100.0 * (twice->mean[k] / g.mean[k] - 1.0)));
    }
    worst_scatter = std::max(worst_scatter, scatter);
    text += fmt::format("| {} | {:.0f} | {:.2f} / {:.2f} | {} | {:.2f} | {} | {:.2f} | {:.0f} | {:.1f} |\n",
                        g.nodes, g.points, g.spacing, g.rim, fmt::join(errors, " "), scatter,
                        partner(g) ? fmt::format("{:.2f}", doubling) : "", 100.0 * g.worst_kink,
                        g.evaluations, g.seconds);
  }
  write_file(folder / "convergence.md", text);

  Chart errors{
      .title = fmt::format("{}: convergence", fs::path(config.image.file).filename().string()),
      .subtitle = {fmt::format("force against {}, mean of {} seeds",
                               reference.empty() ? "the finest cloud" : "the reference", options.seeds)},
      .x_label = "nodes",
      .y_label = "difference in force [%]",
      .log_x = true};
  Chart curves{
      .title = "force curves", .subtitle = {}, .x_label = "indentation [mm]", .y_label = "force [N]"};
  int colour = 0;
  for (const std::size_t k :
       {std::size_t{0}, depths.size() / 2 - (depths.size() > 1 ? 1 : 0), depths.size() - 1}) {
    for (const double density : options.densities) {
      ChartSeries series{.name = fmt::format("{:.3g} mm, {:.3g} points per node", depths[k],
                                             density * model_options(config).grid.ratio),
                         .x = {},
                         .y = {},
                         .label = {}};
      for (const Group& g : groups)
        if (g.density == density) {
          series.x.push_back(static_cast<double>(g.nodes));
          series.y.push_back(100.0 * (g.mean[k] / against[k] - 1.0));
        }
      series.colour = colour;
      series.dashed = series.hollow = density != options.densities.front();
      errors.series.push_back(series);
    }
    ++colour;
  }
  for (const double at : {-2.0, 2.0}) errors.lines.push_back({.vertical = false, .at = at, .text = "2 %"});
  for (const Group& g : groups)
    if (g.density == options.densities.front())
      curves.series.push_back(
          {.name = fmt::format("{} nodes", g.nodes), .x = depths, .y = g.mean, .label = {}});
  if (!reference.empty())
    curves.series.push_back({.name = "reference", .x = depths, .y = reference, .label = {}, .line = false});
  write_chart_png(folder / "convergence.png", {errors, curves});
  write_chart_svg(folder / "convergence.svg", {errors, curves});

  Outcome outcome;
  const double estimate = 100.0 * std::abs(groups.front().mean.back() / finest.mean.back() - 1.0);
  outcome.headline =
      fmt::format("{}finest {} at {:.3g} mm; coarsest differs by {:.2f} %, seeds by at most {:.2f} %", text,
                  with_a_digit_more(finest.mean.back()), depths.back(), estimate, worst_scatter);
  outcome.summary_json = Json({{"status", "finished"},
                               {"force_N", finest.mean.back()},
                               {"indentation_mm", depths.back()},
                               {"largest_scatter", worst_scatter / 100.0},
                               {"warnings", distinct_warnings(runs)}})
                             .dump(2, ' ', false, Json::error_handler_t::replace) +
                         "\n";
  return outcome;
}

}  // namespace dimple
