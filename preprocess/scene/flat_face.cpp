#include "preprocess/scene/flat_face.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>

#include "io/stop.hpp"
#include "preprocess/model.hpp"
#include "preprocess/surface/height_map.hpp"

namespace dimple {
namespace {

constexpr double flat_tolerance = 0.02;  // of the height
// Tolerance in edges of the surface's triangles, the accuracy of the voxels, up to this part of the height.
constexpr double edge_tolerance = 0.15, most_tolerance = 0.05;
constexpr double facing = 0.85;      // cosine: normals of voxels on an oblique plane vary by some 20 degrees
constexpr double outer_part = 0.1;   // of the height: range of the search for a plane across a direction
constexpr double axis_angle = 0.25;  // degrees
constexpr int most_planes = 24;
constexpr double least_area =
    0.03;  // of the surface: directions with less do not reach a quarter of the outline

constexpr double surely_small = 0.2;  // fraction of the outline: no body rests on less

double radians(double degrees) {
  return degrees * std::numbers::pi / 180.0;
}

double typical_edge(const BodySurface& body) {
  std::vector<double> area(body.triangle_area().data(),
                           body.triangle_area().data() + body.triangle_area().size());
  std::nth_element(area.begin(), area.begin() + static_cast<std::ptrdiff_t>(area.size() / 2), area.end());
  return std::sqrt(area[area.size() / 2] * 4.0 / std::numbers::sqrt3);
}

Points centres_of(const BodySurface& body) {
  Points centre(3, body.triangles().cols());
  for (Index t = 0; t < centre.cols(); ++t) centre.col(t) = body.middle_of(t);
  return centre;
}

// Integrals of x and x x^T over each triangle.
struct FacetMoments {
  Points first;
  SecondMoments second;
};

// With x from the middle of the body's box, so that little cancels about the middle of a face. Exact: a
// twelfth of the area times the sum over the corners and nine times the middle.
FacetMoments facet_moments_of(const BodySurface& body) {
  const Index count = body.triangles().cols();
  const Vec3 about = 0.5 * (body.lower() + body.upper());
  FacetMoments moments{Points(3, count), SecondMoments(6, count)};
  tbb::parallel_for(Index{0}, count, [&](Index t) {
    const double area = body.triangle_area()[t];
    const Vec3 middle = body.middle_of(t) - about;
    Mat3 second = 9.0 * middle * middle.transpose();
    for (int k = 0; k < 3; ++k) {
      const Vec3 x = body.vertex().col(body.triangles()(k, t)) - about;
      second += x * x.transpose();
    }
    moments.first.col(t) = area * middle;
    set_moments(moments.second, t, area / 12.0 * second);
  });
  return moments;
}

// Directions in which much of the surface faces, the most frequent first.
std::vector<Vec3> frequent_normals(const BodySurface& body) {
  // Normals are binned on the faces of a cube, so that each is compared with at most a few thousand means.
  constexpr int cells = 24;
  std::vector<Vec3> sum(6 * cells * cells, Vec3::Zero());
  std::vector<double> area(sum.size(), 0.0);
  for (Index t = 0; t < body.triangles().cols(); ++t) {
    const Vec3 n = body.normal().col(t);
    Index axis = 0;
    const double largest = n.cwiseAbs().maxCoeff(&axis);
    if (largest == 0.0) continue;
    const auto cell = [&](double x) {
      return std::clamp(static_cast<int>((std::atan(x / largest) / std::numbers::pi * 2.0 + 0.5) * cells), 0,
                        cells - 1);
    };
    const auto k = static_cast<std::size_t>(
        ((2 * axis + (n[axis] < 0.0)) * cells + cell(n[(axis + 1) % 3])) * cells + cell(n[(axis + 2) % 3]));
    sum[k] += body.triangle_area()[t] * n;
    area[k] += body.triangle_area()[t];
  }
  std::vector<Vec3> mean;
  std::vector<double> weight;
  for (std::size_t k = 0; k < sum.size(); ++k)
    if (area[k] > 0.0 && sum[k].norm() > 0.0) {
      mean.push_back(sum[k].normalized());
      weight.push_back(area[k]);
    }
  const double near = std::cos(radians(12.0)), apart = std::cos(radians(25.0));
  std::vector<double> density(mean.size(), 0.0);
  for (std::size_t a = 0; a < mean.size(); ++a)
    for (std::size_t b = 0; b < mean.size(); ++b)
      if (mean[a].dot(mean[b]) > near) density[a] += weight[b];
  std::vector<std::size_t> order(mean.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return density[a] > density[b]; });
  std::vector<Vec3> result;
  for (const std::size_t k : order) {
    if (static_cast<int>(result.size()) == most_planes || density[k] < least_area * body.area()) break;
    if (std::none_of(result.begin(), result.end(), [&](const Vec3& r) { return r.dot(mean[k]) > apart; }))
      result.push_back(mean[k]);
  }
  return result;
}

struct Plane {
  double lowest, height, tolerance, offset;
  std::vector<Index> member;  // triangles
};

// Places in the order of their numbers, with a box around each sixty-four: finds the outermost ones quickly.
class Blocks {
 public:
  explicit Blocks(const Points& x)
      : x_(x), middle_(3, (x.cols() + size - 1) / size), half_(3, middle_.cols()) {
    for (Index b = 0; b < middle_.cols(); ++b) {
      const auto part = x.middleCols(size * b, std::min(size, x.cols() - size * b));
      const Vec3 low = part.rowwise().minCoeff(), high = part.rowwise().maxCoeff();
      middle_.col(b) = 0.5 * (low + high);
      half_.col(b) = 0.5 * (high - low);
    }
    rounding_ = 1e-12 * (x.cols() > 0 ? x.cwiseAbs().maxCoeff() : 0.0);
  }
  const Points& places() const { return x_; }
  double farthest(const Vec3& out) const {
    double most = -std::numeric_limits<double>::infinity();
    for_each_beyond([&] { return most; }, out, [&](Index k) { most = std::max(most, x_.col(k).dot(out)); });
    return most;
  }
  // Calls visit(k) for all places farther out than limit(), and for others of their blocks.
  template <class Limit, class Visit>
  void for_each_beyond(const Limit& limit, const Vec3& out, const Visit& visit) const {
    const Vec3 size_of_out = out.cwiseAbs();
    for (Index b = 0; b < middle_.cols(); ++b) {
      if (middle_.col(b).dot(out) + half_.col(b).dot(size_of_out) + rounding_ <= limit()) continue;
      for (Index k = size * b; k < std::min(size * (b + 1), x_.cols()); ++k) visit(k);
    }
  }

