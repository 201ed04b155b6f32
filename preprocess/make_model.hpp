#pragma once

#include <vector>

#include "preprocess/model.hpp"
#include "preprocess/stages.hpp"

namespace dimple {

/// Makes a solver's model from a discretisation: supports, gradients, masses and, if the scheme has them,
/// gradients consistent with the surface (where there is one) and pressure patches.
///
/// `tissue` [Q]: number of each point's tissue, from 0; `density` of each tissue [kg/m^3]. `stages`, if
/// given, receives the time of each step. Throws ModelError: a place without enough nodes, a tenth of the
/// supports had to be enlarged, a node without mass; Stopped.
Model make_model(Discretisation places, const Scheme& scheme, Eigen::VectorXi tissue,
                 const std::vector<double>& density, StageTimes* stages = nullptr);

}  // namespace dimple
