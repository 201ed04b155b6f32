#include "preprocess/boundary_conditions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numbers>

#include "io/error.hpp"

namespace dimple {
namespace {

struct Side {
  const char* word;
  Vec3 lps;
};
// In the order in which ties are decided: an organ in an image lies or stands on its lower side.
const std::array<Side, 6> sides = {{{"inferior", {0, 0, -1}},
                                    {"posterior", {0, 1, 0}},
                                    {"anterior", {0, -1, 0}},
                                    {"left", {1, 0, 0}},
                                    {"right", {-1, 0, 0}},
                                    {"superior", {0, 0, 1}}}};

constexpr double flat_share = 0.25;        // of the outline that must touch for a face to count as flat
constexpr double flat_tolerance = 0.02;    // of the height
constexpr double bed_depth = 1.0 / 3.0;    // of the height, for an organ without a flat face
constexpr double dome_depth = 0.2;         // of the height: the part of a side that counts as its dome
constexpr double thick_enough = 0.5;       // of the organ's greatest thickness must lie beneath the circle
constexpr double dome_tolerance = 0.0025;  // of the height: domes that differ by less are equally high

std::string side_name(const Vec3& lps) {
  const auto best = std::max_element(sides.begin(), sides.end(), [&](const Side& a, const Side& b) {
    return a.lps.dot(lps) < b.lps.dot(lps) - 1e-9;
  });
  return best->word;
}

struct Stand {
  double lowest = 0.0, height = 0.0;
  double touching = 0.0;  // flat area touching the plane [mm^2]
  double share = 0.0;     // that / outline seen from below
  double dome = 0.0;      // area of its dome, seen from below / outline
};

Stand stand_on(const BodySurface& body, const Vec3& down, double tolerance_mm) {
  Stand stand;
  const Eigen::VectorXd depth = body.vertex().transpose() * down;
  stand.lowest = depth.maxCoeff();
  stand.height = stand.lowest - depth.minCoeff();
  const double tolerance = std::max(flat_tolerance * stand.height, tolerance_mm);
  double touching = 0.0, dome = 0.0, outline = 0.0;
  for (Index t = 0; t < body.triangles().cols(); ++t) {
    const double facing = body.normal().col(t).dot(down);
    outline += 0.5 * std::abs(facing) * body.triangle_area()[t];
    const double centre =
        (depth[body.triangles()(0, t)] + depth[body.triangles()(1, t)] + depth[body.triangles()(2, t)]) / 3.0;
    if (facing > 0.9 && stand.lowest - centre < tolerance) touching += facing * body.triangle_area()[t];
    if (facing > 0.0 && stand.lowest - centre < dome_depth * stand.height)
      dome += facing * body.triangle_area()[t];
  }
  stand.touching = touching;
  stand.share = touching / outline;
  stand.dome = dome / outline;
  return stand;
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

void find_base(const BodySurface& body, const BoundaryOptions& options, double node_spacing_mm,
               Boundary& result) {
  const double tolerance = 0.25 * node_spacing_mm;
  Stand stand;
  std::string side;
  if (options.base == "auto") {
    std::array<Stand, 6> stands;
    std::array<Vec3, 6> axes;
    std::size_t flattest = 0;
    for (std::size_t s = 0; s < 6; ++s) {
      axes[s] = nearest_axis(body, sides[s].lps);
      stands[s] = stand_on(body, axes[s], tolerance);
      // The largest flat face: a block stands on its broad side.
      const bool flat = stands[s].share >= flat_share, flat_before = stands[flattest].share >= flat_share;
      if ((flat && !flat_before) ||
          (flat == flat_before && stands[s].touching > 1.05 * stands[flattest].touching))
        flattest = s;
    }
    std::size_t chosen = flattest;
    if (stands[flattest].share >= flat_share) {
      result.base_reason = fmt::format("largest flat face: {:.0f} % of its outline touches the plane there",
                                       100.0 * stands[flattest].share);
    } else {
      chosen = 0;
      for (std::size_t s = 1; s < 6; ++s) {
        const bool lower = stands[s].height < 0.9 * stands[chosen].height;
        const bool opposite = axes[s].dot(axes[chosen]) < -0.5;
        if (lower || (opposite && stands[s].dome < 0.9 * stands[chosen].dome)) chosen = s;
      }
      result.base_reason = fmt::format(
          "no flat face (at most {:.0f} % of an outline touches): bedded on the {} side, across "
          "which the organ is {:.0f} mm high; its dome is {:.0f} % of the outline, that of the side above "
          "{:.0f} %",
          100.0 * stands[flattest].share, sides[chosen].word, stands[chosen].height,
          100.0 * stands[chosen].dome, 100.0 * stand_on(body, -axes[chosen], tolerance).dome);
    }
    stand = stands[chosen];
    side = sides[chosen].word;
    result.down = axes[chosen];
  } else {
    const auto named =
        std::find_if(sides.begin(), sides.end(), [&](const Side& s) { return s.word == options.base; });
    const auto vector = parse_vector(options.base);
    if (named != sides.end()) {
      result.down = nearest_axis(body, named->lps);
    } else if (vector && vector->norm() > 0.0) {
      result.down = local_direction(body, vector->normalized());
    } else {
      throw UsageError(
          {.fact = fmt::format("'{}' is not a side", options.base),
           .where = "--base (boundary.base)",
           .why = "a side is auto, inferior, superior, left, right, anterior, posterior or x,y,z",
           .remedy = "give one of these, for instance --base inferior"});
    }
    stand = stand_on(body, result.down, tolerance);
    side = side_name(body.to_world().linear() * result.down);
    result.base_reason =
        fmt::format("asked for; {:.0f} % of its outline touches the plane there", 100.0 * stand.share);
  }
  result.lowest = stand.lowest;
  result.height = stand.height;
  result.flat_base = stand.share >= flat_share;
  if (options.base_depth_mm > 0.0) {
    result.base_depth = options.base_depth_mm;
  } else {
    result.base_depth = result.flat_base ? std::max(flat_tolerance * stand.height, 0.35 * node_spacing_mm)
                                         : bed_depth * stand.height;
  }
  result.base_reason =
      fmt::format("{} side; {}; held to {:.1f} mm up", side, result.base_reason, result.base_depth);
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

void find_circle(const BodySurface& body, const BoundaryOptions& options, Boundary& result) {
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

  if (const auto asked = parse_vector(options.indent_at)) {
    const Vec3 local = body.to_world().inverse() * *asked;
    const auto touch = first_touch(body, local, result.push);
    if (!touch) {
      const Vec3 lower = body.to_world() * body.lower(), upper = body.to_world() * body.upper();
      throw ModelError(
          {.fact = fmt::format("the indenter at {} mm misses the organ", options.indent_at),
           .where = "--indent-at (boundary.indent_at)",
           .why = fmt::format("a line through it along the push direction meets no tissue; the organ lies "
                              "between ({:.1f}, {:.1f}, {:.1f}) and ({:.1f}, {:.1f}, {:.1f}) mm",
                              std::min(lower.x(), upper.x()), std::min(lower.y(), upper.y()),
                              std::min(lower.z(), upper.z()), std::max(lower.x(), upper.x()),
                              std::max(lower.y(), upper.y()), std::max(lower.z(), upper.z())),
           .remedy = "give a place over the organ, or --indent-at top"});
    }
    result.centre = *touch;
    result.circle_reason = "asked for; moved along the push direction onto the surface";
    return;
  }
  const bool left = options.indent_at == "left", right = options.indent_at == "right";
  if (!left && !right && options.indent_at != "top")
    throw UsageError({.fact = fmt::format("'{}' is not a place to indent", options.indent_at),
                      .where = "--indent-at (boundary.indent_at)",
                      .why = "a place is top, left, right or x,y,z in LPS mm",
                      .remedy = "for instance --indent-at left"});

  // Height map: lines along the push, an eighth of the indenter apart.
  const auto [e1, e2] = across(result.push);
  const double step = options.indenter_diameter_mm / 8.0;
  const Vec3 middle = body.centroid();
  const Eigen::VectorXd c1 = body.vertex().transpose() * e1, c2 = body.vertex().transpose() * e2;
  const int half1 = static_cast<int>(
      std::ceil(std::max(c1.maxCoeff() - middle.dot(e1), middle.dot(e1) - c1.minCoeff()) / step));
  const int half2 = static_cast<int>(
      std::ceil(std::max(c2.maxCoeff() - middle.dot(e2), middle.dot(e2) - c2.minCoeff()) / step));
  const double none = std::numeric_limits<double>::quiet_NaN();
  Eigen::ArrayXXd height = Eigen::ArrayXXd::Constant(2 * half1 + 1, 2 * half2 + 1, none);  // against the push
  Eigen::ArrayXXd thickness = Eigen::ArrayXXd::Zero(height.rows(), height.cols());  // of what is met first
  const auto at = [&](int i, int j) {
    return Vec3(middle + (i - half1) * step * e1 + (j - half2) * step * e2);
  };
  for (int i = 0; i < height.rows(); ++i)
    for (int j = 0; j < height.cols(); ++j)
      if (const std::vector<double> t = body.crossings(at(i, j), result.push); !t.empty()) {
        height(i, j) = -at(i, j).dot(result.push) - t[0];
        thickness(i, j) = t[1] - t[0];
      }

  struct Candidate {
    int i, j;
    double mean, off_middle;
  };
  std::vector<Candidate> candidates;
  const int reach = 5;  // samples: the disc and a little more, so that the tool does not hang over an edge
  const Vec3 to_left = local_direction(body, Vec3::UnitX());
  for (int i = 0; i < height.rows(); ++i)
    for (int j = 0; j < height.cols(); ++j) {
      const double leftness = (at(i, j) - middle).dot(to_left);
      if ((left && leftness <= 0.0) || (right && leftness >= 0.0)) continue;
      if (thickness(i, j) < thick_enough * thickness.maxCoeff()) continue;  // a rim or a flange
      double sum = 0.0;
      int count = 0;
      bool whole = true;
      for (int di = -reach; di <= reach && whole; ++di)
        for (int dj = -reach; dj <= reach && whole; ++dj) {
          if (di * di + dj * dj > reach * reach) continue;
          const int ii = i + di, jj = j + dj;
          whole =
              ii >= 0 && jj >= 0 && ii < height.rows() && jj < height.cols() && std::isfinite(height(ii, jj));
          if (whole && di * di + dj * dj <= 16) {
            sum += height(ii, jj);
            ++count;
          }
        }
      if (whole) candidates.push_back({i, j, sum / count, (at(i, j) - middle).norm()});
    }
  if (candidates.empty())
    throw ModelError(
        {.fact = fmt::format("no place on the {} takes an indenter of {:.1f} mm diameter", options.indent_at,
                             options.indenter_diameter_mm),
         .where = "indenter circle",
         .why = "it would hang over the organ's edge everywhere",
         .remedy = "make it smaller with --indenter-diameter, or choose the place with --indent-at x,y,z"});
  const double best =
      std::max_element(candidates.begin(), candidates.end(), [](const auto& a, const auto& b) {
        return a.mean < b.mean;
      })->mean;
  const Candidate* chosen = nullptr;
  double chosen_leftness = 0.0;
  for (const Candidate& c : candidates) {
    if (c.mean < best - dome_tolerance * result.height) continue;
    const double leftness = (at(c.i, c.j) - middle).dot(to_left);
    const bool nearer =
        !chosen || c.off_middle < chosen->off_middle - 0.5 * step ||
        (c.off_middle < chosen->off_middle + 0.5 * step && leftness > chosen_leftness + 0.5 * step);
    if (nearer) {
      chosen = &c;
      chosen_leftness = leftness;
    }
  }
  result.centre = *first_touch(body, at(chosen->i, chosen->j), result.push);
  result.circle_reason = fmt::format(
      "over the highest dome{}{}: nearest to the middle of all places within {:.2f} mm of its top",
      left    ? " of the left half"
      : right ? " of the right half"
              : "",
      options.direction == "auto" ? ", opposite to the base" : "", dome_tolerance * result.height);
}

}  // namespace

Boundary find_boundary(const BodySurface& body, const BoundaryOptions& options, double node_spacing_mm) {
  Boundary result;
  find_base(body, options, node_spacing_mm, result);
  find_circle(body, options, result);
  return result;
}

bool on_base(const Boundary& boundary, const Vec3& x, const Vec3& normal) {
  if (boundary.lowest - x.dot(boundary.down) > boundary.base_depth) return false;
  return boundary.flat_base || normal.dot(boundary.down) > 0.0;
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
