#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "io/error.hpp"
#include "io/file.hpp"

namespace dimple {

/// State of an unfinished run, from which it resumes; removed when it has finished.
inline constexpr const char* checkpoint_file = "checkpoint.cbor";

/// True for a folder that holds only the summary of a run without results: nothing can be lost. False if
/// there is no such folder.
bool holds_only_a_word(const std::filesystem::path& folder);

/// Writes to a summary.json why a run left nothing else in its folder. It makes the folder if needed, but not
/// after Ctrl-C. A folder with other files is left alone. If they are those of the present run and it has
/// finished, its summary and page report that the work after it has not. Never throws.
void write_status(const std::filesystem::path& folder, const std::string& command, const std::string& image,
                  const Error& error, const std::vector<std::string>& warnings) noexcept;

/// Sets in the summary of a run that it ended otherwise after all: status, exit code and why.
void end_otherwise(nlohmann::ordered_json& summary, const Error& error);

/// Writes to a summary.json that the run of this folder has failed, and why. Throws OutputError.
void write_word(const std::filesystem::path& folder, const std::string& command, const std::string& image,
                const Error& error, const std::vector<std::string>& warnings);

/// Action if there are results already.
enum class Existing {
  refuse,   ///< report an error
  replace,  ///< remove them and start again
  resume    ///< continue the run that has made them
};

/// Folder of a run from its first file to its last; other runs are kept out. Files that its list does not
/// name are never removed or replaced.
class ResultFolder {
 public:
  /// Changes nothing yet. `model`: folder of the solved model, whose files are no results. Throws
  /// OutputError: the folder cannot be made or written to, or another run uses it. It may also hold files of
  /// others without a list, or results with Existing::refuse.
  ResultFolder(std::filesystem::path folder, Existing existing, std::filesystem::path model = {});

  bool finished() const;   ///< an earlier run has ended there
  bool resumable() const;  ///< it has left a checkpoint, and is to be resumed

  /// Makes the folder and begins its list. Removes unfinished files of an earlier run; unless that is to be
  /// resumed, also all files of its list. Throws OutputError.
  void prepare();
  const std::filesystem::path& path() const { return path_; }

 private:
  void require_nothing_to_lose() const;

  std::filesystem::path path_;
  Existing existing_;
  std::filesystem::path model_;
  std::optional<FolderLock> lock_;
  std::optional<FileList> list_;
};

}  // namespace dimple
