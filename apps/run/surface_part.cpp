#include "apps/run/surface_part.hpp"

#include <Eigen/Geometry>
#include <charconv>
#include <cmath>

#include "preprocess/scene/sides.hpp"

namespace dimple {
namespace {

// x, y, z and radius, if the text is that.
std::optional<Eigen::Vector4d> ball_in_mm(const std::string& text) {
  Eigen::Vector4d ball;
  const char *at = text.data(), *end = at + text.size();
  for (int d = 0; d < 4; ++d) {
    while (at != end && (*at == ' ' || (d > 0 && *at == ','))) ++at;
    const auto [next, error] = std::from_chars(at, end, ball[d]);
    if (error != std::errc{} || !std::isfinite(ball[d])) return std::nullopt;
    at = next;
  }
  return at == end && ball[3] > 0.0 ? std::optional(ball) : std::nullopt;
}

}  // namespace

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

std::optional<SurfacePart> surface_part_named(const std::string& on) {
  if (on == "all") return SurfacePart{};
  const SurfacePart part{.side = side_named(on, "on = SIDE, a part of the surface"), .ball = ball_in_mm(on)};
  return part.side || part.ball ? std::optional(part) : std::nullopt;
}

}  // namespace dimple
