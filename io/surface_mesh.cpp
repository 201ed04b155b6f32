#include "io/surface_mesh.hpp"

#include <fmt/format.h>
#include <vtkCellArray.h>
#include <vtkCleanPolyData.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkTriangleFilter.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <vector>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/text.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr Index most_triangles = 2'000'000;
constexpr std::uintmax_t most_bytes = 500'000'000;
constexpr double welded = 1e-6;                // of the size
constexpr const char* ras_mark = "SPACE=RAS";  // as 3D Slicer writes it into a title or comment

[[noreturn]] void refuse(const fs::path& file, const std::string& fact, const std::string& why,
                         const std::string& remedy, std::size_t line = 0) {
  throw InputError({.fact = fact,
                    .where = line == 0 ? file.string() : fmt::format("{}, line {}", file.string(), line),
                    .why = why,
                    .remedy = remedy});
}

// Text STL and OBJ are read here: VTK's readers replace a number that they cannot read by another one,
// silently, and have no line numbers.

// Polygons as in the file.
struct Polygons {
  vtkNew<vtkPoints> place;
  vtkNew<vtkCellArray> cells;
  bool is_ras = false;
  bool is_stl = false;  // each triangle has corners of its own
};

// ----------------------------------------------------------------------------------------- lines of text

// The text without a byte order mark.
std::string_view text_in(const fs::path& file, std::string_view content) {
  if (content.starts_with("\xff\xfe") || content.starts_with("\xfe\xff"))
    refuse(file, fmt::format("{} cannot be read", file.filename().string()), "it is text in UTF-16",
           "save it as UTF-8, or export it again, as binary STL");
  if (content.starts_with("\xef\xbb\xbf")) content.remove_prefix(3);
  return content;
}

// Calls `work(line, number)`.
template <class Work>
void for_each_line(std::string_view text, const Work& work) {
  for (std::size_t number = 1; !text.empty(); ++number) {
    if (number % 65536 == 0) stop_if_requested();
    const std::size_t end = std::min(text.find('\n'), text.size());
    work(trimmed(text.substr(0, end)), number);
    text.remove_prefix(std::min(end + 1, text.size()));
  }
}

// Takes the first word off `line`; empty: there is none.
std::string_view next_word(std::string_view& line) {
  line = trimmed(line);
  const std::string_view word = line.substr(0, line.find_first_of(" \t"));
  line.remove_prefix(word.size());
  return word;
}

Vec3 corner_in(const fs::path& file, std::string_view line, std::size_t number) {
  Vec3 place;
  for (double& value : place) {
    const std::string_view word = next_word(line);
    const char *begin = word.data(), *end = begin + word.size();
    if (word.starts_with('+')) ++begin;  // std::from_chars accepts no plus sign
    const auto [stop, error] = std::from_chars(begin, end, value);
    if (error == std::errc() && stop == end && std::isfinite(static_cast<float>(value))) continue;
    refuse(file,
           fmt::format("{} cannot be read: {} in line {}", file.filename().string(),
                       word.empty() ? "a corner has too few numbers"
                                    : fmt::format("'{}' is not a finite number", printable(word, 40)),
                       number),
           word.find(',') != std::string_view::npos ? "decimal commas are not read"
                                                    : "a corner is three numbers in mm",
           "export it again with decimal points, or as binary STL", number);
  }
  return place;
}

// ------------------------------------------------------------------------------------------------------- STL

constexpr std::size_t stl_title = 80, stl_header = 84, stl_triangle = 50;  // bytes of a binary file

[[noreturn]] void refuse_stl(const fs::path& file, std::size_t bytes, std::size_t claimed, bool solid) {
  refuse(file, fmt::format("{} is no STL file", file.filename().string()),
         solid                 ? "it holds no facet, as text, or bytes that are no text"
         : bytes >= stl_header ? fmt::format("it is not text that begins with 'solid', and as a binary file "
                                             "it would have {} triangles and {} bytes, where there are {}",
                                             claimed, stl_header + stl_triangle * claimed, bytes)
                               : "it is too short for a binary file and does not begin with 'solid'",
         "export it again, as binary STL");
}

void read_binary_stl(const fs::path& file, const std::string& content, Polygons& into) {
  constexpr std::size_t normal = 12;
  for (std::size_t at = stl_header; at < content.size(); at += stl_triangle) {
    Eigen::Matrix3f corner;
    std::memcpy(corner.data(), content.data() + at + normal, sizeof(float) * 9);
    if (!corner.allFinite())
      refuse(file, fmt::format("a corner in {} is not a finite number", file.filename().string()),
             "the program that wrote the file did not check", "export it again");
    const vtkIdType first = into.place->GetNumberOfPoints();
    for (int c = 0; c < 3; ++c) into.place->InsertNextPoint(corner.col(c).data());
    into.cells->InsertNextCell({first, first + 1, first + 2});
  }
}

