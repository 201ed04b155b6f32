#include "tests/bench/reference_force.hpp"

#include <algorithm>
#include <cmath>

#include "preprocess/clones.hpp"
#include "solver/terms/inverse_cube_root.hpp"

namespace dimple {
namespace {

std::vector<std::int32_t> plain(const Eigen::VectorXi& values) {
  return {values.begin(), values.end()};
}

// All loops are inlined into functions that are not templates, since only those can be cloned per processor.

template <class Real>
[[gnu::always_inline]] inline void gradients(ReferenceForce<Real>& r) {
  const std::int32_t* node = r.node.data();
  const Real *dx = r.dphi_x.data(), *dy = r.dphi_y.data(), *dz = r.dphi_z.data();
  const Real *ux = r.u_x.data(), *uy = r.u_y.data(), *uz = r.u_z.data();
  for (std::size_t q = 0; q < r.volume.size(); ++q) {
    Real xx = 0, xy = 0, xz = 0, yx = 0, yy = 0, yz = 0, zx = 0, zy = 0, zz = 0;
    for (std::int32_t k = r.offset[q], end = r.offset[q + 1]; k < end; ++k) {
      const std::int32_t a = node[k];
      xx += ux[a] * dx[k];
      xy += ux[a] * dy[k];
      xz += ux[a] * dz[k];
      yx += uy[a] * dx[k];
      yy += uy[a] * dy[k];
      yz += uy[a] * dz[k];
      zx += uz[a] * dx[k];
      zy += uz[a] * dy[k];
      zz += uz[a] * dz[k];
    }
    const Real row[9] = {xx, xy, xz, yx, yy, yz, zx, zy, zz};
    for (std::size_t i = 0; i < 9; ++i) r.H[i][q] = row[i];
  }
}

// det(I + H) - 1 without the loss of digits of det F - 1.
template <class Real>
[[gnu::always_inline]] inline void dilations(ReferenceForce<Real>& r) {
  const Real *xx = r.H[0].data(), *xy = r.H[1].data(), *xz = r.H[2].data(), *yx = r.H[3].data(),
             *yy = r.H[4].data(), *yz = r.H[5].data(), *zx = r.H[6].data(), *zy = r.H[7].data(),
             *zz = r.H[8].data();
  Real* __restrict dilation = r.dilation.data();
  for (std::size_t q = 0; q < r.volume.size(); ++q) {
    const Real minors =
        (xx[q] * yy[q] - xy[q] * yx[q]) + (xx[q] * zz[q] - xz[q] * zx[q]) + (yy[q] * zz[q] - yz[q] * zy[q]);
    const Real det = xx[q] * (yy[q] * zz[q] - yz[q] * zy[q]) - xy[q] * (yx[q] * zz[q] - yz[q] * zx[q]) +
                     xz[q] * (yx[q] * zy[q] - yy[q] * zx[q]);
    dilation[q] = (xx[q] + yy[q] + zz[q]) + minors + det;
  }
}

// result[row] = sum of weight x value[member].
template <class Real>
[[gnu::always_inline]] inline Real weighted(const typename ReferenceForce<Real>::Rows& rows, std::size_t row,
                                            const Real* value) {
  const std::int32_t* member = rows.member.data();
  const Real* weight = rows.weight.data();
  Real sum = 0;
  for (std::int32_t k = rows.offset[row], end = rows.offset[row + 1]; k < end; ++k)
    sum += weight[k] * value[member[k]];
  return sum;
}

template <class Real>
[[gnu::always_inline]] inline void pressures(ReferenceForce<Real>& r) {
  for (std::size_t b = 0; b < r.patch_dilation.size(); ++b)
    r.patch_dilation[b] = weighted<Real>(r.of_patch, b, r.dilation.data());
  for (std::size_t q = 0; q < r.volume.size(); ++q) {
    const Real mean = weighted<Real>(r.of_point, q, r.patch_dilation.data()),
               remaining = r.dilation[q] - mean;
    r.unresolved[q] = Real(2) * r.beta * r.ks * remaining * remaining * remaining;
    r.pressure[q] = r.ks * r.dilation[q] + r.bulk * mean + r.unresolved[q];
  }
  for (std::size_t b = 0; b < r.patch_unresolved.size(); ++b)
    r.patch_unresolved[b] = weighted<Real>(r.of_patch, b, r.unresolved.data());
  for (std::size_t q = 0; q < r.volume.size(); ++q)
    r.pressure[q] -= weighted<Real>(r.of_point, q, r.patch_unresolved.data());
}

// V P = V mu g F + V (pressure + mu/2 g' tr C) cof F, g = J^(-2/3).
template <class Real>
[[gnu::always_inline]] inline void stresses(ReferenceForce<Real>& r) {
  const Real *hxx = r.H[0].data(), *hxy = r.H[1].data(), *hxz = r.H[2].data(), *hyx = r.H[3].data(),
             *hyy = r.H[4].data(), *hyz = r.H[5].data(), *hzx = r.H[6].data(), *hzy = r.H[7].data(),
             *hzz = r.H[8].data(), *dilation = r.dilation.data(), *pressure = r.pressure.data(),
             *volume = r.volume.data();
  Real *__restrict pxx = r.VP[0].data(), *__restrict pxy = r.VP[1].data(), *__restrict pxz = r.VP[2].data(),
       *__restrict pyx = r.VP[3].data(), *__restrict pyy = r.VP[4].data(), *__restrict pyz = r.VP[5].data(),
       *__restrict pzx = r.VP[6].data(), *__restrict pzy = r.VP[7].data(), *__restrict pzz = r.VP[8].data();
  const Real mu = r.mu, J0 = r.smallest_J, g0 = std::pow(J0, Real(-2.0 / 3.0)),
             g1 = Real(-2.0 / 3.0) * g0 / J0, g2 = Real(-5.0 / 3.0) * g1 / J0;
  for (std::size_t q = 0; q < r.volume.size(); ++q) {
    const Real xx = hxx[q] + 1, xy = hxy[q], xz = hxz[q], yx = hyx[q], yy = hyy[q] + 1, yz = hyz[q],
               zx = hzx[q], zy = hzy[q], zz = hzz[q] + 1, J = dilation[q] + 1;
    const Real trace =
        (xx * xx + xy * xy + xz * xz) + (yx * yx + yy * yy + yz * yz) + (zx * zx + zy * zy + zz * zz);
    // std::cbrt would keep this loop from handling several points at once.
    const Real Jc = J > J0 ? J : J0, below = J - J0;
    Real root = inverse_cube_root_guess(Jc);
    for (int pass = 0; pass < (sizeof(Real) == 4 ? 3 : 4); ++pass)
      root = root * (Real(4) - Jc * root * root * root) * Real(1.0 / 3.0);
    const Real power = root * root, power_slope = Real(-2.0 / 3.0) * power * (root * root * root);
    const Real low = g0 + below * (g1 + Real(0.5) * g2 * below), low_slope = g1 + g2 * below;
    const Real g = J < J0 ? low : power, slope = J < J0 ? low_slope : power_slope;
    const Real shear = volume[q] * mu * g, p = volume[q] * (pressure[q] + Real(0.5) * mu * trace * slope);
    pxx[q] = shear * xx + p * (yy * zz - yz * zy);
    pxy[q] = shear * xy + p * (yz * zx - yx * zz);
    pxz[q] = shear * xz + p * (yx * zy - yy * zx);
    pyx[q] = shear * yx + p * (xz * zy - xy * zz);
    pyy[q] = shear * yy + p * (xx * zz - xz * zx);
    pyz[q] = shear * yz + p * (xy * zx - xx * zy);
    pzx[q] = shear * zx + p * (xy * yz - xz * yy);
    pzy[q] = shear * zy + p * (xz * yx - xx * yz);
    pzz[q] = shear * zz + p * (xx * yy - xy * yx);
  }
}

template <class Real>
[[gnu::always_inline]] inline void forces(ReferenceForce<Real>& r) {
  const Real *ux = r.u_x.data(), *uy = r.u_y.data(), *uz = r.u_z.data();
  Real *fx = r.f_x.data(), *fy = r.f_y.data(), *fz = r.f_z.data();
  const std::int32_t* other = r.variance.member.data();
  const Real* K = r.variance.weight.data();
  for (std::size_t a = 0; a < r.f_x.size(); ++a) {
    Real x = 0, y = 0, z = 0;
    for (std::int32_t k = r.variance.offset[a], end = r.variance.offset[a + 1]; k < end; ++k) {
      x += K[k] * ux[other[k]];
      y += K[k] * uy[other[k]];
      z += K[k] * uz[other[k]];
    }
    fx[a] = r.mu * x;
    fy[a] = r.mu * y;
    fz[a] = r.mu * z;
  }
  const std::int32_t* node = r.node.data();
  const Real *dx = r.dphi_x.data(), *dy = r.dphi_y.data(), *dz = r.dphi_z.data();
  for (std::size_t q = 0; q < r.volume.size(); ++q) {
    const Real xx = r.VP[0][q], xy = r.VP[1][q], xz = r.VP[2][q], yx = r.VP[3][q], yy = r.VP[4][q],
               yz = r.VP[5][q], zx = r.VP[6][q], zy = r.VP[7][q], zz = r.VP[8][q];
    for (std::int32_t k = r.offset[q], end = r.offset[q + 1]; k < end; ++k) {
      const std::int32_t a = node[k];
      fx[a] += xx * dx[k] + xy * dy[k] + xz * dz[k];
      fy[a] += yx * dx[k] + yy * dy[k] + yz * dz[k];
      fz[a] += zx * dx[k] + zy * dy[k] + zz * dz[k];
    }
  }
}

template <class Real>
[[gnu::always_inline]] inline void all(ReferenceForce<Real>& r) {
  gradients(r);
  dilations(r);
  pressures(r);
  stresses(r);
  forces(r);
}

DIMPLE_CLONES void all_single(ReferenceForce<float>& r) {
  all(r);
}
DIMPLE_CLONES void all_double(ReferenceForce<double>& r) {
  all(r);
}

}  // namespace

template <class Real>
ReferenceForce<Real>::ReferenceForce(const Model& model, const Material& material)
    : mu(static_cast<Real>(material.mu)),
      ks(static_cast<Real>(pointwise_bulk_modulus(material))),
      bulk(static_cast<Real>(material.kappa - pointwise_bulk_modulus(material))),
      offset(plain(model.support.offset)),
      node(plain(model.support.member)) {
  const auto real = [](double value) { return static_cast<Real>(value); };
  for (Index k = 0; k < model.dphi.cols(); ++k) {
    dphi_x.push_back(real(model.dphi(0, k)));
    dphi_y.push_back(real(model.dphi(1, k)));
    dphi_z.push_back(real(model.dphi(2, k)));
  }
  for (const double V : model.volume) volume.push_back(real(V));

  const PressurePatches& patches = model.patches;
  of_point = {plain(patches.of_point.offset), plain(patches.of_point.member), {}};
  for (const double psi : patches.psi) of_point.weight.push_back(real(psi));
  Eigen::VectorXi place;
  const CompressedRows members = transpose(patches.of_point, patches.count(), &place);
  of_patch = {plain(members.offset), plain(members.member), {}};
  for (Index b = 0; b < patches.count(); ++b)
    for (int k = members.offset[b]; k < members.offset[b + 1]; ++k)
      of_patch.weight.push_back(
          real(patches.psi[place[k]] * model.volume[members.member[k]] / patches.volume[b]));

  const GradientVariance& v = model.variance.at(0);
  variance = {plain(v.rows.offset), plain(v.rows.member), {}};
  for (const double K : v.K) variance.weight.push_back(real(K));

  const auto Q = static_cast<std::size_t>(model.point_count()),
             N = static_cast<std::size_t>(model.node_count()), B = static_cast<std::size_t>(patches.count());
  for (auto* values : {&u_x, &u_y, &u_z, &f_x, &f_y, &f_z}) values->resize(N);
  for (auto& values : H) values.resize(Q);
  for (auto& values : VP) values.resize(Q);
  for (auto* values : {&dilation, &pressure, &unresolved}) values->resize(Q);
  for (auto* values : {&patch_dilation, &patch_unresolved}) values->resize(B);
}

void evaluate(ReferenceForce<float>& reference) {
  all_single(reference);
}
void evaluate(ReferenceForce<double>& reference) {
  all_double(reference);
}

template <class Real>
void set_displacement(ReferenceForce<Real>& reference, const Eigen::Matrix4Xd& u) {
  for (std::size_t a = 0; a < reference.u_x.size(); ++a) {
    const auto at = u.col(static_cast<Index>(a));
    reference.u_x[a] = static_cast<Real>(at.x());
    reference.u_y[a] = static_cast<Real>(at.y());
    reference.u_z[a] = static_cast<Real>(at.z());
  }
}

template <class Real>
Eigen::Matrix4Xd force_of(const ReferenceForce<Real>& reference) {
  Eigen::Matrix4Xd f(4, static_cast<Index>(reference.f_x.size()));
  for (std::size_t a = 0; a < reference.f_x.size(); ++a)
    f.col(static_cast<Index>(a)) << reference.f_x[a], reference.f_y[a], reference.f_z[a], 0.0;
  return f;
}

#define DIMPLE_REFERENCE(Real)                                                    \
  template struct ReferenceForce<Real>;                                           \
  template void set_displacement(ReferenceForce<Real>&, const Eigen::Matrix4Xd&); \
  template Eigen::Matrix4Xd force_of(const ReferenceForce<Real>&);
DIMPLE_REFERENCE(float)
DIMPLE_REFERENCE(double)
#undef DIMPLE_REFERENCE

}  // namespace dimple
