#pragma once

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <vector>

#include "preprocess/build_model.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple::hertz {

// An elastic sphere between two rigid planes, or two such spheres, by Hertz's pressure over a small disc
// about each pole. The displacement is that of the whole sphere (Lur'e 1964), for each Legendre polynomial of
// the pressure.

inline constexpr double radius = 20e-3, mu = 1000.0, nu = 0.45, young = 2.0 * mu * (1.0 + nu);

struct Contact {
  double force, approach;  // [N]; [m] from the sphere's middle to the plane, less the radius
};

// Force and approach for a contact radius `a` [m].
inline Contact at_radius(double a) {
  constexpr int rings = 1000, terms = 4000;
  const double force = 4.0 / 3.0 * young / (1.0 - nu * nu) * a * a * a / radius,
               highest = 1.5 * force / (std::numbers::pi * a * a);
  std::vector<double> cosine, weight, before(rings, 1.0), now;  // weight: pressure times sin(theta) d theta
  for (int i = 0; i < rings; ++i) {
    const double s = (i + 0.5) / rings * 0.5 * std::numbers::pi, r = a * std::sin(s) / radius;
    cosine.push_back(std::sqrt(1.0 - r * r));
    weight.push_back(highest * std::cos(s) * r / cosine.back() * a / radius * std::cos(s) * 0.5 *
                     std::numbers::pi / rings);
  }
  now = cosine;
  double sinks = 0.0;  // of the pole
  for (const double w : weight) sinks += w * radius * (1.0 - 2.0 * nu) / young;
  for (int n = 2; n <= terms; ++n) {
    double sum = 0.0;
    for (std::size_t i = 0; i < rings; ++i) {
      const double next = ((2 * n - 1) * cosine[i] * now[i] - (n - 1) * before[i]) / n;
      before[i] = now[i];
      now[i] = next;
      sum += weight[i] * next;
    }
    if (n % 2 == 1) continue;  // both poles are pressed
    const double m = n;
    sinks += (2.0 * m + 1.0) * sum * radius *
             (m * (m * m + 2.0 * m - 1.0 + 2.0 * nu) / (m - 1.0) - (m + 1.0) * (m - 2.0 + 4.0 * nu)) /
             (4.0 * mu * (m * m + (1.0 + 2.0 * nu) * m + 1.0 + nu));
  }
  return {force, sinks};
}

inline double force_at(double approach) {
  double low = 0.0, high = 0.2 * radius;
  for (int k = 0; k < 30; ++k) {
    const double a = 0.5 * (low + high);
    (at_radius(a).approach < approach ? low : high) = a;
  }
  return at_radius(low).force;
}

// Number of nodes and tolerance; with DIMPLE_ALL_SCENES=1 as fine as the claim of 2 % needs.
struct Fineness {
  Index nodes = 1500;
  double within = 0.03;
};
inline Fineness fineness() {
  return std::getenv("DIMPLE_ALL_SCENES") ? Fineness{6000, 0.02} : Fineness{};
}

// Upper half of the sphere, fine at its top; its middle plane is the base.
inline Discretisation half_sphere(Index nodes) {
  ModelOptions options;
  options.node_set.count = nodes;
  options.node_set.grading.whole_patch = true;
  options.boundary = {.base = "inferior", .indent_at = "0,0,top", .contact_radius_mm = 2.5};
  return build_model(cut_ellipsoid_surface(Vec3::Constant(1e3 * radius), 0.0, 480), options).model;
}

// Node of the middle plane nearest to the axis.
inline Index centre_of(const Discretisation& half) {
  return *std::min_element(half.base.begin(), half.base.end(), [&](Index a, Index b) {
    return half.X.col(a).head<2>().norm() < half.X.col(b).head<2>().norm();
  });
}

}  // namespace dimple::hertz
