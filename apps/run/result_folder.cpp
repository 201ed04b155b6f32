#include "apps/run/result_folder.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <mutex>
#include <set>
#include <system_error>
#include <utility>

#include "apps/run/report.hpp"
#include "apps/run/summary.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

bool is_folder_itself(const fs::path& folder) {  // not a link to one
  std::error_code ignored;
  return fs::symlink_status(folder, ignored).type() == fs::file_type::directory;
}

bool is_there(const fs::path& file) {  // or a broken link
  std::error_code ignored;
  return fs::exists(fs::symlink_status(file, ignored));
}

// Folder to which the present run of this process has begun to write.
std::mutex begun_mutex;
fs::path begun;

Json summary_in(const fs::path& folder) try {
  std::error_code ignored;
  if (!fs::is_regular_file(folder / "summary.json", ignored)) return {};
  return Json::parse(read_file(folder / "summary.json", most_bytes_of_text), nullptr, false);
} catch (const Error&) {
  return {};
}

// A summary identifies its own writer: that of a run that failed at once is in no list.
bool is_of_a_run(const Json& summary) {
  return summary.is_object() && summary.contains("status") && summary.contains("version");
}

// A list made by others must not lead out of the folder or through a link.
bool lies_within(const fs::path& folder, const fs::path& name) {
  if (name.empty() || name.is_absolute() || name != name.lexically_normal()) return false;
  fs::path at = folder;
  for (const fs::path& part : name.parent_path())
    if (part == ".." || !is_folder_itself(at /= part)) return false;
  return name.has_filename() && name.filename() != "..";
}

// True for files of the solved model in the folder of the results; of a run's own model also its image.
bool is_of_model(const fs::path& file, const fs::path& model) {
  constexpr std::array names = {"model.toml", "nodes.vtu", "points.vtu", "surface.vtp", "label.vti"};
  if (model.empty() || std::find(names.begin(), names.end(), file.filename()) == names.end()) return false;
  std::error_code ignored;
  return fs::equivalent(file.parent_path(), model, ignored) ||
         (file.filename() == "label.vti" && fs::equivalent(file.parent_path() / "model", model, ignored));
}

// Files that runs have written there, by their list; first summary and checkpoint, which refer to the rest.
std::vector<fs::path> written_before(const fs::path& folder, const fs::path& model) {
  std::set<std::string> names = listed_files(folder).value_or(std::set<std::string>{});
  if (is_of_a_run(summary_in(folder))) names.insert("summary.json");
  std::vector<fs::path> files;
  for (const std::string& name : names)
    if (lies_within(folder, name) && is_there(folder / name) && !is_of_model(folder / name, model))
      files.push_back(folder / name);
  std::stable_partition(files.begin(), files.end(), [](const fs::path& file) {
    return file.filename() == "summary.json" || file.filename() == checkpoint_file;
  });
  return files;
}

std::vector<fs::path> with_folders_in(const fs::path& folder) {
  std::error_code ignored;
  std::vector<fs::path> list = {folder};
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (is_folder_itself(entry)) list.push_back(entry);
  return list;
}

// True if a killed run has left partial files.
bool holds_temporaries(const fs::path& folder) {
  std::error_code ignored;
  const std::vector<fs::path> folders = with_folders_in(folder);
  return std::any_of(folders.begin(), folders.end(), [&](const fs::path& one) {
    return std::any_of(fs::directory_iterator(one, ignored), fs::directory_iterator(),
                       [](const fs::directory_entry& entry) { return is_temporary(entry); });
  });
}

// True if there is no other file except for its list and partial files of a killed run.
bool holds_only(const fs::path& folder, const char* file) {
  std::error_code ignored;
  return std::all_of(fs::directory_iterator(folder, ignored), fs::directory_iterator(),
                     [&](const fs::directory_entry& entry) {
                       const fs::path name = entry.path().filename();
                       return name == file || name == file_list_name || is_temporary(entry);
                     });
}

// True for the summary of a run without results.
bool is_status_file(const Json& summary) {
  if (!summary.is_object() || summary.contains("force_N") || !summary.contains("status")) return false;
  return summary["status"] == "failed" || summary["status"] == "interrupted";
}

// True if the files can be made again in a moment, as a model can.
bool may_overwrite(const fs::path& folder, const std::vector<fs::path>& files) {
  constexpr std::array made_again = {"summary.json", "config.resolved.toml", "label.vti"};
  const auto is_made_again = [&](const fs::path& file) {
    return file.parent_path() == folder / "model" ||
           std::find(made_again.begin(), made_again.end(), file.filename()) != made_again.end();
  };
  return is_status_file(summary_in(folder)) && std::all_of(files.begin(), files.end(), is_made_again);
}

}  // namespace

bool holds_only_a_word(const fs::path& folder) {
  return is_status_file(summary_in(folder)) && holds_only(folder, "summary.json");
}

void end_otherwise(Json& summary, const Error& error) {
  summary["status"] = error.code == ExitCode::interrupted ? "interrupted" : "failed";
  summary["exit_code"] = static_cast<int>(error.code);
  summary["failure"] = report_json(error.report);
}

