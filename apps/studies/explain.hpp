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

/// One choice changed, and the force that this gives.
struct Alternative {
  enum class Kind {
    cloud,  ///< the discretisation: nothing smaller than what another random cloud does means anything
    doubt,  ///< what an image and a scene do not say
    simplification  ///< what a model may leave out
  };
  std::string what, instead;  ///< "base", "held to 15.0 mm instead of 30.0 mm"
  std::string all;            ///< what was tried of `what`, in a few words: "held to 15.0 or 45.0 mm"
  Kind kind = Kind::doubt;
  double depth_mm = 0.0;  ///< where forces are compared: the load's depth, or less: `deeper`
  double force = 0.0;     ///< [N] there
  double effect = 0.0;    ///< on it: force / the force of the scene as it is - 1
  std::vector<std::pair<double, double>> effects =
      {};                   ///< depth [mm], and the effect there: the last is `effect`
  double elsewhere = 0.0;   ///< of a shift: the longest change of a displacement at a target or in depth [mm]
  std::string deeper = {};  ///< why there is nothing beyond depth_mm: no equilibrium, or the tissue gave way
  double seconds = 0.0;     ///< from the image to the force
  std::string failed = {};  ///< why there is none; empty: there is one
};

/// What the force of one image and load depends on, measured.
struct Explanation {
  Index nodes = 0;
  double depth_mm = 0.0, force = 0.0, seconds = 0.0;  ///< [N] of the scene as it is; [s] that it took
  double noise = 0.0;  ///< largest effect of another random cloud, as a share of the force
  std::vector<Alternative> alternatives = {};  ///< by `what` the largest effect first, those that failed last
  std::vector<std::string> warnings = {};      ///< of the guards, about the scene as it is
  std::string ended_by = {};                   ///< by what it was stopped before its end; empty: it was not
  double total_s = 0.0;
  std::string run =
      {};  ///< the force of the run that it explains, with its nodes, in words; empty: there is none
};

/// What is smaller than this [share of the force], or than the noise, does not matter.
inline constexpr double least_effect = 0.01;
inline double threshold(const Explanation& e) {
  return e.noise > least_effect ? e.noise : least_effect;
}

/// Nodes with which choices are compared at first: as many as a run has by itself, and more on a folded body
/// and under a tool that takes more.
Index nodes_to_explain(const Scene& scene, double facing_share);

/// A tool that touches, changed in one of its choices: a length, on the nodes of the unchanged one, or its
/// friction. What is not known of it: a radius to 2 %, the radius of an edge to 20 %.
struct ToolChoice {
  std::string what, all, instead;
  ToolShape shape;
  double friction;
};
/// None that the tool cannot have: see tool_of().
std::vector<ToolChoice> tool_choices(const ToolShape& shape, double friction);

/// Runs the scene of `scene` and then with one choice at a time changed: other clouds, the contact (of a
/// tool that touches its friction, its radius and the radius of its edge, on the same nodes), the base's
/// height, the circle's place, the segmentation's border, the surface's smoothing, the voxels' size, folds
/// that are narrow, and what a model may leave out: large strain, far tissue, incompressibility, inertia,
/// tissues of their own. The circle, its direction and the base stay where the scene as it is has them. A
/// choice that gives the run another cloud is compared with the mean of three clouds, and is the mean of two
/// itself where its effect is below three times what clouds differ by; any other is compared with the force
/// on the same cloud. Where the tissue gives way, forces are compared above: where it comes to rest differs
/// from cloud to cloud by more than any choice does.
///
/// `nodes`: 0: nodes_to_explain(), and more where another random cloud has more than `least_effect`. An
/// accuracy that was asked for plays no part. `progress` hears a line about each run. Throws what simulate()
/// throws where the scene as it is has no force, and what check_pairs() throws; a choice that has none
/// is listed with why. Stopped: before the first comparison; after it, what there is is returned.
Explanation explain(const Scene& scene, Index nodes, const std::function<void(const std::string&)>& progress);

/// By `what` the largest effect first, those that failed last.
void sort_by_effect(std::vector<Alternative>& alternatives);
/// What was chosen instead, with the depth of its effect where that is less than the run's.
std::string instead_of(const Alternative& alternative, const Explanation& explanation);
/// "discretisation", "doubt", "simplification".
const char* word_of(Alternative::Kind kind);

/// A quantity and what changes it, ready to be written.
struct ChoiceTable {
  struct Row {
    std::string what, instead, all;  ///< as of an Alternative
    std::string at = {};             ///< "at 3.75 mm": where the effect is of less depth than the run's force
    Alternative::Kind kind = Alternative::Kind::doubt;
    std::optional<double> effect = {};  ///< nothing: the changed run failed
    std::string csv, verdict;
    double seconds = 0.0;
  };
  std::string text;                ///< in front of the table in explain.md
  std::string effect, csv_header;  ///< "effect on the force, %"
  std::string title;               ///< of the chart
  std::vector<std::string> subtitle = {};
  std::string axis;
  double shade = 0.0;  ///< effects below it do not matter
  std::string shade_text;
  std::vector<Row> rows = {};
};
/// explain.csv, .md, .png and .svg.
void write_choices(const std::filesystem::path& folder, const ChoiceTable& table);

/// The same of an explanation. `subject`: what it is of.
void write_explanation(const std::filesystem::path& folder, const Explanation& explanation,
                       const std::string& subject);

/// "matters", "no matter" or, of a simplification that does not matter, "free"; why there is no force.
std::string verdict(const Explanation& explanation, const Alternative& alternative);

}  // namespace dimple
