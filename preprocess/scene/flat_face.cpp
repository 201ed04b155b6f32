#include "preprocess/scene/flat_face.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>

#include "io/stop.hpp"
#include "preprocess/surface/height_map.hpp"

namespace dimple {
namespace {

constexpr double flat_tolerance = 0.02;  // of the height
// Of an edge of the surface's triangles: less than that the voxels do not say, up to this part of the height.
constexpr double edge_tolerance = 0.15, most_tolerance = 0.05;
constexpr double facing = 0.85;      // cosine: normals of voxels on an oblique plane waver by some 20 degrees
constexpr double outer_part = 0.1;   // of the height: where the plane across a direction is looked for
constexpr double axis_angle = 0.25;  // degrees
constexpr int most_planes = 24;
constexpr double least_area =
    0.03;  // of the surface: where fewer normals agree is no face of a quarter outline

double radians(double degrees) {
  return degrees * std::numbers::pi / 180.0;
}

double typical_edge(const BodySurface& body) {
  std::vector<double> area(body.triangle_area().data(),
                           body.triangle_area().data() + body.triangle_area().size());
  std::nth_element(area.begin(), area.begin() + static_cast<std::ptrdiff_t>(area.size() / 2), area.end());
  return std::sqrt(area[area.size() / 2] * 4.0 / std::numbers::sqrt3);
}

Vec3 centre_of(const BodySurface& body, Index t) {
  return (body.vertex().col(body.triangles()(0, t)) + body.vertex().col(body.triangles()(1, t)) +
          body.vertex().col(body.triangles()(2, t))) /
         3.0;
}

Points centres_of(const BodySurface& body) {
  Points centre(3, body.triangles().cols());
  for (Index t = 0; t < centre.cols(); ++t) centre.col(t) = centre_of(body, t);
  return centre;
}

// Directions out of the body in which much of its surface faces; the most frequent first.
std::vector<Vec3> frequent_normals(const BodySurface& body) {
  // Normals gathered in a cube's faces of cells, so that each is compared with a few thousand means at most.
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

// The triangles that may face out, about as far as `out` turns before it is asked for anew.
class Facing {
 public:
  /// `centre` [3xT] of the triangles.
  Facing(const BodySurface& body, const Points& centre) : body_(body), centre_(centre) {}
  const std::vector<Index>& around(const Vec3& out) {
    if (about_.dot(out) > std::cos(radians(turn))) return triangle_;
    const double least = std::cos(std::acos(facing) + radians(turn + 1.0));
    about_ = out;
    triangle_.clear();
    for (Index t = 0; t < centre_.cols(); ++t)
      if (body_.normal().col(t).dot(out) > least) triangle_.push_back(t);
    return triangle_;
  }
  const Points& centre() const { return centre_; }

 private:
  static constexpr double turn = 10.0;  // degrees
  const BodySurface& body_;
  const Points& centre_;
  Vec3 about_ = Vec3::Zero();
  std::vector<Index> triangle_;
};

// The slab across `out` near the outermost place that holds most of the surface that faces out.
Plane plane_across(const BodySurface& body, Facing& near, const Vec3& out, double edge) {
  Plane plane{};
  const Eigen::VectorXd depth = body.vertex().transpose() * out;
  plane.lowest = depth.maxCoeff();
  plane.height = plane.lowest - depth.minCoeff();
  plane.tolerance =
      std::max(flat_tolerance * plane.height, std::min(edge_tolerance * edge, most_tolerance * plane.height));
  plane.offset = plane.lowest;
  struct Facet {
    double depth, area;
    Index t;
  };
  std::vector<Facet> facets;
  for (const Index t : near.around(out)) {
    const double faces = body.normal().col(t).dot(out);
    if (faces < facing) continue;
    const double at = near.centre().col(t).dot(out);
    if (plane.lowest - at < std::max(outer_part * plane.height, 2.0 * plane.tolerance))
      facets.push_back({at, faces * body.triangle_area()[t], t});
  }
  std::sort(facets.begin(), facets.end(), [](const Facet& a, const Facet& b) {
    return a.depth < b.depth || (a.depth == b.depth && a.t < b.t);
  });
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
  // Half of it lies above and half below: the rounded rim does not count more than it is.
  double below = 0.0;
  for (std::size_t k = best_first; k < best_last; ++k) {
    if (below < 0.5 * most) plane.offset = facets[k].depth;
    below += facets[k].area;
    plane.member.push_back(facets[k].t);
  }
  return plane;
}

// The direction across the plane that lies best through the triangles; exact, so that large ones count as
// what they are.
Vec3 fitted_normal(const BodySurface& body, const std::vector<Index>& member, const Vec3& out) {
  Vec3 middle = Vec3::Zero();
  double area = 0.0;
  for (const Index t : member) {
    middle += body.triangle_area()[t] * centre_of(body, t);
    area += body.triangle_area()[t];
  }
  middle /= area;
  Mat3 second = Mat3::Zero();
  for (const Index t : member) {
    const Vec3 c = centre_of(body, t) - middle;
    Mat3 about = 9.0 * c * c.transpose();
    for (int k = 0; k < 3; ++k) {
      const Vec3 x = body.vertex().col(body.triangles()(k, t)) - middle;
      about += x * x.transpose();
    }
    second += body.triangle_area()[t] / 12.0 * about;
  }
  const Eigen::SelfAdjointEigenSolver<Mat3> axes(second);
  const Vec3 normal = axes.eigenvectors().col(0);
  return normal.dot(out) < 0.0 ? Vec3(-normal) : normal;
}

FlatFace measured(const BodySurface& body, const Moments& moments, Facing& near, const Vec3& out,
                  const Plane& plane) {
  FlatFace face{.out = out,
                .offset = plane.offset,
                .height = 0.0,
                .tolerance = plane.tolerance,
                .outermost = plane.lowest - plane.offset <= 2.0 * plane.tolerance};
  face.height = plane.offset - (plane.lowest - plane.height);
  for (const Index t : near.around(out)) {
    const double faces = body.normal().col(t).dot(out);
    if (faces > facing && std::abs(near.centre().col(t).dot(out) - plane.offset) <= plane.tolerance)
      face.area += faces * body.triangle_area()[t];
  }
  const View view(body, moments, out);
  face.share = face.area / height_map(view, (view.high - view.low).maxCoeff() / 150.0).outline();
  return face;
}

// The direction out of the face that lies about across `out`, if there is one.
std::optional<Vec3> settled(const BodySurface& body, Facing& near, Vec3 out, double edge) {
  Plane plane = plane_across(body, near, out, edge);
  for (int pass = 0; pass < 20 && !plane.member.empty(); ++pass) {
    stop_if_asked();
    const Vec3 before = out;
    out = fitted_normal(body, plane.member, out);
    plane = plane_across(body, near, out, edge);
    if ((out - before).norm() < 1e-5) break;
  }
  if (plane.member.empty()) return std::nullopt;
  // Voxels do not know a direction better than this, and a face along them is meant to be along them.
  Index axis = 0;
  out.cwiseAbs().maxCoeff(&axis);
  if (std::abs(out[axis]) > std::cos(radians(axis_angle)))
    return (out[axis] < 0.0 ? -1.0 : 1.0) * Vec3::Unit(axis);
  return ((1e5 * out).array().round() * 1e-5).matrix().normalized();
}

}  // namespace

FlatFace face_towards(const BodySurface& body, const Moments& moments, const Vec3& out) {
  const Points centre = centres_of(body);
  Facing near(body, centre);
  return measured(body, moments, near, out, plane_across(body, near, out, typical_edge(body)));
}

std::vector<FlatFace> flat_faces(const BodySurface& body, const Moments& moments) {
  const double edge = typical_edge(body);
  const Points centre = centres_of(body);
  const std::vector<Vec3> frequent = frequent_normals(body);
  std::vector<std::optional<Vec3>> found(frequent.size());
  tbb::parallel_for(std::size_t{0}, frequent.size(), [&](std::size_t k) {
    Facing near(body, centre);
    found[k] = settled(body, near, frequent[k], edge);
  });
  std::vector<Vec3> apart;
  for (const std::optional<Vec3>& out : found)
    if (out && std::none_of(apart.begin(), apart.end(),
                            [&](const Vec3& other) { return other.dot(*out) > std::cos(radians(5.0)); }))
      apart.push_back(*out);
  std::vector<FlatFace> faces(apart.size());
  tbb::parallel_for(std::size_t{0}, faces.size(), [&](std::size_t k) {
    Facing near(body, centre);
    faces[k] = measured(body, moments, near, apart[k], plane_across(body, near, apart[k], edge));
  });
  std::stable_sort(faces.begin(), faces.end(),
                   [](const FlatFace& a, const FlatFace& b) { return a.area > b.area; });
  return faces;
}

}  // namespace dimple
