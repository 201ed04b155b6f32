#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace dimple {

/// Points of one kind, joined by a line in their order. A point that is not finite is not drawn and leaves a
/// gap in the line.
struct ChartSeries {
  std::string name = {};               ///< in the legend; empty: not there
  std::vector<double> x = {}, y = {};  ///< [n]
  bool line = true, markers = true;
  bool dashed = false;            ///< the line
  int colour = -1;                ///< same number, same hue and marker; -1: the next that no series asks for
  std::vector<double> half = {};  ///< [n] half the width of a band about the line; empty: none
  std::string end = {};           ///< what is written at the last point, at a dot; empty: nothing
};

struct Chart {
  std::string title = {};
  std::vector<std::string> subtitle = {};
  std::string x_label = {}, y_label = {};  ///< with the unit
  std::vector<ChartSeries> series = {};
};

/// What a result depends on, the largest first: a bar for each row from its least to its greatest effect.
struct Tornado {
  struct Row {
    std::string name = {}, note = {};  ///< what it is, and between what
    double low = 0.0, high = 0.0;      ///< of the effect; one of them may be 0
    int colour = 0;                    ///< same number, same hue
  };
  std::string title = {};
  std::vector<std::string> subtitle = {};
  std::string x_label = {};                ///< with the unit
  std::vector<Row> rows = {};              ///< from the top
  double shade = 0.0;                      ///< half the width of a band around zero that means nothing
  std::string shade_text = {};             ///< what it is
  std::map<int, std::string> legend = {};  ///< colour -> meaning
};

/// Draw the panels, 1000 x 650 pixels each, one below the other; those of tornados are less tall where they
/// have few rows. A PNG, or where the name ends with .svg an SVG of the same picture, which refers to nothing
/// outside itself. The same input gives the same bytes, no display is needed. Throw OutputError, and
/// std::invalid_argument where lengths do not agree, a bar ends nowhere or there is no panel.
void write_chart(const std::filesystem::path& file, const std::vector<Chart>& panels);
void write_tornado(const std::filesystem::path& file, const std::vector<Tornado>& panels);

}  // namespace dimple
