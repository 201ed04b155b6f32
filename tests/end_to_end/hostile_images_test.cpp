// Images that are broken, hostile or inconsistent: each is refused with a message or read correctly. None may
// end the program by a signal, stall it, or use more memory than a valid image of that size.

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <cctype>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "tests/end_to_end/image_bytes.hpp"
#include "tests/end_to_end/program.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Eigen::Affine3d;
using Eigen::Scaling;
using Words = std::vector<std::string>;
using Files = std::vector<std::pair<std::string, std::string>>;  ///< name, bytes

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr double slower = 5.0;  // a sanitizer also needs as many times the memory
#else
constexpr double slower = 1.0;
#endif
constexpr double memory_limit_MB = 1000.0 * slower;
constexpr double time_limit_s = 20.0 * slower;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// One image, and the result that `dimple info` must have.
struct Case {
  std::string name = {};  ///< a sentence
  Files files = {};       ///< the first is the image
  int code = 0;
  Words words = {};                                   ///< of the refusal, or of each warning in order
  std::map<int, int> counts = organ_counts;           ///< voxels of each label; empty: too many to list
  Affine3d to_world = SmallOrgan().to_world;          ///< placement of voxel (i, j, k) of the small organ
  std::function<void(const fs::path&)> prepare = {};  ///< makes files that a list cannot describe
  std::string argument = files.empty() ? "" : files.front().first;
  Words more_arguments = {};
  std::string name_of_1 = {};  ///< of label 1, if it is checked
};

void PrintTo(const Case& c, std::ostream* out) {
  *out << c.name;
}

Case refused(std::string name, Files files, Words words) {
  return {.name = std::move(name), .files = std::move(files), .code = 3, .words = std::move(words)};
}

Case right(std::string name, Files files, Words warnings = {}) {
  return {.name = std::move(name), .files = std::move(files), .words = std::move(warnings)};
}

Case named(std::string name, Files files, std::string name_of_1, Words warnings = {}) {
  Case c = right(std::move(name), std::move(files), std::move(warnings));
  c.name_of_1 = std::move(name_of_1);
  return c;
}

Case placed(std::string name, Files files, const Affine3d& to_world, Words warnings = {}) {
  return {
      .name = std::move(name), .files = std::move(files), .words = std::move(warnings), .to_world = to_world};
}

Case counted(std::string name, Files files, std::map<int, int> counts, Words warnings = {}) {
  return {.name = std::move(name),
          .files = std::move(files),
          .words = std::move(warnings),
          .counts = std::move(counts)};
}

Case prepared(std::string name, std::string argument, std::function<void(const fs::path&)> prepare,
              Words words, int code = 3) {
  return {.name = std::move(name),
          .code = code,
          .words = std::move(words),
          .prepare = std::move(prepare),
          .argument = std::move(argument)};
}

void write(const fs::path& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary) << bytes;
}

/// Case whose bytes are too many to be made for every test at the start.
Case large(std::string name, const std::string& file, std::function<std::string()> bytes, Words words) {
  return prepared(
      std::move(name), file, [=](const fs::path& folder) { write(folder / file, bytes()); },
      std::move(words));
}

std::string first(const std::string& bytes, std::size_t count) {
  return bytes.substr(0, count);
}

std::string without_last(const std::string& bytes, std::size_t count) {
  return bytes.substr(0, bytes.size() - count);
}

std::string with_flipped_byte(std::string bytes, std::size_t place) {
  bytes.at(place) = static_cast<char>(bytes.at(place) ^ 0x55);
  return bytes;
}

/// Random bytes, which do not compress.
std::string noise(std::size_t count) {
  std::mt19937 random(5);
  std::string bytes(count, '\0');
  for (char& byte : bytes) byte = static_cast<char>(random());
  return bytes;
}

/// The small organ with another value in one voxel.
SmallOrgan with_voxel(double value) {
  SmallOrgan organ;
  organ.at(4, 4, 3) = value;
  return organ;
}

Affine3d sheared(double shear) {
  Affine3d m = SmallOrgan().to_world;
  Eigen::Matrix3d s = Eigen::Matrix3d::Identity();
  s(0, 1) = shear;
  m.linear() = s * m.linear();
  return m;
}

Affine3d left_handed() {
  Affine3d m = SmallOrgan().to_world;
  m.linear().col(0) *= -1.0;
  return m;
}

Affine3d turned() {
  return Eigen::AngleAxisd(0.4, Eigen::Vector3d(1, -2, 3).normalized()) * SmallOrgan().to_world;
}

Affine3d degenerate() {
  Affine3d m = SmallOrgan().to_world;
  m.linear().col(1) = m.linear().col(0);
  return m;
}

Affine3d not_finite() {
  Affine3d m = SmallOrgan().to_world;
  m.matrix()(1, 3) = nan;
  return m;
}

Affine3d spaced(double x, double y, double z) {
  Affine3d m = SmallOrgan().to_world;
  m.linear() = Eigen::Vector3d(x, y, z).asDiagonal();
  return m;
}

const std::map<int, int> doubled_counts = {{2, 206}, {4, 1}, {6, 1}, {8, 1}, {10, 1}};

/// Grey values like those of an MRI, in a type that a label image may have.
std::string grey_values() {
  std::mt19937 random(11);
  std::vector<double> grey(20 * 20 * 20);
  for (double& v : grey) v = 200.0 + static_cast<double>(random() % 900);
  return as_bytes<std::int16_t>(grey);
}

Words with_four_parts(const Words& words) {
  Words all = {"\n  where: ", "\n  why:   ", "\n  try:   "};
  all.insert(all.end(), words.begin(), words.end());
  return all;
}

class HostileImage : public testing::TestWithParam<Case> {};

TEST_P(HostileImage, IsRefusedInWordsOrReadRight) {
  const Case& c = GetParam();
  const fs::path folder = fresh_folder();
  double honest_MB = 0.0;
  for (const auto& [name, bytes] : c.files) {
    fs::create_directories((folder / name).parent_path());
    write(folder / name, bytes);
    honest_MB += static_cast<double>(bytes.size()) / 1e6;
  }
  if (c.prepare) c.prepare(folder);

  Words arguments = {"info", c.argument, "--json"};
  arguments.insert(arguments.end(), c.more_arguments.begin(), c.more_arguments.end());
  rlimit unlimited{};
  getrlimit(RLIMIT_AS, &unlimited);
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)  // their shadows are larger
  if (c.words == Words{"memory"}) GTEST_SKIP() << "memory cannot be limited under a sanitizer";
#else
  const rlimit limited{6'000'000'000, unlimited.rlim_max};
  setrlimit(RLIMIT_AS, &limited);  // limits the program's memory, to protect the machine
#endif
  Program program(folder, arguments);
  setrlimit(RLIMIT_AS, &unlimited);
  while (program.running() && program.cpu_s() < time_limit_s)
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  if (program.running()) {
    program.send(SIGKILL);
    program.wait();
    FAIL() << "still busy after " << time_limit_s << " s of CPU time";
  }
  const Ran ran = program.wait();
  fs::remove_all(folder);
  RecordProperty("peak_MB", std::to_string(static_cast<int>(ran.peak_MB)));
  EXPECT_LT(ran.peak_MB, memory_limit_MB + honest_MB);
  ASSERT_EQ(ran.code, c.code) << ran.out << ran.err;
  const auto json = nlohmann::json::parse(ran.out);

  if (c.code != 0) {
    EXPECT_TRUE(ran.err.starts_with("dimple: ")) << "a library speaks: " << ran.err;
    for (const std::string& word : with_four_parts(c.words))
      EXPECT_NE(ran.err.find(word), std::string::npos) << "no '" << word << "' in\n" << ran.err;
    EXPECT_EQ(json.at("exit_code"), c.code);
    for (const char* trace :
         {"itk::", "ITK ERROR", "/usr/include", ".cxx", ".hxx", "[nrrd]", "0x5", "std::", "vector::"})
      EXPECT_EQ(ran.err.find(trace), std::string::npos) << "the library's own words: " << ran.err;
    return;
  }
  EXPECT_EQ(ran.err, "");
  const auto& warnings = json.at("warnings");
  EXPECT_EQ(warnings.size(), c.words.size()) << warnings.dump(1);
  for (std::size_t w = 0; w < std::min(warnings.size(), c.words.size()); ++w)
    EXPECT_NE(warnings[w].get<std::string>().find(c.words[w]), std::string::npos) << warnings.dump(1);

  std::map<int, int> counts;
  for (const auto& label : json.at("labels")) {
    const int value = label.at("value");
    counts[value] = label.at("voxels");
    if (value == 1 && !c.name_of_1.empty()) {
      EXPECT_EQ(label.at("name"), c.name_of_1);
    }
    const auto place = organ_places.find(value);
    if (c.counts != organ_counts || place == organ_places.end()) continue;
    const Eigen::Vector3d expected =
        c.to_world * Eigen::Vector3d(place->second[0], place->second[1], place->second[2]);
    for (int r = 0; r < 3; ++r)
      EXPECT_NEAR(label.at("centre_mm").at(static_cast<std::size_t>(r)).get<double>(), expected[r], 1e-4)
          << "label " << value << ", coordinate " << r;
  }
  if (!c.counts.empty()) {
    EXPECT_EQ(counts, c.counts);
  }
}

