// NRRD and MetaImage: headers by ITK's ImageIO classes, voxels by our own code. ImageFileReader needs the
// voxel type in advance, and wraps values that do not fit. The ImageIO classes of ITK 5.2 crash on short text
// and allocate memory for missing voxels. They report success when voxels are missing.

#include <fmt/format.h>
#include <itkMetaDataObject.h>
#include <itkMetaImageIO.h>
#include <itkNrrdImageIO.h>
#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <limits>
#include <memory>
#include <mutex>
#include <sstream>

#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/text.hpp"
#include "io/text_header.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

/// Message of an ITK exception about a header: the innermost reason of NrrdIO, without the functions and
/// source files of the library. If nothing else is left: that the library failed.
std::string words_of(const std::exception& error) {
  const auto* of_itk = dynamic_cast<const itk::ExceptionObject*>(&error);
  std::string text = of_itk ? of_itk->GetDescription() : "";
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back())) != 0) text.pop_back();
  if (const auto last = text.rfind("[nrrd] "); last != std::string::npos) {
    text.erase(0, last);
    const auto function = text.find(": ");
    text.erase(0, function == std::string::npos ? text.size() : function + 2);
  } else if (const auto prefix = text.find("): "); prefix != std::string::npos) {
    text.erase(0, prefix + 3);
  }
  std::replace(text.begin(), text.end(), '\n', ' ');
  for (const char* trace : {"itk::", "ITK ", "ITK_", "/usr/", ".cxx", ".hxx", ".h:", "0x", "[nrrd]", "biff"})
    if (text.find(trace) != std::string::npos) text.clear();
  return text.empty() ? "its header is damaged or contradicts itself: the library that reads it failed"
                      : text;
}

Number number_type(const itk::ImageIOBase& io, const fs::path& file) {
  using itk::IOComponentEnum;
  static const std::map<IOComponentEnum, Number> types = {
      {IOComponentEnum::CHAR, Number::int8},      {IOComponentEnum::UCHAR, Number::uint8},
      {IOComponentEnum::SHORT, Number::int16},    {IOComponentEnum::USHORT, Number::uint16},
      {IOComponentEnum::INT, Number::int32},      {IOComponentEnum::UINT, Number::uint32},
      {IOComponentEnum::LONG, Number::int64},     {IOComponentEnum::ULONG, Number::uint64},
      {IOComponentEnum::LONGLONG, Number::int64}, {IOComponentEnum::ULONGLONG, Number::uint64},
      {IOComponentEnum::FLOAT, Number::real32},   {IOComponentEnum::DOUBLE, Number::real64}};
  const auto found = types.find(io.GetComponentType());
  if (found == types.end()) throw unreadable(file, "a label image", "the type of its voxels is unknown");
  return found->second;
}

/// Captures the library's output: its reader reports errors in no other form.
class Silence {
 public:
  Silence() : out_(std::cout.rdbuf(said_.rdbuf())), err_(std::cerr.rdbuf(said_.rdbuf())) {}
  ~Silence() {
    std::cout.rdbuf(out_);
    std::cerr.rdbuf(err_);
  }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  // The streams belong to the process: other readers wait.
  inline static std::recursive_mutex one_;
  std::lock_guard<std::recursive_mutex> alone_{one_};
  std::ostringstream said_;
  std::streambuf *out_, *err_;
};

KeyValues metadata(const itk::ImageIOBase& io) {
  KeyValues keys;
  for (const std::string& key : io.GetMetaDataDictionary().GetKeys())
    if (std::string value; itk::ExposeMetaData(io.GetMetaDataDictionary(), key, value)) keys[key] = value;
  return keys;
}

/// Reads header and checks; the voxels are read afterwards.
StoredImage read_information(itk::ImageIOBase& io, const fs::path& file, std::string format) {
  StoredImage image;
  image.format = std::move(format);
  try {
    const Silence silence;
    io.SetFileName(file.string());
    io.ReadImageInformation();
  } catch (const std::exception& error) {  // from ITK, or from the library on a damaged header
    throw unreadable(file, image.format, words_of(error));
  }
  std::vector<Index> size;
  for (unsigned a = 0; a < io.GetNumberOfDimensions(); ++a) {
    // Before any cast: a size that does not fit would become negative.
    if (io.GetDimensions(a) > static_cast<itk::SizeValueType>(std::numeric_limits<Index>::max()))
      throw unreadable(file, image.format,
                       fmt::format("axis {} is said to hold {} voxels", a + 1, io.GetDimensions(a)));
    size.push_back(static_cast<Index>(io.GetDimensions(a)));
  }
  image.size = checked_size(size, io.GetNumberOfComponents(), file, layers_from_segment_keys(metadata(io)));
  image.type = number_type(io, file);
  for (unsigned a = 0; a < 3; ++a) {
    const std::vector<double> direction = io.GetDirection(a);
    for (unsigned r = 0; r < 3; ++r) image.to_world.linear()(r, a) = direction[r] * io.GetSpacing(a);
    image.to_world.translation()[a] = io.GetOrigin(a);
  }
  return image;
}

