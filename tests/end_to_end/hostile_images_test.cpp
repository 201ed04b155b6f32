// Images that are broken, hostile or say two things at once: each is refused in words or read right. None may
// end the program by a signal, keep it busy, or take memory beyond what an honest image of that size needs.

#include <sys/resource.h>
#include <sys/stat.h>

#include <cctype>
#include <functional>
#include <limits>
#include <random>

#include "tests/end_to_end/image_bytes.hpp"
#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

using Eigen::Affine3d;
using Eigen::Scaling;
using Words = std::vector<std::string>;
using Files = std::vector<std::pair<std::string, std::string>>;  ///< name, bytes

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr double slower = 5.0;  // and as many times the memory, which a sanitizer keeps beside the program's
#else
constexpr double slower = 1.0;
#endif
constexpr double memory_limit_MB = 1000.0 * slower;
constexpr double time_limit_s = 20.0 * slower;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// One image, and what `dimple info` owes it.
struct Case {
  std::string name = {};  ///< a sentence
  Files files = {};       ///< the first is the image
  int code = 0;
  Words words = {};                                   ///< of the refusal, or of each warning in order
  std::map<int, int> counts = organ_counts;           ///< voxels of each label; empty: too many to say
  Affine3d to_world = SmallOrgan().to_world;          ///< where voxel (i, j, k) of the small organ lies
  std::function<void(const fs::path&)> prepare = {};  ///< makes what a list of files cannot say
  std::string argument = files.empty() ? "" : files.front().first;
  Words more_arguments = {};
  std::string name_of_1 = {};  ///< of label 1, if it is looked at
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

/// Cases of images that are one file, all of one name.
struct OneFile {
  std::string file, prefix;  ///< how the name of each case begins

  Case refused(const std::string& name, std::string bytes, Words words) const {
    return dimple::refused(prefix + name, {{file, std::move(bytes)}}, std::move(words));
  }
  Case right(const std::string& name, std::string bytes, Words warnings = {}) const {
    return dimple::right(prefix + name, {{file, std::move(bytes)}}, std::move(warnings));
  }
  Case placed(const std::string& name, std::string bytes, const Affine3d& to_world,
              Words warnings = {}) const {
    Case c = right(name, std::move(bytes), std::move(warnings));
    c.to_world = to_world;
    return c;
  }
  Case counted(const std::string& name, std::string bytes, std::map<int, int> counts) const {
    Case c = right(name, std::move(bytes));
    c.counts = std::move(counts);
    return c;
  }
};

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

/// Bytes too many to be made for every test at the start.
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

/// Bytes that do not compress.
std::string noise(std::size_t count) {
  std::mt19937 random(5);
  std::string bytes(count, '\0');
  for (char& byte : bytes) byte = static_cast<char>(random());
  return bytes;
}

/// The organ with one voxel of it changed.
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

/// Grey values as of an MRI, in a type that a label image may have.
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
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)  // whose shadows are larger
  if (c.words == Words{"memory"}) GTEST_SKIP() << "memory cannot be limited under a sanitizer";
