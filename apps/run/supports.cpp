#include "apps/run/supports.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "apps/scene/surface_part.hpp"
#include "io/error.hpp"
#include "io/words.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/surface/body_surface.hpp"

namespace dimple {
namespace {

constexpr double on_surface = 0.1;  // spacings

Report report_on(const std::string& name, const char* key, const std::string& fact, const std::string& why,
                 const std::string& remedy) {
  return {.fact = fmt::format("the support '{}' {}", name, fact),
          .where = fmt::format("support.{}.{}", name, key),
          .why = why,
          .remedy = remedy};
}

// Nodes of a support, and the mean of the surface's unit normals there.
struct Chosen {
  std::vector<Index> node;
  Vec3 normal = Vec3::Zero();
  double nearest_mm = std::numeric_limits<double>::infinity();  // surface node to a ball's centre
};

// A face of a cut belongs to no side of the body; a ball may include it.
bool is_inside_cut(const SurfacePart& part, const Surface& faces, Index t) {
  return part.side && faces.is_cut_face(t);
}

// Mean over the area: nodes are few, and some are on rounded edges.
Vec3 mean_normal(const SurfacePart& part, const BodySurface& surface, const Surface& faces) {
  Vec3 sum = Vec3::Zero();
  double area = 0.0;
  for (Index t = 0; t < surface.triangles().cols(); ++t) {
    const auto corner = surface.triangles().col(t);
    const Vec3 middle = (surface.vertex().col(corner[0]) + surface.vertex().col(corner[1]) +
                         surface.vertex().col(corner[2])) /
                        3.0;
    if (!part.has(middle, surface.normal().col(t)) || is_inside_cut(part, faces, t)) continue;
    sum += surface.triangle_area()[t] * surface.normal().col(t);
    area += surface.triangle_area()[t];
  }
  return area > 0.0 ? Vec3(sum / area) : sum;
}

Chosen nodes_on_surface(const SurfacePart& part, const Discretisation& places, const BodySurface& surface) {
  Chosen chosen;
  for (Index a = 0; a < places.node_count(); ++a) {
    const Vec3 x = 1e3 * places.X.col(a);
    const double near = on_surface * 1e3 * places.spacing[a];
    if (surface.farther(x, near)) continue;
    if (part.ball) chosen.nearest_mm = std::min(chosen.nearest_mm, (x - part.ball->head<3>()).norm());
    const Index t = surface.closest(x).triangle;
    if (!part.has(x, surface.normal().col(t)) || is_inside_cut(part, places.surface, t)) continue;
    chosen.node.push_back(a);
  }
  chosen.normal = mean_normal(part, surface, places.surface);
  return chosen;
}

Chosen nodes_with_label(int label, const Discretisation& places) {
  Chosen chosen;
  if (!(places.label.array() == label).any()) return chosen;
  const Neighbours points(places.point);
  for (Index a = 0; a < places.node_count(); ++a)
    if (places.label[points.nearest(places.X.col(a), 1).front()] == label) chosen.node.push_back(a);
  return chosen;
}

bool has(const std::vector<Index>& ascending, Index a) {
  return std::binary_search(ascending.begin(), ascending.end(), a);
}

void check_nodes(const Scene::Support& held, const Chosen& chosen, const Discretisation& places,
                 const std::vector<Index>& base) {
  const std::vector<Index>& nodes = chosen.node;
  const std::string& name = held.name;
  const bool of_label = !held.part;
  if (nodes.empty())
    throw ModelError(
        report_on(name, "on", fmt::format("on '{}' meets no node", held.on_words),
                  of_label ? "no integration point has that label, or none is nearest to a node"
                  : std::isfinite(chosen.nearest_mm)
                      ? fmt::format("the nearest node of the surface is {} from the ball's middle",
                                    length_in_words(chosen.nearest_mm))
                      : "no node of the surface is there",
                  of_label ? "`dimple info IMAGE` shows the labels; a model made without this support has no "
                             "labels, unless tissues differ"
                           : "give another side, a larger ball on the surface, or more --nodes"));
  const auto of_tool =
      std::count_if(nodes.begin(), nodes.end(), [&](Index a) { return has(places.bonded_patch, a); });
  if (of_tool > 0)
    throw ModelError(
        report_on(name, "on",
                  fmt::format("on '{}' contains {} of the {} nodes of the contact patch", held.on_words,
                              of_tool, places.bonded_patch.size()),
                  fmt::format("the centre of the contact patch is at {}, and its nodes move with the tool",
                              in_words(1e3 * places.tool.centre)),
                  "move or shrink the support (a ball in place of a side), or move the tool (--indent-at)"));
  if (std::all_of(nodes.begin(), nodes.end(), [&](Index a) { return has(base, a); }))
    throw ModelError(report_on(name, "on", fmt::format("on '{}' meets no node but the base's", held.on_words),
                               "the base is held already, and stays where it is",
                               "leave the support out, or choose another --base or a smaller --base-depth"));
}

HeldSet set_of(const Scene::Support& held, const Chosen& chosen, double depth_mm) {
  const std::string& name = held.name;
  HeldSet set{.name = name, .node = {}};
  const Vec3 move(held.move_mm[0], held.move_mm[1], held.move_mm[2]);
  if (!held.slides) {
    set.direction = move.isZero(0.0) ? move : move.normalized();
    set.fraction = move.norm() / depth_mm;
    return set;
  }
  if (chosen.normal.norm() < facing)
    throw ModelError(
        report_on(name, "hold", "slides along a patch that faces all directions",
                  fmt::format("the mean of its unit normals has a length of {:.2f}", chosen.normal.norm()),
                  "give a side or a smaller ball, or hold = \"fixed\""));
  set.hold = HeldSet::Hold::along;
  set.direction = chosen.normal.normalized();
  const double along = move.dot(set.direction);
  if (std::abs(along) < facing * move.norm())
    throw ModelError(report_on(
        name, "move_mm", "moves along the surface on which it slides",
        fmt::format("the patch's mean normal is ({:.2f}, {:.2f}, {:.2f}), and across it nothing is held",
                    set.direction.x(), set.direction.y(), set.direction.z()),
        "give a displacement within 45 degrees of the normal, or hold = \"fixed\""));
  set.fraction = along / depth_mm;
  return set;
}

std::string sentence(const HeldSet& set, double depth_mm, Index of_base, Index of_others) {
  const auto three = [](const Vec3& v) {
    const Vec3 shown = v.array() + 0.0;  // avoids -0
    return fmt::format("({:.4g}, {:.4g}, {:.4g})", shown.x(), shown.y(), shown.z());
  };
  const Vec3 moves = set.fraction * depth_mm * set.direction;
  std::string text = fmt::format("{}: {} nodes, ", set.name, set.node.size());
  if (set.hold == HeldSet::Hold::along)
    text += fmt::format("sliding, normal {}", three((set.direction * 100.0).array().round() / 100.0));
  if (set.fraction != 0.0)
    text += fmt::format("{}moves {} mm", set.hold == HeldSet::Hold::along ? ", " : "", three(moves));
  else if (set.hold == HeldSet::Hold::all)
    text += "fixed";
  if (of_base > 0) text += fmt::format("; {} more belong to the base and do not move", of_base);
  if (of_others > 0) text += fmt::format("; {} more belong to supports named after it", of_others);
  return text;
}

}  // namespace

int number_of_label(const std::string& label, const std::map<std::string, int>& names) {
  if (!label.empty() && label.find_first_not_of("0123456789") == std::string::npos && label.size() < 10)
    return std::stoi(label);
  const auto known = names.find(label);
  return known == names.end() ? -1 : known->second;
}

bool names_labels(const Scene& scene) {
  return std::any_of(scene.supports.begin(), scene.supports.end(),
                     [](const Scene::Support& support) { return !support.part; });
}

Supports supports_of(const Scene& scene, const Discretisation& places,
                     const std::map<std::string, int>& label_names) {
  Supports result;
  if (scene.supports.empty()) return result;
  const std::vector<Index> base = scene.base_is_held ? places.base : std::vector<Index>();
  const bool all_labels = std::none_of(scene.supports.begin(), scene.supports.end(),
                                       [](const Scene::Support& support) { return support.part; });
  if (!all_labels && places.surface.empty())
    throw ModelError({.fact = "a support needs a surface, and this model has none",
                      .where = "support",
                      .why = "its files hold only nodes and points",
                      .remedy = "use the label image, or the tissue of a label (on = \"label:NAME\")"});
  std::optional<BodySurface> surface;
  if (!all_labels) surface.emplace(places.surface.vertex_mm, places.surface.triangles);
  std::vector<Chosen> chosen;
  std::vector<int> owner(static_cast<std::size_t>(places.node_count()), -1);  // last support of a node
  for (const Scene::Support& held : scene.supports) {
    chosen.push_back(held.part ? nodes_on_surface(*held.part, places, *surface)
                               : nodes_with_label(number_of_label(held.label, label_names), places));
    check_nodes(held, chosen.back(), places, base);
    const auto number = static_cast<int>(result.sets.size());
    for (const Index a : chosen.back().node) owner[static_cast<std::size_t>(a)] = number;
    result.sets.push_back(set_of(held, chosen.back(), scene.depth_mm));
  }
  Index taken = 0;
  for (std::size_t k = 0; k < chosen.size(); ++k) {
    HeldSet& set = result.sets[k];
    Index of_base = 0, of_others = 0;
    for (const Index a : chosen[k].node) {
      if (has(base, a))
        ++of_base;
      else if (owner[static_cast<std::size_t>(a)] != static_cast<int>(k))
        ++of_others;
      else
        set.node.push_back(a);
    }
    if (set.node.empty())
      throw ModelError(report_on(set.name, "on", "has no node left", "later supports contain all of them",
                                 "leave one of them out, or make the others smaller"));
    taken += static_cast<Index>(set.node.size());
    result.words.push_back(sentence(set, scene.depth_mm, of_base, of_others));
  }
  Index held_before = 0;
  for (Index a = 0; a < places.node_count(); ++a) held_before += has(base, a) || has(places.bonded_patch, a);
  if (taken + held_before == places.node_count())
    throw ModelError({.fact = fmt::format("the supports contain all of the {} free nodes", taken),
                      .where = "support",
                      .why = "with the base and the contact patch nothing is left to deform",
                      .remedy = "make the supports smaller"});
  return result;
}

void require_free_under(const RigidBody& tool, double depth, const std::vector<HeldSet>& supports,
                        const Model& model) {
  if (supports.empty() || !(depth > 0.0)) return;
  const double radius = contact_radius(tool.shape, depth);
  const Neighbours nodes(model.X);
  std::set<Index> under;
  for (const auto& place : tool.surface.place.colwise())
    if ((place - tool.pose.tip).cross(tool.pose.points_at).norm() < radius)
      under.insert(nodes.nearest(place, 1).front());
  for (const HeldSet& set : supports) {
    const auto held = std::count_if(under.begin(), under.end(), [&](Index a) { return has(set.node, a); });
    if (held == 0) continue;
    throw ModelError(
        report_on(set.name, "on",
                  fmt::format("holds {} of the nodes under the tool{}", held,
                              tool.name.empty() ? "" : fmt::format(" '{}'", tool.name)),
                  fmt::format("the tool presses {} nodes around {}, and held nodes cannot move", under.size(),
                              in_words(1e3 * tool.pose.tip)),
                  fmt::format("move or shrink the support (a ball in place of a side), or move the tool ({})",
                              tool.name.empty() ? "--indent-at" : fmt::format("tool.{}.at_mm", tool.name))));
  }
}

Vec3 force_on(const HeldSet& support, const Nodal& f) {
  Vec3 sum = Vec3::Zero();
  for (const Index a : support.node) sum -= f.col(a).head<3>();
  if (support.hold == HeldSet::Hold::along) sum = sum.dot(support.direction) * support.direction;
  return sum;
}

}  // namespace dimple
