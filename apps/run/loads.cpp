#include "apps/run/loads.hpp"

#include <fmt/format.h>

#include "apps/run/membranes.hpp"
#include "apps/scene/surface_part.hpp"
#include "io/error.hpp"
#include "preprocess/scene/sides.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {
namespace {

std::vector<Index> triangles_on(const Scene::Pressure& pressure, const Surface& surface) {
  std::vector<Index> chosen = triangles_on(pressure.on, surface);
  if (chosen.empty())
    throw UsageError({.fact = fmt::format("the pressure '{}' on '{}' meets no part of the surface",
                                          pressure.name, pressure.on_words),
                      .where = fmt::format("load.pressure.{}.on", pressure.name),
                      .why = "it would act on nothing",
                      .remedy = "give all, a side, or a larger ball on the surface"});
  return chosen;
}

}  // namespace

std::string in_words(const Loads& loads) {
  std::string text;
  if (!loads.gravity.isZero(0.0))
    text = fmt::format("gravity {:.4g} m/s2 ({})", loads.gravity.norm(), side_towards(loads.gravity));
  if (loads.fluid)
    text +=
        fmt::format("{}fluid lost above {:.1f} mm along ({:.2f}, {:.2f}, {:.2f})", text.empty() ? "" : ", ",
                    1e3 * loads.fluid->level, loads.fluid->up.x(), loads.fluid->up.y(), loads.fluid->up.z());
  for (const SurfacePressure& one : loads.pressure)
    text += fmt::format("{}pressure {} {:.4g} Pa", text.empty() ? "" : ", ", one.name, one.pressure);
  for (const auto& [one, unused] : loads.body_force)
    text += fmt::format("{}body force {} ({:.4g}, {:.4g}, {:.4g}) N/m3{}", text.empty() ? "" : ", ", one.name,
                        one.force.x(), one.force.y(), one.force.z(),
                        one.gradient.isZero(0.0)
                            ? ""
                            : fmt::format(" at ({:.4g}, {:.4g}, {:.4g}) mm, linear in space",
                                          1e3 * one.at.x(), 1e3 * one.at.y(), 1e3 * one.at.z()));
  return text;
}

void check_loads(const Scene& scene, const Surface& surface) {
  if (!scene.pressures.empty() && surface.empty())
    throw ModelError({.fact = "a pressure needs a surface, and this model has none",
                      .where = "load.pressure",
                      .why = "its files hold only nodes and points",
                      .remedy = "use the label image, or leave the pressure out"});
  for (const Scene::Pressure& pressure : scene.pressures) triangles_on(pressure, surface);
  check_membranes(scene, surface);
}

Loads loads_of(const Scene& scene, const Model& model, const Surface& chosen_on) {
  check_loads(scene, chosen_on);
  Loads loads{.gravity = scene.gravity, .pressure = {}, .membrane = membranes_on(scene, model, chosen_on)};
  if (!scene.body_forces.empty()) {
    const Interpolation to_points = point_interpolation(model);
    for (const BodyForce& one : scene.body_forces)
      loads.body_force.push_back({one, nodal_force(model, to_points, one)});
  }
  if (const auto& fluid = scene.fluid_lost) {
    const Eigen::VectorXd height = model.X.transpose() * fluid->up;
    loads.fluid =
        FluidLost{.up = fluid->up,
                  .level = height.maxCoeff() - fluid->fraction * (height.maxCoeff() - height.minCoeff())};
  }
  for (const Scene::Pressure& pressure : scene.pressures)
    loads.pressure.push_back({.name = pressure.name,
                              .patch = surface_patch(model, triangles_on(pressure, chosen_on)),
                              .pressure = pressure.pressure_Pa,
                              .follows = pressure.follows,
                              .around = pressure.on_words == "all"});
  return loads;
}

}  // namespace dimple