void read_text_stl(const fs::path& file, const std::string& text, Polygons& into) {
  const std::string cannot = fmt::format("{} cannot be read", file.filename().string());
  bool ended = false;
  for_each_line(text, [&](std::string_view line, std::size_t number) {
    const std::string_view word = next_word(line);
    if (word == "vertex") into.place->InsertNextPoint(corner_in(file, line, number).data());
    if (word == "endfacet") {
      const vtkIdType corners = into.place->GetNumberOfPoints();
      if (corners != 3 * (into.cells->GetNumberOfCells() + 1))
        refuse(file, fmt::format("{}: the facet that ends in line {} has not three corners", cannot, number),
               "STL has triangles only", "export it again, as binary STL", number);
      into.cells->InsertNextCell({corners - 3, corners - 2, corners - 1});
    }
    if (!word.empty()) ended = word == "endsolid" || word == "end";
  });
  if (!ended)
    refuse(file, cannot, "it breaks off: its last line is not 'endsolid'", "export it again, as binary STL");
}

void read_stl(const fs::path& file, const std::string& content, Polygons& into) {
  into.is_stl = true;
  std::uint32_t count = 0;
  if (content.size() >= stl_header) std::memcpy(&count, content.data() + stl_title, sizeof count);
  std::string_view title = std::string_view(content).substr(0, stl_title);
  if (content.size() >= stl_header && content.size() == stl_header + stl_triangle * std::size_t{count}) {
    read_binary_stl(file, content, into);
  } else {
    const std::string_view original = text_in(file, content);
    const std::string text = lower(original);
    const bool solid = trimmed(text).starts_with("solid");
    if (!solid || text.find("facet") == std::string::npos || text.find('\0') != std::string::npos)
      refuse_stl(file, content.size(), count, solid);
    read_text_stl(file, text, into);
    title = trimmed(original);
    title = title.substr(0, title.find('\n'));
  }
  into.is_ras = title.find(ras_mark) != std::string_view::npos;
}

// ------------------------------------------------------------------------------------------------------- OBJ

// The number of a corner, from 0; counted from the last of `places` where it is negative.
vtkIdType corner_number(const fs::path& file, std::string_view word, std::size_t line, vtkIdType places) {
  long long number = 0;
  word = word.substr(0, word.find('/'));
  const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), number);
  if (error != std::errc() || stop != word.data() + word.size() || number == 0 || number < -places)
    refuse(file,
           fmt::format("{} cannot be read: '{}' in line {} is no corner", file.filename().string(),
                       printable(word, 40), line),
           "a face is a list of corners by number", "export it again, as binary STL", line);
  return number > 0 ? number - 1 : places + number;
}

void read_obj(const fs::path& file, std::string_view text, Polygons& into) {
  std::vector<vtkIdType> face;
  bool continues = false;  // a face continues in the next line
  vtkIdType last = -1;
  for_each_line(text, [&](std::string_view line, std::size_t number) {
    if (line.starts_with('#') && line.find(ras_mark) != std::string_view::npos) into.is_ras = true;
    const std::string_view kind = continues ? "f" : next_word(line);
    if (kind == "v") into.place->InsertNextPoint(corner_in(file, line, number).data());
    if (kind != "f") return;
    continues = line.ends_with('\\');
    if (continues) line.remove_suffix(1);
    for (auto word = next_word(line); !word.empty() && word[0] != '#'; word = next_word(line)) {
      face.push_back(corner_number(file, word, number, into.place->GetNumberOfPoints()));
      last = std::max(last, face.back());
    }
    if (continues) return;
    if (face.size() < 3)
      refuse(file,
             fmt::format("{} cannot be read: the face in line {} has {} corners", file.filename().string(),
                         number, face.size()),
             "it needs three", "export it again, as binary STL", number);
    into.cells->InsertNextCell(static_cast<vtkIdType>(face.size()), face.data());
    face.clear();
  });
  if (last >= into.place->GetNumberOfPoints())
    refuse(file,
           fmt::format("a face in {} uses corner {}; there are {}", file.filename().string(), last + 1,
                       into.place->GetNumberOfPoints()),
           "the file contradicts itself", "export it again");
}

// ------------------------------------------------------------------------------------------------ meshes

