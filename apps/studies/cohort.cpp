#include "apps/studies/cohort.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstring>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

#include "apps/run/checkpoint.hpp"
#include "apps/run/compare.hpp"
#include "apps/run/model_options.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/result_folder.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/scene/resolve.hpp"
#include "apps/studies/read_results.hpp"
#include "apps/studies/run_program.hpp"
#include "io/file.hpp"
#include "io/label_names.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::size_t longest_id = 200;  // file systems allow 255 bytes, including ".log"

std::string line_of(const Cohort& cohort, std::size_t row) {
  return fmt::format("{}, line {}", cohort.file.string(), cohort.table.row[row].line);
}

// Reason why a folder cannot have that name on every system; empty if it can.
std::string why_no_id(const std::string& id) {
  if (id.empty()) return "it is empty";
  if (id.size() > longest_id) return fmt::format("it is longer than {} bytes", longest_id);
  if (id.front() == '.' || id.front() == '-') return "it begins with a dot or a hyphen";
  if (id.back() == '.' || id.back() == ' ') return "it ends with a dot or a blank";
  for (const char c : id)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) return "it holds a control character";
  if (const auto at = id.find_first_of("/\\:*?\"<>|"); at != std::string::npos)
    return fmt::format("it holds '{}'", id[at]);
  for (const char* ending : {".log", ".csv", ".html", ".json"})  // of files next to the folders
    if (id.ends_with(ending)) return fmt::format("it ends with '{}' as a file does", ending);
  try {
    [[maybe_unused]] const std::string text = Json(id).dump();  // throws if it is not UTF-8
  } catch (const Json::exception&) {
    return "it is not UTF-8: save the table with that encoding";
  }
  return {};
}

void require_ids(const Cohort& cohort) {
  std::map<std::string, std::size_t> first;
  for (std::size_t row = 0; row < cohort.size(); ++row) {
    const std::string& id = cohort.id(row);
    if (const std::string why = why_no_id(id); !why.empty())
      throw InputError({.fact = fmt::format("'{}' cannot be the id of a case", id),
                        .where = line_of(cohort, row),
                        .why = "it names a folder, and " + why,
                        .remedy = "use letters, digits, - and _"});
    // Some file systems do not distinguish A and a.
    std::string small = id;
    std::transform(small.begin(), small.end(), small.begin(),
                   [](unsigned char c) { return c < 0x80 ? std::tolower(c) : c; });
    const auto [other, is_new] = first.emplace(small, row);
    if (!is_new)
      throw InputError({.fact = fmt::format("the id '{}' is there twice", id),
                        .where = fmt::format("{}, and line {}", line_of(cohort, row),
                                             cohort.table.row[other->second].line),
                        .why = "it names a folder, and two cases would have the same one",
                        .remedy = "give each case an id of its own; ids must differ in more than capitals"});
  }
}

// Path in a row, relative to the table.
std::string next_to(const Cohort& cohort, const std::string& key, const std::string& text) {
  const fs::path path = cohort.file.parent_path() / text;
  const bool is_word = key == "output.compare"      ? text == paper_word
                       : key == "image.label_names" ? !fs::exists(path) && known_label_names(text)
                                                    : key != "image.file" && key != "load.poses";
  return is_word ? text : path.string();
}

// Result of an earlier finished run; nothing if there is none. Throws UsageError: the folder has another run.
std::optional<Outcome> finished_before(const Description& described, const fs::path& folder) {
  std::error_code ignored;
  if (!fs::is_directory(folder, ignored)) return std::nullopt;
  if (const ResultFolder results(folder, Existing::resume); !results.finished()) return std::nullopt;
  return record_run(described, folder, Existing::resume);
}

