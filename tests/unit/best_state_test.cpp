#include "solver/equilibrium/best_state.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace dimple::best_state_test {
namespace {

Nodal nodes(double value) {
  return Nodal::Constant(4, 2, value);
}
Eigen::VectorXd patches(double value) {
  return Eigen::VectorXd::Constant(3, value);
}
BestState after_a_step() {
  BestState best(nodes(0.0), patches(0.0), 1.0);
  best.take(nodes(1.0), patches(2.0), 0.5, nodes(8.0), patches(16.0));
  return best;
}

TEST(BestState, KnowsNoSetbackBeforeAStepButANumberThatIsNone) {
  BestState best(nodes(0.0), patches(0.0), 1.0);
  EXPECT_FALSE(best.is_setback(1e6));
  EXPECT_TRUE(best.is_setback(std::numeric_limits<double>::quiet_NaN()));
  Nodal u = nodes(7.0);
  Eigen::VectorXd lambda = patches(7.0);
  EXPECT_FALSE(best.step_back(u, lambda)) << "there is nothing to go back to";
  EXPECT_EQ(u, nodes(7.0));
}

TEST(BestState, TakesASetbackBackHalfAsFarEachTimeAndNotForever) {
  BestState best = after_a_step();
  EXPECT_FALSE(best.is_setback(4.9)) << "ten times worse may pass on the way";
  EXPECT_TRUE(best.is_setback(5.1));
  Nodal u;
  Eigen::VectorXd lambda;
  for (const double fraction : {0.5, 0.25, 0.125, 0.0625}) {
    ASSERT_TRUE(best.step_back(u, lambda));
    EXPECT_EQ(u, nodes(1.0 + 8.0 * fraction));
    EXPECT_EQ(lambda, patches(2.0 + 16.0 * fraction));
    EXPECT_EQ(best.caution(), 1.0 / fraction);
  }
  EXPECT_FALSE(best.step_back(u, lambda));
}

TEST(BestState, GainsByATenthAndGivesUpAfterThirtyStatesWithoutOne) {
  BestState best = after_a_step();
  EXPECT_TRUE(best.is_gain(0.44));
  EXPECT_FALSE(best.is_gain(0.46));
  for (int k = 0; k < 30; ++k) {
    EXPECT_FALSE(best.is_last_attempt()) << k;
    EXPECT_TRUE(best.may_continue()) << k;
  }
  EXPECT_TRUE(best.is_last_attempt());
  best.take(nodes(3.0), patches(3.0), 0.4, nodes(1.0), patches(1.0));
  EXPECT_TRUE(best.may_continue()) << "a gain begins the count anew";
  for (int k = 1; k < 30; ++k) ASSERT_TRUE(best.may_continue());
  EXPECT_FALSE(best.may_continue());
}

TEST(BestState, ABetterStateWithoutAStepLeavesTheLastStep) {
  BestState best = after_a_step();
  best.take(nodes(2.0), patches(2.0), 0.3);
  EXPECT_EQ(best.u(), nodes(2.0));
  EXPECT_EQ(best.residual(), 0.3);
  Nodal u;
  Eigen::VectorXd lambda;
  ASSERT_TRUE(best.step_back(u, lambda));
  EXPECT_EQ(u, nodes(6.0));
}

}  // namespace
}  // namespace dimple::best_state_test
