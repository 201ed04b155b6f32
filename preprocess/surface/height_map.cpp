#include "preprocess/surface/height_map.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "io/stop.hpp"
#include "preprocess/side_by_side.hpp"

namespace dimple {
namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();

}  // namespace

Moments moments_of(const BodySurface& body) {
  // Tetrahedra from the centroid to each triangle, with Keast's five points: exact to the third degree.
  Moments result = {Mat3::Zero(), Vec3::Zero(), 0.0};
  const Vec3 middle = body.centroid();
  double volume = 0.0;
  const auto add = [&](double weight, const Vec3& x) {
    result.second += weight * x * x.transpose();
    result.third += weight * x.squaredNorm() * x;
  };
  for (Index t = 0; t < body.triangles().cols(); ++t) {
    const Vec3 a = body.vertex().col(body.triangles()(0, t)) - middle,
               b = body.vertex().col(body.triangles()(1, t)) - middle,
               c = body.vertex().col(body.triangles()(2, t)) - middle;
    const double tetrahedron = a.dot(b.cross(c)) / 6.0;
    const Vec3 sum = a + b + c;
    volume += tetrahedron;
    add(-0.8 * tetrahedron, sum / 4.0);
    add(0.45 * tetrahedron, sum / 6.0);
    for (const Vec3& corner : {a, b, c}) add(0.45 * tetrahedron, (sum + 2.0 * corner) / 6.0);
  }
  result.second /= volume;
  result.third /= volume;
  result.size = std::sqrt(result.second.trace());
  return result;
}

View::View(const BodySurface& the_body, const Moments& moments, const Vec3& along)
    : body(&the_body), approach(along) {
  Index axis = 0;
  approach.cwiseAbs().minCoeff(&axis);
  const Vec3 e1 = (Vec3::Unit(axis) - approach[axis] * approach).normalized(), e2 = approach.cross(e1);
  Eigen::Matrix<double, 3, 2> across;
  across << e1, e2;
  const Eigen::Matrix2d second = across.transpose() * moments.second * across;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(second);
  // A body as long as it is wide has no longest direction, and the choice is arbitrary.
  const bool round = axes.eigenvalues()[0] > 0.999 * axes.eigenvalues()[1];
  u = round ? e1 : Vec3((across * axes.eigenvectors().col(1)).normalized());
  v = approach.cross(u);
  place.resize(3, body->vertex().cols());
  place.row(0) = u.transpose() * body->vertex();
  place.row(1) = v.transpose() * body->vertex();
  place.row(2) = -approach.transpose() * body->vertex();
  low = place.topRows<2>().rowwise().minCoeff();
  high = place.topRows<2>().rowwise().maxCoeff();
  const Triangles& triangles = body->triangles();
  block.resize(4, (triangles.cols() + in_block - 1) / in_block);
  for (Index b = 0; b < block.cols(); ++b) {
    Eigen::Vector2d least = high, greatest = low;
    for (Index t = in_block * b; t < std::min(in_block * (b + 1), triangles.cols()); ++t)
      for (int k = 0; k < 3; ++k) {
        const auto corner = place.col(triangles(k, t)).head<2>();
        least = least.cwiseMin(corner);
        greatest = greatest.cwiseMax(corner);
      }
    block.col(b) << least, greatest;
  }
}

double HeightMap::between(const Eigen::Vector2d& p) const {
  const Eigen::Vector2d x = (p - corner) / step;
  const double fi = std::floor(x.x()), fj = std::floor(x.y());
  if (!(fi >= 0.0 && fj >= 0.0 && fi + 1.0 < static_cast<double>(height.rows()) &&
        fj + 1.0 < static_cast<double>(height.cols())))
    return none;
  const auto i = static_cast<Index>(fi), j = static_cast<Index>(fj);
  const double a = x.x() - fi, b = x.y() - fj;
  return (1.0 - a) * ((1.0 - b) * height(i, j) + b * height(i, j + 1)) +
         a * ((1.0 - b) * height(i + 1, j) + b * height(i + 1, j + 1));
}

