#include "apps/run/loads.hpp"

#include <fmt/format.h>

#include "apps/run/membranes.hpp"
#include "apps/run/surface_part.hpp"
#include "io/error.hpp"
#include "preprocess/scene/sides.hpp"

namespace dimple {
namespace {

[[noreturn]] void refuse_pressure(const std::string& name, const std::string& fact, const std::string& why) {
  throw UsageError({.fact = fmt::format("the pressure '{}' {}", name, fact),
                    .where = fmt::format("load.pressure.{}.on", name),
                    .why = why,
                    .remedy = "give all, a side such as superior, or a ball x,y,z,radius in mm that holds a "
                              "part of the surface"});
}

SurfacePart part_of(const std::string& name, const Config::Pressure& pressure) {
  const auto part = surface_part_named(pressure.on);
  if (!part)
    refuse_pressure(name, fmt::format("is on '{}'", pressure.on), "this names no part of the surface");
  return *part;
}

std::vector<Index> triangles_on(const std::string& name, const Config::Pressure& pressure,
                                const Surface& surface) {
  std::vector<Index> chosen = triangles_on(part_of(name, pressure), surface);
  if (chosen.empty())
    refuse_pressure(name, fmt::format("on '{}' meets no part of the surface", pressure.on),
                    "it would act on nothing");
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

void check_loads(const Config& config) {
  gravity_of(config);
  for (const auto& [name, pressure] : config.pressure) part_of(name, pressure);
  check_membranes(config);
}

void check_loads(const Config& config, const Surface& surface) {
  if (!config.pressure.empty() && surface.empty())
    throw ModelError({.fact = "a pressure acts on the surface, and this model has none",
                      .where = "load.pressure",
                      .why = "its files hold nodes and points alone",
                      .remedy = "take the label image, or leave the pressure out"});
  for (const auto& [name, pressure] : config.pressure) triangles_on(name, pressure, surface);
  check_membranes(config, surface);
}

Loads loads_of(const Config& config, const Model& model) {
  check_loads(config, model.surface);
  Loads loads{.gravity = gravity_of(config), .pressure = {}, .membrane = membranes_on(config, model)};
  for (const auto& [name, pressure] : config.pressure)
    loads.pressure.push_back({.name = name,
                              .patch = surface_patch(model, triangles_on(name, pressure, model.surface)),
                              .pressure = pressure.pressure_Pa,
                              .follows = pressure.follows == "yes"});
  return loads;
}

}  // namespace dimple
