#include "apps/run/live_socket.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <tbb/task_arena.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstring>
#include <exception>
#include <mutex>
#include <string_view>
#include <thread>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/between_frames.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::size_t longest_line = 256;
constexpr int looks_ms = 50;  // between two looks at whether the work is to end

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

[[noreturn]] void fail(const fs::path& path, const std::string& what) {
  throw OutputError({.fact = fmt::format("{}: {}", what, std::strerror(errno)),
                     .where = path.string(),
                     .why = "forces are given out on a unix domain socket there",
                     .remedy = "give --socket a short path in a folder of your own that nothing stands at",
                     .code = "socket"});
}

struct Descriptor {
  int number = -1;
  Descriptor() = default;
  explicit Descriptor(int n) : number(n) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() { close(); }
  void close() {
    if (number >= 0) ::close(number);
    number = -1;
  }
};

// A socket that is left by a program that was killed is taken away; anything else is not.
void listen_at(const fs::path& path, Descriptor& socket) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string name = path.string();
  if (name.empty() || name.size() >= sizeof address.sun_path) {
    errno = ENAMETOOLONG;
    fail(path, "the path of the socket cannot be taken");
  }
  std::memcpy(address.sun_path, name.c_str(), name.size() + 1);
  struct stat there {};
  if (lstat(name.c_str(), &there) == 0) {
    if (!S_ISSOCK(there.st_mode)) {
      errno = EEXIST;
      fail(path, "the socket cannot be made");
    }
    const Descriptor other(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
    if (other.number >= 0 &&
        connect(other.number, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
      errno = EADDRINUSE;
      fail(path, "another program serves here");
    }
    unlink(name.c_str());
  }
  socket.number = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (socket.number < 0 ||
      bind(socket.number, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      listen(socket.number, 1) != 0)
    fail(path, "the socket cannot be made");
}

// One or three numbers; how many there are, 0 for neither.
int numbers_in(std::string_view line, double (&number)[3]) {
  int count = 0;
  const char *at = line.data(), *end = at + line.size();
  for (;;) {
    while (at != end && (*at == ' ' || *at == '\t' || *at == ',' || *at == '\r')) ++at;
    if (at == end) break;
    if (count == 3) return 0;
    const auto [next, error] = std::from_chars(at, end, number[count]);
    if (error != std::errc() || !std::isfinite(number[count]) || std::abs(number[count]) > 1e5) return 0;
    at = next;
    ++count;
  }
  return count == 1 || count == 3 ? count : 0;
}

// What both threads know.
struct Shared {
  std::mutex mutex;
  Vec3 tip;            // asked for last
  bool along = true;   // by its depth alone
  double depth = 0.0;  // then this
  BetweenFrames between;
  LiveFrame frame;  // the last
  Indenter tool;    // of the last touch
  std::exception_ptr failed;
  std::atomic<bool> end = false;
  std::int64_t frames = 0;
};

void find_frames(LiveTool& tool, double rate, const std::function<void(const PathFrame&)>& each,
                 Shared& shared) try {
  const Clock::time_point begin = Clock::now();
  const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate));
  Clock::time_point next = begin;
  // One processor is left to the answers.
  tbb::task_arena others(std::max(1, tbb::this_task_arena::max_concurrency() - 1));
  while (!shared.end.load()) {
    Vec3 tip;
    bool along;
    double depth;
    {
      const std::lock_guard lock(shared.mutex);
      tip = shared.tip, along = shared.along, depth = shared.depth;
    }
    const Clock::time_point now = Clock::now();
    const FrameLimit limit{.seconds = 0.9 / rate};
    const LiveFrame frame = others.execute([&] {
      return along ? move_depth(tool, depth, limit, 1.0 / rate) : move_tip(tool, tip, limit, 1.0 / rate);
    });
    {
      const std::lock_guard lock(shared.mutex);
      shared.tool = tool.session->model().tool;
      shared.frame = frame;
      correct(shared.between, frame);
      ++shared.frames;
    }
    if (each)
      each({.time = seconds_since(begin), .seconds = seconds_since(now), .frame = frame, .tip = tool.tip});
    next = std::max(next + period, Clock::now());
    std::this_thread::sleep_until(next);
  }
} catch (...) {
  const std::lock_guard lock(shared.mutex);
  shared.failed = std::current_exception();
  shared.end = true;
}

