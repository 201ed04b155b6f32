#pragma once

#include <string>
#include <vector>

#include "apps/scene/scene.hpp"
#include "solver/march.hpp"
#include "solver/terms/rigid_contact.hpp"

namespace dimple {

/// Further contacting tools, in addition to the one whose force is computed: [tool.NAME].

/// Requested contact points [mm, LPS]: nodes are as fine there as under the tool.
std::vector<Vec3> places_of_other_tools(const Scene& scene);

/// Further tools at first contact with the model, with a sentence on each. They move as scene.further_tools
/// says for each metre of the tool, or by the steps. Throws ModelError: the surface is missing, far from the
/// requested place, or not faced by the tool; UsageError: the tool is too short.
struct OtherTools {
  std::vector<RigidBody> rigid_body;
  std::vector<std::string> words;
};
OtherTools other_tools_of(const Scene& scene, const Model& model, const std::vector<HeldSet>& supports);

/// Throws UsageError: two contacting tools overlap before anything moves.
void require_tools_apart(const Loading& loading);

/// Force of the tissue on a further tool at the end, as a sentence.
std::string at_the_end_in_words(const std::string& name, const RigidContact::ContactSummary& now);

}  // namespace dimple
