#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>

#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"

namespace dimple {

// The steps from a case to the force curve of one cloud: simulate(), the band and the refinement take them.

/// Nodes and points, before anything expensive is done.
struct Placed {
  Discretisation places;
  Scheme scheme;
  std::map<std::string, int> label_names;
};

/// The image of a case, read, or as it was read before, and its site; then its provenance is known too.
/// `before_cuts`, if given, receives it before it is cut.
Organ organ_of(const Case& given, const RunLog& log, Result& result,
               std::optional<Organ>* before_cuts = nullptr);
/// Places for the tool and for the case's own number of nodes. `organ`: nothing where it began with a model.
Placed place(const Case& given, const std::optional<Organ>& organ, const RunLog& log, Result& result);
/// As many nodes as that, whatever the case has chosen.
Placed place(Index nodes, const Scene& scene, const Organ& organ, const LabelImage& image, const RunLog& log,
             Result& result);

/// From places to a model that is complete.
void complete(const Scene& scene, Placed placed, const RunLog& log, LoadedModel& result);
/// The same, and to a load that is accepted. Throws UsageError, ModelError: it is not.
void make_ready(const Case& given, Placed placed, const RunLog& log, Result& result);

/// The place whose displacement the case asks for, if it does. Throws UsageError: it is outside of the body.
std::optional<Followed> followed_in(const Scene& scene, const Organ& organ);

class CutScene;  // cut_scene.hpp

/// Marches a model that is complete, and keeps what comes of it: history, findings, where the place goes that
/// is followed. Where the scene has steps that cut, `cuts` makes them, and the result's model is then
/// another. Asked to stop it returns what there is, `interrupted`. What is returned is to outlive the frames'
/// forces.
std::unique_ptr<ForceSystem> march(const Scene& scene, const SolverOptions& options, const Observer& observer,
                                   const MarchState* from, const RunLog& log, Result& result,
                                   CutScene* cuts = nullptr, const RunObserver* watching = nullptr);

/// What else the clouds of the result's organ are made from, but for the image.
std::shared_ptr<Origin> origin_of(const Scene& scene, Organ organ, const Result& result);
/// As it is, but with the nodes, points, base and circle that the model was made with.
Scene with_model_of(const Scene& scene, const ModelChoices& made);

}  // namespace dimple
