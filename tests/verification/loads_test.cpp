// Gravity, body forces and pressure against closed forms.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "preprocess/supports/support.hpp"
#include "tests/helpers/marched.hpp"
#include "tests/verification/verify_bodies.hpp"

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;
using Hold = HeldSet::Hold;

// A box with faces that slide on frictionless walls, if `walls` is true, for each axis at 0 and at 1. Nodes
// on two walls slide along both, nodes on three are fixed. `clamped`: further fixed nodes.
struct Walls {
  std::array<std::array<bool, 2>, 3> at;
  std::function<bool(const LatticeBody&, Index)> clamped;
};

std::vector<HeldSet> sets_of(const LatticeBody& body, const Walls& walls) {
  std::array<HeldSet, 7> set;
  for (std::size_t d = 0; d < 3; ++d) {
    const Vec3 axis = Vec3::Unit(static_cast<Index>(d));
    set[d] = {.name = "wall", .node = {}, .hold = Hold::along, .direction = axis};
    set[3 + d] = {.name = "edge", .node = {}, .hold = Hold::across, .direction = axis};
  }
  set[6] = {.name = "fixed", .node = {}};
  for (Index a = 0; a < body.at.cols(); ++a) {
    std::vector<std::size_t> held, free;
    for (std::size_t d = 0; d < 3; ++d) {
      const auto axis = static_cast<int>(d);
      const bool on_wall =
          (walls.at[d][0] && body.on_face(a, axis, 0.0)) || (walls.at[d][1] && body.on_face(a, axis, 1.0));
      (on_wall ? held : free).push_back(d);
    }
    const bool clamped = walls.clamped && walls.clamped(body, a);
    if (clamped || held.size() == 3)
      set[6].node.push_back(a);
    else if (held.size() == 2)
      set[3 + free[0]].node.push_back(a);
    else if (held.size() == 1)
      set[held[0]].node.push_back(a);
  }
  std::vector<HeldSet> result;
  std::copy_if(set.begin(), set.end(), std::back_inserter(result),
               [](const HeldSet& s) { return !s.node.empty(); });
  return result;
}

// A box on such walls under loads, applied in even steps.
struct LoadedBox {
  LoadedBox(const Lattice& lattice, const Walls& walls, const Material& material)
      : statics(make_lattice(lattice), sets_of(make_lattice(lattice), walls), {material}) {}
  Equilibrium under(ForceTerms terms, int steps, double tolerance = 1e-6) const {
    System body(statics.system(), statics.model(), statics.constraints(), std::move(terms));
    const Relaxation relax(body);
    Equilibrium found{Nodal::Zero(4, statics.model().node_count()),
                      Nodal::Zero(4, statics.model().node_count())};
    Eigen::VectorXd lambda = Eigen::VectorXd::Zero(statics.model().patches.count());
    for (int k = 1; k <= steps; ++k) {
      body.set({.fraction = static_cast<double>(k) / steps});
      if (k > 1) found.u *= static_cast<double>(k) / (k - 1), lambda *= static_cast<double>(k) / (k - 1);
      relax(found.u, found.f, {.tolerance = tolerance, .evaluations = 20000}, &lambda);
    }
    return found;
  }
  const Model& model() const { return statics.model(); }
  Statics statics;
};

// Stress P_zz of laterally confined neo-Hookean tissue, F = diag(1, 1, l) [Pa].
double confined_stress(const Material& m, double l) {
  return m.mu * std::pow(l, -2.0 / 3.0) * (l - (2.0 + l * l) / (3.0 * l)) + m.kappa * (l - 1.0);
}

// P(l(Z)) = -rho g (H - Z) for any strain: here the lowest tissue is compressed to 0.62 of its height.
TEST(Gravity, ShortensAConfinedColumnAsItsWeightAboveEachPlaceSays) {
  const double H = 20e-3, g = 18.0;
  Material sponge = neo_hookean(210.0, 0.3, 1000.0);
  const LoadedBox column(box_lattice(Vec3(10e-3, 10e-3, H), 9, 0.1),
                         {.at = {{{true, true}, {true, true}, {true, false}}}, .clamped = {}}, sponge);
  const Equilibrium found =
      column.under(make_terms(column.model(), {.gravity = Vec3(0.0, 0.0, -g), .pressure = {}}), 4);
  const auto stretch = [&](double Z) {
    return root(0.2, 1.2, [&](double l) { return confined_stress(sponge, l) + 1000.0 * g * (H - Z); });
  };
  EXPECT_LT(stretch(0.0), 0.63);
  const auto sinks = [&](double Z) {
    double sum = 0.0;
    constexpr int parts = 400;
    for (int k = 0; k < parts; ++k) sum += (stretch(Z * (k + 0.5) / parts) - 1.0) * Z / parts;
    return sum;
  };
  for (Index a = 0; a < column.model().node_count(); a += 7) {
    EXPECT_NEAR(found.u(2, a), sinks(column.model().X(2, a)), 0.01 * std::abs(sinks(H)))
        << column.model().X(2, a);
    EXPECT_LT(found.u.col(a).head<2>().norm(), 0.01 * std::abs(sinks(H)));
  }
  const double weight = column.model().mass.sum() * g;
  EXPECT_NEAR(face_force(column.statics.body(), found.f, 2, 0.0).z(), weight, 1e-4 * weight)
      << "the floor bears it";
}

