#include "preprocess/surface/boundary_fit.hpp"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>
#include <tuple>

#include "io/stop.hpp"
#include "preprocess/surface/mesh_sweeps.hpp"

namespace dimple {
namespace {

// Constants chosen by tests/bench/results/surface.csv (balls of 6 to 60 voxels, boxes, a torus). Lengths are
// in units: the cube root of a voxel's volume or half the lattice's step, unless stated otherwise.
struct Rules {
  double smallest_window = 4.5;  // 4: the top of a ball of 25 is off by 0.08 instead of 0.05
  double growth = 1.4142135623730951;
  int windows = 6;      // up to 25 units: terraces of a radius of 300
  double floor = 0.15;  // of a face's precision: the error of the quadric itself
  double slack = 0.6;   // voxel edges along the normal; 0.75 rounds the edges of boxes
  double misfit = 1.3;  // times that of positions rounded to voxels; 1.6 flattens ellipsoids
  double outside = 0.02, outside_first = 0.15;  // fraction of faces that may disagree; first: smallest window
  double wrong_side = 0.1;
  double support = 0.75, covered = 0.4;  // windows: reach of a fit, and part where it makes seeds needless
  double agreement = 0.5;                // cosine of the normals of a vertex and a fit that moves it
  double farthest = 1.2;                 // times half a voxel along the normal: no vertex moves farther
  double undecided = 0.02;               // weight of a vertex's own position
};
constexpr Rules rules;

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;

// Numbers of points, sorted into cubic cells.
class PointCells {
 public:
  PointCells(const std::vector<Vec3>& point, double edge) : edge_(edge) {
    constexpr double most_cells = 4e6;
    if (!point.empty()) {
      Vec3 low = point.front(), high = low;
      for (const Vec3& x : point) low = low.cwiseMin(x), high = high.cwiseMax(x);
      edge_ = std::max(edge_, std::cbrt((high - low).array().max(edge).prod() / most_cells));
      origin_ = low;
      n_ = ((high - low) / edge_).array().floor().cast<int>() + 1;
    }
    offset_.assign(static_cast<std::size_t>(n_.prod()) + 1, 0);
    for (const Vec3& x : point) ++offset_[number(cell_of(x)) + 1];
    for (std::size_t c = 1; c < offset_.size(); ++c) offset_[c] += offset_[c - 1];
    order_.resize(point.size());
    std::vector<int> next(offset_.begin(), offset_.end() - 1);
    for (std::size_t i = 0; i < point.size(); ++i)
      order_[static_cast<std::size_t>(next[number(cell_of(point[i]))]++)] = static_cast<int>(i);
  }
  /// Points in the order of their cells.
  const std::vector<int>& order() const { return order_; }
  /// Calls visit(k) for all points order()[k] in cells that a cube around x reaches.
  template <class Visit>
  void around(const Vec3& x, double reach, const Visit& visit) const {
    const Eigen::Array3i first = cell_of(x.array() - reach).max(0),
                         last = cell_of(x.array() + reach).min(n_ - 1);
    if ((first > last).any()) return;
    for (int k = first[2]; k <= last[2]; ++k)
      for (int j = first[1]; j <= last[1]; ++j) {
        const int end = offset_[number({last[0], j, k}) + 1];
        for (int m = offset_[number({first[0], j, k})]; m < end; ++m) visit(static_cast<std::size_t>(m));
      }
  }

