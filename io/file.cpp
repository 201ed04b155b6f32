#include "io/file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/evp.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <map>
#include <memory>
#include <mutex>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

std::string reason(int error_number) {
  return std::generic_category().message(error_number);
}

std::string remedy_for_writing(int error_number) {
  switch (error_number) {
    case ENOSPC:
    case EDQUOT:
      return "make room on that disk, or choose another output folder with --output";
    case ENOENT:
    case ENOTDIR:
      return "create the folder first, or choose another output folder with --output";
    case EACCES:
    case EPERM:
    case EROFS:
      return "choose an output folder that you may write to with --output";
    default:
      return "choose another output folder with --output";
  }
}

[[noreturn]] void cannot_write(const fs::path& file, int error_number) {
  throw OutputError({.fact = fmt::format("cannot write '{}': {}", file.string(), reason(error_number)),
                     .where = fmt::format("writing {}", file.filename().string()),
                     .why = "the system refused; an earlier file of that name is unchanged",
                     .remedy = remedy_for_writing(error_number)});
}

[[noreturn]] void cannot_read(const fs::path& file, int error_number) {
  throw InputError({.fact = fmt::format("cannot read '{}': {}", file.string(), reason(error_number)),
                    .where = fmt::format("reading {}", file.filename().string()),
                    .why = "the system refused",
                    .remedy = error_number == ENOENT   ? "check the spelling of the path"
                              : error_number == EISDIR ? "name a file, not a folder"
                                                       : "check that you may read the file"});
}

/// A file descriptor that closes itself. POSIX calls, because streams hide errno and cannot fsync.
struct Descriptor {
  int number = -1;
  explicit Descriptor(int opened) : number(opened) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (number >= 0) ::close(number);
  }
};

/// The number of bytes read, 0 at the end; tries again when a signal interrupts.
std::size_t read_some(const Descriptor& in, char* buffer, std::size_t size, const fs::path& file) {
  for (;;) {
    const ssize_t n = ::read(in.number, buffer, size);
    if (n >= 0) return static_cast<std::size_t>(n);
    if (errno != EINTR) cannot_read(file, errno);
  }
}

Descriptor open_to_read(const fs::path& file) {
  const int number = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (number < 0) cannot_read(file, errno);
  return Descriptor(number);
}

}  // namespace

namespace {

// Folders in which this process has had temporaries, for end_all_writing().
struct Written {
  std::mutex mutex;
  std::set<fs::path> folders;
};
Written& written() {
  static Written* const one = new Written;  // threads may still write while statics are destroyed
  return *one;
}

}  // namespace

fs::path temporary_next_to(const fs::path& file) {
  static std::atomic<unsigned> count = 0;  // two threads may write the same name
  {
    const std::lock_guard lock(written().mutex);
    written().folders.insert(file.has_parent_path() ? file.parent_path() : fs::path("."));
  }
  return file.parent_path() / fmt::format(".{}-{}-{}", ::getpid(), count++, file.filename().string());
}

namespace {

// The parts of temporary_next_to()'s names.
const std::regex& temporary_name() {
  static const std::regex pattern(R"(\.(\d{1,9})-\d+-(.+))");
  return pattern;
}

}  // namespace

void remove_temporaries_of(const fs::path& file) {
  std::error_code ignored;
  const fs::path folder = file.has_parent_path() ? file.parent_path() : fs::path(".");
  std::vector<fs::path> left;
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    const std::string name = entry.path().filename().string();
    std::smatch part;
    if (!std::regex_match(name, part, temporary_name()) || part[2] != file.filename().string()) continue;
    const pid_t writer = std::stoi(part[1]);
    if (writer == ::getpid() || (::kill(writer, 0) != 0 && errno == ESRCH)) left.push_back(entry.path());
  }
  for (const fs::path& path : left) fs::remove(path, ignored);
}

bool is_temporary(const fs::path& file) {
  return std::regex_match(file.filename().string(), temporary_name());
}

void remove_temporaries_in(const fs::path& folder) {
  std::error_code ignored;
  std::vector<fs::path> left;
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (is_temporary(entry.path())) left.push_back(entry.path());
  for (const fs::path& path : left) fs::remove(path, ignored);
}

