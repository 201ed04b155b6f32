#include "solver/equilibrium/contact_step.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

#include "io/stop.hpp"

// Primal-dual active sets for lambda >= 0, q + K lambda >= 0:
// 1. q = gap - K before: the gaps without contact forces.
// 2. First set: samples with a force, or with a negative gap.
// 3. Solve K lambda = -q within the set, with lambda = 0 outside.
// 4. Next set: members with lambda > 0, and others whose gap q + K lambda is negative. Repeat 3 until the set
//    is unchanged.
// 5. After 40 sets: projected Gauss-Seidel sweeps, until forces change by less than 1e-10 of the largest.
// 6. Return max(lambda, 0) - before.
//
// Source:   Hintermueller, Ito, Kunisch 2002; Cryer 1971 (step 5, our addition). See the header.

namespace dimple {
namespace {

constexpr int most_sets = 40, most_sweeps = 2000;
constexpr double most_products = 1e9;      // of all sweeps: a second or two
constexpr double converged_sweep = 1e-10;  // change of a force in a sweep, of the largest force

// Projected Gauss-Seidel sweeps: each force in turn closes its own gap.
template <class Stiffness>
void sweep_until_still(const Stiffness& K, const Eigen::VectorXd& q, Eigen::VectorXd& lambda) {
  lambda = lambda.cwiseMax(0.0).eval();
  const double a_sweep = static_cast<double>(lambda.size()) * static_cast<double>(lambda.size());
  for (int sweep = 0; sweep < most_sweeps && sweep * a_sweep < most_products; ++sweep) {
    stop_if_requested();
    double change = 0.0;
    for (Index s = 0; s < lambda.size(); ++s) {
      double open = q[s];
      for (Index t = 0; t < lambda.size(); ++t) open += K(s, t) * lambda[t];
      const double force = std::max(0.0, lambda[s] - open / K(s, s));
      change = std::max(change, std::abs(force - lambda[s]));
      lambda[s] = force;
    }
    if (change <= converged_sweep * lambda.maxCoeff()) return;
  }
}

}  // namespace

Eigen::VectorXd contact_step(const Eigen::MatrixXd& compliance, const Points& normal,
                             const Eigen::VectorXd& gap, const Eigen::VectorXd& before) {
  const Index count = gap.size();
  const auto K = [&](Index s, Index t) { return compliance(s, t) * normal.col(s).dot(normal.col(t)); };
  Eigen::VectorXd q = gap;
  for (Index t = 0; t < count; ++t)
    if (before[t] != 0.0)
      for (Index s = 0; s < count; ++s) q[s] -= K(s, t) * before[t];
  std::vector<Index> in_contact;
  for (Index s = 0; s < count; ++s)
    if (before[s] > 0.0 || gap[s] < 0.0) in_contact.push_back(s);
  Eigen::VectorXd lambda = Eigen::VectorXd::Zero(count);
  bool found = false;
  for (int set = 0; set < most_sets && !found; ++set) {
    stop_if_requested();
    const auto n = static_cast<Index>(in_contact.size());
    Eigen::MatrixXd of_contacts(n, n);
    Eigen::VectorXd b(n);
    for (Index j = 0; j < n; ++j) {
      const Index t = in_contact[static_cast<std::size_t>(j)];
      b[j] = -q[t];
      for (Index i = j; i < n; ++i) of_contacts(i, j) = K(in_contact[static_cast<std::size_t>(i)], t);
    }
    // Column by column: the bits of a factor in blocks depend on the processor's caches (Multigrid).
    if (n > 0) b = Eigen::LDLT<Eigen::MatrixXd, Eigen::Lower>(of_contacts).solve(b).eval();
    lambda.setZero();
    Eigen::VectorXd open = q;
    for (Index j = 0; j < n; ++j) {
      const Index t = in_contact[static_cast<std::size_t>(j)];
      lambda[t] = b[j];
      for (Index s = 0; s < count; ++s) open[s] += K(s, t) * b[j];
    }
    std::vector<char> visited(static_cast<std::size_t>(count), 0);
    for (const Index t : in_contact) visited[static_cast<std::size_t>(t)] = 1;
    std::vector<Index> next;
    for (Index s = 0; s < count; ++s)
      if (visited[static_cast<std::size_t>(s)] ? lambda[s] > 0.0 : open[s] < 0.0) next.push_back(s);
    found = next == in_contact;
    in_contact = std::move(next);
  }
  if (!found) sweep_until_still(K, q, lambda);
  return lambda.cwiseMax(0.0) - before;
}

}  // namespace dimple
