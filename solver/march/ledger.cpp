#include "solver/march/ledger.hpp"

#include <algorithm>
#include <cmath>

namespace dimple {

double Ledger::mean_force(const Nodal& f) {
  const double now = system_.force_along_motion(f), mean = 0.5 * (now + account_.force_before);
  account_.force_before = now;
  return mean;
}

void Ledger::add_work(double joules) {
  account_.external += joules;
  account_.largest_external = std::max(account_.largest_external, std::abs(account_.external));
}

ForceSample Ledger::force(const Moment& now, const Nodal& u, const Nodal& f) const {
  const Model& model = system_.model();
  ForceSample sample{now.t, now.depth, system_.along_approach(f), -along_approach(model, model.base, f)};
  Eigen::Map<Wrench>(sample.on_tool.data()) = system_.on_tool(u, f);
  Eigen::Map<Vec3>(sample.aside.data()) = system_.aside();
  Eigen::Map<Vec3>(sample.turned.data()) = system_.turned();
  return sample;
}

void Ledger::add(const ForceSample& sample) const {
  history_.force.push_back(sample);
  for (const RigidContact* wall : system_.walls())
    Eigen::Map<Wrench>(history_.on_walls.emplace_back().data()) = wall->on_tool(system_.now());
}

void Ledger::write(const ForceSample& sample, const Nodal& f) {
  add(sample);
  account_.largest_reaction = std::max(account_.largest_reaction, std::abs(sample.force));
  if (account_.largest_reaction > 0.0)
    history_.momentum_error =
        std::max(history_.momentum_error, system_.spurious_resultant(f) / account_.largest_reaction);
}

EnergySample Ledger::energy(const Moment& now, double kinetic, const StoredEnergy& stored, double work,
                            double dissipation) const {
  return {
      now.t, now.depth, kinetic, stored.sum(), account_.external + work, account_.dissipated + dissipation};
}

void Ledger::write(const EnergySample& energy) {
  account_.external = energy.external;
  account_.dissipated = energy.dissipated;
  account_.largest_external = std::max(account_.largest_external, std::abs(account_.external));
  history_.energy.push_back(energy);
}

void Ledger::keep_worst(const ForceSystem::Sweep& sweep) {
  history_.J_min = std::min(history_.J_min, sweep.J_min);
  history_.inverted = std::max(history_.inverted, sweep.inverted);
}

void Ledger::note(const Retry& retry) {
  history_.retries.push_back(retry);
  if (observer_.retry) observer_.retry(history_.retries.back());
}

MarchState Ledger::kept(const MarchState& state) const {
  MarchState copy = state;
  copy.past = system_.past();
  copy.history = history_;
  return copy;
}

}  // namespace dimple
