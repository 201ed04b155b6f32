// Valid label images of many sizes, types, encodings and placements, written by ITK and by nibabel. Voxels
// and affines are compared with those that ITK's own reader or nibabel reports.
//
// DIMPLE_SEED and DIMPLE_FILES set seed and number of images; a failure names the seed and keeps the file.

#include <gtest/gtest.h>
#include <itkImage.h>
#include <itkImageFileReader.h>
#include <itkImageFileWriter.h>
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>
#include <sys/wait.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>
#include <sstream>

#include "io/label_image.hpp"
#include "tests/end_to_end/image_bytes.hpp"
#include "tests/end_to_end/program.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Random = std::mt19937_64;

std::uint64_t number_from_environment(const char* name, std::uint64_t otherwise) {
  const char* text = std::getenv(name);
  return text && *text ? std::strtoull(text, nullptr, 10) : otherwise;
}

std::uint64_t seed() {
  return number_from_environment("DIMPLE_SEED", 15);
}

template <class T>
T one_of(Random& random, std::initializer_list<T> list) {
  return list.begin()[random() % list.size()];
}

double between(Random& random, double low, double high) {
  return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
}

void write_bytes(const fs::path& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary) << bytes;
}

// ------------------------------------------------------------------------------------------------- drawing

struct Drawn {
  std::array<Index, 3> size{};
  Vec3 spacing, origin;
  Mat3 direction;
  std::vector<std::int32_t> label;  ///< first axis fastest
};

Mat3 drawn_direction(Random& random) {
  Mat3 axes = Mat3::Identity();
  if (random() % 2) {  // a permutation
    std::array<int, 3> order{0, 1, 2};
    std::shuffle(order.begin(), order.end(), random);
    for (int c = 0; c < 3; ++c) axes.col(c) = Vec3::Unit(order[static_cast<std::size_t>(c)]);
  }
  for (int c = 0; c < 3; ++c)
    if (random() % 2) axes.col(c) *= -1.0;  // left-handed ones too
  if (random() % 2) {
    const Vec3 about(between(random, -1, 1), between(random, -1, 1), between(random, -1, 1));
    axes =
        Eigen::AngleAxisd(between(random, 0, std::numbers::pi), about.normalized()).toRotationMatrix() * axes;
  }
  return axes;
}

/// Draws bodies, plates, rods and specks of a few labels up to `largest`.
Drawn drawn(Random& random, std::int64_t largest, std::size_t bytes_per_voxel) {
  Drawn image;
  if (random() % 16 == 0) {  // fills the buffers of any reader
    image.size = {64, 64, static_cast<Index>(64 / bytes_per_voxel * (1 + random() % 2))};
    std::shuffle(image.size.begin(), image.size.end(), random);
  } else {
    for (Index& n : image.size) switch (random() % 3) {
        case 0:
          n = one_of<Index>(random, {2, 4, 8, 16, 32, 64});
          break;
        case 1:
          n = one_of<Index>(random, {2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67});
          break;
        default:
          n = 2 + static_cast<Index>(random() % 50);
      }
  }
  for (int a = 0; a < 3; ++a)
    image.spacing[a] = random() % 2
                           ? one_of(random, {1.0, 0.5, 0.4, 375.0 / 512.0, 1.3671875, 2.5, 3.0, 0.0625})
                           : between(random, 0.1, 6.0);
  for (int a = 0; a < 3; ++a) image.origin[a] = between(random, -300.0, 300.0);
  image.direction = drawn_direction(random);

  image.label.assign(static_cast<std::size_t>(image.size[0] * image.size[1] * image.size[2]), 0);
  const auto bodies = 1 + random() % 4;
  for (std::uint64_t b = 0; b < bodies; ++b) {
    const auto label = static_cast<std::int32_t>(
        random() % 3 ? 1 + random() % 5 : 1 + random() % static_cast<std::uint64_t>(largest));
    Vec3 middle, half;
    for (int a = 0; a < 3; ++a) {
      const auto n = static_cast<double>(image.size[static_cast<std::size_t>(a)]);
      middle[a] = std::floor(between(random, 0.0, n));
      half[a] = random() % 4 ? between(random, 0.5, 0.6 * n) : 0.5;  // every fourth extent is one voxel
    }
    const bool is_box = random() % 2;
    std::size_t v = 0;
    for (Index k = 0; k < image.size[2]; ++k)
      for (Index j = 0; j < image.size[1]; ++j)
        for (Index i = 0; i < image.size[0]; ++i, ++v) {
          const Vec3 x =
              (Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)) - middle)
                  .cwiseQuotient(half);
          if (is_box ? x.cwiseAbs().maxCoeff() < 1.0 : x.norm() < 1.0) image.label[v] = label;
        }
  }
  if (random() % 5 == 0)  // frayed
    for (std::int32_t& l : image.label)
      if (l != 0 && random() % 4 == 0) l = static_cast<std::int32_t>(random() % 4);
  image.label[random() % image.label.size()] = 1;  // not all background
  return image;
}

