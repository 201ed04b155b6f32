#include "solver/terms/tool_force.hpp"

#include <Eigen/Geometry>

namespace dimple {

Wrench wrench_on_tool(const Model& model, const Constraints& constraints, const Nodal& u, const Nodal& f,
                      const Vec3& reference) {
  Wrench sum = Wrench::Zero();
  for (const Index a : model.bonded_patch) {
    const Vec3 holds = (f.col(a) - constraints.project(a, f.col(a))).head<3>();
    const Vec3 arm = model.X.col(a) + u.col(a).head<3>() - reference;
    sum.head<3>() -= holds;
    sum.tail<3>() -= arm.cross(holds);
  }
  return sum;
}

double along_approach(const Model& model, const std::vector<Index>& nodes, const Nodal& f) {
  const Eigen::Vector4d approach = padded(model.tool.approach);
  double sum = 0.0;
  for (const Index a : nodes) sum += f.col(a).dot(approach);
  return sum;
}

double lateral_fraction(const Wrench& on_tool, const Vec3& approach) {
  const Vec3 force = on_tool.head<3>();
  const double whole = force.norm();
  return whole > 0.0 ? (force - force.dot(approach) * approach).norm() / whole : 0.0;
}

}  // namespace dimple
