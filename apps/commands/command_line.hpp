#pragma once

namespace dimple {

/// The whole program behind main(): reads the command line, runs one command, reports errors. Returns the
/// exit code.
int command_line(int argc, char** argv);

}  // namespace dimple
