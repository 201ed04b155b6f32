// The window on results and the live organ. Windows are opened under Xvfb, and moved by xdotool as a hand would.

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "io/file.hpp"
#include "io/table.hpp"
#include "tests/end_to_end/picture_pixels.hpp"
#include "tests/end_to_end/program.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

// What is missing here, or nothing.
std::string missing_for_windows() {
  for (const char* program : {"xvfb-run", "xdotool"})
    if (std::system(fmt::format("command -v {} >/dev/null 2>&1", program).c_str()) != 0)
      return fmt::format("{} is not installed here (Debian: xvfb, xauth, xdotool)", program);
  return {};
}

// A number of its own: a display that was just given up is taken and then gone. Without -noreset the server starts anew
// when xdotool, for a moment its only client, leaves, and refuses the program.
Ran under_xvfb(const fs::path& folder, const std::string& script) {
  Ran ran;
  for (int again = 0; again < 3; ++again) {
    write_file(folder / "script.sh", script);
    ran = Program(folder,
                  {"-c", fmt::format("xvfb-run -a -n $((200 + $$ % 700)) -s '-screen 0 1400x900x24 -noreset' sh script.sh")},
                  "/bin/sh")
              .wait();
    if (ran.code != 2) break;  // no display
  }
  return ran;
}

// Shares of a picture's pixels that are white, and dark as the largest displacement is drawn.
struct Shares {
  double paper = 0.0, dark = 0.0;
};
Shares shares_of(const fs::path& picture) {
  const auto is_dark = [](int red, int green, int blue) {
    return red > 40 && red < 215 && green < 90 && blue > 60 && blue < 125;
  };
  return {share_of_pixels(picture, is_white), share_of_pixels(picture, is_dark)};
}

// Two of them may run side by side: one phantom each.
fs::path folder_with_brain() {
  const fs::path folder = fresh_folder();
  EXPECT_EQ(dimple(folder, "phantom brain.nrrd --spacing 2 -q").code, 0);
  return folder;
}

const char* const there_and_back = "time_s,depth_mm\n0,0\n0.4,4\n1.0,4\n1.3,1\n1.6,1\n1.8,0\n2,0\n";

TEST(View, ShowsAFrameOfResultsWithItsSectionAndForce) {
  if (const std::string what = missing_for_windows(); !what.empty()) GTEST_SKIP() << what;
  const fs::path folder = folder_with_brain();
  ASSERT_EQ(dimple(folder, "run brain.nrrd -o out -q --nodes 1000 --depth 6mm --frames 3 --write surface --band off")
                .code,
            0);
  const std::string program = DIMPLE_PROGRAM;
  const Ran drawn = under_xvfb(folder, fmt::format("set -e\n'{0}' view out --picture last.png\n"
                                                   "'{0}' view out --picture first.png --frame 0\n"
                                                   "'{0}' view out --picture labels.png --labels\n",
                                                   program));
  ASSERT_EQ(drawn.code, 0) << drawn.err;
  EXPECT_EQ(drawn.err.find("ERR"), std::string::npos) << drawn.err;
  const Shares last = shares_of(folder / "last.png"), first = shares_of(folder / "first.png");
  EXPECT_GT(last.paper, 0.3);
  EXPECT_LT(last.paper, 0.95);
  EXPECT_GT(last.dark, first.dark + 1e-3);
  EXPECT_NE(read_file(folder / "last.png"), read_file(folder / "labels.png"));
  EXPECT_EQ(lines_above_colours(folder / "last.png"), 2) << "what the colours are, and their numbers, apart";
}

TEST(View, SaysWhatIsMissingInAFolderWithoutResults) {
  const fs::path folder = fresh_folder();
  const Ran ran = dimple(folder, "view .");
  EXPECT_EQ(ran.code, 3);
  EXPECT_NE(ran.err.find("holds no surface"), std::string::npos) << ran.err;
}