// ------------------------------------------------------------------------------------------------- writing

template <class T>
void write_as(const Drawn& drawn, itk::ImageIOBase& io, const fs::path& file, bool compressed) {
  using Image = itk::Image<T, 3>;
  const auto image = Image::New();
  typename Image::SizeType size;
  typename Image::SpacingType spacing;
  typename Image::PointType origin;
  typename Image::DirectionType direction;
  for (unsigned a = 0; a < 3; ++a) {
    size[a] = static_cast<itk::SizeValueType>(drawn.size[a]);
    spacing[a] = drawn.spacing[a];
    origin[a] = drawn.origin[a];
    for (unsigned r = 0; r < 3; ++r) direction(r, a) = drawn.direction(r, a);
  }
  image->SetRegions(typename Image::RegionType(size));
  image->SetSpacing(spacing);
  image->SetOrigin(origin);
  image->SetDirection(direction);
  image->Allocate();
  std::transform(drawn.label.begin(), drawn.label.end(), image->GetBufferPointer(),
                 [](std::int32_t label) { return static_cast<T>(label); });
  const auto writer = itk::ImageFileWriter<Image>::New();
  writer->SetImageIO(&io);
  writer->SetFileName(file.string());
  writer->SetInput(image);
  writer->SetUseCompression(compressed);
  writer->Update();
}

