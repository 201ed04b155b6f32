#pragma once

#include <functional>
#include <string>
#include <vector>

#include "preprocess/scene/boundary_conditions.hpp"
#include "solver/march.hpp"

namespace dimple {

// Error bounds under a bonded patch: the error of the discretisation, from the forces of two node sets.
//
// 1. why_no_error_bounds() refuses scenes, bodies and tissues that the calibration does not cover.
// 2. CoarserMarch solves the same scene with half the nodes, in parallel with the run if a processor is free.
// 3. The change is the relative difference of force / depth between the two, its maximum down to each depth.
// 4. error_measure() adds a floor: two node sets may agree by chance, and both miss strain at the patch edge.
// 5. The half-width is error_multiplier times this measure times the force.
// 6. The displacement of a followed place has bounds of its own, from its change and the depth of the tool.
//
// Calibration: tests/bench/calibrate.cpp (dimple_calibrate) computes the multipliers from random scenes, and
// error_bounds_test.cpp again. Evidence: tests/verification/README.md, "Error bounds"; results/band_*.csv
// there.

/// Error bounds of the force, from a coarser discretisation of the same body. They cover the error of the
/// discretisation and no other.
struct ErrorBounds {
  std::string unknown = "not requested";  ///< why there are none; empty: there are bounds
  Index coarse_nodes = 0;                 ///< of the coarser discretisation
  double seconds = 0.0;                   ///< time that the run waited for it [s]
  std::vector<double> half;               ///< [samples of the force curve] half-width [N]
  bool contacting = false;                ///< of a contacting tool
  bool known() const { return unknown.empty(); }
};

/// Lower bound of a force [N]. Contact has no tension: below a contacting tool that is pressed, it is at
/// least zero.
double lower_bound(double force, double half, bool contacting);
/// Lower bounds of a curve, or none if they are unknown.
std::vector<double> lower_bounds(const std::vector<ForceSample>& force, const ErrorBounds& error_bounds);

/// Ratio of the run's nodes to those of the coarser discretisation.
inline constexpr double coarser = 2.0;
/// Fraction of the surface, facing itself across narrow_gap_mm, above which a body counts as folded. A human
/// brain has 0.21 in voxels of 2 mm, a phantom with one fissure 0.03, a heart 0.02, a liver and lungs 0.002.
inline constexpr double most_facing = 0.1;
/// Fewest nodes for which error_half_width() is calibrated. On folded atlas brains 2000 nodes were up to 5 %
/// off, although 1000 agreed with them within 2 %.
inline Index fewest_nodes_with_error_bounds(double facing_fraction) {
  return facing_fraction > most_facing ? 4000 : 1000;
}
/// Largest depth for which the bounds are calibrated [radii of the patch].
inline constexpr double deepest_with_error_bounds = 1.7;
/// Longest way across the approach direction for which they are [radii of the tool].
inline constexpr double farthest_aside_with_error_bounds = 0.5;

/// Body under the bonded patch, in radii of the patch.
struct BodyUnderPatch {
  double thickness = 0.0;  ///< from the patch's centre along the press direction to the exit from the body
  double size = 0.0;       ///< cube root of the body's volume
  double voxel = 0.0;      ///< longest edge of the image's voxels; 0: there is no image
};
/// `boundary`: in the surface's frame.
BodyUnderPatch body_under_patch(const BodySurface& body, const Boundary& boundary, double voxel_mm);

/// Range of the scenes of calibration and proof. Each scene has a row in band_bodies.csv, next to their
/// forces. A test compares these numbers with it.
struct Covered {
  double least, most;
};
extern const Covered covered_thickness, covered_size, covered_nu;  ///< radii, radii, -
extern const double covered_voxel, covered_stiffness_ratio;        ///< at most; radii, -
extern const std::size_t covered_tissues;                          ///< at most

/// Reason why there are no bounds for such a body, or nothing.
std::string why_no_error_bounds(const BodyUnderPatch& body);
/// Reason why there are none for such tissues, or nothing.
std::string why_no_error_bounds(const std::vector<Material>& materials);

/// Load on which the error bounds depend: depth [radii of the bonded patch], and whether the body has several
/// tissues. At their interface points are on either side by chance.
struct ErrorLoad {
  double radii = 0.0;
  bool several_tissues = false;
};

/// Half-width of the error bounds, as a part of the force: multiplier * (0.3 change + floor). `change`:
/// largest relative difference down to this depth from the force with half as many nodes or fewer; `nodes`:
/// of the finer set. The floor covers what the change misses: chance agreement, and deeper down the strain at
/// the patch edge, for which both sets are too coarse:
///
///     floor = 1 % ((nodes / 1000)^-0.6 + 0.15 radii^4 (nodes / 1000)^-0.25); 1.7 times as much for several
///     tissues.
///
/// No order of convergence is used, since three random node sets do not separate it from their scatter. Eca &
/// Hoekstra (2014) treat such data by factors of safety. The constants, rounded, give narrow bounds on the
/// calibration's scenes; the proof's scenes were known when the form was chosen. With the multiplier the
/// bounds of 95 % of the scenes hold at all depths at once, for 1000, 2000, 4000 and 8000 nodes each. This is
/// split conformal prediction (Lei et al. 2018). Bounds hold if they contain the force of the finest set
/// (16,000 to 64,000 nodes), plus and minus its difference from half as many. All sets have the same spacing
/// at the patch edge; no bound covers a finer one.
double error_half_width(double change, Index nodes, const ErrorLoad& load);
extern const double error_multiplier;
/// The sum in brackets.
double error_measure(double change, Index nodes, const ErrorLoad& load);

/// Half-width of the error bounds of a place's displacement [m]: multiplier * (change + 1 % (nodes /
/// 1000)^-0.6 depth). `change`: distance between its displacements with both node sets; `depth`: of the tool,
/// since the error at a distance scales with it and not with the small displacement there. The multiplier is
/// calibrated like that of the force: at a random place of each scene within three patch diameters, against
/// 8000 nodes.
double displacement_half_width(double change, double depth, Index nodes);
extern const double displacement_multiplier;
/// The sum in brackets.
double displacement_measure(double change, double depth, Index nodes);

/// Largest number of nodes that a requested accuracy may use.
inline constexpr Index most_nodes_for_accuracy = 64'000;
/// Half-width at zero change, as a part of the force; of a displacement, as a part of the depth.
using ErrorFloor = std::function<double(Index nodes)>;
ErrorFloor floor_of_force(const ErrorLoad& load);
ErrorFloor floor_of_displacement();

/// Number of nodes expected to suffice for an accuracy. It is the smallest whose bounds are that narrow if
/// the change adds a tenth to the floor. `requested_fraction` 0: not known.
Index expected_nodes(double requested_fraction, double facing_fraction, const ErrorFloor& floor);
/// Numbers of nodes in the levels of a refinement. The first level has half of the expected nodes, few enough
/// to end soon. The second has the expected number, between twice and four times the first. The next has four
/// times as many nodes if `half` is far above `requested` (same unit), else twice: one comparison fewer.
/// Compared with a refinement from the fewest nodes, a goal of 2 % takes 0.92 of the time and 3 % takes 0.88
/// (calibration, medians).
Index nodes_of_first_level(Index expected);
Index nodes_of_second_level(Index first, Index expected);
Index nodes_of_next_level(Index nodes, double half, double requested);

/// Approximate number of nodes at which the floor of the bounds is half as wide.
Index nodes_for_half_the_error(Index nodes, const ErrorFloor& floor);

/// A place of the body and its displacement under the load.
struct Followed {
  Vec3 place = Vec3::Zero();  ///< at rest [m, LPS]
  Vec3 u = Vec3::Zero();      ///< its displacement at the last depth [m]
  double half = 0.0;          ///< half-width of its error bounds [m], if the force has bounds
};

/// Half-widths [N] at each depth of a force curve of so many nodes, from a coarser one. The change is
/// interpolated between the coarser depths. Empty if the coarser curve ends before. `radius`: of the patch
/// [m].
std::vector<double> half_widths(const std::vector<ForceSample>& force, Index nodes,
                                const std::vector<ForceSample>& coarse, double radius, bool several_tissues);

/// Half-widths [N] at each sample of a tool that moves in steps, from a coarser curve over the same time.
/// Changes and floors refer to the largest force so far, since the tool may retract: `fraction` is the
/// half-width as a part of it, from the largest change so far and the largest depth so far [m]. Changes are
/// measured at the times that both curves have, among them the ends of all steps, and not before `shallowest`
/// [m] is reached; there the force is between zero and the first bounds. Empty if the coarser curve ends
/// before, or the tool stays above.
using FractionOfLargest = std::function<double(double change, double deepest)>;
std::vector<double> half_widths_of_steps(const std::vector<ForceSample>& force,
                                         const std::vector<ForceSample>& coarse, double shallowest,
                                         const FractionOfLargest& fraction);

/// Force [N] of a curve, and its half-width, at other depths [m] in any order, none deeper than the curve.
/// Force / depth and half-width / force are interpolated, since they change slowly. Needs a sample with a
/// depth.
std::vector<double> forces_between(const std::vector<ForceSample>& curve, const std::vector<double>& depth);
std::vector<double> halves_between(const std::vector<ForceSample>& curve, const std::vector<double>& half,
                                   const std::vector<double>& depth);

}  // namespace dimple
