#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/band.hpp"
#include "solver/march.hpp"

namespace dimple {

/// A force curve that somebody has measured, or the end values of one: its loading, from the first contact to
/// the largest depth.
struct MeasuredCurve {
  std::string name = {};                       ///< of its file, or the word that stands for it
  double sample = 0.0;                         ///< number of the sample, where the file holds many
  std::vector<double> depth = {}, force = {};  ///< [m] above 0, [N]
  std::vector<double> time = {};               ///< [s], as many, or none
  std::vector<std::string> row_name = {};      ///< as many, or none where the depths tell the rows apart
  std::size_t simulated = 0;                   ///< of the last rows: not measured, and in no mean
  std::string left_out = {};                   ///< rows that are no part of the loading, in words
  std::string averaged = {};                   ///< how rows were put together, in words
};

/// A sensor's rows beyond this many say no more of a curve.
inline constexpr std::size_t most_rows_of_curve = 4000;

/// Reads a CSV with the columns indentation_mm (or _um) and force_N (or _mN, _uN, _nN), and time_s if there
/// is one. Depths rise until the largest; what comes after it, a hold or the unloading, is left out. Of more
/// than most_rows_of_curve rows groups of one size are averaged, except for the deepest, which stays. Throws
/// InputError: no such columns, depths that fall and rise again, no depth above 0, forces that do not resist,
/// several curves.
MeasuredCurve read_measured_curve(const std::filesystem::path& file);
/// One curve for each run of rows with the same number in the column sample; without that column, one.
std::vector<MeasuredCurve> read_measured_curves(const std::filesystem::path& file);

/// Speed of the tool [m/s]. Throws InputError: the curve has no times, they do not rise, or the depth is not
/// proportional to the time since contact within 5 % of the largest.
double ramp_rate(const MeasuredCurve& curve);

/// The word for the end values of Horton et al. 2007, section 5.
MeasuredCurve paper_curve();

/// A measured curve beside ours, where both are.
struct Comparison {
  MeasuredCurve measured;           ///< the rows that are compared
  std::vector<double> force, half;  ///< ours at its depths [N], and half the band's width, or none
  std::size_t deeper = 0;           ///< rows that are not compared: our curve ends before
  double at_end = 0.0, mean = 0.0;  ///< measured / ours at the last depth; sum of the measured / sum of ours
  double rms = 0.0;                 ///< of the differences [N]
  std::optional<double> inside_band;  ///< share of the measured rows
};
/// Nothing is fitted. Without a row where both are, `force` is empty. `touches`: ours is of a tool that
/// touches.
Comparison compare(const MeasuredCurve& measured, const std::vector<ForceSample>& ours, const Band& band,
                   bool touches = false);

/// "measured.csv: measured / ours 1.12 at 8.00 mm, 1.08 on average over 24 depths"
std::string in_words(const Comparison& comparison);
nlohmann::ordered_json to_json(const Comparison& comparison);
/// compare.csv
void write_comparison(const std::filesystem::path& file, const Comparison& comparison);

}  // namespace dimple
