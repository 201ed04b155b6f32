#include "io/words.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace dimple {
namespace {

TEST(Words, ASmallForceIsInMillinewtonsOrMicronewtonsAndNeverLooksLikeNothing) {
  EXPECT_EQ(force_written(0.0754)(0.0754), "0.0754 N");
  EXPECT_EQ(force_written(0.01)(0.01), "0.0100 N");
  EXPECT_EQ(force_written(123.4)(123.4), "123.4000 N");
  EXPECT_EQ(force_written(0.0)(0.0), "0.0000 N");
  EXPECT_EQ(force_written(-0.00754)(-0.00754), "-7.54 mN");
  EXPECT_EQ(force_written(1.234e-4)(1.234e-4), "0.123 mN");
  EXPECT_EQ(force_written(9.87e-5)(9.87e-5), "98.7 uN");
  EXPECT_EQ(force_written(4.0e-8)(4.0e-8), "4e-08 N");
  EXPECT_EQ(force_written(1.234e-9)(1.234e-9), "1.23e-09 N");
  for (double force = 1.0; force > 1e-30; force *= 0.77) {
    const Written written = force_written(force);
    EXPECT_NEAR(std::stod(written.number(force)) / written.per_unit, force, 0.006 * force) << written(force);
  }
}

TEST(Words, WhatIsBesideAForceIsInItsUnit) {
  const Written written = force_written(0.0052);
  EXPECT_EQ(written.number(0.0049) + " to " + written(0.0055), "4.90 to 5.50 mN");
}

TEST(Words, ASmallVolumeIsInCubicMillimetres) {
  EXPECT_EQ(volume_written(86430.0)(86430.0), "86.43 cm3");
  EXPECT_EQ(volume_written(100.0)(100.0), "0.10 cm3");
  EXPECT_EQ(volume_written(27.0)(27.0), "27.0 mm3");
  EXPECT_EQ(volume_written(0.125)(0.125), "0.125 mm3");
  EXPECT_EQ(volume_written(1e-6)(1e-6), "1e-06 mm3");
}

}  // namespace
}  // namespace dimple
