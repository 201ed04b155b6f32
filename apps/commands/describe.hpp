#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "io/label_image.hpp"

namespace dimple {

/// A flag or an argument of a command, as other programs are told of it: man pages, shells, 3D Slicer.
struct FlagWords {
  std::vector<std::string> names;  ///< "-o", "--out"; of an argument "IMAGE"
  std::string value;               ///< "mm", "FILE", "bash|zsh|fish"; empty: none is taken
  std::string help;
  std::string group;
  std::vector<std::string> choices;  ///< of the value, as the option table or `value` has them
  bool takes_value = false, positional = false, required = false;
};

/// Those of a command, in the order of its help, without hidden ones.
std::vector<FlagWords> flags_of(const CLI::App& command);

/// dimple(1), or dimple-COMMAND(1), as roff.
std::string man_page(const CLI::App& app, const CLI::App* command);

/// What a label image holds, as `info --json` and `phantom --json` print it.
std::string image_as_json(const std::filesystem::path& file, const LabelImage& image);

/// For bash, zsh or fish; empty for another word.
std::string completion_for(const CLI::App& app, const std::string& shell);

}  // namespace dimple
