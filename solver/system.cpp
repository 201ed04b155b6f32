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
               std::vector<std::unique_ptr<TouchingTool>> rigid, std::unique_ptr<FoldContact> folds)
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
      touching_ = one.get();
    else
      walls_.push_back(one.get());
  }
  if (folds_) contacts_.push_back({folds_.get(), nullptr, contact_unknowns()});
  for (const OneContact& one : contacts_)
    is_active_.emplace_back(static_cast<std::size_t>(one.term->count()), char{0});
  if (touching_)
    for (Index s = 0; s < touching_->count(); ++s) activate({0, s});
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

void System::bring_back(Eigen::VectorXd& lambda) const {
  for (const OneContact& one : contacts_)
    one.term->bring_back(lambda.segment(model_.patches.count() + one.first, one.term->unknowns()));
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
  if (loaded()) energy.loads -= loads_at_rest_;
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
  return energy + now_.share * pressure_around_ * change;
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

double System::along_push(const Nodal& f) const {
  return touching_ ? touching_->along(model_.tool.push) : dimple::along_push(model_, model_.circle, f);
}

double System::working_force(const Nodal& f) const {
  double force = held_.working_force(f);
  if (touching_) force += touching_->working_force(now_);
  for (const TouchingTool* wall : walls_) force += wall->along(wall->motion());
  return force;
}

Wrench System::on_tool(const Nodal& u, const Nodal& f) const {
  if (touching_) return touching_->on_tool(now_);
  Vec3 carried = Vec3::Zero();  // preload displacement of the bonded patch
  if (loaded() && !model_.circle.empty()) {
    for (const Index a : model_.circle) carried += step_start_.u.col(a).head<3>();
    carried /= static_cast<double>(model_.circle.size());
    carried -= way_before_.come;
  }
  return wrench_on_tool(model_, held_, u, f, model_.tool.centre + tool_displacement() + carried);
}

Vec3 System::tool_displacement() const {
  RigidWay way = way_before_;
  way.motion = held_.motion(tool_set);
  return way.come_at(now_.depth);
}

Vec3 System::turned() const {
  return way_before_.has_turned() ? rotation_vector(way_before_.turned_at(now_.depth)) : Vec3::Zero().eval();
}

Vec3 System::aside() const {
  const Vec3 way = tool_displacement(), &push = model_.tool.push;
  if (way_before_.come.isZero(0.0) && !way_before_.turns() && held_.motion(tool_set) == push)
    return Vec3::Zero();  // without rounding
  return way - way.dot(push) * push;
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
  const Index of_tool = touching_ ? touching_->count() : 0;
  for (const OneContact& one : contacts_) {
    if (one.term == touching_ && !touching_->rubs()) continue;
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
  active_.resize(static_cast<std::size_t>(touching_ ? touching_->count() : 0));
  for (std::size_t c = touching_ ? 1 : 0; c < is_active_.size(); ++c)
    std::fill(is_active_[c].begin(), is_active_[c].end(), char{0});
  for (std::size_t k = 0; k + 1 < met.size(); k += 2)
    activate({static_cast<Index>(met[k]), static_cast<Index>(met[k + 1])});
  for (auto one = contacts_.rbegin(); one != contacts_.rend(); ++one)
    if (one->term != touching_ || touching_->rubs()) restore_last(*one->term);
  tissue_.restore_past(past);
}

void System::begin_at(Rest rest, Constraints held) {
  run_start_ = step_start_ = std::move(rest);
  held_ = std::move(held);
  tissue_.hold_pressures({});  // release the pressures of the search
  accept_step(step_start_.u);
  for (const auto& one : rigid_) one->count_heat_anew();  // energies exclude the preload
  if (pressure_around_ != 0.0) tissue_.stress_sweep(step_start_.u);
  loads_at_rest_ = energy_of_terms(step_start_.u);
}

void System::go_on(Rest from, Constraints held, const RigidWay& of_tool, double travel_before,
                   const std::vector<RigidWay>& of_walls) {
  held.start_at(from.u);
  step_start_ = std::move(from);
  held_ = std::move(held);
  way_before_ = of_tool;
  std::size_t wall = 0;
  for (const auto& one : rigid_)
    if (one->is_measured()) {
      RigidWay way = of_tool;
      way.motion = held_.motion(tool_set);
      one->go_on(way, travel_before);
    } else {
      one->go_on(of_walls[wall], travel_before);
      ++wall;
    }
  tissue_.hold_pressures({});
}

void System::measure_by(const Nodal& f) {
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
Rest come_to_rest(System& system, double tolerance) {
  Rest rest = system.step_start();
  const Relaxation relax(system);
  Nodal f = rest.u;
  const std::int64_t before = system.tissue().sweeps();
  const auto sweeps = [&] { return system.tissue().sweeps() - before; };
  double done = 0.0, part = first_part;
  while (done < 1.0) {
    stop_if_asked();
    const double share = std::min(1.0, done + part);
    Rest tried = rest;
    if (done > 0.0) {
      tried.u *= share / done;
      tried.lambda *= share / done;
    }
    system.begin_step(at_last);
    system.set({.share = share}, tried.u);
    try {
      RelaxOptions how{.tolerance = tolerance};
      if (relax.has_mixed())
        how.evaluations = std::clamp<std::int64_t>(most_in_all - sweeps(), 1, most_of_part);
      relax(tried.u, f, how, &tried.lambda);
      system.accept_step(tried.u);
      rest = std::move(tried);
      done = share;
    } catch (const SolveError& error) {
      part *= 0.5;
      if (part >= smallest_part && (sweeps() < most_in_all || !relax.has_mixed())) continue;
      Report report = error.report;
      report.fact = text("the body is not in equilibrium under its loads: ", report.fact,
                         "; the tolerance is ", tolerance);
      report.where = text("before first contact, at ", percent(share), " of its loads; ", report.where);
      report.remedy =
          "lower the loads, raise the stiffness, hold more of the body, or accept more unbalanced force, for "
          "instance --set solver.tolerance=1e-3";
      throw SolveError(report);
    }
  }
  return rest;
}

// Restores the preloaded state, as if it had been computed here. Accepting it again changes nothing. The tool
// has been moved since, and has no other past there.
void be_at_rest(System& system, const Settled& settled) {
  const Rest& rest = settled.rest;
  Nodal f = rest.u;
  system.restore_past(settled.past);
  system.begin_step(at_last);
  system.force_at(rest.u, rest.lambda, f);
  system.accept_step(rest.u);
}

// [N] Least reactions under a contacting tool: those of a sphere pressed in by 0.003 of its radius. Grazing
// contact has an equilibrium, too.
double least_contact_force(const ForceSystem& tissue, const Touch& touch) {
  constexpr double least = 1e-3;  // of the shear modulus times the radius squared
  double softest = std::numeric_limits<double>::infinity();
  for (const Material& material : tissue.materials()) softest = std::min(softest, material.mu);
  return least * softest * touch.shape.radius * touch.shape.radius;
}

}  // namespace

std::unique_ptr<System> make_system(const ForceSystem& tissue, const Model& model, Contact contact,
                                    const std::vector<HeldSet>& further, const Loads& loads, double tolerance,
                                    const Touch* touch, std::shared_ptr<const FoldBanks> folds,
                                    const std::vector<Touch>& walls, const Settled* settled) {
  std::vector<std::unique_ptr<TouchingTool>> rigid;
  if (touch) rigid.push_back(std::make_unique<TouchingTool>(*touch));
  for (const Touch& wall : walls) rigid.push_back(std::make_unique<TouchingTool>(wall));
  auto closing = folds ? std::make_unique<FoldContact>(std::move(folds), tissue) : nullptr;
  if (!loads.move_the_body()) {
    auto unloaded = std::make_unique<System>(tissue, model, make_constraints(model, contact, further),
                                             make_terms(model, loads), std::move(rigid), std::move(closing));
    if (touch) unloaded->set_least_reactions(least_contact_force(tissue, *touch));
    return unloaded;
  }
  std::vector<HeldSet> still;  // tool and moving sets are not applied yet
  std::copy_if(further.begin(), further.end(), std::back_inserter(still),
               [](const HeldSet& s) { return s.share == 0.0; });
  still.push_back({.name = base_set, .node = model.base});
  auto system = std::make_unique<System>(tissue, model, Constraints(model.node_count(), std::move(still)),
                                         make_terms(model, loads), std::move(rigid), std::move(closing));
  if (touch) system->touching()->stand_apart(true);
  Rest rest = settled ? settled->rest : come_to_rest(*system, tolerance);
  if (settled) be_at_rest(*system, *settled);
  if (touch) system->touching()->stand_apart(false);
  Constraints held = make_constraints(model, contact, further);
  held.start_at(rest.u);
  system->begin_at(std::move(rest), std::move(held));
  return system;
}

}  // namespace dimple
