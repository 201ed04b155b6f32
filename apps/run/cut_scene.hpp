#pragma once

#include <vector>

#include "apps/run/organ.hpp"
#include "apps/run/pipeline.hpp"
#include "apps/run/steps.hpp"
#include "solver/march/steps.hpp"

namespace dimple {

/// A scene whose steps cut the body where it then is: [step.NAME] with a cut. The blade is carried back to
/// where the tissue that it passes through was at rest (carried_back()); the whole body at rest is cut there,
/// by all blades so far, and gets nodes of its own; the displacements that the nodes before had are those
/// from which equilibrium is found, at the held pose of all tools.
class CutScene {
 public:
  /// `organ`: before it was cut. `given` must outlive this.
  CutScene(const Case& given, Organ organ);

  std::size_t count() const { return steps_.size(); }
  /// The body between cut k - 1 and cut k; 0: before any.
  ScenePart part(std::size_t k) const;
  /// Makes the cut k, 0 the first, where `part` has left the body: `result` has then its model and its load,
  /// and `next` where it is about. Throws ModelError, UsageError, InputError: it cannot be made.
  void cut(std::size_t k, const ScenePart& part, const RunLog& log, Result& result, ScenePart& next);
  /// What came of the last, for the summary; told in a line.
  void tell(const ScenePart& part, const RunLog& log, Result& result);

 private:
  void make_again(const RunLog& log, Result& result);

  const Case& given_;
  Organ whole_;
  std::vector<CutStep> steps_;
  StepCuts done_;
};

std::string in_words(const CutMade& made);

}  // namespace dimple
