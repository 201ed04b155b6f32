#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "apps/scene/scene.hpp"
#include "io/error.hpp"

namespace dimple {

/// Feature of a scene, or driver (from `run` on). Two features are compatible unless the table of clashes()
/// excludes them.
enum class Feature : std::uint8_t {
  bonded_patch,
  contacting_tool,
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
  contacting_tool_by_hand,
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

/// Name of a feature in messages, "gravity", and its option.
struct FeatureWords {
  Feature feature;
  const char* name;
  const char* option;
};
const FeatureWords& words_of(Feature feature);

/// Feature that excludes some others. The texts may hold {beside}, the name of the other, and values of the
/// configuration. Without a fact, nothing is refused: `why` then explains missing error bounds or a force
/// that is not proportional to one modulus.
struct Clash {
  Feature feature;
  Features other;
  const char* fact;
  const char* where;
  const char* why;
  const char* remedy;
};
/// All of them, in the order in which they are checked.
std::span<const Clash> clashes();

/// Feature that requires error bounds or a proportional force. `lead`: text before the reason why there are
/// none.
struct Need {
  Feature feature, needs;
  const char* fact;
  const char* where;
  const char* lead;
  const char* remedy;
};
std::span<const Need> needs();

/// Features of a configuration, without drivers. Throws UsageError, InputError: a tool, a friction or a
/// material is not understood.
Features features_of(const Scene& scene);

/// Error that check_pairs() throws for this configuration and driver; nothing if they are compatible.
std::optional<Report> clash_of(const Scene& scene, Feature driver);

/// Throws UsageError if two features of the configuration exclude each other, or one excludes the driver.
/// Nothing needs to be built before. Throws what features_of() throws.
void check_pairs(const Scene& scene, Feature driver);

/// Throws UsageError: the configuration has `feature`, which excludes `other`. For features found after the
/// configuration was read: inertia of a march, or the scheme of a model made before.
void check_pair(const Scene& scene, Feature feature, Feature other);

inline constexpr const char* not_for_dynamics = "not calibrated for dynamics";
/// Reason why the configuration has no `requested` (error bounds or a proportional force); empty if it has.
std::string why_without(const Scene& scene, Feature requested);

/// Throws UsageError: the scheme does not support a law, a stress or several tissues. The scheme may be that
/// of a model made before.
void check_materials(const Scene& scene, const Scheme& scheme);

/// The table as text, a paragraph for each feature that excludes another.
std::string pairs_in_words();

}  // namespace dimple
