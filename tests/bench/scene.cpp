#include "tests/bench/scene.hpp"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <map>

#include "preprocess/image/phantom.hpp"
#include "tests/bench/reference_force.hpp"

namespace dimple {
namespace {

// Displacement: 2 mm under the tool, less around it, zero at the base. Smooth, so every J stays positive.
ForceSystem::Nodal dent(const Model& model) {
  const Vec3& approach = model.tool.approach;
  const Eigen::VectorXd along = model.X.transpose() * approach;
  const double top = model.tool.centre.dot(approach), height = along.maxCoeff() - top;
  ForceSystem::Nodal u = ForceSystem::Nodal::Zero(4, model.node_count());
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 from = model.X.col(a) - model.tool.centre;
    const double away = (from - from.dot(approach) * approach).norm() / (2.0 * model.tool.radius);
    u.col(a).head<3>() = 2e-3 * (1.0 - (along[a] - top) / height) / (1.0 + away * away) * approach;
  }
  return u;
}

template <class Real>
double difference_of_reference(const MeasuredBlock& scene, const ForceSystem::Nodal& f) {
  ReferenceForce<Real> reference(scene.model, scene.material);
  set_displacement(reference, scene.u);
  evaluate(reference);
  return (force_of(reference) - f).cwiseAbs().maxCoeff() / f.cwiseAbs().maxCoeff();
}

void compare_with_reference(const MeasuredBlock& scene) {
  const ForceSystem exact(scene.model, scene.material),
      single(scene.model, scene.material, Precision::single_);
  ForceState exact_forces(exact), single_forces(single);
  ForceSystem::Nodal f = scene.u, g = scene.u;
  exact_forces.internal_force(scene.u, f);
  single_forces.internal_force(scene.u, g);
  const auto demand = [&](const char* what, double difference, double least) {
    if (difference <= least) return;
    fmt::print(
        stderr,
        "error: {} differs from the converging scheme's force in double precision by {:.2g} of the largest "
        "nodal force, {:.2g} allowed ({} nodes): times of a wrong force are worth nothing\n",
        what, difference, least, scene.model.node_count());
    std::exit(1);
  };
  demand("the reference in double precision", difference_of_reference<double>(scene, f), 1e-9);
  demand("the reference in single precision", difference_of_reference<float>(scene, f), 1e-3);
  demand("the product's force in single precision", (f - g).cwiseAbs().maxCoeff() / f.cwiseAbs().maxCoeff(),
         1e-3);
}

}  // namespace

Model whole_model(const LabelImage& image, const Scene& run) {
  const SegmentedBody body = make_body_surface(image, {});
  return build_model(body.surface, model_options(run), {.density = {material_of(run).density}}).model;
}

namespace {
std::map<std::pair<std::string, Index>, MeasuredBlock> made;
}  // namespace

const MeasuredBlock& scene(const std::string& scheme, Index nodes) {
  const auto found = made.find({scheme, nodes});
  if (found != made.end()) return found->second;
  MeasuredBlock& now = made[{scheme, nodes}];
  now.run.scheme = scheme;
  now.run.node_set.nodes = nodes;
  now.image = make_phantom({.shape = "block", .size_mm = {60.0, 60.0, 30.0}});
  now.material = material_of(now.run);
  now.model = whole_model(now.image, now.run);
  now.u = dent(now.model);
  if (now.model.scheme.pressure_patches) compare_with_reference(now);
  return now;
}

std::string scene_facts() {
  std::string text;
  for (const auto& [key, s] : made)
    text += fmt::format(
        "# scene: {}, {} nodes: {} points, {} pairs, {} patches, {} shares, {} entries of variance\n",
        key.first, s.model.node_count(), s.model.point_count(), s.model.support.member.size(),
        s.model.patches.count(), s.model.patches.psi.size(),
        s.model.variance.empty() ? 0 : s.model.variance.front().K.size());
  return text;
}

}  // namespace dimple
