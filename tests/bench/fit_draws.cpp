// How often `dimple fit` finds the modulus, and Ogden's exponent, that a curve was made with: by a finer
// cloud, with noise.
//
//   dimple_fit_draws FOLDER --data DIR [--draws 100]
//
// Writes fit.csv, a row for each body, depth and noise, and fit.md. A body takes a run of the finer cloud and
// one of fit's own with its band for each depth, and a dozen of the default cloud for the exponent: draws
// cost nothing.

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>

#include "apps/run/compare.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/studies/fit.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "preprocess/image/phantom.hpp"
#include "tests/helpers/draw.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr double mu = 300.0, alpha = -6.0;
constexpr int rows = 40;
constexpr Index finer = 8000;
constexpr std::array<double, 3> noises = {0.0, 0.01, 0.03};

struct Body {
  const char* name;
  fs::path image;
};

Config case_of(const Body& body, double depth_mm) {
  Config config;
  config.image.file = body.image.string();
  config.load.depth_mm = depth_mm;
  return config;
}

std::vector<double> depths_to(double depth_mm) {
  std::vector<double> depth;
  for (int k = 1; k <= rows; ++k) depth.push_back(1e-3 * depth_mm * k / rows);
  return depth;
}

// A curve of another cloud than the default one.
std::vector<double> truth_of(Config config, const std::vector<double>& depth) {
  config.cloud.nodes = finer;
  config.cloud.seed = 2;
  return forces_between(simulate({.config = config}).history.force, depth);
}

double band_of(const Result& result) {
  double share = 0.0;
  for (std::size_t k = 0; k < result.band.half.size(); ++k)
    if (const ForceSample& s = result.history.force[k]; s.depth > 0.0)
      share = std::max(share, result.band.half[k] / std::abs(s.force));
  return share;
}

// Forces of the default cloud between exponents that were run: by a cubic through the four nearest, in log
// |alpha|.
struct Exponents {
  std::vector<double> at;                   // log |alpha|, rising
  std::vector<std::vector<double>> forces;  // for 1 Pa
  std::vector<double> operator()(const std::vector<double>& numbers) const {
    const double x = std::log(std::abs(numbers[0]));
    auto k = static_cast<std::size_t>(std::lower_bound(at.begin(), at.end(), x) - at.begin());
    k = std::clamp<std::size_t>(k, 2, at.size() - 2) - 2;
    std::vector<double> result(forces[0].size(), 0.0);
    for (std::size_t i = k; i < k + 4; ++i) {
      double weight = 1.0;
      for (std::size_t j = k; j < k + 4; ++j)
        if (j != i) weight *= (x - at[j]) / (at[i] - at[j]);
      for (std::size_t r = 0; r < result.size(); ++r) result[r] += weight * forces[i][r];
    }
    return result;
  }
};

struct Tally {
  std::string csv =
      "body,depth_mm,of,truth,noise_percent,draws,mean,rms_error_percent,noise_band_percent,discretisation_"
      "band_percent,"
      "near_percent,inside_band_percent\n";
  std::string md =
      "| body | depth, mm | noise, % | draws | fitted | mean error, % | rms error, % | band: noise, % | "
      "discretisation, % | "
      "near enough, % | inside the band, % |\n|---|---:|---:|---:|---|---:|---:|---:|---:|---:|---:|\n";
};

// Draws of one curve. `near`: what counts as near enough, as a share.
void tally(Tally& to, const Body& body, double depth_mm, const std::vector<double>& depth,
           const std::vector<double>& truth, const std::vector<FitParameter>& sought, const UnitForces& model,
           double half_share, int draws) {
  const std::size_t which = sought.size();  // mu, or the number that is sought beside it
  const double true_value = which == 0 ? mu : alpha, near = which == 0 ? 0.02 : 0.10;
  Draw draw{std::mt19937_64(1)};
  for (const double noise : noises) {
    const int count = noise > 0.0 ? draws : 1;
    double mean = 0.0, squares = 0.0, by_noise = 0.0, by_cloud = 0.0;
    int is_near = 0, inside = 0;
    for (int k = 0; k < count; ++k) {
      std::vector<double> measured = truth;
      for (double& f : measured) f += noise * truth.back() * draw.gaussian();
      CurveFit fit = fit_curve(depth, measured, sought, model);
      add_discretisation(fit, depth, half_share);
      const FittedNumber& number = fit.number[which];
      const double error = number.value / true_value - 1.0;
      mean += number.value / count;
      squares += error * error / count;
      by_noise += number.noise / std::abs(number.value) / count;
      by_cloud += number.discretisation / std::abs(number.value) / count;
      is_near += std::abs(error) <= near;
      inside += std::abs(number.value - true_value) <= number.half();
    }
    const char* of = which == 0 ? "mu" : "alpha";
    to.csv +=
        fmt::format("{},{:g},{},{:g},{:g},{},{:.6g},{:.3f},{:.3f},{:.3f},{:.0f},{:.0f}\n", body.name,
                    depth_mm, of, true_value, 100.0 * noise, count, mean, 100.0 * std::sqrt(squares),
                    100.0 * by_noise, 100.0 * by_cloud, 100.0 * is_near / count, 100.0 * inside / count);
    to.md += fmt::format(
        "| {} | {:g} | {:g} | {} | {} | {:+.2f} | {:.2f} | {:.2f} | {:.2f} | {:.0f} | {:.0f} |\n", body.name,
        depth_mm, 100.0 * noise, count, of, 100.0 * (mean / true_value - 1.0), 100.0 * std::sqrt(squares),
        100.0 * by_noise, 100.0 * by_cloud, 100.0 * is_near / count, 100.0 * inside / count);
  }
}

