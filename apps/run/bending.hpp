#pragma once

#include <string>
#include <vector>

#include "solver/march.hpp"

namespace dimple {

/// How much of the push bends or shifts the part under the tool, and does not indent it: how far the surface
/// on its other side, where the push through the tool's centre first leaves the body, moves along the push.
class BendingOfPart {
 public:
  explicit BendingOfPart(const Model& model);
  void see(const Frame& frame);
  /// A warning, if it is half of the push or more; empty: it is less, or nothing was seen. Loads that act
  /// before the tool moves have moved that surface too, which does not count.
  std::string warning() const;

 private:
  const Vec3 push_;
  std::vector<Index> opposite_;       // nodes; none: the model has no surface
  double thickness_ = 0.0;            // [m]
  double diameter_ = 0.0;             // [m]
  double depth_ = 0.0, moved_ = 0.0;  // [m]
  double settled_ = 0.0;              // of moved_, before the tool has moved [m]
};

}  // namespace dimple
