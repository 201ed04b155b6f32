#include "io/words.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "io/text.hpp"

namespace dimple {
namespace {

TEST(Words, AForceHasThreeDigitsAndIsInMillinewtonsBelowATenthOfANewton) {
  const auto words = force_in_words;
  EXPECT_EQ(words(1234.4), "1234 N");
  EXPECT_EQ(words(12.34), "12.3 N");
  EXPECT_EQ(words(0.5434), "0.543 N");
  EXPECT_EQ(words(0.1), "0.100 N");
  EXPECT_EQ(words(0.09996), "0.100 N");
  EXPECT_EQ(words(0.09994), "99.9 mN");
  EXPECT_EQ(words(0.0754), "75.4 mN");
  EXPECT_EQ(words(-0.00754), "-7.54 mN");
  EXPECT_EQ(words(1.234e-4), "0.123 mN");
  EXPECT_EQ(words(9.87e-5), "98.7 uN");
  EXPECT_EQ(words(4.0e-8), "40.0 nN");
  EXPECT_EQ(words(1e-14), "< 0.001 nN");
  EXPECT_EQ(words(0.0), "0 N");
  for (double force = 999.0; force > 1e-10; force *= 0.77) {
    const Written written = force_written(force);
    EXPECT_NEAR(std::stod(written.number(force)) / written.per_unit, force, 0.005001 * force)
        << written(force);
    EXPECT_EQ(written(force).find('e'), std::string::npos);
  }
}

TEST(Words, WhatIsNextToAForceIsInItsUnit) {
  const Written written = force_written(0.0052);
  EXPECT_EQ(written.number(0.0049) + " to " + written(0.0055), "4.90 to 5.50 mN");
}

TEST(Words, AVolumeIsInCubicMillimetresBelowACubicCentimetre) {
  const auto words = volume_in_words;
  EXPECT_EQ(words(3.4e6), "3400 cm3");
  EXPECT_EQ(words(86430.0), "86.4 cm3");
  EXPECT_EQ(words(1000.0), "1.00 cm3");
  EXPECT_EQ(words(999.6), "1.00 cm3");
  EXPECT_EQ(words(999.4), "999 mm3");
  EXPECT_EQ(words(100.0), "100 mm3");
  EXPECT_EQ(words(27.0), "27.0 mm3");
  EXPECT_EQ(words(0.125), "0.125 mm3");
  EXPECT_EQ(words(1e-6), "< 0.001 mm3");
}

TEST(Words, AFractionTooSmallToMatterIsSmallAndNotNothing) {
  const auto words = [](double of_hundred) { return percent(0.01 * of_hundred); };
  EXPECT_EQ(words(101.3), "101 %");
  EXPECT_EQ(words(31.26), "31.3 %");
  EXPECT_EQ(words(3.412), "3.41 %");
  EXPECT_EQ(words(-0.052), "-0.05 %");
  EXPECT_EQ(words(3.103e-7), "< 0.01 %");
  EXPECT_EQ(words(0.0099), "< 0.01 %");
  EXPECT_EQ(words(0.0), "0 %");
}

TEST(Words, AChangeHasItsSignAndNothingHasNone) {
  EXPECT_EQ(with_sign(1.26), "+1.3");
  EXPECT_EQ(with_sign(-1.26), "-1.3");
  for (const double nothing : {0.0, -0.04, 0.04, -0.0}) EXPECT_EQ(with_sign(nothing), "0.0");
}

TEST(Words, AModulusIsInKilopascalsFromTenOnward) {
  EXPECT_EQ(stress_in_words(210.0), "210 Pa");
  EXPECT_EQ(stress_in_words(231.68), "231.7 Pa");
  EXPECT_EQ(stress_in_words(12500.0), "12.5 kPa");
  EXPECT_EQ(stress_in_words(2e8), "200 MPa");
}

TEST(Words, NoNumberHasAnExponent) {
  EXPECT_EQ(plain(8.0), "8");
  EXPECT_EQ(plain(1e-5), "0.00001");
  EXPECT_EQ(plain(0.499), "0.499");
  EXPECT_EQ(plain(1234567.0), "1234567");
  EXPECT_EQ(plain(-0.0), "0");
  EXPECT_EQ(in_words(Vec3(-0.04, 1.0, -2.55)), "(0.0, 1.0, -2.5) mm");
  EXPECT_EQ(three_digits(8.0), "8.00");
  EXPECT_EQ(three_digits(12345.0), "12345");
  EXPECT_EQ(three_digits(0.9996), "1.00");
  EXPECT_EQ(three_digits(0.00012345), "0.000123");
  EXPECT_EQ(length_in_words(8.0), "8.00 mm");
  EXPECT_EQ(length_in_words(12.345), "12.35 mm");
  EXPECT_EQ(length_in_words(0.5), "0.50 mm");
  EXPECT_EQ(length_in_words(0.01234), "0.0123 mm");
  EXPECT_EQ(length_in_words(0.0), "0.00 mm");
}

TEST(Words, AShellReadsAWordOfAnyTextAsItIs) {
  EXPECT_EQ(shell_word("--opening=-5,0,25.5,10"), "--opening=-5,0,25.5,10");
  EXPECT_EQ(shell_word(""), "''");
  EXPECT_EQ(shell_word("my brain $(touch x)"), "'my brain $(touch x)'");
  EXPECT_EQ(shell_word("it's"), "'it'\\''s'");
}

}  // namespace
}  // namespace dimple
