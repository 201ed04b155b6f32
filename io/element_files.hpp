#pragma once

#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// What finite-element programs are given: elements of one kind and of one neo-Hookean tissue, a fixed base,
/// and a circle that is pushed in.
struct ElementModel {
  std::vector<std::string> remarks;  ///< about where it comes from: comments at the head of the file
  Points X;                          ///< [3xN] mm, LPS
  /// [10xE] tetrahedra: corners, then middles of 01, 12, 20, 03, 13, 23. [20xE] hexahedra: corners, then
  /// middles of 01, 12, 23, 30, 45, 56, 67, 74, 04, 15, 26, 37. [8xE] hexahedra: corners.
  Eigen::Matrix<Index, Eigen::Dynamic, Eigen::Dynamic> elements;
  std::vector<Index> base, circle;      ///< nodes
  double mu = 210.0, kappa = 104930.0;  ///< [Pa]
  Vec3 push = -Vec3::UnitZ();           ///< unit vector
  double depth_mm = 8.0;
  bool bonded = true;  ///< the circle's nodes cannot slide; otherwise they only move along the push
  int frames = 8;      ///< even depths at which forces are asked for
};

/// The same with corners only, which must be the first `corner_count` nodes: hexahedra of 20 nodes become
/// those of 8.
ElementModel without_middles(const ElementModel& model, Index corner_count);

/// What the program calls these elements: C3D10, C3D20R, C3D8; tet10, hex20, hex8.
std::string calculix_element(const ElementModel& model);
std::string febio_element(const ElementModel& model);

/// The input file of CalculiX (`ccx FILE-without-.inp`), and of FEBio 4 (`febio4 -i FILE`). Lengths in mm,
/// forces in mN, stresses in kPa, so that numbers are near 1: both programs compare some with absolute
/// limits. Throws UsageError: FEBio with a sliding circle that is not pushed along an axis.
std::string calculix_input(const ElementModel& model);
std::string febio_input(const ElementModel& model);

}  // namespace dimple
