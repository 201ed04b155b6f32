#include "preprocess/scene/boundary_conditions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>

#include "io/error.hpp"
#include "io/words.hpp"
#include "preprocess/scene/fixed_base.hpp"
#include "preprocess/scene/patch_place.hpp"
#include "preprocess/scene/sides.hpp"

namespace dimple {
namespace {

constexpr double few_voxels = 3.0;         // across the contact patch
constexpr double smallest_organ_mm = 1.0;  // across: the image of a smaller one may be in metres
constexpr const char* place_option = "--indent-at (boundary.indent_at)";
constexpr double widest_patch = 1000.0;  // [mm] upper limit of --indenter-diameter

// First point of the body that the tool meets when it moves along `approach` through `x`.
std::optional<Vec3> first_contact(const BodySurface& body, const Vec3& x, const Vec3& approach) {
  const std::vector<double> t = body.crossings(x, approach);
  if (t.empty()) return std::nullopt;
  return x + t.front() * approach;
}

struct Frame2 {
  Vec3 e1, e2;
};

Frame2 across(const Vec3& approach) {
  Index axis = 0;
  approach.cwiseAbs().minCoeff(&axis);
  const Vec3 e1 = (Vec3::Unit(axis) - approach[axis] * approach).normalized();
  return {e1, approach.cross(e1)};
}

std::string words(const BodySurface& body, const Vec3& local) {
  return in_words(Vec3(body.to_world() * local));
}

// Parsed value of --indent-at; directions and places in LPS, mm.
struct RequestedPlace {
  std::optional<Vec3> from;   // the side that the tool comes from; none: opposite to the base
  std::optional<Vec3> half;   // the half of the organ that was requested
  std::optional<Vec3> place;  // z is unused for x,y,top
  bool z_is_free = false;
};

std::vector<std::string> split_at_commas(const std::string& text) {
  std::vector<std::string> parts(1);
  for (const char c : text)
    if (c == ',')
      parts.emplace_back();
    else
      parts.back() += c;
  return parts;
}

RequestedPlace parse_place(const std::string& text) {
  if (const auto place = parse_vector(text)) return {.from = {}, .half = {}, .place = place};
  const std::vector<std::string> part = split_at_commas(text);
  if (part.size() == 3 && part[2] == "top")
    if (const auto flat = parse_vector(part[0] + "," + part[1] + ",0"))
      return {.from = Vec3(0, 0, 1), .half = {}, .place = flat, .z_is_free = true};
  if (part.size() == 1 && text == "top")
    throw UsageError(
        {.fact = "'top' is ambiguous",
         .where = "--indent-at (boundary.indent_at)",
         .why =
             "it may mean the side opposite to the base, whichever that is, or the patient's superior side",
         .remedy = "give --indent-at opposite for the side opposite to the base, or --indent-at superior"});
  const auto from = side_named(part[0], place_option);
  const auto half = part.size() == 2 ? side_named(part[1], place_option) : std::nullopt;
  if (part.size() > 2 || (!from && part[0] != "opposite") || (part.size() == 2 && !half))
    throw UsageError(
        {.fact = fmt::format("'{}' is not a place to indent", text),
         .where = "--indent-at (boundary.indent_at)",
         .why = "a place is opposite (to the base), a side of the patient (superior, inferior, left, "
                "right, anterior, posterior, or S, I, L, R, A, P), one of these and a half of the "
                "organ (superior,left), x,y,z in LPS mm, or x,y,top",
         .remedy = "for instance --indent-at left"});
  return {.from = from, .half = half, .place = {}};
}

// Instruction to press a place on another side than the tool's; empty if the place is on the tool's side.
std::string from_its_side(const BodySurface& body, const Vec3& requested, const Boundary& boundary) {
  const BodySurface::Closest nearest = body.closest(requested);
  const Vec3 out = body.normal().col(nearest.triangle);
  constexpr double aslant = 0.7;
  if (nearest.distance > boundary.radius || -out.dot(boundary.approach) > aslant) return {};
  const Vec3 lps = body.to_world().linear() * out;
  Vec3 along = Vec3::Zero();
  Index axis = 0;
  lps.cwiseAbs().maxCoeff(&axis);
  along[axis] = lps[axis] < 0.0 ? 1.0 : -1.0;
  return fmt::format("press it from its own side, the {} one, with --base {} --direction={:g},{:g},{:g}; or ",
                     side_towards(lps), side_towards(-lps), along[0] + 0.0, along[1] + 0.0, along[2] + 0.0);
}

// `room`: from the place, `contact`, to an edge; `least_room`: the least that the tool needs [mm].
[[noreturn]] void refuse_edge(const BodySurface& body, const Vec3& requested, const Vec3& contact,
                              double room, double least_room, bool is_contacting, const Boundary& boundary) {
  if (is_contacting)
    throw ModelError({.fact = fmt::format("the tool of {:.4g} mm diameter at {} would be in contact over an "
                                          "edge of the organ, which is not modelled",
                                          2.0 * boundary.radius, words(body, contact)),
                      .where = "--indent-at (boundary.indent_at) and --tool (tool.shape)",
                      .why = fmt::format("contact may extend to {:.1f} mm from its middle, and at {:.1f} mm "
                                         "the surface ends or drops by more than a radius",
                                         least_room, room),
                      .remedy = "move it with --indent-at, or give it a smaller radius; for a plate use a "
                                "sphere that is nearly flat, such as --tool sphere:1000mm",
                      .code = "tool-too-wide"});
  throw ModelError(
      {.fact = fmt::format("the contact patch of {:.4g} mm diameter at {} extends beyond the organ's edge",
                           2.0 * boundary.radius, words(body, contact)),
       .where = "--indent-at (boundary.indent_at)",
       .why = fmt::format("{:.1f} mm from its middle the surface ends or drops by more than a radius", room),
       .remedy = from_its_side(body, requested, boundary) +
                 "move it with --indent-at, make it smaller with --indenter-diameter, or leave "
                 "the place to --indent-at opposite"});
}

// `least_room`: around the place, without an edge [mm]. `is_contacting`: a contacting tool, not a bonded one.
void place_as_requested(const BodySurface& body, const std::string& requested_for,
                        const RequestedPlace& place, const View& view, double least_room, bool is_contacting,
                        Boundary& result) {
  Vec3 given = *place.place;
  if (place.z_is_free) given.z() = (body.to_world() * body.centroid()).z();
  const Vec3 requested = body.to_world().inverse() * given;
  const auto contact = first_contact(body, requested, result.approach);
  if (!contact) {
    const Vec3 lower = body.to_world() * body.lower(), upper = body.to_world() * body.upper();
    throw ModelError(
        {.fact = fmt::format("the tool at {} mm misses the organ", requested_for),
         .where = "--indent-at (boundary.indent_at)",
         .why = fmt::format("a line through it along the approach direction meets no tissue; the organ is "
                            "between ({:.1f}, {:.1f}, {:.1f}) and ({:.1f}, {:.1f}, {:.1f}) mm",
                            std::min(lower.x(), upper.x()), std::min(lower.y(), upper.y()),
                            std::min(lower.z(), upper.z()), std::max(lower.x(), upper.x()),
                            std::max(lower.y(), upper.y()), std::max(lower.z(), upper.z())),
         .remedy = fmt::format("give a place over the organ, such as the nearest of its surface, {}, or "
                               "--indent-at opposite",
                               words(body, body.closest(requested).place))});
  }
  result.centre = *contact;
  const double moved = (*contact - requested).norm();
  if (moved > 4.0 * result.radius && !place.z_is_free)
    throw ModelError(
        {.fact = fmt::format("the place {} mm is {:.1f} mm from where the contact patch meets the organ",
                             requested_for, moved),
         .where = "--indent-at (boundary.indent_at)",
         .why = fmt::format("along the approach direction the contact patch of {:.4g} mm diameter meets the "
                            "organ at {}, more than two diameters away",
                            2.0 * result.radius, words(body, *contact)),
         .remedy =
             from_its_side(body, requested, result) +
             fmt::format("give that place, or the place of the surface nearest to the one given, {}, for "
                         "which another --direction may be needed",
                         words(body, body.closest(requested).place)),
         .code = "place-moved"});
  result.patch_reason =
      fmt::format("as requested; projected {:.1f} mm along the approach direction onto the surface", moved);
  if (moved > result.radius && !place.z_is_free)
    result.warnings.push_back(
        fmt::format("the place {} mm of --indent-at was moved by {:.1f} mm, more than the radius of the "
                    "contact patch: along the approach direction the organ is met first at {}",
                    requested_for, moved, words(body, *contact)));
  const Room room = room_around(view, view.flat(*contact), result.radius);
  result.room = room.even;
  if (room.whole < least_room)
    refuse_edge(body, requested, *contact, room.whole, least_room, is_contacting, result);
}

// Direction of the tool's motion. `known`: of the same body, for a place that does not define it.
Vec3 approach_of(const BodySurface& body, const BoundaryOptions& options, const RequestedPlace& requested,
                 const Boundary* known, const Vec3& down) {
  if (options.direction == "auto")
    return requested.from             ? nearest_axis(body, -*requested.from)
           : known && requested.place ? known->approach
                                      : down;
  const auto vector = parse_vector(options.direction);
  if (!vector || !(vector->norm() > 0.0))
    throw UsageError({.fact = fmt::format("'{}' is not a direction", options.direction),
                      .where = "--direction (boundary.direction)",
                      .why = "a direction is auto or three numbers x,y,z in LPS",
                      .remedy = "for instance --direction 0,0,-1 to press down"});
  if (requested.from && !(vector->dot(*requested.from) < 0.0))
    throw UsageError({.fact = fmt::format("a tool with the direction {} does not approach from the {} side",
                                          options.direction, side_towards(*requested.from)),
                      .where = "--direction and --indent-at",
                      .why = fmt::format("--indent-at {} is met from that side only", options.indent_at),
                      .remedy = "reverse --direction, or give the other side or a place x,y,z"});
  return local_direction(body, vector->normalized());
}

// Radius of the contact: a contacting tool may be wider than the organ, and only its contact must find room.
double radius_of_contact(const BoundaryOptions& options) {
  const double radius = 0.5 * options.indenter_diameter_mm;
  return options.contact_radius_mm > 0.0 ? std::min(radius, options.contact_radius_mm) : radius;
}

void check_width(const BoundaryOptions& options, Boundary& result) {
  const double across = options.indenter_diameter_mm / std::max(options.voxel_mm, 1e-300);
  const bool is_contacting = options.contact_radius_mm > 0.0;
  const double enough = few_voxels * options.voxel_mm;
  if (options.voxel_mm > 0.0 && across < 1.0)
    throw ModelError(
        {.fact = fmt::format("the tool of {:.4g} mm diameter is smaller than a voxel of {:.4g} mm",
                             options.indenter_diameter_mm, options.voxel_mm),
         .where =
             is_contacting ? "--tool (tool.shape)" : "--indenter-diameter (boundary.indenter_diameter_mm)",
         .why = "the image does not show the shape of the surface beneath it",
         .remedy = enough > widest_patch
                       ? std::string("no tool is wide enough for such voxels: check the unit of "
                                     "the image's voxel spacing, which is read as millimetres")
                   : is_contacting
                       ? fmt::format("give a radius of at least {:.4g} mm, or a finer image", 0.5 * enough)
                       : fmt::format("give at least {:.4g} mm, or a finer image", enough),
         .code = "circle-too-small"});
  if (options.voxel_mm > 0.0 && across < few_voxels)
    result.warnings.push_back(
        fmt::format("the tool of {:.4g} mm diameter is {:.1f} voxels across: the image barely resolves the "
                    "surface beneath it",
                    options.indenter_diameter_mm, across));
}

void place_on_highest(const BodySurface& body, const Moments& moments, const BoundaryOptions& options,
                      const RequestedPlace& requested, const View& view, Boundary& result) {
  std::optional<Eigen::Vector2d> half;
  if (requested.half) half = view.flat(local_direction(body, *requested.half));
  const std::string side = side_in_words(body, -result.approach);
  if (half && half->norm() < 0.1)
    throw UsageError(
        {.fact = fmt::format("'{}' names no half of the {}", options.indent_at, side),
         .where = "--indent-at (boundary.indent_at)",
         .why = "the tool approaches from that side or the opposite one, so that half is all of the surface "
                "or none of it",
         .remedy = "name a half across the approach direction, for instance --indent-at superior,left"});
  const auto is_free = [&](const Vec3& leaves) {
    return result.lowest - leaves.dot(result.down) > result.base_depth;
  };
  const auto dome_for = [&](double radius) {
    return highest_dome(view, moments, radius, result.height, half,
                        local_direction(body, Vec3(1.0, 0.1, 0.01)), is_free);
  };
  auto place = dome_for(result.radius);
  if (const double contact_radius = radius_of_contact(options); !place && contact_radius < result.radius)
    place = dome_for(contact_radius);
  const auto contact =
      place ? first_contact(body, view.at(place->centre, 0.0), result.approach) : std::nullopt;
  if (!contact) {
    const auto& corner = body.vertex();
    const double widest = (corner.rowwise().maxCoeff() - corner.rowwise().minCoeff()).maxCoeff();
    const bool has_odd_unit = widest < smallest_organ_mm;
    throw ModelError(
        {.fact = fmt::format("no place on the {} has room for a tool of {:.1f} mm diameter", side,
                             options.indenter_diameter_mm),
         .where = "contact patch",
         .why = has_odd_unit ? fmt::format("the body is {:.2g} mm wide: the image may be in metres", widest)
                             : "it would extend beyond the organ's edge everywhere",
         .remedy = has_odd_unit ? "check the unit of the image: voxel sizes are millimetres"
                                : "make it smaller with --indenter-diameter (or --tool), or see `dimple "
                                  "places IMAGE` for where it fits"});
  }
  result.centre = *contact;
  result.room = place->room;
  result.patch_reason = fmt::format(
      "highest point with room for the contact patch{} on the {}{}{}",
      requested.half ? fmt::format(" of the {} half", side_towards(*requested.half)) : "", side,
      result.approach == result.down ? ", opposite to the base" : "",
      place->equals == 2  ? "; another point has the same height"
      : place->equals > 2 ? fmt::format("; {} other points have the same height", place->equals - 1)
                          : "");
}

// A tilted tool keeps the place that it would have upright, `straight`, not the highest along `approach`.
void place_tilted(const BodySurface& body, const Moments& moments, const BoundaryOptions& options,
                  const RequestedPlace& requested, const Vec3& straight, Boundary& result) {
  Boundary upright = result;
  upright.approach = straight;
  place_on_highest(body, moments, options, requested, View(body, moments, straight), upright);
  const Vec3 x = body.to_world() * upright.centre;
  RequestedPlace there;
  there.place = x;
  place_as_requested(body, fmt::format("{:.1f},{:.1f},{:.1f}", x.x(), x.y(), x.z()), there,
                     View(body, moments, result.approach), radius_of_contact(options),
                     options.contact_radius_mm > 0.0, result);
  result.patch_reason =
      fmt::format("{}; tilted there by {:.0f} degrees", upright.patch_reason,
                  180.0 / std::numbers::pi * std::acos(std::min(1.0, straight.dot(result.approach))));
}

// `straight`: the direction of a tool without one of its own.
void find_patch(const BodySurface& body, const Moments& moments, const BoundaryOptions& options,
                const RequestedPlace& requested, const Vec3& straight, Boundary& result) {
  constexpr double most_tilted = 0.65;  // its cosine: beyond that the tool comes from another side
  check_width(options, result);
  const View view(body, moments, result.approach);
  const double tilt = straight.dot(result.approach);
  if (requested.place)
    place_as_requested(body, options.indent_at, requested, view, radius_of_contact(options),
                       options.contact_radius_mm > 0.0, result);
  else if (tilt > most_tilted && tilt < 1.0 - 1e-9)
    place_tilted(body, moments, options, requested, straight, result);
  else
    place_on_highest(body, moments, options, requested, view, result);
  if (result.room < preferred_room * result.radius)
    result.patch_reason +=
        fmt::format("; the nearest fold or edge is {:.1f} mm from its middle", result.room);
  else
    result.patch_reason +=
        fmt::format("; no fold or edge within {:.1f} mm of its middle", preferred_room * result.radius);
  if (result.room < little_room * result.radius)
    result.warnings.push_back(
        fmt::format("the tool has little room for a contact patch of {:.4g} mm diameter: a fold, an edge or "
                    "a steep slope is {:.1f} mm from its middle; {:.4g} mm would be enough. At large depths "
                    "tissue may fold onto itself there{}",
                    2.0 * result.radius, result.room, preferred_room * result.radius,
                    requested.place ? "" : "; no other place has more room"));
  if (!body.image_ends().empty() && body.at_image_end(result.centre))
    result.warnings.push_back(
        "THE TOOL IS WHERE THE IMAGE ENDS: the surface beneath it is where the scan was cut, not the organ's "
        "own surface; `dimple places IMAGE` lists other places");
}

}  // namespace

void check_words(const BoundaryOptions& options) {
  base_direction(options.base);
  parse_place(options.indent_at);
}

Boundary find_boundary(const BodySurface& body, const BoundaryOptions& options, const Boundary* known) {
  Boundary result;
  const Moments moments = moments_of(body);
  const RequestedPlace requested = parse_place(options.indent_at);
  if (known)
    result = {.down = known->down,
              .lowest = known->lowest,
              .height = known->height,
              .base_depth = known->base_depth,
              .flat_base = known->flat_base,
              .base_by_axes = known->base_by_axes,
              .base_reason = known->base_reason,
              .patch_reason = {},
              .warnings = {}};
  else
    find_base(body, moments, options, requested.from, result);
  warn_of_base_at_image_end(body, result);
  result.radius = 0.5 * options.indenter_diameter_mm;
  result.approach = approach_of(body, options, requested, known, result.down);
  BoundaryOptions without_direction = options;
  without_direction.direction = "auto";
  const Vec3 straight = approach_of(body, without_direction, requested, known, result.down);
  find_patch(body, moments, options, requested, straight, result);
  return result;
}

Vec3 place_of_contact(const BodySurface& body, const Boundary& boundary, double reach,
                      const std::function<double(double)>& height) {
  constexpr int cells = 12,
                halvings = 5;  // of the reach: places are tried on a lattice, then nearer the best
  const Vec3 e = boundary.approach.unitOrthogonal(), g = boundary.approach.cross(e);
  Eigen::Vector2d best = Eigen::Vector2d::Zero();
  Vec3 place = boundary.centre;
  double soonest = height(0.0);
  const auto look_around = [&](const Eigen::Vector2d& middle, double step, int half) {
    for (int i = -half; i <= half; ++i)
      for (int k = -half; k <= half; ++k) {
        const Eigen::Vector2d at = middle + step * Eigen::Vector2d(i, k);
        if (!(at.norm() < reach)) continue;
        const auto contact =
            first_contact(body, boundary.centre + at.x() * e + at.y() * g, boundary.approach);
        if (!contact) continue;
        const double travel = (*contact - boundary.centre).dot(boundary.approach) + height(at.norm());
        if (!(travel < soonest - 1e-9 * reach)) continue;
        soonest = travel, best = at, place = *contact;
      }
  };
  double step = reach / cells;
  look_around(best, step, cells);
  for (int k = 0; k < halvings; ++k) look_around(Eigen::Vector2d(best), step *= 0.5, 1);
  return place;
}

namespace {

bool is_near_middle(const Boundary& boundary, const Vec3& contact) {
  return std::abs((contact - boundary.centre).dot(boundary.approach)) <= 2.0 * boundary.radius;
}

// False deep in or through the gap of a cut, where the tool cannot come.
bool is_under_patch(const BodySurface& body, const Boundary& boundary, const Vec3& x) {
  const auto contact = first_contact(body, x, boundary.approach);
  return contact && is_near_middle(boundary, *contact);
}

Vec3 contact_of_patch(const BodySurface& body, const Boundary& boundary, const Vec3& x) {
  const auto contact = first_contact(body, x, boundary.approach);
  if (contact && is_near_middle(boundary, *contact)) return *contact;
  const Vec3 world = body.to_world() * boundary.centre;
  throw ModelError(
      {.fact = fmt::format("the contact patch of {:.1f} mm diameter at ({:.1f}, {:.1f}, {:.1f}) mm extends "
                           "beyond the organ's edge",
                           2.0 * boundary.radius, world.x(), world.y(), world.z()),
       .where = "contact patch",
       .why = contact
                  ? "below a part of its edge the surface is more than a diameter deeper than at its middle"
                  : "a part of its edge meets no tissue",
       .remedy = "move it with --indent-at or make it smaller with --indenter-diameter (or --tool)"});
}

// Adds `count` places on the surface at distance r from the patch's axis, the first rotated by half a `turn`.
void add_ring(const BodySurface& body, const Boundary& boundary, double r, int count, double turn,
              std::vector<Vec3>& nodes) {
  const auto [e1, e2] = across(boundary.approach);
  for (int k = 0; k < count; ++k) {
    const double angle = 2.0 * std::numbers::pi * (k + turn) / count;
    const Vec3 x = boundary.centre + r * (std::cos(angle) * e1 + std::sin(angle) * e2);
    if (!boundary.over_cut || is_under_patch(body, boundary, x))
      nodes.push_back(contact_of_patch(body, boundary, x));
  }
}

// Middle of the patch; none if a cut has removed it.
std::vector<Vec3> middle_of_patch(const BodySurface& body, const Boundary& boundary) {
  if (!boundary.over_cut) return {boundary.centre};
  if (!is_under_patch(body, boundary, boundary.centre)) return {};
  return {contact_of_patch(body, boundary, boundary.centre)};
}

}  // namespace

Points to_points(const std::vector<Vec3>& places) {
  Points result(3, static_cast<Index>(places.size()));
  for (std::size_t k = 0; k < places.size(); ++k) result.col(static_cast<Index>(k)) = places[k];
  return result;
}

Points edge_of_patch(const BodySurface& body, const Boundary& boundary, int count) {
  std::vector<Vec3> patch_edge;
  add_ring(body, boundary, boundary.radius, count, 0.0, patch_edge);
  return to_points(patch_edge);
}

Points patch_nodes(const BodySurface& body, const Boundary& boundary, double spacing_mm) {
  const int rings = std::max(1, static_cast<int>(std::ceil(boundary.radius / spacing_mm - 0.2)));
  std::vector<Vec3> nodes = middle_of_patch(body, boundary);
  for (int ring = 1; ring <= rings; ++ring) {
    const double r = boundary.radius * ring / rings;
    const int count = std::max(6, static_cast<int>(std::lround(2.0 * std::numbers::pi * r / spacing_mm)));
    // Alternate rings are rotated so that their nodes do not line up.
    add_ring(body, boundary, r, count, 0.5 * (ring % 2), nodes);
  }
  return to_points(nodes);
}

Points graded_patch_nodes(const BodySurface& body, const Boundary& boundary,
                          const std::function<double(double)>& spacing) {
  std::vector<double> radii = {boundary.radius};
  // Rings are a little closer than the nodes along them, as rows of equilateral triangles are.
  for (double r = boundary.radius;;) {
    const double step = 0.9 * spacing(std::max(0.0, r - 0.45 * spacing(r)));
    r -= step;
    if (r < 0.6 * step) break;
    radii.push_back(r);
  }
  // The remainder at the middle is distributed over all rings inside the edge.
  const double last = radii.back(), goal = 0.9 * spacing(0.0);
  if (radii.size() > 1) {
    const double excess = last - std::max(goal, 0.0), span = boundary.radius - last;
    for (std::size_t k = 1; k < radii.size(); ++k)
      radii[k] -= 0.5 * excess * (boundary.radius - radii[k]) / span;
  }
  std::vector<Vec3> nodes = middle_of_patch(body, boundary);
  for (std::size_t k = 0; k < radii.size(); ++k) {
    const int count =
        std::max(6, static_cast<int>(std::lround(2.0 * std::numbers::pi * radii[k] / spacing(radii[k]))));
    add_ring(body, boundary, radii[k], count, 0.5 * static_cast<double>(k % 2), nodes);
  }
  return to_points(nodes);
}

std::optional<Vec3> parse_vector(const std::string& text) {
  Vec3 v;
  const char* p = text.data();
  const char* end = p + text.size();
  for (int d = 0; d < 3; ++d) {
    while (p < end && *p == ' ') ++p;
    const auto [next, error] = std::from_chars(p, end, v[d]);
    if (error != std::errc{} || !std::isfinite(v[d])) return std::nullopt;
    p = next;
    if (d < 2 && (p == end || *p++ != ',')) return std::nullopt;
  }
  return p == end ? std::optional<Vec3>(v) : std::nullopt;
}

}  // namespace dimple
