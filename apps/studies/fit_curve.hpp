#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace dimple {

/// A number of the material that is looked for beside its modulus, from `least` to `most`. Of one sign where
/// it is logarithmic: then its steps are shares of itself.
struct FitParameter {
  std::string name, unit;
  double start = 0.0, least = 0.0, most = 0.0;
  bool logarithmic = false;
  bool is_place = false;  ///< on an axis, whose zero means nothing: its band is wide beside the limits alone
};

/// Forces [N] of the model at the depths of a measured curve, with a modulus of 1 Pa: in equilibrium they
/// grow with it. The other numbers are given. Throws SolveError where there is no equilibrium.
using UnitForces = std::function<std::vector<double>(const std::vector<double>& numbers)>;

/// A number with its error: half the width of its 95 % band, in its own unit.
struct FittedNumber {
  std::string name, unit;
  double value = 0.0;
  double noise = 0.0;           ///< by what the residuals scatter; infinite: the curve does not tell
  double discretisation = 0.0;  ///< by the band of the model's force; 0 where that is not known
  double by_tilt = 0.0;  ///< where there are several: what a tilt of the forces from +1 % to -1 % changes
  double earlier = std::numeric_limits<double>::quiet_NaN();  ///< see add_first_touch(); nothing: not finite
  double later = std::numeric_limits<double>::quiet_NaN();
  double scale = 0.0;      ///< where it is a place, how far the search for it goes
  bool at_limit = false;   ///< of the search
  bool determined = true;  ///< false: see settle()
  double half() const { return noise + discretisation; }
};

struct CurveFit {
  std::vector<FittedNumber> number;  ///< the modulus [Pa], then those that were sought
  std::vector<double> force;         ///< of the model with them [N]
  double sum2 = 0.0;                 ///< of the residuals [N^2]
  double rms = 0.0;                  ///< of the residuals [N]
  double memory = 0.0;  ///< correlation of each residual with the next; above 0 where it is no white noise
  double least_worse =
      0.0;  ///< by how much another fit's sum2 must be larger to be worse beyond the noise [N^2]
  Eigen::MatrixXd inverse;  ///< [numbers x rows] how much the numbers change with each measured force [1/N]
  int runs = 0;             ///< of the model
  bool converged = true;    ///< false: the runs were used up
};

/// Least squares between a measured curve and the model's, all rows alike.
///
/// The modulus is  sum(m f) / sum(f f)  for whatever the other numbers are (variable projection), so that
/// only those are searched, by Levenberg and Marquardt's method (Eigen's port of MINPACK) within their
/// limits, with derivatives by differences, in at most `most_runs` runs.
///
/// The noise is told from the residuals with n - p degrees of freedom, by the linearised covariance of least
/// squares and the 95 % quantile of Student's t. Where residuals remember the one before (correlation r above
/// 2 / sqrt(n)), the covariance is that of n (1 - r) / (1 + r) rows.
///
/// Throws InputError: fewer rows than numbers and one, or no positive modulus fits; SolveError: no
/// equilibrium at the start.
CurveFit fit_curve(const std::vector<double>& depth, const std::vector<double>& measured,
                   const std::vector<FitParameter>& sought, const UnitForces& unit_forces,
                   int most_runs = 24);

/// What the band of the model's force, `half_share` of it to both sides, does to the numbers: once for all
/// depths alike, and for several numbers once more as a tilt, from one side of the band at the beginning to
/// the other at the end. A modulus alone lies between mu / (1 + h) and mu / (1 - h).
void add_discretisation(CurveFit& fit, const std::vector<double>& depth, double half_share);

/// What the numbers would be, had the tool first touched off_first_touch() before and after where the curve's
/// depth begins: `earlier` and `later` are the forces [N] of the model with the numbers found, at depths that
/// are larger and smaller by that. A modulus alone is fitted anew, several numbers follow by their
/// derivatives.
void add_first_touch(CurveFit& fit, const std::vector<double>& measured, const std::vector<double>& earlier,
                     const std::vector<double>& later);
/// [m] A tenth of a millimetre, of a curve that is shallower than four of these a quarter of its depth.
double off_first_touch(double depth);

/// Half the width of the model's band as a share of the force, as a modulus alone feels it: least squares
/// weighs each row by the square of its force.
double weighted_share(const std::vector<double>& share, const std::vector<double>& force);

/// Which numbers the curve determines: not those whose band is wider than themselves, or would be by a tilt
/// of the forces of 1 %, by which clouds may differ, where the discretisation's part is not known; nor those
/// at a limit of the search. What is said of each of the others.
std::vector<std::string> settle(CurveFit& fit, bool discretisation_known);

/// The worse fit is not worse beyond the noise: the curve does not choose between the two.
bool alike(const CurveFit& better, const CurveFit& worse);

/// How far from the zero of a curve's depth the first touch is looked for [m].
double farthest_first_touch(double depth);

}  // namespace dimple
