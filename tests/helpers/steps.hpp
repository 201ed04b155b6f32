#pragma once

#include "preprocess/make_model.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple::testing_bodies {

/// Runs this step of make_model() alone, with supports of any size.
inline SupportReport find_supports(Model& model, const SupportOptions& options) {
  model.scheme.support = options;
  if (model.tissue.size() != model.point_count()) model.tissue = Eigen::VectorXi::Zero(model.point_count());
  dimple::find_supports(model);
  return model.support_report;
}

}  // namespace dimple::testing_bodies
