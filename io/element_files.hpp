#pragma once

#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// What finite-element programs are given: ten-node tetrahedra of one neo-Hookean tissue, a fixed base, and a
/// circle that is pushed in.
struct ElementModel {
  std::vector<std::string> remarks;  ///< about where it comes from: comments at the head of the file
  Points X;                          ///< [3xN] mm, LPS
  Eigen::Matrix<Index, 10, Eigen::Dynamic> tetrahedra;  ///< corners, then middles of 01, 12, 20, 03, 13, 23
  std::vector<Index> base, circle;                      ///< nodes
  double mu = 210.0, kappa = 104930.0;                  ///< [Pa]
  Vec3 push = -Vec3::UnitZ();                           ///< unit vector
  double depth_mm = 8.0;
  bool bonded = true;  ///< the circle's nodes cannot slide; otherwise they only move along the push
  int frames = 8;      ///< even depths at which forces are asked for
};

/// The input file of CalculiX (`ccx FILE-without-.inp`), and of FEBio 4 (`febio4 -i FILE`). Lengths in mm,
/// forces in mN, stresses in kPa, so that numbers are near 1: both programs compare some with absolute
/// limits. Throws UsageError: FEBio with a sliding circle that is not pushed along an axis.
std::string calculix_input(const ElementModel& model);
std::string febio_input(const ElementModel& model);

/// The force [N] along the push at each depth that the program reached: from CalculiX's FILE.dat, from what
/// FEBio wrote into febio_forces_file. No library reads these; the text is a plain list. Throw InputError.
std::vector<double> calculix_forces(const std::string& dat, const Vec3& push);
std::vector<double> febio_forces(const std::string& log, const Vec3& push, int frames);
inline constexpr const char* febio_forces_file = "circle_forces.txt";

}  // namespace dimple
