#include <array>

#include "apps/scene/compatibility.hpp"

// Short names for this table only.
namespace dimple::compatibility {
namespace {

using F = Feature;

template <class... Each>
constexpr Features of(Each... each) {
  Features all;
  (all.set(each), ...);
  return all;
}

constexpr std::array<FeatureWords, feature_count> all_words = {{
    {F::bonded_patch, "the bonded indenter", "tool.shape"},
    {F::contacting_tool, "a contacting tool", "tool.shape"},
    {F::friction, "friction of the tool", "tool.friction"},
    {F::further_friction, "friction of a further tool or a wall", "tool.NAME.friction, wall.NAME.friction"},
    {F::chosen_contact, "a choice of contact under the bonded indenter", "load.contact"},
    {F::chosen_diameter, "a diameter of the contact patch", "boundary.indenter_diameter_mm"},
    {F::frictionless, "a frictionless contact patch", "load.contact"},
    {F::sideways, "a bonded indenter that moves in space", "step.NAME.move_mm"},
    {F::turning, "a tool that turns", "step.NAME.turn_deg"},
    {F::further_tool, "further tools", "tool"},
    {F::moving_further_tool, "a further tool that moves with the tool", "tool.NAME.move_mm"},
    {F::fluid_lost, "lost fluid", "load.fluid_lost"},
    {F::gravity, "gravity", "load.gravity"},
    {F::pressure, "pressures", "load.pressure"},
    {F::body_force, "a body force", "load.body_force"},
    {F::membrane, "a membrane", "load.membrane, membrane"},
    {F::tension, "a membrane with tension", "membrane.NAME.tension_N_per_m"},
    {F::free_base, "a base that is not held", "boundary.base_hold"},
    {F::wall, "a wall", "load.wall, wall"},
    {F::wall_at_gap, "a wall at a stated gap", "wall.NAME.gap"},
    {F::support, "supports", "support"},
    {F::moving_support, "a support that moves with the tool", "support.NAME.move_mm"},
    {F::steps, "a scene of steps", "step"},
    {F::cut, "a cut", "image.cut"},
    {F::cut_step, "a step that cuts", "step.NAME.cut"},
    {F::cut_after_step, "a cut of a body in a deformed state", "step.NAME.cut"},
    {F::grid_images, "a deformed image", "output.write"},
    {F::warped_images, "a deformed image of the patient", "output.warp, output.warp_labels"},
    {F::followed_place, "a point whose displacement is requested", "accuracy.quantity"},
    {F::self_contact, "contact between folds", "load.self_contact"},
    {F::imaged_loaded, "a body imaged under its loads", "load.imaged"},
    {F::converging_scheme, "the converging scheme", "scheme.name"},
    {F::paper_scheme, "the scheme of Horton et al. (2007)", "scheme.name"},
    {F::inertia, "a run with inertia", "solver.time"},
    {F::viscous, "viscoelastic tissue", "material.prony_g"},
    {F::tissues, "several tissues", "tissue"},
    {F::other_law, "a law other than neo-Hooke's", "material"},
    {F::printed_stress, "the printed stress", "material.stress"},
    {F::ogden, "Ogden's moduli", "material.ogden_mu_Pa"},
    {F::mooney, "a Mooney-Rivlin law", "material.mooney_c01_Pa"},
    {F::preset, "a published material", "material.preset"},
    {F::uncertain_mu, "a shear modulus with an uncertainty", "material.mu_spread_percent"},
    {F::accuracy, "an accuracy", "accuracy.goal, accuracy.budget_s"},
    {F::comparison, "--compare", "output.compare"},
    {F::paper_comparison, "--compare horton2007", "output.compare"},
    {F::run, "dimple run", ""},
    {F::solve, "an existing model", ""},
    {F::solve_in_memory, "an existing model in memory", ""},
    {F::model, "dimple model", ""},
    {F::model_in_memory, "a model by itself", ""},
    {F::explain, "--explain", ""},
    {F::fit, "dimple fit", ""},
    {F::export_mesh, "dimple export", ""},
    {F::by_hand, "a tool moved by hand", ""},
    {F::contacting_tool_by_hand, "a contacting tool moved by hand", ""},
    {F::session, "a Session", ""},
    {F::shift, "dimple shift", ""},
    {F::places, "the list of places", ""},
    {F::error_bounds, "error bounds", "accuracy.band"},
    {F::proportional_force, "a force that is proportional to one modulus", ""},
}};

constexpr bool is_in_order() {
  for (std::size_t k = 0; k < feature_count; ++k)
    if (static_cast<std::size_t>(all_words[k].feature) != k) return false;
  return true;
}
static_assert(is_in_order());

// Features and texts that several lines of the table use.
constexpr Features loads = of(F::fluid_lost, F::gravity, F::pressure, F::body_force);
constexpr const char* equilibrium = "contact is solved in equilibrium, depth by depth";
constexpr const char* patch_alone = "its explicit march has the bonded indenter only";
constexpr const char* leave_one = "leave one of them out";
constexpr const char* deformed = "step.{cut_step}.cut";
constexpr const char* mu_in_words =
    "mu has an uncertainty of {spread} %; its effect on the force needs several runs";
constexpr const char* two_runs = "run once with the smallest and once with the largest modulus";

constexpr auto all_clashes = std::to_array<Clash>({
    // Features that a driver does not support:
    {F::export_mesh, of(F::tissues, F::other_law, F::printed_stress),
     "only one neo-Hookean tissue can be exported", "material",
     "these programs define other laws differently",
     "leave out tissues, presets, --stress printed, Ogden and Prony numbers"},
    {F::accuracy, of(F::model, F::fit, F::shift), "{beside} has no accuracy goal", "{accuracy}",
     "it uses the given number of nodes",
     "leave it out here; dimple run chooses the number of nodes for an accuracy"},
    {F::accuracy, of(F::solve), "a model's files hold one node set, and an accuracy goal needs several",
     "--accuracy (accuracy.goal)", "they do not hold the surface from which nodes are generated",
     "begin with the image: dimple run"},
    {F::accuracy, of(F::steps, F::further_tool), "an accuracy goal cannot be combined with {beside}",
     "--accuracy (accuracy.goal)",
     "the nodes for an accuracy are calibrated for one tool that presses straight",
     "choose the number of nodes with --nodes, and read the error bounds"},
    {F::steps, of(F::export_mesh, F::by_hand, F::session, F::shift, F::fit, F::explain, F::comparison),
     "{beside} has no steps", "step", "it presses straight to one depth",
     "leave them out here and give --depth, or use dimple run"},
    {F::cut_step, of(F::solve, F::solve_in_memory),
     "the step '{any_cut_step}' cuts, and {beside} cannot be cut", "step.{any_cut_step}.cut",
     "a cut body is built again from its image", "begin with the image: dimple run IMAGE"},
    {F::cut, of(F::export_mesh, F::by_hand, F::places), "{beside} has no cuts, and '{cut}' is requested",
     "--cut (image.cut)", "`dimple run` and `dimple model` cut a body before the tool makes contact",
     "leave --cut out, or use dimple run IMAGE --cut"},
    {F::further_tool, of(F::model_in_memory, F::by_hand, F::session, F::shift, F::fit, F::explain),
     "{beside} has one tool, and there is a further one, '{further_tool}'", "tool.{further_tool}",
     "only dimple run has several tools at once", "leave it out here"},
    {F::membrane, of(F::paper_scheme, F::inertia, F::export_mesh, F::by_hand, F::session, F::explain),
     "{beside} has no membranes", "{membrane}",
     "membranes have no mass and are modelled in equilibrium only, in dimple run and solve",
     "leave it out here, or use dimple run with --time quasi-static"},
    {F::contacting_tool,
     of(F::model_in_memory, F::solve, F::solve_in_memory, F::export_mesh, F::session, F::shift,
        F::paper_comparison),
     "{beside} has the bonded indenter only, and the tool is '{tool}'", "tool.shape",
     "only `dimple run`, `fit`, `places` and `poke` have a contacting tool", "leave the tool out here"},
    {F::self_contact, of(F::export_mesh, F::by_hand, F::session),
     "{beside} lets folds pass through each other", "--self-contact (load.self_contact)",
     "`dimple run`, `solve` and `shift` compute contact between folds, in equilibrium",
     "leave --self-contact out, or use dimple run IMAGE --self-contact on"},
    {F::free_base, of(F::paper_scheme, F::inertia, F::export_mesh, F::by_hand, F::session),
     "{beside} needs a fixed base", "--base-hold (boundary.base_hold)",
     "a free body rests on walls, and contact with walls is solved in equilibrium only, in dimple run and "
     "solve",
     "leave it out, or use dimple run with --time quasi-static"},
    {F::wall, of(F::paper_scheme, F::inertia, F::export_mesh, F::by_hand, F::session),
     "{beside} has no walls", "{wall}",
     "contact with walls is solved in equilibrium only, in dimple run and solve",
     "leave the walls out, or use dimple run with --time quasi-static"},
    {F::imaged_loaded, of(F::by_hand, F::session, F::shift),
     "{beside} uses the image's shape as the load-free shape", "load.imaged",
     "only `dimple run` and `dimple solve` compute the load-free shape", "leave load.imaged out"},
    {F::export_mesh, of(F::support, F::further_tool, F::pressure, F::fluid_lost, F::gravity, F::body_force),
     "{beside} cannot be exported", "{option}", "the file holds only the tool and the base",
     "leave it out here, and add it to the file in the other program's format"},
    {F::export_mesh, of(F::paper_scheme), "a scheme cannot be exported", "--scheme",
     "the other program solves the file with its own elements", "leave it out here"},
    {F::export_mesh, of(F::inertia), "inertia cannot be exported", "--time", "the file holds a static step",
     "leave it out here"},
    {F::export_mesh, of(F::imaged_loaded), "{beside} cannot be exported", "{option}",
     "the file holds no loads to remove", "leave it out here"},
    {F::grid_images, of(F::solve),
     "images on the grid of the label image are requested, and a model's files hold no image",
     "--write images (output.write)", "dimple solve begins with nodes and points",
     "begin with the image: dimple run; or name an image of the patient with --warp"},
    {F::by_hand, of(F::paper_scheme), "a tool is moved by hand with the scheme {scheme}",
     "--scheme (scheme.name)", "each of its equilibria needs hundreds of force evaluations",
     "use the scheme 'converging'"},
    {F::contacting_tool_by_hand, loads, "a contacting tool moved by hand needs a body without loads", "load",
     "its first contact is computed on the body as imaged",
     "leave the loads out, use the bonded indenter, or use dimple run"},
    {F::contacting_tool_by_hand, of(F::support),
     "a contacting tool moved by hand needs a body held by its base only", "support",
     "further held or moved parts have not been validated with it",
     "leave the supports out, use the bonded indenter, or use dimple run"},
    {F::contacting_tool_by_hand, of(F::friction), "a tool moved by hand has no friction", "tool.friction",
     "with friction its force depends on its path", "leave the friction out, or use dimple run"},
    {F::contacting_tool_by_hand, of(F::viscous), "a contacting tool moved by hand needs elastic tissue",
     "material.prony_g", "tissue that relaxes continues to move after the tool has left",
     "leave the Prony terms out, or use the bonded indenter"},
    {F::explain, of(F::paper_scheme), "the comparisons of --explain need the converging scheme",
     "--explain and --scheme", "the error of the other scheme exceeds most of the compared effects",
     leave_one},
    // Loads.
    {F::fluid_lost, of(F::gravity), "lost fluid cannot be combined with gravity", "load.fluid_lost",
     "gravity adds the whole weight to a body imaged without it; lost fluid changes the equilibrium in which "
     "it was imaged",
     leave_one},
    // Steps.
    {F::turning, of(F::bonded_patch), "the step '{turning}' turns the bonded indenter",
     "step.{turning}.turn_deg", "the bonded indenter only translates",
     "choose a contacting tool, as --tool capsule:2mm,length=20mm"},
    {F::sideways, of(F::frictionless),
     "the step '{sideways}' moves the tool in space, and it is frictionless", "step.{sideways}.move_mm",
     "tissue slides under it and does not follow it",
     "give one number, along its approach direction, or --contact bonded"},
    {F::cut_after_step, loads, "the step '{cut_step}' cuts a body in a deformed state, with {beside}",
     deformed, "the indenter is bonded to nodes of the loaded body, and the cut body has other nodes",
     "cut it at rest (--cut), or leave the loads out"},
    {F::cut_after_step, of(F::tension),
     "the step '{cut_step}' cuts a body in a deformed state, with a membrane with tension", deformed,
     "the tension moves the body before the tool makes contact, as loads do",
     "cut it at rest (--cut), or leave the tension out"},
    {F::cut_after_step, of(F::viscous),
     "the step '{cut_step}' cuts a body in a deformed state, with viscoelastic tissue", deformed,
     "its history belongs to integration points, and the cut body has others",
     "cut it at rest (--cut), or leave the relaxation out"},
    {F::cut_after_step, of(F::turning),
     "the step '{cut_step}' cuts a body in a deformed state, with a tool that turns", deformed,
     "the centre of its rotation would change on the cut body",
     "cut it at rest (--cut), or let the tool go straight"},
    {F::cut_after_step, of(F::friction, F::further_friction),
     "the step '{cut_step}' cuts a body in a deformed state, with friction", deformed,
     "the slip belongs to contact points of the surface before the cut",
     "cut it at rest (--cut), or leave the friction out"},
    {F::cut_after_step, of(F::wall_at_gap),
     "the step '{cut_step}' cuts a body in a deformed state, with a wall at a stated gap", deformed,
     "the gap is that of the body before the cut",
     "cut it at rest (--cut), or leave the wall where the image has it"},
    {F::steps, of(F::moving_support),
     "the support '{moving_support}' moves with the tool, and there are steps",
     "support.{moving_support}.move_mm", "in a scene of steps one thing moves at a time",
     "give it a step: [step.NAME] with moves = \"{moving_support}\""},
    {F::steps, of(F::paper_scheme), "steps are requested of a march with inertia", "scheme.name",
     "each step goes from an equilibrium to the next", "leave --time and --scheme out, or the steps"},
    {F::steps, of(F::inertia), "steps are requested of a march with inertia", "solver.time",
     "each step goes from an equilibrium to the next", "leave --time and --scheme out, or the steps"},
    // The tool.
    {F::friction, of(F::bonded_patch),
     "friction '{friction}' is requested, and the tool is the bonded indenter", "--friction (tool.friction)",
     "friction needs a contacting tool; the other tool is bonded or slides (--contact)",
     "leave --friction out, or choose such a tool, as --tool sphere:5mm"},
    {F::contacting_tool, of(F::inertia), "inertia cannot be combined with the tool '{tool}'",
     "--time (solver.time)", equilibrium, "leave --time out, or --tool"},
    {F::contacting_tool, of(F::paper_scheme),
     "the scheme horton2007 cannot be combined with the tool '{tool}'", "--scheme (scheme.name)", patch_alone,
     "leave --scheme out, or --tool"},
    {F::contacting_tool, of(F::chosen_contact), "{beside} cannot be combined with the tool '{tool}'",
     "--contact (load.contact)", "a tool of this shape is in contact, with --friction or without",
     "leave --contact out, or --tool"},
    {F::contacting_tool, of(F::chosen_diameter), "{beside} cannot be combined with the tool '{tool}'",
     "--indenter-diameter (boundary.indenter_diameter_mm)", "the tool's own lengths define its size",
     "leave --indenter-diameter out, or --tool"},
    {F::contacting_tool, of(F::accuracy), "{beside} cannot be combined with the tool '{tool}'",
     "--accuracy (accuracy.goal)",
     "the nodes for an accuracy are calibrated for the bonded indenter only; a contacting tool has error "
     "bounds for the given nodes",
     "choose the number of nodes with --nodes, and read the error bounds"},
    // Further tools.
    {F::steps, of(F::moving_further_tool),
     "the tool '{moving_tool}' moves with the tool, and there are steps", "tool.{moving_tool}.move_mm",
     "in a scene of steps one thing moves at a time",
     "give it a step: [step.NAME] with moves = \"{moving_tool}\""},
    {F::further_tool, of(F::inertia), "inertia cannot be combined with a further tool",
     "--time (solver.time)", equilibrium, leave_one},
    {F::further_tool, of(F::paper_scheme), "the scheme horton2007 cannot be combined with a further tool",
     "--scheme (scheme.name)", patch_alone, leave_one},
    {F::further_tool, loads, "{beside} cannot be combined with a further tool", "load",
     "the first contact is computed on the body at rest, without loads", leave_one},
    {F::further_tool, of(F::membrane), "a membrane cannot be combined with a further tool", "membrane",
     "contact with a body under a membrane has not been validated", leave_one},
    // Contact of folds, and the load-free configuration.
    {F::self_contact, of(F::inertia), "contact between folds cannot be combined with the time '{time}'",
     "--self-contact (load.self_contact) and --time (solver.time)", equilibrium, leave_one},
    {F::self_contact, of(F::paper_scheme),
     "contact between folds cannot be combined with the scheme '{scheme}'",
     "--self-contact (load.self_contact) and --scheme (scheme.name)", equilibrium, leave_one},
    {F::imaged_loaded,
     of(F::fluid_lost, F::wall, F::free_base, F::cut, F::cut_step, F::grid_images, F::warped_images,
        F::contacting_tool, F::steps, F::followed_place, F::self_contact),
     "{beside} cannot be combined with a body imaged under its loads", "load.imaged",
     "its place is given in the image, and the load-free shape differs from it", "leave one of the two out"},
    // Materials.
    {F::paper_scheme, of(F::tissues, F::other_law), "the scheme horton2007 has one neo-Hookean tissue only",
     "--scheme horton2007", "it is kept as printed, for comparison",
     "leave --scheme out for other laws, viscoelastic and several tissues"},
    {F::converging_scheme, of(F::printed_stress), "the printed stress needs the scheme horton2007",
     "--stress printed", "the converging scheme is derived from energies, and the printed stress has none",
     "add --scheme horton2007"},
    {F::uncertain_mu, of(F::ogden), mu_in_words, "--mu (material.mu_spread_percent)",
     "the modulus of this material is not given by --mu", two_runs},
    // Reasons why there are no error bounds, and why a force is not proportional to one modulus.
    {F::error_bounds, of(F::paper_scheme), "", "", "calibrated for the converging scheme only", ""},
    {F::error_bounds, of(F::inertia), "", "", not_for_dynamics, ""},
    {F::error_bounds, of(F::frictionless), "", "", "not calibrated for a frictionless contact patch", ""},
    {F::error_bounds, of(F::membrane), "", "", "not calibrated for membranes", ""},
    {F::error_bounds, of(F::turning), "", "", "not calibrated for a tool that turns", ""},
    {F::error_bounds, of(F::cut_step), "", "", "not calibrated for steps that cut", ""},
    {F::error_bounds, of(F::fluid_lost), "", "", "not calibrated for lost fluid", ""},
    {F::error_bounds, of(F::support), "", "", "not calibrated for supports", ""},
    {F::proportional_force, of(F::paper_scheme, F::inertia), "", "",
     "the force includes inertia, which does not grow with mu", ""},
    {F::proportional_force, of(F::mooney), "", "",
     "the second constant of a Mooney-Rivlin law does not grow with mu", ""},
    {F::proportional_force, of(F::preset), "", "", "the material is a published one (--preset)", ""},
    {F::proportional_force, of(F::tissues), "", "",
     "the force of several tissues is proportional to no single modulus", ""},
    {F::proportional_force, loads, "", "", "loads other than the tool do not grow with mu", ""},
    {F::proportional_force, of(F::membrane), "", "", "a membrane's stiffness does not grow with mu", ""},
});

constexpr auto all_needs = std::to_array<Need>({
    {F::fit, F::proportional_force, "the modulus of this case cannot be fitted to a force", "dimple fit",
     "the fit needs a force that is proportional to the modulus: ",
     "fit one tissue of neo-Hookean, Ogden's or Gent's law in equilibrium (--time quasi-static)"},
    {F::uncertain_mu, F::proportional_force, mu_in_words, "--mu (material.mu_spread_percent)", "", two_runs},
    {F::accuracy, F::error_bounds, "the accuracy of this run cannot be estimated",
     "--accuracy (accuracy.goal) or --budget (accuracy.budget_s)",
     "it needs error bounds of the force: ", "leave them out, and compare several --nodes"},
});

}  // namespace
}  // namespace dimple::compatibility

namespace dimple {

const FeatureWords& words_of(Feature feature) {
  return compatibility::all_words[static_cast<std::size_t>(feature)];
}

std::span<const Clash> clashes() {
  return compatibility::all_clashes;
}

std::span<const Need> needs() {
  return compatibility::all_needs;
}

}  // namespace dimple
