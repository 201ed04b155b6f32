#include "solver/internal_force.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cmath>

namespace dimple {
namespace {

constexpr Index nodes_per_block = 64;

}  // namespace

ForceSystem::ForceSystem(const Model& model, const Material& material, Precision precision)
    : ForceSystem(model, {{material}, Eigen::VectorXi::Zero(model.point_count())}, precision) {}

ForceSystem::ForceSystem(const Model& model, const Tissues& tissues, Precision precision)
    : tissues_(tissues),
      nodes_(model.node_count()),
      points_(model.point_count()),
      pairs_(model.support.member.size()),
      patches_(model.patches.count() > 0) {
  if (precision == Precision::single_)
    single_ = std::make_unique<ProjectedKernel<float>>(model, tissues);
  else
    double_ = std::make_unique<ProjectedKernel<double>>(model, tissues);
}

ForceSystem::Sweep ForceSystem::stress_sweep(const Nodal& u) const {
  assert(u.cols() == node_count());
  const auto of_kernel = [&](const auto& sweep) {
    return Sweep{sweep.J_min, sweep.point, sweep.inverted, patches_};
  };
  return single_ ? of_kernel(single_->stress_sweep(u.data())) : of_kernel(double_->stress_sweep(u.data()));
}

void ForceSystem::gather_sweep(Nodal& f, const std::function<void(Index, Index)>& then) const {
  assert(f.cols() == node_count());
  const Index blocks = (node_count() + nodes_per_block - 1) / nodes_per_block;
  tbb::parallel_for(
      tbb::blocked_range<Index>(0, blocks, 4),
      [&](const tbb::blocked_range<Index>& range) {
        const Index first = range.begin() * nodes_per_block,
                    last = std::min(range.end() * nodes_per_block, node_count());
        if (single_)
          single_->gather(f.data(), first, last);
        else
          double_->gather(f.data(), first, last);
        if (then) then(first, last);
      },
      tbb::static_partitioner());
}

ForceSystem::Sweep ForceSystem::internal_force(const Nodal& u, Nodal& f) const {
  const Sweep sweep = stress_sweep(u);
  gather_sweep(f, {});
  return sweep;
}

Eigen::Matrix<double, 9, Eigen::Dynamic> ForceSystem::deformation_gradients(const Nodal& u) const {
  stress_sweep(u);
  Eigen::Matrix<double, 9, Eigen::Dynamic> result(9, point_count());
  for (Index q = 0; q < point_count(); ++q)
    Eigen::Map<Mat3>(result.col(q).data()) =
        single_ ? single_->deformation_gradient(q) : double_->deformation_gradient(q);
  return result;
}

Eigen::Matrix<double, 9, Eigen::Dynamic> ForceSystem::stresses(const Nodal& u) const {
  stress_sweep(u);
  Eigen::Matrix<double, 9, Eigen::Dynamic> result(9, point_count());
  for (Index q = 0; q < point_count(); ++q)
    Eigen::Map<Mat3>(result.col(q).data()) = single_ ? single_->stress(q) : double_->stress(q);
  return result;
}

void ForceSystem::gradients_at(Index q, std::vector<int>& node, Points& dphi) const {
  if (single_)
    single_->gradients_at(q, node, dphi);
  else
    double_->gradients_at(q, node, dphi);
}

void ForceSystem::begin_step(double dt) const {
  if (single_) single_->begin_step(dt);
  if (double_) double_->begin_step(dt);
}

void ForceSystem::accept_step(const Nodal& u) const {
  if (single_) single_->accept(u.data());
  if (double_) double_->accept(u.data());
}

std::vector<double> ForceSystem::past() const {
  return single_ ? single_->past() : double_->past();
}

void ForceSystem::restore_past(const std::vector<double>& past) const {
  if (single_) single_->restore_past(past);
  if (double_) double_->restore_past(past);
}

void ForceSystem::hold_pressures(const Eigen::VectorXd& pressure) const {
  if (single_) single_->hold(pressure);
  if (double_) double_->hold(pressure);
}

void ForceSystem::patch_state(Patches& patches) const {
  if (single_) single_->patch_state(patches.dilation, patches.bulk);
  if (double_) double_->patch_state(patches.dilation, patches.bulk);
}

void ForceSystem::patch_gradients(const CompressedRows& nodes, Eigen::Matrix4Xf& gradient) const {
  if (single_) single_->patch_gradients(nodes, gradient);
  if (double_) double_->patch_gradients(nodes, gradient);
}

bool ForceSystem::viscoelastic() const {
  return std::any_of(tissues_.material.begin(), tissues_.material.end(),
                     [](const Material& m) { return !m.prony.empty(); });
}

double ForceSystem::stored_energy(const Nodal& u, double* unseen) const {
  return single_ ? single_->stored_energy(u.data(), unseen) : double_->stored_energy(u.data(), unseen);
}

ForceSystem::Nodal to_nodal(const Points& values) {
  ForceSystem::Nodal result = ForceSystem::Nodal::Zero(4, values.cols());
  result.topRows<3>() = values;
  return result;
}

}  // namespace dimple
