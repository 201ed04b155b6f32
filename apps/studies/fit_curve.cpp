#include "apps/studies/fit_curve.hpp"

#include <fmt/format.h>

#include <Eigen/SVD>
#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <map>
#include <unsupported/Eigen/NonLinearOptimization>

#include "io/digits.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double least_modulus = 1e-3, most_modulus = 1e12;  // [Pa]
constexpr double infinite = std::numeric_limits<double>::infinity();

VectorXd vector_of(const std::vector<double>& list) {
  return Eigen::Map<const VectorXd>(list.data(), static_cast<Index>(list.size()));
}

// Fraction of the range between a number's limits: the search covers all real x and never exceeds them.
double fraction_of(double x) {
  return 1.0 / (1.0 + std::exp(-x));
}
double number_at(const FitParameter& s, double x) {
  return s.logarithmic ? s.least * std::pow(s.most / s.least, fraction_of(x))
                       : s.least + (s.most - s.least) * fraction_of(x);
}
double x_of(const FitParameter& s, double number) {
  const double fraction = s.logarithmic ? std::log(number / s.least) / std::log(s.most / s.least)
                                        : (number - s.least) / (s.most - s.least);
  return std::log(fraction / (1.0 - fraction));
}

struct OutOfRuns {};

// Residuals at x and their derivatives, in the form that Eigen's search requires.
struct Projection {
  using Scalar = double;
  using InputType = VectorXd;
  using ValueType = VectorXd;
  using JacobianType = MatrixXd;
  using QRSolver = Eigen::ColPivHouseholderQR<JacobianType>;
  enum { InputsAtCompileTime = Eigen::Dynamic, ValuesAtCompileTime = Eigen::Dynamic };

  const VectorXd& measured;
  const std::vector<FitParameter>& sought;
  const UnitForces& unit_forces;
  int most_runs;
  int runs = 0;
  std::map<std::vector<double>, VectorXd> known = {};  // by x

  Index inputs() const { return static_cast<Index>(sought.size()); }
  Index values() const { return measured.size(); }

  // Step of about a hundredth of the range between the limits, or less near them, for forces accurate to
  // 1e-4.
  static constexpr double step = 0.05;

  const VectorXd& unit(const VectorXd& x) {
    const std::vector<double> key(x.data(), x.data() + x.size());
    if (const auto found = known.find(key); found != known.end()) return found->second;
    if (runs >= most_runs) throw OutOfRuns{};
    ++runs;
    std::vector<double> numbers;
    for (std::size_t k = 0; k < sought.size(); ++k) numbers.push_back(number_at(sought[k], key[k]));
    return known[key] = vector_of(unit_forces(numbers));
  }
  double modulus(const VectorXd& f) const { return measured.dot(f) / f.squaredNorm(); }
  VectorXd residual(const VectorXd& x) {
    const VectorXd& f = unit(x);
    return measured - modulus(f) * f;
  }

  int operator()(const VectorXd& x, VectorXd& r) try {
    r = residual(x);
    return 0;
  } catch (const SolveError&) {
    r = 10.0 * measured;  // no equilibrium there: the search turns back
    return 0;
  } catch (const OutOfRuns&) {
    return -1;
  }
  int df(const VectorXd& x, MatrixXd& J) try {
    const VectorXd here = residual(x);
    for (Index k = 0; k < inputs(); ++k) J.col(k) = (residual(shifted(x, k)) - here) / (toward(x, k) * step);
    return 0;
  } catch (const OutOfRuns&) {
    return -1;
  }

  // Differences point inwards, where the law is milder.
  static double toward(const VectorXd& x, Index k) { return x[k] > 0.0 ? -1.0 : 1.0; }
  static VectorXd shifted(VectorXd x, Index k) {
    x[k] += toward(x, k) * step;
    return x;
  }
};

// Forces scaled by a factor that falls linearly from 1 at the beginning to -1 at the end.
VectorXd tilted(const std::vector<double>& depth, const VectorXd& forces) {
  return (1.0 - 2.0 * vector_of(depth).array() / depth.back()).matrix().cwiseProduct(forces);
}

double student_95(double degrees) {
  return boost::math::quantile(boost::math::students_t(degrees), 0.975);
}

// Correlation of each residual with the next.
double memory_of(const VectorXd& r) {
  const double sum2 = r.squaredNorm();
  return sum2 > 0.0 ? r.head(r.size() - 1).dot(r.tail(r.size() - 1)) / sum2 : 0.0;
}

