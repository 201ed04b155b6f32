#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/simulate.hpp"
#include "preprocess/image/close_gaps.hpp"

namespace dimple {

// What simulate() is made of, up to the places of nodes and points.

/// As far as it is known yet.
Work work_of(const Scene& scene, const LoadedModel& result);

/// What is told to the observer; warnings are kept too.
struct RunLog {
  const RunObserver& observer;
  Result& result;
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

/// For people: the image's file, or that it was given without one.
std::string name_of_image(const ModelChoices& choices);
/// Of the file; of an image without one, of its labels and where they lie.
std::string sha256_of_image(const ModelChoices& choices, const LabelImage& image);

void say_default_stiffness(const RunLog& log, const Scene& scene);

/// The tissues of scene.tissues by their labels. Throws InputError: one has no point, and is not among those
/// that a step has taken out.
TissueOptions tissues_of(const Scene& scene, const std::map<std::string, int>& label_names,
                         const Discretisation& places, const std::vector<LabelMeasure>& taken_out = {});

/// The body as the image and the options give it, before any node is placed.
struct Organ {
  ModelOptions options;
  std::vector<int> labels;                         ///< taken; none: all
  std::optional<ClosedImage> closed = {};          ///< instead of the image
  std::string closing = {};                        ///< what was closed, in a sentence
  std::shared_ptr<const SegmentedBody> body = {};  ///< that of all models made of the organ
  std::shared_ptr<const Site> site = {};           ///< likewise, once it is known under its options
  std::map<std::string, int> label_names = {};
};

/// An organ with all that was found on the way to it: several models are made of it (Case::organ).
struct ReadOrgan {
  Organ organ;
  Result read;  ///< image, labels, segment, warnings
  /// Of one model that was made of it: a case that asks for the same site, or for the same places, takes
  /// them.
  struct Made {
    Scene scene;
    std::shared_ptr<const Site> site;
    Index nodes = 0;  ///< asked for
    Discretised at;
    double site_s = 0.0, places_s = 0.0;  ///< what they took
  };
  std::shared_ptr<const Made> made = {};
};
ReadOrgan read_once(const Case& given, const RunObserver& observer);
/// What was made in the run of a case on that organ; null where it was cut, or its loads were taken off it.
std::shared_ptr<const ReadOrgan::Made> made_in(const Scene& scene, const LoadedModel& found);

/// What a model in memory was made from, and what else its clouds are made from.
struct Origin {
  ModelChoices choices;
  Organ organ;
  LabelImage image;  ///< of the labels, where tissues differ
  ImageFacts facts;
  std::vector<std::string> image_warnings;
  Boundary boundary;  ///< in the surface's own frame
};

/// Reads the image, takes its labels, closes its gaps, draws the surface.
Organ read_organ(const Case& given, const ModelOptions& options, const RunLog& log, Result& result);

/// The label of a place, where labels are of several tissues or one is a support; where they are all of one
/// their borders mean nothing. Good for as long as the image is.
LabelAt labels_of(const Scene& scene, const Organ& organ, const LabelImage& image);

/// Where the organ rests and the tool stands, under its options.
void find_site(const Scene& scene, const RunLog& log, Organ& organ, LoadedModel& result);

/// What steps of a scene have cut, all of them so far.
struct StepCuts {
  std::vector<TriangleMesh> sheets;  ///< as they lie in the body at rest [mm, LPS]
  std::vector<std::string> labels;   ///< that the last of them takes out
  bool has_taken_labels = false;     ///< any of them
  std::string where;                 ///< the option of the last
};
/// `whole`: the organ before any cut but of labels, its site unknown. Base and tool stay where they are on
/// it. The result's labels and cut become those of the organ that is left. Throws ModelError ("cut"),
/// InputError: there is no such label.
Organ cut_by_steps(const Scene& scene, const Organ& whole, const LabelImage& image, const StepCuts& cuts,
                   const RunLog& log, LoadedModel& result);

/// Nodes, points, base and circle of an organ whose site is known; `options` differ from the organ's in the
/// number of nodes, if at all. Adds them to the provenance of the image. `made`: the same, if it is known.
Discretisation place_nodes(const Scene& scene, const Organ& organ, const ModelOptions& options,
                           const LabelImage& image, const RunLog& log, LoadedModel& result,
                           const Discretised* made = nullptr);

}  // namespace dimple
