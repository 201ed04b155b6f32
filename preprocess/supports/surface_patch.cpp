#include "preprocess/supports/surface_patch.hpp"

#include <Eigen/Geometry>
#include <array>
#include <map>

#include "preprocess/supports/consistency.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {

double area_of(const SurfacePatch& patch) {
  double sum = 0.0;
  for (const auto& t : patch.triangles.colwise()) {
    const Vec3 a = patch.corner.col(t[0]);
    sum += 0.5 * (Vec3(patch.corner.col(t[1])) - a).cross(Vec3(patch.corner.col(t[2])) - a).norm();
  }
  return sum;
}

SurfacePatch surface_patch(const Model& model, const std::vector<Index>& chosen) {
  Triangles triangles(3, static_cast<Index>(chosen.size()));
  for (std::size_t k = 0; k < chosen.size(); ++k)
    triangles.col(static_cast<Index>(k)) = model.surface.triangles.col(chosen[k]);
  const SurfacePieces pieces = pieces_of(model, triangles);
  const Index count = pieces.place.cols();
  SurfacePatch patch;
  patch.triangles.resize(3, count);
  std::map<std::array<double, 3>, int> numbers;  // neighbours have the same corners to the bit
  std::vector<Vec3> corner, normal;
  for (Index k = 0; k < 3 * count; ++k) {
    const Vec3 x = pieces.corner.col(k);
    const auto [at, is_new] = numbers.try_emplace({x.x(), x.y(), x.z()}, static_cast<int>(corner.size()));
    if (is_new) {
      corner.push_back(x);
      normal.push_back(Vec3::Zero());
    }
    normal[static_cast<std::size_t>(at->second)] += pieces.area.col(k / 3);
    patch.triangles(k % 3, k / 3) = at->second;
  }
  patch.corner.resize(3, static_cast<Index>(corner.size()));
  Points normals = patch.corner;
  for (std::size_t v = 0; v < corner.size(); ++v) {
    patch.corner.col(static_cast<Index>(v)) = corner[v];
    normals.col(static_cast<Index>(v)) = normal[v];
  }
  patch.at_corner = surface_interpolation(model, patch.corner, normals);
  patch.at_middle = surface_interpolation(model, pieces.place, pieces.area);
  return patch;
}

}  // namespace dimple
