#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "apps/scene/description.hpp"
#include "apps/scene/option.hpp"
#include "apps/scene/scene.hpp"

namespace dimple {

// Options as they were given: numbers in the units of their keys, and texts that resolve() reads.

/// Pressure on a part of the surface: [load.pressure.NAME].
struct PressureText {
  double pressure_Pa = 0.0;
  std::string on = "all";       ///< faces of one side, a ball x,y,z,radius in mm, or all
  std::string follows = "yes";  ///< the surface as it deforms
};
/// Force per volume of all tissue that varies linearly in space: [load.body_force.NAME].
struct BodyForceText {
  std::vector<double> force_N_per_m3 = {0, 0, 0};  ///< x,y,z in LPS, at `at_mm`
  std::vector<double> gradient_N_per_m4;           ///< nine numbers, row by row; none: uniform
  std::vector<double> at_mm = {0, 0, 0};           ///< x,y,z in LPS
};
/// Membrane on a part of the surface: [membrane.NAME].
struct FilmText {
  double thickness_mm = 0.0, mu_Pa = 0.0;  ///< of neo-Hookean tissue
  double tension_N_per_m = 0.0;            ///< at rest, in all directions
  std::string on = "all";                  ///< as of a pressure
  std::string wrinkles = "yes";            ///< under compression, which it then does not carry
};
/// Rigid wall next to or around the body: [wall.NAME].
struct WallText {
  std::string shape;             ///< label:NAME, a file, plane:x,y,z,nx,ny,nz or around:GAP
  std::string friction = "0";    ///< as for a tool
  std::string gap = "image";     ///< [mm] at the closest point; image: unchanged
  std::string opening = "none";  ///< x,y,z,radius in mm: tissue closest to the wall there is free
  std::int64_t places = 4000;    ///< largest number of contact points on the body's surface
};
/// Part of the body that is held in addition to the base or moved in addition to the tool: [support.NAME].
/// The options of the moving least squares' supports are in [support] itself.
struct SupportText {
  std::string on;                           ///< a side, a ball x,y,z,radius in mm, or label:NAME
  std::string hold = "fixed";               ///< or "sliding": held along the surface's normal only
  std::vector<double> move_mm = {0, 0, 0};  ///< displacement when the tool is at load.depth_mm
};
/// Contacting tool in addition to [tool]: [tool.NAME].
struct FurtherToolText {
  std::string shape;                  ///< as for the tool, but no circle
  std::string friction = "0";         ///< Coulomb's coefficient, or stick
  std::vector<double> at_mm;          ///< x,y,z in LPS; first contact is at the closest surface point
  std::vector<double> direction;      ///< x,y,z in LPS; none: along the inward normal there
  std::vector<double> move_mm = {0};  ///< displacement when the tool is at load.depth_mm, as in a step
};
/// Step of the load, in order: [step.NAME]. No step: the tool moves straight to load.depth_mm.
struct StepText {
  std::string moves = "tool";   ///< or the name of a support or a further tool
  std::vector<double> move_mm;  ///< x,y,z in LPS, or for a tool one number along its approach
  /// Rotation vector of a contacting tool, and its centre, in LPS; no centre: its tip at the step's
  /// beginning.
  std::vector<double> turn_deg, about_mm;
  std::string cut;              ///< as image.cut, in the body's current shape; nothing moves meanwhile
  double toughness_J_m2 = 0.0;  ///< energy per new area; 0: not known
  double time_s = 0.0;          ///< duration; 0: displacement over load.rate
  int order = 0;                ///< order in which the steps were given
};

/// All options of a run.
struct Config {
  struct Image : ModelChoices::Image {
    std::string cut;  ///< see cut_named()
  } image;
  struct Scheme {
    std::string name{converging.name};
  } scheme;
  ModelChoices::NodeSet node_set;
  ModelChoices::Grid grid;
  struct Support {
    double radius_factor = 0.0;
  } support;
  struct BoundarySection : ModelChoices::Place {
    std::string base_hold = "fixed";  ///< or "none": walls carry the body
  } boundary;
  struct MaterialSection : MaterialNumbers {
    double mu_spread_percent = 0.0;  ///< uncertainty of the shear modulus: +- this
    double young_Pa = 0.0;           ///< until complete() has replaced it by the shear modulus
    std::string stress = "consistent";
    std::string preset = "none";
  } material;
  /// Tissues that differ from `material`: label, by number or name -> what differs, option -> text.
  std::map<std::string, std::map<std::string, std::string>> tissue;
  struct Load {
    double depth_mm = 8.0;
    double rate_mm_per_s = 1.0;
    std::string contact = "bonded";
    std::string gravity = "none";
    std::string imaged = "unloaded";    ///< with or without gravity and pressures, see unloaded.hpp
    std::string membrane = "none";      ///< of the whole surface: "0.1mm:400kPa"
    std::string self_contact = "auto";  ///< of folds that close, see folds.hpp
    std::string fluid_lost = "none";    ///< "anterior,60%"
    std::string wall = "none";          ///< one rigid wall next to the body
    std::string poses;                  ///< table of the tool's poses, which become steps; empty: none
    std::string poses_taken = {};       ///< summary of the poses for the log: no option
  } load;
  ToolWords tool;
  std::map<std::string, PressureText> pressure;
  std::map<std::string, BodyForceText> body_force;
  std::map<std::string, FilmText> membrane;
  std::map<std::string, WallText> wall;
  std::map<std::string, SupportText> held;
  std::map<std::string, FurtherToolText> other_tool;
  std::map<std::string, StepText> step;
  struct SolverSection {
    double safety = 0.9;
    double damping_per_s = 0.0;
    std::int64_t frames = 8;
    double step_radii = 0.0;
    double sample_rate_per_s = 150.0;
    std::string time = "auto";
    std::string precision = "single";
    double tolerance = 1e-4;
    std::int64_t evaluations = 2000;
  } solver;
  struct Accuracy {
    std::string goal;                ///< "2%", "1mN", or empty
    std::string quantity = "force";  ///< or "displacement@x,y,z"
    double budget_s = 0.0;
    std::string error_bounds = "on";
  } accuracy;
  Scene::Output output;

