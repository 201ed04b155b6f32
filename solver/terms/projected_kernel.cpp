#include "solver/terms/projected_kernel.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <stdexcept>

// The layout that the loops of projected_loops.cpp walk over; projected_kernel_layout.cpp builds it.
//
//   points    0 ................. 255 | 256 ............... 511 | ...    blocks: one thread's work at a time
//             |
//             +- octets of eight points, one register for each number of them:
//             |    gradient      column[3][3][8]    F - I
//             |    octet_number_ the patches that any of the eight meets;  octet_weight_  psi [8] of each
//             |
//             +- point q: quads point_offset_[q] to point_offset_[q + 1], four nodes each, zeros at the end
//
//                  | d[0] x y z | d[1] x y z | d[2] x y z | d[3] x y z | twice[4] |    a line of the cache
//                    gradients of the four nodes' shape functions        |             in single precision
//                                                                        | twice the number of the place
//                                                                        v
//   at_node   | x y z 0 | x y z 0 | ...  places of block 0 | x y z 0 | ...  places of block 1 | ...
//
// Every node (and patch) of a block has a place of this block alone: one thread copies displacements into it
// and then adds up forces in it. Every node then sums its places in order, with the same bits for any number
// of threads.
//
// Internal force of moving least squares with pressure patches; stress_sweep() is 1 to 6, gather() 7 and 8:
//  1. Copy u to the places of each block.
//  2. F_q = I + sum_a u_a (x) dphi_qa with the mean gradients of cell q; J_q - 1 without loss of digits.
//  3. J_b = sum_q psi_b V_q J_q / V_b, the volume ratio of each patch; J~_q = sum_b psi_b(q) J_b.
//  4. p_q = ks (J_q - 1) + (kappa - ks) (J~_q - 1) + r_q,   r_q = 2 ks beta (J_q - J~_q)^3.
//     A held pressure of patch b replaces its (kappa - ks) (J_b - 1).
//  5. p_q -= sum_b psi_b(q) r_b, r_b the patch mean of r_q: the derivative of J~ in the quartic term.
//  6. P_q = c P_dist(F_q) + F_q K_q + p_q cof F_q (elastic: c = 1, K = 0); V_q P_q dphi_qa to the places.
//  7. f_a = sum of the places of node a, in their order.
//  8. f_a += mu c sum_b K_ab u_b of the gradient variance, and its viscoelastic history.
// Without patches 3 and 5 are left out, and p_q = ks (J_q - 1).
//
// Source:   Horton et al. 2007, section 2.2 (1, 2, 6, 7); Chen et al. 2001 (mean gradients); Dohrmann and
//           Bochev 2004 (the size of ks).
// Departs:  patches, the quartic term and the gradient variance are our own; see the header.

namespace dimple {
namespace {

constexpr Index patches_per_task = 32;
constexpr double beta = 1.0;

// F at point q.
template <class Real>
Mat3 gradient_at(const LongVector<ProjectedOctet<Real>>& gradient, std::size_t q) {
  Mat3 result = Mat3::Identity();
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) result(i, j) += static_cast<double>(gradient[q / 8].column[j][i][q % 8]);
  return result;
}

}  // namespace

