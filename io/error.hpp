#pragma once

#include <stdexcept>
#include <string>
#include <utility>

namespace dimple {

/// Exit code of the process. Documented in apps/guide/files.md; stable.
enum class ExitCode : int {
  ok = 0,
  internal = 1,      ///< an error in the program
  usage = 2,         ///< command line or configuration
  input = 3,         ///< image or model files unreadable or unusable
  model = 4,         ///< the model could not be built
  solve = 5,         ///< the solution failed
  output = 6,        ///< results could not be written
  interrupted = 130  ///< Ctrl-C; the partial result is valid
};

/// Name of the code for programs, if the error has no special one.
inline const char* word_of(ExitCode code) {
  switch (code) {
    case ExitCode::ok:
      return "ok";
    case ExitCode::internal:
      return "internal";
    case ExitCode::usage:
      return "usage";
    case ExitCode::input:
      return "input";
    case ExitCode::model:
      return "no-model";
    case ExitCode::solve:
      return "no-solution";
    case ExitCode::output:
      return "output";
    case ExitCode::interrupted:
      return "interrupted";
  }
  return "internal";
}

/// The four parts of a message, and a word for programs.
struct Report {
  std::string fact;       ///< what is wrong, with numbers
  std::string where;      ///< stage, file, place
  std::string why;        ///< how it came about
  std::string remedy;     ///< what to do, with the option's name
  std::string code = {};  ///< kebab-case, one for each kind of error; empty: that of the exit code
};

/// Every failure that a user can meet. Thrown with its report, printed by apps only.
class Error : public std::runtime_error {
 public:
  Error(ExitCode exit_code, Report what_to_say)
      : std::runtime_error(what_to_say.fact), code(exit_code), report(std::move(what_to_say)) {
    if (report.code.empty()) report.code = word_of(exit_code);
  }
  ExitCode code;
  Report report;
};

struct UsageError : Error {
  explicit UsageError(Report what_to_say) : Error(ExitCode::usage, std::move(what_to_say)) {}
};
struct InputError : Error {
  explicit InputError(Report what_to_say) : Error(ExitCode::input, std::move(what_to_say)) {}
};
struct ModelError : Error {
  explicit ModelError(Report what_to_say) : Error(ExitCode::model, std::move(what_to_say)) {}
};
struct SolveError : Error {
  explicit SolveError(Report what_to_say) : Error(ExitCode::solve, std::move(what_to_say)) {}
};
struct OutputError : Error {
  explicit OutputError(Report what_to_say) : Error(ExitCode::output, std::move(what_to_say)) {}
};

}  // namespace dimple
