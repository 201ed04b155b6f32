#pragma once

#include <memory>
#include <string>

#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"

namespace dimple {

/// Reason why such a run has no error bounds, or nothing: they are calibrated for the defaults.
std::string why_no_error_bounds(const Scene& scene);
/// Reason from the scene, the body and how time is followed. `boundary`: in the surface's frame.
std::string why_no_error_bounds(const Scene& scene, const Organ& organ, const Boundary& boundary,
                                const LoadedModel& result);
/// Reason after the run, from its model as well. `scene`: with the choices that its model was made with.
std::string why_no_error_bounds_after(const Scene& scene, const LoadedModel& result);

/// Reason why no other nodes can be made: they need labels of an image that was not kept; or nothing.
std::string why_no_labels(const Scene& scene, const Origin& origin);

/// March of a coarser discretisation of the same organ, for the error bounds. It runs on one processor in
/// parallel with the finer march if one is free, otherwise on request. Both give the same bits.
class CoarserMarch {
 public:
  /// `result`: complete, before its march; not looked at later.
  CoarserMarch(const Scene& scene, const Result& result);
  ~CoarserMarch();  ///< cancels a march whose result was not requested
  CoarserMarch(const CoarserMarch&) = delete;
  CoarserMarch& operator=(const CoarserMarch&) = delete;

  Index nodes() const;
  /// Waits for the march. Throws its error.
  const Result& operator()();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// Error bounds of a finished march, from the march of a coarser discretisation of the same organ.
struct RunErrorBounds {
  ErrorBounds error_bounds;
  double half_of_displacement = 0.0;  ///< [m] if a place is followed
  bool stopped = false;
};
RunErrorBounds error_bounds_of_run(const Scene& scene, const Result& result, CoarserMarch& coarser);

/// Half-width of the bounds of the followed place; `coarse`: its displacement with the coarser nodes [m].
double half_of_displacement(const Result& result, const Vec3& coarse);

}  // namespace dimple
