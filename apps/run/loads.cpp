#include "apps/run/loads.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <charconv>
#include <cmath>
#include <numbers>
#include <optional>

#include "io/error.hpp"
#include "preprocess/sides.hpp"

namespace dimple {
namespace {

constexpr double facing = std::numbers::sqrt2 / 2.0;  // cosine: within 45 degrees

[[noreturn]] void refuse_pressure(const std::string& name, const std::string& fact, const std::string& why) {
  throw UsageError({.fact = fmt::format("the pressure '{}' {}", name, fact),
                    .where = fmt::format("load.pressure.{}.on", name),
                    .why = why,
                    .remedy = "give all, a side such as superior, or a ball x,y,z,radius in mm that holds a part of the surface"});
}

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

std::vector<Index> triangles_on(const std::string& name, const std::string& on, const Surface& surface) {
  const auto side = side_named(on);
  const auto ball = ball_in_mm(on);
  if (on != "all" && !side && !ball) refuse_pressure(name, fmt::format("is on '{}'", on), "this names no part of the surface");
  std::vector<Index> chosen;
  for (Index t = 0; t < surface.triangles.cols(); ++t) {
    const Vec3 a = surface.vertex_mm.col(surface.triangles(0, t)), b = surface.vertex_mm.col(surface.triangles(1, t)),
               c = surface.vertex_mm.col(surface.triangles(2, t));
    const Vec3 normal = (b - a).cross(c - a);
    if (side && normal.dot(*side) < facing * normal.norm()) continue;
    if (ball && ((a + b + c) / 3.0 - ball->head<3>()).norm() > (*ball)[3]) continue;
    chosen.push_back(t);
  }
  if (chosen.empty()) refuse_pressure(name, fmt::format("on '{}' meets no part of the surface", on), "it would act on nothing");
  return chosen;
}

}  // namespace

std::string in_words(const Loads& loads) {
  std::string text;
  if (!loads.gravity.isZero(0.0))
    text = fmt::format("gravity {:.4g} m/s2 ({})", loads.gravity.norm(), side_towards(loads.gravity));
  for (const SurfacePressure& one : loads.pressure)
    text += fmt::format("{}pressure {} {:.4g} Pa", text.empty() ? "" : ", ", one.name, one.pressure);
  return text;
}

Loads loads_of(const Config& config, const Model& model) {
  Loads loads{.gravity = gravity_of(config), .pressure = {}};
  if (config.pressure.empty()) return loads;
  if (model.surface.empty())
    throw ModelError({.fact = "a pressure acts on the surface, and this model has none",
                      .where = "load.pressure",
                      .why = "its files hold nodes and points alone",
                      .remedy = "take the label image, or leave the pressure out"});
  for (const auto& [name, pressure] : config.pressure)
    loads.pressure.push_back({.name = name,
                              .patch = surface_patch(model, triangles_on(name, pressure.on, model.surface)),
                              .pressure = pressure.pressure_Pa,
                              .follows = pressure.follows == "yes"});
  return loads;
}

}  // namespace dimple
