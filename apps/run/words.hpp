#pragma once

#include <string>
#include <vector>

#include "io/label_image.hpp"
#include "io/words.hpp"
#include "solver/guards.hpp"

namespace dimple {

/// "2 (right_hemisphere)", and a dozen of them at most.
std::string in_words(const LabelMeasure& label);
std::string in_words(const std::vector<LabelMeasure>& labels);
/// On one line, beside the others of a run that goes on.
std::string in_words(const Finding& finding);

double poisson_ratio(const Material& m);

}  // namespace dimple
