#include "apps/studies/run_program.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "apps/ending.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

std::vector<char*> pointers(std::vector<std::string>& words) {
  std::vector<char*> result;
  for (std::string& word : words) result.push_back(word.data());
  result.push_back(nullptr);
  return result;
}

}  // namespace

ProgramRun run_program(const std::vector<std::string>& arguments, const fs::path& folder,
                       const std::string& log, double limit_s, int threads,
                       const std::function<bool()>& stop_requested, double grace_s) {
  std::vector<std::string> words = arguments, environment;
  for (char** entry = environ; *entry != nullptr; ++entry)
    if (std::strncmp(*entry, "OMP_NUM_THREADS=", 16) != 0) environment.emplace_back(*entry);
  environment.push_back(fmt::format("OMP_NUM_THREADS={}", threads));

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addchdir_np(&actions, folder.c_str());
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  // A group of its own, so that what it starts ends with it.
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
  posix_spawnattr_setpgroup(&attributes, 0);
  pid_t child = 0;
  const auto start = std::chrono::steady_clock::now();
  const int failed = posix_spawn(&child, words.front().c_str(), &actions, &attributes, pointers(words).data(),
                                 pointers(environment).data());
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  if (failed != 0)
    throw UsageError({.fact = fmt::format("{} cannot be started", words.front()),
                      .where = "another program",
                      .why = std::strerror(failed),
                      .remedy = "give the path of a program that works"});

  const Child ends_with_this_process(child);
  ProgramRun run;
  const auto seconds = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  int status = 0;
  double asked_at_s = 0.0;
  while (waitpid(child, &status, WNOHANG) == 0) {
    if (!run.interrupted && stop_requested && stop_requested()) {
      run.interrupted = true;
      asked_at_s = seconds();
      if (grace_s > 0.0) kill(-child, SIGTERM);
    }
    run.out_of_time = seconds() > limit_s;
    if ((run.interrupted && seconds() >= asked_at_s + grace_s) || run.out_of_time) {
      kill(-child, SIGKILL);
      waitpid(child, &status, 0);
      break;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  run.seconds = seconds();
  run.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return run;
}

}  // namespace dimple
