#include "preprocess/supports/fold_faces.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <map>
#include <optional>

#include "io/stop.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/supports/consistency.hpp"
#include "preprocess/supports/support.hpp"
#include "preprocess/surface/surface_cells.hpp"

namespace dimple {
namespace {

constexpr double faces = -0.5;      // cosine between outward normals of opposing walls, at most
constexpr double least_flat = 0.5;  // of a sample: |vector area| / area; less is around an edge
// Least gap of a part / gap of its sample: a smaller one is the wall's own edge, which the ray grazes.
constexpr double least_of_whole = 0.25;
constexpr double same_wall =
    0.7;  // cosine between the normals of the places ahead of a part and of the whole
constexpr int nearest_points = 12, nearest_nodes = 8;
constexpr double enough_pieces = 12.0;  // of the surface, on a spacing of the nodes squared

// The surface in the body's own axes, where lengths are in mm for SurfaceCells.
class Walls {
 public:
  explicit Walls(const Model& model)
      : axes_(model.axes),
        centre_(model.tool.centre),
        vertex_(own(1e-3 * model.surface.vertex_mm)),
        triangles_(model.surface.triangles),
        cells_(vertex_, triangles_) {}

  struct Across {
    Vec3 place = Vec3::Zero(), normal = Vec3::Zero();
    double gap = 0.0;
  };
  // First wall that a ray from x [m], outside, enters along a unit vector.
  std::optional<Across> across(const Vec3& x, const Vec3& along, double length) const {
    thread_local std::vector<SurfaceCells::Crossing> crossings;
    const Vec3 from = own(x), ray = 1e3 * length * (axes_.transpose() * along);
    cells_.pass(from, from + ray, crossings, true);
    for (const SurfaceCells::Crossing& crossing : crossings) {
      if (crossing.leave) continue;
      return Across{axes_ * (1e-3 * (from + crossing.t * ray)) + centre_,
                    axes_ * cells_.normal().col(crossing.triangle), crossing.t * length};
    }
    return std::nullopt;
  }

 private:
  Mat3 axes_;
  Vec3 centre_;
  Points vertex_;
  Triangles triangles_;
  SurfaceCells cells_;

