#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace dimple {

/// Planes through a body before and after a load, one above the other.
struct BeforeAfter {
  using Pieces = std::vector<std::array<Eigen::Vector2d, 2>>;  ///< lines on a plane, from its upper left [mm]
  struct Plane {
    std::string name;                    ///< "axial"
    std::array<std::string, 4> letters;  ///< of its left, right, upper and lower side
    double width_mm = 0.0, height_mm = 0.0;
    std::ptrdiff_t columns = 0, rows = 0;
    std::vector<std::uint8_t> before = {},
                              after = {};           ///< [3 x columns x rows] red, green, blue, from the top
    Pieces undeformed = {}, moved = {}, wall = {};  ///< the body's outline before and after, and rigid parts
    std::vector<Eigen::Vector2d> mark_before = {}, mark_after = {};  ///< tracked places
  };
  std::string title;
  std::vector<std::string> warnings = {}, lines = {};  ///< below the title, and below the planes
  std::string wall = {};                               ///< name of the rigid parts in the legend
  std::vector<Plane> plane = {};
};

/// The bytes of a PNG, 1600 pixels wide. Needs no display; the same input gives the same bytes. Throws
/// OutputError, and std::invalid_argument if a plane has not one number for each of its places.
std::string before_after_png(const BeforeAfter& picture);

}  // namespace dimple
