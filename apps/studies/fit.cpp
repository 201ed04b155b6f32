#include "apps/studies/fit.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/SVD>
#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <unsupported/Eigen/NonLinearOptimization>

#include "apps/run/other_tools.hpp"
#include "apps/run/results.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/unless_stopped.hpp"
#include "io/digits.hpp"
#include "io/draw/chart.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double least_modulus = 1e-3, most_modulus = 1e12;  // [Pa]
constexpr double infinite = std::numeric_limits<double>::infinity();

// --------------------------------------------------------------------------------------- least squares

VectorXd vector_of(const std::vector<double>& list) {
  return Eigen::Map<const VectorXd>(list.data(), static_cast<Index>(list.size()));
}

// The search goes over all real x; a number comes near its limits and never beyond them.
double share_of(double x) {
  return 1.0 / (1.0 + std::exp(-x));
}
double number_at(const FitParameter& s, double x) {
  return s.logarithmic ? s.least * std::pow(s.most / s.least, share_of(x))
                       : s.least + (s.most - s.least) * share_of(x);
}
double x_of(const FitParameter& s, double number) {
  const double share = s.logarithmic ? std::log(number / s.least) / std::log(s.most / s.least)
                                     : (number - s.least) / (s.most - s.least);
  return std::log(share / (1.0 - share));
}

struct OutOfRuns {};

// What Eigen's search asks: residuals at x, and how they change with it.
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

  // A hundredth of the way between the limits, or less near them; differences of forces that are known to
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
    for (Index k = 0; k < inputs(); ++k) J.col(k) = (residual(beside(x, k)) - here) / (toward(x, k) * step);
    return 0;
  } catch (const OutOfRuns&) {
    return -1;
  }

  // Differences are taken inwards, where the law is milder.
  static double toward(const VectorXd& x, Index k) { return x[k] > 0.0 ? -1.0 : 1.0; }
  static VectorXd beside(VectorXd x, Index k) {
    x[k] += toward(x, k) * step;
    return x;
  }
};

// From itself at the beginning to its opposite at the end.
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

}  // namespace

