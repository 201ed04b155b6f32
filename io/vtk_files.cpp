#include "io/vtk_files.hpp"

#include <fmt/format.h>
#include <vtkBase64Utilities.h>
#include <vtkCallbackCommand.h>
#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkDataArray.h>
#include <vtkDoubleArray.h>
#include <vtkFieldData.h>
#include <vtkFloatArray.h>
#include <vtkImageData.h>
#include <vtkInformation.h>
#include <vtkIntArray.h>
#include <vtkLogger.h>
#include <vtkMatrix3x3.h>
#include <vtkNew.h>
#include <vtkObjectFactory.h>
#include <vtkOutputWindow.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkShortArray.h>
#include <vtkSignedCharArray.h>
#include <vtkSmartPointer.h>
#include <vtkTypeInt32Array.h>
#include <vtkUnsignedShortArray.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLFileReadTester.h>
#include <vtkXMLImageDataWriter.h>
#include <vtkXMLPolyDataReader.h>
#include <vtkXMLPolyDataWriter.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <vtkXMLUnstructuredGridWriter.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <limits>
#include <mutex>
#include <numeric>
#include <optional>
#include <set>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <utility>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"

namespace dimple {

namespace fs = std::filesystem;

namespace {

// ------------------------------------------------------------------------------------------------- messages

/// Keeps what VTK would print to the terminal. An observer on the reader is not enough: the parser and the
/// decompressor inside it report on their own.
class CapturedMessages : public vtkOutputWindow {
 public:
  static CapturedMessages* New() { VTK_STANDARD_NEW_BODY(CapturedMessages); }
  void DisplayText(const char* text) override {
    if (first.empty() && text != nullptr) first = text;
  }
  std::string first;  ///< the first message: later ones are its consequences

 protected:
  CapturedMessages() = default;
};

/// Captures VTK's messages for as long as it lives, then puts the former window back.
/// VTK's logger writes to the terminal beside the window, so it is silenced too.
class MessageScope {
 public:
  MessageScope() {
    vtkOutputWindow::SetInstance(window_);
    vtkObject::GlobalWarningDisplayOn();
    vtkLogger::SetStderrVerbosity(vtkLogger::VERBOSITY_OFF);
  }
  ~MessageScope() {
    vtkLogger::SetStderrVerbosity(logged_);
    vtkObject::SetGlobalWarningDisplay(displayed_);
    vtkOutputWindow::SetInstance(before_);
  }
  MessageScope(const MessageScope&) = delete;
  MessageScope& operator=(const MessageScope&) = delete;

  /// The first message in one line, without its beginning "ERROR: In x.cxx, line 7\nvtkY (0x55d0): ".
  std::string text() const {
    std::string_view message = window_->first;
    if (const auto end = message.find("): "); end != std::string_view::npos) message.remove_prefix(end + 3);
    std::string line;
    for (const char c : message) {
      const bool blank = c == ' ' || c == '\n' || c == '\t' || c == '\r';
      if (!blank) line += c;
      if (blank && !line.empty() && line.back() != ' ') line += ' ';
    }
    while (!line.empty() && (line.back() == ' ' || line.back() == '.')) line.pop_back();
    return line;
  }
  bool empty() const { return window_->first.empty(); }