namespace {

void write_summary(const fs::path& folder, const Json& summary) {
  std::optional<FileList> list;
  if (listed_files(folder)) list.emplace(folder);
  write_file(folder / "summary.json", as_text(summary));
}

// Amends the summary of a finished run if the work after it has failed.
void amend_word(const fs::path& folder, const Error& error) {
  Json summary = summary_in(folder);
  if (!summary.is_object() || summary.value("status", "") != "finished") return;
  end_otherwise(summary, error);
  write_summary(folder, summary);
  amend_report(folder / "report.html", summary, "");
}

}  // namespace

void write_word(const fs::path& folder, const std::string& command, const std::string& image,
                const Error& error, const std::vector<std::string>& warnings) {
  Json word = Json::object();
  word["command"] = command;
  if (!image.empty()) word["image"] = image;
  word["version"] = DIMPLE_VERSION;
  end_otherwise(word, error);
  word["warnings"] = warnings;
  make_folder(folder);
  write_summary(folder, word);
}

void write_status(const fs::path& folder, const std::string& command, const std::string& image,
                  const Error& error, const std::vector<std::string>& warnings) noexcept try {
  if (error.code == ExitCode::usage) return;
  const auto* stopped = dynamic_cast<const Stopped*>(&error);
  std::error_code ignored;
  {
    const std::lock_guard lock(begun_mutex);
    if (begun == folder) {
      if (fs::exists(folder / "summary.json", ignored)) return amend_word(folder, error);
      if (error.code == ExitCode::output) return;
    } else {
      if (error.code == ExitCode::output) return;
      if (stopped && stopped->reason == StopReason::interrupted) return;
      if (fs::exists(folder, ignored) && !fs::is_empty(folder, ignored) && !holds_only_a_word(folder)) return;
    }
  }
  write_word(folder, command, image, error, warnings);
} catch (...) {  // the original error is more important
}

namespace {

// Accepts a folder with a list, with only the summary of a failed run, or with the solved model.
void require_ours(const fs::path& folder, const fs::path& model) {
  std::error_code ignored;
  if (fs::is_directory(folder, ignored) && !holds_only(folder, "") && !listed_files(folder) &&
      !holds_only_a_word(folder) && !(!model.empty() && fs::equivalent(folder, model, ignored)))
    throw OutputError(
        {.fact = fmt::format("{} holds files that are not results of dimple", folder.string()),
         .where = "-o",
         .why = fmt::format(
             "there is no {}, the list of a run's files, and other files are never removed or replaced",
             file_list_name),
         .remedy = "give an empty or a new folder with -o"});
}

// A run neither writes through links nor deletes behind them.
void refuse_links(const fs::path& folder) {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (entry.is_symlink(ignored) && entry.is_directory(ignored))
      throw OutputError({.fact = fmt::format("{} is a link", entry.path().string()),
                         .where = "-o",
                         .why = "a run writes its frames there, and would replace files elsewhere",
                         .remedy = "remove the link, or give another folder with -o"});
}

}  // namespace

ResultFolder::ResultFolder(fs::path folder, Existing existing, fs::path model)
    : path_(std::move(folder)), existing_(existing), model_(std::move(model)) {
  std::error_code ignored;
  if (fs::is_directory(path_, ignored)) {
    lock_.emplace(path_);
    refuse_links(path_);
  }
  require_ours(path_, model_);
  try_folder(path_);
  require_nothing_to_lose();
}

void ResultFolder::require_nothing_to_lose() const {
  if (existing_ != Existing::refuse) return;
  const std::vector<fs::path> files = written_before(path_, model_);
  if ((files.empty() && !holds_temporaries(path_)) || may_overwrite(path_, files)) return;
  const bool is_model = std::find(files.begin(), files.end(), path_ / "model.toml") != files.end() &&
                        !is_there(path_ / "summary.json");
  throw OutputError(
      {.fact = fmt::format("{} holds {}", path_.string(),
                           is_model     ? "a model already"
                           : finished() ? "the results of a run"
                                        : "the results of an unfinished run"),
       .where = "-o",
       .why = "it would be lost",
       .remedy = is_model || finished()
                     ? "give another folder with -o, or --force to replace it"
                     : "continue that run with --resume, start again with --force, or give another -o"});
}

bool ResultFolder::finished() const {
  const Json summary = summary_in(path_);
  if (!summary.is_object()) return false;
  const std::string status = summary.value("status", "");
  return status != "interrupted" && status != "failed";
}

bool ResultFolder::resumable() const {
  std::error_code ignored;
  return existing_ == Existing::resume && fs::is_regular_file(path_ / checkpoint_file, ignored);
}

void ResultFolder::prepare() {
  make_folder(path_);
  if (!lock_) {  // another run may have come and gone since
    lock_.emplace(path_);
    require_nothing_to_lose();
  }
  {
    const std::lock_guard lock(begun_mutex);
    begun = path_;
  }
  for (const fs::path& folder : with_folders_in(path_)) remove_temporaries_in(folder);
  if (!resumable()) {
    std::error_code error;  // files that cannot be removed are replaced
    for (const fs::path& file : written_before(path_, model_)) {
      fs::remove(file, error);
      if (file.parent_path() != path_) fs::remove(file.parent_path(), error);  // kept if it holds more
    }
  }
  list_.emplace(path_);
}

}  // namespace dimple
