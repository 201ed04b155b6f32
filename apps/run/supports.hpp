#pragma once

#include <map>
#include <string>
#include <vector>

#include "apps/scene/scene.hpp"
#include "solver/constraints.hpp"
#include "solver/terms/touching_tool.hpp"

namespace dimple {

/// The label that it is given by its number or its name, or -1.
int number_of_label(const std::string& label, const std::map<std::string, int>& names);
/// Whether a support is the tissue of a label: then points need to know theirs.
bool names_labels(const Scene& scene);

/// What scene.supports says, as sets of nodes, none of them in two of them or in the base; and a sentence on
/// each.
struct Supports {
  std::vector<HeldSet> sets;
  std::vector<std::string> words;
};
/// Throws ModelError: a support meets no node, or some of the tool's,
/// all of them leave nothing free, or the model lacks a surface or labels.
Supports supports_of(const Scene& scene, const Discretisation& places,
                     const std::map<std::string, int>& label_names);

/// Throws ModelError: a support holds nodes of the surface that a tool presses where it is pushed in by
/// `depth` [m] from its first touch.
void require_free_under(const Touch& tool, double depth, const std::vector<HeldSet>& supports,
                        const Model& model);

/// What the tissue does to it [N].
Vec3 force_on(const HeldSet& support, const Nodal& f);

}  // namespace dimple