void require_more_rows(Index rows, Index numbers) {
  if (rows > numbers) return;
  throw InputError({.fact = fmt::format("the curve has {} row{} with a depth above 0, for {} number{}", rows,
                                        rows == 1 ? "" : "s", numbers, numbers == 1 ? "" : "s"),
                    .where = "--curve",
                    .why = "the quality of a fit needs one row more than unknowns",
                    .remedy = "measure at more depths, or fit fewer numbers (--of)",
                    .code = "bad-curve"});
}

// Refuses a modulus far beyond any tissue; the option of the modulus has the same upper limit.
void require_possible(double mu) {
  if (mu > least_modulus && mu < most_modulus) return;
  throw InputError(
      {.fact = fmt::format("the best modulus would be {} Pa", plain(mu, 3)),
       .where = "--curve",
       .why = mu > 0.0 ? "no tissue has that modulus" : "the forces do not grow with the depth",
       .remedy =
           "check the file: units as in its header, force positive where tissue resists, near 0 at contact",
       .code = "bad-curve"});
}

VectorXd start_of(const std::vector<FitParameter>& sought) {
  VectorXd x(static_cast<Index>(sought.size()));
  for (std::size_t k = 0; k < sought.size(); ++k) x[static_cast<Index>(k)] = x_of(sought[k], sought[k].start);
  return x;
}

// Moves x to the least squares; false if the runs did not suffice.
bool minimize(Projection& problem, VectorXd& x) {
  const auto for_derivatives = static_cast<int>(x.size());  // reserved for the derivatives at the end
  problem.most_runs -= for_derivatives;
  Eigen::LevenbergMarquardt<Projection> search(problem);
  search.parameters.factor = 1.0;  // largest first step in x
  search.parameters.xtol = search.parameters.ftol = 1e-3;
  search.parameters.maxfev = 1000;  // not the limit: runs are counted instead, and their results kept
  const auto status = search.minimize(x);
  problem.most_runs += for_derivatives;
  return status != Eigen::LevenbergMarquardtSpace::UserAsked;
}

// Derivatives of the forces by the numbers themselves: mu, then those that are sought.
MatrixXd derivatives(Projection& problem, const VectorXd& x, double mu, const VectorXd& unit) {
  MatrixXd J(problem.values(), 1 + x.size());
  J.col(0) = unit;
  for (Index k = 0; k < x.size(); ++k) {
    const FitParameter& s = problem.sought[static_cast<std::size_t>(k)];
    try {
      J.col(k + 1) = mu * (problem.unit(Projection::shifted(x, k)) - unit) /
                     (number_at(s, x[k] + Projection::toward(x, k) * Projection::step) - number_at(s, x[k]));
    } catch (const OutOfRuns&) {
      J.col(k + 1).setZero();
    }
  }
  return J;
}

struct PseudoInverse {
  MatrixXd inverse;
  bool blind = false;  // at least one of the numbers has no effect
};

PseudoInverse pseudo_inverse(const MatrixXd& J) {
  // Columns are scaled to length 1, as the numbers have different units.
  VectorXd length = J.colwise().norm();
  for (double& l : length) l = l > 0.0 ? l : 1.0;
  const Eigen::JacobiSVD<MatrixXd> svd(J * length.cwiseInverse().asDiagonal(),
                                       Eigen::ComputeThinU | Eigen::ComputeThinV);
  const VectorXd singular = svd.singularValues();
  return {.inverse = length.cwiseInverse().asDiagonal() * svd.matrixV() *
                     singular.cwiseMax(1e-300).cwiseInverse().asDiagonal() * svd.matrixU().transpose(),
          // Forces are accurate to 1e-4, so smaller derivatives by differences are zero.
          .blind = singular[J.cols() - 1] < 1e-4 * singular[0]};
}

// Variance of one row [N^2]; correlated residuals count as fewer rows.
double noise_variance(double sum2, double memory, double rows, double numbers) {
  const double variance = sum2 / (rows - numbers);
  return memory > 2.0 / std::sqrt(rows) ? variance * ((1.0 + memory) / (1.0 - memory)) : variance;
}

FittedNumber number_found(const FitParameter& s, double x) {
  FittedNumber number = {.name = s.name, .unit = s.unit, .value = number_at(s, x)};
  if (s.is_place) number.scale = s.most - s.least;
  number.at_limit = std::abs(fraction_of(x) - 0.5) > 0.48;
  return number;
}

}  // namespace