TEST(View, WithoutADisplayEndsInWords) {
  const fs::path folder = folder_with_brain();
  const Ran ran = Program(folder, {"-c", fmt::format("DISPLAY= '{}' poke brain.nrrd -q", DIMPLE_PROGRAM)}, "/bin/sh")
                      .wait();
  EXPECT_EQ(ran.code, 2);
  EXPECT_NE(ran.err.find("no window can be opened"), std::string::npos) << ran.err;
}

TEST(Poke, GivesTheSameForcesForAnyNumberOfThreadsWhereTheLimitIsInEvaluations) {
  const fs::path folder = folder_with_brain();
  write_file(folder / "path.csv", there_and_back);
  for (const char* threads : {"1", "2", "5"}) {
    const Ran ran = dimple(folder, fmt::format("poke brain.nrrd --script path.csv --nodes 700 --evaluations 8 -q "
                                               "--record with{0} --threads {0}",
                                               threads));
    ASSERT_EQ(ran.code, 0) << ran.err;
  }
  const std::string one = read_file(folder / "with1" / "forces.csv");
  EXPECT_EQ(read_file(folder / "with2" / "forces.csv"), one);
  EXPECT_EQ(read_file(folder / "with5" / "forces.csv"), one);
}

TEST(Poke, FeelsAtEachStopTheForceOfARun) {
  const fs::path folder = folder_with_brain();
  write_file(folder / "path.csv", there_and_back);
  const Ran live = dimple(folder, "poke brain.nrrd --script path.csv --nodes 1000 --evaluations 10 -q --record live");
  ASSERT_EQ(live.code, 0) << live.err;
  EXPECT_NE(live.out.find("1,000 nodes"), std::string::npos) << live.out;
  ASSERT_EQ(dimple(folder, "run brain.nrrd -o out -q --nodes 1000 --depth 4mm --frames 4 --band off --write force").code,
            0);
  const Table felt = read_csv(folder / "live" / "forces.csv"), run = read_csv(folder / "out" / "force.csv");
  const auto of_run = [&](double depth) {
    const auto& at = *run.find("indentation_mm");
    const auto k = std::min_element(at.begin(), at.end(), [&](double a, double b) {
                     return std::abs(a - depth) < std::abs(b - depth);
                   }) - at.begin();
    return (*run.find("force_N"))[static_cast<std::size_t>(k)];
  };
  const auto &time = *felt.find("time_s"), &force = *felt.find("force_N"), &band = *felt.find("half_band_N");
  int compared = 0;
  for (std::size_t k = 0; k < time.size(); ++k) {
    const double depth = std::abs(time[k] - 0.96) < 1e-6 ? 4.0 : std::abs(time[k] - 1.56) < 1e-6 ? 1.0 : 0.0;
    if (depth == 0.0) continue;
    EXPECT_NEAR(force[k], of_run(depth), 0.01 * of_run(depth)) << depth;
    EXPECT_GT(band[k], 0.0);
    ++compared;
  }
  EXPECT_EQ(compared, 2);
  const Ran by_key = dimple(folder, "poke brain.nrrd --script path.csv --set cloud.nodes=900 -q");
  EXPECT_NE(by_key.out.find("900 nodes"), std::string::npos) << by_key.out;
  EXPECT_EQ(force.back(), 0.0);
  EXPECT_TRUE(fs::exists(folder / "live" / "surface.pvd"));
}

