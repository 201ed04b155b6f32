#include "solver/system.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/equilibrium/relax.hpp"
#include "solver/text.hpp"

namespace dimple {

System::System(const ForceSystem& tissue, const Model& model, Constraints held, ForceTerms terms,
               std::vector<std::unique_ptr<RigidContact>> rigid, std::unique_ptr<FoldContact> folds)
    : model_(model),
      held_(std::move(held)),
      tissue_(tissue),
      terms_(std::move(terms)),
      rigid_(std::move(rigid)),
      folds_(std::move(folds)) {
  std::stable_partition(rigid_.begin(), rigid_.end(), [](const auto& one) { return one->is_measured(); });
  for (const auto& one : rigid_) {
    contacts_.push_back({one.get(), one.get(), contact_unknowns()});
    if (one->is_measured())
      tool_contact_ = one.get();
    else
      walls_.push_back(one.get());
  }
  if (folds_) contacts_.push_back({folds_.get(), nullptr, contact_unknowns()});
  for (const OneContact& one : contacts_)
    is_active_.emplace_back(static_cast<std::size_t>(one.term->count()), char{0});
  if (tool_contact_)
    for (Index s = 0; s < tool_contact_->count(); ++s) activate({0, s});
  step_start_ = {Nodal::Zero(4, model.node_count()),
                 Eigen::VectorXd::Zero(model.patches.count() + contact_unknowns())};
  run_start_ = step_start_;
  for (const auto& term : terms_) pressure_around_ += term->pressure_around();
  if (!MixedIteration::serves(tissue_.system(), model)) pressure_around_ = 0.0;  // it acts on triangles
  set(now_);
}

void System::activate(const ActiveSample& one) {
  active_.push_back(one);
  is_active_[static_cast<std::size_t>(one.contact)][static_cast<std::size_t>(one.sample)] = 1;
}

void System::activate_penetrating() {
  for (std::size_t c = 0; c < contacts_.size(); ++c) {
    const Eigen::VectorXd& gap = contacts_[c].term->gaps();
    for (Index s = 0; s < gap.size(); ++s)
      if (gap[s] < 0.0 && !is_active_[c][static_cast<std::size_t>(s)]) activate({static_cast<Index>(c), s});
  }
}

void System::set(const Instant& now, Nodal& u) {
  set(now);
  held_.prescribe(u, now.depth);
}

void System::add_terms(const Nodal& u, Nodal& f) {
  load_.setZero(4, u.cols());
  for (const auto& term : terms_) {
    if (pressure_around_ == 0.0 || term->pressure_around() == 0.0) {
      term->add_force(u, now_, term->is_load() ? load_ : f);
      continue;
    }
    // The tissue's pressures bear it. A hundredth of it scales the residual: the base may bear next to
    // nothing.
    Nodal its = Nodal::Zero(4, u.cols());
    term->add_force(u, now_, its);
    load_ += 0.01 * its;
    f -= 0.01 * its;
  }
  for (const auto& one : rigid_) one->add_force(u, now_, load_);
  f += load_;
  if (folds_) folds_->add_force(u, now_, f);
}

System::Sweep System::force(const Nodal& u, Nodal& f) {
  const Sweep sweep = tissue_.internal_force(u, f);
  if (!tissue_alone()) add_terms(u, f);
  return sweep;
}

System::Sweep System::force_at(const Nodal& u, const Eigen::VectorXd& lambda, Nodal& f) {
  const bool with_pressures = MixedIteration::serves(tissue_.system(), model_);
  const Index patches = model_.patches.count();
  tissue_.hold_pressures(with_pressures ? lambda.head(patches).cwiseQuotient(model_.patches.volume)
                                        : Eigen::VectorXd());
  for (const OneContact& one : contacts_)
    one.term->set_forces(lambda.segment(patches + one.first, one.term->unknowns()));
  return force(u, f);
}

void System::project_to_admissible(Eigen::VectorXd& lambda) const {
  for (const OneContact& one : contacts_)
    one.term->project_to_admissible(lambda.segment(model_.patches.count() + one.first, one.term->unknowns()));
}

void System::gather(const Nodal& u, Nodal& f, const std::function<void(Index first, Index last)>& then) {
  if (tissue_alone()) return tissue_.gather_sweep(f, then);
  tissue_.gather_sweep(f, {});
  add_terms(u, f);
  if (then) then(0, u.cols());
}

StoredEnergy System::stored_energy(const Nodal& u) {
  StoredEnergy energy;
  energy.tissue = tissue_.stored_energy(u, &energy.hourglass);
  energy.loads = energy_of_terms(u);
  if (loaded()) energy.loads -= loads_at_start_;
  return energy;
}

// Needs a sweep at u. A pressure on the entire surface does work on the body's volume.
double System::energy_of_terms(const Nodal& u) const {
  double energy = 0.0;
  for (const auto& term : terms_)
    if (pressure_around_ == 0.0 || term->pressure_around() == 0.0) energy += term->energy(u, now_);
  if (pressure_around_ == 0.0) return energy;
  ForceState::Patches patches;
  tissue_.patch_state(patches);
  double change = 0.0;
  for (Index b = 0; b < patches.dilation.size(); ++b)
    change += model_.patches.volume[b] * patches.dilation[b];
  return energy + now_.fraction * pressure_around_ * change;
}

StiffnessBound System::stiffness_bound() const {
  StiffnessBound bound;
  bound.node = Eigen::VectorXd::Zero(model_.node_count());
  for (const auto& term : terms_) term->add_stiffness_bound(bound);
  return bound;
}

NodeStiffness System::node_stiffness(const Nodal& u) const {
  NodeStiffness sum = NodeStiffness::Zero(9, u.cols());
  for (const auto& term : terms_) term->add_node_stiffness(u, sum);
  return sum;
}

double System::along_approach(const Nodal& f) const {
  return tool_contact_ ? tool_contact_->along(model_.tool.approach)
                       : dimple::along_approach(model_, model_.bonded_patch, f);
}

double System::force_along_motion(const Nodal& f) const {
  double force = held_.force_along_motion(f);
  if (tool_contact_) force += tool_contact_->force_along_motion(now_);
  for (const RigidContact* wall : walls_) force += wall->along(wall->motion());
  return force;
}

Wrench System::on_tool(const Nodal& u, const Nodal& f) const {
  if (tool_contact_) return tool_contact_->on_tool(now_);
  Vec3 carried = Vec3::Zero();  // preload displacement of the bonded patch
  if (loaded() && !model_.bonded_patch.empty()) {
    for (const Index a : model_.bonded_patch) carried += step_start_.u.col(a).head<3>();
    carried /= static_cast<double>(model_.bonded_patch.size());
    carried -= motion_before_.initial_displacement;
  }
  return wrench_on_tool(model_, held_, u, f, model_.tool.centre + tool_displacement() + carried);
}

Vec3 System::tool_displacement() const {
  RigidMotion motion = motion_before_;
  motion.motion = held_.motion(tool_set);
  return motion.displacement_at(now_.depth);
}

Vec3 System::turned() const {
  return motion_before_.has_turned() ? rotation_vector(motion_before_.turned_at(now_.depth))
                                     : Vec3::Zero().eval();
}

Vec3 System::aside() const {
  const Vec3 displacement = tool_displacement(), &approach = model_.tool.approach;
  if (motion_before_.initial_displacement.isZero(0.0) && !motion_before_.turns() &&
      held_.motion(tool_set) == approach)
    return Vec3::Zero();  // without rounding
  return displacement - displacement.dot(approach) * approach;
}

void System::accept_step(const Nodal& u) {
  tissue_.accept_step(u);
  for (const auto& term : terms_) term->accept(u, now_);
  for (const OneContact& one : contacts_) one.term->accept(u, now_);
}

// Order: tissue; contacts (a tool without friction has no past); pairs of contact and sample that have become
// active; terms. The number of values follows each contact, the pairs and each term.
std::vector<double> System::past() const {
  std::vector<double> all = tissue_.past();
  const auto add = [&](const ForceTerm& term) {
    const std::vector<double> its = term.past();
    all.insert(all.end(), its.begin(), its.end());
    all.push_back(static_cast<double>(its.size()));
  };
  const Index of_tool = tool_contact_ ? tool_contact_->count() : 0;
  for (const OneContact& one : contacts_) {
    if (one.term == tool_contact_ && !tool_contact_->has_friction()) continue;
    add(*one.term);
  }
  for (auto one = active_.begin() + of_tool; one != active_.end(); ++one) {
    all.push_back(static_cast<double>(one->contact));
    all.push_back(static_cast<double>(one->sample));
  }
  if (!contacts_.empty())
    all.push_back(static_cast<double>(2 * (static_cast<Index>(active_.size()) - of_tool)));
  for (const auto& term : terms_) add(*term);
  return all;
}

void System::restore_past(std::vector<double> past) {
  const auto take_last = [&] {
    const auto count = static_cast<std::ptrdiff_t>(past.back());
    past.pop_back();
    const std::vector<double> its(past.end() - count, past.end());
    past.erase(past.end() - count, past.end());
    return its;
  };
  const auto restore_last = [&](ForceTerm& term) { term.restore_past(take_last()); };
  for (auto term = terms_.rbegin(); term != terms_.rend(); ++term) restore_last(**term);
  const std::vector<double> met = contacts_.empty() ? std::vector<double>() : take_last();
  active_.resize(static_cast<std::size_t>(tool_contact_ ? tool_contact_->count() : 0));
  for (std::size_t c = tool_contact_ ? 1 : 0; c < is_active_.size(); ++c)
    std::fill(is_active_[c].begin(), is_active_[c].end(), char{0});
  for (std::size_t k = 0; k + 1 < met.size(); k += 2)
    activate({static_cast<Index>(met[k]), static_cast<Index>(met[k + 1])});
  for (auto one = contacts_.rbegin(); one != contacts_.rend(); ++one)
    if (one->term != tool_contact_ || tool_contact_->has_friction()) restore_last(*one->term);
  tissue_.restore_past(past);
}

void System::set_reference_state(EquilibriumState state, Constraints held) {
  run_start_ = step_start_ = std::move(state);
  held_ = std::move(held);
  tissue_.hold_pressures({});  // release the pressures of the search
  accept_step(step_start_.u);
  for (const auto& one : rigid_) one->reset_dissipation();  // energies exclude the preload
  if (pressure_around_ != 0.0) tissue_.stress_sweep(step_start_.u);
  loads_at_start_ = energy_of_terms(step_start_.u);
}

void System::begin_scene_step(EquilibriumState from, Constraints held, const RigidMotion& of_tool,
                              double travel_before, const std::vector<RigidMotion>& of_walls) {
  held.start_at(from.u);
  step_start_ = std::move(from);
  held_ = std::move(held);
  motion_before_ = of_tool;
  std::size_t wall = 0;
  for (const auto& one : rigid_)
    if (one->is_measured()) {
      RigidMotion motion = of_tool;
      motion.motion = held_.motion(tool_set);
      one->begin_motion(motion, travel_before);
    } else {
      one->begin_motion(of_walls[wall], travel_before);
      ++wall;
    }
  tissue_.hold_pressures({});
}

void System::set_residual_scale(const Nodal& f) {
  Nodal free(4, f.cols());
  least_reactions_ = std::max(least_reactions_, 0.01 * balance(f, free).reactions);
}

namespace {

constexpr double first_part = 0.25, smallest_part = 1.0 / 64.0;  // of the loads, applied at once
// Force evaluations by mixed iteration. The 25 random scenes on real organs that reached equilibrium took at
// most 444 for a part and 1111 in all.
constexpr std::int64_t most_of_part = 600, most_in_all = 2000;
constexpr double at_last = std::numeric_limits<double>::infinity();  // s: for fully relaxed tissue

// Preload, the equilibrium under the loads alone:
// 1. Apply a quarter of the loads at once, and later as much again.
// 2. First guess: the last state, scaled to the new loads. Viscoelastic tissue is fully relaxed.
// 3. Search; accept the state.
// 4. If none is found, repeat with half the increment, down to 1/64 of the loads.
EquilibriumState find_equilibrium(System& system, double tolerance) {
  EquilibriumState state = system.step_start();
  const Relaxation relax(system);
  Nodal f = state.u;
  const std::int64_t before = system.tissue().sweeps();
  const auto sweeps = [&] { return system.tissue().sweeps() - before; };
  double done = 0.0, part = first_part;
  while (done < 1.0) {
    stop_if_requested();
    const double fraction = std::min(1.0, done + part);
    EquilibriumState tried = state;
    if (done > 0.0) {
      tried.u *= fraction / done;
      tried.lambda *= fraction / done;
    }
    system.begin_step(at_last);
    system.set({.fraction = fraction}, tried.u);
    try {
      RelaxOptions how{.tolerance = tolerance};
      if (relax.has_mixed())
        how.evaluations = std::clamp<std::int64_t>(most_in_all - sweeps(), 1, most_of_part);
      relax(tried.u, f, how, &tried.lambda);
      system.accept_step(tried.u);
      state = std::move(tried);
      done = fraction;
    } catch (const SolveError& error) {
      part *= 0.5;
      if (part >= smallest_part && (sweeps() < most_in_all || !relax.has_mixed())) continue;
      Report report = error.report;
      report.fact = text("the body is not in equilibrium under its loads: ", report.fact,
                         "; the tolerance is ", tolerance);
      report.where = text("before first contact, at ", percent(fraction), " of its loads; ", report.where);
      report.remedy =
          "lower the loads, raise the stiffness, hold more of the body, or accept more unbalanced force, for "
          "instance --set solver.tolerance=1e-3";
      throw SolveError(report);
    }
  }
  return state;
}

// Restores the preloaded state, as if it had been computed here. Accepting it again changes nothing. The tool
// has been moved since, and has no other past there.
void set_preloaded_state(System& system, const PreloadedState& preloaded) {
  const EquilibriumState& state = preloaded.state;
  Nodal f = state.u;
  system.restore_past(preloaded.past);
  system.begin_step(at_last);
  system.force_at(state.u, state.lambda, f);
  system.accept_step(state.u);
}

// [N] Least reactions under a contacting tool: those of a sphere pressed in by 0.003 of its radius. Grazing
// contact has an equilibrium, too.
double least_contact_force(const ForceSystem& tissue, const RigidBody& indenter) {
  constexpr double least = 1e-3;  // of the shear modulus times the radius squared
  double softest = std::numeric_limits<double>::infinity();
  for (const Material& material : tissue.materials()) softest = std::min(softest, material.mu);
  return least * softest * indenter.shape.radius * indenter.shape.radius;
}

}  // namespace

std::unique_ptr<System> make_system(const ForceSystem& tissue, const Model& model, Contact contact,
                                    const std::vector<HeldSet>& further, const Loads& loads, double tolerance,
                                    const RigidBody* indenter, std::shared_ptr<const FoldFaces> folds,
                                    const std::vector<RigidBody>& walls, const PreloadedState* preloaded) {
  std::vector<std::unique_ptr<RigidContact>> rigid;
  if (indenter) rigid.push_back(std::make_unique<RigidContact>(*indenter));
  for (const RigidBody& wall : walls) rigid.push_back(std::make_unique<RigidContact>(wall));
  auto closing = folds ? std::make_unique<FoldContact>(std::move(folds), tissue) : nullptr;
  if (!loads.move_the_body()) {
    auto unloaded = std::make_unique<System>(tissue, model, make_constraints(model, contact, further),
                                             make_terms(model, loads), std::move(rigid), std::move(closing));
    if (indenter) unloaded->set_least_reactions(least_contact_force(tissue, *indenter));
    return unloaded;
  }
  std::vector<HeldSet> still;  // tool and moving sets are not applied yet
  std::copy_if(further.begin(), further.end(), std::back_inserter(still),
               [](const HeldSet& s) { return s.fraction == 0.0; });
  still.push_back({.name = base_set, .node = model.base});
  auto system = std::make_unique<System>(tissue, model, Constraints(model.node_count(), std::move(still)),
                                         make_terms(model, loads), std::move(rigid), std::move(closing));
  if (indenter) system->tool_contact()->set_separated(true);
  EquilibriumState state = preloaded ? preloaded->state : find_equilibrium(*system, tolerance);
  if (preloaded) set_preloaded_state(*system, *preloaded);
  if (indenter) system->tool_contact()->set_separated(false);
  Constraints held = make_constraints(model, contact, further);
  held.start_at(state.u);
  system->set_reference_state(std::move(state), std::move(held));
  return system;
}

}  // namespace dimple
