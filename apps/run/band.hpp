#pragma once

#include <string>
#include <vector>

#include "solver/march.hpp"

namespace dimple {

/// How far the force may be from that of an ever finer cloud of the same body, by what a coarser cloud gives:
/// the error of the discretisation, and no other.
struct Band {
  std::string unknown = "it was not asked for";  ///< why there is none; empty: there is one
  Index coarse_nodes = 0;                        ///< of the coarser cloud
  double seconds = 0.0;                          ///< that it took
  std::vector<double> half;                      ///< [samples of the force curve] half its width [N]
  bool known() const { return unknown.empty(); }
};

/// The coarser cloud has one node for this many of the run's.
inline constexpr double coarser = 2.0;
/// Above this share of the surface, facing itself across narrow_gap_mm, a body counts as folded. A human brain's was
/// 0.21 in voxels of 2 mm; a phantom's with one fissure 0.03, a heart's 0.02, a liver's and lungs' 0.002.
inline constexpr double most_facing = 0.1;
/// Clouds for which band_half_width() was measured begin with this many nodes. Of a folded body 2000 are too few: on
/// atlases' brains they were up to 5 % off where 1000 were within 2 % of them.
inline Index fewest_nodes_with_band(double facing_share) {
  return facing_share > most_facing ? 4000 : 1000;
}
/// Depths up to which it was measured [radii of the circle].
inline constexpr double deepest_with_band = 1.7;

/// Half the width of the band as a part of the force: multiplier * (change + floor). `change`: of the force from that of
/// a cloud with half as many nodes or fewer, as a part of it, the largest down to this depth; `nodes`: of the finer
/// cloud; `radii`: the depth over the circle's radius. The floor is what the change does not see, because two clouds can
/// agree by chance: 3 % with 1000 nodes, and less by their root; beyond one radius, where the rim's strain is too
/// sharp for any of these clouds, 4 %, and less by the fourth root.
///
/// There is no order of convergence in it: forces of two random clouds differ by their scatter too, which three clouds
/// cannot tell from an order (Eca & Hoekstra 2014 meet data that scatter so by factors of safety). The multipliers are
/// those with which the bands of 95 in 100 scenes, drawn at random, hold the force of the finest cloud (32,000 or 16,000
/// nodes) and all that lies as far from it as the cloud half as fine is, at all depths and with all clouds of a quarter of
/// its nodes or fewer at once (split conformal prediction; Lei et al. 2018): tests/verification/README.md. A test computes
/// them again from the scenes.
double band_half_width(double change, Index nodes, double radii);
extern const double band_multiplier;       ///< down to one radius
extern const double band_multiplier_deep;  ///< deeper
/// Whether the second holds, with room for the last bits of a depth.
inline bool is_deep(double radii) {
  return radii > 1.0 + 1e-9;
}
/// The sum in brackets.
double band_measure(double change, Index nodes, double radii);

/// As many nodes as an accuracy may take.
inline constexpr Index most_nodes_for_accuracy = 64'000;
/// What the band is with so many nodes and no change: no goal may be narrower.
double narrowest_band(double radii);

/// As many nodes as may well do for an accuracy: where the band of a change by a tenth of the floor is that narrow.
/// `wanted_share` 0: not known.
Index expected_nodes(double wanted_share, double facing_share, double radii);
/// The ladder of clouds for an accuracy. The first has half as many nodes as are expected, but few enough for it to end
/// soon; the second as many as are expected, if that is no more than four times as many. After a cloud whose band is
/// `half` wide where `wanted` is asked for (in the same unit) four times as many are taken where that is far too
/// wide, else twice: one change less to be paid for. On the scenes of the calibration this asks for 2 % in 0.92 of the
/// time, median, that a ladder from the fewest nodes takes, and for 3 % in 0.88.
Index first_rung(Index expected);
Index second_rung(Index first, Index expected);
Index next_rung(Index nodes, double half, double wanted);

/// About how many times as many nodes make the band half as wide: on the scenes of the calibration its median falls with
/// the power 0.56 of the nodes down to one radius, 0.34 deeper.
double nodes_for_half_the_band(double radii);

/// A place of the body, and where the load brings it.
struct Followed {
  Vec3 place = Vec3::Zero();  ///< at rest [m, LPS]
  Vec3 u = Vec3::Zero();      ///< its displacement at the last depth [m]
  double change = 0.0;        ///< from that of the coarser cloud [m], where there is a band of the force
};

/// Half the band's width at each depth of a force curve of so many nodes, against the coarser cloud's [N]: at other
/// depths than that has, the change is interpolated. Empty if the coarser curve ends before. `radius` of the circle [m].
std::vector<double> half_widths(const std::vector<ForceSample>& force, Index nodes,
                                const std::vector<ForceSample>& coarse, double radius);

/// Force [N] of a curve, and half its band's width, at other depths [m], rising or not, none deeper than the curve. What is
/// interpolated is divided by the depth, or by the force: it changes slowly. Needs: a sample with a depth.
std::vector<double> forces_between(const std::vector<ForceSample>& curve, const std::vector<double>& depth);
std::vector<double> halves_between(const std::vector<ForceSample>& curve, const std::vector<double>& half,
                                   const std::vector<double>& depth);

}  // namespace dimple
