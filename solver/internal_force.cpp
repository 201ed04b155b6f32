#include "solver/internal_force.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cmath>

#include "solver/clones.hpp"
#include "solver/inverse_cube_root.hpp"

namespace dimple {
namespace {

constexpr Index points_per_block = 128;
constexpr Index nodes_per_block = 64;

using Vec4 = double __attribute__((vector_size(32), aligned(8), may_alias));

}  // namespace

ForceSystem::ForceSystem(const Model& model, const Material& material, Precision precision)
    : ForceSystem(model, {{material}, Eigen::VectorXi::Zero(model.point_count())}, precision) {}

ForceSystem::ForceSystem(const Model& model, const Tissues& tissues, Precision precision)
    : tissues_(tissues),
      material_(tissues.material.front()),
      nodes_(model.node_count()),
      points_(model.point_count()),
      pairs_(model.support.member.size()) {
  if (model.patches.count() > 0) {
    if (precision == Precision::single_)
      single_ = std::make_unique<ProjectedKernel<float>>(model, tissues);
    else
      double_ = std::make_unique<ProjectedKernel<double>>(model, tissues);
    return;
  }
  Eigen::VectorXi slot;
  const CompressedRows influence = transpose(model.support, model.node_count(), &slot);
  const auto& rows = model.support;

  point_offset_.assign(rows.offset.begin(), rows.offset.end());
  by_point_.resize(static_cast<std::size_t>(rows.member.size()));
  for (Index k = 0; k < rows.member.size(); ++k)
    by_point_[static_cast<std::size_t>(k)] = {{model.dphi(0, k), model.dphi(1, k), model.dphi(2, k)},
                                              rows.member[k]};

  node_offset_.assign(influence.offset.begin(), influence.offset.end());
  by_node_.resize(by_point_.size());
  for (Index k = 0; k < influence.member.size(); ++k) {
    const int s = slot[k];
    by_node_[static_cast<std::size_t>(k)] = {{model.dphi(0, s), model.dphi(1, s), model.dphi(2, s)},
                                             influence.member[k]};
  }

  volume_.assign(model.volume.begin(), model.volume.end());
  stress_.resize(volume_.size());
  block_.resize(static_cast<std::size_t>((point_count() + points_per_block - 1) / points_per_block));
}

// The stress of four points at once: lane l of every register belongs to point first + l.
DIMPLE_CLONES
void ForceSystem::sweep_block(const ForceSystem& system, const double* u, Index first, Index last,
                              Sweep& result) {
  const double mu = system.material_.mu;
  const bool printed = system.material_.as_printed;
  const double bulk = printed ? system.material_.kappa - 2.0 / 3.0 * mu : system.material_.kappa;
  const double third = printed ? 0.0 : 1.0 / 3.0;
  const Pair* pair = system.by_point_.data();
  const Vec4* node = reinterpret_cast<const Vec4*>(u);

  for (Index q = first; q < last; q += 4) {
    const int lanes = static_cast<int>(std::min<Index>(4, last - q));
    alignas(32) double H[3][3][4] = {};  // [column][row][lane] of F - I
    alignas(32) double V[4] = {};
    for (int lane = 0; lane < lanes; ++lane) {
      const auto point = static_cast<std::size_t>(q + lane);
      Vec4 h0 = {}, h1 = {}, h2 = {};
      for (std::int32_t k = system.point_offset_[point], end = system.point_offset_[point + 1]; k < end;
           ++k) {
        const Vec4 ua = node[pair[k].number];
        h0 += ua * pair[k].d[0];
        h1 += ua * pair[k].d[1];
        h2 += ua * pair[k].d[2];
      }
      for (int i = 0; i < 3; ++i) {
        H[0][i][lane] = h0[i];
        H[1][i][lane] = h1[i];
        H[2][i][lane] = h2[i];
      }
      V[lane] = system.volume_[point];
    }
    Vec4 h[3][3];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) h[i][j] = *reinterpret_cast<const Vec4*>(H[j][i]);

    // J - 1 from H, not det F - 1: near rest the latter loses the digits that kappa then multiplies.
    const Vec4 minors = (h[0][0] * h[1][1] - h[0][1] * h[1][0]) + (h[0][0] * h[2][2] - h[0][2] * h[2][0]) +
                        (h[1][1] * h[2][2] - h[1][2] * h[2][1]);
    const Vec4 det = h[0][0] * (h[1][1] * h[2][2] - h[1][2] * h[2][1]) -
                     h[0][1] * (h[1][0] * h[2][2] - h[1][2] * h[2][0]) +
                     h[0][2] * (h[1][0] * h[2][1] - h[1][1] * h[2][0]);
    const Vec4 dilation = (h[0][0] + h[1][1] + h[2][2]) + minors + det;
    Vec4 J = 1.0 + dilation;
    bool whole = true;
    for (int lane = 0; lane < lanes; ++lane) {
      if (J[lane] > 0.0 && std::isfinite(J[lane])) {
        if (J[lane] < result.J_min) result = {J[lane], q + lane};
        continue;
      }
      whole = false;  // inverted, or not a number: no stress here, and the driver stops the run
      if (result.ok()) result = {std::isfinite(J[lane]) ? J[lane] : std::nan(""), q + lane};
      J[lane] = 1.0;
      V[lane] = 0.0;
    }

    Vec4 root;
    for (int lane = 0; lane < 4; ++lane) root[lane] = inverse_cube_root_guess(J[lane]);
    for (int pass = 0; pass < 4; ++pass) root = root * (4.0 - J * root * root * root) * (1.0 / 3.0);

    const Vec4 f00 = h[0][0] + 1.0, f11 = h[1][1] + 1.0, f22 = h[2][2] + 1.0;
    const Vec4 f01 = h[0][1], f02 = h[0][2], f10 = h[1][0], f12 = h[1][2], f20 = h[2][0], f21 = h[2][1];
    const Vec4 I1 = (f00 * f00 + f10 * f10 + f20 * f20) + (f01 * f01 + f11 * f11 + f21 * f21) +
                    (f02 * f02 + f12 * f12 + f22 * f22);
    const Vec4 volume = *reinterpret_cast<const Vec4*>(V);
    const Vec4 shear = volume * mu * root * root;  // V mu J^(-2/3)
    const Vec4 pressure = volume * bulk * dilation - third * shear * I1 / J;
    const Vec4 P[3][3] = {
        // [column][row] of V P = shear F + pressure cof F
        {shear * f00 + pressure * (f11 * f22 - f21 * f12), shear * f10 + pressure * (f21 * f02 - f01 * f22),
         shear * f20 + pressure * (f01 * f12 - f11 * f02)},
        {shear * f01 + pressure * (f12 * f20 - f22 * f10), shear * f11 + pressure * (f22 * f00 - f02 * f20),
         shear * f21 + pressure * (f02 * f10 - f12 * f00)},
        {shear * f02 + pressure * (f10 * f21 - f20 * f11), shear * f12 + pressure * (f20 * f01 - f00 * f21),
         shear * f22 + pressure * (f00 * f11 - f10 * f01)}};
    for (int lane = 0; lane < lanes; ++lane) {
      Stress& out = system.stress_[static_cast<std::size_t>(q + lane)];
      for (int j = 0; j < 3; ++j)
        *reinterpret_cast<Vec4*>(out.column[j]) = Vec4{P[j][0][lane], P[j][1][lane], P[j][2][lane], 0.0};
      if (!whole && V[lane] == 0.0) out = Stress{};
    }
  }
}

