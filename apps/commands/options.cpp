#include <fmt/format.h>

#include "apps/commands/command.hpp"

namespace dimple {

Command add_options(CLI::App& app, Invocation&) {
  return {app.add_subcommand("options", "list every option with its unit, default, range and meaning"), [] {
            fmt::print("{}", wrapped(option_reference(), 52));
            return 0;
          }};
}

}  // namespace dimple
