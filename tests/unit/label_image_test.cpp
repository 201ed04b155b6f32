#include "io/label_image.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <random>
#include <sstream>

#include "io/error.hpp"
#include "io/file.hpp"
#include "preprocess/image/phantom.hpp"
#include "preprocess/surface/label_surface.hpp"
#include "tests/helpers/folder.hpp"
#include "tests/helpers/image.hpp"
#include "tests/helpers/report.hpp"
#include "tests/helpers/small_disk.hpp"
#include "tests/helpers/stored_image.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

/// An asymmetric body of three labels with known names, so that no rotation maps it to itself.
LabelImage body() {
  LabelImage image;
  image.size = {5, 7, 4};
  image.to_world = Eigen::Translation3d(-12.5, 40.25, 7.0) * Eigen::Scaling(0.5, 1.25, 2.0);
  std::mt19937 random(7);
  std::vector<std::int32_t> voxel;
  for (int v = 0; v < 5 * 7 * 4; ++v) voxel.push_back(static_cast<int>(random() % 4));
  set_voxels(image, voxel);
  image.names = {{1, "cortex"}, {2, "white matter"}, {3, "tumour, \"left\""}};
  return image;
}

/// The body, rotated about a skew axis.
LabelImage oblique_body() {
  LabelImage image = body();
  image.to_world = Eigen::AngleAxisd(0.3, Vec3(1, 2, -1).normalized()) * image.to_world;
  return image;
}

/// Expects equal labels at equal places.
void expect_same(const LabelImage& a, const LabelImage& b, double tolerance_mm) {
  EXPECT_EQ(a.size, b.size);
  EXPECT_EQ(a.run, b.run);
  EXPECT_EQ(a.row_offset, b.row_offset);
  EXPECT_LT((a.to_world.matrix() - b.to_world.matrix()).cwiseAbs().maxCoeff(), tolerance_mm)
      << a.to_world.matrix() << "\n\n"
      << b.to_world.matrix();
}

LabelImage read(const std::string& name, const std::string& content) {
  const fs::path file = test_folder() / name;
  write_file(file, content);
  return read_label_image(file);
}

Report refusal(const std::string& name, const std::string& content) {
  const Report report = report_of<InputError>([&] { read(name, content); });
  EXPECT_FALSE(report.fact.empty() || report.why.empty() || report.remedy.empty());
  EXPECT_NE(report.where.find(name), std::string::npos) << report.where;
  return report;
}

/// All four texts of a report in one string.
std::string all(const Report& r) {
  return r.fact + " | " + r.where + " | " + r.why + " | " + r.remedy;
}

bool warns_of(const LabelImage& image, const std::string& words) {
  return std::any_of(image.warnings.begin(), image.warnings.end(),
                     [&](const std::string& w) { return w.find(words) != std::string::npos; });
}

#define EXPECT_SAYS(text, words) EXPECT_NE((text).find(words), std::string::npos) << (text)

// -------------------------------------------------------------------------------------------- geometry

TEST(LabelImage, GivesTheSameOrganForEveryStorageOrder) {
  LabelImage halfway = body();  // rotated by 45 degrees, +L and +P are equally near
  halfway.to_world = Eigen::AngleAxisd(std::acos(-1.0) / 4.0, Vec3::UnitZ()) * halfway.to_world;
  for (const LabelImage& organ : {body(), oblique_body(), halfway}) {
    const bool one_nearest = organ.to_world.matrix() != halfway.to_world.matrix();
    const LabelImage first = read("first.nrrd", nrrd_of(as_it_is(organ)));
    if (one_nearest) expect_same(first, organ, 1e-9);
    std::array<int, 3> axis{0, 1, 2};
    do {
      for (int signs = 0; signs < 8; ++signs) {
        SCOPED_TRACE(testing::Message() << axis[0] << axis[1] << axis[2] << " signs " << signs);
        const StoredImage raw =
            stored_as(organ, axis, {(signs & 1) != 0, (signs & 2) != 0, (signs & 4) != 0});
        expect_same(read("order.nrrd", nrrd_of(raw)), first, 1e-9);
        if (!one_nearest) continue;
        std::string letters;
        for (std::size_t c = 0; c < 3; ++c) letters += (signs >> c & 1 ? "RAI" : "LPS")[axis[c]];
        for (const LabelImage& image :
             {read("order_ras.nrrd", nrrd_of(raw, true)), read("order.mha", metaimage_of(raw))}) {
          expect_same(image, organ, 1e-9);
          EXPECT_EQ(image.orientation, letters);
          EXPECT_EQ(image.stored_size, raw.size);
          EXPECT_NEAR(image.stored_spacing[0], organ.spacing()[axis[0]], 1e-9);
          EXPECT_GT(image.voxel_volume(), 0.0);
        }
        expect_same(read("order.nii", NiftiFile(raw).file()), organ, 1e-5);  // NIfTI's single precision
      }
    } while (std::next_permutation(axis.begin(), axis.end()));
  }
}

