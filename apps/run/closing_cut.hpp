#pragma once

#include <string>

#include "preprocess/supports/support.hpp"
#include "solver/march.hpp"

namespace dimple {

/// Whether the banks of a cut pass through each other under the load, which nothing keeps apart or contact at
/// other places than these: on samples of each bank, against the plane of the bank that was opposite at rest.
class ClosingCut {
 public:
  /// `gap` [m]: what was between the banks at rest.
  ClosingCut(const Model& model, double gap);
  void see(const Frame& frame);
  /// A warning, if a hundredth of the banks' area or more does so; empty: less, or there are none.
  std::string warning() const;
  /// How far the one came into the other at most [m].
  double deepest() const { return worst_; }

 private:
  Interpolation at_;      // three corners of each sample, then the place opposite
  Points place_;          // [3 x 4 samples] of the same, at rest [m]
  Eigen::VectorXd area_;  // [samples]
  double gap_ = 0.0;      // [m]
  double worst_ = 0.0;    // [m] at any frame
  double share_ = 0.0;    // of the area, there
  double depth_ = 0.0;    // of the tool [m], there
};

}  // namespace dimple