// Options that decide a force decide it under a hand as well.
TEST(Poke, SlidesUnderTheToolWhereThatIsAskedFor) {
  const fs::path folder = folder_with_brain();
  write_file(folder / "path.csv", "time_s,depth_mm\n0,0\n0.4,4\n1,4\n");
  double force[2];
  for (const char* contact : {"bonded", "frictionless"}) {
    const std::string what = fmt::format("--contact {} --nodes 600 -q", contact);
    ASSERT_EQ(dimple(folder, fmt::format("poke brain.nrrd --script path.csv --evaluations 10 --record {} {}", contact, what)).code, 0);
    ASSERT_EQ(dimple(folder, fmt::format("run brain.nrrd -o run_{} --depth 4mm --frames 4 --band off --write force {}", contact, what)).code, 0);
    const double felt = read_csv(folder / contact / "forces.csv").find("force_N")->back(),
                 right = read_csv(folder / (std::string("run_") + contact) / "force.csv").find("force_N")->back();
    EXPECT_NEAR(felt, right, 0.01 * right) << contact;
    force[contact[0] == 'f'] = right;
  }
  EXPECT_LT(force[1], 0.97 * force[0]);
}

TEST(Poke, FollowsATipThroughTheAirToAnotherPlace) {
  const fs::path folder = folder_with_brain();
  // Into the dome of one half, out, across, and into that of the other, which is its mirror image.
  write_file(folder / "path.csv",
             "time_s,x_mm,y_mm,z_mm\n0,13.9,0,27.6\n0.4,13.9,0,23.6\n0.8,13.9,0,23.6\n1.2,13.9,0,31\n"
             "1.6,-13.9,0,31\n2.4,-13.9,0,23.6\n2.8,-13.9,0,23.6\n");
  const Ran ran = dimple(folder, "poke brain.nrrd --script path.csv --nodes 700 --evaluations 12 -q --record rec");
  ASSERT_EQ(ran.code, 0) << ran.err;
  const Table felt = read_csv(folder / "rec" / "forces.csv");
  const auto &time = *felt.find("time_s"), &force = *felt.find("force_N");
  double here = 0.0, between = 1.0, there = 0.0;
  for (std::size_t k = 0; k < time.size(); ++k) {
    if (std::abs(time[k] - 0.8) < 1e-6) here = force[k];
    if (std::abs(time[k] - 1.4) < 1e-6) between = force[k];
    if (std::abs(time[k] - 2.8) < 1e-6) there = force[k];
  }
  EXPECT_GT(here, 0.01);
  EXPECT_EQ(between, 0.0);
  EXPECT_NEAR(there, here, 0.1 * here);
}

TEST(Poke, PressesTheToolInWhereTheMouseTouchesTheBody) {
  if (const std::string what = missing_for_windows(); !what.empty()) GTEST_SKIP() << what;
  const fs::path folder = folder_with_brain();
  // Down in the middle of the body, drawn downwards, held, let go; then the window is closed by its key.
  const Ran ran = under_xvfb(folder, fmt::format(R"(
'{}' poke brain.nrrd --nodes 800 --record rec --fps 20 --force 2>said &
poke=$!
window=""
for k in $(seq 150); do
  window=$(xdotool search --name '^Dimple$' 2>/dev/null | head -n 1)
  [ -n "$window" ] && [ -e rec/window/window_0001.png ] && break
  kill -0 $poke 2>/dev/null || break
  sleep 0.2
done
xdotool mousemove --window "$window" 420 360 mousedown 1
sleep 1
for y in $(seq 362 2 400); do xdotool mousemove --window "$window" 420 $y; sleep 0.05; done
sleep 1.5
xdotool mouseup 1
sleep 1
xdotool key --window "$window" q
for k in $(seq 50); do kill -0 $poke 2>/dev/null || break; sleep 0.2; done
kill -INT $poke 2>/dev/null
wait $poke
)",
                                                 DIMPLE_PROGRAM));
  EXPECT_EQ(ran.code, 0) << read_file(folder / "said");
  const Table felt = read_csv(folder / "rec" / "forces.csv");
  const auto &force = *felt.find("force_N"), &depth = *felt.find("depth_mm");
  EXPECT_GT(*std::max_element(force.begin(), force.end()), 0.0);
  EXPECT_GT(*std::max_element(depth.begin(), depth.end()), 0.5);
  EXPECT_EQ(force.front(), 0.0);
  EXPECT_EQ(force.back(), 0.0);  // let go
}

