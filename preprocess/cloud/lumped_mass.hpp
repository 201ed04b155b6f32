#pragma once

#include "preprocess/model.hpp"

namespace dimple {

/// Nodal masses [N, kg]: each integration point's mass, density x volume, shared equally among its support.
///
/// The sum is density x total volume. Source: Horton et al. 2007, section 2.3, last but one paragraph.
/// Throws ModelError if a node is in no support: it would have no mass.
Eigen::VectorXd lumped_mass(const Model& model, const Eigen::VectorXd& density);

}  // namespace dimple
