#include "apps/run/band.hpp"

#include <algorithm>
#include <cmath>

namespace dimple {
namespace {

// y at x, by a line between neighbours; before the first and after the last as there. x_of: rising.
double between(const std::vector<double>& x_of, const std::vector<double>& y_of, double x) {
  const auto after = static_cast<std::size_t>(std::lower_bound(x_of.begin(), x_of.end(), x) - x_of.begin());
  if (after == 0) return y_of.front();
  if (after == x_of.size()) return y_of.back();
  const double part = (x - x_of[after - 1]) / (x_of[after] - x_of[after - 1]);
  return (1.0 - part) * y_of[after - 1] + part * y_of[after];
}

// Depths, and forces over them, which change slowly; without the beginning, where there is neither.
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

}  // namespace

// dimple_calibrate prints them.
const double band_multiplier = 1.024, band_multiplier_deep = 1.019;

double band_measure(double change, Index nodes, double radii) {
  const double thousands = static_cast<double>(nodes) / 1000.0;
  return std::abs(change) + (is_deep(radii) ? 0.04 / std::pow(thousands, 0.25) : 0.03 / std::sqrt(thousands));
}

double band_half_width(double change, Index nodes, double radii) {
  return (is_deep(radii) ? band_multiplier_deep : band_multiplier) * band_measure(change, nodes, radii);
}

double narrowest_band(double radii) {
  return band_half_width(0.0, most_nodes_for_accuracy, radii);
}

Index expected_nodes(double wanted_share, double facing_share, double radii) {
  constexpr double change = 1.1;  // of the floor; chosen on the calibration's scenes
  Index nodes = fewest_nodes_with_band(facing_share);
  while (wanted_share > 0.0 && change * band_half_width(0.0, nodes, radii) > wanted_share &&
         2 * nodes <= most_nodes_for_accuracy)
    nodes *= 2;
  return nodes;
}

Index first_rung(Index expected) {
  constexpr Index soon = 4000;
  return std::min(expected / 2, soon);
}

Index second_rung(Index first, Index expected) {
  return std::clamp(expected, 2 * first, 4 * first);
}

Index next_rung(Index nodes, double half, double wanted) {
  constexpr double far_too_wide = 2.2;
  return nodes * (wanted > 0.0 && half > far_too_wide * wanted ? 4 : 2);
}

double nodes_for_half_the_band(double radii) {
  return std::pow(2.0, 1.0 / (is_deep(radii) ? 0.34 : 0.56));
}

std::vector<double> half_widths(const std::vector<ForceSample>& force, Index nodes,
                                const std::vector<ForceSample>& coarse, double radius) {
  const Stiffness fine = stiffness_of(force), other = stiffness_of(coarse);
  if (fine.depth.empty() || other.depth.empty() || other.depth.back() < fine.depth.back() * (1.0 - 1e-9))
    return {};
  std::vector<double> change;  // where the coarser cloud has a force: the largest until there
  for (std::size_t k = 0; k < other.depth.size(); ++k) {
    const double here =
        std::abs(between(fine.depth, fine.force_by_depth, other.depth[k]) / other.force_by_depth[k] - 1.0);
    change.push_back(k > 0 ? std::max(change.back(), here) : here);
  }
  std::vector<double> half;
  for (const ForceSample& sample : force)
    half.push_back(std::abs(sample.force) *
                   band_half_width(between(other.depth, change, sample.depth), nodes, sample.depth / radius));
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
  std::vector<double> depth_of, share, result = forces_between(curve, depth);
  for (std::size_t k = 0; k < curve.size(); ++k)
    if (curve[k].depth > 0.0 && curve[k].force != 0.0) {
      depth_of.push_back(curve[k].depth);
      share.push_back(half[k] / std::abs(curve[k].force));
    }
  for (std::size_t k = 0; k < depth.size(); ++k)
    result[k] = share.empty() ? 0.0 : std::abs(result[k]) * between(depth_of, share, depth[k]);
  return result;
}

}  // namespace dimple
