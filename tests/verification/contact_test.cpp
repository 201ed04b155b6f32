// A tool in frictionless contact, against closed forms of linear elasticity at small strain.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>

#include "io/error.hpp"
#include "solver/equilibrium/contact_step.hpp"
#include "solver/equilibrium/friction_step.hpp"
#include "tests/helpers/marched.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

constexpr double mu = 210.0, nu = 0.499, plane_modulus = 2.0 * mu / (1.0 - nu);  // E / (1 - nu^2) [Pa]

// ---------------------------------------------------------------------------------------------------------
// Layer of unit thickness, bonded to a rigid base or sliding on it, under an axisymmetric frictionless punch
// (Lebedev and Ufliand 1958). phi(t) = (delta - g(t)) / pi + int_0^a K(t, x) phi(x) dx, phi(a) = 0, F = 2 pi
// int phi, in units of E* h^2.
// ---------------------------------------------------------------------------------------------------------

struct Bed {
  double poisson;
  bool loose = false;
};

double softness(double s, const Bed& bed) {  // L(s): layer compared with the half-space
  const double k = 3.0 - 4.0 * bed.poisson, e = std::exp(-2.0 * s);
  const double sinh = 0.5 * (1.0 - e * e), cosh = 0.5 * (1.0 + e * e);  // of 2 s, times exp(-2 s)
  if (bed.loose) return (cosh - e) / (sinh + 2.0 * s * e);
  return (2.0 * k * sinh - 4.0 * s * e) / (2.0 * k * cosh + (1.0 + k * k + 4.0 * s * s) * e);
}

// Kernel int_0^inf (1 - L(s)) cos(s y) ds by Simpson's rule; 1 - L falls as exp(-2 s).
double kernel(double y, const Bed& bed) {
  constexpr int count = 800;
  constexpr double end = 20.0, h = end / count;
  double sum = 0.0;
  for (int i = 0; i <= count; ++i) {
    const double weight = i == 0 || i == count ? 1.0 : i % 2 == 1 ? 4.0 : 2.0, s = h * i;
    sum += weight * (i == 0 ? 1.0 : 1.0 - softness(s, bed)) * std::cos(s * y);
  }
  return sum * h / 3.0;
}

struct OnLayer {
  double depth, force;
  double a = 0.0;
  Eigen::VectorXd phi = {};  // at equal distances from 0 to a

  // Pressure of the contact at r in units of E*: phi is an Abel transform of it, p(r) = -int_r^a phi'(t) dt /
  // sqrt(t^2 - r^2), here over s = sqrt(t^2 - r^2).
  double pressure(double r) const {
    if (r >= a) return 0.0;
    const Index last = phi.size() - 1;
    const double h = a / static_cast<double>(last);
    const auto slope =
        [&](double t) {  // by differences at the midpoints of intervals; 0 at the centre of contact
          const double at = std::min(t / h + 0.5, static_cast<double>(last) - 1e-9);
          const auto i = static_cast<Index>(at);
          const double fraction = at - static_cast<double>(i);
          const auto piece = [&](Index k) { return k == 0 ? phi[0] - phi[1] : phi[k] - phi[k - 1]; };
          return ((1.0 - fraction) * piece(i) + fraction * piece(std::min(i + 1, last))) / h;
        };
    constexpr int count = 2000;
    const double end = std::sqrt(a * a - r * r), ds = end / count;
    double sum = 0.0;
    for (int k = 0; k < count; ++k) {
      const double t = std::hypot(r, (k + 0.5) * ds);
      sum -= slope(t) / t * ds;
    }
    return sum;
  }
};

// Depth and force for the contact radius `a` and the profile g alone, by Simpson's rule.
template <class Shape>
OnLayer on_layer(double a, const Bed& bed, const Shape& g) {
  constexpr int n = 81;
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Identity(n, n);
  Eigen::MatrixXd right(n, 2);  // for a unit depth, and for -g
  const double h = a / (n - 1);
  const auto weight = [&](int j) { return h / 3.0 * (j == 0 || j == n - 1 ? 1.0 : j % 2 == 1 ? 4.0 : 2.0); };
  std::vector<double> of(2 * n);
  for (int d = 0; d < 2 * n; ++d) of[static_cast<std::size_t>(d)] = kernel(h * d, bed);
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j)
      matrix(i, j) -= weight(j) / std::numbers::pi *
                      (of[static_cast<std::size_t>(i + j)] + of[static_cast<std::size_t>(std::abs(i - j))]);
    right.row(i) << 1.0 / std::numbers::pi, -g(h * i) / std::numbers::pi;
  }
  const Eigen::MatrixXd phi = matrix.partialPivLu().solve(right);
  OnLayer result{.depth = -phi(n - 1, 1) / phi(n - 1, 0), .force = 0.0, .a = a};
  result.phi = result.depth * phi.col(0) + phi.col(1);
  for (int j = 0; j < n; ++j)
    result.force += 2.0 * std::numbers::pi * weight(j) * (result.depth * phi(j, 0) + phi(j, 1));
  return result;
}

// Solution at a given depth, by bisection over the radius of contact.
template <class Shape>
OnLayer at_depth(double depth, double least, const Bed& bed, const Shape& g) {
  double low = least, high = 4.0;
  for (int k = 0; k < 40; ++k) {
    const double a = 0.5 * (low + high);
    (on_layer(a, bed, g).depth < depth ? low : high) = a;
  }
  return on_layer(0.5 * (low + high), bed, g);
}
template <class Shape>
double force_at(double depth, double least, const Bed& bed, const Shape& g) {
  return at_depth(depth, least, bed, g).force;
}

auto paraboloid(double radius) {
  return [radius](double t) { return t * t / radius; };
}
auto rounded_punch(double flat, double edge) {
  return [flat, edge](double t) {
    return t <= flat ? 0.0 : t / edge * (std::sqrt(t * t - flat * flat) - flat * std::acos(flat / t));
  };
}

double hertz(double radius, double depth) {
  return 4.0 / 3.0 * std::sqrt(radius) * std::pow(depth, 1.5);
}

TEST(ContactTruth, TheIntegralEquationGivesTheTabulatedForcesOfAParaboloidOnABondedAndOnALooseLayer) {
  struct Tabulated {
    Bed bed;
    double chi, ratio;  // of the force to that on a half-space
  };
  const Bed bonded{nu}, loose{0.5, true};
  for (const auto& [bed, chi, ratio] : {Tabulated{bonded, 0.1, 1.1288},
                                        {bonded, 0.3, 1.5167},
                                        {bonded, 0.5, 2.1513},
                                        {bonded, 1.0, 5.0806},
                                        {loose, 0.1, 1.0811},
                                        {loose, 0.3, 1.2896},
                                        {loose, 0.5, 1.5668},
                                        {loose, 0.75, 2.0018},
                                        {loose, 1.0, 2.5045}}) {
    const double radius = 50.0, depth = chi * chi / radius;
    EXPECT_NEAR(force_at(depth, 0.0, bed, paraboloid(radius)) / hertz(radius, depth), ratio, 2e-3 * ratio)
        << chi << (bed.loose ? " loose" : " bonded");
  }
}