TEST(LabelImage, KeepsEveryVoxelInItsPlaceUnderAnyTurn) {
  // The multiset of (position, label) does not depend on the choice of axes.
  std::mt19937 random(3);
  std::uniform_real_distribution<double> angle(-3.0, 3.0);
  for (int turn = 0; turn < 50; ++turn) {
    LabelImage organ = body();
    organ.to_world =
        Eigen::AngleAxisd(angle(random), Vec3(angle(random), angle(random), angle(random)).normalized()) *
        organ.to_world;
    const StoredImage raw = as_it_is(organ);
    const LabelImage image = read("turned.nrrd", nrrd_of(raw));
    const Mat3 axes = image.to_world.linear().colwise().normalized();
    EXPECT_GT(axes.determinant(), 0.0);
    EXPECT_GT(axes.trace(), 1.9);  // no rotation is further than this from the nearest of the 24
    const Eigen::Affine3d to_stored = raw.to_world.inverse() * image.to_world;
    for (Index k = 0; k < image.size[2]; ++k)
      for (Index j = 0; j < image.size[1]; ++j)
        for (Index i = 0; i < image.size[0]; ++i) {
          const Vec3 s = to_stored * place_of(i, j, k);
          ASSERT_LT((s - Vec3(s.array().round())).norm(), 1e-9);
          ASSERT_EQ(image.at(i, j, k), organ.at(std::lround(s[0]), std::lround(s[1]), std::lround(s[2])));
        }
  }
}

TEST(LabelImage, KeepsATurnOfAThousandthAndDropsOneOfRounding) {
  for (const double turn : {1e-3, 1e-4, 1e-6}) {
    StoredImage raw = as_it_is(body());
    raw.to_world.linear() = Eigen::AngleAxisd(turn, Vec3::UnitZ()).toRotationMatrix() * raw.to_world.linear();
    const Vec3 axis = read("turned_a_little.nrrd", nrrd_of(raw)).to_world.linear().col(0).normalized();
    EXPECT_NEAR(axis.y(), turn > 2e-5 ? turn : 0.0, 1e-9) << turn;
  }
}

/// An ellipsoid with a bump, no two extents alike.
LabelImage bumpy_body(const Vec3& spacing) {
  LabelImage image = image_of({23, 19, 14}, spacing, [](Index i, Index j, Index k) {
    const Vec3 x = place_of(i, j, k);
    return (x - Vec3(11, 9, 6)).cwiseQuotient(Vec3(9.5, 7.5, 5.0)).norm() < 1.0 ||
           (x - Vec3(15, 6, 9)).norm() < 3.6;
  });
  image.to_world = Eigen::Translation3d(-12.5, 40.25, 7.0) * image.to_world;
  return image;
}