#else
  const rlimit limited{6'000'000'000, unlimited.rlim_max};
  setrlimit(RLIMIT_AS, &limited);  // for the program, so that no machine is brought down
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
  const OneFile nii{"a.nii", "A NIfTI "}, gz{"a.nii.gz", "A gzipped NIfTI "};
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

  const std::string two = nifti_2();
  std::string dicom(2000, '\0');
  dicom.replace(128, 4, "DICM");
  const Nifti pair = Nifti().set(108, 0.0f).set(344, std::array<char, 4>{'n', 'i', '1', '\0'});

  std::vector<Case> cases = {
      // cut short or damaged
      nii.refused("that is empty", "", {"ends after 0 of 348 bytes"}),
      nii.refused("cut in its header", first(whole, 200), {"ends after 200 of 348"}),
      nii.refused("that is all header", first(whole, 352), {"0 of 504 bytes", "incomplete"}),
      nii.refused("cut by one byte", without_last(whole, 1), {"503 of 504 bytes", "incomplete"}),
      gz.refused("cut in its voxels", without_last(packed, 20), {"incomplete"}),
      gz.refused("cut in its first bytes", first(packed, 12), {"incomplete"}),
      gz.refused("without its checksum", without_last(packed, 8), {"checksum"}),
      gz.refused("with another checksum", with_flipped_byte(packed, packed.size() - 6), {"damaged"}),
      gz.refused("damaged in its middle", with_flipped_byte(packed, packed.size() / 2), {"damaged"}),
      gz.right("with rubbish after its end", packed + "rubbish after the end"),
      right("A gzipped NIfTI under the name of a plain one", {{"a.nii", packed}}),
      right("A plain NIfTI under the name of a gzipped one", {{"a.nii.gz", whole}}),
      nii.right("that goes on after its voxels", whole + std::string(252, '\1'),
                {"goes on for 252 bytes after its voxels"}),
      gz.right("that goes on after its voxels", gzip(whole + std::string(252, '\1')), {"goes on"}),

      // sizes
      nii.refused("of 1200 voxels each way in one kilobyte", Nifti().dims({1200, 1200, 1200}).file(),
                  {"cannot hold 1728000000 bytes"}),
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
      nii.refused("of 32767 voxels each way", Nifti().dims({32767, 32767, 32767}).file(),
                  {"3.52e+13 voxels"}),
      large("A gzipped NIfTI of nothing but zeros that unpacks to 216 megabytes", "a.nii.gz",
            [] {
              return gzip(Nifti().dims({600, 600, 600}).data(std::string(216'000'000, '\0')).file());
            },
            {"all 216000000 voxels are background"}),
      nii.refused("with a negative size", Nifti().dims({9, -8, 7}).file(), {"-8 voxels"}),
      nii.refused("with a size of zero", Nifti().dims({9, 8, 0}).file(), {"0 voxels"}),
      nii.refused("without axes", Nifti().set(40, std::int16_t{0}).file(), {"0 axes"}),
      nii.refused("of nine axes", Nifti().set(40, std::int16_t{9}).file(), {"9 axes"}),
      nii.refused("of minus three axes", Nifti().set(40, std::int16_t{-3}).file(), {"-3 axes"}),
      nii.refused("that is flat", Nifti().dims({24, 21}).file(), {"flat: 24 x 21 voxels"}),
      nii.refused("of one slice", Nifti().dims({24, 21, 1}).file(),
                  {"flat", "one slice", "whole segmented volume"}),
      nii.refused("of two time frames", Nifti().dims({9, 8, 7, 2}).data(voxels + voxels).file(),
                  {"4 axes (9 x 8 x 7 x 2 voxels)", "time frame"}),
      nii.refused("of vectors", Nifti().dims({9, 8, 7, 1, 3}).data(voxels + voxels + voxels).file(),
                  {"holds 3 numbers"}),
      nii.right("with further axes of length 1", Nifti().dims({9, 8, 7, 1, 1, 1, 1}).file()),
      nii.right("with a fourth axis of length 0", Nifti().dims({9, 8, 7, 0}).file()),

      // types and values
      nii.refused("of the second version cut in its header", first(two, 400), {"52 of 192 bytes"}),
      nii.refused("of the second version cut by one byte", without_last(two, 1), {"503 of 504 bytes"}),
      nii.refused("of the second version sent as a text", with_flipped_byte(two, 8), {"not a NIfTI-2 image"}),
      nii.refused("of the second version with sizes beyond any count",
                  std::string(two).replace(24, 8, "\xff\xff\xff\xff\xff\xff\xff\x7f", 8), {"e+20 voxels"}),
      nii.refused("of the second version whose voxels begin nowhere",
                  std::string(two).replace(168, 8, "\xff\xff\xff\xff\xff\xff\xff\x7f", 8), {"begin at byte"}),
      nii.refused("of colours", of_type(128, 24, voxels + voxels + voxels), {"RGB24"}),
      nii.refused("of colours with opacity", of_type(2304, 32, voxels), {"RGBA32"}),
      nii.refused("of complex numbers", of_type(32, 64, voxels), {"COMPLEX64"}),
      nii.refused("of single bits", of_type(1, 1, voxels), {"BINARY"}),
      nii.refused("of no type", of_type(0, 0, voxels), {"not one number each"}),
      nii.right("whose type and bits disagree", of_type(2, 16, voxels),
                {"16 bits per voxel where its type has 8"}),
      nii.refused("that is a probability map", floats(0.5),
                  {"0.5, which is not a whole number", "probability"}),
      nii.refused("with a voxel that is not a number", floats(nan), {"not finite", "(4, 4, 3)"}),
      nii.refused("with an infinite voxel", floats(std::numeric_limits<double>::infinity()), {"not finite"}),
      nii.refused("with a negative label", of_type(4, 16, as_bytes<std::int16_t>(with_voxel(-1).voxel)),
                  {"-1, which is negative"}),
      nii.refused("with a label beyond 32 bits",
                  of_type(768, 32, as_bytes<std::uint32_t>(with_voxel(4e9).voxel)),
                  {"larger than 2147483647"}),
      nii.refused("with a label beyond 64 bits of precision",
                  of_type(1280, 64, as_bytes<std::uint64_t>(with_voxel(9.3e18).voxel)), {"larger than"}),
      nii.counted("with a label above 65535", of_type(8, 32, as_bytes<std::int32_t>(with_voxel(70000).voxel)),
                  {{1, 205}, {2, 1}, {3, 1}, {4, 1}, {5, 1}, {70000, 1}}),
      nii.refused("of nothing but background", Nifti().data(std::string(504, '\0')).file(),
                  {"all 504 voxels are background"}),
      nii.right("scaled by what is not a number", Nifti().set(112, float(nan)).file()),
      nii.refused("shifted by what is not a number", Nifti().set(112, 1.0f).set(116, float(nan)).file(),
                  {"not finite"}),

      // place in space
      nii.placed("skewed by a ten-thousandth", sform_only(sheared(1e-4)), sheared(1e-4)),
      nii.placed("skewed by a tenth", sform_only(sheared(0.1)), sheared(0.1), {"not at right angles"}),
      nii.right("with an empty sform beside its qform", Nifti().sform(1, Affine3d(Scaling(0.0))).file(),
                {"sform"}),
      nii.placed("whose sform leads to an atlas", Nifti().sform(4, Scaling(1.25) * plain).file(),
                 Scaling(1.25) * plain, {"sform and qform"}),
      nii.refused("with NaN in its sform", sform_only(not_finite()), {"not finite"}),
      nii.refused("with infinity in its qform",
                  qform_only().set(268, std::numeric_limits<float>::infinity()).file(), {"not finite"}),
      nii.refused("with an sform of one plane", sform_only(degenerate()), {"one plane"}),
      nii.refused("with an sform of zeros", sform_only(Affine3d(Scaling(0.0))), {"0 x 0 x 0 mm"}),
      nii.refused("with a spacing that is not a number", qform_only().pixdim(3, nan).file(), {"not finite"}),
      nii.right("whose sform and spacing disagree", Nifti().qform(0).pixdim(1, 1.0).file(),
                {"1 x 2 x 2.5 mm"}),
      nii.right("without a unit", in_unit(0, 1.0)),
      nii.right("in an unknown unit", in_unit(5, 1.0), {"unit of length 5 is unknown"}),
      nii.placed("of millimetres that says metres", Nifti().set(123, char{1}).file(), Scaling(1000.0) * plain,
                 {"metres", "unusual for an organ"}),

      // where the voxels begin
      nii.refused("whose voxels begin far behind its end", Nifti().set(108, 9e8f).file(),
                  {"begin at byte 900000000"}),
      gz.refused("whose voxels begin far behind its end", gzip(Nifti().set(108, 9e8f).file()),
                 {"ends after"}),
      nii.refused("whose voxels begin before the file", Nifti().set(108, -352.0f).file(),
                  {"begin at byte -352"}),
      nii.refused("whose voxels begin nowhere", Nifti().set(108, float(nan)).file(), {"begin at byte nan"}),
      nii.right("that forgot where its voxels begin", Nifti().set(108, 0.0f).file()),
      nii.right("with an extension",
                first(Nifti().set(108, 384.0f).file(), 352) + std::string(32, 'x') + voxels),

      // something else
      nii.refused("that is a text", std::string(600, 'x'), {"not a NIfTI-1 image"}),
      gz.refused("that is a text", gzip(std::string(600, 'x')), {"not a NIfTI-1 image"}),
      nii.refused("with a wrong magic", Nifti().set(344, std::array<char, 4>{'n', '+', '3', 0}).file(),
                  {"not a NIfTI-1 image"}),
      nii.refused("that is a DICOM file", dicom, {"DICOM"}),
      nii.refused("that is an NRRD", Nrrd().file(), {"not a NIfTI-1 image"}),

      // header and voxels apart
      right("A NIfTI in two files named by its voxels", {{"a.img", voxels}, {"a.hdr", pair.header()}}),
      right("A NIfTI in two files of which one is gzipped",
            {{"a.hdr", pair.header()}, {"a.img.gz", gzip(voxels)}}),
      refused("A NIfTI without its second file", {{"a.hdr", pair.header()}}, {"a.img", "No such file"}),
      refused("A NIfTI without its first file", {{"a.img", voxels}}, {"a.hdr", "No such file"}),
      refused("A NIfTI whose second file is cut short",
              {{"a.hdr", pair.header()}, {"a.img", first(voxels, 100)}}, {"a.img", "100 of 504 bytes"}),
      refused("An Analyze image", {{"a.hdr", Nifti().set(344, std::int32_t{0}).header()}, {"a.img", voxels}},
              {"Analyze", "how it lies"}),
  };
  for (const auto& [wrong, said] : {std::pair{0.0, "0 x 2 x 2.5 mm"}, {-1.5, "-1.5 x 2 x 2.5 mm"}}) {
    cases.push_back(
        nii.refused(std::string("in its qform with ") + said, qform_only().pixdim(1, wrong).file(), {said}));
    cases.push_back(nii.refused(std::string("without a place with ") + said,
                                without_place().pixdim(1, wrong).file(), {said}));
  }
  Case mri = right("An MRI in place of its segmentation",
                   {{"a.nii", Nifti().dims({20, 20, 20}).type(4, 16).data(grey_values()).file()}},
                   {"an MRI or CT rather than its segmentation"});
  mri.counts.clear();
  cases.push_back(std::move(mri));
  return cases;
}

