#include "solver/terms/internal_force.hpp"

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
      patches_(model.scheme.pressure_patches) {
  if (precision == Precision::single_)
    single_ = std::make_unique<ProjectedKernel<float>>(model, tissues);
  else
    double_ = std::make_unique<ProjectedKernel<double>>(model, tissues);
}

void ForceSystem::gradients_at(Index q, std::vector<int>& node, Points& dphi) const {
  if (single_)
    single_->gradients_at(q, node, dphi);
  else
    double_->gradients_at(q, node, dphi);
}

bool ForceSystem::viscoelastic() const {
  return relaxes(tissues_.material);
}

template <class Then>
decltype(auto) ForceState::with(const Then& then) {
  return system_->single_ ? then(*system_->single_, std::get<0>(state_))
                          : then(*system_->double_, std::get<1>(state_));
}
template <class Then>
decltype(auto) ForceState::with(const Then& then) const {
  return system_->single_ ? then(*system_->single_, std::get<0>(state_))
                          : then(*system_->double_, std::get<1>(state_));
}

ForceState::ForceState(const ForceSystem& system) : system_(&system) {
  if (system.single_)
    state_ = system.single_->undeformed();
  else
    state_ = system.double_->undeformed();
}

ForceState::Sweep ForceState::stress_sweep(const Nodal& u) {
  ++sweeps_;
  assert(u.cols() == system_->node_count());
  return with([&](const auto& kernel, auto& state) {
    const auto sweep = kernel.stress_sweep(state, u.data());
    return Sweep{sweep.J_min, sweep.point, sweep.inverted, system_->patches_};
  });
}

void ForceState::gather_sweep(Nodal& f, const std::function<void(Index, Index)>& then) const {
  const Index nodes = system_->node_count();
  assert(f.cols() == nodes);
  const Index blocks = (nodes + nodes_per_block - 1) / nodes_per_block;
  tbb::parallel_for(
      tbb::blocked_range<Index>(0, blocks, 4),
      [&](const tbb::blocked_range<Index>& range) {
        const Index first = range.begin() * nodes_per_block,
                    last = std::min(range.end() * nodes_per_block, nodes);
        with([&](const auto& kernel, const auto& state) { kernel.gather(state, f.data(), first, last); });
        if (then) then(first, last);
      },
      tbb::static_partitioner());
}

ForceState::Sweep ForceState::internal_force(const Nodal& u, Nodal& f) {
  const Sweep sweep = stress_sweep(u);
  gather_sweep(f, {});
  return sweep;
}

double ForceState::stored_energy(const Nodal& u, double* hourglass) {
  return with(
      [&](const auto& kernel, auto& state) { return kernel.stored_energy(state, u.data(), hourglass); });
}

double ForceState::dilation(Index q) const {
  return with([&](const auto& kernel, const auto& state) { return kernel.dilation(state, q); });
}

Eigen::Matrix<double, 9, Eigen::Dynamic> ForceState::deformation_gradients() const {
  Eigen::Matrix<double, 9, Eigen::Dynamic> result(9, system_->point_count());
  with([&](const auto& kernel, const auto& state) {
    for (Index q = 0; q < result.cols(); ++q)
      Eigen::Map<Mat3>(result.col(q).data()) = kernel.deformation_gradient(state, q);
  });
  return result;
}

Eigen::Matrix<double, 9, Eigen::Dynamic> ForceState::stresses() const {
  return with([](const auto& kernel, const auto& state) { return kernel.stresses(state); });
}

void ForceState::begin_step(double dt) {
  with([&](const auto& kernel, auto& state) { kernel.begin_step(state, dt); });
}

void ForceState::accept_step(const Nodal& u) {
  with([&](const auto& kernel, auto& state) { kernel.accept(state, u.data()); });
}

std::vector<double> ForceState::past() const {
  return with([](const auto& kernel, const auto& state) { return kernel.past(state); });
}

void ForceState::restore_past(const std::vector<double>& past) {
  with([&](const auto& kernel, auto& state) { kernel.restore_past(state, past); });
}

void ForceState::hold_pressures(const Eigen::VectorXd& pressure) {
  with([&](const auto& kernel, auto& state) { kernel.hold(state, pressure); });
}

void ForceState::press_around(double pressure) {
  with([&](const auto&, auto& state) { state.around = static_cast<decltype(state.around)>(pressure); });
}

double ForceState::pressure_around() const {
  return with([](const auto&, const auto& state) { return static_cast<double>(state.around); });
}

void ForceState::patch_state(Patches& patches) const {
  with([&](const auto& kernel, const auto& state) {
    kernel.patch_state(state, patches.dilation, patches.bulk);
  });
}

void ForceState::patch_gradients(const CompressedRows& nodes, Eigen::Matrix4Xf& gradient) const {
  with([&](const auto& kernel, const auto& state) { kernel.patch_gradients(state, nodes, gradient); });
}

Nodal to_nodal(const Points& values) {
  Nodal result = Nodal::Zero(4, values.cols());
  result.topRows<3>() = values;
  return result;
}

}  // namespace dimple
