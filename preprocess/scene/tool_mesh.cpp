#include "preprocess/scene/tool_mesh.hpp"

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <vtkCellArray.h>
#include <vtkNew.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataNormals.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "io/words.hpp"
#include "preprocess/surface/body_surface.hpp"
#include "preprocess/surface/closed_mesh.hpp"
#include "preprocess/surface/exact_side.hpp"

namespace dimple {
namespace {

constexpr double smallest_mm = 0.2, largest_mm = 2000.0;
constexpr double target_points = 200e3;  // of the grid
constexpr double margin = 0.25;          // of the width, around the tool

[[noreturn]] void refuse(const Drawing& of, const std::string& fact, const std::string& why,
                         const std::string& remedy) {
  throw InputError({.fact = fmt::format("the {} in {} {}", of.what, of.name, fact),
                    .where = of.where,
                    .why = why,
                    .remedy = remedy,
                    .code = of.what + "-mesh"});
}

void refuse_other_units(const Drawing& of, const Points& vertex) {
  const double size = (vertex.rowwise().maxCoeff() - vertex.rowwise().minCoeff()).maxCoeff();
  if (size < smallest_mm || size > largest_mm)
    refuse(of, fmt::format("is {:.3g} mm long", size),
           fmt::format(
               "a {} must be {:g} to {:g} mm long; the file has no units, and its numbers are read as mm",
               of.what, smallest_mm, largest_mm),
           size < smallest_mm ? "scale it by 1000 if it was drawn in metres" : "scale it to mm");
}

void refuse_border(const Drawing& of, const TriangleMesh& mesh) {
  std::vector<std::array<Index, 2>> edge;
  edge.reserve(static_cast<std::size_t>(mesh.triangles.size()));
  for (Index t = 0; t < mesh.triangles.cols(); ++t)
    for (Index c = 0; c < 3; ++c) {
      const Index a = mesh.triangles(c, t), b = mesh.triangles((c + 1) % 3, t);
      edge.push_back({std::min(a, b), std::max(a, b)});
    }
  std::sort(edge.begin(), edge.end());
  std::size_t open = 0;
  std::array<Index, 2> at{};
  for (auto begin = edge.begin(), end = begin; begin != edge.end(); begin = end) {
    end = std::upper_bound(begin, edge.end(), *begin);
    if ((end - begin) % 2 == 1 && open++ == 0) at = *begin;
  }
  if (open > 0)
    refuse(of, fmt::format("has an open border of {} edges", open),
           fmt::format("one of them is near {} in its file; inside and outside are not known",
                       in_words(Vec3(0.5 * (mesh.vertex.col(at[0]) + mesh.vertex.col(at[1]))))),
           "close its holes in the program that made it");
}

// Turns all triangles outward; true if some were not.
bool turn_outward(TriangleMesh& mesh) {
  vtkNew<vtkPolyData> poly;
  vtkNew<vtkPoints> points;
  points->SetDataTypeToDouble();
  for (const auto& x : mesh.vertex.colwise()) points->InsertNextPoint(x.data());
  vtkNew<vtkCellArray> cells;
  for (const auto& t : mesh.triangles.colwise()) {
    const std::array<vtkIdType, 3> corner{t[0], t[1], t[2]};
    cells->InsertNextCell(3, corner.data());
  }
  poly->SetPoints(points);
  poly->SetPolys(cells);
  vtkNew<vtkPolyDataNormals> normals;
  normals->SetInputData(poly);
  normals->ConsistencyOn();
  normals->AutoOrientNormalsOn();
  normals->SplittingOff();
  normals->Update();
  const Triangles before = mesh.triangles;
  vtkIdType count = 0;
  const vtkIdType* corner = nullptr;
  Index t = 0;
  bool turned = false;
  vtkCellArray* polys = normals->GetOutput()->GetPolys();
  for (polys->InitTraversal(); polys->GetNextCell(count, corner) && t < before.cols(); ++t) {
    mesh.triangles.col(t) << corner[0], corner[1], corner[2];
    Index first = 0;
    while (first < 2 && before(first, t) != mesh.triangles(0, t)) ++first;
    turned = turned || before((first + 1) % 3, t) != mesh.triangles(1, t);
  }
  return turned;
}

// Throws if triangles cross; the mesh faces outward and is a manifold.
void refuse_crossing(const Drawing& of, const TriangleMesh& mesh) {
  const std::vector<std::pair<Index, Index>> crossing = crossing_triangles(mesh);
  if (crossing.empty()) return;
  const auto [t, other] = *std::min_element(crossing.begin(), crossing.end());
  const auto middle = [&](Index face) {
    const auto its = mesh.triangles.col(face);
    return Vec3((mesh.vertex.col(its[0]) + mesh.vertex.col(its[1]) + mesh.vertex.col(its[2])) / 3.0);
  };
  refuse(of, fmt::format("passes through itself: {} pairs of its triangles cross", crossing.size()),
         fmt::format("two of them are near {} in its file; inside and outside are not known",
                     in_words(Vec3(0.5 * (middle(t) + middle(other))))),
         "unite its parts in the program that made it");
}

// Distances from `low` upwards to `height`, with a margin around.
DistanceGrid sampled(const BodySurface& tool, double width, double height) {
  const double around = margin * std::min(width, height);
  const Vec3 low = tool.lower().array() - around;
  Vec3 high = tool.upper().array() + around;
  high[2] = std::min(high[2], height + around);
  const Vec3 size = high - low;
  DistanceGrid grid{.origin = low, .step = std::cbrt(size.prod() / target_points), .n = {}, .value = {}};
  for (Index d = 0; d < 3; ++d)
    grid.n[static_cast<std::size_t>(d)] =
        std::max<Index>(4, static_cast<Index>(std::ceil(size[d] / grid.step)) + 1);
  grid.value.resize(static_cast<std::size_t>(grid.n[0] * grid.n[1] * grid.n[2]));
  // Exact near the surface. Deep inside, where no tissue comes, distances are bounded.
  const double deep = margin * width;
  tbb::parallel_for(Index{0}, grid.n[1] * grid.n[2], [&](Index row) {
    stop_if_requested();
    const Index j = row % grid.n[1], k = row / grid.n[1];
    for (Index i = 0; i < grid.n[0]; ++i) {
      const Vec3 x =
          low + grid.step * Vec3(static_cast<double>(i), static_cast<double>(j), static_cast<double>(k));
      const bool inside = tool.contains(x);
      const double away = inside && tool.farther(x, deep) ? deep : tool.closest(x).distance;
      grid.value[static_cast<std::size_t>(grid.number(i, j, k))] = inside ? -away : away;
    }
  });
  return grid;
}

std::vector<double> lower_surface(const DistanceGrid& grid, double width) {
  constexpr int places = 64, directions = 48;
  std::vector<double> lower(places, std::numeric_limits<double>::infinity());
  tbb::parallel_for(0, places, [&](int place) {
    const double r = 0.5 * width * place / (places - 1);
    for (int k = 0; k < (place == 0 ? 1 : directions); ++k) {
      const double angle = 2.0 * std::numbers::pi * k / directions;
      double& least = lower[static_cast<std::size_t>(place)];
      least = std::min(least, height_over(grid, r * std::cos(angle), r * std::sin(angle)));
    }
  });
  return lower;
}

}  // namespace

TriangleMesh closed_drawing(const Drawing& of, const Points& vertex_mm, const Triangles& triangles,
                            bool& turned) {
  TriangleMesh mesh{vertex_mm, triangles};
  refuse_other_units(of, mesh.vertex);
  refuse_border(of, mesh);
  turned = turn_outward(mesh);
  separate_coincident_sheets(mesh);
  stop_if_requested();
  refuse_crossing(of, mesh);
  stop_if_requested();
  return mesh;
}

ToolMesh tool_mesh(const Points& vertex_mm, const Triangles& triangles, const std::string& name) {
  ToolMesh result;
  result.name = name;
  TriangleMesh mesh = closed_drawing({.name = name}, vertex_mm, triangles, result.turned);
  const Vec3 low = mesh.vertex.rowwise().minCoeff(), high = mesh.vertex.rowwise().maxCoeff();
  mesh.vertex.colwise() -= Vec3(0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]);
  const double width = 2.0 * mesh.vertex.topRows<2>().colwise().norm().maxCoeff();
  const BodySurface tool(mesh.vertex, mesh.triangles);
  result.volume_mm3 = tool.volume();
  result.distance = sampled(tool, width, std::min(2.0 * width, high[2] - low[2]));
  result.distance.origin *= 1e-3;
  result.distance.step *= 1e-3;
  for (double& value : result.distance.value) value *= 1e-3;
  result.width = 1e-3 * width;
  result.lower = lower_surface(result.distance, result.width);
  result.length = 1e-3 * (high[2] - low[2]);
  result.vertex = 1e-3 * mesh.vertex;
  result.triangles = std::move(mesh.triangles);
  return result;
}

}  // namespace dimple
