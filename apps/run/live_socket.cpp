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
#include <limits>
#include <mutex>
#include <string_view>
#include <thread>
#include <utility>

#include "apps/run/stopwatch.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/live/between_frames.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::size_t longest_line = 256;
constexpr int looks_ms = 50;         // between two checks for the end of the work
constexpr double patience_s = 1.0;   // for a program that does not read answers
constexpr int kept_bytes = 1 << 15;  // of answers that are not read; more only for the last message

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

[[noreturn]] void fail(const fs::path& path, const std::string& what) {
  throw OutputError({.fact = fmt::format("{}: {}", what, std::strerror(errno)),
                     .where = path.string(),
                     .why = "forces are sent through a unix domain socket there",
                     .remedy = "give --socket a short, unused path in a folder of your own",
                     .code = "socket"});
}

struct Descriptor {
  int number = -1;
  Descriptor() = default;
  explicit Descriptor(int n) : number(n) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  Descriptor(Descriptor&& other) noexcept : number(std::exchange(other.number, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(number, other.number);
    return *this;
  }
  ~Descriptor() { close(); }
  void close() {
    if (number >= 0) ::close(number);
    number = -1;
  }
};

// A socket left by a killed program is removed; any other file is not.
void listen_at(const fs::path& path, Descriptor& socket) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string name = path.string();
  if (name.empty() || name.size() >= sizeof address.sun_path) {
    errno = ENAMETOOLONG;
    fail(path, "the path of the socket cannot be used");
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
  // The socket is the owner's alone from its creation, whatever the umask is.
  constexpr mode_t owners = S_IRUSR | S_IWUSR;
  socket.number = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (socket.number < 0 || fchmod(socket.number, owners) != 0 ||
      bind(socket.number, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
      chmod(name.c_str(), owners) != 0 || listen(socket.number, 8) != 0)
    fail(path, "the socket cannot be made");
}

// Parses one or three numbers; returns their count, 0 for neither.
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

std::string number(double value) {
  return fmt::format("{:.9g}", value + 0.0);  // avoids -0
}

void send_words(int client, const std::string& words) {
  (void)send(client, words.data(), words.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
}

}  // namespace

struct ForceServer::Parts {
  Parts(const LiveTool& live, const fs::path& at) : path(at), organ(*live.organ), tool(live.session->tool()) {
    tip = tool.centre;
    between.radius = tool.radius;
    between.has_contact = organ.shape.has_value();
    contact_count = live.contact_count;
    listen_at(path, listening);
    thread = std::thread([this] { serve(); });
  }
  ~Parts() {
    end = true;
    thread.join();
    unlink(path.c_str());
  }

  const fs::path path;
  const LiveOrgan& organ;
  Descriptor listening;
  const Clock::time_point begin = Clock::now();
  std::atomic<bool> end = false;

  // State shared by both threads, under the mutex.
  mutable std::mutex mutex;
  Vec3 tip;            // last request
  bool along = true;   // the last request is a depth
  double depth = 0.0;  // that depth
  BetweenFrames between;
  LiveFrame frame;  // the last one
  ToolPlace tool;   // at the last contact
  Index contact_count = 0;
  std::size_t cuts = 0;          // at the last contact
  std::optional<Vec3> no_place;  // where no nodes could be made
  Served served;

  // State of the answering thread.
  std::string received, answers;  // with the program that moves the tool
  bool too_long = false;          // the present line is too long, and was answered
  bool within_line = false;       // the last bytes that it read ended within an answer
  Clock::time_point taken;        // last time that it read bytes
  std::thread thread;

  double now() const { return seconds_since(begin); }
  bool no_place_at(const Vec3& at) const { return no_place && (at - *no_place).norm() < 0.25 * tool.radius; }
  void serve();
  LiveAnswer at_tip();
  std::string answer_to(std::string_view line);
  std::string refused_line();
  bool read_from(int client);
  bool write_to(int client);
  Descriptor turn_away() const;
};

// Answer if the tip is given by its place, see TipRequest.
LiveAnswer ForceServer::Parts::at_tip() {
  using Kind = TipRequest::Kind;
  constexpr double unknown = std::numeric_limits<double>::infinity();
  const TipRequest requested = tip_request(organ, tool, frame.depth, tip);
  LiveAnswer said;
  if (requested.kind == Kind::air) return said;
  if (requested.kind == Kind::new_place || no_place_at(tip)) {
    said.error = unknown;
    said.tool = no_place_at(tip) ? LiveFrame::Tool::elsewhere : LiveFrame::Tool::lags;  // in approach
    return said;
  }
  said = answer(between, requested.at.depth, now());
  LiveFrame like;
  like.depth = said.depth, like.force = said.force, like.tool = said.tool;
  like.error = said.error, like.error_at_depth = said.error_at_depth;
  if (said.tool != LiveFrame::Tool::lags) report_lateral(like, requested, tool.radius);
  said.error = like.error, said.tool = like.tool;
  return said;
}

std::string ForceServer::Parts::answer_to(std::string_view line) {
  double values[3];
  const int count = numbers_in(line, values);
  const std::lock_guard lock(mutex);
  if (count == 0) {
    ++served.refused;
    return "error: a line is x_mm y_mm z_mm, or one depth_mm\n";
  }
  ++served.answers;
  along = count == 1;
  LiveAnswer said;
  if (along) {
    depth = 1e-3 * values[0];
    said = answer(between, depth, now());
  } else {
    tip = 1e-3 * Vec3(values[0], values[1], values[2]);
    said = at_tip();
  }
  std::string text;
  for (Index c = 0; c < 3; ++c) text += number(said.on_tool[c]) + ' ';
  text += fmt::format("{:.6g} {:.6g} ", 1e3 * said.depth + 0.0, said.error);
  for (Index c = 3; c < 6; ++c) text += number(said.on_tool[c]) + ' ';
  return text + name_of(said.tool) + '\n';
}

std::string ForceServer::Parts::refused_line() {
  const std::lock_guard lock(mutex);
  ++served.refused;
  return fmt::format("error: a line is longer than {} characters\n", longest_line);
}

// Returns false if the client is gone.
bool ForceServer::Parts::read_from(int client) {
  const Clock::time_point arrived = Clock::now();
  char buffer[4096];
  const ssize_t got = recv(client, buffer, sizeof buffer, MSG_DONTWAIT);
  if (got < 0 && (errno == EAGAIN || errno == EINTR)) return true;
  if (got <= 0) return false;
  received.append(buffer, static_cast<std::size_t>(got));
  taken = arrived;
  std::size_t from = 0;
  for (std::size_t to; (to = received.find('\n', from)) != std::string::npos; from = to + 1) {
    const std::string_view line = std::string_view(received).substr(from, to - from);
    if (!std::exchange(too_long, false))
      answers += line.size() > longest_line ? refused_line() : answer_to(line);
  }
  received.erase(0, from);
  if (received.size() > longest_line || too_long) {  // one answer; the rest of the line is skipped
    received.clear();
    if (!std::exchange(too_long, true)) answers += refused_line();
  }
  if (!write_to(client)) return false;
  const std::lock_guard lock(mutex);
  served.slowest_s = std::max(served.slowest_s, seconds_since(arrived));
  return true;
}

// Returns false if the client is gone or reads nothing. Unsent bytes wait, and block further reading.
bool ForceServer::Parts::write_to(int client) {
  while (!answers.empty()) {
    const ssize_t sent = send(client, answers.data(), answers.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (sent < 0 && errno != EAGAIN && errno != EINTR) return false;
    if (sent <= 0) break;
    taken = Clock::now();
    within_line = answers[static_cast<std::size_t>(sent) - 1] != '\n';
    answers.erase(0, static_cast<std::size_t>(sent));
  }
  if (answers.empty() || seconds_since(taken) < patience_s) return true;
  const int more = 2 * kept_bytes;
  setsockopt(client, SOL_SOCKET, SO_SNDBUF, &more, sizeof more);
  const std::string remaining = within_line ? answers.substr(0, answers.find('\n') + 1) : std::string();
  send_words(client,
             remaining + "error: the answers were not read for 1 s; read each before the next request\n");
  return false;
}

// Refuses a client. It may send before it reads, and its connection stays open for the message.
Descriptor ForceServer::Parts::turn_away() const {
  Descriptor other(accept4(listening.number, nullptr, nullptr, SOCK_CLOEXEC));
  if (other.number < 0) return other;
  send_words(other.number, "error: another program moves the tool; try again later\n");
  shutdown(other.number, SHUT_WR);
  return other;
}

void ForceServer::Parts::serve() {
  Descriptor client, turned_away;
  const auto leave = [&] {
    client.close();
    received.clear(), answers.clear();
    within_line = too_long = false;
  };
  while (!end.load()) {
    const short asks = answers.empty() ? POLLIN : POLLOUT;
    pollfd wait[] = {{.fd = listening.number, .events = POLLIN, .revents = 0},
                     {.fd = client.number, .events = asks, .revents = 0}};
    const int ready = poll(wait, 2, looks_ms);
    // The client is served first: if it has left, a waiting one can be accepted.
    if (ready > 0 && (wait[1].revents & (POLLIN | POLLHUP | POLLERR)) != 0 && answers.empty() &&
        !read_from(client.number))
      leave();
    if (!answers.empty() && !write_to(client.number)) leave();
    if (ready <= 0 || wait[0].revents == 0) continue;
    if (client.number >= 0) {
      const std::lock_guard lock(mutex);
      ++served.turned_away;
      turned_away = turn_away();
      continue;
    }
    client.number = accept4(listening.number, nullptr, nullptr, SOCK_CLOEXEC);
    if (client.number >= 0) setsockopt(client.number, SOL_SOCKET, SO_SNDBUF, &kept_bytes, sizeof kept_bytes);
  }
}

ForceServer::ForceServer(const LiveTool& tool, const fs::path& path)
    : parts_(std::make_unique<Parts>(tool, path)) {}
ForceServer::~ForceServer() = default;

PathFrame ForceServer::move(LiveTool& tool, const FrameLimit& limit, double dt) {
  Parts& p = *parts_;
  Vec3 tip;
  bool along;
  double depth;
  {
    const std::lock_guard lock(p.mutex);
    tip = p.tip, along = p.along, depth = p.depth;
  }
  const double time = p.now();
  const Stopwatch watch;
  if (along)
    move_depth(tool, depth, limit, dt);
  else
    move_tip(tool, tip, limit, dt);
  const PathFrame now = path_frame_of(tool, time, watch.seconds());
  const std::lock_guard lock(p.mutex);
  if (p.contact_count != tool.contact_count || p.cuts != tool.sheets.size()) forget(p.between);
  p.contact_count = tool.contact_count;
  p.cuts = tool.sheets.size();
  p.no_place = tool.no_place;
  p.tool = tool.session->tool();
  p.between.radius = p.tool.radius;
  p.frame = now.frame;
  correct(p.between, now.frame, p.now());
  ++p.served.frames;
  return now;
}

Served ForceServer::served() const {
  const std::lock_guard lock(parts_->mutex);
  return parts_->served;
}

Served serve_forces(LiveTool& tool, const fs::path& path, double rate, double seconds,
                    const std::function<void(const PathFrame&)>& each) {
  ForceServer server(tool, path);
  const Clock::time_point begin = Clock::now();
  const auto period = std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate));
  Clock::time_point next = begin;
  // One processor is reserved for the answers.
  tbb::task_arena others(std::max(1, tbb::this_task_arena::max_concurrency() - 1));
  while (stop_requested() == StopReason::none && seconds_since(begin) < seconds) {
    const PathFrame now =
        others.execute([&] { return server.move(tool, {.seconds = 0.9 / rate}, 1.0 / rate); });
    if (each) each(now);
    next = std::max(next + period, Clock::now());
    std::this_thread::sleep_until(next);
  }
  return server.served();
}

}  // namespace dimple
