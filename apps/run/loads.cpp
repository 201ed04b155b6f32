#include "apps/run/loads.hpp"

#include <fmt/format.h>

#include "apps/run/membranes.hpp"
#include "apps/run/surface_part.hpp"
#include "io/error.hpp"
#include "preprocess/scene/sides.hpp"

namespace dimple {
namespace {

SurfacePart part_of(const std::string& name, const Config::Pressure& pressure) {
  return surface_part_named(pressure.on, fmt::format("load.pressure.{}.on", name),
                            fmt::format("the pressure '{}'", name));
}

std::vector<Index> triangles_on(const std::string& name, const Config::Pressure& pressure,
                                const Surface& surface) {
  std::vector<Index> chosen = triangles_on(part_of(name, pressure), surface);
  if (chosen.empty())
    throw UsageError(
        {.fact = fmt::format("the pressure '{}' on '{}' meets no part of the surface", name, pressure.on),
         .where = fmt::format("load.pressure.{}.on", name),
         .why = "it would act on nothing",
         .remedy = "give all, a side, or a larger ball on the surface"});
  return chosen;
}

}  // namespace

WordNumber share_of_lost_fluid() {
  return {"share", "%", 0.01, 0.0, 100.0, true, true};
}

std::optional<FluidWords> fluid_lost_of(const Config& config) {
  if (config.load.fluid_lost == "none") return std::nullopt;
  const OptionWord word = parse_word(
      {"the lost fluid",
       {{.numbers = joined(direction_numbers(), {share_of_lost_fluid()}),
         .example = "the direction that is up and a share of the height: anterior,60%, or 0,-1,0,60%",
         .is_side = true}}},
      config.load.fluid_lost, "load.fluid_lost");
  if (word.three().isZero(0.0)) refuse_word(word, "has no direction", "three zeros are no direction");
  return FluidWords{word.is_side ? word.three() : Vec3(word.three().stableNormalized()), word.number.back()};
}

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
  return text;
}

void check_loads(const Config& config) {
  gravity_of(config);
  fluid_lost_of(config);
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

Loads loads_of(const Config& config, const Model& model, const Surface& chosen_on) {
  check_loads(config, chosen_on);
  Loads loads{
      .gravity = gravity_of(config), .pressure = {}, .membrane = membranes_on(config, model, chosen_on)};
  if (const auto fluid = fluid_lost_of(config)) {
    const Eigen::VectorXd height = model.X.transpose() * fluid->up;
    loads.fluid = FluidLost{
        .up = fluid->up, .level = height.maxCoeff() - fluid->share * (height.maxCoeff() - height.minCoeff())};
  }
  for (const auto& [name, pressure] : config.pressure)
    loads.pressure.push_back({.name = name,
                              .patch = surface_patch(model, triangles_on(name, pressure, chosen_on)),
                              .pressure = pressure.pressure_Pa,
                              .follows = pressure.follows == "yes",
                              .around = pressure.on == "all"});
  return loads;
}

}  // namespace dimple
