#include "apps/run/unloaded.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <limits>

#include "apps/run/folds.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/scene.hpp"
#include "apps/scene/surface_part.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"
#include "preprocess/make_model.hpp"
#include "preprocess/supports/support.hpp"
#include "solver/system.hpp"

namespace dimple {
namespace {

constexpr int most_rounds = 30;
// Requested distance to the image, of the body's size and at most [m]. The rounds come little closer: places
// that move past a node's support change the discretisation by steps. The steps are 0.05 mm where its weight
// moves a block of 800 nodes by 2.5 mm.
constexpr double close_enough = 1e-3, closest = 1e-4;
// A round that does not halve the distance halves the correction of the next, to a quarter at least. A node
// moved relative to its neighbours may change its place by up to twice as much.
constexpr double contraction = 0.5, least_fraction = 0.25;
constexpr const char* by_imaged = "load.imaged";
constexpr const char* taken_off = "taken_off";  // in a model's provenance

bool was_loaded(const Scene& scene) {
  return scene.imaged_loaded;
}

// True if a load, a film or a support is on a side or in a ball.
bool names_parts(const Scene& scene) {
  const auto is_part = [](const SurfacePart& part) { return part.side || part.ball; };
  return std::any_of(scene.pressures.begin(), scene.pressures.end(),
                     [&](const Scene::Pressure& one) { return is_part(one.on); }) ||
         std::any_of(scene.membranes.begin(), scene.membranes.end(),
                     [&](const Scene::Film& one) { return is_part(one.on); }) ||
         std::any_of(scene.supports.begin(), scene.supports.end(),
                     [&](const Scene::Support& one) { return one.part && is_part(*one.part); });
}

[[noreturn]] void refuse(const std::string& fact, const std::string& why, const std::string& remedy) {
  throw UsageError({.fact = fact, .where = by_imaged, .why = why, .remedy = remedy});
}

// Distance of everything from its place in the image [m].
struct Difference {
  Points node, point, vertex;
  double largest() const {
    return std::max(node.colwise().norm().maxCoeff(),
                    vertex.cols() > 0 ? vertex.colwise().norm().maxCoeff() : 0.0);
  }
};

struct Equilibrium {
  Nodal u;
  Points node, point, vertex;  // displacements [m]
  std::vector<Mat3> F;         // at the points
};

Equilibrium under_loads(const Scene& scene, const std::vector<HeldSet>& further, const LoadedModel& result,
                        const Surface& imaged) {
  const Model& model = result.model;
  const ForceSystem tissue(model, result.tissues, scene.solver.precision);
  const auto system = make_system(tissue, model, scene.contact, further, loads_of(scene, model, imaged),
                                  scene.solver.tolerance);
  Equilibrium found;
  found.u = system->step_start().u;
  const Points u = found.u.topRows<3>();
  found.node = node_interpolation(model)(u);
  found.point = point_interpolation(model)(u);
  found.vertex = surface_interpolation(model)(u);
  std::vector<int> near;
  Points dphi;
  for (Index q = 0; q < model.point_count(); ++q) {
    tissue.gradients_at(q, near, dphi);
    Mat3 F = Mat3::Identity();
    for (std::size_t k = 0; k < near.size(); ++k)
      F += u.col(near[k]) * dphi.col(static_cast<Index>(k)).transpose();
    found.F.push_back(F);
  }
  return found;
}

// Sets volumes and moments of the points to their load-free values.
void unload_cells(const Discretisation& imaged, const std::vector<Mat3>& F, Discretisation& places) {
  for (Index q = 0; q < imaged.point_count(); ++q) {
    const Mat3& loaded = F[static_cast<std::size_t>(q)];
    const double J = loaded.determinant();
    if (!(J > 0.0)) continue;  // inverted: as imaged
    places.volume[q] = imaged.volume[q] / J;
    if (imaged.second_moments.cols() == 0) continue;
    const Mat3 back = loaded.inverse();
    set_moments(places.second_moments, q, back * as_matrix(imaged.second_moments, q) * back.transpose());
  }
}

}  // namespace

void check_imaged(const Scene& scene, const ModelFiles* model) {
  if (model && model->provenance.contains(taken_off) && names_parts(scene))
    refuse("the model is load-free, and a load or membrane acts on a part of the loaded body's surface",
           "a side or a ball was chosen on the image's shape, which differs from this one",
           "use the label image with --set load.imaged=loaded, or all of the surface");
  if (!was_loaded(scene)) return;
  if (model && model->provenance.contains(taken_off))
    refuse("load.imaged=loaded is given, and this model is already load-free",
           "its loads were removed when it was made", "leave load.imaged out, and give the loads");
  if (!has_loads(scene) && scene.membranes.empty())
    refuse("load.imaged=loaded is given, and there are no loads", "there is nothing to remove",
           "give --gravity or a pressure");
}

void take_loads_off(const Scene& scene, const std::vector<HeldSet>& further,
                    const std::vector<double>& density, const RunLog& log, LoadedModel& result) {
  if (!was_loaded(scene)) return;
  if (folds_make_contact(scene, result.facing_fraction))
    refuse("contact between folds cannot be combined with a body imaged under its loads",
           "the load-free shape is computed without their contact", "give --self-contact off");
  log.doing("computing the load-free shape");
  const Discretisation imaged = result.model;
  const Points vertex = 1e-3 * imaged.surface.vertex_mm;
  const double size = (imaged.X.rowwise().maxCoeff() - imaged.X.rowwise().minCoeff()).norm();
  double before = std::numeric_limits<double>::infinity(), first = before, fraction = 1.0;
  Unloaded& unloaded = result.unloaded.emplace();
  unloaded.imaged_surface = imaged.surface;
  unloaded.imaged_centre = imaged.tool.centre;
  for (;;) {
    stop_if_requested();
    const Equilibrium now = under_loads(scene, further, result, imaged.surface);
    const Model& model = result.model;
    const Difference difference{model.X + now.node - imaged.X, model.point + now.point - imaged.point,
                                1e-3 * model.surface.vertex_mm + now.vertex - vertex};
    unloaded.within = difference.largest();
    unloaded.taken_back = (model.X - imaged.X).colwise().norm().maxCoeff();
    if (unloaded.within <= std::min(close_enough * size, closest)) break;
    if (unloaded.rounds == 0) first = unloaded.within;
    if (++unloaded.rounds > most_rounds || !(unloaded.within < 2.0 * first))
      throw SolveError(
          {.fact = fmt::format(
               "the load-free shape was not found: after {} iterations the loaded body is {} from the image",
               unloaded.rounds, length_in_words(1e3 * unloaded.within)),
           .where = "before first contact, load.imaged",
           .why = "the deformation is so large that the iteration does not converge",
           .remedy =
               "lower gravity or the pressures, raise the stiffness, or use the image's shape as load-free",
           .code = "unloaded"});
    if (!(unloaded.within < contraction * before)) fraction = std::max(0.5 * fraction, least_fraction);
    before = unloaded.within;
    Discretisation places = model;
    places.X -= fraction * difference.node;
    places.point -= fraction * difference.point;
    places.surface.vertex_mm -= 1e3 * fraction * difference.vertex;
    unload_cells(imaged, now.F, places);
    Eigen::VectorXi tissue = model.tissue;
    const Scheme scheme = model.scheme;
    result.model = make_model(std::move(places), scheme, std::move(tissue), density);
  }
  // The bonded patch moves back with its nodes; the loads bring it to its place in the image.
  Vec3 back = Vec3::Zero();
  for (const Index a : imaged.bonded_patch) back += result.model.X.col(a) - imaged.X.col(a);
  if (!imaged.bonded_patch.empty())
    result.model.tool.centre += back / static_cast<double>(imaged.bonded_patch.size());
  result.provenance[taken_off] =
      fmt::format("the loads, from {} off the image", length_in_words(1e3 * unloaded.taken_back));
  log.say(fmt::format(
      "unloaded load-free shape up to {} from the image; reloading reproduces the image within {}; {} "
      "iterations",
      length_in_words(1e3 * unloaded.taken_back), length_in_words(1e3 * unloaded.within), unloaded.rounds));
}

}  // namespace dimple