 private:
  static constexpr Index size = 64;
  const Points& x_;
  Points middle_, half_;
  double rounding_ = 0.0;
};

// Surface data that every direction uses.
struct Facets {
  explicit Facets(const BodySurface& of) : body(of), centre(centres_of(of)), edge(typical_edge(of)) {}
  Facets(const Facets&) = delete;
  Facets& operator=(const Facets&) = delete;
  const BodySurface& body;
  Points centre;  // [3xT] of the triangles
  double edge;
  Blocks vertices{body.vertex()}, centres{centre};
};

struct Facet {
  double depth, area;
  Index t;
};

// Facets by depth, then by number: first into bins of depth, since sorting all together is slow.
std::vector<Facet> sorted(const std::vector<Facet>& facets, double least, double greatest) {
  constexpr std::size_t drawers = 256;
  const auto drawer = [&](const Facet& facet) {
    const double part = (facet.depth - least) / (greatest - least);
    return static_cast<std::size_t>(std::clamp(part, 0.0, 1.0) * static_cast<double>(drawers - 1));
  };
  std::vector<std::size_t> offset(drawers + 1, 0);
  for (const Facet& facet : facets) ++offset[drawer(facet) + 1];
  for (std::size_t d = 0; d < drawers; ++d) offset[d + 1] += offset[d];
  std::vector<Facet> result(facets.size());
  std::vector<std::size_t> at(offset.begin(), offset.end() - 1);
  for (const Facet& facet : facets) result[at[drawer(facet)]++] = facet;
  for (std::size_t d = 0; d < drawers; ++d)
    std::sort(result.begin() + static_cast<std::ptrdiff_t>(offset[d]),
              result.begin() + static_cast<std::ptrdiff_t>(offset[d + 1]),
              [](const Facet& a, const Facet& b) {
                return a.depth < b.depth || (a.depth == b.depth && a.t < b.t);
              });
  return result;
}

// Slab across `out` near the outermost place that holds most of the surface that faces out.
Plane plane_across(const Facets& of, const Vec3& out) {
  const BodySurface& body = of.body;
  Plane plane{};
  plane.lowest = of.vertices.farthest(out);
  plane.height = plane.lowest + of.vertices.farthest(-out);
  plane.tolerance = std::max(flat_tolerance * plane.height,
                             std::min(edge_tolerance * of.edge, most_tolerance * plane.height));
  plane.offset = plane.lowest;
  std::vector<Facet> facets;
  const double range = std::max(outer_part * plane.height, 2.0 * plane.tolerance);
  of.centres.for_each_beyond([&] { return plane.lowest - range; }, out,
                             [&](Index t) {
                               const double at = of.centre.col(t).dot(out);
                               if (!(plane.lowest - at < range)) return;
                               const double faces = body.normal().col(t).dot(out);
                               if (faces >= facing)
                                 facets.push_back({at, faces * body.triangle_area()[t], t});
                             });
  facets = sorted(facets, plane.lowest - range, plane.lowest);
  double inside = 0.0, most = 0.0;
  std::size_t first = 0, best_first = 0, best_last = 0;
  for (std::size_t last = 0; last < facets.size(); ++last) {
    inside += facets[last].area;
    while (facets[last].depth - facets[first].depth > 2.0 * plane.tolerance) inside -= facets[first++].area;
    if (inside > most * (1.0 + 1e-9)) {
      most = inside;
      best_first = first;
      best_last = last + 1;
    }
  }
  // The median: half of it is above and half below, so that rounded edges get no extra weight.
  double below = 0.0;
  for (std::size_t k = best_first; k < best_last; ++k) {
    if (below < 0.5 * most) plane.offset = facets[k].depth;
    below += facets[k].area;
    plane.member.push_back(facets[k].t);
  }
  return plane;
}

// Normal of the least-squares plane through the triangles: large ones count by their area.
Vec3 fitted_normal(const BodySurface& body, const FacetMoments& moments, const std::vector<Index>& member,
                   const Vec3& out) {
  double area = 0.0;
  Vec3 first = Vec3::Zero();
  SecondMoments sum = SecondMoments::Zero(6, 1);
  for (const Index t : member) {
    area += body.triangle_area()[t];
    first += moments.first.col(t);
    sum += moments.second.col(t);
  }
  const Mat3 second = as_matrix(sum, 0) - first * first.transpose() / area;
  const Eigen::SelfAdjointEigenSolver<Mat3> axes(second);
  const Vec3 normal = axes.eigenvectors().col(0);
  return normal.dot(out) < 0.0 ? Vec3(-normal) : normal;
}

FlatFace measured(const Facets& of, const Moments& moments, const Vec3& out, const Plane& plane) {
  const BodySurface& body = of.body;
  FlatFace face{.out = out,
                .offset = plane.offset,
                .height = 0.0,
                .tolerance = plane.tolerance,
                .outermost = plane.lowest - plane.offset <= 2.0 * plane.tolerance};
  face.height = plane.offset - (plane.lowest - plane.height);
  of.centres.for_each_beyond([&] { return plane.offset - 1.001 * plane.tolerance; }, out,
                             [&](Index t) {
                               if (std::abs(of.centre.col(t).dot(out) - plane.offset) > plane.tolerance)
                                 return;
                               if (const double faces = body.normal().col(t).dot(out); faces > facing)
                                 face.area += faces * body.triangle_area()[t];
                             });
  // An upper bound: the outline's area times the height exceeds the volume.
  face.fraction = face.area * plane.height / body.volume();
  if (face.fraction < surely_small) return face;
  const View view(body, moments, out);
  face.fraction = face.area / height_map(view, (view.high - view.low).maxCoeff() / 150.0).outline();
  return face;
}

// Normal of the face near direction `out`, by iteration; nothing if there is no such face.
std::optional<Vec3> converged(const Facets& of, const FacetMoments& moments, Vec3 out) {
  Plane plane = plane_across(of, out);
  for (int pass = 0; pass < 20 && !plane.member.empty(); ++pass) {
    stop_if_requested();
    const Vec3 before = out;
    out = fitted_normal(of.body, moments, plane.member, out);
    plane = plane_across(of, out);
    if ((out - before).norm() < 1e-5) break;
  }
  if (plane.member.empty()) return std::nullopt;
  // Rounded to the axis: voxels determine a direction no better, and a face along them is meant so.
  Index axis = 0;
  out.cwiseAbs().maxCoeff(&axis);
  if (std::abs(out[axis]) > std::cos(radians(axis_angle)))
    return (out[axis] < 0.0 ? -1.0 : 1.0) * Vec3::Unit(axis);
  return ((1e5 * out).array().round() * 1e-5).matrix().normalized();
}

}  // namespace

