#pragma once

#include <memory>
#include <string>

#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"

namespace dimple {

/// Why the band of such a run cannot be told, or nothing: it was measured for what is the default.
std::string why_no_band(const Scene& scene);
/// Likewise, once it is known how time is followed and what the body looks like. `boundary`: in the surface's
/// frame.
std::string why_no_band(const Scene& scene, const Organ& organ, const Boundary& boundary,
                        const LoadedModel& result);
/// Likewise, of a march that has come to its end. `scene`: with the choices that its model was made with.
std::string why_no_band_after(const Scene& scene, const LoadedModel& result);

/// That other clouds need the labels of an origin's image, and that these are not there; or nothing.
std::string why_no_labels(const Scene& scene, const Origin& origin);

/// The march of a coarser cloud of the same organ, by which a band is found. Where a processor can be spared
/// it runs beside the march of the finer cloud, on one; otherwise when it is asked for. The same bits either
/// way.
class CoarserMarch {
 public:
  /// `result`: complete, before its march; not looked at later.
  CoarserMarch(const Scene& scene, const Result& result);
  ~CoarserMarch();  ///< an answer that nobody has asked for is given up
  CoarserMarch(const CoarserMarch&) = delete;
  CoarserMarch& operator=(const CoarserMarch&) = delete;

  Index nodes() const;
  /// Waits for it. Throws what it met.
  const Result& operator()();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

/// The band of a march that has come to its end, from the march of a coarser cloud of the same organ.
struct BandOfRun {
  Band band;
  double half_of_displacement = 0.0;  ///< [m] where one is followed
  bool stopped = false;
};
BandOfRun band_of_run(const Scene& scene, const Result& result, CoarserMarch& coarser);

/// Half the band's width of the place that is followed, where a coarser cloud brings it to `coarse` [m].
double half_of_displacement(const Result& result, const Vec3& coarse);

}  // namespace dimple
