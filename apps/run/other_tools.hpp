#pragma once

#include <string>
#include <vector>

#include "apps/scene/scene.hpp"
#include "solver/march.hpp"
#include "solver/terms/touching_tool.hpp"

namespace dimple {

/// Further tools that touch the body beside the one whose force is the answer: [tool.NAME].

/// Where they are to touch [mm, LPS]: nodes are as fine there as under the tool.
std::vector<Vec3> places_of_other_tools(const Scene& scene);

/// Each where it first touches the model, and a sentence on it. Its way is that of scene.further_tools for
/// each metre of the tool's, or what the steps say. Throws ModelError: the surface is far from the place that
/// was asked for, or the tool stands in another one.
struct OtherTools {
  std::vector<Touch> touch;
  std::vector<std::string> words;
};
OtherTools other_tools_of(const Scene& scene, const Model& model, const std::vector<HeldSet>& supports);

/// Throws UsageError: two tools that touch are in one place before anything moves.
void require_tools_apart(const Loading& loading);

/// What the tissue does to a further tool at the end, as a sentence.
std::string at_the_end_in_words(const std::string& name, const TouchingTool::Touched& now);

}  // namespace dimple
