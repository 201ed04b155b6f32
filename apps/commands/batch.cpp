#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/info.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "apps/commands/all_commands.hpp"
#include "apps/commands/log.hpp"
#include "apps/commands/terminal.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/summary.hpp"
#include "apps/studies/cohort.hpp"
#include "io/stop.hpp"
#include "io/text.hpp"

namespace dimple {
namespace {

using How = CaseEnd::How;

struct BatchArguments {
  Flags flags;
  std::string cases, id;
  std::size_t index = 0, jobs = 0;
};

std::size_t count(const std::vector<CaseEnd>& ends, How how) {
  return static_cast<std::size_t>(
      std::count_if(ends.begin(), ends.end(), [&](const CaseEnd& e) { return e.how == how; }));
}

void print_table(const Cohort& cohort, const std::vector<CaseEnd>& ends, double seconds,
                 const std::string& out) {
  print(fmt::format("{} finished, {} skipped, {} failed", count(ends, How::finished),
                    count(ends, How::skipped), count(ends, How::failed)));
  if (const std::size_t left = count(ends, How::interrupted) + count(ends, How::not_begun); left > 0)
    print(fmt::format(", {} left to do", left));
  print(fmt::format(" of {} cases in {:.1f} s\t{}\n", ends.size(), seconds, printable(out)));
  std::size_t widest = 0;
  for (std::size_t row = 0; row < ends.size(); ++row)
    if (ends[row].how == How::failed) widest = std::max(widest, cohort.id(row).size());
  for (std::size_t row = 0; row < ends.size(); ++row) {
    const CaseEnd& end = ends[row];
    if (end.how != How::failed) continue;
    print(fmt::format("  row {:>{}}  {:<{}}  {} [{}]\n", row + 1, std::to_string(ends.size()).size(),
                      cohort.id(row), widest, printable(end.reason.fact), printable(end.reason.code)));
    print(fmt::format("  {:>{}}  try: {}\n", "", 4 + std::to_string(ends.size()).size() + 2 + widest,
                      printable(end.reason.remedy)));
  }
}

void print_ends(const Cohort& cohort, const std::vector<CaseEnd>& ends, double seconds) {
  const auto left = [&](How how) {
    Json list = Json::array();
    for (std::size_t row = 0; row < ends.size(); ++row)
      if (ends[row].how == how) list.push_back(cohort.id(row));
    return list;
  };
  Json out = {{"cases", ends.size()}, {"seconds", seconds}};
  for (const auto& [name, how] : {std::pair{"finished", How::finished}, std::pair{"skipped", How::skipped}})
    out[name] = left(how);
  out["failed"] = Json::array();
  for (std::size_t row = 0; row < ends.size(); ++row)
    if (const CaseEnd& end = ends[row]; end.how == How::failed) {
      Json failure = {{"row", row + 1}, {"id", cohort.id(row)}, {"exit_code", static_cast<int>(end.code)}};
      failure.update(report_json(end.reason));
      out["failed"].push_back(std::move(failure));
    }
  for (const auto& [name, how] :
       {std::pair{"interrupted", How::interrupted}, std::pair{"not_begun", How::not_begun}})
    out[name] = left(how);
  print_json(as_text(out));
}

// Number of the row with that id, from 1.
std::size_t index_of(const Cohort& cohort, const std::string& id) {
  std::vector<std::string> known;
  for (std::size_t row = 0; row < cohort.size(); ++row) {
    if (cohort.id(row) == id) return row + 1;
    known.push_back(cohort.id(row));
  }
  throw UsageError({.fact = fmt::format("the table has no case '{}'{}", id, did_you_mean(id, known)),
                    .where = "--id",
                    .why = "none of its rows has that id",
                    .remedy = fmt::format("give an id of {}", cohort.file.string())});
}

int run_one(const Cohort& cohort, const Description& of_all_rows, Invocation& shared, std::size_t index) {
  if (index > cohort.size())
    throw UsageError({.fact = fmt::format("row {} is requested, and the table has {}", index, cohort.size()),
                      .where = "--index",
                      .why = "rows are counted from 1, without the header",
                      .remedy = fmt::format("give a number from 1 to {}", cohort.size())});
  const std::filesystem::path out = shared.out;
  shared.out = (out / cohort.id(index - 1)).string();
  into_folder(shared, image_of(cohort, index - 1));
  return finish(shared, run_case(cohort, index - 1, of_all_rows, out, shared.force, to_log()));
}

int run_all(const Cohort& cohort, const Description& of_all_rows, const Invocation& shared,
            std::size_t jobs) {
  const Stopwatch whole;
  const int threads = std::max(1, shared.threads);
  const auto cores = static_cast<std::size_t>(tbb::info::default_concurrency());  // that this process may use
  CohortOptions options{
      .jobs = jobs > 0 ? jobs : std::max<std::size_t>(1, cores / static_cast<std::size_t>(threads)),
      .rerun = shared.force,
      .program = {std::filesystem::read_symlink("/proc/self/exe").string()}};
  options.program.insert(options.program.end(), shared.words.begin(), shared.words.end());
  options.program.push_back("--index");
  const std::vector<CaseEnd> ends = run_cohort(cohort, of_all_rows, shared.out, options, progress_of(shared));
  if (shared.json)
    print_ends(cohort, ends, whole.seconds());
  else
    print_table(cohort, ends, whole.seconds(), shared.out);
  if (const StopReason why = stop_requested(); why != StopReason::none) {
    print_error(fmt::format("dimple: {}; the same command continues from there [{}]\n",
                            Stopped(why).report.fact, Stopped(why).report.code));
    return static_cast<int>(ExitCode::interrupted);
  }
  for (const CaseEnd& end : ends)
    if (end.how == How::failed) return static_cast<int>(end.code);
  return 0;
}

}  // namespace

Command add_batch(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<BatchArguments>();
  CLI::App* command = add_to(app, whole::batch);
  command
      ->add_option("CASES", options->cases,
                   "CSV with the columns id, image, and any option (mu_Pa, label, indent_at, ...); other "
                   "options given "
                   "here are of all rows")
      ->required();
  command->add_option("-o,--out,--output", shared.out, "folder for the results: a folder in it for each id")
      ->required();
  command->add_flag("--force", shared.force,
                    "replace results of other options or another image; results of the same are kept");
  command
      ->add_option("--index", options->index,
                   "only this row, the first is 1, in this process: for array jobs of a cluster")
      ->check(CLI::Range(std::size_t{1}, std::size_t{1000000000}));
  command->add_option("--id", options->id, "only the row with this id: for workflow managers")
      ->excludes("--index");
  command->add_option("--jobs", options->jobs, "rows at once [as many as threads allow on the cores]")
      ->check(CLI::Range(1, 256));
  options->flags.add(*command, "run");
  add_common(*command, shared);
  command->get_option("--threads")->description("of each row; results do not depend on it [1]");
  return {command, [&shared, command, options] {
            const Description of_all_rows = options->flags.stated(*command);
            const Cohort cohort = read_cohort(options->cases);
            const std::size_t index = options->id.empty() ? options->index : index_of(cohort, options->id);
            if (index == 0) return run_all(cohort, of_all_rows, shared, options->jobs);
            std::optional<tbb::global_control> limit;
            if (shared.threads == 0) limit.emplace(tbb::global_control::max_allowed_parallelism, 1);
            return run_one(cohort, of_all_rows, shared, index);
          }};
}

}  // namespace dimple
