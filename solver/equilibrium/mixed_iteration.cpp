#include "solver/equilibrium/mixed_iteration.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "io/stop.hpp"
#include "solver/equilibrium/anderson.hpp"
#include "solver/equilibrium/best_state.hpp"
#include "solver/equilibrium/contact_coupling.hpp"
#include "solver/equilibrium/laplace_preconditioner.hpp"
#include "solver/equilibrium/mixed_constants.hpp"
#include "solver/equilibrium/pressure_schur.hpp"

namespace dimple {

struct MixedIteration::Parts {
  System& body;
  LaplacePreconditioner laplace;
  PressureSchur schur;
  ContactCoupling contact;
  Anderson anderson;                          // of displacements and lambda, scaled to be of one kind
  Nodal u_of_gradient;                        // displacements at which G was found
  double viscous_scale = 0.0;                 // `fraction` of the differences stored in `anderson`
  Nodal viscous;                              // [4xN] N, viscous force of the current state
  std::chrono::steady_clock::duration lap{};  // of an iteration in bounded time, mean of the last few

  explicit Parts(System& s) : body(s), laplace(s), schur(s), contact(s, laplace) {}

  Index patch_count() const { return body.model().patches.count(); }
  bool factorise_laplacian();
  const Nodal* viscous_force(const Nodal& u, const Viscosity& viscosity);
  void step_of_tissue(const Nodal& r, const Eigen::VectorXd& s, Nodal& du, Eigen::VectorXd& dlambda);
  void step(const Nodal& r, const Eigen::VectorXd& s, double factor, Nodal& du, Eigen::VectorXd& dlambda);
  void advance(Nodal& u, Eigen::VectorXd& lambda, const Nodal& du, const Eigen::VectorXd& dlambda,
               double caution);
  void hold_still(Nodal& u, const Nodal& was) const;
};

bool MixedIteration::Parts::factorise_laplacian() {
  contact.forget();
  return laplace.factorise();
}

// `fraction` x L (u - about).
const Nodal* MixedIteration::Parts::viscous_force(const Nodal& u, const Viscosity& viscosity) {
  laplace.multiply_undeformed(u - viscosity.about, viscous);
  viscous *= viscosity.fraction;
  return &viscous;
}

// The step without contact, of the unbalanced force r and the unbalanced volume s.
void MixedIteration::Parts::step_of_tissue(const Nodal& r, const Eigen::VectorXd& s, Nodal& du,
                                           Eigen::VectorXd& dlambda) {
  laplace.apply(r, du);
  dlambda = schur.apply(s - schur.volume_change(du));
  Nodal held = r;
  schur.add_forces(dlambda, held);
  laplace.apply(held, du);
  du = -du;
}

// Step with contact, whose gaps are multiplied by `factor`.
void MixedIteration::Parts::step(const Nodal& r, const Eigen::VectorXd& s, double factor, Nodal& du,
                                 Eigen::VectorXd& dlambda) {
  Eigen::VectorXd of_patches(s.size());
  step_of_tissue(r, s, du, of_patches);
  dlambda.tail(dlambda.size() - s.size()).setZero();
  if (!contact.empty()) {
    Nodal held = r;
    contact.apply(factor, du, held, dlambda.tail(dlambda.size() - s.size()));
    step_of_tissue(held, s, du, of_patches);
  }
  dlambda.head(s.size()) = of_patches;
}

// Next state after u and lambda, with the step du and dlambda.
void MixedIteration::Parts::advance(Nodal& u, Eigen::VectorXd& lambda, const Nodal& du,
                                    const Eigen::VectorXd& dlambda, double caution) {
  const Index n = u.cols(), nb = lambda.size();
  const Eigen::VectorXd& scale = laplace.scale();
  Eigen::VectorXd of_lambda(nb);
  of_lambda.head(patch_count()) = schur.scale();
  of_lambda.tail(nb - patch_count()) = contact.scale();
  const auto scaled = [&](const Nodal& v, const Eigen::VectorXd& l) {
    Eigen::VectorXd all(4 * n + nb);
    Eigen::Map<Nodal>(all.data(), 4, n) = v * scale.asDiagonal();
    all.tail(nb) = l.cwiseProduct(of_lambda);
    return all;
  };
  const Nodal from = u;
  const Eigen::VectorXd here = scaled(u, lambda);
  Eigen::VectorXd place = anderson.next(here, scaled(du, dlambda), caution);
  u = Eigen::Map<Nodal>(place.data(), 4, n) * scale.cwiseInverse().asDiagonal();
  if (const double strain = laplace.strain_between(from, u); strain > mixed_constants.longest_step) {
    place = here + mixed_constants.longest_step / strain * (place - here);
    u = Eigen::Map<Nodal>(place.data(), 4, n) * scale.cwiseInverse().asDiagonal();
  }
  lambda = place.tail(nb).cwiseQuotient(of_lambda);
  body.project_to_admissible(lambda);
}

// Restores held nodes exactly: only rounding can have moved them.
void MixedIteration::Parts::hold_still(Nodal& u, const Nodal& was) const {
  const Constraints& held = body.held();
  for (Index a = 0; a < u.cols(); ++a)
    if (!held.is_free(a)) u.col(a) = was.col(a) + held.project(a, u.col(a) - was.col(a));
}

namespace {

// Unbalanced forces and volumes of a state.
struct Unbalanced {
  Unbalanced(Index nodes, Index patch_count) : force(4, nodes), volume(patch_count) {}
  Nodal force;             // on what is free to move
  Eigen::VectorXd volume;  // J - 1 - p / bulk
  ForceState::Patches patches;
  ForceSystem::Sweep sweep;
  double residual = 0.0, reactions = 0.0, volume_error = 0.0;
  double contact = 0.0;  // error of the tool's, relative to the admissible one

