#include "apps/studies/explain_shift.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "apps/run/folds.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/unless_stopped.hpp"
#include "apps/run/words.hpp"
#include "apps/studies/shift_run.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/table.hpp"

namespace dimple {
namespace {

using Kind = Alternative::Kind;

constexpr double tilt_degrees_of_up = 15.0, fraction_of_fluid = 0.2, opening_mm = 5.0, gap_of_label_mm = 2.0;

struct ShiftTrial {
  std::string what, instead, all;
  Kind kind;
  Scene scene;
};

// Displacements of one shift: at the opening, and at the targets and points in depth [3 x M] mm.
struct Measured {
  double at_opening = 0.0;
  Points elsewhere;
  Points nodes;
  double base_depth = 0.0;
};

// Measures a shift. `places`: of Measured::elsewhere; if empty, they are set from this shift.
Measured measured(const Scene& scene, const ShiftScene& requested, Points& places) {
  Shifted now;
  unless_stopped([&] { find_equilibrium(scene, requested, {}, now); });
  Measured result;
  result.at_opening = now.surface_mm.col(now.largest_in(requested.opening)).norm();
  if (places.cols() == 0) {
    places.resize(3, now.line.cols() + static_cast<Index>(requested.targets.size()));
    for (Index k = 0; k < places.cols(); ++k)
      places.col(k) = k < now.line.cols() ? Vec3(now.line.col(k))
                                          : requested.targets[static_cast<std::size_t>(k - now.line.cols())];
  }
  result.elsewhere = now.at(places);
  result.nodes = now.result.model.X;
  result.base_depth = now.result.report.boundary.base_depth;
  return result;
}

std::string side_of(const Vec3& v) {
  static constexpr std::array<std::array<const char*, 2>, 3> names = {
      {{"right", "left"}, {"anterior", "posterior"}, {"inferior", "superior"}}};
  Index axis = 0;
  v.cwiseAbs().maxCoeff(&axis);
  return names[static_cast<std::size_t>(axis)][v[axis] > 0.0 ? 1 : 0];
}

Scene::Wall& skull_in(Scene& scene) {
  return *std::find_if(scene.walls.begin(), scene.walls.end(),
                       [](const Scene::Wall& wall) { return wall.name == skull_name; });
}

class Trials {
 public:
  Trials(const Scene& scene, const ShiftScene& requested, const ShiftOptions& options, double base_depth)
      : unchanged_(scene), requested_(requested), options_(options) {
    discretisation();
    skull();
    load();
    body(base_depth);
  }
  std::vector<ShiftTrial> list;

 private:
  template <class Change>
  void add(const char* what, const std::string& all, const std::string& instead, Kind kind,
           const Change& change) {
    ShiftTrial trial{what, instead, all.empty() ? instead : all, kind, unchanged_};
    change(trial.scene);
    list.push_back(std::move(trial));
  }

  void discretisation() {
    for (const int more : {1, 2})
      add("cloud", "two other random node sets",
          fmt::format("seed {} instead of {}", unchanged_.node_set.seed + more, unchanged_.node_set.seed),
          Kind::node_set, [&](Scene& c) { c.node_set.seed += more; });
    add("number of nodes", "",
        fmt::format("{} instead of {}", 2 * unchanged_.node_set.nodes, unchanged_.node_set.nodes),
        Kind::node_set, [](Scene& c) { c.node_set.nodes *= 2; });
  }

  void skull() {
    const bool derived = options_.skull == "derived";
    const double gap = gap_of_skull(options_);
    if (derived)
      for (const double other : {0.5 * gap, 2.0 * gap})
        add("gap",
            fmt::format("{} or {} mm instead of {} mm", plain(0.5 * gap), plain(2.0 * gap), plain(gap)),
            fmt::format("{} mm instead of {} mm", plain(other), plain(gap)), Kind::doubt,
            [&](Scene& c) { skull_in(c).around = 1e-3 * other; });
    else
      for (const double other : {0.0, gap_of_label_mm})
        add("gap", fmt::format("0 or {} mm at the nearest place", plain(gap_of_label_mm)),
            fmt::format("{} mm at the nearest place", plain(other)), Kind::doubt,
            [&](Scene& c) { skull_in(c).gap = 1e-3 * other; });
    add("friction at the skull", "", "0.3 instead of none", Kind::doubt,
        [](Scene& c) { skull_in(c).friction = 0.3; });
    const Eigen::Vector4d& o = requested_.opening;
    for (const double sign : {1.0, -1.0}) {
      const double radius = std::max(o[3] + sign * opening_mm, 0.5 * o[3]);
      add("opening", fmt::format("radius {} mm larger or smaller", plain(opening_mm)),
          fmt::format("radius {} mm instead of {} mm", plain(radius), plain(o[3])), Kind::doubt,
          [&](Scene& c) { skull_in(c).opening = Eigen::Vector4d(o[0], o[1], o[2], radius); });
    }
  }