 private:
  // The window is the process's: who reads or writes beside this one waits.
  inline static std::recursive_mutex one_;
  std::lock_guard<std::recursive_mutex> alone_{one_};
  vtkNew<CapturedMessages> window_;
  vtkSmartPointer<vtkOutputWindow> before_ = vtkOutputWindow::GetInstance();
  int displayed_ = vtkObject::GetGlobalWarningDisplay();
  vtkLogger::Verbosity logged_ = vtkLogger::GetCurrentVerbosityCutoff();
};

// -------------------------------------------------------------------------------------------- fields to VTK

template <class Array>
vtkSmartPointer<Array> packed(const Eigen::MatrixXd& values) {
  using Value = typename Array::ValueType;
  vtkNew<Array> array;
  array->SetNumberOfComponents(static_cast<int>(values.rows()));
  array->SetNumberOfTuples(values.cols());
  Value* to = array->GetPointer(0);
  for (Index i = 0; i < values.size(); ++i) {
    const double value = values.data()[i];
    if constexpr (std::is_integral_v<Value>) {
      if (!(std::abs(value) <= static_cast<double>(std::numeric_limits<Value>::max())))
        throw std::invalid_argument(fmt::format("{} does not fit into an int32 field", value));
      to[i] = static_cast<Value>(std::lround(value));
    } else {
      to[i] = static_cast<Value>(value);
    }
  }
  return array;
}

vtkSmartPointer<vtkDataArray> vtk_array(const Field& field, Index points) {
  // A mistake of the caller, not of the user; VTK would write a file that its own reader refuses.
  if (field.name.empty() || field.values.cols() != points || field.values.rows() < 1 ||
      (!field.components.empty() && static_cast<Index>(field.components.size()) != field.values.rows()))
    throw std::invalid_argument(fmt::format("field \"{}\" is [{} x {}] with {} component names, on {} points",
                                            field.name, field.values.rows(), field.values.cols(),
                                            field.components.size(), points));
  vtkSmartPointer<vtkDataArray> array;
  switch (field.type) {
    case Field::Type::real32:
      array = packed<vtkFloatArray>(field.values);
      break;
    case Field::Type::real64:
      array = packed<vtkDoubleArray>(field.values);
      break;
    case Field::Type::int32:
      array = packed<vtkIntArray>(field.values);
      break;
  }
  array->SetName(field.name.c_str());
  if (!field.unit.empty()) array->GetInformation()->Set(vtkDataArray::UNITS_LABEL(), field.unit.c_str());
  for (std::size_t c = 0; c < field.components.size(); ++c)
    array->SetComponentName(static_cast<vtkIdType>(c), field.components[c].c_str());
  return array;
}

vtkSmartPointer<vtkPoints> vtk_points(const Points& position_mm, bool exact) {
  vtkNew<vtkPoints> points;
  const Field field{.name = "Points",
                    .unit = "mm",
                    .values = position_mm,
                    .type = exact ? Field::Type::real64 : Field::Type::real32};
  points->SetData(vtk_array(field, position_mm.cols()));
  return points;
}

void add_fields(vtkPointSet& set, const std::vector<Field>& fields, double time_s) {
  for (const Field& field : fields) set.GetPointData()->AddArray(vtk_array(field, set.GetNumberOfPoints()));
  // ParaView then offers the displacement first, for Warp By Vector. No text arrays: meshio exits on them.
  constexpr const char* warp = "displacement_mm";
  vtkDataArray* displacement = set.GetPointData()->GetArray(warp);
  if (displacement != nullptr && displacement->GetNumberOfComponents() == 3)
    set.GetPointData()->SetActiveVectors(warp);

  vtkNew<vtkDoubleArray> time;
  time->SetName("TimeValue");
  time->InsertNextValue(time_s);
  set.GetFieldData()->AddArray(time);
}

/// Numbers of points and corners: half as long as VTK's own, and no mesh that fits into memory needs more.
using CellNumbers = vtkTypeInt32Array;

/// Packed one by one. VTK's own 32 kB cost a start of the compressor each; whole arrays would be more than a
/// reader that minds damaged headers lets a short file claim (absurd_blocks).
constexpr std::size_t block_bytes = std::size_t{1} << 18;

/// Into memory first: on a full disk VTK's own files are truncated in silence.
template <class Writer>
void write_xml(const fs::path& file, vtkDataObject& data, bool small, bool even_if_stopped = false) {
  if (!even_if_stopped) stop_if_asked();
  std::string content;
  {
    const MessageScope messages;
    vtkNew<Writer> writer;
    writer->SetInputDataObject(&data);
    // Inline base64: bytes appended raw are not XML, and since its fixes of CVE-2023-52425 the expat of
    // Debian 12 stumbles over them before VTK's readers stop it.
    writer->SetDataModeToBinary();
    // Of whole floating-point numbers zlib at its fastest took half of the time of writing, for files a fifth
    // shorter.
    writer->SetCompressorTypeToLZ4();
    if (small) {
      writer->SetCompressorTypeToZLib();
      writer->SetCompressionLevel(1);
    }
    writer->SetBlockSize(block_bytes);
    writer->WriteToOutputStringOn();
    vtkNew<vtkCallbackCommand> progress;
    progress->SetCallback([](vtkObject* caller, unsigned long, void*, void*) {
      if (stop_asked() != StopReason::none) static_cast<vtkAlgorithm*>(caller)->SetAbortExecute(1);
    });
    if (!even_if_stopped) writer->AddObserver(vtkCommand::ProgressEvent, progress);
    const int done = writer->Write();
    if (writer->GetAbortExecute() != 0) stop_if_asked();
    if (done == 0 || writer->GetErrorCode() != 0 || !messages.empty())
      throw OutputError({.fact = fmt::format("{} could not be encoded", file.filename().string()),
                         .where = fmt::format("writing {}", file.string()),
                         .why = fmt::format("VTK says: {}", messages.text()),
                         .remedy = "check the free memory; a smaller model or fewer fields need less"});
    content = writer->GetOutputString();
  }
  write_file(file, content);
}

// ------------------------------------------------------------------------------------------ fields from VTK

[[noreturn]] void refuse_vtk(const fs::path& file, std::string fact, std::string why, std::string remedy) {
  throw InputError({.fact = std::move(fact),
                    .where = fmt::format("reading {}", file.string()),
                    .why = std::move(why),
                    .remedy = std::move(remedy)});
}

Eigen::MatrixXd unpacked(vtkDataArray& array) {
  Eigen::MatrixXd values(array.GetNumberOfComponents(), array.GetNumberOfTuples());
  for (Index n = 0; n < values.cols(); ++n) array.GetTuple(n, values.col(n).data());
  return values;
}

/// Whole numbers that always fit 32 bits; wider ones become doubles.
Field::Type type_of(vtkDataArray& array) {
  switch (array.GetDataType()) {
    case VTK_FLOAT:
      return Field::Type::real32;
    case VTK_CHAR:
    case VTK_SIGNED_CHAR:
    case VTK_UNSIGNED_CHAR:
    case VTK_SHORT:
    case VTK_UNSIGNED_SHORT:
    case VTK_INT:
      return Field::Type::int32;
    default:
      return Field::Type::real64;
  }
}

std::vector<Field> fields_of(vtkFieldData& data) {
  std::vector<Field> fields;
  for (int a = 0; a < data.GetNumberOfArrays(); ++a) {
    auto* array = vtkDataArray::SafeDownCast(data.GetAbstractArray(a));
    if (array == nullptr || array->GetName() == nullptr) continue;  // text: not a field
    Field field{.name = array->GetName(), .unit = "", .values = unpacked(*array), .type = type_of(*array)};
    vtkInformation* information = array->GetInformation();
    if (information->Has(vtkDataArray::UNITS_LABEL()))
      field.unit = information->Get(vtkDataArray::UNITS_LABEL());
    if (array->HasAComponentName())
      for (int c = 0; c < array->GetNumberOfComponents(); ++c) {
        const char* name = array->GetComponentName(c);
        field.components.emplace_back(name == nullptr ? "" : name);
      }
    fields.push_back(std::move(field));
  }
  return fields;
}

/// Whether the first letters of the array SPACE are R, A and S.
bool says_ras(vtkFieldData& data) {
  vtkDataArray* space = data.GetArray("SPACE");
  if (space == nullptr || space->GetNumberOfComponents() != 1 || space->GetNumberOfTuples() < 3) return false;
  return space->GetTuple1(0) == 'R' && space->GetTuple1(1) == 'A' && space->GetTuple1(2) == 'S';
}

/// Finite positions, at least one.
Points positions_of(const fs::path& file, vtkPointSet& set) {
  if (set.GetNumberOfPoints() == 0)
    refuse_vtk(file, fmt::format("{} holds no point", file.filename().string()),
               "the file is well formed but its point list is empty",
               "export it again, or name another file");
  Points position_mm = unpacked(*set.GetPoints()->GetData());
  for (Index n = 0; n < position_mm.cols(); ++n)
    if (!position_mm.col(n).allFinite())
      refuse_vtk(file,
                 fmt::format("point {} of {} lies at ({}, {}, {})", n, position_mm.cols(), position_mm(0, n),
                             position_mm(1, n), position_mm(2, n)),
                 "a position must be three finite numbers; the program that wrote the file did not check",
                 "remove that point or repair the file");
  return position_mm;
}

/// VTK's reader trusts the counts in the header: a negative one makes it write outside its arrays, an absurd
/// one ask for all memory. No compressor that VTK knows packs a thousand points or cells into one byte.
template <class Reader>
class CheckedReader : public Reader {
 public:
  static CheckedReader* New() { VTK_STANDARD_NEW_BODY(CheckedReader); }
  /// The first count that a file of that size cannot hold.
  std::optional<vtkIdType> impossible_count(std::uintmax_t file_bytes) {
    for (int piece = 0; piece < this->GetNumberOfPieces(); ++piece)
      for (const vtkIdType count :
           {this->GetNumberOfPointsInPiece(piece), this->GetNumberOfCellsInPiece(piece)})
        if (count < 0 || static_cast<std::uintmax_t>(count) / 1000 > file_bytes) return count;
    return std::nullopt;
  }
};

/// Where the elements begin that VTK reads arrays from.
std::vector<std::size_t> arrays_in(const std::string& content) {
  std::vector<std::size_t> begin;
  for (const char* element : {"<DataArray", "<Array"})
    for (std::size_t at = 0; (at = content.find(element, at)) != std::string::npos; ++at) begin.push_back(at);
  return begin;
}

constexpr const char* blanks = " \r\n\t";

/// What an attribute of the element that begins at `at` says. By hand, since VTK's own parser takes memory
/// for what an element says as soon as it has met it; and no std::regex: it descends once a letter, and a
/// long value would end the stack.
std::string attribute(const std::string& content, std::size_t at, const std::string& name) {
  constexpr std::size_t none = std::string::npos;
  at = content.find_first_of(std::string(blanks) + "/>", at);
  while ((at = content.find_first_not_of(blanks, at)) != none && content[at] != '>') {
    const std::size_t end_of_key = content.find_first_of(std::string(blanks) + "=>", at);
    const std::size_t equals = content.find_first_not_of(blanks, end_of_key);
    if (equals == none) return "";
    if (content[equals] != '=') {  // no attribute
      at = end_of_key;
      continue;
    }
    const std::size_t open = content.find_first_not_of(blanks, equals + 1);
    if (open == none || (content[open] != '"' && content[open] != '\'')) return "";
    const std::size_t close = content.find(content[open], open + 1);
    if (close == none) return "";
    if (content.compare(at, end_of_key - at, name) == 0) return content.substr(open + 1, close - open - 1);
    at = close + 1;
  }
  return "";
}

/// Each compressed array begins with how many blocks it has, how large they are, and how large each is
/// packed: VTK takes memory for all of them, whatever the file holds. True: more than it can hold.
bool absurd_blocks(const std::string& content) {
  const std::size_t root = content.find("<VTKFile");
  if (root == std::string::npos || attribute(content, root, "compressor").empty()) return false;
  const std::string header = attribute(content, root, "header_type");
  const std::size_t width = header.empty() || header == "UInt32" ? 4 : 8;
  const bool big = attribute(content, root, "byte_order") == "BigEndian";
  const std::size_t appended = content.find("<AppendedData"), first = content.find('_', appended);
  const bool raw = appended != std::string::npos && attribute(content, appended, "encoding") == "raw";
  // The first words of the data at `at`; fewer where the file ends.
  const auto words = [&](std::size_t at, std::size_t count, bool is_raw) {
    const std::size_t bytes = width * count;
    std::vector<unsigned char> plain(bytes + 3);
    std::size_t got = 0;
    if (is_raw) {
      got = std::min(bytes, content.size() - std::min(at, content.size()));
      std::copy_n(content.data() + std::min(at, content.size()), got, plain.data());
    } else if (at < content.size()) {
      got = vtkBase64Utilities::DecodeSafely(reinterpret_cast<const unsigned char*>(content.data()) + at,
                                             std::min((bytes + 2) / 3 * 4, (content.size() - at) / 4 * 4),
                                             plain.data(), plain.size());
    }
    std::vector<std::uint64_t> result;
    for (std::size_t w = 0; (w + 1) * width <= std::min(got, bytes); ++w) {
      std::uint64_t word = 0;
      for (std::size_t b = 0; b < width; ++b)
        word |= std::uint64_t{plain[w * width + (big ? width - 1 - b : b)]} << (8 * b);
      result.push_back(word);
    }
    return result;
  };
  const std::uint64_t size = content.size(), unpacked = 1100 * size + (1 << 16);  // zlib packs 1030 to one
  for (const std::size_t at : arrays_in(content)) {
    const std::string format = attribute(content, at, "format");
    if (!format.empty() && format != "ascii" && format != "binary" && format != "appended")
      return true;  // written so that only VTK understands it
    std::size_t data = std::string::npos;
    if (format == "binary") data = content.find_first_not_of(blanks, content.find('>', at) + 1);
    if (format == "appended" && first != std::string::npos)
      data = first + 1 + std::strtoull(attribute(content, at, "offset").c_str(), nullptr, 10);
    if (data >= content.size()) continue;
    const bool is_raw = format == "appended" && raw;
    const auto start = words(data, 3, is_raw);
    if (start.size() < 3) continue;
    if (start[0] > size / width || start[1] > unpacked || start[2] > unpacked) return true;
    const auto all = words(data, 3 + static_cast<std::size_t>(start[0]), is_raw);
    std::uint64_t packed = 0;
    for (std::size_t k = 3; k < all.size(); ++k)
      if ((packed += std::min(all[k], size + 1)) > size) return true;
  }
  return false;
}

/// What would make VTK's reader follow a null pointer, write outside its arrays or ask for all memory, as a
/// sentence: `kind` is not there, or an array is not of numbers of a type that VTK knows or cannot be in the
/// file.
std::string fatal_flaw(const std::string& content, const std::string& kind) {
  std::size_t begin = 0;
  do {
    begin = content.find('<' + kind, begin + 1);
  } while (begin < content.size() &&
           content.find_first_of(std::string(blanks) + '>', begin) != begin + kind.size() + 1);
  if (begin == std::string::npos) return fmt::format("its element <{}> is missing", kind);
  static const std::set<std::string> known = {"Int8",  "UInt8",  "Int16",   "UInt16",  "Int32", "UInt32",
                                              "Int64", "UInt64", "Float32", "Float64", "Bit"};
  for (const std::size_t at : arrays_in(content)) {
    if (known.count(attribute(content, at, "type")) == 0)
      return fmt::format("an array is not one of numbers: {}",
                         content.substr(at, std::min(content.find('>', at) - at, std::size_t{60})));
    // It looks for a name of each component, and takes memory for each tuple, before it reads a number.
    for (const auto& [name, most] :
         {std::pair{"NumberOfComponents", std::size_t{1000}}, {"NumberOfTuples", 1000 * content.size()}}) {
      const std::string count = attribute(content, at, name);
      if (count.find_first_not_of("0123456789") != std::string::npos || count.size() > 18 ||
          std::strtoull(count.c_str(), nullptr, 10) > most)
        return fmt::format("an array is said to have {} of {}", name, count.substr(0, 60));
    }
  }
  if (absurd_blocks(content))
    return fmt::format("a compressed array is said to hold more than {} bytes can", content.size());
  return "";
}

/// Text arrays are taken out, since VTK's reader does not check where their words end. A SPACE of the field
/// data becomes one of the numbers of its first letters.
std::string without_text_arrays(std::string content) {
  const std::size_t appended = content.find("<AppendedData");
  std::vector<std::size_t> arrays = arrays_in(content);
  std::sort(arrays.rbegin(), arrays.rend());
  for (const std::size_t at : arrays) {
    if (at > appended || attribute(content, at, "type") != "String") continue;
    const std::string element = content.substr(at + 1, content.find_first_of(blanks, at) - at - 1);
    const std::size_t open = content.find('>', at);
    if (open == std::string::npos) continue;
    const bool is_empty = content[open - 1] == '/';
    if (attribute(content, at, "Name") == "SPACE" && attribute(content, at, "NumberOfTuples") == "1") {
      content.replace(
          at, open + 1 - at,
          fmt::format(R"(<{} type="Int8" Name="SPACE" NumberOfTuples="3" format="{}" offset="{}"{}>)",
                      element, attribute(content, at, "format"), attribute(content, at, "offset"),
                      is_empty ? "/" : ""));
      continue;
    }
    const std::string end = fmt::format("</{}>", element);
    const std::size_t close = is_empty ? open : content.find(end, open);
    if (close == std::string::npos) continue;
    content.erase(at, close + (is_empty ? 1 : end.size()) - at);
  }
  return content;
}

/// The parsed file, with everything VTK complained about turned into an InputError.
template <class Reader>
auto read_xml(const fs::path& file, const std::string& kind, const std::string& suffix) {
  const std::string name = file.filename().string();
  std::error_code ignored;
  if (!fs::exists(file, ignored))
    refuse_vtk(file, fmt::format("there is no file {}", file.string()), "no such file or folder",
               "check the path; it is relative to the current folder");
  if (fs::is_directory(file, ignored))
    refuse_vtk(file, fmt::format("{} is a folder", name), fmt::format("a {} file is needed", suffix),
               "name a file in it");
  require_regular_file(file);
  const std::string written = read_file(file);
  const std::string content = kind == "PolyData" ? without_text_arrays(written) : written;

  const MessageScope messages;
  vtkNew<vtkXMLFileReadTester> tester;
  tester->SetFileName(file.c_str());
  if (tester->TestReadFile() == 0)
    refuse_vtk(file, fmt::format("{} is not a VTK XML file", name),
               "it does not start with an XML element <VTKFile type=...>",
               fmt::format("convert it to {} (ParaView: File > Save Data)", suffix));
  const std::string found = tester->GetFileDataType() == nullptr ? "nothing" : tester->GetFileDataType();
  if (found != kind)
    refuse_vtk(file, fmt::format("{} holds {}, not {}", name, found, kind),
               fmt::format("a {} file is needed here", suffix),
               fmt::format("name a {} file, or convert this one in ParaView", suffix));

  if (const std::string flaw = fatal_flaw(content, kind); !flaw.empty())
    refuse_vtk(file, fmt::format("{} is damaged", name), flaw, "copy or export it again");

  vtkNew<CheckedReader<Reader>> reader;
  reader->SetFileName(file.c_str());
  if (content != written) {
    reader->ReadFromInputStringOn();
    reader->SetInputString(content);
  }
  try {
    reader->UpdateInformation();
    const auto bytes = fs::file_size(file);
    if (const auto count = reader->impossible_count(bytes))
      refuse_vtk(file, fmt::format("{} is damaged", name),
                 fmt::format("its header states {} points or cells; the file has {} bytes", *count, bytes),
                 "copy or export it again");
    reader->Update();
  } catch (const Error&) {
    throw;
  } catch (const std::exception& e) {  // no memory, or the file has just disappeared
    refuse_vtk(file, fmt::format("{} is damaged", name), fmt::format("reading gave up: {}", e.what()),
               "copy or export it again");
  }
  if (!messages.empty() || reader->GetErrorCode() != 0)
    refuse_vtk(file, fmt::format("{} is damaged or incomplete", name),
               fmt::format("VTK says: {}", messages.text()),
               "copy or export it again; a full disk or a broken transfer cuts files short");
  return vtkSmartPointer(reader->GetOutput());
}

// --------------------------------------------------------------------------------------------------- images

/// The foreground and two voxels on every side, for contours to close; the whole image if it holds none.
VoxelBox foreground_and_margin(const LabelImage& image) {
  const auto [ni, nj, nk] = image.size;
  VoxelBox box = foreground_box(image);
  if (box.high[0] < 0) return {.low = {0, 0, 0}, .high = {ni - 1, nj - 1, nk - 1}};
  for (std::size_t d = 0; d < 3; ++d) {
    constexpr Index margin = 2;
    box.low[d] = std::max<Index>(box.low[d] - margin, 0);
    box.high[d] = std::min<Index>(box.high[d] + margin, image.size[d] - 1);
  }
  return box;
}

/// The part of `image` inside `box`, which holds all of its foreground.
LabelImage cropped(const LabelImage& image, const VoxelBox& box) {
  LabelImage part;
  for (std::size_t d = 0; d < 3; ++d) part.size[d] = box.high[d] - box.low[d] + 1;
  part.to_world = image.to_world;
  part.to_world.translation() =
      image.to_world *
      Vec3(static_cast<double>(box.low[0]), static_cast<double>(box.low[1]), static_cast<double>(box.low[2]));
  const auto first = static_cast<std::int32_t>(box.low[0]);
  part.row_offset.push_back(0);
  for (Index k = box.low[2]; k <= box.high[2]; ++k)
    for (Index j = box.low[1]; j <= box.high[1]; ++j) {
      for (const Run& run : image.row(j, k))
        part.run.push_back({run.begin - first, run.end - first, run.label});
      part.row_offset.push_back(part.run.size());
    }
  return part;
}

/// The largest cosine between two voxel axes; 0 for an ordinary image.
double skew(const LabelImage& image) {
  const Mat3 axes = image.to_world.linear().colwise().normalized();
  return std::max({std::abs(axes.col(0).dot(axes.col(1))), std::abs(axes.col(1).dot(axes.col(2))),
                   std::abs(axes.col(2).dot(axes.col(0)))});
}

/// The same labels on a grid along L, P, S that covers `image`, each voxel as its nearest neighbour.
LabelImage straightened(const LabelImage& image) {
  const Vec3 step = image.spacing();
  Eigen::AlignedBox3d bounds;  // of the voxel centres
  for (const Index i : {Index{0}, image.size[0] - 1})
    for (const Index j : {Index{0}, image.size[1] - 1})
      for (const Index k : {Index{0}, image.size[2] - 1})
        bounds.extend(image.to_world *
                      Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k)));