void end_all_writing() noexcept try {
  // Never unlocked: other writers wait until the process has ended.
  written().mutex.lock();
  const std::string own = fmt::format(".{}-", ::getpid());
  for (const fs::path& folder : written().folders) {
    std::error_code ignored;
    std::vector<fs::path> left;
    for (const auto& entry : fs::directory_iterator(folder, ignored))
      if (is_temporary(entry.path()) && entry.path().filename().string().starts_with(own))
        left.push_back(entry.path());
    for (const fs::path& path : left) fs::remove(path, ignored);
  }
} catch (...) {
}

FolderLock::FolderLock(const fs::path& folder)
    : folder_(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
  if (folder_ < 0) return;
  // A process forked a moment ago holds the locks of its parent until it becomes another program.
  constexpr int tries = 50;
  for (int k = 0; k < tries; ++k) {
    if (::flock(folder_, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK) return;
    ::usleep(10'000);
  }
  ::close(folder_);
  throw OutputError({.fact = fmt::format("another run is writing to {}", folder.string()),
                     .where = "-o",
                     .why = "two runs in one folder would overwrite each other's results",
                     .remedy = "wait until it has ended, or give another folder with -o"});
}

FolderLock::~FolderLock() {
  if (folder_ >= 0) ::close(folder_);
}

namespace {

struct Listed {
  std::set<std::string> names = {};
  int holders = 0;  // FileLists of that folder
};
struct Lists {
  std::mutex mutex;
  std::map<fs::path, Listed> of_folder;
};
Lists& lists() {
  static Lists* const one = new Lists;  // threads may still write while statics are destroyed
  return *one;
}

// Adds a line to each list that the file belongs to. Throws OutputError: it cannot be written, or a file of
// others is in its place.
void put_down_in_lists(const fs::path& file) {
  const std::lock_guard lock(lists().mutex);
  std::error_code ignored;
  const bool is_there = fs::exists(fs::symlink_status(file, ignored)) && file.filename() != file_list_name;
  for (auto& [folder, listed] : lists().of_folder) {
    std::set<std::string>& known = listed.names;
    const std::string name = file.lexically_normal().lexically_relative(folder).generic_string();
    const bool within = !name.empty() && !name.starts_with("..") && name.find('\n') == std::string::npos;
    if (!within || known.contains(name)) continue;
    if (is_there)
      throw OutputError(
          {.fact = fmt::format("{} was not written by this program", file.string()),
           .where = "-o",
           .why = fmt::format("it is not in {}, the list of files that this program wrote there",
                              file_list_name),
           .remedy = "move it away, or give another folder with -o"});
    const fs::path list = folder / file_list_name;
    const Descriptor out(::open(list.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_NOFOLLOW | O_CLOEXEC, 0666));
    const std::string line = name + '\n';
    if (out.number < 0 || ::write(out.number, line.data(), line.size()) != std::ssize(line))
      cannot_write(list, errno);
    known.insert(name);
  }
}

// Sorted, and without those that have been removed.
std::set<std::string> still_there(const fs::path& folder, std::set<std::string> names) {
  std::erase_if(names, [&](const std::string& name) {
    std::error_code ignored;
    return !fs::exists(fs::symlink_status(folder / name, ignored));
  });
  return names;
}

void write_list(const fs::path& folder, const std::set<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += name + '\n';
  write_file(folder / file_list_name, text);
}

}  // namespace

FileList::FileList(const fs::path& folder) : folder_(folder.lexically_normal()) {
  {
    const std::lock_guard lock(lists().mutex);
    if (const auto one = lists().of_folder.find(folder_); one != lists().of_folder.end()) {
      ++one->second.holders;
      return;
    }
  }
  const std::set<std::string> before =
      still_there(folder_, listed_files(folder_).value_or(std::set<std::string>{}));
  write_list(folder_, before);
  const std::lock_guard lock(lists().mutex);
  lists().of_folder[folder_] = {before, 1};
}

FileList::~FileList() {
  std::set<std::string> names;
  {
    const std::lock_guard lock(lists().mutex);
    Listed& own = lists().of_folder[folder_];
    if (--own.holders > 0) return;
    names = still_there(folder_, own.names);
    lists().of_folder.erase(folder_);
  }
  try {
    write_list(folder_, names);
  } catch (const Error&) {  // the one that has grown remains
  }
}

std::optional<std::set<std::string>> listed_files(const fs::path& folder) {
  std::error_code ignored;
  const fs::path list = folder / file_list_name;
  if (fs::symlink_status(list, ignored).type() != fs::file_type::regular) return std::nullopt;
  std::set<std::string> names;
  std::istringstream lines(read_file(list, most_bytes_of_text));
  for (std::string name; std::getline(lines, name);) names.insert(name);
  return names;
}

void claim_temporary(const fs::path& temporary, const fs::path& file) {
  const Descriptor out(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  if (out.number < 0) cannot_write(file, errno);
}

void move_into_place(const fs::path& temporary, const fs::path& file) {
  int error_number = 0;
  {
    const Descriptor written(::open(temporary.c_str(), O_RDONLY | O_CLOEXEC));
    // A process that must end has two seconds, and a busy disk can take a tenth for each file.
    const bool in_haste = stop_requested() != StopReason::none;
    if (written.number < 0 || (!in_haste && ::fsync(written.number) != 0)) error_number = errno;
  }
  if (error_number == 0) try {
      put_down_in_lists(file);
    } catch (const OutputError&) {
      ::unlink(temporary.c_str());
      throw;
    }
  if (error_number == 0 && ::rename(temporary.c_str(), file.c_str()) != 0) error_number = errno;
  if (error_number != 0) {
    ::unlink(temporary.c_str());
    cannot_write(file, error_number);
  }
}

void write_file(const fs::path& file, std::string_view content) {
  const fs::path temporary = temporary_next_to(file);
  int error_number = 0;
  {
    const Descriptor out(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
    if (out.number < 0) cannot_write(file, errno);
    while (!content.empty()) {
      const ssize_t n = ::write(out.number, content.data(), content.size());
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) {
        error_number = errno;
        break;
      }
      content.remove_prefix(static_cast<std::size_t>(n));
    }
  }
  if (error_number != 0) {
    ::unlink(temporary.c_str());
    cannot_write(file, error_number);
  }
  move_into_place(temporary, file);
}

namespace {

OutputError no_folder(const fs::path& folder, const std::string& what) {
  return OutputError({.fact = fmt::format("the folder {} cannot be {}", folder.string(), what),
                      .where = "results",
                      .why = "a file has that name, or the place cannot be written to",
                      .remedy = "give another -o"});
}

/// The first existing folder of a folder and those above. Throws OutputError: something else has its name.
fs::path nearest_folder(const fs::path& folder) {
  for (fs::path at = folder;; at = at.has_parent_path() ? at.parent_path() : fs::path(".")) {
    struct stat status {};
    if (::stat(at.c_str(), &status) == 0) {
      if (S_ISDIR(status.st_mode)) return at;
      throw no_folder(folder, fmt::format("made: {} is {}", at.string(),
                                          S_ISREG(status.st_mode) ? "a file" : "no folder"));
    }
    const int error_number = errno;
    if (error_number != ENOENT) throw no_folder(folder, "made: " + reason(error_number));
    if (::lstat(at.c_str(), &status) == 0)
      throw no_folder(folder, fmt::format("made: {} is a link that leads nowhere", at.string()));
  }
}

/// The system's error number, or 0: a temporary next to that file can be made and written.
int try_writing(const fs::path& file) {
  const fs::path temporary = temporary_next_to(file);
  const Descriptor out(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  if (out.number < 0) return errno;
  const int error_number = ::write(out.number, "dimple", 6) == 6 ? 0 : errno;
  ::unlink(temporary.c_str());
  return error_number;
}

}  // namespace

void make_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error || !std::filesystem::is_directory(folder))
    throw no_folder(folder, error ? "made: " + error.message() : "made");
}

void try_folder(const fs::path& folder) {
  if (folder.empty()) throw no_folder(folder, "made: it has no name");
  const fs::path there = nearest_folder(folder);
  if (there == folder) {
    if (const int error_number = try_writing(folder / "try"); error_number != 0)
      throw no_folder(folder, "written to: " + reason(error_number));
    return;
  }
  const fs::path trial = temporary_next_to(there / "try");
  int error_number = ::mkdir(trial.c_str(), 0777) == 0 ? 0 : errno;
  if (error_number == 0) {
    error_number = try_writing(trial / "try");
    ::rmdir(trial.c_str());
  }
  if (error_number != 0) throw no_folder(folder, "made: " + reason(error_number));
}

void try_file(const fs::path& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) == 0 && !S_ISREG(status.st_mode)) {
    if (S_ISDIR(status.st_mode)) cannot_write(file, EISDIR);
    throw OutputError({.fact = fmt::format("cannot write '{}': it is a pipe or a device", file.string()),
                       .where = fmt::format("writing {}", file.filename().string()),
                       .why = "a file is written under a temporary name and then renamed",
                       .remedy = "give the name of a file"});
  }
  if (const int error_number = try_writing(file); error_number != 0) cannot_write(file, error_number);
}

