#include "solver/equilibrium/contact_coupling.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/helpers/block.hpp"

namespace dimple::contact_coupling_test {
namespace {

// A sphere above the block with its tip at first contact, `deeper` [m] along the press direction.
RigidBody sphere(const Model& model, double deeper, double friction = 0.0) {
  RigidBody indenter;
  indenter.shape = sphere_shape(10e-3);  // over several of the nodes, which are 3.3 mm apart
  indenter.surface = contact_surface(model, 9e-3);
  indenter.pose = first_contact(indenter.shape, model.tool, indenter.surface);
  indenter.pose.tip += deeper * indenter.pose.points_at;
  indenter.friction = friction;
  return indenter;
}

// The undeformed block on its base, with one rigid contact.
struct InContact {
  const ForceSystem forces;
  System body;
  LaplacePreconditioner laplace;
  ContactCoupling contact;
  Nodal u, f;
  Eigen::VectorXd lambda;

  static std::vector<std::unique_ptr<RigidContact>> only(RigidBody indenter) {
    std::vector<std::unique_ptr<RigidContact>> rigid;
    rigid.push_back(std::make_unique<RigidContact>(std::move(indenter)));
    return rigid;
  }
  InContact(const Model& model, RigidBody indenter)
      : forces(model, neo_hookean(210.0, 0.49, 1000.0)),
        body(forces, model, Constraints(model.node_count(), {{.name = base_set, .node = model.base}}), {},
             only(std::move(indenter))),
        laplace(body),
        contact(body, laplace),
        u(Nodal::Zero(4, model.node_count())),
        f(u),
        lambda(body.step_start().lambda) {
    EXPECT_TRUE(laplace.factorise());
    evaluate(0.0);
  }
  void evaluate(double depth) {
    body.set({.depth = depth});
    body.force_at(u, lambda, f);
    contact.extend();
  }
  ContactTerm& term() { return *body.contacts().front().term; }
  Eigen::VectorXd change(const Nodal& du, Nodal& r) {
    Eigen::VectorXd all(body.contact_unknowns());
    contact.apply(1.0, du, r, all);
    return all;
  }
};

TEST(ContactCoupling, KnowsHowFarAForceAtOneSampleMovesAnother) {
  const Model model = testing_bodies::averaged_block();
  InContact in(model, sphere(model, 0.0));
  const Eigen::MatrixXd& C = in.contact.compliance();
  ASSERT_EQ(C.rows(), in.body.tool_contact()->count()) << "all samples of a measured tool are active";
  EXPECT_EQ(C, Eigen::MatrixXd(C.transpose()));
  const Eigen::VectorXd x = Eigen::VectorXd::NullaryExpr(
      C.rows(), [](Index k) { return std::sin(1.0 + 2.3 * static_cast<double>(k)); });
  EXPECT_GT(x.dot(C * x), 0.0);
  EXPECT_LE(C.maxCoeff(), 1.001 * C.diagonal().maxCoeff());

  const auto& [rows, weight] = in.term().moves();
  const Index s = 0, t = C.rows() - 1;
  Nodal force = Nodal::Zero(4, model.node_count()), moved = force;
  for (int k = rows.offset[s]; k < rows.offset[s + 1]; ++k) force(1, rows.member[k]) += weight[k];
  in.laplace.apply(force, moved);
  double distance = 0.0;
  for (int k = rows.offset[t]; k < rows.offset[t + 1]; ++k) distance += weight[k] * moved(1, rows.member[k]);
  EXPECT_NEAR(distance, C(t, s), 1e-3 * C(s, s));
  in.contact.forget();
  EXPECT_TRUE(in.contact.empty());
}

TEST(ContactCoupling, IsNothingWhereNothingIsInContact) {
  const Model model = testing_bodies::averaged_block();
  RigidBody wall = sphere(model, -10e-3);
  wall.motion = Vec3::Zero().eval();
  InContact in(model, wall);
  EXPECT_TRUE(in.contact.empty());
  const Nodal before = testing_bodies::random_displacement(model, 1.0);
  Nodal r = before;
  EXPECT_TRUE(in.change(before, r).isZero(0.0));
  EXPECT_EQ(r, before);
  EXPECT_EQ(in.contact.residual_with_contact(0.3, 1.0, 1e-4), 0.3);
  EXPECT_TRUE(in.contact.scale().isOnes(0.0));
}

TEST(ContactCoupling, GrowsByTheSamplesOfAWallThatPenetrate) {
  const Model model = testing_bodies::averaged_block();
  RigidBody wall = sphere(model, 0.8e-3);
  wall.motion = wall.pose.points_at;
  InContact in(model, wall);
  const auto penetrating = [&] { return (in.term().gaps().array() < 0.0).count(); };
  const Index few = penetrating();
  ASSERT_GT(few, 0);
  ASSERT_EQ(in.contact.compliance().rows(), few);
  const Eigen::MatrixXd first = in.contact.compliance();
  in.evaluate(2.2e-3);
  ASSERT_GT(penetrating(), few);
  const Eigen::MatrixXd& C = in.contact.compliance();
  EXPECT_EQ(C.rows(), penetrating());
  EXPECT_EQ(Eigen::MatrixXd(C.topLeftCorner(few, few)), first) << "what is there stays as it is";
  EXPECT_EQ(C, Eigen::MatrixXd(C.transpose()));
  in.evaluate(-10e-3);
  EXPECT_EQ(in.contact.compliance().rows(), static_cast<Index>(in.body.active().size()))
      << "what was in contact stays active";
}

TEST(ContactCoupling, ClosesGapsWithForcesThatDoNotPull) {
  const Model model = testing_bodies::averaged_block();
  InContact in(model, sphere(model, 0.0));
  const double depth = 1e-3;
  in.evaluate(depth);
  EXPECT_GT(in.contact.contact_violation(), 1.0);
  EXPECT_EQ(in.contact.residual_with_contact(0.0, 0.0, 1e-4),
            std::max(1.0, 1e-4 * in.contact.contact_violation()))
      << "all of the force is missing";
  const Nodal du = Nodal::Zero(4, model.node_count());
  Nodal r = du, spread = du;
  const Eigen::VectorXd force = in.change(du, r);
  EXPECT_GE(force.minCoeff(), 0.0);
  EXPECT_GT(force.maxCoeff(), 0.0);
  const Eigen::MatrixXd& C = in.contact.compliance();
  const Points& n = in.term().normals();
  const Eigen::VectorXd gap = in.term().gaps() + C.cwiseProduct(n.transpose() * n) * force;
  EXPECT_GT(gap.minCoeff(), -1e-5 * depth);
  for (Index s = 0; s < gap.size(); ++s) {
    if (force[s] > 0.0) {
      EXPECT_NEAR(gap[s], 0.0, 1e-5 * depth) << s;
    }
  }
  in.term().spread(force, spread);
  EXPECT_EQ(r, spread);
}

TEST(ContactCoupling, KeepsFrictionWithinCoulombsCone) {
  const Model model = testing_bodies::averaged_block();
  InContact in(model, sphere(model, 0.0, 0.3));
  Nodal r = Nodal::Zero(4, model.node_count()), du = r;
  in.evaluate(1e-3);
  const Index patches = model.patches.count(), count = in.term().count();
  in.lambda.tail(in.body.contact_unknowns()) = in.change(du, r);
  EXPECT_TRUE(in.lambda.tail(3 * count).isZero(0.0)) << "in the first step all slide freely";
  EXPECT_EQ(in.lambda.size(), patches + 4 * count);
  in.evaluate(1e-3);
  in.body.accept_step(in.u);
  in.evaluate(1.2e-3);
  du.row(0).setConstant(1e-4);
  const RigidContact& tool = *in.body.tool_contact();
  const Eigen::VectorXd change = in.change(du, r);
  double largest = 0.0;
  for (Index s = 0; s < count; ++s) {
    const Vec3 friction = tool.friction_forces().col(s) + change.segment<3>(count + 3 * s);
    const double bound = tool.bound(s, tool.forces()[s] + change[s]);
    EXPECT_LE(friction.norm(), bound * (1.0 + 1e-9) + 1e-15) << s;
    EXPECT_LE(std::abs(friction.dot(tool.normals().col(s))), 1e-9 * friction.norm() + 1e-15) << s;
    largest = std::max(largest, friction.norm());
  }
  EXPECT_GT(largest, 0.0);
}

}  // namespace
}  // namespace dimple::contact_coupling_test
