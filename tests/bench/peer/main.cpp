// dimple_peer IMAGE FILE [--set KEY=VALUE]...: the scene as hexahedra, for CalculiX (FILE.inp, 20 nodes each)
// or FEBio (FILE.feb, 8 nodes each). Says how many nodes and elements there are, as JSON.

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "apps/scene/config.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "tests/bench/peer/hexahedral_model.hpp"

int main(int argc, char** argv) {
  using namespace dimple;
  const std::vector<std::string> words(argv, argv + argc);
  try {
    if (words.size() < 3)
      throw UsageError({.fact = "usage: dimple_peer IMAGE FILE [--set KEY=VALUE]...",
                        .where = "command line",
                        .why = "the image or the file is missing",
                        .remedy = "give both"});
    Config config;
    set_option(config, "image.file", words[1], "IMAGE");
    for (std::size_t k = 3; k < words.size(); ++k) {
      if (words[k] == "--set") continue;
      const std::size_t equals = words[k].find('=');
      set_option(config, words[k].substr(0, equals),
                 equals == std::string::npos ? "" : words[k].substr(equals + 1), "--set");
    }
    resolve_material(config);
    const std::filesystem::path file = words[2];
    const bool febio = file.extension() == ".feb";
    const ElementModel model = hexahedral_model(config, febio);
    write_file(file, febio ? febio_input(model, "hex8") : calculix_input(model, "C3D20R"));
    fmt::print("{{\"nodes\": {}, \"elements\": {}}}\n", model.X.cols(), model.elements.cols());
    return 0;
  } catch (const Error& error) {
    fmt::print(stderr, "{}\n", error.report.fact);
    return static_cast<int>(error.code);
  }
}
