#pragma once

#include <string>
#include <vector>

#include "solver/march.hpp"

namespace dimple {

/// Rigid-body motion of the tissue far from tool and base, in rotation and translation. A local indentation
/// leaves it nearly at rest; an organ that rocks or yields on its base moves it.
class RockingOfBody {
 public:
  explicit RockingOfBody(const Model& model);
  void see(const Frame& frame);
  /// A warning, if at the largest depth this motion is a tenth of it or more, and most of the motion there.
  /// Empty: it is less. Motion by loads before the tool's does not count.
  std::string warning() const;

 private:
  std::vector<Index> far_;           // nodes; none: too few are far from tool and base
  Points x_, preload_displacement_;  // [3 x far] at rest, and displacements before the tool has moved [m]
  double depth_ = 0.0;               // the largest [m]
  double rigid_ = 0.0;               // root mean square of the rigid motion then [m]
  double undeformed_ = 0.0;          // and of the remaining motion [m]
};

}  // namespace dimple