ForceSystem::Sweep ForceSystem::stress_sweep(const Nodal& u) const {
  assert(u.cols() == node_count());
  const auto of_kernel = [](const auto& sweep) {
    return Sweep{sweep.J_min, sweep.point, sweep.inverted, true};
  };
  if (single_) return of_kernel(single_->stress_sweep(u.data()));
  if (double_) return of_kernel(double_->stress_sweep(u.data()));
  const Index blocks = static_cast<Index>(block_.size());
  tbb::parallel_for(
      tbb::blocked_range<Index>(0, blocks, 4),
      [&](const tbb::blocked_range<Index>& range) {
        for (Index b = range.begin(); b < range.end(); ++b) {
          Sweep& sweep = block_[static_cast<std::size_t>(b)] = Sweep{};
          sweep_block(*this, u.data(), b * points_per_block,
                      std::min((b + 1) * points_per_block, point_count()), sweep);
        }
      },
      tbb::static_partitioner());
  Sweep result;
  for (const Sweep& sweep : block_) {
    if (result.ok() && (!sweep.ok() || sweep.J_min < result.J_min)) result = sweep;
  }
  return result;
}

DIMPLE_CLONES
void ForceSystem::gather_block(const ForceSystem& system, double* f, Index first, Index last) {
  const Pair* pair = system.by_node_.data();
  const Stress* stress = system.stress_.data();
  for (Index a = first; a < last; ++a) {
    Vec4 f0 = {}, f1 = {}, f2 = {};
    for (std::int32_t k = system.node_offset_[static_cast<std::size_t>(a)],
                      end = system.node_offset_[static_cast<std::size_t>(a) + 1];
         k < end; ++k) {
      const Vec4* column = reinterpret_cast<const Vec4*>(stress[pair[k].number].column);
      f0 += column[0] * pair[k].d[0];
      f1 += column[1] * pair[k].d[1];
      f2 += column[2] * pair[k].d[2];
    }
    reinterpret_cast<Vec4*>(f)[a] = f0 + f1 + f2;
  }
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
        else if (double_)
          double_->gather(f.data(), first, last);
        else
          gather_block(*this, f.data(), first, last);
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
  Eigen::Matrix<double, 9, Eigen::Dynamic> result(9, point_count());
  if (single_ || double_) {
    stress_sweep(u);
    for (Index q = 0; q < point_count(); ++q)
      Eigen::Map<Mat3>(result.col(q).data()) =
          single_ ? single_->deformation_gradient(q) : double_->deformation_gradient(q);
    return result;
  }
  tbb::parallel_for(Index{0}, point_count(), [&](Index q) {
    Mat3 F = Mat3::Identity();
    for (std::int32_t k = point_offset_[static_cast<std::size_t>(q)];
         k < point_offset_[static_cast<std::size_t>(q) + 1]; ++k) {
      const Pair& pair = by_point_[static_cast<std::size_t>(k)];
      F += u.col(pair.number).head<3>() * Eigen::RowVector3d(pair.d[0], pair.d[1], pair.d[2]);
    }
    Eigen::Map<Mat3>(result.col(q).data()) = F;
  });
  return result;
}