/// File of the voxels: the header's own, or another that it names relative to itself.
fs::path second_file(const fs::path& header_file, const std::string& name, const std::string& format) {
  if (name.empty()) throw unreadable(header_file, format, "it does not name the file of its voxels");
  const fs::path data = header_file.parent_path() / name;
  try {
    require_regular_file(data);
  } catch (const InputError& error) {
    throw unreadable(header_file, format, "its voxels should be in another file: " + error.report.fact);
  }
  return data;
}

InputError spread_over_files(const fs::path& file, const std::string& format) {
  return unreadable(file, format, "its voxels are spread over several files, which is not supported");
}

void read_plain(StoredImage& image, const fs::path& file, std::uintmax_t begin) {
  const std::uintmax_t length = length_of(file), held = length - std::min(length, begin);
  const std::size_t needed = image.data_bytes();
  if (held < needed)
    throw truncated(file, fmt::format("the file holds {} of {} bytes of voxels", held, needed));
  image.data.resize(needed);
  std::ifstream in(file, std::ios::binary);
  in.seekg(static_cast<std::streamoff>(begin));
  for (std::size_t got = 0; got < needed;) {
    stop_if_requested();
    const std::size_t part = std::min<std::size_t>(needed - got, 1 << 24);
    in.read(reinterpret_cast<char*>(image.data.data() + got), static_cast<std::streamsize>(part));
    got += static_cast<std::size_t>(in.gcount());
    if (!in) throw truncated(file, fmt::format("the file holds {} of {} bytes of voxels", got, needed));
  }
  warn_of_surplus(image, held - needed);
}

/// Reads zlib or gzip, possibly of several members. Every turn consumes bytes of the file, yields bytes, or
/// is the last one.
void read_deflated(StoredImage& image, const fs::path& file, std::uintmax_t begin) {
  const std::size_t needed = image.data_bytes();
  std::size_t got = 0;
  std::ifstream in(file, std::ios::binary);
  in.seekg(static_cast<std::streamoff>(begin));
  image.data.reserve(needed);  // address space only: memory is used as the bytes come
  z_stream stream{};
  inflateInit2(&stream, 15 + 32);
  const std::unique_ptr<z_stream, int (*)(z_stream*)> closed_at_the_end(&stream, &inflateEnd);
  std::vector<unsigned char> packed(1 << 16), plain(1 << 18);
  int state = Z_OK;
  while (got < needed + surplus_limit) {
    stop_if_requested();
    if (stream.avail_in == 0) {  // the stream may still hold output without further input
      in.read(reinterpret_cast<char*>(packed.data()), static_cast<std::streamsize>(packed.size()));
      stream.next_in = packed.data();
      stream.avail_in = static_cast<unsigned>(in.gcount());
    }
    if (state == Z_STREAM_END) {
      if (stream.avail_in == 0 || *stream.next_in != 0x1f) break;  // the end, or garbage: no further member
      inflateReset(&stream);
    }
    const unsigned before = stream.avail_in;
    stream.next_out = plain.data();
    stream.avail_out = static_cast<unsigned>(plain.size());
    state = inflate(&stream, Z_NO_FLUSH);
    const std::size_t came = plain.size() - stream.avail_out,
                      requested = std::min(came, needed - std::min(got, needed));
    const auto* bytes = reinterpret_cast<const std::byte*>(plain.data());
    image.data.insert(image.data.end(), bytes, bytes + requested);
    got += came;
    if (state != Z_OK && state != Z_STREAM_END) break;  // damaged, or nothing left to read or write
    if (came == 0 && stream.avail_in == before) break;
  }
  if (state == Z_DATA_ERROR || state == Z_NEED_DICT)
    throw truncated(
        file, fmt::format("the compressed data are damaged after {} of {} bytes of voxels", got, needed));
  if (got < needed || (state != Z_STREAM_END && got < needed + surplus_limit))
    throw truncated(file, fmt::format("the compressed data hold {} of {} bytes of voxels", got, needed));
  warn_of_surplus(image, got - needed);
}