// Programs write one image in different forms: storage order, format, single or double precision, six digits,
// and any rounding by a millionth of a millimetre.
TEST(LabelImage, HasTheSameShapeHoweverItIsStoredAndItsHeaderRounded) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> rounding(-1e-6, 1e-6);
  int directions = 0;
  for (const Vec3& spacing : {Vec3(0.5, 1.25, 2.0), Vec3(375.0 / 512, 375.0 / 512, 0.7), Vec3(0.4, 0.4, 0.4),
                              Vec3(1.3671875, 1.3671875, 2.5), Vec3(3.05, 3.05, 10.0)})
    for (const bool oblique : {false, true}) {
      LabelImage organ = bumpy_body(spacing);
      if (oblique) organ.to_world = Eigen::AngleAxisd(0.3, Vec3(1, 2, -1).normalized()) * organ.to_world;
      const LabelImage first = read("first.nrrd", nrrd_of(as_it_is(organ)));
      const SegmentedBody body = make_body_surface(first, {});
      std::array<int, 3> axis{0, 1, 2};
      do {
        for (const int signs : {0, 3, 5, 7})
          for (int rounded = 0; rounded < 3; ++rounded) {
            StoredImage raw = stored_as(organ, axis, {(signs & 1) != 0, (signs & 2) != 0, (signs & 4) != 0});
            for (double& x : raw.to_world.matrix().topRows<3>().reshaped()) {
              if (rounded == 1) x += rounding(random);
              // Oblique axes are excluded: three numbers of six digits give a length to five.
              if (rounded == 2 && !oblique) x = std::stod((std::ostringstream() << x).str());  // six digits
            }
            for (const auto& [name, bytes] : {std::pair{"a.nrrd", nrrd_of(raw)},
                                              {"ras.nrrd", nrrd_of(raw, true)},
                                              {"a.mha", metaimage_of(raw)},
                                              {"a.nii", NiftiFile(raw).file()}}) {
              SCOPED_TRACE(testing::Message()
                           << name << ", axes " << axis[0] << axis[1] << axis[2] << ", signs " << signs
                           << ", rounded " << rounded << ", spacing " << spacing.transpose()
                           << (oblique ? ", oblique" : ""));
              const LabelImage image = read(name, bytes);
              ++directions;
              ASSERT_EQ(image.run, first.run);
              ASSERT_EQ(image.spacing(), first.spacing());
              ASSERT_EQ(image.voxel_volume(), first.voxel_volume());
              ASSERT_LT((image.to_world.matrix() - organ.to_world.matrix()).cwiseAbs().maxCoeff(), 2e-3);
              if (!oblique) {
                ASSERT_EQ(image.to_world.linear(), first.to_world.linear());
              }
              if (signs != 3) continue;  // the surface is checked for some only
              const SegmentedBody same = make_body_surface(image, {});
              ASSERT_EQ(same.surface.vertex().cols(), body.surface.vertex().cols());
              ASSERT_EQ((same.surface.vertex() - body.surface.vertex()).cwiseAbs().maxCoeff(), 0.0);
            }
          }
      } while (std::next_permutation(axis.begin(), axis.end()));
    }
  EXPECT_EQ(directions, 5 * 2 * 6 * 4 * 3 * 4);
}

TEST(LabelImage, RoundsSpacingToABillionthOfAMillimetre) {
  LabelImage organ = body();
  organ.to_world.linear()(2, 2) = 1.9999999999999964;
  EXPECT_EQ(read("rounded.nrrd", nrrd_of(as_it_is(organ))).spacing()[2], 2.0);
}

// -------------------------------------------------------------------------------------------- round trips

TEST(LabelImage, IsTheSameAfterWritingAndReadingInEveryFormat) {
  const fs::path folder = fresh_folder();
  for (const LabelImage& organ : {body(), oblique_body()})
    for (const auto& [name, format, tolerance] : {std::tuple{"a.nrrd", "3D Slicer segmentation (NRRD)", 1e-9},
                                                  {"a.seg.nrrd", "3D Slicer segmentation (NRRD)", 1e-9},
                                                  {"a.mha", "MetaImage", 1e-9},
                                                  {"a.nii", "NIfTI-1", 1e-5},
                                                  {"a.nii.gz", "NIfTI-1", 1e-5}}) {
      SCOPED_TRACE(name);
      write_label_image(folder / name, organ);
      const fs::path table = folder / "a.labels.txt";
      const bool needs_table = std::string(format) == "NIfTI-1" || std::string(format) == "MetaImage";
      const LabelImage back = read_label_image(folder / name, needs_table ? table : fs::path());
      expect_same(back, organ, tolerance);
      EXPECT_EQ(back.names, organ.names);
      EXPECT_EQ(back.format, format);
      EXPECT_EQ(back.orientation, "LPS");
      EXPECT_TRUE(back.warnings.empty()) << back.warnings.front();
    }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), {}), 6);  // five images, one table, nothing else

  LabelImage sheared = body();  // whose axes are not at right angles
  sheared.to_world.linear()(0, 1) = 0.02 * sheared.to_world.linear()(1, 1);
  write_label_image(folder / "a.nii.gz", sheared);
  expect_same(read_label_image(folder / "a.nii.gz"), sheared, 1e-5);
}

