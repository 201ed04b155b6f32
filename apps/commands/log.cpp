#include "apps/commands/log.hpp"

#include <fmt/color.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string_view>
#include <thread>

#include "apps/commands/terminal.hpp"
#include "apps/ending.hpp"
#include "apps/run/stopwatch.hpp"
#include "io/text.hpp"

namespace dimple {
namespace {

bool quiet = false, verbose = false, coloured = false;

std::mutex warnings_mutex;
std::vector<std::string> warnings;

std::string left_in_words(double s) {
  if (s < 1.0) return "less than 1 s left";
  if (s < 99.5) return fmt::format("{:.0f} s left", s);
  return s < 5400.0 ? fmt::format("{:.0f} min left", s / 60.0) : fmt::format("{:.1f} h left", s / 3600.0);
}

// Progress line at the bottom of a terminal. Debian 12 has no package for one.
class StageLine {
 public:
  explicit StageLine(bool slicer) : slicer_(slicer), terminal_(!quiet && isatty(STDERR_FILENO) != 0) {
    if (slicer_)
      tag("<filter-start>\n<filter-name>dimple</filter-name>\n"
          "<filter-comment>from a label image to a force</filter-comment>\n</filter-start>\n");
    if (terminal_) ticker_ = std::jthread([this](const std::stop_token& stop) { tick(stop); });
  }
  ~StageLine() {
    if (ticker_.joinable()) {
      ticker_.request_stop();
      ticker_.join();
    }
    erase();
    if (slicer_)
      tag(
          fmt::format("<filter-end>\n<filter-name>dimple</filter-name>\n<filter-time>{:.2f}</filter-time>\n"
                      "</filter-end>\n",
                      whole_.seconds()));
  }
  StageLine(const StageLine&) = delete;
  StageLine& operator=(const StageLine&) = delete;

  void begin(Part part, const Work& work) {
    const std::lock_guard lock(mutex_);
    if (own_s_ > 0.0) {  // the last part's time measures the speed of this machine
      taken_s_ += since_.seconds();
      expected_before_s_ += own_s_;
    }
    what_ = name_of(part);
    state_.clear();
    fraction_ = 0.0;
    tenths_ = 0;
    own_s_ = expected_s(part, work);
    after_s_ = 0.0;
    for (const Part later : all_parts)
      if (later > part) after_s_ += expected_s(later, work);
    is_predicted_ = !work.refinement;
    since_ = {};
    draw();
  }

  void name(const std::string& what) {
    const std::lock_guard lock(mutex_);
    what_ = what;
    draw();
  }

  // Sets the progress of the march.
  void update(double fraction, const std::string& state) {
    std::optional<std::string> line;
    {
      const std::lock_guard lock(mutex_);
      fraction_ = std::clamp(fraction, 0.0, 1.0);
      state_ = state;
      const int tenths = static_cast<int>(std::floor(10.0 * fraction + 1e-9));
      constexpr double long_s = 60.0;
      const bool each = verbose || own_s_ >= long_s;
      if (!terminal_ && (each ? tenths > tenths_ : tenths_ < 5 && tenths >= 5 && tenths < 10))
        line = fmt::format("{:<8} {:.0f} %  {}{}", what_, std::floor(100.0 * fraction + 1e-7), state,
                           fraction < 1.0 && is_predicted_ ? ", " + left_in_words(left_s()) : "");
      tenths_ = std::max(tenths, tenths_);
      if (terminal_ && drawn_.seconds() < 0.1) return;
      draw();
    }
    if (line) say(*line);
  }

  // Prints lines above the progress line.
  void above(const std::function<void()>& print) {
    const std::lock_guard lock(mutex_);
    erase();
    print();
  }
  // Removes the progress line.
  void idle() {
    const std::lock_guard lock(mutex_);
    erase();
    what_.clear();
  }

 private:
  // Estimated time of all remaining parts [s], from their counts and the speed of this machine so far.
  double left_s() const {
    constexpr double doubt_s = 0.3;  // the first parts are too short for an estimate
    const double pace = std::clamp((taken_s_ + doubt_s) / (expected_before_s_ + doubt_s), 0.1, 30.0);
    const double here = since_.seconds();
    const double done = std::pow(fraction_, 1.5);  // deep equilibria take longer than shallow ones
    const double own = fraction_ > 0.05 ? here * (1.0 - done) / done : std::max(0.0, pace * own_s_ - here);
    return own + pace * after_s_;
  }

  void draw() {
    const double left = left_s(), passed = whole_.seconds();
    if (slicer_ && is_predicted_ && own_s_ > 0.0) {
      reported_ = std::max(reported_, std::min(0.99, passed / std::max(passed + left, 1e-9)));
      tag(fmt::format("<filter-progress>{:.3f}</filter-progress>\n", reported_));
    }
    if (!terminal_ || what_.empty()) return;
    drawn_ = {};
    std::string line = fmt::format("{:<8}", what_);
    if (own_s_ > 0.0) {
      const double fraction = is_predicted_ ? passed / std::max(passed + left, 1e-9) : fraction_;
      const int filled = static_cast<int>(std::floor(24.0 * fraction));
      line += fmt::format(" [{:=<{}}{:{}}]", "", filled, "", 24 - filled);
      if (!state_.empty()) line += ' ' + state_;
      if (is_predicted_) line += (state_.empty() ? " " : ", ") + left_in_words(left);
    } else {
      line += " ...";
    }
    const std::size_t width = terminal_width(STDERR_FILENO) - 1;
    line = printable(line);
    if (line.size() > width) line.resize(width);
    std::fputs(("\r\033[K" + line).c_str(), stderr);
    std::fflush(stderr);
    open_ = true;
  }

