#include "solver/equilibrium/contact_coupling.hpp"

#include <algorithm>
#include <cmath>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "solver/equilibrium/contact_step.hpp"
#include "solver/equilibrium/friction_step.hpp"
#include "solver/equilibrium/mixed_constants.hpp"
#include "solver/text.hpp"

// Contact forces in one step of the mixed iteration:
// 1. Activate the samples that penetrate, and find their columns of C_st = w_s A^-1 w_t by unit forces.
// 2. Predict gaps: gap_s + n_s . w_s du, where du is the step without contact.
// 3. Find the changes of all normal forces that keep the gaps open: contact_step().
// 4. Predict slips by du and by these changes, in the tangent planes; bounds follow from the new normal
//    forces.
// 5. Find the changes of friction, contact by contact: friction_step().
// 6. Add both changes to the nodal forces; the mixed iteration then repeats its step.
// 7. Error of a sample: |min(gap, C_ss lambda)|, or C_ss |t - projection of t - slip / C_ss|, over the
//    admissible one.
//
// Source:   Wriggers 2006, chapters 4 and 5 (Lagrange multipliers, Coulomb's law).
// Departs:  C is made of the preconditioner and not of the tangent; friction does not act back on normal
//           forces within a step.

namespace dimple {

ContactCoupling::ContactCoupling(System& body, LaplacePreconditioner& laplace)
    : body_(body), laplace_(laplace) {}

// visit(node, w) for each weight of a sample's gap.
template <class Visit>
void ContactCoupling::visit_nodes(Index row, const Visit& visit) const {
  const Index sample = active(row).sample;
  const auto& [rows, w] = contact_of(row).term->moves();
  for (int k = rows.offset[sample]; k < rows.offset[sample + 1]; ++k) visit(rows.member[k], w[k]);
}

// Samples of one contact that have a compliance.
std::vector<ContactCoupling::Sample> ContactCoupling::samples_of(const ContactTerm* term) const {
  std::vector<Sample> result;
  for (Index k = 0; k < compliance_.rows(); ++k)
    if (contact_of(k).term == term) result.push_back({k, active(k).sample});
  return result;
}

void ContactCoupling::extend() {
  body_.activate_penetrating();
  int pairings_now = 0;
  for (const System::OneContact& one : body_.contacts()) pairings_now += one.term->pairing();
  if (pairings_now != pairings_) forget();
  pairings_ = pairings_now;
  const auto count = static_cast<Index>(body_.active().size());
  if (count > mixed_constants.most_contact_points)
    throw SolveError(
        {.fact = text("contact has ", count, " points, and at most ", mixed_constants.most_contact_points,
                      " are computed"),
         .where = "static solver",
         .why = "the compliances between all contact points are stored; memory grows with the square of "
                "their number and time with the cube",
         .remedy = "use fewer contact points: fewer nodes (--nodes), or --set wall.NAME.places for a wall",
         .code = "contact-places"});
  if (const Index known = compliance_.rows(); count > known) {
    compliance_.conservativeResize(count, count);
    find_columns(known);
    mirror_columns(known);
  }
}

// Columns from `known` on: displacements of all samples by unit forces, four forces at a time.
void ContactCoupling::find_columns(Index known) {
  const Index count = compliance_.rows();
  Nodal force(4, body_.model().node_count()), moved = force;
  const Eigen::VectorXd softest = laplace_.softest_part();
  for (Index first = known; first < count; first += 4) {
    stop_if_requested();
    force.setZero();
    const Index last = std::min(first + 4, count);
    for (Index t = first; t < last; ++t) visit_nodes(t, [&](int a, double w) { force(t - first, a) = w; });
    laplace_.apply_to_scalars(softest, force, moved);
    for (Index s = 0; s < count; ++s) {
      Eigen::Vector4d sum = Eigen::Vector4d::Zero();
      visit_nodes(s, [&](int a, double w) { sum += w * moved.col(a); });
      for (Index t = first; t < last; ++t) compliance_(s, t) = sum[t - first];
    }
  }
}

// Rows from `known` on, to make the matrix symmetric. The measured tool's samples, all active from the start,
// use the mean of both directions; later samples repeat their columns.
void ContactCoupling::mirror_columns(Index known) {
  const Index count = compliance_.rows(), of_tool = body_.tool_contact() ? body_.tool_contact()->count() : 0;
  if (known == 0 && of_tool > 0) {
    const auto block = compliance_.topLeftCorner(of_tool, of_tool);
    compliance_.topLeftCorner(of_tool, of_tool) = (0.5 * (block + block.transpose())).eval();
  }
  for (Index t = std::max(known, of_tool); t < count; ++t)
    for (Index s = 0; s < t; ++s) compliance_(t, s) = compliance_(s, t);
  // In single precision it need not be positive definite.
  compliance_.diagonal().tail(count - known) *= 1.0 + mixed_constants.compliance_margin;
}

Eigen::VectorXd ContactCoupling::scale() const {
  Eigen::VectorXd result = Eigen::VectorXd::Ones(body_.contact_unknowns());
  for (Index k = 0; k < compliance_.rows(); ++k) result[unknown_of(k)] = std::sqrt(compliance_(k, k));
  for (const System::OneContact& one : body_.contacts())
    if (one.rigid && one.rigid->has_friction())
      for (const auto& [k, s] : samples_of(one.term))
        result.segment<3>(one.first + one.rigid->count() + 3 * s).setConstant(std::sqrt(compliance_(k, k)));
  return result;
}

// Error of a sample's friction at the last force, as a length [m].
double ContactCoupling::lack_of_friction(const RigidContact& rigid, const Sample& one) const {
  const auto& [row, s] = one;
  const Vec3 force = rigid.friction_forces().col(s), slip = rigid.slips().col(s);
  const double most = rigid.bound(s, rigid.forces()[s]), C = compliance_(row, row);
  return most > 0.0 ? C * (force - brought_within(most, force - slip / C)).norm() : 0.0;
}

ContactCoupling::Lack ContactCoupling::lack_of(const System::OneContact& one) const {
  Lack lack;
  const bool frictional = one.rigid && one.rigid->has_friction();
  for (const Sample& sample : samples_of(one.term)) {
    const auto& [k, s] = sample;
    const double C = compliance_(k, k);
    double off = std::abs(std::min(one.term->gaps()[s], C * one.term->forces()[s]));
    if (frictional) off = std::max(off, lack_of_friction(*one.rigid, sample));
    lack.largest = std::max(lack.largest, off / one.term->error_at(s, body_.now()));
    lack.force = std::hypot(lack.force, off / C);
  }
  return lack;
}

double ContactCoupling::contact_violation() const {
  return body_.tool_contact() ? lack_of(body_.contacts().front()).largest : 0.0;
}

// Residual with the contact error of the measured tool.
double ContactCoupling::with_tool(double residual, const Lack& lack, double reactions,
                                  double tolerance) const {
  // While the contact error is too large it counts as under the default tolerance or more. Under a stricter
  // one an unsupported body would otherwise look better than all later states.
  const double counts = lack.largest > 1.0 ? std::max(tolerance, mixed_constants.usual_tolerance) : tolerance;
  residual = std::max(residual, counts * lack.largest);
  // No force acts yet: all of it is missing, however small the penetration.
  const double nothing = std::max(mixed_constants.negligible_reactions * lack.force, body_.least_reactions());
  if (lack.largest > 1.0 && reactions <= nothing) residual = std::max(residual, 1.0);
  return residual;
}

double ContactCoupling::residual_with_contact(double residual, double reactions, double tolerance) const {
  Lack others;
  for (const System::OneContact& one : body_.contacts()) {
    const Lack its = lack_of(one);
    if (one.rigid && one.rigid->is_measured()) {
      residual = with_tool(residual, its, reactions, tolerance);
      continue;
    }
    others.largest = std::max(others.largest, its.largest);
    others.force = std::hypot(others.force, its.force);
  }
  // There are no reactions at all where nothing is in contact yet.
  reactions = std::max(reactions, mixed_constants.negligible_reactions * others.force);
  return std::max(residual, others.largest > 1.0
                                ? std::max(tolerance * others.largest, others.force / reactions)
                                : tolerance * others.largest);
}

// [active] N: changes of the normal forces; `normal` [3 x active] receives their directions.
Eigen::VectorXd ContactCoupling::normal_forces(double gap_factor, const Nodal& du, Points& normal) const {
  const Index count = compliance_.rows();
  Eigen::VectorXd gap(count), before(count);
  normal.resize(3, count);
  for (Index k = 0; k < count; ++k) {
    const Index sample = active(k).sample;
    const ContactTerm& of = *contact_of(k).term;
    before[k] = of.forces()[sample];
    normal.col(k) = of.normals().col(sample);
    gap[k] = gap_factor * of.gaps()[sample];
    visit_nodes(k, [&](int a, double w) { gap[k] += w * normal.col(k).dot(du.col(a).head<3>()); });
  }
  return contact_step(compliance_, normal, gap, before);
}

// Displacement of a sample by du and by the changes of all normal forces [m].
Vec3 ContactCoupling::displacement(Index row, const Eigen::VectorXd& of_normals, const Points& normal,
                                   const Nodal& du) const {
  Vec3 move = Vec3::Zero();
  visit_nodes(row, [&](int a, double w) { move += w * du.col(a).head<3>(); });
  for (Index t = 0; t < of_normals.size(); ++t)
    if (of_normals[t] != 0.0) move += compliance_(row, t) * of_normals[t] * normal.col(t);
  return move;
}

// The change [3xM] N of one contact's friction, in addition to the changes of all normal forces.
Points ContactCoupling::friction(const RigidContact& rigid, const Eigen::VectorXd& of_normals,
                                 const Points& normal, double gap_factor, const Nodal& du) const {
  const std::vector<Sample> own = samples_of(&rigid);
  const auto count = static_cast<Index>(own.size());
  std::vector<Index> row;
  Points slip(3, count), its_normal(3, count), before(3, count);
  Eigen::VectorXd bound(count);
  for (Index i = 0; i < count; ++i) {
    const auto& [k, s] = own[static_cast<std::size_t>(i)];
    row.push_back(k);
    const Vec3 n = its_normal.col(i) = rigid.normals().col(s);
    slip.col(i) = gap_factor * rigid.slips().col(s);
    before.col(i) = rigid.friction_forces().col(s);
    bound[i] = rigid.bound(s, rigid.forces()[s] + of_normals[k]);
    if (!(bound[i] > 0.0)) continue;
    const Vec3 move = displacement(k, of_normals, normal, du);
    slip.col(i) += move - n * n.dot(move);
  }
  const Points of_own = friction_step(compliance_(row, row), its_normal, slip, before, bound);
  Points change = Points::Zero(3, rigid.count());
  for (Index i = 0; i < count; ++i) change.col(own[static_cast<std::size_t>(i)].number) = of_own.col(i);
  return change;
}

void ContactCoupling::apply(double gap_factor, const Nodal& du, Nodal& r,
                            Eigen::Ref<Eigen::VectorXd> change) const {
  change.setZero();
  Points normal;
  const Eigen::VectorXd of_normals = normal_forces(gap_factor, du, normal);
  for (Index k = 0; k < of_normals.size(); ++k) change[unknown_of(k)] = of_normals[k];
  for (const System::OneContact& one : body_.contacts()) {
    one.term->spread(Eigen::VectorXd(change.segment(one.first, one.term->count())), r);
    if (!(one.rigid && one.rigid->has_friction())) continue;
    const Points of_friction = friction(*one.rigid, of_normals, normal, gap_factor, du);
    one.rigid->spread(of_friction, r);
    change.segment(one.first + one.rigid->count(), of_friction.size()) =
        Eigen::Map<const Eigen::VectorXd>(of_friction.data(), of_friction.size());
  }
}

}  // namespace dimple
