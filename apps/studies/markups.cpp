#include "apps/studies/markups.hpp"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/text.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse_markups(const fs::path& file, const std::string& fact, const std::string& why) {
  throw InputError({.fact = fact,
                    .where = file.string(),
                    .why = why,
                    .remedy = "save the points in 3D Slicer as .mrk.json or .fcsv, or give x,y,z in LPS mm"});
}

// Position in LPS: x and y of RAS change their sign. Old files write 0 for RAS and 1 for LPS.
Vec3 in_lps(const fs::path& file, const std::string& space, const Vec3& x) {
  if (space == "LPS" || space == "1") return x;
  if (space == "RAS" || space == "0") return {-x.x(), -x.y(), x.z()};
  refuse_markups(file, fmt::format("the places are in the space '{}'", space), "known are RAS and LPS");
}

double coordinate_in(const fs::path& file, const std::string& field) {
  const std::string text(trimmed(field));
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value))
    refuse_markups(file, fmt::format("'{}' is not a coordinate", field), "a point has three numbers, in mm");
  return value;
}

// Points in rows of id,x,y,z,... after "# CoordinateSystem = RAS".
std::vector<Vec3> read_fcsv(const fs::path& file, const std::string& content) {
  std::string space = "RAS";  // default for old files
  std::vector<Vec3> places;
  std::istringstream lines(content);
  for (std::string line; std::getline(lines, line);) {
    const std::string text(trimmed(line));
    if (text.empty()) continue;
    if (text.front() == '#') {
      if (const auto equals = text.find('='); text.find("CoordinateSystem") < equals)
        space = std::string(trimmed(text.substr(equals + 1)));
      continue;
    }
    std::vector<std::string> fields;
    std::istringstream row(text);
    for (std::string field; std::getline(row, field, ',');) fields.push_back(field);
    if (fields.size() < 4)
      refuse_markups(file, fmt::format("the row '{}' has {} fields", text, fields.size()),
                     "a row is id,x,y,z and more");
    places.push_back(in_lps(
        file, space,
        {coordinate_in(file, fields[1]), coordinate_in(file, fields[2]), coordinate_in(file, fields[3])}));
  }
  return places;
}

std::vector<Vec3> read_mrk_json(const fs::path& file, const std::string& content) {
  std::vector<Vec3> places;
  try {
    const auto json = nlohmann::json::parse(content);
    for (const auto& list : json.at("markups")) {
      const std::string space = list.value("coordinateSystem", "LPS");
      for (const auto& point : list.at("controlPoints")) {
        const auto x = point.at("position").get<std::vector<double>>();
        if (x.size() != 3)
          refuse_markups(file, fmt::format("a point has {} coordinates", x.size()),
                         "a point has three numbers, in mm");
        places.push_back(in_lps(file, space, {x[0], x[1], x[2]}));
      }
    }
  } catch (const nlohmann::json::exception& error) {
    refuse_markups(file, "this is no markups file of 3D Slicer", error.what());
  }
  return places;
}

}  // namespace

bool is_markups_file(const fs::path& file) {
  const std::string suffix = lower(file.extension().string());
  return suffix == ".fcsv" || suffix == ".json";
}

std::vector<Vec3> read_markups(const fs::path& file) {
  const std::string content = read_file(file, most_bytes_of_text);
  const std::vector<Vec3> places =
      lower(file.extension().string()) == ".fcsv" ? read_fcsv(file, content) : read_mrk_json(file, content);
  if (places.empty())
    refuse_markups(file, "no point is in the file", "there is no place at which to report a shift");
  return places;
}

}  // namespace dimple