  void load() {
    const Scene::Fluid fluid = unchanged_.fluid_lost.value();
    for (const double sign : {1.0, -1.0}) {
      const double fraction = std::clamp(fluid.fraction + sign * fraction_of_fluid, 0.05, 1.0);
      if (fraction == fluid.fraction) continue;
      add("fluid lost", fmt::format("{:g} points more or less of the height", 100.0 * fraction_of_fluid),
          fmt::format("{:.0f} % instead of {:.0f} %", 100.0 * fraction, 100.0 * fluid.fraction), Kind::doubt,
          [&](Scene& c) { c.fluid_lost->fraction = fraction; });
    }
    Index axis = 0;
    fluid.up.cwiseAbs().minCoeff(&axis);
    const Vec3 u = (Vec3::Unit(axis) - fluid.up[axis] * fluid.up).normalized(), v = fluid.up.cross(u);
    const double angle = tilt_degrees_of_up * std::numbers::pi / 180.0;
    for (const Vec3& displacement : {u, Vec3(-u), v, Vec3(-v)})
      add("direction of up", fmt::format("tilted by {:g} degrees in four directions", tilt_degrees_of_up),
          fmt::format("tilted by {:g} degrees, {}", tilt_degrees_of_up, side_of(displacement)), Kind::doubt,
          [&](Scene& c) {
            c.fluid_lost->up = (std::cos(angle) * fluid.up + std::sin(angle) * displacement).normalized();
          });
  }

  void body(double base_depth) {
    if (unchanged_.material.preset == "none")
      for (const double factor : {0.5, 2.0})
        add("shear modulus", "half or twice",
            fmt::format("{} instead of {}", stress_in_words(factor * unchanged_.material.mu_Pa),
                        stress_in_words(unchanged_.material.mu_Pa)),
            Kind::doubt, [&](Scene& c) { c.material.mu_Pa *= factor; });
    for (const double factor : {0.5, 1.5})
      add("held part",
          fmt::format("{:.1f} or {:.1f} mm instead of {:.1f} mm", 0.5 * base_depth, 1.5 * base_depth,
                      base_depth),
          fmt::format("held to {:.1f} mm instead of {:.1f} mm", factor * base_depth, base_depth), Kind::doubt,
          [&](Scene& c) { c.boundary.base_depth_mm = factor * base_depth; });
    if (!(unchanged_.image.close_mm > 0.0)) return;
    const std::string all = fmt::format("open instead of filled below {} mm, with contact or without",
                                        plain(unchanged_.image.close_mm));
    for (const bool indenter : {false, true})
      add("sulci", all,
          indenter ? "open, with contact of their walls" : "open, and their walls pass through each other",
          Kind::doubt, [indenter](Scene& c) {
            c.image.close_mm = 0.0;
            c.self_contact = indenter ? Scene::SelfContact::on : Scene::SelfContact::off;
          });
  }

