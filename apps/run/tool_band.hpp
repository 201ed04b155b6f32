#pragma once

#include <vector>

#include "preprocess/model.hpp"
#include "solver/march.hpp"
#include "solver/terms/tool_shape.hpp"

namespace dimple {

/// Half the width of the band of a tool that touches, as a part of the force:
///
///     multiplier (0.3 change + 1 % (nodes / 1000)^-0.6 + 0.4 (spacing / radius of contact)^2).
///
/// `change`: as of the circle's band (band_half_width()). The last term is what two clouds have in common:
/// contact that is enforced in the mean around each node reaches too far, and where few nodes touch the force
/// is too high by that much. `spacing` at the contact and `contact` radius in the same unit.
double tool_band_half_width(double change, Index nodes, double spacing, double contact);
/// On the calibration's spheres and punch (tool_band_test) 0.9 would have held at all depths; 1.5 was frozen
/// before images were looked at, whose surfaces are neither level nor smooth, and there one band of the first
/// four did not hold (results/tool_band_coverage.csv: it took 1.77 times its width). It was widened by that.
extern const double tool_band_multiplier;
/// The sum in brackets.
double tool_band_measure(double change, Index nodes, double spacing, double contact);

/// How deep the body's surface came into the tool at most [m], and how deep the tool was then; 0: nothing
/// that counts.
struct Penetration {
  double largest = 0.0, at = 0.0;
};

/// Half the band's width [N] at each depth of a force curve of the model, against that of a coarser cloud; no
/// less than penetration may put the force off by (Guards::off_by_penetration), which is less the deeper the
/// tool has gone on since. Shallower than it was measured, where a handful of nodes touch, the force is known
/// to lie between none and the straight line to the first depth that was: contact grows with the depth. Empty
/// if the coarser curve ends before, or the force does before that depth.
std::vector<double> tool_half_widths(const std::vector<ForceSample>& force, const Model& model,
                                     const std::vector<ForceSample>& coarse, const ToolShape& shape,
                                     const Penetration& penetration = {});

/// Clouds for which the band was measured, with half of which they were compared.
inline constexpr Index fewest_nodes_with_tool_band = 1500;
/// Bodies for which it was measured [radii of the contact].
inline constexpr double thinnest_with_tool_band = 3.5;
/// From so many of a tool's radii the band was measured, and down to so many.
inline constexpr double shallowest_with_tool_band = 0.08;
inline constexpr double deepest_with_tool_band = 0.8;

}  // namespace dimple
