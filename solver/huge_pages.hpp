#pragma once

#include <cstdlib>
#include <new>
#include <vector>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace dimple {

/// Memory of long arrays that are read from end to end, in pages of 2 MiB where the system has them: with
/// pages of 4 KiB the processor stops fetching ahead at each, a third of the time of a force evaluation.
template <class T>
struct HugePages {
  using value_type = T;
  static constexpr std::size_t page = std::size_t{2} << 20;

  HugePages() = default;
  template <class U>
  HugePages(const HugePages<U>&) {}  // NOLINT: allocators convert

  T* allocate(std::size_t count) {
    const std::size_t bytes = (count * sizeof(T) + page - 1) / page * page;
    void* memory = bytes >= 2 * page ? std::aligned_alloc(page, bytes)
                                     : std::aligned_alloc(64, (count * sizeof(T) + 63) / 64 * 64);
    if (!memory) throw std::bad_alloc();
#if defined(__linux__)
    if (bytes >= 2 * page) madvise(memory, bytes, MADV_HUGEPAGE);  // a wish: where it fails nothing is lost
#endif
    return static_cast<T*>(memory);
  }
  void deallocate(T* memory, std::size_t) {
    std::free(memory);
  }
  bool operator==(const HugePages&) const {
    return true;
  }
};

template <class T>
using LongVector = std::vector<T, HugePages<T>>;

}  // namespace dimple