SurfaceFile in_triangles(const Polygons& polygons) {
  vtkNew<vtkPolyData> read;
  read->SetPoints(polygons.place);
  read->SetPolys(polygons.cells);
  vtkNew<vtkCleanPolyData> same;  // equal corners of an STL first: each is then merged once
  same->SetInputData(read);
  if (polygons.is_stl) same->Update();
  vtkNew<vtkTriangleFilter> triangles;
  triangles->SetInputData(polygons.is_stl ? same->GetOutput() : read);
  triangles->PassVertsOff();
  triangles->PassLinesOff();
  vtkNew<vtkCleanPolyData> clean;
  clean->SetInputConnection(triangles->GetOutputPort());
  clean->SetTolerance(welded);
  clean->ConvertPolysToLinesOff();
  clean->Update();
  vtkPolyData& mesh = *clean->GetOutput();
  SurfaceFile surface;
  surface.position_mm.resize(3, mesh.GetNumberOfPoints());
  for (Index v = 0; v < surface.position_mm.cols(); ++v) mesh.GetPoint(v, surface.position_mm.col(v).data());
  if (polygons.is_ras) surface.position_mm.topRows<2>() *= -1.0;
  surface.triangles.resize(3, mesh.GetNumberOfPolys());
  Index count = 0;
  vtkIdType corners = 0;
  const vtkIdType* corner = nullptr;
  for (mesh.GetPolys()->InitTraversal(); mesh.GetPolys()->GetNextCell(corners, corner);)
    if (corners == 3 && corner[0] != corner[1] && corner[1] != corner[2] && corner[2] != corner[0])
      surface.triangles.col(count++) << corner[0], corner[1], corner[2];
  surface.triangles.conservativeResize(3, count);
  return surface;
}

// Compared by position, since corners of a .vtp need not be merged.
void refuse_copies(const fs::path& file, const SurfaceFile& surface) {
  using Corner = std::array<double, 3>;
  std::vector<std::array<Corner, 3>> all;
  all.reserve(static_cast<std::size_t>(surface.triangles.cols()));
  for (const auto& t : surface.triangles.colwise()) {
    auto& corners = all.emplace_back();
    for (std::size_t c = 0; c < 3; ++c)
      Vec3::Map(corners[c].data()) = surface.position_mm.col(t[static_cast<Index>(c)]);
    std::sort(corners.begin(), corners.end());
  }
  std::sort(all.begin(), all.end());
  const auto twice = std::adjacent_find(all.begin(), all.end());
  if (twice == all.end()) return;
  const auto copies = all.end() - std::unique(twice, all.end());
  const auto place = [&](std::size_t c) { return Vec3::Map((*twice)[c].data()); };
  refuse(file,
         fmt::format("in {} a triangle is there twice near {}", file.filename().string(),
                     dimple::in_words(Vec3((place(0) + place(1) + place(2)) / 3.0))),
         fmt::format("{} of its {} triangles are copies of others; inside and outside are not known", copies,
                     surface.triangles.cols()),
         "remove the copies in the program that made it");
}

}  // namespace

SurfaceFile read_surface_mesh(const fs::path& file) {
  require_regular_file(file);
  const std::string suffix = lower(file.extension().string());
  SurfaceFile surface;
  Polygons polygons;
  if (suffix == ".vtp") {
    surface = read_vtp(file);
  } else if (suffix == ".stl") {
    read_stl(file, read_file(file, most_bytes), polygons);
    surface = in_triangles(polygons);
  } else if (suffix == ".obj") {
    const std::string content = read_file(file, most_bytes);
    const std::string_view text = text_in(file, content);
    if (!is_utf8(text))
      refuse(file, fmt::format("{} is no OBJ file", file.filename().string()), "it is not text",
             "export it again, as binary STL");
    read_obj(file, text, polygons);
    surface = in_triangles(polygons);
  } else {
    refuse(file, fmt::format("{} is not of a kind that is read as a surface", file.filename().string()),
           fmt::format("surfaces are read from {} files", surface_suffixes), "export it as binary STL");
  }
  if (surface.triangles.cols() == 0)
    refuse(file, fmt::format("{} holds no triangle", file.filename().string()), "it is not a surface",
           "name the file of a closed surface");
  if (surface.triangles.cols() > most_triangles)
    refuse(file, fmt::format("{} has {} triangles", file.filename().string(), surface.triangles.cols()),
           fmt::format("at most {} are allowed", most_triangles),
           "reduce it, for instance by the Decimate filter of ParaView");
  refuse_copies(file, surface);
  return surface;
}

bool is_surface_file(const std::string& name) {
  const std::string suffix = lower(fs::path(name).extension().string());
  return suffix == ".stl" || suffix == ".obj" || suffix == ".vtp";
}

}  // namespace dimple