/// Voxels as decimal numbers between blanks.
void read_ascii(StoredImage& image, const fs::path& file, std::uintmax_t begin) {
  const std::size_t count = image.data_bytes() / bytes_of(image.type);
  const std::uintmax_t length = length_of(file), held = length - std::min(length, begin);
  if (held + 1 < 2 * count)  // a digit each, and a blank between
    throw truncated(file, fmt::format("{} letters cannot hold {} numbers", held, count));
  image.type = Number::real64;  // the written type, whatever the declared one is
  image.data.resize(count * sizeof(double));
  std::ifstream in(file, std::ios::binary);
  in.seekg(static_cast<std::streamoff>(begin));
  std::string word;
  constexpr int longest = 64;  // letters; longer ones would be read as two numbers
  for (std::size_t v = 0; v < count; ++v) {
    if (v % 65536 == 0) stop_if_requested();
    if (!(in >> std::setw(longest) >> word))
      throw truncated(file, fmt::format("the file holds {} of {} voxels", v, count));
    const auto value = number_in<double>(word);
    if (!value || word.size() >= longest)
      throw truncated(file, fmt::format("voxel {} is '{}', which is no number", v, word));
    std::memcpy(image.data.data() + v * sizeof(double), &*value, sizeof(double));
  }
}

std::optional<int> number_of_hex(char c) {
  constexpr std::string_view digits = "0123456789abcdef";
  const auto digit = digits.find(static_cast<char>(std::tolower(static_cast<unsigned char>(c))));
  if (digit == std::string_view::npos) return std::nullopt;
  return static_cast<int>(digit);
}

/// Voxels as two hexadecimal digits a byte.
void read_hex(StoredImage& image, const fs::path& file, std::uintmax_t begin) {
  const std::size_t needed = image.data_bytes();
  const std::uintmax_t length = length_of(file), held = length - std::min(length, begin);
  std::size_t digits = 0;
  if (held >= 2 * needed) {
    image.data.resize(needed);
    std::ifstream in(file, std::ios::binary);
    in.seekg(static_cast<std::streamoff>(begin));
    for (char c = 0; digits < 2 * needed && in >> c; ++digits) {
      if (digits % 65536 == 0) stop_if_requested();
      const auto digit = number_of_hex(c);
      if (!digit) throw truncated(file, fmt::format("'{}' is no hexadecimal digit", c));
      image.data[digits / 2] |= static_cast<std::byte>(digits % 2 == 0 ? *digit << 4 : *digit);
    }
  }
  if (digits < 2 * needed)
    throw truncated(file, fmt::format("the file holds {} of {} bytes of voxels",
                                      std::min<std::uintmax_t>(held / 2, needed - 1), needed));
}

void read_nrrd_voxels(StoredImage& image, const TextHeader& header, const fs::path& file, bool detached) {
  const std::string encoding = lower(header.at("encoding"));
  const auto skip = [&](const char* key, const char* other) {
    const std::string text = header.has(key) ? header.at(key) : header.has(other) ? header.at(other) : "0";
    const auto value = number_in<std::int64_t>(text);
    if (!value || *value < -1) throw unreadable(file, image.format, fmt::format("{} is {}", key, text));
    return *value;
  };
  const std::int64_t lines = skip("line skip", "lineskip"), bytes = skip("byte skip", "byteskip");
  if (!detached && !header.complete) throw truncated(file, "the header does not end");

  std::uintmax_t begin = detached ? 0 : header.bytes;
  if (lines > 0) {
    std::ifstream in(file, std::ios::binary);
    in.seekg(static_cast<std::streamoff>(begin));
    for (std::int64_t line = 0; line < lines; ++line) {
      if (line % 65536 == 0) stop_if_requested();
      if (!in.ignore(std::numeric_limits<std::streamsize>::max(), '\n') || in.eof())
        throw truncated(file, fmt::format("the file has {} of {} lines to skip", line, lines));
    }
    begin = static_cast<std::uintmax_t>(in.tellg());
  }
  if (bytes != 0 && encoding != "raw")
    throw unreadable(file, image.format, fmt::format("byte skip is {} for voxels that are not raw", bytes));
  if (bytes < 0)  // at the end of the file
    begin = length_of(file) - std::min<std::uintmax_t>(length_of(file), image.data_bytes());
  else
    begin += static_cast<std::uintmax_t>(bytes);

  check_length(image, file);
  const std::string endian = lower(header.at("endian"));
  const bool is_text = encoding == "ascii" || encoding == "text" || encoding == "txt";
  if (!is_text && bytes_of(image.type) > 1 && endian != "little" && endian != "big")
    throw unreadable(file, image.format, "it does not state the byte order (endian)");
  if (is_text)
    read_ascii(image, file, begin);
  else if (encoding == "raw")
    read_plain(image, file, begin);
  else if (encoding == "gzip" || encoding == "gz")
    read_deflated(image, file, begin);
  else if (encoding == "hex")
    read_hex(image, file, begin);
  else
    throw unreadable(file, image.format, fmt::format("its encoding is '{}'", header.at("encoding")));
  if (!is_text && endian == "big") swap_bytes(image);
}

