#include "apps/run/simulate.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "apps/run/bending.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/words.hpp"
#include "io/error.hpp"
#include "io/memory.hpp"
#include "io/stop.hpp"
#include "preprocess/support.hpp"
#include "solver/quasi_static.hpp"
#include "solver/stable_time_step.hpp"

namespace dimple {
namespace {

using Line = RunObserver::Line;

struct Placed {
  Discretisation places;
  Scheme scheme;
  std::map<std::string, int> label_names;
  std::optional<Organ> organ = {};  // of an image
};

// Where nobody has chosen, a folded body takes as many as its band needs.
void take_nodes_for_band(const Config& config, const Talk& talk, ModelOptions& options, Result& result) {
  const Index fewest = fewest_nodes_with_band(result.facing_share);
  if (!default_nodes(config) || !options.scheme.pressure_patches || options.cloud.count >= fewest) return;
  talk.say(fmt::format(
      "nodes    {} instead of {}, as none were given: {:.0f} % of the surface faces another part of "
      "it, and the force of such a body is known from {} nodes on",
      fewest, options.cloud.count, 100.0 * result.facing_share, fewest));
  options.cloud.count = result.nodes_for_band = fewest;
}

// The organ that was read before, under the options of this case.
Organ taken_again(const Case& given, Result& result) {
  Organ organ = given.organ->organ;
  const double voxel_mm = organ.options.boundary.voxel_mm;
  organ.options = model_options(given.config);
  organ.options.boundary.voxel_mm = voxel_mm;
  check_materials(materials_of(given.config), organ.options.scheme);
  check_words(organ.options.boundary);
  result = given.organ->read;
  return organ;
}

Placed place(const Case& given, const RunObserver& observer, const Talk& talk, Result& result) {
  Placed placed;
  if (given.model) {
    check_materials(materials_of(given.config), given.model->scheme);
    for (const std::string& note : given.model->notes) talk.warn(note);
    say_default_stiffness(talk, given.config);
    placed.places = given.model->places;
    placed.scheme = given.model->scheme;
    placed.label_names = given.model->label_names;
    result.provenance = given.model->provenance;
  } else {
    placed.organ.emplace(given.organ ? taken_again(given, result)
                                     : read_organ(given, model_options(given.config), talk, result));
    placed.label_names = placed.organ->label_names;
    ModelOptions options = placed.organ->options;
    placed.scheme = options.scheme;
    take_nodes_for_band(given.config, talk, options, result);
    placed.places = place_nodes(given.config, *placed.organ, options, result.image, talk, result);
    if (result.nodes_for_band > 0)
      result.chosen["cloud.nodes"] += ", as the body is folded and none were given";
  }
  if (observer.placed) observer.placed(placed.places, placed.scheme);
  return placed;
}

void complete(const Config& config, Placed placed, const Talk& talk, Result& result) {
  const Stopwatch completing;
  const TissueOptions tissues = tissues_of(config, placed.label_names, placed.places);
  talk.begin(Part::supports, config);
  Eigen::VectorXi of_point = tissue_of_points(placed.places, tissues);
  const Model& model = result.model = make_model(std::move(placed.places), placed.scheme, std::move(of_point),
                                                 tissues.density, &result.stages);
  result.tissues = {materials_of(config), model.tissue};
  const SupportOptions& options = model.scheme.support;
  const SupportReport& support = model.support_report;
  const ConsistencyReport& consistency = model.consistency_report;
  talk.detail(fmt::format(
      "support  {} basis, {} weight, radius {:.2f} spacings: {} to {} nodes per point, mean {:.1f}; {} grown "
      "for conditioning",
      basis_word(options.basis), weight_word(options.weight), options.effective_radius_factor(),
      support.fewest, support.most, support.mean, support.grown));
  talk.detail(fmt::format("support  linear fields reproduced to {:.1e}; worst pivot ratio {:.1e}",
                          support.linear_error, support.worst_pivot_ratio));
  if (consistency.iterations > 0)
    talk.detail(fmt::format(
        "patch    forces of a constant pressure: {:.1e} off before, {:.1e} after a change of gradients by at "
        "most {:.2f} of a cell's largest",
        consistency.before, consistency.after, consistency.largest_change));
  if (support.unseen > 0)
    talk.detail(
        fmt::format("folds    {} pairs of a node and a point are near each other across a gap and do not "
                    "belong together; {} "
                    "points see too few nodes and take what is near",
                    support.unseen, support.unconnected));
  else if (model.scheme.consistent_gradients && model.surface.empty())
    talk.warn("without a surface the gradients are not made consistent: forces at high pressure are too low");
  talk.detail(fmt::format("mass     {} g in all, {} to {} g per node", three_digits(model.mass.sum() * 1e3),
                          three_digits(model.mass.minCoeff() * 1e3), three_digits(model.mass.maxCoeff() * 1e3)));
  result.complete_s = completing.seconds();
}

void require_room_beneath(const Config& config, const Discretisation& places) {
  const double beneath =
      (places.X.transpose() * places.tool.push).maxCoeff() - places.tool.centre.dot(places.tool.push);
  if (loading_of(config).depth >= beneath)
    throw ModelError(
        {.fact =
             fmt::format("an indentation of {} is deeper than the organ beneath the circle, {}",
                         length_in_words(config.load.depth_mm), length_in_words(1e3 * beneath)),
         .where = "--depth (load.depth_mm)",
         .why = "the tool would come out on the other side",
         .remedy = "give a smaller --depth, or another place with --indent-at"});
}

std::string describe(const Tissues& tissues, std::size_t t) {
  const Material& m = tissues.material[t];
  const LawWords words = words_of(m);
  std::string law = words.title;
  for (const auto& term : words.terms) {
    std::vector<std::string> numbers;
    for (const auto& [name, value] : term)
      numbers.push_back(name.ends_with("_Pa") ? stress_in_words(value) : plain(value));
    law += fmt::format(" ({})", fmt::join(numbers, ", "));
  }
  for (const PronyTerm& term : m.prony) law += fmt::format(", {} relaxing in {} s", plain(term.g), plain(term.tau));
  return fmt::format(
      "material {}{}: mu {}, nu {}, density {} kg/m3",
      t == 0 ? "" : fmt::format("of {} points, ", (tissues.of_point.array() == static_cast<int>(t)).count()),
      law, stress_in_words(m.mu), plain(poisson_ratio(m)), plain(m.density));
}

std::string crossings_in_words(double crossings) {
  return crossings < 1.0
             ? fmt::format("the load lasts {} of the time that a shear wave takes through the organ",
                           percent(crossings))
             : fmt::format("the load lasts {} times as long as a shear wave takes through the organ",
                           three_digits(crossings));
}

// As config.solver.time asks: "auto" and "dynamic" look at how long the load lasts.
TimeMode time_of(const Config& config, const Talk& talk, const Result& result) {
  const std::string& asked = config.solver.time;
  if (asked == "quasi-static") return TimeMode::quasi_static;
  if (asked == "explicit" || !result.model.scheme.pressure_patches) return TimeMode::explicit_;
  TimeMode mode = choose_time(result.model, result.tissues, result.loading);
  if (mode == TimeMode::quasi_static && asked == "dynamic") mode = TimeMode::dynamic;
  const double crossings = shear_crossings(result.model, result.tissues, result.loading);
  const bool shallow = mode == TimeMode::quasi_static && crossings < slow_load;
  talk.line(
      mode == TimeMode::quasi_static && !shallow ? Line::detail : Line::said,
      fmt::format(
          "time     {}: {}{}",
          mode == TimeMode::dynamic     ? "implicit dynamics, in steps of the body's natural modes"
          : mode == TimeMode::explicit_ ? "explicit dynamics"
                                        : "quasi-static",
          crossings_in_words(crossings),
          shallow ? "; the load is short, but its tool is slow; --time explicit follows the waves" : ""));
  return mode;
}

// From places to a model that is complete, and a load that is accepted.
void make_ready(const Case& given, Placed placed, const Talk& talk, Result& result) {
  const Config& config = given.config;
  require_room_beneath(config, placed.places);
  check_loads(config, placed.places.surface);
  Supports supports = supports_of(config, placed.places, placed.label_names);
  for (const std::string& words : supports.words) talk.say("support  " + words);
  const Stopwatch preparing;
  complete(config, std::move(placed), talk, result);
  const Model& model = result.model;
  const Loading& loading = result.loading = loading_of(config);
  result.loading.further = std::move(supports.sets);
  result.loading.loads = loads_of(config, model);
  const SolverOptions options = solver_options(config);
  result.findings = check_model(model, model.support_report, loading.depth);
  for (const Finding& finding : result.findings) talk.warn(in_words(finding));
  for (std::size_t t = 0; t < result.tissues.material.size(); ++t) {
    const Material& m = result.tissues.material[t];
    // The stiffness that nobody has chosen was told of before.
    talk.line(t == 0 && default_stiffness(config) ? Line::detail : Line::said, describe(result.tissues, t));
    talk.detail(fmt::format("waves    kappa {}, so {:.2f} and {:.3f} m/s", stress_in_words(m.kappa),
                            pressure_wave_speed(m), shear_wave_speed(m)));
  }
  if (const std::string preset = beside_preset(config); !preset.empty()) talk.say("preset   " + preset);
  if (!loading.loads.none()) talk.say("loads    " + in_words(loading.loads) + "; the body comes to rest under it first");
  result.time = time_of(config, talk, result);
  talk.detail(fmt::format("load     {} at {} mm/s: {} s, {}, {}", length_in_words(config.load.depth_mm),
                          plain(config.load.rate_mm_per_s), three_digits(loading.duration()), config.load.contact,
                          result.time == TimeMode::quasi_static
                              ? fmt::format("equilibrium in {} steps", steps_of_load(model, loading, options))
                          : result.time == TimeMode::dynamic ? "with inertia, by implicit steps"
                                                             : "with inertia, by central differences"));
  if (is_as_printed(result.tissues.material.front())) {
    talk.warn("the printed stress has no energy: energy.csv shows that of the consistent form");
    if (options.damping == 0.0)
      talk.warn(
          "the printed stress does work on closed paths, so undamped vibration grows: give --damping, for "
          "instance 20");
  }
  if (result.time != TimeMode::quasi_static && config.material.mu_spread_percent > 0.0)
    throw UsageError(
        {.fact = "mu is given as known to a share of it, and inertia takes part in the force",
         .where = "--mu (material.mu_spread_percent)",
         .why = "the load is so short that the run is dynamic, and its force not proportional to mu",
         .remedy = "run it once with the smallest and once with the largest modulus, or slower"});
  result.spread = spread_of(config);
  result.model_warnings = result.warnings.size();
  result.complete_s = preparing.seconds();
}

std::unique_ptr<ForceSystem> force_system(const Config& config, Result& result) {
  const Stopwatch readying;
  auto system = std::make_unique<ForceSystem>(result.model, result.tissues, precision_of(config));
  result.model.dphi.resize(
      3, 0);  // the system has them in a layout of its own; twice is 0.4 GB at 100,000 nodes
  give_back_memory();
  stop_if_asked();
  result.complete_s += readying.seconds();
  return system;
}

void keep_findings(const Talk& talk, Result& result) {
  for (const Finding& finding : result.history.guards) talk.warn(in_words(finding));
  result.findings.insert(result.findings.end(), result.history.guards.begin(), result.history.guards.end());
}

void warn_of_bending(const Talk& talk, const BendingOfPart& bending) {
  if (const std::string warning = bending.warning(); !warning.empty()) talk.warn(warning);
}

constexpr const char* not_for_dynamics = "it was measured in equilibrium, not for dynamics";

// Why the band of such a run cannot be told, or nothing: it was measured for what is the default.
std::string no_band(const Config& config) {
  const Config usual;
  if (config.scheme.name != usual.scheme.name) return "it was measured for the converging scheme alone";
  if (config.solver.time == "explicit" || config.solver.time == "dynamic") return not_for_dynamics;
  if (config.load.contact != usual.load.contact)
    return "it was measured for a circle to which the tissue is bonded";
  if (has_loads(config)) return "it was measured for bodies that bear no load but the tool's";
  if (!has_tool_alone(config)) return "it was measured for bodies that nothing holds but their base";
  if (const std::string none = no_band(materials_of(config)); !none.empty()) return none;
  if (config.solver.tolerance > usual.solver.tolerance)
    return fmt::format("it was measured for a tolerance of {:g}", usual.solver.tolerance);
  if (config.solver.step_radii > usual.solver.step_radii)
    return fmt::format("it was measured with steps of the load of at most {:g} radii",
                       usual.solver.step_radii);
  if (config.boundary.direction != usual.boundary.direction)
    return "it was measured for a circle that moves straight towards the base";
  if (config.cloud.rim != usual.cloud.rim || config.cloud.jitter != usual.cloud.jitter ||
      config.grid.points != usual.grid.points || config.grid.ratio != usual.grid.ratio ||
      config.support.basis != usual.support.basis || config.support.weight != usual.support.weight ||
      config.support.radius_factor != usual.support.radius_factor)
    return "it was measured for the default nodes, points and supports alone";
  if (config.load.depth_mm > deepest_with_band * 0.5 * config.boundary.indenter_diameter_mm)
    return fmt::format("it was measured down to {} radii of the circle", deepest_with_band);
  return {};
}

// Likewise, once it is known how time is followed and what the body looks like.
std::string no_band(const Config& config, const Organ& organ, const Boundary& boundary,
                    const Result& result) {
  if (result.time != TimeMode::quasi_static) return not_for_dynamics;
  if (const std::string none = no_band(config); !none.empty()) return none;
  return no_band(body_under_circle(organ.body->surface, boundary, organ.options.boundary.voxel_mm));
}

// By which the model's force gets a band another time.
void keep_origin(const Case& given, std::optional<Organ> organ, Result& result) {
  if (!organ) return;
  result.origin = std::make_shared<Origin>(Origin{.config = given.config,
                                                  .organ = std::move(*organ),
                                                  .image = result.image,
                                                  .facing_share = result.facing_share,
                                                  .boundary = result.report.boundary});
}

// As it is, but with the nodes, points, base and circle of the model.
Config with_model_of(const Config& config, const Config& made) {
  Config result = config;
  result.image = made.image;
  result.scheme = made.scheme;
  result.cloud = made.cloud;
  result.grid = made.grid;
  result.support = made.support;
  result.boundary = made.boundary;
  return result;
}

ModelOptions with_nodes(const Organ& organ, Index nodes) {
  ModelOptions options = organ.options;
  options.cloud.count = nodes;
  options.cloud.spacing_mm = 0.0;
  return options;
}

// What moves the place that is followed, in this model.
std::optional<Interpolation> to_followed(const Result& result) {
  if (!result.followed) return std::nullopt;
  return inner_interpolation(result.model, result.followed->place);
}

Vec3 displacement_at(const Interpolation& place, const ForceSystem::Nodal& u) {
  return place(u.topRows<3>()).col(0);
}

// A place outside of the body moves nowhere. Throws UsageError.
std::optional<Followed> followed_in(const Config& config, const Organ& organ) {
  const std::optional<Vec3> place = followed_place(config);
  if (!place) return std::nullopt;
  const BodySurface& surface = organ.body->surface;
  const Vec3 there = surface.to_world().inverse() * (*place * 1e3);
  if (!surface.contains(there)) {
    const BodySurface::Closest closest = surface.closest(there);
    throw UsageError({.fact = fmt::format("the place {} lies outside of the body", in_words(*place * 1e3)),
                      .where = "--quantity (accuracy.quantity)",
                      .why = fmt::format("its surface is {:.1f} mm away, at {}", closest.distance,
                                         in_words(surface.to_world() * closest.place)),
                      .remedy = "give a place of the body at rest, in LPS mm"});
  }
  return Followed{.place = *place};
}

// The force curve of the same body with fewer nodes, at few depths, and the displacement of the place that is followed.
struct Coarser {
  History history;
  Vec3 u = Vec3::Zero();
};
Coarser coarser_with(Index nodes, const Config& config, const Organ& organ, const LabelImage& image,
                     const Result& result) {
  const ModelOptions options = with_nodes(organ, nodes);
  Result coarse;
  const RunObserver unheard;
  complete(config,
           {discretise(organ.body->surface, options, labels_of(config, organ, image)).places, options.scheme,
            organ.label_names},
           Talk{unheard, coarse}, coarse);
  coarse.followed = result.followed;
  const std::optional<Interpolation> place = to_followed(coarse);
  const std::unique_ptr<ForceSystem> system = force_system(config, coarse);
  SolverOptions how = solver_options(config);
  how.frames = 1;  // nobody looks at them
  Observer observer;
  if (place)
    observer.frame = [&](const Frame& frame) { coarse.followed->u = displacement_at(*place, frame.u); };
  solve(result.time, *system, coarse.model, result.loading, how, observer, coarse.history);
  if (coarse.history.interrupted) throw Stopped(stop_asked());
  return {std::move(coarse.history), place ? coarse.followed->u : Vec3::Zero()};
}

// What the supports feel where the tool is at that depth [m].
void feel_supports(const ForceSystem::Nodal& f, double depth, Result& result) {
  result.on_support.clear();
  for (const HeldSet& support : result.loading.further) result.on_support.push_back(force_on(support, f));
  result.on_support_at = depth;
}

double half_of_displacement(const Result& result, const Vec3& coarse) {
  return displacement_half_width((result.followed->u - coarse).norm(), result.history.force.back().depth,
                                 result.model.node_count());
}

void find_band(const Case& given, const std::optional<Organ>& read, const Talk& talk, Result& result) {
  if (!given.band) return;
  Band& band = result.band;
  const Origin* origin = given.origin.get();
  const Organ* organ = read ? &*read : origin ? &origin->organ : nullptr;
  if (!organ) {
    band.unknown = "a model's files hold one cloud, and it takes two";
    return;
  }
  const Config config = origin ? with_model_of(given.config, origin->config) : given.config;
  if (origin) {
    result.facing_share = origin->facing_share;
    if (!config.tissue.empty() && origin->image.run.empty()) {
      band.unknown = "it takes another cloud, and the labels of the image were not kept";
      return;
    }
  }
  band.unknown = no_band(config, *organ, origin ? origin->boundary : result.report.boundary, result);
  const Index fewest = fewest_nodes_with_band(result.facing_share);
  if (band.known() && result.model.node_count() < fewest)
    band.unknown = fmt::format("it was measured from {0} nodes on{1}; give --nodes {0}", fewest,
                               result.facing_share > most_facing ? " where a body has folds" : "");
  if (!band.known()) return;
  talk.begin(Part::band, given.config);
  const Stopwatch whole;
  band.coarse_nodes =
      static_cast<Index>(std::lround(static_cast<double>(result.model.node_count()) / coarser));
  const std::string cloud = fmt::format("with {} nodes, with which it is compared, ", band.coarse_nodes);
  try {
    const Coarser coarse =
        coarser_with(band.coarse_nodes, config, *organ, origin ? origin->image : result.image, result);
    band.half = half_widths(result.history.force, result.model.node_count(), coarse.history.force,
                            result.model.tool.radius, !given.config.tissue.empty());
    if (band.half.empty())
      band.unknown = cloud + "the force ends before";
    else if (Followed* followed = result.followed ? &*result.followed : nullptr)
      followed->half = half_of_displacement(result, coarse.u);
  } catch (const Stopped&) {
    band.unknown = "the run was stopped before";
    result.history.interrupted = true;
  } catch (const Error& error) {
    result.history.interrupted = stop_asked() != StopReason::none;  // of which this is a consequence
    band.unknown = result.history.interrupted ? "the run was stopped before" : cloud + error.report.fact;
  } catch (const std::bad_alloc&) {
    band.unknown = cloud + "memory is short";
  }
  band.seconds = whole.seconds();
}

// A frame that is kept, because whether its cloud is fine enough shows only at the end.
struct KeptFrame {
  int number;
  double t, depth;
  ForceSystem::Nodal u, f;
  ForceState forces;
};

// One cloud of a ladder, marched to the end.
struct Rung {
  Result result;
  std::vector<std::pair<Line, std::string>> lines;  // that it would have told
  std::unique_ptr<ForceSystem> system;
  std::vector<KeptFrame> frames;
  Index asked = 0;  // nodes
  double seconds = 0.0;
};

void require_a_band(const std::string& none) {
  if (none.empty()) return;
  throw UsageError({.fact = "the accuracy of this run cannot be told",
                    .where = "--accuracy (accuracy.goal) or --budget (accuracy.budget_s)",
                    .why = "it is told by a band of the force, and " + none,
                    .remedy = "leave them out, and compare several --nodes"});
}

// `base`: what the image gave. Throws Stopped too.
std::unique_ptr<Rung> march_with(Index nodes, const Case& given, const Organ& organ, const Result& base,
                                 const RunObserver& observer) {
  const Stopwatch whole;
  auto rung = std::make_unique<Rung>();
  rung->asked = nodes;
  Result& result = rung->result;
  result.image_words = base.image_words;
  result.labels = base.labels;
  result.closed_mm3 = base.closed_mm3;
  result.facing_share = base.facing_share;
  result.segment = base.segment;
  result.warnings = base.warnings;
  result.image_warnings = base.image_warnings;
  result.read_s = base.read_s;
  result.build_s = base.build_s;
  result.stages.add(base.stages);
  const RunObserver keeping{.line =
                                [&](Line kind, const std::string& text) {
                                  if (kind == Line::doing && observer.line) return observer.line(kind, text);
                                  rung->lines.emplace_back(kind, text);
                                },
                            .part =
                                [&](Part part, const Work& work) {
                                  if (observer.part) observer.part(part, work);
                                }};
  const Talk talk{keeping, result};
  const ModelOptions options = with_nodes(organ, nodes);
  make_ready(given,
             {place_nodes(given.config, organ, options, base.image, talk, result), options.scheme,
              organ.label_names},
             talk, result);
  require_a_band(no_band(given.config, organ, result.report.boundary, result));
  result.followed = base.followed;
  const std::optional<Interpolation> place = to_followed(result);
  BendingOfPart bending(result.model);
  rung->system = force_system(given.config, result);
  talk.begin(Part::solving, given.config);
  const Stopwatch solving;
  const Observer march{
      .frame =
          [&](const Frame& frame) {
            rung->frames.push_back({frame.number, frame.t, frame.depth, frame.u, frame.f, frame.forces});
            if (place) result.followed->u = displacement_at(*place, frame.u);
            bending.see(frame);
          },
      .sample = [](const ForceSample&, const History&) { return stop_asked() == StopReason::none; },
      .retry =
          [&](const Retry& retry) {
            talk.detail(
                fmt::format("retry    at {:.3f} mm ({}): {}", 1e3 * retry.depth, retry.code, retry.what));
          }};
  solve(result.time, *rung->system, result.model, result.loading, solver_options(given.config), march,
        result.history);
  if (result.history.interrupted) throw Stopped(stop_asked());
  result.solve_s = solving.seconds();
  keep_findings(talk, result);
  warn_of_bending(talk, bending);
  rung->seconds = whole.seconds();
  return rung;
}

// What an accuracy is asked of, and half its band's width: of the displacement where one is asked for.
std::pair<double, double> asked_for(const LadderStep& step, const Result& result) {
  return result.followed ? std::pair(step.length, step.half_length) : std::pair(std::abs(step.force), step.half);
}

// The march of a rung, for who has not seen it.
void replay(Rung rung, const RunObserver& observer, Result& result) {
  rung.result.image = std::move(result.image);
  rung.result.ladder = std::move(result.ladder);
  result = std::move(rung.result);
  for (const auto& [kind, text] : rung.lines)
    if (observer.line) observer.line(kind, text);
  if (observer.placed) observer.placed(result.model, result.model.scheme);
  Stopwatch writing;
  try {
    stop_if_asked();
    if (observer.begin) observer.begin(result);
    writing = {};
    for (const KeptFrame& frame : rung.frames)
      if (observer.march.frame)
        observer.march.frame({frame.number, frame.t, frame.depth, frame.u, frame.f, frame.forces});
    if (observer.march.sample) observer.march.sample(result.history.force.back(), result.history);
  } catch (const Stopped&) {
    // The force is known, and takes a moment to write.
    result.history.interrupted = true;
    if (observer.begin) observer.begin(result);
  }
  result.image = {};
  result.solve_s += writing.seconds();
}

// Clouds from coarse to fine, until the band of one is as narrow as asked.
void climb(const Case& given, const Goal& goal, const RunObserver& observer, Result& result) {
  const Stopwatch whole;
  const Talk talk{observer, result};
  const Config& config = given.config;
  if (given.model)
    throw UsageError({.fact = "a model's files hold one cloud, and an accuracy takes several",
                      .where = "--accuracy (accuracy.goal)",
                      .why = "the surface from which clouds are made is not in them",
                      .remedy = "begin with the image: dimple run"});
  require_a_band(no_band(config));
  const Organ organ = read_organ(given, model_options(config), talk, result);
  result.followed = followed_in(config, organ);
  const Stopwatch climbing;
  std::unique_ptr<Rung> best;
  std::vector<ForceSample> coarse;
  std::string ended;  // why, if not by the goal
  // A cloud may be too coarse for its body; what two in a row meet has another reason.
  constexpr int most_failures = 2;
  int failures = 0;
  // How much of a displacement its floor is, nobody knows before.
  const Index hoped = expected_nodes(result.followed ? 0.0 : goal.share, result.facing_share, band_floor(config));
  int level = 0;
  for (Index nodes = first_rung(hoped); ended.empty();) {
    ++level;
    std::unique_ptr<Rung> rung;
    const Stopwatch marching;
    try {
      rung = march_with(nodes, given, organ, result, observer);
    } catch (const Stopped&) {
      if (!best) throw;
      ended = "the run was stopped";
      break;
    } catch (const Error& error) {
      if (stop_asked() != StopReason::none) {  // of which this is a consequence
        if (!best) throw Stopped(stop_asked());
        ended = "the run was stopped";
        break;
      }
      const bool may_be_too_coarse = (error.code == ExitCode::model || error.code == ExitCode::solve) &&
                                     error.report.code != "memory" && ++failures < most_failures;
      const bool in_time = goal.budget_s == 0.0 || whole.seconds() + 2.0 * marching.seconds() < goal.budget_s;
      if (!may_be_too_coarse || !in_time || 2 * nodes > most_nodes_for_accuracy) {
        if (!best) throw;
        ended = fmt::format("with {} nodes: {}", nodes, error.report.fact);
        break;
      }
      talk.say(fmt::format("refine   level {}, {} nodes: {}", level, nodes, error.report.fact));
      nodes *= 2;
      continue;
    }
    failures = 0;
    Result& now = rung->result;
    const std::vector<ForceSample>& force = now.history.force;
    if (!coarse.empty()) {
      now.band.half = half_widths(force, now.model.node_count(), coarse, now.model.tool.radius,
                                  !config.tissue.empty());
      now.band.unknown = "";
      now.band.coarse_nodes = best->result.model.node_count();
      if (now.followed) now.followed->half = half_of_displacement(now, best->result.followed->u);
    } else {
      now.band.unknown = "the run ended with its first cloud";
    }
    LadderStep step{.nodes = now.model.node_count(),
                    .force = force.back().force,
                    .half = now.band.known() ? now.band.half.back() : 0.0,
                    .seconds = rung->seconds};
    if (now.followed) step.length = now.followed->u.norm(), step.half_length = now.followed->half;
    result.ladder.push_back(step);
    const auto width = [&](double half, double of) {
      return now.band.known() ? " +- " + percent(half / of) : std::string();
    };
    talk.say(fmt::format("refine   level {}, {} nodes: {}{}{}, {:.1f} s", level, step.nodes,
                         force_in_words(step.force), width(step.half, std::abs(step.force)),
                         now.followed ? fmt::format(", {} mm{}", three_digits(1e3 * step.length),
                                                    width(step.half_length, step.length))
                                      : "",
                         step.seconds));
    const auto [last, half] = asked_for(step, now);
    coarse = force;
    best = std::move(rung);
    const double wanted = goal.half_width(last);
    if (best->result.band.known() && half <= wanted) break;
    const Index next = best->result.band.known() ? next_rung(nodes, half, wanted) : second_rung(nodes, hoped);
    const double expected = best->seconds * static_cast<double>(next) / static_cast<double>(nodes);
    if (goal.budget_s > 0.0 && whole.seconds() + expected > goal.budget_s)
      ended = fmt::format("{} nodes would take about {:.0f} s more, beyond the {:g} s given", next, expected,
                          goal.budget_s);
    else if (next > most_nodes_for_accuracy)
      ended = fmt::format("more than {} nodes are not tried", most_nodes_for_accuracy);
    nodes = next;
  }
  const double others_s = climbing.seconds() - best->seconds;
  if (!ended.empty() && (goal.share > 0.0 || goal.absolute > 0.0)) {
    const LadderStep& step = result.ladder.back();
    const auto [value, half] = asked_for(step, best->result);
    const double share = half / value;
    Talk{observer, best->result}.warn(
        fmt::format("the accuracy asked for, {}, was not reached: {}; {}", config.accuracy.goal,
                    best->result.band.known() ? "the error is +- " + percent(share)
                                              : "the error is unknown so far",
                    ended));
  } else if (!ended.empty()) {
    talk.say("refine   " + ended);
  }
  const Result& last = best->result;
  const Index more = nodes_for_half_the_band(last.model.node_count(), band_floor(config));
  if (last.band.known() && more <= most_nodes_for_accuracy) {
    const double more_s = best->seconds * static_cast<double>(more) / static_cast<double>(last.model.node_count());
    talk.say(fmt::format(
        "refine   {} nodes in {:.1f} s; half the error would take about {} nodes and {:.0f} s",
        last.model.node_count(), climbing.seconds(), (more + 50) / 100 * 100, more_s + climbing.seconds()));
  }
  if (goal.budget_s > 0.0)
    best->result.chosen["accuracy.budget_s"] = fmt::format(
        "another machine finds another cloud; these bits again: --budget 0 --nodes {}", best->asked);
  replay(std::move(*best), observer, result);
  result.band.seconds = others_s;
}

}  // namespace

void build_case(const Case& given, const RunObserver& observer, Result& result) {
  const Talk talk{observer, result};
  Placed placed = place(given, observer, talk, result);
  std::optional<Organ> organ = std::move(placed.organ);
  complete(given.config, std::move(placed), talk, result);
  keep_origin(given, std::move(organ), result);
}

void simulate(const Case& given, const RunObserver& observer, Result& result) {
  spread_of(given.config);  // what is wrong with it is said before anything is built
  check_loads(given.config);
  check_supports(given.config);
  if (const std::optional<Goal> goal = goal_of(given.config)) return climb(given, *goal, observer, result);
  const Talk talk{observer, result};
  const Config& config = given.config;
  Placed placed = place(given, observer, talk, result);
  std::optional<Organ> organ = std::move(placed.organ);
  if (organ) result.followed = followed_in(config, *organ);
  make_ready(given, std::move(placed), talk, result);
  stop_if_asked();
  talk.begin(Part::solving, config);
  if (observer.begin) observer.begin(result);
  if (!given.band || config.tissue.empty()) result.image = {};  // nobody needs it any longer
  Observer march = observer.march;
  const std::optional<Interpolation> place = to_followed(result);
  BendingOfPart bending(result.model);
  if (place && given.from && given.from->u.cols() > 0)
    result.followed->u = displacement_at(*place, given.from->u);  // no frame may be left
  if (given.from && given.from->f.cols() > 0)  // likewise
    feel_supports(given.from->f, given.from->history.force.back().depth, result);
  march.frame = [&](const Frame& frame) {
    if (place) result.followed->u = displacement_at(*place, frame.u);
    feel_supports(frame.f, frame.depth, result);
    bending.see(frame);
    if (observer.march.frame) observer.march.frame(frame);
  };
  std::unique_ptr<ForceSystem> system = force_system(config, result);

  if (given.band) result.band.unknown = "the run ended before";  // until find_band()
  const Stopwatch solving;
  try {
    solve(result.time, *system, result.model, result.loading, solver_options(config), march, result.history,
          given.from);
  } catch (const Stopped&) {
    result.history.interrupted = true;
  } catch (const Error&) {
    result.solve_s = solving.seconds();
    keep_findings(talk, result);  // they count also where the march ends by an error
    // What breaks while everything is being stopped is a consequence of that.
    if (stop_asked() == StopReason::none) throw;
    result.history.interrupted = true;
    return;
  }
  result.solve_s = solving.seconds();
  keep_findings(talk, result);
  warn_of_bending(talk, bending);
  system.reset();  // the band's coarser cloud needs the room
  if (!result.history.interrupted) find_band(given, organ, talk, result);
  keep_origin(given, std::move(organ), result);
}

Result simulate(const Case& given, const RunObserver& observer) {
  Result result;
  simulate(given, observer, result);
  return result;
}

}  // namespace dimple