// ------------------------------------------------------------------------------------------------- NIfTI

/// NIfTI-2 by the byte offsets of the standard, with an sform.
std::string nifti_2() {
  const SmallOrgan organ;
  std::string header(544, '\0');
  const auto set = [&](std::size_t offset, auto value) {
    std::memcpy(header.data() + offset, &value, sizeof value);
  };
  set(0, std::int32_t{540});
  header.replace(4, 8, std::string("n+2\0\r\n\x1a\n", 8));
  set(12, std::int16_t{2});
  set(14, std::int16_t{8});
  set(16, std::int64_t{3});
  for (std::size_t a = 0; a < 3; ++a) set(24 + 8 * a, std::int64_t{organ.size[a]});
  for (int a = 0; a < 3; ++a)
    set(static_cast<std::size_t>(112 + 8 * a), organ.to_world.linear().col(a).norm());  // pixdim
  set(168, std::int64_t{544});
  set(348, std::int32_t{1});
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 4; ++c)
      set(static_cast<std::size_t>(400 + 32 * r + 8 * c),
          (r < 2 ? -1.0 : 1.0) * organ.to_world.matrix()(r, c));
  set(500, std::int32_t{2});
  return header + as_bytes<std::uint8_t>(organ.voxel);
}

std::vector<Case> nifti_cases() {
  const std::string whole = Nifti().file(), packed = gzip(whole);
  const std::string voxels = as_bytes<std::uint8_t>(SmallOrgan().voxel);
  const auto of_type = [](int code, int bits, std::string bytes) {
    return Nifti().type(code, bits).data(std::move(bytes)).file();
  };
  const auto floats = [&](double value) { return of_type(16, 32, as_bytes<float>(with_voxel(value).voxel)); };
  const auto sform_only = [](const Affine3d& m) {
    Nifti nifti = Nifti().qform(0).sform(1, m);
    for (int a = 0; a < 3; ++a) nifti.pixdim(a + 1, m.linear().col(a).norm());
    return nifti.file();
  };
  const auto qform_only = [] { return Nifti().sform(0, Affine3d::Identity()); };
  const auto without_place = [] { return Nifti().sform(0, Affine3d::Identity()).qform(0); };
  const auto in_unit = [](char unit, double factor) {
    SmallOrgan organ;
    organ.to_world = Scaling(1.0 / factor) * organ.to_world;
    return Nifti(organ).set(123, unit).file();
  };
  const Affine3d plain = SmallOrgan().to_world;
  const Affine3d bare = Affine3d(Scaling(1.5, 2.0, 2.5));

  const std::string two = nifti_2();
  std::string dicom(2000, '\0');
  dicom.replace(128, 4, "DICM");
  const Nifti pair = Nifti().set(108, 0.0f).set(344, std::array<char, 4>{'n', 'i', '1', '\0'});
  SmallOrgan shifted;
  for (double& v : shifted.voxel) v = 7.0 + 2.0 * v;
  const std::string stored = as_bytes<std::int16_t>(shifted.voxel);

  std::vector<Case> cases = {
      // cut short or damaged
      refused("An empty NIfTI", {{"a.nii", ""}}, {"ends after 0 of 348 bytes"}),
      refused("A NIfTI cut in its header", {{"a.nii", first(whole, 200)}}, {"ends after 200 of 348"}),
      refused("A NIfTI that is all header", {{"a.nii", first(whole, 352)}}, {"0 of 504 bytes", "incomplete"}),
      refused("A NIfTI cut by one byte", {{"a.nii", without_last(whole, 1)}},
              {"503 of 504 bytes", "incomplete"}),
      refused("A gzipped NIfTI cut in its voxels", {{"a.nii.gz", without_last(packed, 20)}}, {"incomplete"}),
      refused("A gzipped NIfTI cut in its first bytes", {{"a.nii.gz", first(packed, 12)}}, {"incomplete"}),
      refused("A gzipped NIfTI without its checksum", {{"a.nii.gz", without_last(packed, 8)}}, {"checksum"}),
      refused("A gzipped NIfTI with another checksum",
              {{"a.nii.gz", with_flipped_byte(packed, packed.size() - 6)}}, {"damaged"}),
      refused("A gzipped NIfTI damaged in its middle",
              {{"a.nii.gz", with_flipped_byte(packed, packed.size() / 2)}}, {"damaged"}),
      right("A gzipped NIfTI with rubbish after its end", {{"a.nii.gz", packed + "rubbish after the end"}}),
      right("A NIfTI gzipped in two members",
            {{"a.nii.gz", gzip(first(whole, 500)) + gzip(whole.substr(500))}}),
      right("A gzipped NIfTI under the name of a plain one", {{"a.nii", packed}}),
      right("A plain NIfTI under the name of a gzipped one", {{"a.nii.gz", whole}}),
      right("A NIfTI that goes on after its voxels", {{"a.nii", whole + std::string(252, '\1')}},
            {"has 252 more bytes after its voxels"}),
      right("A gzipped NIfTI that goes on after its voxels",
            {{"a.nii.gz", gzip(whole + std::string(252, '\1'))}}, {"more bytes after its voxels"}),

      // sizes
      refused("A NIfTI of 1500 voxels each way in one kilobyte",
              {{"a.nii", Nifti().dims({1500, 1500, 1500}).file()}}, {"3.38e+09 voxels"}),
      refused("A NIfTI of 1200 voxels each way in one kilobyte",
              {{"a.nii", Nifti().dims({1200, 1200, 1200}).file()}}, {"cannot hold 1728000000 bytes"}),
      large("A NIfTI of a thousand voxels each way in two megabytes", "a.nii",
            [] {
              return Nifti().dims({1000, 1000, 1000}).data(std::string(2'000'000, '\1')).file();
            },
            {"2000000 of 1000000000 bytes"}),
      large("A gzipped NIfTI of a thousand voxels each way in two megabytes", "a.nii.gz",
            [] {
              return gzip(Nifti().dims({1000, 1000, 1000}).data(noise(2'000'000)).file());
            },
            {"2000000 of 1000000000 bytes"}),
      large("A NIfTI of doubles larger than any memory", "a.nii.gz",
            [] {
              return gzip(Nifti().dims({1290, 1290, 1290}).type(64, 64).data(noise(1'000'000)).file());
            },
            {"cannot hold 17173512000 bytes"}),
      refused("A NIfTI of 32767 voxels each way", {{"a.nii", Nifti().dims({32767, 32767, 32767}).file()}},
              {"3.52e+13 voxels"}),
      large("A gzipped NIfTI of nothing but zeros that unpacks to 216 megabytes", "a.nii.gz",
            [] {
              return gzip(Nifti().dims({600, 600, 600}).data(std::string(216'000'000, '\0')).file());
            },
            {"all 216000000 voxels are background"}),
      refused("A NIfTI with a negative size", {{"a.nii", Nifti().dims({9, -8, 7}).file()}}, {"-8 voxels"}),
      refused("A NIfTI with a size of zero", {{"a.nii", Nifti().dims({9, 8, 0}).file()}}, {"0 voxels"}),
      refused("A NIfTI without axes", {{"a.nii", Nifti().set(40, std::int16_t{0}).file()}}, {"0 axes"}),
      refused("A NIfTI of nine axes", {{"a.nii", Nifti().set(40, std::int16_t{9}).file()}}, {"9 axes"}),
      refused("A NIfTI of minus three axes", {{"a.nii", Nifti().set(40, std::int16_t{-3}).file()}},
              {"-3 axes"}),
      refused("A flat NIfTI", {{"a.nii", Nifti().dims({24, 21}).file()}}, {"flat: 24 x 21 voxels"}),
      refused("A NIfTI of one slice", {{"a.nii", Nifti().dims({24, 21, 1}).file()}},
              {"flat", "one slice", "whole segmented volume"}),
      refused("A NIfTI of two time frames",
              {{"a.nii", Nifti().dims({9, 8, 7, 2}).data(voxels + voxels).file()}},
              {"4 axes (9 x 8 x 7 x 2 voxels)", "time frame"}),
      refused("A NIfTI of vectors",
              {{"a.nii", Nifti().dims({9, 8, 7, 1, 3}).data(voxels + voxels + voxels).file()}},
              {"holds 3 numbers"}),
      right("A NIfTI with further axes of length 1", {{"a.nii", Nifti().dims({9, 8, 7, 1, 1, 1, 1}).file()}}),
      right("A NIfTI with a fourth axis of length 0", {{"a.nii", Nifti().dims({9, 8, 7, 0}).file()}}),

      // types and values
      right("A NIfTI of the second version", {{"a.nii", two}}),
      right("A gzipped NIfTI of the second version", {{"a.nii.gz", gzip(two)}}),
      refused("A NIfTI of the second version cut in its header", {{"a.nii", first(two, 400)}},
              {"52 of 192 bytes"}),
      refused("A NIfTI of the second version cut by one byte", {{"a.nii", without_last(two, 1)}},
              {"503 of 504 bytes"}),
      refused("A NIfTI of the second version sent as a text", {{"a.nii", with_flipped_byte(two, 8)}},
              {"not a NIfTI-2 image"}),
      refused("A NIfTI of the second version with sizes beyond any count",
              {{"a.nii", std::string(two).replace(24, 8, "\xff\xff\xff\xff\xff\xff\xff\x7f", 8)}},
              {"e+20 voxels"}),
      refused("A NIfTI of the second version whose voxels begin nowhere",
              {{"a.nii", std::string(two).replace(168, 8, "\xff\xff\xff\xff\xff\xff\xff\x7f", 8)}},
              {"begin at byte"}),
      refused("A NIfTI of colours", {{"a.nii", of_type(128, 24, voxels + voxels + voxels)}}, {"RGB24"}),
      refused("A NIfTI of colours with opacity", {{"a.nii", of_type(2304, 32, voxels)}}, {"RGBA32"}),
      refused("A NIfTI of complex numbers", {{"a.nii", of_type(32, 64, voxels)}}, {"COMPLEX64"}),
      refused("A NIfTI of single bits", {{"a.nii", of_type(1, 1, voxels)}}, {"BINARY"}),
      refused("A NIfTI of no type", {{"a.nii", of_type(0, 0, voxels)}}, {"not one number each"}),
      right("A NIfTI whose type and bits disagree", {{"a.nii", of_type(2, 16, voxels)}},
            {"16 bits per voxel where its type has 8"}),
      refused("A probability map in NIfTI", {{"a.nii", floats(0.5)}},
              {"0.5, which is not a whole number", "probability"}),
      refused("A NIfTI with a voxel that is not a number", {{"a.nii", floats(nan)}},
              {"not finite", "(4, 4, 3)"}),
      refused("A NIfTI with an infinite voxel", {{"a.nii", floats(std::numeric_limits<double>::infinity())}},
              {"not finite"}),
      refused("A NIfTI with a negative label",
              {{"a.nii", of_type(4, 16, as_bytes<std::int16_t>(with_voxel(-1).voxel))}},
              {"-1, which is negative"}),
      refused("A NIfTI with a label beyond 32 bits",
              {{"a.nii", of_type(768, 32, as_bytes<std::uint32_t>(with_voxel(4e9).voxel))}},
              {"larger than 2147483647"}),
      refused("A NIfTI with a label beyond 64 bits of precision",
              {{"a.nii", of_type(1280, 64, as_bytes<std::uint64_t>(with_voxel(9.3e18).voxel))}},
              {"larger than"}),
      right("A NIfTI of 64 bits", {{"a.nii", of_type(1024, 64, as_bytes<std::int64_t>(SmallOrgan().voxel))}}),
      right("A NIfTI of 64 bits without a sign",
            {{"a.nii", of_type(1280, 64, as_bytes<std::uint64_t>(SmallOrgan().voxel))}}),
      right("A NIfTI of whole doubles", {{"a.nii", of_type(64, 64, as_bytes<double>(SmallOrgan().voxel))}}),
      counted("A NIfTI with a label above 65535",
              {{"a.nii", of_type(8, 32, as_bytes<std::int32_t>(with_voxel(70000).voxel))}},
              {{1, 205}, {2, 1}, {3, 1}, {4, 1}, {5, 1}, {70000, 1}}),
      right("A NIfTI in the other byte order",
            {{"a.nii", Nifti()
                           .type(512, 16)
                           .data(as_bytes<std::uint16_t>(SmallOrgan().voxel, true))
                           .swap_header()
                           .file()}}),
      right("A NIfTI of floats in the other byte order",
            {{"a.nii",
              Nifti().type(16, 32).data(as_bytes<float>(SmallOrgan().voxel, true)).swap_header().file()}}),
      refused("A NIfTI of nothing but background", {{"a.nii", Nifti().data(std::string(504, '\0')).file()}},
              {"all 504 voxels are background"}),
      counted("A NIfTI whose numbers are scaled", {{"a.nii", Nifti().set(112, 2.0f).file()}}, doubled_counts),
      right("A NIfTI whose numbers are scaled and shifted",
            {{"a.nii", Nifti().type(4, 16).data(stored).set(112, 0.5f).set(116, -3.5f).file()}}),
      right("A NIfTI scaled by what is not a number", {{"a.nii", Nifti().set(112, float(nan)).file()}}),
      refused("A NIfTI scaled to fractions", {{"a.nii", Nifti().set(112, 0.1f).file()}},
              {"0.2, which is not a whole number"}),
      refused("A NIfTI shifted by what is not a number",
              {{"a.nii", Nifti().set(112, 1.0f).set(116, float(nan)).file()}}, {"not finite"}),

      // place in space
      right("A NIfTI with an sform alone", {{"a.nii", sform_only(plain)}}),
      placed("A NIfTI with an oblique sform alone", {{"a.nii", sform_only(turned())}}, turned()),
      placed("A NIfTI with a left-handed sform", {{"a.nii", sform_only(left_handed())}}, left_handed()),
      placed("A NIfTI skewed by a ten-thousandth", {{"a.nii", sform_only(sheared(1e-4))}}, sheared(1e-4)),
      placed("A NIfTI skewed by a thousandth", {{"a.nii", sform_only(sheared(1e-3))}}, sheared(1e-3),
             {"not at right angles"}),
      placed("A NIfTI skewed by a tenth", {{"a.nii", sform_only(sheared(0.1))}}, sheared(0.1),
             {"not at right angles"}),
      right("A NIfTI with a qform alone", {{"a.nii", qform_only().file()}}),
      right("A NIfTI with a qform of no handedness", {{"a.nii", qform_only().pixdim(0, 0.0).file()}}),
      placed("A NIfTI whose quaternion mirrors its third axis",
             {{"a.nii", qform_only().pixdim(0, -1.0).file()}}, plain * Scaling(1.0, 1.0, -1.0)),
      right("A NIfTI with an empty sform beside its qform",
            {{"a.nii", Nifti().sform(1, Affine3d(Scaling(0.0))).file()}}, {"sform"}),
      placed("A NIfTI that does not say how it lies", {{"a.nii", without_place().file()}}, bare,
             {"does not state the image's orientation"}),
      placed("A NIfTI whose sform and qform disagree",
             {{"a.nii", Nifti().sform(1, Eigen::Translation3d(10, 0, 0) * plain).file()}},
             Eigen::Translation3d(10, 0, 0) * plain,
             {"sform and qform place the image up to 10 mm apart: the sform says 1.5 x 2 x 2.5 mm from "
              "(10.25, -33.5, 7), the qform 1.5 x 2 x 2.5 mm from (20.25, -33.5, 7)"}),
      placed("A NIfTI whose sform leads to an atlas",
             {{"a.nii", Nifti().sform(4, Scaling(1.25) * plain).file()}}, Scaling(1.25) * plain,
             {"sform and qform"}),
      refused("A NIfTI with NaN in its sform", {{"a.nii", sform_only(not_finite())}}, {"not finite"}),
      refused("A NIfTI with infinity in its qform",
              {{"a.nii", qform_only().set(268, std::numeric_limits<float>::infinity()).file()}},
              {"not finite"}),
      refused("A NIfTI with an sform of one plane", {{"a.nii", sform_only(degenerate())}}, {"one plane"}),
      refused("A NIfTI with an sform of zeros", {{"a.nii", sform_only(Affine3d(Scaling(0.0)))}},
              {"0 x 0 x 0 mm"}),
      refused("A NIfTI with a spacing of zero in its qform", {{"a.nii", qform_only().pixdim(2, 0.0).file()}},
              {"1.5 x 0 x 2.5 mm"}),
      refused("A NIfTI with a negative spacing in its qform",
              {{"a.nii", qform_only().pixdim(2, -2.0).file()}}, {"1.5 x -2 x 2.5 mm"}),
      refused("A NIfTI with a spacing that is not a number", {{"a.nii", qform_only().pixdim(3, nan).file()}},
              {"not finite"}),
      refused("A NIfTI with a spacing of zero and no place",
              {{"a.nii", without_place().pixdim(1, 0.0).file()}}, {"0 x 2 x 2.5 mm"}),
      refused("A NIfTI with a negative spacing and no place",
              {{"a.nii", without_place().pixdim(1, -1.5).file()}}, {"-1.5 x 2 x 2.5 mm"}),
      right("A NIfTI whose sform and spacing disagree", {{"a.nii", Nifti().qform(0).pixdim(1, 1.0).file()}},
            {"1 x 2 x 2.5 mm"}),
      right("A NIfTI in metres", {{"a.nii", in_unit(1, 1000.0)}}, {"metres"}),
      right("A NIfTI in microns", {{"a.nii", in_unit(3, 0.001)}}, {"microns"}),
      right("A NIfTI without a unit", {{"a.nii", in_unit(0, 1.0)}}),
      right("A NIfTI in an unknown unit", {{"a.nii", in_unit(5, 1.0)}}, {"unit of length 5 is unknown"}),
      placed("A NIfTI of millimetres that says metres", {{"a.nii", Nifti().set(123, char{1}).file()}},
             Scaling(1000.0) * plain, {"metres", "unusual for an organ"}),

      // where the voxels begin
      refused("A NIfTI whose voxels begin far behind its end", {{"a.nii", Nifti().set(108, 9e8f).file()}},
              {"begin at byte 900000000"}),
      refused("A gzipped NIfTI whose voxels begin far behind its end",
              {{"a.nii.gz", gzip(Nifti().set(108, 9e8f).file())}}, {"ends after"}),
      refused("A NIfTI whose voxels begin before the file", {{"a.nii", Nifti().set(108, -352.0f).file()}},
              {"begin at byte -352"}),
      refused("A NIfTI whose voxels begin nowhere", {{"a.nii", Nifti().set(108, float(nan)).file()}},
              {"begin at byte nan"}),
      right("A NIfTI that forgot where its voxels begin", {{"a.nii", Nifti().set(108, 0.0f).file()}}),
      right("A NIfTI with an extension",
            {{"a.nii", first(Nifti().set(108, 384.0f).file(), 352) + std::string(32, 'x') + voxels}}),

      // something else
      refused("A text under the name of a NIfTI", {{"a.nii", std::string(600, 'x')}},
              {"not a NIfTI-1 image"}),
      refused("A gzipped text under the name of a NIfTI", {{"a.nii.gz", gzip(std::string(600, 'x'))}},
              {"not a NIfTI-1 image"}),
      refused("A NIfTI with a wrong magic",
              {{"a.nii", Nifti().set(344, std::array<char, 4>{'n', '+', '3', 0}).file()}},
              {"not a NIfTI-1 image"}),
      refused("A DICOM file under the name of a NIfTI", {{"a.nii", dicom}}, {"DICOM"}),
      refused("An NRRD under the name of a NIfTI", {{"a.nii", Nrrd().file()}}, {"not a NIfTI-1 image"}),

      // header and voxels apart
      right("A NIfTI in two files", {{"a.hdr", pair.header()}, {"a.img", voxels}}),
      right("A NIfTI in two files named by its voxels", {{"a.img", voxels}, {"a.hdr", pair.header()}}),
      right("A NIfTI in two gzipped files", {{"a.hdr.gz", gzip(pair.header())}, {"a.img.gz", gzip(voxels)}}),
      right("A NIfTI in two files of which one is gzipped",
            {{"a.hdr", pair.header()}, {"a.img.gz", gzip(voxels)}}),
      refused("A NIfTI without its second file", {{"a.hdr", pair.header()}}, {"a.img", "No such file"}),
      refused("A NIfTI without its first file", {{"a.img", voxels}}, {"a.hdr", "No such file"}),
      refused("A NIfTI whose second file is cut short",
              {{"a.hdr", pair.header()}, {"a.img", first(voxels, 100)}}, {"a.img", "100 of 504 bytes"}),
      refused("An Analyze image", {{"a.hdr", Nifti().set(344, std::int32_t{0}).header()}, {"a.img", voxels}},
              {"Analyze", "orientation"}),
  };
  Case mri = right("An MRI in place of its segmentation",
                   {{"a.nii", Nifti().dims({20, 20, 20}).type(4, 16).data(grey_values()).file()}},
                   {"an MRI or CT rather than its segmentation"});
  mri.counts.clear();
  cases.push_back(std::move(mri));
  return cases;
}

