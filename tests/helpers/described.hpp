#pragma once

#include "apps/run/organ.hpp"
#include "apps/run/simulate.hpp"
#include "apps/scene/resolve.hpp"

namespace dimple {

/// A case whose scene options describe.
struct Described : Case {
  Config config = {};
  Case resolved() const {
    Case given = *this;
    given.scene = resolve(config);
    return given;
  }
};

inline void simulate(const Described& given, const RunObserver& observer, Result& result) {
  simulate(given.resolved(), observer, result);
}
inline Result simulate(const Described& given, const RunObserver& observer = {}) {
  return simulate(given.resolved(), observer);
}
inline void build_case(const Described& given, const RunObserver& observer, Result& result) {
  build_case(given.resolved(), observer, result);
}
inline Described described(const Config& config) {
  Described given;
  given.config = config;
  return given;
}

}  // namespace dimple
