#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/scene/surface_part.hpp"
#include "preprocess/build_model.hpp"
#include "preprocess/surface/body_surface.hpp"
#include "preprocess/surface/closed_mesh.hpp"
#include "solver/march.hpp"
#include "solver/material.hpp"
#include "solver/terms/loads.hpp"

namespace dimple {

/// Error that is asked for at most, of the force or of the displacement that is followed, and the time in
/// which nodes for it are looked for.
struct Goal {
  std::string text;                    ///< as it was given
  double share = 0.0, absolute = 0.0;  ///< of it, or [N], [m]; both 0: as small as the time allows
  double budget_s = 0.0;               ///< 0: without an end
  double half_width(double of) const { return absolute > 0.0 ? absolute : share * of; }
};

/// What a body is cut by: a plane or a disc of it, an edge that goes straight in along a line, a sheet that
/// was drawn, or a label that is taken out. Places in mm, LPS.
struct Blade {
  enum class Kind { plane, line, sheet, label };
  Kind kind = Kind::plane;
  Vec3 first = Vec3::Zero();   ///< place of the plane; begin of the line
  Vec3 second = Vec3::Zero();  ///< normal of the plane; end of the line
  double length = 0.0;         ///< radius of the disc, 0 for a whole plane; depth of the line
  TriangleMesh sheet = {};
  std::string label = {};  ///< number or name
  std::string text = {};   ///< as it was given
};
/// Blades of one option or one step; none: no cut.
struct Cut {
  std::vector<Blade> blades = {};
  std::string text = {}, where = {};  ///< as it was given, and the option
  explicit operator bool() const { return !blades.empty(); }
};

/// What nodes and integration points are made from, but for the tool, the tissues and the supports.
struct ModelChoices {
  struct Image {
    std::string file;                ///< empty: the image is in memory
    std::vector<std::string> label;  ///< numbers or names; empty: all foreground
    std::string label_names;         ///< table of names, or empty
    double close_mm = 0.0;           ///< gaps narrower than this are closed
    double cut_gap_mm = 0.5;         ///< between the banks of a cut
    bool operator==(const Image&) const = default;
  } image;
  Cut cut;  ///< before the load
  std::string scheme{converging.name};
  struct Cloud {
    std::int64_t nodes = 1500;
    double spacing_mm = 0.0;  ///< instead of a number; 0: from the number
    double rim = 0.0;         ///< 0: as the scheme has it; likewise of all that follow
    std::int64_t seed = 1;
    double jitter = 0.0;
    bool operator==(const Cloud&) const = default;
  } cloud;
  struct Grid {
    std::int64_t points = 0;
    double ratio = 0.0;
    bool operator==(const Grid&) const = default;
  } grid;
  double support_radius_factor = 0.0;
  /// Words that find_boundary() understands: BoundaryOptions.
  struct Place {
    std::string base = "auto";
    double base_depth_mm = 0.0;
    std::string indent_at = "opposite";
    double indenter_diameter_mm = 10.0;
    std::string direction = "auto";
    bool operator==(const Place&) const = default;
  } boundary;
};

/// Tissue of one label.
struct TissueOfLabel {
  std::string label;  ///< number or name
  MaterialNumbers numbers;
  bool printed_stress = false;
  bool has_own_nu = false;
};

/// Shape of a tool that touches and its friction, with the words that named them.
struct ToolWords {
  std::string shape = "circle", friction = "0";
};

/// Word for the values of the paper, in place of a measured curve.
inline constexpr const char* paper_word = "horton2007";

/// What moves in a step where no support or further tool is named.
inline constexpr const char* tool_word = "tool";

/// Everything that decides a result, resolved from the options and checked: what is here is what is computed.
/// Lengths whose names end in _mm are those of the options, so that the same options give the same bits.
struct Scene : ModelChoices {
  struct Material : MaterialNumbers {
    double mu_spread = 0.0;  ///< how well the shear modulus is known: +- this share
    bool printed_stress = false;
    std::string preset = "none";
    std::string beside_preset = {};  ///< numbers that were given in place of the preset's, in words
    bool operator==(const Material&) const = default;
  } material;                          ///< of all labels without a tissue of their own
  std::vector<TissueOfLabel> tissues;  ///< in the order of their labels

  bool base_is_held = true;
  double depth_mm = 8.0;
  double rate_mm_per_s = 1.0;
  Contact contact = Contact::bonded;  ///< of the circle
  std::optional<ToolShape> tool;      ///< that touches; none: the circle
  double friction = 0.0;              ///< Coulomb's coefficient; infinite: stick
  ToolWords tool_words;

  Vec3 gravity = Vec3::Zero();  ///< [m/s^2] LPS
  /// Fluid whose level has fallen: which way is up, and the share of the body's height above the level.
  struct Fluid {
    Vec3 up = Vec3::Zero();
    double share = 0.0;
  };
  std::optional<Fluid> fluid_lost;
  struct Pressure {
    std::string name;
    double pressure_Pa = 0.0;
    SurfacePart on;
    std::string on_words;
    bool follows = true;
  };
  std::vector<Pressure> pressures;
  std::vector<BodyForce> body_forces;
  struct Film {
    std::string name;
    double thickness_mm = 0.0, mu_Pa = 0.0, tension_N_per_m = 0.0;
    SurfacePart on;
    std::string on_words;
    bool wrinkles = true;
  };
  std::vector<Film> membranes;
  bool imaged_loaded = false;  ///< the image shows the body under its loads
  enum class SelfContact { automatic, off, on } self_contact = SelfContact::automatic;

