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

/// Largest error requested of the force or of a displacement, and the time for the search for the nodes.
struct Goal {
  std::string text;                       ///< as it was given
  double fraction = 0.0, absolute = 0.0;  ///< relative, or in N or m; both 0: as small as the time allows
  double budget_s = 0.0;                  ///< 0: unlimited
  double half_width(double of) const { return absolute > 0.0 ? absolute : fraction * of; }
};

/// Shape of a cut: a plane or a disc, a straight edge that enters along a line, a drawn sheet, or a label
/// that is removed. Positions in mm, LPS.
struct Blade {
  enum class Kind { plane, line, sheet, label };
  Kind kind = Kind::plane;
  Vec3 first = Vec3::Zero();   ///< point of the plane; start of the line
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

/// Choices for nodes and integration points, except tool, tissues and supports.
struct ModelChoices {
  struct Image {
    std::string file;                ///< empty: the image is in memory
    std::vector<std::string> label;  ///< numbers or names; empty: all foreground
    std::string label_names;         ///< table of names, or empty
    double close_mm = 0.0;           ///< gaps narrower than this are closed
    double cut_gap_mm = 0.5;         ///< between the faces of a cut
    bool operator==(const Image&) const = default;
  } image;
  Cut cut;  ///< before the load
  std::string scheme{converging.name};
  struct NodeSet {
    std::int64_t nodes = 1500;
    double spacing_mm = 0.0;  ///< instead of the number of nodes; 0: from that number
    double patch_edge = 0.0;  ///< here and in all that follow, 0: the scheme's value
    std::int64_t seed = 1;
    double jitter = 0.0;
    bool operator==(const NodeSet&) const = default;
  } node_set;
  struct Grid {
    std::int64_t points = 0;
    double ratio = 0.0;
    bool operator==(const Grid&) const = default;
  } grid;
  double support_radius_factor = 0.0;
  /// Texts that find_boundary() reads: BoundaryOptions.
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

/// Shape and friction of a contacting tool, as given.
struct ToolWords {
  std::string shape = "circle", friction = "0";
};

/// Word for the values of the paper in place of a measured curve.
inline constexpr const char* paper_word = "horton2007";

/// Name of the moving part of a step where no support or further tool is named.
inline constexpr const char* tool_word = "tool";

/// Everything that decides a result, resolved from the options and checked. Lengths whose names end in _mm
/// are those of the options, so that the same options give the same bits.
struct Scene : ModelChoices {
  struct Material : MaterialNumbers {
    double mu_spread = 0.0;  ///< relative uncertainty of the shear modulus
    bool printed_stress = false;
    std::string preset = "none";
    std::string deviations_from_preset = {};  ///< numbers that replace the preset's, as text
    bool operator==(const Material&) const = default;
  } material;                          ///< of all labels without a tissue of their own
  std::vector<TissueOfLabel> tissues;  ///< in the order of their labels

  bool base_is_held = true;
  double depth_mm = 8.0;
  double rate_mm_per_s = 1.0;
  Contact contact = Contact::bonded;  ///< of the contact patch, if there is no `tool`
  std::optional<ToolShape> tool;      ///< in contact; none: a contact patch of fixed nodes
  double friction = 0.0;              ///< Coulomb's coefficient; infinite: no slip
  ToolWords tool_words;

