// Films on a body against closed forms.

#include "solver/terms/membrane.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "solver/equilibrium/relax.hpp"
#include "solver/terms/loads.hpp"
#include "tests/helpers/marched.hpp"
#include "tests/helpers/shapes.hpp"
#include "tests/verification/verify_bodies.hpp"

namespace dimple {
namespace {

// A block with the product's supports, and all of its surface.
const Model& block_model() {
  static const Model model = [] {
    ModelOptions options;
    options.node_set.count = 800;
    options.boundary.indenter_diameter_mm = 10.0;
    return build_model(block_surface(Vec3::Zero(), Vec3(30.0, 30.0, 20.0)), options).model;
  }();
  return model;
}
Membrane film_on(const Model& model, double tension = 0.0) {
  std::vector<Index> all(static_cast<std::size_t>(model.surface.triangles.cols()));
  std::iota(all.begin(), all.end(), Index{0});
  return {.patch = surface_patch(model, all),
          .thickness = 1e-4,
          .shear_modulus = 4e5,
          .wrinkles = false,
          .tension = tension};
}
Nodal linear(const Model& model, const Mat3& gradient) {
  Nodal u = Nodal::Zero(4, model.node_count());
  u.topRows<3>() = gradient * model.X;
  return u;
}

// A balloon of radius r inflated by l has p 3 V l^2 = dE/dl, so p = 2 mu h/r (1/l - l^-7) with 3 V = A r. A
// body of any shape that grows uniformly has the same dE/dl for its area.
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

TEST(Membrane, StretchedInOneDirectionKeepsItsVolumeAndPullsByItsLaw) {
  const Model& model = block_model();
  const Membrane film = film_on(model, 7.0);
  const auto term = membrane(film);
  const double l = 1.3, across = 0.9;
  const Nodal u = linear(model, Vec3(l - 1.0, across - 1.0, 0.0).asDiagonal());
  const double mu_h = film.thickness * film.shear_modulus;
  const auto law = [&](double a, double b) {
    return 0.5 * mu_h * (a * a + b * b + 1.0 / (a * a * b * b) - 3.0) + 3.5 * (a * a + b * b - 2.0);
  };
  // There are two faces across each axis.
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
    Nodal u = Nodal::Zero(4, model.node_count()), displacement = u, f = u;
    for (Index a = 0; a < model.node_count(); ++a) {
      const Vec3 X = model.X.col(a) * 100.0;
      u.col(a).head<3>() = 1e-3 * Vec3(X.x() * X.y(), std::sin(2.0 * X.y()), X.z() * X.x());
      displacement.col(a).head<3>() = Vec3(X.y() * X.z(), std::sin(2.0 * X.z()), X.x() - X.y());
    }
    term->add_force(u, {}, f);
    const double e = 1e-7;
    const double slope =
        (term->energy(u + e * displacement, {}) - term->energy(u - e * displacement, {})) / (2.0 * e);
    EXPECT_NEAR(f.cwiseProduct(displacement).sum(), slope, 1e-6 * std::abs(slope));
    EXPECT_LT(f.rowwise().sum().norm(), 1e-9 * f.norm()) << "it pushes the body nowhere";
    const Mat3 R = Eigen::AngleAxisd(0.7, Vec3(1.0, 2.0, -1.0).normalized()).toRotationMatrix();
    EXPECT_NEAR(term->energy(linear(model, R - Mat3::Identity()), {}), 0.0, 1e-12);
    Nodal turned = linear(model, R - Mat3::Identity()), force = Nodal::Zero(4, model.node_count());
    turned.topRows<3>() += R * u.topRows<3>();
    term->add_force(turned, {}, force);
    EXPECT_LT((force.topRows<3>() - R * f.topRows<3>()).norm(), 1e-9 * f.norm());
  }
}

// Invariants of a film that is stretched with the body, F, follow from F and the normal at rest alone: tr C =
// |F|^2 - |F n|^2, det C = (det F |F^-T n|)^2.
TEST(Membrane, OnACurvedBodyHasTheEnergyOfTheStretchInEachPlaceOfItsSurface) {
  ModelOptions options;
  options.node_set.count = 1200;
  options.boundary.indenter_diameter_mm = 10.0;
  const Model model = build_model(cut_ellipsoid_surface(Vec3(30.0, 24.0, 20.0), -8.0), options).model;
  const Membrane film = film_on(model, 3.0);
  const auto term = membrane(film);
  Mat3 F = Vec3(1.25, 0.9, 1.05).asDiagonal();
  F(0, 1) = 0.2;
  F(2, 0) = -0.15;
  const Mat3 to_normal = F.determinant() * F.inverse().transpose();
  double exact = 0.0;
  for (const auto& t : film.patch.triangles.colwise()) {
    const Vec3 a = film.patch.corner.col(t[0]);
    const Vec3 twice = (Vec3(film.patch.corner.col(t[1])) - a).cross(Vec3(film.patch.corner.col(t[2])) - a);
    const Vec3 n = twice.normalized();
    const double trace = F.squaredNorm() - (F * n).squaredNorm(), det = (to_normal * n).squaredNorm();
    exact += 0.5 * twice.norm() *
             (0.5 * film.thickness * film.shear_modulus * (trace + 1.0 / det - 3.0) +
              0.5 * film.tension * (trace - 2.0));
  }
  EXPECT_NEAR(term->energy(linear(model, F - Mat3::Identity()), {}), exact, 1e-6 * exact);
}

// A wrinkling film is a strip where it is short across, and slack where it is short in all directions.
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
  // The faces along x are narrower than a strip by its own contraction, 1.3^-1/2 = 0.877. Those along y and z
  // are short in both directions.
  const double strip = 0.5 * mu_h * (1.3 * 1.3 + 2.0 / 1.3 - 3.0);
  const double along_x = 2.0 * (30e-3 * 30e-3 + 30e-3 * 20e-3);
  EXPECT_NEAR(term->energy(at(Vec3(1.3, 0.7, 0.8)), {}), along_x * strip, 1e-9 * strip * along_x);
  // A taut film wrinkles where it is narrower than a strip, (mu h + T) l^2 w^4 = mu h; its energy has no jump
  // there.
  Membrane taut = film_on(model, 20.0);
  taut.wrinkles = true;
  const auto skin = membrane(taut);
  const double width = std::pow(mu_h / ((mu_h + 20.0) * 1.3 * 1.3), 0.25);
  const auto narrow = [&](double w) { return skin->energy(at(Vec3(1.3, w, 1.3)), {}); };
  EXPECT_NEAR(narrow(width - 1e-6), narrow(width + 1e-6), 1e-9 * narrow(width));
  EXPECT_EQ(narrow(width - 0.02), narrow(width - 0.2))
      << "faces across z are strips then, as are those across x";
  EXPECT_GT(narrow(width + 0.02), narrow(width));
  const auto full = membrane(film_on(model));
  EXPECT_NEAR(term->energy(at(Vec3(1.3, 1.1, 1.2)), {}), full->energy(at(Vec3(1.3, 1.1, 1.2)), {}),
              1e-12 * mu_h);
}

