#pragma once

#include <optional>
#include <string>

#include "preprocess/supports/interpolation.hpp"
#include "solver/terms/membrane.hpp"

namespace dimple {

/// A pressure on a patch of the surface, inward where it is positive.
struct SurfacePressure {
  std::string name;
  SurfacePatch patch;
  double pressure = 0.0;  ///< [Pa]
  bool follows =
      true;  ///< normal to the deformed surface at every state; false: dead, normal to the surface at rest
  bool around = false;  ///< on the entire surface
};

/// A fluid in which the body was in equilibrium with its weight, and whose level has fallen: the lost
/// buoyancy above the level acts. (The pressure below falls by the same amount everywhere, which does not
/// move incompressible tissue.)
struct FluidLost {
  Vec3 up = Vec3::UnitZ();     ///< unit vector, against gravity
  double level = 0.0;          ///< along it, of the fluid that is left [m]
  double density = 1007.0;     ///< of the fluid [kg/m^3]: cerebrospinal fluid
  double acceleration = 9.81;  ///< [m/s^2]
};

/// [4xN] N: the nodes of each integration point bear the part of its cell above the level.
Nodal lost_buoyancy(const Model& model, const FluidLost& fluid);

/// A dead load per reference volume of all tissue that varies linearly in space.
struct BodyForce {
  std::string name;
  Vec3 force = Vec3::Zero();     ///< at the place `at` [N/m^3]
  Mat3 gradient = Mat3::Zero();  ///< change of each component, a row, per metre along x, y, z [N/m^4]
  Vec3 at = Vec3::Zero();        ///< [m]
};

/// [4xN] N: sum_q V_q phi_a(X_q) f(X_q), consistent with the displacement field. `to_points`: the shape
/// functions at the integration points, of point_interpolation().
Nodal nodal_force(const Model& model, const Interpolation& to_points, const BodyForce& body);

/// Loads that act before first contact of the tool and continue to act.
struct Loads {
  Vec3 gravity = Vec3::Zero();  ///< [m/s^2]
  std::vector<SurfacePressure> pressure;
  std::vector<Membrane> membrane = {};
  std::optional<FluidLost> fluid = {};
  struct OnNodes {
    BodyForce body;
    Nodal force;  ///< of nodal_force()
  };
  std::vector<OnNodes> body_force = {};
  bool none() const {
    return gravity.isZero(0.0) && pressure.empty() && membrane.empty() && !fluid && body_force.empty();
  }
  /// True if the loads displace the body before the tool moves; a membrane without tension does not.
  bool move_the_body() const;
};
ForceTerms make_terms(const Model& model, const Loads& loads);

/// Constant forces [4xN] N, with the energy -force . u.
std::unique_ptr<ForceTerm> dead_load(Nodal force);

}  // namespace dimple
