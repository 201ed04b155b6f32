// No loss of data: neither in a folder with results, nor when a run is stopped or killed.

#include <iostream>
#include <random>

#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/whole_files.hpp"

namespace dimple {
namespace {

using Clock = std::chrono::steady_clock;

class Resume : public InFolder {
 protected:
  // The slow run takes some seconds, long enough to be interrupted.
  const std::string slow = "run brain.nrrd -o out --nodes 500 --depth 4mm --rate 0.02mm/s --frames 100 -q";
  const std::string quick = "run brain.nrrd -o out --nodes 400 --depth 0.5mm --frames 2 -q";

  void SetUp() override { good("phantom brain.nrrd --spacing 3 -q"); }

  /// The slow run, stopped by `signal` some time after its first checkpoint.
  Ran stopped(int signal) const {
    Program program(folder, words_of(slow));
    while (program.running() && !fs::exists(folder / "out" / "checkpoint.cbor"))
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    EXPECT_TRUE(program.running()) << program.err_so_far();
    program.send(signal);
    return program.wait();
  }
};

TEST_F(Resume, IsOneOfTwoThingsThatMayBeDoneWithResultsThatAreThere) {
  good(quick);
  const std::string before = text_of(folder / "out" / "force.csv");
  refused(6, quick, {"out holds the results of a run", "--force"});
  refused(6, quick + " --mu 300", {"out holds the results of a run"});
  refused(2, quick + " --force --resume", {"--force"});
  EXPECT_EQ(text_of(folder / "out" / "force.csv"), before);
  good(quick + " --mu 300 --force");
  EXPECT_NE(text_of(folder / "out" / "force.csv"), before);
  good("solve out/model -o out --depth 0.5mm --frames 2 -q --force");
  EXPECT_TRUE(fs::exists(folder / "out" / "model" / "model.toml")) << "what was solved is no result";
  good("model brain.nrrd -o model --nodes 400 -q");
  refused(6, "model brain.nrrd -o model --nodes 500 -q", {"model holds a model already", "--force"});
  good("model brain.nrrd -o model --nodes 450 -q --force");
  good("solve model -o model --depth 0.5mm --frames 2 -q");  // a model alone: no results are there yet
  refused(6, "solve model -o model --depth 0.5mm --frames 2 -q", {"model holds the results of a run"});
  good("solve model -o model --depth 0.5mm --frames 3 -q --force");
}

TEST_F(Resume, OfAFinishedRunSaysSoAndChangesNothing) {
  const std::string line =
      "run brain.nrrd -o out --nodes 400 --depth 0.5mm --frames 2 --preset miller_chinzei_2002 --label 1,2";
  good(line + " -q");
  const auto times = [&] {
    std::vector<fs::file_time_type> list;
    for (const std::string& name : files_in(folder / "out"))
      list.push_back(fs::last_write_time(folder / "out" / name));
    return list;
  };
  const auto before = times();
  const std::string again = line + " --resume";
  const Ran ran = good(again);
  EXPECT_THAT(ran.err, HasSubstr("finished"));
  EXPECT_THAT(ran.out, HasSubstr("N at 0.50 mm, no error estimate: "));
  EXPECT_EQ(good(again + " --json").out, text_of(folder / "out" / "summary.json"));
  EXPECT_EQ(times(), before);
  refused(2, again + " --mu 300", {"material.mu_Pa is 300.0 now, and was 842.0", "--force"});
  refused(2, again + " --write force", {"output.write is [\"force\"] now, and was [\"all\"]", "--force"});

  good("solve out/model -o solved --depth 0.5mm --frames 2 -q");
  good("solve out/model -o solved --depth 0.5mm --frames 2 -q --resume");
  good("model brain.nrrd -o other --nodes 420 -q");
  refused(2, "solve other -o solved --depth 0.5mm --frames 2 -q --resume", {"the image or model differs"});
}

TEST_F(Resume, OfARunThatWasInterruptedEndsAsIfItHadNotBeen) {
  good(slow);
  fs::rename(folder / "out", folder / "undisturbed");
  const Ran ran = stopped(SIGINT);
  EXPECT_EQ(ran.code, 130) << ran.err;
  expect_whole_files(folder / "out", true);
  EXPECT_EQ(summary().at("status"), "interrupted");
  refused(6, slow, {"unfinished run", "--resume", "--force"});
  refused(2, slow + " --resume --mu 300", {"material.mu_Pa is 300.0 now, and was 210.0", "--force"});
  refused(2, slow + " --resume --set tissue.1.mu=300", {"tissue.1.mu_Pa is", "not set"});
  fs::rename(folder / "brain.nrrd", folder / "same.nrrd");
  good("phantom brain.nrrd --spacing 3.1 -q");
  refused(2, slow + " --resume", {"the image or model differs"});
  fs::rename(folder / "same.nrrd", folder / "brain.nrrd");
  good(slow + " --resume");
  expect_same_results(folder / "undisturbed", folder / "out");
}

TEST_F(Resume, OfACheckpointThatIsDamagedIsRefused) {
  EXPECT_EQ(stopped(SIGKILL).code, 128 + SIGKILL);
  const fs::path checkpoint = folder / "out" / "checkpoint.cbor";
  const std::string whole = text_of(checkpoint);
  for (const std::size_t length : {std::size_t{0}, std::size_t{40}, whole.size() / 2, whole.size() - 1}) {
    std::ofstream(checkpoint, std::ios::binary) << whole.substr(0, length);
    refused(3, slow + " --resume", {"checkpoint.cbor", "cannot be read", "--force"});
  }
  for (std::size_t k = 0; k < 25; ++k) {
    std::string flipped = whole;
    flipped[k * (whole.size() - 1) / 24] ^= static_cast<char>(1 << k % 8);
    std::ofstream(checkpoint, std::ios::binary) << flipped;
    refused(3, slow + " --resume", {"checkpoint.cbor", "cannot be read", "checksum", "--force"});
  }
  std::ofstream(checkpoint, std::ios::binary) << whole;
  fs::remove(folder / "out" / "nodes" / "nodes_0000.vtu");
  refused(6, slow + " --resume", {"nodes_0000.vtu has disappeared", "--force"});
}

TEST_F(Resume, OfNothingBeginsAtTheBeginning) {
  good(quick + " --resume");
  fs::rename(folder / "out", folder / "one");
  fs::create_directories(folder / "out" / "model");  // as after a kill at the first file
  std::ofstream(folder / "out" / ".dimple_files") << "";
  std::ofstream(folder / "out" / "model" / ".12-0-nodes.vtu") << "<VTKF";
  refused(6, quick, {"unfinished run"});
  good(quick + " --resume");
  expect_same_results(folder / "one", folder / "out");
}

TEST_F(Resume, OrAnythingElseInAFolderWhereARunIsAtWorkIsRefused) {
  // The run takes longer than three others wait for it to end.
  const std::string longer = "run brain.nrrd -o out --nodes 500 --depth 4mm --rate 0.02mm/s --frames 600 -q";
  Program program(folder, words_of(longer));
  while (program.running() && !fs::exists(folder / "out" / "nodes" / "nodes_0002.vtu"))
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  for (const char* how : {"", " --force", " --resume"})
    refused(6, longer + how, {"another run is writing to out"});
  EXPECT_TRUE(program.running());
}

// ----------------------------------------------------------------------------------------------- kill -9

/// Runs are killed at random, some of them several times, then resumed to their end. DIMPLE_KILLS is the
/// total number of kills.
TEST_F(Resume, OfRunsThatWereKilledAtAnyMomentEndsWithTheSameBits) {
  struct Scene {
    std::string name, arguments;
    double seconds = 0.0;
  };
  const std::string node_set = " --nodes 300 -q";
  std::vector<Scene> scenes = {
      {"slowly", "--depth 5mm --frames 25" + node_set},
      {"slowly_relaxing", "--depth 5mm --frames 25 --preset miller_chinzei_2002" + node_set},
      {"every_wave", "--depth 3mm --rate 20mm/s --frames 6 --time explicit" + node_set},
      {"touching",
       "--depth 3mm --frames 25 --tool sphere:5mm --friction 0.3 --wall around:0.2mm "
       "--set wall.wall.friction=0.3" +
           node_set},
      {"covered",
       "--depth 3mm --frames 25 --membrane 0.1mm:400kPa --set membrane.skin.tension=1N/m" + node_set},
      {"papers_scheme", "--depth 3mm --rate 4mm/s --frames 6 --scheme horton2007" + node_set},
  };
  for (Scene& scene : scenes) {
    const auto start = Clock::now();
    good("run brain.nrrd -o undisturbed_" + scene.name + ' ' + scene.arguments);
    scene.seconds = std::chrono::duration<double>(Clock::now() - start).count();
  }
  const char* variable = std::getenv("DIMPLE_KILLS");
  const int requested = variable ? std::atoi(variable) : 12;
  std::mt19937 random(7);
  int kills = 0, resumed_midway = 0, rounds = 0;
  for (; kills < requested && !HasFailure(); ++rounds) {
    const int laps = rounds / static_cast<int>(scenes.size());
    const Scene& scene = scenes[static_cast<std::size_t>(rounds) % scenes.size()];
    // Every second run reaches its first checkpoint; the remainder from there is a small part of a run.
    const bool while_it_marches = (rounds + laps) % 2 == 1;
    SCOPED_TRACE(scene.name + ", round " + std::to_string(rounds));
    const std::string line = "run brain.nrrd -o out " + scene.arguments + " --resume";
    fs::remove_all(folder / "out");
    for (bool again = true; again;) {
      Program program(folder, words_of(line));
      while (while_it_marches && program.running() && !fs::exists(folder / "out" / "checkpoint.cbor"))
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      std::uniform_real_distribution<double> moment(0.0, (while_it_marches ? 0.1 : 1.0) * scene.seconds);
      std::this_thread::sleep_for(std::chrono::duration<double>(moment(random)));
      again = program.running() && kills < requested;
      if (!again) break;
      program.send(SIGKILL);
      const int code = program.wait().code;
      if (code == 0) break;  // it ended meanwhile
      ASSERT_EQ(code, 128 + SIGKILL);
      ++kills;
      if (fs::exists(folder / "out")) expect_whole_files(folder / "out", false);
      again = random() % 3 == 0;
    }
    resumed_midway += fs::exists(folder / "out" / "checkpoint.cbor") ? 1 : 0;
    good(line);
    expect_same_results(folder / ("undisturbed_" + scene.name), folder / "out");
  }
  std::cout << kills << " kills in " << rounds << " runs, " << resumed_midway
            << " of them resumed half-way\n";
  EXPECT_EQ(kills, requested);
  EXPECT_GT(resumed_midway, 0);
}

}  // namespace
}  // namespace dimple
