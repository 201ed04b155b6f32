#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace dimple {

/// Points of one kind, joined by a line in their order.
struct PlotSeries {
  std::string name = {};
  std::vector<double> x = {}, y = {};   ///< [n]
  std::vector<std::string> label = {};  ///< [n] beside the points, or none at all
  bool line = true, markers = true;
  bool dashed = false;  ///< the line
  bool hollow = false;  ///< the markers
  int colour = -1;      ///< same number, same hue; -1: the next
};

/// A line across the plot with a few words.
struct PlotLine {
  bool vertical = false;
  double at = 0.0;
  std::string text = {};
};

struct Plot {
  std::string title = {};
  std::vector<std::string> subtitle = {};
  std::string x_label = {}, y_label = {};  ///< with the unit
  bool log_x = false, log_y = false;
  std::optional<std::array<double, 2>> x_range = {}, y_range = {};  ///< low, high; else what the series need
  std::vector<PlotSeries> series = {};
  std::vector<PlotLine> lines = {};
};

/// FOLDER/NAME.png and .svg by draw.py beside this, with matplotlib; where that is not installed, a line says
/// so.
void write_plots(const std::filesystem::path& folder, const std::string& name,
                 const std::vector<Plot>& panels, int columns = 1);

}  // namespace dimple
