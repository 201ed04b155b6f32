#include "preprocess/supports/contact_surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "io/error.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/supports/consistency.hpp"
#include "preprocess/supports/support.hpp"
#include "preprocess/surface/surface_cells.hpp"

namespace dimple {
namespace {

constexpr double faces_tool = 0.5;  // largest cosine of outward normal and press direction: folds may turn
constexpr double looked_at = 2.0;   // reaches from the axis: nothing farther can come under the tool
// Least area of a sample in squares of the node spacing. Smaller samples hardly affect the force, and had
// pressures of up to twenty times that of their neighbours.
constexpr double least_area = 0.5;
constexpr double farthest = 2.0;  // node spacings from a piece to a node that may receive it
constexpr int most_neighbours = 8;
constexpr double hat_wide = 2.0;  // node spacings to each side

Vec3 across(const ToolPlace& tool, const Vec3& d) {
  return d - d.dot(tool.approach) * tool.approach;
}

// Positions of the tool's axis along its path, from the first contact [m], across the press direction.
std::vector<Vec3> axes_along(const ToolPlace& tool, const std::vector<Vec3>& path, double apart) {
  std::vector<Vec3> axes = {Vec3::Zero()};
  for (const Vec3& come : path) {
    const Vec3 from = axes.back(), to = across(tool, come);
    const int pieces = std::min(1000, static_cast<int>(std::ceil((to - from).norm() / apart)));
    for (int k = 1; k <= pieces; ++k) axes.emplace_back(from + static_cast<double>(k) / pieces * (to - from));
  }
  return axes;
}

// Pieces of the surface around the tool's axis.
SurfacePieces pieces_around(const Model& model, const ToolPlace& tool, const std::vector<Vec3>& axes,
                            double radius) {
  const Points vertex = model.surface.vertex_mm * 1e-3;
  std::vector<Index> near;
  for (Index t = 0; t < model.surface.triangles.cols(); ++t) {
    const auto corner = model.surface.triangles.col(t);
    const auto at = [&](Index c) { return across(tool, vertex.col(corner[c]) - tool.centre); };
    const Vec3 a = at(0), b = at(1), c = at(2);
    if (std::any_of(axes.begin(), axes.end(),
                    [&](const Vec3& axis) { return distance2_to_triangle(axis, a, b, c) < radius * radius; }))
      near.push_back(t);
  }
  return pieces_of(model, model.surface.triangles(Eigen::all, near));
}

using Cells = std::map<int, std::vector<Index>>;  // the pieces that are nearest to a node

// Moves pieces of nodes with too little area to the nearest other node that has enough. Its pieces must face
// in the same direction, unlike the other wall of a gap. If one piece finds no such node near, all remain.
Cells without_small(const Model& model, const Points& place, const Points& area, const Cells& cells) {
  std::vector<int> large;
  std::vector<Vec3> faces;
  for (const auto& [node, own] : cells) {
    double size = 0.0;
    Vec3 sum = Vec3::Zero();
    for (const Index k : own) {
      size += area.col(k).norm();
      sum += area.col(k);
    }
    if (size < least_area * std::pow(model.spacing[node], 2)) continue;
    large.push_back(node);
    faces.push_back(sum.normalized());
  }
  if (large.empty()) return cells;
  const Neighbours nodes(model.X(Eigen::all, large));
  const int requested = std::min<int>(most_neighbours, static_cast<int>(large.size()));
  const auto neighbour = [&](Index k) {  // -1: none
    for (const int other : nodes.nearest(place.col(k), requested)) {
      const int its = large[static_cast<std::size_t>(other)];
      if ((model.X.col(its) - place.col(k)).norm() <= farthest * model.spacing[its] &&
          faces[static_cast<std::size_t>(other)].dot(area.col(k)) > 0.5 * area.col(k).norm())
        return its;
    }
    return -1;
  };
  Cells result;
  for (const auto& [node, own] : cells) {
    std::vector<int> to(own.size(), node);
    if (!std::binary_search(large.begin(), large.end(), node)) {
      std::transform(own.begin(), own.end(), to.begin(), neighbour);
      if (std::count(to.begin(), to.end(), -1) > 0) std::fill(to.begin(), to.end(), node);
    }
    for (std::size_t i = 0; i < own.size(); ++i) result[to[i]].push_back(own[i]);
  }
  for (auto& [node, own] : result) std::sort(own.begin(), own.end());
  return result;
}

[[noreturn]] void refuse(const std::string& fact) {
  throw ModelError({.fact = fact,
                    .where = "surface beneath the tool",
                    .why = "contact with a tool is enforced at points of the body's surface",
                    .remedy = "begin with the label image, choose another place (--indent-at), or leave "
                              "--tool out",
                    .code = "contact-surface"});
}

}  // namespace

void look_around(ContactSurface& surface) {
  const Neighbours samples(surface.place);
  surface.around.offset = Eigen::VectorXi::Zero(surface.count() + 1);
  std::vector<int> near, member;
  std::vector<double> weight;
  for (Index s = 0; s < surface.count(); ++s) {
    const double wide = hat_wide * surface.spacing[s];
    samples.within(surface.place.col(s), wide, near);
    for (const int t : near) {
      if (t != s && !(surface.normal.col(t).dot(surface.normal.col(s)) > 0.0)) continue;
      member.push_back(t);
      weight.push_back(1.0 - (surface.place.col(t) - surface.place.col(s)).norm() / wide);
    }
    surface.around.offset[s + 1] = static_cast<int>(member.size());
  }
  surface.around.member = Eigen::Map<Eigen::VectorXi>(member.data(), static_cast<Index>(member.size()));
  surface.hat = Eigen::Map<Eigen::VectorXd>(weight.data(), static_cast<Index>(weight.size()));
}

ContactSurface contact_surface(const Model& model, double reach, const std::vector<Vec3>& path) {
  return contact_surface(model, model.tool, reach, path);
}

ContactSurface contact_surface(const Model& model, const ToolPlace& tool, double reach,
                               const std::vector<Vec3>& path) {
  if (model.surface.empty()) refuse("the model has no surface for contact");
  const std::vector<Vec3> axes = axes_along(tool, path, 0.25 * reach);
  const SurfacePieces pieces = pieces_around(model, tool, axes, looked_at * reach);
  const Neighbours nodes(model.X);
  Cells cell;
  std::vector<Index> reached, beyond;
  for (Index k = 0; k < pieces.place.cols(); ++k) {
    const Vec3 x = pieces.place.col(k), area = pieces.area.col(k);
    const Vec3 aside = across(tool, x - tool.centre);
    double away = std::numeric_limits<double>::infinity();
    for (const Vec3& axis : axes) away = std::min(away, (aside - axis).norm());
    const int node = nodes.nearest(x, 1).front();
    const bool faces = area.dot(tool.approach) < faces_tool * area.norm();
    const bool held = std::binary_search(model.base.begin(), model.base.end(), node);
    if (away < reach && faces && !held) {
      cell[node].push_back(static_cast<Index>(reached.size()));
      reached.push_back(k);
    } else if (away < looked_at * reach) {
      beyond.push_back(k);
    }
  }
  if (reached.empty()) refuse("no part of the surface faces the tool");
  ContactSurface result;
  result.between = pieces.place(Eigen::all, reached);
  const Points area = pieces.area(Eigen::all, reached);
  result.at_between = surface_interpolation(model, result.between, area);
  std::vector<std::vector<Index>> cells;
  cell = without_small(model, result.between, area, cell);
  result.spacing.resize(static_cast<Index>(cell.size()));
  for (auto& [node, own] : cell) {
    result.spacing[static_cast<Index>(cells.size())] = model.spacing[node];
    cells.push_back(std::move(own));
  }
  static_cast<CellMeans&>(result) =
      means_of(cells, result.between, area, result.at_between, model.node_count());
  result.beyond = pieces.place(Eigen::all, beyond);
  result.at_beyond = surface_interpolation(model, result.beyond, pieces.area(Eigen::all, beyond));
  look_around(result);
  return result;
}

}  // namespace dimple