TEST(ContactTruth, TheIntegralEquationGivesTheTabulatedForcesOfARoundedPunchOnABondedLayer) {
  for (const auto& [depth, force] : {std::pair{0.01059, 0.01494}, {0.05657, 0.08748}})
    EXPECT_NEAR(force_at(depth, 0.4, {0.5}, rounded_punch(0.4, 0.1)), force, 3e-3 * force);
}

TEST(ContactTruth, TheRadiusOfContactOfARingIsTheRings) {
  auto mesh = std::make_shared<ToolMesh>();
  const double none = std::numeric_limits<double>::infinity();
  mesh->lower = {none, none, 1e-3, 0.0, 1e-3, none};  // every millimetre, a ring of 3 mm radius
  mesh->width = 10e-3;
  const ToolShape ring = drawn_shape(mesh);
  EXPECT_NEAR(contact_radius(ring, 1e-3), 3.5e-3, 1e-9);
  EXPECT_NEAR(contact_radius(ring, 3e-3), 4e-3, 1e-9);
}

TEST(ContactTruth, TheRadiusOfContactIsThatOfSneddon) {
  // Reference: F / F_Hertz of the true sphere, by its series.
  const ToolShape sphere = sphere_shape(1.0);
  for (const double depth : {0.01, 0.1, 0.3}) {
    const double a = contact_radius(sphere, depth);
    const double force = 0.5 * (a * a + 1.0) * std::log((1.0 + a) / (1.0 - a)) - a;
    const double series = 1.0 - depth / 10.0 - depth * depth / 840.0 + 11.0 * std::pow(depth, 3) / 15120.0;
    EXPECT_NEAR(force / hertz(1.0, depth), series, 1e-3);
    EXPECT_NEAR(half_space_force(sphere, depth).value() / hertz(1.0, depth), series, 1e-3);
  }
  const ToolShape punch = punch_shape(5.0, 1.0);
  EXPECT_NEAR(contact_radius(punch, 0.71111), 4.5, 1e-4);
}

TEST(ContactTruth, TheForceOnAHalfSpaceGrowsByTheDiameterOfItsContactForEachLengthOfDepth) {
  const ToolShape punch = punch_shape(5.0, 1.0);
  EXPECT_NEAR(half_space_force(punch, 0.71111).value(), 6.12052, 1e-3);
  // dF / d depth = 2 a E* for any body of revolution (Sneddon 1965); the punch's contact ends at its side.
  for (const ToolShape& shape :
       {punch, sphere_shape(5.0), capsule_shape(5.0, 20.0), cone_shape(1.2, 0.5, 5.0)})
    for (const double depth : {0.01, 0.3, 1.0, 4.0, 9.0}) {
      constexpr double h = 1e-4;
      const double slope =
          (*half_space_force(shape, depth + h) - *half_space_force(shape, depth - h)) / (2.0 * h);
      EXPECT_NEAR(slope, 2.0 * contact_radius(shape, depth), 1e-5 * slope) << depth;
    }
  EXPECT_NEAR(contact_radius(punch, 9.0), 5.0, 1e-9);
  EXPECT_EQ(half_space_force(punch, -0.1), 0.0);
  const ToolShape drawn = drawn_shape(std::make_shared<const ToolMesh>());
  EXPECT_FALSE(half_space_force(drawn, 1.0)) << "a drawn tool has no closed form";
}

TEST(ToolShape, TheNormalIsTheGradientOfTheDistanceAndOfUnitLength) {
  const ToolPose pose{.tip = {1e-3, -2e-3, 3e-3}, .points_at = Vec3(0.2, -0.3, -0.9).normalized()};
  for (const ToolShape& shape : {sphere_shape(5e-3), punch_shape(5e-3, 1e-3), capsule_shape(2e-3, 20e-3)})
    for (int k = 0; k < 200; ++k) {
      const Vec3 x = pose.tip + 8e-3 * Vec3(std::sin(1.7 * k), std::cos(2.3 * k), std::sin(3.1 * k + 1.0));
      const ToolDistance here = distance_to_tool(shape, pose, x);
      EXPECT_NEAR(here.normal.norm(), 1.0, 1e-9);
      if (here.distance < 0.0) continue;
      // Outside it is smooth: the nearest point of the surface is opposite to the normal.
      EXPECT_NEAR(distance_to_tool(shape, pose, x - here.distance * here.normal).distance, 0.0, 1e-9);
      constexpr double h = 1e-7;
      for (int i = 0; i < 3; ++i)
        EXPECT_NEAR((distance_to_tool(shape, pose, x + h * Vec3::Unit(i)).distance -
                     distance_to_tool(shape, pose, x - h * Vec3::Unit(i)).distance) /
                        (2.0 * h),
                    here.normal[i], 1e-4);
    }
}

TEST(ToolShape, TheTipIsInContactAndTheLowerSurfaceIsAtItsHeight) {
  const ToolPose pose{};
  for (const ToolShape& shape : {sphere_shape(5e-3), punch_shape(5e-3, 1e-3), capsule_shape(2e-3, 20e-3)}) {
    EXPECT_NEAR(distance_to_tool(shape, pose, Vec3::Zero()).distance, 0.0, 1e-15);
    for (double r = 0.0; r < shape.radius; r += 0.1e-3)
      EXPECT_NEAR(distance_to_tool(shape, pose, {0.0, r, height_of_tool(shape, r)}).distance, 0.0, 1e-12);
    EXPECT_TRUE(std::isinf(height_of_tool(shape, 1.01 * shape.radius)));
    EXPECT_NEAR(distance_to_tool(shape, pose, {shape.radius + 1e-3, 0.0, shape.radius}).distance, 1e-3,
                1e-12);
  }
}

// Compliance of samples along a line; it decreases with their distance.
Eigen::MatrixXd compliance_of(Index count) {
  Eigen::MatrixXd compliance(count, count);
  for (Index s = 0; s < count; ++s)
    for (Index t = 0; t < count; ++t) compliance(s, t) = 1.0 / (0.5 + std::abs(static_cast<double>(s - t)));
  compliance.diagonal().array() += 2.0;
  return compliance;
}

TEST(ContactStep, NeitherPullsNorLetsASampleInAndAForceIsOnlyWhereAGapIsClosed) {
  constexpr Index count = 40;
  const Eigen::MatrixXd compliance = compliance_of(count);
  Points normal(3, count);
  Eigen::VectorXd gap(count), before(count);
  for (Index s = 0; s < count; ++s) {
    const double x = static_cast<double>(s);
    normal.col(s) = Vec3(0.3 * std::sin(x), 0.2 * std::cos(x), -1.0).normalized();
    gap[s] = 0.002 * (x - 20.0) * (x - 20.0) - 0.3 + 0.05 * std::sin(5.0 * x);
    before[s] = std::max(0.0, 0.1 * std::sin(2.0 * x));
  }
  const Eigen::VectorXd change = contact_step(compliance, normal, gap, before);
  int in_contact = 0;
  for (Index s = 0; s < count; ++s) {
    double after = gap[s];
    for (Index t = 0; t < count; ++t)
      after += compliance(s, t) * normal.col(s).dot(normal.col(t)) * change[t];
    const double force = before[s] + change[s];
    EXPECT_GE(force, -1e-12);
    EXPECT_GE(after, -1e-9);
    EXPECT_NEAR(force * after, 0.0, 1e-9);
    in_contact += force > 0.0;
  }
  EXPECT_GT(in_contact, 5);
  EXPECT_LT(in_contact, count - 5);
}