// In stretching it is four times as stiff as in shear, see add_stiffness_bound().
TEST(Membrane, IsAtRestNoStifferThanFourTimesWhatThePreconditionerTakesItFor) {
  const Model& model = block_model();
  const auto term = membrane(film_on(model, 3.0));
  StiffnessBound bound;
  bound.node = Eigen::VectorXd::Zero(model.node_count());
  term->add_stiffness_bound(bound);
  const Nodal state = Nodal::Zero(4, model.node_count());
  for (const double waves : {0.0, 1.0, 5.0, 30.0, 200.0}) {
    Nodal displacement = state, f0 = state, f = state;
    for (Index a = 0; a < model.node_count(); ++a) {
      const Vec3 X = model.X.col(a) * 100.0;
      displacement.col(a).head<3>() = waves == 0.0 ? Vec3(X.y(), X.z(), 2.0 * X.x())
                                                   : Vec3(std::sin(waves * X.y()), std::cos(waves * X.x()),
                                                          std::sin(waves * X.x() * X.y()));
    }
    const double e = 1e-8;
    term->add_force(state, {}, f0);
    term->add_force(e * displacement, {}, f);
    const double stiff = (f - f0).cwiseProduct(displacement).sum() / e;
    double most = 0.0;
    for (const auto& edge : bound.directed)
      most += edge.weight * (displacement.col(edge.a) - displacement.col(edge.b)).squaredNorm();
    EXPECT_LT(stiff, 4.0 * most) << waves;
    EXPECT_GT(stiff, 0.02 * most) << waves;
  }
}

