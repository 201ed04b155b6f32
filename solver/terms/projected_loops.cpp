#include "solver/terms/projected_loops.hpp"

#include <algorithm>
#include <cmath>

#include "preprocess/clones.hpp"
#include "solver/terms/inverse_cube_root.hpp"
#include "solver/terms/wide.hpp"

namespace dimple {
namespace {

using namespace wide;  // the vector verbs

template <class Real>
constexpr int ahead = sizeof(Real) == 4 ? 24 : 12;  // quads fetched before they are needed

// F - I of points [first, last), first a multiple of eight; the last octet is padded with zeros. `nodes` of a
// quad are computed at once, and each adds to a sum of its own (of doubles, every second one to the same):
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
        // Unrolled: sums in a loop would stay in memory.
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
// `stress` begins with that of point `first`.
template <class Real, int nodes>
[[gnu::always_inline]] inline void scatter_body(const ProjectedQuad<Real>* quad, const std::int32_t* offset,
                                                const ProjectedColumns<Real>* stress, Real* f, Index first,
                                                Index last) {
  // Prefetch: the next gradients most likely use the data that follows in memory.
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

// J^(-1/3) by Newton's method.
template <class Real, int count>
[[gnu::always_inline]] inline Pack<Real, count> inverse_cube_roots(Pack<Real, count> J) {
  Pack<Real, count> root;
  for (int lane = 0; lane < count; ++lane) root[lane] = inverse_cube_root_guess(J[lane]);
  for (int pass = 0; pass < (count == 8 ? 3 : 4); ++pass)
    root = root * (Real(4) - J * root * root * root) * Real(1.0 / 3.0);
  return root;
}

}  // namespace

template <class Real>
void ProjectedLoops<Real>::gradients(const Quad* quad, const std::int32_t* offset, const Real* u,
                                     Octet* gradient, Real* dilation, Index first, Index last) {
  if constexpr (sizeof(Real) == 4) {
    if (has_avx512) return avx512_gradients(quad, offset, u, gradient, dilation, first, last);
    if (has_avx2) return avx2_gradients(quad, offset, u, gradient, dilation, first, last);
  }
  cloned_gradients(quad, offset, u, gradient, dilation, first, last);
}

template <class Real>
DIMPLE_CLONES void ProjectedLoops<Real>::neo_hookean_stresses(const Octet* gradient, const Real* dilation,
                                                              const Real* pressure, const Real* mu,
                                                              const Real* volume, Columns* stress,
                                                              Index first, Index last, Real least_J,
                                                              Real fraction) {
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
    const Lanes root = inverse_cube_roots<Real, count>(Jc);
    const Lanes power = root * root, below = J - least_J;
    const Lanes power_slope = Real(-2.0 / 3.0) * power * (root * root * root);
    const Lanes low = g0 + below * (g1 + Real(0.5) * g2 * below), low_slope = g1 + g2 * below;
    const Lanes g = inverted ? low : power, slope = fraction * (inverted ? low_slope : power_slope);

    // P = M g F + (pressure + M I1 slope / 2) cof F. At small strains both parts of M nearly cancel, which
    // would leave the rounding of 1. With F = I + H and cof F = I + K the two identities are combined first:
    // g + I1 slope / 2 = (g / J) (J - 1 - stretch).
    const Lanes cofactor = Real(0.5) * I1 * slope;
    const Lanes direct = g + cofactor, upright = power * (root * root * root) * (e - stretch);
    const Lanes of_identity = fraction == Real(0) ? direct : inverted ? direct : upright;
    const Lanes V = load<count>(volume + q), M = load<count>(mu + q), shear = V * M * g;
    const Lanes VP = V * load<count>(pressure + q), p = VP + V * M * cofactor,
                residual = VP + V * M * of_identity;
    const Lanes P[3][3] = {
        // [column][row] of V P = shear H + p K + rest I
        {shear * h00 + p * (h11 + h22 + (h11 * h22 - h21 * h12)) + residual,
         shear * h10 + p * ((h21 * h02 - h01 * h22) - h01),
         shear * h20 + p * ((h01 * h12 - h11 * h02) - h02)},
        {shear * h01 + p * ((h12 * h20 - h22 * h10) - h10),
         shear * h11 + p * (h22 + h00 + (h22 * h00 - h02 * h20)) + residual,
         shear * h21 + p * ((h02 * h10 - h12 * h00) - h12)},
        {shear * h02 + p * ((h10 * h21 - h20 * h11) - h20), shear * h12 + p * ((h20 * h01 - h00 * h21) - h21),
         shear * h22 + p * (h00 + h11 + (h00 * h11 - h10 * h01)) + residual}};
    for (int j = 0; j < 3; ++j) {
      Pack<Real, 4> column[count];
      columns<Real, count>(P[j][0], P[j][1], P[j][2], column);
      for (int lane = 0; lane < count; ++lane) four(stress[q - first + lane].column[j]) = column[lane];
    }
  }
}

template <class Real>
void ProjectedLoops<Real>::scatter(const Quad* quad, const std::int32_t* offset, const Columns* stress,
                                   Real* f, Index first, Index last) {
  if constexpr (sizeof(Real) == 4) {
    if (has_avx512) return avx512_scatter(quad, offset, stress, f, first, last);
    if (has_avx2) return avx2_scatter(quad, offset, stress, f, first, last);
  }
  cloned_scatter(quad, offset, stress, f, first, last);
}

template <class Real>
DIMPLE_CLONES void ProjectedLoops<Real>::variance_forces(const Fraction* fraction, const std::int32_t* offset,
                                                         const Real* u, double scale, double* f, Index first,
                                                         Index last) {
  for (Index a = first; a < last; ++a) {
    Four<Real> sum[4] = {};
    std::int32_t k = offset[a];
    const std::int32_t end = offset[a + 1];
    for (; k + 3 < end; k += 4) {
      __builtin_prefetch(fraction + k + 128);
      for (int i = 0; i < 4; ++i) sum[i] += four(u, fraction[k + i].number) * fraction[k + i].weight;
    }
    for (; k < end; ++k) sum[0] += four(u, fraction[k].number) * fraction[k].weight;
    const auto all = (sum[0] + sum[1]) + (sum[2] + sum[3]);
    for (int i = 0; i < 4; ++i) f[4 * a + i] += scale * static_cast<double>(all[i]);
  }
}

template <class Real>
DIMPLE_CLONES void ProjectedLoops<Real>::means_of_patches(const std::int32_t* number, const Real* weight,
                                                          const std::int32_t* offset, const Real* patch,
                                                          Real* mean, Index first, Index last) {
  using Eight = Pack<Real, 8>;
  for (Index o = first; o < last; ++o) {
    Eight even = {}, odd = {};
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
DIMPLE_CLONES void ProjectedLoops<Real>::spread_to_patches(const std::int32_t* number, const Real* weight,
                                                           const std::int32_t* offset, const Real* value,
                                                           const Real* volume, Real* patch, Index first,
                                                           Index last) {
  using Eight = Pack<Real, 8>;
  for (Index o = first; o < last; ++o) {
    const Eight all = load<8>(value + 8 * o) * load<8>(volume + 8 * o);
    for (std::int32_t k = offset[o], end = offset[o + 1]; k < end; ++k)
      store<8>(patch + 8 * number[k], load<8>(patch + 8 * number[k]) + load<8>(weight + 8 * k) * all);
  }
}

template <class Real>
DIMPLE_CLONES bool ProjectedLoops<Real>::least_dilations(const Real* dilation, Real* least, Index first,
                                                         Index last) {
  using Eight = Pack<Real, 8>;
  Eight smallest = {}, nothing = {};
  for (Index o = first / 8; 8 * o < last; ++o) {
    const Eight now = load<8>(dilation + 8 * o);
    smallest = now < smallest ? now : smallest;
    nothing += now - now;
  }
  store<8>(least, smallest);
  bool numbers = true;
  for (int lane = 0; lane < 8; ++lane) numbers = numbers && nothing[lane] == Real(0);
  return numbers;
}

template struct ProjectedLoops<float>;
template struct ProjectedLoops<double>;

}  // namespace dimple
