#include <fmt/format.h>

#include <filesystem>

#include "apps/commands/all_commands.hpp"
#include "apps/commands/describe.hpp"
#include "apps/commands/terminal.hpp"
#include "io/error.hpp"
#include "io/file.hpp"

namespace dimple {
namespace {

struct ManArguments {
  std::string command, folder;
};

const CLI::App* command_named(const CLI::App& app, const std::string& name) {
  std::vector<std::string> known;
  for (const CLI::App* command : app.get_subcommands({})) {
    if (command->get_name() == name) return command;
    known.push_back(command->get_name());
  }
  throw UsageError({.fact = fmt::format("there is no command '{}'{}", name, did_you_mean(name, known)),
                    .where = "dimple man",
                    .why = "a manual page describes the program or one of its commands",
                    .remedy = "see `dimple --help` for all of them"});
}

}  // namespace

Command add_man(CLI::App& app, Invocation&) {
  const auto options = std::make_shared<ManArguments>();
  CLI::App* command = add_to(app, whole::man);
  command->add_option("COMMAND", options->command, "of this command [of the program]");
  command->add_option("-o,--out,--output", options->folder,
                      "write the pages of all commands into this folder");
  return {command, [&app, options] {
            if (options->folder.empty()) {
              print(man_page(app, options->command.empty() ? nullptr : command_named(app, options->command)));
              return 0;
            }
            make_folder(options->folder);
            const std::filesystem::path folder = options->folder;
            write_file(folder / "dimple.1", man_page(app, nullptr));
            for (const CLI::App* known : app.get_subcommands({}))
              write_file(folder / fmt::format("dimple-{}.1", known->get_name()), man_page(app, known));
            return 0;
          }};
}

Command add_completion(CLI::App& app, Invocation&) {
  const auto shell = std::make_shared<std::string>();
  CLI::App* command = add_to(app, whole::completion);
  command->add_option("SHELL", *shell, "the shell that is to complete")
      ->type_name("bash|zsh|fish")
      ->required();
  return {command, [&app, shell] {
            const std::string text = completion_for(app, *shell);
            if (text.empty())
              throw UsageError({.fact = fmt::format("there is no completion for '{}'{}", *shell,
                                                    did_you_mean(*shell, {"bash", "zsh", "fish"})),
                                .where = "dimple completion",
                                .why = "it is made for bash, zsh and fish",
                                .remedy = "for instance dimple completion bash"});
            print(text);
            return 0;
          }};
}

}  // namespace dimple
