#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/stopwatch.hpp"

namespace dimple {

// Refinement: node sets from coarse to fine, until the error bounds of one are as narrow as requested.
//
// 1. expected_nodes() estimates the number of nodes from the floor of the bounds.
// 2. The first level has half of it, at most 4000 nodes. It is marched to the end, and its frames are kept.
// 3. The second level has about the expected number. The bounds of a level come from the level before.
// 4. If they are narrow enough, the level becomes the result, and replay() passes on its frames.
// 5. Otherwise the next level has two or four times the nodes, within the time budget and 64,000 nodes.
// 6. After a failure it has twice the nodes if no level has a force yet, else half of those that failed.
// 7. If only one level has a force because finer ones fail, it is compared with one of half its nodes.
//
// The bounds are those of the bonded patch (`error_bounds.hpp`, with their calibration). Evidence: coverage
// and cost of the goals in tests/verification/results/band_goals.csv.

/// Frame that is kept, since only the end of the march shows whether its level is fine enough.
struct KeptFrame {
  int number;
  double t, depth;
  ForceSystem::Nodal u, f;
  ForceState forces;
};

/// One discretisation, marched to the end, with the messages and frames not passed on yet.
struct Level {
  Result result;
  std::vector<std::pair<RunObserver::Line, std::string>> lines;
  std::unique_ptr<ForceSystem> system;  ///< for the forces of the frames
  std::vector<KeptFrame> frames;
  Index requested = 0;  ///< requested nodes
  double seconds = 0.0;
};

/// Reason why a refinement has ended before its goal.
struct RefinementEnd {
  enum class Why { stopped, failed, out_of_time, too_many_nodes } why;
  Index nodes = 0;        ///< of the level that failed, or that the budget does not allow
  double seconds = 0.0;   ///< expected time of that level [s]
  std::string fact = {};  ///< reason of the failure
};

struct Refinement {
  std::unique_ptr<Level> finest;               ///< not null
  std::vector<RefinementLevel> levels;         ///< that reached a force
  std::optional<RefinementEnd> stopped_short;  ///< empty: the goal was reached
  std::optional<RefinementEnd> failed;         ///< the coarsest level above one with a force
  Index too_coarse = 0;                        ///< nodes of the last level that failed before any force
  double seconds = 0.0;
};

/// Callbacks of a refinement, with the number of the level.
struct RefinementObserver {
  std::function<void(int, const RefinementLevel&)> marched = {};
  std::function<void(int, Index nodes, const std::string& fact)> failed = {};
  const RunObserver& of_march;  ///< receives the start of a level and its parts; other events are kept
};

/// Refines. `from`: organ, image and choices; `read`: facts of the image and the followed place; `whole`:
/// clock of the time budget. Throws the error of the last level if none reached a force; Stopped too.
Refinement refine(const Case& given, const Goal& goal, const Origin& from, const Result& read,
                  const Stopwatch& whole, const RefinementObserver& observer);

/// Throws UsageError if there is a reason why there are no error bounds.
void refuse_without_error_bounds(const std::string& none);
/// Throws UsageError: the requested error is below the scatter of two node sets.
void check_goal(const Scene& scene);

/// Quantity of a requested accuracy, displacement or force, and half-width of its error bounds.
std::pair<double, double> requested_for(const RefinementLevel& level, const Solution& result);

/// Passes on the messages and frames of a level, which becomes the result.
void replay(Level level, const RunObserver& observer, Result& result);

}  // namespace dimple
