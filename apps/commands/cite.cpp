#include <fmt/format.h>
#include <unistd.h>

#include "apps/commands/command.hpp"
#include "apps/commands/terminal.hpp"

namespace dimple {
namespace {

// Text of CITATION.cff; a test compares the two.
constexpr const char* text = R"(Please cite the software, and the paper that its method grew from.

The Dimple authors: Dimple: from a label image to a force, meshless soft-tissue indentation. Version {}.

Ashley Horton, Adam Wittek, Karol Miller: Subject-Specific Biomechanical Simulation of Brain Indentation Using a Meshless Method. Medical Image Computing and Computer-Assisted Intervention (MICCAI), 2007.
)";

constexpr const char* bibtex = R"(@software{{dimple,
  author  = {{{{The Dimple authors}}}},
  title   = {{{{Dimple: from a label image to a force, meshless soft-tissue indentation}}}},
  version = {{{}}}
}}

@inproceedings{{horton2007,
  author    = {{Horton, Ashley and Wittek, Adam and Miller, Karol}},
  title     = {{{{Subject-Specific Biomechanical Simulation of Brain Indentation Using a Meshless Method}}}},
  booktitle = {{Medical Image Computing and Computer-Assisted Intervention (MICCAI)}},
  year      = {{2007}}
}}
)";

}  // namespace

Command add_cite(CLI::App& app, Invocation&) {
  const auto as_bibtex = std::make_shared<bool>(false);
  CLI::App* command =
      app.add_subcommand("cite", "print how to cite the program and its method")->group("About the program");
  command->add_flag("--bibtex", *as_bibtex, "as BibTeX entries");
  return {command, [as_bibtex] {
            if (*as_bibtex)
              print(fmt::format(bibtex, DIMPLE_VERSION));
            else
              print(wrapped(fmt::format(text, DIMPLE_VERSION), 0, terminal_width(STDOUT_FILENO)));
            return 0;
          }};
}

}  // namespace dimple
