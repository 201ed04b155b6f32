#pragma once

#include <string>

#include "preprocess/supports/support.hpp"
#include "solver/march.hpp"

namespace dimple {

/// Penetration of the faces of a cut under the load, without contact or between contact points. Samples of
/// each face are compared with the plane of the face opposite at rest.
class ClosingCut {
 public:
  /// `gap` [m]: distance of the faces at rest.
  ClosingCut(const Model& model, double gap);
  void see(const Frame& frame);
  /// A warning, if a hundredth of the faces' area or more penetrates; empty: less, or there is no cut.
  std::string warning() const;
  /// Largest penetration [m].
  double deepest() const { return worst_; }

 private:
  Interpolation at_;       // three corners of each sample, then the point opposite
  Points place_;           // [3 x 4 samples] the same at rest [m]
  Eigen::VectorXd area_;   // [samples]
  double gap_ = 0.0;       // [m]
  double worst_ = 0.0;     // [m] in any frame
  double fraction_ = 0.0;  // of the area, in that frame
  double depth_ = 0.0;     // of the tool in that frame [m]
};

}  // namespace dimple
