#include "apps/run/walls.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "apps/run/steps.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/view.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/option_word.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/surface_mesh.hpp"
#include "io/text.hpp"
#include "preprocess/image/close_gaps.hpp"
#include "preprocess/scene/wall_field.hpp"
#include "preprocess/supports/wall_surface.hpp"
#include "preprocess/surface/closed_mesh.hpp"
#include "solver/march/steps.hpp"

namespace dimple {
namespace {

constexpr double hull_closes_mm = 12.0;  // narrower gaps in the body are its fissures
constexpr double faces_wall = -0.3;      // largest outward normal of the body . that of the wall
// Distance from the body within which walls act: of the body's size, and its limits [m].
constexpr double reach_of_size = 0.15, least_reach = 10e-3, most_reach = 30e-3;
constexpr double overlap_voxels = 1.0;    // allowed overlap of neighbouring labels
constexpr double overlap_spacings = 0.2;  // the same without an image

// Distance field of a wall around the model's box.
DistanceGrid field_of(const BodySurface& wall, bool hollow, const Model& model, double finest_mm,
                      double reach) {
  const Vec3 low = 1e3 * (model.X.rowwise().minCoeff().array() - 1.2 * reach).matrix(),
             high = 1e3 * (model.X.rowwise().maxCoeff().array() + 1.2 * reach).matrix();
  return wall_field(wall, hollow, low, high, finest_mm, 1e3 * 1.1 * reach);
}

struct WallShape {
  ToolShape shape;
  ToolPose pose;
  double gap = 0.0;  // stated gap in front of the drawn wall [m]
  std::string words;
};

WallShape wall_shape_of(const Scene::Wall& wall, const Model& model, const LabelImage* image,
                        const Organ* organ, double reach) {
  using Kind = Scene::Wall::Kind;
  WallShape result;
  if (wall.kind == Kind::plane) {
    result.shape = plane_shape();
    result.pose = {wall.place, wall.normal};
    result.words = "a plane";
    return result;
  }
  const auto take = [&](const BodySurface& surface, bool hollow, double finest) {
    result.shape =
        field_shape(std::make_shared<const DistanceGrid>(field_of(surface, hollow, model, finest, reach)));
  };
  if (wall.kind == Kind::mesh) {
    take(*wall.mesh, false, 0.0);
    result.words = fmt::format("the mesh {}", std::filesystem::path(wall.file).filename().string());
    return result;
  }
  if (!image || !organ || image->run.empty())
    throw UsageError(
        {.fact = fmt::format("the wall '{}' is '{}', and there is no label image", wall.name, wall.words),
         .where = wall_key(wall.name, "shape"),
         .why = "the model was made before, and its files do not hold the image",
         .remedy = "begin with the image: dimple run IMAGE --wall ..."});
  const double voxel = image->spacing().minCoeff();
  if (wall.kind == Kind::labels) {
    std::vector<int> labels;
    for (const std::string& label : wall.labels) labels.push_back(number_of_label(label, organ->label_names));
    const SegmentedBody solid = make_body_surface(*image, labels);
    take(solid.surface, false, voxel);
    result.words = fmt::format("{} {}", labels.size() == 1 ? "label" : "labels", fmt::join(wall.labels, ","));
    if (solid.report.dropped_volume_mm3 > 0.0)
      result.words += fmt::format(", the largest of its {} pieces (without {})", solid.report.pieces,
                                  volume_in_words(solid.report.dropped_volume_mm3));
    return result;
  }
  result.gap = wall.around;
  const Vec3 size = organ->body->surface.upper() - organ->body->surface.lower();
  const double closes = std::min(hull_closes_mm, 0.5 * size.minCoeff());
  const ClosedImage closed = close_gaps(organ->closed ? organ->closed->image : *image, organ->labels, closes);
  take(make_body_surface(closed.image, organ->labels).surface, true, voxel);
  result.words = fmt::format("the outer hull of the body, gaps narrower than {} closed, at a gap of {}",
                             length_in_words(closes), length_in_words(1e3 * result.gap));
  return result;
}

}  // namespace

void check_walls(const Scene& scene, const LabelImage& image, const std::vector<int>& of_body,
                 const std::map<std::string, int>& names) {
  for (const Scene::Wall& wall : scene.walls) {
    for (const std::string& label : wall.labels) {
      const int value = number_of_label(label, names);
      const bool there =
          std::any_of(image.run.begin(), image.run.end(), [&](const Run& run) { return run.label == value; });
      if (there && !of_body.empty() && std::find(of_body.begin(), of_body.end(), value) == of_body.end())
        continue;
      throw InputError(
          {.fact = there ? fmt::format("label '{}' is both the wall '{}' and a part of the body", label,
                                       wall.name)
                         : fmt::format("the image has no label '{}' for the wall '{}'", label, wall.name),
           .where = wall_key(wall.name, "shape"),
           .why = there ? "a wall is rigid and needs a label of its own" : "no voxel has it",
           .remedy = there ? "choose the labels of the body with --label"
                           : "`dimple info IMAGE` shows the labels"});
    }
  }
}

namespace {

// Part of the surface that can come to the wall, by the place next to it on the wall.
ContactSurface facing_surface(const Model& model, const RigidBody& wall, double reach,
                              const std::optional<Eigen::Vector4d>& opening, Index most_places) {
  bool opens = false;
  ContactSurface surface = wall_surface(
      model,
      [&](const Vec3& x, const Vec3& outward) {
        const ToolDistance to = distance_to_tool(wall.shape, wall.pose, x);
        if (to.distance > reach || outward.dot(to.normal) > faces_wall) return false;
        const Vec3 there = 1e3 * (x - to.distance * to.normal);
        const bool is_open = opening && (there - opening->head<3>()).norm() <= (*opening)[3];
        opens = opens || is_open;
        return !is_open;
      },
      most_places);
  if (opening && !opens && surface.count() > 0)
    throw ModelError(
        {.fact = fmt::format("the opening of the wall '{}' at ({:.4g}, {:.4g}, {:.4g}) mm opens no part of "
                             "the wall near the body",
                             wall.name, (*opening)[0], (*opening)[1], (*opening)[2]),
         .where = wall_key(wall.name, "opening"),
         .why = fmt::format("no part of the wall within its radius of {} faces the body within {}",
                            length_in_words((*opening)[3]), length_in_words(1e3 * reach)),
         .remedy = "give x,y,z,radius in mm (LPS) of a ball that holds a part of the wall, or none",
         .code = "wall"});
  return surface;
}

Eigen::VectorXd distances(const RigidBody& wall, const Points& places) {
  Eigen::VectorXd result(places.cols());
  for (Index k = 0; k < places.cols(); ++k)
    result[k] = distance_to_tool(wall.shape, wall.pose, places.col(k)).distance;
  return result;
}

// Offsets the wall: as a whole to a stated gap, and out of the body where they overlap.
std::string gap_offset(const std::string& name, const WallShape& shape, std::optional<double> gap,
                       double allowed, RigidBody& wall) {
  const ContactSurface& surface = wall.surface;
  const Eigen::VectorXd at = distances(wall, surface.place) + roundness(wall),
                        between = distances(wall, surface.between);
  Index first = 0;
  const double nearest = at.minCoeff(&first);
  const double whole = gap ? *gap - nearest : shape.gap;
  if (nearest + whole < -allowed)
    throw ModelError(
        {.fact =
             fmt::format("the wall '{}' overlaps the body by {} at {}", name,
                         length_in_words(-1e3 * (nearest + whole)), in_words(1e3 * surface.place.col(first))),
         .where = wall_key(name, "shape"),
         .why = fmt::format("an overlap of more than {} is not treated as contact",
                            length_in_words(1e3 * allowed)),
         .remedy = fmt::format("correct the image or the wall, or give it a gap, as wall.{}.gap = 0", name),
         .code = "wall"});
  wall.gap_offset = (-at.array() - whole).max(0.0) + whole;
  wall.gap_offset_between = (-between.array() - whole).max(0.0) + whole;
  const double overlap = std::max(0.0, -(nearest + whole));
  std::string words =
      overlap > 0.0
          ? fmt::format("overlaps of up to {} at rest are treated as contact", length_in_words(1e3 * overlap))
          : fmt::format("{} away at the nearest place, {}", length_in_words(1e3 * (nearest + whole)),
                        in_words(Vec3(1e3 * surface.place.col(first))));
  if (gap)
    words += fmt::format(", set {} by {}", whole < 0.0 ? "forward" : "back",
                         length_in_words(1e3 * std::abs(whole)));
  return words;
}

}  // namespace

namespace {

// Beyond its grid a wall's distance is invalid.
bool is_within(const DistanceGrid& grid, const Vec3& x) {
  const Vec3 at = (x - grid.origin) / grid.step;
  for (Index d = 0; d < 3; ++d)
    if (at[d] < 0.0 || at[d] > static_cast<double>(grid.n[static_cast<std::size_t>(d)] - 1)) return false;
  return true;
}

struct FixedWall {
  RigidBody wall;
  double back;  // [m]
  std::optional<Eigen::Vector4d> opening;
};

std::vector<FixedWall> fixed_walls(const Scene& scene, const Loading& loading) {
  std::vector<FixedWall> walls;
  for (const RigidBody& wall : loading.walls) {
    const Scene::Wall* its = named(scene.walls, wall.name);
    if (wall.is_tool || !its) continue;
    walls.push_back({wall, wall.gap_offset.size() > 0 ? wall.gap_offset.minCoeff() : 0.0, its->opening});
  }
  return walls;
}

// Nearest wall and its distance [mm]; NaN at its opening.
struct Nearest {
  double gap = std::numeric_limits<double>::infinity();
  const FixedWall* wall = nullptr;
};
Nearest nearest_of(const std::vector<FixedWall>& walls, const Vec3& place_mm) {
  Nearest nearest;
  bool is_open = false;
  for (const FixedWall& one : walls) {
    if (one.wall.shape.field && !is_within(*one.wall.shape.field, 1e-3 * place_mm - one.wall.pose.tip))
      continue;
    const ToolDistance to = distance_to_tool(one.wall.shape, one.wall.pose, 1e-3 * place_mm);
    const double gap = 1e3 * (to.distance + one.back);
    if (!(gap < nearest.gap)) continue;
    nearest = {gap, &one};
    const Vec3 there = place_mm - 1e3 * to.distance * to.normal;
    is_open = one.opening && (there - one.opening->head<3>()).norm() <= (*one.opening)[3];
  }
  if (is_open) nearest.gap = std::numeric_limits<double>::quiet_NaN();
  return nearest;
}

}  // namespace

GapAt gap_to_walls(const Scene& scene, const Loading& loading) {
  const std::vector<FixedWall> walls = fixed_walls(scene, loading);
  if (walls.empty()) return {};
  return [walls](const Vec3& place_mm) { return nearest_of(walls, place_mm).gap; };
}

namespace {

// Displacements of a tool from its first contact on [m]; turns are left out.
std::vector<Vec3> places_reached(const Loading& loading, std::string_view name, const Vec3& motion) {
  std::vector<Vec3> places = {Vec3::Zero()};
  if (loading.steps.empty()) places.emplace_back(loading.depth * motion);
  double come = 0.0;
  for (const Step& step : loading.steps) places.push_back(moved(loading.steps, name, come += step.length()));
  return places;
}

// Drawn shaft over the bonded patch: the axis and eight lines around it, to two radii above it [mm].
Points shaft_of(const ToolPlace& bonded_patch) {
  Points shaft(3, 9 * 8);
  const Vec3 side = bonded_patch.approach.unitOrthogonal(), across = bonded_patch.approach.cross(side);
  for (Index k = 0; k < shaft.cols(); ++k) {
    const double angle = 0.25 * std::numbers::pi * static_cast<double>(k % 9),
                 out = k % 9 == 8 ? 0.0 : bonded_patch.radius,
                 up = 0.25 * static_cast<double>(k / 9 + 1) * bonded_patch.radius;
    shaft.col(k) = 1e3 * (bonded_patch.centre - up * bonded_patch.approach +
                          out * (std::cos(angle) * side + std::sin(angle) * across));
  }
  return shaft;
}

}  // namespace

std::string tool_in_wall(const Scene& scene, const Model& model, const Loading& loading) {
  constexpr double little = 0.1;  // of the tool's radius
  const std::vector<FixedWall> walls = fixed_walls(scene, loading);
  if (walls.empty()) return {};
  double most = 0.0;
  std::string words;
  const auto look = [&](const std::string& name, const Points& body_mm, double radius,
                        const std::vector<Vec3>& come) {
    for (const Vec3& by : come)
      for (Index k = 0; k < body_mm.cols(); ++k) {
        const Vec3 place = body_mm.col(k) + 1e3 * by;
        const Nearest nearest = nearest_of(walls, place);
        if (!(-nearest.gap > std::max(most, 1e3 * little * radius))) continue;
        most = -nearest.gap;
        words = fmt::format(
            "the {} is {} inside of the wall '{}' at {}, and passes through it: walls act on the body only; "
            "give the wall an opening for the tool, as --set wall.{}.opening=x,y,z,radius",
            name, length_in_words(most), nearest.wall->wall.name, in_words(place), nearest.wall->wall.name);
      }
  };
  look("tool", loading.indenter ? tool_body(*loading.indenter).position_mm : shaft_of(model.tool),
       loading.indenter ? loading.indenter->shape.radius : model.tool.radius,
       places_reached(loading, "", model.tool.approach));
  for (const RigidBody& rigid : loading.walls)
    if (rigid.is_tool)
      look(fmt::format("tool '{}'", rigid.name), tool_body(rigid).position_mm, rigid.shape.radius,
           places_reached(loading, rigid.name, rigid.motion.value_or(Vec3::Zero())));
  return words;
}

std::string in_words(const std::string& name, const RigidContact::ContactSummary& wall) {
  if (wall.samples == 0 && wall.penetration > 0.0)
    return fmt::format(
        "{}: in contact at none of its contact points at the end; between them the surface penetrates by {}",
        name, length_in_words(1e3 * wall.penetration));
  if (wall.samples == 0) return name + ": not in contact at the end";
  return fmt::format("{}: net force {} over {:.0f} mm2; the surface penetrates by {} at most", name,
                     force_in_words(wall.force.norm()), 1e6 * wall.area,
                     length_in_words(1e3 * wall.penetration));
}

Walls walls_of(const Scene& scene, const Model& model, const LabelImage* image, const Organ* organ) {
  Walls walls;
  if (scene.walls.empty()) return walls;
  if (model.surface.empty())
    throw ModelError({.fact = "a wall needs the body's surface, and this model has none",
                      .where = "wall",
                      .why = "its files hold only nodes and points",
                      .remedy = "use the label image, or leave the wall out"});
  const double size = (model.X.rowwise().maxCoeff() - model.X.rowwise().minCoeff()).maxCoeff();
  const double reach =
      std::max(std::clamp(reach_of_size * size, least_reach, most_reach), 1.5 * deepest(scene, model.tool));
  for (const Scene::Wall& its : scene.walls) {
    const std::string& name = its.name;
    RigidBody wall;
    const WallShape shape = wall_shape_of(its, model, image, organ, reach);
    wall.shape = shape.shape;
    wall.pose = shape.pose;
    wall.name = name;
    wall.motion = Vec3::Zero().eval();
    wall.friction = its.friction;
    wall.surface = facing_surface(model, wall, reach, its.opening, its.places);
    if (wall.surface.count() == 0)
      throw ModelError(
          {.fact = fmt::format("no part of the body can reach the wall '{}'", name),
           .where = wall_key(name, "shape"),
           .why = fmt::format("no free part of its surface faces it within {}: held surface and surface in "
                              "an opening have no contact with walls",
                              length_in_words(1e3 * reach)),
           .remedy =
               "`dimple info IMAGE` shows where the body is; a plane's normal points to it; make its opening "
               "smaller, if it has one",
           .code = "wall"});
    const double allowed = image && !image->run.empty() ? 1e-3 * overlap_voxels * image->spacing().maxCoeff()
                                                        : overlap_spacings * model.spacing.mean();
    const std::string apart = gap_offset(name, shape, its.gap, allowed, wall);
    walls.words.push_back(fmt::format("{}: {}, {}; {}; {} contact points", name, shape.words,
                                      friction_in_words(wall.friction), apart, wall.surface.count()));
    walls.rigid_body.push_back(std::move(wall));
  }
  return walls;
}

}  // namespace dimple
