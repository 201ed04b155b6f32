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

/// A table of cells, each of a class: which combinations of two parameters work, and how the others fail.
struct Map {
  std::string title = {};
  std::vector<std::string> subtitle = {};
  std::string x_label = {}, y_label = {};               ///< with the unit
  std::vector<std::string> x_ticks = {}, y_ticks = {};  ///< [columns] from the left, [rows] from the top
  std::vector<std::string> cell = {};  ///< [rows x columns] code, row by row; empty: not known
  std::vector<std::string> note = {};  ///< [rows x columns] below the code, smaller; or none at all
  std::map<std::string, std::string> legend = {};  ///< code -> meaning
  std::map<std::string, int> colour = {};  ///< code -> the same number, the same colour in every picture
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

/// Likewise. The code "ok" is green, one that begins so pale green; the others take the colours asked for, or
/// in the order of the alphabet over all panels those that are left, of eight that the common colour-vision
/// deficiencies keep apart, then of eight paler ones.
void write_map_png(const std::filesystem::path& file, const std::vector<Map>& panels, int columns = 1);
void write_map_svg(const std::filesystem::path& file, const std::vector<Map>& panels, int columns = 1);

/// Likewise, but with few rows less tall.
void write_tornado_png(const std::filesystem::path& file, const std::vector<Tornado>& panels,
                       int columns = 1);
void write_tornado_svg(const std::filesystem::path& file, const std::vector<Tornado>& panels,
                       int columns = 1);

}  // namespace dimple
