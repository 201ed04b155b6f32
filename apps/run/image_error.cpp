#include "apps/run/image_error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "apps/run/words.hpp"

namespace dimple {

bool is_large(const ImageError& error, double force, double discretisation) {
  if (!error.known() || error.half.empty()) return false;
  return error.half.back() > std::max(image_error_to_warn * std::abs(force), discretisation);
}

std::string image_warning(const ImageError& error, double force, double depth, double discretisation) {
  if (!is_large(error, force, discretisation)) return {};
  const double half = error.half.back();
  const bool by_shape = error.shape >= error.thickness;
  return fmt::format(
      "half a voxel changes the force by {}, +- {}; voxels of {} leave the body's {} uncertain{}; try: a "
      "finer image{} [image-resolution]",
      percent(half / std::abs(force)), force_in_words(half), length_in_words(1e3 * error.voxel),
      by_shape ? "shape under the tool" : "thickness under the tool",
      by_shape ? fmt::format(", and it is pressed in by {} only", length_in_words(1e3 * depth)) : "",
      by_shape ? ", a sharper tool or a greater depth" : "");
}

}  // namespace dimple