TEST(LabelImage, IsWrittenInTheSmallestTypeThatHoldsItsLabels) {
  const fs::path folder = fresh_folder();
  for (const auto& [label, type] :
       {std::pair{255, "unsigned char"}, {256, "unsigned short"}, {65536, "int"}}) {
    LabelImage organ = body();
    organ.names.clear();
    std::vector<std::int32_t> voxel = every_voxel(organ);
    voxel[17] = label;
    set_voxels(organ, voxel);
    for (const char* name : {"a.nrrd", "a.mha", "a.nii.gz"}) {
      write_label_image(folder / name, organ);
      expect_same(read_label_image(folder / name), organ, 1e-5);
    }
    EXPECT_SAYS(read_file(folder / "a.nrrd").substr(0, 400), std::string("type: ") + type + "\n");
    EXPECT_EQ(read_label_image(folder / "a.nrrd").format, "NRRD");
  }
}

TEST(LabelImage, HasTheKeysOf3DSlicerWhenWrittenAsASegmentation) {
  const fs::path file = fresh_folder() / "brain.seg.nrrd";
  write_label_image(file, make_phantom({.spacing_mm = 2.0}));
  const std::string header = read_file(file).substr(0, 3000);
  for (const char* key :
       {"Segment0_ID:=Segment_1\n", "Segment0_Name:=left_hemisphere\n", "Segment0_LabelValue:=1\n",
        "Segment0_Layer:=0\n", "Segment1_Name:=right_hemisphere\n", "Segment1_LabelValue:=2\n",
        "Segment0_Color:=", "Segmentation_MasterRepresentation:=Binary labelmap\n",
        "Segmentation_ReferenceImageExtentOffset:=0 0 0\n",
        "Segmentation_ContainedRepresentationNames:=Binary labelmap|\n"})
    EXPECT_SAYS(header, key);
  EXPECT_SAYS(header, "Segment0_Extent:=18 33 2 ");  // voxels of the left half, border of two
}

TEST(LabelImage, IsNotWrittenUnderAnUnknownSuffixOrIntoAMissingFolder) {
  const fs::path folder = fresh_folder();
  for (const char* name : {"a.png", "a.nhdr", "a.mhd", "a", "a.nrrd.gz"})
    expect_error<UsageError>([&] { write_label_image(folder / name, body()); }, {.why = ".seg.nrrd"});
  for (const char* name : {"a.nrrd", "a.nii.gz", "a.mha"})
    expect_error<OutputError>([&] { write_label_image(folder / "missing" / name, body()); },
                              {.fact = "No such file or directory"});
  EXPECT_TRUE(fs::is_empty(folder));
}

TEST(LabelImage, KeepsTheOlderFileWhenTheDiskIsFull) {
  const fs::path folder = fresh_folder();
  LabelImage noise = body();  // does not compress
  noise.names.clear();
  noise.size = {64, 64, 64};
  std::mt19937 random(5);
  std::vector<std::int32_t> voxel(64 * 64 * 64);
  for (auto& v : voxel) v = static_cast<std::int32_t>(random() % 256);
  set_voxels(noise, voxel);
  for (const char* name : {"a.nrrd", "a.nii", "a.nii.gz", "a.mha"}) {
    SCOPED_TRACE(name);
    write_label_image(folder / name, body());
    const std::string before = read_file(folder / name);
    for (const rlim_t size : {20'000, 262'144}) {  // early, and in the last block
      const SmallDisk full(size);
      EXPECT_THROW(write_label_image(folder / name, noise), OutputError);
    }
    EXPECT_EQ(read_file(folder / name), before);
  }
  for (const auto& entry : fs::directory_iterator(folder))
    EXPECT_NE(entry.path().filename().string().front(), '.') << entry.path();
}

// -------------------------------------------------------------------------------------------- voxel types

