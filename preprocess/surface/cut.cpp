#include "preprocess/surface/cut.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/corefinement.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/boost/graph/helpers.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <optional>
#include <tuple>

#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
namespace pmp = CGAL::Polygon_mesh_processing;

constexpr double nothing = 1e-9;  // of the body's volume

[[noreturn]] void refuse(const std::string& fact, const std::string& why, const std::string& remedy) {
  throw ModelError({.fact = fact, .where = "--cut (image.cut)", .why = why, .remedy = remedy, .code = "cut"});
}

Mesh to_mesh(const Points& vertex, const Triangles& triangles) {
  Mesh mesh;
  std::vector<Mesh::Vertex_index> corner;
  for (const auto& x : vertex.colwise()) corner.push_back(mesh.add_vertex({x[0], x[1], x[2]}));
  const auto at = [&](Index v) { return corner[static_cast<std::size_t>(v)]; };
  for (const auto& t : triangles.colwise())
    if (mesh.add_face(at(t[0]), at(t[1]), at(t[2])) == Mesh::null_face())
      refuse("the sheet of a cut is no surface",
             "more than two of its triangles meet at an edge, or neighbours face opposite directions",
             "give a sheet of one layer with consistent orientation");
  return mesh;
}

TriangleMesh from_mesh(const Mesh& mesh) {
  TriangleMesh result;
  std::map<Mesh::Vertex_index, Index> number;
  std::vector<Vec3> vertex;
  result.triangles.resize(3, static_cast<Index>(mesh.number_of_faces()));
  Index t = 0;
  for (const auto face : mesh.faces()) {
    Index c = 0;
    for (const auto v : mesh.vertices_around_face(mesh.halfedge(face))) {
      const auto [at, is_new] = number.try_emplace(v, static_cast<Index>(vertex.size()));
      if (is_new) vertex.emplace_back(mesh.point(v).x(), mesh.point(v).y(), mesh.point(v).z());
      result.triangles(c++, t) = static_cast<int>(at->second);
    }
    ++t;
  }
  result.vertex.resize(3, static_cast<Index>(vertex.size()));
  for (std::size_t v = 0; v < vertex.size(); ++v) result.vertex.col(static_cast<Index>(v)) = vertex[v];
  return result;
}

// Canonical order, since CGAL's order depends on addresses in memory. Vertices: those of the first mesh in
// their order, those of the second, then new ones by position. Triangles: in the order of the triangles that
// they are parts of, then new ones by their vertices.
TriangleMesh in_order(const TriangleMesh& mesh, const TriangleMesh& first, const TriangleMesh& second) {
  using Place = std::array<double, 3>;
  const auto place_of = [](const Points& vertex, Index v) {
    return Place{vertex(0, v), vertex(1, v), vertex(2, v)};
  };
  std::map<Place, Index> placed;
  for (Index v = 0; v < first.vertex.cols(); ++v) placed.try_emplace(place_of(first.vertex, v), v);
  for (Index v = 0; v < second.vertex.cols(); ++v)
    placed.try_emplace(place_of(second.vertex, v), first.vertex.cols() + v);
  const Index none = first.vertex.cols() + second.vertex.cols();
  const auto nearly = [](double mm) { return std::floor(1e5 * mm + 0.3); };  // independent of the last digits
  std::vector<std::tuple<Index, Place, Place>> key;
  for (Index v = 0; v < mesh.vertex.cols(); ++v) {
    const Place place = place_of(mesh.vertex, v);
    const auto known = placed.find(place);
    key.emplace_back(known == placed.end() ? none : known->second,
                     Place{nearly(place[0]), nearly(place[1]), nearly(place[2])}, place);
  }
  std::vector<int> at(key.size()), number(key.size());
  std::iota(at.begin(), at.end(), 0);
  std::stable_sort(at.begin(), at.end(), [&](int a, int b) {
    return key[static_cast<std::size_t>(a)] < key[static_cast<std::size_t>(b)];
  });
  TriangleMesh result{mesh.vertex(Eigen::all, at), mesh.triangles};
  for (std::size_t k = 0; k < at.size(); ++k) number[static_cast<std::size_t>(at[k])] = static_cast<int>(k);
  const auto turned = [](std::array<Index, 3> its) {
    std::rotate(its.begin(), std::min_element(its.begin(), its.end()), its.end());
    return its;
  };
  std::map<std::array<Index, 3>, Index> of_first;
  for (Index t = 0; t < first.triangles.cols(); ++t)
    of_first[turned({first.triangles(0, t), first.triangles(1, t), first.triangles(2, t)})] = t;
  std::optional<BodySurface> whole;
  const auto part_of = [&](const auto& t) {
    constexpr double on_it = 1e-6;  // mm
    const Index none_of_them = first.triangles.cols();
    if (none_of_them == 0) return none_of_them;
    if (!whole) whole.emplace(first.vertex, first.triangles);
    const Vec3 middle = (mesh.vertex.col(t[0]) + mesh.vertex.col(t[1]) + mesh.vertex.col(t[2])) / 3.0;
    const BodySurface::Closest next = whole->closest(middle);
    return next.distance < on_it ? next.triangle : none_of_them;
  };
  std::vector<std::pair<Index, std::array<Index, 3>>> triangles;
  for (const auto& t : mesh.triangles.colwise()) {
    std::array<Index, 3> its{}, before{};
    for (std::size_t c = 0; c < 3; ++c) {
      const auto v = static_cast<std::size_t>(t[static_cast<Index>(c)]);
      its[c] = number[v], before[c] = std::get<0>(key[v]);
    }
    const auto known = of_first.find(turned(before));
    triangles.emplace_back(known == of_first.end() ? part_of(t) : known->second, turned(its));
  }
  std::sort(triangles.begin(), triangles.end());
  for (std::size_t t = 0; t < triangles.size(); ++t)
    for (Index c = 0; c < 3; ++c)
      result.triangles(c, static_cast<Index>(t)) =
          static_cast<int>(triangles[t].second[static_cast<std::size_t>(c)]);
  return result;
}