 private:
  Eigen::Array3i cell_of(const Vec3& x) const {
    return ((x - origin_) / edge_).array().max(-2.0).min(1e6).floor().cast<int>();
  }
  std::size_t number(const Eigen::Array3i& c) const {
    return static_cast<std::size_t>(c[0]) +
           static_cast<std::size_t>(n_[0]) *
               (static_cast<std::size_t>(c[1]) +
                static_cast<std::size_t>(n_[1]) * static_cast<std::size_t>(c[2]));
  }
  double edge_;
  Vec3 origin_ = Vec3::Zero();
  Eigen::Array3i n_ = Eigen::Array3i::Ones();
  std::vector<int> offset_, order_;
};

// `side`: twice the axis, plus one where outside is towards lower indices.
struct BoundaryFaces {
  std::vector<Vec3> centre;  // [mm]
  std::vector<int> side;
};

// One in `every` boundary faces, chosen evenly.
BoundaryFaces boundary_faces(const VoxelSet& body, const Mat3& voxel_to_local, std::uint32_t every) {
  BoundaryFaces faces;
  const Vec3 first(static_cast<double>(body.first[0]), static_cast<double>(body.first[1]),
                   static_cast<double>(body.first[2]));
  std::uint32_t count = 0;
  const auto add = [&](double i, double j, double k, int side) {
    if ((count++ * 2654435761u >> 16) % every != 0) return;
    faces.centre.push_back(voxel_to_local * (first + Vec3(i, j, k)));
    faces.side.push_back(side);
  };
  // Calls `each` for the voxels of one row without a neighbour in the other.
  const auto alone = [](std::span<const VoxelSet::Stretch> row, std::span<const VoxelSet::Stretch> other,
                        const auto& each) {
    auto at = other.begin();
    for (auto [i, end] : row)
      while (i < end) {
        while (at != other.end() && at->end <= i) ++at;
        const std::int32_t to = at == other.end() ? end : std::min(end, at->begin);
        for (; i < to; ++i) each(static_cast<double>(i));
        if (i < end) i = std::min(end, at->end);
      }
  };
  for (Index k = 0; k < body.size[2]; ++k) {
    stop_if_requested();
    for (Index j = 0; j < body.size[1]; ++j) {
      const auto row = body.row(j, k);
      const auto y = static_cast<double>(j), z = static_cast<double>(k);
      for (const auto& [begin, end] : row) add(begin - 0.5, y, z, 1), add(end - 0.5, y, z, 0);
      if (j + 1 < body.size[1]) {
        alone(row, body.row(j + 1, k), [&](double i) { add(i, y + 0.5, z, 2); });
        alone(body.row(j + 1, k), row, [&](double i) { add(i, y + 0.5, z, 3); });
      }
      if (k + 1 < body.size[2]) {
        alone(row, body.row(j, k + 1), [&](double i) { add(i, y, z + 0.5, 4); });
        alone(body.row(j, k + 1), row, [&](double i) { add(i, y, z + 0.5, 5); });
      }
    }
  }
  return faces;
}

// A quadric near a seed: c0 + c1 u + c2 v + c3 u^2 + c4 u v + c5 v^2, height over a plane [mm].
struct Fit {
  Vec3 centre;
  Mat3 frame;  // rows: two directions in the plane, its normal
  Vec6 c = Vec6::Zero();
  double window = 0.0;  // radius of the ball whose faces determine it [mm]

  struct Height {
    double height, slope_u, slope_v;
  };
  Height at(double u, double v) const {
    return {c[0] + u * (c[1] + c[3] * u + c[4] * v) + v * (c[2] + c[5] * v), c[1] + 2.0 * c[3] * u + c[4] * v,
            c[2] + c[4] * u + 2.0 * c[5] * v};
  }
};

Mat3 frame_along(const Vec3& normal) {
  const Vec3 u = normal.unitOrthogonal();
  Mat3 frame;
  frame << u.transpose(), normal.cross(u).transpose(), normal.transpose();
  return frame;
}

class Fitter {
 public:
  Fitter(const BoundaryFaces& faces, const Mat3& voxel_to_local, double unit)
      : unit_(unit), cells_(faces.centre, 2.0 * unit) {
    for (const int f : cells_.order()) {
      faces_.centre.push_back(faces.centre[static_cast<std::size_t>(f)]);
      faces_.side.push_back(faces.side[static_cast<std::size_t>(f)]);
    }
    for (int side = 0; side < 6; ++side)
      outward_[static_cast<std::size_t>(side)] = (side % 2 ? -1.0 : 1.0) * voxel_to_local.col(side / 2);
  }

