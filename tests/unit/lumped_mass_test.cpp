#include "preprocess/nodes/lumped_mass.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/error.hpp"
#include "tests/helpers/block.hpp"
#include "tests/helpers/report.hpp"

namespace dimple {
namespace {

TEST(LumpedMass, IsOfEachPointsOwnDensity) {
  const Model model = testing_bodies::block(5);
  Eigen::VectorXd density(model.point_count());
  for (Index q = 0; q < density.size(); ++q) density[q] = model.point(2, q) < 10e-3 ? 900.0 : 1800.0;
  EXPECT_NEAR(lumped_mass(model, density).sum(), density.dot(model.volume), 1e-12);
  EXPECT_NEAR(density.dot(model.volume), 1350.0 * model.volume.sum(), 0.2 * 1350.0 * model.volume.sum());
}

TEST(LumpedMass, DividesAPointsMassEquallyAmongItsNodes) {
  Model model;
  model.scheme = horton2007;
  model.X = Points::Zero(3, 3);
  model.point = Points::Zero(3, 2);
  model.volume = Eigen::Vector2d(6.0, 2.0);
  model.support.offset.resize(3);
  model.support.offset << 0, 3, 4;
  model.support.member.resize(4);
  model.support.member << 0, 1, 2, 1;
  EXPECT_THAT(lumped_mass(model, Eigen::VectorXd::Constant(model.point_count(), 10.0)),
              testing::ElementsAre(20.0, 40.0, 20.0));
}

TEST(LumpedMass, ANodeInNoSupportIsRefusedByNumberAndPlace) {
  Model model = testing_bodies::block(5);
  model.X.conservativeResize(3, model.X.cols() + 1);
  model.X.rightCols(1) = Vec3(0.1, 0.2, 0.3);
  expect_error<ModelError>(
      [&] { lumped_mass(model, Eigen::VectorXd::Constant(model.point_count(), 1000.0)); },
      {.fact = "node " + std::to_string(model.X.cols() - 1),
       .where = "(100.00, 200.00, 300.00) mm",
       .remedy = "support.radius_factor"});
}

}  // namespace
}  // namespace dimple
