#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>

#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"

namespace dimple {

// Steps from a case to the force curve of one node set, for simulate(), the error bounds and the refinement.

/// Nodes and points, before anything expensive is done.
struct NodePlacement {
  Discretisation places;
  Scheme scheme;
  std::map<std::string, int> label_names;
};

/// Organ of a case, from its image or read before, with its site and provenance. `before_cuts`, if given,
/// receives it uncut.
Organ organ_of(const Case& given, const RunLog& log, Result& result,
               std::optional<Organ>* before_cuts = nullptr);
/// Places with the case's own number of nodes. `organ`: none if the case begins with a model.
NodePlacement place(const Case& given, const std::optional<Organ>& organ, const RunLog& log, Result& result);
/// Places with this number of nodes, whatever the case has chosen.
NodePlacement place(Index nodes, const Scene& scene, const Organ& organ, const LabelImage& image,
                    const RunLog& log, Result& result);

/// Makes a complete model from places.
void complete(const Scene& scene, NodePlacement placed, const RunLog& log, LoadedModel& result);
/// Makes a model and an accepted load from places. Throws UsageError, ModelError: they are not accepted.
void make_ready(const Case& given, NodePlacement placed, const RunLog& log, Result& result);

/// Followed place, if the case requests its displacement. Throws UsageError: it is outside of the body.
std::optional<Followed> followed_in(const Scene& scene, const Organ& organ);

class CutScene;  // cut_scene.hpp

/// Marches a complete model and keeps history, findings and displacement of the followed place. If steps of
/// the scene cut, `cuts` makes the cuts and replaces the result's model. If stopped, it returns the results
/// so far, `interrupted`. The returned system must outlive the frames' forces.
std::unique_ptr<ForceSystem> march(const Scene& scene, const SolverOptions& options, const Observer& observer,
                                   const MarchState* from, const RunLog& log, Result& result,
                                   CutScene* cuts = nullptr, const RunObserver* watching = nullptr);

/// Origin of the result's model, without the image.
std::shared_ptr<Origin> origin_of(const Scene& scene, Organ organ, const Result& result);
/// Scene with the nodes, points, base and bonded patch that the model was made with.
Scene with_model_of(const Scene& scene, const ModelChoices& made);

}  // namespace dimple