template <class Real>
typename ProjectedKernel<Real>::State ProjectedKernel<Real>::undeformed() const {
  State s;
  for (std::size_t t = 0; t < material_.size(); ++t)
    s.history.emplace_back(material_[t], points_of_tissue_[t]);
  for (const Variance& v : variance_) {
    VariancePast& past = s.variance.emplace_back();
    if (const auto terms = material_[static_cast<std::size_t>(v.tissue)].prony.size(); terms > 0) {
      past.force.assign(static_cast<std::size_t>(4 * nodes_), 0.0);
      past.f0 = past.force;
      past.h.assign(terms * past.force.size(), 0.0);
    }
  }
  for (const std::int32_t t : tissue_) {
    const Material& m = material_[static_cast<std::size_t>(t)];
    const double ks = patches_ > 0       ? pointwise_bulk_modulus(m)
                      : is_as_printed(m) ? m.kappa - 2.0 / 3.0 * m.mu
                                         : m.kappa;
    s.ks.push_back(static_cast<Real>(ks));
    s.bulk.push_back(static_cast<Real>(m.kappa - ks));
  }
  s.patch_bulk.resize(patch_volume_.size());
  find_patch_bulk(s);
  s.u.resize(static_cast<std::size_t>(4 * nodes_));
  s.at_node.resize(4 * nodes_of_block_.member.size());
  if (patches_ == 0) s.moved.resize(s.at_node.size());
  s.at_patch.resize(patches_of_block_.member.size());
  s.octet_sum.resize(8 * s.at_patch.size());
  s.place_sum.resize(s.at_patch.size());
  s.gradient.resize(static_cast<std::size_t>(points_ + 7) / 8);
  for (auto* values : {&s.dilation, &s.pressure, &s.unresolved})
    values->resize(8 * s.gradient.size(), Real(0));
  for (auto* values : {&s.patch_dilation, &s.patch_unresolved})
    values->resize(static_cast<std::size_t>(patches_));
  s.block.resize(static_cast<std::size_t>(blocks_));
  return s;
}

// Runs over the blocks forwards and backwards in turn: each pass begins with blocks still in the cache.
template <class Real>
template <class Body>
void ProjectedKernel<Real>::over_blocks(State& s, const Body& body) const {
  tbb::parallel_for(
      tbb::blocked_range<Index>(0, static_cast<Index>(s.block.size()), 2),
      [&](const tbb::blocked_range<Index>& range) {
        for (Index k = range.begin(); k < range.end(); ++k) {
          const Index b = s.backward ? range.begin() + range.end() - 1 - k : k;
          body(b, b * points_per_block, std::min((b + 1) * points_per_block, points_));
        }
      },
      tbb::static_partitioner());
  s.backward = !s.backward;
}

// Mean over each patch, from the sums of its blocks.
template <class Real>
void ProjectedKernel<Real>::sum_patches(const State& s, std::vector<Real>& patch) const {
  for (std::size_t b = 0; b < patch.size(); ++b) {
    double sum = 0.0;
    for (std::int32_t k = patches_of_block_.of_offset[b]; k < patches_of_block_.of_offset[b + 1]; ++k)
      sum += s.place_sum[static_cast<std::size_t>(patches_of_block_.place[static_cast<std::size_t>(k)])];
    patch[b] = static_cast<Real>(sum / patch_volume_[b]);
  }
}

template <class Real>
void ProjectedKernel<Real>::point_stresses(const State& s, Index first, Index last, Columns* stress) const {
  if (plain_) {
    Loops::neo_hookean_stresses(s.gradient.data(), s.dilation.data(), s.pressure.data(), mu_.data(),
                                volume_.data(), stress, first, last, smallest_J_, slope_);
    if (patches_ == 0)  // inverted or not finite: no stress there; the march stops
      for (auto q = static_cast<std::size_t>(first); q < static_cast<std::size_t>(last); ++q)
        if (!(s.dilation[q] > Real(-1)) || !std::isfinite(s.dilation[q]))
          stress[q - static_cast<std::size_t>(first)] = {};
    return;
  }
  for (Index q = first; q < last; ++q) {
    const auto at = static_cast<std::size_t>(q), t = static_cast<std::size_t>(tissue_[at]);
    const ViscousHistory& history = s.history[t];
    const Mat3 F = gradient_at(s.gradient, at);
    Mat3 P = history.step.c * distortional_stress(material_[t], F) +
             static_cast<double>(s.pressure[at]) * cofactor(F);
    if (!material_[t].prony.empty()) P += F * history.K(slot_[at]);
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 4; ++i)
        stress[q - first].column[j][i] = i < 3 ? static_cast<Real>(P(i, j)) * volume_[at] : Real(0);
  }
}

