#include "preprocess/nodes/lumped_mass.hpp"

#include <fmt/format.h>

#include "io/error.hpp"
#include "io/stop.hpp"

namespace dimple {

Eigen::VectorXd lumped_mass(const Model& model, const Eigen::VectorXd& density) {
  Eigen::VectorXd mass = Eigen::VectorXd::Zero(model.node_count());
  for (Index q = 0; q < model.point_count(); ++q) {
    if (q % 4096 == 0) stop_if_requested();
    const double fraction = density[q] * model.volume[q] / static_cast<double>(model.support.count(q));
    for (int k = model.support.offset[q]; k < model.support.offset[q + 1]; ++k)
      mass[model.support.member[k]] += fraction;
  }
  Index a = 0;
  if (!(mass.minCoeff(&a) > 0.0)) {
    const Vec3 x = model.X.col(a) * 1e3;
    throw ModelError(
        {.fact = fmt::format("node {} is in no support domain, so it has no mass", a),
         .where = fmt::format("nodal masses; node at ({:.2f}, {:.2f}, {:.2f}) mm", x.x(), x.y(), x.z()),
         .why = "no integration point is within its support radius",
         .remedy = "use more integration points (--points) or a larger support.radius_factor"});
  }
  return mass;
}

}  // namespace dimple