/// Compresses the bytes in pieces of random lengths, perhaps in several members.
std::string gzipped_in_pieces(const std::string& plain, Random& random) {
  std::string packed;
  std::vector<char> out(1 << 16);
  z_stream stream{};
  const int level = 1 + static_cast<int>(random() % 9);
  deflateInit2(&stream, level, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
  for (std::size_t begin = 0; begin < plain.size();) {
    const std::size_t count = std::min<std::size_t>(plain.size() - begin, 1 + random() % 100'000);
    const bool last = begin + count == plain.size();
    const int flush = last ? Z_FINISH : one_of(random, {Z_NO_FLUSH, Z_SYNC_FLUSH, Z_FULL_FLUSH, Z_FINISH});
    stream.next_in = reinterpret_cast<unsigned char*>(const_cast<char*>(plain.data() + begin));
    stream.avail_in = static_cast<unsigned>(count);
    do {
      stream.next_out = reinterpret_cast<unsigned char*>(out.data());
      stream.avail_out = static_cast<unsigned>(out.size());
      deflate(&stream, flush);
      packed.append(out.data(), out.size() - stream.avail_out);
    } while (stream.avail_out == 0);
    if (flush == Z_FINISH) deflateReset(&stream);
    begin += count;
  }
  deflateEnd(&stream);
  return packed;
}

/// Writes the image's voxels in an encoding that ITK's writer does not have.
void encode_again(const fs::path& nrrd, const std::string& encoding, Random& random) {
  std::string bytes = text_of(nrrd);
  const std::size_t end = bytes.find("\n\n") + 2;
  std::string header = bytes.substr(0, end), voxels = bytes.substr(end), text;
  header.replace(header.find("encoding: raw"), 13, "encoding: " + encoding);
  if (encoding == "hex")
    for (std::size_t v = 0; v < voxels.size(); ++v) {
      const auto byte = static_cast<unsigned char>(voxels[v]);
      text += "0123456789abcdef"[byte >> 4], text += "0123456789abcdef"[byte & 15];
      if (v % 35 == 34) text += '\n';
    }
  else
    text = gzipped_in_pieces(voxels, random);
  write_bytes(nrrd, header + text);
}

/// Reverses the bytes of each number; ITK's writers change the header only.
void turn_bytes(const fs::path& file, const std::string& little, const std::string& big, std::size_t voxels,
                std::size_t width) {
  std::string bytes = text_of(file);
  const std::size_t data = bytes.size() - voxels * width;
  for (std::size_t v = data; width > 1 && v < bytes.size(); v += width)
    std::reverse(bytes.begin() + static_cast<std::ptrdiff_t>(v),
                 bytes.begin() + static_cast<std::ptrdiff_t>(v + width));
  if (const auto at = bytes.find(little); at < data) bytes.replace(at, little.size(), big);
  write_bytes(file, bytes);
}

/// Draws an image, writes it and returns the file; empty if ITK does not write that type in that format.
template <class T>
fs::path write_one(Random& random, const fs::path& folder) {
  const std::int64_t largest =
      std::is_floating_point_v<T>
          ? 70'000
          : static_cast<std::int64_t>(std::min<std::uint64_t>(
                2'147'483'647, static_cast<std::uint64_t>(std::numeric_limits<T>::max())));
  const Drawn image = drawn(random, largest, sizeof(T));
  const std::string displacement = one_of<std::string>(
      random, {"raw.nrrd", "gzip.nrrd", "ascii.nrrd", "big.nrrd", "hex.nrrd", "pieces.nrrd", "raw.nhdr",
               "gzip.nhdr", "raw.mha", "big.mha", "gzip.mha", "ascii.mha", "raw.mhd", "gzip.mhd", "a.nii",
               "a.nii.gz", "pieces.nii.gz", "a.hdr", "a.img.gz"});
  const fs::path file = folder / displacement;
  const bool compressed = displacement.starts_with("gzip") || displacement.ends_with(".gz");
  if (displacement.ends_with(".nrrd") || displacement.ends_with(".nhdr")) {
    const auto io = itk::NrrdImageIO::New();
    if (displacement.starts_with("ascii")) io->SetFileTypeToASCII();
    io->SetCompressionLevel(1 + static_cast<int>(random() % 9));
    write_as<T>(image, *io, file, compressed);
    if (displacement.starts_with("hex")) encode_again(file, "hex", random);
    if (displacement.starts_with("pieces")) encode_again(file, "gzip", random);
    if (displacement.starts_with("big"))
      turn_bytes(file, "endian: little", "endian: big", image.label.size(), sizeof(T));
  } else if (displacement.ends_with(".mha") || displacement.ends_with(".mhd")) {
    const auto io = itk::MetaImageIO::New();
    if (displacement.starts_with("ascii")) io->SetFileTypeToASCII();
    write_as<T>(image, *io, file, compressed);
    if (displacement.starts_with("big"))
      turn_bytes(file, "ByteOrderMSB = False", "ByteOrderMSB = True", image.label.size(), sizeof(T));
  } else {
    const auto io = itk::NiftiImageIO::New();
    write_as<T>(image, *io, file, compressed);
    if (displacement.starts_with("pieces")) {
      const std::unique_ptr<gzFile_s, int (*)(gzFile)> in(gzopen(file.c_str(), "rb"), &gzclose);
      std::string plain(1 << 26, '\0');
      plain.resize(static_cast<std::size_t>(gzread(in.get(), plain.data(), 1u << 26)));
      write_bytes(file, gzipped_in_pieces(plain, random));
    }
  }
  return file;
}

// ------------------------------------------------------------------------------------------------- comparing

/// Content of a file as another library reads it.
struct Reported {
  std::array<Index, 3> size{};
  Eigen::Affine3d to_world = Eigen::Affine3d::Identity();  // LPS [mm]
  std::vector<double> label;                               // first axis fastest
};

Reported reported_by_itk(const fs::path& file) {
  using Image = itk::Image<double, 3>;
  const auto reader = itk::ImageFileReader<Image>::New();
  const std::string name = file.string();
  itk::ImageIOBase::Pointer io;
  if (name.ends_with(".nrrd") || name.ends_with(".nhdr"))
    io = itk::NrrdImageIO::New();
  else if (name.ends_with(".mha") || name.ends_with(".mhd"))
    io = itk::MetaImageIO::New();
  else
    io = itk::NiftiImageIO::New();
  reader->SetImageIO(io);
  reader->SetFileName(name);
  reader->Update();
  const Image* image = reader->GetOutput();
  Reported reported;
  for (unsigned a = 0; a < 3; ++a) {
    reported.size[a] = static_cast<Index>(image->GetLargestPossibleRegion().GetSize()[a]);
    for (unsigned r = 0; r < 3; ++r)
      reported.to_world.linear()(r, a) = image->GetDirection()(r, a) * image->GetSpacing()[a];
    reported.to_world.translation()[a] = image->GetOrigin()[a];
  }
  reported.label.assign(image->GetBufferPointer(),
                        image->GetBufferPointer() + reported.size[0] * reported.size[1] * reported.size[2]);
  return reported;
}

/// `slack`: largest distance of positions, relative to the diagonal. Spacings are snapped to five digits.
void expect_agree(const LabelImage& ours, const Reported& reported, double slack = 5e-5) {
  EXPECT_EQ(ours.stored_size, reported.size);
  EXPECT_GT(ours.to_world.linear().determinant(), 0.0);
  // The map from their voxels to ours is a rotation by right angles and a shift by whole numbers.
  const Eigen::Affine3d map = ours.to_world.inverse() * reported.to_world;
  const Eigen::Matrix<Index, 3, 3> turn = map.linear().array().round().cast<Index>();
  const Eigen::Matrix<Index, 3, 1> shift = map.translation().array().round().cast<Index>();
  const double diagonal = (reported.to_world.linear() * Vec3(static_cast<double>(reported.size[0]),
                                                             static_cast<double>(reported.size[1]),
                                                             static_cast<double>(reported.size[2])))
                              .norm();
  for (int corner = 0; corner < 8; ++corner) {
    Eigen::Matrix<Index, 3, 1> at;
    for (int a = 0; a < 3; ++a) at[a] = corner >> a & 1 ? reported.size[static_cast<std::size_t>(a)] - 1 : 0;
    const Vec3 here = ours.to_world * (turn * at + shift).cast<double>(),
               there = reported.to_world * at.cast<double>();
    ASSERT_LT((here - there).norm(), slack * diagonal)
        << here.transpose() << " instead of " << there.transpose();
  }
  std::size_t v = 0, wrong = 0;
  for (Index k = 0; k < reported.size[2]; ++k)
    for (Index j = 0; j < reported.size[1]; ++j)
      for (Index i = 0; i < reported.size[0]; ++i) {
        const Eigen::Matrix<Index, 3, 1> at = turn * Eigen::Matrix<Index, 3, 1>(i, j, k) + shift;
        for (int a = 0; a < 3; ++a)
          ASSERT_TRUE(at[a] >= 0 && at[a] < ours.size[static_cast<std::size_t>(a)]) << at.transpose();
        wrong += ours.at(at[0], at[1], at[2]) != reported.label[v++];
      }
  EXPECT_EQ(wrong, 0u);
}

// Types of one byte appear twice as often as the others.
fs::path (*const write_a_type[])(Random&, const fs::path&) = {
    write_one<signed char>,    write_one<unsigned char>, write_one<unsigned char>, write_one<short>,
    write_one<unsigned short>, write_one<int>,           write_one<unsigned>,      write_one<long long>,
    write_one<float>,          write_one<double>};

TEST(Differential, FilesOfItkHoldHereWhatTheyHoldThere) {
  const fs::path folder = fresh_folder();
  const std::uint64_t files = number_from_environment("DIMPLE_FILES", 500);
  std::cout << "seed " << seed() << ", " << files << " files\n";
  std::map<std::string, int> written;
  for (std::uint64_t n = 0; n < files; ++n) {
    SCOPED_TRACE(testing::Message() << "seed " << seed() << ", file " << n);
    Random random(seed() * 1'000'003 + n);
    const fs::path own = folder / std::to_string(n);
    fs::create_directory(own);
    const fs::path file = write_a_type[random() % std::size(write_a_type)](random, own);
    SCOPED_TRACE(file);
    ++written[file.filename().string()];
    if (file.filename() == "ascii.mha") {  // refused in words, as README says
      EXPECT_THROW(read_label_image(file), std::exception);
      fs::remove_all(own);
      continue;
    }
    try {
      expect_agree(read_label_image(file), reported_by_itk(file));
    } catch (const std::exception& error) {
      ADD_FAILURE() << error.what();
    }
    if (!testing::Test::HasFailure()) fs::remove_all(own);
  }
  for (const auto& [displacement, count] : written)
    std::cout << "  " << displacement << ": " << count << '\n';
}

TEST(Differential, FilesOfNibabelHoldHereWhatTheyHoldThere) {
  const fs::path folder = fresh_folder();
  const std::uint64_t files = number_from_environment("DIMPLE_FILES", 500) / 5;
  std::ostringstream command;
  command << "/usr/bin/python3 '" << DIMPLE_NIBABEL_WRITER << "' " << seed() << ' ' << files << " '"
          << folder.string() << "'";
  const int status = std::system(command.str().c_str());
  if (!WIFEXITED(status) || WEXITSTATUS(status) == 77 || WEXITSTATUS(status) == 127)
    GTEST_SKIP() << "python3 or its nibabel is not installed (Debian: python3-nibabel)";
  ASSERT_EQ(WEXITSTATUS(status), 0);
  std::ifstream list(folder / "files.txt");
  std::string line;
  std::uint64_t count = 0;
  while (std::getline(list, line)) {
    std::istringstream words(line);
    std::string name, labels;
    Reported reported;
    words >> name >> labels;
    for (Index& n : reported.size) words >> n;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 4; ++c) words >> reported.to_world.matrix()(r, c);
    double slack = 0.0;
    words >> slack;
    ASSERT_TRUE(words) << line;
    SCOPED_TRACE(testing::Message() << "seed " << seed() << ", " << name);
    const std::string bytes = text_of(folder / labels);
    std::vector<std::int32_t> label(bytes.size() / sizeof(std::int32_t));
    std::memcpy(label.data(), bytes.data(), bytes.size());
    reported.label.assign(label.begin(), label.end());
    reported.to_world = Eigen::Scaling(-1.0, -1.0, 1.0) * reported.to_world;  // RAS to LPS
    try {
      expect_agree(read_label_image(folder / name), reported, slack);
    } catch (const std::exception& error) {
      ADD_FAILURE() << error.what();
    }
    ++count;
  }
  EXPECT_EQ(count, files);
}

// ---------------------------------------------------------------------------------------- large images

/// An ellipsoid in n x n x n voxels of 0.4 mm, written slice by slice.
void write_large(const fs::path& file, Index n, std::size_t width, const std::string& header) {
  const bool is_meta = file.extension() == ".mha";
  std::ofstream out(file, std::ios::binary);
  if (file.extension() != ".gz") out << header;
  z_stream stream{};
  deflateInit2(&stream, 1, Z_DEFLATED, is_meta ? 15 : 15 + 16, 9, Z_DEFAULT_STRATEGY);
  std::vector<char> packed(1 << 20);
  const auto add = [&](const std::string& bytes, int flush) {
    stream.next_in = reinterpret_cast<unsigned char*>(const_cast<char*>(bytes.data()));
    stream.avail_in = static_cast<unsigned>(bytes.size());
    do {
      stream.next_out = reinterpret_cast<unsigned char*>(packed.data());
      stream.avail_out = static_cast<unsigned>(packed.size());
      deflate(&stream, flush);
      out.write(packed.data(), static_cast<std::streamsize>(packed.size() - stream.avail_out));
    } while (stream.avail_out == 0);
  };
  if (file.extension() == ".gz") add(header, Z_NO_FLUSH);
  const double middle = 0.5 * static_cast<double>(n - 1), half = 0.45 * static_cast<double>(n);
  std::string slice;
  for (Index k = 0; k < n; ++k) {
    slice.assign(static_cast<std::size_t>(n * n) * width, '\0');
    for (Index j = 0; j < n; ++j) {
      const double z = (static_cast<double>(k) - middle) / half, y = (static_cast<double>(j) - middle) / half;
      const double remaining = 1.0 - z * z - y * y;
      if (remaining <= 0.0) continue;
      const double x = half * std::sqrt(remaining);
      for (auto i = static_cast<Index>(std::ceil(middle - x)); static_cast<double>(i) <= middle + x; ++i)
        slice[static_cast<std::size_t>(i + n * j) * width] = 1;
    }
    add(slice, k + 1 == n ? Z_FINISH : Z_NO_FLUSH);
  }
  deflateEnd(&stream);
}

std::string nifti_header(int n) {  // of bytes
  const Eigen::Affine3d place(Eigen::Scaling(0.4));
  return Nifti()
      .dims({n, n, n})
      .pixdim(1, 0.4)
      .pixdim(2, 0.4)
      .pixdim(3, 0.4)
      .sform(1, place)
      .qform(0)
      .data("")
      .file();
}

std::string three_times(int n) {
  const std::string one = std::to_string(n);
  return one + ' ' + one + ' ' + one;
}

std::string nrrd_header(int n) {
  return Nrrd()
      .set("type", "uint16")
      .set("endian", "little")
      .set("sizes", three_times(n))
      .set("space directions", "(0,0.4,0) (0,0,0.4) (0.4,0,0)")
      .set("encoding", "gzip")
      .header();
}

std::string meta_header(int n) {
  return MetaImage()
      .set("CompressedData", "True")
      .set("TransformMatrix", "-1 0 0 0 1 0 0 0 1")
      .set("ElementSpacing", "0.4 0.4 0.4")
      .set("DimSize", three_times(n))
      .set("ElementType", "MET_USHORT")
      .header();
}

TEST(Differential, LargeImagesTakeNoMoreMemoryThanTheyHoldAndHalfAGigabyte) {
  const fs::path folder = fresh_folder();
  write_large(folder / "256.nrrd", 256, 2, nrrd_header(256));  // 2^25 bytes
  write_large(folder / "256.mha", 256, 2, meta_header(256));
  write_large(folder / "512.nii.gz", 512, 1, nifti_header(512));
  write_large(folder / "512.nrrd", 512, 2, nrrd_header(512));
  for (const auto& [name, n, width] : {std::tuple{"256.nrrd", 256.0, 2},
                                       {"256.mha", 256.0, 2},
                                       {"512.nii.gz", 512.0, 1},
                                       {"512.nrrd", 512.0, 2}}) {
    SCOPED_TRACE(name);
    const Ran ran = good(folder, std::string("info ") + name + " --json");
    const auto labels = nlohmann::json::parse(ran.out).at("labels");
    const double volume = 4.0 / 3.0 * std::numbers::pi * std::pow(0.45 * n * 0.4, 3);
    EXPECT_NEAR(labels.at(0).at("volume_mm3").get<double>(), volume, 1e-3 * volume);
    EXPECT_EQ(labels.at(0).at("pieces"), 1);
    const double honest_MB = n * n * n * width / 1e6;
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    EXPECT_LT(ran.peak_MB, honest_MB + 500.0);
#endif
    std::cout << name << ": " << honest_MB << " MB of voxels, peak " << ran.peak_MB << " MB\n";
  }
  fs::remove_all(folder);
}

}  // namespace
}  // namespace dimple