// The samples are strongly coupled, so that sets of samples in contact repeat.
TEST(ContactStep, IsFoundHoweverTheSamplesMoveEachOther) {
  std::mt19937 random(1);
  std::normal_distribution<double> any;
  const auto some = [&] { return any(random); };
  constexpr Index count = 8;
  const Points normal = Vec3::UnitZ().replicate(1, count);
  for (int draw = 0; draw < 3000; ++draw) {
    const Eigen::MatrixXd part = Eigen::MatrixXd::NullaryExpr(count, count, some);
    Eigen::MatrixXd K = part * part.transpose();
    K.diagonal().array() += 0.01;
    const Eigen::VectorXd gap = Eigen::VectorXd::NullaryExpr(count, some);
    const Eigen::VectorXd force = contact_step(K, normal, gap, Eigen::VectorXd::Zero(count));
    const Eigen::VectorXd after = gap + K * force;
    ASSERT_GE(force.minCoeff(), 0.0) << draw;
    ASSERT_GE(after.minCoeff(), -1e-5) << draw;
    ASSERT_LT(force.cwiseProduct(after).cwiseAbs().maxCoeff(), 1e-4 * std::max(1.0, force.maxCoeff()))
        << draw;
  }
}

TEST(FrictionStep, HoldsWhatItCanAndElsewhereOpposesTheSlipAsMuchAsItMay) {
  constexpr Index count = 40;
  const Eigen::MatrixXd compliance = compliance_of(count);
  Points normal(3, count), slip(3, count), before(3, count);
  Eigen::VectorXd bound(count);
  for (Index s = 0; s < count; ++s) {
    const double x = static_cast<double>(s);
    const Vec3 n = normal.col(s) = Vec3(0.3 * std::sin(x), 0.2 * std::cos(x), -1.0).normalized();
    const Vec3 displacement(0.2 + 0.1 * std::sin(x), 0.3 * std::cos(0.4 * x), 0.1),
        force(std::sin(3.0 * x), 0.5, -0.3);
    slip.col(s) = displacement - n * n.dot(displacement);
    before.col(s) = 0.05 * (force - n * n.dot(force));
    bound[s] = s % 7 == 0 ? 0.0 : 0.003 * x;
  }
  const Points force = before + friction_step(compliance, normal, slip, before, bound);
  int held = 0, slid = 0;
  for (Index s = 0; s < count; ++s) {
    const Vec3 n = normal.col(s), t = force.col(s);
    EXPECT_LE(t.norm(), bound[s] * (1.0 + 1e-12));
    EXPECT_NEAR(n.dot(t), 0.0, 1e-12);
    Vec3 after = slip.col(s);
    for (Index k = 0; k < count; ++k) after += compliance(s, k) * (force.col(k) - before.col(k));
    after -= n * n.dot(after);
    if (bound[s] == 0.0) continue;
    if (t.norm() < (1.0 - 1e-9) * bound[s]) {
      EXPECT_LT(after.norm(), 1e-3);
      ++held;
    } else {
      EXPECT_NEAR(t.dot(after), -t.norm() * after.norm(), 1e-3 * t.norm());
      ++slid;
    }
  }
  EXPECT_GT(held, 5);
  EXPECT_GT(slid, 5);
}

// ---------------------------------------------------------------------------------------------------------
// The program's solutions
// ---------------------------------------------------------------------------------------------------------

struct ContactSummary {
  History history;
  std::shared_ptr<const RigidBody> indenter;
  Index nodes = 0;
  Eigen::VectorXd pressure = {};  // of the samples, at the end [Pa]
  Points on_body = {};            // their forces [N]
  double force() const { return history.force.back().force; }
};

// A tool at first contact with that part of the model's surface.
std::shared_ptr<RigidBody> tool_contact(const ToolShape& shape, const Model& model, ContactSurface surface,
                                        double friction = 0.0) {
  auto indenter = std::make_shared<RigidBody>();
  indenter->shape = shape;
  indenter->surface = std::move(surface);
  indenter->pose = first_contact(shape, model.tool, indenter->surface);
  indenter->friction = friction;
  return indenter;
}

ForceSystem tissue_of(const Model& model, double ratio = 0.49) {
  return {model, {{neo_hookean(mu, ratio, 1000.0)}, model.tissue}, Precision::double_};
}

// Makes the base slide on its bed; one node in its middle is fixed.
void let_slide(Model& model, Loading& loading) {
  const Index middle = *std::min_element(model.base.begin(), model.base.end(), [&](Index a, Index b) {
    return model.X.col(a).head<2>().norm() < model.X.col(b).head<2>().norm();
  });
  loading.further = {
      {.name = "slides", .node = model.base, .hold = HeldSet::Hold::along, .direction = Vec3::UnitZ()},
      {.name = "middle", .node = {middle}}};
  model.base.clear();
}

ContactSummary contact_summary(const BodySurface& body, const ToolShape& shape, double depth_mm, Index nodes,
                               int frames = 1, bool loose = false) {
  ModelOptions options;
  options.node_set.count = nodes;
  options.node_set.grading.whole_patch = !(shape.edge > 0.0);
  options.boundary = {.base = "inferior",
                      .indent_at = "0,0,top",
                      .indenter_diameter_mm = 2e3 * shape.radius,
                      .contact_radius_mm = 1e3 * contact_radius(shape, 1e-3 * depth_mm)};
  // Room around the tool is not checked: a shallow sphere may be wider than the block.
  options.boundary.indenter_diameter_mm = std::min(options.boundary.indenter_diameter_mm, 10.0);
  BuiltModel built = build_model(body, options);
  const auto indenter = tool_contact(
      shape, built.model,
      contact_surface(built.model, std::min(1.5 * shape.radius, 3e-3 * options.boundary.contact_radius_mm)));
  ContactSummary result{.history = {}, .indenter = indenter, .nodes = built.model.node_count()};
  Loading loading{.depth = 1e-3 * depth_mm};
  loading.indenter = indenter;
  if (loose) let_slide(built.model, loading);
  const Tissues tissues{{neo_hookean(mu, nu, 1000.0)}, built.model.tissue};
  const ForceSystem system(built.model, tissues, Precision::single_);
  Observer observer;
  observer.frame = [&](const Frame& frame) {
    result.pressure = frame.tool->pressures();
    result.on_body = frame.tool->forces_on_body();
  };
  result.history = marched(system, built.model, loading, {.frames = frames}, observer);
  return result;
}

double of_layer(double radius_mm, double depth_mm, double thickness_mm, bool loose = false) {
  return plane_modulus * 1e-6 * thickness_mm * thickness_mm *
         force_at(depth_mm / thickness_mm, 0.0, {nu, loose}, paraboloid(radius_mm / thickness_mm));
}

