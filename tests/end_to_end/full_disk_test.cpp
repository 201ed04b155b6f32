// Results that cannot be written: exit code 6, a message, and no broken file under a final name.

#include <fcntl.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/whole_files.hpp"

namespace dimple {
namespace {

/// Limits the size of each file to `bytes` during its lifetime, for this process and those that it starts.
struct SmallFiles {
  rlimit before{};
  explicit SmallFiles(rlim_t bytes) {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before);
    const rlimit limit{bytes, before.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~SmallFiles() {
    setrlimit(RLIMIT_FSIZE, &before);
    std::signal(SIGXFSZ, SIG_DFL);
  }
};

/// True if the process can have mounts of its own, which end with it; no rights needed with user namespaces.
bool own_mounts() {
  static const bool granted = [] {
    const uid_t user = getuid();
    const gid_t group = getgid();
    if (unshare(CLONE_NEWNS) != 0) {
      if (unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0) return false;
      std::ofstream("/proc/self/setgroups") << "deny";
      std::ofstream("/proc/self/uid_map") << user << ' ' << user << " 1";
      std::ofstream("/proc/self/gid_map") << group << ' ' << group << " 1";
    }
    return mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0;
  }();
  return granted;
}

struct Mount {
  fs::path at;
  bool good;
  Mount(fs::path folder, const char* type, unsigned long flags, const std::string& options)
      : at(std::move(folder)) {
    fs::create_directories(at);
    good = own_mounts() && mount(type, at.c_str(), type, flags, options.c_str()) == 0;
  }
  ~Mount() {
    if (good) umount2(at.c_str(), MNT_DETACH);
  }
};

class FullDisk : public InFolder {
 protected:
  const std::string run = "run brain.nrrd --nodes 500 --depth 2mm --frames 12 -q -o ";