// -------------------------------------------------------------------------------------------------- NRRD

std::vector<Case> nrrd_cases() {
  const OneFile nrrd{"a.nrrd", "An NRRD "};
  const std::string voxels = as_bytes<std::uint8_t>(SmallOrgan().voxel);
  const auto with = [](const std::string& key, const std::string& value) {
    return Nrrd().set(key, value).file();
  };
  const auto lacking = [](const std::string& key) { return Nrrd().erase(key).file(); };
  const auto at = [](const Affine3d& m) { return Nrrd().geometry(m).file(); };
  const auto encoded = [](const std::string& encoding, std::string bytes) {
    return Nrrd().set("encoding", encoding).data(std::move(bytes)).file();
  };
  const Affine3d plain = SmallOrgan().to_world;
  std::string text, hex;
  for (const unsigned char v : voxels) {
    text += std::to_string(int{v}) + " ";
    hex += "0123456789abcdef"[v >> 4], hex += "0123456789abcdef"[v & 15];
  }
  const auto layers = [&](const std::string& kind, int count) {
    std::string all;
    for (const char v : voxels) all.append(static_cast<std::size_t>(count), v);
    return Nrrd()
        .set("dimension", "4")
        .set("sizes", std::to_string(count) + " 9 8 7")
        .set("space directions", "none (1.5,0,0) (0,2,0) (0,0,2.5)")
        .set("kinds", kind + " domain domain domain")
        .data(all)
        .file();
  };
  const auto in_unit = [&](const std::string& unit, double factor) {
    return Nrrd()
        .geometry(Scaling(1.0 / factor) * plain)
        .set("space units", "\"" + unit + "\" \"" + unit + "\" \"" + unit + "\"")
        .file();
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
      nrrd.refused("that is empty", "", {"cannot be read as NRRD"}),
      nrrd.refused("that is all magic", "NRRD0004\n", {"cannot be read as NRRD"}),
      nrrd.refused("that is a text", "not an image\n", {"cannot be read as NRRD"}),
      nrrd.refused("of a version to come", "NRRD0009" + Nrrd().file().substr(8), {"cannot be read"}),
      nrrd.refused("cut by one byte", without_last(Nrrd().file(), 1), {"503 of 504 bytes", "incomplete"}),
      nrrd.refused("without an end of its header", without_last(Nrrd().header(), 1), {"NRRD"}),
      nrrd.refused("with noise for a header", "NRRD0004\n" + noise(5000), {"NRRD"}),
      nrrd.refused("with a line of a megabyte",
                   Nrrd().set("content", std::string(1 << 20, 'x')).set("sizes", "900 800 700").file(),
                   {"of 504000000 bytes"}),
      nrrd.right("with a comment of a megabyte", Nrrd().more("# " + std::string(1 << 20, 'x') + "\n").file()),
      nrrd.right("with the line ends of Windows", crlf + voxels),
      nrrd.right("that goes on after its voxels", Nrrd().file() + std::string(72, '\1'),
                 {"goes on for 72 bytes after its voxels"}),
      refused("A gzipped NRRD cut short", {{"a.nrrd", encoded("gzip", without_last(packed, 20))}},
              {"incomplete"}),
      refused("A gzipped NRRD damaged in its middle",
              {{"a.nrrd", encoded("gzip", with_flipped_byte(packed, packed.size() / 2))}}, {"damaged"}),
      nrrd.refused("that is not gzipped but says so", encoded("gzip", voxels), {"damaged"}),
      right("A gzipped NRRD with rubbish after its end",
            {{"a.nrrd", encoded("gzip", packed + "rubbish after the end")}}),
      nrrd.refused("in ASCII cut short", encoded("ascii", first(text, 700)), {"incomplete"}),
      nrrd.refused("in ASCII with words in it", encoded("ascii", "nine " + text), {"a.nrrd"}),
      nrrd.refused("in hexadecimal cut short", encoded("hex", first(hex, 500)), {"incomplete"}),
      nrrd.refused("that is bzipped", encoded("bzip2", "BZh9" + noise(300)), {"bzip2", "gzip", "unu save"}),
      nrrd.refused("of unknown encoding", encoded("zip", voxels), {"encoding"}),

      // sizes
      nrrd.refused("of 1200 voxels each way in one kilobyte", with("sizes", "1200 1200 1200"),
                   {"cannot hold 1728000000 bytes"}),
      large("An NRRD of a thousand voxels each way in two megabytes", "a.nrrd",
            [] { return Nrrd().set("sizes", "1000 1000 1000").data(std::string(2'000'000, '\1')).file(); },
            {"2000000 of 1000000000 bytes"}),
      large("A gzipped NRRD of a thousand voxels each way in two megabytes", "a.nrrd",
            [] {
              return Nrrd()
                  .set("sizes", "1000 1000 1000")
                  .set("encoding", "gzip")
                  .data(gzip(noise(2'000'000)))
                  .file();
            },
            {"2000000 of 1000000000 bytes"}),
      large("An NRRD in ASCII of a thousand voxels each way in two megabytes", "a.nrrd",
            [] {
              return Nrrd()
                  .set("sizes", "1000 1000 1000")
                  .set("encoding", "ascii")
                  .data(std::string(2'000'000, '1'))
                  .file();
            },
            {"1000000000"}),
      nrrd.refused("with two lines of sizes", Nrrd().more("sizes: 9 8 7\n").file(), {"a.nrrd"}),
      nrrd.refused("that is flat",
                   "NRRD0004\ntype: uint8\ndimension: 2\nsizes: 24 21\nencoding: raw\n\n" + voxels,
                   {"flat: 24 x 21"}),
      nrrd.refused("of one slice", with("sizes", "24 21 1"), {"flat"}),
      nrrd.refused("of vectors", layers("vector", 3), {"holds 3 numbers"}),
      nrrd.refused("of colours", layers("RGB-color", 3), {"holds 3 numbers"}),
      right("An NRRD of one layer", {{"a.seg.nrrd", layers("list", 1)}}),

      // types and values
      nrrd.refused("of blocks", Nrrd().set("type", "block").set("block size", "4").file(), {"a.nrrd"}),
      nrrd.refused("of two bytes in unknown order",
                   Nrrd().set("type", "uint16").data(as_bytes<std::uint16_t>(SmallOrgan().voxel)).file(),
                   {"endian"}),

      // place in space
      nrrd.right("in the coordinates of a scanner", with("space", "scanner-xyz"),
                 {"does not name patient directions"}),
      nrrd.right("in a space of three directions",
                 [] {
                   std::string f = Nrrd().file();
                   return f.replace(f.find("space: left-posterior-superior"), 30, "space dimension: 3");
                 }(),
                 {"does not name patient directions"}),
      nrrd.refused("with axes in one plane", at(degenerate()), {"one plane"}),
      nrrd.refused("with NaN in its origin", at(not_finite()), {"nan"}),
      nrrd.refused("with a spacing of zero", at(spaced(1.5, 0.0, 2.5)),
                   {"axis 2 has the direction (0,0,0), which has no length", "place in space"}),
      nrrd.refused("with a spacing of next to nothing",
                   with("space directions", "(1.5,0,0) (0,1e-310,0) (0,0,2.5)"), {"no length"}),
      nrrd.refused("whose space has more letters than the library has room for",
                   with("space", std::string(1000, 'l')), {"the line of space is 1007 letters long"}),
      nrrd.refused("whose directions have more letters than the library has room for",
                   with("space directions", "(1.5,0,0) (0,2,0) (0,0,2.5" + std::string(1000, '0')),
                   {"space directions are not 3 vectors"}),
      nrrd.refused("whose directions are many and of four numbers",
                   with("space directions", "(1.5,0,0) (0,2,0) (0,888881,1,0) (0," + std::string(40, '8') +
                                                ",0) (0,0,1) (0,0,1," + std::string(60, '8') + ")"),
                   {"space directions are not 3 vectors"}),
      nrrd.refused("with a long line that says nothing",
                   with("space", "left-posterior-superior\n" + std::string(1000, 'x')), {"letters long"}),
      nrrd.right("whose directions have every digit",
                 with("space directions",
                      "(1.50000000000000000,-0.00000000000000000,0.00000000000000000) "
                      "(0.00000000000000000,2.00000000000000000,-0.00000000000000000) "
                      "(-0.00000000000000000,0.00000000000000000,2.50000000000000000)")),
      nrrd.right("with a long description", with("content", std::string(1000, 'c'))),
      nrrd.right("with a long value of a key of its own",
                 with("space", "left-posterior-superior\nmine:=" + std::string(5000, 'v'))),
      nrrd.placed("without an origin", lacking("space origin"), Affine3d(Scaling(1.5, 2.0, 2.5)),
                  {"no space origin"}),
      nrrd.placed("with spacings alone",
                  Nrrd()
                      .erase("space")
                      .erase("space directions")
                      .erase("space origin")
                      .set("spacings", "1.5 2 2.5")
                      .file(),
                  Affine3d(Scaling(1.5, 2.0, 2.5)), {"no space directions"}),
      nrrd.refused("with a spacing that is not a number",
                   Nrrd()
                       .erase("space")
                       .erase("space directions")
                       .erase("space origin")
                       .set("spacings", "1.5 nan 2.5")
                       .file(),
                   {"a.nrrd"}),
      nrrd.right("in metres", in_unit("m", 1000.0), {"lengths in m;"}),
      nrrd.right("in microns", in_unit("um", 0.001), {"lengths in um;"}),
      nrrd.right("in an unknown unit", in_unit("pc", 1.0), {"'pc' is unknown"}),

      // header and voxels apart
      refused("An NRRD that does not name its second file", {{"a.nhdr", Nrrd().header()}},
              {"0 of 504 bytes"}),
      nrrd.refused("with a NUL in its encoding", encoded(std::string("ra\0w", 4), voxels), {"\n  try:   "}),
      right("An NRRD with lines to skip",
            {{"a.nhdr", Nrrd().set("line skip", "1").set("data file", "a.raw").header()},
             {"a.raw", "0123456789\n" + voxels}}),
      refused("A gzipped NRRD with its voxels at the end",
              {{"a.nrrd", Nrrd().set("byte skip", "-1").set("encoding", "gzip").data(packed).file()}},
              {"a.nrrd"}),

      // names
      named("A segmentation with names in Latin-1", {{"a.seg.nrrd", segments("h\xe9patique", "b", "2")}},
            "h\u00e9patique"),
      named("A segmentation with terminal commands for names",
            {{"a.seg.nrrd", segments("\x1b[2Jliver", "two\\nlines", "2")}}, " [2Jliver"),
      named("A segmentation that gives one label two names",
            {{"a.seg.nrrd", segments("liver", "kidney", "1")}}, "liver", {"'liver' and 'kidney'"}),
      named("A segmentation that counts a segment by a million digits",
            {{"a.seg.nrrd", Nrrd().more("Segment" + std::string(1000000, '1') + "_Name:=liver\n").file()}},
            "liver"),
      named("A segmentation with absurd label numbers",
            {{"a.seg.nrrd", segments("liver", "kidney", "99999999999999999999")}}, "liver"),
  };
  const std::pair<const char*, Words> lines[] = {
      {"sizes",
       {"9 8", "9 -8 7", "9 0 7", "nine eight seven", "4294967296 4294967296 4294967296",
        "4611686018427387905 4 126"}},
      {"dimension", {"17", "4294967299", "0"}},
      {"type", {"quaternion"}},
      {"space", {"left-posterior-inferior"}},
      {"space directions", {"(1.5,0,0) (0,2,0) none"}},
      {"byte skip", {"999999999999"}},
      {"line skip", {"999999999999"}}};
  for (const auto& [key, values] : lines)
    for (const std::string& value : values)
      cases.push_back(nrrd.refused(std::string("with ") + key + " " + value, with(key, value), {"a.nrrd"}));
  for (const char* key : {"sizes", "dimension", "type"})
    cases.push_back(nrrd.refused(std::string("without ") + key, lacking(key), {"a.nrrd"}));
  return cases;
}

