#pragma once

#include <memory>
#include <string>

#include "apps/scene/scene.hpp"
#include "preprocess/supports/fold_banks.hpp"

namespace dimple {

/// Whether folds that close touch, instead of passing through each other (load.self_contact), in a body of
/// which that share of the surface faces itself: "auto" has them touch in folded bodies (most_facing), unless
/// the scheme or the time that is asked for, or such a tissue, has no contact looked for.
bool folds_touch(const Scene& scene, double facing_share);

/// Where the model's surface faces itself across gaps that the tool's way may close; null: nowhere, or they
/// do not touch.
std::shared_ptr<const FoldBanks> folds_of(const Scene& scene, double facing_share, const Model& model,
                                          double deepest);

/// "gaps up to 16 mm are watched at 321 places".
std::string in_words(const FoldBanks& banks, double deepest);

}  // namespace dimple
