#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace dimple {

/// Points of one kind, joined by a line in their order. A point that is not finite, or not positive on a
/// logarithmic axis, is not drawn and leaves a gap in the line.
struct ChartSeries {
  std::string name = {};                ///< in the legend; empty: not there
  std::vector<double> x = {}, y = {};   ///< [n]
  std::vector<std::string> label = {};  ///< [n] beside the points, or none at all
  bool line = true, markers = true;
  bool dashed = false;  ///< the line
  bool hollow = false;  ///< the markers
  int colour = -1;      ///< same number, same hue and marker; -1: the next that no series asks for
};

/// A line across the plot with a few words, e.g. "real time", "2 %".
struct ChartLine {
  bool vertical = false;
  double at = 0.0;
  std::string text = {};
};

struct Chart {
  std::string title = {};
  std::vector<std::string> subtitle = {};
  std::string x_label = {}, y_label = {};  ///< with the unit
  bool log_x = false, log_y = false;
  std::optional<std::array<double, 2>> x_range = {},
                                       y_range = {};  ///< low, high; else what series and lines need
  std::vector<ChartSeries> series = {};
  std::vector<ChartLine> lines = {};
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

/// Draw the panels, 1000 x 650 pixels each, row by row in a grid of at most that many columns. Both files
/// show the same picture: the same input gives the same bytes, no display is needed, the SVG refers to
/// nothing outside itself. Points left out for a logarithmic axis or a range are counted in a note.
/// Throw OutputError, and std::invalid_argument where lengths do not agree, a range is not one or there is
/// no column.
void write_chart_png(const std::filesystem::path& file, const std::vector<Chart>& panels, int columns = 1);
void write_chart_svg(const std::filesystem::path& file, const std::vector<Chart>& panels, int columns = 1);

/// Likewise.
void write_tornado_png(const std::filesystem::path& file, const std::vector<Tornado>& panels,
                       int columns = 1);
void write_tornado_svg(const std::filesystem::path& file, const std::vector<Tornado>& panels,
                       int columns = 1);

}  // namespace dimple
