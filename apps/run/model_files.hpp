#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "apps/scene/scene.hpp"
#include "io/vtk_files.hpp"

namespace dimple {

/// Model as files that a person can open and another program can make:
///
///     model.toml    which files, the tool, the support options; provenance
///     nodes.vtu     positions [LPS mm, double], spacing_mm, node_flags (1 base, 2 bonded patch)
///     points.vtu    positions [LPS mm, double], volume_mm3, label, spread_mm2
///     surface.vtp   the body's surface, for pictures; optional
///     label.vti     the label image, for pictures; optional
///
/// nodes and points may also be .csv lists of locations, as in the paper's program. Columns: x_mm, y_mm,
/// z_mm, and if available spacing_mm and node_flags, or volume_mm3.
struct ModelFiles {
  Discretisation places;
  Scheme scheme = horton2007;  ///< that of the paper for a list of locations, unless model.toml names another
  std::map<std::string, int> label_names;         ///< of the image; not kept in the files
  std::map<std::string, std::string> provenance;  ///< image, sha256, labels, reasons
  double facing_fraction = 0.0;                   ///< see ImageFacts; 0: not known
  std::vector<std::string> notes;                 ///< assumptions on reading
};

/// Writes all but label.vti. Throws OutputError.
void write_model(const std::filesystem::path& folder, const Discretisation& places, const Scheme& scheme,
                 const std::map<std::string, std::string>& provenance, double facing_fraction);

/// Reads a folder or its model.toml. Throws InputError: a part is missing or invalid.
ModelFiles read_model(const std::filesystem::path& model);

}  // namespace dimple
