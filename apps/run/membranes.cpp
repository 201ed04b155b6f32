#include "apps/run/membranes.hpp"

#include <fmt/format.h>

#include "apps/scene/option_word.hpp"
#include "apps/scene/surface_part.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"

namespace dimple {
namespace {

std::vector<Index> triangles_of(const Scene::Film& film, const Surface& surface) {
  std::vector<Index> chosen = uncut_triangles_on(film.on, surface);
  if (chosen.empty() && !surface.empty())
    throw UsageError({.fact = fmt::format("the membrane '{}' on '{}' meets no part of the surface", film.name,
                                          film.on_words),
                      .where = fmt::format("membrane.{}.on", film.name),
                      .why = "it would cover nothing",
                      .remedy = "give all, a side, or a larger ball on the surface"});
  return chosen;
}

}  // namespace

void check_membranes(const Scene& scene, const Surface& surface) {
  if (scene.membranes.empty()) return;
  if (surface.empty())
    throw ModelError({.fact = "a membrane needs a surface, and this model has none",
                      .where = "membrane",
                      .why = "its files hold only nodes and points",
                      .remedy = "use the label image, or leave the membrane out"});
  for (const Scene::Film& film : scene.membranes) triangles_of(film, surface);
}

std::vector<Membrane> membranes_on(const Scene& scene, const Model& model, const Surface& chosen_on) {
  std::vector<Membrane> membranes;
  if (scene.membranes.empty()) return membranes;
  for (const Scene::Film& film : scene.membranes)
    membranes.push_back({.name = film.name,
                         .patch = surface_patch(model, triangles_of(film, chosen_on)),
                         .thickness = 1e-3 * film.thickness_mm,
                         .shear_modulus = film.mu_Pa,
                         .wrinkles = film.wrinkles,
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
    text += fmt::format("{} tension {} N/m; the body is in equilibrium under it first",
                        stiffness > 0.0 ? "," : "", three_digits(film.tension));
  if (!film.wrinkles) text += ", bears compression";
  return text + fmt::format(", on {} mm2 of the surface", three_digits(1e6 * area_of(film.patch)));
}

}  // namespace dimple
