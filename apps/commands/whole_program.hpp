#pragma once

#include <string>
#include <vector>

namespace dimple {

// `dimple` has the commands of one run. All others, with the libraries that they need, are in the program
// dimple_all beside it, which is `dimple` where the program is installed.

/// Whether the words of a command line, without the program's name, ask for what dimple_all alone has.
bool needs_whole_program(const std::vector<std::string>& words);

/// Continues as dimple_all with the same words, in this process; returns if it is not there.
void become_whole_program(const std::vector<std::string>& words);

/// `command`: "fit". Throws UsageError, with how to build dimple_all.
[[noreturn]] void refuse_without_whole_program(const std::string& command);

}  // namespace dimple
