#include <unistd.h>

#include "apps/commands/command.hpp"
#include "apps/commands/terminal.hpp"
#include "apps/scene/compatibility.hpp"

namespace dimple {

Command add_options(CLI::App& app, Invocation&) {
  const auto pairs = std::make_shared<bool>(false);
  CLI::App* command =
      app.add_subcommand("options", "list every option with its unit, default, range and meaning")
          ->group("About the program");
  command->add_flag("--pairs", *pairs, "list incompatible options instead, with the reason");
  return {command, [pairs] {
            const std::string text = *pairs ? pairs_in_words() : option_reference();
            print(wrapped(text, *pairs ? 13 : 52, terminal_width(STDOUT_FILENO)));
            return 0;
          }};
}

}  // namespace dimple
