#include "apps/studies/verify.hpp"

#include <fmt/format.h>

#include "apps/commands/command.hpp"
#include "apps/commands/log.hpp"
#include "apps/commands/terminal.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"

namespace dimple {
namespace {

struct VerifyArguments {
  std::vector<std::string> cases;
  bool list = false;
  Index nodes = 4250;
};

int perform(const VerifyArguments& options, Invocation& shared) {
  if (options.list) {
    for (const VerifyGroup& group : verify_groups())
      print(fmt::format("{:<16} {}\n", group.name, group.what));
    return 0;
  }
  if (!shared.out.empty()) try_folder(shared.out);
  const auto rows = verify(options.cases, options.nodes, [&](const std::string& group) {
    say(fmt::format("verify   {}", group));
    return stop_asked() == StopReason::none;
  });
  if (rows.empty()) stop_if_asked();
  if (!shared.out.empty()) {
    make_folder(shared.out);
    for (const auto& [name, text] :
         {std::pair{"verify.csv", verify_csv(rows)}, std::pair{"verify.md", verify_markdown(rows)}}) {
      const std::filesystem::path file = std::filesystem::path(shared.out) / name;
      remove_temporaries_of(file);
      write_file(file, text);
    }
  }
  if (shared.json)
    print_json(verify_json(rows));
  else
    print(verify_table(rows));
  shared.json = false;  // what there is was printed; the error goes to stderr alone
  if (const StopReason why = stop_asked(); why != StopReason::none) throw Stopped(why);
  require_passed(rows);
  return 0;
}

}  // namespace

Command add_verify(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<VerifyArguments>();
  CLI::App* command =
      app.add_subcommand("verify", "compute what is known in closed form or by other methods, and compare");
  command->add_option("--case", options->cases, "only this one; may be given several times")
      ->type_name("NAME")
      ->allow_extra_args(false);
  command->add_flag("--list", options->list, "list the cases and stop");
  command->add_option("--nodes", options->nodes, "of the indented bodies")
      ->check(CLI::Range(200, 1000000))
      ->capture_default_str();
  command->add_option("-o,--out,--output", shared.out, "folder for verify.csv and verify.md");
  add_common(*command, shared);
  return {command, [&shared, options] { return perform(*options, shared); }};
}

}  // namespace dimple
