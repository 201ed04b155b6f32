#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <string_view>

namespace dimple {

/// Writes `content` beside `file`, flushes it to disk and renames it, so that the final name never holds half
/// a file and an older file of that name survives a failure. Throws OutputError with the system's reason
/// (disk full, read-only, no such folder).
void write_file(const std::filesystem::path& file, std::string_view content);

/// A name beside `file`, with its suffix, for a writer that wants a path; nothing else uses it. It starts
/// with a dot and the number of this process.
std::filesystem::path temporary_beside(const std::filesystem::path& file);

/// Makes `temporary`, empty. On failure throws OutputError about `file`, which it is to become.
void claim_temporary(const std::filesystem::path& temporary, const std::filesystem::path& file);

/// Flushes `temporary` to disk, unless the process was asked to end, and renames it to `file`. On failure,
/// also where a FileList has not that file and it is there, removes `temporary` and throws OutputError.
void move_into_place(const std::filesystem::path& temporary, const std::filesystem::path& file);

/// Removes what killed programs have left beside `file` on the way to it; not what one that still lives is
/// writing.
void remove_temporaries_of(const std::filesystem::path& file);

/// Whether this is the name of one.
bool is_temporary(const std::filesystem::path& file);

/// Removes such leftovers of any file in `folder`, which nobody else may be writing to.
void remove_temporaries_in(const std::filesystem::path& folder);

/// The last thing before a process ends while its threads are still at work: removes the temporaries of all
/// of them and lets nobody begin another. Never throws.
void end_all_writing() noexcept;

/// Keeps other runs out of a folder for as long as it lives: by flock(), so it ends with the process, and
/// nothing is left behind. On a file system without such locks it does nothing.
class FolderLock {
 public:
  /// Throws OutputError: another program holds it.
  explicit FolderLock(const std::filesystem::path& folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int folder_;
};

/// Makes the folder and those above it. Throws OutputError with the system's reason.
void make_folder(const std::filesystem::path& folder);

/// Tries, by making something and removing it, whether a folder can be made there, or the one that is there
/// be written to, and leaves nothing. To be called before what takes long. Throws OutputError with the
/// system's reason.
void try_folder(const std::filesystem::path& folder);

/// The same for a file: its folder is there and can be written to, and nothing but a file has its name.
void try_file(const std::filesystem::path& file);

/// As long as it lives, each file that comes into place below `folder` is first put down in the folder's
/// list: what a program has made there can be told from what others have put there, also after it was killed.
/// A file that is there and not in the list is not replaced.
class FileList {
 public:
  explicit FileList(const std::filesystem::path& folder);
  ~FileList();
  FileList(const FileList&) = delete;
  FileList& operator=(const FileList&) = delete;

 private:
  std::filesystem::path folder_;
};
/// Of that list.
inline constexpr const char* file_list_name = ".dimple_files";
/// What it holds, relative to the folder; nothing: there is none.
std::optional<std::set<std::string>> listed_files(const std::filesystem::path& folder);

/// Throws InputError unless a file can be there: not a folder, and not a pipe or device, which may never end.
void require_regular_file(const std::filesystem::path& file);

/// The whole file. Throws InputError with the system's reason, or because it does not end within
/// `most_bytes`.
std::string read_file(const std::filesystem::path& file, std::uintmax_t most_bytes = UINTMAX_MAX);

/// What somebody wrote by hand or another run as a summary is no larger; tables of measured numbers are no
/// larger.
inline constexpr std::uintmax_t most_bytes_of_text = 10'000'000, most_bytes_of_table = 500'000'000;

/// SHA-256 of the file's bytes, 64 hexadecimal digits. Throws InputError.
std::string sha256_of_file(const std::filesystem::path& file);
std::string sha256(std::string_view bytes);

/// On one line, with the characters of RFC 4648.
std::string base64(std::string_view bytes);

}  // namespace dimple