  LabelImage grid;
  grid.to_world = Eigen::Translation3d(bounds.min()) * Eigen::Scaling(step);
  for (std::size_t d = 0; d < 3; ++d) {
    const auto row = static_cast<Index>(d);
    grid.size[d] = 1 + static_cast<Index>(std::ceil(bounds.sizes()[row] / step[row] - 1e-9));
  }
  const Eigen::Affine3d to_image = image.to_world.inverse() * grid.to_world;
  std::vector<std::int32_t> label(static_cast<std::size_t>(grid.size[0]));
  for (Index k = 0; k < grid.size[2]; ++k)
    for (Index j = 0; j < grid.size[1]; ++j) {
      stop_if_asked();
      for (Index i = 0; i < grid.size[0]; ++i) {
        const Vec3 at =
            to_image * Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k));
        const Eigen::Array<Index, 3, 1> voxel = at.array().round().cast<Index>();
        const bool inside = (voxel >= 0).all() && voxel[0] < image.size[0] && voxel[1] < image.size[1] &&
                            voxel[2] < image.size[2];
        label[static_cast<std::size_t>(i)] = inside ? image.at(voxel[0], voxel[1], voxel[2]) : 0;
      }
      append_row(grid, label);
    }
  return grid;
}

template <class Array>
vtkSmartPointer<vtkDataArray> labels_as(const LabelImage& image) {
  vtkNew<Array> array;
  array->SetName("label");
  array->SetNumberOfValues(static_cast<vtkIdType>(image.size[0] * image.size[1] * image.size[2]));
  auto* row = array->GetPointer(0);
  std::fill(row, row + array->GetNumberOfValues(), 0);
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j, row += image.size[0])
      for (const Run& run : image.row(j, k))
        std::fill(row + run.begin, row + run.end, static_cast<typename Array::ValueType>(run.label));
  return array;
}

