#include "tests/end_to_end/program.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <pty.h>
#include <sys/ioctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

namespace dimple {

namespace fs = std::filesystem;

Program::Program(const fs::path& folder, const std::vector<std::string>& arguments,
                 const std::string& program) {
  static int count = 0;
  const std::string stem = "said_" + std::to_string(++count);
  out_ = process_folder() / (stem + ".out");
  err_ = process_folder() / (stem + ".err");
  std::vector<std::string> words = {program};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);

  pid_ = fork();
  if (pid_ < 0) throw std::runtime_error("fork failed");
  if (pid_ > 0) return;
  const auto redirect = [](const char* file, int flags, int to) {
    const int from = open(file, flags, 0600);
    if (from < 0 || dup2(from, to) < 0) _exit(125);
    close(from);
  };
  redirect("/dev/null", O_RDONLY, STDIN_FILENO);
  redirect(out_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, STDOUT_FILENO);
  redirect(err_.c_str(), O_WRONLY | O_CREAT | O_TRUNC, STDERR_FILENO);
  if (chdir(folder.c_str()) != 0) _exit(125);
  execv(argv[0], argv.data());
  _exit(127);
}

Program::~Program() {
  if (!ended_) {
    kill(pid_, SIGKILL);
    reap(0);
  }
  std::error_code ignored;
  fs::remove(out_, ignored);
  fs::remove(err_, ignored);
}

namespace {

double seconds_of(const timeval& t) {
  return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
}

// CPU time of the process and its ended children: fields 14 to 17 of proc(5), in ticks.
double cpu_seconds_of(const std::string& pid) {
  const fs::path proc = fs::path("/proc") / pid;
  const std::string stat = text_of(proc / "stat");
  const std::size_t name_end = stat.rfind(')');
  if (name_end == std::string::npos) return 0.0;  // it has ended
  std::istringstream fields(stat.substr(name_end + 1));
  std::string field;
  double ticks = 0.0;
  for (int k = 3; k <= 17 && fields >> field; ++k)
    if (k >= 14) ticks += std::stod(field);
  double seconds = ticks / static_cast<double>(sysconf(_SC_CLK_TCK));
  std::error_code ignored;
  for (const auto& thread : fs::directory_iterator(proc / "task", ignored)) {
    std::istringstream children(text_of(thread.path() / "children"));
    for (std::string child; children >> child;) seconds += cpu_seconds_of(child);
  }
  return seconds;
}

}  // namespace

double cpu_of(double seconds) {
  return seconds * std::max(1u, std::thread::hardware_concurrency());
}

double Program::cpu_s() const {
  return ended_ ? cpu_s_ : cpu_seconds_of(std::to_string(pid_));
}

bool Program::reap(int options) {
  rusage used{};
  if (wait4(pid_, &status_, options, &used) != pid_) return false;
  peak_MB_ = static_cast<double>(used.ru_maxrss) / 1024.0;
  cpu_s_ = seconds_of(used.ru_utime) + seconds_of(used.ru_stime);
  return true;
}

bool Program::running() {
  if (!ended_) ended_ = reap(WNOHANG);
  return !ended_;
}

void Program::wait_until_it_listens() {
  for (; running(); std::this_thread::sleep_for(std::chrono::milliseconds(5))) {
    std::istringstream status(text_of("/proc/" + std::to_string(pid_) + "/status"));
    for (std::string line; std::getline(status, line);)
      if (line.starts_with("SigCgt:") && (std::stoull(line.substr(7), nullptr, 16) >> (SIGINT - 1) & 1) != 0)
        return;
  }
}

std::string Program::err_so_far() const {
  return text_of(err_);
}

void Program::send(int signal) const {
  if (!ended_) kill(pid_, signal);
}

Ran Program::wait() {
  if (!ended_) reap(0);
  ended_ = true;
  return {.code = WIFEXITED(status_) ? WEXITSTATUS(status_) : 128 + WTERMSIG(status_),
          .out = text_of(out_),
          .err = text_of(err_),
          .peak_MB = peak_MB_,
          .cpu_s = cpu_s_};
}

Ran dimple(const fs::path& folder, const std::vector<std::string>& arguments) {
  return Program(folder, arguments).wait();
}

std::vector<std::string> words_of(const std::string& arguments) {
  std::istringstream words(arguments);
  std::vector<std::string> list;
  for (std::string word; words >> word;) list.push_back(word);
  return list;
}

Ran dimple(const fs::path& folder, const std::string& arguments) {
  return dimple(folder, words_of(arguments));
}

Ran good(const fs::path& folder, const std::vector<std::string>& arguments) {
  const Ran ran = dimple(folder, arguments);
  std::string line = "dimple";
  for (const std::string& word : arguments) line += ' ' + word;
  EXPECT_EQ(ran.code, 0) << line << '\n' << ran.err;
  return ran;
}

Ran good(const fs::path& folder, const std::string& arguments) {
  return good(folder, words_of(arguments));
}

Ran dimple_on_terminal(const fs::path& folder, const std::vector<std::string>& arguments, int columns) {
  std::vector<std::string> words = {DIMPLE_PROGRAM};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  winsize size{};
  size.ws_row = 50;
  size.ws_col = static_cast<unsigned short>(columns);
  int terminal = -1;
  const pid_t pid = forkpty(&terminal, nullptr, nullptr, &size);
  if (pid < 0) throw std::runtime_error("forkpty failed");
  if (pid == 0) {
    unsetenv("COLUMNS");
    setenv("TERM", "xterm", 1);
    if (chdir(folder.c_str()) != 0) _exit(125);
    execv(argv[0], argv.data());
    _exit(127);
  }
  Ran ran;
  char text[4096];
  for (ssize_t got = 0;
       (got = read(terminal, text, sizeof text)) > 0;)  // ends by an error when the last one has closed it
    ran.out.append(text, static_cast<std::size_t>(got));
  close(terminal);
  int status = 0;
  waitpid(pid, &status, 0);
  ran.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return ran;
}

std::string text_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

void ends_with(const fs::path& folder, int code, const std::string& arguments,
               const std::vector<std::string>& words) {
  SCOPED_TRACE("dimple " + arguments);
  const Ran ran = dimple(folder, arguments);
  EXPECT_EQ(ran.code, code) << ran.err;
  expect_words(ran.err, words);
}

void expect_words(const std::string& text, const std::vector<std::string>& words) {
  for (const std::string& word : words)
    EXPECT_NE(text.find(word), std::string::npos) << "no '" << word << "' in\n" << text;
}

void expect_refusal(const Ran& ran, int code, const std::vector<std::string>& words) {
  EXPECT_EQ(ran.code, code) << ran.err;
  expect_words(ran.err, {"dimple: ", "\n  where: ", "\n  why:   ", "\n  try:   "});
  expect_words(ran.err, words);
}

void expect_refusals(const fs::path& folder, const std::string& command,
                     const std::vector<RefusedLine>& lines) {
  for (const RefusedLine& line : lines) {
    SCOPED_TRACE("dimple " + command + ' ' + line.options);
    expect_refusal(dimple(folder, command + ' ' + line.options), line.code, line.words);
  }
}

Ran stopped_at_checkpoint(const fs::path& folder, const std::string& arguments, int signal) {
  Program program(folder, words_of(arguments));
  while (program.running() && !fs::exists(folder / "out" / "checkpoint.cbor"))
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  EXPECT_TRUE(program.running()) << program.err_so_far();
  program.send(signal);
  const Ran ran = program.wait();
  EXPECT_EQ(ran.code, 130) << ran.err;
  return ran;
}

}  // namespace dimple