  Points own(const Points& x) const { return 1e3 * (axes_.transpose() * (x.colwise() - centre_)); }
};

// The nearest node on the own side of a gap that begins `gap` in front of x, usually the nearest of all.
int own_node(const Model& model, const Neighbours& nodes, const Vec3& x, const Vec3& normal, double gap) {
  const auto is_own = [&](int a) { return (model.X.col(a) - x).dot(normal) < 0.5 * gap; };
  if (const int nearest = nodes.nearest(x, 1).front(); is_own(nearest)) return nearest;
  const std::vector<int> near = nodes.nearest(x, nearest_nodes);
  const auto own = std::find_if(near.begin(), near.end(), is_own);
  return own == near.end() ? near.front() : *own;
}

// The node of each piece that has a wall straight ahead; -1: it has none. Where pieces are much smaller than
// the spacing, one represents several and has their area.
std::vector<int> nodes_before_walls(const Model& model, const Neighbours& nodes, const Walls& walls,
                                    double widest, SurfacePieces& pieces) {
  std::vector<int> result(static_cast<std::size_t>(pieces.place.cols()), -1);
  tbb::parallel_for(Index{0}, pieces.place.cols(), [&](Index k) {
    if (k % 256 == 0) stop_if_requested();
    const Vec3 x = pieces.place.col(k), normal = pieces.area.col(k).normalized();
    const double spacing = model.spacing[nodes.nearest(x, 1).front()];
    const auto for_several =
        static_cast<Index>(std::max(1.0, spacing * spacing / (enough_pieces * pieces.area.col(k).norm())));
    if (k % for_several != 0) return;
    pieces.area.col(k) *= static_cast<double>(for_several);
    const std::optional<Walls::Across> across = walls.across(x, normal, widest);
    if (across && across->normal.dot(normal) < faces)
      result[static_cast<std::size_t>(k)] = own_node(model, nodes, x, normal, across->gap);
  });
  return result;
}

// A part of the surface in front of a wall of the same body, and that wall.
struct FoldFace {
  int node;
  std::vector<Index> pieces;
  Vec3 normal;
  Walls::Across across;
};

std::vector<FoldFace> fold_faces_of(const Model& model, const Neighbours& nodes, const Walls& walls,
                                    double widest, SurfacePieces& pieces) {
  const std::vector<int> before = nodes_before_walls(model, nodes, walls, widest, pieces);
  std::map<int, std::vector<Index>> cell;
  for (Index k = 0; k < pieces.place.cols(); ++k)
    if (const int node = before[static_cast<std::size_t>(k)]; node >= 0) cell[node].push_back(k);
  std::vector<FoldFace> result;
  for (auto& [node, own] : cell) {
    // Around the bottom of a gap a node may have pieces of both walls: those of the smaller one are left out.
    Vec3 all = Vec3::Zero(), middle = all, normal = all;
    for (const Index k : own) all += pieces.area.col(k);
    std::erase_if(own, [&](Index k) { return !(pieces.area.col(k).dot(all) > 0.0); });
    double sum = 0.0;
    for (const Index k : own) {
      const double A = pieces.area.col(k).norm();
      sum += A, middle += A * pieces.place.col(k), normal += pieces.area.col(k);
    }
    if (own.empty() || normal.norm() < least_flat * sum) continue;
    normal.normalize();
    const std::optional<Walls::Across> its = walls.across(middle / sum, normal, widest);
    if (its && its->normal.dot(normal) < faces) result.push_back({node, std::move(own), normal, *its});
  }
  return result;
}

// The wall ahead takes the mean normal of the sample there, if that faces back: normals of triangles vary.
void take_mean_normals(const Model& model, const Neighbours& nodes, std::vector<FoldFace>& fold_faces) {
  std::map<int, std::size_t> of_node;
  for (std::size_t c = 0; c < fold_faces.size(); ++c) of_node[fold_faces[c].node] = c;
  for (FoldFace& fold_face : fold_faces) {
    const auto found = of_node.find(
        own_node(model, nodes, fold_face.across.place, fold_face.across.normal, fold_face.across.gap));
    if (found == of_node.end()) continue;
    const Vec3& mean = fold_faces[found->second].normal;
    if (mean.dot(fold_face.normal) < faces) fold_face.across.normal = mean;
  }
}

// The integration point whose deformation rotates the wall there.
Index point_behind(const Model& model, const Neighbours& points, const Vec3& place, const Vec3& normal) {
  const std::vector<int> near = points.nearest(place, nearest_points);
  for (const int q : near)
    if ((model.point.col(q) - place).dot(normal) < 0.0 && (!model.sight || model.sight->point_sees(q, place)))
      return q;
  return near.front();
}

// Some of a sample's pieces, and the opposing wall.
struct Part {
  std::vector<Index> pieces;
  Vec3 opposite = Vec3::Zero();
};

Vec3 middle_of(const std::vector<Index>& own, const SurfacePieces& pieces) {
  Vec3 middle = Vec3::Zero();
  double sum = 0.0;
  for (const Index k : own) {
    const double A = pieces.area.col(k).norm();
    sum += A, middle += A * pieces.place.col(k);
  }
  return middle / sum;
}

// Parts nearer to the wall than the whole sample, among 36 squares of a sixth of the spacing about its
// middle. With thirds, walls of a fissure that narrows to its floor penetrated each other by 0.08 spacings.
std::vector<Part> nearer_parts(const FoldFace& fold_face, double spacing, const SurfacePieces& pieces,
                               const Walls& walls, double widest) {
  const Vec3 middle = middle_of(fold_face.pieces, pieces), one = fold_face.normal.unitOrthogonal(),
             other = fold_face.normal.cross(one);
  constexpr std::size_t squares = 6;
  const auto which = [&](double x) {
    return static_cast<std::size_t>(
        std::clamp(std::floor(squares * (x / spacing + 0.5)), 0.0, static_cast<double>(squares - 1)));
  };
  std::array<Part, squares * squares> square;
  for (const Index k : fold_face.pieces) {
    const Vec3 d = pieces.place.col(k) - middle;
    square[which(d.dot(one)) + squares * which(d.dot(other))].pieces.push_back(k);
  }
  const auto gap = [&](const Vec3& place, const Vec3& opposite) {
    return (place - opposite).dot(fold_face.across.normal);
  };
  const double of_whole = gap(middle, fold_face.across.place);
  std::vector<Part> parts;
  for (Part& part : square) {
    if (part.pieces.empty()) continue;
    const Vec3 its_middle = middle_of(part.pieces, pieces);
    const std::optional<Walls::Across> across = walls.across(its_middle, fold_face.normal, widest);
    if (!across || across->normal.dot(fold_face.across.normal) < same_wall) continue;
    const Vec3 aside = across->place - fold_face.across.place;
    if ((aside - aside.dot(fold_face.across.normal) * fold_face.across.normal).norm() > spacing) continue;
    const double its_gap = gap(its_middle, across->place);
    if (its_gap < least_of_whole * of_whole || its_gap > of_whole - FoldFaces::bulges * spacing) continue;
    part.opposite = across->place;
    parts.push_back(std::move(part));
  }
  return parts;
}

}  // namespace

FoldFaces find_fold_faces(const Model& model, double widest) {
  FoldFaces result;
  if (model.surface.empty()) return result;
  SurfacePieces pieces = pieces_of(model);
  const Neighbours nodes(model.X);
  const Walls walls(model);
  std::vector<FoldFace> fold_faces = fold_faces_of(model, nodes, walls, widest, pieces);
  take_mean_normals(model, nodes, fold_faces);
  const auto count = static_cast<Index>(fold_faces.size());
  std::vector<Index> used, place_in_used(static_cast<std::size_t>(pieces.place.cols()));
  std::vector<std::vector<Index>> cell;
  std::vector<Vec3> opposite;
  result.opposite_normal.resize(3, count);
  result.spacing.resize(count);
  const Neighbours points(model.point);
  const auto put = [&](const std::vector<Index>& own, const Vec3& across) {
    opposite.push_back(across);
    cell.emplace_back();
    for (const Index k : own) cell.back().push_back(place_in_used[static_cast<std::size_t>(k)]);
  };
  for (Index c = 0; c < count; ++c) {
    const FoldFace& fold_face = fold_faces[static_cast<std::size_t>(c)];
    result.spacing[c] = model.spacing[fold_face.node];
    result.opposite_normal.col(c) = fold_face.across.normal;
    result.point.push_back(point_behind(model, points, fold_face.across.place, fold_face.across.normal));
    for (const Index k : fold_face.pieces) {
      place_in_used[static_cast<std::size_t>(k)] = static_cast<Index>(used.size());
      used.push_back(k);
    }
    put(fold_face.pieces, fold_face.across.place);
  }
  for (Index c = 0; c < count; ++c) {
    const FoldFace& fold_face = fold_faces[static_cast<std::size_t>(c)];
    for (const Part& part : nearer_parts(fold_face, result.spacing[c], pieces, walls, widest))
      put(part.pieces, part.opposite);
    result.part_end.push_back(static_cast<Index>(cell.size()));
  }
  result.opposite = Eigen::Map<const Points>(opposite.empty() ? nullptr : opposite.front().data(), 3,
                                             static_cast<Index>(opposite.size()));
  const Points place = pieces.place(Eigen::all, used), area = pieces.area(Eigen::all, used);
  result.sample = means_of(cell, place, area, surface_interpolation(model, place, area), model.node_count());
  for (Index c = 0; c < count; ++c)
    result.own_point.push_back(
        point_behind(model, points, result.sample.place.col(c), result.sample.normal.col(c)));
  Points outward(3, result.opposite.cols());
  outward.leftCols(count) = result.opposite_normal;
  for (Index c = 0; c < count; ++c)
    for (Index row = result.part_begin(c); row < result.part_end[static_cast<std::size_t>(c)]; ++row)
      outward.col(row) = result.opposite_normal.col(c);
  result.at_opposite = surface_interpolation(model, result.opposite, outward);
  return result;
}

}  // namespace dimple
