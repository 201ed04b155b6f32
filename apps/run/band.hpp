#pragma once

#include <functional>
#include <string>
#include <vector>

#include "preprocess/scene/boundary_conditions.hpp"
#include "solver/march.hpp"

namespace dimple {

/// How far the force may be from that of an ever finer cloud of the same body, by what a coarser cloud gives:
/// the error of the discretisation, and no other.
struct Band {
  std::string unknown = "not requested";  ///< why there is none; empty: there is one
  Index coarse_nodes = 0;                 ///< of the coarser cloud
  double seconds = 0.0;                   ///< that it took
  std::vector<double> half;               ///< [samples of the force curve] half its width [N]
  bool known() const { return unknown.empty(); }
};

/// The coarser cloud has one node for this many of the run's.
inline constexpr double coarser = 2.0;
/// Above this share of the surface, facing itself across narrow_gap_mm, a body counts as folded. A human
/// brain's was 0.21 in voxels of 2 mm; a phantom's with one fissure 0.03, a heart's 0.02, a liver's and
/// lungs' 0.002.
inline constexpr double most_facing = 0.1;
/// Clouds for which band_half_width() was measured begin with this many nodes. Of a folded body 2000 are too
/// few: on atlases' brains they were up to 5 % off where 1000 were within 2 % of them.
inline Index fewest_nodes_with_band(double facing_share) {
  return facing_share > most_facing ? 4000 : 1000;
}
/// Depths up to which it was measured [radii of the circle].
inline constexpr double deepest_with_band = 1.7;

/// The body as its circle sees it, in radii of the circle.
struct BodyUnderCircle {
  double thickness = 0.0;  ///< from the circle's centre along the push, until that leaves the body
  double size = 0.0;       ///< cube root of the body's volume
  double voxel = 0.0;      ///< longest edge of the image's voxels; 0: there is no image
};
/// `boundary` in the surface's own frame.
BodyUnderCircle body_under_circle(const BodySurface& body, const Boundary& boundary, double voxel_mm);

/// What the scenes covered from which the band was made and in which it was tried: band_bodies.csv beside
/// their forces has a row for each, and a test compares these numbers with it.
struct Covered {
  double least, most;
};
extern const Covered covered_thickness, covered_size, covered_nu;  ///< radii, radii, -
extern const double covered_voxel, covered_stiffness_ratio;        ///< at most; radii, -
extern const std::size_t covered_tissues;                          ///< at most

/// Why no band is known of such a body, or nothing.
std::string why_no_band(const BodyUnderCircle& body);
/// Why none is known of such tissues, or nothing.
std::string why_no_band(const std::vector<Material>& materials);

/// What a band depends on besides clouds: how deep the tool is [radii of the circle], and whether the body is
/// of several tissues. Where they meet, points lie on either side by chance.
struct BandLoad {
  double radii = 0.0;
  bool several_tissues = false;
};

/// Half the width of the band as a part of the force: multiplier * (0.3 change + floor). `change`: of the
/// force from that of a cloud with half as many nodes or fewer, as a part of it, the largest down to this
/// depth; `nodes`: of the finer cloud. The floor is what the change does not see, because two clouds can
/// agree by chance, and deeper down because the rim's strain is too sharp for either of them:
///
///     floor = 1 % ((nodes / 1000)^-0.6 + 0.15 radii^4 (nodes / 1000)^-0.25), and 1.7 times that of several
///     tissues.
///
/// There is no order of convergence in it: forces of two random clouds differ by their scatter too, which
/// three clouds cannot tell from an order (Eca & Hoekstra 2014 meet data that scatter so by factors of
/// safety). The constants, rounded, make the bands of the calibration's scenes narrow. With the multiplier
/// the bands of 95 in 100 of those scenes hold, with 1000, 2000, 4000 and 8000 nodes each, at all depths at
/// once, the force of the finest cloud (16,000 to 64,000 nodes) and all that lies as far from it as the cloud
/// half as fine is (split conformal prediction; Lei et al. 2018; a test computes it again). The form was
/// chosen with these and the proof's scenes at hand, and the truth is a cloud of this program with the same
/// spacing at the rim: see tests/verification/README.md.
double band_half_width(double change, Index nodes, const BandLoad& load);
extern const double band_multiplier;
/// The sum in brackets.
double band_measure(double change, Index nodes, const BandLoad& load);

/// Half the width of the band of a place's displacement [m]: multiplier * (change + 1 % (nodes / 1000)^-0.6
/// depth). `change`: from where the coarser cloud brings it; `depth` of the tool: far away from it a place
/// moves little, and how far it may be off is a part of the tool's way and not of that. The multiplier is
/// made in the same way as the force's, from a random place of each scene, at most three diameters of the
/// circle away from it, and a truth of 8000 nodes.
double displacement_half_width(double change, double depth, Index nodes);
extern const double displacement_multiplier;
/// The sum in brackets.
double displacement_measure(double change, double depth, Index nodes);

/// As many nodes as an accuracy may take.
inline constexpr Index most_nodes_for_accuracy = 64'000;
/// Half the width of the band, as a part of the force, or of a displacement as a part of the depth, where the
/// change is nothing.
using FloorOfBand = std::function<double(Index nodes)>;
FloorOfBand floor_of_force(const BandLoad& load);
FloorOfBand floor_of_displacement();

/// As many nodes as may well do for an accuracy: where the band is that narrow, and a tenth of its floor
/// more. `wanted_share` 0: not known.
Index expected_nodes(double wanted_share, double facing_share, const FloorOfBand& floor);
/// The levels of a refinement for an accuracy, in nodes. The first has half as many nodes as are expected,
/// but few enough for it to end soon; the second as many as are expected, if that is no more than four times
/// as many. After a cloud whose band is `half` wide where `wanted` is asked for (in the same unit) four times
/// as many are taken where that is far too wide, else twice: one change less to be paid for. On the scenes of
/// the calibration this asks for 2 % in 0.92 of the time, median, that a refinement from the fewest nodes
/// takes, and for 3 % in 0.88.
Index nodes_of_first_level(Index expected);
Index nodes_of_second_level(Index first, Index expected);
Index nodes_of_next_level(Index nodes, double half, double wanted);

/// About how many nodes make the band half as wide: where its floor is.
Index nodes_for_half_the_band(Index nodes, const FloorOfBand& floor);

/// A place of the body, and where the load brings it.
struct Followed {
  Vec3 place = Vec3::Zero();  ///< at rest [m, LPS]
  Vec3 u = Vec3::Zero();      ///< its displacement at the last depth [m]
  double half = 0.0;          ///< half its band's width [m], where there is a band of the force
};

/// Half the band's width at each depth of a force curve of so many nodes, against the coarser cloud's [N]: at
/// other depths than that has, the change is interpolated. Empty if the coarser curve ends before. `radius`
/// of the circle [m].
std::vector<double> half_widths(const std::vector<ForceSample>& force, Index nodes,
                                const std::vector<ForceSample>& coarse, double radius, bool several_tissues);

/// Force [N] of a curve, and half its band's width, at other depths [m], rising or not, none deeper than the
/// curve. What is interpolated is divided by the depth, or by the force: it changes slowly. Needs: a sample
/// with a depth.
std::vector<double> forces_between(const std::vector<ForceSample>& curve, const std::vector<double>& depth);
std::vector<double> halves_between(const std::vector<ForceSample>& curve, const std::vector<double>& half,
                                   const std::vector<double>& depth);

}  // namespace dimple
