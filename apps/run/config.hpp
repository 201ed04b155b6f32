#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "apps/run/band.hpp"
#include "preprocess/build_model.hpp"
#include "solver/march.hpp"
#include "solver/material.hpp"

namespace dimple {

/// Everything that decides a result. Units as in the names; conversion to SI is in the functions below.
struct Config {
  struct Image {
    std::string file;
    std::vector<std::string> label;  ///< numbers or names; empty: all foreground
    std::string label_names;         ///< table of names, or empty
    double close_mm = 0.0;           ///< gaps narrower than this are closed
    std::string cut;                 ///< see cuts.hpp
    double cut_gap_mm = 0.5;         ///< between the banks of a cut
  } image;
  struct Scheme {
    std::string name{converging.name};
  } scheme;
  struct Cloud {
    std::int64_t nodes = 1500;
    double spacing_mm = 0.0;
    double rim = 0.0;
    std::int64_t seed = 1;
    double jitter = 0.0;
  } cloud;
  struct Grid {
    std::int64_t points = 0;
    double ratio = 0.0;
  } grid;
  struct Support {
    double radius_factor = 0.0;
  } support;
  struct BoundarySection {
    std::string base = "auto";
    double base_depth_mm = 0.0;
    std::string base_hold = "fixed";  ///< or "none": walls carry the body
    std::string indent_at = "opposite";
    double indenter_diameter_mm = 10.0;
    std::string direction = "auto";
  } boundary;
  struct MaterialSection : MaterialNumbers {
    double mu_spread_percent = 0.0;  ///< how well the shear modulus is known: +- this
    double young_Pa = 0.0;           ///< until resolve_young(), which puts the shear modulus in its place
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
    std::string membrane = "none";      ///< of the whole surface: "0.1mm:400kPa", see membranes.hpp
    std::string self_contact = "auto";  ///< of folds that close, see folds.hpp
    std::string fluid_lost = "none";    ///< "anterior,60%", see loads.hpp
    std::string wall = "none";          ///< one rigid wall beside the body, see walls.hpp
    std::string poses;                  ///< a table of the tool's poses, which become steps; empty: none
    std::string poses_taken = {};       ///< what was made of it, for the log: no option
  } load;
  struct Tool {
    std::string shape = "circle";  ///< see tool_of() in tool.hpp
    std::string friction = "0";    ///< see friction_of() in tool.hpp
  } tool;
  /// A pressure on a part of the surface: [load.pressure.NAME].
  struct Pressure {
    double pressure_Pa = 0.0;
    std::string on = "all";       ///< what faces a side, what lies in a ball x,y,z,radius in mm, or all
    std::string follows = "yes";  ///< the surface as it deforms
  };
  std::map<std::string, Pressure> pressure;
  /// A thin film on a part of the surface: [membrane.NAME].
  struct Film {
    double thickness_mm = 0.0, mu_Pa = 0.0;  ///< of neo-Hookean tissue
    double tension_N_per_m = 0.0;            ///< at rest, in all directions
    std::string on = "all";                  ///< as of a pressure
    std::string wrinkles = "yes";            ///< where it is compressed, instead of bearing that
  };
  std::map<std::string, Film> membrane;
  /// What stands beside or around the body and is rigid: [wall.NAME].
  struct Wall {
    std::string shape;             ///< label:NAME, a file, plane:x,y,z,nx,ny,nz or around:GAP
    std::string friction = "0";    ///< as a tool's
    std::string gap = "image";     ///< [mm] at the nearest place; image: as it is there
    std::string opening = "none";  ///< x,y,z,radius in mm: what is nearest to the wall there is free
    std::int64_t places = 4000;    ///< of the body's surface where it is looked for, at most
  };
  std::map<std::string, Wall> wall;
  /// A part of the body that is held beside the base, or moved beside the tool: [support.NAME]. The numbers
  /// of the moving least squares' supports stand in [support] itself.
  struct Held {
    std::string on;                           ///< a side, a ball x,y,z,radius in mm, or label:NAME
    std::string hold = "fixed";               ///< or "sliding": along the surface's normal alone
    std::vector<double> move_mm = {0, 0, 0};  ///< where it has come when the tool is at load.depth_mm
  };
  std::map<std::string, Held> held;
  /// A further tool that touches, beside [tool]: [tool.NAME].
  struct OtherTool {
    std::string shape;           ///< as of the tool, but no circle
    std::string friction = "0";  ///< likewise
    std::vector<double> at_mm;   ///< x,y,z in LPS: the nearest place of the surface is where it touches first
    std::vector<double> direction;      ///< x,y,z in LPS; none: straight into the surface there
    std::vector<double> move_mm = {0};  ///< where it has come when the tool is at load.depth_mm: as of a step
  };
  std::map<std::string, OtherTool> other_tool;
  /// What moves, and how far, one after the other: [step.NAME]. None: the tool, straight to load.depth_mm.
  struct Step {
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
  std::map<std::string, Step> step;
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
    std::string goal;                ///< "2%", "1mN", or empty; see goal_of()
    std::string quantity = "force";  ///< or "displacement@x,y,z"; see followed_place()
    double budget_s = 0.0;
    std::string band = "on";
  } accuracy;
  struct Output {
    std::vector<std::string> write = {"all"};  ///< which files; see wanted_of() in results.hpp
    std::vector<std::string> warp;         ///< images of the patient, linear between voxels; see images.hpp
    std::vector<std::string> warp_labels;  ///< the same, the nearest voxel's number
    std::string write_frames = "last";     ///< of which frames images are written
    std::string compare;                   ///< a measured curve, paper_word, or empty; see compare.hpp
  } output;

