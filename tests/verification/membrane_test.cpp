// Films on a body against closed forms.

#include "solver/terms/membrane.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "preprocess/build_model.hpp"
#include "preprocess/surface/shapes.hpp"
#include "solver/equilibrium/relax.hpp"
#include "tests/verification/verify_bodies.hpp"

namespace dimple {
namespace {

// A block with curved nodes' supports, as the product makes it; all of its surface.
const Model& block_model() {
  static const Model model = [] {
    ModelOptions options;
    options.cloud.count = 800;
    options.boundary.indenter_diameter_mm = 10.0;
    return build_model(block_surface(Vec3::Zero(), Vec3(30.0, 30.0, 20.0)), options).model;
  }();
  return model;
}
Membrane film_on(const Model& model, double tension = 0.0) {
  std::vector<Index> all(static_cast<std::size_t>(model.surface.triangles.cols()));
  std::iota(all.begin(), all.end(), Index{0});
  return {.patch = surface_patch(model, all), .thickness = 1e-4, .shear_modulus = 4e5, .tension = tension};
}
double area_of(const SurfacePatch& patch) {
  double sum = 0.0;
  for (const auto& t : patch.triangles.colwise()) {
    const Vec3 a = patch.corner.col(t[0]);
    sum += 0.5 * (Vec3(patch.corner.col(t[1])) - a).cross(Vec3(patch.corner.col(t[2])) - a).norm();
  }
  return sum;
}
Nodal linear(const Model& model, const Mat3& gradient) {
  Nodal u = Nodal::Zero(4, model.node_count());
  u.topRows<3>() = gradient * model.X;
  return u;
}

// A balloon of radius r that is blown up by l has p 3 V l^2 = dE/dl, so p = 2 mu h/r (1/l - l^-7) with 3 V =
// A r; a body of any shape that grows evenly has the same dE/dl of its area.
TEST(Membrane, BlownUpEvenlyResistsAsABalloonToPastItsLargestPressure) {
  const Model& model = block_model();
  const Membrane film = film_on(model);
  const double area = area_of(film.patch), mu_h = film.thickness * film.shear_modulus;
  const auto term = membrane(film);
  double largest = 0.0, at = 0.0;
  for (double l = 1.0; l < 2.5; l += 0.01) {
    const Nodal u = linear(model, (l - 1.0) * Mat3::Identity());
    Nodal f = Nodal::Zero(4, model.node_count());
    term->add_force(u, {}, f);
    const double slope = f.topRows<3>().cwiseProduct(model.X).sum();
    const double pressure = slope / (area * l * l);  // times r
    EXPECT_NEAR(pressure, 2.0 * mu_h * (1.0 / l - std::pow(l, -7)), 1e-6 * mu_h) << l;
    if (pressure > largest) largest = pressure, at = l;
  }
  EXPECT_NEAR(largest, 1.2395 * mu_h, 1e-3 * mu_h);
  EXPECT_NEAR(at, 1.383, 0.01);
}

TEST(Membrane, StretchedOneWayKeepsItsVolumeAndPullsByItsLaw) {
  const Model& model = block_model();
  const Membrane film = film_on(model, 7.0);
  const auto term = membrane(film);
  const double l = 1.3, across = 0.9;
  const Nodal u = linear(model, Vec3(l - 1.0, across - 1.0, 0.0).asDiagonal());
  const double mu_h = film.thickness * film.shear_modulus;
  const auto law = [&](double a, double b) {
    return 0.5 * mu_h * (a * a + b * b + 1.0 / (a * a * b * b) - 3.0) + 3.5 * (a * a + b * b - 2.0);
  };
  // Two faces across each axis.
  const double exact =
      2.0 * (30e-3 * 30e-3 * law(l, across) + 30e-3 * 20e-3 * (law(l, 1.0) + law(across, 1.0)));
  EXPECT_NEAR(term->energy(u, {}), exact, 1e-9 * exact);
}

TEST(Membrane, HasTheForceThatIsTheDerivativeOfItsEnergyAndTurnsWithTheBody) {
  const Model& model = block_model();
  const auto term = membrane(film_on(model, 3.0));
  Nodal u = Nodal::Zero(4, model.node_count()), way = u, f = u;
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 X = model.X.col(a) * 100.0;
    u.col(a).head<3>() = 1e-3 * Vec3(X.x() * X.y(), std::sin(2.0 * X.y()), X.z() * X.x());
    way.col(a).head<3>() = Vec3(X.y() * X.z(), std::sin(2.0 * X.z()), X.x() - X.y());
  }
  term->add_force(u, {}, f);
  const double e = 1e-7;
  const double slope = (term->energy(u + e * way, {}) - term->energy(u - e * way, {})) / (2.0 * e);
  EXPECT_NEAR(f.cwiseProduct(way).sum(), slope, 1e-6 * std::abs(slope));
  EXPECT_LT(f.rowwise().sum().norm(), 1e-9 * f.norm()) << "it pushes the body nowhere";
  const Mat3 R = Eigen::AngleAxisd(0.7, Vec3(1.0, 2.0, -1.0).normalized()).toRotationMatrix();
  EXPECT_NEAR(term->energy(linear(model, R - Mat3::Identity()), {}), 0.0, 1e-12);
  Nodal turned = linear(model, R - Mat3::Identity()), force = Nodal::Zero(4, model.node_count());
  turned.topRows<3>() += R * u.topRows<3>();
  term->add_force(turned, {}, force);
  EXPECT_LT((force.topRows<3>() - R * f.topRows<3>()).norm(), 1e-9 * f.norm());
}

// Stretched it is four times as stiff as sheared, see add_stiffness_bound().
TEST(Membrane, IsAtRestNoStifferThanFourTimesWhatThePreconditionerTakesItFor) {
  const Model& model = block_model();
  const auto term = membrane(film_on(model, 3.0));
  StiffnessBound bound;
  bound.node = Eigen::VectorXd::Zero(model.node_count());
  term->add_stiffness_bound(bound);
  const Nodal rest = Nodal::Zero(4, model.node_count());
  for (const double waves : {0.0, 1.0, 5.0, 30.0, 200.0}) {
    Nodal way = rest, f0 = rest, f = rest;
    for (Index a = 0; a < model.node_count(); ++a) {
      const Vec3 X = model.X.col(a) * 100.0;
      way.col(a).head<3>() = waves == 0.0 ? Vec3(X.y(), X.z(), 2.0 * X.x())
                                          : Vec3(std::sin(waves * X.y()), std::cos(waves * X.x()),
                                                 std::sin(waves * X.x() * X.y()));
    }
    const double e = 1e-8;
    term->add_force(rest, {}, f0);
    term->add_force(e * way, {}, f);
    const double stiff = (f - f0).cwiseProduct(way).sum() / e;
    double most = 0.0;
    for (const auto& edge : bound.edge)
      most += edge.weight * (way.col(edge.a) - way.col(edge.b)).squaredNorm();
    EXPECT_LT(stiff, 4.0 * most) << waves;
    EXPECT_GT(stiff, 0.02 * most) << waves;
  }
}

// 0.1 mm of 400 kPa, some seventy times as stiff as the tissue between two nodes, is found to be in
// equilibrium by the iteration for pressures itself; a stiffer film makes the body more resistant.
TEST(Membrane, AsStiffAsAPiaComesToEquilibriumAndMakesTheBodyResistMore) {
  const Model& model = block_model();
  const ForceSystem tissue(model, neo_hookean(210.0, 0.499, 1000.0));
  double softer = 0.0;
  for (const double share : {0.0, 0.1, 1.0}) {
    ForceTerms terms;
    Membrane film = film_on(model);
    film.shear_modulus *= share;
    if (share > 0.0) terms.push_back(membrane(film));
    System body(tissue, model, make_constraints(model, Contact::bonded), std::move(terms));
    Nodal u = Nodal::Zero(4, model.node_count()), f = u;
    body.set({.depth = 1e-3}, u);
    Eigen::VectorXd lambda = Eigen::VectorXd::Zero(model.patches.count());
    const Relaxed found = MixedIteration(body)(u, lambda, f, {.tolerance = 1e-4}, true);
    EXPECT_TRUE(found.converged) << share;
    const double force = along_push(model, model.indenter, f);
    EXPECT_GT(force, 1.1 * softer) << share;
    softer = force;
  }
}

}  // namespace
}  // namespace dimple
