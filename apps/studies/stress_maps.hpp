#pragma once

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "apps/run/config.hpp"
#include "io/types.hpp"

namespace dimple {

/// One side of a map: an option and the values that it takes. Two keys have a meaning of their own:
/// load.depth_mm: all depths come from one run to the deepest, so they are even steps of it;
/// phantom.height_mm: the height of the block, each an image of its own.
struct StressAxis {
  std::string key;
  std::string label = {};  ///< with the unit; empty: the key
  std::vector<std::string> values;
  std::vector<std::string> ticks = {};  ///< in the picture; empty: the values
  bool is_depth() const { return key == "load.depth_mm"; }
  bool is_height() const { return key == "phantom.height_mm"; }
};

/// One scene over two axes.
struct StressMap {
  std::string name, title, scene;
  StressAxis x, y;
  std::vector<std::pair<std::string, std::string>> settings = {};  ///< option, text
  std::array<double, 3> block_mm = {60.0, 60.0, 30.0};
};

/// The atlas: names are what --map takes.
const std::vector<StressMap>& stress_maps();

/// "material.nu=0.3,0.45" as an axis. Throws UsageError: no such option, a value that it does not take, fewer
/// than two values or one twice, depths that are not even steps.
StressAxis stress_axis(const std::string& text, const std::string& flag);
void check_axis(const StressAxis& axis, const std::string& flag);

/// Whether an option belongs to the physical case; the others say how it is computed.
bool is_physical(const std::string& key);

/// Of one case: the scheme converging with `nodes` nodes and every numerical option but frames and
/// evaluations as usual.
Config finest_of(const Config& config, Index nodes);

/// A run at one depth.
struct StressFrame {
  double depth_mm = 0.0, force_N = 0.0;
  double energy_error = 0.0;  ///< largest imbalance so far, as a part of the tool's work so far
  double J_min = 1.0;         ///< at any point, at this depth
  Index inverted = 0;         ///< inverted points
  double inverted_mm3 = 0.0;  ///< their volume at rest
};

/// What is left of a run.
struct StressRun {
  std::string ended;  ///< empty: it finished; or the code of why not
  std::string fact;   ///< and its words
  std::vector<StressFrame> frames;
  Index nodes = 0, points = 0, retries = 0;
  std::string guards;  ///< codes of its warnings, separated by blanks
};

/// What a cell has to fulfil besides having finished.
namespace survival {
/// The largest change of the force curve's slope that comes suddenly, as a part of its mean slope:
/// |F(k+1) - 3 F(k) + 3 F(k-1) - F(k-2)| / (F(k+1) / (k+1)), k counting frames from F(0) = 0. A smooth curve,
/// however much it stiffens, makes this small as frames come closer; a bend or a drop does not.
constexpr double kink = 0.25;
constexpr double energy = 0.02;  ///< unbalanced, as a part of the tool's work
/// Inverted volume, as a part of the half ball under the circle, where the strain at the sharp rim of a
/// bonded circle is unbounded and no cloud keeps every point upright.
constexpr double inverted = 0.01;
constexpr double error = 0.05;  ///< of the force against the finest stable run
}  // namespace survival

/// A cell of a map.
struct StressVerdict {
  std::string code;
  double force_N, reference_N;  ///< at the cell's depth; not a number where unknown
  Index reference_nodes = 0;
  double error = 0.0;  ///< signed; where all depths count the largest
  double kink = 0.0, energy_error = 0.0, J_min = 1.0, inverted_mm3 = 0.0;
  Index inverted = 0;
};

/// Judges a run up to its frame number `last`, from 1. `finest` are the runs of the same case to compare
/// with, the finest first; one that is not stable itself up to a depth does not serve there. With
/// `at_last_only` the force counts at that frame alone, else at each up to it.
///
/// Codes, the first that applies: why the run did not get there; non-finite; energy; inverted; kinked;
/// unchecked (no finer stable run); inaccurate; ok-rim (survived, with inverted points at the rim); ok.
StressVerdict judge(const StressRun& run, const std::vector<StressRun>& finest, std::size_t last,
                    bool at_last_only, double circle_radius_mm);

/// Survived, with or without a note.
bool survived(const std::string& code);

/// In the legend.
std::string meaning_of(const std::string& code);

}  // namespace dimple