/// The narrowest of int8, int16, uint16, int32 that holds every label; not uint8, which VTK takes for
/// colours.
vtkSmartPointer<vtkDataArray> label_array(const LabelImage& image) {
  std::int32_t least = 0, greatest = 0;
  for (const Run& run : image.run)
    least = std::min(least, run.label), greatest = std::max(greatest, run.label);
  const auto fits = [&](auto type) {
    using Limits = std::numeric_limits<decltype(type)>;
    return least >= Limits::min() && greatest <= Limits::max();
  };
  using SignedChar = signed char;
  if (fits(SignedChar{})) return labels_as<vtkSignedCharArray>(image);
  if (fits(short{})) return labels_as<vtkShortArray>(image);
  using UnsignedShort = unsigned short;
  if (fits(UnsignedShort{})) return labels_as<vtkUnsignedShortArray>(image);
  return labels_as<vtkIntArray>(image);
}

// --------------------------------------------------------------------------------------------------- series

std::string xml_text(std::string_view text) {
  std::string escaped;
  for (const char c : text) switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      default:
        escaped += c;
    }
  return escaped;
}

}  // namespace

// =================================================================================================== writers

const Field* PointFile::find(const std::string& name) const {
  const auto found =
      std::find_if(fields.begin(), fields.end(), [&](const Field& field) { return field.name == name; });
  return found == fields.end() ? nullptr : &*found;
}

