#pragma once

#include <memory>
#include <string>

#include "apps/scene/scene.hpp"
#include "preprocess/supports/fold_faces.hpp"

namespace dimple {

/// True if closing folds are in contact instead of passing through each other (load.self_contact).
/// `facing_fraction`: fraction of the surface that faces itself. "auto" means contact in folded bodies
/// (most_facing), unless the requested scheme or time, or a tissue, does not support it.
bool folds_make_contact(const Scene& scene, double facing_fraction);

/// Places where the surface faces itself across gaps that the tool may close; null if there are none, or if
/// folds have no contact.
std::shared_ptr<const FoldFaces> folds_of(const Scene& scene, double facing_fraction, const Model& model,
                                          double deepest);

/// "gaps up to 16 mm are watched at 321 places".
std::string in_words(const FoldFaces& fold_faces, double deepest);

}  // namespace dimple
