#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apps/scene/scene.hpp"
#include "io/types.hpp"
#include "solver/terms/tool_shape.hpp"

namespace dimple {

/// Run with one choice changed, and its force.
struct Alternative {
  enum class Kind {
    node_set,       ///< the discretisation: smaller effects than that of other random nodes are noise
    doubt,          ///< uncertain in the image or the scene
    simplification  ///< effect that a model may leave out
  };
  std::string what, instead;  ///< "base", "held to 15.0 mm instead of 30.0 mm"
  std::string all;            ///< all values tried of `what`: "held to 15.0 or 45.0 mm"
  Kind kind = Kind::doubt;
  double depth_mm = 0.0;  ///< of the comparison: the load's depth, or less: see `deeper`
  double force = 0.0;     ///< [N] there
  double effect = 0.0;    ///< relative change of the force compared with the unchanged scene
  std::vector<std::pair<double, double>> effects =
      {};                   ///< depth [mm] and the effect there; the last is `effect`
  double elsewhere = 0.0;   ///< largest change at a target or in depth [mm]; shift only
  std::string deeper = {};  ///< why depth_mm is not the load's: no equilibrium, or a limit point
  double seconds = 0.0;     ///< from the image to the force
  std::string failed = {};  ///< why there is no force; empty: there is one
};

/// Measured effects of choices on the force, for one image and load.
struct Explanation {
  Index nodes = 0;
  double depth_mm = 0.0, force = 0.0, seconds = 0.0;  ///< [N] and [s] of the unchanged scene
  double noise = 0.0;                                 ///< largest relative effect of other random nodes
  std::vector<Alternative> alternatives = {};  ///< grouped by `what`, largest effect first, failed ones last
  std::vector<std::string> warnings = {};      ///< of the guards, about the unchanged scene
  std::string ended_by = {};                   ///< reason why it was stopped; empty: it was not
  double total_s = 0.0;
  std::string run = {};  ///< force and nodes of the explained run as text; empty: there is none
};

/// Smallest effect that matters [fraction of the force], unless the noise is larger.
inline constexpr double least_effect = 0.01;
inline double threshold(const Explanation& e) {
  return e.noise > least_effect ? e.noise : least_effect;
}

/// Initial number of nodes for the comparisons: a run's default, or more for a folded body or a tool that
/// needs more.
Index nodes_to_explain(const Scene& scene, double facing_fraction);

/// Contacting tool with one choice changed: a length, with the nodes of the unchanged tool, or its friction.
/// The assumed uncertainty is 2 % of a radius and 20 % of the radius of an edge.
struct ToolChoice {
  std::string what, all, instead;
  ToolShape shape;
  double friction;
};
/// Choices for a tool, only with lengths that it can have: see tool_named().
std::vector<ToolChoice> tool_choices(const ToolShape& shape, double friction);

/// Runs a scene, then repeats it with one choice at a time changed: other random nodes; the contact (for a
/// contacting tool its friction, its radius and the radius of its edge, with the same nodes); height of the
/// base; position of the bonded patch; boundary of the segmentation; smoothing of the surface; voxel size;
/// narrow folds; and simplifications: small strain, no far tissue, compressibility, no inertia, one tissue.
/// Patch, direction and base are those of the unchanged scene.
///
/// A choice that changes the nodes is compared with the mean over three node sets; if its effect is below
/// three times their scatter, it is itself the mean over two. Any other choice is compared with the force on
/// the same nodes. Forces are compared before a limit point: the state after it differs more between node
/// sets than between choices.
///
/// `nodes`: 0: nodes_to_explain(), and more while other random nodes change the force by more than
/// `least_effect`. A requested accuracy is ignored. `progress` receives a line per run. Throws what
/// simulate() throws for the unchanged scene, and what check_pairs() throws; a choice that fails is listed
/// with its reason. Stopped: before the first comparison; later, the comparisons so far are returned.
Explanation explain(const Scene& scene, Index nodes, const std::function<void(const std::string&)>& progress);

/// Sorts by `what`, largest effect first, failed ones last.
void sort_by_effect(std::vector<Alternative>& alternatives);
/// Alternative choice, with the depth of its effect if that is less than the run's.
std::string instead_of(const Alternative& alternative, const Explanation& explanation);
/// Name of a kind: "discretisation", "doubt", "simplification".
const char* word_of(Alternative::Kind kind);

/// Effects of choices on a quantity, as text for the files.
struct ChoiceTable {
  struct Row {
    std::string what, instead, all;  ///< as of an Alternative
    std::string at = {};             ///< "at 3.75 mm" if the effect is at less depth than the run's force
    Alternative::Kind kind = Alternative::Kind::doubt;
    std::optional<double> effect = {};  ///< nothing: the changed run failed
    std::string csv, verdict;
    double seconds = 0.0;
  };
  std::string text;                ///< before the table in explain.md
  std::string effect, csv_header;  ///< "effect on the force, %"
  std::string title;               ///< of the chart
  std::vector<std::string> subtitle = {};
  std::string axis;
  double shade = 0.0;  ///< effects below it do not matter
  std::string shade_text;
  std::vector<Row> rows = {};
};
/// Writes explain.csv, .md, .png and .svg.
void write_choices(const std::filesystem::path& folder, const ChoiceTable& table);

/// Writes an explanation. `subject`: the quantity that it explains.
void write_explanation(const std::filesystem::path& folder, const Explanation& explanation,
                       const std::string& subject);

/// "matters", "no matter", or "free" for a simplification that does not matter; the reason if there is no
/// force.
std::string verdict(const Explanation& explanation, const Alternative& alternative);

}  // namespace dimple