Eigen::Matrix<double, 9, Eigen::Dynamic> ForceSystem::stresses(const Nodal& u) const {
  if (!single_ && !double_) {
    auto result = deformation_gradients(u);
    for (Index q = 0; q < point_count(); ++q) {
      Eigen::Map<Mat3> at(result.col(q).data());
      at = pk1_stress(material_, at).eval();
    }
    return result;
  }
  stress_sweep(u);
  Eigen::Matrix<double, 9, Eigen::Dynamic> result(9, point_count());
  for (Index q = 0; q < point_count(); ++q)
    Eigen::Map<Mat3>(result.col(q).data()) = single_ ? single_->stress(q) : double_->stress(q);
  return result;
}

void ForceSystem::begin_step(double dt) const {
  if (single_) single_->begin_step(dt);
  if (double_) double_->begin_step(dt);
}

void ForceSystem::accept_step(const Nodal& u) const {
  if (single_) single_->accept(u.data());
  if (double_) double_->accept(u.data());
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

Eigen::VectorXd ForceSystem::stiffness() const {
  return single_ ? single_->stiffness() : double_->stiffness();
}

bool ForceSystem::viscoelastic() const {
  return std::any_of(tissues_.material.begin(), tissues_.material.end(),
                     [](const Material& m) { return !m.prony.empty(); });
}

double ForceSystem::stored_energy(const Nodal& u) const {
  if (single_) return single_->stored_energy(u.data());
  if (double_) return double_->stored_energy(u.data());
  const auto F = deformation_gradients(u);
  double energy = 0.0;
  for (Index q = 0; q < point_count(); ++q)
    energy += volume_[static_cast<std::size_t>(q)] *
              strain_energy(material_, Eigen::Map<const Mat3>(F.col(q).data()));
  return energy;
}

ForceSystem::Nodal to_nodal(const Points& values) {
  ForceSystem::Nodal result = ForceSystem::Nodal::Zero(4, values.cols());
  result.topRows<3>() = values;
  return result;
}

}  // namespace dimple
