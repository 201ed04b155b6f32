#pragma once

#include <vector>

#include "apps/run/organ.hpp"
#include "apps/run/pipeline.hpp"
#include "apps/run/steps.hpp"
#include "solver/march/steps.hpp"

namespace dimple {

/// Scene with steps that cut the deformed body: [step.NAME] with a cut. The blade is mapped to the tissue at
/// rest (carried_back()). The body at rest is cut there, by all blades so far, and gets new nodes.
/// Equilibrium is found from the displacements of the previous nodes, at the held pose of all tools.
class CutScene {
 public:
  /// `organ`: before any cut. `given` must outlive this.
  CutScene(const Case& given, Organ organ);

  std::size_t count() const { return steps_.size(); }
  /// Part of the load between cut k - 1 and cut k; 0: before any.
  ScenePart part(std::size_t k) const;
  /// Makes cut k, from 0, at the end of `part`: `result` gets the new model and load, and `next` its start.
  /// Throws ModelError, UsageError, InputError: it cannot be made.
  void cut(std::size_t k, const ScenePart& part, const RunLog& log, Result& result, ScenePart& next);
  /// Records the result of the last cut for the summary, and reports it in a line.
  void report_to(const ScenePart& part, const RunLog& log, Solution& result);

 private:
  void make_again(const RunLog& log, Result& result);

  const Case& given_;
  Organ whole_;
  std::vector<CutStep> steps_;
  StepCuts done_;
};

std::string in_words(const CutMade& made);

}  // namespace dimple
