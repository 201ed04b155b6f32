#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apps/scene/config.hpp"
#include "apps/scene/option_word.hpp"

namespace dimple {

// Parts of resolve(): each makes a part of a scene from the text of its options. All throw UsageError if a
// text is not understood, and InputError for a file.

/// Gravity of a side of the patient, or of x,y,z in m/s2.
Vec3 gravity_named(const std::string& text);
/// Lost fluid of "anterior,60%"; nothing: none is lost.
std::optional<Scene::Fluid> fluid_named(const std::string& text);
/// Fraction of the body's height, in percent as in an option.
WordNumber fraction_of_lost_fluid();
std::vector<Scene::Pressure> pressures_named(const std::map<std::string, PressureText>& texts);
std::vector<BodyForce> body_forces_named(const std::map<std::string, BodyForceText>& texts);
/// Membranes. `of_all`: --membrane, or none; it is named "surface".
std::vector<Scene::Film> films_named(const std::map<std::string, FilmText>& texts, const std::string& of_all);
/// Walls. `of_option`: --wall, or none; it is named "wall".
std::vector<Scene::Wall> walls_named(std::map<std::string, WallText> texts, const std::string& of_option);
std::vector<Scene::Support> supports_named(const std::map<std::string, SupportText>& texts);
std::vector<Scene::FurtherTool> further_tools_named(const std::map<std::string, FurtherToolText>& texts);
/// Steps in their order.
std::vector<Scene::Step> steps_named(const std::map<std::string, StepText>& texts, double cut_gap_mm);
/// Blades longer and deeper than their gap, separated by semicolons; see Cut. Positions in LPS, mm.
///
///     plane:x,y,z,nx,ny,nz              a plane through a point, with its normal
///     plane:x,y,z,nx,ny,nz,radius=20mm  a disc of it
///     line:x,y,z,x,y,z,depth=15mm       an edge's path between two points, along the inward normal
///     FILE.stl, .obj, .vtp              a drawn sheet; the inside of a closed one is removed
///     label:NAME                        the voxels of a label are removed
Cut cut_named(const std::string& text, const std::string& where, double gap_mm);
/// Position [m, LPS] of displacement@x,y,z; nothing: only the force is requested.
std::optional<Vec3> followed_named(const std::string& quantity);

/// Steps between the rows of a table of the tool's poses, and a summary.
struct PosesTaken {
  std::map<std::string, StepText> steps;
  std::string words;
};
PosesTaken steps_of_poses(const std::string& file);

/// Largest depth of the tool over steps that move something [mm]. With displacements in x, y and z only, the
/// approach direction is not available yet; the depth is then along the first displacement.
template <class Steps>
double deepest_along_approach(const Steps& steps) {
  double pressed = 0.0, deepest = 0.0, along_first = 0.0, deepest_along_first = 0.0;
  Vec3 first = Vec3::Zero();
  for (const auto& step : steps) {
    if (step.moves != tool_word) continue;
    if (step.move_mm.size() == 1) {
      pressed += step.move_mm[0];
      deepest = std::max(deepest, pressed);
    } else if (step.move_mm.size() == 3) {
      const Vec3 displacement(step.move_mm[0], step.move_mm[1], step.move_mm[2]);
      if (first.isZero(0.0)) first = displacement.normalized();
      along_first += displacement.dot(first);
      deepest_along_first = std::max(deepest_along_first, along_first);
    }
  }
  return deepest > 0.0 ? deepest : deepest_along_first;
}

// Checks between parts of a scene before anything is built. All throw UsageError.
void check_steps(const Scene& scene);
void check_names(const Scene& scene);
void check_bed(const Scene& scene);
void check_tool(const Scene& scene);

}  // namespace dimple
