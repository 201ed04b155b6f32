#pragma once

#include <Eigen/Core>

namespace dimple {

using Index = Eigen::Index;
using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;
using Points = Eigen::Matrix3Xd;  ///< [3xN] positions or vectors
using Triangles =
    Eigen::Matrix<Index, 3, Eigen::Dynamic>;  ///< [3xT] corner numbers, outward when counted anticlockwise

}  // namespace dimple