  void at(System& body, const Nodal& u, const Eigen::VectorXd& lambda, Nodal& f, const Nodal* viscous) {
    const Eigen::VectorXd& of_patches = body.model().patches.volume;
    sweep = body.force_at(u, lambda, f);
    body.tissue().patch_state(patches);
    const Balance balance = body.balance(f, force, [&](Index a, Eigen::Vector4d& all) {
      if (viscous) all += viscous->col(a);
    });
    residual = balance.residual();
    reactions = balance.reactions;
    volume = patches.dilation -
             lambda.head(of_patches.size()).cwiseQuotient(patches.bulk.cwiseProduct(of_patches));
    volume_error = std::sqrt(volume.cwiseAbs2().dot(of_patches) / of_patches.sum());
  }
};

// Copy of the unbalanced forces at the best state, if the caller requests them.
struct AtBest {
  AtBest(MixedIteration::Residual* left_, const Nodal& f_, const Unbalanced& now) : left(left_) {
    keep(f_, now);
  }
  MixedIteration::Residual* left;
  Nodal f;
  ForceSystem::Sweep sweep;

  void keep(const Nodal& f_, const Unbalanced& now) {
    if (!left) return;
    f = f_;
    sweep = now.sweep;
    left->force = now.force;
    left->volume = now.volume;
    left->contact = contact_error * now.contact;
  }
  void give_back(Nodal& f_, ForceSystem::Sweep& sweep_) const {
    if (!left) return;
    f_ = f;
    sweep_ = sweep;
  }
};

// Timer of iterations in bounded time. `mean`: of the last few.
struct Laps {
  using Clock = std::chrono::steady_clock;
  Laps(Clock::time_point until_, Clock::duration& mean_)
      : until(until_),
        mean(mean_),
        timed(until != Clock::time_point::max()),
        last(timed ? Clock::now() : Clock::time_point()) {}
  Clock::time_point until;
  Clock::duration& mean;
  bool timed;
  Clock::time_point last;