void write_vtu(const fs::path& file, const PointFile& points, double time_s, bool exact) {
  const vtkIdType count = points.position_mm.cols();
  vtkNew<vtkUnstructuredGrid> grid;
  grid->SetPoints(vtk_points(points.position_mm, exact));

  vtkNew<CellNumbers> offset, node;  // one vertex each: some readers drop a single poly-vertex
  offset->SetNumberOfValues(count + 1);
  node->SetNumberOfValues(count);
  std::iota(node->GetPointer(0), node->GetPointer(0) + count, 0);
  std::iota(offset->GetPointer(0), offset->GetPointer(0) + count + 1, 0);
  vtkNew<vtkCellArray> vertices;
  vertices->SetData(offset, node);
  grid->SetCells(VTK_VERTEX, vertices);

  add_fields(*grid, points.fields, time_s);
  write_xml<vtkXMLUnstructuredGridWriter>(file, *grid, points.small, points.even_if_stopped);
}

namespace {

void set_polygons(vtkPolyData& mesh, const SurfaceFile& surface) {
  vtkNew<CellNumbers> offset, corner;
  offset->SetNumberOfValues(surface.triangles.cols() + 1);
  corner->SetNumberOfValues(surface.triangles.size());
  for (Index t = 0; t <= surface.triangles.cols(); ++t) offset->SetValue(t, static_cast<int>(3 * t));
  for (Index c = 0; c < surface.triangles.size(); ++c)
    corner->SetValue(c, static_cast<int>(surface.triangles.data()[c]));
  vtkNew<vtkCellArray> triangles;
  triangles->SetData(offset, corner);
  mesh.SetPolys(triangles);
  for (const Field& field : surface.on_triangles)
    mesh.GetCellData()->AddArray(vtk_array(field, surface.triangles.cols()));
}

// Strips of other programs, taken apart: a, b, c, d, e are the triangles (a, b, c), (c, b, d), (c, d, e).
// Refuses numbers that contradict each other.
std::vector<vtkIdType> corners_of_strips(const fs::path& file, vtkPolyData& mesh) {
  std::vector<vtkIdType> all;
  vtkIdType corners = 0;
  const vtkIdType* corner = nullptr;
  for (vtkIdType s = 0; s < mesh.GetStrips()->GetNumberOfCells(); ++s) {
    mesh.GetStrips()->GetCellAtId(s, corners, corner);
    if (corners < 3)
      refuse_vtk(file,
                 fmt::format("triangle strip {} of {} has {} corners", s, file.filename().string(), corners),
                 "it needs three", "export it again");
    for (vtkIdType c = 0; c < corners; ++c) {
      if (corner[c] < 0 || corner[c] >= mesh.GetNumberOfPoints())
        refuse_vtk(file,
                   fmt::format("triangle strip {} of {} uses point {}; there are {}", s,
                               file.filename().string(), corner[c], mesh.GetNumberOfPoints()),
                   "the file contradicts itself", "export it again");
      const vtkIdType turned = c % 2;
      if (c >= 2) all.insert(all.end(), {corner[c - 2 + turned], corner[c - 1 - turned], corner[c]});
    }
  }
  return all;
}

}  // namespace

