#pragma once

#include <string>

#include "solver/terms/membrane.hpp"

namespace dimple {

/// A pressure on a patch of the surface, inward where it is positive.
struct SurfacePressure {
  std::string name;
  SurfacePatch patch;
  double pressure = 0.0;  ///< [Pa]
  bool follows =
      true;  ///< it acts on the deformed surface along its normals; false: on that at rest, and stays so
};

/// What acts on a body before a tool touches it, and goes on acting.
struct Loads {
  Vec3 gravity = Vec3::Zero();  ///< [m/s^2]
  std::vector<SurfacePressure> pressure;
  std::vector<Membrane> membrane = {};
  bool none() const { return gravity.isZero(0.0) && pressure.empty() && membrane.empty(); }
  /// Whether the body comes to rest under it first: a membrane without tension leaves it where it is.
  bool move_the_body() const;
};
ForceTerms make_terms(const Model& model, const Loads& loads);

/// Forces [4xN] N that stay what they are: energy -force . u.
std::unique_ptr<ForceTerm> dead_load(Nodal force);

}  // namespace dimple
