#pragma once

#include <string>

#include "apps/run/organ.hpp"
#include "apps/run/refine.hpp"

namespace dimple {

// What a run tells while it goes, made of its data.

/// That a folded body takes as many nodes as its band needs, in place of the usual ones.
std::string nodes_for_band_in_words(Index nodes, Index usual, double facing_share);
std::string nodes_for_edge_in_words(Index nodes, Index usual);
/// The supports, the gradients, the folds and the masses of a model that is complete.
void tell_of_supports(const RunLog& log, const Model& model);
/// Law and numbers of a tissue.
std::string describe(const Tissues& tissues, std::size_t t, const std::string& label);
/// Moduli, loads, supports, cuts and steps, a line for each kind: for the picture.
std::vector<std::string> scene_in_words(const Scene& scene, const Result& result);
/// The materials that points are of.
std::vector<Material> in_use(const Tissues& tissues);
/// How time is followed, and why so. `shallow`: the load is short, but its tool is slow.
std::string time_in_words(TimeMode mode, double crossings, bool shallow);

/// Asks for the unit of numbers that look like metres or kPa: a depth, a tool, a modulus or a film that is
/// smaller than any of soft tissue.
void ask_for_units(const RunLog& log, const Scene& scene, const LoadedModel& result);
/// Warns where the base does not bear the tool's force at the end of a march with inertia.
void warn_of_inertia(const RunLog& log, const Result& result);

/// The cloud of a refinement level, and one that came to nothing.
std::string level_in_words(int number, const RefinementLevel& level, bool has_displacement);
std::string failure_in_words(int number, Index nodes, const std::string& fact);
/// Why a refinement has ended before its goal.
std::string in_words(const RefinementEnd& end, const Goal& goal);
/// That the accuracy asked for was not reached. `share`: the error that is left, as a part of the force or
/// length.
std::string shortfall_in_words(const std::string& asked, std::optional<double> share,
                               const std::string& ended);
/// What half the error would take. `more`: nodes for it.
std::string next_half_in_words(const Refinement& refinement, Index more);

}  // namespace dimple
