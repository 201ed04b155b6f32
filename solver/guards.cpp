#include "solver/guards.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>

#include "solver/text.hpp"

// Guards, in the order of a run:
// 1. Before loading, check_model(): moment matrices, enlarged supports, number of nodes in the bonded patch.
// 2. Every sweep, check_sweep(): J is finite, and positive if the energy needs it.
// 3. At samples and equilibria, check_nodes() and check_points(): finite values, the tool within the body,
//    volumes of inverted points, of points without stress and of changed volume.
// 4. Contact, check_contact(), check_wall(), check_apart(): penetration between samples, tools that overlap.
// 5. Energies, check_energy(), check_kinetic(): balance, and vibration under a slow load.
// 6. Modes without resistance, check_hourglass(), check_fluctuation(); noise of the force, check_smooth().
// 7. A wrong result throws, and the march retries from its last good state; a doubtful one leaves a finding.
//
// Source:   Ganzenmueller 2015 (check_fluctuation). All other limits are measured here, see their constants.

namespace dimple {
namespace {

constexpr double wall_poor = 0.15;  // of the node spacing: penetration into a wall

using Nodal = ForceSystem::Nodal;

// Moment matrices are refused at 1e-5 (MlsResult::ok); default discretisations stay above 1e-4.
constexpr double poor_pivot = 3e-5;
constexpr double linear_noise = 1e-9,
                 linear_wrong = 1e-6;  // of gradients of linear fields: rounding is 1e-14
constexpr double many_grown = 0.02;    // of the points
constexpr double accuracy = 0.05;      // of the force; the atlas uses it, too
// Volume fractions. At a sharp edge the strain is unbounded: with every fine discretisation tens of points
// there, 1e-5 of the volume, are inverted, and the force stays within 1 % of the reference.
constexpr double inverted_wrong = 0.01, inverted_minor = 1e-4;
constexpr double nearly_incompressible = 20.0;  // kappa / mu: nu 0.475
constexpr double far_from_1 = 0.3;              // |J - 1|; patches hold their volume, points only nearly
constexpr double volume_poor = 0.01, volume_wrong = 0.2;
constexpr double energy_poor = 0.02, energy_wrong = 0.1;  // of the largest external work; usual: 1e-4
constexpr double energy_floor = 1e-9;                     // J: a thousandth of a shallow indentation's
constexpr double kinetic_poor = 0.05;                     // of the stored energy, after a fifth of the load
// Median of |second differences| of `jagged_samples` samples over the largest force. Usual: 3e-4 to 1e-3;
// 0.25 with steps of 0.98 of the stable one, whose noise holds 0.4 % of the energy, in the few nodes of the
// bonded patch.
constexpr double jagged_poor = 0.03;
constexpr std::size_t jagged_samples = 15;
// Multiple of `most_penetration`. A punch of 5 mm with an edge of 1 mm and 0.03 radii of penetration had a
// force within 1 % of finite elements.
constexpr double penetration_wrong = 50.0;
// Largest force error by penetration for a minor finding, as a fraction; the error bounds are as wide.
// Spheres at their defaults have 3 to 10 %, and forces within 2.5 % of Hertz.
constexpr double penetration_poor = 0.1;
constexpr double hourglass_poor = 0.15;  // of the stored energy; usual: 0.02 to 0.05
// Fluctuation energy over the stored energy. In the paper's scheme on the block at 8 mm: 0.4 with 4.5 points
// a node, 1.2 with its 1.5, and 19 with supports of 2.5 spacings, whose force is a third. A bonded patch of
// three nodes has 5 from first contact on.
constexpr double fluctuation_poor = 1.5, fluctuation_wrong = 10.0;
// Nodal parameters are somewhat longer than displacements under a contacting tool.
constexpr double longer_than_displacement = 1.25;

std::string in_mm(const Vec3& metres) {
  const Vec3 x = metres * 1e3;
  return text("(", fixed(x.x(), 2), ", ", fixed(x.y(), 2), ", ", fixed(x.z(), 2), ") mm");
}

std::string moment(const Moment& now) {
  std::string result = text("solver, t = ", now.t, " s, indentation ", now.depth * 1e3, " mm");
  if (now.dt > 0.0) result += text("; step ", 1e6 * now.dt, " us");
  if (now.dt_stable > 0.0) result += text(", stable ", 1e6 * now.dt_stable, " us");
  return result;
}

}  // namespace

std::vector<Finding> check_model(const Model& model, const SupportReport& support, double depth) {
  std::vector<Finding> findings;
  const auto at = [&](Index q) {
    return q < 0 ? std::string("support domains")
                 : text("support domains; point ", q, " at rest at ", in_mm(model.point.col(q)));
  };
  if (!(support.linear_error < linear_wrong))
    throw ModelError({.fact = text("gradients of linear fields are wrong by ", support.linear_error),
                      .where = at(support.worst_pivot_at),
                      .why = text("a moment matrix is nearly singular (pivot ratio ",
                                  support.worst_pivot_ratio, "): the nodes around it are nearly in a plane"),
                      .remedy = "raise support.radius_factor, or use more nodes (--nodes)",
                      .code = "conditioning"});
  if (support.worst_pivot_ratio < poor_pivot || support.linear_error > linear_noise)
    findings.push_back(
        {{.fact = text("a moment matrix is badly conditioned: pivot ratio ", support.worst_pivot_ratio,
                       ", linear fields within ", support.linear_error),
          .where = at(support.worst_pivot_at),
          .why = "the nodes around it are nearly in a plane or on a line",
          .remedy = "raise support.radius_factor, or use more nodes (--nodes)",
          .code = "conditioning"},
         support.worst_pivot_ratio});
  if (const double fraction = static_cast<double>(support.grown) / static_cast<double>(model.point_count());
      fraction > many_grown)
    findings.push_back(
        {{.fact = text(support.grown, " supports had to be enlarged, by up to ", support.largest_growth,
                       ", to hold enough nodes: ", percent(fraction), " of the points"),
          .where = at(support.fewest_at),
          .why = text("the nodes are sparse, or the body is thin compared with its supports; one point has ",
                      support.fewest, " nodes"),
          .remedy = "raise support.radius_factor, or use more nodes (--nodes)",
          .code = "supports"},
         fraction});
  // On the verification block 29, 33, 49, 63, 99 and 167 nodes in the bonded patch gave forces 45, 23, 12, 8,
  // 4 and 1 % too large at a depth of 1.6 radii, and a quarter of that at first contact.
  const auto nodes = static_cast<double>(model.bonded_patch.size());
  if (model.bonded_patch.empty()) return findings;  // a contacting tool
  const double deep = std::min(depth / (1.6 * model.tool.radius), 1.0);
  const double error = 0.04 * std::pow(99.0 / std::max(nodes, 1.0), 1.6) * (0.25 + 0.75 * deep * deep);
  if (error > accuracy)
    findings.push_back(
        {{.fact = text("only ", nodes, " nodes are under the contact patch: the force may be off by ",
                       error < 0.5 ? "about " + percent(error) : "half or more"),
          .where = text("contact patch at ", in_mm(model.tool.centre), ", ", 2e3 * model.tool.radius,
                        " mm across, to a depth of ", 1e3 * depth, " mm"),
          .why = "on the verification block this number of nodes gives such an error",
          .remedy = text("use more nodes (--nodes) or a finer --rim; for ", percent(accuracy), " use about ",
                         std::ceil(nodes * std::pow(error / accuracy, 1.0 / 1.6)), " nodes there"),
          .code = "circle-nodes"},
         nodes});
  return findings;
}

Guards::Guards(System& system, bool static_answer, bool on, std::vector<Finding>& findings)
    : forces_(system.tissue()),
      model_(system.model()),
      static_answer_(static_answer),
      on_(on),
      findings_(findings),
      beneath_((model_.X.transpose() * model_.tool.approach).maxCoeff() -
               model_.tool.centre.dot(model_.tool.approach)) {}

// One finding for each code, that with the worst value; only that of `inverted`, J_min, falls. Points without
// stress count in the last state.
void Guards::find(Finding finding) {
  const auto same = std::find_if(findings_.begin(), findings_.end(),
                                 [&](const Finding& f) { return f.report.code == finding.report.code; });
  if (same == findings_.end())
    findings_.push_back(std::move(finding));
  else if (finding.report.code == "inverted"
               ? finding.worst < same->worst
               : finding.worst > same->worst || finding.report.code == no_stress)
    *same = std::move(finding);
}

void Guards::check_sweep(const ForceSystem::Sweep& sweep, const Moment& now) const {
  if (sweep.ok()) return;
  const std::string where =
      moment(now) + text("; point at rest at ", in_mm(model_.point.col(std::max<Index>(sweep.point, 0))));
  if (!std::isfinite(sweep.J_min))
    throw SolveError({.fact = text("the displacement is not finite at integration point ", sweep.point),
                      .where = where,
                      .why = "the time step is too long, or the load too large for these nodes",
                      .remedy = "use a smaller solver.safety, more nodes (--nodes), or a smaller --depth",
                      .code = "non-finite"});
  throw SolveError(
      {.fact = text("the tissue was inverted: det F = ", sweep.J_min, " at integration point ", sweep.point),
       .where = where,
       .why = "the load is too large for these nodes, or the time step too long",
       .remedy = "use more nodes (--nodes), a smaller --depth, or a smaller solver.safety",
       .code = "inverted"});
}

void Guards::check_nodes(const Nodal& u, const Nodal& f, const Moment& now) const {
  if (on_ && now.depth >= beneath_)
    throw SolveError({.fact = text("the tool has passed the far side of the body, ", 1e3 * beneath_,
                                   " mm beneath the contact patch: the tissue between is inverted"),
                      .where = moment(now),
                      .why = "the depth exceeds the body's thickness; integration points may not show it",
                      .remedy = "use a smaller --depth",
                      .code = "inverted"});
  if (!on_ || (std::isfinite(u.sum()) && std::isfinite(f.sum()))) return;
  for (Index a = 0; a < u.cols(); ++a)
    for (int i = 0; i < 3; ++i)
      if (!std::isfinite(u(i, a)) || !std::isfinite(f(i, a)))
        throw SolveError({.fact = text("the ", std::isfinite(u(i, a)) ? "force on" : "displacement of",
                                       " node ", a, " along ", "xyz"[i], " is not finite"),
                          .where = moment(now) + text("; node at rest at ", in_mm(model_.X.col(a))),
                          .why = "the time step is too long, or the load too large for these nodes",
                          .remedy = "use a smaller solver.safety, more nodes (--nodes), or a smaller --depth",
                          .code = "non-finite"});
}

namespace {

Finding without_stress(Index count, Index of, double fraction, double J_min, const std::string& where) {
  return {
      {.fact = text(count, " of ", of, " integration points ", count == 1 ? "has" : "have", " det F below ",
                    least_J_of_stress, ", ", percent(fraction), " of the volume; smallest det F ", J_min),
       .where = where,
       .why = "the strain at a sharp edge is unbounded, beyond the range of the material law",
       .remedy = "keep the force; stresses are not finite at these points; more nodes or a smaller --depth "
                 "reduce their number",
       .code = no_stress},
      static_cast<double>(count),
      fraction < inverted_minor};
}

Report of_inverted(Index inverted, double fraction, const ForceSystem::Sweep& sweep, const Model& model,
                   const Moment& now) {
  const Vec3 x = model.point.col(sweep.point);
  return {.fact = text(inverted, " of ", model.point_count(), " integration points ",
                       inverted == 1 ? "is" : "are", " inverted, ", percent(fraction),
                       " of the volume; smallest det F ", sweep.J_min),
          .where = moment(now) + text("; worst point at rest at ", in_mm(x), ", ",
                                      1e3 * (x - model.tool.centre).norm(),
                                      " mm from the centre of the contact patch"),
          .why = "the strain at a sharp edge is unbounded; so small a volume does not affect the force",
          .remedy = text("keep the force; no stress is given where det F is below ", least_J_of_stress),
          .code = "inverted"};
}

}  // namespace

void Guards::check_points(const ForceSystem::Sweep& sweep, const Moment& now) {
  if (!on_) return;
  const Tissues& tissues = forces_.system().tissues();
  Index inverted = 0, crushed = 0, far = 0, furthest = -1;
  double inverted_volume = 0.0, crushed_volume = 0.0, far_volume = 0.0, whole = 0.0, largest = 0.0;
  for (Index q = 0; q < model_.point_count(); ++q) {
    const double e = forces_.dilation(q), V = model_.volume[q];
    whole += V;
    if (e <= -1.0) {
      ++inverted;
      inverted_volume += V;
    }
    if (e < least_J_of_stress - 1.0) {
      ++crushed;
      crushed_volume += V;
    }
    if (std::abs(e) <= far_from_1) continue;
    const Material& m = tissues.material[static_cast<std::size_t>(tissues.of_point[q])];
    if (m.kappa < nearly_incompressible * m.mu) continue;
    ++far;
    far_volume += V;
    if (std::abs(e) > largest) {
      largest = std::abs(e);
      furthest = q;
    }
  }
  if (const double fraction = inverted_volume / whole; inverted > 0) {
    Report report = of_inverted(inverted, fraction, sweep, model_, now);
    if (fraction > inverted_wrong) {
      report.why = "the load is too large for these nodes: the sharp edge alone inverts less";
      report.remedy =
          "use more nodes (--nodes), shorter steps of the load (--set solver.step_radii=0.05), or a smaller "
          "--depth";
      throw SolveError(report);
    }
    find({report, sweep.J_min, fraction < inverted_minor});
  }
  if (crushed == 0)
    std::erase_if(findings_, [](const Finding& before) { return before.report.code == no_stress; });
  else
    find(without_stress(crushed, model_.point_count(), crushed_volume / whole, sweep.J_min, moment(now)));
  if (const double fraction = far_volume / whole; fraction > volume_poor) {
    Report report = {
        .fact = text("nearly incompressible tissue changes its volume by more than ", percent(far_from_1),
                     " at ", far, " points, ", percent(fraction), " of the volume; most at one: det F ",
                     1.0 + forces_.dilation(furthest)),
        .where = moment(now) + text("; that point at rest at ", in_mm(model_.point.col(furthest))),
        .why = "the nodes are too coarse there for bending at constant volume",
        .remedy = "use more nodes (--nodes), a smaller --depth, or weaker loads where they bend it",
        .code = "volume"};
    if (fraction > volume_wrong) throw SolveError(report);
    find({report, fraction});
  }
}

void Guards::check_energy(const EnergySample& e, double largest_external, double duration, bool conserves,
                          const Moment& now, bool warns_alone) {
  if (!std::isfinite(e.kinetic) || !std::isfinite(e.stored))
    throw SolveError({.fact = "the energy is not finite",
                      .where = moment(now),
                      .why = "the time integration is unstable",
                      .remedy = "use a smaller solver.safety, for instance --set solver.safety=0.6",
                      .code = "non-finite"});
  // The printed stress has no energy; the dissipation of viscoelastic tissue is not computed.
  if (!forces_.system().as_printed() && !forces_.system().viscoelastic()) {
    const double error = e.error(), scale = largest_external;
    const bool gain = error < 0.0;
    Report report = {
        .fact = text(
            gain ? "energy balance violated (energy gained)" : "energy balance violated (energy lost)",
            ": the tool did ", 1e6 * e.external, " uJ of work, the tissue holds ",
            1e6 * (e.kinetic + e.stored), " uJ",
            e.dissipated != 0.0 ? text(", and ", 1e6 * e.dissipated, " uJ was dissipated by friction") : ""),
        .where = moment(now),
        .why =
            now.dt_stable > 0.0
                ? "the time integration is unstable"
                : "the steps are too long to follow the path, or the tissue passed a limit point between two",
        .remedy = now.dt_stable > 0.0 ? "use a smaller solver.safety, for instance --set solver.safety=0.6"
                                      : "use shorter steps: --set solver.step_radii=0.05",
        .code = "energy"};
    // Central differences gain energy only by instability. It begins in the few nodes of the bonded patch,
    // long before the whole body shows it.
    const double wrong = gain && now.dt_stable > 0.0 ? energy_poor : energy_wrong;
    if (std::abs(error) > wrong * scale + energy_floor && (gain || conserves) && !warns_alone)
      throw SolveError(report);
    if (on_ && std::abs(error) > energy_poor * scale + energy_floor)
      find({report, std::abs(error) / std::max(scale, 1e-300)});
  }
  if (!should_be_static(now, duration)) return;
  if (const double ratio = e.kinetic / std::max(e.stored, 1e-300); ratio > kinetic_poor)
    find({{.fact = text("the body still vibrates: its kinetic energy is ", percent(ratio), " of the stored"),
           .where = moment(now),
           .why = "the load lasts long enough for a static answer, but nothing or little damps the waves",
           .remedy = "use --damping, for instance --damping 20, a smaller --rate, or --time quasi-static",
           .code = "kinetic"},
          ratio});
}

bool Guards::should_be_static(const Moment& now, double duration) const {
  return on_ && static_answer_ && now.t >= 0.2 * duration;
}

void Guards::check_smooth(const std::vector<double>& force, double largest, double duration,
                          const Moment& now) {
  if (!should_be_static(now, duration)) return;
  double worst = 0.0;
  for (std::size_t first = 0; first + jagged_samples + 2 <= force.size(); ++first) {
    std::array<double, jagged_samples> bend;
    for (std::size_t k = 0; k < jagged_samples; ++k)
      bend[k] = std::abs(force[first + k] - 2.0 * force[first + k + 1] + force[first + k + 2]);
    std::nth_element(bend.begin(), bend.begin() + jagged_samples / 2, bend.end());
    worst = std::max(worst, bend[jagged_samples / 2] / largest);
  }
  if (worst > jagged_poor)
    find({{.fact = text("the force jumps from sample to sample, by ", percent(worst), " of the largest"),
           .where = moment(now),
           .why =
               "the load lasts long enough for a static answer, but short waves ring in the nodes under the "
               "tool: nothing damps them, or the time step is close to the stable one",
           .remedy =
               "use --damping, for instance --damping 20, a smaller solver.safety, or --time quasi-static",
           .code = "jagged"},
          worst});
}

void Guards::check_kinetic(double kinetic, double external, const Moment& now) const {
  if (!on_ || forces_.system().as_printed() || kinetic <= 1.5 * external + energy_floor) return;
  throw SolveError({.fact = text("energy balance violated: the tool did ", 1e6 * external,
                                 " uJ of work, the kinetic energy alone is ", 1e6 * kinetic, " uJ"),
                    .where = moment(now),
                    .why = "the time integration is unstable",
                    .remedy = "use a smaller solver.safety, for instance --set solver.safety=0.6",
                    .code = "energy"});
}

void Guards::check_hourglass(double hourglass, double stored, const Moment& now) {
  if (!on_ || !(stored > energy_floor) || hourglass <= hourglass_poor * stored) return;
  find({{.fact = text(percent(hourglass / stored),
                      " of the stored energy is in modes that the cells' mean gradients do not resolve"),
         .where = moment(now),
         .why = "displacements vary within a cell as much as from cell to cell: the nodes are too coarse for "
                "this load",
         .remedy = "use more nodes (--nodes) or more points (--set grid.ratio)",
         .code = "hourglass"},
        hourglass / stored});
}

void Guards::check_fluctuation(const Nodal& u, const Moment& now) {
  if (!on_ || !model_.variance.empty() || now.depth <= 0.0) return;
  const double stored = forces_.stored_energy(u);
  const auto F = forces_.deformation_gradients();
  const Tissues& tissues = forces_.system().tissues();
  double energy = 0.0;
  for (Index q = 0; q < model_.point_count(); ++q) {
    const auto nodes = model_.support.member.segment(model_.support.offset[q], model_.support.count(q));
    Vec3 x = Vec3::Zero(), v = x;
    for (const int a : nodes) {
      x += model_.X.col(a);
      v += u.col(a).head<3>();
    }
    x /= static_cast<double>(nodes.size());
    v /= static_cast<double>(nodes.size());
    const Mat3 H = Eigen::Map<const Mat3>(F.col(q).data()) - Mat3::Identity();
    double off = 0.0, size = 0.0;
    for (const int a : nodes) {
      const Vec3 away = model_.X.col(a) - x;
      off += (u.col(a).head<3>() - v - H * away).squaredNorm();
      size += away.squaredNorm();
    }
    const double mu = tissues.material[static_cast<std::size_t>(tissues.of_point[q])].mu;
    energy += model_.volume[q] * 1.5 * mu * off / size;
  }
  const double fraction = energy / std::max(stored, 1e-300);
  if (fraction <= fluctuation_poor) return;
  Report report = {
      .fact = text("nodal displacements that integration points do not resolve would hold ", fraction,
                   " times the stored energy"),
      .where = moment(now),
      .why = "too few points or too wide supports leave modes without stiffness: the force is too low",
      .remedy =
          "use more points (--set grid.ratio=4.5), supports of 1.8 spacings or less, more nodes (--nodes), "
          "or "
          "leave out --scheme horton2007",
      .code = "hourglass"};
  if (fraction > fluctuation_wrong) throw SolveError(report);
  find({report, fraction});
}

namespace {

std::optional<Report> overlap_of(const ToolNow& one_now, const ToolNow& other_now) {
  constexpr double more_than_contact = 1e-3;  // of the smaller radius; a blade may be thin
  const RigidBody &one = one_now.body, &other = other_now.body;
  const std::optional<Vec3> place =
      place_in_both(one.shape, one_now.pose, other.shape, other_now.pose,
                    more_than_contact * std::min(one.shape.radius, other.shape.radius));
  if (!place) return std::nullopt;
  const auto name = [](const RigidBody& body) { return body.name.empty() ? std::string("tool") : body.name; };
  return Report{
      .fact = text("the tools '", name(one), "' and '", name(other), "' would both be at ", in_mm(*place)),
      .where = text("tool.", other.name),
      .why = "both are rigid, and cannot pass through each other",
      .remedy = text("keep them apart: tool.", other.name, ".at_mm, direction and move_mm, or smaller tools"),
      .code = tools_overlap};
}

}  // namespace

std::optional<Report> overlap_of_tools(const std::vector<ToolNow>& tools) {
  for (std::size_t k = 0; k < tools.size(); ++k)
    for (std::size_t l = 0; l < k; ++l)
      if (std::optional<Report> report = overlap_of(tools[l], tools[k])) return report;
  return std::nullopt;
}

void Guards::check_contact(const RigidContact::Audit& audit, double most, const RigidBody& body,
                           const Moment& now) {
  if (audit.beyond > most)
    throw SolveError(
        {.fact = text("the tool penetrates ", 1e3 * audit.beyond,
                      " mm into a part of the surface without contact points"),
         .where =
             moment(now) + text("; that part at rest at ", in_mm(body.surface.beyond.col(audit.beyond_at))),
         .why = "contact points are near the tool's axis, to half its radius or the depth beyond it, on "
                "surface that faces the tool: the tool has passed through thin tissue, reached the base or a "
                "fold, or was moved or turned beyond them",
         .remedy = "use a smaller --depth, a smaller tool, or a place further from folds and edges "
                   "(--indent-at)",
         .code = "contact-surface"});
  if (!on_ || audit.penetration <= most) return;
  const double off = now.depth > 0.0 ? off_by_penetration(audit.penetration, now.depth) : 0.0;
  Report report = {.fact = text("the body's surface penetrates ", fixed(1e3 * audit.penetration, 4),
                                " mm into the tool between contact points"),
                   .where = moment(now),
                   .why = text("the nodes under the tool are too far apart for its shape",
                               now.depth > 0.0 ? text("; the force may be off by up to ", percent(off)) : ""),
                   .remedy = "use more nodes (--nodes), a smaller --depth, or a tool with a rounder edge",
                   .code = "penetration"};
  const bool is_minor = now.depth > 0.0 && off <= penetration_poor;
  if (audit.penetration <= penetration_wrong * most) return find({report, audit.penetration, is_minor});
  const auto before = std::find_if(findings_.begin(), findings_.end(),
                                   [](const Finding& f) { return f.report.code == "penetration"; });
  // Penetration by coarse nodes grows with the depth; a surface that folds penetrates at once, with more
  // nodes too.
  const bool has_edge = body.shape.edge > 0.0 || body.shape.mesh;
  if (has_edge && body.friction == 0.0 && before != findings_.end() &&
      audit.penetration > 2.0 * before->worst) {
    report.why = text("it was ", fixed(1e3 * before->worst, 4),
                      " mm before: without friction the surface has folded at an edge of the tool");
    report.remedy =
        "use friction (--friction 0.3, or stick), round the tool's edge, or use a smaller --depth";
  }
  throw SolveError(report);
}

void Guards::check_apart(const std::vector<ToolNow>& tools, const Moment& now) const {
  if (!on_) return;
  std::optional<Report> report = overlap_of_tools(tools);
  if (!report) return;
  report->where = moment(now);
  throw SolveError(*std::move(report));
}

void Guards::check_wall(const RigidBody& wall, double penetration, bool has_contact, const Moment& now) {
  const double spacing = wall.surface.count() > 0 ? wall.surface.spacing.mean() : 0.0;
  const bool is_tool = wall.is_tool;
  if (!on_ || penetration <= (is_tool ? most_penetration * wall.shape.radius : wall_poor * spacing)) return;
  const Report report = {
      .fact = text("the body's surface penetrates ", fixed(1e3 * penetration, is_tool ? 4 : 2),
                   " mm into the ", is_tool ? "tool" : "wall", " '", wall.name, "' between contact points"),
      .where = moment(now),
      .why = text("nodes are ", fixed(1e3 * spacing, 1),
                  " mm apart there, and the load bends the surface between them"),
      .remedy = is_tool ? "use more nodes (--nodes), or a smaller load; a model must be made with "
                          "all of its tools"
                        : "use more nodes (--nodes), or a smaller load",
      .code = is_tool ? "tool-penetration" : "wall-penetration"};
  if (is_tool && !has_contact && penetration > penetration_wrong * most_penetration * wall.shape.radius)
    throw SolveError(report);
  find({report, penetration});
}

void Guards::found_limit_point(const Nodal& jump, double distance, bool folds_make_contact,
                               const Moment& now) {
  Index furthest = 0;
  const Eigen::RowVectorXd size = jump.colwise().norm();
  const double largest = size.maxCoeff(&furthest);
  if (!on_ || largest <= longer_than_displacement * distance ||
      std::any_of(findings_.begin(), findings_.end(),
                  [](const Finding& f) { return f.report.code == "limit-point"; }))
    return;
  find({{.fact = text("the tissue passed a limit point at ", fixed(1e3 * now.depth, 2),
                      " mm: a node moved by ", fixed(1e3 * largest, largest < 1e-5 ? 6 : 2),
                      " mm while the tool moved by ", fixed(1e3 * distance, 2), " mm, and ",
                      (size.array() > distance).count(), " of ", size.size(), " nodes by more than the tool"),
         .where = moment(now) + "; " + place_of(model_, furthest),
         .why = text("the path of equilibria has a limit point there: a wall buckled or a fold rolled over. "
                     "The force beyond is that of the equilibrium found there",
                     folds_make_contact ? "" : "; its folds pass through each other (--self-contact)"),
         .remedy = text("trust the curve to ", fixed(1e3 * (now.depth - distance), 2),
                        " mm; beyond, move the tool further from folds and edges (--indent-at), or use the "
                        "bonded indenter with --time explicit"),
         .code = "limit-point"},
        1e3 * largest});
}

void Guards::found_lost_contact(const Nodal& jump, double distance, const Moment& now) {
  Index furthest = 0;
  const double largest = jump.colwise().norm().maxCoeff(&furthest);
  if (!on_ || largest <= longer_than_displacement * distance ||
      std::any_of(findings_.begin(), findings_.end(),
                  [](const Finding& f) { return f.report.code == "tool-left"; }))
    return;
  find({{.fact = text("the tool has lost contact, and a node sprang back by ", fixed(1e3 * largest, 2),
                      " mm while the tool moved by ", fixed(1e3 * distance, 2), " mm"),
         .where = moment(now) + "; " + place_of(model_, furthest),
         .why = "no equilibrium in contact was found, as when a tool slides off an edge; the body at rest is "
                "one, and its stored energy was dissipated",
         .remedy = "trust the curve to the depth before; to resolve the loss of contact use shorter steps "
                   "(--set solver.step_radii=0.02)",
         .code = "tool-left"},
        1e3 * largest});
}

void Guards::check_step(const Moment& now) const {
  if (!on_ || now.dt <= now.dt_stable) return;
  throw SolveError({.fact = text("the time step of ", 1e6 * now.dt, " us is above the stable one of ",
                                 1e6 * now.dt_stable, " us"),
                    .where = moment(now),
                    .why = now.depth > 0.0
                               ? "compressed tissue has a shorter stable step than at the last frame"
                               : "it was requested",
                    .remedy = "use a solver.safety below 1, for instance 0.9, or more frames (--frames)",
                    .code = "time-step"});
}

std::string place_of(const Model& model, Index node) {
  return text("node ", node, " at rest at ", in_mm(model.X.col(node)));
}

SolveError after_retries(const SolveError& error, const std::string& what) {
  Report report = error.report;
  report.why += text("; it recurred after ", most_retries, " retries, with ", what);
  return SolveError(report);
}

}  // namespace dimple
