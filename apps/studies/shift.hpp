#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "apps/run/record.hpp"

namespace dimple {

/// Options of the brain shift after a craniotomy, as on the command line.
struct ShiftOptions {
  std::string brain;                ///< labels of the soft tissue; empty: all
  std::string skull = "derived";    ///< a label, or "derived": the brain's outer hull at a gap
  std::string opening;              ///< x,y,z,radius in mm
  std::string up;                   ///< a side, or x,y,z: against gravity
  std::string fluid_lost = "60%";   ///< of the brain's height
  std::string gap;                  ///< between brain and skull; empty: as in the image for a label
  std::vector<std::string> target;  ///< each x,y,z in mm, or a markups file
  bool tables_alone = false;        ///< no images, pictures or page
};

/// Adds to the brain a skull with the opening, lost fluid down to that fraction of its height, and a held
/// lowest part. There is no tool. Throws UsageError: an option is not understood.
Description describe_shift(Description brain, const ShiftOptions& options);

/// Defaults of a shift that differ from those of a run: key of an option -> text.
std::map<std::string, std::string> defaults_of_shift();

/// Computes the equilibrium and writes displacement and deformed images, targets.csv, profile.csv,
/// surface.vtp, nodes.vtu, summary.json. `described`: of describe_shift(). Throws as simulate() does.
Outcome shift(const Description& described, const ShiftOptions& options, const std::filesystem::path& folder,
              Existing existing, const RecordObserver& observer);

}  // namespace dimple
