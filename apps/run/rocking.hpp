#pragma once

#include <string>
#include <vector>

#include "solver/march.hpp"

namespace dimple {

/// How far tissue that is far from the tool and from the base moves as a body, in rotation and translation. A
/// local dent leaves it nearly at rest; an organ that rocks or yields on its base takes it along.
class RockingOfBody {
 public:
  explicit RockingOfBody(const Model& model);
  void see(const Frame& frame);
  /// A warning, if at the deepest push it is a tenth of that or more, and most of what moves there; empty: it
  /// is less. What loads moved before the tool does not count.
  std::string warning() const;

 private:
  std::vector<Index> far_;  // nodes; none: too few are far from tool and base
  Points x_, settled_;      // [3 x far] at rest, and displacements before the tool has moved [m]
  double depth_ = 0.0;      // the deepest [m]
  double rigid_ = 0.0;      // root mean square of the rigid motion there [m]
  double rest_ = 0.0;       // and of what is left [m]
};

}  // namespace dimple
