#include "apps/commands/all_commands.hpp"
#include "apps/commands/command_line.hpp"
#include "apps/commands/whole_program.hpp"

// Commands of one run, for the program `dimple`.

namespace dimple {
namespace {

// Command listed in the help. It runs only if command_line() has not found the whole program.
template <const WholeCommand& elsewhere>
Command listed(CLI::App& app, Invocation&) {
  CLI::App* command = add_to(app, elsewhere)->allow_extras()->prefix_command();
  command->set_help_flag();
  command->set_help_all_flag();
  return {command, []() -> int { refuse_without_whole_program(elsewhere.name); }};
}

}  // namespace

ProgramParts program_parts() {
  return {.commands = {add_phantom, add_info, add_places, add_model, add_solve, add_run, listed<whole::poke>,
                       listed<whole::batch>, listed<whole::collect>, listed<whole::compare>,
                       listed<whole::fit>, listed<whole::shift>, listed<whole::export_mesh>, add_options,
                       add_cite, add_doctor, listed<whole::man>, listed<whole::completion>}};
}

}  // namespace dimple
