#pragma once

#include <map>
#include <string>
#include <vector>

#include "apps/run/organ.hpp"
#include "apps/scene/scene.hpp"
#include "io/draw/zero_pieces.hpp"
#include "solver/march.hpp"

namespace dimple {

/// Once the image is read: throws InputError where a wall is a label that is not there, or is of the body.
void check_walls(const Scene& scene, const LabelImage& image, const std::vector<int>& of_body,
                 const std::map<std::string, int>& names);

/// The walls beside a model, and what was found of each, in a sentence.
struct Walls {
  std::vector<Touch> touch;
  std::vector<std::string> words;
};
/// `image`: of the labels, and `organ`: as it was read from it; null: the model was made before. Throws
/// UsageError: a wall is made of an image, and there is none; ModelError: a wall lies in the body by more
/// than a voxel, with the place, or nothing of the body can reach it.
Walls walls_beside(const Scene& scene, const Model& model, const LabelImage* image, const Organ* organ);

/// How far a place is from the nearest of the walls [mm]; not a number where that is open. Empty: there are
/// none.
GapAt gap_to_walls(const Scene& scene, const Loading& loading);

/// Of a tool that lies in a wall, as it begins or where it straight goes, by more than a tenth of its radius:
/// a warning. Empty: none does.
std::string tool_in_wall(const Scene& scene, const Model& model, const Loading& loading);

/// "skull: pushed with 1.20 N net over 350 mm2; the surface reaches 0.0123 mm into it at most", or "not
/// touched".
std::string in_words(const std::string& name, const TouchingTool::Touched& wall);

}  // namespace dimple