// Refuses both moduli in one row, also if one of them is the default.
void require_one_modulus(const Cohort& cohort, std::size_t row, const Description& described) {
  const TextTable::Row& fields = cohort.table.row[row];
  const auto says = [&](const char* key) {
    for (std::size_t c = 0; c < cohort.key.size(); ++c)
      if (cohort.key[c] == key) return !fields.field[c].empty();
    return false;
  };
  const double mu_Pa = std::get<double>(value_of(described, "material.mu_Pa")),
               young_Pa = std::get<double>(value_of(described, "material.young_Pa"));
  if (!says("material.mu_Pa") || !says("material.young_Pa") || young_Pa == 0.0) return;
  throw UsageError({.fact = fmt::format("both a shear modulus, {} Pa, and Young's modulus, {} Pa, are given",
                                        mu_Pa, young_Pa),
                    .where = line_of(cohort, row),
                    .why = "one follows from the other: mu = E / (2 (1 + nu))",
                    .remedy = "leave one of the two fields empty"});
}

bool is_other_run(const Error& error) {
  return error.report.code == other_run;
}

// Records why a case failed, unless the folder holds other files; a crashed run leaves no summary. Never
// throws: the program ends with that failure anyway.
void write_failure(const Cohort& cohort, std::size_t row, const fs::path& folder, const Error& error,
                   bool died = false) noexcept try {
  std::error_code ignored;
  const bool is_free =
      !fs::exists(folder, ignored) || fs::is_empty(folder, ignored) || holds_only_a_word(folder);
  if (!is_free && !(died && !fs::exists(folder / "summary.json", ignored))) return;
  write_word(folder, "batch", image_of(cohort, row), error, {});
} catch (...) {
}

Error crashed(int signal, const fs::path& log) {
  const bool killed = signal == SIGKILL;
  return {
      killed ? ExitCode::model : ExitCode::internal,
      {.fact = fmt::format("the process of this case was ended by signal {} ({})", signal, strsignal(signal)),
       .where = log.string(),
       .why = killed ? "it was killed, possibly by the system for lack of memory"
                     : "this is an error in the program",
       .remedy = killed ? "start the batch again; with fewer --jobs or --nodes if memory is short"
                        : "please report it with the command and the image that you used",
       .code = "crashed"}};
}

// Error of a process that ended with that code, from its messages.
Error failure_of(int code, const fs::path& folder, const fs::path& log) {
  const auto exit_code = static_cast<ExitCode>(code);
  if (const auto failure = failure_in(folder, code)) return {exit_code, *failure};
  Report report{.fact = fmt::format("the process of this case ended with code {}", code),
                .where = log.string(),
                .why = "its last output is there",
                .remedy = "read them"};
  try {
    std::istringstream lines(read_file(log));
    const std::map<std::string, std::string*> parts = {{"dimple: ", &report.fact},
                                                       {"  where: ", &report.where},
                                                       {"  why:   ", &report.why},
                                                       {"  try:   ", &report.remedy},
                                                       {"  code:  ", &report.code}};
    for (std::string line; std::getline(lines, line);)
      for (const auto& [begin, part] : parts)
        if (line.starts_with(begin)) *part = line.substr(begin.size());
  } catch (const Error&) {
  }
  return {exit_code, report};
}

// Runs one row in its own process.
CaseEnd run_apart(const Cohort& cohort, std::size_t row, const Description& of_all_rows, const fs::path& out,
                  const CohortOptions& options) {
  using How = CaseEnd::How;
  const Stopwatch whole;
  const fs::path folder = out / cohort.id(row), log = fs::absolute(out / (cohort.id(row) + ".log"));
  const Description described = case_of(cohort, row, of_all_rows);
  try {
    if (const auto before = finished_before(described, folder))
      return {.how = How::skipped, .headline = before->headline};
  } catch (const UsageError& error) {
    if (!options.rerun || !is_other_run(error)) throw;
  }
  std::vector<std::string> words = options.program;
  words.push_back(std::to_string(row + 1));
  constexpr double grace_s = 0.9;  // less than the whole program has to end
  const ProgramRun run = run_program(
      words, fs::current_path(), log.string(), [] { return stop_requested() != StopReason::none; }, grace_s);
  CaseEnd end{.seconds = whole.seconds()};
  std::error_code ignored;
  if (run.code == 0) {
    const auto done = finished_before(described, folder);
    end.how = How::finished;
    end.headline = done ? done->headline : "";
    fs::remove(log, ignored);
    return end;
  }
  if (run.interrupted || run.code == static_cast<int>(ExitCode::interrupted)) {
    end.how = How::interrupted;
    end.code = ExitCode::interrupted;
    fs::remove(log, ignored);
    return end;
  }
  if (run.code < 128) throw failure_of(run.code, folder, log);
  const Error error = crashed(run.code - 128, log);
  write_failure(cohort, row, folder, error, true);
  throw error;
}

}  // namespace

