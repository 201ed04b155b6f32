#include "apps/scene/surface_part.hpp"

#include <Eigen/Geometry>

namespace dimple {
bool SurfacePart::has(const Vec3& place_mm, const Vec3& normal) const {
  if (side && normal.dot(*side) < facing * normal.norm()) return false;
  return !ball || (place_mm - ball->head<3>()).norm() <= (*ball)[3];
}

std::vector<Index> triangles_on(const SurfacePart& part, const Surface& surface) {
  std::vector<Index> chosen;
  for (Index t = 0; t < surface.triangles.cols(); ++t) {
    const Vec3 a = surface.vertex_mm.col(surface.triangles(0, t)),
               b = surface.vertex_mm.col(surface.triangles(1, t)),
               c = surface.vertex_mm.col(surface.triangles(2, t));
    if (part.has((a + b + c) / 3.0, (b - a).cross(c - a))) chosen.push_back(t);
  }
  return chosen;
}

std::vector<Index> uncut_triangles_on(const SurfacePart& part, const Surface& surface) {
  std::vector<Index> chosen = triangles_on(part, surface);
  std::erase_if(chosen, [&](Index t) { return surface.is_cut_face(t); });
  return chosen;
}

std::vector<WordForm> forms_of_surface_part() {
  return {{"all"},
          {.example = "a side such as superior", .is_side = true},
          {"", ball_numbers(), "a ball x,y,z,radius in mm that holds a part of the surface"}};
}

SurfacePart surface_part_of(const OptionWord& word) {
  if (word.number.empty()) return {};
  if (word.is_side) return {.side = word.three(), .ball = {}};
  return {.side = {}, .ball = Eigen::Vector4d(word.number.data())};
}

SurfacePart surface_part_named(const std::string& on, const std::string& where, const std::string& of) {
  return surface_part_of(
      parse_word({"the place", forms_of_surface_part(), "this names no part of the surface"}, on, where, of));
}

}  // namespace dimple
