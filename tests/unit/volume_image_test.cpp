#include "io/volume_image.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <numeric>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/label_image.hpp"
#include "io/stop.hpp"
#include "tests/helpers/folder.hpp"
#include "tests/helpers/image.hpp"
#include "tests/helpers/report.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

VoxelGrid oblique_grid() {
  VoxelGrid grid;
  grid.size = {7, 5, 4};
  grid.to_world = Eigen::Translation3d(-12.5, 30.25, 7.0) *
                  Eigen::AngleAxisd(0.3, Vec3(1, 2, 2).normalized()) * Eigen::Scaling(-1.5, 2.0, 2.5);
  return grid;
}

std::vector<float> ramp(const VoxelGrid& grid) {
  std::vector<float> value(static_cast<std::size_t>(grid.voxels()));
  std::iota(value.begin(), value.end(), -3.5f);
  return value;
}

TEST(VolumeImage, ComesBackAsItWasWrittenInEveryFormat) {
  const fs::path folder = fresh_folder();
  const VoxelGrid grid = oblique_grid();
  const std::vector<float> value = ramp(grid);
  for (const std::string suffix : {".nrrd", ".nii", ".nii.gz", ".mha"}) {
    SCOPED_TRACE(suffix);
    const fs::path file = folder / ("ramp" + suffix);
    VolumeWriter out(file, grid, {});
    out.write(std::span(value).first(20));  // in any portions
    out.write(std::span(value).subspan(20));
    EXPECT_FALSE(fs::exists(file));
    out.finish();
    const VolumeImage image(file);
    ASSERT_EQ(image.grid().size, grid.size);
    // NIfTI holds its geometry in single precision.
    EXPECT_LT((image.grid().to_world.matrix() - grid.to_world.matrix()).cwiseAbs().maxCoeff(),
              suffix.starts_with(".nii") ? 2e-6 : 1e-12);
    ASSERT_EQ(image.bytes_per_voxel(), sizeof(float));
    EXPECT_EQ(std::memcmp(image.voxel(0), value.data(), 4 * value.size()), 0);
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 4);
}

TEST(VolumeImage, KeepsTypeScaleAndSegmentsOfTheImageItIsLike) {
  const fs::path folder = fresh_folder();
  LabelImage labels = image_of({6, 5, 4}, {1, 1, 2},
                               [](Index i, Index j, Index k) { return i > 1 && j > 1 && k > 0 ? 700 : 0; });
  labels.names[700] = "Liver";
  for (const std::string suffix : {".seg.nrrd", ".nrrd", ".nii.gz", ".nii", ".mha"}) {
    SCOPED_TRACE(suffix);
    const fs::path file = folder / ("labels" + suffix), copy = folder / ("copy" + suffix);
    write_label_image(file, labels);
    const VolumeImage image(file);
    VolumeWriter out(copy, image.grid(), {.like = &image});
    out.write({image.voxel(0), image.bytes_per_voxel() * static_cast<std::size_t>(image.grid().voxels())});
    out.finish();
    const LabelImage again = read_label_image(copy);
    EXPECT_EQ(again.run, labels.run);
    EXPECT_EQ(again.to_world.matrix(), labels.to_world.matrix());
    EXPECT_EQ(again.format, read_label_image(file).format);
    if (suffix.ends_with("nrrd")) {
      EXPECT_EQ(again.names, labels.names);
    }
    EXPECT_EQ(VolumeImage(copy).bytes_per_voxel(), 2u);
    EXPECT_EQ(image.label_of(image.voxel(119)), 700);
  }
}

TEST(VolumeImage, IsSampledBetweenItsVoxelsInItsOwnType) {
  const fs::path folder = fresh_folder();
  const VoxelGrid grid = oblique_grid();
  const std::vector<float> value = ramp(grid);
  VolumeWriter out(folder / "ramp.nrrd", grid, {});
  out.write(value);
  out.finish();
  const VolumeImage image(folder / "ramp.nrrd");
  const std::vector<float> places = {2.5f,  1.0f, 1.0f, 2.0f, 1.25f, 1.5f,
                                     -3.0f, 0.0f, 0.0f, 6.4f, 4.0f,  3.0f};
  std::vector<float> found(4);
  image.sample(places, Sampling::linear, reinterpret_cast<std::byte*>(found.data()));
  EXPECT_EQ(found,
            (std::vector<float>{-3.5f + 2.5f + 7 + 35, -3.5f + 2 + 8.75f + 52.5f, -3.5f, value.back()}));
  image.sample(places, Sampling::nearest, reinterpret_cast<std::byte*>(found.data()));
  EXPECT_EQ(found, (std::vector<float>{-3.5f + 3 + 7 + 35, -3.5f + 2 + 7 + 70, 0.0f, value.back()}));

  const LabelImage whole =
      image_of({4, 4, 4}, {1, 1, 1}, [](Index i, Index, Index) { return i < 2 ? 10 : 13; });
  write_label_image(folder / "whole.nii.gz", whole);
  const VolumeImage numbers(folder / "whole.nii.gz");
  const std::vector<float> between = {1.4f, 1.0f, 1.0f, 1.6f, 1.0f, 1.0f};
  std::vector<std::uint8_t> rounded(2);
  numbers.sample(between, Sampling::linear, reinterpret_cast<std::byte*>(rounded.data()));
  EXPECT_EQ(rounded, (std::vector<std::uint8_t>{11, 12}));
}

TEST(VolumeImage, ThatIsGivenUpLeavesNothingBehind) {
  const fs::path folder = fresh_folder();
  const VoxelGrid grid = oblique_grid();
  {
    VolumeWriter out(folder / "half.nrrd", grid, {});
    const std::vector<float> value = ramp(grid);
    out.write(std::span(value).first(30));
    EXPECT_THROW(out.finish(), std::logic_error);
  }
  EXPECT_TRUE(fs::is_empty(folder));
  EXPECT_THROW(VolumeWriter(folder / "nowhere" / "a.nrrd", grid, {}), OutputError);
  ask_to_stop(StopReason::interrupted);
  {
    VolumeWriter out(folder / "stopped.nii.gz", grid, {.components = 3, .meaning = "modeling"});
    const std::vector<float> value(static_cast<std::size_t>(3 * grid.voxels()), 1.0f);
    EXPECT_THROW(out.write(value), Stopped);
  }
  forget_stop();
  EXPECT_TRUE(fs::is_empty(folder));
}

TEST(VolumeImage, ThatCannotBeReadIsRefusedInTheWordsOfAnImage) {
  const fs::path folder = fresh_folder();
  write_file(folder / "text.nii.gz", "no image");
  write_file(folder / "short.nrrd",
             "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 9 9 9\nspacings: 1 1 1\nencoding: raw\n\nshort");
  write_file(folder / "flat.nrrd", "NRRD0004\ntype: uint8\ndimension: 2\nsizes: 2 2\nencoding: raw\n\nabcd");
  for (const auto& [name, word] :
       {std::pair{"text.nii.gz", "ends after"}, {"short.nrrd", "bytes"}, {"flat.nrrd", "flat"}}) {
    SCOPED_TRACE(name);
    const fs::path file = folder / name;
    expect_error<InputError>(
        [&] { const VolumeImage image(file); },
        {.fact = word, .where = "image " + file.string(), .remedy = ".nii.gz", .code = "bad-image"});
  }
}

}  // namespace
}  // namespace dimple