/// The body in single precision, with another value in voxel (3, 0, 1).
std::string with_value(float value) {
  const StoredImage raw = as_it_is(body());
  NiftiFile nifti(raw);
  nifti.type(16, 32);
  nifti.voxels.clear();
  for (std::size_t v = 0; v < raw.voxel.size(); ++v) {
    const float number = v == 38 ? value : static_cast<float>(raw.voxel[v]);
    nifti.voxels.append(reinterpret_cast<const char*>(&number), sizeof number);
  }
  return nifti.file();
}

TEST(LabelImage, RoundsLabelsThatAreWholeNumbersButForRoundingAndWarns) {
  const std::tuple<float, int, const char*> values[] = {{3.0000458f, 3, "by 4.6e-05 at most"},
                                                        {2.99992f, 3, "by 8e-05 at most"},
                                                        {-1.2e-7f, 0, "by 1.2e-07 at most"}};
  for (const auto& [value, label, words] : values) {
    const LabelImage image = read("near.nii", with_value(value));
    EXPECT_EQ(image.at(3, 0, 1), label);
    EXPECT_TRUE(warns_of(image, words)) << value;
  }
  EXPECT_FALSE(warns_of(read("whole.nii", with_value(3.0f)), "rounded"));

  // Bytes are scaled by 12/255: half a step is 0.0235, and label 6 is just as far from its number.
  LabelImage twice = body();
  for (auto& part : twice.run) part.label *= 2;
  NiftiFile scaled(as_it_is(twice));
  for (char& v : scaled.voxels) v = static_cast<char>(std::nearbyint(v * 255 / 12.0));
  scaled.set(112, 12.0f / 255.0f);
  const LabelImage image = read("scaled.nii", scaled.file());
  expect_same(image, twice, 1e-5);
  EXPECT_TRUE(warns_of(image, "by 0.024 at most"));
}

TEST(LabelImage, RefusesVoxelsThatAreNoLabels) {
  const StoredImage raw = as_it_is(body());
  const Report half = refusal("bad.nii", with_value(0.5f));
  EXPECT_SAYS(half.fact, "1 of 140 voxels hold no label: the first is 0.5, which is not a whole number");
  EXPECT_SAYS(half.where, "stored voxel (3, 0, 1)");
  EXPECT_SAYS(half.remedy, "label map");
  for (const auto& [value, words] : {std::pair{2.9997f, "2.9997, which is not a whole number"},
                                     {600000.5f, "600000.5, which is not a whole number"},
                                     {3e9f, "larger than"}})
    EXPECT_SAYS(refusal("bad.nii", with_value(value)).fact, words);

  // Values that are not multiples of labels, from an MRI with its scale.
  for (const float slope : {0.1f, 0.5f, 2.0f / 3.0f, 1.25f}) {
    NiftiFile mri(raw);
    for (char& v : mri.voxels) v = static_cast<char>(v + 1);
    mri.set(112, slope);
    EXPECT_SAYS(refusal("mri.nii", mri.file()).fact, "not a whole number");
  }
}

// -------------------------------------------------------------------------------------------- refusals
// Most refusals are in the table of tests/end_to_end/hostile_images_test.cpp.

TEST(LabelImage, IsRefusedWhereItsNeighboursAreHardlyEverAlike) {
  // The image has 260^3 grey values: 17.6 million runs of one voxel would be 12 times the file.
  StoredImage mri{{260, 260, 260}, Eigen::Affine3d::Identity(), std::vector<std::uint8_t>(260 * 260 * 260)};
  std::mt19937 random(2);
  for (auto& v : mri.voxel) v = static_cast<std::uint8_t>(random() >> 24);
  const Report report = refusal("mri.nrrd", nrrd_of(mri));
  EXPECT_SAYS(report.fact, "change more than 4194304 times along the rows of 260 x 260 x 260 voxels");
  EXPECT_SAYS(report.why, "an MRI or CT rather than its segmentation");
}

// -------------------------------------------------------------------------------------------- names

