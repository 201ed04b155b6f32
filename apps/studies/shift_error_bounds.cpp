#include "apps/studies/shift_error_bounds.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <new>

#include "apps/run/unless_stopped.hpp"
#include "apps/run/words.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

// Values chosen on whole heads and checked on others: tests/bench/README.md. The change with half as many
// nodes estimates the error poorly there. With 4000 nodes the error is up to a fifth, mostly too large a
// shift; with more nodes it is less.
constexpr double least_fraction = 0.25;
constexpr Index fewest_nodes = 4000;

double largest_at_opening(const ShiftScene& requested, const Shifted& shifted) {
  return shifted.surface_mm.col(shifted.largest_in(requested.opening)).norm();
}

// Reason why the calibration does not apply; brain, opening, gap and fluid may differ from it.
std::string why_unknown(const Scene& scene) {
  const Scene usual;
  if (!scene.error_bounds) return "accuracy.band is off";
  if (scene.scheme != usual.scheme) return "calibrated for the converging scheme only";
  if (!scene.tissues.empty() || !scene.membranes.empty() || scene.material.nu != usual.material.nu)
    return "calibrated for one tissue with the default nu, without membranes";
  if (scene.walls.size() != 1 || scene.walls.front().name != skull_name || scene.walls.front().friction > 0.0)
    return "calibrated for a frictionless skull only";
  if (scene.node_set.jitter != usual.node_set.jitter || scene.grid.points != usual.grid.points ||
      scene.grid.ratio != usual.grid.ratio || scene.support_radius_factor != usual.support_radius_factor ||
      scene.solver.tolerance > usual.solver.tolerance)
    return "calibrated for the default points, supports and tolerance only";
  return {};
}

std::string why_unknown(const Scene& scene, const ShiftScene& requested, const Shifted& shifted) {
  if (const std::string why = why_unknown(scene); !why.empty()) return why;
  if (const Index nodes = shifted.result.model.node_count(); nodes < fewest_nodes)
    return fmt::format("not calibrated below {} nodes", fewest_nodes);
  if (shifted.result.facing_fraction > most_facing) return "not calibrated for open sulci";
  if (shifted.sweep.inverted > 0) return "integration points are inverted";
  if (largest_at_opening(requested, shifted) > most_measured_mm)
    return fmt::format("not calibrated for shifts above {:g} mm", most_measured_mm);
  return {};
}

Points places_of(const ShiftScene& requested, const Shifted& shifted) {
  Points places(3, shifted.line.cols() + static_cast<Index>(requested.targets.size()));
  places.leftCols(shifted.line.cols()) = shifted.line;
  places.rightCols(places.cols() - shifted.line.cols()) = points_of(requested.targets);
  return places;
}

}  // namespace

ShiftErrorBounds error_bounds_of_shift(const Scene& scene, const ShiftScene& requested,
                                       const Shifted& shifted) {
  ShiftErrorBounds error_bounds{.unknown = why_unknown(scene, requested, shifted)};
  if (!error_bounds.known()) return error_bounds;
  error_bounds.coarser_nodes = shifted.result.model.node_count() / 2;
  Scene coarse = scene;
  coarse.node_set.nodes = error_bounds.coarser_nodes;
  coarse.node_set.spacing_mm = 0.0;
  const Points places = places_of(requested, shifted);
  Shifted other;
  Points there_mm;
  try {
    unless_stopped([&] {
      find_equilibrium(coarse, requested, {}, other);
      there_mm = other.at(places);
    });
  } catch (const Stopped&) {
    error_bounds.stopped = true;
    error_bounds.unknown = "the run was stopped first";
    return error_bounds;
  } catch (const std::bad_alloc&) {
    error_bounds.unknown = "not enough memory for the comparison";
    return error_bounds;
  } catch (const Error& error) {
    error_bounds.unknown =
        fmt::format("the comparison with {} nodes failed: {}", error_bounds.coarser_nodes, error.report.fact);
    return error_bounds;
  }
  const double here = largest_at_opening(requested, shifted);
  error_bounds.change_mm = std::abs(here - largest_at_opening(requested, other));
  if (places.cols() > 0) {
    Points here_mm(3, places.cols());
    here_mm.leftCols(shifted.line_mm.cols()) = shifted.line_mm;
    here_mm.rightCols(shifted.targets_mm.cols()) = shifted.targets_mm;
    error_bounds.change_mm =
        std::max(error_bounds.change_mm, (here_mm - there_mm).colwise().norm().maxCoeff());
  }
  const double nodes = static_cast<double>(shifted.result.model.node_count());
  error_bounds.half_mm =
      std::max(error_bounds.change_mm, least_fraction * std::sqrt(fewest_nodes / nodes) * here);
  return error_bounds;
}

std::string in_words(const ShiftErrorBounds& error_bounds) {
  if (!error_bounds.known()) return "unknown: " + error_bounds.unknown;
  return fmt::format("at most {} by discretisation: halving the nodes changes it by up to {}",
                     length_in_words(error_bounds.half_mm), length_in_words(error_bounds.change_mm));
}

}  // namespace dimple
