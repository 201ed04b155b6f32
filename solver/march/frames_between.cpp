#include "solver/march/frames_between.hpp"

#include <algorithm>

#include "io/error.hpp"
#include "solver/march/quasi_static.hpp"
#include "solver/text.hpp"

namespace dimple {

Frame frame_of(const System& system, int number, const Moment& at, const Nodal& u, const Nodal& f) {
  Frame frame{number, at.t, at.depth, u, f, system.tissue()};
  frame.aside = system.aside();
  frame.turned = system.turned();
  frame.tool = system.tool_contact();
  frame.walls = system.walls();
  if (frame.tool) frame.contact_force = system.along_approach(f);
  return frame;
}

bool FramesBetween::show(int& last, double before, double from, const Predictor& path) {
  EquilibriumState now{path.point.back().u, path.point.back().lambda};
  Nodal f = now.u;
  for (; last < options.frames && travel_of(last + 1) < before; ++last) {
    const double travel = travel_of(last + 1);
    const Moment at{loading.t_at(travel), loading.depth_at(travel)};
    system.begin_step((travel - from) / loading.rate);
    const std::int64_t swept = system.tissue().sweeps();
    path.extrapolate(travel, now.u, now.lambda);
    system.project_to_admissible(now.lambda);
    system.set({.t = at.t, .depth = travel}, now.u);
    const bool found = find(now, f);
    history.extra_evaluations += system.tissue().sweeps() - swept;
    if (found)
      ledger.add(ledger.force(at, now.u, f));
    else
      report_interpolated_frames(at.depth);
    if (observer.frame) observer.frame(frame_of(system, loading.start.frame + last + 1, at, now.u, f));
    if (found && !ledger.show_force()) return false;
  }
  return true;
}

// False: none was found, and `now` is unchanged. A mixed search starts nearby, so that it gets twice the
// average evaluations of a load step.
bool FramesBetween::find(EquilibriumState& now, Nodal& f) {
  const EquilibriumState guess = now;
  try {
    const bool mixed = relax.has_mixed();
    const RelaxOptions how{
        .tolerance = options.tolerance,
        .evaluations = mixed ? std::min(options.evaluations, 2 * evaluations_of_step) : options.evaluations};
    if ((mixed ? relax.from_near(now.u, now.lambda, f, how) : relax(now.u, f, how, &now.lambda)).converged)
      return true;
  } catch (const SolveError&) {
  }
  now = guess;
  system.force_at(now.u, now.lambda, f);
  return false;
}

void FramesBetween::report_interpolated_frames(double depth) {
  if (std::any_of(history.guards.begin(), history.guards.end(),
                  [](const Finding& f) { return f.report.code == "frame"; }))
    return;
  history.guards.push_back(
      {.report = {.fact = text("the frame at ", 1e3 * depth, " mm shows the line between two equilibria"),
                  .where = "static solver",
                  .why = "no equilibrium was found at its depth; the force curve omits it",
                  .remedy = "use the frames before and after it, or choose other --frames",
                  .code = "frame"},
       .worst = depth});
}

}  // namespace dimple
