#pragma once

#include <sys/resource.h>

#include <csignal>

namespace dimple {

/// Simulates a full disk: no file may grow beyond `bytes` during its lifetime.
struct SmallDisk {
  rlimit before{};
  explicit SmallDisk(rlim_t bytes) {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before);
    const rlimit limit{bytes, before.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~SmallDisk() { setrlimit(RLIMIT_FSIZE, &before); }
};

}  // namespace dimple