Cohort read_cohort(const fs::path& file) {
  require_regular_file(file);
  Cohort cohort{.file = file, .table = read_text_csv(file), .key = {}};
  const std::vector<std::string>& header = cohort.table.header;
  bool has_id = false, has_image = false;
  for (std::size_t c = 0; c < header.size(); ++c) {
    const std::string where = fmt::format("{}, column '{}'", file.string(), header[c]);
    std::string key = header[c] == "id" ? "id" : header[c] == "image" ? "image.file" : "";
    if (key.empty()) key = option_named(header[c], where, {"id", "image"});
    if (std::find(cohort.key.begin(), cohort.key.end(), key) != cohort.key.end())
      throw UsageError({.fact = fmt::format("two columns give {}", key),
                        .where = where,
                        .why = "a case has one value of it",
                        .remedy = "remove one of them"});
    if (key == "id") cohort.id_column = c, has_id = true;
    has_image = has_image || key == "image.file";
    cohort.key.push_back(key);
  }
  if (!has_id || !has_image)
    throw InputError({.fact = fmt::format("the table has no column {}", has_id ? "image" : "id"),
                      .where = file.string(),
                      .why = "each case has an id, which names its folder, and an image",
                      .remedy = "head the columns id,image and the options that differ"});
  if (cohort.size() == 0)
    throw InputError({.fact = "the table has no rows",
                      .where = file.string(),
                      .why = "there is nothing to run",
                      .remedy = "write a row for each case below the header"});
  require_ids(cohort);
  return cohort;
}

std::string image_of(const Cohort& cohort, std::size_t row) {
  for (std::size_t c = 0; c < cohort.key.size(); ++c)
    if (const std::string& text = cohort.table.row[row].field[c];
        cohort.key[c] == "image.file" && !text.empty())
      return next_to(cohort, cohort.key[c], text);
  return {};
}

Description case_of(const Cohort& cohort, std::size_t row, Description described) {
  const std::string line = line_of(cohort, row);
  const TextTable::Row& fields = cohort.table.row[row];
  complete_for_all_cases(described);  // the row's values take precedence
  for (std::size_t c = 0; c < cohort.key.size(); ++c)
    if (const std::string& key = cohort.key[c]; key != "id" && !fields.field[c].empty())
      set_option(described, key, next_to(cohort, key, fields.field[c]), line);
  require_one_modulus(cohort, row, described);
  complete(described);
  if (image_file(described).empty())
    throw InputError({.fact = "the case has no image",
                      .where = line,
                      .why = "the field is empty",
                      .remedy = "write the path of its label image there"});
  require_regular_file(image_file(described));
  const Scene scene = resolve(described);
  check_pairs(scene, Feature::run);
  check_words(model_options(scene).boundary);
  if (!scene.output.compare.empty() && scene.output.compare != paper_word)
    read_measured_curve(scene.output.compare);
  return described;
}