  void SetUp() override {
    good("phantom brain.nrrd --spacing 3 -q");
    good("model brain.nrrd -o model --nodes 500 -q");
  }
  /// Commands that write their results to the place `out`; each needs some seconds at most.
  static std::vector<std::string> writers(const std::string& out) {
    return {"phantom " + out + "/p.nrrd --spacing 3 -q",
            "phantom " + out + "/p.seg.nrrd --spacing 3 -q",
            "phantom " + out + "/p.nii.gz --spacing 3 -q",
            "phantom " + out + "/p.mha --spacing 3 -q",
            "export brain.nrrd --nodes 800 -q -o " + out + "/scene.inp",
            "export brain.nrrd --nodes 800 -q -o " + out + "/scene.feb",
            "model brain.nrrd --nodes 500 -q -o " + out + "/model",
            "solve model --depth 1mm --frames 2 -q -o " + out + "/solved",
            "run brain.nrrd --nodes 500 --depth 1mm --frames 2 -q -o " + out + "/run"};
  }
};

TEST_F(FullDisk, OfAnySizeLeavesWholeFilesOrNone) {
  int refused = 0;
  for (const rlim_t bytes : {0, 100, 2'000, 20'000, 100'000}) {
    const std::string out = "limit_" + std::to_string(bytes);
    fs::create_directories(folder / out);
    for (const std::string& command : writers(out)) {
      SCOPED_TRACE(command);
      Ran ran;
      {
        const SmallFiles limit(bytes);
        ran = dimple(folder, command);
      }
      if (ran.code == 0) continue;
      ++refused;
      // Without any free byte even the message cannot be written.
      if (bytes > 1000) expect_refusal(ran, 6, {"File too large"});
      EXPECT_EQ(ran.code, 6) << ran.err;
    }
    expect_whole_files(folder / out, true);
  }
  EXPECT_GT(refused, 25);
}

TEST_F(FullDisk, ThatHasRoomAgainLetsARunContinue) {
  good(run + "undisturbed");
  const Ran ran = [&] {
    const SmallFiles limit(60'000);  // the model fits, no frame of the points does
    return dimple(folder, run + "out");
  }();
  expect_refusal(ran, 6, {"File too large", "--output"});
  expect_whole_files(folder / "out", true);
  good(run + "out --resume");
  expect_same_results(folder / "undisturbed", folder / "out");
}

TEST_F(FullDisk, ReallyFull) {
  if (!Mount(folder / "trial", "tmpfs", 0, "size=64k").good)
    GTEST_SKIP() << "skipped: this user may not mount a small file system";
  good(run + "undisturbed");
  int refused = 0;
  for (const int kilobytes : {8, 100, 700, 1200}) {
    SCOPED_TRACE(std::to_string(kilobytes) + " kB");
    const std::string name = "disk_" + std::to_string(kilobytes);
    const Mount disk(folder / name, "tmpfs", 0, "size=" + std::to_string(kilobytes) + "k");
    ASSERT_TRUE(disk.good);
    for (const std::string& command : writers(name)) {
      SCOPED_TRACE(command);
      const Ran ran = dimple(folder, command);
      refused += ran.code == 6;
      if (ran.code != 0) expect_refusal(ran, 6, {"No space left on device"});
      expect_whole_files(disk.at, true);
      for (const auto& entry : fs::directory_iterator(disk.at)) fs::remove_all(entry);
    }
    const Ran ran = dimple(folder, run + name + "/out");
    if (ran.code == 0) continue;
    expect_refusal(ran, 6, {"No space left on device"});
    ASSERT_EQ(mount("tmpfs", disk.at.c_str(), "tmpfs", MS_REMOUNT, "size=50m"), 0);  // room again
    good(run + name + "/out --resume");
    expect_same_results(folder / "undisturbed", folder / name / "out");
  }
  EXPECT_GT(refused, 10);
}

TEST_F(FullDisk, OrOneThatMayOnlyBeReadIsRefusedInWords) {
  fs::create_directories(folder / "disk");
  const Mount disk(folder / "disk", "tmpfs", 0, "size=20m");
  if (!disk.good) GTEST_SKIP() << "skipped: this user may not mount a file system";
  good(run + "disk/earlier");
  const auto before = files_in(disk.at);
  ASSERT_EQ(mount("tmpfs", disk.at.c_str(), "tmpfs", MS_REMOUNT | MS_RDONLY, ""), 0);
  for (const std::string& command : writers("disk")) {
    SCOPED_TRACE(command);
    expect_refusal(dimple(folder, command), 6, {"Read-only file system"});
  }
  const Ran ran = dimple(folder, run + "disk/earlier --force");
  expect_refusal(ran, 6, {"Read-only file system"});
  EXPECT_EQ(files_in(disk.at), before);
}

TEST_F(FullDisk, BehindTheStandardOutputIsNoticed) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "skipped: there is no /dev/full";
  for (const char* command :
       {"options", "run brain.nrrd --nodes 400 --depth 0.5mm --frames 1 -q --json -o out"}) {
    const Ran ran =
        Program(folder, {"-c", std::string(DIMPLE_PROGRAM " ") + command + " > /dev/full"}, "/bin/sh").wait();
    expect_refusal(ran, 6, {"standard output"});
  }
  expect_whole_files(folder / "out", true);
  EXPECT_TRUE(fs::exists(folder / "out" / "summary.json"));
  const Ran silent =
      Program(folder, {"-c", DIMPLE_PROGRAM " run nowhere.nrrd -o other 2> /dev/full"}, "/bin/sh").wait();
  EXPECT_EQ(silent.code, 3);
}

TEST(ClosedStreams, OfMessagesLeaveTheRunAsItIs) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom block.nrrd --shape block --size 40,40,20 --spacing 2");
  const Ran ran = Program(folder,
                          {"-c", DIMPLE_PROGRAM " run block.nrrd -o out --nodes 300 --depth 1mm "
                                                "--frames 1 --band off --write force 2>&-"},
                          "/bin/sh")
                      .wait();
  EXPECT_EQ(ran.code, 0);
  EXPECT_GT(fs::file_size(folder / "out" / "force.csv"), 0u);
}

}  // namespace
}  // namespace dimple
