// Energy released by a cut: difference of stored energies of bodies with slits of two lengths, held alike,
// against closed forms.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "solver/equilibrium/relax.hpp"
#include "solver/system.hpp"
#include "tests/helpers/shapes.hpp"
#include "tests/verification/even_lattice.hpp"

namespace dimple {
namespace {

constexpr double mu = 1000.0, nu = 0.499;
const Vec3 strip(20e-3, 2e-3, 80e-3);  // distance of grips, thickness, width [m]

// Strip on a lattice, gripped at both ends of x. Midway a slit goes through all y, from the top to `depth`.
Model slit_strip(double depth) {
  const Vec3 lower(-0.5 * strip.x(), -0.5 * strip.y(), 0.0);
  Discretisation places = even_lattice({lower, lower + strip, {19, 2, 76}}, {36, 4, 140});
  places.spacing.setConstant(strip.x() / 19);
  for (Index a = 0; a < places.X.cols(); ++a) {
    if (places.X(0, a) < lower.x() + 1e-9) places.base.push_back(a);
    if (places.X(0, a) > -lower.x() - 1e-9) places.bonded_patch.push_back(a);
  }
  places.tool.approach = Vec3::UnitX();
  const BodySurface surface = slit_block_surface(1e3 * strip, -0.05, 0.1, 1e3 * depth);
  places.surface = {surface.vertex(), surface.triangles()};
  Eigen::VectorXi tissue = places.label;
  return make_model(std::move(places), converging, std::move(tissue), {1000.0});
}

constexpr std::array stretches = {1.2, 1.5, 2.0};

// Energies [J] at these stretches of the distance between the grips.
std::array<double, 3> energies_of(double depth) {
  const Model model = slit_strip(depth);
  const ForceSystem tissue(model, {{neo_hookean(mu, nu, 1000.0)}, model.tissue});
  const std::unique_ptr<System> system = make_system(tissue, model, Contact::bonded, {});
  const Relaxation relax(*system);
  EquilibriumState state = system->step_start();
  Nodal f = state.u;
  std::array<double, 3> energy{};
  double now = 1.0;
  for (std::size_t k = 0; k < stretches.size(); ++k) {
    while (now < stretches[k] - 1e-9) {
      const double next = std::min(now + 0.15, stretches[k]);
      state.u *= (next - 1.0) / std::max(now - 1.0, 1e-9);  // zero at first
      system->set({.depth = (next - 1.0) * strip.x()}, state.u);
      EXPECT_TRUE(relax.from_near(state.u, state.lambda, f, {}).converged) << next;
      now = next;
    }
    energy[k] = system->stored_energy(state.u).tissue;
  }
  return energy;
}

// A strip much wider than the distance of its grips, in pure shear (its thickness contracts, its width does
// not): a longer slit unloads more of it in proportion. Rivlin and Thomas, J. Polym. Sci. 10 (1953) 291: G =
// H0 W, W = mu/2 (l^2 + l^-2 - 2).
TEST(ACutReleases, OfAPureShearStripTheEnergyThatItsHeightHolds) {
  constexpr double shorter = 30e-3, longer = 45e-3;
  const auto before = energies_of(shorter), after = energies_of(longer);
  for (std::size_t k = 0; k < stretches.size(); ++k) {
    const double l = stretches[k], G = (before[k] - after[k]) / ((longer - shorter) * strip.y()),
                 expected = strip.x() * 0.5 * mu * (l * l + 1.0 / (l * l) - 2.0);
    EXPECT_NEAR(G, expected, 0.03 * expected) << l;
  }
}

}  // namespace
}  // namespace dimple