  double window(int size) const { return unit_ * rules.smallest_window * std::pow(rules.growth, size); }

  /// The fit with the largest window that the faces agree with; none if the smallest already disagrees.
  std::optional<Fit> grow(const Vec3& x, const Vec3& normal) const {
    std::optional<Fit> result;
    Fit fit{.centre = x, .frame = frame_along(normal)};
    for (int size = 0; size < rules.windows; ++size) {
      fit.window = window(size);
      bool agrees = improve(fit, size == 0);
      if (size == 0) agrees = agrees && improve(fit, true);
      if (!agrees) break;
      result = fit;
    }
    if (!result || result->window >= window(rules.windows - 1)) return result;
    fit = *result;
    fit.window *= std::sqrt(rules.growth);
    return improve(fit, false) ? fit : result;
  }

  /// Half the extent of a voxel along a unit vector [mm].
  double half_voxel(const Vec3& n) const {
    return 0.5 * (std::abs(n.dot(outward_[0])) + std::abs(n.dot(outward_[2])) + std::abs(n.dot(outward_[4])));
  }

 private:
  static constexpr int lanes = 8;
  using Lanes = Eigen::Array<float, lanes, 1>;
  // Some faces in a seed's frame, lengths in windows. Padding in the last one has no weight.
  struct Near {
    Lanes u, v, h, weight, out_u, out_v, out_h;
  };
  // Height of some faces above the quadric, and their weights.
  struct Compared {
    Lanes h, weight;
  };
  struct Agreement {
    Lanes misfit = Lanes::Zero(), agreeing = Lanes::Zero(), all = Lanes::Zero();
  };
  // Sums over faces for the normal equations of a change of the quadric.
  struct Sums {
    std::array<Lanes, 15> moment;  // of 1, u, v, u^2, uv, v^2, u^3, u^2 v, u v^2, v^3, u^4, ...
    std::array<Lanes, 6> load;
    Sums() { moment.fill(Lanes::Zero()), load.fill(Lanes::Zero()); }
  };
  static double sum(const Lanes& value) { return value.cast<double>().sum(); }

  void gather(const Fit& fit, std::vector<Near>& near) const {
    near.clear();
    const double shrink = 1.0 / fit.window;
    std::array<Vec3, 6> outward;
    for (std::size_t side = 0; side < 6; ++side) outward[side] = shrink * (fit.frame * outward_[side]);
    int lane = lanes;
    cells_.around(fit.centre, fit.window, [&](std::size_t f) {
      const Vec3 away = shrink * (faces_.centre[f] - fit.centre);
      const double r2 = away.squaredNorm();
      if (r2 >= 1.0) return;
      if (lane == lanes) {
        const Lanes zero = Lanes::Zero();
        near.push_back({zero, zero, zero, zero, zero, zero, zero});
        lane = 0;
      }
      const Vec3 local = fit.frame * away;
      const Vec3& out = outward[static_cast<std::size_t>(faces_.side[f])];
      Near& to = near.back();
      to.u[lane] = static_cast<float>(local[0]);
      to.v[lane] = static_cast<float>(local[1]);
      to.h[lane] = static_cast<float>(local[2]);
      to.weight[lane] = static_cast<float>((1.0 - r2) * (1.0 - r2));
      to.out_u[lane] = static_cast<float>(out[0]);
      to.out_v[lane] = static_cast<float>(out[1]);
      to.out_h[lane] = static_cast<float>(out[2]);
      ++lane;
    });
  }

