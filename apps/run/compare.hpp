#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/error_bounds.hpp"
#include "solver/march.hpp"

namespace dimple {

/// Measured force curve, or its end values: loading, from the first contact to the largest depth.
struct MeasuredCurve {
  std::string name = {};                       ///< of its file, or the word that stands for it
  double sample = 0.0;                         ///< number of the sample, where the file holds many
  std::vector<double> depth = {}, force = {};  ///< [m] above 0, [N]
  std::vector<double> time = {};               ///< [s], as many, or none
  std::vector<std::string> row_name = {};      ///< as many, or none if the depths identify the rows
  std::size_t simulated = 0;                   ///< number of last rows; not measured, and in no mean
  std::string left_out = {};                   ///< rows that do not belong to the loading, in words
  std::string averaged = {};                   ///< how rows were averaged, in words
};

/// Most rows of a curve; more rows of a sensor add nothing.
inline constexpr std::size_t most_rows_of_curve = 4000;

/// Reads a CSV with the columns indentation_mm and force_N (or force_mN), and time_s if there is one. Depths
/// rise to the largest; rows after it, a hold or the unloading, are left out. More than most_rows_of_curve
/// rows are averaged in groups of one size, except for the deepest. Throws InputError: no such columns,
/// depths that fall and rise again, no depth above 0, forces without resistance.
MeasuredCurve read_measured_curve(const std::filesystem::path& file);
/// One curve for each run of rows with the same number in the column sample; without that column, one.
std::vector<MeasuredCurve> read_measured_curves(const std::filesystem::path& file);

/// Speed of the tool [m/s]. Throws InputError: the curve has no times, or they do not rise. The depth must be
/// proportional to the time since contact within 5 % of the largest depth.
double ramp_rate(const MeasuredCurve& curve);

/// End values of Horton et al. 2007, section 5, for `paper_word`.
MeasuredCurve paper_curve();

/// Comparison of a measured curve with the computed one, at depths of both.
struct Comparison {
  MeasuredCurve measured;           ///< the rows that are compared
  std::vector<double> force, half;  ///< computed, at its depths [N], and half-width of the bounds, or none
  bool contacting = false;          ///< a contacting tool
  std::size_t deeper = 0;           ///< rows that are not compared: the computed curve ends before
  double at_end = 0.0, mean = 0.0;  ///< measured / computed: at the last depth; of the sums
  double rms = 0.0;                 ///< of the differences [N]
  std::optional<double> inside_error_bounds;  ///< fraction of the measured rows
};
/// Compares without any fit. `force` is empty if no row is within the computed depth. `has_contact`: the
/// computed curve is of a contacting tool.
Comparison compare(const MeasuredCurve& measured, const std::vector<ForceSample>& ours,
                   const ErrorBounds& error_bounds, bool has_contact = false);

/// "measured.csv: measured / ours 1.12 at 8.00 mm, 1.08 on average over 24 depths"
std::string in_words(const Comparison& comparison);
nlohmann::ordered_json to_json(const Comparison& comparison);
/// compare.csv
void write_comparison(const std::filesystem::path& file, const Comparison& comparison);

}  // namespace dimple
