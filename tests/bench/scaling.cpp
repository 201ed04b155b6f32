// How run time and memory grow with the number of nodes, on a block of 60 x 60 x 30 mm at 1 mm: whole runs of
// the program, one after the other.
//
//   dimple_scaling build/release/dimple tests/bench/results [NODES ...]
//
// writes scaling.csv, scaling.png, scaling.svg there. Leave the machine alone meanwhile: some five minutes.

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "apps/studies/run_program.hpp"
#include "io/error.hpp"
#include "io/table.hpp"
#include "tests/bench/picture.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
constexpr int threads = 2;

nlohmann::json summary_of(const std::string& dimple, const fs::path& folder, std::vector<std::string> words) {
  fs::remove_all(folder / "out");
  words.insert(words.begin(), {dimple, "run", "block.nrrd", "-o", "out", "-q", "--band", "off", "--threads",
                               std::to_string(threads)});
  const ProgramRun run = run_program(words, folder, "log.txt");
  if (run.code != 0)
    throw std::runtime_error(fmt::format("{} ended with {}", fmt::join(words, " "), run.code));
  nlohmann::json summary;
  std::ifstream(folder / "out" / "summary.json") >> summary;
  return summary;
}

// Of y over x, by least squares of the logarithms.
double exponent(const std::vector<double>& x, const std::vector<double>& y) {
  const auto n = static_cast<double>(x.size());
  double sx = 0.0, sy = 0.0, sxx = 0.0, sxy = 0.0;
  for (std::size_t k = 0; k < x.size(); ++k) {
    const double a = std::log(x[k]), b = std::log(y[k]);
    sx += a;
    sy += b;
    sxx += a * a;
    sxy += a * b;
  }
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

void measure(const std::string& dimple, const fs::path& results, const std::vector<int>& sizes) {
  const fs::path folder = fs::temp_directory_path() / fmt::format("dimple_scaling_{}", getpid());
  fs::create_directories(folder);
  run_program(
      {dimple, "phantom", "block.nrrd", "--shape", "block", "--size", "60,60,30", "--spacing", "1", "-q"},
      folder, "log.txt");
  Table table{.header = {"nodes", "integration_points", "preprocess_s", "quasi_static_s", "evaluations",
                         "peak_MB", "explicit_step_us", "explicit_s_per_s"},
              .column = std::vector<std::vector<double>>(8)};
  for (const int nodes : sizes) {
    const auto still =
        summary_of(dimple, folder, {"--nodes", std::to_string(nodes), "--frames", "2", "--depth", "2mm"});
    double build = 0.0;
    for (const auto& [stage, seconds] : still["preprocess_wall_s"].items())
      if (stage != "read") build += seconds.get<double>();
    rusage children{};
    getrusage(RUSAGE_CHILDREN, &children);  // the largest so far: sizes grow
    const auto moving = summary_of(dimple, folder,
                                   {"--nodes", std::to_string(nodes), "--frames", "1", "--depth", "0.16mm",
                                    "--time", "explicit", "--scheme", "horton2007"});
    const double step = moving["time_step_s"].get<double>();
    const std::vector<double> row = {still["counts"]["nodes"].get<double>(),
                                     still["counts"]["integration_points"].get<double>(),
                                     build,
                                     still["solve_wall_s"].get<double>(),
                                     still["force_evaluations"].get<double>(),
                                     static_cast<double>(children.ru_maxrss) / 1024.0,
                                     1e6 * step,
                                     1e-3 * moving["ms_per_step"].get<double>() / step};
    for (std::size_t c = 0; c < row.size(); ++c) table.column[c].push_back(row[c]);
    fmt::print("{}\n", fmt::join(row, ", "));
    std::fflush(stdout);
  }
  fs::remove_all(folder);
  write_csv(results / "scaling.csv", table);

  const auto& x = table.column[0];
  std::vector<double> whole;
  for (std::size_t k = 0; k < x.size(); ++k) whole.push_back(table.column[2][k] + table.column[3][k]);
  const auto named = [&](const std::string& name, const std::vector<double>& y) {
    return PlotSeries{.name = fmt::format("{}: N^{:.2f}", name, exponent(x, y)), .x = x, .y = y};
  };
  std::vector<std::string> megabytes;
  for (const double m : table.column[5]) megabytes.push_back(fmt::format("{:.0f} MB", m));
  PlotSeries memory = named("peak memory of the run", table.column[5]);
  memory.label = megabytes;
  const std::vector<Plot> panels = {
      {.title = "Wall time over nodes",
       .subtitle = {fmt::format(
           "block, converging: preprocessing and equilibrium at two depths; horton2007: a second "
           "of life; {} threads",
           threads)},
       .x_label = "nodes",
       .y_label = "wall time [s]",
       .log_x = true,
       .log_y = true,
       .series = {named("preprocessing", table.column[2]),
                  named("equilibrium at 1 and 2 mm", table.column[3]), named("both", whole),
                  named("horton2007, a second of central differences", table.column[7])}},
      {.title = "Memory over nodes",
       .subtitle = {"the whole run, converging, quasi-static"},
       .x_label = "nodes",
       .y_label = "peak memory [MB]",
       .log_x = true,
       .log_y = true,
       .series = {memory},
       .lines = {{.at = 2048.0, .text = "2 GB"}}}};
  write_plots(results, "scaling", panels, 2);
}

}  // namespace
}  // namespace dimple

int main(int count, char** argument) {
  if (count < 3) {
    fmt::print(stderr, "usage: dimple_scaling DIMPLE RESULTS [NODES ...]\n");
    return 2;
  }
  std::vector<int> sizes;
  for (int k = 3; k < count; ++k) sizes.push_back(std::atoi(argument[k]));
  if (sizes.empty()) sizes = {2000, 4250, 8500, 17000, 34000, 100000};
  try {
    dimple::measure(std::filesystem::absolute(argument[1]), argument[2], sizes);
  } catch (const dimple::Error& error) {
    fmt::print(stderr, "error: {}: {}\n", error.what(), error.report.where);
    return 1;
  } catch (const std::exception& error) {
    fmt::print(stderr, "error: {}\n", error.what());
    return 1;
  }
}
