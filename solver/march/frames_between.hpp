#pragma once

#include "solver/equilibrium/relax.hpp"
#include "solver/march/ledger.hpp"
#include "solver/march/predictor.hpp"

namespace dimple {

/// Frame `number` of the history, at displacements u [4xN] m with the force f [4xN] N.
Frame frame_of(const System& system, int number, const Moment& at, const Nodal& u, const Nodal& f);

/// Output frames at depths between two equilibria; they do not affect the march.
struct FramesBetween {
  System& system;
  const Relaxation& relax;
  const Loading& loading;
  const SolverOptions& options;
  const Observer& observer;
  const Ledger& ledger;
  History& history;

  double travel_of(int frame) const { return loading.depth / options.frames * frame; }

  /// Shows the frames after `last` up to a depth. `path` holds the equilibria on both sides; the tissue's
  /// history ends at `from`. False: the observer stops the run.
  bool show(int& last, double before, double from, const Predictor& path);

 private:
  bool find(EquilibriumState& now, Nodal& f);
  void report_interpolated_frames(double depth);
};

}  // namespace dimple