// Without patches the force of a point depends on no other point: small groups of points keep their data in
// the innermost cache.
template <class Real>
void ProjectedKernel<Real>::pointwise_forces(State& s, Index first, Index last, std::size_t from,
                                             std::size_t to) const {
  std::array<Columns, points_at_once> stress;
  std::copy_n(s.at_node.data() + 4 * from, 4 * (to - from), s.moved.data() + 4 * from);
  const Real* node = s.moved.data() + 4 * from;
  Real* force = s.at_node.data() + 4 * from;
  std::fill_n(force, 4 * (to - from), Real(0));
  for (Index q = first; q < last; q += points_at_once) {
    const Index end = std::min(q + points_at_once, last);
    Loops::gradients(quad_.data(), point_offset_.data(), node, s.gradient.data(), s.dilation.data(), q, end);
    for (auto p = static_cast<std::size_t>(q); p < static_cast<std::size_t>(end); ++p)
      s.pressure[p] = s.ks[p] * s.dilation[p];
    point_stresses(s, q, end, stress.data());
    Loops::scatter(quad_.data(), point_offset_.data(), stress.data(), force, q, end);
  }
}

template <class Real>
struct ProjectedKernel<Real>::OfBlock {
  const ProjectedKernel& k;
  State& s;
  Index block, first, last;  // its points are [first, last)
  using Means = std::array<Real, points_per_block>;
  struct Range {
    std::size_t from, to;
  };

  Range range(const Places& p) const {
    return {static_cast<std::size_t>(p.offset[static_cast<std::size_t>(block)]),
            static_cast<std::size_t>(p.offset[static_cast<std::size_t>(block) + 1])};
  }
  Range points() const { return {static_cast<std::size_t>(first), static_cast<std::size_t>(last)}; }

  // Displacements u [4xN] m of its nodes, their gradients, and the worst point; forces too where there are no
  // patches.
  void gradients_of(const double* u) const {
    const auto [from, to] = range(k.nodes_of_block_);
    for (std::size_t n = from; n < to; ++n)
      for (std::size_t i = 0; i < 4; ++i)
        s.at_node[4 * n + i] =
            static_cast<Real>(u[4 * static_cast<std::size_t>(k.nodes_of_block_.member[n]) + i]);
    if (k.patches_ > 0)
      Loops::gradients(k.quad_.data(), k.point_offset_.data(), s.at_node.data() + 4 * from, s.gradient.data(),
                       s.dilation.data(), first, last);
    else
      k.pointwise_forces(s, first, last, from, to);
    s.block[static_cast<std::size_t>(block)] = worst();
    if (k.variance_.empty()) return;
    const auto blocks = static_cast<Index>(s.block.size());  // a part of the nodes each, for gather()
    for (Index i = 4 * k.nodes_ * block / blocks; i < 4 * k.nodes_ * (block + 1) / blocks; ++i)
      s.u[static_cast<std::size_t>(i)] = static_cast<Real>(u[i]);
  }

  Sweep worst() const {
    Sweep sweep;
    std::array<Real, 8> least;
    sweep.finite = Loops::least_dilations(s.dilation.data(), least.data(), first, last);
    const Real smallest = *std::min_element(least.begin(), least.end());
    const Real* begin = s.dilation.data() + first;
    const Real* end = s.dilation.data() + last;
    if (!sweep.finite) {
      sweep.J_min = std::nan("");
      sweep.point = std::find_if(begin, end, [](Real e) { return !std::isfinite(e); }) - s.dilation.data();
    } else if (smallest < Real(0)) {
      sweep.J_min = 1.0 + static_cast<double>(smallest);
      sweep.point = std::find(begin, end, smallest) - s.dilation.data();
    }
    if (!sweep.finite || smallest <= Real(-1))
      sweep.inverted = std::count_if(begin, end, [](Real e) { return e <= Real(-1); });
    return sweep;
  }