TEST(LabelImage, IsTheSameOfLabelsInMemoryInWhateverOrderTheyLie) {
  const LabelImage image = oblique_body();
  std::array<int, 3> axis{0, 1, 2};
  do {
    const StoredImage raw = stored_as(image, axis, {axis[0] == 1, false, axis[2] != 2});
    const auto [nx, ny, nz] = raw.size;
    const std::vector<double> number(raw.voxel.begin(), raw.voxel.end());
    LabelArray array{
        .voxel = number.data(), .size = raw.size, .step = {1, nx, nx * ny}, .to_world = raw.to_world};
    expect_same(label_image_of(array), image, 1e-9);
    // Voxels with the last axis fastest, as C and numpy keep them.
    std::vector<std::int64_t> turned(raw.voxel.size());
    for (Index k = 0; k < nz; ++k)
      for (Index j = 0; j < ny; ++j)
        for (Index i = 0; i < nx; ++i)
          turned[static_cast<std::size_t>((i * ny + j) * nz + k)] =
              raw.voxel[static_cast<std::size_t>(i + nx * (j + ny * k))];
    array.voxel = turned.data();
    array.step = {ny * nz, nz, 1};
    expect_same(label_image_of(array), image, 1e-9);
    turned[static_cast<std::size_t>((1 * ny + 2) * nz + 3)] = -1;
    EXPECT_EQ(report_of<InputError>([&] { label_image_of(array); }).where,
              "label image in memory, stored voxel (1, 2, 3)");
  } while (std::next_permutation(axis.begin(), axis.end()));
}

/// The body, whose file names its labels, read with a table of names.
LabelImage with_table(const std::string& table) {
  const fs::path folder = test_folder();
  write_label_image(folder / "a.nrrd", body());
  write_file(folder / "table", table);
  return read_label_image(folder / "a.nrrd", folder / "table");
}

TEST(LabelImage, TakesNamesFromATableOverThoseInTheFile) {
  const LabelImage snap = with_table(
      "################\n# ITK-SnAP Label Description File\n"
      "    0     0    0    0        0  0  0    \"Clear Label\"\n"
      "    1   255    0    0        1  1  1    \"grey matter\"\r\n"
      "    9     0  255    0        1  1  1    \"vessel 2\"\n");
  EXPECT_EQ(snap.names.at(1), "grey matter");
  EXPECT_EQ(snap.names.at(2), "white matter");  // still from the file
  EXPECT_EQ(snap.names.at(9), "vessel 2");
  EXPECT_FALSE(snap.names.contains(0));
  const LabelImage lut = with_table(
      "#No. Label Name: R G B A\n\n0 Unknown 0 0 0 0\n2 Left-Cerebral-White-Matter 245 245 245 0\n"
      "3 two words 205 62 78\n");
  EXPECT_EQ(lut.names.at(2), "Left-Cerebral-White-Matter");
  EXPECT_EQ(lut.names.at(3), "two words");

  for (const auto& [table, words] : {std::pair{"1 a 0 0 0 0\nbrain 1\n", "line 2"},
                                     {"1 255 0 0\n", "names no label"},
                                     {"1 0 0 0 1 1 1 \"open\n", "closing quote"},
                                     {"# only a comment\n", "names no label"}}) {
    const Report report = report_of<InputError>([&] { with_table(table); });
    EXPECT_SAYS(report.remedy, "--label-names");
    EXPECT_SAYS(all(report), words);
  }
  EXPECT_THROW(read_label_image(test_folder() / "a.nrrd", test_folder() / "missing.txt"), InputError);
}

TEST(LabelNames, AreThoseOfTotalSegmentatorWithoutAFile) {
  const fs::path folder = fresh_folder();
  LabelImage organ = body();
  organ.names.clear();
  for (auto& part : organ.run) part.label = part.label == 1 ? 5 : part.label == 2 ? 51 : 117;
  write_label_image(folder / "ct.nii.gz", organ);
  const LabelImage ct = read_label_image(folder / "ct.nii.gz", "totalsegmentator");
  EXPECT_EQ(ct.names.size(), 117u);
  EXPECT_EQ(ct.names.at(5), "liver");
  EXPECT_EQ(ct.names.at(51), "heart");
  EXPECT_EQ(ct.names.at(117), "costal_cartilages");
  EXPECT_FALSE(warns_of(ct, "TotalSegmentator"));

  for (auto& part : organ.run) part.label = part.label == 5 ? 5 : part.label == 51 ? 22 : 50;
  write_label_image(folder / "mr.nii.gz", organ);
  const LabelImage mr = read_label_image(folder / "mr.nii.gz", "TotalSegmentator-MR");
  EXPECT_EQ(mr.names.size(), 50u);
  EXPECT_EQ(mr.names.at(22), "heart");
  EXPECT_EQ(mr.names.at(50), "brain");
  EXPECT_FALSE(warns_of(mr, "TotalSegmentator"));
  EXPECT_TRUE(warns_of(read_label_image(folder / "mr.nii.gz", "totalsegmentator"),
                       "label 22 is read as prostate, as in CT; for an MR it is heart"));

  for (auto& part : organ.run) part.label = 5;  // a label with the same name in both
  write_label_image(folder / "liver.nii.gz", organ);
  EXPECT_TRUE(read_label_image(folder / "liver.nii.gz", "totalsegmentator").warnings.empty());
  EXPECT_THROW(read_label_image(folder / "liver.nii.gz", "totalsegment"), InputError);
}