void is_true(const ContactSummary& found, double truth, double fraction) {
  const double ratio = found.force() / truth;
  std::printf(
      "%td nodes: %.4f mN, %+.2f %% of the truth; penetration %.2e radii, %td samples touch, %td "
      "evaluations in %zu equilibria, %zu retries\n",
      found.nodes, 1e3 * found.force(), 100.0 * (ratio - 1.0),
      found.history.penetration / found.indenter->shape.radius, found.history.contact_samples,
      found.history.evaluations, found.history.force.size() - 1, found.history.retries.size());
  EXPECT_NEAR(ratio, 1.0, fraction);
  // A penetration of the surface between the samples is reported.
  bool reported = false;
  for (const Finding& finding : found.history.guards)
    reported = reported || finding.report.code == "penetration";
  EXPECT_EQ(reported, found.history.penetration > 1e-3 * found.indenter->shape.radius);
}

// For a half-space and a sphere the solution phi is known, and so is the pressure: Hertz.
TEST(ContactTruth, ThePressureOnAThickLayerIsThatOfHertz) {
  const double radius = 0.5, a = 0.002;
  const OnLayer thick = on_layer(a, {nu}, paraboloid(radius));
  for (const double r : {0.0, 0.5, 0.9}) {
    const double hertz = 2.0 * a / (std::numbers::pi * radius) * std::sqrt(1.0 - r * r);
    EXPECT_NEAR(thick.pressure(r * a), hertz, 0.003 * hertz) << r;
  }
  // The integral of the pressure is the force, on a thin layer too.
  const OnLayer thin = on_layer(0.8, {nu}, paraboloid(8.0));
  double sum = 0.0;
  for (int k = 0; k < 400; ++k) {
    const double r = 0.8 * (k + 0.5) / 400;
    sum += 2.0 * std::numbers::pi * r * thin.pressure(r) * 0.8 / 400;
  }
  EXPECT_NEAR(sum, thin.force, 0.003 * thin.force);
}

// Error of the pressure within `fraction` of the contact radius, relative to the true pressure in the middle.
struct PressureError {
  double mean_square = 0.0, largest = 0.0;
  int count = 0;
};
PressureError pressure_error(const ContactSummary& found, const OnLayer& truth, double thickness_mm,
                             double fraction) {
  PressureError error;
  const ContactSurface& surface = found.indenter->surface;
  const double middle = plane_modulus * truth.pressure(0.0);
  for (Index s = 0; s < surface.count(); ++s) {
    const Vec3 from = surface.place.col(s) - found.indenter->pose.tip;
    const double r = from.head<2>().norm() * 1e3 / thickness_mm;
    if (r > fraction * truth.a) continue;
    const double off = found.pressure[s] / middle - plane_modulus * truth.pressure(r) / middle;
    error.mean_square += off * off;
    error.largest = std::max(error.largest, std::abs(off));
    ++error.count;
  }
  error.mean_square = std::sqrt(error.mean_square / error.count);
  std::printf(
      "%td nodes: pressure in %d places off by %.1f %% in the mean square, %.1f %% at most; largest %.3f of "
      "the "
      "truth in the middle\n",
      found.nodes, error.count, 100.0 * error.mean_square, 100.0 * error.largest,
      found.pressure.maxCoeff() / middle);
  return error;
}

// A sample with too little area would have an arbitrary force. Isolated samples, and those of another
// orientation, are not merged.
TEST(SamplesOfContact, HaveEnoughSurfaceOfTheirOwnAndBetweenThemAllOfIt) {
  for (const Index nodes : {1000, 4000}) {
    const Model model = model_with_tool(cylinder_surface(30, 30),
                                        {.nodes = nodes, .contact_radius = 4.0, .whole_patch = false});
    const ContactSurface surface = contact_surface(model, 8e-3);
    double area = 0.0;
    Index small = 0;
    for (Index s = 0; s < surface.count(); ++s) {
      area += surface.area[s];
      small += surface.area[s] < 0.5 * std::pow(surface.spacing[s], 2);
    }
    EXPECT_LE(small, surface.count() / 100) << "of " << surface.count() << " with " << nodes << " nodes";
    // Pieces of triangles within the reach form the disc of the flat end, up to their size.
    EXPECT_NEAR(area, std::numbers::pi * 64e-6, 0.02 * std::numbers::pi * 64e-6);
  }
}

class PressureUnderATool : public testing::TestWithParam<Index> {};
INSTANTIATE_TEST_SUITE_P(Contacting, PressureUnderATool, testing::Values(1000, 4000, 8000));

TEST_P(PressureUnderATool, OfASphereIsThatOfTheIntegralEquation) {
  const ToolShape sphere = sphere_shape(40e-3);
  for (const auto& [thickness, depth] : {std::pair{10.0, 0.225}, {5.0, 0.15}}) {
    SCOPED_TRACE(testing::Message() << thickness << " mm thick");
    const ContactSummary found =
        contact_summary(block_surface({-30, -30, 0}, {30, 30, thickness}), sphere, depth, GetParam());
    const OnLayer truth = at_depth(depth / thickness, 0.0, {nu}, paraboloid(40.0 / thickness));
    const PressureError error = pressure_error(found, truth, thickness, 0.9);
    EXPECT_GT(error.count, 50);
    EXPECT_LT(error.mean_square, 0.05);
    EXPECT_LT(error.largest, 0.25)
        << "at single places; without means around them it is up to twenty times as much";
    EXPECT_NEAR(found.history.contact_pressure, plane_modulus * truth.pressure(0.0),
                0.25 * plane_modulus * truth.pressure(0.0));
    // Forces never pull, there is no pressure far from the contact, and all pressures sum to the tool's
    // force.
    EXPECT_GE(found.pressure.minCoeff(), 0.0);
    EXPECT_EQ(found.pressure.maxCoeff(), found.history.contact_pressure);
    for (Index s = 0; s < found.pressure.size(); ++s) {
      const double r =
          1e3 * (found.indenter->surface.place.col(s) - found.indenter->pose.tip).head<2>().norm();
      if (r > 1.1 * truth.a * thickness + 3e3 * found.indenter->surface.spacing[s])
        EXPECT_EQ(found.pressure[s], 0.0);
    }
    EXPECT_NEAR(-found.on_body.row(2).sum(), found.force(), 1e-9 * found.force());
  }
}

// The program's default number of nodes is tested, and more.
TEST_P(PressureUnderATool, OfAPunchIsThatOfTheIntegralEquation) {
  if (GetParam() < 4000) GTEST_SKIP() << "skipped: a punch takes 4000 nodes";
  const ToolShape punch = punch_shape(5e-3, 1e-3);
  const ContactSummary found =
      contact_summary(block_surface({-30, -30, 0}, {30, 30, 10}), punch, 0.1059, GetParam());
  const OnLayer truth = at_depth(0.01059, 0.4, {nu}, rounded_punch(0.4, 0.1));
  const PressureError error = pressure_error(found, truth, 10.0, 0.5);
  EXPECT_GT(error.count, 5);
  EXPECT_LT(error.mean_square, 0.05);
  EXPECT_LT(error.largest, 0.2);
}

