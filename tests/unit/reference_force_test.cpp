// The product's kernel against the same energy's forces written down plainly.

#include "tests/bench/reference_force.hpp"

#include <gtest/gtest.h>

#include "solver/internal_force.hpp"
#include "tests/helpers/block.hpp"

namespace dimple {
namespace {

using namespace testing_bodies;
using Nodal = ForceSystem::Nodal;

template <class Real>
Nodal reference_force(const Model& model, const Material& material, const Nodal& u) {
  ReferenceForce<Real> reference(model, material);
  set_displacement(reference, u);
  evaluate(reference);
  return force_of(reference);
}

// Of the largest force of any node, the largest difference.
double difference(const Nodal& f, const Nodal& g) {
  return (f - g).cwiseAbs().maxCoeff() / g.cwiseAbs().maxCoeff();
}

TEST(ReferenceForce, IsTheKernelsToRounding) {
  const Model model = averaged_block();
  const Material material = neo_hookean(210.0, 0.499, 1000.0);
  const ForceSystem system(model, material);
  for (const double size : {0.1e-3, 0.5e-3, 4e-3}) {  // the last turns points inside out
    const Nodal u = random_displacement(model, size);
    Nodal f = u;
    system.internal_force(u, f);
    EXPECT_LT(difference(f, reference_force<double>(model, material, u)), 1e-11);
  }
}

TEST(ReferenceForce, IsTheKernelsInSinglePrecision) {
  const Model model = averaged_block();
  const Material material = neo_hookean(210.0, 0.499, 1000.0);
  const ForceSystem system(model, material, Precision::single_);
  const Nodal u = random_displacement(model, 0.5e-3);
  Nodal f = u;
  system.internal_force(u, f);
  EXPECT_LT(difference(f, reference_force<float>(model, material, u)), 1e-5);
  EXPECT_LT(difference(f, reference_force<double>(model, material, u)), 1e-5);
}

}  // namespace
}  // namespace dimple
