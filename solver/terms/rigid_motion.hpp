#pragma once

#include <Eigen/Geometry>

#include "io/types.hpp"

namespace dimple {

/// [3x3] of a rotation vector, whose length is the angle [rad], right-handed.
inline Mat3 rotation(const Vec3& vector) {
  const double angle = vector.norm();
  return angle > 0.0 ? Eigen::AngleAxisd(angle, vector / angle).toRotationMatrix() : Mat3::Identity().eval();
}

/// Rotation vector of a rotation matrix, of an angle of pi at most.
inline Vec3 rotation_vector(const Mat3& turned) {
  const Eigen::AngleAxisd whole(turned);
  return whole.angle() * whole.axis();
}

/// Motion of a rigid body in a step of a scene. At the beginning its tip is at p and its rotation is R; after
/// a path of s [m] about c = p + `arm` they are
///
///     p(s) = c + exp(s turn) (p - c) + s motion,   R(s) = exp(s turn) R
struct RigidMotion {
  Vec3 initial_displacement = Vec3::Zero();  ///< displacement of the tip since its first pose [m]
  Mat3 turned = Mat3::Identity();            ///< rotation since the first pose
  Vec3 motion = Vec3::Zero();                ///< [m] per metre of the path
  Vec3 turn = Vec3::Zero();                  ///< rotation vector, likewise [rad]
  Vec3 arm = Vec3::Zero();                   ///< from the tip at the beginning to the centre of rotation [m]

  bool turns() const { return !turn.isZero(0.0); }
  bool has_turned() const { return turns() || turned != Mat3::Identity(); }
  Vec3 by_turning(double s) const { return arm - rotation(s * turn) * arm; }
  Vec3 displacement_at(double s) const {
    Vec3 now = s * motion;
    if (turns()) now += by_turning(s);
    return initial_displacement.isZero(0.0) ? now : Vec3(initial_displacement + now);
  }
  Mat3 turned_at(double s) const { return turns() ? Mat3(rotation(s * turn) * turned) : turned; }
  /// dp/ds.
  Vec3 speed_at(double s) const {
    return turns() ? Vec3(motion - turn.cross(rotation(s * turn) * arm)) : motion;
  }
};

}  // namespace dimple
