#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "io/error.hpp"
#include "io/file.hpp"

namespace dimple {

/// Where a run keeps what it needs to go on; not there when it has finished.
inline constexpr const char* checkpoint_file = "checkpoint.cbor";

/// A folder that holds no more than the word of a run that failed, or of one that was stopped before it had
/// results: there is nothing to lose. False where there is no such folder.
bool holds_only_a_word(const std::filesystem::path& folder);

/// Says in a summary.json why nothing else is in the folder of a run: makes the folder if it is not there,
/// and leaves those alone that hold anything else, but for what the present run has begun to write: if that
/// has finished, its summary and page say now that what came after has not. For Ctrl-C, which nobody needs to
/// be told of, it makes no folder. Never throws.
void leave_word(const std::filesystem::path& folder, const std::string& command, const std::string& image,
                const Error& error, const std::vector<std::string>& warnings) noexcept;

/// Of a summary that a run has written, that it ended otherwise after all: status, exit code and why.
void end_otherwise(nlohmann::ordered_json& summary, const Error& error);

/// Says in a summary.json that the run of this folder has failed, and why. Throws OutputError.
void write_word(const std::filesystem::path& folder, const std::string& command, const std::string& image,
                const Error& error, const std::vector<std::string>& warnings);

/// What to do where results are already.
enum class Existing {
  refuse,   ///< say so
  replace,  ///< remove them and start anew
  resume    ///< go on with the run that has made them
};

/// The folder of a run from its first file to its last; other runs are kept out meanwhile. Files that its
/// list does not name are never removed or replaced.
class ResultFolder {
 public:
  /// Changes nothing yet. `model`: the folder of the model that is solved, whose files are no results. Throws
  /// OutputError: the folder cannot be made or written to, it holds files of others and no list, or results
  /// although `existing` is refuse, or another run is at work there.
  ResultFolder(std::filesystem::path folder, Existing existing, std::filesystem::path model = {});

  bool finished() const;   ///< an earlier run has ended there
  bool resumable() const;  ///< or has left a checkpoint, and is to be resumed

  /// Makes the folder; removes what an earlier run left unfinished there, and, unless that is to be resumed,
  /// all that it has made by its own list. Begins such a list. Throws OutputError.
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