Vec3 normal_of(const TriangleMesh& mesh, Index t) {
  const auto its = mesh.triangles.col(t);
  const Vec3 a = mesh.vertex.col(its[0]);
  return (Vec3(mesh.vertex.col(its[1])) - a).cross(Vec3(mesh.vertex.col(its[2])) - a);
}

// The sheet twice, half a gap before and behind itself, with walls along its border.
TriangleMesh thickened(const TriangleMesh& sheet, double gap) {
  const Index count = sheet.vertex.cols(), faces = sheet.triangles.cols();
  Points normal = Points::Zero(3, count);
  std::map<std::array<int, 2>, int> edges;  // directed; a border's has none in the other direction
  for (Index t = 0; t < faces; ++t)
    for (Index c = 0; c < 3; ++c) {
      normal.col(sheet.triangles(c, t)) += normal_of(sheet, t);
      ++edges[{static_cast<int>(sheet.triangles(c, t)), static_cast<int>(sheet.triangles((c + 1) % 3, t))}];
    }
  normal.colwise().normalize();
  std::vector<std::array<int, 2>> border;
  for (const auto& [edge, times] : edges)
    if (!edges.contains({edge[1], edge[0]})) border.push_back(edge);
  TriangleMesh solid;
  solid.vertex.resize(3, 2 * count);
  solid.vertex.leftCols(count) = sheet.vertex + 0.5 * gap * normal;
  solid.vertex.rightCols(count) = sheet.vertex - 0.5 * gap * normal;
  solid.triangles.resize(3, 2 * faces + 2 * static_cast<Index>(border.size()));
  const int other = static_cast<int>(count);
  solid.triangles.leftCols(faces) = sheet.triangles;
  for (Index t = 0; t < faces; ++t)
    solid.triangles.col(faces + t) << sheet.triangles(0, t) + other, sheet.triangles(2, t) + other,
        sheet.triangles(1, t) + other;
  Index t = 2 * faces;
  for (const auto& [a, b] : border) {
    solid.triangles.col(t++) << b, a, a + other;
    solid.triangles.col(t++) << b, a + other, b + other;
  }
  return solid;
}

void refuse_folded(const Mesh& solid, bool is_region, double gap) {
  if (!pmp::does_self_intersect(solid)) return;
  if (is_region)
    refuse("the closed surface of a cut passes through itself", "its inside is not defined",
           "unite its parts in the program that made it");
  refuse("the sheet of a cut passes through itself, or is bent too sharply",
         fmt::format("it is modelled as {:g} mm thick, and its two faces cross", gap),
         "give a smoother sheet, or a narrower gap with --set image.cut_gap");
}

// A piece of a closed surface; pieces that face inward are hollows.
struct Shell {
  Mesh mesh;
  double volume;  // signed
  Vec3 centre;
};

