#include "preprocess/supports/wall_surface.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "io/stop.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/supports/consistency.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {
namespace {

constexpr double most_held = 0.5;  // fraction that moves with the base: a sample with more has no force

using PiecesOfSamples = std::vector<std::vector<Index>>;  // the pieces of each sample
using PiecesByNode = std::map<std::array<Index, 2>, std::vector<Index>>;

double held_fraction(const Model& model, const std::vector<Index>& pieces, const Points& area,
                     const Interpolation& at_piece) {
  double held = 0.0, all = 0.0;
  for (const Index k : pieces) {
    const double A = area.col(k).norm();
    all += A;
    for (int e = at_piece.rows.offset[k]; e < at_piece.rows.offset[k + 1]; ++e)
      if (std::binary_search(model.base.begin(), model.base.end(), at_piece.rows.member[e]))
        held += A * at_piece.weight[e];
  }
  return held / all;
}

// Pieces by the nearest node; two samples for a node whose surface faces two directions, as in thin tissue.
PiecesByNode by_node(const std::vector<int>& node, const Points& area) {
  PiecesByNode cell;
  std::map<Index, Vec3> first;
  for (Index k = 0; k < area.cols(); ++k) {
    const Index a = node[static_cast<std::size_t>(k)];
    const Vec3& facing = first.try_emplace(a, area.col(k)).first->second;
    cell[{a, facing.dot(area.col(k)) < 0.0 ? 1 : 0}].push_back(k);
  }
  return cell;
}

// Pieces of neighbouring nodes joined in a grid just coarse enough for at most `most` samples, without
// samples that move with the base. `spacing` receives that of each sample [m].
PiecesOfSamples samples_of(const Model& model, const PiecesByNode& of_node, const std::vector<int>& node,
                           const Points& area, const Interpolation& at_piece, Index most,
                           std::vector<double>& spacing) {
  const Vec3 corner = model.X.rowwise().minCoeff();  // origin of the grid: one cell holds all in the end
  for (double edge = 0.0;; edge = edge > 0.0 ? 1.2 * edge : model.spacing.minCoeff()) {
    stop_if_requested();
    std::map<std::array<Index, 5>, std::vector<Index>> joined;
    for (const auto& [key, own] : of_node) {
      std::array<Index, 5> at{0, 0, 0, key[0], key[1]};
      if (edge > 0.0) {
        const Vec3 x = (model.X.col(key[0]) - corner) / edge, n = area.col(own.front());
        Index side = 0;
        n.cwiseAbs().maxCoeff(&side);
        at = {static_cast<Index>(std::floor(x.x())), static_cast<Index>(std::floor(x.y())),
              static_cast<Index>(std::floor(x.z())), side, n[side] > 0.0 ? 1 : 0};
      }
      auto& all = joined[at];
      all.insert(all.end(), own.begin(), own.end());
    }
    if (static_cast<Index>(joined.size()) > most) continue;
    PiecesOfSamples cells;
    for (auto& [key, own] : joined) {
      if (held_fraction(model, own, area, at_piece) > most_held) continue;
      spacing.push_back(std::max(edge, model.spacing[node[static_cast<std::size_t>(own.front())]]));
      cells.push_back(std::move(own));
    }
    return cells;
  }
}

}  // namespace

ContactSurface wall_surface(const Model& model, const MayContact& may_contact, Index most) {
  ContactSurface result;
  const SurfacePieces pieces = pieces_of(model, model.surface.triangles);
  const Neighbours nodes(model.X);
  std::vector<Index> taken;
  std::vector<int> node;
  for (Index k = 0; k < pieces.place.cols(); ++k) {
    if (k % 4096 == 0) stop_if_requested();
    const Vec3 x = pieces.place.col(k), area = pieces.area.col(k);
    if (!may_contact(x, area.normalized())) continue;
    taken.push_back(k);
    node.push_back(nodes.nearest(x, 1).front());
  }
  if (taken.empty()) return result;
  result.between = pieces.place(Eigen::all, taken);
  const Points area = pieces.area(Eigen::all, taken);
  result.at_between = surface_interpolation(model, result.between, area);
  const auto of_node = by_node(node, area);
  std::vector<double> spacing;
  const PiecesOfSamples cells = samples_of(model, of_node, node, area, result.at_between, most, spacing);
  static_cast<CellMeans&>(result) =
      means_of(cells, result.between, area, result.at_between, model.node_count());
  // Leaves out the pieces that the base holds.
  std::vector<Index> kept;
  for (const std::vector<Index>& own : cells) kept.insert(kept.end(), own.begin(), own.end());
  std::sort(kept.begin(), kept.end());
  result.between = Points(result.between(Eigen::all, kept));
  result.at_between = surface_interpolation(model, result.between, Points(area(Eigen::all, kept)));
  result.sample_of.resize(static_cast<Index>(kept.size()));
  result.fraction.resize(result.sample_of.size());
  for (std::size_t c = 0; c < cells.size(); ++c)
    for (const Index k : cells[c]) {
      const Index at = std::lower_bound(kept.begin(), kept.end(), k) - kept.begin();
      result.sample_of[at] = static_cast<int>(c);
      result.fraction[at] = area.col(k).norm() / result.area[static_cast<Index>(c)];
    }
  result.spacing = Eigen::Map<Eigen::VectorXd>(spacing.data(), static_cast<Index>(spacing.size()));
  result.beyond.resize(3, 0);
  result.at_beyond = surface_interpolation(model, result.beyond, result.beyond);
  look_around(result);
  return result;
}

}  // namespace dimple
