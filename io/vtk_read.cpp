#include <fmt/format.h>
#include <vtkBase64Utilities.h>
#include <vtkCellArray.h>
#include <vtkDataArray.h>
#include <vtkFieldData.h>
#include <vtkInformation.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLFileReadTester.h>
#include <vtkXMLPolyDataReader.h>
#include <vtkXMLUnstructuredGridReader.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <optional>
#include <set>
#include <system_error>
#include <utility>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/vtk_files.hpp"
#include "io/vtk_messages.hpp"

namespace dimple {

namespace fs = std::filesystem;

namespace {

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

/// True if the first letters of the array SPACE are R, A and S.
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
                 fmt::format("point {} of {} is at ({}, {}, {})", n, position_mm.cols(), position_mm(0, n),
                             position_mm(1, n), position_mm(2, n)),
                 "a position must be three finite numbers; the program that wrote the file did not check",
                 "remove that point or repair the file");
  return position_mm;
}

/// VTK's reader trusts the counts in the header: a negative one makes it write outside its arrays, an absurd
/// one request all memory. No compressor of VTK packs a thousand points or cells into one byte.
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

/// Starts of the elements that VTK reads arrays from.
std::vector<std::size_t> arrays_in(const std::string& content) {
  std::vector<std::size_t> begin;
  for (const char* element : {"<DataArray", "<Array"})
    for (std::size_t at = 0; (at = content.find(element, at)) != std::string::npos; ++at) begin.push_back(at);
  return begin;
}

constexpr const char* blanks = " \r\n\t";

/// Value of an attribute of the element that begins at `at`. By our own code, since VTK's parser allocates
/// the memory that an element requests as soon as it meets it. No std::regex: it recurses for each letter,
/// and a long value would overflow the stack.
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

/// Each compressed array begins with the number of its blocks, their size, and the packed size of each: VTK
/// allocates memory for all of them, whatever the file holds. True: more than it can hold.
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
      return true;  // only VTK understands such numbers
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

/// A sentence on an error that would make VTK's reader follow a null pointer, write outside its arrays or
/// request all memory: `kind` does not exist, or an array has no numbers of a type of VTK or cannot be in the
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
    // It searches a name of each component, and allocates memory for each tuple, before it reads a number.
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

/// Removes text arrays, since VTK's reader does not check where their words end. A SPACE of the field data
/// becomes one of the numbers of its first letters.
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
    refuse_vtk(file, fmt::format("{} is damaged", name), fmt::format("reading failed: {}", e.what()),
               "copy or export it again");
  }
  if (!messages.empty() || reader->GetErrorCode() != 0)
    refuse_vtk(file, fmt::format("{} is damaged or incomplete", name),
               fmt::format("VTK says: {}", messages.text()),
               "copy or export it again; a full disk or a broken transfer cuts files short");
  return vtkSmartPointer(reader->GetOutput());
}

// Converts strips of other programs: a, b, c, d, e are the triangles (a, b, c), (c, b, d), (c, d, e). Refuses
// numbers that contradict each other.
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

const Field* PointFile::find(const std::string& name) const {
  const auto found =
      std::find_if(fields.begin(), fields.end(), [&](const Field& field) { return field.name == name; });
  return found == fields.end() ? nullptr : &*found;
}

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

}  // namespace dimple
