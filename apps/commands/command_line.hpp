#pragma once

#include <vector>

#include "apps/commands/command.hpp"

namespace dimple {

/// What a program is made of. There are two, see whole_program.hpp: one with what one run needs, one with
/// all commands.
struct ProgramParts {
  std::vector<Command (*)(CLI::App&, Invocation&)> commands;  ///< in the order of the help
  Outcome (*explain)(const Scene&, const Invocation&,
                     Outcome) = nullptr;  ///< of `run --explain`, if it is there
  bool whole = false;                     ///< all commands are there
};

/// Those of the program that is linked: few_commands.cpp or all_commands.cpp.
ProgramParts program_parts();

/// The program behind main(): reads the command line, runs one command, reports errors. Returns the exit
/// code.
int command_line(int argc, char** argv, const ProgramParts& parts);

}  // namespace dimple
