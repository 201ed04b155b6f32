#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <set>
#include <string>
#include <string_view>

namespace dimple {

/// Writes `content` next to `file`, flushes it to disk and renames it: the final name never holds half a
/// file, and an older file of that name survives a failure. Throws OutputError with the system's reason (disk
/// full, read-only, no such folder).
void write_file(const std::filesystem::path& file, std::string_view content);

/// A name next to `file`, with its suffix, for a writer that needs a path; nothing else uses it. It starts
/// with a dot and the number of this process.
std::filesystem::path temporary_next_to(const std::filesystem::path& file);

/// Makes `temporary`, empty. On failure throws OutputError about `file`, its later name.
void claim_temporary(const std::filesystem::path& temporary, const std::filesystem::path& file);

/// Flushes `temporary` to disk, unless the process must end, and renames it to `file`. On failure, also if
/// `file` exists and is not in a FileList, removes `temporary` and throws OutputError.
void move_into_place(const std::filesystem::path& temporary, const std::filesystem::path& file);

/// Removes temporaries that terminated programs have left next to `file`; not those of running ones.
void remove_temporaries_of(const std::filesystem::path& file);

/// True for the name of such a temporary.
bool is_temporary(const std::filesystem::path& file);

/// Removes such leftovers of any file in `folder`, to which nothing else may be writing.
void remove_temporaries_in(const std::filesystem::path& folder);

/// The last call before a process ends while its threads are running: removes the temporaries of all of them
/// and prevents new ones. Never throws.
void end_all_writing() noexcept;

/// Keeps other runs out of a folder while it exists: by flock(), so it ends with the process without a trace.
/// On a file system without such locks it does nothing.
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

/// Tests that a folder can be made, or an existing one written to, by making and removing something. To be
/// called before long computations. Throws OutputError with the system's reason.
void try_folder(const std::filesystem::path& folder);

/// Tests a file: its folder exists and can be written to, and nothing but a file has its name.
void try_file(const std::filesystem::path& file);

/// While it exists, each new file below `folder` is first entered in the folder's list. The list
/// distinguishes files of the program from those of others, even after it was killed. An existing file that
/// is not in the list is not replaced.
class FileList {
 public:
  explicit FileList(const std::filesystem::path& folder);
  ~FileList();
  FileList(const FileList&) = delete;
  FileList& operator=(const FileList&) = delete;

 private:
  std::filesystem::path folder_;
};
/// Name of that list.
inline constexpr const char* file_list_name = ".dimple_files";
/// Content of the list, relative to the folder; nothing: there is none.
std::optional<std::set<std::string>> listed_files(const std::filesystem::path& folder);

/// Throws InputError for a folder, and for a pipe or device, which may never end.
void require_regular_file(const std::filesystem::path& file);

/// The whole file. Throws InputError with the system's reason, or because it is longer than `most_bytes`.
std::string read_file(const std::filesystem::path& file, std::uintmax_t most_bytes = UINTMAX_MAX);

/// Upper limits for texts written by hand or as a summary, and for tables of measured numbers.
inline constexpr std::uintmax_t most_bytes_of_text = 10'000'000, most_bytes_of_table = 500'000'000;

/// SHA-256 of the file's bytes, 64 hexadecimal digits. Throws InputError.
std::string sha256_of_file(const std::filesystem::path& file);
std::string sha256(std::string_view bytes);

/// Base64 on one line, with the characters of RFC 4648.
std::string base64(std::string_view bytes);

}  // namespace dimple
