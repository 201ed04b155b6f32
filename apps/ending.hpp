#pragma once

#include <functional>
#include <thread>

#include "io/stop.hpp"

namespace dimple {

/// Handler of Ctrl-C, SIGTERM, SIGHUP and the time limit, while it exists: requests a stop of all work
/// (io/stop.hpp). If that takes more than 1.2 s, it removes temporaries, ends child programs and returns 130
/// from the process. A second signal does so at once, a third one kills. Only one may exist at a time.
class Ending {
 public:
  Ending();
  ~Ending();
  Ending(const Ending&) = delete;
  Ending& operator=(const Ending&) = delete;

  /// Sets the time limit, from the start of the process.
  void limit(double seconds);
  /// Sets the function that writes what remains when the process is ended. Another thread calls it during the
  /// computation.
  void last_words(std::function<void(const Stopped&)> write);

 private:
  std::jthread thread_;
};

/// Wall time since the system started this process [s].
double seconds_since_start();

/// Child program that leads its own process group; it ends when this process is ended.
class Child {
 public:
  explicit Child(int group);
  ~Child();
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

 private:
  int slot_ = -1;
};

}  // namespace dimple