// Parameters: the number of nodes, and the largest relative error of the force.
class OnALayer : public testing::TestWithParam<std::pair<Index, double>> {};
INSTANTIATE_TEST_SUITE_P(Contacting, OnALayer,
                         testing::Values(std::pair<Index, double>{1000, 0.03},
                                         std::pair<Index, double>{4000, 0.015}));

TEST_P(OnALayer, ASphereHasTheForceOfTheIntegralEquation) {
  const auto [nodes, fraction] = GetParam();
  for (const auto& [thickness, depth] : {std::pair{10.0, 0.225}, {5.0, 0.15}}) {
    SCOPED_TRACE(testing::Message() << thickness << " mm thick");
    const BodySurface layer = block_surface({-30, -30, 0}, {30, 30, thickness});
    is_true(contact_summary(layer, sphere_shape(40e-3), depth, nodes), of_layer(40.0, depth, thickness),
            fraction);
  }
}

TEST_P(OnALayer, APunchHasTheForceOfTheIntegralEquation) {
  const auto [nodes, fraction] = GetParam();
  const BodySurface layer = block_surface({-30, -30, 0}, {30, 30, 10});
  const double truth = plane_modulus * 1e-4 * force_at(0.01059, 0.4, {nu}, rounded_punch(0.4, 0.1));
  is_true(contact_summary(layer, punch_shape(5e-3, 1e-3), 0.1059, nodes), truth, fraction);
}

// The profile of a sharp cone is pi/2 cot(angle) t. The rounded tip is above it by a thousandth of the depth.
TEST_P(OnALayer, AConeHasTheForceOfTheIntegralEquation) {
  const auto [nodes, fraction] = GetParam();
  constexpr double angle = 85.0 * std::numbers::pi / 180.0, thickness = 10.0, depth = 0.3;
  const auto sharp = [](double t) { return 0.5 * std::numbers::pi / std::tan(angle) * t; };
  const double truth =
      plane_modulus * 1e-6 * thickness * thickness * force_at(depth / thickness, 0.0, {nu}, sharp);
  is_true(contact_summary(block_surface({-30, -30, 0}, {30, 30, thickness}), cone_shape(angle, 0.1e-3, 10e-3),
                          depth, nodes),
          truth, fraction);
}

// The loop is over chi = sqrt(radius x depth) / thickness.
TEST_P(OnALayer, ThatIsLooseASphereHasTheForceOfTheIntegralEquation) {
  const Index nodes = GetParam().first;
  constexpr double thickness = 5.0, half = 16.0 * thickness;  // six heights wide it is 1 % softer
  const BodySurface layer = block_surface({-half, -half, 0}, {half, half, thickness});
  for (const double chi : {0.2, 0.3, 0.5, 0.75, 1.0}) {
    SCOPED_TRACE(chi);
    const double depth = std::pow(chi * thickness, 2) / 40.0;
    std::printf("chi %.2f, ", chi);
    is_true(contact_summary(layer, sphere_shape(40e-3), depth, nodes, 1, true),
            of_layer(40.0, depth, thickness, true), nodes < 4000 ? 0.03 : 0.02);
  }
}

TEST(RigidContact, NeverPullsAndItsForceGrowsFromNothingWithTheDepth) {
  const ToolShape sphere = sphere_shape(5e-3);
  const ContactSummary found =
      contact_summary(block_surface({-20, -20, 0}, {20, 20, 20}), sphere, 1.5, 1000, 6);
  double before = 0.0;
  ASSERT_GT(found.history.force.size(), 4u);
  for (const ForceSample& sample : found.history.force) {
    EXPECT_GE(sample.force, before);
    EXPECT_NEAR(sample.on_tool[2], sample.force, 1e-9);  // the press direction is downwards
    EXPECT_NEAR(sample.base_force, sample.force, 2e-2 * found.force());
    before = sample.force;
  }
  EXPECT_EQ(found.history.force.front().force, 0.0);
  EXPECT_GT(found.force(), 0.0);
}

// The tool is near an edge, so that it is drawn sideways and rotated.
class ToolNextToAnEdge : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Contacting, ToolNextToAnEdge, testing::Values(0.0, 0.2, 1e9));

TEST_P(ToolNextToAnEdge, HasTheForceAndTheMomentOfTheBase) {
  const ToolShape sphere = sphere_shape(5e-3);
  const Model model = model_with_tool(block_surface({-15, -15, 0}, {15, 15, 20}),
                                      {.nodes = 1000, .contact_radius = 3.0, .at = "8,3,top"});
  const auto indenter = tool_contact(sphere, model, contact_surface(model, 1.5 * sphere.radius), GetParam());
  const ForceSystem system = tissue_of(model);
  Loading loading{.depth = 2e-3};
  loading.indenter = indenter;
  Vec3 force = Vec3::Zero(), moment = force;
  const Vec3 tip = indenter->pose.tip + loading.depth * indenter->pose.points_at;
  Observer observer;
  observer.frame = [&](const Frame& frame) {
    force.setZero(), moment.setZero();
    for (const Index a : model.base) {
      const Vec3 held = frame.f.col(a).head<3>(), x = model.X.col(a) + frame.u.col(a).head<3>();
      force += held;
      moment += (x - tip).cross(held);
    }
  };
  const History history = marched(system, model, loading, {.frames = 1, .tolerance = 1e-5}, observer);
  const Eigen::Map<const Wrench> on_tool(history.force.back().on_tool.data());
  EXPECT_GT(force.z(), 0.0) << "it pushes the tool back";
  EXPECT_GT(force.head<2>().norm(), 0.02 * force.norm()) << "and sideways";
  EXPECT_LT((on_tool.head<3>() - force).norm(), 1e-4 * force.norm());
  EXPECT_GT(on_tool.tail<3>().norm(), 0.02 * force.norm() * sphere.radius) << "and turns it about its tip";
  EXPECT_LT((on_tool.tail<3>() - moment).norm(), 2e-3 * force.norm() * sphere.radius);
  EXPECT_NEAR(history.force.back().force, force.z(), 1e-4 * force.norm());
}

// Makes one node much stiffer than its neighbourhood, like a node whose shape function has few neighbours.
void stiffen_one_node(Model& model, Index node, double fraction) {
  GradientVariance& v = model.variance.front();
  const auto entry = [&](Index a, Index b) -> double& {
    int k = v.rows.offset[a];
    while (v.rows.member[k] != b) ++k;
    return v.K[k];
  };
  const double more = fraction * entry(node, node) / static_cast<double>(v.rows.count(node));
  for (int k = v.rows.offset[node]; k < v.rows.offset[node + 1]; ++k) {
    const Index b = v.rows.member[k];
    if (b == node) continue;
    entry(node, node) += more;
    entry(b, b) += more;
    entry(node, b) -= more;
    entry(b, node) -= more;
  }
}

