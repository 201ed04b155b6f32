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
  for (const bool wrinkles : {false, true}) {
  SCOPED_TRACE(wrinkles);
  Membrane film = film_on(model, 3.0);
  film.wrinkles = wrinkles;
  const auto term = membrane(film);
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
}

// Of a film that is stretched as the body is, F, its two invariants follow from F and the normal at rest alone:
// tr C = |F|^2 - |F n|^2, det C = (det F |F^-T n|)^2.
TEST(Membrane, OnACurvedBodyHasTheEnergyOfTheStretchInEachPlaceOfItsSurface) {
  ModelOptions options;
  options.cloud.count = 1200;
  options.boundary.indenter_diameter_mm = 10.0;
  const Model model =
      build_model(cut_ellipsoid_surface(Vec3(30.0, 24.0, 20.0), -8.0), options).model;
  const Membrane film = film_on(model, 3.0);
  const auto term = membrane(film);
  Mat3 F = Vec3(1.25, 0.9, 1.05).asDiagonal();
  F(0, 1) = 0.2;
  F(2, 0) = -0.15;
  const Mat3 to_normal = F.determinant() * F.inverse().transpose();
  double exact = 0.0;
  for (const auto& t : film.patch.triangles.colwise()) {
    const Vec3 a = film.patch.corner.col(t[0]);
    const Vec3 twice =
        (Vec3(film.patch.corner.col(t[1])) - a).cross(Vec3(film.patch.corner.col(t[2])) - a);
    const Vec3 n = twice.normalized();
    const double trace = F.squaredNorm() - (F * n).squaredNorm(), det = (to_normal * n).squaredNorm();
    exact += 0.5 * twice.norm() *
             (0.5 * film.thickness * film.shear_modulus * (trace + 1.0 / det - 3.0) +
              0.5 * film.tension * (trace - 2.0));
  }
  EXPECT_NEAR(term->energy(linear(model, F - Mat3::Identity()), {}), exact, 1e-6 * exact);
}

// A film that wrinkles: a strip where it is short across, nothing where it is short in all directions.
TEST(Membrane, ThatWrinklesBearsTensionAlone) {
  const Model& model = block_model();
  Membrane film = film_on(model);
  film.wrinkles = true;
  const auto term = membrane(film);
  const double mu_h = film.thickness * film.shear_modulus;
  const auto at = [&](const Vec3& stretch) {
    return linear(model, Mat3(stretch.asDiagonal()) - Mat3::Identity());
  };
  Nodal f = Nodal::Zero(4, model.node_count());
  term->add_force(at(Vec3(0.9, 0.8, 0.95)), {}, f);
  EXPECT_EQ(f.norm(), 0.0);
  EXPECT_EQ(term->energy(at(Vec3(0.9, 0.8, 0.95)), {}), 0.0);
  // Across by less than a strip contracts by itself, 1.3^-1/2 = 0.877, on all faces along x; not on those along
  // y and z, which are short in both directions.
  const double strip = 0.5 * mu_h * (1.3 * 1.3 + 2.0 / 1.3 - 3.0);
  const double along_x = 2.0 * (30e-3 * 30e-3 + 30e-3 * 20e-3);
  EXPECT_NEAR(term->energy(at(Vec3(1.3, 0.7, 0.8)), {}), along_x * strip, 1e-9 * strip * along_x);
  const auto full = membrane(film_on(model));
  EXPECT_NEAR(term->energy(at(Vec3(1.3, 1.1, 1.2)), {}), full->energy(at(Vec3(1.3, 1.1, 1.2)), {}),
              1e-12 * mu_h);
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
    for (const auto& edge : bound.directed)
      most += edge.weight * (way.col(edge.a) - way.col(edge.b)).squaredNorm();
    EXPECT_LT(stiff, 4.0 * most) << waves;
    EXPECT_GT(stiff, 0.02 * most) << waves;
  }
}

// What a tool of 10 mm feels at `depth` on a block of tissue under a film, from the iteration for equilibria
// itself; negative: none was found.
double force_under(const Model& model, const Membrane* film, double depth, Contact contact = Contact::bonded) {
  const ForceSystem tissue(model, neo_hookean(210.0, 0.499, 1000.0));
  ForceTerms terms;
  if (film) terms.push_back(membrane(*film));
  System body(tissue, model, make_constraints(model, contact), std::move(terms));
  Nodal u = Nodal::Zero(4, model.node_count()), f = u;
  Eigen::VectorXd lambda = Eigen::VectorXd::Zero(model.patches.count());
  MixedIteration iteration(body);
  Relaxed found;
  constexpr double step = 0.5e-3;
  for (double at = std::min(step, depth);; at = std::min(at + step, depth)) {
    body.set({.depth = at}, u);
    found = iteration(u, lambda, f, {.tolerance = 1e-4}, true);
    if (!found.converged) return -1.0;
    if (at == depth) return along_push(model, model.indenter, f);
    u *= std::min(at + step, depth) / at;
    lambda *= std::min(at + step, depth) / at;
  }
}

// Up to 1.2 MPa x 0.1 mm, ..., some five hundred times as stiff as the tissue between two nodes. A stiffer film
// makes the body more resistant, and none makes it softer.
TEST(Membrane, AsStiffAsAPiaComesToEquilibriumAndMakesTheBodyResistMore) {
  const Model& model = block_model();
  for (const bool wrinkles : {false, true}) {
    double softer = force_under(model, nullptr, 1e-3);
    for (const double stiffness : {4.0, 40.0, 210.0}) {
      Membrane film = film_on(model);
      film.wrinkles = wrinkles;
      film.shear_modulus = stiffness / film.thickness;
      const double force = force_under(model, &film, 1e-3);
      EXPECT_GT(force, softer) << stiffness << " " << wrinkles;
      std::printf("wrinkles %d, %g N/m: %g mN (softer: %g)\n", wrinkles, stiffness, 1e3 * force, 1e3 * softer);
      softer = force;
    }
  }
}

}  // namespace
}  // namespace dimple
