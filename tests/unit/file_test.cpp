#include "io/file.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include "io/error.hpp"
#include "tests/helpers/folder.hpp"
#include "tests/helpers/report.hpp"
#include "tests/helpers/small_disk.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

std::size_t entries(const fs::path& folder) {
  return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder), {}));
}

TEST(File, HoldsWhatWasWrittenAndNothingIsLeftNextToIt) {
  const fs::path folder = fresh_folder();
  std::string content = "a\0b\r\n";
  content.append(300'000, 'x');
  write_file(folder / "a.bin", content);
  EXPECT_EQ(read_file(folder / "a.bin"), content);
  write_file(folder / "a.bin", "");
  EXPECT_EQ(read_file(folder / "a.bin"), "");
  EXPECT_EQ(entries(folder), 1u);
}

TEST(File, GetsTheRightsThatTheUsersMaskGives) {
  const fs::path folder = fresh_folder();
  const mode_t mask = umask(022);
  write_file(folder / "a.txt", "a");
  umask(mask);
  EXPECT_EQ(fs::status(folder / "a.txt").permissions() & fs::perms::mask, fs::perms(0644));
}

TEST(File, KeepsTheOlderContentWhenTheDiskIsFull) {
  const fs::path folder = fresh_folder();
  write_file(folder / "a.txt", "old");
  expect_error<OutputError>(
      [&] {
        const SmallDisk full(4096);
        write_file(folder / "a.txt", std::string(100'000, 'x'));
      },
      {.fact = "File too large", .remedy = "--output"});
  EXPECT_EQ(read_file(folder / "a.txt"), "old");
  EXPECT_EQ(entries(folder), 1u);
}

TEST(File, SaysWhyItCannotBeWritten) {
  const fs::path folder = fresh_folder();
  fs::create_directory(folder / "taken");
  expect_error<OutputError>([&] { write_file(folder / "no" / "a.txt", "a"); },
                            {.fact = "No such file or directory", .remedy = "create the folder"});
  expect_error<OutputError>([&] { write_file(folder / "taken", "a"); }, {.fact = "Is a directory"});
  EXPECT_EQ(entries(folder), 1u);
}

TEST(File, SaysWhyItCannotBeRead) {
  const fs::path folder = fresh_folder();
  expect_error<InputError>([&] { read_file(folder / "missing.txt"); },
                           {.fact = "missing.txt': No such file", .remedy = "spelling"});
  EXPECT_THROW(read_file(folder), InputError);
  EXPECT_THROW(sha256_of_file(folder / "missing.txt"), InputError);
}

TEST(Error, HasTheExitCodeOfItsKind) {
  EXPECT_EQ(UsageError({}).code, ExitCode::usage);
  EXPECT_EQ(InputError({}).code, ExitCode::input);
  EXPECT_EQ(ModelError({}).code, ExitCode::model);
  EXPECT_EQ(SolveError({}).code, ExitCode::solve);
  EXPECT_EQ(OutputError({}).code, ExitCode::output);
}

TEST(File, HasTheDigestOfTheStandard) {
  // FIPS 180-4 examples; the second is a million times "a", longer than any buffer here.
  const fs::path folder = fresh_folder();
  write_file(folder / "abc", "abc");
  EXPECT_EQ(sha256_of_file(folder / "abc"),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  write_file(folder / "million", std::string(1'000'000, 'a'));
  EXPECT_EQ(sha256_of_file(folder / "million"),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
  write_file(folder / "empty", "");
  EXPECT_EQ(sha256_of_file(folder / "empty"),
            "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(File, HasATemporaryNameWithItsSuffixNextToIt) {
  const fs::path one = temporary_next_to("out/brain.seg.nrrd"), two = temporary_next_to("out/brain.seg.nrrd");
  EXPECT_NE(one, two);
  EXPECT_EQ(one.parent_path(), "out");
  EXPECT_TRUE(one.string().ends_with("brain.seg.nrrd"));
}

TEST(FileList, KeepsFilesThatItHasNot) {
  const fs::path folder = fresh_folder();
  write_file(folder / "mine.txt", "mine");
  {
    const FileList list(folder);
    write_file(folder / "ours.txt", "one");
    { const FileList within(folder); }
    write_file(folder / "ours.txt", "two");
    EXPECT_THROW(write_file(folder / "mine.txt", "ours"), OutputError);
  }
  EXPECT_EQ(read_file(folder / "mine.txt"), "mine");
  EXPECT_EQ(read_file(folder / "ours.txt"), "two");
  EXPECT_EQ(listed_files(folder), std::set<std::string>{"ours.txt"});
  EXPECT_EQ(entries(folder), 3u) << "no temporary is left";
  {
    const FileList again(folder);
    write_file(folder / "ours.txt", "three");
  }
  EXPECT_EQ(read_file(folder / "ours.txt"), "three");
}

TEST(Base64, IsThatOfTheStandard) {  // RFC 4648, section 10
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
  EXPECT_EQ(base64(std::string("\0\xff\xfe", 3)), "AP/+");
}

TEST(Base64, OfAFileThatIsTakenInPiecesIsThatOfTheWhole) {
  const std::size_t piece = 3 << 20;
  for (const std::size_t more : {0, 1, 2}) {
    const std::string text = base64(std::string(2 * piece + more, 'f'));
    std::string expected;
    for (std::size_t k = 0; k < 2 * piece; k += 3) expected += "ZmZm";
    EXPECT_EQ(text == expected + (more == 0 ? "" : more == 1 ? "Zg==" : "ZmY="), true) << more;
  }
}

}  // namespace
}  // namespace dimple