std::vector<Shell> shells_of(const Mesh& mesh) {
  std::vector<Mesh> parts;
  pmp::split_connected_components(mesh, parts);
  std::vector<Shell> shells;
  for (Mesh& part : parts) {
    const TriangleMesh triangles = from_mesh(part);
    const Vec3 middle = triangles.vertex.rowwise().mean();
    double volume = 0.0;
    Vec3 first = Vec3::Zero();
    for (const auto& t : triangles.triangles.colwise()) {
      const Vec3 a = triangles.vertex.col(t[0]) - middle, b = triangles.vertex.col(t[1]) - middle,
                 c = triangles.vertex.col(t[2]) - middle;
      const double tetrahedron = a.dot(b.cross(c)) / 6.0;
      volume += tetrahedron;
      first += tetrahedron * (a + b + c) / 4.0;
    }
    shells.push_back({std::move(part), volume, middle + first / volume});
  }
  return shells;
}

}  // namespace

TriangleMesh disc_sheet(const Vec3& centre, const Vec3& normal, double radius, double step) {
  constexpr int most = 400;  // rings
  const int rings = std::clamp(static_cast<int>(std::ceil(radius / step)), 4, most);
  const Vec3 n = normal.normalized(), e = n.unitOrthogonal(), g = n.cross(e);
  TriangleMesh sheet;
  std::vector<Vec3> vertex = {centre};
  std::vector<std::array<int, 3>> triangle;
  // Ring r has 6 r vertices, six sectors each: all triangles are nearly equilateral.
  const auto number = [](int r, int k) { return r == 0 ? 0 : 1 + 3 * r * (r - 1) + k % (6 * r); };
  for (int r = 1; r <= rings; ++r)
    for (int k = 0; k < 6 * r; ++k) {
      const double angle = 2.0 * std::numbers::pi * k / (6 * r);
      vertex.emplace_back(centre + radius * r / rings * (std::cos(angle) * e + std::sin(angle) * g));
    }
  for (int r = 1; r <= rings; ++r)
    for (int sector = 0; sector < 6; ++sector)
      for (int k = 0; k < r; ++k) {
        const int out = sector * r + k, in = sector * (r - 1) + k;
        triangle.push_back({number(r, out), number(r, out + 1), number(r - 1, in)});
        if (k + 1 < r) triangle.push_back({number(r - 1, in), number(r, out + 1), number(r - 1, in + 1)});
      }
  sheet.vertex.resize(3, static_cast<Index>(vertex.size()));
  for (std::size_t v = 0; v < vertex.size(); ++v) sheet.vertex.col(static_cast<Index>(v)) = vertex[v];
  sheet.triangles.resize(3, static_cast<Index>(triangle.size()));
  for (std::size_t t = 0; t < triangle.size(); ++t)
    sheet.triangles.col(static_cast<Index>(t)) << triangle[t][0], triangle[t][1], triangle[t][2];
  return sheet;
}

TriangleMesh swept_sheet(const Vec3& x, const Vec3& y, const Vec3& into, double above, double depth,
                         double step) {
  constexpr int most = 800;
  const Vec3 along = y - x, from = x - above * into, down = (above + depth) * into;
  const int n = std::clamp(static_cast<int>(std::ceil(along.norm() / step)), 1, most),
            m = std::clamp(static_cast<int>(std::ceil(down.norm() / step)), 1, most);
  TriangleMesh sheet{Points(3, (n + 1) * (m + 1)), Triangles(3, 2 * n * m)};
  const auto number = [n](int i, int j) { return i + (n + 1) * j; };
  for (int j = 0; j <= m; ++j)
    for (int i = 0; i <= n; ++i)
      sheet.vertex.col(number(i, j)) =
          from + static_cast<double>(i) / n * along + static_cast<double>(j) / m * down;
  Index t = 0;
  for (int j = 0; j < m; ++j)
    for (int i = 0; i < n; ++i) {
      const int a = number(i, j), b = number(i + 1, j), c = number(i + 1, j + 1), d = number(i, j + 1);
      sheet.triangles.col(t++) << a, b, c;
      sheet.triangles.col(t++) << a, c, d;
    }
  return sheet;
}

