#include "preprocess/supports/contact_surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <set>
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

// The samples: means of places and of shape functions over the pieces of each cell.
void take_means(const std::map<int, std::vector<Index>>& cell, const Points& area, Index node_count,
                ContactSurface& surface) {
  const auto count = static_cast<Index>(cell.size());
  surface.place.setZero(3, count);
  surface.normal.setZero(3, count);
  surface.area.setZero(count);
  CompressedRows& rows = surface.at_place.rows;
  rows.offset = Eigen::VectorXi::Zero(count + 1);
  std::vector<int> member;
  std::vector<double> weight;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(node_count);
  const Interpolation& of_piece = surface.at_between;
  Index c = 0;
  for (const auto& [node, pieces] : cell) {
    std::set<int> seen;
    for (const Index k : pieces) {
      const double A = area.col(k).norm();
      surface.area[c] += A;
      surface.place.col(c) += A * surface.between.col(k);
      surface.normal.col(c) += area.col(k);
      for (int e = of_piece.rows.offset[k]; e < of_piece.rows.offset[k + 1]; ++e) {
        sum[of_piece.rows.member[e]] += A * of_piece.weight[e];
        seen.insert(of_piece.rows.member[e]);
      }
    }
    surface.place.col(c) /= surface.area[c];
    surface.normal.col(c).normalize();
    for (const int a : seen) {
      member.push_back(a);
      weight.push_back(sum[a] / surface.area[c]);
      sum[a] = 0.0;
    }
    rows.offset[++c] = static_cast<int>(member.size());
  }
  rows.member = Eigen::Map<Eigen::VectorXi>(member.data(), static_cast<Index>(member.size()));
  surface.at_place.weight = Eigen::Map<Eigen::VectorXd>(weight.data(), static_cast<Index>(weight.size()));
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
  std::map<int, std::vector<Index>> cell;  // the pieces that are nearest to a node
  std::vector<Index> touched, beyond;
  for (Index k = 0; k < pieces.place.cols(); ++k) {
    const Vec3 x = pieces.place.col(k), area = pieces.area.col(k);
    const double away = from_axis(model.tool, x).norm();
    const int node = nodes.nearest(x, 1).front();
    const bool faces = area.dot(model.tool.push) < faces_tool * area.norm();
    const bool held = std::binary_search(model.base.begin(), model.base.end(), node);
    if (away < reach && faces && !held) {
      cell[node].push_back(static_cast<Index>(touched.size()));
      touched.push_back(k);
    } else if (away < looked_at * reach) {
      beyond.push_back(k);
    }
  }
  if (touched.empty()) refuse("no part of the surface faces the tool");
  ContactSurface result;
  result.between = pieces.place(Eigen::all, touched);
  const Points area = pieces.area(Eigen::all, touched);
  result.at_between = surface_interpolation(model, result.between, area);
  take_means(cell, area, model.node_count(), result);
  result.beyond = pieces.place(Eigen::all, beyond);
  result.at_beyond = surface_interpolation(model, result.beyond, pieces.area(Eigen::all, beyond));
  return result;
}

}  // namespace dimple
