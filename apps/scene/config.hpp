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

// The options as they were given: numbers in the units of their keys, and words that resolve() understands.

/// A pressure on a part of the surface: [load.pressure.NAME].
struct PressureText {
  double pressure_Pa = 0.0;
  std::string on = "all";       ///< what faces a side, what lies in a ball x,y,z,radius in mm, or all
  std::string follows = "yes";  ///< the surface as it deforms
};
/// A force per volume of all tissue that varies linearly in space: [load.body_force.NAME].
struct BodyForceText {
  std::vector<double> force_N_per_m3 = {0, 0, 0};  ///< x,y,z in LPS, at the place `at_mm`
  std::vector<double> gradient_N_per_m4;           ///< nine numbers, row by row; none: it is uniform
  std::vector<double> at_mm = {0, 0, 0};           ///< x,y,z in LPS
};
/// A thin film on a part of the surface: [membrane.NAME].
struct FilmText {
  double thickness_mm = 0.0, mu_Pa = 0.0;  ///< of neo-Hookean tissue
  double tension_N_per_m = 0.0;            ///< at rest, in all directions
  std::string on = "all";                  ///< as of a pressure
  std::string wrinkles = "yes";            ///< where it is compressed, instead of bearing that
};
/// What stands beside or around the body and is rigid: [wall.NAME].
struct WallText {
  std::string shape;             ///< label:NAME, a file, plane:x,y,z,nx,ny,nz or around:GAP
  std::string friction = "0";    ///< as a tool's
  std::string gap = "image";     ///< [mm] at the nearest place; image: as it is there
  std::string opening = "none";  ///< x,y,z,radius in mm: what is nearest to the wall there is free
  std::int64_t places = 4000;    ///< of the body's surface where it is looked for, at most
};
/// A part of the body that is held beside the base, or moved beside the tool: [support.NAME]. The numbers of
/// the moving least squares' supports stand in [support] itself.
struct SupportText {
  std::string on;                           ///< a side, a ball x,y,z,radius in mm, or label:NAME
  std::string hold = "fixed";               ///< or "sliding": along the surface's normal alone
  std::vector<double> move_mm = {0, 0, 0};  ///< where it has come when the tool is at load.depth_mm
};
/// A further tool that touches, beside [tool]: [tool.NAME].
struct FurtherToolText {
  std::string shape;                  ///< as of the tool, but no circle
  std::string friction = "0";         ///< likewise
  std::vector<double> at_mm;          ///< x,y,z in LPS: the nearest place of the surface is where it touches
  std::vector<double> direction;      ///< x,y,z in LPS; none: straight into the surface there
  std::vector<double> move_mm = {0};  ///< where it has come when the tool is at load.depth_mm: as of a step
};
/// What moves, and how far, one after the other: [step.NAME]. None: the tool, straight to load.depth_mm.
struct StepText {
  std::string moves = "tool";   ///< or the name of a support or a further tool
  std::vector<double> move_mm;  ///< x,y,z in LPS, or of a tool one number: along its push
  /// Rotation vector in LPS axes of a tool that touches, about a place in LPS; none: about its tip, as the
  /// step begins.
  std::vector<double> turn_deg, about_mm;
  std::string cut;              ///< as image.cut, of the body as it then is; nothing moves meanwhile
  double toughness_J_m2 = 0.0;  ///< what new area takes; 0: not known
  double time_s = 0.0;          ///< how long it lasts; 0: as its way takes at load.rate
  int order = 0;                ///< as they were given
};

/// All options of a run.
struct Config {
  struct Image : ModelChoices::Image {
    std::string cut;  ///< see cut_named()
  } image;
  struct Scheme {
    std::string name{converging.name};
  } scheme;
  ModelChoices::Cloud cloud;
  ModelChoices::Grid grid;
  struct Support {
    double radius_factor = 0.0;
  } support;
  struct BoundarySection : ModelChoices::Place {
    std::string base_hold = "fixed";  ///< or "none": walls carry the body
  } boundary;
  struct MaterialSection : MaterialNumbers {
    double mu_spread_percent = 0.0;  ///< how well the shear modulus is known: +- this
    double young_Pa = 0.0;           ///< until complete() has put the shear modulus in its place
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
    std::string imaged = "unloaded";    ///< how gravity and pressures found the body, see unloaded.hpp
    std::string membrane = "none";      ///< of the whole surface: "0.1mm:400kPa"
    std::string self_contact = "auto";  ///< of folds that close, see folds.hpp
    std::string fluid_lost = "none";    ///< "anterior,60%"
    std::string wall = "none";          ///< one rigid wall beside the body
    std::string poses;                  ///< a table of the tool's poses, which become steps; empty: none
    std::string poses_taken = {};       ///< what was made of it, for the log: no option
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
    std::string band = "on";
  } accuracy;
  Scene::Output output;

  /// key -> why it has its value ("default", "config.toml", "--nodes", or "nodes=" of Python, ...)
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

/// The steps of a scene in their order, by name.
std::vector<std::pair<std::string, StepText>> steps_in_order(const Config& config);
/// Those that move something.
std::vector<std::pair<std::string, StepText>> moving_steps(const Config& config);

/// What set_option() does to a description.
void set_option(Config& config, const std::string& key, const std::string& text, const std::string& source);

/// The whole key of the option that a file or --set calls `key`, with its unit: "load.depth_mm" of
/// "load.depth", "step.press.move_mm" of "step.press.move". Throws UsageError: there is none.
std::string full_key(const std::string& key, const std::string& source);

/// What read_config() and complete() do to a description.
void read_config(Config& config, const std::filesystem::path& file);
void complete(Config& config);

/// The preset, and which of its numbers were given otherwise: "horton_2007, but mu_Pa 3.0 (--mu) in place of
/// 210.0". Empty: there is no preset, or it is taken as it is.
std::string beside_preset(const Config& config);

/// Whether the stiffness is the one that nobody has chosen.
bool default_stiffness(const Config& config);
/// Whether the depth follows from the radius of the tool, as none was given.
bool depth_is_of_tool(const Config& config);

}  // namespace dimple
