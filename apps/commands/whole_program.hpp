#pragma once

#include <string>
#include <vector>

namespace dimple {

// `dimple` has the commands of one run. The whole program (target dimple_all, whole/dimple next to it) has
// all commands and the libraries that they need. The whole program is installed.

/// True if a command line, without the program's name, needs the whole program.
bool needs_whole_program(const std::vector<std::string>& words);

/// Replaces this process by the whole program with the same arguments; returns if it is not found.
void become_whole_program(const std::vector<std::string>& words);

/// Throws UsageError with instructions to build the whole program. `command`: "fit".
[[noreturn]] void refuse_without_whole_program(const std::string& command);

}  // namespace dimple
