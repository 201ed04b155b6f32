// NRRD and MetaImage through ITK's ImageIO classes. Not through ImageFileReader: that wants the voxel type
// before it has seen the file, and wraps what does not fit.

#include <fmt/format.h>
#include <itkMetaDataObject.h>
#include <itkMetaImageIO.h>
#include <itkNrrdImageIO.h>
#include <zlib.h>

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <sstream>

#include "io/label_formats.hpp"
#include "io/label_names.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

InputError unreadable(const fs::path& file, const std::string& format, std::string why) {
  return InputError({.fact = fmt::format("'{}' cannot be read as {}", file.filename().string(), format),
                     .where = image_place(file),
                     .why = std::move(why),
                     .remedy = "check that the file is complete and of the format that its suffix names; "
                               "export the segmentation anew"});
}

/// What an ITK exception has to say, without file and line of ITK's own sources.
std::string words_of(const itk::ExceptionObject& error) {
  std::string text = error.GetDescription();
  if (const auto prefix = text.find("): "); prefix != std::string::npos) text.erase(0, prefix + 3);
  std::replace(text.begin(), text.end(), '\n', ' ');
  while (!text.empty() && text.back() == ' ') text.pop_back();
  return text;
}

Number number_type(const itk::ImageIOBase& io, const fs::path& file) {
  using itk::IOComponentEnum;
  switch (io.GetComponentType()) {
    case IOComponentEnum::CHAR:
      return Number::int8;
    case IOComponentEnum::UCHAR:
      return Number::uint8;
    case IOComponentEnum::SHORT:
      return Number::int16;
    case IOComponentEnum::USHORT:
      return Number::uint16;
    case IOComponentEnum::INT:
      return Number::int32;
    case IOComponentEnum::UINT:
      return Number::uint32;
    case IOComponentEnum::LONG:
    case IOComponentEnum::LONGLONG:
      return Number::int64;
    case IOComponentEnum::ULONG:
    case IOComponentEnum::ULONGLONG:
      return Number::uint64;
    case IOComponentEnum::FLOAT:
      return Number::real32;
    case IOComponentEnum::DOUBLE:
      return Number::real64;
    default:
      throw unreadable(file, "a label image", "the type of its voxels is unknown");
  }
}

/// Header and checks; the voxels are read afterwards, by read_voxels.
StoredImage read_information(itk::ImageIOBase& io, const fs::path& file, std::string format) {
  StoredImage image;
  image.format = std::move(format);
  try {
    io.SetFileName(file.string());
    io.ReadImageInformation();
  } catch (const itk::ExceptionObject& error) {
    throw unreadable(file, image.format, words_of(error));
  }
  std::vector<Index> size;
  for (unsigned a = 0; a < io.GetNumberOfDimensions(); ++a) {
    // Before any cast: a size that does not fit would come out negative.
    if (io.GetDimensions(a) > static_cast<itk::SizeValueType>(std::numeric_limits<Index>::max()))
      throw unreadable(file, image.format,
                       fmt::format("axis {} is said to hold {} voxels", a + 1, io.GetDimensions(a)));
    size.push_back(static_cast<Index>(io.GetDimensions(a)));
  }
  image.size = checked_size(size, io.GetNumberOfComponents(), file);
  image.type = number_type(io, file);
  for (unsigned a = 0; a < 3; ++a) {
    const std::vector<double> direction = io.GetDirection(a);
    for (unsigned r = 0; r < 3; ++r) image.to_world.linear()(r, a) = direction[r] * io.GetSpacing(a);
    image.to_world.translation()[a] = io.GetOrigin(a);
  }
  return image;
}

void read_voxels(itk::ImageIOBase& io, StoredImage& image, const fs::path& file) {
  image.data.resize(image.data_bytes());
  itk::ImageIORegion everything(io.GetNumberOfDimensions());
  for (unsigned a = 0; a < io.GetNumberOfDimensions(); ++a) everything.SetSize(a, io.GetDimensions(a));
  io.SetIORegion(everything);
  if (static_cast<std::size_t>(io.GetImageSizeInBytes()) !=
      image.data.size())  // ITK fills what it thinks right
    throw unreadable(file, image.format, "header and voxel type disagree about the size of the data");
  try {
    io.Read(image.data.data());
  } catch (const itk::ExceptionObject& error) {
    throw truncated(file, words_of(error));
  }
}

