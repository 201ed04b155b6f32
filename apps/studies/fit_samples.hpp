#pragma once

#include "apps/studies/fit.hpp"

namespace dimple {

/// Fits each of many curves of one scene: fits.csv with a row for each sample, fits.png and .svg,
/// summary.json. The scene's forces are computed once, for mu on one run and for a further number on a grid
/// of its values; the fits interpolate between them. Throws as fit() does; a curve that has no fit has an
/// empty row and is counted.
Outcome fit_samples(const Description& described, const FitOptions& options,
                    const std::vector<MeasuredCurve>& curves, ResultFolder& results,
                    const std::filesystem::path& folder,
                    const std::function<void(const std::string&)>& progress);

}  // namespace dimple
