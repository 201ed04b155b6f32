#include "preprocess/supports/mls_lanes.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "preprocess/clones.hpp"

namespace dimple {
namespace {

constexpr int width = 4;
using Lanes = double __attribute__((vector_size(8 * width), aligned(8), may_alias));

// No function: one that returned a register would depend on the processor it is compiled for.
#define DIMPLE_LOAD(from) (*reinterpret_cast<const Lanes*>(from))
#define DIMPLE_STORE(to, value) (*reinterpret_cast<Lanes*>(to) = (value))

// Keeps and counts the nodes that reach any of eight places, and sums their radii for each place.
DIMPLE_CLONES void keep_reaching(const double* place, const double* X, const double* radius,
                                 const int* candidates, Index count, int* kept, Index* kept_count,
                                 double* reached, double* sum_of_radii) {
  Lanes n[2] = {}, sum[2] = {};
  Index keep = 0;
  for (Index k = 0; k < count; ++k) {
    const int a = candidates[k];
    const double *at = X + 3 * a, R = radius[a];
    Lanes in[2];
    for (int h = 0; h < 2; ++h) {
      const Lanes dx = DIMPLE_LOAD(place + 4 * h) - at[0], dy = DIMPLE_LOAD(place + 8 + 4 * h) - at[1],
                  dz = DIMPLE_LOAD(place + 16 + 4 * h) - at[2];
      in[h] = dx * dx + dy * dy + dz * dz < R * R ? Lanes{1.0, 1.0, 1.0, 1.0} : Lanes{};
      n[h] += in[h];
      sum[h] += R * in[h];
    }
    const Lanes both = in[0] + in[1];
    kept[keep] = a;
    keep += both[0] + both[1] + both[2] + both[3] > 0.0;
  }
  *kept_count = keep;
  for (int h = 0; h < 2; ++h) {
    DIMPLE_STORE(reached + 4 * h, n[h]);
    DIMPLE_STORE(sum_of_radii + 4 * h, sum[h]);
  }
}

// Four places: two passes over the nodes for the coefficients and one for the gradients, or one and one for
// values.
DIMPLE_CLONES void gradients_of_four(const double* place, const double* X, const double* radius,
                                     const int* nodes, Index count, const char* pinned, double e,
                                     const double* scale, double* weight, double* rows, Index stride,
                                     bool gradients, double* pivot_ratio) {
  const Lanes px = DIMPLE_LOAD(place), py = DIMPLE_LOAD(place + 8), pz = DIMPLE_LOAD(place + 16);
  const Lanes per_scale = 1.0 / DIMPLE_LOAD(scale);
  // Moments about the place, of 1, x, y, z: the lower triangle.
  Lanes m00 = {}, m10 = {}, m20 = {}, m30 = {}, m11 = {}, m21 = {}, m31 = {}, m22 = {}, m32 = {}, m33 = {};
  for (Index k = 0; k < count; ++k) {
    const double *at = X + 3 * nodes[k], R = radius[nodes[k]], inverse2 = 1.0 / (R * R);
    const Lanes x = at[0] - px, y = at[1] - py, z = at[2] - pz;
    const Lanes s2 = (x * x + y * y + z * z) * inverse2;
    Lanes s;
    for (int lane = 0; lane < width; ++lane) s[lane] = std::sqrt(s2[lane]);
    const auto inside = s2 < 1.0;
    Lanes w = inside ? 1.0 + s2 * (-6.0 + s * (8.0 - 3.0 * s)) : Lanes{};
    // dw/dx_r = slope (place - X)_r
    Lanes slope = inside ? (-12.0 * inverse2) * ((1.0 - s) * (1.0 - s)) : Lanes{};
    if (pinned[nodes[k]]) {
      const Lanes per = 1.0 / (s2 + e), factor = (1.0 + e) * per;
      w *= factor;
      slope = slope * factor - (2.0 * inverse2) * w * per;
    }
    DIMPLE_STORE(weight + 8 * k, w);
    DIMPLE_STORE(weight + 8 * k + 4, slope);
    const Lanes u = x * per_scale, v = y * per_scale, t = z * per_scale;
    const Lanes wu = w * u, wv = w * v, wt = w * t;
    m00 += w, m10 += wu, m20 += wv, m30 += wt;
    m11 += wu * u, m21 += wu * v, m31 += wu * t;
    m22 += wv * v, m32 += wv * t, m33 += wt * t;
  }
  // L D L^T
  const Lanes d0 = m00, l10 = m10 / d0, l20 = m20 / d0, l30 = m30 / d0;
  const Lanes d1 = m11 - l10 * m10, c21 = m21 - l20 * m10, c31 = m31 - l30 * m10;
  const Lanes l21 = c21 / d1, l31 = c31 / d1;
  const Lanes d2 = m22 - l20 * m20 - l21 * c21, c32 = m32 - l30 * m20 - l31 * c21;
  const Lanes l32 = c32 / d2;
  const Lanes d3 = m33 - l30 * m30 - l31 * c31 - l32 * c32;
  for (int lane = 0; lane < width; ++lane) {
    const double least = std::min(std::min(d0[lane], d1[lane]), std::min(d2[lane], d3[lane]));
    const double most = std::max(std::max(d0[lane], d1[lane]), std::max(d2[lane], d3[lane]));
    pivot_ratio[lane] = least > 0.0 ? least / most : 0.0;
  }
  const auto solve = [&](Lanes & b0, Lanes & b1, Lanes & b2, Lanes & b3) __attribute__((always_inline)) {
    b1 -= l10 * b0;
    b2 -= l20 * b0 + l21 * b1;
    b3 -= l30 * b0 + l31 * b1 + l32 * b2;
    b0 /= d0, b1 /= d1, b2 /= d2, b3 /= d3;
    b2 -= l32 * b3;
    b1 -= l21 * b2 + l31 * b3;
    b0 -= l10 * b1 + l20 * b2 + l30 * b3;
  };
  Lanes c0 = {1.0, 1.0, 1.0, 1.0}, c1 = {}, c2 = {}, c3 = {};
  solve(c0, c1, c2, c3);
  if (!gradients) {
    for (Index k = 0; k < count; ++k) {
      const double* at = X + 3 * nodes[k];
      const Lanes u = (at[0] - px) * per_scale, v = (at[1] - py) * per_scale, t = (at[2] - pz) * per_scale;
      const Lanes phi = DIMPLE_LOAD(weight + 8 * k) * (c0 + u * c1 + v * c2 + t * c3);
      for (int lane = 0; lane < width; ++lane) rows[lane * stride + k] = phi[lane];
    }
    return;
  }

  // Right sides of d c/dx_r: p'(x) - dA/dx_r c.
  Lanes b[3][4] = {};
  for (Index k = 0; k < count; ++k) {
    const double* at = X + 3 * nodes[k];
    const Lanes x = at[0] - px, y = at[1] - py, z = at[2] - pz;
    const Lanes u = x * per_scale, v = y * per_scale, t = z * per_scale;
    const Lanes pc = DIMPLE_LOAD(weight + 8 * k + 4) * (c0 + u * c1 + v * c2 + t * c3);
    const Lanes gx = x * pc, gy = y * pc, gz = z * pc;  // minus dw/dx_r p.c
    b[0][0] += gx, b[0][1] += gx * u, b[0][2] += gx * v, b[0][3] += gx * t;
    b[1][0] += gy, b[1][1] += gy * u, b[1][2] += gy * v, b[1][3] += gy * t;
    b[2][0] += gz, b[2][1] += gz * u, b[2][2] += gz * v, b[2][3] += gz * t;
  }
  for (int r = 0; r < 3; ++r) {
    b[r][1 + r] += per_scale;
    solve(b[r][0], b[r][1], b[r][2], b[r][3]);
  }
  for (Index k = 0; k < count; ++k) {
    const double* at = X + 3 * nodes[k];
    const Lanes x = at[0] - px, y = at[1] - py, z = at[2] - pz;
    const Lanes u = x * per_scale, v = y * per_scale, t = z * per_scale;
    const Lanes w = DIMPLE_LOAD(weight + 8 * k);
    const Lanes pc = DIMPLE_LOAD(weight + 8 * k + 4) * (c0 + u * c1 + v * c2 + t * c3);
    const Lanes g[3] = {w * (b[0][0] + u * b[0][1] + v * b[0][2] + t * b[0][3]) - x * pc,
                        w * (b[1][0] + u * b[1][1] + v * b[1][2] + t * b[1][3]) - y * pc,
                        w * (b[2][0] + u * b[2][1] + v * b[2][2] + t * b[2][3]) - z * pc};
    for (int lane = 0; lane < width; ++lane)
      for (int r = 0; r < 3; ++r) rows[(3 * lane + r) * stride + k] = g[r][lane];
  }
}

DIMPLE_CLONES void transform(double* rows, Index stride) {
  for (Index m = 0; m < stride; m += width)
    for (int r = 0; r < 3; ++r) {
      Lanes v[cell_places];
      for (int k = 0; k < cell_places; ++k) v[k] = DIMPLE_LOAD(rows + (3 * k + r) * stride + m);
      for (int step = 1; step < cell_places; step *= 2)
        for (int k = 0; k < cell_places; ++k)
          if (!(k & step)) {
            const Lanes sum = v[k] + v[k + step], difference = v[k] - v[k + step];
            v[k] = sum;
            v[k + step] = difference;
          }
      const double root = std::sqrt(1.0 / cell_places);
      DIMPLE_STORE(rows + r * stride + m, v[0] * (1.0 / cell_places));
      for (int k = 1; k < cell_places; ++k) DIMPLE_STORE(rows + (3 * k + r) * stride + m, v[k] * root);
    }
}

DIMPLE_CLONES void products(const double* rows, int count, Index stride, Index n, double factor,
                            double* lower) {
  for (Index a = 0; a < n; a += width) {
    const Index here = std::min<Index>(width, n - a);
    for (Index b = 0; b < a + here; b += 2 * width) {
      Lanes sum[width][2] = {};
      const double *left = rows + a, *right = rows + b;
      for (int r = 0; r < count; ++r, left += stride, right += stride) {
        const Lanes r0 = DIMPLE_LOAD(right), r1 = DIMPLE_LOAD(right + width);
        for (int i = 0; i < width; ++i) {
          sum[i][0] += left[i] * r0;
          sum[i][1] += left[i] * r1;
        }
      }
      for (Index i = 0; i < here; ++i) {
        double both[2 * width];
        DIMPLE_STORE(both, factor * sum[i][0]);
        DIMPLE_STORE(both + width, factor * sum[i][1]);
        const Index row = a + i, last = std::min<Index>(2 * width, row + 1 - b);
        if (last > 0)
          std::memcpy(lower + row * (row + 1) / 2 + b, both, static_cast<std::size_t>(last) * sizeof(double));
      }
    }
  }
}

#undef DIMPLE_LOAD
#undef DIMPLE_STORE

}  // namespace

void mls_of_eight(const Points& x, const Points& X, std::span<const int> nodes, const Eigen::VectorXd& radius,
                  std::span<const char> pinned, double interpolation, bool gradients, MlsOfEight& result) {
  const Index rows = gradients ? 3 : 1;  // of each place
  std::array<double, 3 * cell_places> place;
  std::array<double, cell_places> reached, scale;
  for (int k = 0; k < cell_places; ++k)
    for (int r = 0; r < 3; ++r) place[static_cast<std::size_t>(cell_places * r + k)] = x(r, k);
  result.nodes.resize(nodes.size() + 1);  // keep_reaching() writes before its test
  Index count = 0;
  keep_reaching(place.data(), X.data(), radius.data(), nodes.data(), static_cast<Index>(nodes.size()),
                result.nodes.data(), &count, reached.data(), scale.data());
  result.nodes.resize(static_cast<std::size_t>(count));
  for (std::size_t k = 0; k < cell_places; ++k) {
    result.reached[k] = static_cast<int>(reached[k]);
    scale[k] = reached[k] > 0.0 ? scale[k] / reached[k] : 1.0;
  }
  result.stride = (count + 7) / 8 * 8;
  result.rows.assign(static_cast<std::size_t>(rows * cell_places * result.stride), 0.0);
  result.weight.resize(static_cast<std::size_t>(8 * count));
  for (int half = 0; half < 2; ++half)
    gradients_of_four(place.data() + 4 * half, X.data(), radius.data(), result.nodes.data(), count,
                      pinned.data(), interpolation, scale.data() + 4 * half, result.weight.data(),
                      result.rows.data() + 4 * rows * half * result.stride, result.stride, gradients,
                      result.pivot_ratio.data() + 4 * half);
}

void mean_and_deviations(MlsOfEight& gradients) {
  transform(gradients.rows.data(), gradients.stride);
}

void lower_products(const double* rows, int count, Index stride, Index n, double factor, double* lower) {
  products(rows, count, stride, n, factor, lower);
}

}  // namespace dimple
