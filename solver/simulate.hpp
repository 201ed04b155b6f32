#pragma once

#include <functional>
#include <vector>

#include "solver/constraints.hpp"
#include "solver/guards.hpp"
#include "solver/stable_time_step.hpp"

namespace dimple {

/// How the tool moves: straight, at constant speed, from touching to `depth`.
struct Loading {
  double depth = 8e-3;  ///< [m]
  double rate = 1e-3;   ///< [m/s]
  Contact contact = Contact::bonded;
  double duration() const { return depth / rate; }
};

struct SolverOptions {
  double safety = 0.9;               ///< time step = safety x stable step
  double damping = 0.0;              ///< mass-proportional [1/s]
  int frames = 16;                   ///< after the first; the step is re-estimated at each
  double sample_rate = 150.0;        ///< of the force [1/s]; the paper's sensor
  double energy_rate = 20.0;         ///< of the energies [1/s]
  double tolerance = 1e-4;           ///< of static equilibrium: unbalanced force / reactions
  std::int64_t evaluations = 20000;  ///< of the force for one static equilibrium, at most
  bool guards = true;                ///< false: only to measure what they cost
};

/// The tool at one time. Forces are components along the push, positive when tissue resists.
struct ForceSample {
  double t, depth;    ///< [s], [m]
  double force;       ///< on the circle's nodes [N]
  double base_force;  ///< on the base's nodes, with which the bed holds the body [N]
};

/// The body at one time.
struct Frame {
  int number;
  double t, depth;
  const ForceSystem::Nodal& u;  ///< [N] m
  const ForceSystem::Nodal& f;  ///< [N] N, internal force at u; on held nodes it is the reaction
};

struct History {
  std::vector<ForceSample> force;
  std::vector<EnergySample> energy;
  std::int64_t steps = 0;
  std::int64_t extra_evaluations = 0;                               ///< of the force, for the stable step
  double dt_stable_first = 0.0, dt_first = 0.0, dt_smallest = 0.0;  ///< [s]
  double J_min = 1.0;                                               ///< smallest det F at any point and step
  Index inverted = 0;     ///< most points that were inside out at once
  double residual = 0.0;  ///< largest that a static equilibrium was left with
  bool interrupted = false;
  double momentum_error = 0.0;  ///< largest |sum of internal forces| / largest single reaction
  std::vector<Finding> guards;
  std::vector<Retry> retries;
};

struct Observer {
  std::function<void(const Frame&)> frame;
  std::function<bool(const ForceSample&, const History&)> sample;  ///< false: stop here, keep what there is
  std::function<void(const Retry&)> retry = {};
};

/// Marches the paper's explicit scheme: central differences in leapfrog form,
///
///     v(t + dt/2) = v(t - dt/2) + dt M^-1 (R - f(u(t))),   u(t + dt) = u(t) + dt v(t + dt/2),
///
/// then the prescribed displacements are put in place. Eliminating v gives the printed form
/// u(t + dt) = dt^2 M^-1 (R - f) + 2 u(t) - u(t - dt); stored velocities keep more digits and let dt change.
///
/// Source:   Horton et al. 2007, sections 2.3 and 3.2.
/// Departs:  the step is computed, and again at every frame under load; the paper does not say how it chose
/// its own. Where a guard says that the number would be wrong, the march goes back to the last frame and
/// takes smaller steps from there on; at most `most_retries` times. Throws:   SolveError: it came again.
/// `history` then holds everything up to the last frame.
void simulate(const ForceSystem& system, const Model& model, const Loading& loading,
              const SolverOptions& options, const Observer& observer, History& history);

}  // namespace dimple
