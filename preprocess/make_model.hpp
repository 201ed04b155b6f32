#pragma once

#include <vector>

#include "preprocess/model.hpp"
#include "preprocess/stages.hpp"

namespace dimple {

/// Makes a discretisation a model that a solver can take: supports, gradients, masses, and, as the scheme has
/// them, gradients that are consistent with the surface (where there is one) and pressure patches.
///
/// `tissue` [Q]: number of each point's tissue, from 0; `density` of each tissue [kg/m^3]. `stages`, if
/// given, receives how long each step took. Throws ModelError: a place without enough nodes, a tenth of the
/// supports had to be enlarged, a node without mass; Stopped.
Model make_model(Discretisation places, const Scheme& scheme, Eigen::VectorXi tissue,
                 const std::vector<double>& density, Stages* stages = nullptr);

}  // namespace dimple
