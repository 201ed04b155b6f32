#include "solver/terms/projected_kernel.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "preprocess/clones.hpp"
#include "solver/terms/inverse_cube_root.hpp"
#include "solver/terms/wide.hpp"

// The layout that the loops below walk over; projected_kernel_layout.cpp builds it.
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
// Every node (and patch) that a block meets has a place there of the block's own: one thread copies
// displacements into it and then adds up forces in it. Last, every node sums its places, in their order: the
// bits are the same for any number of threads.
//
// One sweep: places <- u; gradients, F - I and J - 1; spread and means, the pressures that patches give;
// stresses, V P; scatter, forces into places. gather() makes f of them.

namespace dimple {
namespace {

using namespace wide;  // the vector verbs

constexpr Index patches_per_task = 32;
template <class Real>
constexpr int ahead = sizeof(Real) == 4 ? 24 : 12;  // quads fetched before they are needed
constexpr double beta = 1.0;

// F - I of points [first, last), first a multiple of eight; the last octet is filled up with zeros. `nodes`
// of a quad are taken at once, and each adds to a sum of its own (of doubles, every second one to the same):
// any number gives the same sums in the same order, and no addition waits for the one just before.
template <class Real, int nodes>
[[gnu::always_inline]] inline void gradient_body(const ProjectedQuad<Real>* quad, const std::int32_t* offset,
                                                 const Real* u, ProjectedOctet<Real>* gradient, Index first,
                                                 Index last) {
  constexpr int sums = sizeof(Real) == 4 ? 4 / nodes : 2;
  for (Index begin = first; begin < last; begin += 8) {
    Pack<Real, 4> column[3][8];
    for (Index lane = 0; lane < 8; ++lane) {
      const Index q = std::min(begin + lane, last);  // beyond the last: no nodes
      const std::int32_t end = offset[std::min(q + 1, last)];
      Nodes<Real, nodes> sum[3][sums] = {};
      for (std::int32_t k = offset[q]; k < end; ++k) {
        __builtin_prefetch(quad + k + ahead<Real>);
        for (int i = 0; i < 4; i += nodes) {
          const auto moved = gather<nodes>(u, quad[k].twice + i);
          const auto d = load_gradients<nodes>(quad[k].d + i);
          const int s = i / nodes % sums;
          sum[0][s] += moved * d.x;
          sum[1][s] += moved * d.y;
          sum[2][s] += moved * d.z;
        }
      }
      for (int j = 0; j < 3; ++j) {
        // Written out: sums that a loop runs over would lie in memory all the time.
        if constexpr (sums == 4) sum[j][0] += sum[j][2], sum[j][1] += sum[j][3];
        if constexpr (sums > 1) sum[j][0] += sum[j][1];
        column[j][lane] = sum_of_nodes<Real, nodes>(sum[j][0]);
      }
    }
    for (int j = 0; j < 3; ++j)
      for (int half = 0; half < 8; half += 4) {
        const auto* c = column[j] + half;
        Pack<Real, 4> row[4];
        transpose<Real>(c[0], c[1], c[2], c[3], row);
        for (int i = 0; i < 3; ++i) four(gradient[begin / 8].column[j][i] + half) = row[i];
      }
  }
}

// det(I + H) - 1 without the loss of digits of det F - 1, which kappa would multiply.
template <class Real>
[[gnu::always_inline]] inline void dilation_body(const ProjectedOctet<Real>* gradient, Real* dilation,
                                                 Index first, Index last) {
  for (Index o = first / 8; 8 * o < last; ++o) {
    const auto& h = gradient[o].column;
    for (int lane = 0; lane < 8; ++lane) {
      const Real xx = h[0][0][lane], yx = h[0][1][lane], zx = h[0][2][lane], xy = h[1][0][lane],
                 yy = h[1][1][lane], zy = h[1][2][lane], xz = h[2][0][lane], yz = h[2][1][lane],
                 zz = h[2][2][lane];
      const Real minors = (xx * yy - yx * xy) + (xx * zz - zx * xz) + (yy * zz - zy * yz);
      const Real det = xx * (yy * zz - zy * yz) - yx * (xy * zz - zy * xz) + zx * (xy * yz - yy * xz);
      dilation[8 * o + lane] = (xx + yy + zz) + minors + det;
    }
  }
}

// The loops over nodes, two thirds of an evaluation, take as many nodes at once as the registers hold.
template <class Real>
DIMPLE_CLONES void cloned_gradients(const ProjectedQuad<Real>* quad, const std::int32_t* offset,
                                    const Real* u, ProjectedOctet<Real>* gradient, Real* dilation,
                                    Index first, Index last) {
  gradient_body<Real, 1>(quad, offset, u, gradient, first, last);
  dilation_body(gradient, dilation, first, last);
}
DIMPLE_AVX2 void avx2_gradients(const ProjectedQuad<float>* quad, const std::int32_t* offset, const float* u,
                                ProjectedOctet<float>* gradient, float* dilation, Index first, Index last) {
  gradient_body<float, 2>(quad, offset, u, gradient, first, last);
  dilation_body(gradient, dilation, first, last);
}
DIMPLE_AVX512 void avx512_gradients(const ProjectedQuad<float>* quad, const std::int32_t* offset,
                                    const float* u, ProjectedOctet<float>* gradient, float* dilation,
                                    Index first, Index last) {
  gradient_body<float, 4>(quad, offset, u, gradient, first, last);
  dilation_body(gradient, dilation, first, last);
}
template <class Real>
void gradients(const ProjectedQuad<Real>* quad, const std::int32_t* offset, const Real* u,
               ProjectedOctet<Real>* gradient, Real* dilation, Index first, Index last) {
  if constexpr (sizeof(Real) == 4) {
    if (has_avx512) return avx512_gradients(quad, offset, u, gradient, dilation, first, last);
    if (has_avx2) return avx2_gradients(quad, offset, u, gradient, dilation, first, last);
  }
  cloned_gradients(quad, offset, u, gradient, dilation, first, last);
}

// V P of neo-Hookean points, into `stress` from its beginning; `pressure` [Q] is the whole coefficient of
// cof F but W_dist's, of which `share` is taken: none in the paper's printed stress. Below `least_J`
// powers of J are Taylor polynomials.
template <class Real>
DIMPLE_CLONES void neo_hookean_stresses(const ProjectedOctet<Real>* gradient, const Real* dilation,
                                        const Real* pressure, const Real* mu, const Real* volume,
                                        ProjectedColumns<Real>* stress, Index first, Index last, Real least_J,
                                        Real share) {
  constexpr int count = sizeof(Real) == 4 ? 8 : 4;  // points at a time
  using Lanes = Pack<Real, count>;
  const Real g0 = std::pow(least_J, Real(-2.0 / 3.0)), g1 = Real(-2.0 / 3.0) * g0 / least_J,
             g2 = Real(-5.0 / 3.0) * g1 / least_J;
  for (Index q = first; q < last; q += count) {
    const auto& H = gradient[q / 8].column;
    const Index part = q % 8;
    const Lanes h00 = load<count>(H[0][0] + part), h10 = load<count>(H[0][1] + part),
                h20 = load<count>(H[0][2] + part), h01 = load<count>(H[1][0] + part),
                h11 = load<count>(H[1][1] + part), h21 = load<count>(H[1][2] + part),
                h02 = load<count>(H[2][0] + part), h12 = load<count>(H[2][1] + part),
                h22 = load<count>(H[2][2] + part);
    const Lanes e = load<count>(dilation + q), J = e + Real(1);
    // (|F|^2 - 3) / 3, and |F|^2
    const Lanes stretch =
        Real(1.0 / 3.0) * (Real(2) * (h00 + h11 + h22) +
                           ((h00 * h00 + h10 * h10 + h20 * h20) + (h01 * h01 + h11 * h11 + h21 * h21) +
                            (h02 * h02 + h12 * h12 + h22 * h22)));
    const Lanes I1 = Real(3) * stretch + Real(3);
    // g = J^(-2/3) and its slope; below least_J the Taylor polynomial there.
    const auto inverted = J < least_J;
    const Lanes Jc = J > least_J ? J : least_J + Lanes{};
    Lanes root;
    for (int lane = 0; lane < count; ++lane) root[lane] = inverse_cube_root_guess(Jc[lane]);
    for (int pass = 0; pass < (count == 8 ? 3 : 4); ++pass)
      root = root * (Real(4) - Jc * root * root * root) * Real(1.0 / 3.0);
    const Lanes power = root * root, below = J - least_J;
    const Lanes power_slope = Real(-2.0 / 3.0) * power * (root * root * root);
    const Lanes low = g0 + below * (g1 + Real(0.5) * g2 * below), low_slope = g1 + g2 * below;
    const Lanes g = inverted ? low : power, slope = share * (inverted ? low_slope : power_slope);

    // P = M g F + (pressure + M I1 slope / 2) cof F, where M (g F - g / (3 J) I1 cof F), all of it at rest,
    // is the difference of numbers that are nearly alike: of small strains it would leave the rounding of 1.
    // So of F = I + H and cof F = I + K what the two identities leave is taken together: g + I1 slope / 2 =
    // (g / J) (J - 1 - stretch).
    const Lanes cofactor = Real(0.5) * I1 * slope;
    const Lanes direct = g + cofactor, upright = power * (root * root * root) * (e - stretch);
    const Lanes of_identity = share == Real(0) ? direct : inverted ? direct : upright;
    const Lanes V = load<count>(volume + q), M = load<count>(mu + q), shear = V * M * g;
    const Lanes VP = V * load<count>(pressure + q), p = VP + V * M * cofactor,
                rest = VP + V * M * of_identity;
    const Lanes P[3][3] = {
        // [column][row] of V P = shear H + p K + rest I
        {shear * h00 + p * (h11 + h22 + (h11 * h22 - h21 * h12)) + rest,
         shear * h10 + p * ((h21 * h02 - h01 * h22) - h01),
         shear * h20 + p * ((h01 * h12 - h11 * h02) - h02)},
        {shear * h01 + p * ((h12 * h20 - h22 * h10) - h10),
         shear * h11 + p * (h22 + h00 + (h22 * h00 - h02 * h20)) + rest,
         shear * h21 + p * ((h02 * h10 - h12 * h00) - h12)},
        {shear * h02 + p * ((h10 * h21 - h20 * h11) - h20), shear * h12 + p * ((h20 * h01 - h00 * h21) - h21),
         shear * h22 + p * (h00 + h11 + (h00 * h11 - h10 * h01)) + rest}};
    for (int j = 0; j < 3; ++j) {
      Pack<Real, 4> column[count];
      columns<Real, count>(P[j][0], P[j][1], P[j][2], column);
      for (int lane = 0; lane < count; ++lane) four(stress[q - first + lane].column[j]) = column[lane];
    }
  }
}

// `stress` begins with that of point `first`.
template <class Real, int nodes>
[[gnu::always_inline]] inline void scatter_body(const ProjectedQuad<Real>* quad, const std::int32_t* offset,
                                                const ProjectedColumns<Real>* stress, Real* f, Index first,
                                                Index last) {
  // The gradients that come next read most likely what follows: fetched here, where the pairs themselves are
  // at hand.
  const std::int32_t next = offset[last] - offset[first];
  for (Index q = first; q < last; ++q) {
    const auto& column = stress[q - first].column;
    const auto p0 = repeat<nodes>(column[0]), p1 = repeat<nodes>(column[1]), p2 = repeat<nodes>(column[2]);
    const std::int32_t end = offset[q + 1];
    for (std::int32_t k = offset[q]; k < end; ++k) {
      __builtin_prefetch(quad + k + next, 0, 2);
      for (int i = 0; i < 4; i += nodes) {
        const auto d = load_gradients<nodes>(quad[k].d + i);
        scatter_add<nodes>(f, quad[k].twice + i, p0 * d.x + p1 * d.y + p2 * d.z);
      }
    }
  }
}

template <class Real>
DIMPLE_CLONES void cloned_scatter(const ProjectedQuad<Real>* quad, const std::int32_t* offset,
                                  const ProjectedColumns<Real>* stress, Real* f, Index first, Index last) {
  scatter_body<Real, 1>(quad, offset, stress, f, first, last);
}
DIMPLE_AVX2 void avx2_scatter(const ProjectedQuad<float>* quad, const std::int32_t* offset,
                              const ProjectedColumns<float>* stress, float* f, Index first, Index last) {
  scatter_body<float, 2>(quad, offset, stress, f, first, last);
}
DIMPLE_AVX512 void avx512_scatter(const ProjectedQuad<float>* quad, const std::int32_t* offset,
                                  const ProjectedColumns<float>* stress, float* f, Index first, Index last) {
  scatter_body<float, 4>(quad, offset, stress, f, first, last);
}
template <class Real>
void scatter(const ProjectedQuad<Real>* quad, const std::int32_t* offset,
             const ProjectedColumns<Real>* stress, Real* f, Index first, Index last) {
  if constexpr (sizeof(Real) == 4) {
    if (has_avx512) return avx512_scatter(quad, offset, stress, f, first, last);
    if (has_avx2) return avx2_scatter(quad, offset, stress, f, first, last);
  }
  cloned_scatter(quad, offset, stress, f, first, last);
}

template <class Real>
DIMPLE_CLONES void variance_forces(const ProjectedShare<Real>* share, const std::int32_t* offset,
                                   const Real* u, double scale, double* f, Index first, Index last) {
  for (Index a = first; a < last; ++a) {
    Four<Real> sum[4] = {};
    std::int32_t k = offset[a];
    const std::int32_t end = offset[a + 1];
    for (; k + 3 < end; k += 4) {
      __builtin_prefetch(share + k + 128);
      for (int i = 0; i < 4; ++i) sum[i] += four(u, share[k + i].number) * share[k + i].weight;
    }
    for (; k < end; ++k) sum[0] += four(u, share[k].number) * share[k].weight;
    const auto all = (sum[0] + sum[1]) + (sum[2] + sum[3]);
    for (int i = 0; i < 4; ++i) f[4 * a + i] += scale * static_cast<double>(all[i]);
  }
}

// Eight points that follow each other have most of their patches in common: one list serves them. The mean
// over each point's patches; and what `value` x volume x weight adds to each patch, eight sums a patch.
template <class Real>
DIMPLE_CLONES void means_of_patches(const std::int32_t* number, const Real* weight,
                                    const std::int32_t* offset, const Real* patch, Real* mean, Index first,
                                    Index last) {
  using Octet = Pack<Real, 8>;
  for (Index o = first; o < last; ++o) {
    Octet even = {}, odd = {};
    std::int32_t k = offset[o];
    const std::int32_t end = offset[o + 1];
    for (; k + 1 < end; k += 2) {
      even += load<8>(weight + 8 * k) * patch[number[k]];
      odd += load<8>(weight + 8 * k + 8) * patch[number[k + 1]];
    }
    if (k < end) even += load<8>(weight + 8 * k) * patch[number[k]];
    store<8>(mean + 8 * (o - first), even + odd);
  }
}
template <class Real>
DIMPLE_CLONES void spread_to_patches(const std::int32_t* number, const Real* weight,
                                     const std::int32_t* offset, const Real* value, const Real* volume,
                                     Real* patch, Index first, Index last) {
  using Octet = Pack<Real, 8>;
  for (Index o = first; o < last; ++o) {
    const Octet all = load<8>(value + 8 * o) * load<8>(volume + 8 * o);
    for (std::int32_t k = offset[o], end = offset[o + 1]; k < end; ++k)
      store<8>(patch + 8 * number[k], load<8>(patch + 8 * number[k]) + load<8>(weight + 8 * k) * all);
  }
}

// The smallest of eight points' J - 1 apart each, and whether all are numbers.
template <class Real>
DIMPLE_CLONES bool least_dilations(const Real* dilation, Real* least, Index first, Index last) {
  using Octet = Pack<Real, 8>;
  Octet smallest = {}, nothing = {};
  for (Index o = first / 8; 8 * o < last; ++o) {
    const Octet now = load<8>(dilation + 8 * o);
    smallest = now < smallest ? now : smallest;
    nothing += now - now;
  }
  store<8>(least, smallest);
  bool numbers = true;
  for (int lane = 0; lane < 8; ++lane) numbers = numbers && nothing[lane] == Real(0);
  return numbers;
}

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
typename ProjectedKernel<Real>::State ProjectedKernel<Real>::at_rest() const {
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

// In turns from the first block to the last and from the last to the first: each pass begins with what the
// last one has left in the cache.
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

// What the blocks have added up: each patch's mean.
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
    neo_hookean_stresses(s.gradient.data(), s.dilation.data(), s.pressure.data(), mu_.data(), volume_.data(),
                         stress, first, last, smallest_J_, slope_);
    if (patches_ == 0)  // inverted, or not a number: no stress there, and the driver stops the run
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

// Without patches a point's force needs nothing of other points: a few at a time, their pairs are still in
// the innermost cache when their forces go back to the nodes.
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
    gradients(quad_.data(), point_offset_.data(), node, s.gradient.data(), s.dilation.data(), q, end);
    for (auto p = static_cast<std::size_t>(q); p < static_cast<std::size_t>(end); ++p)
      s.pressure[p] = s.ks[p] * s.dilation[p];
    point_stresses(s, q, end, stress.data());
    scatter(quad_.data(), point_offset_.data(), stress.data(), force, q, end);
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
      gradients(k.quad_.data(), k.point_offset_.data(), s.at_node.data() + 4 * from, s.gradient.data(),
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
    sweep.finite = least_dilations(s.dilation.data(), least.data(), first, last);
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
    means_of_patches(k.octet_number_.data(), k.octet_weight_.data(), k.octet_offset_.data(),
                     s.at_patch.data() + range(k.patches_of_block_).from, mean.data(), first / 8,
                     (last + 7) / 8);
  }
  void take(const std::vector<Real>& patch) const {
    const auto [from, to] = range(k.patches_of_block_);
    for (std::size_t p = from; p < to; ++p)
      s.at_patch[p] = patch[static_cast<std::size_t>(k.patches_of_block_.member[p])];
  }
  // To the sums of its patches, of a value at each point.
  void spread(const LongVector<Real>& value) const {
    const auto [from, to] = range(k.patches_of_block_);
    std::fill_n(s.octet_sum.data() + 8 * from, 8 * (to - from), Real(0));
    spread_to_patches(k.octet_number_.data(), k.octet_weight_.data(), k.octet_offset_.data(), value.data(),
                      k.volume_.data(), s.octet_sum.data() + 8 * from, first / 8, (last + 7) / 8);
    for (std::size_t p = from; p < to; ++p) {
      const Real* lane = s.octet_sum.data() + 8 * p;
      const auto two = [&](int i) { return static_cast<double>(lane[i]) + static_cast<double>(lane[i + 4]); };
      s.place_sum[p] = (two(0) + two(1)) + (two(2) + two(3));
    }
  }

  // From the volumes of its patches. Pressures that are unknowns of their own take the place of what the bulk
  // modulus makes of the volume.
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

  // The pressures less the patches' means of what no patch resolves; then the forces.
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
    scatter(k.quad_.data(), k.point_offset_.data(), stress.data(), s.at_node.data() + 4 * from, first, last);
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
    variance_forces(v.rows.share.data(), v.rows.offset.data(), s.u.data(),
                    material_[t].mu * s.history[t].step.c, f, first, last);
    if (!s.variance[n].force.empty())
      for (Index k = 4 * first; k < 4 * last; ++k) f[k] += s.variance[n].force[static_cast<std::size_t>(k)];
  }
}

template <class Real>
double ProjectedKernel<Real>::stored_energy(State& s, const double* u, double* hourglass) const {
  stress_sweep(s, u);
  std::vector<double> of_block(s.block.size(), 0.0);  // summed up in their order, whoever made them
  over_blocks(s, [&](Index block, Index first, Index last) {
    for (auto q = static_cast<std::size_t>(first); q < static_cast<std::size_t>(last); ++q) {
      const Material& m = material_[static_cast<std::size_t>(tissue_[q])];
      const double ks = patches_ > 0 ? pointwise_bulk_modulus(m) : m.kappa, e = s.dilation[q],
                   rest = patches_ > 0 ? unresolved_dilation(s, q) : 0.0;
      of_block[static_cast<std::size_t>(block)] +=
          static_cast<double>(volume_[q]) * (distortional_energy(m, gradient_at(s.gradient, q)) +
                                             0.5 * ks * e * e + 0.5 * ks * beta * rest * rest * rest * rest);
    }
  });
  double energy = std::accumulate(of_block.begin(), of_block.end(), 0.0);
  for (std::size_t b = 0; b < patch_volume_.size(); ++b) {
    const double e = s.patch_dilation[b], bulk = s.patch_bulk[b];
    // Of a held pressure: what is stationary both in it and in u (Hellinger and Reissner).
    energy += patch_volume_[b] *
              (s.held.empty() ? 0.5 * bulk * e * e : s.held[b] * e - 0.5 * s.held[b] * s.held[b] / bulk);
  }
  const double seen = energy;
  std::vector<double> f(static_cast<std::size_t>(4 * nodes_));
  for (const Variance& v : variance_) {
    std::fill(f.begin(), f.end(), 0.0);
    variance_forces(v.rows.share.data(), v.rows.offset.data(), s.u.data(),
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
  // ks follows what is left of the shear modulus: after a load that grew evenly until now, the c of one long
  // step.
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
    variance_forces(v.rows.share.data(), v.rows.offset.data(), s.u.data(), material_[t].mu, now.data(), 0,
                    nodes_);
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
      throw std::invalid_argument("the past of another model cannot be taken over");
    std::copy_n(past.data() + at, count, to);
    at += static_cast<std::size_t>(count);
  });
}

// A patch lies in one tissue: that of any of its points.
template <class Real>
void ProjectedKernel<Real>::find_patch_bulk(State& s) const {
  for (std::size_t b = 0; b < s.patch_bulk.size(); ++b)
    s.patch_bulk[b] = static_cast<double>(s.bulk[static_cast<std::size_t>(
        of_patch_.share[static_cast<std::size_t>(of_patch_.offset[b])].number)]);
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
        const Share& share = of_patch_.share[static_cast<std::size_t>(k)];
        const auto q = static_cast<std::size_t>(share.number);
        Eigen::Matrix<float, 4, 3> slope = Eigen::Matrix<float, 4, 3>::Zero();
        slope.template topRows<3>() =
            (static_cast<double>(share.weight) * cofactor(gradient_at(s.gradient, q))).template cast<float>();
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
      if (i > 0 && quad.twice[i] == quad.twice[0]) continue;  // filled up
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