  struct Wall {
    std::string name;
    enum class Kind { labels, mesh, plane, around } kind = Kind::plane;
    std::vector<std::string> labels = {};  ///< numbers or names
    std::string file = {};                 ///< of the mesh
    std::shared_ptr<const BodySurface> mesh = {};
    Vec3 place = Vec3::Zero(), normal = Vec3::Zero();  ///< of the plane [m]
    double around = 0.0;                               ///< gap in front of the outer hull [m]
    double friction = 0.0;
    std::optional<double> gap = {};               ///< at the nearest place [m]; none: as the image has it
    std::optional<Eigen::Vector4d> opening = {};  ///< ball [mm, LPS]
    std::int64_t places = 4000;
    std::string words = {};  ///< the shape as it was given
  };
  std::vector<Wall> walls;
  struct Support {
    std::string name;
    std::optional<SurfacePart> part;  ///< none: the tissue of a label
    std::string label;                ///< number or name
    std::string on_words;
    bool slides = false;
    std::vector<double> move_mm = {0, 0, 0};  ///< where it has come when the tool is at its depth
  };
  std::vector<Support> supports;
  struct FurtherTool {
    std::string name;
    ToolShape shape;
    double friction = 0.0;
    Vec3 at_mm = Vec3::Zero();
    std::optional<Vec3> direction = {};  ///< none: straight into the surface
    std::vector<double> move_mm = {0};   ///< x,y,z, or one number along its push
  };
  std::vector<FurtherTool> further_tools;
  struct Step {
    std::string name;
    std::string moves = "tool";  ///< or the name of a support or a further tool
    std::vector<double> move_mm = {}, turn_deg = {}, about_mm = {};
    Cut cut = {};
    double toughness_J_m2 = 0.0;  ///< 0: not known
    double time_s = 0.0;          ///< 0: as its way takes at the rate
  };
  std::vector<Step> steps;  ///< in their order

  struct Numerics {
    double safety = 0.9;
    double damping_per_s = 0.0;
    std::int64_t frames = 8;
    double step_radii = 0.0;
    double sample_rate_per_s = 150.0;
    double tolerance = 1e-4;
    std::int64_t evaluations = 2000;
    Precision precision = Precision::single_;
    enum class Time { automatic, quasi_static, explicit_ } time = Time::automatic;
  } solver;

  bool band = true;              ///< a discretisation error of the force is wanted
  std::optional<Goal> goal;      ///< an accuracy that nodes are looked for
  std::optional<Vec3> followed;  ///< place whose displacement is asked for [m, LPS, at rest]
  struct Output {
    std::vector<std::string> write = {"all"};
    std::vector<std::string> warp, warp_labels;  ///< images of the patient
    std::string write_frames = "last";
    std::string compare;  ///< a measured curve, paper_word, or empty
  } output;

  /// What somebody has chosen, and what stands as it is usual.
  struct Given {
    bool nodes = false, stiffness = false, contact = false, diameter = false, rate = false,
         sample_rate = false;
    bool depth_is_of_tool = false;  ///< the depth follows from the tool's radius
  } given;
  std::string poses_words = {};  ///< of poses that have become steps, for the log
};

/// That of a name; null: there is none.
template <class Named>
const Named* named(const std::vector<Named>& all, const std::string& name) {
  for (const Named& one : all)
    if (one.name == name) return &one;
  return nullptr;
}

/// Whether it is the scheme that converges, and not that of the paper.
bool converges(const ModelChoices& choices);
/// Whether gravity, lost fluid, a pressure or a body force acts on the body.
bool has_loads(const Scene& scene);
/// Whether nothing acts but the tool, nor holds the body but the base.
bool has_tool_alone(const Scene& scene);
/// Steps in which something moves or holds.
std::vector<Scene::Step> moving_steps(const Scene& scene);
/// Whether the tool turns in any step.
bool turns(const Scene& scene);
/// Cuts of the body before anything has moved: that before the load, and those of the first steps.
std::vector<Cut> cuts_at_rest(const Scene& scene);
bool has_cuts(const Scene& scene);  ///< at rest

/// A step that cuts the body once something has moved.
struct CutStep {
  std::string name;
  Cut cut;
  std::size_t after;            ///< so many of the steps that move something
  double toughness_J_m2 = 0.0;  ///< 0: not known
};
std::vector<CutStep> cuts_after_moves(const Scene& scene);

const char* name_of(Contact contact);
const char* name_of(Scene::Numerics::Time time);

/// Scheme of the name, with what was asked for in place of its own choices.
Scheme scheme_of(const ModelChoices& choices);
Material material_of(const Scene& scene);
/// Material of all labels that have no tissue of their own, then those of the tissues, in their order.
std::vector<Material> materials_of(const Scene& scene);
Loading loading_of(const Scene& scene);
SolverOptions solver_options(const Scene& scene);

/// Keys of walls in messages: "wall.skull.shape", "--wall (load.wall)".
std::string wall_key(const std::string& name, const char* option);
/// Of a drawn sheet, its longest extent along an axis [mm].
double size_of(const TriangleMesh& sheet);

/// Of the tool's radius, a depth that nobody has given at most: deeper down it sinks in towards its equator,
/// or tissue folds at its edge.
inline constexpr double usual_depth_in_radii = 0.8;
/// Throws UsageError: a tool that touches is pushed in deeper than it is long.
void require_tool_as_long(const Scene& scene, double depth_mm);
/// Longest step of the load in equilibrium, in radii of the tool.
double longest_step_radii(const Scene& scene);

}  // namespace dimple
