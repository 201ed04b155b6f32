#include "apps/run/folds.hpp"

#include <fmt/format.h>

#include "apps/run/band.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "solver/equilibrium/mixed_iteration.hpp"

namespace dimple {
namespace {

// Of the tool's way: both banks may come towards each other.
constexpr double widest = 2.0;

bool has_inertia(const Config& config) {
  return config.solver.time == "explicit";
}

bool converges(const Config& config) {
  return config.scheme.name == Config{}.scheme.name;
}

}  // namespace

bool folds_touch(const Config& config, double facing_share) {
  if (config.load.self_contact != "auto") return config.load.self_contact == "on";
  return facing_share > most_facing && !has_inertia(config) && converges(config) &&
         MixedIteration::serves(materials_of(config));
}

void check_folds(const Config& config) {
  if (config.load.self_contact != "on") return;
  const bool by_time = has_inertia(config);
  if (!by_time && converges(config)) return;
  throw UsageError(
      {.fact = fmt::format("folds are to touch, and {} is '{}'", by_time ? "the time" : "the scheme",
                           by_time ? config.solver.time : config.scheme.name),
       .where = by_time ? "--self-contact (load.self_contact) and --time (solver.time)"
                        : "--self-contact (load.self_contact) and --scheme (scheme.name)",
       .why = "the contact is solved for in equilibrium, depth by depth",
       .remedy = "leave one of the two out"});
}

void require_open_folds(const Config& config, const std::string& what) {
  if (config.load.self_contact != "on") return;
  throw UsageError(
      {.fact = fmt::format("{} lets folds pass through each other", what),
       .where = "--self-contact (load.self_contact)",
       .why = "folds that touch are followed in equilibrium by `dimple run`, `solve` and `shift`",
       .remedy = "leave --self-contact out, or use dimple run IMAGE --self-contact on"});
}

std::shared_ptr<const FoldBanks> folds_of(const Config& config, double facing_share, const Model& model,
                                          double deepest) {
  if (!folds_touch(config, facing_share)) return nullptr;
  if (config.load.self_contact == "auto" && !model.scheme.pressure_patches) return nullptr;
  auto banks = std::make_shared<const FoldBanks>(fold_banks(model, widest * deepest));
  return banks->count() > 0 ? banks : nullptr;
}

std::string in_words(const FoldBanks& banks, double deepest) {
  return fmt::format("folds that close touch, without friction: gaps up to {} are watched at {} places",
                     length_in_words(1e3 * widest * deepest), banks.count());
}

}  // namespace dimple