TEST(LabelNames, AreReadFromThreeDSlicersTables) {
  // The .ctbl is as 3D Slicer writes it, with numbers that have no name.
  const LabelImage ctbl = with_table(
      "# Color table file C:/Users/me/GenericColors.ctbl\r\n# 4 values\r\n0 Background 0 0 0 0\r\n1 artery "
      "216 101 79 255\r\n"
      "2 (none) 0 0 0 0\r\n3 connective_tissue 111 184 210 255\r\n");
  EXPECT_EQ(ctbl.names.at(1), "artery");
  EXPECT_EQ(ctbl.names.at(2), "white matter");  // the image's own
  EXPECT_EQ(ctbl.names.at(3), "connective_tissue");
  EXPECT_TRUE(ctbl.warnings.empty());
  // The .csv is that of newer versions.
  const LabelImage csv = with_table(
      "LabelValue,Name,Color_R,Color_G,Color_B,Color_A,Type_CodingScheme,Type_CodeValue,Type_CodeMeaning\n"
      "2,\"liver, left lobe\",221,130,101,255,SCT,10200004,Liver\n1,,216,101,79,255,SCT,51114001,Artery\n");
  EXPECT_EQ(csv.names.at(1), "Artery");
  EXPECT_EQ(csv.names.at(2), "liver, left lobe");
  EXPECT_TRUE(csv.warnings.empty());
  EXPECT_THROW(with_table("LabelValue,Name\nfirst,liver\n"), InputError);
}

TEST(LabelNames, AreWarnedOfWhereTheTableIsAmbiguous) {
  EXPECT_TRUE(
      warns_of(with_table("1 liver 1 2 3 255\n1 spleen 1 2 3 255\n"), "label 1 both 'liver' and 'spleen'"));
  EXPECT_TRUE(with_table("1 upper lobe 10 20 30 255\n").warnings.empty());
  EXPECT_TRUE(warns_of(with_table("1 upper lobe 3 10 20 30 255\n"), "first in line 1"));
  EXPECT_TRUE(warns_of(with_table("8 liver 1 2 3 255\n"), "names none of the labels"));
}

// -------------------------------------------------------------------------------------------- measures

TEST(LabelImage, IsMeasuredByLabel) {
  LabelImage image;
  image.size = {6, 5, 4};
  image.to_world = Eigen::Affine3d(Eigen::Scaling(1.0, 2.0, 3.0));
  std::vector<std::int32_t> voxel(6 * 5 * 4, 0);
  const auto set = [&](Index i, Index j, Index k, int label) {
    voxel[static_cast<std::size_t>(i + 6 * (j + 5 * k))] = label;
  };
  set(1, 1, 1, 7), set(2, 1, 1, 7), set(3, 2, 1, 7);  // the third is in contact by an edge only
  set(2, 2, 1, 3);                                    // another label between them does not join them
  set(5, 4, 3, 9);                                    // a corner of the image
  set_voxels(image, voxel);
  image.names = {{7, "nucleus"}};
  const auto labels = measure_labels(image);
  ASSERT_EQ(labels.size(), 3u);
  EXPECT_EQ(labels[0].value, 3);
  EXPECT_EQ(labels[1].value, 7);
  EXPECT_EQ(labels[1].name, "nucleus");
  EXPECT_EQ(labels[1].voxels, 3);
  EXPECT_DOUBLE_EQ(labels[1].volume_mm3, 18.0);
  EXPECT_EQ(labels[1].pieces, 2);
  EXPECT_EQ(labels[1].largest_piece_voxels, 2);
  EXPECT_FALSE(labels[1].meets_border);
  EXPECT_TRUE(labels[2].meets_border);
  EXPECT_EQ(labels[2].pieces, 1);
}

