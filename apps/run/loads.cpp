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

std::optional<FluidWords> fluid_lost_of(const Config& config) {
  const std::string& text = config.load.fluid_lost;
  if (text == "none") return std::nullopt;
  const auto refuse = [&](const std::string& fact, const std::string& why) {
    throw UsageError({.fact = fmt::format("the fluid that is lost {}", fact),
                      .where = "load.fluid_lost",
                      .why = why,
                      .remedy = "give which way is up and the share of the body's height that has no fluid "
                                "any more: anterior,60%, or 0,-1,0,60%"});
  };
  const auto comma = text.rfind(',');
  const std::string last = comma == std::string::npos ? "" : text.substr(comma + 1);
  if (last.size() < 2 || last.back() != '%')
    refuse(fmt::format("is '{}'", text), "it ends with a share in percent");
  double percent = 0.0;
  set_value({.key = "load.fluid_lost",
             .value = &percent,
             .most = 100.0,
             .least_excluded = true,
             .help = "a share in percent"},
            last.substr(0, last.size() - 1), "load.fluid_lost");
  const std::string up = text.substr(0, comma);
  std::optional<Vec3> direction = side_named(up, "load.fluid_lost");
  if (!direction) {
    std::vector<double> n;
    set_value({.key = "load.fluid_lost", .value = &n, .least = -1e6, .most = 1e6, .help = "which way is up"},
              up, "load.fluid_lost");
    if (n.size() != 3 || Vec3(n[0], n[1], n[2]).isZero(0.0))
      refuse(fmt::format("has '{}' for the way up", up),
             "it is a side, or three numbers that are a direction");
    direction = Vec3(n[0], n[1], n[2]).stableNormalized();
  }
  return FluidWords{*direction, 0.01 * percent};
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
