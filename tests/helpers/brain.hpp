#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <random>

#include "io/label_image.hpp"
#include "tests/helpers/image.hpp"

namespace dimple {

using Inside = std::function<bool(const Vec3&)>;

/// Image of a body within `reach` of the origin, in voxels of edge h whose lattice is rotated by `grid`.
inline LabelImage image_of(const Inside& inside, double reach, double h,
                           const Mat3& grid = Mat3::Identity()) {
  const auto n = static_cast<Index>(2.0 * std::ceil(reach / h)) + 2;
  Eigen::Affine3d to_world = Eigen::Affine3d::Identity();
  to_world.linear() = h * grid;
  // The offset gives the body no special position in the lattice.
  to_world.translation() =
      -h * grid * (Vec3::Constant(0.5 * static_cast<double>(n - 1)) + Vec3(0.13, 0.29, 0.41));
  LabelImage image = image_of({n, n, n}, Vec3::Ones(), [&](Index i, Index j, Index k) {
    return inside(to_world * place_of(i, j, k));
  });
  image.to_world = to_world;
  return image;
}

inline Mat3 random_rotation(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const double w = normal(random), x = normal(random), y = normal(random), z = normal(random);
  return Eigen::Quaterniond(w, x, y, z).normalized().toRotationMatrix();
}

/// Two hemispheres on a flat cut face at z = 0, the left one `higher` by this part; 84 x 62 x 30 mm. The
/// fissure is 4 mm wide at half its depth: two voxels of 2 mm.
inline bool in_brain(const Vec3& x, double higher) {
  if (x.z() < 0.0) return false;
  const double u = std::max(0.0, std::abs(x.x()) - 5.0) / 26.0, v = (x.y() - higher * 30.0) / 42.0;
  const double rho2 = u * u + v * v;
  if (rho2 >= 1.0) return false;
  const double dome = 30.0 * std::sqrt(1.0 - rho2) * (1.0 + (x.x() > 0.0 ? higher : 0.0));
  return x.z() < dome * (1.0 - 0.3 * std::exp(-std::pow(x.x() / 2.5, 2)));
}

/// Number of random rotations in a test: DIMPLE_ROTATIONS, or `usual`.
inline int rotations(int usual) {
  const char* requested = std::getenv("DIMPLE_ROTATIONS");
  return requested ? std::atoi(requested) : usual;
}

}  // namespace dimple
