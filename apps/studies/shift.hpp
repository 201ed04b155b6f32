#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "apps/run/record.hpp"

namespace dimple {

/// Brain shift after a craniotomy, as the command line has it.
struct ShiftOptions {
  std::string brain;                ///< labels of what is soft; empty: all
  std::string skull = "derived";    ///< a label, or the outer hull of the brain at a gap
  std::string opening;              ///< x,y,z,radius in mm
  std::string up;                   ///< a side, or x,y,z: against gravity
  std::string fluid_lost = "60%";   ///< of the brain's height
  std::string gap;                  ///< between brain and skull; empty: of a label as the image has it
  std::vector<std::string> target;  ///< x,y,z in mm each, or the name of a file of markups
  bool tables_alone = false;        ///< no images, pictures and page
};

/// The brain that is described, with a skull around it that is open there, fluid lost down to that share of
/// its height, its lowest part held, and no tool. Throws UsageError: one of the options is not understood.
Description describe_shift(Description brain, const ShiftOptions& options);

/// What a shift takes where nobody says it, where that is not what a run takes: key of an option -> text.
std::map<std::string, std::string> defaults_of_shift();

/// The equilibrium after it: displacement and deformed images, targets.csv, profile.csv, surface.vtp,
/// nodes.vtu, summary.json. `described`: as describe_shift() returns it. Throws as simulate() does.
Outcome shift(const Description& described, const ShiftOptions& options, const std::filesystem::path& folder,
              Existing existing, const RecordObserver& observer);

}  // namespace dimple
