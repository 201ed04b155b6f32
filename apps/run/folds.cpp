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