// -------------------------------------------------------------------------------------------------- NRRD

std::vector<Case> nrrd_cases() {
  const std::string voxels = as_bytes<std::uint8_t>(SmallOrgan().voxel);
  const auto with = [](const std::string& key, const std::string& value) {
    return Nrrd().set(key, value).file();
  };
  const auto lacking = [](const std::string& key) { return Nrrd().erase(key).file(); };
  const auto at = [](const Affine3d& m) { return Nrrd().geometry(m).file(); };
  const auto encoded = [](const std::string& encoding, std::string bytes) {
    return Nrrd().set("encoding", encoding).data(std::move(bytes)).file();
  };
  const auto of_type = [](const std::string& type, std::string bytes) {
    return Nrrd().set("type", type).set("endian", "little").data(std::move(bytes)).file();
  };
  const auto detached = [](const std::string& where) { return Nrrd().set("data file", where).header(); };
  const Affine3d plain = SmallOrgan().to_world;
  const Affine3d ras = Scaling(-1.0, -1.0, 1.0) * plain;
  std::string text, hex;
  for (const unsigned char v : voxels) {
    text += std::to_string(int{v}) + " ";
    hex += "0123456789abcdef"[v >> 4], hex += "0123456789abcdef"[v & 15];
  }
  const auto layers = [&](const std::string& kind, int count, const std::string& more = "") {
    std::string all;
    for (const char v : voxels) all.append(static_cast<std::size_t>(count), v);
    return Nrrd()
        .set("dimension", "4")
        .set("sizes", std::to_string(count) + " 9 8 7")
        .set("space directions", "none (1.5,0,0) (0,2,0) (0,0,2.5)")
        .set("kinds", kind + " domain domain domain")
        .more(more)
        .data(all)
        .file();
  };
  const auto in_unit = [&](const std::string& unit, double factor) {
    return Nrrd()
        .geometry(Scaling(1.0 / factor) * plain)
        .set("space units", "\"" + unit + "\" \"" + unit + "\" \"" + unit + "\"")
        .file();
  };
  const auto last_axis = [&](const std::string& kind, int count) {
    return Nrrd()
        .set("dimension", "4")
        .set("sizes", "9 8 7 " + std::to_string(count))
        .set("space directions", "(1.5,0,0) (0,2,0) (0,0,2.5) none")
        .set("kinds", "domain domain domain " + kind)
        .data(voxels + voxels)
        .file();
  };
  const auto without_place = [] {
    return Nrrd().erase("space").erase("space directions").erase("space origin");
  };
  const auto segments = [](const std::string& name_1, const std::string& name_2, const std::string& value_2) {
    return Nrrd()
        .more("Segment0_ID:=a\nSegment0_Name:=" + name_1 +
              "\nSegment0_LabelValue:=1\nSegment1_ID:=b\nSegment1_Name:=" + name_2 +
              "\nSegment1_LabelValue:=" + value_2 + "\n")
        .file();
  };
  std::string crlf;
  for (const char c : Nrrd().header()) crlf += c == '\n' ? std::string("\r\n") : std::string(1, c);
  const std::string packed = gzip(voxels);

  std::vector<Case> cases = {
      // cut short or damaged
      refused("An empty NRRD", {{"a.nrrd", ""}}, {"cannot be read as NRRD"}),
      refused("An NRRD that is all magic", {{"a.nrrd", "NRRD0004\n"}}, {"cannot be read as NRRD"}),
      refused("A text under the name of an NRRD", {{"a.nrrd", "not an image\n"}}, {"cannot be read as NRRD"}),
      refused("An NRRD of a version to come", {{"a.nrrd", "NRRD0009" + Nrrd().file().substr(8)}}, {"cannot be read"}),
      refused("An NRRD cut by one byte", {{"a.nrrd", without_last(Nrrd().file(), 1)}},
              {"503 of 504 bytes", "incomplete"}),
      refused("An NRRD without an end of its header", {{"a.nrrd", without_last(Nrrd().header(), 1)}}, {"NRRD"}),
      refused("An NRRD with noise for a header", {{"a.nrrd", "NRRD0004\n" + noise(5000)}}, {"NRRD"}),
      refused("An NRRD with a line of a megabyte",
              {{"a.nrrd", Nrrd().set("content", std::string(1 << 20, 'x')).set("sizes", "900 800 700").file()}},
              {"of 504000000 bytes"}),
      right("An NRRD with a comment of a megabyte", {{"a.nrrd", Nrrd().more("# " + std::string(1 << 20, 'x') + "\n").file()}}),
      right("An NRRD with the line ends of Windows", {{"a.nrrd", crlf + voxels}}),
      right("An NRRD that goes on after its voxels", {{"a.nrrd", Nrrd().file() + std::string(72, '\1')}},
            {"has 72 more bytes after its voxels"}),
      right("A gzipped NRRD", {{"a.nrrd", encoded("gzip", packed)}}),
      refused("A gzipped NRRD cut short", {{"a.nrrd", encoded("gzip", without_last(packed, 20))}}, {"incomplete"}),
      refused("A gzipped NRRD damaged in its middle",
              {{"a.nrrd", encoded("gzip", with_flipped_byte(packed, packed.size() / 2))}}, {"damaged"}),
      refused("An NRRD that is not gzipped but says so", {{"a.nrrd", encoded("gzip", voxels)}}, {"damaged"}),
      right("A gzipped NRRD with rubbish after its end", {{"a.nrrd", encoded("gzip", packed + "rubbish after the end")}}),
      right("An NRRD in ASCII", {{"a.nrrd", encoded("ascii", text)}}),
      refused("An NRRD in ASCII cut short", {{"a.nrrd", encoded("ascii", first(text, 700))}}, {"incomplete"}),
      refused("An NRRD in ASCII with words in it", {{"a.nrrd", encoded("ascii", "nine " + text)}}, {"a.nrrd"}),
      right("An NRRD in hexadecimal", {{"a.nrrd", encoded("hex", hex)}}),
      refused("An NRRD in hexadecimal cut short", {{"a.nrrd", encoded("hex", first(hex, 500))}}, {"incomplete"}),
      refused("A bzipped NRRD", {{"a.nrrd", encoded("bzip2", "BZh9" + noise(300))}}, {"bzip2", "gzip", "unu save"}),
      refused("An NRRD of unknown encoding", {{"a.nrrd", encoded("zip", voxels)}}, {"encoding"}),

      // sizes
      refused("An NRRD without sizes", {{"a.nrrd", lacking("sizes")}}, {"cannot be read as NRRD"}),
      refused("An NRRD of too few sizes", {{"a.nrrd", with("sizes", "9 8")}}, {"cannot be read as NRRD"}),
      refused("An NRRD with a negative size", {{"a.nrrd", with("sizes", "9 -8 7")}}, {"a.nrrd"}),
      refused("An NRRD with a size of zero", {{"a.nrrd", with("sizes", "9 0 7")}}, {"a.nrrd"}),
      refused("An NRRD with sizes in words", {{"a.nrrd", with("sizes", "nine eight seven")}}, {"a.nrrd"}),
      refused("An NRRD whose sizes overflow", {{"a.nrrd", with("sizes", "4294967296 4294967296 4294967296")}}, {"a.nrrd"}),
      refused("An NRRD whose sizes overflow to what it holds",
              {{"a.nrrd", with("sizes", "4611686018427387905 4 126")}}, {"a.nrrd"}),
      refused("An NRRD of 1200 voxels each way in one kilobyte", {{"a.nrrd", with("sizes", "1200 1200 1200")}},
              {"cannot hold 1728000000 bytes"}),
      large("An NRRD of a thousand voxels each way in two megabytes", "a.nrrd", [] { return Nrrd().set("sizes", "1000 1000 1000").data(std::string(2'000'000, '\1')).file(); }, {"2000000 of 1000000000 bytes"}),
      large("A gzipped NRRD of a thousand voxels each way in two megabytes", "a.nrrd", [] { return Nrrd().set("sizes", "1000 1000 1000").set("encoding", "gzip").data(gzip(noise(2'000'000))).file(); }, {"2000000 of 1000000000 bytes"}),
      large("An NRRD in ASCII of a thousand voxels each way in two megabytes", "a.nrrd", [] { return Nrrd().set("sizes", "1000 1000 1000").set("encoding", "ascii").data(std::string(2'000'000, '1')).file(); }, {"1000000000"}),
      refused("An NRRD of 17 axes", {{"a.nrrd", with("dimension", "17")}}, {"a.nrrd"}),
      refused("An NRRD of 4 billion axes", {{"a.nrrd", with("dimension", "4294967299")}}, {"a.nrrd"}),
      refused("An NRRD without axes", {{"a.nrrd", with("dimension", "0")}}, {"a.nrrd"}),
      refused("An NRRD that does not say how many axes it has", {{"a.nrrd", lacking("dimension")}}, {"a.nrrd"}),
      refused("An NRRD with two lines of sizes", {{"a.nrrd", Nrrd().more("sizes: 9 8 7\n").file()}}, {"a.nrrd"}),
      refused("A flat NRRD", {{"a.nrrd", "NRRD0004\ntype: uint8\ndimension: 2\nsizes: 24 21\nencoding: raw\n\n" + voxels}},
              {"flat: 24 x 21"}),
      refused("An NRRD of one slice", {{"a.nrrd", with("sizes", "24 21 1")}}, {"flat"}),
      refused("An NRRD of two layers",
              {{"a.seg.nrrd", layers("list", 2, "Segment0_ID:=a\nSegment0_Name:=liver\nSegment0_Layer:=0\nSegment1_ID:=b\nSegment1_Layer:=1\n")}},
              {"every voxel holds 2 numbers", "'liver' in layer 0, 'Segment1' in layer 1", "may overlap", "3D Slicer"}),
      refused("An NRRD of vectors", {{"a.nrrd", layers("vector", 3)}}, {"holds 3 numbers"}),
      refused("An NRRD of colours", {{"a.nrrd", layers("RGB-color", 3)}}, {"holds 3 numbers"}),
      refused("An NRRD with an axis of time", {{"a.nrrd", layers("time", 2)}}, {"4 axes (sizes: 2 9 8 7)", "one time frame"}),
      refused("An NRRD whose last axis is time", {{"a.nrrd", last_axis("time", 2)}}, {"4 axes (sizes: 9 8 7 2)", "one time frame"}),
      refused("An NRRD with a fourth axis in space", {{"a.nrrd", last_axis("space", 1)}}, {"4 axes (sizes: 9 8 7 1)", "one time frame"}),
      right("An NRRD of one layer", {{"a.seg.nrrd", layers("list", 1)}}),

      // types and values
      refused("An NRRD without a type", {{"a.nrrd", lacking("type")}}, {"a.nrrd"}),
      refused("An NRRD of an unknown type", {{"a.nrrd", with("type", "quaternion")}}, {"a.nrrd"}),
      refused("An NRRD of blocks", {{"a.nrrd", Nrrd().set("type", "block").set("block size", "4").file()}}, {"a.nrrd"}),
      refused("An NRRD of two bytes in unknown order",
              {{"a.nrrd", Nrrd().set("type", "uint16").data(as_bytes<std::uint16_t>(SmallOrgan().voxel)).file()}}, {"endian"}),
      right("An NRRD in the other byte order",
            {{"a.nrrd", Nrrd().set("type", "int32").set("endian", "big").data(as_bytes<std::int32_t>(SmallOrgan().voxel, true)).file()}}),
      refused("An NRRD with a negative label", {{"a.nrrd", of_type("int16", as_bytes<std::int16_t>(with_voxel(-1).voxel))}},
              {"-1, which is negative"}),
      refused("An NRRD with a voxel that is not a number", {{"a.nrrd", of_type("float", as_bytes<float>(with_voxel(nan).voxel))}},
              {"not finite"}),
      refused("A probability map in NRRD", {{"a.nrrd", of_type("double", as_bytes<double>(with_voxel(0.25).voxel))}},
              {"0.25, which is not a whole number"}),
      right("An NRRD of 64 bits", {{"a.nrrd", of_type("uint64", as_bytes<std::uint64_t>(SmallOrgan().voxel))}}),
      refused("An NRRD of nothing but background", {{"a.nrrd", Nrrd().data(std::string(504, '\0')).file()}},
              {"all 504 voxels are background"}),

      // place in space
      right("An NRRD in right anterior superior",
            {{"a.nrrd", Nrrd().set("space", "right-anterior-superior").geometry(ras).file()}}),
      right("An NRRD in RAS for short", {{"a.nrrd", Nrrd().set("space", "RAS").geometry(ras).file()}}),
      right("An NRRD in LPS for short", {{"a.nrrd", with("space", "LPS")}}),
      right("An NRRD in LAS for short",
            {{"a.nrrd", Nrrd().set("space", "LAS").geometry(Scaling(1.0, -1.0, 1.0) * plain).file()}}),
      right("An NRRD in left anterior superior",
            {{"a.nrrd", Nrrd().set("space", "left-anterior-superior").geometry(Scaling(1.0, -1.0, 1.0) * plain).file()}}),
      right("An NRRD in the coordinates of a scanner", {{"a.nrrd", with("space", "scanner-xyz")}},
            {"does not name patient directions"}),
      right("An NRRD in a space of three directions",
            {{"a.nrrd", [] { std::string f = Nrrd().file(); return f.replace(f.find("space: left-posterior-superior"), 30, "space dimension: 3"); }()}},
            {"does not name patient directions"}),
      refused("An NRRD in an unknown space", {{"a.nrrd", with("space", "left-posterior-inferior")}}, {"a.nrrd"}),
      placed("An oblique NRRD", {{"a.nrrd", at(turned())}}, turned()),
      placed("A left-handed NRRD", {{"a.nrrd", at(left_handed())}}, left_handed()),
      placed("A skewed NRRD", {{"a.nrrd", at(sheared(0.1))}}, sheared(0.1), {"not at right angles"}),
      refused("An NRRD with axes in one plane", {{"a.nrrd", at(degenerate())}}, {"one plane"}),
      refused("An NRRD with NaN in its origin", {{"a.nrrd", at(not_finite())}}, {"nan"}),
      refused("An NRRD with a spacing of zero", {{"a.nrrd", at(spaced(1.5, 0.0, 2.5))}},
              {"axis 2 has the direction (0,0,0), which has no length", "place in space"}),
      refused("An NRRD with a spacing of next to nothing",
              {{"a.nrrd", with("space directions", "(1.5,0,0) (0,1e-310,0) (0,0,2.5)")}}, {"no length"}),
      refused("An NRRD with a direction of one axis missing",
              {{"a.nrrd", with("space directions", "(1.5,0,0) (0,2,0) none")}}, {"a.nrrd"}),
      refused("An NRRD whose space has more letters than the library has room for",
              {{"a.nrrd", with("space", std::string(1000, 'l'))}}, {"the line of space is 1007 letters long"}),
      refused("An NRRD whose directions have more letters than the library has room for",
              {{"a.nrrd", with("space directions", "(1.5,0,0) (0,2,0) (0,0,2.5" + std::string(1000, '0'))}},
              {"space directions are not 3 vectors"}),
      refused("An NRRD whose directions are many and of four numbers",
              {{"a.nrrd", with("space directions", "(1.5,0,0) (0,2,0) (0,888881,1,0) (0," + std::string(40, '8') + ",0) (0,0,1) (0,0,1," + std::string(60, '8') + ")")}},
              {"space directions are not 3 vectors"}),
      refused("An NRRD with a long line that says nothing",
              {{"a.nrrd", with("space", "left-posterior-superior\n" + std::string(1000, 'x'))}},
              {"letters long"}),
      right("An NRRD whose directions have every digit",
            {{"a.nrrd", with("space directions",
                             "(1.50000000000000000,-0.00000000000000000,0.00000000000000000) "
                             "(0.00000000000000000,2.00000000000000000,-0.00000000000000000) "
                             "(-0.00000000000000000,0.00000000000000000,2.50000000000000000)")}}),
      right("An NRRD with a long description", {{"a.nrrd", with("content", std::string(1000, 'c'))}}),
      right("An NRRD with a long value of a key of its own",
            {{"a.nrrd", with("space", "left-posterior-superior\nmine:=" + std::string(5000, 'v'))}}),
      placed("An NRRD without an origin", {{"a.nrrd", lacking("space origin")}}, Affine3d(Scaling(1.5, 2.0, 2.5)),
             {"no space origin"}),
      placed("An NRRD with spacings alone",
             {{"a.nrrd", without_place().set("spacings", "1.5 2 2.5").file()}},
             Affine3d(Scaling(1.5, 2.0, 2.5)), {"no space directions"}),
      refused("An NRRD with a spacing that is not a number",
              {{"a.nrrd", without_place().set("spacings", "1.5 nan 2.5").file()}},
              {"a.nrrd"}),
      right("An NRRD in metres", {{"a.nrrd", in_unit("m", 1000.0)}}, {"lengths in m;"}),
      right("An NRRD in microns", {{"a.nrrd", in_unit("um", 0.001)}}, {"lengths in um;"}),
      placed("An NRRD of metres that says nothing of them", {{"a.nrrd", at(Scaling(0.001) * plain)}}, Scaling(0.001) * plain,
             {"check the unit"}),
      refused("An NRRD that does not say how large its voxels are", {{"a.nrrd", without_place().file()}}, {"a.nrrd"}),
      refused("An NRRD that says how thick its voxels are alone",
              {{"a.nrrd", without_place().set("thicknesses", "1.5 2 2.5").file()}}, {"a.nrrd"}),
      right("An NRRD in an unknown unit", {{"a.nrrd", in_unit("pc", 1.0)}}, {"'pc' is unknown"}),

      // header and voxels apart
      right("An NRRD in two files", {{"a.nhdr", detached("a.raw")}, {"a.raw", voxels}}),
      right("An NRRD with its voxels in another folder", {{"b/a.nhdr", detached("../a.raw")}, {"a.raw", voxels}}),
      refused("An NRRD without its second file", {{"a.nhdr", detached("a.raw")}}, {"a.raw", "No such file"}),
      refused("An NRRD that does not name its second file", {{"a.nhdr", Nrrd().header()}}, {"0 of 504 bytes"}),
      refused("An NRRD whose second file is cut short", {{"a.nhdr", detached("a.raw")}, {"a.raw", first(voxels, 100)}},
              {"100 of 504 bytes"}),
      refused("An NRRD in a list of files", {{"a.nhdr", detached("LIST") + "a.raw\n"}, {"a.raw", voxels}}, {"several files"}),
      refused("An NRRD in numbered files", {{"a.nhdr", detached("a%d.raw 1 7 1")}, {"a1.raw", voxels}}, {"several files"}),
      refused("An NRRD with its voxels in a device", {{"a.nhdr", detached("/dev/zero")}}, {"/dev/zero", "not a file"}),
      refused("An NRRD with nothing after data file", {{"a.nhdr", Nrrd().set("data file", "").header()}},
              {"a.nhdr"}),
      refused("An NRRD with a NUL in its encoding",
              {{"a.nrrd", encoded(std::string("ra\0w", 4), voxels)}}, {"\n  try:   "}),
      refused("An NRRD with its voxels in a folder", {{"a.nhdr", detached(".")}}, {"Is a directory"}),
      right("An NRRD with bytes to skip", {{"a.nhdr", Nrrd().set("byte skip", "10").set("data file", "a.raw").header()}, {"a.raw", "0123456789" + voxels}}),
      right("An NRRD with its voxels at the end", {{"a.nhdr", Nrrd().set("byte skip", "-1").set("data file", "a.raw").header()}, {"a.raw", "0123456789" + voxels}}),
      right("An NRRD with lines to skip", {{"a.nhdr", Nrrd().set("line skip", "1").set("data file", "a.raw").header()}, {"a.raw", "0123456789\n" + voxels}}),
      refused("An NRRD with more bytes to skip than there are", {{"a.nrrd", with("byte skip", "999999999999")}}, {"a.nrrd"}),
      refused("An NRRD with more lines to skip than there are", {{"a.nrrd", with("line skip", "999999999999")}}, {"a.nrrd"}),
      refused("A gzipped NRRD with its voxels at the end",
              {{"a.nrrd", Nrrd().set("byte skip", "-1").set("encoding", "gzip").data(packed).file()}}, {"a.nrrd"}),

      // names
      named("A segmentation with names in Latin-1", {{"a.seg.nrrd", segments("h\xe9patique", "b", "2")}}, "h\u00e9patique"),
      named("A segmentation with terminal commands for names", {{"a.seg.nrrd", segments("\x1b[2Jliver", "two\\nlines", "2")}}, " [2Jliver"),
      named("A segmentation that gives one label two names", {{"a.seg.nrrd", segments("liver", "kidney", "1")}}, "liver",
            {"'liver' and 'kidney'"}),
      named("A segmentation that counts a segment by a million digits",
            {{"a.seg.nrrd", Nrrd().more("Segment" + std::string(1000000, '1') + "_Name:=liver\n").file()}}, "liver"),
      named("A segmentation with absurd label numbers", {{"a.seg.nrrd", segments("liver", "kidney", "99999999999999999999")}}, "liver"),
  };
  Case pipe = prepared("An NRRD with its voxels in a pipe", "a.nhdr",
                       [header = detached("a.raw")](const fs::path& folder) {
                         write(folder / "a.nhdr", header);
                         mkfifo((folder / "a.raw").c_str(), 0600);
                       },
                       {"a.raw", "not a file"});
  cases.push_back(std::move(pipe));
  return cases;
}