// A device's side of the socket.
class Device {
 public:
  explicit Device(const fs::path& at) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, at.c_str(), sizeof address.sun_path - 1);
    for (int tries = 0; tries < 600 && !connected_; ++tries) {
      socket_ = ::socket(AF_UNIX, SOCK_STREAM, 0);
      connected_ = connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
      if (connected_) break;
      ::close(socket_);
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
  }
  ~Device() {
    if (connected_) ::close(socket_);
  }
  bool connected() const { return connected_; }
  std::string ask(const std::string& line) {
    if (send(socket_, line.data(), line.size(), MSG_NOSIGNAL) < 0) return {};
    char answer[512];
    const ssize_t got = recv(socket_, answer, sizeof answer, 0);
    return got > 0 ? std::string(answer, static_cast<std::size_t>(got)) : std::string();
  }

 private:
  int socket_ = -1;
  bool connected_ = false;
};

TEST(Poke, AnswersADeviceWithForcesThatDoNotJump) {
  const fs::path folder = folder_with_brain();
  // The path of a socket has 107 characters at most.
  const fs::path at = fs::temp_directory_path() / fmt::format("dimple_{}.sock", getpid());
  Program program(folder, {"poke", "brain.nrrd", "--socket", at.string(), "--nodes", "600", "-q"});
  Device device(at);
  ASSERT_TRUE(device.connected()) << program.err_so_far();
  std::vector<double> force;
  for (int k = 0; k <= 400; ++k) {  // two seconds at 200 Hz, 3 mm in and out again
    const std::string answer = device.ask(fmt::format("{:.6f}\n", 1.5 * (1.0 - std::cos(k * 3.14159265 / 200.0))));
    double f[5];
    ASSERT_EQ(std::sscanf(answer.c_str(), "%lf %lf %lf %lf %lf", f, f + 1, f + 2, f + 3, f + 4), 5) << answer;
    force.push_back(std::sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]));
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  const double most = *std::max_element(force.begin(), force.end());
  EXPECT_GT(most, 1e-3);
  for (std::size_t k = 2; k < force.size(); ++k)
    EXPECT_LT(std::abs(force[k] - force[k - 1]), 0.1 * most) << k;
  EXPECT_EQ(device.ask("left a bit\n").rfind("error", 0), 0U);
  program.send(SIGINT);
  EXPECT_EQ(program.wait().code, 130);
  EXPECT_FALSE(fs::exists(at));
}

TEST(Poke, RefusesAPathThatIsNone) {
  const fs::path folder = folder_with_brain();
  const auto refused = [&](const std::string& csv, const std::string& words) {
    write_file(folder / "path.csv", csv);
    const Ran ran = dimple(folder, "poke brain.nrrd --script path.csv -q");
    EXPECT_EQ(ran.code, 3) << csv;
    EXPECT_NE(ran.err.find(words), std::string::npos) << ran.err;
  };
  refused("time_s,force_N\n0,1\n1,2\n", "depth_mm");
  refused("time_s,depth_mm\n0,1\n", "1 row");
  refused("time_s,depth_mm\n0,1\n0,2\n", "rises");
  refused("time_s,depth_mm\n0,1\n9000,2\n", "9000 s");
  EXPECT_EQ(dimple(folder, "poke brain.nrrd --script path.csv --socket a.sock").code, 2);
  EXPECT_EQ(dimple(folder, "poke brain.nrrd --script path.csv --fps 0").code, 2);
  EXPECT_EQ(dimple(folder, "poke brain.nrrd --socket a.sock --window").code, 2);
  const Ran far = dimple(folder, {"poke", "brain.nrrd", "--socket", std::string(120, 's')});
  EXPECT_EQ(far.code, 2);
  EXPECT_NE(far.err.find("107 characters"), std::string::npos) << far.err;
}

}  // namespace
}  // namespace dimple
