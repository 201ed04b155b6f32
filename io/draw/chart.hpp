#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace dimple {

/// Points of one kind, joined by a line in their order. Points that are not finite leave a gap in the line.
struct ChartSeries {
  std::string name = {};               ///< in the legend; empty: not there
  std::vector<double> x = {}, y = {};  ///< [n]
  bool line = true, markers = true;
  bool dashed = false;  ///< the line
  int colour = -1;      ///< same number, same hue and marker; -1: the next that no series requests
  std::vector<double> low = {}, high = {};  ///< [n] error bounds about the line; empty: none
  std::string end = {};                     ///< text at the last point, at a dot; empty: none
};

struct Chart {
  std::string title = {};
  std::vector<std::string> subtitle = {};
  std::string x_label = {}, y_label = {};  ///< with the unit
  std::vector<ChartSeries> series = {};
};

/// Sensitivities, the largest first: a bar for each row from its least to its greatest effect.
struct Tornado {
  struct Row {
    std::string name = {}, note = {};  ///< its quantity, and the range of that
    double low = 0.0, high = 0.0;      ///< of the effect; one of them may be 0
    int colour = 0;                    ///< same number, same hue
  };
  std::string title = {};
  std::vector<std::string> subtitle = {};
  std::string x_label = {};                ///< with the unit
  std::vector<Row> rows = {};              ///< from the top
  double shade = 0.0;                      ///< half-width of the range around zero that is insignificant
  std::string shade_text = {};             ///< its meaning
  std::map<int, std::string> legend = {};  ///< colour -> meaning
};

/// Draw the panels, 1000 x 650 pixels each, one below the other; panels of tornados are lower if they have
/// few rows. A PNG, or an SVG of the same picture if the name ends with .svg, without external references.
/// The same input gives the same bytes, no display is needed. Throw OutputError, and std::invalid_argument
/// where lengths do not agree, a bar ends nowhere or there is no panel.
void write_chart(const std::filesystem::path& file, const std::vector<Chart>& panels);
void write_tornado(const std::filesystem::path& file, const std::vector<Tornado>& panels);

}  // namespace dimple