// Compliance of a hanging layer of height h under forces cos(pi x / W) on its lower side, W half of the first
// unstable wave. Stiffness falls to zero at rho g h / mu = 6.2229, wave number 2.1198 / h. Source: Mora,
// Phou, Fromental, Pomeau, Phys. Rev. Lett. 113, 178301, 2014.
TEST(Gravity, MakesABondedLayerThatHangsLoseItsStabilityWhereItIsKnownTo) {
  const double h = 10e-3, W = std::numbers::pi * h / 2.1198, mu = 210.0;
  Lattice lattice = box_lattice(Vec3(W, 0.4 * h, h), 4, 0.0);
  const Walls walls{.at = {{{true, true}, {true, true}, {false, false}}},
                    .clamped = [](const LatticeBody& body, Index a) { return body.on_face(a, 2, 1.0); }};
  const LoadedBox layer(lattice, walls, neo_hookean(mu, 0.4999, 1000.0));
  const Model& model = layer.model();
  Nodal wave = Nodal::Zero(4, model.node_count());
  for (Index a = 0; a < model.node_count(); ++a)
    if (layer.statics.body().on_face(a, 2, 0.0))
      wave(2, a) = 1e-6 * std::cos(std::numbers::pi * model.X(0, a) / W);
  const std::vector<double> ratio = {4.0, 4.8, 5.4};
  std::vector<double> stiffness;
  for (const double alpha : ratio) {
    ForceTerms terms =
        make_terms(model, {.gravity = Vec3(0.0, 0.0, -alpha * mu / (1000.0 * h)), .pressure = {}});
    terms.push_back(dead_load(wave));
    stiffness.push_back(wave.squaredNorm() /
                        wave.cwiseProduct(layer.under(std::move(terms), 2, 1e-6).u).sum());
  }
  // The parabola goes through the three points.
  const auto at = [&](double x) {
    double sum = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
      double part = stiffness[i];
      for (std::size_t j = 0; j < 3; ++j)
        if (j != i) part *= (x - ratio[j]) / (ratio[i] - ratio[j]);
      sum += part;
    }
    return sum;
  };
  const double critical = root(5.0, 8.0, [&](double x) { return -at(x); });
  RecordProperty("critical", std::to_string(critical));
  EXPECT_NEAR(critical, 6.2229, 0.02 * 6.2229) << stiffness[0] << " " << stiffness[1] << " " << stiffness[2];
}

Loads under(const Model& model, const BodyForce& body) {
  Loads loads;
  loads.body_force.push_back({body, nodal_force(model, point_interpolation(model), body)});
  return loads;
}

// A body force b Z along the axis gives P_zz(Z) = b (H^2 - Z^2) / 2. At small strain u_z(Z) = b (H^2 Z / 2 -
// Z^3 / 6) / (kappa + 4/3 mu).
TEST(BodyForce, ThatGrowsAlongAConfinedColumnCompressesItByItsIntegralAboveEachPlace) {
  const double W = 10e-3, H = 20e-3, b = -7350.0;
  const Material sponge = neo_hookean(210.0, 0.3, 1000.0);
  const LoadedBox column(box_lattice(Vec3(W, W, H), 9, 0.1),
                         {.at = {{{true, true}, {true, true}, {true, false}}}, .clamped = {}}, sponge);
  const Vec3 at(1e-3, 2e-3, 0.25 * H);
  const BodyForce body{.name = "grows",
                       .force = Vec3(0.0, 0.0, b * at.z()),
                       .gradient = Vec3(0.0, 0.0, b).asDiagonal(),
                       .at = at};
  const Equilibrium found = column.under(make_terms(column.model(), under(column.model(), body)), 1);
  const double modulus = sponge.kappa + 4.0 / 3.0 * sponge.mu;
  EXPECT_NEAR(std::abs(0.5 * b * H * H) / modulus, 2e-3, 1e-4) << "the strain at the base is small";
  const auto exact = [&](double Z) { return b * (0.5 * H * H * Z - Z * Z * Z / 6.0) / modulus; };
  const Points u = node_interpolation(column.model())(found.u).topRows<3>();
  for (Index a = 0; a < column.model().node_count(); ++a) {
    EXPECT_NEAR(u(2, a), exact(column.model().X(2, a)), 0.006 * std::abs(exact(H))) << column.model().X(2, a);
    EXPECT_LT(u.col(a).head<2>().norm(), 0.006 * std::abs(exact(H)));
  }
  const double stress = face_force(column.statics.body(), found.f, 2, 0.0).z() / (W * W);
  EXPECT_NEAR(stress, -0.5 * b * H * H, 1e-4 * stress) << "stress at the base";
}