  // `counts`: the lap that ends here is a whole one.
  bool none_left(bool counts, bool* late) {
    if (!timed) return false;
    const Clock::time_point now = Clock::now();
    if (counts) mean += (now - last - mean) / 5;
    last = now;
    const bool none = now + mean + mean / 2 > until;
    if (late) *late = none;
    return none;
  }
};

}  // namespace

MixedIteration::MixedIteration(System& system) : parts_(std::make_unique<Parts>(system)) {}
MixedIteration::~MixedIteration() = default;

double MixedIteration::laplacian_of(const Nodal& v) const {
  Nodal pull;
  parts_->laplace.multiply_undeformed(v, pull);
  return v.cwiseProduct(pull).sum();
}

Eigen::VectorXd pressures_of_volumes(const System& system) {
  ForceState::Patches patches;
  system.tissue().patch_state(patches);
  return patches.dilation.cwiseProduct(patches.bulk).cwiseProduct(system.model().patches.volume);
}

bool MixedIteration::serves(const ForceSystem& system, const Model& model) {
  return model.scheme.pressure_patches && model.scheme.averaged_gradients && serves(system.materials());
}

bool MixedIteration::serves(const std::vector<Material>& tissues) {
  return std::all_of(tissues.begin(), tissues.end(),
                     [](const Material& m) { return m.kappa - pointwise_bulk_modulus(m) > 1e-2 * m.mu; });
}

Relaxed MixedIteration::operator()(Nodal& u, Eigen::VectorXd& lambda, Nodal& f, const RelaxOptions& options,
                                   bool reassemble, const Viscosity* viscosity) {
  Parts& p = *parts_;
  const Relaxed first = iterate(u, lambda, f, options, reassemble, viscosity);
  if (first.converged || viscosity || !std::isfinite(first.residual) ||
      first.evaluations >= options.evaluations)
    return first;
  RelaxOptions remaining = options;
  remaining.evaluations -= first.evaluations;
  Relaxed second = first;
  p.laplace.stiffen(u);
  if (p.factorise_laplacian()) {
    second = iterate(u, lambda, f, remaining, true, nullptr);
    second.evaluations += first.evaluations;
  }
  p.laplace.relax();
  return second;
}

Relaxed MixedIteration::within(Nodal& u, Eigen::VectorXd& lambda, Nodal& f, const RelaxOptions& options,
                               bool reassemble, Residual& left) {
  Parts& p = *parts_;
  left.force.setZero(4, u.cols());
  left.volume.setZero(p.patch_count());
  left.contact = 0.0;
  left.late = false;
  const Relaxed found = iterate(u, lambda, f, options, reassemble, nullptr, &left);
  if (!p.laplace.is_factorised() || !p.schur.is_factorised()) return found;
  Nodal z(4, u.cols());
  p.laplace.apply(left.force, z);
  left.energy = left.force.cwiseProduct(z).sum() + left.volume.dot(p.schur.apply(left.volume));
  return found;
}

// Makes the matrices of the step, unless those of the last call serve. False: one is not positive definite.
bool MixedIteration::prepare(const Nodal& u, const Eigen::VectorXd& bulk, bool reassemble,
                             const Viscosity* viscosity) {
  Parts& p = *parts_;
  if (reassemble || !p.schur.has_gradient()) {
    p.schur.find_gradient();
    p.u_of_gradient = u;
  }
  const bool other_viscosity = p.viscous_scale != (viscosity ? viscosity->fraction : 0.0);
  p.viscous_scale = viscosity ? viscosity->fraction : 0.0;
  const bool new_matrix = !p.laplace.is_factorised();
  if (new_matrix && !p.factorise_laplacian()) return false;
  if (new_matrix || reassemble || !p.laplace.has_soft_part()) p.laplace.find_soft_part(p.u_of_gradient);
  if (!p.schur.factorise(bulk)) return false;
  p.anderson.begin(4 * u.cols() + bulk.size() + p.body.contact_unknowns(), reassemble || other_viscosity);
  return true;
}

// One search: its state (u, lambda), the forces f there and what they lack.
struct MixedIteration::Search {
  Parts& p;
  Nodal& u;
  Eigen::VectorXd& lambda;
  Nodal& f;
  const RelaxOptions& options;
  const Viscosity* viscosity;
  Residual* left;  // null: time is not bounded
  Unbalanced now;
  Relaxed result = {};

