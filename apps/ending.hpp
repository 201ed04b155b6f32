#pragma once

#include <functional>
#include <thread>

#include "io/stop.hpp"

namespace dimple {

/// Hears Ctrl-C, SIGTERM, SIGHUP and the clock for as long as it lives, and asks all work to end
/// (io/stop.hpp). What has not ended by itself within 1.2 s is ended: temporaries and programs started from
/// here go, and the process returns 130. A second signal does so at once, a third one kills. One at a time.
class Ending {
 public:
  Ending();
  ~Ending();
  Ending(const Ending&) = delete;
  Ending& operator=(const Ending&) = delete;

  /// Work is to end this long after the start of the process.
  void limit(double seconds);
  /// What is still to be written when the process is ended: from another thread, while others are at work.
  void last_words(std::function<void(const Stopped&)> write);

 private:
  std::jthread thread_;
};

/// Wall time since the system started this process: what a person has waited for [s].
double seconds_since_start();

/// A program started from here, with the group of its own that it leads: it ends when this process is ended.
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