CurveFit fit_curve(const std::vector<double>& depth, const std::vector<double>& measured_N,
                   const std::vector<FitParameter>& sought, const UnitForces& unit_forces, int most_runs) {
  const auto n = static_cast<Index>(depth.size()), p = static_cast<Index>(1 + sought.size());
  if (n <= p)
    throw InputError({.fact = fmt::format("the curve has {} row{} with a depth above 0, for {} number{}", n,
                                          n == 1 ? "" : "s", p, p == 1 ? "" : "s"),
                      .where = "--curve",
                      .why = "without one row more than numbers nothing tells how well they fit",
                      .remedy = "measure at more depths, or look for fewer numbers (--of)",
                      .code = "bad-curve"});
  const VectorXd measured = vector_of(measured_N);
  Projection problem{
      .measured = measured, .sought = sought, .unit_forces = unit_forces, .most_runs = most_runs};
  CurveFit result;
  VectorXd x(p - 1);
  for (Index k = 0; k + 1 < p; ++k)
    x[k] = x_of(sought[static_cast<std::size_t>(k)], sought[static_cast<std::size_t>(k)].start);
  problem.unit(x);  // at the start there must be an equilibrium
  if (p > 1) {
    problem.most_runs -= static_cast<int>(p - 1);  // for the derivatives at the end
    Eigen::LevenbergMarquardt<Projection> search(problem);
    search.parameters.factor = 1.0;  // at most that far in x with the first step
    search.parameters.xtol = search.parameters.ftol = 1e-3;
    search.parameters.maxfev = 1000;  // runs are counted, and remembered
    const auto status = search.minimize(x);
    result.converged = status != Eigen::LevenbergMarquardtSpace::UserAsked;
    problem.most_runs += static_cast<int>(p - 1);
  }
  const VectorXd unit = problem.unit(x);
  const double mu = problem.modulus(unit);
  // Far beyond any tissue; the option of the modulus takes no more.
  if (!(mu > least_modulus && mu < most_modulus))
    throw InputError({.fact = fmt::format("the best modulus would be {} Pa", plain(mu, 3)),
                      .where = "--curve",
                      .why = mu > 0.0 ? "no tissue has that" : "the forces do not grow with the depth",
                      .remedy =
                          "look at the file: units as the columns say, force positive where tissue resists, "
                          "near 0 at contact",
                      .code = "bad-curve"});
  const VectorXd model = mu * unit, r = measured - model;
  MatrixXd J(n, p);  // of the forces, by the numbers themselves
  J.col(0) = unit;
  for (Index k = 0; k + 1 < p; ++k) {
    const FitParameter& s = sought[static_cast<std::size_t>(k)];
    try {
      J.col(k + 1) = mu * (problem.unit(Projection::beside(x, k)) - unit) /
                     (number_at(s, x[k] + Projection::toward(x, k) * Projection::step) - number_at(s, x[k]));
    } catch (const OutOfRuns&) {
      J.col(k + 1).setZero();
    }
  }
  // Columns of length 1, or numbers in pascals and seconds would be compared.
  VectorXd length = J.colwise().norm();
  for (double& l : length) l = l > 0.0 ? l : 1.0;
  const Eigen::JacobiSVD<MatrixXd> svd(J * length.cwiseInverse().asDiagonal(),
                                       Eigen::ComputeThinU | Eigen::ComputeThinV);
  const VectorXd singular = svd.singularValues();
  // Derivatives by differences of forces that are good to 1e-4: what is below is none.
  const bool blind = singular[p - 1] < 1e-4 * singular[0];
  result.inverse = length.cwiseInverse().asDiagonal() * svd.matrixV() *
                   singular.cwiseMax(1e-300).cwiseInverse().asDiagonal() * svd.matrixU().transpose();

  result.runs = problem.runs;
  result.sum2 = r.squaredNorm();
  result.rms = std::sqrt(result.sum2 / static_cast<double>(n));
  result.memory = memory_of(r);
  const double rows = static_cast<double>(n);
  double sigma2 = result.sum2 / (rows - static_cast<double>(p));
  if (result.memory > 2.0 / std::sqrt(rows)) sigma2 *= (1.0 + result.memory) / (1.0 - result.memory);
  const double t = student_95(rows - static_cast<double>(p));
  result.least_worse = t * t * sigma2;
  const VectorXd tilt = 0.01 * tilted(depth, model);
  for (Index k = 0; k < p; ++k) {
    FittedNumber number{.name = "mu", .unit = "Pa", .value = mu};
    if (k > 0) {
      const FitParameter& s = sought[static_cast<std::size_t>(k - 1)];
      number = {.name = s.name, .unit = s.unit, .value = number_at(s, x[k - 1])};
      if (s.is_place) number.scale = s.most - s.least;
      number.at_limit = std::abs(share_of(x[k - 1]) - 0.5) > 0.48;
    }
    if (p > 1) number.by_tilt = blind ? infinite : std::abs(result.inverse.row(k).dot(tilt));
    number.noise = blind ? infinite : t * std::sqrt(sigma2) * result.inverse.row(k).norm();
    result.number.push_back(number);
  }
  result.force.assign(model.data(), model.data() + n);
  return result;
}

void add_discretisation(CurveFit& fit, const std::vector<double>& depth, double half_share) {
  const VectorXd along = half_share * vector_of(fit.force);
  const VectorXd tilt = tilted(depth, along);
  if (fit.number.size() == 1) {
    fit.number[0].discretisation =
        half_share < 1.0 ? fit.number[0].value * half_share / (1.0 - half_share) : infinite;
    return;
  }
  for (std::size_t k = 0; k < fit.number.size(); ++k) {
    const auto row = fit.inverse.row(static_cast<Index>(k));
    fit.number[k].discretisation = std::abs(row.dot(along)) + std::abs(row.dot(tilt));
  }
}

