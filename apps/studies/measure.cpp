#include "apps/studies/measure.hpp"

#include "io/stop.hpp"

namespace dimple {

Measured measure(const Config& config, bool band) {
  require_no_goal(config, "a study");
  RunObserver observer;
  observer.march.sample = [](const ForceSample&, const History&) {
    stop_if_asked();
    return true;
  };
  Result result = simulate({.config = config, .band = band}, observer);
  if (result.history.interrupted) throw Stopped(stop_asked());
  return {.nodes = result.model.node_count(),
          .points = result.model.point_count(),
          .spacing_mm = result.report.spacing_mm,
          .rim_spacing_mm = result.report.rim_spacing_mm,
          .history = std::move(result.history),
          .band = std::move(result.band),
          .warnings = std::move(result.warnings),
          .build_s = result.read_s + result.build_s + result.complete_s,
          .solve_s = result.solve_s};
}

}  // namespace dimple
