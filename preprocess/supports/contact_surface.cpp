#include "preprocess/supports/contact_surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "io/error.hpp"
#include "preprocess/cloud/neighbours.hpp"
#include "preprocess/supports/consistency.hpp"
#include "preprocess/supports/support.hpp"
#include "preprocess/surface/surface_cells.hpp"

namespace dimple {
namespace {

constexpr double faces_tool = 0.5;  // outward normal . push, at most: folds over the edge may turn to it
constexpr double looked_at = 2.0;   // reaches from the axis: what is farther cannot come under the tool

Vec3 from_axis(const Indenter& tool, const Vec3& x) {
  const Vec3 d = x - tool.centre;
  return d - d.dot(tool.push) * tool.push;
}

// The surface around the tool's axis, in pieces.
SurfacePieces pieces_around(const Model& model, double radius) {
  const Points vertex = model.surface.vertex_mm * 1e-3;
  std::vector<Index> near;
  for (Index t = 0; t < model.surface.triangles.cols(); ++t) {
    const auto corner = model.surface.triangles.col(t);
    if (distance2_to_triangle(Vec3::Zero(), from_axis(model.tool, vertex.col(corner[0])),
                              from_axis(model.tool, vertex.col(corner[1])),
                              from_axis(model.tool, vertex.col(corner[2]))) < radius * radius)
      near.push_back(t);
  }
  return pieces_of(model, model.surface.triangles(Eigen::all, near));
}

[[noreturn]] void refuse(const std::string& fact) {
  throw ModelError({.fact = fact,
                    .where = "surface beneath the tool",
                    .why = "a tool that touches is followed on samples of the body's surface",
                    .remedy = "begin with the label image, choose another place (--indent-at), or leave "
                              "--tool out",
                    .code = "contact-surface"});
}

}  // namespace

ContactSurface contact_surface(const Model& model, double reach) {
  if (model.surface.empty()) refuse("the model has no surface that a tool could touch");
  const SurfacePieces pieces = pieces_around(model, looked_at * reach);
  const Neighbours nodes(model.X);
  std::vector<Index> touched, beyond;
  for (Index k = 0; k < pieces.place.cols(); ++k) {
    const Vec3 x = pieces.place.col(k), area = pieces.area.col(k);
    const double away = from_axis(model.tool, x).norm();
    const bool faces = area.dot(model.tool.push) < faces_tool * area.norm();
    const bool held = std::binary_search(model.base.begin(), model.base.end(), nodes.nearest(x, 1).front());
    if (away < reach && faces && !held)
      touched.push_back(k);
    else if (away < looked_at * reach)
      beyond.push_back(k);
  }
  if (touched.empty()) refuse("no part of the surface faces the tool");
  ContactSurface result;
  result.place = pieces.place(Eigen::all, touched);
  result.normal = pieces.area(Eigen::all, touched);
  result.area = result.normal.colwise().norm().transpose();
  result.normal.colwise().normalize();
  result.at_place = surface_interpolation(model, result.place, result.normal);
  result.between.resize(3, 3 * result.count());
  Points normal = result.between;
  for (Index k = 0; k < result.count(); ++k) {
    result.between.middleCols(3 * k, 3) =
        pieces.corner.middleCols(3 * touched[static_cast<std::size_t>(k)], 3);
    normal.middleCols(3 * k, 3) = result.normal.col(k).replicate(1, 3);
  }
  result.at_between = surface_interpolation(model, result.between, normal);
  result.beyond = pieces.place(Eigen::all, beyond);
  result.at_beyond = surface_interpolation(model, result.beyond, pieces.area(Eigen::all, beyond));
  return result;
}

}  // namespace dimple
