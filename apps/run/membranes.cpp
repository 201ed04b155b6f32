#include "apps/run/membranes.hpp"

#include <fmt/format.h>

#include "apps/run/option_word.hpp"
#include "apps/run/surface_part.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

constexpr const char* of_all = "surface";

[[noreturn]] void refuse(const std::string& name, const std::string& fact, const std::string& where,
                         const std::string& why, const std::string& remedy) {
  throw UsageError({.fact = fmt::format("the membrane '{}' {}", name, fact),
                    .where = where,
                    .why = why,
                    .remedy = remedy});
}

// "0.1mm:400kPa"
Config::Film film_of_words(const std::string& text) {
  Config::Film film;
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

std::map<std::string, Config::Film> films_of(const Config& config) {
  std::map<std::string, Config::Film> films = config.membrane;
  if (config.load.membrane == "none") return films;
  const Config::Film film = film_of_words(config.load.membrane);
  if (!films.emplace(of_all, film).second)
    refuse(of_all, "is given twice", "--membrane (load.membrane) and membrane.surface",
           "the one of --membrane has that name", "give one of them, or the other a name of its own");
  return films;
}

std::vector<Index> triangles_of(const std::string& name, const Config::Film& film, const Surface& surface) {
  const std::string where = fmt::format("membrane.{}.on", name);
  std::vector<Index> chosen =
      uncut_triangles_on(surface_part_named(film.on, where, fmt::format("the membrane '{}'", name)), surface);
  if (chosen.empty() && !surface.empty())
    refuse(name, fmt::format("on '{}' meets no part of the surface", film.on), where,
           "it would cover nothing", "give all, a side, or a larger ball on the surface");
  return chosen;
}

}  // namespace

void check_membranes(const Config& config) {
  if (!has_membranes(config)) return;
  for (const auto& [name, film] : films_of(config)) {
    triangles_of(name, film, {});
    const bool thick = film.thickness_mm > 0.0, stiff = film.mu_Pa > 0.0;
    if (thick != stiff || !(stiff || film.tension_N_per_m > 0.0))
      refuse(name,
             thick == stiff ? "has neither stiffness nor tension"
             : thick        ? "has no modulus"
                            : "has no thickness",
             fmt::format("membrane.{}", name), "its stiffness is its thickness times its shear modulus",
             "give both, as in --membrane 0.1mm:400kPa, or a tension alone");
  }
}

void check_membranes(const Config& config, const Surface& surface) {
  if (!has_membranes(config)) return;
  if (surface.empty())
    throw ModelError({.fact = "a membrane lies on the surface, and this model has none",
                      .where = "membrane",
                      .why = "its files hold nodes and points alone",
                      .remedy = "take the label image, or leave the membrane out"});
  for (const auto& [name, film] : films_of(config)) triangles_of(name, film, surface);
}

std::vector<Membrane> membranes_on(const Config& config, const Model& model, const Surface& chosen_on) {
  std::vector<Membrane> membranes;
  if (!has_membranes(config)) return membranes;
  for (const auto& [name, film] : films_of(config))
    membranes.push_back({.name = name,
                         .patch = surface_patch(model, triangles_of(name, film, chosen_on)),
                         .thickness = 1e-3 * film.thickness_mm,
                         .shear_modulus = film.mu_Pa,
                         .wrinkles = film.wrinkles == "yes",
                         .tension = film.tension_N_per_m});
  return membranes;
}

std::string in_words(const Membrane& film) {
  const double stiffness = film.thickness * film.shear_modulus;
  std::string text = film.name + ":";
  if (stiffness > 0.0)
    text += fmt::format(" {} of {} ({} N/m)", length_in_words(1e3 * film.thickness),
                        stress_in_words(film.shear_modulus), three_digits(stiffness));
  if (film.tension > 0.0)
    text += fmt::format("{} tension {} N/m; the body comes to rest under it first",
                        stiffness > 0.0 ? "," : "", three_digits(film.tension));
  if (!film.wrinkles) text += ", bears compression";
  return text + fmt::format(", on {} mm2 of the surface", three_digits(1e6 * area_of(film.patch)));
}

}  // namespace dimple
