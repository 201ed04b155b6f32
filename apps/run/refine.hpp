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

// Clouds from coarse to fine, until the band of one is as narrow as asked.

/// A frame that is kept, because whether its cloud is fine enough shows only at the end.
struct KeptFrame {
  int number;
  double t, depth;
  ForceSystem::Nodal u, f;
  ForceState forces;
};

/// One cloud, marched to the end, and what nobody has heard of it yet.
struct Level {
  Result result;
  std::vector<std::pair<RunObserver::Line, std::string>> lines;
  std::unique_ptr<ForceSystem> system;  ///< of the frames' forces
  std::vector<KeptFrame> frames;
  Index asked = 0;  ///< nodes
  double seconds = 0.0;
};

/// Why a refinement has ended before its goal.
struct RefinementEnd {
  enum class Why { stopped, failed, out_of_time, too_many_nodes } why;
  Index nodes = 0;        ///< of the cloud that failed, or for which there is no time
  double seconds = 0.0;   ///< that it would take
  std::string fact = {};  ///< why it failed
};

struct Refinement {
  std::unique_ptr<Level> finest;               ///< there is one
  std::vector<RefinementLevel> levels;         ///< that came to a force
  std::optional<RefinementEnd> stopped_short;  ///< nothing: the goal was reached
  std::optional<RefinementEnd> failed;         ///< the coarsest cloud finer than one with a force
  Index too_coarse = 0;                        ///< nodes of the last that failed before any force
  double seconds = 0.0;
};

/// What is heard meanwhile, with the number of the level.
struct RefinementObserver {
  std::function<void(int, const RefinementLevel&)> marched = {};
  std::function<void(int, Index nodes, const std::string& fact)> failed = {};
  const RunObserver& of_march;  ///< what a level begins with, and its parts; the rest of it is kept
};

/// `from`: organ, image and choices; `read`: what was told of them, and the place that is followed. `whole`:
/// since when the budget counts. Throws, where no cloud came to a force, what the last one threw; Stopped
/// too.
Refinement refine(const Case& given, const Goal& goal, const Origin& from, const Result& read,
                  const Stopwatch& whole, const RefinementObserver& observer);

/// Throws UsageError if there is a reason why no band is known.
void refuse_without_band(const std::string& none);
/// Throws UsageError: the scene asks for a smaller error than two clouds can show by other than chance.
void check_goal(const Scene& scene);

/// What an accuracy is asked of, and half its band's width: of the displacement where one is asked for.
std::pair<double, double> asked_for(const RefinementLevel& level, const Solution& result);

/// The march of a level, for who has not seen it. It becomes the result.
void replay(Level level, const RunObserver& observer, Result& result);

}  // namespace dimple
