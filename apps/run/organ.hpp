#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/simulate.hpp"
#include "preprocess/image/close_gaps.hpp"

namespace dimple {

// Parts of simulate() up to the places of nodes and points.

/// Work of the run, from what is known so far.
Work work_of(const Scene& scene, const LoadedModel& result);

/// Lines and warnings for the observer; warnings are kept in the result too.
struct RunLog {
  const RunObserver& observer;
  LoadedModel& result;
  void line(RunObserver::Line kind, const std::string& text) const {
    if (observer.line) observer.line(kind, text);
  }
  void doing(const std::string& text) const { line(RunObserver::Line::doing, text); }
  void begin(Part part, const Scene& scene) const {
    if (observer.part) observer.part(part, work_of(scene, result));
  }
  void say(const std::string& text) const { line(RunObserver::Line::said, text); }
  void detail(const std::string& text) const { line(RunObserver::Line::detail, text); }
  void warn(const std::string& text) const {
    result.warnings.push_back(text);
    line(RunObserver::Line::warning, text);
  }
};

/// Name for messages: the image's file, or a note that there was none.
std::string name_of_image(const ModelChoices& choices);
/// Checksum of the file; of an image without one, of its labels and their grid.
std::string sha256_of_image(const ModelChoices& choices, const LabelImage& image);

void say_default_stiffness(const RunLog& log, const Scene& scene);

/// Tissues of scene.tissues by their labels. Throws InputError: a label has no point, and no step has removed
/// it.
TissueOptions tissues_of(const Scene& scene, const std::map<std::string, int>& label_names,
                         const Discretisation& places, const std::vector<LabelMeasure>& taken_out = {});

/// Body from the image and the options, before any node is placed.
struct Organ {
  ModelOptions options;
  std::vector<int> labels;                         ///< of the body; none: all
  std::optional<ClosedImage> closed = {};          ///< replaces the image
  std::string closing = {};                        ///< description of the closed gaps
  std::shared_ptr<const SegmentedBody> body = {};  ///< common to all models of the organ
  std::shared_ptr<const Site> site = {};           ///< likewise, once found under these options
  std::map<std::string, int> label_names = {};
};

/// Organ with the results of reading it, of which several models are made (Case::organ).
struct PreparedOrgan {
  Organ organ;
  Result read;  ///< image, labels, segment, warnings
  /// Site and places of one model made of it: a case that requests the same site, or the same places, uses
  /// them.
  struct Made {
    Scene scene;
    std::shared_ptr<const Site> site;
    Index nodes = 0;  ///< requested
    Discretised at;
    double site_s = 0.0, places_s = 0.0;  ///< their durations
  };
  std::shared_ptr<const Made> made = {};
};
PreparedOrgan read_once(const Case& given, const RunObserver& observer);
/// Site and places from the run of a case on that organ; null if it was cut or its loads were removed.
std::shared_ptr<const PreparedOrgan::Made> made_in(const Scene& scene, const LoadedModel& found);

/// Origin of a model in memory, from which its further discretisations are made.
struct Origin {
  ModelChoices choices;
  Organ organ;
  LabelImage image;  ///< of the labels, if tissues differ
  ImageFacts facts;
  std::vector<std::string> image_warnings;
  Boundary boundary;  ///< in the surface's frame
};

/// Reads the image, chooses its labels, closes gaps and makes the surface.
Organ read_organ(const Case& given, const ModelOptions& options, const RunLog& log, Result& result);

/// Label of a place, if labels differ in tissue or one is a support; otherwise their borders have no meaning.
/// Valid as long as the image exists.
LabelAt labels_of(const Scene& scene, const Organ& organ, const LabelImage& image);

/// Finds the base of the organ and the place of the tool, under the organ's options.
void find_site(const Scene& scene, const RunLog& log, Organ& organ, LoadedModel& result);

/// All cuts that the steps of a scene have made so far.
struct StepCuts {
  std::vector<TriangleMesh> sheets;  ///< in the body at rest [mm, LPS]
  std::vector<std::string> labels;   ///< that the last cut removes
  bool has_taken_labels = false;     ///< in any of them
  std::string where;                 ///< of the last cut
};
/// Cuts the organ. `whole`: before any cut except of labels, without its site. Base and tool keep their
/// places. The result's labels and cut become those of the remaining organ. Throws ModelError ("cut"),
/// InputError: there is no such label.
Organ cut_by_steps(const Scene& scene, const Organ& whole, const LabelImage& image, const StepCuts& cuts,
                   const RunLog& log, LoadedModel& result);

/// Nodes, points, base and bonded patch of an organ with a site; adds them to the image's provenance.
/// `options` differ from the organ's in the number of nodes at most. `made`: the same, if available.
Discretisation place_nodes(const Scene& scene, const Organ& organ, const ModelOptions& options,
                           const LabelImage& image, const RunLog& log, LoadedModel& result,
                           const Discretised* made = nullptr);

}  // namespace dimple