// The resultant is V f(c), the moment about the origin V (c x f(c) + sum_j e_j x (G S) e_j). c is the
// centroid, S the second moments about it. The cells are exact to the second order of their size.
TEST(BodyForce, HasTheResultantAndTheMomentOfItsIntegralOverTheBody) {
  const Vec3 size(12e-3, 9e-3, 15e-3), c = 0.5 * size, at(-4e-3, 7e-3, 2e-3);
  const LoadedBox box(box_lattice(size, 5, 0.2), {.at = {}, .clamped = {}}, neo_hookean(210.0, 0.45, 1000.0));
  const Model& model = box.model();
  Mat3 gradient;
  gradient << 1.0, -2.0, 3.0, 0.5, 4.0, -1.5, 7.0, 2.5, -3.5;
  const BodyForce body{
      .name = "all", .force = Vec3(300.0, -200.0, 500.0), .gradient = 1e5 * gradient, .at = at};
  const Loads loads = under(model, body);
  EXPECT_FALSE(loads.none());
  EXPECT_TRUE(loads.move_the_body());
  const ForceTerms terms = make_terms(model, loads);
  ASSERT_EQ(terms.size(), 1u);
  Nodal f = Nodal::Zero(4, model.node_count());
  terms.front()->add_force(Nodal::Zero(4, model.node_count()), {}, f);
  Vec3 resultant = Vec3::Zero(), moment = Vec3::Zero();
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 on_node = -f.col(a).head<3>();
    resultant += on_node;
    moment += Vec3(model.X.col(a)).cross(on_node);
  }
  const double volume = size.prod();
  const Vec3 middle = body.force + body.gradient * (c - at);
  const Vec3 exact = volume * middle;
  const Mat3 spread = (size.cwiseAbs2() / 12.0).asDiagonal();
  Vec3 exact_moment = volume * c.cross(middle);
  for (int j = 0; j < 3; ++j)
    exact_moment += volume * Vec3::Unit(j).cross(Vec3(body.gradient * spread.col(j)));
  EXPECT_LT((resultant - exact).norm(), 1e-9 * exact.norm());
  EXPECT_LT((moment - exact_moment).norm(), 0.01 * exact_moment.norm());
}

// Upper face of the surface.
SurfacePatch top_of(const Model& model) {
  return surface_patch(model, triangles_facing(model, Vec3::UnitZ()));
}

// A cube on three walls, free at its other sides. Pressed along z its stretches are l and twice a: free
// sides, and P_zz = -p for a dead pressure, P_zz = -p a^2 for one that follows the surface.
struct Pressed {
  double a, l;
};
Pressed pressed(const Material& m, double p, bool follows) {
  const auto side = [&](double a, double l) {
    Mat3 F = Vec3(a, a, l).asDiagonal();
    return pk1_stress(m, F)(0, 0);
  };
  const auto free_side = [&](double l) { return root(0.5, 2.0, [&](double a) { return side(a, l); }); };
  const double l = root(0.4, 1.0, [&](double x) {
    const double a = free_side(x);
    Mat3 F = Vec3(a, a, x).asDiagonal();
    return pk1_stress(m, F)(2, 2) + p * (follows ? a * a : 1.0);
  });
  return {free_side(l), l};
}

