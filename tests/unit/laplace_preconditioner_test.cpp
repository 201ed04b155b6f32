#include "solver/equilibrium/laplace_preconditioner.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "solver/equilibrium/mixed_constants.hpp"
#include "tests/helpers/block.hpp"

namespace dimple::laplace_preconditioner_test {
namespace {

using testing_bodies::affine;
using testing_bodies::averaged_block;
using testing_bodies::random_displacement;

const Material tissue = neo_hookean(210.0, 0.49, 1000.0);

double product(const Nodal& a, const Nodal& b) {
  return a.cwiseProduct(b).sum();
}

void expect_symmetric_positive(LaplacePreconditioner& laplace, const Model& model) {
  const Nodal a = random_displacement(model, 1.0, 3), b = random_displacement(model, 1.0, 4);
  Nodal of_a = a, of_b = b;
  laplace.apply(a, of_a);
  laplace.apply(b, of_b);
  EXPECT_NEAR(product(b, of_a), product(a, of_b), 1e-4 * b.norm() * of_a.norm());
  EXPECT_GT(product(a, of_a), 0.0);
  EXPECT_GT(product(b, of_b), 0.0);
}

TEST(LaplacePreconditioner, SolvesItsOwnMatrixWhereOneLevelIsEnough) {
  const Model model = averaged_block(4);
  ASSERT_LT(model.node_count(), 300);
  const ForceSystem forces(model, tissue);
  System body(forces, model, make_constraints(model, Contact::bonded));
  LaplacePreconditioner laplace(body);
  EXPECT_FALSE(laplace.is_factorised());
  ASSERT_TRUE(laplace.factorise());
  EXPECT_TRUE(laplace.is_factorised());
  Nodal z = random_displacement(model, 1.0), r = z, solved = z;
  for (Index a = 0; a < z.cols(); ++a) z.col(a) = body.held().project(a, z.col(a));
  laplace.multiply_undeformed(z, r);
  r += mixed_constants.diagonal_of_held * z * laplace.weights().asDiagonal();
  laplace.apply(r, solved);
  EXPECT_LT((solved - z).norm(), 1e-3 * z.norm());  // of single precision
}

TEST(LaplacePreconditioner, IsSymmetricAndLeavesHeldNodesInPlace) {
  const Model model = averaged_block();
  const ForceSystem forces(model, tissue);
  for (const Contact contact : {Contact::bonded, Contact::frictionless}) {
    System body(forces, model, make_constraints(model, contact));
    LaplacePreconditioner laplace(body);
    ASSERT_TRUE(laplace.factorise());
    expect_symmetric_positive(laplace, model);
    const Nodal r = random_displacement(model, 1.0);
    Nodal z = r;
    laplace.apply(r, z);
    for (Index a = 0; a < z.cols(); ++a)
      EXPECT_LT((z.col(a) - body.held().project(a, z.col(a))).norm(), 1e-12 * z.norm()) << a;
  }
}

// For u = X, |grad u|^2 = 3: the stated multiple of mu/2 |grad u|^2 x volume.
TEST(LaplacePreconditioner, HasTheStatedEnergyOfALinearField) {
  const Model model = averaged_block();
  const ForceSystem forces(model, tissue);
  System body(forces, model, make_constraints(model, Contact::bonded));
  const LaplacePreconditioner laplace(body);
  const Nodal u = to_nodal(model.X);
  Nodal pull;
  laplace.multiply_undeformed(u, pull);
  const double energy = 1.5 * forces.shear_modulus(0) * model.volume.sum();
  EXPECT_NEAR(product(u, pull), mixed_constants.laplacian_stiffness * energy, 1e-9 * energy);
  EXPECT_NEAR(laplace.strain_between(Nodal::Zero(4, u.cols()), 0.1 * u), 0.1, 1e-12);
}

TEST(LaplacePreconditioner, IsAsMuchStifferAsTheLawUntilItIsRelaxed) {
  const Model model = averaged_block();
  const ForceSystem forces(model, tissue);
  System body(forces, model, make_constraints(model, Contact::bonded));
  LaplacePreconditioner laplace(body);
  ASSERT_TRUE(laplace.factorise());
  const Eigen::VectorXd undeformed = laplace.weights();
  laplace.stiffen(Nodal::Zero(4, model.node_count()));
  EXPECT_LT((laplace.weights() - undeformed).norm(), 1e-6 * undeformed.norm());
  laplace.stiffen(affine(model, Vec3(0.4, 1.0, 1.0).asDiagonal()));
  EXPECT_GT((laplace.weights() - 1.2 * undeformed).minCoeff(), 0.0);
  EXPECT_LE((laplace.weights() - mixed_constants.largest_stiffening * undeformed).maxCoeff(), 0.0);
  laplace.relax();
  EXPECT_EQ(laplace.weights(), undeformed);
  EXPECT_FALSE(laplace.is_factorised()) << "its inverses are those of the stiffer matrix";
}

// A term that resists along x alone, between neighbours as much as at each node.
class Fibres : public ForceTerm {
 public:
  explicit Fibres(double stiffness) : stiffness_(stiffness) {}
  void add_force(const Nodal&, const Instant&, Nodal&) override {}
  double energy(const Nodal&, const Instant&) override { return 0.0; }
  void add_stiffness_bound(StiffnessBound& bound) const override {
    const auto nodes = static_cast<int>(bound.node.size());
    for (int a = 1; a < nodes; ++a) bound.directed.push_back({a, a - 1, stiffness_});
  }
  void add_node_stiffness(const Nodal&, NodeStiffness& stiffness) const override {
    stiffness.row(0).array() += 2.0 * stiffness_;
  }

 private:
  double stiffness_;
};

TEST(LaplacePreconditioner, IsSoftWhereATermResistsInOneDirectionAlone) {
  const Model model = averaged_block();
  const ForceSystem forces(model, tissue);
  ForceTerms terms;
  terms.push_back(std::make_unique<Fibres>(100.0));
  System body(forces, model, make_constraints(model, Contact::bonded), std::move(terms));
  LaplacePreconditioner laplace(body);
  ASSERT_TRUE(laplace.factorise());
  laplace.find_soft_part(Nodal::Zero(4, model.node_count()));
  ASSERT_TRUE(laplace.has_soft_part());
  const Eigen::VectorXd softest = laplace.softest_part();
  EXPECT_LT((softest.array() - 1.0).abs().maxCoeff(), 1e-12) << "across x nothing is taken away";
  expect_symmetric_positive(laplace, model);
  // A force on one node moves it further across the fibres than along them.
  const Index a = model.node_count() / 2;
  ASSERT_TRUE(body.held().is_free(a));
  Nodal force = Nodal::Zero(4, model.node_count()), along = force, across = force;
  force(0, a) = 1.0;
  laplace.apply(force, along);
  force(0, a) = 0.0;
  force(1, a) = 1.0;
  laplace.apply(force, across);
  EXPECT_GT(across(1, a), 1.5 * along(0, a));
}

}  // namespace
}  // namespace dimple::laplace_preconditioner_test
