#include "preprocess/boundary_conditions.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <numbers>

#include "io/error.hpp"
#include "io/words.hpp"
#include "preprocess/circle_place.hpp"
#include "preprocess/flat_face.hpp"

namespace dimple {
namespace {

struct Side {
  const char* word;
  Vec3 lps;
};
const std::array<Side, 6> sides = {{{"inferior", {0, 0, -1}},
                                    {"posterior", {0, 1, 0}},
                                    {"anterior", {0, -1, 0}},
                                    {"left", {1, 0, 0}},
                                    {"right", {-1, 0, 0}},
                                    {"superior", {0, 0, 1}}}};
// Other words for them: as 3D Slicer's letters, and as one speaks of an image whose z points up.
const std::map<std::string, std::string> same_side = {
    {"bottom", "inferior"}, {"below", "inferior"}, {"under", "inferior"}, {"down", "inferior"},
    {"top", "superior"},    {"above", "superior"}, {"up", "superior"},    {"front", "anterior"},
    {"back", "posterior"},  {"I", "inferior"},     {"S", "superior"},     {"A", "anterior"},
    {"P", "posterior"},     {"L", "left"},         {"R", "right"}};

constexpr double flat_share = 0.25;      // of the outline that must touch for a face to count as flat
constexpr double same_area = 0.02;       // flat faces that differ by less are as large
constexpr double bed_depth = 1.0 / 3.0;  // of the height, for an organ without a flat face
constexpr double dome_depth = 0.2;       // of the height: the part of a side that counts as its dome
constexpr double same_dome = 0.05;       // domes that differ by less are as broad
constexpr double same_moment = 0.9;      // variances across two axes: from here on neither is the thinner one
constexpr double few_voxels = 3.0;       // across the circle
constexpr double widest_circle = 1000.0;  // mm: as wide as --indenter-diameter takes

std::string side_name(const Vec3& lps) {
  const auto best = std::max_element(sides.begin(), sides.end(), [&](const Side& a, const Side& b) {
    return a.lps.dot(lps) < b.lps.dot(lps) - 1e-9;
  });
  return best->word;
}

// "inferior", or "inferior (0.17, 0.00, -0.98)" where it is not along that axis of the patient.
std::string side_in_words(const BodySurface& body, const Vec3& down) {
  const Vec3 lps = body.to_world().linear() * down;
  const std::string name = side_name(lps);
  if (lps.cwiseAbs().maxCoeff() > 1.0 - 1e-6) return name + " side";
  return fmt::format("{} side ({:.2f}, {:.2f}, {:.2f})", name, lps.x() + 0.0, lps.y() + 0.0, lps.z() + 0.0);
}

// Which of several equal directions an organ rests on: an organ in an image lies or stands on its lower side,
// then on its back.
double preference(const BodySurface& body, const Vec3& down) {
  return (body.to_world().linear() * down).dot(Vec3(0.01, 0.1, -1.0));
}

// Area of what lies close to the outermost place across `down`, of the body's outline.
double dome_of(const BodySurface& body, const Vec3& down) {
  const Eigen::VectorXd depth = body.vertex().transpose() * down;
  const double lowest = depth.maxCoeff(), height = lowest - depth.minCoeff();
  double dome = 0.0, outline = 0.0;
  for (Index t = 0; t < body.triangles().cols(); ++t) {
    const double facing = body.normal().col(t).dot(down);
    outline += 0.5 * std::abs(facing) * body.triangle_area()[t];
    const double centre =
        (depth[body.triangles()(0, t)] + depth[body.triangles()(1, t)] + depth[body.triangles()(2, t)]) / 3.0;
    if (facing > 0.0 && lowest - centre < dome_depth * height) dome += facing * body.triangle_area()[t];
  }
  return dome / outline;
}

Vec3 local_direction(const BodySurface& body, const Vec3& lps) {
  return body.to_world().linear().transpose() * lps;
}

// The image axis nearest to an LPS direction: a side of the image, not of the scanner's room.
Vec3 nearest_axis(const BodySurface& body, const Vec3& lps) {
  const Vec3 local = local_direction(body, lps);
  Index axis = 0;
  local.cwiseAbs().maxCoeff(&axis);
  return (local[axis] < 0.0 ? -1.0 : 1.0) * Vec3::Unit(axis);
}

// The direction across which a body without a flat face is bedded, and why.
Vec3 bedded_on(const BodySurface& body, const Moments& moments, std::string& reason) {
  const Eigen::SelfAdjointEigenSolver<Mat3> axes(moments.second);
  const Vec3 variance = axes.eigenvalues();
  Vec3 down;
  if (variance[0] < same_moment * variance[1]) {
    down = axes.eigenvectors().col(0);
    down = ((1e5 * down).array().round() * 1e-5).matrix().normalized();
    reason = "across which the organ is thinnest";
  } else {
    // As thin across two axes, or across all three: the patient's own directions, across what is longer.
    const bool round = variance[1] >= same_moment * variance[2];
    const Vec3 along = axes.eigenvectors().col(2);
    const auto across = [&](const Vec3& lps) {
      const Vec3 axis = nearest_axis(body, lps);
      return round ? axis : Vec3(axis - axis.dot(along) * along);
    };
    down = across(Vec3(0, 0, -1));
    if (down.norm() < 0.5) down = across(Vec3(0, 1, 0));
    down.normalize();
    reason = fmt::format("as the organ is about as thin in {} directions the patient's own decide",
                         round ? "all" : "two");
  }
  const double below = dome_of(body, down), above = dome_of(body, -down);
  const double pointed = down.dot(moments.third) / std::pow(moments.size, 3);
  const bool turn = std::abs(below - above) > same_dome * std::max(below, above) ? below > above
                    : std::abs(pointed) > 0.02                                   ? pointed < 0.0
                                               : preference(body, -down) > preference(body, down);
  if (turn) down = -down;
  reason += fmt::format("; its dome there is {:.0f} % of the outline, that of the side above {:.0f} %",
                        100.0 * (turn ? above : below), 100.0 * (turn ? below : above));
  return down;
}

void rest_on(const FlatFace& face, Boundary& result) {
  result.down = face.out;
  result.lowest = face.offset;
  result.height = face.height;
  result.flat_base = true;
  result.base_depth = face.tolerance;
}

void bed_on(const BodySurface& body, const Vec3& down, Boundary& result) {
  const Eigen::VectorXd depth = body.vertex().transpose() * down;
  result.down = down;
  result.lowest = depth.maxCoeff();
  result.height = result.lowest - depth.minCoeff();
  result.flat_base = false;
  result.base_depth = bed_depth * result.height;
}

void find_base(const BodySurface& body, const Moments& moments, const BoundaryOptions& options,
               Boundary& result) {
  const auto stands = [](const FlatFace& face) { return face.outermost && face.share >= flat_share; };
  if (options.base == "auto") {
    const std::vector<FlatFace> faces = flat_faces(body, moments);
    const FlatFace* largest = nullptr;
    double share = 0.0;
    for (const FlatFace& face : faces) {
      if (face.outermost) share = std::max(share, face.share);
      if (!stands(face)) continue;
      if (!largest || (face.area > (1.0 - same_area) * largest->area &&
                       preference(body, face.out) > preference(body, largest->out) + 1e-6))
        largest = &face;
    }
    if (largest) {
      rest_on(*largest, result);
      result.base_reason =
          fmt::format("largest flat face: {:.0f} % of the outline touches its plane", 100.0 * largest->share);
    } else {
      std::string reason;
      bed_on(body, bedded_on(body, moments, reason), result);
      result.base_reason = fmt::format(
          "no flat face (at most {:.0f} % of an outline touches): bedded on the side {}; {:.0f} mm high",
          100.0 * share, reason, result.height);
    }
  } else {
    const auto other = same_side.find(options.base);
    const std::string& word = other == same_side.end() ? options.base : other->second;
    const auto named =
        std::find_if(sides.begin(), sides.end(), [&](const Side& s) { return s.word == word; });
    const auto vector = parse_vector(options.base);
    Vec3 down;
    if (named != sides.end()) {
      down = nearest_axis(body, named->lps);
    } else if (vector && vector->norm() > 0.0) {
      down = local_direction(body, vector->normalized());
    } else {
      throw UsageError({.fact = fmt::format("'{}' is not a side", options.base),
                        .where = "--base (boundary.base)",
                        .why = "a side is auto, inferior (or bottom), superior (top), left, right, anterior "
                               "(front), posterior "
                               "(back) or x,y,z",
                        .remedy = "give one of these, for instance --base inferior"});
    }
    const FlatFace face = face_towards(body, moments, down);
    if (stands(face))
      rest_on(face, result);
    else
      bed_on(body, down, result);
    result.base_reason =
        fmt::format("asked for; {:.0f} % of the outline touches the plane there", 100.0 * face.share);
  }
  if (options.base_depth_mm > 0.0) result.base_depth = options.base_depth_mm;
  result.base_reason = fmt::format("{}; {}; held to {:.1f} mm up", side_in_words(body, result.down),
                                   result.base_reason, result.base_depth);
}

// The place where the tool, coming along `push` through `x`, first meets the body.
std::optional<Vec3> first_touch(const BodySurface& body, const Vec3& x, const Vec3& push) {
  const std::vector<double> t = body.crossings(x, push);
  if (t.empty()) return std::nullopt;
  return x + t.front() * push;
}

struct Frame2 {
  Vec3 e1, e2;
};

Frame2 across(const Vec3& push) {
  Index axis = 0;
  push.cwiseAbs().minCoeff(&axis);
  const Vec3 e1 = (Vec3::Unit(axis) - push[axis] * push).normalized();
  return {e1, push.cross(e1)};
}

std::string words(const BodySurface& body, const Vec3& local) {
  return in_words(Vec3(body.to_world() * local));
}

// A place that is asked for in LPS [mm]: x,y,z, or x,y,top where z is not known.
struct Asked {
  Vec3 place;
  bool moved_freely = false;
};

std::optional<Asked> parse_place(const BodySurface& body, const std::string& text) {
  const std::string top = ",top";
  if (text.size() > top.size() && text.compare(text.size() - top.size(), top.size(), top) == 0) {
    auto flat = parse_vector(text.substr(0, text.size() - top.size()) + ",0");
    if (!flat) return std::nullopt;
    flat->z() = (body.to_world() * body.centroid()).z();
    return Asked{*flat, true};
  }
  const auto place = parse_vector(text);
  return place ? std::optional<Asked>({*place, false}) : std::nullopt;
}

void place_as_asked(const BodySurface& body, const std::string& asked_for, const Asked& place,
                    const View& view, Boundary& result) {
  const Vec3 asked = body.to_world().inverse() * place.place;
  const auto touch = first_touch(body, asked, result.push);
  if (!touch) {
    const Vec3 lower = body.to_world() * body.lower(), upper = body.to_world() * body.upper();
    throw ModelError(
        {.fact = fmt::format("the indenter at {} mm misses the organ", asked_for),
         .where = "--indent-at (boundary.indent_at)",
         .why = fmt::format("a line through it along the push direction meets no tissue; the organ lies "
                            "between ({:.1f}, {:.1f}, {:.1f}) and ({:.1f}, {:.1f}, {:.1f}) mm",
                            std::min(lower.x(), upper.x()), std::min(lower.y(), upper.y()),
                            std::min(lower.z(), upper.z()), std::max(lower.x(), upper.x()),
                            std::max(lower.y(), upper.y()), std::max(lower.z(), upper.z())),
         .remedy = fmt::format("give a place over the organ, such as the nearest of its surface, {}, or "
                               "--indent-at top",
                               words(body, body.closest(asked).place))});
  }
  result.centre = *touch;
  const double moved = (*touch - asked).norm();
  if (moved > 4.0 * result.radius && !place.moved_freely)
    throw ModelError(
        {.fact = fmt::format("the place {} mm lies {:.1f} mm from where the circle meets the organ",
                             asked_for, moved),
         .where = "--indent-at (boundary.indent_at)",
         .why = fmt::format(
             "coming along the push the circle of {:.4g} mm diameter touches the organ at {}; more "
             "than two diameters away another place is likely to be meant",
             2.0 * result.radius, words(body, *touch)),
         .remedy =
             fmt::format("give that place; the surface nearest to the one given is at {}, where another "
                         "--direction may be needed",
                         words(body, body.closest(asked).place)),
         .code = "place-moved"});
  result.circle_reason = fmt::format("asked for; moved {:.1f} mm along the push onto the surface", moved);
  if (moved > result.radius && !place.moved_freely)
    result.warnings.push_back(fmt::format(
        "the place {} mm that --indent-at gives was moved by {:.1f} mm, more than the circle's radius: "
        "along the push the organ is met first at {}",
        asked_for, moved, words(body, *touch)));
  const Room room = room_around(view, view.flat(*touch), result.radius);
  result.room = room.even;
  if (room.whole < result.radius)
    throw ModelError(
        {.fact = fmt::format("the indenter's circle of {:.4g} mm diameter at {} hangs over the organ's edge",
                             2.0 * result.radius, words(body, *touch)),
         .where = "--indent-at (boundary.indent_at)",
         .why = fmt::format("{:.1f} mm from its middle the surface ends or drops by more than a radius",
                            room.whole),
         .remedy =
             "move it with --indent-at, make it smaller with --indenter-diameter, or leave the place to "
             "--indent-at top"});
}

void find_circle(const BodySurface& body, const Moments& moments, const BoundaryOptions& options,
                 Boundary& result) {
  result.radius = 0.5 * options.indenter_diameter_mm;
  result.push = result.down;
  if (options.direction != "auto") {
    const auto vector = parse_vector(options.direction);
    if (!vector || !(vector->norm() > 0.0))
      throw UsageError({.fact = fmt::format("'{}' is not a direction", options.direction),
                        .where = "--direction (boundary.direction)",
                        .why = "a direction is auto or three numbers x,y,z in LPS",
                        .remedy = "for instance --direction 0,0,-1 to push down"});
    result.push = local_direction(body, vector->normalized());
  }
  const double across = options.indenter_diameter_mm / std::max(options.voxel_mm, 1e-300);
  if (options.voxel_mm > 0.0 && across < 1.0)
    throw ModelError(
        {.fact = fmt::format("the indenter of {:.4g} mm diameter is smaller than a voxel of {:.4g} mm",
                             options.indenter_diameter_mm, options.voxel_mm),
         .where = "--indenter-diameter (boundary.indenter_diameter_mm)",
         .why = "the image does not say what the surface is like beneath it",
         .remedy =
             few_voxels * options.voxel_mm > widest_circle
                 ? std::string(
                       "no circle is wide enough for such voxels: check the unit of the image's voxel "
                       "spacing, which is taken as millimetres")
                 : fmt::format("give at least {:.4g} mm, or a finer image", few_voxels * options.voxel_mm),
         .code = "circle-too-small"});
  if (options.voxel_mm > 0.0 && across < few_voxels)
    result.warnings.push_back(fmt::format(
        "the indenter of {:.4g} mm diameter is {:.1f} voxels across: the surface beneath it is hardly "
        "known",
        options.indenter_diameter_mm, across));

  const View view(body, moments, result.push);
  const auto asked = parse_place(body, options.indent_at);
  if (asked) {
    place_as_asked(body, options.indent_at, *asked, view, result);
  } else {
    const bool left = options.indent_at == "left", right = options.indent_at == "right";
    if (!left && !right && options.indent_at != "top")
      throw UsageError({.fact = fmt::format("'{}' is not a place to indent", options.indent_at),
                        .where = "--indent-at (boundary.indent_at)",
                        .why = "a place is top, left, right, x,y,z in LPS mm, or x,y,top",
                        .remedy = "for instance --indent-at left"});
    std::optional<Eigen::Vector2d> side;
    if (left || right) side = view.flat(local_direction(body, (left ? 1.0 : -1.0) * Vec3::UnitX()));
    const auto place = highest_dome(view, moments, result.radius, result.height, side,
                                    local_direction(body, Vec3(1.0, 0.1, 0.01)));
    const auto touch = place ? first_touch(body, view.at(place->centre, 0.0), result.push) : std::nullopt;
    if (!touch)
      throw ModelError(
          {.fact = fmt::format("no place on the {} takes an indenter of {:.1f} mm diameter",
                               options.indent_at, options.indenter_diameter_mm),
           .where = "indenter circle",
           .why = "it would hang over the organ's edge everywhere",
           .remedy = "make it smaller with --indenter-diameter, or choose the place with --indent-at x,y,z"});
    result.centre = *touch;
    result.room = place->room;
    result.circle_reason =
        fmt::format("over the highest dome with room{}{}{}",
                    left    ? " of the left half"
                    : right ? " of the right half"
                            : "",
                    options.direction == "auto" ? ", opposite to the base" : "",
                    place->equals > 1 ? fmt::format(", one of {} as high", place->equals) : "");
  }
  const double short_of_room = 1.75 * result.radius;
  if (result.room < wanted_room * result.radius)
    result.circle_reason +=
        fmt::format("; the nearest fold or edge is {:.1f} mm from its middle", result.room);
  else
    result.circle_reason +=
        fmt::format("; no fold or edge within {:.1f} mm of its middle", wanted_room * result.radius);
  if (result.room < short_of_room)
    result.warnings.push_back(fmt::format(
        "the circle of {:.4g} mm diameter has little room: {:.1f} mm from its middle a fold, an edge or a "
        "steep slope "
        "cuts the surface, and {:.4g} mm are wanted; tissue may fold onto itself there under a deep push{}",
        2.0 * result.radius, result.room, wanted_room * result.radius,
        asked ? "" : "; no other place is better"));
}

}  // namespace

Boundary find_boundary(const BodySurface& body, const BoundaryOptions& options, const Boundary* known) {
  Boundary result;
  const Moments moments = moments_of(body);
  if (known)
    result = {.down = known->down,
              .lowest = known->lowest,
              .height = known->height,
              .base_depth = known->base_depth,
              .flat_base = known->flat_base,
              .base_reason = known->base_reason,
              .circle_reason = {},
              .warnings = {}};
  else
    find_base(body, moments, options, result);
  find_circle(body, moments, options, result);
  return result;
}

bool on_base(const Boundary& boundary, const Vec3& x, const Vec3& normal) {
  if (boundary.lowest - x.dot(boundary.down) > boundary.base_depth) return false;
  // The sides that rise from a flat face are not part of it; a bed reaches to where the organ overhangs it.
  return normal.dot(boundary.down) > (boundary.flat_base ? 0.5 : 1e-6);
}

namespace {

Vec3 touch_of_circle(const BodySurface& body, const Boundary& boundary, const Vec3& x) {
  const auto touch = first_touch(body, x, boundary.push);
  if (touch && std::abs((*touch - boundary.centre).dot(boundary.push)) <= 2.0 * boundary.radius)
    return *touch;
  const Vec3 world = body.to_world() * boundary.centre;
  throw ModelError(
      {.fact = fmt::format("the indenter's circle of {:.1f} mm diameter at ({:.1f}, {:.1f}, {:.1f}) mm hangs "
                           "over the organ's edge",
                           2.0 * boundary.radius, world.x(), world.y(), world.z()),
       .where = "indenter circle",
       .why = touch ? "at a part of its rim the surface lies more than a diameter deeper"
                    : "a part of its rim meets no tissue",
       .remedy = "move it with --indent-at or make it smaller with --indenter-diameter"});
}

// `count` places on the surface at distance r from the circle's axis, the first half a `turn` on.
void add_ring(const BodySurface& body, const Boundary& boundary, double r, int count, double turn,
              std::vector<Vec3>& nodes) {
  const auto [e1, e2] = across(boundary.push);
  for (int k = 0; k < count; ++k) {
    const double angle = 2.0 * std::numbers::pi * (k + turn) / count;
    const Vec3 x = boundary.centre + r * (std::cos(angle) * e1 + std::sin(angle) * e2);
    nodes.push_back(touch_of_circle(body, boundary, x));
  }
}

}  // namespace

Points to_points(const std::vector<Vec3>& places) {
  Points result(3, static_cast<Index>(places.size()));
  for (std::size_t k = 0; k < places.size(); ++k) result.col(static_cast<Index>(k)) = places[k];
  return result;
}

Points rim_of_circle(const BodySurface& body, const Boundary& boundary, int count) {
  std::vector<Vec3> rim;
  add_ring(body, boundary, boundary.radius, count, 0.0, rim);
  return to_points(rim);
}

Points circle_nodes(const BodySurface& body, const Boundary& boundary, double spacing_mm) {
  const int rings = std::max(1, static_cast<int>(std::ceil(boundary.radius / spacing_mm - 0.2)));
  std::vector<Vec3> nodes = {boundary.centre};
  for (int ring = 1; ring <= rings; ++ring) {
    const double r = boundary.radius * ring / rings;
    const int count = std::max(6, static_cast<int>(std::lround(2.0 * std::numbers::pi * r / spacing_mm)));
    // Rings are turned against each other so that their nodes do not line up.
    add_ring(body, boundary, r, count, 0.5 * (ring % 2), nodes);
  }
  return to_points(nodes);
}

Points graded_circle_nodes(const BodySurface& body, const Boundary& boundary,
                           const std::function<double(double)>& spacing) {
  std::vector<double> radii = {boundary.radius};
  // Rings a little closer than their nodes along them, as rows of equilateral triangles are.
  for (double r = boundary.radius;;) {
    const double step = 0.9 * spacing(std::max(0.0, r - 0.45 * spacing(r)));
    r -= step;
    if (r < 0.6 * step) break;
    radii.push_back(r);
  }
  // The last step to the middle is whatever is left: spread it over all rings inside the rim.
  const double last = radii.back(), wanted = 0.9 * spacing(0.0);
  if (radii.size() > 1) {
    const double excess = last - std::max(wanted, 0.0), span = boundary.radius - last;
    for (std::size_t k = 1; k < radii.size(); ++k)
      radii[k] -= 0.5 * excess * (boundary.radius - radii[k]) / span;
  }
  std::vector<Vec3> nodes = {boundary.centre};
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
