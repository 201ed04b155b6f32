#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "apps/scene/option.hpp"
#include "apps/scene/resolve_parts.hpp"
#include "apps/scene/tool_words.hpp"
#include "io/error.hpp"
#include "io/surface_mesh.hpp"
#include "io/text.hpp"
#include "preprocess/surface/body_surface.hpp"
#include "preprocess/surface/closed_mesh.hpp"

namespace dimple {
namespace {

constexpr const char* wall_of_option = "wall";

[[noreturn]] void refuse_wall(const std::string& name, const std::string& fact, const char* option,
                              const std::string& why, const std::string& remedy) {
  throw UsageError({.fact = fmt::format("the wall '{}' {}", name, fact),
                    .where = wall_key(name, option),
                    .why = why,
                    .remedy = remedy});
}

std::string of_wall(const std::string& name) {
  return fmt::format("the wall '{}'", name);
}

WordNumber gap_number() {
  return {"gap", "mm", 1e-3, 0.0, 100.0};
}

OptionWord word_of_wall(const std::string& name, const WallText& wall) {
  if (trimmed(wall.shape).empty())
    refuse_wall(name, "has no shape", "shape", "its place is not known",
                "give label:NAME, a closed mesh such as skull.stl, plane:x,y,z,nx,ny,nz, or around:2mm");
  return parse_word({"the shape",
                     {{.kind = "label", .names = "NAME"},
                      {"plane", joined(place_numbers(1e-3), direction_numbers())},
                      {"around", {gap_number()}, "around:2mm"}},
                     fmt::format("this names no wall; a mesh is read from {} files", surface_suffixes),
                     true},
                    wall.shape, wall_key(name, "shape"), of_wall(name));
}

std::shared_ptr<const BodySurface> surface_of_file(const std::string& name,
                                                   const std::filesystem::path& file) {
  const SurfaceFile drawn = read_surface_mesh(file);
  bool turned = false;
  TriangleMesh mesh =
      closed_drawing({.name = file.filename().string(), .what = "wall", .where = wall_key(name, "shape")},
                     drawn.position_mm, drawn.triangles, turned);
  return std::make_shared<const BodySurface>(std::move(mesh.vertex), std::move(mesh.triangles));
}

std::optional<Eigen::Vector4d> opening_of(const std::string& name, const WallText& wall) {
  const OptionWord word = parse_word({"the opening", {{"none"}, {"", ball_numbers()}}}, wall.opening,
                                     wall_key(name, "opening"), of_wall(name));
  if (word.number.empty()) return std::nullopt;
  return Eigen::Vector4d(word.number.data());
}

std::optional<double> gap_of(const std::string& name, const WallText& wall) {
  const OptionWord word = parse_word({"the gap", {{"image"}, {"", {gap_number()}, "0.5mm"}}}, wall.gap,
                                     wall_key(name, "gap"), of_wall(name));
  return word.number.empty() ? std::nullopt : std::optional(word.number.front());
}

void set_shape(const OptionWord& word, Scene::Wall& wall) {
  using Kind = Scene::Wall::Kind;
  if (word.kind == "label") {
    wall.kind = Kind::labels;
    wall.labels = word.name;
  } else if (word.kind == "file") {
    wall.kind = Kind::mesh;
    wall.file = word.name.front();
    wall.mesh = surface_of_file(wall.name, wall.file);
  } else if (word.kind == "plane") {
    wall.kind = Kind::plane;
    wall.place = word.three(), wall.normal = word.three(3);
    if (!(wall.normal.norm() > 0.0)) refuse_word(word, "has no normal", "a direction is not zero");
    wall.normal.normalize();
  } else {
    wall.kind = Kind::around;
    wall.around = word.number.front();
  }
}

}  // namespace

std::string wall_key(const std::string& name, const char* option) {
  return name == wall_of_option && std::string(option) == "shape" ? "--wall (load.wall)"
                                                                  : fmt::format("wall.{}.{}", name, option);
}

std::vector<Scene::Wall> walls_named(std::map<std::string, WallText> texts, const std::string& of_option) {
  if (of_option != "none") {
    WallText& its = texts[wall_of_option];  // its other options may be given under that name
    if (!its.shape.empty())
      refuse_wall(wall_of_option, "is given twice", "shape", "the one of --wall has that name",
                  "give one of them, or the other a name of its own");
    its.shape = of_option;
  }
  std::vector<Scene::Wall> walls;
  for (const auto& [name, text] : texts) {
    Scene::Wall& wall = walls.emplace_back();
    wall.name = name;
    wall.words = text.shape;
    set_shape(word_of_wall(name, text), wall);
    wall.friction = friction_named(text.friction, wall_key(name, "friction"));
    wall.opening = opening_of(name, text);
    wall.gap = gap_of(name, text);
    wall.places = text.places;
    if (wall.gap && wall.kind == Scene::Wall::Kind::around)
      refuse_wall(name, "has two gaps", "gap", "around:GAP is at that gap already", "leave one of them out");
  }
  return walls;
}

// Checks that a body without a held base is carried and has no rigid-body mode. Friction does not prevent it:
// it is zero before anything presses, and no equilibrium was found from there.
void check_bed(const Scene& scene) {
  if (scene.base_is_held) return;
  constexpr const char* option = "--base-hold (boundary.base_hold)";
  if (scene.walls.empty() && scene.supports.empty())
    throw UsageError({.fact = "the base is free, and nothing supports the body",
                      .where = option,
                      .why = "it would move as a whole",
                      .remedy = "give a wall below it, as --wall plane:0,0,0,0,0,1, or a support"});
  // A bonded patch prescribes the motion of its nodes, but only after the loads have been applied.
  const bool patch_holds = !scene.tool && scene.contact == Contact::bonded && !has_loads(scene);
  const bool support_holds = std::any_of(scene.supports.begin(), scene.supports.end(),
                                         [](const Scene::Support& support) { return !support.slides; });
  if (patch_holds || support_holds) return;
  throw UsageError(
      {.fact = "nothing holds the body sideways before it is pressed on its walls",
       .where = option,
       .why = "the base is free, walls and tools only press, and friction acts only under pressure",
       .remedy =
           "use the bonded indenter without gravity or pressures, or give a [support.NAME] that is fixed"});
}

}  // namespace dimple