  // `c`: the quadric with lengths in windows. `slack`, `floor2`: in windows, and squared.
  static Compared compare(Agreement& sums, const Near& f, const std::array<float, 6>& c, float slack,
                          float floor2, float wrong_side) {
    const Lanes height = c[0] + f.u * (c[1] + c[3] * f.u + c[4] * f.v) + f.v * (c[2] + c[5] * f.v);
    const Lanes slope_u = c[1] + 2.0f * c[3] * f.u + c[4] * f.v,
                slope_v = c[2] + c[4] * f.u + 2.0f * c[5] * f.v;
    const Lanes length2 = 1.0f + slope_u * slope_u + slope_v * slope_v, length = length2.sqrt();
    const Lanes along = (f.out_h - slope_u * f.out_u - slope_v * f.out_v) / length;
    const Lanes r = (f.h - height) / length;
    const Lanes this_side = (along >= -wrong_side).select(f.weight, Lanes::Zero());
    const Lanes agreeing = (r.abs() <= 0.5f * along.abs() + slack).select(this_side, Lanes::Zero());
    sums.all += this_side;
    sums.agreeing += agreeing;
    const Lanes precision = agreeing / (along * along + floor2);
    sums.misfit += precision * r * r;
    return {f.h - height, precision / length2};
  }

  static void add(Sums& sums, const Near& f, const Compared& compared) {
    const Lanes &u = f.u, &v = f.v, &p = compared.weight, &h = compared.h;
    const Lanes pu = p * u, pv = p * v, uu = u * u, uv = u * v, vv = v * v, puu = p * uu, puv = p * uv,
                pvv = p * vv;
    const std::array<Lanes, 15> moment = {p,        pu,       pv,       puu,      puv,
                                          pvv,      puu * u,  puu * v,  pvv * u,  pvv * v,
                                          puu * uu, puu * uv, puu * vv, pvv * uv, pvv * vv};
    for (std::size_t i = 0; i < 15; ++i) sums.moment[i] += moment[i];
    const std::array<Lanes, 6> load = {p * h, pu * h, pv * h, puu * h, puv * h, pvv * h};
    for (std::size_t i = 0; i < 6; ++i) sums.load[i] += load[i];
  }

  // The least-squares fit to the faces that agree with the fit so far; false if too few agree with it, or
  // they disagree with each other. All lengths but those of `fit` are in windows.
  bool improve(Fit& fit, bool first) const {
    thread_local std::vector<Near> near;
    thread_local std::vector<Compared> compared;
    gather(fit, near);
    const double w = fit.window;
    Vec6 scale;
    scale << w, 1.0, 1.0, 1.0 / w, 1.0 / w, 1.0 / w;
    std::array<float, 6> c;
    for (int i = 0; i < 6; ++i) c[static_cast<std::size_t>(i)] = static_cast<float>(fit.c[i] / scale[i]);
    const Vec3 normal = fit.frame.row(2);
    const double across =
        Vec3(normal.dot(outward_[0]), normal.dot(outward_[2]), normal.dot(outward_[4])).norm();
    const double floor = rules.floor * unit_ / w;
    Agreement agreement;
    compared.clear();
    for (const Near& f : near)
      compared.push_back(compare(agreement, f, c, static_cast<float>(rules.slack * across / w),
                                 static_cast<float>(floor * floor),
                                 static_cast<float>(rules.wrong_side * unit_ / w)));

    constexpr double least_weight = 3.0;  // of the faces in all, each at most 1
    const double agreeing = sum(agreement.agreeing), outside = first ? rules.outside_first : rules.outside;
    if (!(agreeing > (1.0 - outside) * sum(agreement.all)) || agreeing < least_weight) return false;
    Sums sums;
    for (std::size_t k = 0; k < near.size(); ++k) add(sums, near[k], compared[k]);
    std::array<double, 15> m;
    for (std::size_t i = 0; i < 15; ++i) m[i] = sum(sums.moment[i]);
    Mat6 A;
    A << m[0], m[1], m[2], m[3], m[4], m[5],    //
        m[1], m[3], m[4], m[6], m[7], m[8],     //
        m[2], m[4], m[5], m[7], m[8], m[9],     //
        m[3], m[6], m[7], m[10], m[11], m[12],  //
        m[4], m[7], m[8], m[11], m[12], m[13],  //
        m[5], m[8], m[9], m[12], m[13], m[14];
    A.diagonal().array() += 1e-6 * A.trace();
    Vec6 b;
    for (int i = 0; i < 6; ++i) b[i] = sum(sums.load[static_cast<std::size_t>(i)]);
    const Vec6 change = A.ldlt().solve(b);
    constexpr double of_rounding = 1.0 / 12.0;  // variance of what is spread evenly over a voxel's edge
    if (sum(agreement.misfit) - change.dot(b) > rules.misfit * of_rounding * agreeing) return false;
    fit.c += scale.cwiseProduct(change);
    return true;
  }