FlatFace face_towards(const BodySurface& body, const Moments& moments, const Vec3& out) {
  const Facets facets(body);
  return measured(facets, moments, out, plane_across(facets, out));
}

std::vector<FlatFace> flat_faces(const BodySurface& body, const Moments& moments) {
  const Facets facets(body);
  const FacetMoments facet_moments = facet_moments_of(body);
  const std::vector<Vec3> frequent = frequent_normals(body);
  std::vector<std::optional<Vec3>> found(frequent.size());
  tbb::parallel_for(std::size_t{0}, frequent.size(),
                    [&](std::size_t k) { found[k] = converged(facets, facet_moments, frequent[k]); });
  std::vector<Vec3> apart;
  for (const std::optional<Vec3>& out : found)
    if (out && std::none_of(apart.begin(), apart.end(),
                            [&](const Vec3& other) { return other.dot(*out) > std::cos(radians(5.0)); }))
      apart.push_back(*out);
  std::vector<FlatFace> faces(apart.size());
  tbb::parallel_for(std::size_t{0}, faces.size(), [&](std::size_t k) {
    faces[k] = measured(facets, moments, apart[k], plane_across(facets, apart[k]));
  });
  std::stable_sort(faces.begin(), faces.end(),
                   [](const FlatFace& a, const FlatFace& b) { return a.area > b.area; });
  return faces;
}

}  // namespace dimple
