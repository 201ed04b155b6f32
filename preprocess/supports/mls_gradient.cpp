#include "preprocess/supports/mls_gradient.hpp"

#include <Eigen/Cholesky>
#include <array>
#include <cmath>
#include <vector>

namespace dimple {
namespace {

struct WeightValue {
  double w;      ///< weight
  double dw_ds;  ///< its derivative with respect to s = distance / radius
};

// The quartic spline.
WeightValue weight_at(double s) {
  if (s >= 1.0) return {0.0, 0.0};
  return {1.0 + s * s * (-6.0 + s * (8.0 - 3.0 * s)), s * (-12.0 + s * (24.0 - 12.0 * s))};
}

using Vec4 = Eigen::Vector4d;
using Mat4 = Eigen::Matrix4d;

Vec4 basis_at(const Vec3& y) {
  Vec4 p;
  p << 1.0, y;
  return p;
}

WeightValue sharpened(WeightValue at, double s, double e) {
  const double factor = (1.0 + e) / (s * s + e);
  return {at.w * factor, at.dw_ds * factor - at.w * factor * 2.0 * s / (s * s + e)};
}

}  // namespace

MlsResult mls_shape_functions(const Vec3& x, const Points& X, std::span<const int> nodes,
                              const Eigen::VectorXd& radius, double growth, const SupportOptions& options,
                              std::span<const char> pinned, Eigen::VectorXd& phi, Points& dphi) {
  if (options.interpolation <= 0.0) pinned = {};
  const Index n = static_cast<Index>(nodes.size());
  phi.resize(n);
  dphi.resize(3, n);
  if (n < 4) return {};

  double scale = 0.0;
  for (const int a : nodes) scale += radius[a];
  scale *= growth / static_cast<double>(n);

  // The basis is centred at x: p(x) = e_1, and d/dx_r of p_a is minus the basis' own derivative.
  // Differentiating only the weights with x fixed in the basis gives the same phi, since the span of p does
  // not change with x.
  thread_local std::vector<double> weight;
  weight.resize(static_cast<std::size_t>(n));
  Mat4 A = Mat4::Zero();
  std::array<Mat4, 3> dA = {Mat4::Zero(), Mat4::Zero(), Mat4::Zero()};
  for (Index k = 0; k < n; ++k) {
    const int a = nodes[static_cast<std::size_t>(k)];
    const Vec3 d = x - X.col(a);
    const double R = radius[a] * growth, distance = d.norm(), s = distance / R;
    WeightValue at = weight_at(s);
    if (!pinned.empty() && pinned[static_cast<std::size_t>(a)]) at = sharpened(at, s, options.interpolation);
    const double w = weight[static_cast<std::size_t>(k)] = at.w;
    const Vec3 dw = distance > 0.0 ? Vec3(d * (at.dw_ds / (R * distance))) : Vec3(Vec3::Zero());
    dphi.col(k) = dw;
    const Vec4 p = basis_at(-d / scale);
    const Mat4 pp = p * p.transpose();
    A += w * pp;
    for (int r = 0; r < 3; ++r) dA[static_cast<std::size_t>(r)] += dw[r] * pp;
  }

  const Eigen::LDLT<Mat4> factor(A);
  const auto pivots = factor.vectorD();
  const double largest = pivots.cwiseAbs().maxCoeff(), smallest = pivots.minCoeff();
  if (!(smallest > 0.0)) return {};

  const Vec4 c = factor.solve(Vec4::Unit(0));
  std::array<Vec4, 3> dc;
  for (int r = 0; r < 3; ++r) {
    // p(x') at x' = x + dx in the frozen frame is [1, dx/scale, O(dx^2)]: its derivative is e_(r+1)/scale.
    const Vec4 dp = Vec4::Unit(1 + r) / scale;
    dc[static_cast<std::size_t>(r)] = factor.solve(dp - dA[static_cast<std::size_t>(r)] * c);
  }
  for (Index k = 0; k < n; ++k) {
    const int a = nodes[static_cast<std::size_t>(k)];
    const Vec3 d = x - X.col(a), dw = dphi.col(k);
    const double w = weight[static_cast<std::size_t>(k)];
    const Vec4 p = basis_at(-d / scale);
    const double pc = p.dot(c);
    phi[k] = w * pc;
    for (int r = 0; r < 3; ++r) dphi(r, k) = dw[r] * pc + w * p.dot(dc[static_cast<std::size_t>(r)]);
  }
  return {smallest / largest};
}

}  // namespace dimple