TEST(RigidContact, FindsItsFirstContactWithANodeThatIsManyTimesAsStiffAsItsNeighbours) {
  const ToolShape sphere = sphere_shape(5e-3);
  Model model =
      model_with_tool(block_surface({-15, -15, 0}, {15, 15, 20}), {.nodes = 600, .contact_radius = 1.5});
  Index at_tip = 0;
  (model.X.colwise() - model.tool.centre).colwise().squaredNorm().minCoeff(&at_tip);
  stiffen_one_node(model, at_tip, 1000.0);
  const auto indenter = tool_contact(sphere, model, contact_surface(model, 1.5 * sphere.radius));
  const History history = marched(tissue_of(model, nu), model, {.depth = 0.5e-3, .indenter = indenter});
  EXPECT_TRUE(history.retries.empty());
  EXPECT_LT(history.evaluations, 100) << "58 were seen; 143 where the node was as soft as its surroundings";
  EXPECT_GT(history.force.back().force, 0.0);
}

// Forces on a tool on a block at the end of each step, along one axis.
std::vector<Vec3> forces_after(const std::vector<Vec3>& directions, double friction, const Vec3& place,
                               Index nodes, History* whole = nullptr, double step_radii = 0.1,
                               Eigen::VectorXd* slid = nullptr) {
  Vec3 come = Vec3::Zero();
  std::vector<Vec3> along, along_mm;
  for (const Vec3& displacement : directions)
    along.push_back(come += displacement), along_mm.push_back(1e3 * come);
  const std::string begins = std::to_string(place.x()) + "," + std::to_string(place.y()) + ",top";
  const Model model =
      model_with_tool(block_surface({-20, -20, 0}, {20, 20, 20}),
                      {.nodes = nodes, .contact_radius = 2.7, .at = begins, .displacement = along_mm});
  const auto indenter =
      tool_contact(sphere_shape(5e-3), model, contact_surface(model, 7e-3, along), friction);
  Loading loading;
  loading.indenter = indenter;
  for (const Vec3& displacement : directions)
    loading.steps.push_back({.name = "", .moves = "", .displacement = displacement});
  Observer observer;
  observer.frame = [&](const Frame& frame) {
    if (slid) *slid = frame.tool->slid_along();
  };
  const History history =
      marched(tissue_of(model), model, loading, {.frames = 1, .step_radii = step_radii}, observer);
  std::vector<Vec3> result;
  double until = 0.0;
  for (const Vec3& displacement : directions) {
    until += displacement.norm() / loading.rate;
    const auto at = std::find_if(history.force.begin(), history.force.end(),
                                 [&](const ForceSample& s) { return s.t > until * (1.0 - 1e-9); });
    EXPECT_NE(at, history.force.end());
    if (at != history.force.end()) result.emplace_back(at->on_tool[0], at->on_tool[1], at->on_tool[2]);
  }
  if (whole) *whole = history;
  return result;
}

TEST(ToolInSteps, WithoutFrictionDependsOnWhereItIsAndNotHowItCame) {
  const Vec3 down(0, 0, -1.5e-3), aside(5e-3, 0, 0);
  const Vec3 slid = forces_after({down, aside}, 0.0, Vec3(-2, 0, 20), 1500).back(),
             early = forces_after({0.2 * down, aside, 0.8 * down}, 0.0, Vec3(-2, 0, 20), 1500).back(),
             straight = forces_after({down + aside}, 0.0, Vec3(-2, 0, 20), 1500).back(),
             there = forces_after({down}, 0.0, Vec3(3, 0, 20), 4000).back();
  EXPECT_LT((slid - early).norm(), 2e-3 * slid.norm());
  EXPECT_LT((slid - straight).norm(), 2e-3 * slid.norm());
  EXPECT_NEAR(slid.z(), there.z(), 0.015 * there.z()) << "nodes are as fine along the way as where it began";
  EXPECT_LT(std::abs(slid.x()), 0.02 * slid.z());
}

TEST(ToolInSteps, IsDraggedBackByFrictionAndLosesItsForceAsItIsLifted) {
  History history;
  const std::vector<Vec3> force = forces_after({{0, 0, -1.5e-3}, {4e-3, 0, 0}, {0, 0, 1e-3}, {0, 0, 1e-3}},
                                               0.3, Vec3(-2, 0, 20), 1500, &history);
  EXPECT_LT(std::abs(force[0].x()), 0.01 * force[0].z());
  EXPECT_LT(force[1].x(), -0.29 * force[1].z())
      << "all of it slides; it is drawn back a little more by the slope";
  EXPECT_GT(force[1].x(), -0.40 * force[1].z());
  EXPECT_LT(force[2].z(), 0.35 * force[1].z());
  EXPECT_LT(force[3].norm(), 1e-6 * force[1].norm())
      << "a tool that has left pulls nothing and is pushed by nothing";
  for (const ForceSample& sample : history.force) EXPECT_GE(sample.force, 0.0);
  double before = 0.0;
  for (const EnergySample& sample : history.energy) {
    EXPECT_GE(sample.dissipated, before - 1e-12);
    before = sample.dissipated;
  }
  EXPECT_GT(before, 0.3 * 0.9 * force[1].z() * 3e-3) << "of friction over three of four millimetres at least";
}

// Under a constant normal force, after a reversal: the law of Masing (1926) for yielding metal. It also holds
// for Coulomb friction on an elastic body. Residuals of the equilibria must not count as slip from much
// earlier places.
TEST(ToolInSteps, DrawnBackHasTwiceTheForceThatHalfOfThePathHadMadeAtFirst) {
  const Vec3 down(0, 0, -1.5e-3), aside(3e-3, 0, 0), back(-1.5e-3, 0, 0);
  History history;
  forces_after({down, aside}, 0.3, Vec3(-2, 0, 20), 1500, &history);
  EXPECT_LT(history.no_slip_area, 0.05 * history.contact_area) << "all of it slides";
  forces_after({down, aside, back}, 0.3, Vec3(-2, 0, 20), 1500, &history, 0.05);
  const Loading usual;
  const double pressed = down.norm() / usual.rate, drawn = pressed + aside.norm() / usual.rate;
  const auto at = [&](double t) {
    const auto after = std::find_if(history.force.begin() + 1, history.force.end(),
                                    [&](const ForceSample& s) { return s.t > t * (1.0 - 1e-9); });
    const ForceSample &to = *after, &from = *(after - 1);
    const double fraction = (t - from.t) / (to.t - from.t);
    return from.on_tool[0] + fraction * (to.on_tool[0] - from.on_tool[0]);
  };
  for (const double displacement : {0.5e-3, 1e-3}) {
    const double first = at(pressed + 0.5 * displacement / usual.rate) - at(pressed);
    EXPECT_NEAR(at(drawn + displacement / usual.rate), at(drawn) - 2.0 * first, 0.04 * std::abs(at(drawn)))
        << displacement;
  }
}

// After a large displacement the whole contact slides by that displacement minus that of the tissue, for any
// load steps.
TEST(ToolInSteps, SlidesAlongTheTissueByItsPathButForWhatThatGoesAlong) {
  const Vec3 down(0, 0, -1.5e-3), aside(4e-3, 0, 0);
  std::vector<double> farthest, sum;
  for (const double step_radii : {0.1, 0.05}) {
    Eigen::VectorXd pressed, drawn;
    forces_after({down}, 0.1, Vec3(-2, 0, 20), 1500, nullptr, step_radii, &pressed);
    forces_after({down, aside}, 0.1, Vec3(-2, 0, 20), 1500, nullptr, step_radii, &drawn);
    EXPECT_GT(pressed.maxCoeff(), 0.02e-3) << "far more than what the search for equilibrium leaves";
    EXPECT_LT(pressed.maxCoeff(), 0.5e-3);
    EXPECT_GT(drawn.maxCoeff(), 0.5 * aside.x());
    EXPECT_LT(drawn.maxCoeff(), aside.x() + pressed.maxCoeff())
        << "nothing that touches can have slid farther";
    farthest.push_back(drawn.maxCoeff());
    sum.push_back(0.0);
    for (const double slid : drawn) sum.back() += slid;
  }
  EXPECT_NEAR(farthest[0], farthest[1], 0.02 * farthest[1]);
  EXPECT_NEAR(sum[0], sum[1], 0.05 * sum[1]);
}

