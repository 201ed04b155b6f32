#pragma once

#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// Finite-element model: ten-node tetrahedra of one neo-Hookean tissue, a fixed base, and a pressed patch.
struct ElementModel {
  std::vector<std::string> remarks;  ///< on its origin: comments at the head of the file
  Points X;                          ///< [3xN] mm, LPS
  /// [10xE] tetrahedra: corners, then middles of 01, 12, 20, 03, 13, 23.
  Eigen::Matrix<Index, Eigen::Dynamic, Eigen::Dynamic> elements;
  std::vector<Index> base, bonded_patch;  ///< nodes
  double mu = 210.0, kappa = 104930.0;    ///< [Pa]
  Vec3 approach = -Vec3::UnitZ();         ///< unit vector
  double depth_mm = 8.0;
  bool bonded = true;  ///< the patch's nodes cannot slide; otherwise they are free across the press direction
  int frames = 8;      ///< even depths at which forces are requested
};

/// The input file of CalculiX (`ccx FILE-without-.inp`), in keywords of Abaqus (which has no such *NODE
/// PRINT), and of FEBio 4 (`febio4 -i FILE`). Lengths in mm, forces in mN, stresses in kPa, so that numbers
/// are near 1: both programs compare some with absolute limits. Throws UsageError: FEBio with a sliding patch
/// that is not pressed along an axis.
std::string calculix_input(const ElementModel& model);
std::string febio_input(const ElementModel& model);

}  // namespace dimple
