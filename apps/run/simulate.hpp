#pragma once

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/error_bounds.hpp"
#include "apps/run/image_error.hpp"
#include "apps/run/model_files.hpp"
#include "apps/run/work.hpp"
#include "apps/scene/scene.hpp"
#include "preprocess/build_model.hpp"
#include "preprocess/surface/cut.hpp"
#include "preprocess/surface/label_surface.hpp"
#include "solver/solve.hpp"

namespace dimple {

/// Changes by a comparison: of the body before its surface is extracted, or of the tool once nodes are
/// placed. They are no options of a run.
struct BodyModification {
  std::function<LabelImage(const LabelImage&)> image = {};
  double smoothing = 1.0;              ///< SurfaceOptions::smoothing
  double outward_voxels = 0.0;         ///< SurfaceOptions::outward_mm in voxels, of their mean edge
  std::optional<ToolShape> tool = {};  ///< that touches, on the nodes of the one that the options name
};

struct Origin;         // organ.hpp
struct PreparedOrgan;  // organ.hpp

/// Input of a run: the image that scene.image.file names, or an existing model, and every choice that decides
/// the result.
struct Case {
  Scene scene;
  std::optional<ModelFiles> model = {};       ///< instead of an image
  std::shared_ptr<const Origin> origin = {};  ///< origin of `model`, if known, for further node sets
  const LabelImage* image = nullptr;          ///< instead of the file that scene.image.file names
  /// Instead of an image, one that was read before with the same options of the image and the same width of
  /// the bonded patch, which its surface follows; all others may differ.
  const PreparedOrgan* organ = nullptr;
  const MarchState* from = nullptr;  ///< where an earlier run of the same case stood
  bool error_bounds = false;         ///< requested, from a coarser node set
  BodyModification change = {};
};

/// Width below which a gap counts as narrow: the walls of a sulcus face each other across it.
inline constexpr double narrow_gap_mm = 4.0;

/// One node set of the refinement for a requested accuracy.
struct RefinementLevel {
  Index nodes = 0;
  double force = 0.0, half = 0.0;  ///< at the last depth, and half-width of its bounds; 0: not known [N]
  double length = 0.0, half_length = 0.0;  ///< of the requested displacement, likewise [m]
  double seconds = 0.0;
};

/// Facts of an image and its organ that do not depend on the model; empty for a model of unknown origin.
struct ImageFacts {
  std::string image_words;           ///< its format, size and axes
  std::vector<LabelMeasure> labels;  ///< taken
  double closed_mm3 = 0.0;           ///< added where gaps were closed
  /// By --cut; see CutBody.
  struct Cut {
    double area_mm2 = 0.0, removed_mm3 = 0.0;
    double sizing = 0.0;           ///< the coarsest that nodes are along it, of the spacing far from the tool
    std::vector<CutPiece> parted;  ///< pieces that are not the one under the tool
    std::vector<LabelMeasure> labels;            ///< taken out
    std::function<bool(const Vec3&)> took = {};  ///< whether a blade took what was at a place [mm, LPS]
  } cut;
  double facing_fraction = 0.0;  ///< of the surface: what faces another part across narrow_gap_mm or less
  Mat3 voxel_edges_mm = Mat3::Zero();  ///< columns: the edges of a voxel, LPS
  SegmentReport segment;
};

/// A step of a scene that has cut the body; `after` 0: at rest.
struct CutMade {
  std::string name, text;
  std::size_t after = 0;                       ///< so many steps that move something
  double toughness_J_m2 = 0.0;                 ///< 0: not known
  std::vector<TriangleMesh> sheets = {};       ///< as they lie in the body at rest [mm, LPS]
  double area_mm2 = 0.0, removed_mm3 = 0.0;    ///< of this one, at rest, as of ImageFacts::Cut
  Index nodes = 0;                             ///< of the model from then on
  double t = 0.0, depth = 0.0;                 ///< [s], [m]
  double force_before = 0.0, force = 0.0;      ///< on the tool, along its push [N]
  double stored_before = 0.0, released = 0.0;  ///< the stored energy, and by how much it falls [J]
  /// Clouds of the two bodies differ by as much, where a cut releases nothing.
  bool releases_no_more_than_node_sets_differ() const { return released < 0.003 * stored_before; }
  /// [J] By the balance of energy: what the area takes and the tissue does not give is the blade's work,
  /// without what it rubs on its sides.
  double work_of_blade() const { return std::max(0.0, 1e-6 * toughness_J_m2 * area_mm2 - released); }
};

/// Load-free configuration of a body that was imaged under its loads: see take_loads_off().
struct Unloaded {
  int rounds = 0;
  double taken_back = 0.0;      ///< of a node, from the image to the shape without loads, at most [m]
  double within = 0.0;          ///< how far from the image the loads bring the body back to, at most [m]
  Surface imaged_surface = {};  ///< as the image has it
  Vec3 imaged_centre = Vec3::Zero();  ///< of the bonded patch, as imaged [m]
};

/// The model under its load, and all that is known of how both were made.
struct LoadedModel : ImageFacts {
  LabelImage image;                      ///< until the march begins, where the case began with one
  Index required_nodes = 0;              ///< required by folds or the tool's edge if none were given; 0: none
  std::shared_ptr<const Origin> origin;  ///< of the model, where it is known
  ModelReport report;
  std::map<std::string, std::string> chosen;      ///< option key -> value chosen for it
  std::map<std::string, std::string> provenance;  ///< image, its SHA-256, labels, reasons
  /// Complete until the march: its force system then takes over the gradients. For an accuracy the march
  /// comes before `begin`.
  Model model;
  Tissues tissues;
  Loading loading;
  TimeMode time = TimeMode::quasi_static;
  std::optional<Unloaded> unloaded;  ///< where the body was imaged under its loads
  std::vector<std::string> warnings;
  /// Number of warnings about the image, and of those before the march.
  std::size_t image_warnings = 0, model_warnings = 0;
  StageTimes stages;  ///< of the preprocessing [s]
  /// [s] Reading the image, making the model from it, completing it; without the observer's part.
  double read_s = 0.0, build_s = 0.0, complete_s = 0.0;
};

/// The march of a model through its load.
struct Solution {
  std::vector<Finding> findings;  ///< of the guards: of the model, then of the march
  History history;                ///< the force curve; `interrupted` if it was asked to stop
  /// Force of the tissue on each of loading.further at the last frame [N], and the tool's depth there [m].
  std::vector<Vec3> on_support;
  double on_support_at = 0.0;
  std::optional<Followed> followed;  ///< where a displacement is requested
  std::vector<CutMade> cuts;         ///< by steps that have been done
  double solve_s = 0.0;              ///< [s] without the error estimate
};

/// Errors of the force.
struct ErrorEstimates {
  ErrorBounds error_bounds;
  ImageError image_error;
  double spread = 0.0;                  ///< relative, by the material, +-; 0: none requested
  std::vector<RefinementLevel> levels;  ///< node sets of a requested accuracy; the last is the result's
};

/// The outcome of a case. Each part is there as soon as it is known: also when simulate() throws later.
struct Result : LoadedModel, Solution, ErrorEstimates {};

/// Callbacks of a run. All may be empty.
struct RunObserver {
  enum class Line {
    doing,   ///< what begins now, until the next line
    said,    ///< what was done, and why so
    detail,  ///< the same, for who wants more
    warning  ///< what may make the result another than was meant; kept in Result::warnings too
  };
  std::function<void(Line, const std::string&)> line = {};
  /// A part of the run begins; counts of its work and of what comes after it, as far as they are known.
  std::function<void(Part, const Work&)> part = {};
  /// Nodes and points are placed; nothing expensive is done yet.
  std::function<void(const Discretisation&, const Scheme&)> placed = {};
  /// The model is complete and the case is accepted: the march begins.
  std::function<void(Result&)> begin = {};
  /// A step cuts the body: its model is about to be another; then it is, and the march goes on.
  std::function<void(Result&)> before_cut = {}, after_cut = {};
  Observer march = {};
};

/// Computes the force curve of a case. Prints nothing, writes no file, handles no signal; requested to stop
/// (io/stop.hpp), it throws Stopped, or, once the march has begun, returns what there is.
///
/// With a goal, finer node sets are marched until the error bounds of one are as narrow. That one is the
/// result, and its frames follow its march.
///
/// Throws UsageError, InputError, ModelError: what is wrong with the case; SolveError: why the march ended,
/// and `result` holds everything up to there.
Result simulate(const Case& given, const RunObserver& observer = {});
void simulate(const Case& given, const RunObserver& observer, Result& result);

/// First half of simulate(): the complete model, and the origin that error bounds of a later Case need.
void build_case(const Case& given, const RunObserver& observer, Result& result);

}  // namespace dimple