void write_vtp(const fs::path& file, const SurfaceFile& surface, double time_s, bool exact) {
  const Index points = surface.position_mm.cols();
  if (surface.triangles.size() > 0 &&
      (surface.triangles.minCoeff() < 0 || surface.triangles.maxCoeff() >= points))
    throw std::invalid_argument(fmt::format("triangle corners run from {} to {}, on {} points",
                                            surface.triangles.minCoeff(), surface.triangles.maxCoeff(),
                                            points));
  vtkNew<vtkPolyData> mesh;
  mesh->SetPoints(vtk_points(surface.position_mm, exact));
  set_polygons(*mesh, surface);
  add_fields(*mesh, surface.fields, time_s);
  for (const Field& fact : surface.facts) mesh->GetFieldData()->AddArray(vtk_array(fact, 1));
  write_xml<vtkXMLPolyDataWriter>(file, *mesh, surface.small, surface.even_if_stopped);
}

void write_vti(const fs::path& file, const LabelImage& image) {
  LabelImage part = cropped(image, foreground_and_margin(image));
  constexpr double orthogonal = 1e-4;  // the limit that ITK sets for reading
  if (skew(part) > orthogonal) part = straightened(part);

  const Vec3 spacing = part.spacing();
  const Mat3 direction = part.to_world.linear().colwise().normalized();
  vtkNew<vtkMatrix3x3> matrix;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) matrix->SetElement(r, c, direction(r, c));

  vtkNew<vtkImageData> grid;
  grid->SetDimensions(static_cast<int>(part.size[0]), static_cast<int>(part.size[1]),
                      static_cast<int>(part.size[2]));
  grid->SetOrigin(part.to_world.translation().data());
  grid->SetSpacing(spacing.data());
  grid->SetDirectionMatrix(matrix);
  grid->GetPointData()->SetScalars(label_array(part));
  write_xml<vtkXMLImageDataWriter>(file, *grid, false);
}