  // Means over the patches of each point, of the values in s.at_patch.
  void means_at_points(Means& mean) const {
    Loops::means_of_patches(k.octet_number_.data(), k.octet_weight_.data(), k.octet_offset_.data(),
                            s.at_patch.data() + range(k.patches_of_block_).from, mean.data(), first / 8,
                            (last + 7) / 8);
  }
  void take(const std::vector<Real>& patch) const {
    const auto [from, to] = range(k.patches_of_block_);
    for (std::size_t p = from; p < to; ++p)
      s.at_patch[p] = patch[static_cast<std::size_t>(k.patches_of_block_.member[p])];
  }
  // Adds a value at each point to the sums of its patches.
  void spread(const LongVector<Real>& value) const {
    const auto [from, to] = range(k.patches_of_block_);
    std::fill_n(s.octet_sum.data() + 8 * from, 8 * (to - from), Real(0));
    Loops::spread_to_patches(k.octet_number_.data(), k.octet_weight_.data(), k.octet_offset_.data(),
                             value.data(), k.volume_.data(), s.octet_sum.data() + 8 * from, first / 8,
                             (last + 7) / 8);
    for (std::size_t p = from; p < to; ++p) {
      const Real* lane = s.octet_sum.data() + 8 * p;
      const auto two = [&](int i) { return static_cast<double>(lane[i]) + static_cast<double>(lane[i + 4]); };
      s.place_sum[p] = (two(0) + two(1)) + (two(2) + two(3));
    }
  }

  // Pressures from the volumes of its patches. Held pressures replace the term of the bulk modulus.
  void pressures() const {
    Means mean;
    take(s.patch_dilation);
    means_at_points(mean);
    const auto [begin, end] = points();
    for (std::size_t q = begin; q < end; ++q) {
      const Real resolved = mean[q - begin], e = s.dilation[q] - resolved;
      s.unresolved[q] = Real(2 * beta) * s.ks[q] * e * e * e;
      s.pressure[q] = s.ks[q] * s.dilation[q] + s.bulk[q] * resolved + s.unresolved[q];
    }
    if (s.around != Real(0))
      for (std::size_t q = begin; q < end; ++q) s.pressure[q] += s.around;
    if (s.held.empty()) return;
    const auto [from, to] = range(k.patches_of_block_);
    for (std::size_t p = from; p < to; ++p) {
      const auto b = static_cast<std::size_t>(k.patches_of_block_.member[p]);
      s.at_patch[p] = s.held[b] - static_cast<Real>(s.patch_bulk[b]) * s.patch_dilation[b];
    }
    means_at_points(mean);
    for (std::size_t q = begin; q < end; ++q) s.pressure[q] += mean[q - begin];
  }

  // Subtracts the patch means of the unresolved part from the pressures; then the forces.
  void forces() const {
    Means mean;
    take(s.patch_unresolved);
    means_at_points(mean);
    const auto [begin, end] = points();
    for (std::size_t q = begin; q < end; ++q) s.pressure[q] -= mean[q - begin];
    std::array<Columns, points_per_block> stress;
    k.point_stresses(s, first, last, stress.data());
    const auto [from, to] = range(k.nodes_of_block_);
    std::fill_n(s.at_node.data() + 4 * from, 4 * (to - from), Real(0));
    Loops::scatter(k.quad_.data(), k.point_offset_.data(), stress.data(), s.at_node.data() + 4 * from, first,
                   last);
  }
};

template <class Real>
typename ProjectedKernel<Real>::Sweep ProjectedKernel<Real>::stress_sweep(State& s, const double* u) const {
  over_blocks(s, [&](Index block, Index first, Index last) {
    const OfBlock mine{*this, s, block, first, last};
    mine.gradients_of(u);
    if (patches_ > 0) mine.spread(s.dilation);
  });
  if (patches_ > 0) {
    sum_patches(s, s.patch_dilation);
    over_blocks(s, [&](Index block, Index first, Index last) {
      const OfBlock mine{*this, s, block, first, last};
      mine.pressures();
      mine.spread(s.unresolved);
    });
    sum_patches(s, s.patch_unresolved);
    over_blocks(s, [&](Index block, Index first, Index last) {
      OfBlock{*this, s, block, first, last}.forces();
    });
  }
  Sweep result;
  for (const Sweep& sweep : s.block) {
    if (result.finite && (!sweep.finite || sweep.J_min < result.J_min)) {
      result.J_min = sweep.J_min;
      result.point = sweep.point;
      result.finite = sweep.finite;
    }
    result.inverted += sweep.inverted;
  }
  return result;
}