KeyValues metadata(const itk::ImageIOBase& io) {
  KeyValues keys;
  for (const std::string& key : io.GetMetaDataDictionary().GetKeys())
    if (std::string value; itk::ExposeMetaData(io.GetMetaDataDictionary(), key, value)) keys[key] = value;
  return keys;
}

/// The value of a header line `key<separator>value`; empty if there is none. Both formats start with lines of
/// text; ITK keeps neither the unit of an NRRD nor where the data of a MetaImage begin.
struct TextHeader {
  KeyValues value;
  std::size_t bytes = 0;  ///< length of the header
};

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t\r") - first + 1);
}

/// Ends at an empty line (NRRD) or after the line with `last_key` (MetaImage).
TextHeader read_text_header(const fs::path& file, char separator, std::string_view last_key) {
  TextHeader header;
  std::ifstream in(file, std::ios::binary);
  std::string line;
  while (header.bytes < (1u << 24) && std::getline(in, line)) {
    header.bytes += line.size() + 1;
    const std::string_view text = trimmed(line);
    if (text.empty()) break;
    const auto middle = text.find(separator);
    if (middle == std::string_view::npos) continue;
    const std::string key(trimmed(text.substr(0, middle)));
    header.value[key] = trimmed(text.substr(middle + 1));
    if (key == last_key) break;
  }
  return header;
}

/// ITK's MetaImage reader prints to stderr and reports success when data are missing or damaged, so the data
/// are checked here first: the file is long enough and, if compressed, inflates to the right number of bytes.
void check_metaimage_data(const StoredImage& image, const fs::path& file) {
  TextHeader header = read_text_header(file, '=', "ElementDataFile");
  const std::string& name = header.value["ElementDataFile"];
  if (name.starts_with("LIST") || name.find('%') != std::string::npos)
    throw unreadable(file, image.format, "its voxels are spread over several files, which is not supported");
  const bool local = name == "LOCAL" || name == "Local" || name == "local";
  const fs::path data_file = local ? file : file.parent_path() / name;
  std::error_code failed;
  const std::uintmax_t length = fs::file_size(data_file, failed);
  if (failed)
    throw unreadable(file, image.format,
                     fmt::format("its voxels should be in '{}': {}", data_file.string(), failed.message()));

  const std::size_t needed = image.data_bytes();
  std::size_t begin = local ? header.bytes : 0;
  if (const auto skip = header.value.find("HeaderSize"); skip != header.value.end())
    begin =
        std::strtol(skip->second.c_str(), nullptr, 10) > 0
            ? std::strtoul(skip->second.c_str(), nullptr, 10)
            : static_cast<std::size_t>(length - std::min<std::uintmax_t>(length, needed));  // -1: at the end

  const std::string& compressed = header.value["CompressedData"];
  if (compressed.empty() ||
      (compressed.front() != 'T' && compressed.front() != 't' && compressed.front() != '1')) {
    if (length < begin + needed)
      throw truncated(data_file, fmt::format("the file holds {} of {} bytes of voxels",
                                             length - std::min<std::uintmax_t>(length, begin), needed));
    return;
  }
  std::ifstream in(data_file, std::ios::binary);
  in.seekg(static_cast<std::streamoff>(begin));
  z_stream stream{};
  inflateInit2(&stream, 15 + 32);  // zlib or gzip, whichever it is
  std::vector<unsigned char> packed(1 << 16), plain(1 << 18);
  int state = Z_OK;
  while (state == Z_OK) {
    in.read(reinterpret_cast<char*>(packed.data()), static_cast<std::streamsize>(packed.size()));
    if (in.gcount() == 0) break;
    stream.next_in = packed.data();
    stream.avail_in = static_cast<unsigned>(in.gcount());
    do {
      stream.next_out = plain.data();
      stream.avail_out = static_cast<unsigned>(plain.size());
      state = inflate(&stream, Z_NO_FLUSH);
    } while (state == Z_OK && stream.avail_out == 0);
    if (state == Z_BUF_ERROR) state = Z_OK;  // the input was used up exactly when the output was full
  }
  const std::size_t got = stream.total_out;
  inflateEnd(&stream);
  if (state == Z_DATA_ERROR || state == Z_NEED_DICT)
    throw truncated(data_file, fmt::format("the compressed data are damaged after {} of {} bytes of voxels",
                                           got, needed));
  if (state != Z_STREAM_END || got < needed)
    throw truncated(data_file, fmt::format("the compressed data hold {} of {} bytes of voxels", got, needed));
}

