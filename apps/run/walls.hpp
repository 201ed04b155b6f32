#pragma once

#include <map>
#include <string>
#include <vector>

#include "apps/run/organ.hpp"
#include "apps/scene/scene.hpp"
#include "io/draw/zero_pieces.hpp"
#include "solver/march.hpp"

namespace dimple {

/// Throws InputError, once the image is read: a wall is a label that is not there or belongs to the body.
void check_walls(const Scene& scene, const LabelImage& image, const std::vector<int>& of_body,
                 const std::map<std::string, int>& names);

/// Walls next to a model, and a sentence on each.
struct Walls {
  std::vector<RigidBody> rigid_body;
  std::vector<std::string> words;
};
/// `image`: with the labels; `organ`: read from it; null: the model was made before. Throws UsageError: a
/// wall needs an image, and there is none; ModelError: a wall overlaps the body by more than a voxel, with
/// the place, or no part of the body can reach it.
Walls walls_of(const Scene& scene, const Model& model, const LabelImage* image, const Organ* organ);

/// Distance of a place from the nearest wall [mm]; NaN at an opening. Empty: there are no walls.
GapAt gap_to_walls(const Scene& scene, const Loading& loading);

/// Warning that a tool overlaps a wall by more than a tenth of its radius, at its start or on its straight
/// path. Empty: none does.
std::string tool_in_wall(const Scene& scene, const Model& model, const Loading& loading);

/// Force, contact area and largest penetration of a wall at the end, in a sentence.
std::string in_words(const std::string& name, const RigidContact::ContactSummary& wall);

}  // namespace dimple
