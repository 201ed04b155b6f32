#include "io/surface_mesh.hpp"

#include <fmt/format.h>
#include <vtkCallbackCommand.h>
#include <vtkCellArray.h>
#include <vtkCleanPolyData.h>
#include <vtkExecutive.h>
#include <vtkNew.h>
#include <vtkOBJReader.h>
#include <vtkPolyData.h>
#include <vtkSTLReader.h>
#include <vtkTriangleFilter.h>

#include <algorithm>
#include <cstdint>
#include <cstring>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/text.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr Index most_triangles = 2'000'000;
constexpr std::uintmax_t most_bytes = 500'000'000;
constexpr double welded = 1e-6;  // of the size

[[noreturn]] void refuse(const fs::path& file, const std::string& fact, const std::string& why,
                         const std::string& remedy) {
  throw InputError({.fact = fact, .where = file.string(), .why = why, .remedy = remedy});
}

// VTK's reader takes the count of a binary file at its word, and any other file as text.
void check_stl(const fs::path& file, const std::string& content) {
  constexpr std::size_t header = 84, a_triangle = 50;
  std::uint32_t count = 0;
  if (content.size() >= header) std::memcpy(&count, content.data() + header - sizeof count, sizeof count);
  const bool binary = content.size() >= header && content.size() == header + a_triangle * std::size_t{count};
  const bool text = content.starts_with("solid") && content.find("facet") != std::string::npos &&
                    content.find('\0') == std::string::npos;
  if (!binary && !text)
    refuse(file, fmt::format("{} is no STL file", file.filename().string()),
           content.size() >= header
               ? fmt::format("it is not text that begins with 'solid', and as a binary file it would have {} "
                             "triangles and {} bytes, where there are {}",
                             count, header + a_triangle * std::size_t{count}, content.size())
           : content.starts_with("solid")
               ? "it holds no facet, as text, and is too short for a binary file"
               : "it is too short for a binary file and does not begin with 'solid'",
           "export it again, as binary STL");
}

template <class Reader>
vtkSmartPointer<vtkPolyData> read_by_vtk(const fs::path& file) {
  std::string failure;
  vtkNew<vtkCallbackCommand> on_error;
  on_error->SetClientData(&failure);
  on_error->SetCallback([](vtkObject*, unsigned long, void* to, void* text) {
    if (text) *static_cast<std::string*>(to) = static_cast<const char*>(text);
  });
  vtkNew<Reader> reader;
  reader->AddObserver(vtkCommand::ErrorEvent, on_error);
  reader->GetExecutive()->AddObserver(vtkCommand::ErrorEvent, on_error);  // else it prints to the terminal
  reader->SetFileName(file.c_str());
  reader->Update();
  if (!failure.empty())
    refuse(file, fmt::format("{} cannot be read", file.filename().string()),
           "it breaks off, or holds what its format does not know", "export it again, as binary STL");
  vtkPolyData* read = reader->GetOutput();
  vtkIdType corners = 0;
  const vtkIdType* corner = nullptr;
  for (read->GetPolys()->InitTraversal(); read->GetPolys()->GetNextCell(corners, corner);)
    for (vtkIdType c = 0; c < corners; ++c)
      if (corner[c] < 0 || corner[c] >= read->GetNumberOfPoints())
        refuse(file,
               fmt::format("a face in {} uses corner {}; there are {}", file.filename().string(),
                           corner[c] + 1, read->GetNumberOfPoints()),
               "the file contradicts itself", "export it again");
  return read;
}

SurfaceFile in_triangles(const fs::path& file, vtkPolyData& read) {
  vtkNew<vtkTriangleFilter> triangles;
  triangles->SetInputData(&read);
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
  for (Index v = 0; v < surface.position_mm.cols(); ++v) {
    mesh.GetPoint(v, surface.position_mm.col(v).data());
    if (!surface.position_mm.col(v).allFinite())
      refuse(file, fmt::format("a corner in {} is not a finite number", file.filename().string()),
             "the program that wrote the file did not check", "export it again");
  }
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

}  // namespace

SurfaceFile read_surface_mesh(const fs::path& file) {
  require_regular_file(file);
  std::string suffix = file.extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  SurfaceFile surface;
  if (suffix == ".vtp") {
    surface = read_vtp(file);
  } else if (suffix == ".stl") {
    check_stl(file, read_file(file, most_bytes));
    surface = in_triangles(file, *read_by_vtk<vtkSTLReader>(file));
  } else if (suffix == ".obj") {
    if (const std::string content = read_file(file, most_bytes); !is_utf8(content))
      refuse(file, fmt::format("{} is no OBJ file", file.filename().string()), "it is not text",
             "export it again, as binary STL");
    surface = in_triangles(file, *read_by_vtk<vtkOBJReader>(file));
  } else {
    refuse(file, fmt::format("{} is not of a kind that is read as a surface", file.filename().string()),
           "surfaces are read from .stl, .obj and .vtp files", "export it as binary STL");
  }
  if (surface.triangles.cols() == 0)
    refuse(file, fmt::format("{} holds no triangle", file.filename().string()), "it is not a surface",
           "name the file of a closed surface");
  if (surface.triangles.cols() > most_triangles)
    refuse(file, fmt::format("{} has {} triangles", file.filename().string(), surface.triangles.cols()),
           fmt::format("at most {} are taken", most_triangles),
           "reduce it, for instance by the Decimate filter of ParaView");
  return surface;
}

bool is_surface_file(const std::string& name) {
  std::string suffix = fs::path(name).extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return suffix == ".stl" || suffix == ".obj" || suffix == ".vtp";
}

}  // namespace dimple
