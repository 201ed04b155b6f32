#include "apps/commands/all_commands.hpp"

#include "apps/commands/command_line.hpp"

// All commands, for the program `dimple_all`.

namespace dimple {

ProgramParts program_parts() {
  return {.commands = {add_phantom, add_info, add_places, add_model, add_solve, add_run, add_poke, add_batch,
                       add_collect, add_compare, add_fit, add_shift, add_export, add_options, add_cite,
                       add_doctor, add_man, add_completion},
          .explain = explain_run,
          .whole = true};
}

}  // namespace dimple