template <class Real>
void ProjectedKernel<Real>::gather(const State& s, double* f, Index first, Index last) const {
  for (Index a = first; a < last; ++a) {
    double sum[4] = {};
    for (std::int32_t k = nodes_of_block_.of_offset[static_cast<std::size_t>(a)];
         k < nodes_of_block_.of_offset[static_cast<std::size_t>(a) + 1]; ++k) {
      const Real* mine = s.at_node.data() + 4 * nodes_of_block_.place[static_cast<std::size_t>(k)];
      for (int i = 0; i < 4; ++i) sum[i] += static_cast<double>(mine[i]);
    }
    for (int i = 0; i < 4; ++i) f[4 * a + i] = sum[i];
  }
  for (std::size_t n = 0; n < variance_.size(); ++n) {
    const Variance& v = variance_[n];
    const auto t = static_cast<std::size_t>(v.tissue);
    Loops::variance_forces(v.rows.fraction.data(), v.rows.offset.data(), s.u.data(),
                           material_[t].mu * s.history[t].step.c, f, first, last);
    if (!s.variance[n].force.empty())
      for (Index k = 4 * first; k < 4 * last; ++k) f[k] += s.variance[n].force[static_cast<std::size_t>(k)];
  }
}

template <class Real>
double ProjectedKernel<Real>::stored_energy(State& s, const double* u, double* hourglass) const {
  stress_sweep(s, u);
  std::vector<double> of_block(s.block.size(), 0.0);  // summed in order, for the same bits
  over_blocks(s, [&](Index block, Index first, Index last) {
    for (auto q = static_cast<std::size_t>(first); q < static_cast<std::size_t>(last); ++q) {
      const Material& m = material_[static_cast<std::size_t>(tissue_[q])];
      const double ks = patches_ > 0 ? pointwise_bulk_modulus(m) : m.kappa, e = s.dilation[q],
                   residual = patches_ > 0 ? unresolved_dilation(s, q) : 0.0;
      of_block[static_cast<std::size_t>(block)] +=
          static_cast<double>(volume_[q]) *
          (distortional_energy(m, gradient_at(s.gradient, q)) + 0.5 * ks * e * e +
           0.5 * ks * beta * residual * residual * residual * residual);
    }
  });
  double energy = std::accumulate(of_block.begin(), of_block.end(), 0.0);
  for (std::size_t b = 0; b < patch_volume_.size(); ++b) {
    const double e = s.patch_dilation[b], bulk = s.patch_bulk[b];
    // Held pressures use the Hellinger-Reissner energy, which is stationary in pressure and in u.
    energy += patch_volume_[b] *
              (s.held.empty() ? 0.5 * bulk * e * e : s.held[b] * e - 0.5 * s.held[b] * s.held[b] / bulk);
  }
  const double seen = energy;
  std::vector<double> f(static_cast<std::size_t>(4 * nodes_));
  for (const Variance& v : variance_) {
    std::fill(f.begin(), f.end(), 0.0);
    Loops::variance_forces(v.rows.fraction.data(), v.rows.offset.data(), s.u.data(),
                           material_[static_cast<std::size_t>(v.tissue)].mu, f.data(), 0, nodes_);
    for (std::size_t k = 0; k < f.size(); ++k) energy += 0.5 * f[k] * u[k];
  }
  if (hourglass) *hourglass = energy - seen;
  return energy;
}

template <class Real>
void ProjectedKernel<Real>::begin_step(State& s, double dt) const {
  if (plain_) return;
  s.step = dt;
  for (ViscousHistory& history : s.history) history.begin_step(dt);
  // ks follows the relaxed shear modulus: the factor c of one long step, as after a load that grew evenly.
  std::vector<double> ks;
  for (Material now : material_) {
    now.mu *= prony_step(now, s.elapsed + dt).c;
    ks.push_back(pointwise_bulk_modulus(now));
  }
  for (std::size_t q = 0; q < s.ks.size(); ++q) {
    const auto t = static_cast<std::size_t>(tissue_[q]);
    s.ks[q] = static_cast<Real>(ks[t]);
    s.bulk[q] = static_cast<Real>(material_[t].kappa - ks[t]);
  }
  find_patch_bulk(s);
  for (std::size_t n = 0; n < variance_.size(); ++n) {
    VariancePast& past = s.variance[n];
    if (past.force.empty()) continue;
    const PronyStep& step = s.history[static_cast<std::size_t>(variance_[n].tissue)].step;
    for (std::size_t k = 0; k < past.force.size(); ++k) {
      past.force[k] = 0.0;
      for (std::size_t i = 0; i < step.e.size(); ++i)
        past.force[k] += step.e[i] * past.h[i * past.force.size() + k] - step.ga[i] * past.f0[k];
    }
  }
}

