#include "apps/studies/run_program.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstring>
#include <thread>

#include "apps/ending.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

}  // namespace

ProgramRun run_program(const std::vector<std::string>& arguments, const fs::path& folder,
                       const std::string& log, const std::function<bool()>& stop_requested, double grace_s) {
  std::vector<std::string> words = arguments;
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addchdir_np(&actions, folder.c_str());
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  // Its own process group, so that its children end with it.
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  posix_spawnattr_setpgroup(&attributes, 0);
  pid_t child = 0;
  const int failed =
      posix_spawn(&child, words.front().c_str(), &actions, &attributes, pointers.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  if (failed != 0)
    throw UsageError({.fact = fmt::format("{} cannot be started", words.front()),
                      .where = "another program",
                      .why = std::strerror(failed),
                      .remedy = "give the path of an executable program"});

  const Child ends_with_this_process(child);
  ProgramRun run;
  int status = 0;
  Clock::time_point requested;
  while (waitpid(child, &status, WNOHANG) == 0) {
    if (!run.interrupted && stop_requested && stop_requested()) {
      run.interrupted = true;
      requested = Clock::now();
      if (grace_s > 0.0) kill(-child, SIGTERM);
    }
    if (run.interrupted && Clock::now() >= requested + std::chrono::duration<double>(grace_s)) {
      kill(-child, SIGKILL);
      waitpid(child, &status, 0);
      break;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  run.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return run;
}

}  // namespace dimple