CurveFit fit_curve(const std::vector<double>& depth, const std::vector<double>& measured_N,
                   const std::vector<FitParameter>& sought, const UnitForces& unit_forces, int most_runs) {
  const auto n = static_cast<Index>(depth.size()), p = static_cast<Index>(1 + sought.size());
  require_more_rows(n, p);
  const VectorXd measured = vector_of(measured_N);
  Projection problem{
      .measured = measured, .sought = sought, .unit_forces = unit_forces, .most_runs = most_runs};
  CurveFit result;
  VectorXd x = start_of(sought);
  problem.unit(x);  // throws if there is no equilibrium at the start
  if (p > 1) result.converged = minimize(problem, x);
  const VectorXd unit = problem.unit(x);
  const double mu = problem.modulus(unit);
  require_possible(mu);
  const VectorXd model = mu * unit, r = measured - model;
  const auto [inverse, blind] = pseudo_inverse(derivatives(problem, x, mu, unit));

  result.inverse = inverse;
  result.runs = problem.runs;
  result.sum2 = r.squaredNorm();
  result.rms = std::sqrt(result.sum2 / static_cast<double>(n));
  result.memory = memory_of(r);
  const double rows = static_cast<double>(n), numbers = static_cast<double>(p);
  const double t = student_95(rows - numbers);
  const double sigma2 = noise_variance(result.sum2, result.memory, rows, numbers);
  result.least_worse = t * t * sigma2;
  const VectorXd tilt = 0.01 * tilted(depth, model);
  for (Index k = 0; k < p; ++k) {
    FittedNumber number = k == 0 ? FittedNumber{.name = "mu", .unit = "Pa", .value = mu}
                                 : number_found(sought[static_cast<std::size_t>(k - 1)], x[k - 1]);
    if (p > 1) number.by_tilt = blind ? infinite : std::abs(inverse.row(k).dot(tilt));
    number.noise = blind ? infinite : t * std::sqrt(sigma2) * inverse.row(k).norm();
    result.number.push_back(number);
  }
  result.force.assign(model.data(), model.data() + n);
  return result;
}

void add_discretisation(CurveFit& fit, const std::vector<double>& depth, double half_fraction) {
  const VectorXd along = half_fraction * vector_of(fit.force);
  const VectorXd tilt = tilted(depth, along);
  if (fit.number.size() == 1) {
    fit.number[0].discretisation =
        half_fraction < 1.0 ? fit.number[0].value * half_fraction / (1.0 - half_fraction) : infinite;
    return;
  }
  for (std::size_t k = 0; k < fit.number.size(); ++k) {
    const auto row = fit.inverse.row(static_cast<Index>(k));
    fit.number[k].discretisation = std::abs(row.dot(along)) + std::abs(row.dot(tilt));
  }
}

void add_first_contact(CurveFit& fit, const std::vector<double>& measured, const std::vector<double>& earlier,
                       const std::vector<double>& later) {
  const VectorXd m = vector_of(measured), f = vector_of(fit.force);
  const auto with = [&](std::size_t k, const VectorXd& moved) {
    if (fit.number.size() == 1) return fit.number[0].value * m.dot(moved) / moved.squaredNorm();
    return fit.number[k].value - fit.inverse.row(static_cast<Index>(k)).dot(moved - f);
  };
  for (std::size_t k = 0; k < fit.number.size(); ++k) {
    fit.number[k].earlier = with(k, vector_of(earlier));
    fit.number[k].later = with(k, vector_of(later));
  }
}

double weighted_fraction(const std::vector<double>& fraction, const std::vector<double>& force) {
  const VectorXd squares = vector_of(force).cwiseAbs2();
  return vector_of(fraction).dot(squares) / squares.sum();
}

double off_first_contact(double depth) {
  return std::min(1e-4, 0.25 * depth);
}

double farthest_first_contact(double depth) {
  return std::min(1e-3, 0.25 * depth);
}

std::vector<std::string> conclude(CurveFit& fit, bool discretisation_known) {
  constexpr const char* remedy = "a longer, deeper or less noisy one may, or fit fewer numbers (--of)";
  std::vector<std::string> words;
  for (FittedNumber& f : fit.number) {
    const double half = f.half() + (discretisation_known ? 0.0 : f.by_tilt);
    if (f.at_limit)
      words.push_back(
          fmt::format("the search for {} ran to its limit, {}: this curve does not determine it; {}", f.name,
                      plain(f.value, 3), remedy));
    else if (!(2.0 * half < (f.scale > 0.0 ? f.scale : std::abs(f.value))))
      words.push_back(fmt::format("this curve does not determine {}: its error bounds are wider than {}; {}",
                                  f.name, f.scale > 0.0 ? "the search for it" : "its value", remedy));
    else
      continue;
    f.determined = false;
  }
  return words;
}

bool alike(const CurveFit& better, const CurveFit& worse) {
  return worse.sum2 - better.sum2 < better.least_worse;
}

}  // namespace dimple