template <class Real>
void ProjectedKernel<Real>::accept(State& s, const double* u) const {
  if (plain_) return;
  s.elapsed += s.step;
  stress_sweep(s, u);
  tbb::parallel_for(Index{0}, points_, [&](Index q) {
    const auto at = static_cast<std::size_t>(q), t = static_cast<std::size_t>(tissue_[at]);
    if (!material_[t].prony.empty()) s.history[t].accept(slot_[at], gradient_at(s.gradient, at));
  });
  for (std::size_t n = 0; n < variance_.size(); ++n) {
    const Variance& v = variance_[n];
    VariancePast& past = s.variance[n];
    if (past.force.empty()) continue;
    const auto t = static_cast<std::size_t>(v.tissue);
    const PronyStep& step = s.history[t].step;
    std::vector<double> now(past.force.size(), 0.0);
    Loops::variance_forces(v.rows.fraction.data(), v.rows.offset.data(), s.u.data(), material_[t].mu,
                           now.data(), 0, nodes_);
    for (std::size_t k = 0; k < now.size(); ++k) {
      for (std::size_t i = 0; i < step.e.size(); ++i) {
        double& h = past.h[i * now.size() + k];
        h = step.e[i] * h + step.ga[i] * (now[k] - past.f0[k]);
      }
      past.f0[k] = now[k];
    }
  }
}

template <class Real>
template <class OfState, class Visit>
void ProjectedKernel<Real>::visit_past(OfState& s, const Visit& visit) {
  visit(&s.elapsed, 1);
  for (auto& history : s.history) {
    if (history.material.prony.empty()) continue;
    visit(history.S0.data(), history.S0.size());
    visit(history.H.data(), history.H.size());
  }
  for (auto& v : s.variance) {
    visit(v.h.data(), static_cast<Index>(v.h.size()));
    visit(v.f0.data(), static_cast<Index>(v.f0.size()));
  }
}

template <class Real>
std::vector<double> ProjectedKernel<Real>::past(const State& s) const {
  std::vector<double> past;
  visit_past(s, [&](const double* from, Index count) { past.insert(past.end(), from, from + count); });
  return past;
}

template <class Real>
void ProjectedKernel<Real>::restore_past(State& s, const std::vector<double>& past) const {
  std::size_t at = 0;
  visit_past(s, [&](double* to, Index count) {
    if (past.size() - at < static_cast<std::size_t>(count))
      throw std::invalid_argument("the history of another model cannot be used");
    std::copy_n(past.data() + at, count, to);
    at += static_cast<std::size_t>(count);
  });
}

// A patch has one tissue: that of any of its points.
template <class Real>
void ProjectedKernel<Real>::find_patch_bulk(State& s) const {
  for (std::size_t b = 0; b < s.patch_bulk.size(); ++b)
    s.patch_bulk[b] = static_cast<double>(s.bulk[static_cast<std::size_t>(
        of_patch_.fraction[static_cast<std::size_t>(of_patch_.offset[b])].number)]);
}

// J - J~ of the last stress_sweep, from the term that it enters.
template <class Real>
double ProjectedKernel<Real>::unresolved_dilation(const State& s, std::size_t q) const {
  return std::cbrt(static_cast<double>(s.unresolved[q]) / (2.0 * beta * static_cast<double>(s.ks[q])));
}

template <class Real>
void ProjectedKernel<Real>::patch_state(const State& s, Eigen::VectorXd& dilation,
                                        Eigen::VectorXd& bulk) const {
  dilation.resize(patches_);
  bulk.resize(patches_);
  for (Index b = 0; b < patches_; ++b) {
    dilation[b] = static_cast<double>(s.patch_dilation[static_cast<std::size_t>(b)]);
    bulk[b] = s.patch_bulk[static_cast<std::size_t>(b)];
  }
}