TEST(Pressure, DeadAndFollowingPressesACubeAsItsClosedFormsSay) {
  const double p = 100.0, size = 10e-3;
  const Material tissue = neo_hookean(210.0, 0.45, 1000.0);
  const LoadedBox cube(box_lattice(Vec3::Constant(size), 6, 0.1),
                       {.at = {{{true, false}, {true, false}, {true, false}}}, .clamped = {}}, tissue);
  std::array<double, 2> height{};
  for (const bool follows : {false, true}) {
    Loads loads;
    loads.pressure.push_back(
        {.name = "top", .patch = top_of(cube.model()), .pressure = p, .follows = follows});
    const Equilibrium found = cube.under(make_terms(cube.model(), loads), 8);
    const Pressed exact = pressed(tissue, p, follows);
    const double shorter = (1.0 - exact.l) * size, wider = (exact.a - 1.0) * size;
    double top = 0.0, side = 0.0, off = 0.0;
    Index on_top = 0, on_side = 0;
    for (Index a = 0; a < cube.model().node_count(); ++a) {
      const Vec3 X = cube.model().X.col(a);
      const Vec3 exact_displacement(wider * X.x() / size, wider * X.y() / size, -shorter * X.z() / size);
      off = std::max(off, (found.u.col(a).head<3>() - exact_displacement).norm());
      if (cube.statics.body().on_face(a, 2, 1.0)) top += found.u(2, a), ++on_top;
      if (cube.statics.body().on_face(a, 0, 1.0)) side += found.u(0, a), ++on_side;
    }
    EXPECT_NEAR(top / static_cast<double>(on_top), -shorter, 5e-3 * shorter) << follows;
    EXPECT_NEAR(side / static_cast<double>(on_side), wider, 5e-3 * shorter) << follows;
    EXPECT_LT(off, 0.01 * shorter) << follows;
    const double force = p * size * size * (follows ? exact.a * exact.a : 1.0);
    EXPECT_NEAR(face_force(cube.statics.body(), found.f, 2, 0.0).z(), force, 2e-3 * force);
    height[follows ? 1 : 0] = exact.l;
  }
  EXPECT_GT(height[0] - height[1], 0.015) << "the two are not the same";
}

// One point in the middle of each small triangle suffices: it is as accurate as the surface.
TEST(Pressure, OnAllSidesOfABodyMovesItNowhereAndDoesTheWorkOfItsChangeOfVolume) {
  const LoadedBox cube(box_lattice(Vec3::Constant(10e-3), 8, 0.1), {.at = {}, .clamped = {}},
                       neo_hookean(210.0, 0.45, 1000.0));
  const Model& model = cube.model();
  std::vector<Index> every(static_cast<std::size_t>(model.surface.triangles.cols()));
  std::iota(every.begin(), every.end(), Index{0});
  const SurfacePatch all = surface_patch(model, every);
  const auto terms =
      make_terms(model, {.gravity = Vec3::Zero(),
                         .pressure = {{.name = "all", .patch = all, .pressure = 50.0, .follows = true}}});
  Nodal u = Nodal::Zero(4, model.node_count()), displacement = u, f = u;
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 X = model.X.col(a) * 100.0;
    u.col(a).head<3>() = 1e-3 * Vec3(X.x() * X.y(), std::sin(2.0 * X.y()), X.z() * X.x());
    displacement.col(a).head<3>() = Vec3(X.y() * X.z(), std::sin(2.0 * X.z()), X.x() - X.y());
  }
  const auto volume = [&](const Nodal& v) {
    const Points x = all.corner + all.at_corner(v.topRows<3>());
    double sum = 0.0;
    for (const auto& t : all.triangles.colwise())
      sum += x.col(t[0]).dot(x.col(t[1]).cross(x.col(t[2]))) / 6.0;
    return sum;
  };
  terms.front()->add_force(u, {}, f);
  const double e = 1e-6, slope = (volume(u + e * displacement) - volume(u - e * displacement)) / (2.0 * e);
  EXPECT_NEAR(f.cwiseProduct(displacement).sum(), 50.0 * slope, 0.005 * std::abs(50.0 * slope));
  EXPECT_LT(f.rowwise().sum().norm(), 1e-12) << "a closed surface is pushed nowhere";
  // For a homogeneous motion, in steps from rest, the energy is the pressure times the increase of volume.
  for (Index a = 0; a < model.node_count(); ++a)
    u.col(a).head<3>() =
        Vec3(0.3 * model.X(0, a) + 0.2 * model.X(1, a), 0.1 * model.X(1, a), 0.2 * model.X(2, a));
  constexpr int steps = 100;
  terms.front()->accept(0.0 * u, {});
  for (int k = 1; k <= steps; ++k) terms.front()->accept(u * (static_cast<double>(k) / steps), {});
  const double grown = volume(u) - volume(Nodal::Zero(4, model.node_count()));
  EXPECT_NEAR(grown, (1.3 * 1.1 * 1.2 - 1.0) * 1e-6, 1e-12);
  EXPECT_NEAR(terms.front()->energy(u, {}), 50.0 * grown, 1e-4 * 50.0 * grown);
}