// Force of a tool of 10 mm at `depth` on a block of tissue under a film, by the iteration for equilibria
// itself; negative if there is none.
double force_under(const Model& model, const Membrane* film, double depth,
                   Contact contact = Contact::bonded) {
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
    if (at == depth) return along_approach(model, model.bonded_patch, f);
    u *= std::min(at + step, depth) / at;
    lambda *= std::min(at + step, depth) / at;
  }
}

// The ratio film x modulus / (tissue x node spacing) is up to 1000. No film makes the body softer.
TEST(Membrane, UpToAThousandTimesAsStiffAsTheTissueComesToEquilibriumAndMakesTheBodyResistMore) {
  const Model& model = block_model();
  const double between_nodes = 210.0 * model.spacing.minCoeff();
  double softer = force_under(model, nullptr, 1e-3);
  for (const double times : {10.0, 100.0, 300.0, 1000.0}) {
    Membrane film = film_on(model);
    film.wrinkles = true;
    film.shear_modulus = times * between_nodes / film.thickness;
    const double force = force_under(model, &film, 1e-3);
    EXPECT_GT(force, softer) << times;
    softer = force;
  }
}

TEST(Membrane, IsNoMeasureOfWhatIsLeftUnbalancedAsALoadIs) {
  const Model& model = block_model();
  const ForceSystem tissue(model, neo_hookean(210.0, 0.499, 1000.0));
  ForceTerms terms;
  terms.push_back(membrane(film_on(model)));
  System body(tissue, model, make_constraints(model, Contact::bonded), std::move(terms));
  const Nodal u = linear(model, Mat3(Vec3(0.05, 0.05, -0.09).asDiagonal()));
  Nodal f = u, free = u;
  body.force(u, f);
  double held = 0.0;
  for (Index a = 0; a < model.node_count(); ++a)
    if (!body.held().is_free(a)) held += 0.5 * f.col(a).norm();
  EXPECT_NEAR(body.balance(f, free).reactions, held, 1e-9 * held);
}

TEST(Membrane, ThatBearsCompressionResistsALittleMoreThanOneThatWrinkles) {
  const Model& model = block_model();
  Membrane film = film_on(model);
  film.shear_modulus = 1e4;
  const double bears = force_under(model, &film, 1e-3);
  film.wrinkles = true;
  const double wrinkles = force_under(model, &film, 1e-3);
  EXPECT_GT(bears, wrinkles);
  EXPECT_LT(bears, 1.05 * wrinkles);
}

// On a large body of nu = 0.5 a small indentation moves the surface only normal to itself. This does not
// strain a bonded film without tension. A deep one stretches it.
TEST(Membrane, OnALargeIncompressibleBodyChangesADeepIndentationAndHardlyAShallowOne) {
  ModelOptions options;
  options.node_set.count = 1500;
  options.boundary.indenter_diameter_mm = 6.0;
  const Model model = build_model(block_surface(Vec3::Zero(), Vec3(80.0, 80.0, 40.0)), options).model;
  Membrane film{.patch = surface_patch(model, triangles_facing(model, Vec3::UnitZ())),
                .thickness = 1e-4,
                .shear_modulus = 2e4};
  EXPECT_NEAR(area_of(film.patch), 80e-3 * 80e-3, 1e-9);
  std::vector<double> gain;
  for (const double depth : {0.03e-3, 0.3e-3, 1e-3, 3e-3})
    gain.push_back(force_under(model, &film, depth) / force_under(model, nullptr, depth) - 1.0);
  EXPECT_GT(gain[0], 0.0);
  EXPECT_LT(gain[0], 0.01);
  for (std::size_t k = 1; k < gain.size(); ++k) EXPECT_GT(gain[k], 2.0 * gain[k - 1]) << k;
  EXPECT_GT(gain[3], 0.3);
}

// A taut film held at its outer edge, far away from the load.
class HeldAtItsEdge : public ForceTerm {
 public:
  HeldAtItsEdge(const Membrane& film, Index nodes)
      : film_(membrane(film)), undeformed_(Nodal::Zero(4, nodes)) {
    const Nodal state = undeformed_;
    film_->add_force(state, {}, undeformed_);
  }
  void add_force(const Nodal& u, const Instant& now, Nodal& f) override {
    film_->add_force(u, now, f);
    f -= undeformed_;
  }
  double energy(const Nodal&, const Instant&) override { return 0.0; }
  void add_stiffness_bound(StiffnessBound& bound) const override { film_->add_stiffness_bound(bound); }
  void add_node_stiffness(const Nodal& u, NodeStiffness& sum) const override {
    film_->add_node_stiffness(u, sum);
  }
  bool is_load() const override { return false; }

