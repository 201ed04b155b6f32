#pragma once

#include "solver/march.hpp"

namespace dimple {

/// The steps of a scene one after the other, each marched quasi-statically from the equilibrium that the last
/// one ended at: history, time and frames go on. Frames are shared out by the steps' ways, at least one for
/// each. Needs: loading.steps, all of them with a way, and what they name among loading.further.
void march_in_steps(System& system, const Loading& loading, const SolverOptions& options,
                    const Observer& observer, History& history, const MarchState* from = nullptr);

/// The frames of each step, of `frames` in all or as many as there are steps.
std::vector<int> frames_of_steps(const std::vector<Step>& steps, int frames);

/// How far the set of that name (empty: the tool) has come, after `come` [m] of all steps' ways.
Vec3 moved(const std::vector<Step>& steps, std::string_view name, double come);

}  // namespace dimple
