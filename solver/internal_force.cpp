#include "solver/internal_force.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cassert>
#include <cmath>

// One binary for every processor: the loader picks the copy that this one can run. All copies round alike, since
// nothing is reordered and products are not fused with sums. Sanitizers run before the loader's choice.
#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(DIMPLE_NO_CLONES)
#define DIMPLE_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define DIMPLE_CLONES
#endif

namespace dimple {
namespace {

constexpr Index points_per_block = 128;
constexpr Index nodes_per_block = 64;

using Vec4 = double __attribute__((vector_size(32), aligned(8), may_alias));

}  // namespace

ForceSystem::ForceSystem(const Model& model, const NeoHookean& material) : material_(material) {
  Eigen::VectorXi slot;
  const CompressedRows influence = transpose(model.support, model.node_count(), &slot);
  const auto& rows = model.support;

  point_offset_.assign(rows.offset.begin(), rows.offset.end());
  by_point_.resize(static_cast<std::size_t>(rows.member.size()));
  for (Index k = 0; k < rows.member.size(); ++k)
    by_point_[static_cast<std::size_t>(k)] = {{model.dphi(0, k), model.dphi(1, k), model.dphi(2, k)}, rows.member[k]};

  node_offset_.assign(influence.offset.begin(), influence.offset.end());
  by_node_.resize(by_point_.size());
  for (Index k = 0; k < influence.member.size(); ++k) {
    const int s = slot[k];
    by_node_[static_cast<std::size_t>(k)] = {{model.dphi(0, s), model.dphi(1, s), model.dphi(2, s)}, influence.member[k]};
  }

  volume_.assign(model.volume.begin(), model.volume.end());
  stress_.resize(volume_.size());
  block_.resize(static_cast<std::size_t>((point_count() + points_per_block - 1) / points_per_block));
}

DIMPLE_CLONES
void ForceSystem::sweep_block(const ForceSystem& system, const double* u, Index first, Index last, Sweep& result) {
  const double mu = system.material_.mu, kappa = system.material_.kappa;
  const bool printed = system.material_.as_printed;
  const double bulk = printed ? kappa - 2.0 / 3.0 * mu : kappa;
  const double third = printed ? 0.0 : 1.0 / 3.0;
  const Pair* pair = system.by_point_.data();
  const Vec4* node = reinterpret_cast<const Vec4*>(u);

  for (Index q = first; q < last; ++q) {
    Vec4 h0 = {}, h1 = {}, h2 = {};  // columns of H = F - I
    for (std::int32_t k = system.point_offset_[static_cast<std::size_t>(q)],
                      end = system.point_offset_[static_cast<std::size_t>(q) + 1];
         k < end; ++k) {
      const Vec4 ua = node[pair[k].number];
      h0 += ua * pair[k].d[0];
      h1 += ua * pair[k].d[1];
      h2 += ua * pair[k].d[2];
    }

    // J - 1 from H, not det F - 1: near rest the latter loses the digits that kappa then multiplies.
    const double trace = h0[0] + h1[1] + h2[2];
    const double minors = (h0[0] * h1[1] - h1[0] * h0[1]) + (h0[0] * h2[2] - h2[0] * h0[2]) + (h1[1] * h2[2] - h2[1] * h1[2]);
    const double det = h0[0] * (h1[1] * h2[2] - h2[1] * h1[2]) - h1[0] * (h0[1] * h2[2] - h2[1] * h0[2]) +
                       h2[0] * (h0[1] * h1[2] - h1[1] * h0[2]);
    const double dilation = trace + minors + det;
    const double J = 1.0 + dilation;

    Stress& out = system.stress_[static_cast<std::size_t>(q)];
    if (!(J > 0.0) || !std::isfinite(J)) {  // inverted, or not a number: the driver stops the run
      if (result.ok()) result = {std::isfinite(J) ? J : std::nan(""), q};
      out = Stress{};
      continue;
    }
    if (J < result.J_min) result = {J, q};

    const Vec4 f0 = {h0[0] + 1.0, h0[1], h0[2], 0.0}, f1 = {h1[0], h1[1] + 1.0, h1[2], 0.0},
               f2 = {h2[0], h2[1], h2[2] + 1.0, 0.0};
    // cof F: its columns are the cross products of F's.
    const Vec4 c0 = {f1[1] * f2[2] - f1[2] * f2[1], f1[2] * f2[0] - f1[0] * f2[2], f1[0] * f2[1] - f1[1] * f2[0], 0.0};
    const Vec4 c1 = {f2[1] * f0[2] - f2[2] * f0[1], f2[2] * f0[0] - f2[0] * f0[2], f2[0] * f0[1] - f2[1] * f0[0], 0.0};
    const Vec4 c2 = {f0[1] * f1[2] - f0[2] * f1[1], f0[2] * f1[0] - f0[0] * f1[2], f0[0] * f1[1] - f0[1] * f1[0], 0.0};
    const Vec4 squares = f0 * f0 + f1 * f1 + f2 * f2;
    const double I1 = squares[0] + squares[1] + squares[2];

    const double root = 1.0 / std::cbrt(J);
    const double V = system.volume_[static_cast<std::size_t>(q)];
    const double shear = V * mu * root * root;                           // V mu J^(-2/3)
    const double pressure = V * bulk * dilation - third * shear * I1 / J;
    Vec4* column = reinterpret_cast<Vec4*>(out.column);
    column[0] = shear * f0 + pressure * c0;
    column[1] = shear * f1 + pressure * c1;
    column[2] = shear * f2 + pressure * c2;
  }
}

ForceSystem::Sweep ForceSystem::stress_sweep(const Nodal& u) const {
  assert(u.cols() == node_count());
  const Index blocks = static_cast<Index>(block_.size());
  tbb::parallel_for(
      tbb::blocked_range<Index>(0, blocks, 4),
      [&](const tbb::blocked_range<Index>& range) {
        for (Index b = range.begin(); b < range.end(); ++b) {
          Sweep& sweep = block_[static_cast<std::size_t>(b)] = Sweep{};
          sweep_block(*this, u.data(), b * points_per_block, std::min((b + 1) * points_per_block, point_count()), sweep);
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
        const Index first = range.begin() * nodes_per_block, last = std::min(range.end() * nodes_per_block, node_count());
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
  tbb::parallel_for(Index{0}, point_count(), [&](Index q) {
    Mat3 F = Mat3::Identity();
    for (std::int32_t k = point_offset_[static_cast<std::size_t>(q)]; k < point_offset_[static_cast<std::size_t>(q) + 1]; ++k) {
      const Pair& pair = by_point_[static_cast<std::size_t>(k)];
      F += u.col(pair.number).head<3>() * Eigen::RowVector3d(pair.d[0], pair.d[1], pair.d[2]);
    }
    Eigen::Map<Mat3>(result.col(q).data()) = F;
  });
  return result;
}

double ForceSystem::stored_energy(const Nodal& u) const {
  const auto F = deformation_gradients(u);
  double energy = 0.0;
  for (Index q = 0; q < point_count(); ++q)
    energy += volume_[static_cast<std::size_t>(q)] * strain_energy(material_, Eigen::Map<const Mat3>(F.col(q).data()));
  return energy;
}

ForceSystem::Nodal to_nodal(const Points& values) {
  ForceSystem::Nodal result = ForceSystem::Nodal::Zero(4, values.cols());
  result.topRows<3>() = values;
  return result;
}

}  // namespace dimple
