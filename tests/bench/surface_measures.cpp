#include "tests/bench/surface_measures.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "tests/helpers/image.hpp"

namespace dimple {
namespace {

constexpr double edge_region = 2.0;            // mm
constexpr double edge_region_curvature = 5.0;  // mm: no vertex of a patch is near an edge
constexpr int patch_rings = 3;

// Area and outward unit normal of each vertex: sums over its triangles. A normal is zero where all triangles
// are points or lines.
struct VertexGeometry {
  Eigen::VectorXd area;
  Points normal;
};
VertexGeometry vertex_geometry(const TriangleMesh& mesh) {
  const Index n = mesh.vertex.cols();
  VertexGeometry geometry{Eigen::VectorXd::Zero(n), Points::Zero(3, n)};
  for (Index t = 0; t < mesh.triangles.cols(); ++t) {
    const Vec3 a = mesh.vertex.col(mesh.triangles(0, t));
    const Vec3 b = mesh.vertex.col(mesh.triangles(1, t)), c = mesh.vertex.col(mesh.triangles(2, t));
    const Vec3 vector_area = 0.5 * (b - a).cross(c - a);
    for (const Index v : mesh.triangles.col(t)) {
      geometry.area[v] += vector_area.norm() / 3.0;
      geometry.normal.col(v) += vector_area;
    }
  }
  for (Index v = 0; v < n; ++v)
    if (const double length = geometry.normal.col(v).norm(); length > 0.0) geometry.normal.col(v) /= length;
  return geometry;
}

using Neighbours = std::vector<std::vector<Index>>;
Neighbours neighbours_of(const TriangleMesh& mesh) {
  Neighbours next(static_cast<std::size_t>(mesh.vertex.cols()));
  for (Index t = 0; t < mesh.triangles.cols(); ++t)
    for (int c = 0; c < 3; ++c)
      next[static_cast<std::size_t>(mesh.triangles(c, t))].push_back(mesh.triangles((c + 1) % 3, t));
  return next;
}

// The vertices within some rings around the first one.
void collect_patch(const Neighbours& next, Index middle, std::vector<Index>& patch) {
  patch.assign(1, middle);
  std::size_t begin = 0;
  for (int ring = 0; ring < patch_rings; ++ring) {
    const std::size_t end = patch.size();
    for (; begin < end; ++begin)
      for (const Index v : next[static_cast<std::size_t>(patch[begin])])
        if (std::find(patch.begin(), patch.end(), v) == patch.end()) patch.push_back(v);
  }
}

// Mean curvature of the paraboloid that fits a patch best, at its middle; `normal` is the height's direction.
double fitted_curvature(const Points& vertex, const std::vector<Index>& patch, const Vec3& normal) {
  using Vec6 = Eigen::Matrix<double, 6, 1>;
  const Vec3 u_axis = normal.unitOrthogonal(), v_axis = normal.cross(u_axis);
  Eigen::Matrix<double, 6, 6> A = Eigen::Matrix<double, 6, 6>::Zero();
  Vec6 right = Vec6::Zero();
  for (const Index p : patch) {
    const Vec3 x = vertex.col(p) - vertex.col(patch.front());
    const double u = x.dot(u_axis), v = x.dot(v_axis);
    const Vec6 basis(1.0, u, v, 0.5 * u * u, u * v, 0.5 * v * v);
    A += basis * basis.transpose();
    right += x.dot(normal) * basis;
  }
  const Vec6 f = A.ldlt().solve(right);
  const double fu = f[1], fv = f[2];
  const double stretch = 1.0 + fu * fu + fv * fv;
  return -0.5 * ((1.0 + fv * fv) * f[3] - 2.0 * fu * fv * f[4] + (1.0 + fu * fu) * f[5]) /
         (stretch * std::sqrt(stretch));
}

// Of each vertex what is measured there; NaN where it is not.
struct VertexErrors {
  std::vector<Foot> foot;
  Eigen::VectorXd angle, curvature;
};
VertexErrors vertex_errors(const TriangleMesh& mesh, const Points& normal, const ExactBody& body,
                           const Placement& placement) {
  const Index n = mesh.vertex.cols();
  const Neighbours next = neighbours_of(mesh);
  VertexErrors errors{std::vector<Foot>(static_cast<std::size_t>(n)),
                      Eigen::VectorXd::Constant(n, not_measured), Eigen::VectorXd::Constant(n, not_measured)};
  tbb::parallel_for(Index{0}, n, [&](Index v) {
    Foot& foot = errors.foot[static_cast<std::size_t>(v)];
    foot = body.foot(placement.turn.transpose() * (mesh.vertex.col(v) - placement.centre));
    const Vec3 exact = placement.turn * foot.normal, drawn = normal.col(v);
    if (!(drawn.squaredNorm() > 0.0) || foot.to_edge <= edge_region) return;
    errors.angle[v] = 180.0 / std::numbers::pi * std::atan2(drawn.cross(exact).norm(), drawn.dot(exact));
    if (foot.to_edge <= edge_region_curvature) return;
    std::vector<Index> patch;
    collect_patch(next, v, patch);
    const double local_radius = std::min(body.radius, 1.0 / std::abs(foot.curvature));
    errors.curvature[v] = (fitted_curvature(mesh.vertex, patch, drawn) - foot.curvature) * local_radius;
  });
  return errors;
}

// Weighted moments and the largest absolute value of what is added.
struct Sum {
  double weight = 0.0, first = 0.0, second = 0.0, largest = 0.0;
  void add(double value, double w) {
    weight += w;
    first += w * value;
    second += w * value * value;
    largest = std::max(largest, std::abs(value));
  }
  double mean() const { return weight > 0.0 ? first / weight : not_measured; }
  double rms() const { return weight > 0.0 ? std::sqrt(second / weight) : not_measured; }
  double most() const { return weight > 0.0 ? largest : not_measured; }
};

double larger(double a, double b) {
  return std::abs(a) >= std::abs(b) ? a : b;
}

// At the extreme points along the axes of the grid.
void add_tops(const TriangleMesh& mesh, const ExactBody& body, const Placement& placement,
              SurfaceErrors& errors) {
  Sum tops;
  errors.top_within = errors.top_across = 0.0;
  for (int axis = 0; axis < 3; ++axis)
    for (const double side : {-1.0, 1.0}) {
      const Vec3 direction = side * Vec3::Unit(axis);
      const double exact =
          direction.dot(placement.centre) + body.reach(placement.turn.transpose() * direction);
      const double error = (side * mesh.vertex.row(axis)).maxCoeff() - exact;
      tops.add(error, 1.0);
      double& worst = axis == 2 ? errors.top_across : errors.top_within;
      worst = larger(worst, error);
    }
  errors.top_mean = tops.mean();
  errors.top_rms = tops.rms();
}

}  // namespace

LabelImage voxelised(const ExactBody& body, const Placement& placement, const Vec3& spacing) {
  constexpr Index margin = 3;
  LabelImage image;
  Vec3 first;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 direction = placement.turn.transpose() * Vec3::Unit(axis);
    const double low = placement.centre[axis] - body.reach(-direction);
    const double high = placement.centre[axis] + body.reach(direction);
    first[axis] = std::floor(low / spacing[axis]) - static_cast<double>(margin);
    image.size[static_cast<std::size_t>(axis)] =
        static_cast<Index>(std::ceil(high / spacing[axis]) - first[axis]) + margin + 1;
  }
  image.to_world = Eigen::Affine3d::Identity();
  image.to_world.linear() = spacing.asDiagonal();
  image.to_world.translation() = spacing.cwiseProduct(first);
  const auto [ni, nj, nk] = image.size;
  std::vector<std::int32_t> voxel(static_cast<std::size_t>(ni * nj * nk));
  tbb::parallel_for(Index{0}, nj * nk, [&](Index row) {
    for (Index i = 0; i < ni; ++i) {
      const Vec3 index(static_cast<double>(i), static_cast<double>(row % nj), static_cast<double>(row / nj));
      const Vec3 x = placement.turn.transpose() * (image.to_world * index - placement.centre);
      voxel[static_cast<std::size_t>(i + ni * row)] = body.contains(x) ? 1 : 0;
    }
  });
  set_voxels(image, voxel);
  return image;
}

