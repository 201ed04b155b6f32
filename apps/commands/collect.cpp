#include "apps/studies/collect.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "apps/commands/all_commands.hpp"
#include "apps/commands/log.hpp"
#include "apps/commands/terminal.hpp"
#include "apps/run/checkpoint.hpp"
#include "apps/studies/cohort.hpp"
#include "io/file.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

struct CollectArguments {
  std::string folder, table, page, bids, cases;
  std::vector<std::string> depths;
};

std::vector<double> depths_in(const std::vector<std::string>& words) {
  std::vector<double> depths;
  for (const std::string& word : words) {
    double depth = 0.0;
    const std::string flag = "--depths";
    set_value({.key = flag,
               .flag = flag,
               .unit = "mm",
               .value = &depth,
               .most = 1000,
               .least_excluded = true,
               .help = "depth at which to report the force"},
              word, flag);
    if (std::find(depths.begin(), depths.end(), depth) == depths.end()) depths.push_back(depth);
  }
  return depths;
}

// Marks a row that was changed after its run, as the numbers in the folder do not belong to it.
void mark_changed(const Cohort& cohort, const fs::path& folder, std::vector<CollectedCase>& cases) {
  for (std::size_t row = 0; row < cohort.size(); ++row)
    for (CollectedCase& one : cases) {
      if (one.id != cohort.id(row) || one.status != "finished") continue;
      const std::string change = changed_since(cohort, row, folder / one.id);
      if (change.empty()) continue;
      one.status = "changed";
      one.code = other_run;
      one.fact = "the run in that folder differs: " + change;
      one.remedy = "run the batch with --force, or give the table that it was run with";
      warn(fmt::format("{}: {}", one.id, one.fact));
    }
}

int perform(const Invocation& shared, const CollectArguments& options) {
  const std::vector<double> depths = depths_in(options.depths);
  std::vector<std::string> expected;
  Cohort cohort;
  if (!options.cases.empty()) cohort = read_cohort(options.cases);
  for (std::size_t row = 0; row < cohort.size(); ++row) expected.push_back(cohort.id(row));
  const fs::path folder = options.folder;
  const fs::path page = options.page.empty() ? folder / "index.html" : fs::path(options.page);
  if (!shared.out.empty()) try_file(shared.out);
  if (!options.page.empty() || fs::is_directory(folder)) try_file(page);
  if (!options.bids.empty()) try_folder(options.bids);
  std::vector<CollectedCase> cases = collect(folder, depths, expected);
  mark_changed(cohort, folder, cases);
  const std::string table = to_csv(table_of(cases, depths));
  if (!options.bids.empty()) {
    const std::size_t count = write_bids(cases, folder, options.bids);
    say(fmt::format("bids     {} cases with a force, in {}", count, options.bids));
  }
  const fs::path relative = fs::absolute(folder).lexically_normal().lexically_relative(
      fs::absolute(page).lexically_normal().parent_path());
  write_file(page, page_of(cases, relative == "." ? "" : (relative / "").string()));
  const auto finished = std::count_if(cases.begin(), cases.end(),
                                      [](const CollectedCase& c) { return c.status == "finished"; });
  say(fmt::format("page     {}: {} cases, {} finished", page.string(), cases.size(), finished));
  if (shared.out.empty())
    print(table);
  else
    write_file(shared.out, table);
  return 0;
}

}  // namespace

Command add_collect(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<CollectArguments>();
  CLI::App* command = add_to(app, whole::collect);
  command->add_option("FOLDER", options->folder, "written by `dimple batch -o`")->required();
  command->add_option("-o,--out,--output", shared.out, "CSV file for the table [printed]");
  command
      ->add_option("--depths", options->depths,
                   "further depths at which to report the force, for instance 2mm,4mm")
      ->delimiter(',');
  command->add_option("--cases", options->cases,
                      "the batch's CSV: cases not run, or changed since, are marked");
  command->add_option("--page", options->page, "HTML page with a picture a case [index.html in the folder]");
  command->add_option("--bids", options->bids,
                      "folder for copies of the force curves and pictures, named as BIDS derivatives");
  command->add_flag("-q,--quiet", shared.quiet, "errors only");
  add_time_limit(*command, shared);
  return {command, [&shared, options] { return perform(shared, *options); }};
}

}  // namespace dimple
