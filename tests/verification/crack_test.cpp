// Sharp cracks at small strains against closed forms: the energy released by a penny-shaped crack, and the
// opening of one from a free face.

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <random>

#include "solver/equilibrium/relax.hpp"
#include "solver/system.hpp"
#include "tests/helpers/shapes.hpp"
#include "tests/verification/even_lattice.hpp"

namespace dimple {
namespace {

constexpr double mu = 1000.0, a = 10e-3;  // shear modulus [Pa]; the crack's radius or depth [m]
constexpr double strain = 1e-5;           // negligible second-order terms
constexpr double width_of_gap = 0.1;      // between the faces of a crack, in spacings

// Number of cells, 1.8 to an interval of nodes; even, so that a crack is between cells.
Eigen::Array3i cells_of(const LatticeBox& box) {
  return 2 * (0.9 * box.intervals.cast<double>()).round().cast<int>();
}

// Moves each node by up to a fifth of a spacing along each axis; nodes on a face stay on it.
void scatter(const LatticeBox& box, Points& X) {
  std::mt19937 random(1);
  // std::uniform_real_distribution is avoided, since its numbers differ between libraries.
  const auto noise = [&] { return 0.2 * (static_cast<double>(random()) / 2147483648.0 - 1.0); };
  for (Index b = 0; b < X.cols(); ++b)
    for (int d = 0; d < 3; ++d) {
      const double by = noise() * box.spacing()[d];
      if (X(d, b) > box.lower[d] + 1e-9 && X(d, b) < box.upper[d] - 1e-9) X(d, b) += by;
    }
}

template <class Chosen>
HeldSet set_of(const Points& X, const char* name, HeldSet::Hold hold, const Vec3& direction, Chosen chosen) {
  HeldSet set{.name = name, .node = {}, .hold = hold, .direction = direction};
  for (Index b = 0; b < X.cols(); ++b)
    if (chosen(Vec3(X.col(b)))) set.node.push_back(b);
  return set;
}

struct Pulled {
  Nodal u;
  double energy = 0.0;
};

// Equilibrium with held nodes displaced as in a body without a crack under strains along the axes.
Pulled pulled(Discretisation places, std::vector<HeldSet> held, const Vec3& strains, double nu) {
  places.base = held.back().node;
  Eigen::VectorXi tissue = places.label;
  const Model model = make_model(std::move(places), converging, std::move(tissue), {1000.0});
  const ForceSystem forces(model, {{neo_hookean(mu, nu, 1000.0)}, model.tissue});
  System system(forces, model, Constraints(model.node_count(), std::move(held)));
  EquilibriumState state = system.step_start();
  state.u.topRows<3>() = strains.asDiagonal() * model.X;
  Nodal f = state.u;
  // Dynamic relaxation is needed for scattered nodes: the mixed iteration fails near a penny.
  const Relaxation relax(system);
  relax(state.u, f, {.tolerance = 1e-5}, &state.lambda);  // throws if there is none
  return {state.u, system.stored_energy(state.u).tissue};
}

double young(double nu) {
  return 2.0 * mu * (1.0 + nu);
}

// Half (large x) of a cube of 3.2 a with the penny z = 0 in its middle; the other half is its mirror image.
// Returns the released energy of the whole, relative to Sneddon's.
double released_by_penny(double per_spacing, double nu, bool scattered) {
  const double side = 1.6 * a;
  const int n = static_cast<int>(std::lround(side / a * per_spacing));
  const LatticeBox box{
      {0.0, -side, -side}, Vec3::Constant(side), {n, 2 * n, 2 * n - 1}};  // z = 0 between nodes
  Discretisation places = even_lattice(box, cells_of(box));
  if (scattered) scatter(box, places.X);
  const double gap = width_of_gap * side / n;
  const BodySurface plug = cylinder_surface(1e3 * a, 1e3 * gap);
  places.surface = {plug.vertex(), plug.triangles()};
  places.surface.vertex_mm.row(2).array() -= 0.5e3 * gap;
  places.surface.triangles.row(0).swap(places.surface.triangles.row(1));  // no tissue in it
  const HeldSet mirror = set_of(places.X, "mirror", HeldSet::Hold::along, Vec3::UnitX(),
                                [](const Vec3& x) { return x.x() < 1e-9; });
  const HeldSet walls = set_of(places.X, "walls", HeldSet::Hold::all, Vec3::Zero(),
                               [&](const Vec3& x) { return x.cwiseAbs().maxCoeff() > side - 1e-9; });
  const double energy =
      2.0 * pulled(std::move(places), {mirror, walls}, strain * Vec3(-nu, -nu, 1.0), nu).energy;
  const double stress = young(nu) * strain, whole = 0.5 * stress * strain * 8.0 * side * side * side;
  return (whole - energy) / (8.0 * (1.0 - nu * nu) * stress * stress * a * a * a / (3.0 * young(nu)));
}

// Ratio to Sneddon's energy in this cube, whose fixed walls reduce the opening, by finite elements:
// reference/crack.csv, front 0. In a cube of 20 a it is 0.999.
double exact_for_penny(double nu) {
  return nu == 0.3 ? 0.8572 : 0.6756;
}

// Reference: Sneddon, Proc. R. Soc. A 187 (1946) 229: 8 (1 - nu^2) stress^2 a^3 / (3 E).
void expect_sneddons_energy(double per_spacing, double nu, bool scattered) {
  const double expected = exact_for_penny(nu);
  EXPECT_NEAR(released_by_penny(per_spacing, nu, scattered), expected, 0.03 * expected) << nu;
}

// Errors for nu 0.3 and 0.45: 2.5 and 2.8 % too much; 4.2 and 4.8 % with 6 spacings in a radius.
TEST(APennyShapedCrack, AmongScatteredNodesReleasesTheEnergyThatSneddonFound) {
#ifdef DIMPLE_QUICK_GROUPS_ONLY
  GTEST_SKIP() << "skipped: minutes under a sanitizer";
#endif
  expect_sneddons_energy(12.0, 0.3, true);
  if (std::getenv("DIMPLE_ALL_SCENES")) expect_sneddons_energy(12.0, 0.45, true);
}

TEST(APennyShapedCrack, InALatticeReleasesTheEnergyThatSneddonFound) {
  if (!std::getenv("DIMPLE_ALL_SCENES")) GTEST_SKIP() << "skipped: 20 s, without DIMPLE_ALL_SCENES";
  expect_sneddons_energy(20.0, 0.3, false);
}

// The released energy is too large, like that of a crack whose radius is larger in proportion to the spacing.
// For nu 0.3 the errors are 7.4, 5.4, 4.3, 2.5 and 2.3 % with 6, 8, 12, 20 and 24 spacings in a radius.
// Extrapolation from two of them: 1.1 %.
TEST(APennyShapedCrack, ActsAsOneLargerByAPartOfASpacingAndFinerOnesComeToSneddonsEnergy) {
  for (const double nu : {0.3, 0.45}) {
    std::array<double, 2> ratio;
    for (std::size_t k = 0; k < 2; ++k) {
      const double per_spacing = k == 0 ? 6.0 : 12.0;
      ratio[k] = released_by_penny(per_spacing, nu, false) / exact_for_penny(nu);
      const double larger = per_spacing * (std::cbrt(ratio[k]) - 1.0);
      EXPECT_GT(larger, 0.0) << nu << " " << per_spacing;
      EXPECT_LT(larger, 0.25) << nu << " " << per_spacing;
    }
    EXPECT_NEAR(2.0 * ratio[1] - ratio[0], 1.0, 0.02) << nu;
  }
}

constexpr std::array places_of_opening = {0.0, 0.25, 0.5, 0.75};  // from the mouth, in depths

struct Edge {
  double energy;                  // released, over thickness x stress^2 depth^2 / E'
  std::array<double, 4> opening;  // over stress x depth / E'
};

// Plane strain: a strip of 12 a (x) by 6 a (z), free at large z, with a slit at x = 0 from there. The slit
// ends midway between two rows of nodes.
Edge opened_from_the_face(int rows, double nu) {
  const double wide = 6.0 * a, h = a / (rows + 0.5), E = young(nu) / (1.0 - nu * nu), stress = E * strain;
  const int n = 6 * rows + 3;
  const LatticeBox box{{-wide, -h, 0.0}, {wide, h, wide}, {2 * n - 1, 2, n}};
  Discretisation places = even_lattice(box, cells_of(box));
  const BodySurface body = slit_block_surface(1e3 * Vec3(2.0 * wide, 2.0 * h, wide),
                                              -0.5e3 * width_of_gap * h, 1e3 * width_of_gap * h, 1e3 * a);
  places.surface = {body.vertex(), body.triangles()};
  const HeldSet plane =
      set_of(places.X, "plane", HeldSet::Hold::along, Vec3::UnitY(), [](const Vec3&) { return true; });
  const HeldSet walls = set_of(places.X, "walls", HeldSet::Hold::all, Vec3::Zero(),
                               [&](const Vec3& x) { return std::abs(x.x()) > wide - 1e-9 || x.z() < 1e-9; });
  const Points X = places.X;
  const Pulled state =
      pulled(std::move(places), {plane, walls}, strain * Vec3(1.0, 0.0, -nu / (1.0 - nu)), nu);
  const double thick = 2.0 * h, whole = 0.5 * stress * strain * 2.0 * wide * wide * thick;
  Edge edge{(whole - state.energy) / (stress * strain * a * a * thick), {}};
  // Opening of the faces, extrapolated from the two nodes on either side, at the middle of y.
  Eigen::VectorXd of_row = Eigen::VectorXd::Zero(n + 1);
  for (Index b = 0; b < X.cols(); ++b) {
    const double x = X(0, b), fraction = std::abs(x) < box.spacing().x() ? 1.5 : -0.5;
    if (std::abs(x) < 2.0 * box.spacing().x() && std::abs(X(1, b)) < 0.5 * h)
      of_row[std::lround((wide - X(2, b)) / h)] += (x > 0.0 ? fraction : -fraction) * state.u(0, b);
  }
  for (std::size_t k = 0; k < edge.opening.size(); ++k) {
    const double at = places_of_opening[k] * (rows + 0.5);
    const auto row = static_cast<Index>(at);
    edge.opening[k] = std::lerp(of_row[row], of_row[row + 1], at - std::floor(at)) / (strain * a);
  }
  return edge;
}

// Finite-element values of this strip: reference/crack.csv, front 0. In a half-plane they give 1.975 (closed
// form 1.1215^2 pi / 2 = 1.976) and 5.817 (Wigglesworth 5.816).
struct KnownEdge {
  double nu;
  Edge of;
};
constexpr std::array known_edges = {KnownEdge{0.3, {1.8347, {5.3936, 4.6785, 3.9030, 2.8494}}},
                                    KnownEdge{0.45, {1.8285, {5.3748, 4.6624, 3.8900, 2.8403}}},
                                    KnownEdge{0.499, {1.8214, {5.3524, 4.6444, 3.8758, 2.8304}}}};

// Wigglesworth, Mathematika 4 (1957) 76: the mouth opens by 5.816 stress x depth / E'. With 16.5 spacings in
// the depth the error is 1.2 to 1.5 %, and 3.0 to 3.6 % in energy. At a quarter, half and three quarters of
// the depth it is 1.7 to 2.0, 2.2 to 2.5 and 3.6 to 4.3 %. With 12.5, 8.5 and 4.5 spacings it is 1.9, 3.7 and
// 4.1 % at most at the mouth.
TEST(ACrackAtAFreeFace, OpensAsWigglesworthFound) {
  constexpr std::array within = {0.02, 0.03, 0.03, 0.05};
  for (const KnownEdge& known : known_edges) {
    const Edge edge = opened_from_the_face(16, known.nu);
    EXPECT_NEAR(edge.energy, known.of.energy, 0.04 * known.of.energy) << known.nu;
    for (std::size_t k = 0; k < within.size(); ++k)
      EXPECT_NEAR(edge.opening[k], known.of.opening[k], within[k] * known.of.opening[k])
          << known.nu << " at " << places_of_opening[k];
  }
}

}  // namespace
}  // namespace dimple
