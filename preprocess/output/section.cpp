#include "preprocess/output/section.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "io/draw/body_frame.hpp"
#include "preprocess/nodes/neighbours.hpp"

namespace dimple {
namespace {

using Vec2 = Eigen::Vector2d;

struct Piece {
  Vec2 from, to;
};

// Outline of the surface in the plane, in the plane's own coordinates: right and up from `origin`. A vertex
// in the plane counts as in front of it, and both triangles at an edge find the same bits on it: the outline
// is closed.
std::vector<Piece> outline(const Surface& surface, const BodyFrame& frame, const Vec3& origin) {
  const Eigen::RowVectorXd before = frame.front.transpose() * (surface.vertex_mm.colwise() - origin);
  const auto crossing = [&](Index a, Index b) {
    if (a > b) std::swap(a, b);
    const Vec3 x = surface.vertex_mm.col(a) + before[a] / (before[a] - before[b]) *
                                                  (surface.vertex_mm.col(b) - surface.vertex_mm.col(a));
    return Vec2(frame.broad.dot(x - origin), frame.up.dot(x - origin));
  };
  std::vector<Piece> pieces;
  for (const auto& t : surface.triangles.colwise()) {
    std::array<Vec2, 2> end;
    std::size_t count = 0;
    for (Index k = 0; k < 3; ++k) {
      const Index a = t[k], b = t[(k + 1) % 3];
      if ((before[a] >= 0.0) != (before[b] >= 0.0)) end[count++] = crossing(a, b);
    }
    if (count == 2) pieces.push_back({end[0], end[1]});
  }
  return pieces;
}

// Lines of the lattice from below `low` to above `high`: `fine` apart from the tool to `flat`, then
// increasingly apart. None passes through the tool's face or axis, where a body may have faces of its own.
std::vector<double> lattice_lines(double low, double high, double flat, double fine, double coarse) {
  const auto outward = [&](double from, double to, double sign, std::vector<double>& lines) {
    for (double x = from; lines.empty() || sign * lines.back() <= sign * to;) {
      lines.push_back(x);
      x += sign * std::min(coarse, fine + 0.15 * std::max(0.0, std::abs(x) - flat));
    }
  };
  std::vector<double> down, up;
  outward(0.37 * fine - fine, low, -1.0, down);
  outward(0.37 * fine, high, 1.0, up);
  std::reverse(down.begin(), down.end());
  down.insert(down.end(), up.begin(), up.end());
  return down;
}

// Crossings of the outline with each of the lines of constant coordinate `fixed`, ascending.
std::vector<std::vector<double>> crossings(const std::vector<Piece>& pieces, const std::vector<double>& lines,
                                           Index fixed) {
  std::vector<std::vector<double>> result(lines.size());
  for (const Piece& p : pieces) {
    const double a = p.from[fixed], b = p.to[fixed];
    auto line = std::lower_bound(lines.begin(), lines.end(), std::min(a, b));
    for (; line != lines.end() && *line <= std::max(a, b); ++line)
      if ((a >= *line) != (b >= *line))
        result[static_cast<std::size_t>(line - lines.begin())].push_back(
            p.from[1 - fixed] + (*line - a) / (b - a) * (p.to[1 - fixed] - p.from[1 - fixed]));
  }
  for (auto& row : result) std::sort(row.begin(), row.end());
  return result;
}

// Vertices in the plane, and triangles of them.
struct FlatMesh {
  std::vector<Vec2> place;
  std::vector<std::array<Index, 3>> triangles;
};

// The inside of an outline on a lattice of lines across (`column`) and up (`row`).
FlatMesh mesh_inside(const std::vector<Piece>& pieces, const std::vector<double>& column,
                     const std::vector<double>& row) {
  FlatMesh mesh;
  std::vector<Vec2>& place = mesh.place;
  const auto along_row = crossings(pieces, row, 1), along_column = crossings(pieces, column, 0);
  const std::size_t columns = column.size(), rows = row.size();
  std::vector<char> inside(columns * rows, 0);
  for (std::size_t j = 0; j < rows; ++j)
    for (std::size_t i = 0; i < columns; ++i) {
      const auto& met = along_row[j];
      inside[j * columns + i] = (std::lower_bound(met.begin(), met.end(), column[i]) - met.begin()) % 2 == 1;
    }

  // Each vertex is made once: 0 at a lattice's corner, 1 and 2 on the lines to the right and up from it.
  std::vector<std::array<Index, 3>> number(columns * rows, {-1, -1, -1});
  const auto corner = [&](std::size_t i, std::size_t j) {
    Index& n = number[j * columns + i][0];
    if (n < 0) n = static_cast<Index>(place.size()), place.emplace_back(column[i], row[j]);
    return n;
  };
  const auto first_between = [](const std::vector<double>& met, double from, double to) {
    const auto found = std::lower_bound(met.begin(), met.end(), from);
    return found != met.end() && *found <= to ? *found : 0.5 * (from + to);  // rounding may differ
  };
  const auto on_line = [&](std::size_t i, std::size_t j, bool upward) {
    Index& n = number[j * columns + i][upward ? 2 : 1];
    if (n < 0) {
      n = static_cast<Index>(place.size());
      if (upward)
        place.emplace_back(column[i], first_between(along_column[i], row[j], row[j + 1]));
      else
        place.emplace_back(first_between(along_row[j], column[i], column[i + 1]), row[j]);
    }
    return n;
  };
  for (std::size_t j = 0; j + 1 < rows; ++j)
    for (std::size_t i = 0; i + 1 < columns; ++i) {
      const std::array<std::pair<std::size_t, std::size_t>, 4> around = {
          {{i, j}, {i + 1, j}, {i + 1, j + 1}, {i, j + 1}}};
      const auto in = [&](std::size_t k) {
        return inside[around[k % 4].second * columns + around[k % 4].first] != 0;
      };
      std::vector<Index> polygon;
      for (std::size_t k = 0; k < 4; ++k) {
        if (in(k)) polygon.push_back(corner(around[k].first, around[k].second));
        if (in(k) == in(k + 1)) continue;
        const bool upward = k % 2 == 1;
        polygon.push_back(k == 1   ? on_line(i + 1, j, upward)
                          : k == 2 ? on_line(i, j + 1, upward)
                                   : on_line(i, j, upward));
      }
      for (std::size_t k = 1; k + 1 < polygon.size(); ++k)
        mesh.triangles.push_back({polygon[0], polygon[k], polygon[k + 1]});
    }
  return mesh;
}

}  // namespace

Section cut_open(const Discretisation& body) {
  Section section;
  const Vec3 origin = body.tool.centre * 1e3;
  const BodyFrame frame = body_frame(body.X * 1e3, origin, body.tool.approach);
  section.front = frame.front;
  const std::vector<Piece> pieces = outline(body.surface, frame, origin);
  if (pieces.empty()) return section;
  Vec2 low = pieces.front().from, high = low;
  for (const Piece& p : pieces)
    low = low.cwiseMin(p.from).cwiseMin(p.to), high = high.cwiseMax(p.from).cwiseMax(p.to);
  const double radius = body.tool.radius * 1e3, longest = (high - low).maxCoeff();
  const double coarse = std::max(longest / 80.0, 1e-6), fine = std::min(radius / 8.0, coarse);
  const std::vector<double> column = lattice_lines(low[0], high[0], 1.2 * radius, fine, coarse),
                            row = lattice_lines(low[1], high[1], radius, fine, coarse);
  const auto [place, triangles] = mesh_inside(pieces, column, row);
  section.place.resize(3, static_cast<Index>(place.size()));
  for (Index n = 0; n < section.place.cols(); ++n) {
    const Vec2& x = place[static_cast<std::size_t>(n)];
    section.place.col(n) = origin + x[0] * frame.broad + x[1] * frame.up;
  }
  section.triangles.resize(3, static_cast<Index>(triangles.size()));
  for (Index t = 0; t < section.triangles.cols(); ++t)
    for (Index k = 0; k < 3; ++k)
      section.triangles(k, t) = triangles[static_cast<std::size_t>(t)][static_cast<std::size_t>(k)];
  return section;
}

PointMeans make_point_means(const Points& point, const Points& places) {
  const Index count = std::min<Index>(8, point.cols());
  PointMeans means{.point = Eigen::MatrixXi(count, places.cols()),
                   .weight = Eigen::MatrixXd(count, places.cols())};
  if (count == 0) return means;
  const Neighbours tree(point);
  tbb::parallel_for(Index{0}, places.cols(), [&](Index m) {
    const std::vector<int> near = tree.nearest(places.col(m), static_cast<int>(count) + 1);
    const auto away2 = [&](std::size_t k) { return (point.col(near[k]) - places.col(m)).squaredNorm(); };
    const double reach2 = away2(near.size() - 1);
    for (Index k = 0; k < count; ++k) {
      const auto n = static_cast<std::size_t>(k);
      const double part = reach2 > 0.0 ? std::max(1.0 - away2(n) / reach2, 0.0) : 1.0;
      means.point(k, m) = near[n];
      means.weight(k, m) =
          std::max(part * part, 1e-12);  // points of a lattice may all be as far away as the ninth
    }
  });
  return means;
}

Eigen::RowVectorXd PointMeans::operator()(const Eigen::RowVectorXd& of_points) const {
  Eigen::RowVectorXd result(point.cols());
  for (Index m = 0; m < point.cols(); ++m) {
    double sum = 0.0, weights = 0.0;
    for (Index k = 0; k < point.rows(); ++k) {
      const double value = of_points[point(k, m)];
      if (std::isfinite(value)) sum += weight(k, m) * value, weights += weight(k, m);
    }
    result[m] = weights > 0.0 ? sum / weights : std::numeric_limits<double>::quiet_NaN();
  }
  return result;
}

}  // namespace dimple
