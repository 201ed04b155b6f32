#pragma once

#include <vector>

#include "apps/commands/command.hpp"

namespace dimple {

/// Parts of one of the two programs (whole_program.hpp): one has the commands of a run, the other has all
/// commands.
struct ProgramParts {
  std::vector<Command (*)(CLI::App&, Invocation&)> commands;  ///< in the order of the help
  Outcome (*explain)(const Scene&, const Invocation&,
                     Outcome) = nullptr;  ///< for `run --explain`, if available
  bool whole = false;                     ///< has all commands
};

/// Parts of the linked program: few_commands.cpp or all_commands.cpp.
ProgramParts program_parts();

/// Body of main(): reads the command line, runs one command, reports errors. Returns the exit code.
int command_line(int argc, char** argv, const ProgramParts& parts);

}  // namespace dimple
