#include "apps/run/folds.hpp"

#include <fmt/format.h>

#include "apps/run/band.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "solver/equilibrium/mixed_iteration.hpp"

namespace dimple {
namespace {

// Widest gap that is watched, in depths of the tool: both walls of a sulcus may approach each other.
constexpr double widest = 2.0;

}  // namespace

bool folds_touch(const Scene& scene, double facing_share) {
  if (scene.self_contact != Scene::SelfContact::automatic)
    return scene.self_contact == Scene::SelfContact::on;
  return facing_share > most_facing && scene.solver.time != Scene::Numerics::Time::explicit_ &&
         converges(scene) && MixedIteration::serves(materials_of(scene));
}

std::shared_ptr<const FoldBanks> folds_of(const Scene& scene, double facing_share, const Model& model,
                                          double deepest) {
  if (!folds_touch(scene, facing_share)) return nullptr;
  if (scene.self_contact == Scene::SelfContact::automatic && !model.scheme.pressure_patches) return nullptr;
  auto banks = std::make_shared<const FoldBanks>(fold_banks(model, widest * deepest));
  return banks->count() > 0 ? banks : nullptr;
}

std::string in_words(const FoldBanks& banks, double deepest) {
  return fmt::format("contact between folds, without friction: gaps up to {}, {} contact points",
                     length_in_words(1e3 * widest * deepest), banks.count());
}

}  // namespace dimple
