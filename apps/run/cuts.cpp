#include "apps/run/cuts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "apps/run/steps.hpp"
#include "apps/run/words.hpp"
#include "io/error.hpp"
#include "io/surface_mesh.hpp"
#include "io/text.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

constexpr const char* option_of_cuts = "--cut (image.cut)";
// Of a whole plane: CGAL hears no Ctrl-C, and a lung's took 12 s with 214 of them.
constexpr double most_rings = 60.0;
constexpr const char* forms =
    "plane:x,y,z,nx,ny,nz[,radius=20mm], line:x,y,z,x,y,z,depth=15mm, sheet.stl or label:NAME";

std::vector<std::string> split(const std::string& text, char at) {
  std::vector<std::string> parts;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end = std::min(text.find(at, begin), text.size());
    if (std::string part(trimmed(text.substr(begin, end - begin))); !part.empty())
      parts.push_back(std::move(part));
    begin = end + 1;
  }
  return parts;
}

// One of those that such an option lists.
struct Words {
  std::string text, where, kind, rest;
  bool is_file() const { return kind == "file"; }
};

[[noreturn]] void refuse(const Words& words, const std::string& fact, const std::string& why) {
  throw UsageError({.fact = fmt::format("the cut '{}' {}", words.text, fact),
                    .where = words.where,
                    .why = why,
                    .remedy = fmt::format("give {}", forms)});
}

std::vector<Words> words_of(const CutText& cut) {
  std::vector<Words> result;
  for (const std::string& text : split(cut.text, ';')) {
    const std::size_t colon = text.find(':');
    const std::string kind = text.substr(0, colon);
    if (kind == "plane" || kind == "line" || kind == "label")
      result.push_back({text, cut.where, kind,
                        colon == std::string::npos ? "" : std::string(trimmed(text.substr(colon + 1)))});
    else if (is_surface_file(text))
      result.push_back({text, cut.where, "file", text});
    else
      refuse({text, cut.where, "", ""}, "is not known",
             fmt::format("it is a plane, a line, a label or a surface, which is read from {} files",
                         surface_suffixes));
  }
  return result;
}

double number_of(const Words& words, const std::string& text, const char* unit) {
  double value = 0.0;
  set_value({.key = "image.cut",
             .flag = "--cut",
             .unit = unit,
             .value = &value,
             .least = -1e6,
             .most = 1e6,
             .help = "a number of a cut"},
            text, fmt::format("{}, '{}'", words.where, words.text));
  return value;
}

// Six numbers, and one more length by name.
struct Six {
  Vec3 first, second;
  double length = 0.0;  // [mm]; 0: not given
};

Six six_of(const Words& words, const std::string& name, const char* unit_of_second) {
  const std::vector<std::string> parts = split(words.rest, ',');
  if (parts.size() < 6 || parts.size() > 7)
    refuse(words, fmt::format("has {} parts", parts.size()),
           fmt::format("a {} has six numbers{}", words.kind, " and one length by name"));
  Six six;
  for (Index k = 0; k < 3; ++k) {
    six.first[k] = number_of(words, parts[static_cast<std::size_t>(k)], "mm");
    six.second[k] = number_of(words, parts[static_cast<std::size_t>(k) + 3], unit_of_second);
  }
  if (parts.size() == 6) return six;
  const std::size_t equals = parts[6].find('=');
  if (equals == std::string::npos || trimmed(parts[6].substr(0, equals)) != name)
    refuse(words, fmt::format("ends with '{}'", parts[6]), fmt::format("its length is called {}", name));
  six.length = number_of(words, std::string(trimmed(parts[6].substr(equals + 1))), "mm");
  if (!(six.length > 0.0))
    refuse(words, fmt::format("has a {} of {}", name, length_in_words(six.length)), "a length is above zero");
  return six;
}

Six plane_of(const Words& words) {
  const Six six = six_of(words, "radius", "");
  if (!(six.second.norm() > 0.0)) refuse(words, "has no normal", "three zeros are no direction");
  return six;
}

Six line_of(const Words& words) {
  const Six six = six_of(words, "depth", "mm");
  if (!(six.length > 0.0)) refuse(words, "has no depth", "an edge cuts as deep as it is pushed");
  if (!((six.first - six.second).norm() > 0.0))
    refuse(words, "begins where it ends", "an edge that does not move opens nothing");
  return six;
}

TriangleMesh drawn(const Words& words) {
  const SurfaceFile file = read_surface_mesh(words.rest);
  return {file.position_mm, file.triangles};
}

double size_of(const TriangleMesh& sheet) {
  return (sheet.vertex.rowwise().maxCoeff() - sheet.vertex.rowwise().minCoeff()).maxCoeff();
}

// How long or deep it is, whichever is less [mm]; infinite: a whole plane, or labels.
double extent_of(const Words& words) {
  if (words.is_file()) return size_of(drawn(words));
  if (words.kind == "line") {
    const Six line = line_of(words);
    return std::min(line.length, (line.first - line.second).norm());
  }
  const double radius = words.kind == "plane" ? plane_of(words).length : 0.0;
  return radius > 0.0 ? 2.0 * radius : std::numeric_limits<double>::infinity();
}

void require_more_than_gap(const Words& words, double gap_mm) {
  const double extent = extent_of(words);
  if (extent > gap_mm) return;
  throw UsageError(
      {.fact = fmt::format("the cut '{}' is {} long or deep", words.text, length_in_words(extent)),
       .where = words.where,
       .why = fmt::format("its faces are {} apart (image.cut_gap), so that it would cut nothing{}",
                          length_in_words(gap_mm),
                          words.is_file() ? "; the file has no units, and its numbers are read as mm" : ""),
       .remedy = "give its lengths in mm, a thousand times as much if they are metres, or a smaller gap"});
}

