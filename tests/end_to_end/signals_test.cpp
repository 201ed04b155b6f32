// Ctrl-C, SIGTERM and a time limit: an answer within two seconds, exit code 130, and only valid files.

#include <sys/stat.h>

#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/whole_files.hpp"

namespace dimple {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

class Stop : public InFolder {
 protected:
  // Takes ten seconds or more if not interrupted.
  const std::string slow = "run brain.nrrd -o out --nodes 500 --depth 8mm --rate 0.02mm/s --frames 400 -q";

  void SetUp() override { good("phantom brain.nrrd --spacing 2 -q"); }

  /// Sends the signal after that time, counted from the start or from the `often`-th output of `word`. Every
  /// command ends soon, either normally or with code 130.
  Ran expect_end(const std::string& line, milliseconds after, int signal, const std::string& word = "",
                 int often = 0) const {
    SCOPED_TRACE("dimple " + line + ", signal " + std::to_string(signal) + " after " +
                 std::to_string(after.count()) + " ms");
    Program program(folder, words_of(line));
    program.wait_until_it_listens();
    const auto said = [&] {
      const std::string err = program.err_so_far();
      int count = 0;
      for (auto at = err.find(word); at != std::string::npos; at = err.find(word, at + 1)) ++count;
      return count;
    };
    while (often > 0 && program.running() && said() < often) std::this_thread::sleep_for(milliseconds(5));
    std::this_thread::sleep_for(after);
    const double before_s = program.cpu_s();
    program.send(signal);
    const Ran ran = program.wait();
    EXPECT_LT(ran.cpu_s - before_s, cpu_of(2.0));
    EXPECT_TRUE(ran.code == 130 || ran.code == 0) << ran.code << '\n' << ran.err;
    EXPECT_EQ(ran.code == 130, ran.err.find("interrupted") != std::string::npos)
        << ran.code << ' ' << ran.err;
    return ran;
  }
};

TEST_F(Stop, IsAnsweredWithinTwoSecondsByEveryCommand) {
  good("model brain.nrrd -o made --nodes 400 -q");
  std::ofstream(folder / "curve.csv") << "indentation_mm,force_N\n1,0.006\n2,0.012\n3,0.019\n4,0.026\n";
  const std::vector<std::string> commands = {"info brain.nrrd",
                                             "phantom out/fine.nrrd --spacing 0.4mm",
                                             "model brain.nrrd -o out/model --nodes 8000",
                                             "solve made -o out/solved --frames 200 --rate 0.01mm/s",
                                             "run brain.nrrd -o out/run --nodes 6000",
                                             "export brain.nrrd -o out/scene.inp --nodes 30000",
                                             "fit brain.nrrd -o out/fit --curve curve.csv --of mu,alpha"};
  fs::create_directories(folder / "out");
  int interrupted = 0;
  for (const int after : {50, 600})
    for (const std::string& command : commands) {
      interrupted += expect_end(command, milliseconds(after), after == 50 ? SIGINT : SIGTERM).code == 130;
      expect_whole_files(folder / "out", true);
      for (const auto& entry : fs::directory_iterator(folder / "out")) fs::remove_all(entry);
    }
  EXPECT_GT(interrupted, static_cast<int>(commands.size())) << "of twice as many";
}

// The result is that of the finest discretisation so far, as if requested alone.
TEST_F(Stop, OfARefinementKeepsItsBestForceWithItsErrorBounds) {
  const std::string line =
      "run brain.nrrd -o out --accuracy 0.5% --depth 2mm --frames 4 --write force,picture";
  int with_error_bounds = 0;
  for (int stop = 0; stop < 6; ++stop) {  // during the first three discretisations
    SCOPED_TRACE(stop);
    fs::remove_all(folder / "out");
    const Ran ran = expect_end(line, milliseconds(100 + 300 * (stop % 2)), SIGINT, "refine ", stop / 2);
    if (!fs::exists(folder / "out/force.csv")) continue;
    expect_whole_files(folder / "out", true);
    const Json reported = summary("out"), levels = reported.at("ladder");
    const Table curve = read_csv(folder / "out/force.csv");
    EXPECT_EQ(curve.find("force_N")->back(), levels.back().at("force_N").get<double>());
    EXPECT_EQ(levels.size() > 1, curve.find("low_N") != nullptr);
    EXPECT_EQ(levels.size() > 1, reported.at("band").contains("low_N"));
    with_error_bounds += levels.size() > 1;
  }
  EXPECT_GT(with_error_bounds, 0);
}

// Rows computed before the signal, and the force that the run had found before, are kept.
TEST_F(Stop, OfAnExplanationKeepsTheForceAndTheLinesBeforeIt) {
  int with_lines = 0;
  for (const int said : {0, 1, 2, 5}) {
    SCOPED_TRACE(said);
    fs::remove_all(folder / "out");
    const Ran ran =
        expect_end("run brain.nrrd -o out --explain --band off --nodes 700 --depth 2mm --frames 4",
                   milliseconds(200), SIGINT, "explain  ", said);
    if (!fs::exists(folder / "out/force.csv")) continue;
    expect_whole_files(folder / "out", true);
    EXPECT_EQ(summary("out").at("exit_code"), ran.code);
    EXPECT_EQ(summary("out").at("status"), ran.code == 0 ? "finished" : "interrupted");
    with_lines += fs::exists(folder / "out/explain.csv");
  }
  EXPECT_GT(with_lines, 0);
}

TEST_F(Stop, BeforeThereIsAResultLeavesTheFolderAsItWas) {
  Program program(folder, words_of("run brain.nrrd -o out --nodes 20000"));
  while (program.running() && program.err_so_far().find("organ ") == std::string::npos)
    std::this_thread::sleep_for(milliseconds(5));
  program.send(SIGINT);
  EXPECT_EQ(program.wait().code, 130);
  EXPECT_FALSE(fs::exists(folder / "out"));
}

TEST_F(Stop, OfWorkThatDoesNotListenIsDoneForIt) {
  ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);  // no writer
  const Ran ran = expect_end("run brain.nrrd -o out --config pipe", milliseconds(300), SIGINT);
  EXPECT_EQ(ran.code, 130);
  EXPECT_THAT(ran.err, HasSubstr("work that cannot be stopped"));
}