 private:
  std::unique_ptr<ForceTerm> film_;
  Nodal undeformed_;
};

// Forces [4xN] N of a pressure q [Pa] on the patch, downwards, within c of the middle.
Nodal pressed(const Model& model, const SurfacePatch& patch, const Vec3& middle, double c, double q) {
  Nodal force = Nodal::Zero(4, model.node_count());
  const auto& [rows, weight] = patch.at_middle;
  double area = 0.0;
  for (Index t = 0; t < patch.triangles.cols(); ++t) {
    const Vec3 a = patch.corner.col(patch.triangles(0, t)), b = patch.corner.col(patch.triangles(1, t)),
               d = patch.corner.col(patch.triangles(2, t));
    if (((a + b + d) / 3.0 - middle).norm() > c) continue;
    const double own = 0.5 * (b - a).cross(d - a).norm();
    area += own;
    for (int k = rows.offset[t]; k < rows.offset[t + 1]; ++k) force(2, rows.member[k]) -= weight[k] * q * own;
  }
  const double all = std::numbers::pi * c * c;
  EXPECT_NEAR(area, all, 0.05 * all);
  return force * (all / area);
}

// For a pressure q on a disc of radius c on a half-space of nu = 0.5 with surface tension T, the middle sinks
// by w = q c / (2 mu) int_0^inf e^-s (sqrt(1 + eta^2 s^2) - eta s) ds, eta = T / (2 mu c). This body is held
// from 14 c on, which reduces w by about the same for all eta. The reduction by the tension is therefore
// compared.
TEST(Membrane, TautOnAHalfSpaceBearsOfAPressureWhatItsClosedFormSays) {
  ModelOptions options;
  options.node_set.count = 3000;
  options.boundary.indenter_diameter_mm = 10.0;
  const double c = 5e-3, mu = 210.0, q = 0.02 * mu;
  const Model model = build_model(block_surface(Vec3::Zero(), Vec3(160.0, 160.0, 80.0)), options).model;
  const Vec3 middle = model.tool.centre;
  const SurfacePatch patch = surface_patch(model, triangles_facing(model, Vec3::UnitZ()));
  HeldSet held{.name = "far", .node = model.base};
  for (Index a = 0; a < model.node_count(); ++a)
    if ((model.X.col(a) - middle).norm() > 14.4 * c) held.node.push_back(a);
  const Index under = *std::min_element(
      model.bonded_patch.begin(), model.bonded_patch.end(),
      [&](Index a, Index b) { return (model.X.col(a) - middle).norm() < (model.X.col(b) - middle).norm(); });
  const ForceSystem tissue(model, neo_hookean(mu, 0.4999, 1000.0));
  const auto sinks = [&](double eta) {
    ForceTerms terms;
    terms.push_back(dead_load(pressed(model, patch, middle, c, q)));
    if (eta > 0.0)
      terms.push_back(std::make_unique<HeldAtItsEdge>(Membrane{.patch = patch, .tension = eta * 2.0 * mu * c},
                                                      model.node_count()));
    System body(tissue, model, Constraints(model.node_count(), {held}), std::move(terms));
    Nodal u = Nodal::Zero(4, model.node_count()), f = u;
    body.set({}, u);
    Eigen::VectorXd lambda = Eigen::VectorXd::Zero(model.patches.count());
    EXPECT_TRUE(MixedIteration(body)(u, lambda, f, {.tolerance = 1e-5}, true).converged) << eta;
    return -u(2, under) * 2.0 * mu / (q * c);
  };
  const double bare = sinks(0.0);
  EXPECT_NEAR(bare, 1.0, 0.1);
  const std::vector<std::pair<double, double>> sunk = {
      {0.1, 0.90973}, {0.5, 0.68406}, {1.0, 0.53886}, {2.0, 0.39334}};
  for (const auto& [eta, w] : sunk) {
    const double borne = (bare - sinks(eta)) / (1.0 - w);
    RecordProperty("borne_" + std::to_string(static_cast<int>(10 * eta)), std::to_string(borne));
    EXPECT_NEAR(borne, 1.0, 0.03) << eta;
  }
}

}  // namespace
}  // namespace dimple
