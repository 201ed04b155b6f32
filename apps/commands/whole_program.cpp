#include "apps/commands/whole_program.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>

#include "apps/commands/all_commands.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

constexpr WholeCommand whole_commands[] = {whole::poke,        whole::batch, whole::collect,
                                           whole::compare,     whole::fit,   whole::shift,
                                           whole::export_mesh, whole::man,   whole::completion};

// Path next to the file of this program, not to a link to it; empty if that is not known.
std::filesystem::path path_of_whole_program() {
  std::error_code unknown;
  const std::filesystem::path here = std::filesystem::read_symlink("/proc/self/exe", unknown);
  return unknown ? std::filesystem::path() : here.parent_path() / "whole" / "dimple";
}

}  // namespace

bool needs_whole_program(const std::vector<std::string>& words) {
  if (words.empty()) return false;
  if (words.front() == "--help-all") return true;
  if (std::any_of(words.begin(), words.end(), [](const auto& word) { return word.starts_with("--explain"); }))
    return true;
  return std::any_of(std::begin(whole_commands), std::end(whole_commands),
                     [&](const WholeCommand& command) { return words.front() == command.name; });
}

void become_whole_program(const std::vector<std::string>& words) {
  const std::string path = path_of_whole_program().string();
  std::string name = "dimple";
  std::vector<std::string> kept = words;
  std::vector<char*> arguments = {name.data()};
  for (std::string& word : kept) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  execv(path.c_str(), arguments.data());
}

void refuse_without_whole_program(const std::string& command) {
  throw UsageError({.fact = fmt::format("`dimple {}` has not been built", command),
                    .where = path_of_whole_program().string(),
                    .why = "`make demo` builds only the commands of one run",
                    .remedy = "`make build` builds all of them",
                    .code = "not-built"});
}

}  // namespace dimple