namespace {

// Blocks of triangles that meet the map, or nearly.
std::vector<Index> blocks_under(const View& view, const HeightMap& map) {
  const Eigen::Array2d low = map.corner.array() - map.step,
                       high = map.place(map.height.rows(), map.height.cols());
  std::vector<Index> blocks;
  for (Index b = 0; b < view.block.cols(); ++b)
    if ((view.block.col(b).tail<2>().array() >= low).all() &&
        (view.block.col(b).head<2>().array() <= high).all())
      blocks.push_back(b);
  return blocks;
}

// Highest crossing of the lines along the approach direction by one of these triangles, on entry (`met`) or
// on exit.
void highest(const View& view, Index first_triangle, Index end, bool met, const HeightMap& map,
             Eigen::ArrayXXd& sheet) {
  const Triangles& triangles = view.body->triangles();
  for (Index t = first_triangle; t < end; ++t) {
    if (met != (view.body->normal().col(t).dot(view.approach) < 0.0)) continue;
    const Vec3 a = view.place.col(triangles(0, t)), b = view.place.col(triangles(1, t)),
               c = view.place.col(triangles(2, t));
    const double double_area = (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
    if (double_area == 0.0) continue;
    const auto first = [&](int d) {
      return std::ceil((std::min({a[d], b[d], c[d]}) - map.corner[d]) / map.step - 1e-9);
    };
    const auto last = [&](int d) {
      return std::floor((std::max({a[d], b[d], c[d]}) - map.corner[d]) / map.step + 1e-9);
    };
    const auto i0 = static_cast<Index>(std::max(first(0), 0.0)),
               j0 = static_cast<Index>(std::max(first(1), 0.0)),
               i1 = static_cast<Index>(std::min(last(0), static_cast<double>(sheet.rows() - 1))),
               j1 = static_cast<Index>(std::min(last(1), static_cast<double>(sheet.cols() - 1)));
    for (Index j = j0; j <= j1; ++j)
      for (Index i = i0; i <= i1; ++i) {
        const Eigen::Vector2d p = map.place(i, j);
        const double wb = ((p.x() - a.x()) * (c.y() - a.y()) - (p.y() - a.y()) * (c.x() - a.x())) /
                          double_area,
                     wc = ((b.x() - a.x()) * (p.y() - a.y()) - (b.y() - a.y()) * (p.x() - a.x())) /
                          double_area;
        // A place on an edge belongs to both triangles: the higher one is kept, and equal heights agree.
        if (wb < -1e-9 || wc < -1e-9 || wb + wc > 1.0 + 1e-9) continue;
        const double w = a.z() + wb * (b.z() - a.z()) + wc * (c.z() - a.z());
        if (!(sheet(i, j) >= w)) sheet(i, j) = w;
      }
  }
}

}  // namespace

HeightMap height_map(const View& view, const Eigen::Vector2d& corner, double step, Index rows,
                     Index columns) {
  HeightMap map{corner, step, Eigen::ArrayXXd::Constant(rows, columns, none),
                Eigen::ArrayXXd::Constant(rows, columns, none)};
  Eigen::ArrayXXd& leaves = map.thickness;  // first the height at which the line leaves the body
  const std::vector<Index> blocks = blocks_under(view, map);
  const auto fill = [&](bool met, Eigen::ArrayXXd& sheet) {
    for (const Index b : blocks) {
      stop_if_requested();
      highest(view, View::in_block * b, std::min(View::in_block * (b + 1), view.body->triangles().cols()),
              met, map, sheet);
    }
  };
  side_by_side([&] { fill(true, map.height); }, [&] { fill(false, leaves); });
  map.thickness = (map.height - leaves).max(0.0);
  return map;
}

HeightMap height_map(const View& view, double step) {
  // The body's middle is a point of the lattice, so that the phase belongs to the body; the lattice's border
  // misses the body.
  const Eigen::Vector2d middle = view.flat(view.body->centroid());
  const auto before = [&](int d) { return std::ceil((middle[d] - view.low[d]) / step) + 1.0; };
  const auto after = [&](int d) { return std::ceil((view.high[d] - middle[d]) / step) + 1.0; };
  return height_map(view, middle - step * Eigen::Vector2d(before(0), before(1)), step,
                    static_cast<Index>(before(0) + after(0)) + 1,
                    static_cast<Index>(before(1) + after(1)) + 1);
}

}  // namespace dimple
