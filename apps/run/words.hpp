#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "io/label_image.hpp"
#include "io/words.hpp"
#include "preprocess/build_model.hpp"
#include "solver/guards.hpp"

namespace dimple {

/// "2 (right_hemisphere)", and a dozen of them at most.
std::string in_words(const LabelMeasure& label);
std::string in_words(const std::vector<LabelMeasure>& labels);
/// One line for a finding.
std::string in_words(const Finding& finding);

/// "75.4 mN at 8.00 mm, 69.3 to 81.4 (discretisation)"; without a half-width, the first half only.
std::string force_title(double force_N, double depth_mm, std::optional<double> half_N = {});
/// Title of a scene of steps: "largest force 75.4 mN at 1.50 mm (step 'press'), 0 N at the end".
std::string scene_title(double largest_N, double depth_mm, const std::string& step, double last_N,
                        std::optional<double> half_N = {});
/// ", 69.3 to 81.4 (discretisation)", in the unit of the force itself.
std::string from_to(double force_N, double half_N, const std::string& by);
/// ", +- 1.2 (image resolution)", in the unit of the force itself.
std::string plus_minus(double force_N, double half_N, const std::string& by);

/// "1500 nodes: 0.55 mm apart at the tool, 24.46 mm far from it".
std::string nodes_in_words(Index nodes, const ModelReport& report);

/// Shell command that repeats, from any folder, the run of the folder's config.resolved.toml. It first
/// changes to the present working directory, where relative paths begin. `words`: the command and what is in
/// no file.
std::string run_again(const std::vector<std::string>& words, const std::filesystem::path& folder);

double poisson_ratio(const Material& m);

}  // namespace dimple
