// The product's kernel compared with a plain implementation of the same energy.

#include "tests/bench/reference_force.hpp"

#include <gtest/gtest.h>

#include "solver/terms/internal_force.hpp"
#include "tests/helpers/block.hpp"

namespace dimple::reference_force_test {
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

// Largest difference, relative to the largest force of any node.
double difference(const Nodal& f, const Nodal& g) {
  return (f - g).cwiseAbs().maxCoeff() / g.cwiseAbs().maxCoeff();
}

TEST(ReferenceForce, IsTheKernelsToRounding) {
  const Model model = averaged_block();
  const Material material = neo_hookean(210.0, 0.499, 1000.0);
  const ForceSystem system(model, material);
  for (const double size : {0.1e-3, 0.5e-3, 4e-3}) {  // the last size inverts points
    const Nodal u = random_displacement(model, size);
    EXPECT_LT(difference(forces_at(system, u), reference_force<double>(model, material, u)), 1e-11);
  }
}

// Both implementations use the same weight and threshold. Without them the forces agree if the tissue is far
// from collapse. The agreement above therefore checks derivations, not two copied numbers.
TEST(ReferenceForce, IsTheKernelsWithoutItsChosenConstantsWhereStrainsAreSmall) {
  const Model model = averaged_block();
  const Material material = neo_hookean(210.0, 0.499, 1000.0);
  const ForceSystem system(model, material);
  const auto difference_without = [&](double size) {
    const Nodal u = random_displacement(model, size);
    ReferenceForce<double> reference(model, material);
    reference.beta = 0.0;
    reference.smallest_J = 1e-4;
    set_displacement(reference, u);
    evaluate(reference);
    return difference(forces_at(system, u), force_of(reference));
  };
  const double small = difference_without(1e-6), large = difference_without(4e-3);
  RecordProperty("small_strain", std::to_string(small));
  RecordProperty("collapse", std::to_string(large));
  EXPECT_LT(small, 1e-7);
  EXPECT_GT(large, 1e-3);  // there they have an effect
}

TEST(ReferenceForce, IsTheKernelsInSinglePrecision) {
  const Model model = averaged_block();
  const Material material = neo_hookean(210.0, 0.499, 1000.0);
  const ForceSystem system(model, material, Precision::single_);
  const Nodal u = random_displacement(model, 0.5e-3), f = forces_at(system, u);
  EXPECT_LT(difference(f, reference_force<float>(model, material, u)), 1e-5);
  EXPECT_LT(difference(f, reference_force<double>(model, material, u)), 1e-5);
}

}  // namespace
}  // namespace dimple::reference_force_test
