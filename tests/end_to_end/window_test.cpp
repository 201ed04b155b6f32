// The live organ. Windows are opened under Xvfb and moved by xdotool in place of a hand.

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdio>
#include <cstring>

#include "io/file.hpp"
#include "io/types.hpp"
#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/picture_pixels.hpp"

namespace dimple {
namespace {

// Name of the program that is missing here; empty if there is none.
std::string missing_for_windows() {
  for (const char* program : {"xvfb-run", "xdotool"})
    if (std::system(fmt::format("command -v {} >/dev/null 2>&1", program).c_str()) != 0)
      return fmt::format("{} is not installed here (Debian: xvfb, xauth, xdotool)", program);
  return {};
}

// A random display number, because a display that was just closed is found and then vanishes. Without
// -noreset the server restarts when xdotool, for a moment its only client, leaves, and refuses the program.
Ran under_xvfb(const fs::path& folder, const std::string& script) {
  Ran ran;
  for (int again = 0; again < 3; ++again) {
    write_file(folder / "script.sh", script);
    ran =
        Program(folder,
                {"-c",
                 fmt::format(
                     "xvfb-run -a -n $((200 + $$ % 700)) -s '-screen 0 1400x900x24 -noreset' sh script.sh")},
                "/bin/sh")
            .wait();
    if (ran.code != 2) break;  // no display
  }
  return ran;
}

// Each test makes a phantom of its own, since two of them may run in parallel.
fs::path folder_with_brain() {
  const fs::path folder = fresh_folder();
  good(folder, "phantom brain.nrrd --spacing 2 -q");
  return folder;
}

fs::path folder_with_block(int spacing_mm) {
  const fs::path folder = fresh_folder();
  const std::string image = "phantom block.nrrd --shape block --size 40,40,20 -q --spacing ";
  good(folder, image + std::to_string(spacing_mm));
  return folder;
}

// Forces along a path, given as rows of a table of depths or of tip positions.
Table forces_along(const fs::path& folder, const std::string& displacement, const std::string& options) {
  const bool is_of_depths =
      std::count(displacement.begin(), displacement.begin() + static_cast<long>(displacement.find('\n')),
                 ',') == 1;
  write_file(folder / "path.csv",
             (is_of_depths ? "time_s,depth_mm\n" : "time_s,x_mm,y_mm,z_mm\n") + displacement);
  good(folder, "poke --script path.csv -q --record rec --force " + options);
  return read_csv(folder / "rec" / "forces.csv");
}

const char* const there_and_back = "time_s,depth_mm\n0,0\n0.4,4\n1.0,4\n1.3,1\n1.6,1\n1.8,0\n2,0\n";

TEST(Poke, WithoutADisplayEndsInWords) {
  const fs::path folder = folder_with_brain();
  const Ran ran =
      Program(folder, {"-c", fmt::format("DISPLAY= '{}' poke brain.nrrd -q", DIMPLE_PROGRAM)}, "/bin/sh")
          .wait();
  EXPECT_EQ(ran.code, 2);
  EXPECT_THAT(ran.err, HasSubstr("no window can be opened"));
}

TEST(Poke, HasAtEachStopTheForceOfARun) {
  const fs::path folder = folder_with_brain();
  write_file(folder / "path.csv", there_and_back);
  const Ran live =
      good(folder, "poke brain.nrrd --script path.csv --nodes 1000 --evaluations 10 -q --record live");
  EXPECT_THAT(live.out, HasSubstr("1,000 nodes"));
  good(folder, "run brain.nrrd -o out -q --nodes 1000 --depth 4mm --frames 4 --band off --write force");
  const Table answer = read_csv(folder / "live" / "forces.csv"), run = read_csv(folder / "out" / "force.csv");
  const auto of_run = [&](double depth) {
    const auto& at = *run.find("indentation_mm");
    const auto k =
        std::min_element(at.begin(), at.end(),
                         [&](double a, double b) { return std::abs(a - depth) < std::abs(b - depth); }) -
        at.begin();
    return (*run.find("force_N"))[static_cast<std::size_t>(k)];
  };
  const auto &time = *answer.find("time_s"), &force = *answer.find("force_N"),
             &error_bounds = *answer.find("half_band_N");
  int compared = 0;
  for (std::size_t k = 0; k < time.size(); ++k) {
    const double depth = std::abs(time[k] - 0.96) < 1e-6 ? 4.0 : std::abs(time[k] - 1.56) < 1e-6 ? 1.0 : 0.0;
    if (depth == 0.0) continue;
    EXPECT_NEAR(force[k], of_run(depth), 0.01 * of_run(depth)) << depth;
    EXPECT_GT(error_bounds[k], 0.0);
    ++compared;
  }
  EXPECT_EQ(compared, 2);
  const Ran by_key = dimple(folder, "poke brain.nrrd --script path.csv --set cloud.nodes=900 -q");
  EXPECT_THAT(by_key.out, HasSubstr("900 nodes"));
  EXPECT_EQ(force.back(), 0.0);
  EXPECT_TRUE(fs::exists(folder / "live" / "surface.pvd"));
}

// Options that determine a force do so during live contact as well.
TEST(Poke, SlidesUnderTheToolOnRequest) {
  const fs::path folder = folder_with_brain();
  double force[2];
  for (const char* contact : {"bonded", "frictionless"}) {
    const std::string what = fmt::format("--contact {} --nodes 600 -q", contact);
    const Table live = forces_along(folder, "0,0\n0.4,4\n1,4\n", "brain.nrrd --evaluations 10 " + what);
    good(folder, "run brain.nrrd -o out --force --depth 4mm --frames 4 --band off --write force " + what);
    const double answer = live.find("force_N")->back(), right = end_of(folder / "out");
    EXPECT_NEAR(answer, right, 0.01 * right) << contact;
    force[contact[0] == 'f'] = right;
  }
  EXPECT_LT(force[1], 0.97 * force[0]);
}

TEST(Poke, RecordedAgainLeavesNothingOfTheRecordBefore) {
  const fs::path folder = folder_with_brain();
  const auto recorded = [&](const char* displacement) {
    forces_along(folder, displacement, "brain.nrrd --nodes 700 --evaluations 12");
    return std::distance(fs::directory_iterator(folder / "rec" / "surface"), fs::directory_iterator());
  };
  EXPECT_GE(recorded("0,0\n1.5,2\n"), 6);
  EXPECT_LE(recorded("0,0\n0.3,1\n"), 3);
  EXPECT_THAT(text_of(folder / "rec" / ".dimple_files"), HasSubstr("forces.csv"));
}

TEST(Poke, FollowsATipThroughTheAirToAnotherPlace) {
  const fs::path folder = folder_with_brain();
  // The path goes into the dome of one half, out, across, and into the other, which is its mirror image.
  const Table answer = forces_along(folder,
                                    "0,13.9,0,27.6\n0.4,13.9,0,23.6\n0.8,13.9,0,23.6\n1.2,13.9,0,31\n"
                                    "1.6,-13.9,0,31\n2.4,-13.9,0,23.6\n2.8,-13.9,0,23.6\n",
                                    "brain.nrrd --nodes 700 --evaluations 12");
  const auto &time = *answer.find("time_s"), &force = *answer.find("force_N");
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

// Runs the window on the brain, moved by xdotool's `gesture`, until its key closes it.
Ran poked_by_hand(const fs::path& folder, const char* options, const char* gesture) {
  return under_xvfb(folder, fmt::format(R"(
'{}' poke brain.nrrd --nodes 800 {} --record rec --fps 20 --force >told 2>said &
poke=$!
window=""
for k in $(seq 150); do
  window=$(xdotool search --name '^Dimple$' 2>/dev/null | head -n 1)
  [ -n "$window" ] && [ -e rec/window/window_0001.png ] && break
  kill -0 $poke 2>/dev/null || break
  sleep 0.2
done
{}
xdotool key --window "$window" q
for k in $(seq 50); do kill -0 $poke 2>/dev/null || break; sleep 0.2; done
kill -INT $poke 2>/dev/null
wait $poke
)",
                                        DIMPLE_PROGRAM, options, gesture));
}

TEST(Poke, PressesTheToolInWhereTheMouseIsOnTheBody) {
  if (const std::string what = missing_for_windows(); !what.empty()) GTEST_SKIP() << what;
  const fs::path folder = folder_with_brain();
  // The gesture: press in the middle of the body, draw downwards, hold, release; a key closes the window.
  const Ran ran = poked_by_hand(folder, "", R"(xdotool mousemove --window "$window" 420 360 mousedown 1
sleep 1
for y in $(seq 362 2 400); do xdotool mousemove --window "$window" 420 $y; sleep 0.05; done
sleep 1.5
xdotool mouseup 1
sleep 1)");
  EXPECT_EQ(ran.code, 0) << read_file(folder / "said");
  const Table answer = read_csv(folder / "rec" / "forces.csv");
  const auto &force = *answer.find("force_N"), &depth = *answer.find("depth_mm");
  EXPECT_GT(*std::max_element(force.begin(), force.end()), 0.0);
  EXPECT_GT(*std::max_element(depth.begin(), depth.end()), 0.5);
  EXPECT_EQ(force.front(), 0.0);
  EXPECT_EQ(force.back(), 0.0);  // released
  EXPECT_EQ(lines_above_colours(folder / "rec" / "window" / "window_0001.png"), 2)
      << "what the colours are, and their numbers, apart";
}

// The stroke is on the flank, away from the bonded patch; the tool itself stays in the air.
TEST(Poke, AScalpelInTheHandCutsTheBodyAlongItsStroke) {
  if (const std::string missing = missing_for_windows(); !missing.empty())
    GTEST_SKIP() << "skipped: " << missing;
  const fs::path folder = folder_with_brain();
  const Ran ran =
      poked_by_hand(folder, "--tool scalpel:6mm", R"(xdotool mousemove --window "$window" 300 420 mousedown 1
sleep 0.5
for y in $(seq 424 4 480); do xdotool mousemove --window "$window" 300 $y; sleep 0.02; done
xdotool mouseup 1
sleep 2)");
  EXPECT_EQ(ran.code, 0) << read_file(folder / "said");
  const Table cuts = read_csv(folder / "rec" / "cuts.csv");
  ASSERT_EQ(cuts.rows(), 1u) << read_file(folder / "told");
  EXPECT_EQ((*cuts.find("cut"))[0], 1.0) << read_file(folder / "told");
  EXPECT_EQ((*cuts.find("depth_mm"))[0], 6.0);
  EXPECT_GT((*cuts.find("area_mm2"))[0], 10.0);
}

// Client of the socket, in place of a device.
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
    return hear();
  }
  // Next answer, waiting if there is none yet; empty if the other side has closed.
  std::string hear() {
    char answer[4096];
    const ssize_t got = recv(socket_, answer, sizeof answer, 0);
    return got > 0 ? std::string(answer, static_cast<std::size_t>(got)) : std::string();
  }
  // Sends as many bytes as fit without waiting and returns their number.
  std::size_t pour(const std::string& lines) {
    const ssize_t sent = send(socket_, lines.data(), lines.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    return sent > 0 ? static_cast<std::size_t>(sent) : 0;
  }

 private:
  int socket_ = -1;
  bool connected_ = false;
};

struct Answer {
  Vec3 force, moment;
  double depth_mm = 0.0, error = 0.0;
  std::string tool;
  double along(const Vec3& approach) const { return -force.dot(approach); }
};
Answer answer_in(const std::string& answer) {
  Answer parsed;
  char tool[32] = {};
  EXPECT_EQ(std::sscanf(answer.c_str(), "%lf %lf %lf %lf %lf %lf %lf %lf %31s", &parsed.force.x(),
                        &parsed.force.y(), &parsed.force.z(), &parsed.depth_mm, &parsed.error,
                        &parsed.moment.x(), &parsed.moment.y(), &parsed.moment.z(), tool),
            9)
      << answer;
  EXPECT_THAT((" " + answer), Not(HasSubstr(" -0 "))) << answer;
  parsed.tool = tool;
  return parsed;
}

void sleep_ms(int ms) {
  std::this_thread::sleep_for(std::chrono::milliseconds(ms));
}

// A tool on the phantom's dome that devices move. A socket's path has at most 107 characters.
struct Served {
  fs::path folder = folder_with_brain();
  fs::path at = fs::temp_directory_path() / fmt::format("dimple_{}.sock", getpid());
  Program program;
  Vec3 approach;
  explicit Served(const std::string& further = "")
      : program(folder, words_of("poke brain.nrrd --nodes 600 -q --seconds 250 --socket " + at.string() +
                                 " " + further)) {
    Device first(at);
    EXPECT_TRUE(first.connected()) << program.err_so_far();
    approach = -steady(first, 0.5).force.normalized();  // without the lateral part: enough for a sign
  }
  // Force at a depth once it no longer changes.
  static Answer steady(Device& device, double mm) {
    Answer answer;
    for (int k = 0; k < 150; ++k, sleep_ms(20))
      if (answer = answer_in(device.ask(fmt::format("{}\n", mm)));
          k > 25 && answer.tool == "there" && answer.error < 0.01 * answer.force.norm())
        break;
    EXPECT_EQ(answer.tool, "there");
    EXPECT_EQ(answer.depth_mm, mm);
    return answer;
  }
  int end() {
    program.send(SIGINT);
    return program.wait().code;
  }
};

TEST(Poke, TwoHundredShortLivedDevicesLeaveTheNextOnesForceRight) {
  Served served;
  Answer truth;
  {
    Device device(served.at);
    truth = Served::steady(device, 1.0);
  }
  for (int k = 0; k < 200; ++k) {
    Device device(served.at);
    answer_in(device.ask(fmt::format("{}\n", (k * 37) % 200 * 0.01)));
  }
  Device next(served.at);
  for (int k = 0; k < 40; ++k, sleep_ms(10)) {
    const Answer answer = answer_in(next.ask("1\n"));
    EXPECT_GE(answer.along(served.approach), 0.0);
    if (answer.tool != "there") continue;
    EXPECT_NEAR(answer.along(served.approach), truth.along(served.approach),
                answer.error + 0.01 * truth.force.norm())
        << k;
  }
  const Answer at_last = Served::steady(next, 1.0);
  EXPECT_LT((at_last.force - truth.force).norm(), 0.01 * truth.force.norm());
  EXPECT_LT((at_last.moment - truth.moment).norm(), 0.01 * truth.moment.norm() + 1e-9);
  EXPECT_EQ(served.end(), 130);
}

TEST(Poke, SaysWhatIsNotFollowed) {
  Served served;
  Device device(served.at);
  // The place is on the dome of one half of the phantom.
  for (int k = 0; k < 20; ++k, sleep_ms(50))
    EXPECT_EQ(answer_in(device.ask("13.9 0 32\n")).force.norm(), 0.0) << "in the air";
  Answer deep;
  for (int k = 0; k < 100; ++k, sleep_ms(50))
    if (deep = answer_in(device.ask("13.9 0 24.6\n")); k > 10 && deep.tool == "there" && deep.depth_mm > 1.0)
      break;
  ASSERT_EQ(deep.tool, "there");
  sleep_ms(500);
  deep = answer_in(device.ask("13.9 0 24.6\n"));
  const Answer aside = answer_in(device.ask("17.9 0 23.6\n"));
  EXPECT_EQ(aside.tool, "elsewhere");
  EXPECT_GT(aside.depth_mm, 0.5) << "it has kept to its axis";
  EXPECT_TRUE(std::isinf(aside.error)) << "nothing is known of the force there";
  const Answer off = answer_in(device.ask("213.9 0 20\n"));
  EXPECT_EQ(off.tool, "there");
  EXPECT_EQ(off.force.norm(), 0.0) << "there is nothing to touch";
  EXPECT_EQ(off.error, 0.0);
  answer_in(device.ask("13.9 0 24.6\n"));
  answer_in(device.ask("200\n"));
  sleep_ms(600);
  const Answer beyond = answer_in(device.ask("200\n"));
  EXPECT_EQ(beyond.tool, "beyond");
  EXPECT_LT(beyond.depth_mm, 100.0);
  EXPECT_EQ(served.end(), 130);
}

TEST(Poke, OneDeviceMovesTheToolAndOthersAreTurnedAwayInWords) {
  Served served;
  Device second(served.at);
  answer_in(second.ask("1\n"));
  {
    Device third(served.at);
    EXPECT_EQ(third.hear(), "error: another program moves the tool; try again later\n");
    EXPECT_EQ(third.hear(), "") << "and is let go";
    Device hasty(served.at);
    EXPECT_EQ(hasty.ask("1\n"), "error: another program moves the tool; try again later\n");
  }
  answer_in(second.ask("1\n"));
  EXPECT_EQ(served.end(), 130);
}

TEST(Poke, ADeviceThatTakesNoAnswersIsNotifiedAndLeavesRoomForTheNext) {
  Served served;
  std::string heard;
  {
    Device flood(served.at);
    std::string lines;
    for (int k = 0; k < 2000; ++k) lines += "0.5\n";
    for (int k = 0; k < 30; ++k, sleep_ms(50)) flood.pour(lines);
    for (std::string more; !(more = flood.hear()).empty();) heard += more;
  }
  const std::size_t error = heard.find("\nerror: the answers were not read for 1 s");
  ASSERT_NE(error, std::string::npos) << heard.size();
  answer_in(heard.substr(heard.rfind('\n', error - 1) + 1));  // the last answer is complete
  Device next(served.at);
  answer_in(next.ask("0.5\n"));
  EXPECT_EQ(served.end(), 130);
}

TEST(Poke, TheSocketIsItsOwnersAloneWhateverTheUmask) {
  const fs::path folder = folder_with_brain();
  for (const char* umask : {"0", "0777"}) {
    const fs::path at = fs::temp_directory_path() / fmt::format("dimple_{}_{}.sock", getpid(), umask);
    Program program(
        folder,
        {"-c", fmt::format("umask {}; exec '{}' poke brain.nrrd --nodes 500 -q --seconds 100 --socket {}",
                           umask, DIMPLE_PROGRAM, at.string())},
        "/bin/sh");
    Device device(at);
    ASSERT_TRUE(device.connected()) << program.err_so_far();
    EXPECT_EQ(fs::status(at).permissions(), fs::perms::owner_read | fs::perms::owner_write) << umask;
    program.send(SIGINT);
    EXPECT_EQ(program.wait().code, 130);
  }
}

TEST(Poke, WhatADeviceDoesIsRecordedWithTheVectorOfItsForce) {
  Served served("--record rec");
  {
    Device device(served.at);
    Served::steady(device, 1.5);
  }
  EXPECT_EQ(served.end(), 130);
  const Table answer = read_csv(served.folder / "rec" / "forces.csv");
  const auto &force = *answer.find("force_N"), &depth = *answer.find("depth_mm");
  const std::size_t k = force.size() - 1;
  EXPECT_EQ(depth[k], 1.5);
  EXPECT_GT(force[k], 1e-3);
  const Vec3 vector((*answer.find("force_x_N"))[k], (*answer.find("force_y_N"))[k],
                    (*answer.find("force_z_N"))[k]);
  EXPECT_GE(vector.norm(), force[k] * (1.0 - 1e-6));
  EXPECT_LT(vector.norm(), 1.5 * force[k]);
  EXPECT_TRUE(answer.find("moment_z_Nm"));
  EXPECT_TRUE(fs::exists(served.folder / "rec" / "surface.pvd"));
}

TEST(Poke, ADeviceMovesTheToolInAWindowToo) {
  if (const std::string what = missing_for_windows(); !what.empty()) GTEST_SKIP() << what;
  const fs::path folder = folder_with_brain();
  const fs::path at = fs::temp_directory_path() / fmt::format("dimple_{}_w.sock", getpid());
  Program program(
      folder,
      {"-c",
       fmt::format(
           "exec xvfb-run -a -n $((200 + $$ % 700)) -s '-screen 0 1400x900x24 -noreset' '{}' poke brain.nrrd "
           "--nodes 500 -q --seconds 20 --fps 10 --window --record rec --socket {}",
           DIMPLE_PROGRAM, at.string())},
      "/bin/sh");
  {
    Device device(at);
    ASSERT_TRUE(device.connected()) << program.err_so_far();
    Answer answer;
    for (int k = 0; k < 100; ++k, sleep_ms(100))
      if (answer = answer_in(device.ask("2\n"));
          answer.tool == "there" && answer.error < 0.05 * answer.force.norm())
        break;
    EXPECT_EQ(answer.depth_mm, 2.0);
    EXPECT_GT(answer.force.norm(), 1e-3);
  }
  const Ran ran = program.wait();
  EXPECT_EQ(ran.code, 0) << ran.err;
  EXPECT_THAT(ran.out, HasSubstr(" answers, "));
  const std::vector<double> depth = *read_csv(folder / "rec" / "forces.csv").find("depth_mm");
  EXPECT_EQ(depth.back(), 2.0) << "the tool stays where it was left";
  EXPECT_TRUE(fs::exists(folder / "rec" / "window" / "window_0000.png"));
}

TEST(Poke, APatchThatAScriptMovesAcrossAtDepthHasAnUnknownForceAndOffTheOrganNone) {
  const fs::path folder = folder_with_brain();
  write_file(folder / "path.csv",
             "time_s,x_mm,y_mm,z_mm\n0,13.9,0,27.6\n0.4,13.9,0,23.6\n0.8,13.9,0,23.6\n1.2,17.9,0,22.6\n"
             "1.6,17.9,0,22.6\n2,213.9,0,22.6\n2.4,213.9,0,12.6\n");
  const Ran ran =
      good(folder, "poke brain.nrrd --script path.csv --nodes 600 --evaluations 12 -q --record rec");
  const Table answer = read_csv(folder / "rec" / "forces.csv");
  const auto &time = *answer.find("time_s"), &tool = *answer.find("tool"), &error = *answer.find("error_N"),
             &force = *answer.find("force_N");
  for (std::size_t k = 0; k < time.size(); ++k) {
    if (time[k] >= 1.2 && time[k] <= 1.6) {
      EXPECT_EQ(tool[k], 3.0) << "elsewhere, at " << time[k];
      EXPECT_TRUE(std::isinf(error[k])) << time[k];
      EXPECT_GT(force[k], 1e-3);
    }
    if (time[k] < 2.0) continue;
    EXPECT_EQ(force[k], 0.0) << "off the organ, at " << time[k];
    EXPECT_EQ(error[k], 0.0);
  }
  EXPECT_THAT(ran.out, HasSubstr("the force is not that of the requested pose in "));
  EXPECT_EQ(answer.find("asked_x_mm")->back(), 213.9);
  EXPECT_EQ(answer.find("tip_x_mm")->back(), 213.9) << "in the air it is where it was asked to be";
}

// On the side of a dome a displacement of 1.2 mm across goes deeper in, or out.
TEST(Poke, ASphereThatSlidesOnASlopeComesDownAgainWhereItRestsAndUntilThenItsErrorHolds) {
  const fs::path folder = folder_with_brain();
  const std::string sphere =
      "brain.nrrd --tool sphere:5mm --nodes 500 --fps 10 --evaluations 12 --indent-at 13.9,0,26.6";
  const Table slid = forces_along(
                  folder, "0,13.9,0,30\n0.5,13.9,0,24.6\n1,13.9,0,24.6\n1.1,15.1,0,24.6\n2,15.1,0,24.6\n",
                  sphere),
              fresh = forces_along(folder, "0,15.1,0,40\n0.5,15.1,0,24.6\n1.2,15.1,0,24.6\n", sphere);
  const double truth = fresh.find("force_N")->back();
  EXPECT_GT(std::abs(slid.find("force_N")->at(10) / truth - 1.0), 0.1) << "the two places differ";
  EXPECT_EQ(slid.find("tool")->back(), 0.0);
  EXPECT_NEAR(slid.find("force_N")->back(), truth, 0.01 * truth);
  for (std::size_t k = 11; k < slid.rows(); ++k)
    EXPECT_LE(std::abs(slid.find("force_N")->at(k) - truth), slid.find("error_N")->at(k) + 0.01 * truth) << k;
  EXPECT_LT(slid.find("error_N")->back(), 0.1 * truth) << "an error that is always wide says nothing";
  const std::vector<double>& nodes = *slid.find("nodes");
  EXPECT_GT(*std::min_element(nodes.begin(), nodes.end()), 450.0) << "a script waits for its nodes";
}

TEST(Poke, ASphereArrivesWhereARunArrives) {
  const fs::path folder = folder_with_block(1);
  const Table answer =
      forces_along(folder, "0,0,0,25\n1,0,0,18\n2,0,0,18\n",
                   "block.nrrd --tool sphere:4mm --indent-at 0,0,top --nodes 800 --evaluations 8 --fps 10");
  EXPECT_EQ(answer.find("depth_mm")->back(), answer.find("asked_mm")->back());
  EXPECT_GT(answer.find("depth_mm")->back(), 2.0);
  EXPECT_EQ(answer.find("tool")->back(), 0.0);
}

// The tip is 0.7 mm outside of the block's edge, and the ball 3 mm inside.
TEST(Poke, ABallWhoseSideIsInTheBodyIsNotInTheAir) {
  const fs::path folder = folder_with_block(2);
  const Table answer = forces_along(folder, "0,21,0,30\n0.4,21,0,8\n0.8,21,0,8\n1.2,40,0,8\n1.6,40,0,8\n",
                                    "block.nrrd --tool sphere:4mm --nodes 500 --evaluations 8 --fps 10");
  EXPECT_EQ(answer.find("tool")->front(), 0.0) << "above all";
  EXPECT_EQ(answer.find("tool")->at(8), 3.0) << "elsewhere";
  EXPECT_TRUE(std::isinf(answer.find("error_N")->at(8)));
  EXPECT_EQ(answer.find("tool")->back(), 0.0) << "far beside it";
}

TEST(Poke, ALineThatIsTooLongHasOneAnswerHoweverItComes) {
  Served served;
  Device device(served.at);
  const std::string part(1000, '9');
  EXPECT_EQ(device.ask(part), "error: a line is longer than 256 characters\n");
  for (const char* remaining : {part.c_str(), "\n"}) {
    EXPECT_GT(device.pour(remaining), 0U);
    sleep_ms(150);
  }
  answer_in(device.ask("0\n"));
  EXPECT_EQ(device.ask(part.substr(0, 300) + "\n"), "error: a line is longer than 256 characters\n");
  EXPECT_EQ(device.ask("left a bit\n").rfind("error: a line is x_mm", 0), 0U);
  EXPECT_EQ(served.end(), 130);
  EXPECT_FALSE(fs::exists(served.at));
}

TEST(Poke, AScriptContinuesWhereTheToolCannotComeDown) {
  const fs::path folder = folder_with_block(2);
  write_file(folder / "way.csv",
             "time_s,x_mm,y_mm,z_mm\n0,0,0,25\n0.4,0,0,18\n0.8,0,0,25\n1.2,18.5,0,25\n1.6,18.5,0,16\n2,0,0,"
             "25\n2.4,0,0,18\n");
  const Ran ran =
      good(folder,
           "poke block.nrrd --script way.csv --record live --tool sphere:4mm --nodes 500 --evaluations 8 "
           "--fps 10 -q");
  EXPECT_THAT(ran.out, HasSubstr(" elsewhere"));
  const Table answer = read_csv(folder / "live" / "forces.csv");
  EXPECT_EQ(answer.find("tool")->at(16), 3.0) << "elsewhere";
  EXPECT_TRUE(std::isinf(answer.find("error_N")->at(16)));
  EXPECT_EQ(answer.find("force_N")->at(16), 0.0);
  EXPECT_GT(answer.find("force_N")->back(), 1e-3);
}

TEST(Poke, RefusesAPathThatIsNone) {
  const fs::path folder = folder_with_brain();
  for (const auto& [csv, word] : {std::pair{"time_s,force_N\n0,1\n1,2\n", "depth_mm"},
                                  {"time_s,depth_mm\n0,1\n", "1 row"},
                                  {"time_s,depth_mm\n0,1\n0,2\n", "increase"},
                                  {"time_s,depth_mm\n0,1\n9000,2\n", "9000 s"}}) {
    write_file(folder / "path.csv", csv);
    ends_with(folder, 3, "poke brain.nrrd --script path.csv -q", {word});
  }
  expect_refusals(folder, "poke brain.nrrd",
                  {{2, "--script path.csv --socket a.sock", {}},
                   {2, "--script path.csv --fps 0", {}},
                   {2, "--socket " + std::string(120, 's'), {"107 characters"}}});
}

}  // namespace
}  // namespace dimple
