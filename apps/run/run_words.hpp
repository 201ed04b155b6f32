#pragma once

#include <string>

#include "apps/run/organ.hpp"
#include "apps/run/refine.hpp"

namespace dimple {

// Messages of a run, made of its data.

/// Reports that a folded body uses as many nodes as its error bounds need, instead of the default.
std::string nodes_for_error_bounds_in_words(Index nodes, Index usual, double facing_fraction);
std::string nodes_for_edge_in_words(Index nodes, Index usual);
/// Reports supports, gradients, folds and masses of a complete model.
void report_supports(const RunLog& log, const Model& model);
/// Law and numbers of a tissue.
std::string describe(const Tissues& tissues, std::size_t t, const std::string& label);
/// Moduli, loads, supports, cuts and steps, one line each, for the picture.
std::vector<std::string> scene_in_words(const Scene& scene, const Result& result);
/// Materials of the points.
std::vector<Material> in_use(const Tissues& tissues);
/// Time mode and its reason. `shallow`: the load is short, but its tool is slow.
std::string time_in_words(TimeMode mode, double crossings, bool shallow);

/// Warns of numbers that look like metres or kPa: a depth, a tool, a modulus or a film smaller than any of
/// soft tissue.
void ask_for_units(const RunLog& log, const Scene& scene, const LoadedModel& result);
/// Warns if the base does not carry the tool's force at the end of a dynamic march.
void warn_of_inertia(const RunLog& log, const Result& result);

/// Line of a refinement level, and of one that failed.
std::string level_in_words(int number, const RefinementLevel& level, bool has_displacement);
std::string failure_in_words(int number, Index nodes, const std::string& fact);
/// Reason why a refinement has ended before its goal.
std::string in_words(const RefinementEnd& end, const Goal& goal);
/// Warning that the requested accuracy was not reached. `fraction`: remaining error, as a part of the force
/// or length.
std::string shortfall_in_words(const std::string& requested, std::optional<double> fraction,
                               const std::string& ended);
/// Cost of half the error. `more`: nodes for it.
std::string next_half_in_words(const Refinement& refinement, Index more);

}  // namespace dimple
