#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "apps/scene/resolve_parts.hpp"
#include "io/error.hpp"
#include "io/surface_mesh.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

// Positions remain in mm, as bodies are cut in mm.
const WordTable& cut_words() {
  static const WordTable table = [] {
    const double far_mm = 1e6;
    WordNumber radius = length_number("radius", 1.0, far_mm);
    radius.usual = 0.0;
    return WordTable{
        "the cut",
        {{"plane",
          joined(place_numbers(), direction_numbers()),
          "plane:x,y,z,nx,ny,nz[,radius=20mm]",
          {radius}},
         {"line",
          joined(place_numbers(), place_numbers()),
          "line:x,y,z,x,y,z,depth=15mm",
          {length_number("depth", 1.0, far_mm)}},
         {.kind = "label", .between = '\0', .names = "NAME"}},
        fmt::format("a cut is a plane, a line, a label or a surface from {} files", surface_suffixes),
        true};
  }();
  return table;
}

Blade blade_of(const OptionWord& word) {
  Blade blade{.text = word.text};
  if (word.kind == "label") {
    blade.kind = Blade::Kind::label;
    blade.label = word.name.front();
    return blade;
  }
  if (word.kind == "file") {
    blade.kind = Blade::Kind::sheet;
    const SurfaceFile file = read_surface_mesh(word.name.front());
    blade.sheet = {file.position_mm, file.triangles};
    return blade;
  }
  blade.kind = word.kind == "plane" ? Blade::Kind::plane : Blade::Kind::line;
  blade.first = word.three(), blade.second = word.three(3), blade.length = word.number.back();
  if (blade.kind == Blade::Kind::plane && !(blade.second.norm() > 0.0))
    refuse_word(word, "has no normal", "a direction is not zero");
  if (blade.kind == Blade::Kind::line && !((blade.first - blade.second).norm() > 0.0))
    refuse_word(word, "begins where it ends", "an edge that does not move cuts nothing");
  return blade;
}

// Length or depth of a blade, the smaller of them [mm]; infinite for a whole plane or labels.
double extent_of(const Blade& blade) {
  constexpr double whole = std::numeric_limits<double>::infinity();
  if (blade.kind == Blade::Kind::sheet) return size_of(blade.sheet);
  if (blade.kind == Blade::Kind::label) return whole;
  if (blade.kind == Blade::Kind::line) return std::min(blade.length, (blade.first - blade.second).norm());
  return blade.length > 0.0 ? 2.0 * blade.length : whole;
}

void require_more_than_gap(const OptionWord& word, const Blade& blade, double gap_mm) {
  const double extent = extent_of(blade);
  if (extent > gap_mm) return;
  refuse_word(
      word, fmt::format("is {} long or deep", length_in_words(extent)),
      fmt::format("its faces are {} apart (image.cut_gap), so that it would cut nothing{}",
                  length_in_words(gap_mm),
                  word.kind == "file" ? "; the file has no units, and its numbers are read as mm" : ""),
      "give its lengths in mm, multiplied by 1000 if they are metres, or a smaller gap");
}

}  // namespace

double size_of(const TriangleMesh& sheet) {
  return (sheet.vertex.rowwise().maxCoeff() - sheet.vertex.rowwise().minCoeff()).maxCoeff();
}

Cut cut_named(const std::string& text, const std::string& where, double gap_mm) {
  Cut cut{.text = text, .where = where};
  for (const std::string& one : parts_between(text, ';')) {
    const OptionWord word = parse_word(cut_words(), one, where);
    cut.blades.push_back(blade_of(word));
    require_more_than_gap(word, cut.blades.back(), gap_mm);
  }
  return cut;
}

}  // namespace dimple