// --------------------------------------------------------------------------------------------- MetaImage

std::vector<Case> metaimage_cases() {
  const std::string voxels = as_bytes<std::uint8_t>(SmallOrgan().voxel), packed = zlib(voxels);
  const auto with = [](const std::string& key, const std::string& value) {
    return MetaImage().set(key, value).file();
  };
  // MetaImage with a further key before the last line.
  const auto inserted = [](const std::string& key, const std::string& value) {
    return MetaImage().erase("ElementDataFile").set(key, value).set("ElementDataFile", "LOCAL");
  };
  const auto lacking = [](const std::string& key) { return MetaImage().erase(key).file(); };
  const auto at = [](const Affine3d& m) { return MetaImage().geometry(m).file(); };
  const auto compressed = [](std::string bytes) {
    return MetaImage().set("CompressedData", "True").data(std::move(bytes)).file();
  };
  const auto sized = [&](const std::string& size, std::string bytes) {
    return inserted("CompressedDataSize", size).set("CompressedData", "True").data(std::move(bytes)).file();
  };
  const auto of_type = [](const std::string& type, std::string bytes) {
    return MetaImage().set("ElementType", type).data(std::move(bytes)).file();
  };
  const auto detached = [](const std::string& where) {
    return MetaImage().set("ElementDataFile", where).header();
  };
  std::string text;
  for (const unsigned char v : voxels) text += std::to_string(int{v}) + " ";

  std::vector<Case> cases = {
      // cut short or damaged
      refused("An empty MetaImage", {{"a.mha", ""}}, {"cannot be read as MetaImage"}),
      refused("A text under the name of a MetaImage", {{"a.mha", "not an image\n"}}, {"cannot be read as MetaImage"}),
      refused("A MetaImage with noise for a header", {{"a.mha", noise(5000)}}, {"a.mha"}),
      refused("A MetaImage cut in its header", {{"a.mha", first(MetaImage().file(), 120)}}, {"a.mha"}),
      refused("A MetaImage cut by one byte", {{"a.mha", without_last(MetaImage().file(), 1)}},
              {"503 of 504 bytes", "incomplete"}),
      right("A MetaImage that goes on after its voxels", {{"a.mha", MetaImage().file() + std::string(72, '\1')}},
            {"has 72 more bytes after its voxels"}),
      right("A compressed MetaImage", {{"a.mha", sized(std::to_string(packed.size()), packed)}}),
      right("A compressed MetaImage of unknown length", {{"a.mha", compressed(packed)}}),
      right("A compressed MetaImage that gives its length as zero", {{"a.mha", sized("0", packed)}}),
      refused("A compressed MetaImage cut short", {{"a.mha", compressed(without_last(packed, 20))}}, {"incomplete"}),
      refused("A compressed MetaImage damaged in its middle",
              {{"a.mha", compressed(with_flipped_byte(packed, packed.size() / 2))}}, {"damaged"}),
      refused("A MetaImage that is not compressed but says so", {{"a.mha", compressed(voxels)}}, {"damaged"}),
      right("A compressed MetaImage that gives its length as a terabyte", {{"a.mha", sized("1000000000000", packed)}}),
      right("A compressed MetaImage that gives a negative length", {{"a.mha", sized("-5", packed)}}),
      right("A compressed MetaImage that gives too short a length", {{"a.mha", sized("10", packed)}}),
      refused("A MetaImage with a line of a megabyte", {{"a.mha", inserted("Comment", std::string(1 << 20, 'x')).file()}},
              {"a.mha"}),
      refused("A MetaImage with a key of a megabyte", {{"a.mha", inserted(std::string(1 << 20, 'x'), "1").file()}}, {"a.mha"}),

      // sizes
      refused("A MetaImage without sizes", {{"a.mha", lacking("DimSize")}}, {"a.mha"}),
      refused("A MetaImage of too few sizes", {{"a.mha", with("DimSize", "9 8")}}, {"a.mha"}),
      refused("A MetaImage with a negative size", {{"a.mha", with("DimSize", "9 -8 7")}}, {"a.mha"}),
      refused("A MetaImage with a size of zero", {{"a.mha", with("DimSize", "9 0 7")}}, {"a.mha"}),
      refused("A MetaImage with sizes in words", {{"a.mha", with("DimSize", "nine eight seven")}}, {"a.mha"}),
      refused("A MetaImage whose sizes overflow", {{"a.mha", with("DimSize", "4294967305 4294967304 4294967303")}}, {"a.mha"}),
      refused("A MetaImage whose sizes overflow to what it holds", {{"a.mha", with("DimSize", "65536 65536 504")}}, {"a.mha"}),
      refused("A MetaImage of 1200 voxels each way in one kilobyte", {{"a.mha", with("DimSize", "1200 1200 1200")}},
              {"504 of 1728000000 bytes"}),
      large("A MetaImage of a thousand voxels each way in two megabytes", "a.mha", [] { return MetaImage().set("DimSize", "1000 1000 1000").data(std::string(2'000'000, '\1')).file(); }, {"2000000 of 1000000000 bytes"}),
      large("A compressed MetaImage of a thousand voxels each way in two megabytes", "a.mha", [] { return MetaImage().set("DimSize", "1000 1000 1000").set("CompressedData", "True").data(zlib(noise(2'000'000))).file(); }, {"2000000 of 1000000000 bytes"}),
      refused("A MetaImage without axes", {{"a.mha", with("NDims", "0")}}, {"a.mha"}),
      refused("A MetaImage of minus three axes", {{"a.mha", with("NDims", "-3")}}, {"a.mha"}),
      refused("A MetaImage of a hundred axes", {{"a.mha", with("NDims", "100")}}, {"a.mha"}),
      refused("A MetaImage of two billion axes", {{"a.mha", with("NDims", "2000000000")}}, {"a.mha"}),
      refused("A MetaImage that says twice how many axes it has",
              {{"a.mha", with("BinaryData", "True\nNDims =444444444444444")}}, {"a key that another line has"}),
      refused("A MetaImage whose header holds what is no text",
              {{"a.mha", with("BinaryData", std::string("True\0\0\0", 7))}}, {"key = value"}),
      refused("A MetaImage with a line that has no value", {{"a.mha", with("BinaryData", "True\nNDims: 5")}},
              {"key = value"}),
      refused("A MetaImage that does not say how many axes it has", {{"a.mha", lacking("NDims")}}, {"a.mha"}),
      refused("A flat MetaImage",
              {{"a.mha", "ObjectType = Image\nNDims = 2\nElementSpacing = 2 2\nDimSize = 24 21\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n" + voxels}},
              {"flat"}),
      refused("A MetaImage of one slice", {{"a.mha", with("DimSize", "24 21 1")}}, {"flat"}),
      refused("A MetaImage of colours",
              {{"a.mha", inserted("ElementNumberOfChannels", "3").data(voxels + voxels + voxels).file()}}, {"holds 3 numbers"}),
      refused("A MetaImage of no numbers per voxel", {{"a.mha", inserted("ElementNumberOfChannels", "0").file()}}, {"a.mha"}),
      refused("A MetaImage of minus one numbers per voxel", {{"a.mha", inserted("ElementNumberOfChannels", "-1").file()}}, {"a.mha"}),

      // types and values
      refused("A MetaImage without a type", {{"a.mha", lacking("ElementType")}}, {"a.mha"}),
      refused("A MetaImage of an unknown type", {{"a.mha", with("ElementType", "MET_QUATERNION")}}, {"a.mha"}),
      refused("A MetaImage of arrays", {{"a.mha", with("ElementType", "MET_UCHAR_ARRAY")}}, {"a.mha"}),
      right("A MetaImage in the other byte order",
            {{"a.mha", MetaImage().set("BinaryDataByteOrderMSB", "True").set("ElementType", "MET_SHORT").data(as_bytes<std::int16_t>(SmallOrgan().voxel, true)).file()}}),
      refused("A MetaImage with a negative label", {{"a.mha", of_type("MET_CHAR", as_bytes<std::int8_t>(with_voxel(-1).voxel))}},
              {"-1, which is negative"}),
      refused("A MetaImage with an infinite voxel",
              {{"a.mha", of_type("MET_DOUBLE", as_bytes<double>(with_voxel(-std::numeric_limits<double>::infinity()).voxel))}},
              {"not finite"}),
      refused("A probability map in MetaImage", {{"a.mha", of_type("MET_FLOAT", as_bytes<float>(with_voxel(0.75).voxel))}},
              {"0.75, which is not a whole number"}),
      right("A MetaImage of 64 bits", {{"a.mha", of_type("MET_LONG_LONG", as_bytes<std::int64_t>(SmallOrgan().voxel))}}),
      refused("A MetaImage of nothing but background", {{"a.mha", MetaImage().data(std::string(504, '\0')).file()}}, {"background"}),
      refused("A MetaImage in ASCII", {{"a.mha", MetaImage().set("BinaryData", "False").data(text).file()}}, {"ASCII"}),

      // place in space
      placed("An oblique MetaImage", {{"a.mha", at(turned())}}, turned()),
      placed("A left-handed MetaImage", {{"a.mha", at(left_handed())}}, left_handed()),
      placed("A skewed MetaImage", {{"a.mha", at(sheared(0.1))}}, sheared(0.1), {"not at right angles"}),
      right("A MetaImage in centimetres",
            {{"a.mha", inserted("DistanceUnits", "cm").geometry(Scaling(0.1) * SmallOrgan().to_world).file()}}, {"lengths in cm;"}),
      right("A MetaImage in millimetres", {{"a.mha", inserted("DistanceUnits", "mm").file()}}),
      right("A MetaImage in an unknown unit", {{"a.mha", inserted("DistanceUnits", "furlong").file()}}, {"'furlong' is unknown"}),
      refused("A MetaImage with axes in one plane", {{"a.mha", at(degenerate())}}, {"one plane"}),
      refused("A MetaImage with NaN in its origin", {{"a.mha", at(not_finite())}}, {"instead of 3 finite numbers"}),
      refused("A MetaImage with a spacing of zero", {{"a.mha", with("ElementSpacing", "1.5 0 2.5")}}, {"1.5 x 0 x 2.5 mm"}),
      refused("A MetaImage with a spacing of next to nothing", {{"a.mha", with("ElementSpacing", "1.5 1e-310 2.5")}},
              {"1e-310"}),
      refused("A MetaImage with an axis of no length", {{"a.mha", with("TransformMatrix", "1 0 0 0 0 0 0 0 1")}},
              {"has no length"}),
      refused("A MetaImage with nothing after ElementDataFile", {{"a.mhd", with("ElementDataFile", "")}},
              {"does not name the file of its voxels"}),
      refused("A MetaImage with a NUL where its sizes should be",
              {{"a.mha", with("DimSize", std::string("9 8\0 7", 6))}}, {"key = value"}),
      refused("A MetaImage with a negative spacing", {{"a.mha", with("ElementSpacing", "1.5 -2 2.5")}}, {"1.5 x -2 x 2.5 mm"}),
      refused("A MetaImage with a spacing that is not a number", {{"a.mha", with("ElementSpacing", "1.5 nan 2.5")}}, {"a.mha"}),
      refused("A MetaImage without a spacing", {{"a.mha", lacking("ElementSpacing")}}, {"no ElementSpacing"}),
      refused("A MetaImage with spacing in words", {{"a.mha", with("ElementSpacing", "wide wide wide")}}, {"a.mha"}),
      right("A MetaImage that does not say how it lies", {{"a.mha", lacking("TransformMatrix")}}, {"no TransformMatrix"}),
      placed("A MetaImage without an origin", {{"a.mha", lacking("Offset")}}, Affine3d(Scaling(1.5, 2.0, 2.5)), {"no Offset"}),
      right("A MetaImage with its place under other names",
            {{"a.mha", [] { std::string f = MetaImage().file(); f.replace(f.find("TransformMatrix"), 15, "Rotation"); return f.replace(f.find("Offset"), 6, "Position"); }()}}),
      refused("A MetaImage whose matrix is too short", {{"a.mha", with("TransformMatrix", "1 0 0 0 1")}}, {"a.mha"}),

      // header and voxels apart
      refused("A MetaImage that does not name its voxels", {{"a.mhd", lacking("ElementDataFile")}}, {"a.mhd"}),
      right("A MetaImage in two files", {{"a.mhd", detached("a.raw")}, {"a.raw", voxels}}),
      right("A MetaImage with its voxels in another folder", {{"b/a.mhd", detached("../a.raw")}, {"a.raw", voxels}}),
      right("A MetaImage with its compressed voxels in a second file",
            {{"a.mhd", MetaImage().set("CompressedData", "True").set("ElementDataFile", "a.zraw").header()}, {"a.zraw", packed}}),
      refused("A MetaImage without its second file", {{"a.mhd", detached("a.raw")}}, {"a.raw", "No such file"}),
      refused("A MetaImage whose second file is cut short", {{"a.mhd", detached("a.raw")}, {"a.raw", first(voxels, 100)}}, {"100 of 504 bytes"}),
      refused("A MetaImage with its voxels in a device", {{"a.mhd", detached("/dev/zero")}}, {"/dev/zero", "not a file"}),
      refused("A MetaImage with its voxels in a folder", {{"a.mhd", detached(".")}}, {"Is a directory"}),
      refused("A MetaImage in a list of files", {{"a.mhd", detached("LIST") + "a.raw\n"}, {"a.raw", voxels}}, {"several files"}),
      refused("A MetaImage in numbered files", {{"a.mhd", detached("a%d.raw 1 7 1")}, {"a1.raw", voxels}}, {"several files"}),
      right("A MetaImage with bytes to skip",
            {{"a.mhd", inserted("HeaderSize", "10").set("ElementDataFile", "a.raw").header()}, {"a.raw", "0123456789" + voxels}}),
      right("A MetaImage with its voxels at the end",
            {{"a.mhd", inserted("HeaderSize", "-1").set("ElementDataFile", "a.raw").header()}, {"a.raw", "0123456789" + voxels}}),
      refused("A MetaImage with more bytes to skip than there are", {{"a.mha", inserted("HeaderSize", "999999999").file()}}, {"a.mha"}),
  };
  cases.push_back(prepared("A MetaImage with its voxels in a pipe", "a.mhd",
                           [header = detached("a.raw")](const fs::path& folder) {
                             write(folder / "a.mhd", header);
                             mkfifo((folder / "a.raw").c_str(), 0600);
                           },
                           {"a.raw", "not a file"}));
  return cases;
}

