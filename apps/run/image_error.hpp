#pragma once

#include <string>
#include <vector>

namespace dimple {

/// Half-width of the force's error bounds by the image's resolution: labels define the surface to half a
/// voxel only. It is in addition to the error of the discretisation.
struct ImageError {
  std::string unknown = "the run ended before";  ///< why there is no estimate; empty: there is one
  double voxel = 0.0;                            ///< edge of the voxels along the press direction [m]
  double shape = 0.0, thickness = 0.0;           ///< the two parts of the last half-width [N]
  std::vector<double> half = {};                 ///< [samples of the force curve] half-width [N]
  bool known() const { return unknown.empty(); }
};

/// Part of the force above which a warning is given, if the error of the discretisation is less.
inline constexpr double image_error_to_warn = 0.10;
/// True if a warning is due. `discretisation`: half-width of the force's other bounds [N]; 0: not known.
bool is_large(const ImageError& error, double force, double discretisation);
/// The warning, or nothing. `depth` [m].
std::string image_warning(const ImageError& error, double force, double depth, double discretisation);

}  // namespace dimple
