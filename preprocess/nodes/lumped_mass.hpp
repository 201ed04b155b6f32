#pragma once

#include "preprocess/model.hpp"

namespace dimple {

/// Nodal masses [N, kg]: m_a = sum_q rho_q V_q / n_q over the points q whose support has node a.
/// 1. Mass of each integration point: density x volume.
/// 2. Divide it equally among the n_q nodes of its support, and sum at the nodes.
///
/// Source: Horton et al. 2007, section 2.3, last but one paragraph. Throws ModelError: a node in no support
/// would have no mass.
Eigen::VectorXd lumped_mass(const Model& model, const Eigen::VectorXd& density);

}  // namespace dimple