// ------------------------------------------------------------------------------------------------- files

std::vector<Case> file_cases() {
  const std::string nifti = Nifti().file(), nrrd = Nrrd().file(), meta = MetaImage().file();
  const auto folder_named = [](const char* name) {
    return [=](const fs::path& folder) { fs::create_directories(folder / name); };
  };
  const auto link = [](const char* to, const char* name) {
    return [=](const fs::path& folder) { fs::create_symlink(to, folder / name); };
  };
  const auto pipe = [](const char* name) {
    return [=](const fs::path& folder) { mkfifo((folder / name).c_str(), 0600); };
  };
  // A sparse file uses no room on the disk: a gigabyte of holes costs nothing.
  const auto holes = [](const char* name, std::string header) {
    return [=](const fs::path& folder) {
      write(folder / name, header);
      fs::resize_file(folder / name, 1'200'000'000'000);
    };
  };
  Case link_to_image = right("A symbolic link to an image", {{"organ.nrrd", nrrd}});
  link_to_image.prepare = link("organ.nrrd", "a.nrrd");
  link_to_image.argument = "a.nrrd";
  const auto with_table = [&](std::string name, std::function<void(const fs::path&)> prepare, Words words) {
    Case c = refused(std::move(name), {{"a.nrrd", nrrd}}, std::move(words));
    c.prepare = std::move(prepare);
    c.more_arguments = {"--label-names", "table.txt"};
    return c;
  };
  return {
      prepared("A path where nothing is", "a.nrrd", {}, {"No such file"}),
      prepared("An empty path", "", {}, {"No such file"}),
      prepared("A path longer than a path may be", std::string(5000, 'a') + ".nrrd", {},
               {"File name too long"}),
      prepared("A folder under the name of a NIfTI", "a.nii", folder_named("a.nii"), {"a.nii", "folder"}),
      prepared("A folder under the name of an NRRD", "a.nrrd", folder_named("a.nrrd"), {"a.nrrd", "folder"}),
      prepared("A loop of symbolic links", "a.nii.gz", link("a.nii.gz", "a.nii.gz"), {"Too many levels"}),
      prepared("A symbolic link to nothing", "a.mha", link("gone.mha", "a.mha"), {"No such file"}),
      prepared("A pipe under the name of a NIfTI", "a.nii", pipe("a.nii"), {"not a file"}),
      prepared("A pipe under the name of an NRRD", "a.nrrd", pipe("a.nrrd"), {"not a file"}),
      prepared("An endless device", "/dev/zero", {}, {"/dev/zero", "not a file"}),
      prepared("A symbolic link to an endless device", "a.nii", link("/dev/zero", "a.nii"), {"not a file"}),
      prepared("The empty device", "/dev/null", {}, {"/dev/null", "not a file"}),
      prepared("A terabyte of holes under the name of a NIfTI", "a.nii",
               holes("a.nii", Nifti().dims({1280, 1280, 1280}).type(64, 64).header()), {"memory"}),
      prepared(
          "A terabyte of holes under the name of an NRRD", "a.nrrd",
          holes("a.nrrd",
                Nrrd().set("sizes", "1280 1280 1280").set("type", "double").set("endian", "little").header()),
          {"memory"}),
      prepared("A terabyte of holes without a header", "a.mha", holes("a.mha", ""), {"a.mha"}),
      prepared("A terabyte of holes without a header under the name of an NRRD", "a.nrrd",
               holes("a.nrrd", ""), {"a.nrrd", "header does not end"}),
      refused("A file of unknown suffix", {{"a.stl", "solid a\nendsolid a\n"}}, {".seg.nrrd"}),
      refused("An image in FreeSurfer's format", {{"aseg.mgz", "\x1f\x8b"}},
              {"FreeSurfer's format", "mri_convert aseg.mgz aseg.nii.gz"}),
      refused("A gzipped NRRD as a whole", {{"a.nrrd.gz", gzip(nrrd)}}, {"known suffix"}),
      std::move(link_to_image),
      right("A NIfTI in a path with blanks and umlauts",
            {{"Frau M\u00fcller/Kopf 1 \u2014 \u8133.nii.gz", gzip(nifti)}}),
      right("An NRRD in a path with blanks and umlauts",
            {{"Frau M\u00fcller/Kopf 1 \u2014 \u8133.seg.nrrd", nrrd}}),
      right("A MetaImage in a path with blanks and umlauts",
            {{"Frau M\u00fcller/Kopf 1 \u2014 \u8133.mha", meta}}),
      right("A NIfTI with its suffix in capitals", {{"A.NII.GZ", gzip(nifti)}}),
      right("An NRRD with its suffix in capitals", {{"A.NRRD", nrrd}}),
      right("A MetaImage with its suffix in capitals", {{"A.MHA", meta}}),
      right("A file whose name holds a percent sign", {{"100%d %s.nrrd", nrrd}}),
      right("A MetaImage whose name holds a percent sign", {{"100%d %s.mha", meta}}),
      right("A file name that is no UTF-8", {{"M\xfcller.nrrd", nrrd}}),
      refused("A broken file whose name is no UTF-8", {{"M\xfcller.nrrd", first(nrrd, 100)}}, {"NRRD"}),
      right("A file name that begins with a dash", {{"./-a.nrrd", nrrd}}),
      with_table("A table of names that is an endless device", link("/dev/zero", "table.txt"),
                 {"table.txt", "not a file"}),
      with_table("A table of names that is a pipe", pipe("table.txt"), {"table.txt", "not a file"}),
      with_table("A table of names that is a folder", folder_named("table.txt"), {"table.txt", "folder"}),
  };
}

std::string identifier(const testing::TestParamInfo<Case>& info) {
  std::string name;
  for (const char c : info.param.name) name += std::isalnum(static_cast<unsigned char>(c)) ? c : '_';
  return name;
}

INSTANTIATE_TEST_SUITE_P(Nifti, HostileImage, testing::ValuesIn(nifti_cases()), identifier);
INSTANTIATE_TEST_SUITE_P(Nrrd, HostileImage, testing::ValuesIn(nrrd_cases()), identifier);
INSTANTIATE_TEST_SUITE_P(MetaImage, HostileImage, testing::ValuesIn(metaimage_cases()), identifier);
INSTANTIATE_TEST_SUITE_P(Path, HostileImage, testing::ValuesIn(file_cases()), identifier);

}  // namespace
}  // namespace dimple
