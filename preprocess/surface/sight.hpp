#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "preprocess/model.hpp"
#include "preprocess/surface/sheet.hpp"
#include "preprocess/surface/surface_cells.hpp"

namespace dimple {

/// Visibility criterion: does the straight segment from x to y stay in the tissue? `spacing`: of the nodes
/// there. Lengths in mm.
/// 1. Crossings of the segment, lengthened by 1e-4 at both ends, with the surface, in order.
/// 2. Each part outside, from an exit to the next entry or to the end, is examined; parts shorter than a
///    twenty-fifth of the spacing do not count. Depth: distance of the part's middle from the surface.
/// 3. Walls that face each other (cosine of their normals below -0.3: a fold, a slit, two lobes side by side)
///    hide y if the depth exceeds 0.02 spacings.
/// 4. Other parts are hollows: they hide y if the depth exceeds 0.1 spacings and 0.2 lengths of the part. The
///    hollows of a rounded surface do not.
///
/// Source: the visibility criterion: Belytschko, Lu, Gu 1994; Organ, Fleming, Terry, Belytschko 1996 (section
/// 2). Departs: tolerances, since a surface of small triangles is nowhere quite convex. Their diffraction
/// method takes weights by the shortest path around the end of a gap, through a node that sees both. It was
/// compared on slit blocks and a heart. With 2000 nodes or more it is 0.2 to 1.2 % stiffer and nearer to one
/// limit from above. With 1000 nodes the heart is 4.6 % off instead of 0.9 %, and seeds of slits scatter by
/// up to 6 % instead of 0.9 %. It costs over twice as much.
bool sees(const SurfaceCells& surface, const Vec3& x, const Vec3& y, double spacing);

/// Does x surely see all of the body within `radius`? True if x is above no triangle there by more than the
/// tolerance of sees().
bool sees_all_within(const SurfaceCells& surface, const Vec3& x, double radius, double spacing);

/// Visibility between nodes and points of a model: sees(), and no crossing of any sheet. Lengths in metres.
class Sight {
 public:
  /// `radius` [N]: of the nodes' supports. The model has a surface.
  Sight(const Discretisation& model, const Eigen::VectorXd& radius);
  /// Visibility after a sheet [m, LPS] has cut the nodes of `cut`, the first of which are those before. Each
  /// of its points is a part of point `whole` [Q] before. `before`: null: nothing was hidden.
  Sight(std::shared_ptr<const Sight> before, std::shared_ptr<const Sheet> sheet, const Discretisation& cut,
        const Eigen::VectorXd& radius, std::vector<Index> whole);
  bool sees(Index node, Index point) const;  ///< of an integration point from a node
  /// Does an integration point see x?
  bool point_sees(Index point, const Vec3& x) const;
  /// True if a node sees everything within its radius.
  bool sees_all(Index node) const { return clear_radius_[node] > 0.0; }
  /// Sheets that have cut the body since its surface was made, in their order [m, LPS].
  const std::vector<std::shared_ptr<const Sheet>>& sheets() const { return sheets_; }
  /// True if that holds for all nodes.
  bool all_clear() const { return clear_radius_.minCoeff() > 0.0; }

 private:
  Points own(const Points& x) const;
  bool through_sheets(const Vec3& x, const Vec3& y) const;
  // Members for a body that sheets have cut: the sheets, the visibility by the body's surface, and each
  // point's number then. All others but X_, point_ and clear_radius_ are empty.
  std::vector<std::shared_ptr<const Sheet>> sheets_ = {};
  std::shared_ptr<const Sight> of_surface_ = {};  // null: nothing
  std::vector<Index> whole_ = {};                 // [Q]
  Mat3 axes_;
  Vec3 centre_;
  Eigen::VectorXd spacing_;                      // [N] m
  std::optional<SurfaceCells> surface_;          // in the body's own axes [mm], like all places here
  Points X_, point_;                             // nodes and points; of a sheet's [m, LPS]
  Eigen::VectorXd clear_radius_;                 // [N] within which a node sees everything [m]
  Eigen::VectorXd depth_;                        // [N] below the surface [m]
  Eigen::VectorXd point_depth_, point_spacing_;  // [Q] likewise; and of the nearest node [m]
};

}  // namespace dimple
