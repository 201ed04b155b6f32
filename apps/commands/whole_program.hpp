#pragma once

#include <string>
#include <vector>

namespace dimple {

// `dimple` has the commands of one run. All others, with the libraries that they need, are in the whole
// program, the target dimple_all: whole/dimple beside it. What is installed is the whole program.

/// Whether the words of a command line, without the program's name, ask for what the whole program alone has.
bool needs_whole_program(const std::vector<std::string>& words);

/// Continues as the whole program with the same words, in this process; returns if it is not there.
void become_whole_program(const std::vector<std::string>& words);

/// `command`: "fit". Throws UsageError, with how to build the whole program.
[[noreturn]] void refuse_without_whole_program(const std::string& command);

}  // namespace dimple
