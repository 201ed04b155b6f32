#include <fmt/format.h>
#include <fmt/ranges.h>

#include <iterator>
#include <string>
#include <vector>

#include "apps/scene/config.hpp"
#include "apps/scene/tool_words.hpp"
#include "preprocess/scene/sides.hpp"

namespace dimple {
namespace {

std::vector<std::string> with_sides(std::vector<std::string> words) {
  words.insert(words.end(), std::begin(names_of_sides), std::end(names_of_sides));
  return words;
}

std::vector<std::string> names_of_presets() {
  std::vector<std::string> names = {"none"};
  for (const Preset& preset : material_presets()) names.push_back(preset.name);
  return names;
}

// One row per option, formatted by hand: one field per line would need ten pages.
// clang-format off

std::vector<Option> image_options(Config& c) {
  return {
      {.key = "image.file", .value = &c.image.file, .help = "the label image"},
      {.key = "image.label", .flag = "--label", .value = &c.image.label, .stage = "model", .common = true,
       .help = "labels of the body, by number or name, comma-separated; empty: all but 0"},
      {.key = "image.label_names", .flag = "--label-names", .value = &c.image.label_names, .stage = "model",
       .help = "table of label names (ITK-SNAP, a colour table of 3D Slicer or FreeSurfer), or "
               "totalsegmentator, totalsegmentator-mr, freesurfer"},
      {.key = "image.close_mm", .flag = "--close", .unit = "mm", .value = &c.image.close_mm, .most = 1000,
       .stage = "model",
       .help = "close gaps in the organ narrower than this before its surface is drawn; 0: as segmented"},
      {.key = "image.cut", .flag = "--cut", .value = &c.image.cut, .stage = "model", .common = true,
       .help = "cut the body before the load: line:x,y,z,x,y,z,depth=15mm, plane:x,y,z,nx,ny,nz, sheet.stl, "
               "label:NAME"},
      {.key = "image.cut_gap_mm", .unit = "mm", .value = &c.image.cut_gap_mm, .least = 0.01, .most = 100,
       .stage = "model", .help = "width of the gap between the faces of a cut"},
  };
}

std::vector<Option> discretisation_options(Config& c) {
  return {
      {.key = "scheme.name", .flag = "--scheme", .value = &c.scheme.name,
       .choices = {"converging", "horton2007"}, .stage = "model",
       .help = "converging: averaged gradients, volume constrained on patches, nodes graded towards the edge "
               "of the contact patch; horton2007: the scheme of Horton et al. (2007)"},
      {.key = "cloud.nodes", .flag = "--nodes", .value = &c.node_set.nodes, .least = 100, .most = 1e6,
       .stage = "model", .common = true, .help = "number of nodes"},
      {.key = "cloud.spacing_mm", .flag = "--spacing", .unit = "mm", .value = &c.node_set.spacing_mm,
       .most = 1000, .stage = "model",
       .help = "target node spacing far from the tool, or everywhere with --rim 1 (alternative to --nodes); "
               "0: derived from --nodes"},
      {.key = "cloud.rim", .flag = "--rim", .value = &c.node_set.patch_edge, .most = 1, .stage = "model",
       .help = "node spacing at the edge of the contact patch, as a fraction of that far away; 1: even; 0: "
               "0.02, but at least 0.11 radii of the patch (converging), 1 (horton2007)"},
      {.key = "cloud.jitter", .value = &c.node_set.jitter, .most = 0.5, .stage = "model",
       .help = "move inner nodes at random by up to this fraction of their spacing"},
      {.key = "cloud.seed", .flag = "--seed", .value = &c.node_set.seed, .most = 1e15, .stage = "model",
       .help = "seed of the random node positions"},
      {.key = "grid.points", .flag = "--points", .value = &c.grid.points, .most = 1e7, .stage = "model",
       .help = "approximate number of integration points; 0: from the ratio"},
      {.key = "grid.ratio", .value = &c.grid.ratio, .most = 100, .stage = "model",
       .help = "integration points per node; 0: 7 (converging), 1.499 (horton2007)"},
      {.key = "support.radius_factor", .flag = "--support", .value = &c.support.radius_factor, .most = 10,
       .stage = "model", .help = "support radius in spacings; 0: 1.6 (converging), 1.8 (horton2007)"},
  };
}

std::vector<Option> boundary_options(Config& c) {
  return {
      {.key = "boundary.base", .flag = "--base", .value = &c.boundary.base, .stage = "model",
       .common = true, .words = with_sides({"auto", "organ"}),
       .help = "side on which the organ rests: auto, superior, inferior, anterior, posterior, left, right, "
               "x,y,z in LPS, or organ: from its shape only"},
      {.key = "boundary.base_depth_mm", .flag = "--base-depth", .unit = "mm",
       .value = &c.boundary.base_depth_mm, .most = 1000, .stage = "model",
       .help = "the surface is fixed up to this height above the base's lowest point; 0: all of a flat face, "
               "else a third of the organ's height"},
      {.key = "boundary.base_hold", .flag = "--base-hold", .value = &c.boundary.base_hold,
       .choices = {"fixed", "none"}, .stage = "solve",
       .help = "fixed: the nodes of the base do not move; none: the body rests on walls (--wall) by contact "
               "only"},
      {.key = "boundary.indent_at", .flag = "--indent-at", .value = &c.boundary.indent_at, .stage = "model",
       .common = true, .words = with_sides({"opposite"}),
       .help = "where the tool meets the body: opposite (to the base), a side, x,y,z in LPS (mm, or "
               "2cm,-5mm,3cm) or x,y,top"},
      {.key = "boundary.indenter_diameter_mm", .flag = "--indenter-diameter", .unit = "mm",
       .value = &c.boundary.indenter_diameter_mm, .most = 1000, .least_excluded = true, .stage = "model",
       .common = true, .help = "diameter of the contact patch"},
      {.key = "boundary.direction", .flag = "--direction", .value = &c.boundary.direction, .stage = "model",
       .help = "direction in which the tool moves: auto (away from its side, or towards the base), or "
               "x,y,z in LPS"},
  };
}

std::vector<Option> material_options(Config& c) {
  return {
      {.key = "material.mu_Pa", .flag = "--mu", .unit = "Pa", .value = &c.material.mu_Pa, .most = 1e12,
       .least_excluded = true, .stage = "solve", .common = true,
       .help = "shear modulus; 210Pa+-30% states its uncertainty too"},
      {.key = "material.mu_spread_percent", .unit = "%", .value = &c.material.mu_spread_percent,
       .most = 100, .stage = "solve", .help = "uncertainty of mu, +-; --mu 210Pa+-30% sets both"},
      {.key = "material.young_Pa", .flag = "--young", .unit = "Pa", .value = &c.material.young_Pa,
       .most = 1e12, .stage = "solve", .common = true,
       .help = "Young's modulus, instead of mu, which is then E / (2 (1 + nu)); 0: not given"},
      {.key = "material.nu", .flag = "--nu", .value = &c.material.nu, .most = 0.49999, .stage = "solve",
       .common = true, .help = "Poisson's ratio"},
      {.key = "material.density_kg_per_m3", .flag = "--density", .unit = "kg/m3",
       .value = &c.material.density_kg_per_m3, .most = 1e5, .least_excluded = true, .stage = "solve",
       .help = "mass density"},
      {.key = "material.stress", .flag = "--stress", .value = &c.material.stress,
       .choices = {"consistent", "printed"}, .stage = "solve",
       .help = "consistent: zero at rest; printed: as printed by Horton et al. (2007)"},
      {.key = "material.preset", .flag = "--preset", .value = &c.material.preset,
       .choices = names_of_presets(),
       .stage = "solve", .common = true,
       .help = "published parameters, instead of mu, nu, density, Ogden and Prony terms"},
      {.key = "material.ogden_mu_Pa", .unit = "Pa", .value = &c.material.ogden_mu_Pa, .stage = "solve",
       .help = "Ogden moduli, 2 mu/alpha^2 (sum of stretches^alpha - 3); none: neo-Hookean"},
      {.key = "material.ogden_alpha", .value = &c.material.ogden_alpha, .stage = "solve",
       .help = "Ogden exponents, one for each modulus"},
      {.key = "material.mooney_c01_Pa", .unit = "Pa", .value = &c.material.mooney_c01_Pa, .most = 1e12,
       .stage = "solve",
       .help = "constant of the second invariant, at most mu/2: a Mooney-Rivlin law; 0: neo-Hookean"},
      {.key = "material.gent_limit", .value = &c.material.gent_limit, .most = 1e6, .stage = "solve",
       .help = "limit of tr C - 3 at constant volume, Jm: Gent's law, which stiffens towards it; 0: neo-Hookean"},
      {.key = "material.prony_g", .value = &c.material.prony_g, .stage = "solve",
       .help = "fractions of the shear modulus that relax; none: elastic"},
      {.key = "material.prony_tau_s", .unit = "s", .value = &c.material.prony_tau_s, .stage = "solve",
       .help = "their relaxation times"},
  };
}

std::vector<Option> load_options(Config& c) {
  return {
      {.key = "tool.shape", .flag = "--tool", .value = &c.tool.shape, .stage = "run", .common = true,
       .words = {"circle"},
       .help = fmt::format("circle, the bonded indenter; or a contacting tool: {} or FILE.stl",
                           fmt::join(tool_examples(), ", "))},
      {.key = "tool.friction", .flag = "--friction", .value = &c.tool.friction, .stage = "run",
       .help = "under a contacting tool: Coulomb's coefficient, as 0.3, or stick: no slip"},
      {.key = "load.depth_mm", .flag = "--depth", .unit = "mm", .value = &c.load.depth_mm, .least = 1e-7, .most = 1000,
       .least_excluded = true, .stage = "solve", .common = true, .help = "indentation at the end"},
      {.key = "load.poses", .flag = "--poses", .value = &c.load.poses, .stage = "solve",
       .help = "CSV of the path of the tool's tip: time_s, x_mm, y_mm, z_mm (LPS), and qw, qx, qy, qz if it "
               "turns; the first row is the first contact, each further row a step"},
      {.key = "load.rate_mm_per_s", .flag = "--rate", .unit = "mm/s", .value = &c.load.rate_mm_per_s,
       .most = 1e5, .least_excluded = true, .stage = "solve", .common = true, .help = "speed of the tool"},
      {.key = "load.contact", .flag = "--contact", .value = &c.load.contact,
       .choices = {"bonded", "frictionless"}, .stage = "solve", .common = true,
       .help = "bonded: the tissue moves with the patch; frictionless: it slides"},
      {.key = "load.self_contact", .flag = "--self-contact", .value = &c.load.self_contact,
       .choices = {"auto", "off", "on"}, .stage = "solve",
       .help = "on: folds and cuts that close come into contact without friction, in equilibrium; off: their "
               "walls pass through each other; auto: on in folded bodies"},
      {.key = "load.wall", .flag = "--wall", .value = &c.load.wall, .stage = "solve", .words = {"none"},
       .help = "rigid obstacle next to or around the body, in contact without friction: label:NAME of the "
               "image, a closed mesh FILE.stl, plane:x,y,z,nx,ny,nz, or around:2mm, the body's outer hull at "
               "that gap; none"},
      {.key = "load.gravity", .flag = "--gravity", .value = &c.load.gravity, .stage = "solve",
       .words = with_sides({"none"}),
       .help = "none; the side towards which it pulls with 9.81 m/s2; or x,y,z in LPS, in m/s2: the body is "
               "in equilibrium under it before the tool makes contact"},
      {.key = "load.imaged", .value = &c.load.imaged, .choices = {"unloaded", "loaded"}, .stage = "solve",
       .help = "what the image shows: the body before gravity, pressures and membranes act, or the body "
               "under them; then the load-free shape is computed"},
      {.key = "load.fluid_lost", .value = &c.load.fluid_lost, .stage = "solve", .words = {"none"},
       .help = "fluid around the body whose level has fallen: the side that is up (or x,y,z) and the "
               "fraction of the body's height above the level, as anterior,60%; buoyancy is lost there, and "
               "gravity has no other effect; none"},
      {.key = "load.membrane", .flag = "--membrane", .value = &c.load.membrane, .stage = "solve",
       .words = {"none"},
       .help = "a thin film bonded to all of the surface, as a pia or a capsule: thickness:shear modulus, "
               "such as 0.1mm:400kPa; none"},
  };
}

std::vector<Option> solver_options_of(Config& c) {
  return {
      {.key = "solver.safety", .flag = "--safety", .value = &c.solver.safety, .most = 2,
       .least_excluded = true, .stage = "solve", .help = "time step as a fraction of the longest stable one"},
      {.key = "solver.damping_per_s", .flag = "--damping", .unit = "1/s", .value = &c.solver.damping_per_s,
       .most = 1e6, .stage = "solve", .help = "mass-proportional damping"},
      {.key = "solver.frames", .flag = "--frames", .value = &c.solver.frames, .least = 1, .most = 100000,
       .stage = "solve", .help = "frames written after the first"},
      {.key = "solver.step_radii", .value = &c.solver.step_radii, .most = 1, .stage = "solve",
       .help = "longest step of the load between two equilibria, in radii of the tool, at least 0.001; 0: "
               "0.2, 0.1 under a contacting tool"},
      {.key = "solver.time", .flag = "--time", .value = &c.solver.time,
       .choices = {"auto", "quasi-static", "explicit"}, .stage = "solve",
       .help = "quasi-static: equilibrium after each step of the load; explicit: central differences; "
               "auto: quasi-static or, if the --rate given is fast for the body, explicit. "
               "horton2007 is explicit"},
      {.key = "solver.precision", .flag = "--precision", .value = &c.solver.precision,
       .choices = {"single", "double"}, .stage = "solve",
       .help = "floating-point precision of the force computation"},
      {.key = "solver.tolerance", .value = &c.solver.tolerance, .least = 1e-8, .most = 0.1,
       .stage = "solve", .help = "equilibrium is reached when unbalanced force / reactions is below this"},
      {.key = "solver.evaluations", .value = &c.solver.evaluations, .least = 100, .most = 1e9,
       .stage = "solve", .help = "largest number of force evaluations for one equilibrium"},
      {.key = "solver.sample_rate_per_s", .unit = "1/s", .value = &c.solver.sample_rate_per_s, .most = 1e6,
       .least_excluded = true, .stage = "solve",
       .help = "rows per second of force.csv; by default a load with inertia has at least 20"},
  };
}

std::vector<Option> output_options(Config& c) {
  return {
      {.key = "accuracy.goal", .flag = "--accuracy", .value = &c.accuracy.goal, .stage = "run",
       .common = true,
       .help = "refine the nodes until the error of the force, or of --quantity, is at most 2%, 1mN, 0.1mm"},
      {.key = "accuracy.quantity", .flag = "--quantity", .value = &c.accuracy.quantity, .stage = "run",
       .help = "force, or displacement@x,y,z: also report the displacement of the point at x,y,z at rest, in "
               "LPS mm, with its error; --accuracy then refers to it"},
      {.key = "accuracy.budget_s", .flag = "--budget", .unit = "s", .value = &c.accuracy.budget_s,
       .most = 1e9, .stage = "run",
       .help = "refine the nodes as far as about this time allows; 0: no limit of time"},
      {.key = "accuracy.band", .flag = "--band", .value = &c.accuracy.error_bounds, .choices = {"on", "off"},
       .stage = "run", .help = "discretisation error of the force, estimated from a second, coarser node set"},
      {.key = "output.write", .flag = "--write", .value = &c.output.write,
       .choices = {"all", "force", "nodes", "points", "surface", "picture", "model", "label", "report",
                   "images", "fine"},
       .stage = "files",
       .help = "files to write, comma-separated; force: only tables and summary, which are always written; "
               "all: everything but images, which have the label image's grid; fine: the surface as it was "
               "drawn, and the points of every frame instead of the last (alone: of all)"},
      {.key = "output.warp", .flag = "--warp", .value = &c.output.warp, .stage = "files",
       .help = "images of the same patient to deform with the body, comma-separated; linear between voxels"},
      {.key = "output.warp_labels", .flag = "--warp-labels", .value = &c.output.warp_labels,
       .stage = "files", .help = "the same for label maps: each voxel takes the nearest voxel's number"},
      {.key = "output.write_frames", .flag = "--write-frames", .value = &c.output.write_frames,
       .choices = {"last", "all"}, .stage = "files", .help = "frames of which images are written"},
      {.key = "output.compare", .flag = "--compare", .value = &c.output.compare, .stage = "files",
       .common = true,
       .help = "a measured curve: CSV with indentation_mm, force_N or force_mN; or horton2007"},
  };
}

// clang-format on

}  // namespace

std::vector<Option> options_of(Config& config) {
  std::vector<Option> all;
  for (const auto section : {image_options, discretisation_options, boundary_options, material_options,
                             load_options, solver_options_of, output_options}) {
    std::vector<Option> of = section(config);
    std::move(of.begin(), of.end(), std::back_inserter(all));
  }
  return all;
}

// clang-format off

std::vector<Option> options_of(PressureText& p) {
  return {
      {.key = "pressure.pressure_Pa", .unit = "Pa", .value = &p.pressure_Pa, .least = -1e9, .most = 1e9,
       .stage = "solve", .help = "pressure on the surface, into the tissue; also in a cavity, which it widens"},
      {.key = "pressure.on", .value = &p.on, .stage = "solve",
       .help = "where: all of the surface, the part that faces a side, or the part in a ball x,y,z,radius in "
               "mm"},
      {.key = "pressure.follows", .value = &p.follows, .choices = {"yes", "no"}, .stage = "solve",
       .help = "yes: it acts along the normals of the deformed surface; no: as on the surface at rest"},
  };
}

std::vector<Option> options_of(BodyForceText& f) {
  return {
      {.key = "body_force.force_N_per_m3", .unit = "N/m3", .value = &f.force_N_per_m3, .stage = "solve",
       .help = "force per volume of all tissue at rest, x,y,z in LPS, at the place at_mm"},
      {.key = "body_force.gradient_N_per_m4", .unit = "N/m4", .value = &f.gradient_N_per_m4,
       .stage = "solve",
       .help = "nine numbers: the change of the force's x per metre along x, y and z, then that of its y and "
               "its z; none: the force is uniform"},
      {.key = "body_force.at_mm", .unit = "mm", .value = &f.at_mm, .stage = "solve",
       .help = "place where the force is force_N_per_m3, x,y,z in LPS"},
  };
}

std::vector<Option> options_of(FilmText& m) {
  return {
      {.key = "membrane.thickness_mm", .unit = "mm", .value = &m.thickness_mm, .most = 1000,
       .stage = "solve", .help = "thickness"},
      {.key = "membrane.mu_Pa", .unit = "Pa", .value = &m.mu_Pa, .most = 1e12, .stage = "solve",
       .help = "shear modulus of the film itself, neo-Hookean"},
      {.key = "membrane.tension_N_per_m", .unit = "N/m", .value = &m.tension_N_per_m, .most = 1e6,
       .stage = "solve",
       .help = "tension at rest, in all directions: the body is in equilibrium under it before the tool "
               "makes contact"},
      {.key = "membrane.on", .value = &m.on, .stage = "solve",
       .help = "where: all of the surface, the part that faces a side, or the part in a ball x,y,z,radius in "
               "mm"},
      {.key = "membrane.wrinkles", .value = &m.wrinkles, .choices = {"yes", "no"}, .stage = "solve",
       .help = "yes: it bears no compression, as a thin film that wrinkles; no: its compression and tension "
               "are alike"},
  };
}

std::vector<Option> options_of(WallText& w) {
  return {
      {.key = "wall.shape", .value = &w.shape, .stage = "solve",
       .help = "label:NAME of the image, or several, as label:3,4; a closed mesh FILE.stl, .obj or .vtp in "
               "mm, LPS; "
               "plane:x,y,z,nx,ny,nz, whose normal points to the body; or around:GAP, the outer hull of the "
               "body, folds closed, at that gap"},
      {.key = "wall.friction", .value = &w.friction, .stage = "solve",
       .help = "Coulomb's coefficient, as 0.3, or stick: no slip"},
      {.key = "wall.gap", .value = &w.gap, .stage = "solve", .words = {"image"},
       .help = "gap to the body at the nearest place, as 0.5mm: the wall is offset everywhere to this gap; "
               "image: as in the image"},
      {.key = "wall.opening", .value = &w.opening, .stage = "solve", .words = {"none"},
       .help = "x,y,z,radius in mm: there the wall is open; none"},
      {.key = "wall.places", .value = &w.places, .least = 10, .most = 20000, .stage = "solve",
       .help = "largest number of contact points on the body's surface: their pairs form a dense matrix"},
  };
}

std::vector<Option> options_of(SupportText& h) {
  return {
      {.key = "support.on", .value = &h.on, .stage = "solve",
       .help = "where: the surface that faces a side, its part in a ball x,y,z,radius in mm, or the tissue "
               "label:NAME"},
      {.key = "support.hold", .value = &h.hold, .choices = {"fixed", "sliding"}, .stage = "solve",
       .help = "fixed: held in all directions; sliding: held along the surface's normal only"},
      {.key = "support.move_mm", .unit = "mm", .value = &h.move_mm, .stage = "solve",
       .help = "its displacement when the tool is at its depth, x,y,z; it moves in proportion to the tool"},
  };
}

std::vector<Option> options_of(FurtherToolText& t) {
  return {
      {.key = "tool.shape", .value = &t.shape, .stage = "model",
       .help = "shape of the further tool, as in --tool: sphere:RADIUS, ..., FILE.stl"},
      {.key = "tool.friction", .value = &t.friction, .stage = "solve",
       .help = "Coulomb's coefficient under it, or the word stick"},
      {.key = "tool.at_mm", .unit = "mm", .value = &t.at_mm, .stage = "model",
       .help = "x,y,z in LPS: first contact is at the nearest point of the surface"},
      {.key = "tool.direction", .value = &t.direction, .stage = "model",
       .help = "its approach direction, x,y,z in LPS; none: along the surface's normal there"},
      {.key = "tool.move_mm", .unit = "mm", .value = &t.move_mm, .stage = "solve",
       .help = "its displacement when the tool is at its depth: x,y,z, or one number along its approach "
               "direction"},
  };
}

std::vector<Option> options_of(StepText& s) {
  return {
      {.key = "step.moves", .value = &s.moves, .stage = "solve",
       .help = "what moves in this step: tool, or the name of a support or of a further tool"},
      {.key = "step.move_mm", .unit = "mm", .value = &s.move_mm, .stage = "solve",
       .help = "displacement: x,y,z in LPS, or for a tool one number, along its approach direction"},
      {.key = "step.turn_deg", .unit = "deg", .value = &s.turn_deg, .stage = "solve",
       .help = "rotation of a contacting tool in this step: a rotation vector x,y,z in LPS, right-handed; "
               "its length is the angle"},
      {.key = "step.about_mm", .unit = "mm", .value = &s.about_mm, .stage = "solve",
       .help = "centre of the rotation, x,y,z in LPS; none: its tip at the start of the step"},
      {.key = "step.cut", .value = &s.cut, .stage = "solve",
       .help = "cut made in this step, as image.cut, in the deformed body; nothing moves in it"},
      {.key = "step.toughness_J_m2", .unit = "J/m2", .value = &s.toughness_J_m2, .least = 0.0, .most = 1e6,
       .stage = "solve",
       .help = "for a step that cuts: energy per square metre of new area; 0: not known"},
      {.key = "step.time_s", .unit = "s", .value = &s.time_s, .least = 0.0, .most = 1e7, .stage = "solve",
       .help = "duration, for tissue that relaxes; 0: from its path and load.rate. If nothing moves, the "
               "duration of the hold"},
  };
}

// clang-format on

const std::vector<Option>& usual_options() {
  static Config usual;
  static const std::vector<Option> all = options_of(usual);
  return all;
}

}  // namespace dimple