// -------------------------------------------------------------------------------------------- real images

class RealLabelImage : public testing::Test {
 protected:
  void SetUp() override {
    const char* folder = std::getenv("DIMPLE_SHARED_DATA");
    if (!folder) GTEST_SKIP() << "set DIMPLE_SHARED_DATA to the folder of real label images to run this test";
    data = folder;
  }
  double volume(const std::string& name, int label = 0) const {
    double sum = 0.0;
    for (const LabelMeasure& measure : measure_labels(read_label_image(data / name)))
      if (label == 0 || measure.value == label) sum += measure.volume_mm3;
    return sum;
  }
  fs::path data;
};

TEST_F(RealLabelImage, HasTheVolumeThatIsKnownOfIt) {
  EXPECT_NEAR(volume("heart_ct_1.5mm.nii.gz"), 668'844, 1);
  EXPECT_NEAR(volume("human_brain_mri_2mm.nrrd"), 1'124'536, 1);
  EXPECT_NEAR(volume("lung_ct_aniso.mha"), 3'363'586, 1);
}

TEST_F(RealLabelImage, OfABrainStoredLeftHandedIsTurnedToLeftPosteriorSuperior) {
  const LabelImage brain = read_label_image(data / "human_brain_mri_2mm.nrrd");
  EXPECT_EQ(brain.orientation, "LIA");
  EXPECT_EQ(brain.stored_size, (std::array<Index, 3>{72, 78, 80}));
  EXPECT_EQ(brain.size, (std::array<Index, 3>{72, 80, 78}));
  EXPECT_TRUE(brain.to_world.linear().isApprox(2.0 * Mat3::Identity()));
  EXPECT_DOUBLE_EQ(brain.voxel_volume(), 8.0);
}

TEST_F(RealLabelImage, Of3DSlicerHasItsNames) {
  const LabelImage chest = read_label_image(data / "chest_ct_10mm.seg.nrrd");
  EXPECT_EQ(chest.format, "3D Slicer segmentation (NRRD)");
  EXPECT_EQ(chest.names.size(), 7u);
  EXPECT_EQ(chest.names.at(6), "left lung");
  EXPECT_EQ(chest.names.at(7), "tissue");
  EXPECT_EQ(chest.orientation, "RAS");
  const auto labels = measure_labels(chest);
  ASSERT_EQ(labels.size(), 7u);
  // The left lung is to the left of the right one.
  double left = 0.0, right = 0.0;
  std::int64_t n_left = 0, n_right = 0;
  for (Index k = 0; k < chest.size[2]; ++k)
    for (Index j = 0; j < chest.size[1]; ++j)
      for (Index i = 0; i < chest.size[0]; ++i) {
        const double x = (chest.to_world * place_of(i, j, k)).x();
        if (chest.at(i, j, k) == 6) left += x, ++n_left;
        if (chest.at(i, j, k) == 5) right += x, ++n_right;
      }
  EXPECT_GT(left / static_cast<double>(n_left), right / static_cast<double>(n_right));
}

TEST_F(RealLabelImage, IsTheSameAfterWritingAndReadingInEveryFormat) {
  const fs::path folder = fresh_folder();
  for (const char* name : {"heart_ct_1.5mm.nii.gz", "human_brain_mri_2mm.nrrd", "lung_ct_aniso.mha",
                           "chest_ct_10mm.seg.nrrd", "abdomen_mr_3mm.nii.gz"}) {
    const LabelImage organ = read_label_image(data / name);
    for (const char* copy : {"a.seg.nrrd", "a.nii.gz", "a.mha"}) {
      SCOPED_TRACE(testing::Message() << name << " as " << copy);
      write_label_image(folder / copy, organ);
      expect_same(read_label_image(folder / copy), organ, 1e-4);
    }
  }
}

}  // namespace
}  // namespace dimple