void add_first_touch(CurveFit& fit, const std::vector<double>& measured, const std::vector<double>& earlier,
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

double weighted_share(const std::vector<double>& share, const std::vector<double>& force) {
  const VectorXd squares = vector_of(force).cwiseAbs2();
  return vector_of(share).dot(squares) / squares.sum();
}

double off_first_touch(double depth) {
  return std::min(1e-4, 0.25 * depth);
}

double farthest_first_touch(double depth) {
  return std::min(1e-3, 0.25 * depth);
}

std::vector<std::string> settle(CurveFit& fit, bool discretisation_known) {
  constexpr const char* remedy = "a longer, deeper or less noisy one may, or look for fewer numbers (--of)";
  std::vector<std::string> words;
  for (FittedNumber& f : fit.number) {
    const double half = f.half() + (discretisation_known ? 0.0 : f.by_tilt);
    if (f.at_limit)
      words.push_back(
          fmt::format("the search for {} ran to its limit, {}: this curve does not determine it; {}", f.name,
                      plain(f.value, 3), remedy));
    else if (!(2.0 * half < (f.scale > 0.0 ? f.scale : std::abs(f.value))))
      words.push_back(fmt::format("this curve does not determine {}: its band is wider than {}; {}", f.name,
                                  f.scale > 0.0 ? "the search for it" : "its value", remedy));
    else
      continue;
    f.determined = false;
  }
  return words;
}

bool alike(const CurveFit& better, const CurveFit& worse) {
  return worse.sum2 - better.sum2 < better.least_worse;
}

// ------------------------------------------------------------------------------------------ the command

namespace {

void require_proportional(const std::string& why) {
  if (why.empty()) return;
  throw UsageError(
      {.fact = "the modulus of this case cannot be told from a force",
       .where = "dimple fit",
       .why = "it is told by a force that is proportional to it, and " + why,
       .remedy = "fit one tissue of neo-Hookean or Ogden's law in equilibrium (--time quasi-static)"});
}

// What follows from the curve is not given as well. A file of all options states everything, and is
// overruled.
void refuse_given(const Config& config, const std::vector<std::string>& keys, const std::string& what) {
  for (const std::string& key : keys)
    if (const auto source = config.source.find(key);
        source != config.source.end() && source->second.starts_with("--"))
      throw UsageError({.fact = fmt::format("{} is given, and follows from the curve", key),
                        .where = source->second,
                        .why = what,
                        .remedy = "leave it out"});
}

// Looked for in the forces of one run, as the modulus is.
constexpr const char* with_touch = "mu,touch";
bool takes_one_run(const std::string& of) {
  return of == "mu" || of == with_touch;
}

void require_long_tool(const Config& config, const MeasuredCurve& curve) {
  const std::optional<ToolShape> tool = tool_of(config);
  if (const double length = tool ? length_of_tool(*tool) : infinite; 1e-3 * config.load.depth_mm > length)
    throw InputError(
        {.fact = fmt::format("the curve goes to {}, and the tool is {} long",
                             length_in_words(1e3 * curve.depth.back()), length_in_words(1e3 * length)),
         .where = curve.name,
         .why = "what holds a tool at its upper end is not modelled",
         .remedy = "fit a shallower part of the curve, or give the tool that it was measured with",
         .code = "bad-curve"});
}

// The case that the curve belongs to, but for the numbers that are sought.
Config case_of(const Config& config, const FitOptions& options, const MeasuredCurve& curve) {
  require_proportional(why_not_proportional(config));
  require_no_goal(config, "dimple fit");
  require_no_steps(config, "dimple fit");
  require_one_tool(config, "dimple fit");
  refuse_given(config, {"load.depth_mm"}, "the run is as deep as the curve");
  refuse_given(config, {"material.mu_Pa", "material.young_Pa", "material.mu_spread_percent"},
               "the modulus is what is looked for");
  Config own = config;
  own.material.mu_spread_percent = 0.0;
  own.load.depth_mm = 1e3 * (curve.depth.back() +
                             (options.of == with_touch ? farthest_first_touch(curve.depth.back()) : 0.0));
  own.source["load.depth_mm"] = curve.name;
  require_long_tool(own, curve);
  if (!curve.time.empty()) {
    refuse_given(config, {"load.rate_mm_per_s"}, "the curve has times");
    own.load.rate_mm_per_s = 1e3 * ramp_rate(curve);
    own.source["load.rate_mm_per_s"] = curve.name;
  }
  if (takes_one_run(options.of) && config.source.count("cloud.nodes") == 0 &&
      !(config.cloud.spacing_mm > 0.0)) {
    own.cloud.nodes = nodes_for_one_run;
    own.source["cloud.nodes"] = "one run is all that it takes";
  }
  auto& m = own.material;
  if (options.of == "mu,alpha") {
    refuse_given(config, {"material.ogden_mu_Pa", "material.ogden_alpha"}, "they are what is looked for");
    m.ogden_mu_Pa = {m.mu_Pa};
  }
  if (options.of == "mu,g,tau") {
    refuse_given(config, {"material.prony_g", "material.prony_tau_s"}, "they are what is looked for");
    ramp_rate(curve);  // says that it has no times
  }
  return own;
}

Config with_numbers(Config config, const std::string& of, const std::vector<double>& numbers) {
  auto& m = config.material;
  if (of == "mu,alpha") m.ogden_alpha = {numbers[0]};
  if (of == "mu,g,tau") m.prony_g = {numbers[0]}, m.prony_tau_s = {numbers[1]};
  return config;
}

// All constants of the law, multiplied alike.
void multiply(Config& config, double factor) {
  config.material.mu_Pa *= factor;
  for (double& mu : config.material.ogden_mu_Pa) mu *= factor;
}

// What is looked for beside mu; for alpha twice, once for each sign: the energy has no alpha between.
std::vector<std::vector<FitParameter>> searches_of(const std::string& of, const MeasuredCurve& curve) {
  if (of == "mu") return {{}};
  if (of == with_touch) {
    const double far = 1e3 * farthest_first_touch(curve.depth.back());
    return {{{.name = "touch", .unit = "mm", .start = 0.0, .least = -far, .most = far, .is_place = true}}};
  }
  if (of == "mu,alpha") {
    const FitParameter positive{
        .name = "alpha", .unit = "", .start = 2.0, .least = 0.5, .most = 30.0, .logarithmic = true};
    const FitParameter negative{
        .name = "alpha", .unit = "", .start = -4.7, .least = -0.5, .most = -30.0, .logarithmic = true};
    return {{negative}, {positive}};
  }
  const double lasts = curve.depth.back() / ramp_rate(curve);
  return {{{.name = "g", .unit = "", .start = 0.5, .least = 0.01, .most = 0.99},
           {.name = "tau",
            .unit = "s",
            .start = 0.3 * lasts,
            .least = 0.01 * lasts,
            .most = 100.0 * lasts,
            .logarithmic = true}}};
}

// `auto` is decided when the modulus is known.
Result march(Config config, bool band) {
  if (config.solver.time == "auto") config.solver.time = "quasi-static";
  RunObserver observer;
  observer.march.sample = [](const ForceSample&, const History&) {
    stop_if_asked();
    return true;
  };
  Result result = simulate({.config = config, .band = band}, observer);
  if (result.history.interrupted) throw Stopped(stop_asked());
  return result;
}

void add_new(std::vector<std::string>& list, const std::vector<std::string>& more) {
  for (const std::string& line : more)
    if (std::find(list.begin(), list.end(), line) == list.end()) list.push_back(line);
}

std::string plus_minus(double half, const FittedNumber& f) {
  if (f.scale > 0.0) return fmt::format("+-{} {}", plain(half, 2), f.unit);
  return fmt::format("+-{:.1f} %", 100.0 * half / std::abs(f.value));
}

std::string with_unit(double value, const std::string& unit) {
  return plain(value, 4) + (unit.empty() ? "" : " " + unit);
}

// "mu 231 Pa, 221 to 241 (noise +-1.2 %, discretisation +-3.1 %)"
std::string in_words(const FittedNumber& f, const std::string& unknown) {
  if (!f.determined)
    return fmt::format("{} is not determined by this curve (best {})", f.name, with_unit(f.value, f.unit));
  const std::string from_to = fmt::format("{} {}, {} to {}", f.name, with_unit(f.value, f.unit),
                                          plain(f.value - f.half(), 4), plain(f.value + f.half(), 4));
  if (!unknown.empty())
    return fmt::format("{} by noise alone ({}; discretisation unknown)", from_to, plus_minus(f.noise, f));
  return fmt::format("{} (noise {}, discretisation {})", from_to, plus_minus(f.noise, f),
                     plus_minus(f.discretisation, f));
}

constexpr int most_runs_of_a_search = 24;  // and one more for the band
constexpr int most_looks_at_one_run = 200;

constexpr const char* not_in_the_band =
    "the band leaves out the base, the circle's place, the contact, the segmentation and whether the tissue "
    "follows this law";
constexpr const char* not_in_the_band_of_a_tool =
    "the band leaves out the base, the tool's place and shape, its friction, its first touch, the "
    "segmentation "
    "and whether the tissue follows this law";

Json to_json(const FittedNumber& f, bool known) {
  const auto finite = [](double x) { return std::isfinite(x) ? Json(x) : Json(); };
  return {{"value", f.value},
          {"unit", f.unit},
          {"low", finite(f.value - f.half())},
          {"high", finite(f.value + f.half())},
          {"noise_half", finite(f.noise)},
          {"discretisation_half", known ? finite(f.discretisation) : Json()},
          {"by_tilt_of_1_percent", finite(f.by_tilt)},
          {"if_touched_earlier", finite(f.earlier)},
          {"if_touched_later", finite(f.later)},
          {"determined", f.determined}};
}

std::vector<double> scaled(std::vector<double> list, double factor) {
  for (double& x : list) x *= factor;
  return list;
}

// Of the model at the curve's depths, where the tool first touches `later` [m] than these begin to count.
std::vector<double> forces_later(const Result& result, std::vector<double> depth, double later) {
  for (double& d : depth) d = std::max(0.0, d - later);
  return result.loading.touch ? forces_of_touch(result.history.force, depth)
                              : forces_between(result.history.force, depth);
}

// Of the force's band, as the fit feels it. Of the circle the largest share at any depth: the band of a
// shallower one says as much of the modulus. A tool that touches has few nodes under it at first, and hardly
// any force.
double share_of_band(const Result& result, const MeasuredCurve& curve, const CurveFit& fit) {
  if (!result.band.known()) return 0.0;
  const std::vector<ForceSample>& samples = result.history.force;
  if (result.loading.touch) {
    std::vector<double> share = halves_between(samples, result.band.half, curve.depth);
    const std::vector<double> force = forces_between(samples, curve.depth);
    for (std::size_t k = 0; k < share.size(); ++k) share[k] /= std::abs(force[k]);
    return weighted_share(share, fit.force);
  }
  double share = 0.0;
  for (std::size_t k = 0; k < samples.size(); ++k)
    if (const ForceSample& s = samples[k]; s.depth > 0.0)
      share = std::max(share, result.band.half[k] / std::abs(s.force));
  return share;
}

// "mu 217 to 248 Pa with the first touch 0.10 mm off"; nothing where it was looked for itself.
std::string first_touch_in_words(const FittedNumber& f, double off) {
  if (std::isnan(f.earlier)) return {};
  const auto [low, high] = std::minmax(f.earlier, f.later);
  return fmt::format("{} {} to {}{} with the first touch {} off", f.name, plain(low, 4), plain(high, 4),
                     f.unit.empty() ? "" : " " + f.unit, length_in_words(1e3 * off));
}

// What a formula for a half-space would make of the same curve.
struct HalfSpaceCheck {
  double mu = 0.0;         ///< [Pa]
  double thickness = 0.0;  ///< of the body under the tool, in radii of the contact at the end
};

std::optional<HalfSpaceCheck> half_space_check(const Result& result, const MeasuredCurve& curve, double touch,
                                               double nu) {
  if (!result.loading.touch || !result.origin) return std::nullopt;
  double products = 0.0, squares = 0.0;
  for (std::size_t k = 0; k < curve.depth.size(); ++k) {
    const std::optional<double> unit = half_space_force(result.loading.touch->shape, curve.depth[k] - touch);
    if (!unit) return std::nullopt;
    products += curve.force[k] * *unit;
    squares += *unit * *unit;
  }
  const Origin& origin = *result.origin;
  const BodyUnderCircle body =
      body_under_circle(origin.organ.body->surface, origin.boundary, origin.organ.options.boundary.voxel_mm);
  // E / (1 - nu^2) = 2 mu / (1 - nu)
  return HalfSpaceCheck{.mu = 0.5 * (1.0 - nu) * products / squares, .thickness = body.thickness};
}

std::string in_words(const HalfSpaceCheck& check, double mu) {
  return fmt::format(
      "check    the formula of Hertz and Sneddon for a half-space without friction gives {} from this curve, "
      "{:+.1f} "
      "%: a check and not the answer, as it leaves out the body's shape and large strain, and is too high on "
      "a "
      "thin layer; here the body is {:.3g} radii of the contact thick",
      stress_in_words(check.mu), 100.0 * (check.mu / mu - 1.0), check.thickness);
}

}  // namespace

Outcome fit(const Config& config, const FitOptions& options, const fs::path& folder,
            const std::function<void(const std::string&)>& progress) {
  if (!takes_one_run(options.of) && options.of != "mu,alpha" && options.of != "mu,g,tau")
    throw UsageError(
        {.fact = fmt::format("--of {} is not allowed", options.of),
         .where = "--of",
         .why = "a curve may tell a modulus alone, with the place of the first touch, with Ogden's exponent, "
                "or with one Prony term",
         .remedy = "give one of mu, mu,touch, mu,alpha and mu,g,tau"});
  if (options.curve == paper_word)
    throw UsageError({.fact = "the paper's values are three end values of two hemispheres, and no curve",
                      .where = "--curve",
                      .why = "they are a comparison and never tuned to",
                      .remedy = "dimple run IMAGE -o OUT --compare horton2007"});
  check_result_folder(folder);
  std::error_code ignored;
  if (fs::exists(folder / "summary.json", ignored) && !fs::exists(folder / "fit.csv", ignored) &&
      !holds_only_a_word(folder))
    throw OutputError({.fact = fmt::format("{} holds the results of a run", folder.string()),
                       .where = "-o",
                       .why = "its summary.json would be lost",
                       .remedy = "give another folder with -o"});
  std::optional<FolderLock> lock;
  if (fs::is_directory(folder)) lock.emplace(folder);
  const MeasuredCurve curve = read_measured_curve(options.curve);
  const Config own = case_of(config, options, curve);

  std::vector<std::string> warnings;
  for (const std::string* words : {&curve.left_out, &curve.averaged})
    if (!words->empty()) warnings.push_back(*words);
  if (curve.time.empty() && !own.material.prony_g.empty())
    warnings.push_back(
        fmt::format("the curve has no time_s, and the tissue relaxes: {} mm/s is taken for the speed",
                    plain(own.load.rate_mm_per_s)));
  const bool one_run = takes_one_run(options.of), band = own.accuracy.band == "on";
  int runs = 0;
  Result result;  // of the numbers that are found
  const UnitForces unit_forces = [&](const std::vector<double>& numbers) {
    const Config one = with_numbers(own, options.of, numbers);
    if (!one_run || runs == 0) {
      result = march(one, one_run && band);
      add_new(warnings, result.warnings);
      ++runs;
    }
    if (!one_run)
      progress(fmt::format("run {:>3}  {} {:.4g}", runs, options.of.substr(3), fmt::join(numbers, ", ")));
    const double touch_mm = options.of == with_touch ? numbers[0] : 0.0;
    return scaled(forces_later(result, curve.depth, 1e-3 * touch_mm), 1.0 / material_of(one).mu);
  };

  const std::vector<std::vector<FitParameter>> searches = searches_of(options.of, curve);
  std::vector<CurveFit> fits;  // the best first
  std::vector<std::string> failed;
  for (const std::vector<FitParameter>& sought : searches) try {
      fits.push_back(unless_stopped([&] {
        return fit_curve(
            curve.depth, curve.force, sought, unit_forces,
            (one_run ? most_looks_at_one_run : most_runs_of_a_search) / static_cast<int>(searches.size()));
      }));
    } catch (const SolveError& error) {
      if (searches.size() == 1 || failed.size() + 1 == searches.size()) throw;
      failed.push_back(error.report.fact);
      warnings.push_back(
          fmt::format("no fit near {} = {}: {}", sought[0].name, plain(sought[0].start), error.report.fact));
    }
  std::stable_sort(fits.begin(), fits.end(),
                   [](const CurveFit& a, const CurveFit& b) { return a.sum2 < b.sum2; });
  CurveFit& best = fits.front();
  std::vector<double> numbers;
  for (std::size_t k = 1; k < best.number.size(); ++k) numbers.push_back(best.number[k].value);
  Config found = with_numbers(own, options.of, numbers);
  if (!one_run) {
    result = march(found, band);
    add_new(warnings, result.warnings);
    ++runs;
  }
  multiply(found, best.number[0].value / material_of(found).mu);
  // Whether inertia plays a part depends on the modulus, which is known only now.
  // A tool that touches is slow where nobody has said how fast it is.
  if (config.solver.time == "auto" && !(result.loading.touch && !was_given(own, "load.rate_mm_per_s")) &&
      choose_time(result.model, {materials_of(found), result.tissues.of_point}, result.loading) !=
          TimeMode::quasi_static)
    require_proportional(
        fmt::format("with the {} that would fit, the load is so short that inertia takes part in it",
                    stress_in_words(best.number[0].value)));
  const std::string& unknown = result.band.unknown;
  add_discretisation(best, curve.depth, share_of_band(result, curve, best));
  const double uncertain = off_first_touch(curve.depth.back());
  double touch = 0.0;  // [m]
  if (options.of == with_touch) {
    touch = 1e-3 * best.number[1].value;
    found.load.depth_mm = 1e3 * (curve.depth.back() - touch);
  } else {
    const double of_model = best.number[0].value / material_of(with_numbers(own, options.of, numbers)).mu;
    add_first_touch(best, curve.force, scaled(forces_later(result, curve.depth, -uncertain), of_model),
                    scaled(forces_later(result, curve.depth, uncertain), of_model));
  }
  const std::optional<HalfSpaceCheck> check =
      half_space_check(result, curve, touch, poisson_ratio(material_of(found)));

  const auto [least, most] = std::minmax_element(curve.force.begin(), curve.force.end());
  const double largest = std::max(std::abs(*least), std::abs(*most)), off = best.rms / largest;
  if (!best.converged)
    warnings.push_back(
        fmt::format("the search was ended after {} runs: the numbers may not be the best", runs));
  if (off > 0.02 && best.memory > 2.0 / std::sqrt(static_cast<double>(curve.depth.size())))
    warnings.push_back(
        fmt::format("the residuals, {:.1f} % of the largest force (rms), are no noise: neighbours lie on one "
                    "side. The tissue follows another law, or the indentation is not counted from contact{}",
                    100.0 * off, options.of == "mu" ? " (--of mu,touch looks for that)" : ""));
  if (fits.size() > 1 && alike(best, fits[1])) {
    FittedNumber &mu = best.number[0], &alpha = best.number[1];
    const FittedNumber &mu2 = fits[1].number[0], &alpha2 = fits[1].number[1];
    warnings.push_back(
        fmt::format("{} {} with mu {} fits as well, within the noise, as {} with mu {}: this curve does not "
                    "tell its sign; "
                    "a deeper or less noisy curve may",
                    alpha.name, plain(alpha2.value, 3), stress_in_words(mu2.value), plain(alpha.value, 3),
                    stress_in_words(mu.value)));
    alpha.determined = false;
    mu.noise = std::max(mu.noise, std::abs(mu.value - mu2.value) + mu2.noise);
  }
  add_new(warnings, settle(best, unknown.empty()));

  make_folder(folder);
  if (!lock) lock.emplace(folder);
  remove_temporaries_in(folder);
  fs::remove(folder / "summary.json", ignored);  // it comes last: with it the fit is complete
  const std::vector<double> depth_mm = scaled(curve.depth, 1e3);
  std::vector<double> residual = curve.force;
  for (std::size_t k = 0; k < residual.size(); ++k) residual[k] -= best.force[k];
  write_csv(folder / "fit.csv", {.header = {"indentation_mm", "measured_N", "model_N", "residual_N"},
                                 .column = {depth_mm, curve.force, best.force, residual}});
  std::vector<std::string> words;
  for (const FittedNumber& f : best.number) words.push_back(in_words(f, unknown));
  std::vector<std::string> by_touch;
  for (const FittedNumber& f : best.number)
    if (const std::string text = first_touch_in_words(f, uncertain); !text.empty()) by_touch.push_back(text);
  words.insert(words.end(), by_touch.begin(), by_touch.end());
  const Written axis = force_written(largest);
  const double unit = axis.per_unit;
  const std::string in_unit = fmt::format("[{}]", axis.unit);
  std::vector<double> zero_and_depths = depth_mm, zero_and_forces = scaled(best.force, unit);
  zero_and_depths.insert(zero_and_depths.begin(), 0.0);
  zero_and_forces.insert(zero_and_forces.begin(), 0.0);
  const std::vector<Chart> charts = {
      {.title = fmt::format("{} fitted to {}", fs::path(config.image.file).filename().string(), curve.name),
       .subtitle = words,
       .x_label = "indentation [mm]",
       .y_label = "force " + in_unit,
       .series = {{.name = "measured", .x = depth_mm, .y = scaled(curve.force, unit), .line = false},
                  {.name = "model", .x = zero_and_depths, .y = zero_and_forces, .markers = false}}},
      {.title = "residuals",
       .subtitle = {fmt::format("measured - model; rms {:.2f} % of the largest force", 100.0 * off)},
       .x_label = "indentation [mm]",
       .y_label = "residual " + in_unit,
       .series = {{.x = depth_mm, .y = scaled(residual, unit), .line = false}}}};
  write_chart_png(folder / "fit.png", charts);
  write_chart_svg(folder / "fit.svg", charts);
  const std::map<std::string, std::vector<std::string>> keys = {
      {"mu", {"material.mu_Pa", "material.ogden_mu_Pa"}},
      {"touch", {}},
      {"alpha", {"material.ogden_alpha"}},
      {"g", {"material.prony_g"}},
      {"tau", {"material.prony_tau_s"}}};
  std::map<std::string, std::string> notes;
  for (std::size_t k = 0; k < best.number.size(); ++k)
    for (const std::string& key : keys.at(best.number[k].name)) {
      found.source[key] = fmt::format("fitted to {}", curve.name);
      notes[key] = words[k];
    }
  write_file(folder / "fitted.toml", to_toml(found, notes));

  Json summary;
  summary["image"] = config.image.file;
  summary["curve"] = options.curve.string();
  summary["curve_sha256"] = sha256_of_file(options.curve);
  summary["status"] = "finished";
  summary["version"] = DIMPLE_VERSION;
  summary["of"] = options.of;
  const FittedNumber& mu = best.number[0];
  // No number under that name that the curve does not tell.
  const auto told = [&](double x) { return mu.determined && std::isfinite(x) ? Json(x) : Json(); };
  summary["mu_Pa"] = told(mu.value);
  summary["mu_low_Pa"] = told(mu.value - mu.half());
  summary["mu_high_Pa"] = told(mu.value + mu.half());
  summary["noise_share"] = std::isfinite(mu.noise) ? Json(mu.noise / mu.value) : Json();
  summary["discretisation_share"] = unknown.empty() ? Json(mu.discretisation / mu.value) : Json();
  if (!unknown.empty()) summary["discretisation_unknown"] = unknown;
  summary["band_of"] = unknown.empty() ? "noise and discretisation" : "noise alone";
  for (const FittedNumber& f : best.number) summary["numbers"][f.name] = to_json(f, unknown.empty());
  if (options.of != with_touch) {
    summary["first_touch"] = {{"off_mm", 1e3 * uncertain},
                              {"mu_if_earlier_Pa", told(mu.earlier)},
                              {"mu_if_later_Pa", told(mu.later)}};
  }
  if (check)
    summary["half_space_check"] = {{"mu_Pa", check->mu},
                                   {"ratio", check->mu / mu.value},
                                   {"thickness_in_contact_radii", check->thickness}};
  if (result.loading.touch) summary["tool"] = own.tool.shape;
  if (result.loading.touch) summary["friction"] = own.tool.friction;
  summary["rows"] = curve.depth.size();
  summary["depth_mm"] = depth_mm.back();
  summary["nodes"] = result.model.node_count();
  summary["runs"] = runs;
  summary["residual_rms_N"] = best.rms;
  summary["residual_memory"] = best.memory;
  const char* left_out = result.loading.touch ? not_in_the_band_of_a_tool : not_in_the_band;
  summary["not_in_the_band"] = left_out;
  summary["warnings"] = warnings;
  const std::string text = as_text(summary);
  write_file(folder / "summary.json", text);
  for (const std::string& warning : warnings) progress("warning: " + warning);
  if (!unknown.empty()) {
    progress("band     discretisation unknown: " + unknown);
    for (const FittedNumber& f : best.number)
      if (f.by_tilt > 0.0 && std::isfinite(f.by_tilt))
        progress(fmt::format(
            "band     if the computed forces were 1 % too large at first and 1 % too small at the end, {} "
            "would change by {}",
            f.name, plain(f.by_tilt, 2)));
  }
  progress(fmt::format(
      "fit      {} rows to {}, {} run{} with {} nodes, residuals {:.2f} % of the largest force (rms)",
      curve.depth.size(), length_in_words(depth_mm.back()), runs, runs == 1 ? "" : "s",
      result.model.node_count(), 100.0 * off));
  if (check) progress(in_words(*check, mu.value));
  progress(fmt::format("note     {}", left_out));
  return {.summary_json = text, .headline = fmt::format("{}", fmt::join(words, "; "))};
}

}  // namespace dimple
