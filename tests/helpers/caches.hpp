#pragma once

#include <Eigen/Core>

namespace dimple::testing_bodies {

/// Makes Eigen assume so many bytes of first-level cache during its lifetime.
struct Caches {
  explicit Caches(std::ptrdiff_t first) { Eigen::setCpuCacheSizes(first, 8 * first, 64 * first); }
  ~Caches() { Eigen::setCpuCacheSizes(own[0], own[1], own[2]); }
  Caches(const Caches&) = delete;
  Caches& operator=(const Caches&) = delete;

 private:
  std::ptrdiff_t own[3] = {Eigen::l1CacheSize(), Eigen::l2CacheSize(), Eigen::l3CacheSize()};
};

}  // namespace dimple::testing_bodies