void project(TriangleMesh& mesh, const ExactBody& body, const Placement& placement) {
  for (Index v = 0; v < mesh.vertex.cols(); ++v) {
    const Foot foot = body.foot(placement.turn.transpose() * (mesh.vertex.col(v) - placement.centre));
    mesh.vertex.col(v) -= foot.distance * (placement.turn * foot.normal);
  }
}

SurfaceErrors errors_of(const TriangleMesh& mesh, const ExactBody& body, const Placement& placement) {
  const VertexGeometry geometry = vertex_geometry(mesh);
  const VertexErrors vertex = vertex_errors(mesh, geometry.normal, body, placement);
  Sum distance, edge, angle, curvature;
  for (Index v = 0; v < mesh.vertex.cols(); ++v) {
    const Foot& foot = vertex.foot[static_cast<std::size_t>(v)];
    (foot.to_edge > edge_region ? distance : edge).add(foot.distance, geometry.area[v]);
    if (std::isfinite(vertex.angle[v])) angle.add(vertex.angle[v], geometry.area[v]);
    if (std::isfinite(vertex.curvature[v])) curvature.add(vertex.curvature[v], geometry.area[v]);
  }
  SurfaceErrors errors{.mean = distance.mean(),
                       .rms = distance.rms(),
                       .largest = distance.most(),
                       .edge_largest = edge.most(),
                       .normal_rms = angle.rms(),
                       .normal_largest = angle.most(),
                       .curvature_rms = curvature.rms(),
                       .volume = 100.0 * (enclosed_volume(mesh) / body.volume - 1.0)};
  if (body.smooth) add_tops(mesh, body, placement, errors);
  return errors;
}

}  // namespace dimple
