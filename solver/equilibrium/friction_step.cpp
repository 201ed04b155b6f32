#include "solver/equilibrium/friction_step.hpp"

#include <algorithm>
#include <vector>

#include "io/stop.hpp"
#include "solver/terms/rigid_contact.hpp"

// Projected Gauss-Seidel iteration for friction with known normal forces:
// 1. Samples with a positive bound take part; all others lose their friction.
// 2. First forces: those before, in the tangent planes and within the bounds.
// 3. moved_s = slip_s + sum_t C_st (t_t - before_t).
// 4. Sample after sample: t_s = projection of t_s - P_s moved_s / C_ss onto |t| <= bound_s; update all moved.
// 5. Repeat 4 until a round moves no sample by more than 1e-4 of the largest slip, at most 60 times.
// 6. Return t - before.
//
// Source:   Wriggers 2006, sections 4.2 and 5.2; Jourdan, Alart, Jean 1998.
// Departs:  normal forces are fixed; the mixed iteration alternates between both.

namespace dimple {
namespace {

constexpr int most_rounds = 60;
constexpr double still = 1e-4;  // largest motion in a round, of the largest slip

}  // namespace

Points friction_step(const Eigen::MatrixXd& compliance, const Points& normal, const Points& slip,
                     const Points& before, const Eigen::VectorXd& bound) {
  std::vector<Index> frictional, had;
  for (Index s = 0; s < bound.size(); ++s) {
    if (bound[s] > 0.0) frictional.push_back(s);
    if (bound[s] > 0.0 || !before.col(s).isZero(0.0)) had.push_back(s);
  }
  // Initial forces, projected into their cones. `moved`: slips of the samples with friction under these
  // forces.
  Points force = Points::Zero(3, bound.size());
  for (const Index s : frictional)
    force.col(s) = brought_within(bound[s], before.col(s) - normal.col(s) * normal.col(s).dot(before.col(s)));
  const auto n = static_cast<Index>(frictional.size());
  const Eigen::MatrixXd among = compliance(frictional, frictional);
  Eigen::MatrixX3d moved(n, 3);
  double largest = 0.0;
  for (Index i = 0; i < n; ++i) {
    const Index s = frictional[static_cast<std::size_t>(i)];
    Vec3 sum = slip.col(s);
    for (const Index t : had) sum += compliance(s, t) * (force.col(t) - before.col(t));
    moved.row(i) = sum;
    largest = std::max(largest, slip.col(s).norm());
  }
  double last = largest;
  for (int round = 0; round < most_rounds && last > still * largest; ++round) {
    stop_if_requested();
    last = 0.0;
    for (Index i = 0; i < n; ++i) {
      const Index s = frictional[static_cast<std::size_t>(i)];
      const Vec3 here = moved.row(i).transpose(), across = here - normal.col(s) * normal.col(s).dot(here);
      const Vec3 requested = brought_within(bound[s], force.col(s) - across / among(i, i));
      const Vec3 change = requested - force.col(s);
      if (change.isZero(0.0)) continue;
      force.col(s) = requested;
      for (int c = 0; c < 3; ++c) moved.col(c) += change[c] * among.col(i);
      last = std::max(last, among(i, i) * change.norm());
    }
  }
  return force - before;
}

}  // namespace dimple
