// Results of the program compared with closed forms and other methods.
//
//   dimple_verify [RESULTS] [--case NAME]... [--nodes 4250]
//
// Prints the table; RESULTS gets verify.csv. The exit code is that of a failed solution if a row differs from
// its reference by more than its tolerance.

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "io/error.hpp"
#include "io/file.hpp"
#include "tests/verification/verify.hpp"

int main(int argc, char** argv) try {
  std::filesystem::path folder;
  std::vector<std::string> cases;
  bool list = false;
  dimple::Index nodes = 4250;
  CLI::App app("Numbers of ours beside those that are known");
  app.add_option("RESULTS", folder, "folder for verify.csv");
  app.add_option("--case", cases, "only this one; may be given several times")->allow_extra_args(false);
  app.add_flag("--list", list, "list the cases and stop");
  app.add_option("--nodes", nodes, "of the indented bodies")
      ->check(CLI::Range(200, 1000000))
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  if (list) {
    for (const dimple::VerifyGroup& group : dimple::verify_groups())
      fmt::print("{:<16} {}\n", group.name, group.what);
    return 0;
  }
  if (!folder.empty()) dimple::try_folder(folder);
  const auto rows = dimple::verify(cases, nodes);
  if (!folder.empty()) {
    dimple::make_folder(folder);
    dimple::write_file(folder / "verify.csv", dimple::verify_csv(rows));
  }
  fmt::print("{}", dimple::verify_markdown(rows));
  dimple::require_passed(rows);
  return 0;
} catch (const dimple::Error& error) {
  fmt::print(stderr, "{}\n  {}\n  {}\n", error.report.fact, error.report.where, error.report.remedy);
  return static_cast<int>(error.code);
}