TEST(ForceTerms, OfLoadsThatDoNotFollowAreTheSlopeOfTheirEnergy) {
  const LoadedBox cube(box_lattice(Vec3::Constant(10e-3), 4, 0.1), {.at = {}, .clamped = {}},
                       neo_hookean(210.0, 0.45, 1000.0));
  const Model& model = cube.model();
  const Nodal u = Nodal::Random(4, model.node_count()) * 1e-3,
              displacement = Nodal::Random(4, model.node_count());
  const Instant half{.fraction = 0.5};
  for (const auto& term : make_terms(
           model,
           {.gravity = Vec3(1.0, -2.0, 9.0),
           .pressure = {{.name = "side", .patch = top_of(model), .pressure = 50.0, .follows = false}}})) {
    Nodal f = Nodal::Zero(4, model.node_count());
    term->add_force(u, half, f);
    const double e = 1e-4, slope = (term->energy(u + e * displacement, half) -
                                    term->energy(u - e * displacement, half)) /
                                   (2.0 * e);
    EXPECT_NEAR(f.cwiseProduct(displacement).sum(), slope, 1e-9 * std::abs(slope));
  }
}

// Springs to the ground, and between distant nodes, a thousand times as stiff as the tissue.
class Springs : public ForceTerm {
 public:
  Springs(StiffnessBound k, Nodal pull, int& calls)
      : k_(std::move(k)), pull_(std::move(pull)), calls_(calls) {}
  void add_force(const Nodal& u, const Instant& now, Nodal& f) override {
    ++calls_;
    f += u * k_.node.asDiagonal();
    for (const StiffnessBound::Edge& e : k_.edge) {
      const Eigen::Vector4d pull = e.weight * (u.col(e.a) - u.col(e.b));
      f.col(e.a) += pull;
      f.col(e.b) -= pull;
    }
    f -= now.fraction * pull_;
  }
  double energy(const Nodal&, const Instant&) override { return 0.0; }
  void add_stiffness_bound(StiffnessBound& bound) const override {
    bound.node += k_.node;
    bound.edge.insert(bound.edge.end(), k_.edge.begin(), k_.edge.end());
  }

 private:
  StiffnessBound k_;
  Nodal pull_;
  int& calls_;
};

TEST(ForceTerms, AThousandTimesAsStiffAsTheTissueStillComeToEquilibrium) {
  const LoadedBox cube(
      box_lattice(Vec3::Constant(10e-3), 6, 0.1),
      {.at = {}, .clamped = [](const LatticeBody& body, Index a) { return body.on_face(a, 2, 0.0); }},
      neo_hookean(210.0, 0.499, 1000.0));
  const Model& model = cube.model();
  const double tissue = 210.0 * 10e-3 / 6.0;  // N/m between neighbours
  StiffnessBound k;
  k.node = Eigen::VectorXd::Zero(model.node_count());
  std::vector<Index> top;
  for (Index a = 0; a < model.node_count(); ++a)
    if (cube.statics.body().on_face(a, 2, 1.0)) top.push_back(a);
  // The upper face is a plate: every node is joined with its neighbour in the list and with a distant one.
  for (std::size_t i = 0; i < top.size(); ++i)
    for (const std::size_t step : {std::size_t{1}, std::size_t{11}})
      k.edge.push_back(
          {static_cast<int>(top[i]), static_cast<int>(top[(i + step) % top.size()]), 1000.0 * tissue});
  Nodal pull = Nodal::Zero(4, model.node_count());
  pull(0, top.front()) = 0.5 * 210.0 * 1e-4 * 0.2;
  ForceTerms terms;
  int calls = 0;
  terms.push_back(std::make_unique<Springs>(k, pull, calls));
  const Equilibrium found = cube.under(std::move(terms), 2, 1e-6);
  // The stiff face moves nearly as one, in the direction of the force.
  double least = 1.0, most = 0.0;
  for (const Index a : top) least = std::min(least, found.u(0, a)), most = std::max(most, found.u(0, a));
  EXPECT_GT(least, 0.0);
  EXPECT_LT(most - least, 0.02 * most);
  EXPECT_LT(calls, 300) << "without the bound of their stiffness it takes 10,000";
}

}  // namespace
}  // namespace dimple