  double unit_;
  PointCells cells_;
  BoundaryFaces faces_;  // in the order of their cells
  std::array<Vec3, 6> outward_;
};

// A contour's vertices, their displacement by the fits so far, and which of them a fit covers.
struct Vertices {
  std::vector<Vec3> place, normal;
  std::vector<Vec3> moved;  // sum of weight times displacement
  std::vector<double> weight;
  std::vector<char> covered;
};

// `place`: the expected boundary of a contour that is `outward` of it.
Vertices vertices_of(const TriangleMesh& surface, double outward) {
  const auto count = static_cast<std::size_t>(surface.vertex.cols());
  Vertices result{std::vector<Vec3>(count), std::vector<Vec3>(count, Vec3::Zero()),
                  std::vector<Vec3>(count, Vec3::Zero()), std::vector<double>(count, 0.0),
                  std::vector<char>(count, 0)};
  const AreaNormals sums = area_normals(surface);
  for (std::size_t v = 0; v < count; ++v) {
    const auto column = static_cast<Index>(v);
    result.normal[v] = sums.normal.col(column).normalized();
    result.place[v] = surface.vertex.col(column) - outward * result.normal[v];
  }
  return result;
}

// Seeds: one uncovered vertex for each cell and each of six directions of the normal, nearest the mean.
std::vector<std::size_t> seeds_among(const Vertices& vertices, double edge) {
  struct Candidate {
    std::uint64_t cell;  // three coordinates in 20 bits each, and the direction
    std::size_t vertex;
    bool operator<(const Candidate& other) const {
      return std::tie(cell, vertex) < std::tie(other.cell, other.vertex);
    }
  };
  constexpr std::uint64_t bits = 20, middle = std::uint64_t{1} << (bits - 1), most = (middle << 1) - 1;
  std::vector<Candidate> candidates;
  for (std::size_t v = 0; v < vertices.place.size(); ++v) {
    if (vertices.covered[v]) continue;
    Index axis = 0;
    vertices.normal[v].cwiseAbs().maxCoeff(&axis);
    std::uint64_t cell = 0;
    for (const double x : vertices.place[v])
      cell = (cell << bits) +
             ((static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(x / edge))) + middle) & most);
    candidates.push_back(
        {(cell << 3) + static_cast<std::uint64_t>(2 * axis + (vertices.normal[v][axis] > 0.0 ? 1 : 0)), v});
  }
  tbb::parallel_sort(candidates.begin(), candidates.end());
  std::vector<std::size_t> seeds;
  for (auto begin = candidates.begin(), end = begin; begin != candidates.end(); begin = end) {
    Vec3 mean = Vec3::Zero();
    for (; end != candidates.end() && end->cell == begin->cell; ++end) mean += vertices.place[end->vertex];
    mean /= static_cast<double>(end - begin);
    const auto distance2 = [&](const Candidate& c) {
      return (vertices.place[c.vertex] - mean).squaredNorm();
    };
    seeds.push_back(std::min_element(begin, end, [&](const Candidate& a, const Candidate& b) {
                      return distance2(a) < distance2(b);
                    })->vertex);
  }
  return seeds;
}

