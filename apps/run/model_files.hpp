#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "apps/scene/scene.hpp"
#include "io/vtk_files.hpp"

namespace dimple {

/// A model as files that a person can open and another program can make:
///
///     model.toml    which files, the tool, the support options; provenance
///     nodes.vtu     positions [LPS mm, double], spacing_mm, node_set (1 base, 2 tool circle)
///     points.vtu    positions [LPS mm, double], volume_mm3, label, spread_mm2
///     surface.vtp   the body's surface, for pictures; optional
///     label.vti     the label image, for pictures; optional
///
/// nodes and points may also be .csv lists of locations, as the paper's program loads them: columns x_mm,
/// y_mm, z_mm, and where known spacing_mm and node_set, or volume_mm3.
struct ModelFiles {
  Discretisation places;
  Scheme scheme = horton2007;  ///< a list of locations is the paper's, unless model.toml says more
  std::map<std::string, int> label_names;         ///< of the image; not kept in the files
  std::map<std::string, std::string> provenance;  ///< image, sha256, labels, reasons
  double facing_share = 0.0;                      ///< see ImageFacts; not known: 0
  std::vector<std::string> notes;                 ///< what had to be assumed on reading
};

/// Writes all but label.vti. Throws OutputError.
void write_model(const std::filesystem::path& folder, const Discretisation& places, const Scheme& scheme,
                 const std::map<std::string, std::string>& provenance, double facing_share);

/// `model` is the folder or its model.toml. Throws InputError: what is missing or makes no sense.
ModelFiles read_model(const std::filesystem::path& model);

}  // namespace dimple