void require_regular_file(const fs::path& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) cannot_read(file, errno);
  if (S_ISDIR(status.st_mode)) cannot_read(file, EISDIR);
  if (!S_ISREG(status.st_mode))
    throw InputError({.fact = fmt::format("'{}' is not a file but a pipe or a device", file.string()),
                      .where = fmt::format("reading {}", file.filename().string()),
                      .why = "it has no length, and may never end",
                      .remedy = "save the content in a file and name that"});
  if (::access(file.c_str(), R_OK) != 0) cannot_read(file, errno);
}

std::string read_file(const fs::path& file, std::uintmax_t most_bytes) {
  const Descriptor in = open_to_read(file);
  struct stat status {};
  if (::fstat(in.number, &status) != 0) cannot_read(file, errno);

  std::string content;
  const auto said = static_cast<std::uintmax_t>(std::max<off_t>(status.st_size, 0));
  content.reserve(static_cast<std::size_t>(std::min(said, most_bytes)));  // a hint: 0 for a pipe
  std::array<char, 1 << 16> buffer;
  while (const std::size_t n = read_some(in, buffer.data(), buffer.size(), file)) {
    content.append(buffer.data(), n);
    if (content.size() > most_bytes)
      throw InputError(
          {.fact = fmt::format("'{}' is larger than {} MB", file.string(), most_bytes / 1'000'000),
           .where = fmt::format("reading {}", file.filename().string()),
           .why = "no file of its kind is, and it may never end",
           .remedy = "check that it is the file that you mean"});
  }
  return content;
}

