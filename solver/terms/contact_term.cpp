#include "solver/terms/contact_term.hpp"

namespace dimple {

void ContactTerm::spread(const Eigen::VectorXd& force, Nodal& f) const {
  const auto& [rows, weight] = moves();
  for (Index s = 0; s < count(); ++s) {
    if (force[s] == 0.0) continue;
    for (int k = rows.offset[s]; k < rows.offset[s + 1]; ++k)
      f.col(rows.member[k]).head<3>() -= (weight[k] * force[s]) * normal_.col(s);
  }
}

void ContactTerm::spread(const Points& force, Nodal& f) const {
  const auto& [rows, weight] = moves();
  for (Index s = 0; s < count(); ++s) {
    if (force.col(s).isZero(0.0)) continue;
    for (int k = rows.offset[s]; k < rows.offset[s + 1]; ++k)
      f.col(rows.member[k]).head<3>() -= weight[k] * force.col(s);
  }
}

}  // namespace dimple