  /// key -> why it has its value ("default", "config.toml", "--nodes", or "nodes=" of Python, ...)
  std::map<std::string, std::string> source;
};

/// One option, declared once: the help, the checks, the file format and `--set` are all made from it.
struct Option {
  std::string key;        ///< "material.mu_Pa": section, name, unit
  std::string flag = {};  ///< "--mu" or empty
  std::string unit = {};  ///< "Pa" or empty; bare numbers are in it
  std::variant<double*, std::int64_t*, std::string*, std::vector<std::string>*, std::vector<double>*> value;
  double least = 0.0, most = 0.0;  ///< range of numbers, both allowed
  bool least_excluded = false;
  std::vector<std::string> choices = {};  ///< of a word, or of each of a list, which then names one at least;
                                          ///< empty: free text
  std::string stage = {};  ///< which commands have the flag: "model", "solve" (run has both), "run" (that
                           ///< alone), "files" (run and solve)
  bool common = false;     ///< of those that `--help` lists; `--help-all` lists all
  std::vector<std::string> words = {};  ///< of free text, those that it is most often: offered, not demanded
  std::string help = {};
};
std::vector<Option> options_of(Config& config);
std::vector<Option> options_of(Config::Pressure& pressure);
std::vector<Option> options_of(Config::Film& membrane);
std::vector<Option> options_of(Config::Wall& wall);
std::vector<Option> options_of(Config::Held& held);
std::vector<Option> options_of(Config::OtherTool& tool);
std::vector<Option> options_of(Config::Step& step);

/// The steps of a scene in their order, by name.
std::vector<std::pair<std::string, Config::Step>> steps_in_order(const Config& config);
/// Those that move something.
std::vector<std::pair<std::string, Config::Step>> moving_steps(const Config& config);

/// "material.mu" of "material.mu_Pa"; a key without its unit at the end stays.
std::string without_unit(const Option& option);

/// Sets one option from text ("300Pa", "superior", "1,Tumour"). `key` with or without its unit suffix.
/// Throws UsageError: unknown key (with a suggestion), not a number, unknown unit, out of range, not a
/// choice.
void set_option(Config& config, const std::string& key, const std::string& text, const std::string& source);

/// The whole key of the option that a file or --set calls `key`, with its unit: "load.depth_mm" of
/// "load.depth", "step.press.move_mm" of "step.press.move". Throws UsageError: there is none.
std::string full_key(const std::string& key, const std::string& source);

/// The key of the option that somebody calls `name`, as the head of a column: its key, with or without
/// section and unit
/// ("material.mu_Pa", "mu"), or its flag ("indent-at", "indent_at"). Throws UsageError: there is none, with a
/// suggestion from these names and from `others`.
std::string option_named(const std::string& name, const std::string& source,
                         const std::vector<std::string>& others);

/// set_option() for a value that is no part of a Config: a time limit, for instance.
void set_value(const Option& option, const std::string& text, const std::string& source);

/// To be called when all options are set: the numbers of the material become those that are used. A preset's
/// numbers stand where nobody has given others; Young's modulus, where it was given, becomes the shear
/// modulus E / (2 (1 + nu)); Ogden moduli are scaled to a shear modulus that was given beside a preset's, and
/// else add up to it. The depth of a scene of steps follows from them. Throws UsageError: two of these were
/// given that contradict each other.
void resolve_material(Config& config);

/// The preset, and which of its numbers were given otherwise: "horton_2007, but mu_Pa 3.0 (--mu) in place of
/// 210.0". Empty: there is no preset, or it is taken as it is.
std::string beside_preset(const Config& config);

/// Before the source of an option that is of all cases of a table; each of them may say otherwise.
inline constexpr const char* for_all_cases = "all cases: ";

/// Whether the stiffness is the one that nobody has chosen.
bool default_stiffness(const Config& config);
/// Whether the number of nodes is: neither it nor a spacing was given.
bool default_nodes(const Config& config);

/// Reads a TOML file over what is there. Throws UsageError, InputError.
void read_config(Config& config, const std::filesystem::path& file);

/// The whole configuration as TOML, each line with where its value came from. `notes`: key -> what was
/// chosen.
std::string to_toml(const Config& config, const std::map<std::string, std::string>& notes);

/// Each option as it stands in that file, by key, but for the path of the image.
std::map<std::string, std::string> option_values(const Config& config);

/// The reference of all options: key, unit, default, range, meaning.
std::string option_reference();

/// The word among `known` nearest to `word`, if it is near enough to have been meant, as ", did you mean
/// ...?".
std::string did_you_mean(const std::string& word, const std::vector<std::string>& known);

/// Whether anybody has chosen the option of that key: not where a file of all options states what is usual.
bool was_given(const Config& config, const char* key);
/// Whether gravity or a pressure acts on the body; whether it has a membrane; whether a wall stands beside
/// it; and whether nothing acts but the tool, nor holds it but the base.
bool has_loads(const Config& config);
bool has_membranes(const Config& config);
bool has_walls(const Config& config);
bool has_base(const Config& config);  ///< that is held
bool has_tool_alone(const Config& config);

/// How well the force is known by its material, as a share of it: in equilibrium under a tool whose way is
/// given it is proportional to the one modulus that the whole body has. The table of compatibility.hpp says
/// where it is not.
double force_spread(const Config& config);

/// Half the width that the band may have, of the force or of the displacement that is asked for, and the time
/// in which the nodes for it are to be found.
struct Goal {
  double share = 0.0, absolute = 0.0;  ///< of it, or [N], [m]; both 0: as narrow as the time allows
  double budget_s = 0.0;               ///< 0: without an end
  double half_width(double of) const { return absolute > 0.0 ? absolute : share * of; }
};
/// Nothing if no accuracy was asked for. Throws UsageError: neither a share nor a force, or of a displacement
/// a length; a number of nodes is given as well.
std::optional<Goal> goal_of(const Config& config);

/// How narrow the band of what is asked for gets: see FloorOfBand.
FloorOfBand band_floor(const Config& config);

/// The place of the body [m, LPS, at rest] whose displacement is asked for, beside the force. Throws
/// UsageError: neither "force" nor "displacement@x,y,z" in mm.
std::optional<Vec3> followed_place(const Config& config);

ModelOptions model_options(const Config& config);
/// The scheme of that name, with what was asked for in place of its own choices.
Scheme scheme_of(const Config& config);
Material material_of(const Config& config);
/// The material of all labels that have no tissue of their own, then those of config.tissue, in its order.
/// Throws UsageError: Ogden or Prony numbers that make no material, or that the chosen scheme has not.
std::vector<Material> materials_of(const Config& config);
Loading loading_of(const Config& config);
/// [m/s^2] LPS. Throws UsageError: neither none, a side nor three numbers.
Vec3 gravity_of(const Config& config);
SolverOptions solver_options(const Config& config);
Precision precision_of(const Config& config);

}  // namespace dimple
