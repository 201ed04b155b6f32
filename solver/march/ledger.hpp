#pragma once

#include "solver/march.hpp"

namespace dimple {

/// The books of one march: the force on the tool and the energies over time, the work that was done on the
/// body, and the worst that any point or step has shown. What the next step needs of them stands in the
/// march's Account, the rest in its History.
class Ledger {
 public:
  Ledger(const System& system, const SolverOptions& options, const Observer& observer, Account& account,
         History& history)
      : system_(system), options_(options), observer_(observer), account_(account), history_(history) {}

  /// The mean of the force that does work on the tool's way, f [4xN] N now and at the last call [N].
  double mean_force(const Nodal& f);
  void add_work(double joules);  ///< done on the body from outside

  bool force_is_due(double t) const { return t >= account_.next_sample; }
  bool energy_is_due(double t) const { return t >= account_.next_energy; }
  /// The next are due an interval after `t` [s].
  void next_force_after(double t) { account_.next_sample = t + 1.0 / options_.sample_rate; }
  void next_energy_after(double t) { account_.next_energy = t + 1.0 / options_.energy_rate; }

  /// At displacements u [4xN] m with the force f [4xN] N.
  ForceSample force(const Moment& now, const Nodal& u, const Nodal& f) const;
  /// Takes a sample into the curve, and what the walls feel now beside it.
  void add(const ForceSample& sample) const;
  /// The same, and f into the largest error of the momentum so far.
  void write(const ForceSample& sample, const Nodal& f);
  /// Shows the last sample. False: the observer has enough.
  bool show_force() const { return !observer_.sample || observer_.sample(history_.force.back(), history_); }

  /// As if this work and this heat [J] came to what is written already.
  EnergySample energy(const Moment& now, double kinetic, const StoredEnergy& stored, double work = 0.0,
                      double heat = 0.0) const;
  /// Takes it, and its work and heat, into the books.
  void write(const EnergySample& energy);

  void keep_worst(const ForceSystem::Sweep& sweep);  ///< its worst point, if it is worse than those before
  void note(const Retry& retry);

  /// All that a run needs which goes on from here.
  MarchState kept(const MarchState& state) const;

 private:
  const System& system_;
  const SolverOptions& options_;
  const Observer& observer_;
  Account& account_;
  History& history_;
};

}  // namespace dimple
