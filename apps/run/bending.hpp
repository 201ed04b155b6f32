#pragma once

#include <string>
#include <vector>

#include "solver/march.hpp"

namespace dimple {

/// Bending or shift of the part under the tool instead of indentation. It is measured on the other side: the
/// motion of the surface where the press direction first leaves the body.
class BendingOfPart {
 public:
  explicit BendingOfPart(const Model& model);
  void see(const Frame& frame);
  /// A warning if this is half of the tool's depth or more; empty: less, or not observed. The preload
  /// displacement does not count.
  std::string warning() const;

 private:
  const Vec3 approach_;
  std::vector<Index> opposite_;        // nodes; none: the model has no surface
  double thickness_ = 0.0;             // [m]
  double diameter_ = 0.0;              // [m]
  double depth_ = 0.0, moved_ = 0.0;   // [m]
  double preload_displacement_ = 0.0;  // moved_ under the loads alone [m]
};

}  // namespace dimple
