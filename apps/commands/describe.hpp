#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>
#include <vector>

#include "io/label_image.hpp"

namespace dimple {

/// Flag or argument of a command, for man pages, shells and 3D Slicer.
struct FlagWords {
  std::vector<std::string> names;  ///< "-o", "--out"; for an argument "IMAGE"
  std::string value;               ///< "mm", "FILE", "bash|zsh|fish"; empty: no value
  std::string help;
  std::string group;
  std::vector<std::string> choices;  ///< of the value, from the option table or `value`
  bool takes_value = false, positional = false, required = false;
};

/// Flags and arguments of a command in the order of its help, without hidden ones.
std::vector<FlagWords> flags_of(const CLI::App& command);

/// Manual page dimple(1) or dimple-COMMAND(1) as roff.
std::string man_page(const CLI::App& app, const CLI::App* command);

/// Contents of a label image as JSON, as `info --json` and `phantom --json` print it.
std::string image_as_json(const std::filesystem::path& file, const LabelImage& image);

/// Completion script for bash, zsh or fish; empty for any other shell.
std::string completion_for(const CLI::App& app, const std::string& shell);

}  // namespace dimple