  void evaluate() {
    stop_if_requested();
    now.at(p.body, u, lambda, f, viscosity ? p.viscous_force(u, *viscosity) : nullptr);
    result.sweep = now.sweep;
    result.residual = now.residual;
    ++result.evaluations;
  }
  void add_contact() {
    if (p.body.contacts().empty()) return;
    p.contact.extend();
    // In bounded time, states searched to different tolerances are compared.
    result.residual = p.contact.residual_with_contact(
        result.residual, now.reactions, left ? mixed_constants.usual_tolerance : options.tolerance);
    if (left && p.body.tool_contact()) now.contact = p.contact.contact_violation();
  }
  bool is_balanced() const {
    return result.residual < options.tolerance && now.volume_error < options.tolerance;
  }
  // Step (du, dlambda) of (1 + `fraction`) A, under viscous forces.
  void step(Nodal& du, Eigen::VectorXd& dlambda) {
    const double factor = viscosity ? 1.0 + viscosity->fraction : 1.0;
    if (viscosity) now.volume *= factor;
    p.step(now.force, now.volume, factor, du, dlambda);
    if (viscosity) du /= factor;
  }
  // True if a limit ends the search: iterations without gain, evaluations or time.
  bool is_over(BestState& best, Laps& laps) {
    const bool late = !best.is_last_attempt() && result.evaluations < options.evaluations &&
                      laps.none_left(best.has_step(), left ? &left->late : nullptr);
    return !best.may_continue() || result.evaluations >= options.evaluations || late;
  }
};

//  1. Evaluate: forces, volumes and contact gaps at (u, lambda), and from them the residual.
//  2. Prepare, once: A^-1 (LaplacePreconditioner), G at the first guess and S^-1 (PressureSchur).
//  3. Extend the contact compliance (ContactCoupling) by what penetrates; add what contact lacks to the
//     residual.
//  4. Setback, a residual far above the best one: return to the best state and half of its step, forget
//     Anderson's memory, continue with 1. After too many of them the best state is the result.
//  5. Converged: residual and volume error are below the tolerance; this state is the result.
//  6. Over: no gain for long, too many evaluations or no time left; the best state is the result.
//  7. Solve the nearby linear problem without contact:
//         du = A^-1 r,   dlambda = S^-1 (s - G' du),   du = -A^-1 (r + G dlambda).
//  8. In contact: find the changes of contact forces, normal and friction, that keep all gaps open where the
//     nodes move by du; add them to r and repeat 7.
//  9. Keep the state and its step if it is a gain on the best one.
// 10. Combine the step with earlier ones (Anderson), shorten it to the longest strain, project the contact
//     forces onto the admissible set, restore held nodes, and continue with 1.
Relaxed MixedIteration::iterate(Nodal& u, Eigen::VectorXd& lambda, Nodal& f, const RelaxOptions& options,
                                bool reassemble, const Viscosity* viscosity, Residual* left) {
  Parts& p = *parts_;
  Search search{p, u, lambda, f, options, viscosity, left, Unbalanced(u.cols(), p.patch_count())};
  const Unbalanced& now = search.now;
  Relaxed& result = search.result;
  result.converged = false;
  search.evaluate();                                                        // 1
  if (!prepare(u, now.patches.bulk, reassemble, viscosity)) return result;  // 2
  search.add_contact();                                                     // 3

  BestState best(u, lambda, result.residual);
  AtBest at_best(left, f, now);
  const auto give_up = [&] {
    u = best.u();
    lambda = best.lambda();
    result.residual = best.residual();
    at_best.give_back(f, result.sweep);
    return result;
  };
  Laps laps(options.until, p.lap);
  Nodal du(4, u.cols());
  Eigen::VectorXd dlambda(lambda.size());
  for (;; search.evaluate(), search.add_contact()) {
    if (best.is_setback(result.residual) || !std::isfinite(now.volume_error)) {  // 4
      if (!best.step_back(u, lambda)) return give_up();
      p.anderson.forget();
      continue;
    }
    if (search.is_balanced()) {  // 5
      result.converged = true;
      at_best.keep(f, now);
      return result;
    }
    if (search.is_over(best, laps)) {  // 6
      if (left && result.residual < best.residual()) {
        best.take(u, lambda, result.residual);
        at_best.keep(f, now);
      }
      return give_up();
    }
    search.step(du, dlambda);             // 7, 8
    if (best.is_gain(result.residual)) {  // 9
      best.take(u, lambda, result.residual, du, dlambda);
      at_best.keep(f, now);
    }
    p.advance(u, lambda, du, dlambda, best.caution());  // 10
    p.hold_still(u, best.u());
  }
}

}  // namespace dimple