std::string answer_to(std::string_view line, double dt, Shared& shared, Served& served) {
  double number[3];
  const int count = numbers_in(line, number);
  if (count == 0) {
    ++served.refused;
    return "error: a line is x_mm y_mm z_mm, or one depth_mm\n";
  }
  ++served.answers;
  const std::lock_guard lock(shared.mutex);
  double depth;
  shared.along = count == 1;
  if (count == 1) {
    depth = shared.depth = 1e-3 * number[0];
  } else {
    shared.tip = 1e-3 * Vec3(number[0], number[1], number[2]);
    const Vec3 from = shared.tip - shared.tool.centre;
    depth = from.dot(shared.tool.push);
    // Beside the circle it is in the air, until it has come down there.
    if ((from - depth * shared.tool.push).norm() > shared.tool.radius && shared.frame.depth <= 0.0)
      depth = 0.0;
  }
  const double force = answer(shared.between, depth, dt);
  const Vec3 on_tool = -force * shared.tool.push;
  return fmt::format("{:.9g} {:.9g} {:.9g} {:.6g} {:.6g}\n", on_tool.x(), on_tool.y(), on_tool.z(),
                     1e3 * shared.frame.depth, shared.frame.error);
}

// Until it goes or takes no more answers, or the work is to end.
void serve(int client, const std::function<bool()>& goes_on, Shared& shared, Served& served) {
  std::string received;
  Clock::time_point last = Clock::now();
  char buffer[4096];
  while (goes_on()) {
    pollfd wait{.fd = client, .events = POLLIN, .revents = 0};
    if (poll(&wait, 1, looks_ms) <= 0) continue;
    const Clock::time_point arrived = Clock::now();
    const ssize_t got = recv(client, buffer, sizeof buffer, 0);
    if (got <= 0) return;
    received.append(buffer, static_cast<std::size_t>(got));
    std::string answers;
    std::size_t begin = 0;
    for (std::size_t end; (end = received.find('\n', begin)) != std::string::npos; begin = end + 1) {
      const Clock::time_point now = Clock::now();
      answers += answer_to(std::string_view(received).substr(begin, end - begin),
                           std::chrono::duration<double>(now - last).count(), shared, served);
      last = now;
    }
    received.erase(0, begin);
    if (received.size() > longest_line) {
      ++served.refused;
      received.clear();
      answers += "error: a line is longer than 256 characters\n";
    }
    for (std::size_t sent = 0; sent < answers.size();) {
      const ssize_t n =
          send(client, answers.data() + sent, answers.size() - sent, MSG_NOSIGNAL | MSG_DONTWAIT);
      if (n <= 0) return;
      sent += static_cast<std::size_t>(n);
    }
    served.slowest_s = std::max(served.slowest_s, seconds_since(arrived));
  }
}

}  // namespace

Served serve_forces(LiveTool& tool, const fs::path& path, double rate, double seconds,
                    const std::function<void(const PathFrame&)>& each) {
  Descriptor listening;
  listen_at(path, listening);
  struct Gone {
    const fs::path& path;
    ~Gone() { unlink(path.c_str()); }
  } gone{path};
  Shared shared;
  shared.tool = tool.session->model().tool;
  shared.tip = shared.tool.centre;
  shared.between.trusted = 0.2 * shared.tool.radius;
  Served served;
  const Clock::time_point begin = Clock::now();
  const auto goes_on = [&] {
    return !shared.end.load() && stop_asked() == StopReason::none && seconds_since(begin) < seconds;
  };
  std::thread frames([&] { find_frames(tool, rate, each, shared); });
  while (goes_on()) {
    pollfd wait{.fd = listening.number, .events = POLLIN, .revents = 0};
    if (poll(&wait, 1, looks_ms) <= 0) continue;
    const Descriptor client(accept4(listening.number, nullptr, nullptr, SOCK_CLOEXEC));
    if (client.number >= 0) serve(client.number, goes_on, shared, served);
  }
  shared.end = true;
  frames.join();
  if (shared.failed && stop_asked() == StopReason::none) std::rethrow_exception(shared.failed);
  served.frames = shared.frames;
  return served;
}

}  // namespace dimple