void scale_from_unit(StoredImage& image, const std::string& unit) {
  if (const std::optional<double> factor = millimetres_in(unit)) {
    if (*factor != 1.0) scale_to_millimetres(image, *factor, unit);
  } else {
    image.warnings.push_back(
        fmt::format("The file's unit of length '{}' is unknown; millimetres are assumed.", unit));
  }
}

void read_metaimage_voxels(StoredImage& image, const TextHeader& header, const fs::path& file,
                           bool detached) {
  std::uintmax_t begin = detached ? 0 : header.bytes;
  if (header.has("HeaderSize")) {
    const auto skip = number_in<std::int64_t>(header.at("HeaderSize"));
    if (!skip) throw unreadable(file, image.format, fmt::format("HeaderSize is {}", header.at("HeaderSize")));
    const std::uintmax_t length = length_of(file);
    if (*skip > 0) begin = static_cast<std::uintmax_t>(*skip);
    if (*skip < 0) begin = length - std::min<std::uintmax_t>(length, image.data_bytes());  // at the end
  }
  if (is_true(header.at("CompressedData"))) {
    check_length(image, file);
    read_deflated(image, file, begin);
  } else {
    read_plain(image, file, begin);
  }
  const std::string order = either(header, {"BinaryDataByteOrderMSB", "ElementByteOrderMSB"});
  if (!order.empty() && is_true(header.at(order))) swap_bytes(image);
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
  const TextHeader header = read_text_header(file, ':', "");
  if (!header.complete && header.bytes == longest_header)  // ITK would search its end in the whole file
    throw unreadable(file, "NRRD",
                     fmt::format("its header does not end within {} MiB", longest_header >> 20));
  check_nrrd_header(header, file);
  const std::string data_key = either(header, {"data file", "datafile"});
  fs::path data_file = file;
  if (!data_key.empty()) {  // before ITK, which would wait for a pipe
    if (header.at(data_key).starts_with("LIST") || header.at(data_key).find('%') != std::string::npos)
      throw spread_over_files(file, "NRRD");
    data_file = second_file(file, header.at(data_key), "NRRD");
  }

  const auto io = itk::NrrdImageIO::New();
  StoredImage image = read_information(*io, file, "NRRD");
  const KeyValues keys = metadata(*io);
  const bool from_slicer = std::any_of(keys.begin(), keys.end(), [](const auto& key) {
    return key.first.starts_with("Segment") && key.first.find("_ID") != std::string::npos;
  });
  if (from_slicer) image.format = "3D Slicer segmentation (NRRD)";
  image.names = names_from_segment_keys(keys, image.warnings);
  if (from_slicer)
    for (const auto& [key, value] : keys)
      if (key.starts_with("Segment")) image.segment_keys[key] = value;

  const auto space = keys.find("NRRD_space");
  if (!header.has("space directions"))
    image.warnings.push_back(
        "The file does not state the image's orientation in the patient (no space directions); its axes are "
        "assumed to be left, posterior and superior.");
  else if (space == keys.end() || space->second != "left-posterior-superior")  // ITK has turned RAS to LPS
    image.warnings.push_back(
        fmt::format("The file does not name patient directions (space: {}); its coordinates are assumed to "
                    "be left, posterior, superior.",
                    space == keys.end() ? "none" : space->second));
  if (header.has("space directions") && !header.has("space origin"))
    image.warnings.push_back(
        "The file does not state the place of its first voxel (no space origin); 0, 0, 0 is assumed.");
  const std::string said_space = lower(header.at("space"));
  if (said_space == "left-anterior-superior" || said_space == "las")
    image.to_world.matrix().topRows<2>() *= -1.0;  // ITK 5.2 turns LAS to RAS instead of LPS
  if (header.has("space units")) {
    std::istringstream words(header.at("space units"));
    std::string unit;
    words >> unit;
    std::erase(unit, '"');
    scale_from_unit(image, unit);
  }
  read_nrrd_voxels(image, header, data_file, !data_key.empty());
  return image;
}

StoredImage read_metaimage(const fs::path& file) {
  const TextHeader header = read_text_header(file, '=', "ElementDataFile");
  std::vector<std::string> warnings;
  check_metaimage_header(header, file, warnings);
  const std::string name = header.at("ElementDataFile");
  if (name.starts_with("LIST") || name.find('%') != std::string::npos)
    throw spread_over_files(file, "MetaImage");
  const bool detached = lower(name) != "local";
  const fs::path data_file = detached ? second_file(file, name, "MetaImage") : file;

  const auto io = itk::MetaImageIO::New();
  StoredImage image = read_information(*io, file, "MetaImage");
  image.warnings = std::move(warnings);
  if (header.has("DistanceUnits")) scale_from_unit(image, header.at("DistanceUnits"));  // ITK leaves it out
  read_metaimage_voxels(image, header, data_file, detached);
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
