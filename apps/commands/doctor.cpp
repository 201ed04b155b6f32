#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/info.h>
#include <unistd.h>

#include <clocale>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "apps/commands/command.hpp"
#include "apps/commands/terminal.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/summary.hpp"
#include "apps/scene/scene.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/memory.hpp"
#include "io/stop.hpp"
#include "io/words.hpp"
#include "preprocess/clones.hpp"
#include "preprocess/image/phantom.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

// Result of a check, printed as one line, with a remedy if it failed.
struct Check {
  bool ok;
  std::string what, found, remedy = {};
  ExitCode code = ExitCode::ok;  ///< exit code if it failed
};

// Folder of temporary files, even if it does not exist.
fs::path temporary_folder() {
  std::error_code error;
  if (const fs::path folder = fs::temp_directory_path(error); !error) return folder;
  for (const char* name : {"TMPDIR", "TMP", "TEMP", "TEMPDIR"})  // order of the library
    if (const char* folder = std::getenv(name)) return folder;
  return "/tmp";
}

// Temporary folder of this process, removed at its end.
struct Scratch {
  fs::path path = temporary_folder() / fmt::format("dimple_doctor_{}", getpid());
  Scratch() { make_folder(path); }
  ~Scratch() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
};

Check check_threads() {
  const auto used = tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism);
  return {true, "threads",
          fmt::format("{} used, {} processors at hand; results do not depend on it", used,
                      tbb::info::default_concurrency())};
}

Check check_simd() {
#if defined(__x86_64__) && !defined(DIMPLE_NO_CLONES)
  return {true, "SIMD",
          __builtin_cpu_supports("avx2") ? "AVX2, supported by this processor"
                                         : "SSE2: this processor has no AVX2, and runs are slower"};
#else
  return {true, "SIMD", "the compiler's default: this build has no AVX2 copies of the hot loops"};
#endif
}

Check check_memory() {
  // Measured in tests/bench/results/scaling.csv: 1.9 GB at 100,000 nodes, 0.15 GB at 2000.
  constexpr double per_node = 18e3, overhead = 0.12e9;
  const double bytes = memory_at_hand(), nodes = std::floor((bytes - overhead) / per_node / 1e3) * 1e3;
  constexpr double enough = 4000.0;
  return {nodes >= enough, "memory",
          fmt::format("{:.1f} GB, enough for about {:.0f} nodes", bytes / 1e9, std::clamp(nodes, 0.0, 1e6)),
          "a run of 4000 nodes may fail for lack of memory: give fewer --nodes, or lift the limit (ulimit "
          "-v, the "
          "container's)",
          ExitCode::model};
}

Check check_writing(const std::string& what, const fs::path& folder, const std::string& remedy) {
  std::error_code error;
  const fs::path absolute = fs::absolute(folder, error);
  const fs::path file = absolute / fmt::format(".dimple_doctor_{}", getpid());
  const bool there = fs::is_directory(absolute, error);
  const bool written = there && static_cast<bool>(std::ofstream(file) << "dimple" << std::flush);
  fs::remove(file, error);
  const fs::space_info space = fs::space(absolute, error);
  return {
      written, what,
      fmt::format("{} {}{}", absolute.string(),
                  !there    ? "is not an existing folder"
                  : written ? "can be written"
                            : "cannot be written",
                  error ? "" : fmt::format(", {:.1f} GB free", static_cast<double>(space.available) / 1e9)),
      remedy, ExitCode::output};
}

Check check_locale() {
  const char* all = std::getenv("LC_ALL");
  const char* lang = std::getenv("LANG");
  return {std::localeconv()->decimal_point == std::string("."), "locale",
          fmt::format("{}; files and numbers are written with a point in every locale",
                      all    ? fmt::format("LC_ALL={}", all)
                      : lang ? fmt::format("LANG={}", lang)
                             : "none set"),
          "unset LC_ALL", ExitCode::internal};
}

// Checks the force on a block against finite elements.
Check check_force() {
  constexpr int depth_mm = 5;
  constexpr double known = 0.0480;                 // [N] there: tests/verification/reference/block.csv
  constexpr double reference_of_600_nodes = 0.08;  // 7.1 % at most at eight depths, tests/bench
  const Stopwatch whole;
  const std::string what = "self test";
  try {
    const Scratch scratch;
    const fs::path image = scratch.path / "block.nrrd";
    write_label_image(image,
                      make_phantom({.shape = "block", .size_mm = {60.0, 60.0, 30.0}, .spacing_mm = 2.0}));
    Scene scene;
    scene.image.file = image.string();
    scene.node_set.nodes = 600;
    scene.given.nodes = true;
    scene.depth_mm = depth_mm;
    scene.solver.frames = depth_mm;
    const Result result = simulate({.scene = scene});
    if (result.history.interrupted) throw Stopped(stop_requested());
    const double force = result.history.force.back().force;
    return {std::abs(force - known) < reference_of_600_nodes * known, what,
            fmt::format("{} under a block indented by {} mm, {} by finite elements; {:.1f} s",
                        force_in_words(force), depth_mm, force_in_words(known), whole.seconds()),
            "the error of the force exceeds that of a coarse model: please report it with this text",
            ExitCode::solve};
  } catch (const Stopped&) {
    throw;
  } catch (const Error& error) {
    return {false, what, error.report.fact, error.report.remedy, error.code};
  }
}

int examine(const fs::path& folder, bool as_json) {
  std::vector<Check> checks = {
      {true, "libraries", DIMPLE_LIBRARIES}, check_threads(), check_simd(), check_memory(), check_locale()};
  checks.push_back(
      check_writing("temporary", temporary_folder(), "set TMPDIR to a folder that can be written"));
  const bool has_room = checks.back().ok;
  checks.push_back(check_writing("output", folder, "give another folder to -o"));
  checks.push_back(has_room ? check_force()
                            : Check{false, "self test", "not made: it needs a folder for temporary files",
                                    "see the line `temporary`", ExitCode::output});
  ExitCode code = ExitCode::ok;
  Json json = {{"version", DIMPLE_VERSION}, {"checks", Json::array()}};
  if (!as_json) print(fmt::format("dimple {}\n", DIMPLE_VERSION));
  for (const Check& check : checks) {
    json["checks"].push_back({{"what", check.what}, {"ok", check.ok}, {"found", check.found}});
    if (!check.ok) json["checks"].back()["remedy"] = check.remedy;
    std::string text = fmt::format("  {:<6} {:<11} {}\n", check.ok ? "ok" : "wrong", check.what, check.found);
    if (!check.ok) text += fmt::format("{:21}try: {}\n", "", check.remedy);
    if (!as_json) print(wrapped(text, 21, terminal_width(STDOUT_FILENO)));
    if (!check.ok && code == ExitCode::ok) code = check.code;
  }
  if (as_json) print_json(as_text(json));
  return static_cast<int>(code);
}

}  // namespace

Command add_doctor(CLI::App& app, Invocation& shared) {
  CLI::App* command =
      app.add_subcommand("doctor", "check the installation: libraries, threads, memory, a known force")
          ->group("About the program");
  command->add_option("-o,--out,--output", shared.out, "folder in which results are to be written [.]");
  add_common(*command, shared);
  return {command, [&shared] { return examine(shared.out.empty() ? "." : shared.out, shared.json); }};
}

}  // namespace dimple