// --------------------------------------------------------------------------------------------- MetaImage

std::vector<Case> metaimage_cases() {
  const OneFile mha{"a.mha", "A MetaImage "};
  const std::string voxels = as_bytes<std::uint8_t>(SmallOrgan().voxel), packed = zlib(voxels);
  const auto with = [](const std::string& key, const std::string& value) {
    return MetaImage().set(key, value).file();
  };
  // A key that MetaImage wants before the last line.
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
  std::string text;
  for (const unsigned char v : voxels) text += std::to_string(int{v}) + " ";

  std::vector<Case> cases = {
      // cut short or damaged
      mha.refused("that is empty", "", {"cannot be read as MetaImage"}),
      mha.refused("that is a text", "not an image\n", {"cannot be read as MetaImage"}),
      mha.refused("with noise for a header", noise(5000), {"a.mha"}),
      mha.refused("cut in its header", first(MetaImage().file(), 120), {"a.mha"}),
      mha.refused("cut by one byte", without_last(MetaImage().file(), 1), {"503 of 504 bytes", "incomplete"}),
      mha.right("that goes on after its voxels", MetaImage().file() + std::string(72, '\1'),
                {"goes on for 72 bytes after its voxels"}),
      right("A compressed MetaImage of unknown length", {{"a.mha", compressed(packed)}}),
      right("A compressed MetaImage that gives its length as zero", {{"a.mha", sized("0", packed)}}),
      refused("A compressed MetaImage cut short", {{"a.mha", compressed(without_last(packed, 20))}},
              {"incomplete"}),
      refused("A compressed MetaImage damaged in its middle",
              {{"a.mha", compressed(with_flipped_byte(packed, packed.size() / 2))}}, {"damaged"}),
      mha.refused("that is not compressed but says so", compressed(voxels), {"damaged"}),
      right("A compressed MetaImage that gives its length as a terabyte",
            {{"a.mha", sized("1000000000000", packed)}}),
      right("A compressed MetaImage that gives a negative length", {{"a.mha", sized("-5", packed)}}),
      right("A compressed MetaImage that gives too short a length", {{"a.mha", sized("10", packed)}}),
      mha.refused("with a line of a megabyte", inserted("Comment", std::string(1 << 20, 'x')).file(),
                  {"a.mha"}),
      mha.refused("with a key of a megabyte", inserted(std::string(1 << 20, 'x'), "1").file(), {"a.mha"}),

      // sizes
      mha.refused("of 1200 voxels each way in one kilobyte", with("DimSize", "1200 1200 1200"),
                  {"504 of 1728000000 bytes"}),
      large("A MetaImage of a thousand voxels each way in two megabytes", "a.mha",
            [] {
              return MetaImage().set("DimSize", "1000 1000 1000").data(std::string(2'000'000, '\1')).file();
            },
            {"2000000 of 1000000000 bytes"}),
      large("A compressed MetaImage of a thousand voxels each way in two megabytes", "a.mha",
            [] {
              return MetaImage()
                  .set("DimSize", "1000 1000 1000")
                  .set("CompressedData", "True")
                  .data(zlib(noise(2'000'000)))
                  .file();
            },
            {"2000000 of 1000000000 bytes"}),
      mha.refused("that says twice how many axes it has", with("BinaryData", "True\nNDims =444444444444444"),
                  {"a key that another line has"}),
      mha.refused("whose header holds what is no text", with("BinaryData", std::string("True\0\0\0", 7)),
                  {"key = value"}),
      mha.refused("with a line that has no value", with("BinaryData", "True\nNDims: 5"), {"key = value"}),
      mha.refused("that is flat",
                  "ObjectType = Image\nNDims = 2\nElementSpacing = 2 2\nDimSize = 24 21\nElementType = "
                  "MET_UCHAR\nElementDataFile = LOCAL\n" +
                      voxels,
                  {"flat"}),
      mha.refused("of one slice", with("DimSize", "24 21 1"), {"flat"}),
      mha.refused("of colours",
                  inserted("ElementNumberOfChannels", "3").data(voxels + voxels + voxels).file(),
                  {"holds 3 numbers"}),

      // types and values
      mha.refused("in ASCII", MetaImage().set("BinaryData", "False").data(text).file(), {"ASCII"}),

      // place in space
      mha.refused("with axes in one plane", at(degenerate()), {"one plane"}),
      mha.refused("with NaN in its origin", at(not_finite()), {"instead of 3 finite numbers"}),
      mha.refused("with a spacing of zero", with("ElementSpacing", "1.5 0 2.5"), {"1.5 x 0 x 2.5 mm"}),
      mha.refused("with a spacing of next to nothing", with("ElementSpacing", "1.5 1e-310 2.5"), {"1e-310"}),
      mha.refused("with an axis of no length", with("TransformMatrix", "1 0 0 0 0 0 0 0 1"),
                  {"has no length"}),
      mha.refused("with a NUL where its sizes should be", with("DimSize", std::string("9 8\0 7", 6)),
                  {"key = value"}),
      mha.refused("with a negative spacing", with("ElementSpacing", "1.5 -2 2.5"), {"1.5 x -2 x 2.5 mm"}),
      mha.refused("without a spacing", lacking("ElementSpacing"), {"no ElementSpacing"}),
      mha.right("that does not say how it lies", lacking("TransformMatrix"), {"no TransformMatrix"}),
      mha.placed("without an origin", lacking("Offset"), Affine3d(Scaling(1.5, 2.0, 2.5)), {"no Offset"}),
      mha.right("with its place under other names",
                [] {
                  std::string f = MetaImage().file();
                  f.replace(f.find("TransformMatrix"), 15, "Rotation");
                  return f.replace(f.find("Offset"), 6, "Position");
                }()),

      // header and voxels apart
      refused("A MetaImage that does not name its voxels", {{"a.mhd", lacking("ElementDataFile")}},
              {"a.mhd"}),
  };
  const std::pair<const char*, Words> lines[] = {
      {"DimSize",
       {"9 8", "9 -8 7", "9 0 7", "nine eight seven", "4294967305 4294967304 4294967303", "65536 65536 504"}},
      {"NDims", {"0", "-3", "100", "2000000000"}},
      {"ElementType", {"MET_QUATERNION", "MET_UCHAR_ARRAY"}},
      {"ElementSpacing", {"1.5 nan 2.5", "wide wide wide"}},
      {"TransformMatrix", {"1 0 0 0 1"}}};
  for (const auto& [key, values] : lines)
    for (const std::string& value : values)
      cases.push_back(mha.refused(std::string("with ") + key + " " + value, with(key, value), {"a.mha"}));
  for (const auto& [key, value] : {std::pair{"ElementNumberOfChannels", "0"},
                                   {"ElementNumberOfChannels", "-1"},
                                   {"HeaderSize", "999999999"}})
    cases.push_back(
        mha.refused(std::string("with ") + key + " " + value, inserted(key, value).file(), {"a.mha"}));
  for (const char* key : {"DimSize", "NDims", "ElementType"})
    cases.push_back(mha.refused(std::string("without ") + key, lacking(key), {"a.mha"}));
  return cases;
}