std::string changed_since(const Cohort& cohort, std::size_t row, const fs::path& folder) try {
  Description before;
  read_config(before, folder / "config.resolved.toml");
  const Description now = case_of(cohort, row, before);
  if (fs::path(image_file(now)).filename() != fs::path(image_file(before)).filename())
    return fmt::format("image is {} now, and was {}", image_file(now), image_file(before));
  const std::map<std::string, std::string> was = option_values(before);
  const std::set<std::string> paths = {"output.compare", "image.label_names",
                                       "load.poses"};  // begin elsewhere
  for (const auto& [key, value] : option_values(now))
    if (const auto found = was.find(key);
        !paths.contains(key) && (found == was.end() || found->second != value))
      return fmt::format("{} is {} now, and was {}", key, value,
                         found == was.end() ? "not set" : found->second);
  return {};
} catch (const Stopped&) {
  throw;
} catch (const Error&) {
  return {};
}

Outcome run_case(const Cohort& cohort, std::size_t row, const Description& of_all_rows, const fs::path& out,
                 bool rerun, const RecordObserver& observer) {
  const fs::path folder = out / cohort.id(row);
  try {
    const Description described = case_of(cohort, row, of_all_rows);
    if (!rerun) return record_run(described, folder, Existing::resume, observer);
    try {
      if (const auto before = finished_before(described, folder)) return *before;
    } catch (const UsageError& error) {
      if (!is_other_run(error)) throw;
    }
    return record_run(described, folder, Existing::replace, observer);
  } catch (const Stopped&) {
    throw;
  } catch (const Error& error) {
    write_failure(cohort, row, folder, error);
    throw;
  }
}

std::vector<CaseEnd> run_cohort(const Cohort& cohort, const Description& of_all_rows, const fs::path& out,
                                const CohortOptions& options,
                                const std::function<void(const std::string&)>& progress) {
  using How = CaseEnd::How;
  try_folder(out);
  make_folder(out);
  std::vector<CaseEnd> ends(cohort.size());
  std::size_t ended = 0;
  std::mutex reporting;
  const auto report_row = [&](std::size_t row) {
    const std::lock_guard lock(reporting);
    const CaseEnd& end = ends[row];
    const std::string place = fmt::format("{:>5}/{}  {}", ++ended, cohort.size(), cohort.id(row));
    switch (end.how) {
      case How::finished:
        return progress(fmt::format("{}  {}, {:.1f} s", place, end.headline, end.seconds));
      case How::skipped:
        return progress(fmt::format("{}  {}, finished before", place, end.headline));
      case How::failed:
        return progress(fmt::format("{}  failed: {} [{}]", place, end.reason.fact, end.reason.code));
      case How::interrupted:
      case How::not_begun:
        return progress(fmt::format("{}  interrupted", place));
    }
  };
  const auto fail = [&](std::size_t row, const Error& error) {
    ends[row].how = How::failed;
    ends[row].reason = error.report;
    ends[row].code = error.code;
    report_row(row);
  };

  std::vector<std::size_t> able;
  for (std::size_t row = 0; row < cohort.size() && stop_requested() == StopReason::none; ++row) try {
      case_of(cohort, row, of_all_rows);
      able.push_back(row);
    } catch (const Error& error) {
      write_failure(cohort, row, out / cohort.id(row), error);
      fail(row, error);
    }

  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    while (stop_requested() == StopReason::none) {
      const std::size_t k = next++;
      if (k >= able.size()) return;
      const std::size_t row = able[k];
      try {
        ends[row] = run_apart(cohort, row, of_all_rows, out, options);
        report_row(row);
      } catch (const Error& error) {
        fail(row, error);
      } catch (const std::exception& error) {
        fail(row, Error(ExitCode::internal, {.fact = error.what(),
                                             .where = cohort.id(row),
                                             .why = "this is an error in the program",
                                             .remedy = "please report it with the command that you used"}));
      }
    }
  };
  {
    std::vector<std::jthread> workers;
    for (std::size_t k = 0; k < std::min(options.jobs, able.size()); ++k) workers.emplace_back(work);
  }
  return ends;
}

}  // namespace dimple