std::vector<CutText> all_cuts(const Config& config) {
  std::vector<CutText> all = cuts_at_rest(config);
  for (const CutStep& step : cuts_after_moves(config)) all.push_back(cut_of_step(step.name, step.cut));
  return all;
}

}  // namespace

CutText cut_of_step(const std::string& name, const std::string& text) {
  return {text, fmt::format("step.{}.cut", name)};
}

std::vector<CutText> cuts_at_rest(const Config& config) {
  std::vector<CutText> cuts;
  if (!split(config.image.cut, ';').empty()) cuts.push_back({config.image.cut, option_of_cuts});
  for (const auto& [name, step] : steps_in_order(config)) {
    if (step.cut.empty()) break;
    cuts.push_back(cut_of_step(name, step.cut));
  }
  return cuts;
}

bool has_cuts(const Config& config) {
  return !cuts_at_rest(config).empty();
}

void check_cuts(const Config& config) {
  for (const CutText& cut : all_cuts(config)) {
    if (words_of(cut).empty())
      refuse({cut.text, cut.where, "", ""}, "says nothing", "a step that cuts says what");
    for (const Words& words : words_of(cut)) {
      if (words.kind == "label" && words.rest.empty())
        refuse(words, "names no label", "it takes out the voxels of a label");
      require_more_than_gap(words, config.image.cut_gap_mm);
    }
  }
}

std::vector<std::string> warnings_of_small_sheets(const Config& config, const BodySurface& body) {
  constexpr double small = 1.0 / 16.0;  // of the body: one as large as the body, drawn in cm, has a tenth
  const double whole = (body.upper() - body.lower()).maxCoeff();
  std::vector<std::string> warnings;
  for (const CutText& cut : all_cuts(config))
    for (const Words& words : words_of(cut))
      if (const double size = words.is_file() ? size_of(drawn(words)) : whole; size < small * whole)
        warnings.push_back(fmt::format(
            "the sheet of the cut '{}' is {} long, and the body {}: the file has no units, and its "
            "numbers are read as mm; scale it if it was drawn in metres, inches or cm",
            words.text, length_in_words(size), length_in_words(whole)));
  return warnings;
}

std::vector<std::string> labels_cut_out(const CutText& cut) {
  std::vector<std::string> labels;
  for (const Words& words : words_of(cut))
    if (words.kind == "label") labels.push_back(words.rest);
  return labels;
}

std::vector<std::string> labels_cut_out_at_rest(const Config& config) {
  std::vector<std::string> labels;
  for (const CutText& cut : cuts_at_rest(config))
    for (std::string& label : labels_cut_out(cut)) labels.push_back(std::move(label));
  return labels;
}

TriangleMesh line_blade(const Vec3& x, const Vec3& y, double depth, const BodySurface& body, double step,
                        const std::string& text, const std::string& where) {
  const Vec3 along = (y - x).normalized();
  const int places = std::clamp(static_cast<int>((y - x).norm() / step), 2, 1000);
  const auto place = [&](int k) { return Vec3(x + static_cast<double>(k) / places * (y - x)); };
  Vec3 into = Vec3::Zero();
  for (int k = 0; k <= places; ++k) into -= body.normal().col(body.closest(place(k)).triangle) / (places + 1);
  into -= into.dot(along) * along;
  if (!(into.norm() > 0.2))
    throw ModelError({.fact = fmt::format("there is no one way into the body along the cut '{}'", text),
                      .where = where,
                      .why = "the surface near it faces opposite ways, or along it",
                      .remedy = "give places on one side of the body, or a plane or sheet instead",
                      .code = "cut"});
  into.normalize();
  // From outside: the surface may bulge beyond the straight way.
  double above = 0.0;
  for (int k = 0; k <= places; ++k) {
    const Vec3 at = place(k);
    if (!body.contains(at)) continue;
    for (const double t : body.crossings(at, -into))
      if (t > 0.0) {
        above = std::max(above, t);
        break;
      }
  }
  return swept_sheet(x, y, into, above + 0.1 * step, depth, step);
}

std::vector<TriangleMesh> blades_of(const CutText& cut, const BodySurface& body, double step) {
  const Eigen::Isometry3d to_body = body.to_world().inverse();
  std::vector<TriangleMesh> sheets;
  for (const Words& words : words_of(cut)) {
    if (words.kind == "plane") {
      const Six plane = plane_of(words);
      const Vec3 place = to_body * plane.first;
      // Of a whole plane, enough to reach beyond the body.
      const double all =
          (body.upper() - body.lower()).norm() + (place - 0.5 * (body.upper() + body.lower())).norm();
      sheets.push_back(disc_sheet(place, to_body.linear() * plane.second,
                                  plane.length > 0.0 ? plane.length : all,
                                  plane.length > 0.0 ? step : std::max(step, all / most_rings)));
    } else if (words.kind == "line") {
      const Six line = line_of(words);
      sheets.push_back(line_blade(to_body * line.first, to_body * line.second, line.length, body, step,
                                  words.text, words.where));
    } else if (words.is_file()) {
      TriangleMesh sheet = drawn(words);
      sheet.vertex = (to_body * sheet.vertex.colwise().homogeneous()).eval();
      sheets.push_back(std::move(sheet));
    }
  }
  return sheets;
}

std::vector<TriangleMesh> blades_of(const Config& config, const SegmentedBody& body) {
  std::vector<TriangleMesh> sheets;
  for (const CutText& cut : cuts_at_rest(config))
    for (TriangleMesh& sheet :
         blades_of(cut, body.surface, body.report.step_mm > 0.0 ? body.report.step_mm : 1.0))
      sheets.push_back(std::move(sheet));
  return sheets;
}

}  // namespace dimple
