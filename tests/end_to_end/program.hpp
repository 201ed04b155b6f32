#pragma once

#include <sys/types.h>

#include <filesystem>
#include <string>
#include <vector>

#include "tests/helpers/folder.hpp"

namespace dimple {

/// Outcome of a run of the program.
struct Ran {
  int code = -1;  ///< exit code; 128 + signal if a signal ended it
  std::string out, err;
  double peak_MB = 0.0;  ///< largest memory
  double cpu_s = 0.0;    ///< of all its threads and children
};

/// CPU seconds that all cores together spend in so many seconds of wall time: a limit that does not depend on
/// how busy the machine is.
double cpu_of(double seconds);

/// The running program, started in `folder`; the destructor kills it.
class Program {
 public:
  Program(const std::filesystem::path& folder, const std::vector<std::string>& arguments,
          const std::string& program = DIMPLE_PROGRAM);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  bool running();
  /// Waits until it has a handler of SIGINT: before that the system handles the signal.
  void wait_until_it_listens();
  std::string err_so_far() const;
  void send(int signal) const;
  /// CPU seconds that it and its children have used so far.
  double cpu_s() const;
  Ran wait();

 private:
  std::filesystem::path out_, err_;
  pid_t pid_ = -1;
  int status_ = 0;
  double peak_MB_ = 0.0, cpu_s_ = 0.0;
  bool ended_ = false;

  bool reap(int options);
};

/// Runs the program to its end. The second form splits at blanks, as a shell does with plain words.
Ran dimple(const std::filesystem::path& folder, const std::vector<std::string>& arguments);
Ran dimple(const std::filesystem::path& folder, const std::string& arguments);

/// Runs the program as dimple() does; the test fails unless the exit code is 0.
Ran good(const std::filesystem::path& folder, const std::vector<std::string>& arguments);
Ran good(const std::filesystem::path& folder, const std::string& arguments);

/// Runs the program on a terminal of its own with so many columns; `out` is all that the terminal received.
Ran dimple_on_terminal(const std::filesystem::path& folder, const std::vector<std::string>& arguments,
                       int columns);
/// Splits a plain command line into words.
std::vector<std::string> words_of(const std::string& arguments);

std::string text_of(const std::filesystem::path& file);

/// Runs the program, which must end with this code and print these words on stderr.
void ends_with(const std::filesystem::path& folder, int code, const std::string& arguments,
               const std::vector<std::string>& words);

/// Expects this exit code, and a message with its four parts and these words.
void expect_refusal(const Ran& ran, int code, const std::vector<std::string>& words);

/// Options that a command refuses, with the exit code and words of the message.
struct RefusedLine {
  int code;
  std::string options;
  std::vector<std::string> words;  ///< of the message
};

/// Runs the command with each of these options in turn and expects the refusal of its line.
void expect_refusals(const std::filesystem::path& folder, const std::string& command,
                     const std::vector<RefusedLine>& lines);

/// Expects that the text holds each of these words.
void expect_words(const std::string& text, const std::vector<std::string>& words);

/// Runs a command that writes to out/, and sends it the signal when its first checkpoint is there. It must be
/// running then, and end with code 130.
Ran stopped_at_checkpoint(const std::filesystem::path& folder, const std::string& arguments, int signal);

}  // namespace dimple