  const Scene& unchanged_;
  const ShiftScene& requested_;
  const ShiftOptions& options_;
};

double farthest(const Points& a, const Points& b) {
  return a.cols() > 0 && a.cols() == b.cols() ? (a - b).colwise().norm().maxCoeff() : 0.0;
}

double threshold_of(const ShiftExplanation& e) {
  return std::max(e.noise_mm, least_effect * e.shift_mm);
}

std::string verdict_of(const ShiftExplanation& e, const Alternative& a) {
  if (!a.failed.empty()) return "no shift: " + a.failed;
  return std::abs(a.effect) > threshold_of(e) ? "matters" : "no matter";
}

// Reference of the changes: the shift with the same nodes, or the mean over the node sets so far.
struct Reference {
  Measured as_it_is;
  double mean = 0.0;
  Points mean_elsewhere;
  int node_sets = 1;
};

void compare(const Measured& now, const ShiftTrial& trial, Reference& reference, Alternative& alternative,
             ShiftExplanation& e) {
  const Points& nodes = reference.as_it_is.nodes;
  const bool same = trial.kind == Kind::node_set || (now.nodes.cols() == nodes.cols() && now.nodes == nodes);
  alternative.effect = now.at_opening - (same ? reference.as_it_is.at_opening : reference.mean);
  alternative.elsewhere =
      farthest(now.elsewhere, same ? reference.as_it_is.elsewhere : reference.mean_elsewhere);
  if (trial.kind == Kind::node_set) e.noise_mm = std::max(e.noise_mm, std::abs(alternative.effect));
  if (trial.what != "cloud") return;
  ++reference.node_sets;
  reference.mean += (now.at_opening - reference.mean) / reference.node_sets;
  reference.mean_elsewhere += (now.elsewhere - reference.mean_elsewhere) / reference.node_sets;
}

}  // namespace

ShiftExplanation explain_shift(const Scene& scene, const ShiftOptions& options,
                               const std::function<void(const std::string&)>& progress) {
  const Stopwatch whole;
  const ShiftScene requested = scene_of(options);
  ShiftExplanation e;
  e.nodes = scene.node_set.nodes;
  Reference reference;
  Points places(3, 0);
  reference.as_it_is = measured(scene, requested, places);
  e.seconds = whole.seconds();
  reference.mean = e.shift_mm = reference.as_it_is.at_opening;
  reference.mean_elsewhere = reference.as_it_is.elsewhere;
  const Trials trials(scene, requested, options, reference.as_it_is.base_depth);
  try {
    for (const ShiftTrial& trial : trials.list) {
      Alternative alternative{trial.what, trial.instead, trial.all, trial.kind};
      const Stopwatch trying;
      try {
        compare(measured(trial.scene, requested, places), trial, reference, alternative, e);
      } catch (const Stopped&) {
        throw;
      } catch (const Error& error) {
        alternative.failed = error.report.fact;
      }
      alternative.seconds = trying.seconds();
      if (progress)
        progress(fmt::format(
            "explain  {}, {}: {}, {:.1f} s", trial.what, trial.instead,
            alternative.failed.empty() ? with_sign(alternative.effect) + " mm" : alternative.failed,
            alternative.seconds));
      e.alternatives.push_back(std::move(alternative));
    }
  } catch (const Stopped& stopped) {
    if (e.alternatives.empty()) throw;
    e.ended_by = stopped.report.fact;
  }
  e.total_s = whole.seconds();
  return e;
}

void write_explanation(const std::filesystem::path& folder, const ShiftExplanation& e,
                       const std::string& subject) {
  const double least = threshold_of(e);
  const std::string unchanged =
      fmt::format("largest shift at the opening {} with {} nodes", length_in_words(e.shift_mm), e.nodes);
  ChoiceTable table{
      .text = fmt::format("{}: {}, in {:.1f} s. Each line repeats that shift with one choice changed. "
                          "Changes below {} are negligible: other node sets, also with twice as many nodes, "
                          "change the largest shift at the opening by up to {}. elsewhere_mm of explain.csv "
                          "is the largest change of a displacement at the targets and in depth.\n\n",
                          subject, unchanged, e.seconds, length_in_words(least), length_in_words(e.noise_mm)),
      .effect = "change of the shift, mm",
      .csv_header = "choice,instead,kind,change_mm,elsewhere_mm,wall_s,verdict",
      .title = fmt::format("What the shift depends on: {}", subject),
      .subtitle = {fmt::format("{}; each bar repeats that shift with one choice changed; {:.0f} s in all",
                               unchanged, e.total_s)},
      .axis = "change of the largest shift at the opening [mm]",
      .shade = least,
      .shade_text = fmt::format("below {}: negligible", length_in_words(least))};
  if (!e.ended_by.empty()) table.text = "Some choices are missing: " + e.ended_by + ".\n\n" + table.text;
  std::vector<Alternative> sorted = e.alternatives;
  sort_by_effect(sorted);
  for (const Alternative& a : sorted) {
    const bool there = a.failed.empty();
    table.rows.push_back(
        {.what = a.what,
         .instead = a.instead,
         .all = a.all,
         .kind = a.kind,
         .effect = there ? std::optional(a.effect) : std::nullopt,
         .csv = fmt::format("{},{},{},{},{},{:.3g},{}", csv_field(a.what), csv_field(a.instead),
                            word_of(a.kind), there ? fmt::format("{:.4g}", a.effect) : "",
                            there ? fmt::format("{:.4g}", a.elsewhere) : "", a.seconds,
                            csv_field(verdict_of(e, a))),
         .verdict = verdict_of(e, a),
         .seconds = a.seconds});
  }
  write_choices(folder, table);
}

}  // namespace dimple