namespace {

class Digest {
 public:
  void add(const char* bytes, std::size_t size) {
    good_ = good_ && EVP_DigestUpdate(context_.get(), bytes, size) == 1;
  }
  std::string text() {
    std::array<unsigned char, EVP_MAX_MD_SIZE> sum{};
    unsigned int length = 0;
    good_ = good_ && EVP_DigestFinal_ex(context_.get(), sum.data(), &length) == 1;
    if (!good_) throw std::runtime_error("OpenSSL could not compute a SHA-256");  // no error of the user
    std::string text;
    for (unsigned int i = 0; i < length; ++i) text += fmt::format("{:02x}", sum[i]);
    return text;
  }

 private:
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_{EVP_MD_CTX_new(), &EVP_MD_CTX_free};
  bool good_ = context_ && EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) == 1;
};

}  // namespace

std::string sha256_of_file(const fs::path& file) {
  const Descriptor in = open_to_read(file);
  Digest digest;
  std::array<char, 1 << 16> buffer;
  while (const std::size_t n = read_some(in, buffer.data(), buffer.size(), file))
    digest.add(buffer.data(), n);
  return digest.text();
}

std::string sha256(std::string_view bytes) {
  Digest digest;
  digest.add(bytes.data(), bytes.size());
  return digest.text();
}

std::string base64(std::string_view bytes) {
  std::string text;
  text.reserve(4 * (bytes.size() / 3 + 2));
  constexpr std::size_t piece =
      3 << 20;  // the library counts in int; whole triples, so that only the last one pads
  for (std::size_t from = 0; from < bytes.size(); from += piece) {
    const std::string_view part = bytes.substr(from, piece);
    std::string room(4 * (part.size() / 3 + 1) + 1, '\0');
    const int length =
        EVP_EncodeBlock(reinterpret_cast<unsigned char*>(room.data()),
                        reinterpret_cast<const unsigned char*>(part.data()), static_cast<int>(part.size()));
    text.append(room, 0, static_cast<std::size_t>(length));
  }
  return text;
}

}  // namespace dimple