// ------------------------------------------------------------------------- header and voxels apart

/// The two formats whose header names the file of its voxels.
std::vector<Case> two_file_cases() {
  const std::string voxels = as_bytes<std::uint8_t>(SmallOrgan().voxel);
  std::vector<Case> cases;
  for (const bool is_nrrd : {true, false}) {
    const std::string an = is_nrrd ? "An NRRD " : "A MetaImage ", file = is_nrrd ? "a.nhdr" : "a.mhd",
                      names = is_nrrd ? "data file" : "ElementDataFile",
                      skips = is_nrrd ? "byte skip" : "HeaderSize";
    const auto headed = [&] { return is_nrrd ? TextImage(Nrrd()) : TextImage(MetaImage()); };
    const auto detached = [&](const std::string& where) { return headed().set(names, where).header(); };
    const auto skipping = [&](const std::string& bytes) {
      return headed().erase(names).set(skips, bytes).set(names, "a.raw").header();
    };
    const auto no = [&](const char* name, const std::string& header, Files more, Words words) {
      more.insert(more.begin(), {file, header});
      cases.push_back(refused(an + name, std::move(more), std::move(words)));
    };
    no("without its second file", detached("a.raw"), {}, {"a.raw", "No such file"});
    no("with an empty name of its second file", detached(""), {}, {is_nrrd ? file : "does not say in which"});
    no("whose second file is cut short", detached("a.raw"), {{"a.raw", first(voxels, 100)}},
       {"100 of 504 bytes"});
    no("in a list of files", detached("LIST") + "a.raw\n", {{"a.raw", voxels}}, {"several files"});
    no("in numbered files", detached("a%d.raw 1 7 1"), {{"a1.raw", voxels}}, {"several files"});
    no("with its voxels in a device", detached("/dev/zero"), {}, {"/dev/zero", "not a file"});
    no("with its voxels in a folder", detached("."), {}, {"Is a directory"});
    cases.push_back(prepared(an + "with its voxels in a pipe", file,
                             [file, header = detached("a.raw")](const fs::path& folder) {
                               write(folder / file, header);
                               mkfifo((folder / "a.raw").c_str(), 0600);
                             },
                             {"a.raw", "not a file"}));
    cases.push_back(right(an + "with its voxels in another folder",
                          {{"b/" + file, detached("../a.raw")}, {"a.raw", voxels}}));
    for (const char* bytes : {"10", "-1"})  // -1: the voxels are at the end
      cases.push_back(right(an + "with " + bytes + " bytes to skip",
                            {{file, skipping(bytes)}, {"a.raw", "0123456789" + voxels}}));
  }
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
  // Room on the disk is taken only by what is written: a gigabyte of holes costs nothing.
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
      prepared("A loop of symbolic links", "a.nii.gz", link("a.nii.gz", "a.nii.gz"), {"Too many levels"}),
      prepared("A symbolic link to nothing", "a.mha", link("gone.mha", "a.mha"), {"No such file"}),
      prepared("A pipe under the name of a NIfTI", "a.nii", pipe("a.nii"), {"not a file"}),
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
INSTANTIATE_TEST_SUITE_P(TwoFiles, HostileImage, testing::ValuesIn(two_file_cases()), identifier);
INSTANTIATE_TEST_SUITE_P(Path, HostileImage, testing::ValuesIn(file_cases()), identifier);

}  // namespace
}  // namespace dimple