// =================================================================================================== readers

PointFile read_vtu(const fs::path& file) {
  const auto grid = read_xml<vtkXMLUnstructuredGridReader>(file, "UnstructuredGrid", ".vtu");
  return {.position_mm = positions_of(file, *grid), .fields = fields_of(*grid->GetPointData())};
}

SurfaceFile read_vtp(const fs::path& file) {
  const auto mesh = read_xml<vtkXMLPolyDataReader>(file, "PolyData", ".vtp");
  const bool is_ras = says_ras(*mesh->GetFieldData());
  SurfaceFile surface{
      .position_mm = positions_of(file, *mesh), .triangles = {}, .fields = fields_of(*mesh->GetPointData())};
  if (is_ras) surface.position_mm.topRows<2>() *= -1.0;

  const std::string name = file.filename().string();
  vtkCellArray& polygons = *mesh->GetPolys();
  const std::vector<vtkIdType> strips = corners_of_strips(file, *mesh);
  if (polygons.GetNumberOfCells() == 0 && strips.empty())
    refuse_vtk(file, fmt::format("{} holds points but no triangle", name), "it is not a surface",
               "name the file of a triangle surface");
  const Index single = polygons.GetNumberOfCells(), in_strips = static_cast<Index>(strips.size()) / 3;
  surface.triangles.resize(3, single + in_strips);
  vtkIdType corners = 0;
  const vtkIdType* corner = nullptr;
  for (Index t = 0; t < single; ++t) {
    polygons.GetCellAtId(t, corners, corner);
    if (corners != 3)
      refuse_vtk(file, fmt::format("polygon {} of {} has {} corners", t, name, corners),
                 "a surface of triangles is needed",
                 "apply the Triangulate filter in ParaView and save the result");
    for (Index c = 0; c < 3; ++c) {
      if (corner[c] < 0 || corner[c] >= surface.position_mm.cols())
        refuse_vtk(file,
                   fmt::format("triangle {} of {} uses point {}; there are {}", t, name, corner[c],
                               surface.position_mm.cols()),
                   "the file contradicts itself", "export it again");
      surface.triangles(c, t) = corner[c];
    }
  }
  for (Index t = 0; t < in_strips; ++t)
    for (Index c = 0; c < 3; ++c)
      surface.triangles(c, single + t) = strips[static_cast<std::size_t>(3 * t + c)];
  return surface;
}

