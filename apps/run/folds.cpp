#include "apps/run/folds.hpp"

#include <fmt/format.h>

#include "apps/run/error_bounds.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "solver/equilibrium/mixed_iteration.hpp"

namespace dimple {
namespace {

// Widest gap that is watched, in depths of the tool: both walls of a sulcus may approach each other.
constexpr double widest = 2.0;

}  // namespace

bool folds_make_contact(const Scene& scene, double facing_fraction) {
  if (scene.self_contact != Scene::SelfContact::automatic)
    return scene.self_contact == Scene::SelfContact::on;
  return facing_fraction > most_facing && scene.solver.time != Scene::Numerics::Time::explicit_ &&
         converges(scene) && MixedIteration::serves(materials_of(scene));
}

std::shared_ptr<const FoldFaces> folds_of(const Scene& scene, double facing_fraction, const Model& model,
                                          double deepest) {
  if (!folds_make_contact(scene, facing_fraction)) return nullptr;
  if (scene.self_contact == Scene::SelfContact::automatic && !model.scheme.pressure_patches) return nullptr;
  auto fold_faces = std::make_shared<const FoldFaces>(find_fold_faces(model, widest * deepest));
  return fold_faces->count() > 0 ? fold_faces : nullptr;
}

std::string in_words(const FoldFaces& fold_faces, double deepest) {
  return fmt::format("contact between folds, without friction: gaps up to {}, {} contact points",
                     length_in_words(1e3 * widest * deepest), fold_faces.count());
}

}  // namespace dimple
