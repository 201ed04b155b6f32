#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apps/scene/config.hpp"
#include "apps/scene/option_word.hpp"

namespace dimple {

// What resolve() is made of: parts of a scene by the words of their options. All throw UsageError where a
// word is not understood, and InputError of a file.

/// A side, or x,y,z in m/s2.
Vec3 gravity_named(const std::string& text);
/// "anterior,60%"; nothing: no fluid is lost.
std::optional<Scene::Fluid> fluid_named(const std::string& text);
/// Share of the body's height as an option gives it, in percent.
WordNumber share_of_lost_fluid();
std::vector<Scene::Pressure> pressures_named(const std::map<std::string, PressureText>& texts);
std::vector<BodyForce> body_forces_named(const std::map<std::string, BodyForceText>& texts);
/// `of_all`: --membrane, or none; it is called "surface".
std::vector<Scene::Film> films_named(const std::map<std::string, FilmText>& texts, const std::string& of_all);
/// `of_option`: --wall, or none; it is called "wall".
std::vector<Scene::Wall> walls_named(std::map<std::string, WallText> texts, const std::string& of_option);
std::vector<Scene::Support> supports_named(const std::map<std::string, SupportText>& texts);
std::vector<Scene::FurtherTool> further_tools_named(const std::map<std::string, FurtherToolText>& texts);
/// In their order.
std::vector<Scene::Step> steps_named(const std::map<std::string, StepText>& texts, double cut_gap_mm);
/// Blades longer and deeper than their gap, separated by semicolons; see Cut.
///
///     plane:x,y,z,nx,ny,nz              a plane through a place, with its normal: LPS, mm
///     plane:x,y,z,nx,ny,nz,radius=20mm  a disc of it
///     line:x,y,z,x,y,z,depth=15mm       an edge's way from place to place, straight into the surface there
///     FILE.stl, .obj, .vtp              a sheet that was drawn: LPS, mm; a closed one is taken out whole
///     label:NAME                        the voxels of a label are taken out
Cut cut_named(const std::string& text, const std::string& where, double gap_mm);
/// Place [m, LPS] of displacement@x,y,z; nothing: the force alone.
std::optional<Vec3> followed_named(const std::string& quantity);

/// Rows of a table of the tool's poses, as steps from each to the next, and what is told of them.
struct PosesTaken {
  std::map<std::string, StepText> steps;
  std::string words;
};
PosesTaken steps_of_poses(const std::string& file);

/// Deepest that the tool is pushed by steps that move something [mm]. Of ways in x, y and z alone, the push
/// not being known yet: along the first of them.
template <class Steps>
double deepest_push(const Steps& steps) {
  double pushed = 0.0, deepest = 0.0, along_first = 0.0, deepest_along_first = 0.0;
  Vec3 first = Vec3::Zero();
  for (const auto& step : steps) {
    if (step.moves != tool_word) continue;
    if (step.move_mm.size() == 1) {
      pushed += step.move_mm[0];
      deepest = std::max(deepest, pushed);
    } else if (step.move_mm.size() == 3) {
      const Vec3 way(step.move_mm[0], step.move_mm[1], step.move_mm[2]);
      if (first.isZero(0.0)) first = way.normalized();
      along_first += way.dot(first);
      deepest_along_first = std::max(deepest_along_first, along_first);
    }
  }
  return deepest > 0.0 ? deepest : deepest_along_first;
}

// Checks of a scene before anything is built, of parts that know of each other. All throw UsageError.
void check_steps(const Scene& scene);
void check_names(const Scene& scene);
void check_bed(const Scene& scene);
void check_tool(const Scene& scene);

}  // namespace dimple