template <class ImageIO>
void write_with(ImageIO& io, const fs::path& file, const StoredImage& image) {
  using itk::IOComponentEnum;
  io.SetFileName(file.string());
  io.SetNumberOfDimensions(3);
  itk::ImageIORegion everything(3);
  for (unsigned a = 0; a < 3; ++a) {
    const auto length = static_cast<itk::SizeValueType>(image.size[a]);
    const Vec3 column = image.to_world.linear().col(a);
    const Vec3 direction = column.normalized();
    io.SetDimensions(a, length);
    io.SetSpacing(a, column.norm());
    io.SetOrigin(a, image.to_world.translation()[a]);
    io.SetDirection(a, std::vector<double>(direction.data(), direction.data() + 3));
    everything.SetSize(a, length);
  }
  io.SetIORegion(everything);
  io.SetNumberOfComponents(1);
  io.SetPixelType(itk::IOPixelEnum::SCALAR);
  io.SetComponentType(image.type == Number::uint8    ? IOComponentEnum::UCHAR
                      : image.type == Number::uint16 ? IOComponentEnum::USHORT
                                                     : IOComponentEnum::INT);
  io.UseCompressionOn();
  try {
    io.Write(image.data.data());
  } catch (const itk::ExceptionObject& error) {
    throw std::runtime_error(words_of(error));
  }
}

}  // namespace

StoredImage read_nrrd(const fs::path& file) {
  const auto io = itk::NrrdImageIO::New();
  StoredImage image = read_information(*io, file, "NRRD");
  const KeyValues keys = metadata(*io);
  const bool from_slicer = std::any_of(keys.begin(), keys.end(), [](const auto& key) {
    return key.first.starts_with("Segment") && key.first.find("_ID") != std::string::npos;
  });
  if (from_slicer) image.format = "3D Slicer segmentation (NRRD)";
  image.names = names_from_segment_keys(keys);

  const TextHeader header = read_text_header(file, ':', "");
  const auto space = keys.find("NRRD_space");
  if (!header.value.contains("space directions"))
    image.warnings.push_back(
        "The file does not say how the image lies in the patient (no space directions); its axes are taken "
        "to run along left, posterior and superior.");
  else if (space == keys.end() ||
           space->second != "left-posterior-superior")  // ITK has turned RAS and LAS to LPS
    image.warnings.push_back(
        fmt::format("The file does not name patient directions (space: {}); its coordinates are taken as "
                    "left, posterior, "
                    "superior.",
                    space == keys.end() ? "none" : space->second));
  if (const auto units = header.value.find("space units"); units != header.value.end()) {
    std::istringstream words(units->second);
    std::string unit;
    words >> unit;
    std::erase(unit, '"');
    if (const std::optional<double> factor = millimetres_in(unit)) {
      if (*factor != 1.0) scale_to_millimetres(image, *factor, unit);
    } else {
      image.warnings.push_back(
          fmt::format("The file's unit of length '{}' is unknown; millimetres are assumed.", unit));
    }
  }
  if (!header.value.contains("data file") && !header.value.contains("datafile")) check_length(image, file);
  read_voxels(*io, image, file);
  return image;
}

StoredImage read_metaimage(const fs::path& file) {
  const auto io = itk::MetaImageIO::New();
  StoredImage image = read_information(*io, file, "MetaImage");
  check_metaimage_data(image, file);
  read_voxels(*io, image, file);
  return image;
}

void write_nrrd(const fs::path& file, const StoredImage& image, const KeyValues& keys) {
  const auto io = itk::NrrdImageIO::New();
  for (const auto& [key, value] : keys)
    itk::EncapsulateMetaData<std::string>(io->GetMetaDataDictionary(), key, value);
  write_with(*io, file, image);
}

void write_metaimage(const fs::path& file, const StoredImage& image) {
  const auto io = itk::MetaImageIO::New();
  write_with(*io, file, image);
}

}  // namespace dimple