// ==================================================================================================== series

TimeSeries::TimeSeries(fs::path pvd, std::string suffix) : pvd_(std::move(pvd)), suffix_(std::move(suffix)) {
  if (!suffix_.starts_with('.')) suffix_ = fmt::format(".{}", suffix_);
}

fs::path TimeSeries::frame(std::size_t number) const {
  const std::string stem = pvd_.stem().string();
  return pvd_.parent_path() / stem / fmt::format("{}_{:04}{}", stem, number, suffix_);
}

fs::path TimeSeries::next_frame() const {
  const fs::path folder = frame(0).parent_path();
  std::error_code failure;
  fs::create_directories(folder, failure);
  if (failure)
    throw OutputError({.fact = fmt::format("the folder {} cannot be made", folder.string()),
                       .where = fmt::format("writing the frames of {}", pvd_.string()),
                       .why = failure.message(),
                       .remedy = "name another output folder, or make this one writable"});
  return frame(frames_.size());
}

void TimeSeries::resume(const std::vector<double>& times_s) {
  std::error_code ignored;
  frames_.clear();
  for (const double time_s : times_s) {
    const fs::path earlier = frame(frames_.size());
    if (!fs::is_regular_file(earlier, ignored)) disappeared(earlier);
    frames_.emplace_back(time_s, earlier.lexically_relative(pvd_.parent_path()).generic_string());
  }
  // The list first: it never names what is gone.
  if (frames_.empty())
    fs::remove(pvd_, ignored);
  else
    write_list();
  for (std::size_t k = frames_.size(); fs::remove(frame(k), ignored);) ++k;
}

void TimeSeries::disappeared(const fs::path& frame) const {
  throw OutputError({.fact = fmt::format("the frame {} has disappeared", frame.string()),
                     .where = fmt::format("listing it in {}", pvd_.string()),
                     .why = "it was written by this run; something else moved or deleted it",
                     .remedy = "let nothing else work in that folder; start anew with --force"});
}

void TimeSeries::add(double time_s) {
  const fs::path written = next_frame();
  std::error_code ignored;
  if (!fs::is_regular_file(written, ignored)) disappeared(written);
  frames_.emplace_back(time_s, written.lexically_relative(pvd_.parent_path()).generic_string());
  write_list();
}

void TimeSeries::write_list() const {
  // No library: VTK has no writer for this list (it is ParaView's), and it is a few lines of text.
  std::string list =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\">\n  <Collection>\n";
  for (const auto& [time, name] : frames_)
    list += fmt::format("    <DataSet timestep=\"{}\" group=\"\" part=\"0\" file=\"{}\"/>\n", time,
                        xml_text(name));
  list += "  </Collection>\n</VTKFile>\n";
  write_file(pvd_, list);
}

}  // namespace dimple