// No-slip samples have not slid. A tool with friction holds none before its first accepted state.
TEST(ToolInSteps, HoldsNothingBeforeItsFirstIncrementEndsAndWhatItHoldsDoesNotSlide) {
  const ToolShape sphere = sphere_shape(5e-3);
  const Model model = model_with_tool(block_surface({-15, -15, 0}, {15, 15, 15}),
                                      {.nodes = 800, .contact_radius = 3.0, .whole_patch = false});
  const auto indenter =
      tool_contact(sphere, model, contact_surface(model, 7e-3), std::numeric_limits<double>::infinity());
  Observer observer;
  int frames = 0;
  observer.frame = [&](const Frame& frame) {
    int held = 0;
    for (Index s = 0; s < frame.tool->count(); ++s) {
      held += frame.tool->contact(s) == RigidContact::Contact::no_slip;
      EXPECT_GE(frame.tool->forces()[s], 0.0) << "nothing pulls, between two equilibria either";
      EXPECT_LT(frame.tool->slid_along()[s], 0.02e-3) << "all but what comes to touch, which may slip once";
    }
    // The first increment ends at a seventh of half a millimetre.
    EXPECT_EQ(held > 0, frame.depth > 0.5e-3 / 7.0 + 1e-9) << frame.depth;
    ++frames;
  };
  marched(tissue_of(model), model, {.depth = 2e-3, .indenter = indenter}, {.frames = 28}, observer);
  EXPECT_EQ(frames, 29);
}

// Frictional dissipation is summed over load steps, so the energy error decreases with their length.
TEST(ToolInSteps, LosesByFrictionWhatTheToolHasDoneMoreThanTheTissueGivesBack) {
  const std::vector<Vec3> directions = {{0, 0, -1.5e-3}, {3e-3, 0, 0}};
  std::vector<double> missing;
  for (const double step_radii : {0.1, 0.05}) {
    History history;
    forces_after(directions, 0.3, Vec3(-2, 0, 20), 1000, &history, step_radii);
    const EnergySample& end = history.energy.back();
    EXPECT_GT(end.dissipated, 0.3 * end.external);
    missing.push_back(std::abs(end.error()) / end.external);
  }
  EXPECT_LT(missing[0], 0.03);
  EXPECT_LT(missing[1], 0.7 * missing[0]);
}

// During an oblique approach all samples in contact slide under a force that grows with each step.
TEST(ToolInSteps, LosesByFrictionNoMoreThanTheToolHasDoneWhereItComesDownAslant) {
  History history;
  forces_after({{3e-3, 0, -1.5e-3}}, 0.1, Vec3(-2, 0, 20), 1000, &history);
  const EnergySample& end = history.energy.back();
  EXPECT_GT(end.dissipated, 0.1 * end.external);
  EXPECT_LT(std::abs(end.error()), 0.01 * end.external);
}

// A sample that comes into contact slips from its predicted place, which depends on the accepted states. The
// dissipation on one discretisation therefore differs by some 2 %, in either direction.
TEST(ToolInSteps, WithFrictionContinuesAfterAStepAsIfThereWereNone) {
  const Vec3 down(0, 0, -0.75e-3), aside(0.5e-3, 0, 0), place(-2, 0, 20);
  double mean = 0.0;
  for (const Index nodes : {1000, 1500, 2000}) {
    SCOPED_TRACE(nodes);
    History once, twice;
    const Vec3 whole = forces_after({2.0 * (down + aside)}, 0.3, place, nodes, &once).back(),
               parts = forces_after({down + aside, down + aside}, 0.3, place, nodes, &twice).back();
    EXPECT_LT((whole - parts).norm(), 2e-3 * whole.norm());
    const double more = twice.energy.back().dissipated / once.energy.back().dissipated - 1.0;
    EXPECT_LT(std::abs(more), 0.03);
    mean += more / 3.0;
  }
  EXPECT_LT(std::abs(mean), 0.01);
}

TEST(ToolInSteps, HasNodesAsFineAlongItsPathAsWhereItBegins) {
  const Model model = model_with_tool(block_surface({-20, -20, 0}, {20, 20, 20}),
                                      {.nodes = 1500,
                                       .contact_radius = 2.7,
                                       .at = "-2,0,top",
                                       .displacement = {Vec3(0, 0, -1.5), Vec3(6, 0, -1.5)}});
  const auto spacing_at = [&](const Vec3& x) {
    Index nearest = 0;
    (model.X.colwise() - 1e-3 * x).colwise().squaredNorm().minCoeff(&nearest);
    return model.spacing[nearest];
  };
  const double begins = spacing_at({-2, 0, 20});
  for (const double x : {0.0, 2.0, 4.0}) EXPECT_LT(spacing_at({x, 0, 20}), 1.1 * begins) << x;
  EXPECT_GT(spacing_at({-2, 10, 20}), 2.0 * begins) << "beside the way they are not";
}

TEST(RigidContact, FrictionLiesInTheTangentPlaneAndIsNeverMoreThanItsFractionOfTheNormalForce) {
  const Model model = model_with_tool(block_surface({-15, -15, 0}, {15, 15, 20}),
                                      {.nodes = 600, .contact_radius = 3.0, .whole_patch = false});
  const RigidBody indenter = *tool_contact(sphere_shape(5e-3), model, contact_surface(model, 7e-3), 0.3);
  RigidContact tool(indenter);
  Nodal u = Nodal::Zero(4, model.node_count()), f = u;
  Eigen::VectorXd force = Eigen::VectorXd::Constant(tool.unknowns(), 1e-3);
  tool.set_forces(force);
  tool.add_force(u, {.depth = 1e-4}, f);
  EXPECT_EQ(tool.friction_forces().norm(), 0.0) << "all slide freely in the first step";
  tool.accept(u, {.depth = 1e-4});
  force[0] = -1e-3;
  tool.set_forces(force);
  tool.add_force(u, {.depth = 2e-4}, f);
  double largest = 0.0;
  for (Index s = 0; s < tool.count(); ++s) {
    const Vec3 t = tool.friction_forces().col(s);
    EXPECT_LE(t.norm(), 0.3 * std::max(tool.forces()[s], 0.0) * (1.0 + 1e-12));
    EXPECT_NEAR(t.dot(tool.normals().col(s)), 0.0, 1e-15);
    largest = std::max(largest, t.norm());
  }
  EXPECT_GT(largest, 0.2e-3);
  // Another tool continues from the accepted state.
  RigidContact other(indenter);
  other.restore_past(tool.past());
  other.set_forces(force);
  other.add_force(u, {.depth = 2e-4}, f);
  EXPECT_EQ(other.slips(), tool.slips());
  EXPECT_EQ(other.friction_forces(), tool.friction_forces());
}