  void erase() {
    if (open_) std::fputs("\r\033[K", stderr);
    open_ = false;
  }

  void tick(const std::stop_token& stop) {
    std::mutex asleep;
    std::condition_variable_any never;
    for (std::unique_lock lock(asleep); !stop.stop_requested();) {
      never.wait_for(lock, stop, std::chrono::milliseconds(200), [] { return false; });
      const std::lock_guard own(mutex_);
      if (!stop.stop_requested() && drawn_.seconds() > 0.15) draw();
    }
  }

  void tag(const std::string& text) const {
    std::fputs(text.c_str(), stdout);
    std::fflush(stdout);
  }

  bool slicer_, terminal_, is_predicted_ = true;
  std::mutex mutex_;
  std::string what_, state_;
  double fraction_ = 0.0, own_s_ = 0.0, after_s_ = 0.0;
  double taken_s_ = 0.0, expected_before_s_ = 0.0;  // of the finished parts
  double reported_ = 0.0;
  int tenths_ = 0;
  bool open_ = false;
  Stopwatch whole_, since_, drawn_;
  std::jthread ticker_;
};

std::optional<StageLine> stage_line;

void above_stage_line(const std::function<void()>& print) {
  if (stage_line)
    stage_line->above(print);
  else
    print();
}

// Prints a line, in colours only on a terminal.
void print_line(const std::string& line, const fmt::text_style& style) {
  above_stage_line([&] {
    fmt::print(stderr, coloured ? style : fmt::text_style(), "{}", line);
    std::fputc('\n', stderr);
    std::fflush(stderr);
  });
}

}  // namespace

void start_log(Verbosity verbosity, bool slicer) {
  // Plain text for any value of NO_COLOR: https://no-color.org.
  const bool plain =
      std::getenv("NO_COLOR") || std::string_view(std::getenv("TERM") ? std::getenv("TERM") : "") == "dumb";
  coloured = !plain && isatty(STDERR_FILENO) != 0;
  quiet = verbosity == Verbosity::quiet;
  verbose = verbosity == Verbosity::verbose;
  stage_line.emplace(slicer);
}

void end_log() {
  stage_line.reset();
}

void clear_stage_line() {
  if (stage_line) stage_line->idle();
}

void say(const std::string& line) {
  if (!quiet) print_line(printable(line), fmt::fg(fmt::terminal_color::green));
}
void detail(const std::string& line) {
  if (verbose) print_line(printable(line), fmt::fg(fmt::terminal_color::cyan));
}
void warn(const std::string& line) {
  {
    const std::lock_guard lock(warnings_mutex);
    warnings.push_back(line);
  }
  if (!quiet)
    print_line("warning: " + printable(line), fmt::emphasis::bold | fmt::fg(fmt::terminal_color::yellow));
}

std::vector<std::string> warnings_so_far() {
  const std::lock_guard lock(warnings_mutex);
  return warnings;
}

RecordObserver to_log() {
  return {.line =
              [](RunObserver::Line kind, const std::string& text) {
                switch (kind) {
                  case RunObserver::Line::doing:
                    if (stage_line) stage_line->name(text);
                    return;
                  case RunObserver::Line::said:
                    return say(text);
                  case RunObserver::Line::detail:
                    return detail(text);
                  case RunObserver::Line::warning:
                    return warn(text);
                }
              },
          .part =
              [](Part part, const Work& work) {
                if (stage_line) stage_line->begin(part, work);
              },
          .progress =
              [](double fraction, const std::string& state) {
                if (stage_line) stage_line->update(fraction, state);
              },
          .waited_s = seconds_since_start()};
}

std::string times_in_words(double total_s, std::vector<std::pair<std::string, double>> parts) {
  double remaining_s = total_s;
  for (const auto& [name, s] : parts) remaining_s -= s;
  parts.emplace_back("starting and ending", std::max(0.0, remaining_s));
  // Rounds by largest remainders, so that the parts add up to the total.
  const int decimals = total_s < 10.0 ? 2 : 1;
  const double unit = std::pow(10.0, -decimals), in_all = std::round(total_s / unit);
  std::vector<double> whole;
  double missing = in_all;
  for (const auto& [name, s] : parts) missing -= whole.emplace_back(std::floor(std::max(0.0, s) / unit));
  std::vector<std::size_t> order(parts.size());
  for (std::size_t k = 0; k < order.size(); ++k) order[k] = k;
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return parts[a].second / unit - whole[a] > parts[b].second / unit - whole[b];
  });
  for (std::size_t k = 0; k < order.size() && missing >= 1.0; ++k, --missing) ++whole[order[k]];
  for (; missing <= -1.0; ++missing) --*std::max_element(whole.begin(), whole.end());
  std::string text = fmt::format("{:.{}f} s", in_all * unit, decimals);
  const char* before = ": ";
  for (std::size_t k = 0; k < parts.size(); ++k) {
    if (whole[k] <= 0.0) continue;
    text += fmt::format("{}{:.{}f} {}", before, whole[k] * unit, decimals, parts[k].first);
    before = ", ";
  }
  return text;
}

}  // namespace dimple
