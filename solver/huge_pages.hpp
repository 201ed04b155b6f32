#pragma once

#include <cstdint>
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
#if defined(__linux__)
    // Mapped afresh: memory that the heap reuses is in small pages.
    if (const std::size_t bytes = whole_pages(count); bytes > 0) {
      void* room = mmap(nullptr, bytes + page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
      if (room == MAP_FAILED) throw std::bad_alloc();
      char* begin = static_cast<char*>(room);
      const std::size_t before = (page - reinterpret_cast<std::uintptr_t>(begin) % page) % page;
      if (before > 0) munmap(begin, before);
      munmap(begin + before + bytes, page - before);
      madvise(begin + before, bytes, MADV_HUGEPAGE);  // a hint: it may fail
      return reinterpret_cast<T*>(begin + before);
    }
#endif
    void* memory = std::aligned_alloc(64, (count * sizeof(T) + 63) / 64 * 64);
    if (!memory) throw std::bad_alloc();
    return static_cast<T*>(memory);
  }
  void deallocate(T* memory, std::size_t count) {
#if defined(__linux__)
    if (const std::size_t bytes = whole_pages(count); bytes > 0) {
      munmap(static_cast<void*>(memory), bytes);
      return;
    }
#endif
    std::free(memory);
  }
  bool operator==(const HugePages&) const {
    return true;
  }

 private:
  static std::size_t whole_pages(std::size_t count) {  // 0: too few bytes
    const std::size_t bytes = count * sizeof(T);
    return bytes < page / 4 ? 0 : (bytes + page - 1) / page * page;
  }
};

template <class T>
using LongVector = std::vector<T, HugePages<T>>;

}  // namespace dimple
