#pragma once

#include <string>
#include <vector>

namespace dimple {

/// Half-width of the force's error bounds by the image's resolution: the labels say where the surface is to
/// half a voxel only. It is in addition to the error of the discretisation.
struct ImageError {
  std::string unknown = "the run ended before";  ///< why there is no estimate; empty: there is one
  double voxel = 0.0;                            ///< edge of the voxels along the push [m]
  double shape = 0.0, thickness = 0.0;           ///< the two parts of the last half-width [N]
  std::vector<double> half = {};                 ///< [samples of the force curve] half-width [N]
  bool known() const { return unknown.empty(); }
};

/// From this part of the force on a warning says so, where the error of the discretisation is less.
inline constexpr double image_error_to_warn = 0.10;
/// Whether a warning is due. `force`, and `discretisation`, its half-width [N]; 0: not known.
bool is_large(const ImageError& error, double force, double discretisation);
/// The warning, or nothing. `depth` [m].
std::string image_warning(const ImageError& error, double force, double depth, double discretisation);

}  // namespace dimple