  /// key -> source of its value ("default", "config.toml", "--nodes", or "nodes=" of Python, ...)
  std::map<std::string, std::string> source;
};

std::vector<Option> options_of(Config& config);
std::vector<Option> options_of(PressureText& pressure);
std::vector<Option> options_of(BodyForceText& force);
std::vector<Option> options_of(FilmText& membrane);
std::vector<Option> options_of(WallText& wall);
std::vector<Option> options_of(SupportText& held);
std::vector<Option> options_of(FurtherToolText& tool);
std::vector<Option> options_of(StepText& step);

/// Steps of a scene in their order, by name.
std::vector<std::pair<std::string, StepText>> steps_in_order(const Config& config);
/// Steps other than cuts.
std::vector<std::pair<std::string, StepText>> moving_steps(const Config& config);

/// Implements set_option() of a description.
void set_option(Config& config, const std::string& key, const std::string& text, const std::string& source);

/// Complete key, with its unit, of an option in a file or --set: "load.depth_mm" for "load.depth",
/// "step.press.move_mm" for "step.press.move". Throws UsageError: there is none.
std::string full_key(const std::string& key, const std::string& source);

/// Implement read_config() and complete() of a description.
void read_config(Config& config, const std::filesystem::path& file);
void complete(Config& config);

/// Preset, and its numbers that were replaced: "horton_2007, but mu_Pa 3.0 (--mu) in place of 210.0". Empty:
/// there is no preset, or none was replaced.
std::string deviations_from_preset(const Config& config);

/// True if the stiffness is the default.
bool default_stiffness(const Config& config);
/// True if no depth was given, so that it follows from the tool's radius.
bool depth_is_of_tool(const Config& config);

}  // namespace dimple
