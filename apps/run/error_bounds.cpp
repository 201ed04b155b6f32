#include "apps/run/error_bounds.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "apps/run/words.hpp"

namespace dimple {
namespace {

// Linear interpolation of y at x, constant outside the range. `x_of`: rising.
double between(const std::vector<double>& x_of, const std::vector<double>& y_of, double x) {
  const auto after = static_cast<std::size_t>(std::lower_bound(x_of.begin(), x_of.end(), x) - x_of.begin());
  if (after == 0) return y_of.front();
  if (after == x_of.size()) return y_of.back();
  const double part = (x - x_of[after - 1]) / (x_of[after] - x_of[after - 1]);
  return (1.0 - part) * y_of[after - 1] + part * y_of[after];
}

// Depths of a curve above 0, and force / depth, which changes slowly.
struct Stiffness {
  std::vector<double> depth, force_by_depth;
};
Stiffness stiffness_of(const std::vector<ForceSample>& curve) {
  Stiffness result;
  for (const ForceSample& sample : curve)
    if (sample.depth > 0.0) {
      result.depth.push_back(sample.depth);
      result.force_by_depth.push_back(sample.force / sample.depth);
    }
  return result;
}

// Scatter of the force between random node sets of this size, as a part of the force.
double chance(double thousands) {
  return 0.01 * std::pow(thousands, -0.6);
}

double in_thousands(Index nodes) {
  return static_cast<double>(nodes) / 1000.0;
}

}  // namespace

double lower_bound(double force, double half, bool contacting) {
  return contacting && force >= 0.0 ? std::max(force - half, 0.0) : force - half;
}

std::vector<double> lower_bounds(const std::vector<ForceSample>& force, const ErrorBounds& error_bounds) {
  std::vector<double> low;
  if (error_bounds.known())
    for (std::size_t k = 0; k < force.size(); ++k)
      low.push_back(lower_bound(force[k].force, error_bounds.half[k], error_bounds.contacting));
  return low;
}

// Values that dimple_calibrate prints.
const double error_multiplier = 2.894, displacement_multiplier = 1.382;

double error_measure(double change, Index nodes, const ErrorLoad& load) {
  const double thousands = in_thousands(nodes),
               at_the_edge = 0.01 * 0.15 * std::pow(load.radii, 4.0) * std::pow(thousands, -0.25);
  return 0.3 * std::abs(change) + (chance(thousands) + at_the_edge) * (load.several_tissues ? 1.7 : 1.0);
}

double error_half_width(double change, Index nodes, const ErrorLoad& load) {
  return error_multiplier * error_measure(change, nodes, load);
}

double displacement_measure(double change, double depth, Index nodes) {
  return change + chance(in_thousands(nodes)) * depth;
}

double displacement_half_width(double change, double depth, Index nodes) {
  return displacement_multiplier * displacement_measure(change, depth, nodes);
}

// Fifth smallest and largest values of the scenes that dimple_calibrate --bodies lists: five scenes or more
// are as extreme. Thin scenes are left out, since their bounds do not hold.
const Covered covered_thickness{2.66, 258.0}, covered_size{5.09, 262.0}, covered_nu{0.45, 0.499};
const double covered_voxel = 2.32, covered_stiffness_ratio = 4.0;
const std::size_t covered_tissues = 2;

BodyUnderPatch body_under_patch(const BodySurface& body, const Boundary& boundary, double voxel_mm) {
  constexpr double just_inside = 0.05;  // radii
  BodyUnderPatch result{.size = std::cbrt(body.volume()) / boundary.radius,
                        .voxel = voxel_mm / boundary.radius};
  const Vec3 start = boundary.centre + just_inside * boundary.radius * boundary.approach;
  for (const double t : body.crossings(start, boundary.approach))
    if (t > 0.0) {
      result.thickness = just_inside + t / boundary.radius;
      break;
    }
  return result;
}

namespace {

// Reason why there are no bounds for a body with such a length [radii of the patch], or nothing.
std::string why_outside(const char* what, double value, const Covered& covered) {
  constexpr const char* reason = "not calibrated for {} {} {:g} radii of the contact patch (here {:.3g})";
  if (!(value >= covered.least)) return fmt::format(reason, what, "below", covered.least, value);
  return value <= covered.most ? "" : fmt::format(reason, what, "above", covered.most, value);
}

}  // namespace

std::string why_no_error_bounds(const BodyUnderPatch& body) {
  for (const std::string& why : {why_outside("a thickness", body.thickness, covered_thickness),
                                 why_outside("a body size", body.size, covered_size),
                                 why_outside("voxels", body.voxel, {0.0, covered_voxel})})
    if (!why.empty()) return why;
  return {};
}

std::string why_no_error_bounds(const std::vector<Material>& materials) {
  constexpr double rounding = 1e-9;
  double softest = materials.front().mu, stiffest = softest;
  for (const Material& material : materials) {
    if (!material.prony.empty()) return "not calibrated for viscoelastic tissue";
    const double nu = poisson_ratio(material);
    if (nu < covered_nu.least - rounding || nu > covered_nu.most + rounding)
      return fmt::format("not calibrated for nu outside {:g} to {:g}", covered_nu.least, covered_nu.most);
    softest = std::min(softest, material.mu);
    stiffest = std::max(stiffest, material.mu);
  }
  if (materials.size() > covered_tissues)
    return fmt::format("not calibrated for more than {} tissues (here {})", covered_tissues,
                       materials.size());
  if (stiffest > (covered_stiffness_ratio + rounding) * softest)
    return fmt::format("not calibrated for stiffness ratios above {:g} (here {:.3g})",
                       covered_stiffness_ratio, stiffest / softest);
  return {};
}

ErrorFloor floor_of_force(const ErrorLoad& load) {
  return [load](Index nodes) { return error_half_width(0.0, nodes, load); };
}

ErrorFloor floor_of_displacement() {
  return [](Index nodes) { return displacement_half_width(0.0, 1.0, nodes); };
}

Index expected_nodes(double requested_fraction, double facing_fraction, const ErrorFloor& floor) {
  constexpr double change = 1.1;  // expected half-width / floor, from the calibration's scenes
  Index nodes = fewest_nodes_with_error_bounds(facing_fraction);
  while (requested_fraction > 0.0 && change * floor(nodes) > requested_fraction &&
         2 * nodes <= most_nodes_for_accuracy)
    nodes *= 2;
  return nodes;
}

Index nodes_of_first_level(Index expected) {
  constexpr Index soon = 4000;
  return std::min(expected / 2, soon);
}

Index nodes_of_second_level(Index first, Index expected) {
  return std::clamp(expected, 2 * first, 4 * first);
}

Index nodes_of_next_level(Index nodes, double half, double requested) {
  constexpr double far_too_wide = 2.2;
  return nodes * (requested > 0.0 && half > far_too_wide * requested ? 4 : 2);
}

Index nodes_for_half_the_error(Index nodes, const ErrorFloor& floor) {
  Index more = nodes;
  while (floor(more) > 0.5 * floor(nodes) && more <= most_nodes_for_accuracy) more += nodes / 4 + 1;
  return more;
}

std::vector<double> half_widths(const std::vector<ForceSample>& force, Index nodes,
                                const std::vector<ForceSample>& coarse, double radius, bool several_tissues) {
  const Stiffness fine = stiffness_of(force), other = stiffness_of(coarse);
  if (fine.depth.empty() || other.depth.empty() || other.depth.back() < fine.depth.back() * (1.0 - 1e-9))
    return {};
  std::vector<double> change;  // largest so far, at the depths of the coarser curve
  for (std::size_t k = 0; k < other.depth.size(); ++k) {
    const double here =
        std::abs(between(fine.depth, fine.force_by_depth, other.depth[k]) / other.force_by_depth[k] - 1.0);
    change.push_back(k > 0 ? std::max(change.back(), here) : here);
  }
  std::vector<double> half;
  for (const ForceSample& sample : force)
    half.push_back(std::abs(sample.force) * error_half_width(between(other.depth, change, sample.depth),
                                                             nodes,
                                                             {sample.depth / radius, several_tissues}));
  return half;
}

std::vector<double> half_widths_of_steps(const std::vector<ForceSample>& force,
                                         const std::vector<ForceSample>& coarse, double shallowest,
                                         const FractionOfLargest& fraction) {
  if (force.empty() || coarse.empty() || coarse.back().t < force.back().t * (1.0 - 1e-9)) return {};
  std::vector<double> half;
  auto other = coarse.begin();
  double deepest = 0.0, largest = 0.0, change = 0.0;
  std::size_t before = 0;  // samples before the tool is deep enough
  for (const ForceSample& sample : force) {
    // A tool that has left the body is no deeper the farther it is.
    if (sample.force != 0.0) deepest = std::max(deepest, std::abs(sample.depth));
    largest = std::max(largest, std::abs(sample.force));
    while (other != coarse.end() && other->t < sample.t * (1.0 - 1e-9)) ++other;
    if (deepest < shallowest * (1.0 - 1e-9) || largest == 0.0)
      before = half.size() + 1;
    else if (other != coarse.end() && other->t <= sample.t * (1.0 + 1e-9))
      change = std::max(change, std::abs(sample.force - other->force) / largest);
    half.push_back(largest * fraction(change, deepest));
  }
  if (before == force.size()) return {};
  const double most = std::abs(force[before].force) + half[before];
  for (std::size_t k = 0; k < before; ++k)
    half[k] = std::max(std::abs(force[k].force), most - std::abs(force[k].force));
  if (force.front().force == 0.0) half.front() = 0.0;  // before any contact
  return half;
}

std::vector<double> forces_between(const std::vector<ForceSample>& curve, const std::vector<double>& depth) {
  const Stiffness ours = stiffness_of(curve);
  std::vector<double> force;
  for (const double d : depth) force.push_back(d * between(ours.depth, ours.force_by_depth, d));
  return force;
}

std::vector<double> halves_between(const std::vector<ForceSample>& curve, const std::vector<double>& half,
                                   const std::vector<double>& depth) {
  std::vector<double> depth_of, fraction, result = forces_between(curve, depth);
  for (std::size_t k = 0; k < curve.size(); ++k)
    if (curve[k].depth > 0.0 && curve[k].force != 0.0) {
      depth_of.push_back(curve[k].depth);
      fraction.push_back(half[k] / std::abs(curve[k].force));
    }
  for (std::size_t k = 0; k < depth.size(); ++k)
    result[k] = fraction.empty() ? 0.0 : std::abs(result[k]) * between(depth_of, fraction, depth[k]);
  return result;
}

}  // namespace dimple