TEST_F(Stop, RequestedTwiceIsAtOnce) {
  ASSERT_EQ(mkfifo((folder / "pipe").c_str(), 0600), 0);
  Program program(folder, words_of("run brain.nrrd -o out --config pipe"));
  program.wait_until_it_listens();
  std::this_thread::sleep_for(milliseconds(300));
  const auto start = Clock::now();
  program.send(SIGINT);
  std::this_thread::sleep_for(milliseconds(100));
  program.send(SIGINT);
  EXPECT_EQ(program.wait().code, 130);
  EXPECT_LT(seconds_since(start), 2.0) << "which is what one signal leaves it";
}

TEST_F(Stop, ByALimitOfTimeKeepsTheBestStateSoFarAndMayBeResumedWithAnother) {
  // The limit doubles until this machine, busy with other work, has some result.
  int limit = 2;
  Ran ran;
  for (; limit < 100 && ran.out.empty(); limit *= 2) {
    fs::remove_all(folder / "out");
    ran = dimple(folder, slow + " --json --time-limit " + std::to_string(limit) + "s");
    EXPECT_LT(ran.cpu_s, cpu_of(limit + 2.0));
    if (ran.out.find("force_N") == std::string::npos) ran.out.clear();
  }
  EXPECT_EQ(ran.code, 130) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("[out-of-time]"));
  EXPECT_EQ(std::count(ran.err.begin(), ran.err.end(), '\n'), 1) << ran.err;
  const Json json = summary("out");
  EXPECT_EQ(Json::parse(ran.out), json);
  EXPECT_EQ(json.at("status"), "interrupted");
  EXPECT_EQ(json.at("exit_code"), 130);
  EXPECT_EQ(json.at("failure").at("code"), "out-of-time");
  const double reached = json.at("indentation_mm").get<double>();
  EXPECT_GT(reached, 0.0);
  EXPECT_LT(reached, 8.0);
  const Table curve = curve_of(folder / "out");
  EXPECT_EQ(curve.find("indentation_mm")->back(), reached);
  EXPECT_EQ(curve.find("force_N")->back(), json.at("force_N"));
  EXPECT_EQ(std::distance(fs::directory_iterator(folder / "out/points"), fs::directory_iterator()), 1)
      << "the last that was reached";
  EXPECT_FALSE(fs::exists(folder / "out/overview.png")) << "there is no time for a picture";
  expect_whole_files(folder / "out", true);

  EXPECT_EQ(dimple(folder, slow).code, 6);
  const Ran again = dimple(folder, slow + " --resume --time-limit " + std::to_string(limit / 60.0) + "min");
  EXPECT_TRUE(again.code == 130 || again.code == 0) << again.err;
  EXPECT_GT(summary("out").at("indentation_mm"), reached);
}

TEST_F(Stop, ByALimitOfTimeBeforeThereIsAResultSaysSoAndTheCorrectedCommandJustWorks) {
  const Ran ran = dimple(folder, "run brain.nrrd -o out --nodes 20000 --time-limit 0.6s -q");
  EXPECT_EQ(ran.code, 130) << ran.err;
  EXPECT_EQ(summary("out").at("status"), "interrupted");
  EXPECT_EQ(summary("out").at("failure").at("code"), "out-of-time");
  good("run brain.nrrd -o out --nodes 400 --depth 0.5mm --frames 2 --time-limit 1h -q");
  EXPECT_EQ(summary("out").at("status"), "finished");
}

TEST_F(Stop, ByALimitThatIsNoTimeIsRefused) {
  for (const char* limit : {"5mm", "soon", "-1s", "0"}) {
    ends_with(folder, 2, "run brain.nrrd -o out --time-limit=" + std::string(limit), {"--time-limit"});
  }
  EXPECT_FALSE(fs::exists(folder / "out"));
}

}  // namespace
}  // namespace dimple
