#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "apps/commands/all_commands.hpp"
#include "apps/commands/log.hpp"
#include "apps/scene/resolve.hpp"
#include "apps/studies/export_mesh.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

struct ExportArguments {
  Flags flags;
  std::string format, elements = "tetrahedra";
};

// Refuses to replace a file of another program; meshes of this one name it in their first lines.
void require_no_file_of_others(const std::filesystem::path& file) {
  if (!std::filesystem::exists(file)) return;
  std::string head(4096, '\0');
  std::ifstream(file, std::ios::binary).read(head.data(), std::ssize(head));
  if (head.find(written_by) != std::string::npos) return;
  throw OutputError({.fact = fmt::format("{} exists and was not written by dimple", file.string()),
                     .where = "-o",
                     .why = "it would be lost",
                     .remedy = "give another name with -o, or --force to replace it"});
}

}  // namespace

Command add_export(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<ExportArguments>();
  CLI::App* command = add_to(app, whole::export_mesh);
  command->add_option("IMAGE", shared.image, "label image");
  command
      ->add_option("-o,--out,--output", shared.out,
                   "file to write: .inp (CalculiX, in Abaqus's keywords) or .feb (FEBio)")
      ->required();
  command->add_option("--format", options->format, "the other program [from the file's name]")
      ->type_name("calculix|febio");
  command->add_option("--elements", options->elements)->group("");  // for old command lines
  command->add_flag("--force", shared.force, "replace a file that this program has not written");
  options->flags.add(*command, "");
  add_common(*command, shared);
  return {command, [&shared, command, options] {
            if (options->elements != "tetrahedra")
              throw UsageError({.fact = fmt::format("there are no {} to export", options->elements),
                                .where = "--elements",
                                .why = "the mesh is one of ten-node tetrahedra",
                                .remedy = "leave --elements out, or give --elements tetrahedra"});
            try_file(shared.out);
            if (!shared.force) require_no_file_of_others(shared.out);
            return finish(shared, export_model(resolve(options->flags.described(*command, shared.image)),
                                               options->format, shared.out, {.line = to_log().line}));
          }};
}

}  // namespace dimple
