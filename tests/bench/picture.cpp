#include "tests/bench/picture.hpp"

#include <fmt/format.h>

#include <cstdio>
#include <nlohmann/json.hpp>

namespace dimple {
namespace {

using Json = nlohmann::json;

Json json_of(const PlotSeries& s) {
  return {{"name", s.name},     {"x", s.x},           {"y", s.y},
          {"label", s.label},   {"line", s.line},     {"markers", s.markers},
          {"dashed", s.dashed}, {"hollow", s.hollow}, {"colour", s.colour}};
}

Json json_of(const Plot& plot) {
  Json json = {{"title", plot.title},     {"subtitle", plot.subtitle}, {"x_label", plot.x_label},
               {"y_label", plot.y_label}, {"log_x", plot.log_x},       {"log_y", plot.log_y},
               {"series", Json::array()}, {"lines", Json::array()}};
  if (plot.x_range) json["x_range"] = *plot.x_range;
  if (plot.y_range) json["y_range"] = *plot.y_range;
  for (const PlotSeries& series : plot.series) json["series"].push_back(json_of(series));
  for (const PlotLine& line : plot.lines)
    json["lines"].push_back({{"vertical", line.vertical}, {"at", line.at}, {"text", line.text}});
  return json;
}

}  // namespace

void write_plots(const std::filesystem::path& folder, const std::string& name,
                 const std::vector<Plot>& panels, int columns) {
  Json all = {{"columns", columns}, {"panels", Json::array()}};
  for (const Plot& panel : panels) all["panels"].push_back(json_of(panel));
  const std::string command =
      fmt::format("/usr/bin/python3 '{}' '{}'", DIMPLE_DRAW, (folder / name).string());
  std::FILE* draw = popen(command.c_str(), "w");
  if (!draw) return;
  fmt::print(draw, "{}", all.dump());
  if (pclose(draw) != 0) fmt::print(stderr, "{} is not drawn: it takes Debian's python3-matplotlib\n", name);
}

}  // namespace dimple
