#pragma once

#include "solver/march.hpp"

namespace dimple {

/// Ledger of one march: force on the tool and energies over time, work done on the body, and the worst point
/// or step. The march's Account holds what the next step needs, its History the rest.
class Ledger {
 public:
  Ledger(const System& system, const SolverOptions& options, const Observer& observer, Account& account,
         History& history)
      : system_(system), options_(options), observer_(observer), account_(account), history_(history) {}

  /// Mean of the force that does work on the path, between the last call and f [4xN] N now [N].
  double mean_force(const Nodal& f);
  void add_work(double joules);  ///< external work

  bool force_is_due(double t) const { return t >= account_.next_sample; }
  bool energy_is_due(double t) const { return t >= account_.next_energy; }
  /// Due times are one interval after `t` [s].
  void next_force_after(double t) { account_.next_sample = t + 1.0 / options_.sample_rate; }
  void next_energy_after(double t) { account_.next_energy = t + 1.0 / options_.energy_rate; }

  /// Sample at displacements u [4xN] m with the force f [4xN] N.
  ForceSample force(const Moment& now, const Nodal& u, const Nodal& f) const;
  /// Adds a sample to the curve, and the present forces on the walls.
  void add(const ForceSample& sample) const;
  /// Adds a sample as add() does, and updates the largest reaction and the largest momentum error from f.
  void write(const ForceSample& sample, const Nodal& f);
  /// Passes the last sample to the observer. False: it stops the run.
  bool show_force() const { return !observer_.sample || observer_.sample(history_.force.back(), history_); }

  /// Energies at one time, with further `work` and frictional dissipation `dissipation` [J] that are not
  /// booked yet.
  EnergySample energy(const Moment& now, double kinetic, const StoredEnergy& stored, double work = 0.0,
                      double dissipation = 0.0) const;
  /// Books an energy sample with its work and dissipation.
  void write(const EnergySample& energy);

  void keep_worst(const ForceSystem::Sweep& sweep);  ///< its worst point, if worse than all before
  void note(const Retry& retry);

  /// State from which a run can continue.
  MarchState kept(const MarchState& state) const;

 private:
  const System& system_;
  const SolverOptions& options_;
  const Observer& observer_;
  Account& account_;
  History& history_;
};

}  // namespace dimple
