#include "apps/log.hpp"

#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace dimple {
namespace {

bool quiet = false;

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
  spdlog::info("{}", line);
}
void detail(const std::string& line) {
  spdlog::debug("{}", line);
}
void warn(const std::string& line) {
  spdlog::warn("warning: {}", line);
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
    say(fmt::format("{} {} %  {}{}", what_, 10 * tenths, state, left));
  }
}

void Progress::finish() {
  if (open_) std::fputs("\n", stderr);
  open_ = false;
}

}  // namespace dimple
