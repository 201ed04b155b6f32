#include "preprocess/output/tetrahedra.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Mesh_criteria_3.h>
#include <CGAL/Mesh_domain_with_polyline_features_3.h>
#include <CGAL/Mesh_triangulation_3.h>
#include <CGAL/Polyhedral_mesh_domain_3.h>
#include <CGAL/Random.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/make_mesh_3.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/nodes/node_set.hpp"

namespace dimple {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Surface = CGAL::Surface_mesh<Kernel::Point_3>;
using Domain = CGAL::Mesh_domain_with_polyline_features_3<CGAL::Polyhedral_mesh_domain_3<Surface, Kernel>>;
using Triangulation = CGAL::Mesh_triangulation_3<Domain>::type;
using Complex = CGAL::Mesh_complex_3_in_triangulation_3<Triangulation>;
using Criteria = CGAL::Mesh_criteria_3<Triangulation>;

constexpr int patch_edge_corners = 120;  // of the polygon for the patch's edge: its area is exact to 0.05 %
// Bound of the circumradius of triangles and tetrahedra / requested edge: 0.58 and 0.61 for equilateral ones,
// and the mesher is below its bounds.
constexpr double radius_per_edge = 0.7;
// Largest distance of triangles from the surface, in edges: a smaller one would refine the rounded edges of a
// body more than the contact patch.
constexpr double distance_per_edge = 0.12;
// Nodes of such a mesh per node of a meshless model: measured, 13 to 16 from a thousand nodes up.
constexpr double vertices_per_node = 15.0;
// Largest number of cubes of the spacing in a body; refused above it.
constexpr double most_cubes = 2e5;

// Requested length of an edge at a place.
struct Field {
  using FT = Kernel::FT;
  using Point_3 = Kernel::Point_3;
  using Index = Domain::Index;
  const Sizing* sizing;
  double scale;
  FT operator()(const Point_3& p, int, const Index&) const {
    stop_if_requested();  // CGAL evaluates the field wherever it refines
    return scale * (*sizing)(Vec3(p.x(), p.y(), p.z()));
  }
};

// The tetrahedra of a body with edges of about `spacing_mm` times the sizing, along the patch's edge too.
Complex fill(const BodySurface& body, const Boundary& boundary, const Sizing& sizing, double spacing_mm) {
  Surface surface;
  std::vector<Surface::Vertex_index> corner;
  for (Index v = 0; v < body.vertex().cols(); ++v)
    corner.push_back(surface.add_vertex({body.vertex()(0, v), body.vertex()(1, v), body.vertex()(2, v)}));
  for (Index t = 0; t < body.triangles().cols(); ++t)
    surface.add_face(corner[static_cast<std::size_t>(body.triangles()(0, t))],
                     corner[static_cast<std::size_t>(body.triangles()(1, t))],
                     corner[static_cast<std::size_t>(body.triangles()(2, t))]);

  CGAL::get_default_random() = CGAL::Random(0);
  Domain domain(surface, &CGAL::get_default_random());
  const Points patch_edge = edge_of_patch(body, boundary, patch_edge_corners);
  std::vector<std::vector<Kernel::Point_3>> lines(1);
  for (Index k = 0; k <= patch_edge.cols(); ++k) {
    const Vec3 x = patch_edge.col(k % patch_edge.cols());
    lines[0].emplace_back(x.x(), x.y(), x.z());
  }
  domain.add_features(lines.begin(), lines.end());

  const Field edges{&sizing, spacing_mm}, radii{&sizing, radius_per_edge * spacing_mm},
      distances{&sizing, distance_per_edge * spacing_mm};
  namespace p = CGAL::parameters;
  const Criteria criteria(p::edge_size = edges, p::facet_angle = 25.0, p::facet_size = radii,
                          p::facet_distance = distances, p::cell_radius_edge_ratio = 2.0,
                          p::cell_size = radii);
  // No time limits: CGAL improves a mesh for as long as its refinement took, which varies between runs.
  return CGAL::make_mesh_3<Complex>(domain, criteria, p::perturb(p::time_limit = 0.0),
                                    p::exude(p::time_limit = 0.0));
}

// An edge by the numbers of its ends, the lesser first.
using Edge = std::pair<Index, Index>;
Edge edge(Index a, Index b) {
  return {std::min(a, b), std::max(a, b)};
}

// Corners, and tetrahedra of positive volume by their numbers.
struct Cells {
  std::vector<Vec3> places;
  std::vector<std::array<Index, 4>> cells;
  double volume = 0.0;
  const Vec3& place(Index a) const { return places[static_cast<std::size_t>(a)]; }
};

// Numbers by position: CGAL's containers are ordered by addresses in memory.
Cells numbered(const Complex& complex) {
  std::vector<Triangulation::Vertex_handle> handles;
  {
    std::set<Triangulation::Vertex_handle> used;
    for (auto cell = complex.cells_in_complex_begin(); cell != complex.cells_in_complex_end(); ++cell)
      for (int k = 0; k < 4; ++k) used.insert(cell->vertex(k));
    handles.assign(used.begin(), used.end());
    const auto key = [](const Triangulation::Vertex_handle& v) {
      return std::array<double, 3>{v->point().z(), v->point().y(), v->point().x()};
    };
    std::sort(handles.begin(), handles.end(), [&](const auto& a, const auto& b) { return key(a) < key(b); });
  }
  Cells mesh;
  std::map<Triangulation::Vertex_handle, Index> number;
  for (const auto& v : handles) {
    number[v] = static_cast<Index>(mesh.places.size());
    mesh.places.emplace_back(v->point().x(), v->point().y(), v->point().z());
  }
  for (auto cell = complex.cells_in_complex_begin(); cell != complex.cells_in_complex_end(); ++cell) {
    std::array<Index, 4> c{};
    for (int k = 0; k < 4; ++k) c[static_cast<std::size_t>(k)] = number.at(cell->vertex(k));
    mesh.cells.push_back(c);
  }
  for (auto& c : mesh.cells) {
    std::sort(c.begin(), c.end());
    const Vec3& origin = mesh.place(c[0]);
    const double six_volumes =
        (mesh.place(c[1]) - origin).cross(mesh.place(c[2]) - origin).dot(mesh.place(c[3]) - origin);
    if (six_volumes < 0.0) std::swap(c[2], c[3]);
    mesh.volume += std::abs(six_volumes) / 6.0;
  }
  std::sort(mesh.cells.begin(), mesh.cells.end());
  return mesh;
}

// Numbers the middle of each edge as a node behind the corners.
std::map<Edge, Index> number_middles(const Cells& mesh) {
  std::map<Edge, Index> middle;
  for (const auto& c : mesh.cells)
    for (int a = 0; a < 4; ++a)
      for (int b = a + 1; b < 4; ++b)
        middle.emplace(edge(c[static_cast<std::size_t>(a)], c[static_cast<std::size_t>(b)]), 0);
  auto next = static_cast<Index>(mesh.places.size());
  for (auto& [ends, node] : middle) node = next++;
  return middle;
}

TetrahedralMesh with_middles(const Cells& from, const std::map<Edge, Index>& middle) {
  TetrahedralMesh mesh;
  mesh.volume_mm3 = from.volume;
  const auto corners = static_cast<Index>(from.places.size());
  mesh.X.resize(3, corners + static_cast<Index>(middle.size()));
  for (Index a = 0; a < corners; ++a) mesh.X.col(a) = from.place(a);
  for (const auto& [ends, node] : middle)
    mesh.X.col(node) = 0.5 * (from.place(ends.first) + from.place(ends.second));
  mesh.tetrahedra.resize(10, static_cast<Index>(from.cells.size()));
  for (Index e = 0; e < mesh.tetrahedra.cols(); ++e) {
    const auto& c = from.cells[static_cast<std::size_t>(e)];
    const auto between = [&](std::size_t a, std::size_t b) { return middle.at(edge(c[a], c[b])); };
    mesh.tetrahedra.col(e) << c[0], c[1], c[2], c[3], between(0, 1), between(1, 2), between(2, 0),
        between(0, 3), between(1, 3), between(2, 3);
  }
  return mesh;
}

// Triangles of one tetrahedron only, by their corners, with the outward normal.
std::map<std::array<Index, 3>, Vec3> outer_faces(const Cells& mesh) {
  std::map<std::array<Index, 3>, std::pair<int, Vec3>> faces;  // how often
  static constexpr int opposite[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
  for (const auto& c : mesh.cells)
    for (const auto& f : opposite) {
      std::array<Index, 3> face{};
      for (std::size_t k = 0; k < 3; ++k) face[k] = c[static_cast<std::size_t>(f[k])];
      const Vec3& origin = mesh.place(face[0]);
      const Vec3 normal = (mesh.place(face[1]) - origin).cross(mesh.place(face[2]) - origin).normalized();
      std::sort(face.begin(), face.end());
      ++faces.try_emplace(face, 0, normal).first->second.first;
    }
  std::map<std::array<Index, 3>, Vec3> outer;
  for (const auto& [face, about] : faces)
    if (about.first == 1) outer.emplace(face, about.second);
  return outer;
}

// Nodes on base and patch; an edge's middle belongs to them if its whole triangle does.
void find_base_and_patch(const Cells& mesh, const std::map<Edge, Index>& middle, const Boundary& boundary,
                         std::set<Index>& base, std::set<Index>& bonded_patch) {
  const double a2 = boundary.radius * boundary.radius * (1.0 + 1e-3);
  for (const auto& [face, normal] : outer_faces(mesh)) {
    bool held = true, pressed = normal.dot(boundary.approach) < 0.0;
    for (const Index v : face) {
      const Vec3 from = mesh.place(v) - boundary.centre;
      const double along = from.dot(boundary.approach);
      held = held && on_base(boundary, mesh.place(v), normal);
      pressed =
          pressed && from.squaredNorm() - along * along <= a2 && std::abs(along) <= 2.0 * boundary.radius;
    }
    // On a flat base, sides that rise from it and the chamfers between do not belong to it.
    held = held && (!boundary.flat_base || normal.dot(boundary.down) > 0.9);
    for (std::size_t k = 0; k < 3; ++k)
      for (const Index v : {face[k], middle.at(edge(face[k], face[(k + 1) % 3]))}) {
        if (held) base.insert(v);
        if (pressed) bonded_patch.insert(v);
      }
  }
}

void require_apart(const std::set<Index>& base, const std::set<Index>& bonded_patch, double spacing_mm) {
  if (base.empty() || bonded_patch.empty())
    throw ModelError({.fact = fmt::format("no triangle of the mesh is {}",
                                          base.empty() ? "on the base" : "in the contact patch"),
                      .where = "tetrahedral mesh",
                      .why = fmt::format("edges of {:.3g} mm are too long", spacing_mm),
                      .remedy = "give a smaller --spacing or more --nodes"});
  for (const Index v : base)
    if (bonded_patch.count(v) > 0)
      throw ModelError({.fact = "the contact patch overlaps the fixed base",
                        .where = "tetrahedral mesh",
                        .why = "a node of the mesh belongs to both",
                        .remedy = "choose another place (--indent-at) or another --base"});
}

}  // namespace

TetrahedralMesh make_tetrahedra(const BodySurface& body, const Boundary& boundary, const Sizing& sizing,
                                double spacing_mm) {
  if (!(body.volume() / std::pow(spacing_mm, 3) <= most_cubes))
    throw ModelError(
        {.fact = fmt::format("the mesh would have over {:.0f} nodes", most_cubes * vertices_per_node),
         .where = "tetrahedral mesh",
         .why = fmt::format("edges of {:.3g} mm are short for this body", spacing_mm),
         .remedy = "give a larger --spacing or fewer --nodes",
         .code = "too-large"});
  const Cells cells = numbered(fill(body, boundary, sizing, spacing_mm));
  if (cells.cells.size() < 20)
    throw ModelError({.fact = fmt::format("the mesh has {} tetrahedra", cells.cells.size()),
                      .where = "tetrahedral mesh",
                      .why = fmt::format("edges of {:.3g} mm are too long for this body", spacing_mm),
                      .remedy = "give a smaller --spacing or more --nodes"});
  const std::map<Edge, Index> middle = number_middles(cells);
  TetrahedralMesh mesh = with_middles(cells, middle);
  std::set<Index> base, bonded_patch;
  find_base_and_patch(cells, middle, boundary, base, bonded_patch);
  require_apart(base, bonded_patch, spacing_mm);
  mesh.base.assign(base.begin(), base.end());
  mesh.bonded_patch.assign(bonded_patch.begin(), bonded_patch.end());
  return mesh;
}

double tetrahedra_spacing_for_count(const BodySurface& body, Index count, const Sizing& sizing) {
  return spacing_for_count(
      body, static_cast<Index>(std::max(8.0, static_cast<double>(count) / vertices_per_node)), sizing);
}

}  // namespace dimple
