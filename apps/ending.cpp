#include "apps/ending.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <semaphore.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iterator>
#include <limits>
#include <mutex>
#include <sstream>
#include <string>
#include <utility>

#include "io/file.hpp"

namespace dimple {
namespace {

constexpr double patience_s = 1.2;  // users expect an answer within 2 s, and releasing gigabytes takes time

// State of the signal handlers: lock-free atomics, and a semaphore because sem_post() is one of the few calls
// that a handler may make.
sem_t woken;
std::atomic<int> signals{0};
std::atomic<bool> ended{false};
std::array<std::atomic<int>, 256> children{};
static_assert(std::atomic<int>::is_always_lock_free);

std::atomic<double> latest{std::numeric_limits<double>::infinity()};
std::mutex words_mutex;
std::function<void(const Stopped&)> words;

double now() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

const double started = now();

void kill_children() {
  for (const std::atomic<int>& child : children)
    if (const int group = child.load(); group > 0) kill(-group, SIGKILL);
}

extern "C" void on_signal(int signal) {
  const int before_errno = errno;
  if (signals.fetch_add(1) >= 2) {
    kill_children();
    std::signal(signal, SIG_DFL);
    raise(signal);
  }
  ask_to_stop(StopReason::interrupted);
  sem_post(&woken);
  errno = before_errno;
}

// Waits for a post, at most until `deadline` on now()'s clock.
void wait_until(double deadline) {
  if (deadline == std::numeric_limits<double>::infinity()) {
    sem_wait(&woken);
    return;
  }
  const double whole = std::floor(deadline);
  const timespec until{static_cast<time_t>(whole), static_cast<long>(1e9 * (deadline - whole))};
  sem_clockwait(&woken, CLOCK_MONOTONIC, &until);
}

[[noreturn]] void end_now(const Stopped& why) {
  kill_children();
  {
    const std::lock_guard lock(words_mutex);
    if (words) words(why);
  }
  end_all_writing();
  // Not if nobody reads stderr, as write() would never return.
  pollfd err{.fd = STDERR_FILENO, .events = POLLOUT, .revents = 0};
  if (poll(&err, 1, 0) == 1 && (err.revents & POLLOUT) != 0) {
    const std::string line =
        fmt::format("dimple: {}, during work that cannot be stopped; files on disk are valid [{}]\n",
                    why.report.fact, why.report.code);
    [[maybe_unused]] const auto ignored = write(STDERR_FILENO, line.data(), line.size());
  }
  _exit(static_cast<int>(ExitCode::interrupted));
}

void watch() {
  while (!ended && stop_requested() == StopReason::none) {
    wait_until(latest);
    if (now() >= latest) ask_to_stop(StopReason::out_of_time);
  }
  const double last = now() + patience_s;
  while (!ended && now() < last && signals < 2) wait_until(last);
  if (!ended) end_now(Stopped(stop_requested()));
}

}  // namespace

Ending::Ending() {
  sem_init(&woken, 0, 0);
  ended = false;
  signals = 0;
  latest = std::numeric_limits<double>::infinity();
  thread_ = std::jthread(watch);
  // Shells start background programs with SIGINT ignored, but can still send it.
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
  if (std::signal(SIGHUP, on_signal) == SIG_IGN) std::signal(SIGHUP, SIG_IGN);  // started by nohup
}

Ending::~Ending() {
  ended = true;
  sem_post(&woken);
  thread_.join();
  std::signal(SIGINT, SIG_DFL);
  std::signal(SIGTERM, SIG_DFL);
}

double seconds_since_start() {
  const double since_main = now() - started;
  // Libraries are loaded before main(). The system records the start of the process in ticks since boot.
  std::ifstream in("/proc/self/stat");
  std::string text((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  std::istringstream fields(
      text.substr(std::min(text.size(), text.rfind(')') + 1)));  // a name may hold blanks
  constexpr int begun = 20;                                      // index of the start time after the name
  std::string field;
  for (int k = 0; k < begun; ++k) fields >> field;
  timespec t{};
  if (!fields || clock_gettime(CLOCK_BOOTTIME, &t) != 0) return since_main;
  const double since_begun = static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec) -
                             std::strtod(field.c_str(), nullptr) / static_cast<double>(sysconf(_SC_CLK_TCK));
  constexpr double longest_loading_s = 60.0;  // otherwise the two clocks are unrelated
  return since_begun > since_main && since_begun < since_main + longest_loading_s ? since_begun : since_main;
}

void Ending::limit(double seconds) {
  latest = started + seconds;
  sem_post(&woken);
}

void Ending::last_words(std::function<void(const Stopped&)> write) {
  const std::lock_guard lock(words_mutex);
  words = std::move(write);
}

Child::Child(int group) {
  for (std::size_t k = 0; k < children.size() && slot_ < 0; ++k)
    if (int none = 0; children[k].compare_exchange_strong(none, group)) slot_ = static_cast<int>(k);
}

Child::~Child() {
  if (slot_ >= 0) children[static_cast<std::size_t>(slot_)] = 0;
}

}  // namespace dimple