  Vec3 gravity = Vec3::Zero();  ///< [m/s^2] LPS
  /// Lost fluid: direction against gravity, and the fraction of the body's height above the fluid's level.
  struct Fluid {
    Vec3 up = Vec3::Zero();
    double fraction = 0.0;
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
    std::optional<double> gap = {};               ///< at the closest point [m]; none: as in the image
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
    std::vector<double> move_mm = {0, 0, 0};  ///< displacement when the tool is at its depth
  };
  std::vector<Support> supports;
  struct FurtherTool {
    std::string name;
    ToolShape shape;
    double friction = 0.0;
    Vec3 at_mm = Vec3::Zero();
    std::optional<Vec3> direction = {};  ///< none: along the inward normal
    std::vector<double> move_mm = {0};   ///< x,y,z, or one number along the approach direction
  };
  std::vector<FurtherTool> further_tools;
  struct Step {
    std::string name;
    std::string moves = "tool";  ///< or the name of a support or a further tool
    std::vector<double> move_mm = {}, turn_deg = {}, about_mm = {};
    Cut cut = {};
    double toughness_J_m2 = 0.0;  ///< energy per new area; 0: not known
    double time_s = 0.0;          ///< 0: displacement over the rate
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

  bool error_bounds = true;      ///< the error bounds of the force are requested
  std::optional<Goal> goal;      ///< accuracy for which nodes are sought
  std::optional<Vec3> followed;  ///< position whose displacement is requested [m, LPS, at rest]
  struct Output {
    std::vector<std::string> write = {"all"};
    std::vector<std::string> warp, warp_labels;  ///< images of the patient
    std::string write_frames = "last";
    std::string compare;  ///< a measured curve, paper_word, or empty
  } output;

  /// Choices of the user; false: the default is used.
  struct Given {
    bool nodes = false, stiffness = false, contact = false, diameter = false, rate = false,
         sample_rate = false;
    bool depth_is_of_tool = false;  ///< the depth follows from the tool's radius
  } given;
  std::string poses_words = {};  ///< summary of poses that have become steps, for the log
};

/// Member with that name; null: there is none.
template <class Named>
const Named* named(const std::vector<Named>& all, const std::string& name) {
  for (const Named& one : all)
    if (one.name == name) return &one;
  return nullptr;
}

/// True for the converging scheme, false for that of the paper.
bool converges(const ModelChoices& choices);
/// True if gravity, lost fluid, a pressure or a body force acts on the body.
bool has_loads(const Scene& scene);
/// True if only the tool acts on the body and only the base holds it.
bool has_tool_alone(const Scene& scene);
/// Steps other than cuts: motions and holds.
std::vector<Scene::Step> moving_steps(const Scene& scene);
/// True if the tool rotates in any step.
bool turns(const Scene& scene);
/// Cuts before any motion: that before the load, and those of the first steps.
std::vector<Cut> cuts_of_undeformed_body(const Scene& scene);
bool has_cuts(const Scene& scene);  ///< at rest

/// Step that cuts the body after a motion.
struct CutStep {
  std::string name;
  Cut cut;
  std::size_t after;            ///< number of preceding steps that are no cuts
  double toughness_J_m2 = 0.0;  ///< 0: not known
};
std::vector<CutStep> cuts_after_moves(const Scene& scene);

const char* name_of(Contact contact);
const char* name_of(Scene::Numerics::Time time);

/// Scheme of the name, with the given values in place of its own.
Scheme scheme_of(const ModelChoices& choices);
Material material_of(const Scene& scene);
/// Material of all labels without their own tissue, then those of the tissues, in their order.
std::vector<Material> materials_of(const Scene& scene);
Loading loading_of(const Scene& scene);
SolverOptions solver_options(const Scene& scene);

/// Keys of walls in messages: "wall.skull.shape", "--wall (load.wall)".
std::string wall_key(const std::string& name, const char* option);
/// Longest extent of a drawn sheet along an axis [mm].
double size_of(const TriangleMesh& sheet);

/// Largest default depth, in radii of the tool: deeper, the tool sinks in nearly to its equator, or tissue
/// folds at its edge.
inline constexpr double usual_depth_in_radii = 0.8;
/// Throws UsageError: the depth exceeds the length of a contacting tool.
void require_tool_as_long(const Scene& scene, double depth_mm);
/// Longest step of the load in equilibrium, in radii of the tool.
double longest_step_radii(const Scene& scene);

}  // namespace dimple