template <class Real>
void ProjectedKernel<Real>::patch_gradients(const State& s, const CompressedRows& nodes,
                                            Eigen::Matrix4Xf& gradient) const {
  gradient.resize(4, nodes.member.size());
  tbb::parallel_for(tbb::blocked_range<Index>(0, patches_, patches_per_task), [&](const auto& range) {
    Eigen::Matrix4Xf sum = Eigen::Matrix4Xf::Zero(4, nodes_);
    for (Index b = range.begin(); b < range.end(); ++b) {
      for (std::int32_t k = of_patch_.offset[static_cast<std::size_t>(b)];
           k < of_patch_.offset[static_cast<std::size_t>(b) + 1]; ++k) {
        const Fraction& fraction = of_patch_.fraction[static_cast<std::size_t>(k)];
        const auto q = static_cast<std::size_t>(fraction.number);
        Eigen::Matrix<float, 4, 3> slope = Eigen::Matrix<float, 4, 3>::Zero();
        slope.template topRows<3>() =
            (static_cast<double>(fraction.weight) * cofactor(gradient_at(s.gradient, q)))
                .template cast<float>();
        const std::int32_t* node = nodes_of_block_.member.data() +
                                   nodes_of_block_.offset[q / static_cast<std::size_t>(points_per_block)];
        for (std::int32_t e = point_offset_[q]; e < point_offset_[q + 1]; ++e) {
          const Quad& quad = quad_[static_cast<std::size_t>(e)];
          for (int i = 0; i < 4; ++i)
            sum.col(node[quad.twice[i] / 2]) += slope.col(0) * static_cast<float>(quad.d[i][0]) +
                                                slope.col(1) * static_cast<float>(quad.d[i][1]) +
                                                slope.col(2) * static_cast<float>(quad.d[i][2]);
        }
      }
      for (int k = nodes.offset[b]; k < nodes.offset[b + 1]; ++k) {
        gradient.col(k) = sum.col(nodes.member[k]);
        sum.col(nodes.member[k]).setZero();
      }
    }
  });
}

template <class Real>
void ProjectedKernel<Real>::gradients_at(Index q, std::vector<int>& node, Points& dphi) const {
  const auto at = static_cast<std::size_t>(q);
  const std::int32_t* member =
      nodes_of_block_.member.data() + nodes_of_block_.offset[at / static_cast<std::size_t>(points_per_block)];
  node.clear();
  dphi.resize(3, 4 * (point_offset_[at + 1] - point_offset_[at]));
  for (std::int32_t e = point_offset_[at]; e < point_offset_[at + 1]; ++e)
    for (int i = 0; i < 4; ++i) {
      const Quad& quad = quad_[static_cast<std::size_t>(e)];
      if (i > 0 && quad.twice[i] == quad.twice[0]) continue;  // padding
      for (int axis = 0; axis < 3; ++axis)
        dphi(axis, static_cast<Index>(node.size())) = static_cast<double>(quad.d[i][axis]);
      node.push_back(member[quad.twice[i] / 2]);
    }
}

template <class Real>
Mat3 ProjectedKernel<Real>::deformation_gradient(const State& s, Index q) const {
  return gradient_at(s.gradient, static_cast<std::size_t>(q));
}

template <class Real>
Eigen::Matrix<double, 9, Eigen::Dynamic> ProjectedKernel<Real>::stresses(const State& s) const {
  Eigen::Matrix<double, 9, Eigen::Dynamic> result(9, points_);
  tbb::parallel_for(Index{0}, blocks_, [&](Index block) {
    std::array<Columns, points_per_block> stress;
    const Index first = block * points_per_block, last = std::min(first + points_per_block, points_);
    point_stresses(s, first, last, stress.data());
    for (Index q = first; q < last; ++q)
      for (int j = 0; j < 3; ++j)
        for (int i = 0; i < 3; ++i)
          result(3 * j + i, q) =
              static_cast<double>(stress[static_cast<std::size_t>(q - first)].column[j][i]) /
              static_cast<double>(volume_[static_cast<std::size_t>(q)]);
  });
  return result;
}

template class ProjectedKernel<float>;
template class ProjectedKernel<double>;

}  // namespace dimple
