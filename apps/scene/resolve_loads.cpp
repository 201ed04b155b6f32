#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "apps/scene/resolve_parts.hpp"
#include "apps/scene/surface_part.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

constexpr const char* of_all_the_surface = "surface";

[[noreturn]] void refuse_membrane(const std::string& name, const std::string& fact, const std::string& where,
                                  const std::string& why, const std::string& remedy) {
  throw UsageError({.fact = fmt::format("the membrane '{}' {}", name, fact),
                    .where = where,
                    .why = why,
                    .remedy = remedy});
}

// Membrane of a text: "0.1mm:400kPa"
FilmText film_of_words(const std::string& text) {
  FilmText film;
  const std::vector<Option> options = options_of(film);
  const auto number = [](const char* name, const Option& of) {
    return WordNumber{name, of.unit, 1.0, of.least, of.most};
  };
  const OptionWord word =
      parse_word({"the membrane",
                  {{.numbers = {number("thickness", options[0]), number("shear modulus", options[1])},
                    .example = "0.1mm:400kPa, or --set membrane.pia.tension=2N/m for a tension",
                    .between = ':'}}},
                 text, "--membrane (load.membrane)");
  film.thickness_mm = word.number[0], film.mu_Pa = word.number[1];
  return film;
}

void check(const std::string& name, const FilmText& film) {
  const bool thick = film.thickness_mm > 0.0, stiff = film.mu_Pa > 0.0;
  if (thick != stiff || !(stiff || film.tension_N_per_m > 0.0))
    refuse_membrane(name,
                    thick == stiff ? "has neither stiffness nor tension"
                    : thick        ? "has no modulus"
                                   : "has no thickness",
                    fmt::format("membrane.{}", name),
                    "its stiffness is its thickness times its shear modulus",
                    "give both, as in --membrane 0.1mm:400kPa, or only a tension");
}

void check(const std::string& name, const BodyForceText& text) {
  const auto require = [&](const char* key, const std::vector<double>& numbers, std::size_t count,
                           double most) {
    const bool is_far =
        std::any_of(numbers.begin(), numbers.end(), [&](double x) { return std::abs(x) > most; });
    if (numbers.size() == count && !is_far) return;
    throw UsageError(
        {.fact = fmt::format("the body force '{}' {}", name,
                             is_far ? "is out of range" : fmt::format("has {} numbers", numbers.size())),
         .where = fmt::format("load.body_force.{}.{}", name, key),
         .why = fmt::format("this option has {} numbers from {:g} to {:g}", count, -most, most),
         .remedy = "give x,y,z in LPS; of the gradient three rows of them, or none"});
  };
  require("force_N_per_m3", text.force_N_per_m3, 3, 1e9);
  require("at_mm", text.at_mm, 3, 1e6);
  if (!text.gradient_N_per_m4.empty()) require("gradient_N_per_m4", text.gradient_N_per_m4, 9, 1e12);
}

}  // namespace

std::vector<Scene::Film> films_named(const std::map<std::string, FilmText>& texts,
                                     const std::string& of_all) {
  std::map<std::string, FilmText> all = texts;
  if (of_all != "none" && !all.emplace(of_all_the_surface, film_of_words(of_all)).second)
    refuse_membrane(of_all_the_surface, "is given twice", "--membrane (load.membrane) and membrane.surface",
                    "the one of --membrane has that name",
                    "give one of them, or the other a name of its own");
  std::vector<Scene::Film> films;
  for (const auto& [name, film] : all) {
    films.push_back({.name = name,
                     .thickness_mm = film.thickness_mm,
                     .mu_Pa = film.mu_Pa,
                     .tension_N_per_m = film.tension_N_per_m,
                     .on = surface_part_named(film.on, fmt::format("membrane.{}.on", name),
                                              fmt::format("the membrane '{}'", name)),
                     .on_words = film.on,
                     .wrinkles = film.wrinkles == "yes"});
    check(name, film);
  }
  return films;
}

std::vector<Scene::Pressure> pressures_named(const std::map<std::string, PressureText>& texts) {
  std::vector<Scene::Pressure> pressures;
  for (const auto& [name, pressure] : texts)
    pressures.push_back({.name = name,
                         .pressure_Pa = pressure.pressure_Pa,
                         .on = surface_part_named(pressure.on, fmt::format("load.pressure.{}.on", name),
                                                  fmt::format("the pressure '{}'", name)),
                         .on_words = pressure.on,
                         .follows = pressure.follows == "yes"});
  return pressures;
}

std::vector<BodyForce> body_forces_named(const std::map<std::string, BodyForceText>& texts) {
  using Rows = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  std::vector<BodyForce> forces;
  for (const auto& [name, text] : texts) {
    check(name, text);
    BodyForce force{
        .name = name, .force = Vec3(text.force_N_per_m3.data()), .at = 1e-3 * Vec3(text.at_mm.data())};
    if (!text.gradient_N_per_m4.empty())
      force.gradient = Eigen::Map<const Rows>(text.gradient_N_per_m4.data());
    forces.push_back(std::move(force));
  }
  return forces;
}

WordNumber fraction_of_lost_fluid() {
  return {"share", "%", 0.01, 0.0, 100.0, true, true};
}

std::optional<Scene::Fluid> fluid_named(const std::string& text) {
  if (text == "none") return std::nullopt;
  const OptionWord word = parse_word(
      {"the lost fluid",
       {{.numbers = joined(direction_numbers(), {fraction_of_lost_fluid()}),
         .example = "the direction that is up and a fraction of the height: anterior,60%, or 0,-1,0,60%",
         .is_side = true}}},
      text, "load.fluid_lost");
  if (word.three().isZero(0.0)) refuse_word(word, "has no direction", "a direction is not zero");
  return Scene::Fluid{word.is_side ? word.three() : Vec3(word.three().stableNormalized()),
                      word.number.back()};
}

Vec3 gravity_named(const std::string& text) {
  if (text == "none") return Vec3::Zero();
  const OptionWord word =
      parse_word({"gravity",
                  {{.numbers = direction_numbers(), .example = "inferior, or 0,0,-9.81", .is_side = true}},
                  "it is a side of the patient, towards which 9.81 m/s2 pull, or three numbers in m/s2"},
                 text, "--gravity (load.gravity)");
  if (!(word.three().norm() < 1e5)) refuse_word(word, "is out of range", "its size is below 100000 m/s2");
  return word.is_side ? Vec3(9.81 * word.three()) : word.three();
}

std::optional<Vec3> followed_named(const std::string& quantity) {
  const OptionWord word = parse_word({"the quantity",
                                      {{"force"},
                                       {.kind = "displacement",
                                        .numbers = place_numbers(1e-3),
                                        .example = "displacement@12,-30,45",
                                        .after_kind = '@'}}},
                                     quantity, "--quantity (accuracy.quantity)");
  return word.number.empty() ? std::nullopt : std::optional(word.three());
}

}  // namespace dimple
