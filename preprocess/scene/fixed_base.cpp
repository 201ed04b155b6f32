#include "preprocess/scene/fixed_base.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "io/error.hpp"
#include "preprocess/scene/flat_face.hpp"
#include "preprocess/scene/sides.hpp"

namespace dimple {
namespace {

constexpr double flat_fraction = 0.25;  // of the outline, for a flat face
// Least fraction of the outline of a face where an organ was cut: the gentle sides of livers, lungs and
// hearts have 0.29 to 0.39, an ellipsoid has 0.16.
constexpr double cut_fraction = 0.45;
constexpr double same_area = 0.05;        // flat faces are equally large within this: few voxels leave 0.035
constexpr double bed_depth = 1.0 / 3.0;   // of the height, for an organ without a flat face
constexpr double dome_depth = 0.2;        // of the height: the part of a side that counts as its dome
constexpr double same_dome = 0.05;        // domes that differ by less are as broad
constexpr double same_moment = 0.9;       // ratio of variances along two axes that count as equal
constexpr double border_fraction = 0.05;  // of the base: less than that at the image's border is ignored
constexpr const char* base_option = "--base (boundary.base)";

// Rank of several equal directions of the base: organs in images rest on their lower side, then their back.
double preference(const BodySurface& body, const Vec3& down) {
  return (body.to_world().linear() * down).dot(Vec3(0.01, 0.1, -1.0));
}

// Area near the outermost place across `down` / area of the body's outline.
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

// The broadest side: the direction across which a body without a flat face is thinnest.
Vec3 broadest_side(const BodySurface& body, const Moments& moments) {
  const Eigen::SelfAdjointEigenSolver<Mat3> axes(moments.second);
  const Vec3 variance = axes.eigenvalues();
  Vec3 down;
  if (variance[0] < same_moment * variance[1]) {
    down = axes.eigenvectors().col(0);
    down = ((1e5 * down).array().round() * 1e-5).matrix().normalized();
  } else {
    // Equally thin across two axes or three: the patient's own directions, across the longer axis.
    const bool round = variance[1] >= same_moment * variance[2];
    const Vec3 along = axes.eigenvectors().col(2);
    const auto across = [&](const Vec3& lps) {
      const Vec3 axis = nearest_axis(body, lps);
      return round ? axis : Vec3(axis - axis.dot(along) * along);
    };
    down = across(Vec3(0, 0, -1));
    if (down.norm() < 0.5) down = across(Vec3(0, 1, 0));
    down.normalize();
  }
  const double below = dome_of(body, down), above = dome_of(body, -down);
  const double pointed = down.dot(moments.third) / std::pow(moments.size, 3);
  const bool turn = std::abs(below - above) > same_dome * std::max(below, above) ? below > above
                    : std::abs(pointed) > 0.02                                   ? pointed < 0.0
                                               : preference(body, -down) > preference(body, down);
  return turn ? Vec3(-down) : down;
}

void put_base_on(const FlatFace& face, Boundary& result) {
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

bool can_support(const FlatFace& face) {
  return face.outermost && face.fraction >= flat_fraction;
}

// True if the face is an end of the image, where the organ continues.
bool is_image_end(const BodySurface& body, const FlatFace& face) {
  return std::any_of(body.image_ends().begin(), body.image_ends().end(), [&](const auto& end) {
    return end.out.dot(face.out) > 0.98 &&
           std::abs(end.offset - face.offset) < end.tolerance + face.tolerance;
  });
}

template <class Allowed>
std::optional<FlatFace> largest_face(const BodySurface& body, const Moments& moments,
                                     const Allowed& allowed) {
  std::optional<FlatFace> largest;
  for (const FlatFace& face : flat_faces(body, moments)) {
    if (!can_support(face) || !allowed(face)) continue;
    if (!largest || (face.area > (1.0 - same_area) * largest->area &&
                     preference(body, face.out) > preference(body, largest->out) + 1e-6))
      largest = face;
  }
  return largest;
}

// Base on the flat face of that side, if it has one, and otherwise a bed.
void put_base_on_side(const BodySurface& body, const Moments& moments, const Vec3& down, Boundary& result) {
  const FlatFace face = face_towards(body, moments, down);
  if (can_support(face))
    put_base_on(face, result);
  else
    bed_on(body, down, result);
}

bool image_ends_across(const BodySurface& body, const Vec3& axis) {
  return std::any_of(body.image_ends().begin(), body.image_ends().end(),
                     [&](const auto& end) { return std::abs(end.out.dot(axis)) > 0.9; });
}

// Side of the base by the patient's axes; `from`: the requested side of the tool, LPS.
Vec3 side_by_axes(const BodySurface& body, const std::optional<Vec3>& from, std::string& reason) {
  if (from) {
    reason = "no flat cut face, so the organ rests on the side opposite to the tool";
    return nearest_axis(body, -*from);
  }
  const Vec3 inferior = nearest_axis(body, Vec3(0, 0, -1)), posterior = nearest_axis(body, Vec3(0, 1, 0));
  if (image_ends_across(body, inferior) && !image_ends_across(body, posterior)) {
    reason =
        "no flat cut face, and the image cuts the organ off above or below, so it rests on the patient's "
        "posterior side";
    return posterior;
  }
  reason = "no flat cut face, so the organ rests on the patient's inferior side";
  return inferior;
}

// Warns that sides are those of the scan, which has its own axes.
void report_turned_axes(const BodySurface& body, const Vec3& lps, const std::string& side, Boundary& result) {
  constexpr double much_degrees = 5.0;
  const double off = 180.0 / std::numbers::pi *
                     std::acos(std::min(1.0, nearest_axis(body, lps).dot(local_direction(body, lps))));
  if (off > much_degrees)
    result.warnings.push_back(fmt::format(
        "the scan's axes are rotated by {:.0f} degrees against the patient's: the base on the {} side and "
        "the approach direction follow the scan's nearest axis; gravity, and supports, loads and films on a "
        "side, follow the patient's. For a base on the patient's axis give --base {:g},{:g},{:g}",
        off, side, lps.x() + 0.0, lps.y() + 0.0, lps.z() + 0.0));
}

}  // namespace

std::string side_in_words(const BodySurface& body, const Vec3& down) {
  const Vec3 lps = body.to_world().linear() * down;
  const std::string name = side_towards(lps);
  if (lps.cwiseAbs().maxCoeff() > 1.0 - 1e-6) return name + " side";
  return fmt::format("{} side ({:.2f}, {:.2f}, {:.2f})", name, lps.x() + 0.0, lps.y() + 0.0, lps.z() + 0.0);
}

Vec3 local_direction(const BodySurface& body, const Vec3& lps) {
  return body.to_world().linear().transpose() * lps;
}

Vec3 nearest_axis(const BodySurface& body, const Vec3& lps) {
  const Vec3 local = local_direction(body, lps);
  Index axis = 0;
  local.cwiseAbs().maxCoeff(&axis);
  return (local[axis] < 0.0 ? -1.0 : 1.0) * Vec3::Unit(axis);
}

std::optional<Vec3> base_direction(const std::string& text) {
  if (text == "auto" || text == "organ") return std::nullopt;
  if (const auto side = side_named(text, base_option)) return side;
  if (const auto vector = parse_vector(text); vector && vector->norm() > 0.0) return vector->normalized();
  throw UsageError({.fact = fmt::format("'{}' is not a side", text),
                    .where = base_option,
                    .why =
                        "a side is auto, organ, inferior, superior, left, right, anterior, posterior, one of "
                        "I, S, L, R, A, P, or x,y,z in LPS",
                    .remedy = "give one of these, for instance --base inferior"});
}

void find_base(const BodySurface& body, const Moments& moments, const BoundaryOptions& options,
               const std::optional<Vec3>& from, Boundary& result) {
  std::string reason;
  const auto requested = base_direction(options.base);
  const bool organ = options.base == "organ";
  std::optional<FlatFace> face;
  if (!requested)
    face = largest_face(body, moments, [&](const FlatFace& one) {
      return organ || (one.fraction >= cut_fraction && !is_image_end(body, one));
    });
  if (requested) {
    put_base_on_side(body, moments,
                     side_named(options.base, base_option) ? nearest_axis(body, *requested)
                                                           : local_direction(body, *requested),
                     result);
    reason = "as requested";
    if (side_named(options.base, base_option)) report_turned_axes(body, *requested, options.base, result);
  } else if (face) {
    put_base_on(*face, result);
    reason = fmt::format("the organ's largest flat face, {:.0f} % of its outline", 100.0 * face->fraction);
  } else if (organ) {
    bed_on(body, broadest_side(body, moments), result);
    reason = "no flat face, so the organ rests on its broadest side";
  } else {
    put_base_on_side(body, moments, side_by_axes(body, from, reason), result);
    result.base_by_axes = true;
  }
  if (options.base_depth_mm > 0.0) result.base_depth = options.base_depth_mm;
  const char* why_so_deep = options.base_depth_mm > 0.0 ? ", as requested,"
                            : result.flat_base          ? ""
                                                        : ", a third of the organ's height (--base-depth),";
  result.base_reason = fmt::format("{}; {}; surface up to {:.1f} mm above it{} is fixed",
                                   side_in_words(body, result.down), reason, result.base_depth, why_so_deep);
}

bool on_base(const Boundary& boundary, const Vec3& x, const Vec3& normal) {
  if (boundary.lowest - x.dot(boundary.down) > boundary.base_depth) return false;
  // Sides that rise from a flat face do not belong to it; a bed ends where the organ overhangs it.
  return normal.dot(boundary.down) > (boundary.flat_base ? 0.5 : 1e-6);
}

// Warns of a base where the image ends, since the tissue continues there. Areas are projected along `down`.
void warn_of_base_at_image_end(const BodySurface& body, Boundary& result) {
  const auto cut = [&](const Vec3& x) {
    return std::any_of(body.image_ends().begin(), body.image_ends().end(), [&](const auto& end) {
      return end.out.dot(result.down) > 0.5 && std::abs(x.dot(end.out) - end.offset) <= end.tolerance;
    });
  };
  if (body.image_ends().empty()) return;
  double base = 0.0, at_end = 0.0;
  for (Index t = 0; t < body.triangles().cols(); ++t) {
    const Vec3 x = body.middle_of(t);
    if (!on_base(result, x, body.normal().col(t))) continue;
    const double seen = body.triangle_area()[t] * body.normal().col(t).dot(result.down);
    base += seen;
    if (cut(x)) at_end += seen;
  }
  if (!(at_end > border_fraction * base)) return;
  result.warnings.push_back(
      fmt::format("THE BASE IS WHERE THE IMAGE ENDS: {:.0f} % of the base ({}) is on the image's border, "
                  "where the scan ends and the organ does not; the force depends on where the scan ends: "
                  "give an image of the whole organ, or another side with --base",
                  100.0 * at_end / base, side_in_words(body, result.down)));
}

}  // namespace dimple