void move_by(const Fit& fit, const Fitter& fitter, std::size_t v, Vertices& vertices) {
  const Vec3 away = vertices.place[v] - fit.centre;
  const double reach = rules.support * fit.window, r2 = away.squaredNorm() / (reach * reach);
  if (r2 >= 1.0) return;
  const Vec3 local = fit.frame * away;
  const auto [height, slope_u, slope_v] = fit.at(local[0], local[1]);
  const Vec3 n = (fit.frame.transpose() * Vec3(-slope_u, -slope_v, 1.0)).normalized();
  if (n.dot(vertices.normal[v]) < rules.agreement) return;
  const double distance = (height - local[2]) / std::sqrt(1.0 + slope_u * slope_u + slope_v * slope_v);
  if (std::abs(distance) > rules.farthest * fitter.half_voxel(n)) return;
  const double size = fit.window / fitter.window(0);
  const double weight = (1.0 - r2) * (1.0 - r2) * size * size;
  vertices.moved[v] += weight * distance * n;
  vertices.weight[v] += weight;
  if (r2 * rules.support * rules.support < rules.covered * rules.covered) vertices.covered[v] = 1;
}

// Adds the displacements of all vertices by all fits, those of similar windows at a time.
void move_by(const std::vector<Fit>& fits, const Fitter& fitter, Vertices& vertices) {
  for (int size = 0; size < rules.windows; ++size) {
    const double least = fitter.window(size) * (1.0 - 1e-9), most = fitter.window(size + 1) * (1.0 - 1e-9);
    std::vector<Vec3> centre;
    std::vector<const Fit*> alike;
    for (const Fit& fit : fits)
      if (fit.window >= least && fit.window < most) centre.push_back(fit.centre), alike.push_back(&fit);
    if (centre.empty()) continue;
    stop_if_requested();
    const double reach = rules.support * most;
    const PointCells cells(centre, 0.5 * reach);
    tbb::parallel_for(std::size_t{0}, vertices.place.size(), [&](std::size_t v) {
      cells.around(vertices.place[v], reach, [&](std::size_t k) {
        move_by(*alike[static_cast<std::size_t>(cells.order()[k])], fitter, v, vertices);
      });
    });
  }
}

}  // namespace

std::vector<double> fit_to_boundary_faces(TriangleMesh& surface, const VoxelSet& body,
                                          const Mat3& voxel_to_local, double step, double outward) {
  const double voxel = std::cbrt(std::abs(voxel_to_local.determinant())), unit = std::max(voxel, 0.5 * step);
  const auto every = static_cast<std::uint32_t>(std::floor(unit / voxel * unit / voxel));
  const Fitter fitter(boundary_faces(body, voxel_to_local, every), voxel_to_local, unit);
  Vertices vertices = vertices_of(surface, outward);
  for (int size = rules.windows - 1; size >= 0; --size) {
    stop_if_requested();
    const std::vector<std::size_t> seeds = seeds_among(vertices, rules.covered * fitter.window(size));
    std::vector<std::optional<Fit>> grown(seeds.size());
    tbb::parallel_for(std::size_t{0}, seeds.size(), [&](std::size_t s) {
      grown[s] = fitter.grow(vertices.place[seeds[s]], vertices.normal[seeds[s]]);
    });
    std::vector<Fit> fits;
    for (const auto& fit : grown)
      if (fit) fits.push_back(*fit);
    move_by(fits, fitter, vertices);
  }
  std::vector<double> determined(vertices.place.size(), 0.0);
  for (std::size_t v = 0; v < determined.size(); ++v) {
    if (!(vertices.weight[v] > 0.0)) continue;
    const double all = vertices.weight[v] + rules.undecided;
    determined[v] = vertices.weight[v] / all;
    surface.vertex.col(static_cast<Index>(v)) += vertices.moved[v] / all;
  }
  return determined;
}

}  // namespace dimple
