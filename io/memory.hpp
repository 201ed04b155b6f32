#pragma once

#include <sys/resource.h>
#include <unistd.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include <algorithm>
#include <fstream>

/// Control of jemalloc, where a program is linked to it.
extern "C" int mallctl(const char* name, void* old, size_t* old_size, void* value, size_t value_size)
    __attribute__((weak));

namespace dimple {

/// Memory that this process may use [bytes]: all of the machine, or the least limit set to it (ulimit -v, a
/// container's). Not the free memory, which changes by the second.
inline double memory_at_hand() {
  double memory = static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGESIZE));
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY)
    memory = std::min(memory, static_cast<double>(limit.rlim_cur));
  for (const char* file : {"/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"}) {
    std::ifstream in(file);
    double bytes = 0.0;
    if (in >> bytes && bytes > 0.0) memory = std::min(memory, bytes);  // "max": no limit
  }
  return memory;
}

/// Returns freed memory to the system. The C library would keep half a gigabyte at a hundred thousand nodes,
/// of millions of small lists or of the texts of large files.
inline void give_back_memory() {
  if (mallctl != nullptr) {
    mallctl("arena.4096.purge", nullptr, nullptr, nullptr, 0);  // 4096: all arenas
    return;
  }
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

}  // namespace dimple
