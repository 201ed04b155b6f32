#pragma once

#include <map>
#include <string>
#include <vector>

#include "apps/scene/scene.hpp"
#include "solver/constraints.hpp"
#include "solver/terms/rigid_contact.hpp"

namespace dimple {

/// Number of a label given by number or name, or -1.
int number_of_label(const std::string& label, const std::map<std::string, int>& names);
/// True if a support is the tissue of a label: then points need to know theirs.
bool names_labels(const Scene& scene);

/// Supports of scene.supports as sets of nodes, disjoint from each other and from the base; and a sentence on
/// each.
struct Supports {
  std::vector<HeldSet> sets;
  std::vector<std::string> words;
};
/// Throws ModelError: a support has no node or some of the tool's, or all of them leave nothing free. The
/// model may also lack a surface or labels.
Supports supports_of(const Scene& scene, const Discretisation& places,
                     const std::map<std::string, int>& label_names);

/// Throws ModelError: a support holds surface nodes that a tool presses down to `depth` [m] from first
/// contact.
void require_free_under(const RigidBody& tool, double depth, const std::vector<HeldSet>& supports,
                        const Model& model);

/// Force of the tissue on the support [N].
Vec3 force_on(const HeldSet& support, const Nodal& f);

}  // namespace dimple
