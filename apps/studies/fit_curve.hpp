#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace dimple {

/// Number of the material that is sought in addition to its modulus, from `least` to `most`. If logarithmic,
/// it has one sign and its steps are relative.
struct FitParameter {
  std::string name, unit;
  double start = 0.0, least = 0.0, most = 0.0;
  bool logarithmic = false;
  bool is_place = false;  ///< position with an arbitrary zero: its interval is compared with the search range
};

/// Forces [N] of the model at the depths of a measured curve, for a modulus of 1 Pa: in equilibrium they are
/// proportional to it. The other numbers are given. Throws SolveError: there is no equilibrium.
using UnitForces = std::function<std::vector<double>(const std::vector<double>& numbers)>;

/// Number with its errors: half-widths of the 95 % interval, in its own unit.
struct FittedNumber {
  std::string name, unit;
  double value = 0.0;
  double noise = 0.0;           ///< from the scatter of the residuals; infinite: not determined
  double discretisation = 0.0;  ///< from the error bounds of the model's force; 0 if unavailable
  double by_tilt = 0.0;         ///< change by a tilt of the forces from +1 % to -1 %; 0 for one number
  double earlier =
      std::numeric_limits<double>::quiet_NaN();  ///< see add_first_contact(); NaN if not computed
  double later = std::numeric_limits<double>::quiet_NaN();
  double scale = 0.0;      ///< of a position: range of its search
  bool at_limit = false;   ///< of the search
  bool determined = true;  ///< false: see conclude()
  double half() const { return noise + discretisation; }
};

struct CurveFit {
  std::vector<FittedNumber> number;  ///< the modulus [Pa], then those that were sought
  std::vector<double> force;         ///< of the model with them [N]
  double sum2 = 0.0;                 ///< of the residuals [N^2]
  double rms = 0.0;                  ///< of the residuals [N]
  double memory = 0.0;       ///< correlation of each residual with the next; above 0 if not white noise
  double least_worse = 0.0;  ///< least increase of another fit's sum2 that exceeds the noise [N^2]
  Eigen::MatrixXd inverse;   ///< [numbers x rows] derivatives of the numbers by the measured forces [1/N]
  int runs = 0;              ///< of the model
  bool converged = true;     ///< false: most_runs was reached
};

/// Least-squares fit of the model to a measured curve, with equal weights.
///
/// The modulus is  sum(m f) / sum(f f)  for any values of the other numbers (variable projection). Only those
/// are searched, within their limits, by the method of Levenberg and Marquardt (Eigen's port of MINPACK).
/// Derivatives are finite differences, and there are at most `most_runs` runs.
///
/// The noise follows from the residuals with n - p degrees of freedom. It uses the linearised covariance of
/// least squares and the 95 % quantile of Student's t. If successive residuals are correlated (r above 2 /
/// sqrt(n)), the covariance is that of n (1 - r) / (1 + r) rows.
///
/// Throws InputError: too few rows, or no positive modulus fits; SolveError: no equilibrium at the start.
CurveFit fit_curve(const std::vector<double>& depth, const std::vector<double>& measured,
                   const std::vector<FitParameter>& sought, const UnitForces& unit_forces,
                   int most_runs = 24);

/// Adds the uncertainty of the numbers from the error bounds of the model's force, +- `half_fraction` of it:
/// once for all depths alike, and for several numbers also as a tilt from one bound at the beginning to the
/// other at the end. A modulus alone is between mu / (1 + h) and mu / (1 - h).
void add_discretisation(CurveFit& fit, const std::vector<double>& depth, double half_fraction);

/// Adds the change of the numbers if first contact is off_first_contact() before or after the curve's zero.
/// `earlier` and `later`: forces [N] of the model with the fitted numbers at depths larger and smaller by
/// that. A modulus alone is fitted again; several numbers follow from their derivatives.
void add_first_contact(CurveFit& fit, const std::vector<double>& measured, const std::vector<double>& earlier,
                       const std::vector<double>& later);
/// Assumed error of first contact [m]: 0.1 mm, or a quarter of the depth for a curve shallower than 0.4 mm.
double off_first_contact(double depth);

/// Relative half-width of the model's error bounds as it affects a modulus: least squares weighs each row by
/// the square of its force.
double weighted_fraction(const std::vector<double>& fraction, const std::vector<double>& force);

/// Decides which numbers the curve determines; returns warnings about the others. A number is not determined
/// at a limit of the search, or if its interval is wider than its value; for a position, than the search
/// range. Without a known discretisation error, a tilt of the forces of 1 % is assumed, by which node sets
/// may differ.
std::vector<std::string> conclude(CurveFit& fit, bool discretisation_known);

/// True if the worse fit is not worse beyond the noise, so that the curve does not distinguish the two.
bool alike(const CurveFit& better, const CurveFit& worse);

/// Largest distance of first contact from the zero of the curve's depth in the search [m].
double farthest_first_contact(double depth);

}  // namespace dimple