void study_modulus(const Body& body, double depth_mm, int draws, Tally& to) {
  Config config = case_of(body, depth_mm);
  config.material.mu_Pa = mu;
  const std::vector<double> depth = depths_to(depth_mm), truth = truth_of(config, depth);
  config.cloud.nodes = nodes_for_one_run;
  const Result ours = simulate({.config = config, .band = true});
  if (!ours.band.known()) fmt::print("{}, {} mm: no band, {}\n", body.name, depth_mm, ours.band.unknown);
  std::vector<double> unit = forces_between(ours.history.force, depth);
  for (double& force : unit) force /= mu;
  tally(
      to, body, depth_mm, depth, truth, {}, [&](const auto&) { return unit; }, band_of(ours), draws);
}

void study_exponent(const Body& body, double depth_mm, int draws, Tally& to) {
  Config config = case_of(body, depth_mm);
  const auto with = [&](double exponent) {
    Config own = config;
    own.material.ogden_mu_Pa = {mu};
    own.material.ogden_alpha = {exponent};
    return own;
  };
  const std::vector<double> depth = depths_to(depth_mm), truth = truth_of(with(alpha), depth);
  Exponents exponents;
  const FitParameter sought{
      .name = "alpha", .unit = "", .start = -4.7, .least = -2.0, .most = -14.0, .logarithmic = true};
  constexpr int knots = 9;
  for (int k = 0; k < knots; ++k) {
    exponents.at.push_back(std::log(2.0) + (std::log(14.0) - std::log(2.0)) * k / (knots - 1));
    exponents.forces.push_back(
        forces_between(simulate({.config = with(-std::exp(exponents.at.back()))}).history.force, depth));
    for (double& force : exponents.forces.back()) force /= mu;
  }
  const Result ours = simulate({.config = with(alpha), .band = true});
  tally(to, body, depth_mm, depth, truth, {sought}, exponents, band_of(ours), draws);
}

}  // namespace
}  // namespace dimple

int main(int argc, char** argv) try {
  using namespace dimple;
  fs::path folder, data;
  int draws = 100;
  CLI::App app("How often a fit finds what a curve was made with");
  app.add_option("folder", folder, "for fit.csv and fit.md")->required();
  app.add_option("--data", data, "folder of the label images");
  app.add_option("--draws", draws);
  CLI11_PARSE(app, argc, argv);
  make_folder(folder);
  const fs::path images = fs::temp_directory_path() / fmt::format("dimple_fit_draws_{}", getpid());
  make_folder(images);
  write_label_image(images / "block.nrrd",
                    make_phantom({.shape = "block", .size_mm = {60, 60, 30}, .spacing_mm = 2.0}));
  write_label_image(
      images / "ellipsoid.nrrd",
      make_phantom({.shape = "cut-ellipsoid", .size_mm = {92.5, 62.5, 28.5}, .spacing_mm = 2.0}));
  const std::vector<Body> bodies = {{"block", images / "block.nrrd"},
                                    {"ellipsoid", images / "ellipsoid.nrrd"},
                                    {"heart", data / "heart_ct_1.5mm.nii.gz"}};
  Tally to;
  for (const Body& body : bodies) {
    if (!fs::exists(body.image)) {
      fmt::print("{}: left out, {} is not there\n", body.name, body.image.string());
      continue;
    }
    const auto timed = [&](const char* what, auto study) {
      try {
        const Stopwatch whole;
        study();
        fmt::print("{}, {}: {:.1f} s\n", body.name, what, whole.seconds());
      } catch (const Error& error) {
        fmt::print("{}, {}: {}\n", body.name, what, error.report.fact);
      }
      std::fflush(stdout);
    };
    timed("mu to 4 mm", [&] { study_modulus(body, 4.0, draws, to); });
    timed("mu to 8 mm", [&] { study_modulus(body, 8.0, draws, to); });
    timed("alpha to 5 mm", [&] { study_exponent(body, 5.0, draws, to); });
    write_file(folder / "fit.csv", to.csv);
    write_file(folder / "fit.md", to.md);
  }
  fs::remove_all(images);
  fmt::print("{}", to.md);
} catch (const dimple::Error& error) {
  fmt::print(stderr, "{}\n{}\n", error.report.fact, error.report.remedy);
  return static_cast<int>(error.code);
}
