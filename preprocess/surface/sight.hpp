#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "preprocess/model.hpp"
#include "preprocess/surface/sheet.hpp"
#include "preprocess/surface/surface_cells.hpp"

namespace dimple {

/// Does the straight way from x to y stay in the tissue? `spacing`: of the nodes there. Lengths in mm.
///
/// What leaves the body and comes back through a wall that faces the one it left by (a fold, a slit, two
/// lobes that lie side by side) is cut off, however narrow the gap is, down to a twenty-fifth of the spacing.
/// What cuts across a shallow hollow is not: a hollow counts where it is deeper than a tenth of the spacing
/// and than a fifth of the part of the way that lies in it, which a rounded surface's is not.
///
/// Source:   the visibility criterion: Belytschko, Lu, Gu 1994; Organ, Fleming, Terry, Belytschko 1996,
/// section 2. Departs:  it has a tolerance, for a surface of small triangles is nowhere quite convex. Their
/// diffraction method
///           (weights by the shortest way around the end of a gap, through a node that sees both) was
///           compared on slit blocks and a heart: 0.2 to 1.2 % stiffer with 2000 nodes or more and nearer to
///           one limit from above, but with 1000 nodes the heart is 4.6 % off instead of 0.9 and slits' seeds
///           scatter by up to 6 instead of 0.9 %, at more than twice the cost.
bool sees(const SurfaceCells& surface, const Vec3& x, const Vec3& y, double spacing);

/// Does x surely see all of the body within `radius`? If no triangle there turns its outer side towards x, by
/// more than the tolerance of sees().
bool sees_all_within(const SurfaceCells& surface, const Vec3& x, double radius, double spacing);

/// What the nodes of a model see. Lengths in metres.
class Sight {
 public:
  /// `radius` [N]: of the nodes' supports. The model has a surface.
  Sight(const Discretisation& model, const Eigen::VectorXd& radius);
  /// What is left of it with a sheet [m, LPS] between the nodes of `cut`, the first of them the same as
  /// before, and its points, each a part of one of those before: `whole` [Q]. `before`: null: nothing was
  /// hidden.
  Sight(std::shared_ptr<const Sight> before, std::shared_ptr<const Sheet> sheet, const Discretisation& cut,
        const Eigen::VectorXd& radius, std::vector<Index> whole);
  bool sees(Index node, Index point) const;  ///< a node and an integration point
  /// Does an integration point see x?
  bool point_sees(Index point, const Vec3& x) const;
  /// A node has nothing within its radius that it may not see.
  bool sees_all(Index node) const { return clear_radius_[node] > 0.0; }
  /// That have cut the body since its surface was laid, in their order [m, LPS].
  const std::vector<std::shared_ptr<const Sheet>>& sheets() const { return sheets_; }
  /// No node has.
  bool all_clear() const { return clear_radius_.minCoeff() > 0.0; }

 private:
  Points own(const Points& x) const;
  bool through_sheets(const Vec3& x, const Vec3& y) const;
  // Of a body that sheets have cut: these, what the body's surface hid before, and of each point that of the
  // body then. All else but X_, point_ and clear_radius_ is empty.
  std::vector<std::shared_ptr<const Sheet>> sheets_ = {};
  std::shared_ptr<const Sight> of_surface_ = {};  // null: nothing
  std::vector<Index> whole_ = {};                 // [Q]
  Mat3 axes_;
  Vec3 centre_;
  Eigen::VectorXd spacing_;                      // [N] m
  std::optional<SurfaceCells> surface_;          // like all places here in the body's own axes [mm]
  Points X_, point_;                             // nodes and points; of a sheet's [m, LPS]
  Eigen::VectorXd clear_radius_;                 // [N] within which a node sees everything [m]
  Eigen::VectorXd depth_;                        // [N] below the surface [m]
  Eigen::VectorXd point_depth_, point_spacing_;  // [Q] likewise; and of the nearest node [m]
};

}  // namespace dimple
