#include "apps/run/cuts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "apps/run/option_word.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/words.hpp"
#include "io/error.hpp"
#include "io/surface_mesh.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

constexpr const char* option_of_cuts = "--cut (image.cut)";
// Of a whole plane: CGAL hears no Ctrl-C, and a lung's took 12 s with 214 of them.
constexpr double most_rings = 60.0;

// Places stay in mm, in which bodies are cut.
const WordTable& cut_words() {
  static const WordTable table = [] {
    const double far_mm = 1e6;
    WordNumber radius = length_number("radius", 1.0, far_mm);
    radius.usual = 0.0;
    return WordTable{"the cut",
                     {{"plane",
                       joined(place_numbers(), direction_numbers()),
                       "plane:x,y,z,nx,ny,nz[,radius=20mm]",
                       {radius}},
                      {"line",
                       joined(place_numbers(), place_numbers()),
                       "line:x,y,z,x,y,z,depth=15mm",
                       {length_number("depth", 1.0, far_mm)}},
                      {.kind = "label", .between = '\0', .names = "NAME"}},
                     fmt::format("it is a plane, a line, a label or a surface, which is read from {} files",
                                 surface_suffixes),
                     true};
  }();
  return table;
}

// Plane or line of a word: its length is the radius of a disc, 0 for a whole plane, or the depth [mm].
struct Six {
  Vec3 first, second;
  double length;
};

Six six_of(const OptionWord& word) {
  const Six six{word.three(), word.three(3), word.number.back()};
  if (word.kind == "plane" && !(six.second.norm() > 0.0))
    refuse_word(word, "has no normal", "three zeros are no direction");
  if (word.kind == "line" && !((six.first - six.second).norm() > 0.0))
    refuse_word(word, "begins where it ends", "an edge that does not move opens nothing");
  return six;
}

std::vector<OptionWord> words_of(const CutText& cut) {
  std::vector<OptionWord> words;
  for (const std::string& text : parts_between(cut.text, ';'))
    words.push_back(parse_word(cut_words(), text, cut.where));
  return words;
}

TriangleMesh drawn(const OptionWord& word) {
  const SurfaceFile file = read_surface_mesh(word.name.front());
  return {file.position_mm, file.triangles};
}

double size_of(const TriangleMesh& sheet) {
  return (sheet.vertex.rowwise().maxCoeff() - sheet.vertex.rowwise().minCoeff()).maxCoeff();
}

// How long or deep it is, whichever is less [mm]; infinite: a whole plane, or labels.
double extent_of(const OptionWord& word) {
  constexpr double whole = std::numeric_limits<double>::infinity();
  if (word.kind == "file") return size_of(drawn(word));
  if (word.kind == "label") return whole;
  const Six six = six_of(word);
  if (word.kind == "line") return std::min(six.length, (six.first - six.second).norm());
  return six.length > 0.0 ? 2.0 * six.length : whole;
}

void require_more_than_gap(const OptionWord& word, double gap_mm) {
  const double extent = extent_of(word);
  if (extent > gap_mm) return;
  refuse_word(
      word, fmt::format("is {} long or deep", length_in_words(extent)),
      fmt::format("its faces are {} apart (image.cut_gap), so that it would cut nothing{}",
                  length_in_words(gap_mm),
                  word.kind == "file" ? "; the file has no units, and its numbers are read as mm" : ""),
      "give its lengths in mm, a thousand times as much if they are metres, or a smaller gap");
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
  if (!parts_between(config.image.cut, ';').empty()) cuts.push_back({config.image.cut, option_of_cuts});
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
    const std::vector<OptionWord> words = words_of(cut);
    if (words.empty())
      throw UsageError({.fact = fmt::format("the cut '{}' says nothing", cut.text),
                        .where = cut.where,
                        .why = "a step that cuts says what",
                        .remedy = "give it a plane, a line, a sheet or a label"});
    for (const OptionWord& word : words) require_more_than_gap(word, config.image.cut_gap_mm);
  }
}

std::vector<std::string> warnings_of_small_sheets(const Config& config, const BodySurface& body) {
  constexpr double small = 1.0 / 16.0;  // of the body: one as large as the body, drawn in cm, has a tenth
  const double whole = (body.upper() - body.lower()).maxCoeff();
  std::vector<std::string> warnings;
  for (const CutText& cut : all_cuts(config))
    for (const OptionWord& word : words_of(cut))
      if (const double size = word.kind == "file" ? size_of(drawn(word)) : whole; size < small * whole)
        warnings.push_back(fmt::format(
            "the sheet of the cut '{}' is {} long, and the body {}: the file has no units, and its "
            "numbers are read as mm; scale it if it was drawn in metres, inches or cm",
            word.text, length_in_words(size), length_in_words(whole)));
  return warnings;
}

std::vector<std::string> labels_cut_out(const CutText& cut) {
  std::vector<std::string> labels;
  for (const OptionWord& word : words_of(cut))
    if (word.kind == "label") labels.push_back(word.name.front());
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
  for (const OptionWord& word : words_of(cut)) {
    if (word.kind == "plane") {
      const Six plane = six_of(word);
      const Vec3 place = to_body * plane.first;
      // Of a whole plane, enough to reach beyond the body.
      const double all =
          (body.upper() - body.lower()).norm() + (place - 0.5 * (body.upper() + body.lower())).norm();
      sheets.push_back(disc_sheet(place, to_body.linear() * plane.second,
                                  plane.length > 0.0 ? plane.length : all,
                                  plane.length > 0.0 ? step : std::max(step, all / most_rings)));
    } else if (word.kind == "line") {
      const Six line = six_of(word);
      sheets.push_back(line_blade(to_body * line.first, to_body * line.second, line.length, body, step,
                                  word.text, word.where));
    } else if (word.kind == "file") {
      TriangleMesh sheet = drawn(word);
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
