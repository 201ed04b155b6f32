#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "apps/scene/scene.hpp"
#include "io/error.hpp"

namespace dimple {

/// What a scene may have, and what may be done with it (a driver, from `run` on). Two of them go together
/// unless the table of clashes() says otherwise.
enum class Feature : std::uint8_t {
  circle,
  touching_tool,
  friction,          ///< of the measured tool
  further_friction,  ///< of a further tool or a wall
  chosen_contact,
  chosen_diameter,
  frictionless,
  sideways,
  turning,
  further_tool,
  moving_further_tool,
  fluid_lost,
  gravity,
  pressure,
  body_force,
  membrane,
  tension,
  free_base,
  wall,
  wall_at_gap,
  support,
  moving_support,
  steps,
  cut,
  cut_step,
  cut_after_step,
  grid_images,    ///< on the grid of the label image
  warped_images,  ///< of the patient
  followed_place,
  self_contact,
  imaged_loaded,
  converging_scheme,
  paper_scheme,
  inertia,
  viscous,
  tissues,
  other_law,
  printed_stress,
  ogden,
  mooney,
  preset,
  uncertain_mu,
  accuracy,
  comparison,
  paper_comparison,
  run,
  solve,
  solve_in_memory,
  model,
  model_in_memory,
  explain,
  fit,
  export_mesh,
  by_hand,
  touching_by_hand,
  session,
  shift,
  places,
  error_bounds,
  proportional_force,
};
inline constexpr std::size_t feature_count = static_cast<std::size_t>(Feature::proportional_force) + 1;

constexpr bool is_driver(Feature feature) {
  return feature >= Feature::run;
}

/// A set of features.
struct Features {
  std::uint64_t bits = 0;
  constexpr bool has(Feature feature) const { return (bits >> static_cast<unsigned>(feature) & 1U) != 0; }
  constexpr void set(Feature feature, bool is_there = true) {
    if (is_there) bits |= std::uint64_t{1} << static_cast<unsigned>(feature);
  }
  constexpr void erase(Feature feature) { bits &= ~(std::uint64_t{1} << static_cast<unsigned>(feature)); }
};
static_assert(feature_count <= 64);

/// How a feature is spoken of: "a tool that touches", and its option.
struct FeatureWords {
  Feature feature;
  const char* name;
  const char* option;
};
const FeatureWords& words_of(Feature feature);

/// A feature that does not go with any of some others. The texts may hold {beside}, the name of the other,
/// and values of the configuration. Without a fact nothing is refused: `why` is then the reason why there are
/// no error bounds, or why the force is not proportional to one modulus.
struct Clash {
  Feature feature;
  Features beside;
  const char* fact;
  const char* where;
  const char* why;
  const char* remedy;
};
/// All of them, in the order in which they are looked for.
std::span<const Clash> clashes();

/// A feature that takes error bounds or a proportional force. `lead` comes before the reason why there is
/// none.
struct Need {
  Feature feature, needs;
  const char* fact;
  const char* where;
  const char* lead;
  const char* remedy;
};
std::span<const Need> needs();

/// What of the table a configuration asks for, without drivers. Throws UsageError, InputError: a tool, a
/// friction or a material is not understood.
Features features_of(const Scene& scene);

/// Why this configuration does not go with the driver: what check_pairs() throws. Nothing: it goes.
std::optional<Report> clash_of(const Scene& scene, Feature driver);

/// Before anything is built: throws UsageError where two features of the configuration do not go together, or
/// one does not go with the driver. Throws what features_of() throws.
void check_pairs(const Scene& scene, Feature driver);

/// Throws UsageError: the configuration has `feature`, which does not go with `beside`. For what is known
/// later than the configuration: that a march has inertia, or the scheme of a model that was made before.
void check_pair(const Scene& scene, Feature feature, Feature beside);

inline constexpr const char* not_for_dynamics = "not calibrated for dynamics";
/// The reason why the configuration has no `wanted`, which are error bounds or a proportional force; empty:
/// it has.
std::string why_without(const Scene& scene, Feature wanted);

/// Throws UsageError: a law, a stress or several tissues that the scheme does not know. The scheme may be
/// that of a model that was made before.
void check_materials(const Scene& scene, const Scheme& scheme);

/// The table for people, a paragraph for each feature that does not go with another.
std::string pairs_in_words();

}  // namespace dimple
