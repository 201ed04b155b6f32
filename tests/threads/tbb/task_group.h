#pragma once

// tbb::task_group for the thread sanitizer, by plain threads; why: parallel_for.h.

#include <thread>
#include <utility>
#include <vector>

namespace tbb {

class task_group {
 public:
  template <class Body>
  void run(Body body) {
    threads_.emplace_back(std::move(body));
  }
  void wait() {
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
  }
  ~task_group() { wait(); }

 private:
  std::vector<std::thread> threads_;
};

}  // namespace tbb
