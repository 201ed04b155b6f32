#include <unistd.h>

#include "apps/commands/command.hpp"
#include "apps/commands/terminal.hpp"

namespace dimple {

Command add_options(CLI::App& app, Invocation&) {
  return {app.add_subcommand("options", "list every option with its unit, default, range and meaning")
              ->group("About the program"),
          [] {
            print(wrapped(option_reference(), 52, terminal_width(STDOUT_FILENO)));
            return 0;
          }};
}

}  // namespace dimple
