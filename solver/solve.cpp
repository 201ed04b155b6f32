#include "solver/solve.hpp"

#include <algorithm>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/equilibrium/mixed_iteration.hpp"
#include "solver/equilibrium/stable_time_step.hpp"
#include "solver/march/explicit.hpp"
#include "solver/march/quasi_static.hpp"
#include "solver/march/steps.hpp"
#include "solver/text.hpp"

namespace dimple {

std::string_view name_of(TimeMode mode) {
  switch (mode) {
    case TimeMode::quasi_static:
      return "quasi-static";
    case TimeMode::explicit_:
      return "explicit";
  }
  return "";
}

namespace {
constexpr double shallow = 0.5;  // radii of the bonded patch: see choose_time()
}

double shear_crossings(const Model& model, const Tissues& tissues, const Loading& loading) {
  return loading.duration() / shear_crossing_time(tissues, model);
}

TimeMode choose_time(const Model& model, const Tissues& tissues, const Loading& loading) {
  Loading no_shallower = loading;
  no_shallower.depth = std::max(loading.depth, shallow * model.tool.radius);
  const bool slow = shear_crossings(model, tissues, no_shallower) >= slow_load;
  return model.scheme.pressure_patches && slow ? TimeMode::quasi_static : TimeMode::explicit_;
}

namespace {

Vec3 mean_on(const std::vector<Index>& nodes, const Nodal& u) {
  Vec3 sum = Vec3::Zero();
  for (const Index a : nodes) sum += u.col(a).head<3>();
  return nodes.empty() ? sum : Vec3(sum / static_cast<double>(nodes.size()));
}

void refuse_contact(TimeMode mode, const ForceSystem& tissue, const Model& model) {
  const char* what = mode != TimeMode::quasi_static ? "inertia"
                     : !MixedIteration::serves(tissue, model)
                         ? "a scheme or a tissue without patches of pressure"
                         : nullptr;
  if (!what) return;
  throw SolveError({.fact = text("a contacting tool is requested together with ", what),
                    .where = text("time ", name_of(mode), ", tool"),
                    .why = "its contact is solved in equilibrium, straight from first contact",
                    .remedy = "leave out one of the two",
                    .code = "touch"});
}

}  // namespace

void equilibrium_under_loads(const ForceSystem& tissue, const Model& model, Loading& loading,
                             double tolerance) {
  if (!loading.indenter || !loading.loads.move_the_body()) return;
  const auto system = make_system(tissue, model, loading.contact, loading.further, loading.loads, tolerance,
                                  loading.indenter.get(), loading.folds, loading.walls);
  loading.preloaded =
      std::make_shared<const PreloadedState>(PreloadedState{system->step_start(), system->past()});
  auto there = std::make_shared<RigidBody>(*loading.indenter);
  there->pose = first_contact(*there, loading.preloaded->state.u);
  loading.indenter = std::move(there);
}

void solve(TimeMode mode, const ForceSystem& tissue, const Model& model, const Loading& loading,
           const SolverOptions& options, const Observer& observer, History& history, const MarchState* from,
           ScenePart* part) {
  if (!loading.steps.empty() && mode != TimeMode::quasi_static)
    throw SolveError({.fact = "a scene of steps is requested with inertia",
                      .where = text("time ", name_of(mode)),
                      .why = "steps go from equilibrium to equilibrium; with inertia its nodes would change "
                             "their speed instantly at a corner of the path",
                      .remedy = "march it quasi-statically (--time quasi-static)",
                      .code = "steps"});
  if (loading.indenter) refuse_contact(mode, tissue, model);
  if (loading.folds && (mode != TimeMode::quasi_static || !MixedIteration::serves(tissue, model)))
    throw SolveError({.fact = "contact between folds is requested in a march or a scheme without contact",
                      .where = text("time ", name_of(mode)),
                      .why = "their contact is solved in equilibrium, with the patches' pressures",
                      .remedy = "march quasi-statically with the converging scheme, or turn self-contact off",
                      .code = "folds"});
  if (!loading.walls.empty() && (mode != TimeMode::quasi_static || !MixedIteration::serves(tissue, model)))
    throw SolveError({.fact = "walls are given in a march or a scheme without contact",
                      .where = text("time ", name_of(mode)),
                      .why = "their contact is solved in equilibrium, with the patches' pressures",
                      .remedy = "march quasi-statically with the converging scheme, or leave the walls out",
                      .code = "walls"});
  try {
    const std::unique_ptr<System> system =
        make_system(tissue, model, loading.contact, loading.further, loading.loads, options.tolerance,
                    loading.indenter.get(), loading.folds, loading.walls, loading.preloaded.get());
    if (!from && (!part || !part->near)) {
      const Nodal& u = system->step_start().u;
      history.preload_displacement = u.colwise().norm().maxCoeff();
      history.carried = mean_on(model.bonded_patch, u);
    }
    switch (mode) {
      case TimeMode::quasi_static:
        if (!loading.steps.empty())
          return march_in_steps(*system, loading, options, observer, history, from, part);
        return march_quasi_statically(*system, loading, options, observer, history, from);
      case TimeMode::explicit_:
        return march_explicitly(*system, loading, options, observer, history, from);
    }
  } catch (const Stopped&) {
    history.interrupted = true;
  }
}

History solve(const Model& model, const Tissues& tissues, const Loading& loading,
              const SolverOptions& options, Precision precision) {
  History history;
  const ForceSystem system(model, tissues, precision);
  solve(choose_time(model, tissues, loading), system, model, loading, options, {}, history);
  return history;
}

}  // namespace dimple