namespace {

// Solid that a sheet removes: the region that it encloses, or the sheet itself, as thick as the gap.
Mesh solid_of(const TriangleMesh& sheet, double gap, bool& is_region) {
  Mesh solid = to_mesh(sheet.vertex, sheet.triangles);
  is_region = CGAL::is_closed(solid);
  if (!is_region) {
    const TriangleMesh thick = thickened(sheet, gap);
    solid = to_mesh(thick.vertex, thick.triangles);
  } else if (enclosed_volume(sheet) < 0.0) {
    pmp::reverse_face_orientations(solid);
  }
  refuse_folded(solid, is_region, gap);
  return solid;
}

}  // namespace

CutBody cut(const BodySurface& body, const std::vector<TriangleMesh>& sheets, double gap, const Vec3& keep) {
  TriangleMesh now_is{body.vertex(), body.triangles()};
  Mesh mesh = to_mesh(now_is.vertex, now_is.triangles);
  double volume = body.volume(), area = 0.0;
  std::vector<BodySurface> taken;
  for (const TriangleMesh& sheet : sheets) {
    stop_if_requested();
    bool is_region = false;
    Mesh solid = solid_of(sheet, gap, is_region);
    const TriangleMesh outline = from_mesh(solid);
    taken.emplace_back(outline.vertex, outline.triangles);
    Mesh left;
    if (!pmp::corefine_and_compute_difference(mesh, solid, left))
      refuse("the surface around a cut cannot be drawn", "it would be in contact with itself along an edge",
             "move the cut a little");
    double now = 0.0;
    for (const Shell& shell : shells_of(left)) now += shell.volume;
    if (!(volume - now > nothing * body.volume()))
      refuse("a cut meets no tissue", "its blade misses the organ, or follows another cut",
             "move it; `dimple info IMAGE` shows where the labels are");
    if (!is_region) area += (volume - now) / gap;
    volume = now;
    now_is = in_order(from_mesh(left), now_is, outline);
    mesh = to_mesh(now_is.vertex, now_is.triangles);
  }

  std::vector<Shell> shells = shells_of(mesh);
  std::erase_if(shells, [&](const Shell& s) { return std::abs(s.volume) < nothing * body.volume(); });
  std::sort(shells.begin(), shells.end(), [](const Shell& a, const Shell& b) { return a.volume > b.volume; });
  if (shells.empty() || shells.front().volume <= 0.0)
    refuse("a cut leaves nothing of the organ", fmt::format("its gap is {:g} mm wide", gap),
           "give a smaller sheet, or a narrower gap with --set image.cut_gap");
  std::optional<std::size_t> kept;
  std::vector<BodySurface> pieces;
  double nearest = std::numeric_limits<double>::infinity();
  for (const Shell& shell : shells) {
    if (shell.volume < 0.0) break;
    const TriangleMesh its = from_mesh(shell.mesh);
    pieces.emplace_back(its.vertex, its.triangles);
    const double away = pieces.back().contains(keep) ? 0.0 : pieces.back().closest(keep).distance;
    if (away < nearest) nearest = away, kept = pieces.size() - 1;
  }
  // Hollows remain in the piece around them.
  Mesh result = shells[*kept].mesh;
  std::vector<CutPiece> parted;
  for (std::size_t k = 0; k < shells.size(); ++k) {
    if (shells[k].volume > 0.0 && k != *kept) parted.push_back({shells[k].volume, shells[k].centre});
    if (shells[k].volume > 0.0) continue;
    const auto& p = shells[k].mesh.point(*shells[k].mesh.vertices().begin());
    if (pieces[*kept].contains({p.x(), p.y(), p.z()})) result += shells[k].mesh;
  }
  TriangleMesh its = in_order(from_mesh(result), now_is, {Points(3, 0), Triangles(3, 0)});
  BodySurface surface(std::move(its.vertex), std::move(its.triangles), body.to_world());
  surface.ends_with_image(body.image_ends());
  return {std::move(surface), body.volume() - volume, area, std::move(parted), std::move(taken)};
}

double distance_to(const std::vector<TriangleMesh>& sheets, const Vec3& x) {
  const Kernel::Point_3 p(x.x(), x.y(), x.z());
  double least = std::numeric_limits<double>::infinity();
  for (const TriangleMesh& sheet : sheets)
    for (const auto& t : sheet.triangles.colwise()) {
      const auto at = [&](Index c) {
        const auto v = sheet.vertex.col(t[c]);
        return Kernel::Point_3(v[0], v[1], v[2]);
      };
      least = std::min(least, CGAL::squared_distance(p, Kernel::Triangle_3(at(0), at(1), at(2))));
    }
  return std::sqrt(least);
}

}  // namespace dimple
