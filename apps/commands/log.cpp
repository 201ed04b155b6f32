#include "apps/commands/log.hpp"

#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <string_view>

namespace dimple {
namespace {

bool quiet = false;

std::mutex warnings_mutex;
std::vector<std::string> warnings;

// The line of doing(), which the next one replaces.
bool open_line = false;
void close_line() {
  if (!open_line) return;
  std::fputs("\r\033[K", stderr);
  open_line = false;
}

}  // namespace

void start_log(Verbosity verbosity) {
  // https://no-color.org: any value of NO_COLOR means plain text.
  const bool plain =
      std::getenv("NO_COLOR") || std::string_view(std::getenv("TERM") ? std::getenv("TERM") : "") == "dumb";
  auto log =
      plain ? std::make_shared<spdlog::logger>("dimple", std::make_shared<spdlog::sinks::stderr_sink_mt>())
            : std::make_shared<spdlog::logger>("dimple",
                                               std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
  log->set_pattern("%^%v%$");
  log->set_level(verbosity == Verbosity::quiet    ? spdlog::level::err
                 : verbosity == Verbosity::normal ? spdlog::level::info
                                                  : spdlog::level::debug);
  spdlog::set_default_logger(log);
  quiet = verbosity == Verbosity::quiet;
}

void say(const std::string& line) {
  close_line();
  spdlog::info("{}", line);
}
void detail(const std::string& line) {
  close_line();
  spdlog::debug("{}", line);
}
void warn(const std::string& line) {
  {
    const std::lock_guard lock(warnings_mutex);
    warnings.push_back(line);
  }
  close_line();
  spdlog::warn("warning: {}", line);
}

std::vector<std::string> warnings_so_far() {
  const std::lock_guard lock(warnings_mutex);
  return warnings;
}

void doing(const std::string& what) {
  if (quiet || isatty(STDERR_FILENO) == 0) return;
  close_line();
  std::fputs((what + " ...").c_str(), stderr);
  std::fflush(stderr);
  open_line = true;
}

Progress::Progress(std::string what)
    : what_(std::move(what)),
      start_(std::chrono::steady_clock::now()),
      last_(start_),
      terminal_(isatty(STDERR_FILENO) != 0) {}

void Progress::update(double share, const std::string& state) {
  if (quiet) return;
  const auto now = std::chrono::steady_clock::now();
  const double elapsed = std::chrono::duration<double>(now - start_).count();
  const std::string left =
      share > 0.02 ? fmt::format(", {:.0f} s left", elapsed * (1.0 - share) / share) : "";
  close_line();
  if (terminal_) {
    if (share < 1.0 && std::chrono::duration<double>(now - last_).count() < 0.1) return;
    last_ = now;
    const int filled = static_cast<int>(std::floor(24.0 * share));
    std::fputs(fmt::format("\r\033[K{} [{:=<{}}{:{}}] {:3.0f} %  {}{}", what_, "", filled, "", 24 - filled,
                           100.0 * share, state, left)
                   .c_str(),
               stderr);
    std::fflush(stderr);
    open_ = true;
  } else if (const int tenths = static_cast<int>(std::floor(10.0 * share + 1e-9)); tenths > tenths_) {
    tenths_ = tenths;
    say(fmt::format("{} {:.0f} %  {}{}", what_, std::floor(100.0 * share + 1e-7), state, left));
  }
}

void Progress::finish() {
  if (open_) std::fputs("\n", stderr);
  open_ = false;
}

RecordObserver to_log() {
  const auto progress = std::make_shared<Progress>("solve");
  return {.line =
              [progress](RunObserver::Line kind, const std::string& text) {
                progress->finish();
                switch (kind) {
                  case RunObserver::Line::doing:
                    return doing(text);
                  case RunObserver::Line::said:
                    return say(text);
                  case RunObserver::Line::detail:
                    return detail(text);
                  case RunObserver::Line::warning:
                    return warn(text);
                }
              },
          .progress = [progress](double share, const std::string& state) { progress->update(share, state); }};
}

}  // namespace dimple
