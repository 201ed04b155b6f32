#include "io/vtk_files.hpp"

#include <fmt/format.h>
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
#include <vtkMatrix3x3.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkShortArray.h>
#include <vtkSignedCharArray.h>
#include <vtkSmartPointer.h>
#include <vtkTypeInt32Array.h>
#include <vtkUnsignedShortArray.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLImageDataWriter.h>
#include <vtkXMLPolyDataWriter.h>
#include <vtkXMLUnstructuredGridWriter.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/vtk_messages.hpp"

namespace dimple {

namespace fs = std::filesystem;

namespace {

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
  // An error of the caller, not of the user; VTK would write a file that its own reader refuses.
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
  // ParaView offers the displacement first, for Warp By Vector. No text arrays: meshio exits on them.
  constexpr const char* warp = "displacement_mm";
  vtkDataArray* displacement = set.GetPointData()->GetArray(warp);
  if (displacement != nullptr && displacement->GetNumberOfComponents() == 3)
    set.GetPointData()->SetActiveVectors(warp);

  vtkNew<vtkDoubleArray> time;
  time->SetName("TimeValue");
  time->InsertNextValue(time_s);
  set.GetFieldData()->AddArray(time);
}

/// Numbers of points and corners: half as long as VTK's own, and enough for meshes that fit into memory.
using CellNumbers = vtkTypeInt32Array;

/// Blocks are packed one by one. VTK's own 32 kB cost a start of the compressor each; whole arrays exceed the
/// limit of readers that check for damaged headers (absurd_blocks).
constexpr std::size_t block_bytes = std::size_t{1} << 18;

/// Into memory first: on a full disk VTK's own files are truncated in silence.
template <class Writer>
void write_xml(const fs::path& file, vtkDataObject& data, bool small, bool even_if_stopped = false) {
  if (!even_if_stopped) stop_if_requested();
  std::string content;
  {
    const MessageScope messages;
    vtkNew<Writer> writer;
    writer->SetInputDataObject(&data);
    // Inline base64: raw appended bytes are not XML, and since its fixes of CVE-2023-52425 the expat of
    // Debian 12 fails on them before VTK's readers stop it.
    writer->SetDataModeToBinary();
    // LZ4: the fastest zlib took half of the time of writing full-precision numbers, for files a fifth
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
      if (stop_requested() != StopReason::none) static_cast<vtkAlgorithm*>(caller)->SetAbortExecute(1);
    });
    if (!even_if_stopped) writer->AddObserver(vtkCommand::ProgressEvent, progress);
    const int done = writer->Write();
    if (writer->GetAbortExecute() != 0) stop_if_requested();
    if (done == 0 || writer->GetErrorCode() != 0 || !messages.empty())
      throw OutputError({.fact = fmt::format("{} could not be encoded", file.filename().string()),
                         .where = fmt::format("writing {}", file.string()),
                         .why = fmt::format("VTK says: {}", messages.text()),
                         .remedy = "check the free memory; a smaller model or fewer fields need less"});
    content = writer->GetOutputString();
  }
  write_file(file, content);
}

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

/// The labels on a grid along L, P, S that covers `image`, each voxel by its nearest neighbour.
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
      stop_if_requested();
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

/// The narrowest of int8, int16, uint16, int32 that holds every label; not uint8, which VTK treats as
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

}  // namespace

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

}  // namespace dimple
