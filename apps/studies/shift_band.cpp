#include "apps/studies/shift_band.hpp"

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
constexpr double least_share = 0.25;
constexpr Index fewest_nodes = 4000;

double largest_at_opening(const ShiftScene& asked, const Shifted& shifted) {
  return shifted.surface_mm.col(shifted.largest_in(asked.opening)).norm();
}

// Reason why the calibration does not apply; brain, opening, gap and fluid may differ from it.
std::string why_unknown(const Scene& scene) {
  const Scene usual;
  if (!scene.band) return "accuracy.band is off";
  if (scene.scheme != usual.scheme) return "calibrated for the converging scheme only";
  if (!scene.tissues.empty() || !scene.membranes.empty() || scene.material.nu != usual.material.nu)
    return "calibrated for one tissue with the default nu, without membranes";
  if (scene.walls.size() != 1 || scene.walls.front().name != skull_name || scene.walls.front().friction > 0.0)
    return "calibrated for a frictionless skull only";
  if (scene.cloud.jitter != usual.cloud.jitter || scene.grid.points != usual.grid.points ||
      scene.grid.ratio != usual.grid.ratio || scene.support_radius_factor != usual.support_radius_factor ||
      scene.solver.tolerance > usual.solver.tolerance)
    return "calibrated for the default points, supports and tolerance only";
  return {};
}

std::string why_unknown(const Scene& scene, const ShiftScene& asked, const Shifted& shifted) {
  if (const std::string why = why_unknown(scene); !why.empty()) return why;
  if (const Index nodes = shifted.result.model.node_count(); nodes < fewest_nodes)
    return fmt::format("not calibrated below {} nodes", fewest_nodes);
  if (shifted.result.facing_share > most_facing) return "not calibrated for open sulci";
  if (shifted.sweep.inverted > 0) return "integration points are inverted";
  if (largest_at_opening(asked, shifted) > most_measured_mm)
    return fmt::format("not calibrated for shifts above {:g} mm", most_measured_mm);
  return {};
}

Points places_of(const ShiftScene& asked, const Shifted& shifted) {
  Points places(3, shifted.line.cols() + static_cast<Index>(asked.targets.size()));
  places.leftCols(shifted.line.cols()) = shifted.line;
  places.rightCols(places.cols() - shifted.line.cols()) = points_of(asked.targets);
  return places;
}

}  // namespace

ShiftBand band_of_shift(const Scene& scene, const ShiftScene& asked, const Shifted& shifted) {
  ShiftBand band{.unknown = why_unknown(scene, asked, shifted)};
  if (!band.known()) return band;
  band.coarser_nodes = shifted.result.model.node_count() / 2;
  Scene coarse = scene;
  coarse.cloud.nodes = band.coarser_nodes;
  coarse.cloud.spacing_mm = 0.0;
  const Points places = places_of(asked, shifted);
  Shifted other;
  Points there_mm;
  try {
    unless_stopped([&] {
      come_to_rest(coarse, asked, {}, other);
      there_mm = other.at(places);
    });
  } catch (const Stopped&) {
    band.stopped = true;
    band.unknown = "the run was stopped first";
    return band;
  } catch (const std::bad_alloc&) {
    band.unknown = "not enough memory for the comparison";
    return band;
  } catch (const Error& error) {
    band.unknown =
        fmt::format("the comparison with {} nodes failed: {}", band.coarser_nodes, error.report.fact);
    return band;
  }
  const double here = largest_at_opening(asked, shifted);
  band.change_mm = std::abs(here - largest_at_opening(asked, other));
  if (places.cols() > 0) {
    Points here_mm(3, places.cols());
    here_mm.leftCols(shifted.line_mm.cols()) = shifted.line_mm;
    here_mm.rightCols(shifted.targets_mm.cols()) = shifted.targets_mm;
    band.change_mm = std::max(band.change_mm, (here_mm - there_mm).colwise().norm().maxCoeff());
  }
  const double nodes = static_cast<double>(shifted.result.model.node_count());
  band.half_mm = std::max(band.change_mm, least_share * std::sqrt(fewest_nodes / nodes) * here);
  return band;
}

std::string in_words(const ShiftBand& band) {
  if (!band.known()) return "unknown: " + band.unknown;
  return fmt::format("at most {} by discretisation: halving the nodes changes it by up to {}",
                     length_in_words(band.half_mm), length_in_words(band.change_mm));
}

}  // namespace dimple