// A body at rest before first contact lacks all contact forces. No tolerance may accept that state.
TEST(RigidContact, IsFoundByTheSearchUnderStrictTolerancesToo) {
  const Model model =
      model_with_tool(block_surface({-20, -20, 0}, {20, 20, 20}), {.nodes = 600, .contact_radius = 2.2});
  const auto indenter = tool_contact(sphere_shape(5e-3), model, contact_surface(model, 5e-3));
  const ForceSystem system = tissue_of(model);
  double usual = 0.0;
  for (const double tolerance : {1e-4, 1e-6, 1e-7}) {
    SCOPED_TRACE(tolerance);
    const History history =
        marched(system, model, {.depth = 1e-3, .indenter = indenter}, {.frames = 1, .tolerance = tolerance});
    if (usual == 0.0) usual = history.force.back().force;
    EXPECT_NEAR(history.force.back().force, usual, 1e-3 * usual);
    EXPECT_EQ(history.energy.back().dissipated, 0.0) << "nothing rubs";
    for (const Finding& finding : history.guards) EXPECT_NE(finding.report.code, "limit-point");
  }
}

TEST(ToolShape, TwoAreInOnePlaceWhereTheirSurfacesAreDeepInEachOther) {
  const ToolShape small = sphere_shape(4e-3), large = sphere_shape(5e-3), rod = capsule_shape(2e-3, 20e-3),
                  punch = punch_shape(5e-3, 1e-3);
  const double deep = 0.05e-3;
  const auto lowest_ball = [](const ToolShape& of, double x, double z) {  // middle of its lowest ball
    return ToolPose{Vec3(x, 1e-3, z - (of.edge > 0.0 ? 0.0 : of.radius)), -Vec3::UnitZ()};
  };
  // Two balls overlap if their centres are nearer than both radii, less the depth in each.
  for (const double apart : {0.0, 3e-3, 8.85e-3, 8.95e-3, 12e-3})
    EXPECT_EQ(place_in_both(small, lowest_ball(small, 0.0, 0.0), large, lowest_ball(large, apart, 0.0), deep)
                  .has_value(),
              apart < 9e-3 - 2.0 * deep)
        << apart;
  // A ball is next to a rod at half its height, and next to a punch, which has no end.
  for (const double apart : {6.85e-3, 6.95e-3})
    EXPECT_EQ(place_in_both(rod, lowest_ball(rod, 0.0, 0.0), large, lowest_ball(large, apart, 8e-3), deep)
                  .has_value(),
              apart < 7e-3 - 2.0 * deep)
        << apart;
  for (const double apart : {8.85e-3, 8.95e-3})
    EXPECT_EQ(
        place_in_both(punch, lowest_ball(punch, 0.0, 0.0), small, lowest_ball(small, apart, 10e-3), deep)
            .has_value(),
        apart < 9e-3 - 2.0 * deep)
        << apart;
  // A punch, which has no end, counts only near the body: tilted punches meet far above it.
  const ToolPose leaning{Vec3(25e-3, 1e-3, 0.0), Vec3(0.5, 0.0, -1.0).normalized()};
  EXPECT_FALSE(place_in_both(punch, lowest_ball(punch, 0.0, 0.0), punch, leaning, deep).has_value());
  EXPECT_TRUE(place_in_both(punch, lowest_ball(punch, 0.0, 0.0), punch,
                            {Vec3(12e-3, 1e-3, 0.0), leaning.points_at}, deep)
                  .has_value());
  // The reported common point is inside both tools.
  const auto place =
      place_in_both(rod, lowest_ball(rod, 0.0, 0.0), large, lowest_ball(large, 6e-3, 8e-3), deep);
  ASSERT_TRUE(place.has_value());
  EXPECT_LT(distance_to_tool(rod, lowest_ball(rod, 0.0, 0.0), *place).distance, -0.98 * deep);
  EXPECT_LT(distance_to_tool(large, lowest_ball(large, 6e-3, 8e-3), *place).distance, -0.98 * deep);
}

// A wide tool draws a compressible layer sideways, which slips.
TEST(RigidContact, FrictionTakesEnergyInEveryStepAndNeverGivesAny) {
  const Model model =
      model_with_tool(block_surface({-15, -15, 0}, {15, 15, 6}), {.nodes = 1000, .contact_radius = 3.0});
  const auto indenter = tool_contact(sphere_shape(5e-3), model, contact_surface(model, 7e-3));
  std::vector<double> force;
  for (const double friction : {0.0, 0.05, 0.2}) {
    indenter->friction = friction;
    const History history = marched(tissue_of(model), model, {.depth = 2.5e-3, .indenter = indenter});
    force.push_back(history.force.back().force);
    double dissipation = 0.0;
    for (const EnergySample& e : history.energy) {
      EXPECT_GE(e.dissipated, dissipation);
      dissipation = e.dissipated;
    }
    const EnergySample& end = history.energy.back();
    EXPECT_NEAR(end.stored + end.dissipated, end.external, 0.02 * end.external);
    if (friction == 0.05) EXPECT_GT(dissipation, 1e-3 * end.external);
    std::printf("friction %g: %.4f mN, heat %.3g of the work\n", friction, 1e3 * force.back(),
                dissipation / end.external);
    if (friction == 0.0) EXPECT_EQ(dissipation, 0.0);
  }
  EXPECT_GT(force[1], force[0]);
  EXPECT_GT(force[2], force[1]);
}

TEST(RigidContact, WithFrictionContinuesFromAStateThatWasKeptToTheSameBits) {
  const Model model =
      model_with_tool(block_surface({-15, -15, 0}, {15, 15, 6}), {.nodes = 600, .contact_radius = 3.0});
  const auto indenter = tool_contact(sphere_shape(5e-3), model, contact_surface(model, 7e-3), 0.1);
  const ForceSystem system = tissue_of(model);
  const Loading loading{.depth = 2e-3, .indenter = indenter};
  std::vector<MarchState> kept;
  Observer observer;
  observer.between_steps = [&](const std::function<MarchState()>& state) { kept.push_back(state()); };
  Eigen::VectorXd slid, slid_again;
  observer.frame = [&](const Frame& frame) { slid = frame.tool->slid_along(); };
  const History whole = marched(system, model, loading, {.frames = 1}, observer);
  ASSERT_GE(kept.size(), 3u);
  observer = {};
  observer.frame = [&](const Frame& frame) { slid_again = frame.tool->slid_along(); };
  const History again = marched(system, model, loading, {.frames = 1}, observer, &kept[1]);
  EXPECT_EQ(slid_again, slid);
  EXPECT_GT(slid.maxCoeff(), 0.01e-3);
  EXPECT_EQ(again.force.back().force, whole.force.back().force);
  EXPECT_EQ(again.energy.back().dissipated, whole.energy.back().dissipated);
  EXPECT_GT(whole.energy.back().dissipated, 0.0);
}

}  // namespace
}  // namespace dimple
