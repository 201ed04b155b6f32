#include "preprocess/output/deformation_map.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "io/stop.hpp"
#include "preprocess/output/lattice_field.hpp"

namespace dimple {
namespace {

constexpr double margin = 3.0;         // largest displacements: range in which the surroundings follow
constexpr double converged = 1e-3;     // of a voxel
constexpr int most_newton_steps = 16;  // of Newton's method
constexpr int cheap_steps = 4;         // of them with the given gradient
constexpr double neighbourhood = 2.0;  // cells: farthest distance from its start
constexpr double on_edge = 1e-6;       // of a tetrahedron's coordinates

Vec3 vec(const std::array<Index, 3>& a) {
  return {static_cast<double>(a[0]), static_cast<double>(a[1]), static_cast<double>(a[2])};
}

// The six tetrahedra of a cell: the paths from its first corner to its last along the axes in any order. They
// meet those of the neighbouring cells in whole faces.
constexpr std::array<std::array<int, 3>, 6> orders = {
    {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}}};  // three even ones, then three odd

}  // namespace

void InverseMapReport::add(const InverseMapReport& other) {
  moved += other.moved;
  solved += other.solved;
  unsettled += other.unsettled;
  folded += other.folded;
  largest_residual = std::max(largest_residual, other.largest_residual);
}

DeformationMap::DeformationMap(const Model& model, const FieldAnywhere& field, const Points& u,
                               const VoxelGrid& grid)
    : model_(model),
      field_(field),
      u_(u),
      grid_(grid),
      to_voxels_(grid.to_world.inverse()),
      surface_(to_voxels_ * model.surface.vertex_mm, model.surface.triangles) {
  surface_.mark_clear_cells([&](const Vec3& x) {
    std::vector<double> crossings;
    rows_inside(x[1], x[2], crossings);
    return std::count_if(crossings.begin(), crossings.end(), [&](double at) { return at < x[0]; }) % 2 == 1;
  });
  const double largest_mm = u.cols() > 0 ? 1e3 * u.colwise().norm().maxCoeff() : 0.0;
  if (!(largest_mm > 0.0)) return;
  const Points undeformed = to_voxels_ * model.surface.vertex_mm;
  Points moved = undeformed;
  for (Index first = 0; first < undeformed.cols(); first += FieldAnywhere::most_places) {
    if (first % 4096 == 0) stop_if_requested();
    const Index count = std::min(FieldAnywhere::most_places, undeformed.cols() - first);
    moved.middleCols(first, count) += displaced(undeformed.middleCols(first, count));
  }
  const Vec3 last = vec(grid.size).array() - 1.0;
  Index beyond = 0;
  for (const auto& x : moved.colwise())
    beyond += (x.array() < -0.5).any() || ((x - last).array() > 0.5).any() ? 1 : 0;
  fraction_beyond_ = static_cast<double>(beyond) / static_cast<double>(moved.cols());

  // Extent of a ball of 1 mm along each axis [voxels].
  const Vec3 ball = to_voxels_.linear().rowwise().norm();
  const Vec3 low = undeformed.rowwise().minCoeff() - margin * largest_mm * ball,
             high = undeformed.rowwise().maxCoeff() + margin * largest_mm * ball;
  std::array<Index, 3> end{};
  for (std::size_t a = 0; a < 3; ++a) {
    const auto d = static_cast<Index>(a);
    // Beyond the image as far as tissue may come from.
    const double before = -1.2 * largest_mm * ball[d] - 1.0, behind = last[d] - before;
    cut_[a] = {low[d]<before, high[d]> behind};
    first_[a] = static_cast<Index>(std::floor(std::max(low[d], before)));
    end[a] = static_cast<Index>(std::ceil(std::min(high[d], behind)));
    if (end[a] <= first_[a]) return;  // the body is far away
  }
  step_ = {1, 1, 1};
  const auto counted = [&](std::size_t a) { return (end[a] - first_[a] + step_[a] - 1) / step_[a] + 1; };
  const Vec3 spacing = grid.spacing();
  while (counted(0) * counted(1) * counted(2) > most_lattice) {  // the finest step grows
    std::size_t finest = 0;
    for (std::size_t a = 1; a < 3; ++a)
      if (static_cast<double>(step_[a]) * spacing[static_cast<Index>(a)] <
          static_cast<double>(step_[finest]) * spacing[static_cast<Index>(finest)])
        finest = a;
    ++step_[finest];
  }
  for (std::size_t a = 0; a < 3; ++a) n_[a] = counted(a);
  sample_body();
  continue_outside();
  bound_rows();
}

// Displacements of places in voxels [voxels], by the field itself.
Points DeformationMap::displaced(const Points& places) const {
  Points value;
  field_.at(1e-3 * (grid_.to_world * places), u_, value);
  return to_voxels_.linear() * (1e3 * value);
}

// Crossings of a row along the first axis with the surface, ascending: inside is from even to odd ones.
void DeformationMap::rows_inside(double j, double k, std::vector<double>& crossings) const {
  thread_local std::vector<SurfaceCells::Hit> hits;
  crossings.clear();
  constexpr int most_tries = 20;
  constexpr double far = 1e9;
  for (int attempt = 0; attempt < most_tries; ++attempt) {
    // Steps aside from an edge on the row.
    const double aside = 1e-6 * attempt * (1.0 + attempt);
    if (!surface_.line(Vec3(-far, j + aside, k + 0.7 * aside), 0, -far, far, hits)) continue;
    for (const auto& hit : hits) crossings.push_back(hit.at);
    std::sort(crossings.begin(), crossings.end());
    if (crossings.size() % 2 == 1) crossings.pop_back();
    return;
  }
}

void DeformationMap::inside(Index k, std::span<char> is_inside) const {
  std::fill(is_inside.begin(), is_inside.end(), char{0});
  const Index ni = grid_.size[0];
  tbb::parallel_for(Index{0}, grid_.size[1], [&](Index j) {
    stop_if_requested();
    thread_local std::vector<double> crossings;
    rows_inside(static_cast<double>(j), static_cast<double>(k), crossings);
    for (std::size_t c = 0; c + 1 < crossings.size(); c += 2) {
      const Index begin = std::max<Index>(0, static_cast<Index>(std::ceil(crossings[c]))),
                  end = std::min<Index>(ni, static_cast<Index>(std::floor(crossings[c + 1])) + 1);
      for (Index i = begin; i < end; ++i) is_inside[static_cast<std::size_t>(i + ni * j)] = 1;
    }
  });
}

std::optional<bool> DeformationMap::inside_near_surface(const Vec3& place) const {
  constexpr double near = 2.0;
  if (surface_.farther(place, near).value_or(false)) return std::nullopt;
  return surface_.contains(place);
}

void DeformationMap::sample_body() {
  inside_.assign(static_cast<std::size_t>(n_[0] * n_[1] * n_[2]), 0);
  v_.assign(3 * inside_.size(), 0.0f);
  const auto at = [&](Index a, Index b, Index c) -> Vec3 {
    return vec({first_[0] + step_[0] * a, first_[1] + step_[1] * b, first_[2] + step_[2] * c});
  };
  tbb::parallel_for(Index{0}, n_[1] * n_[2], [&](Index row) {
    if (row % 64 == 0) stop_if_requested();
    thread_local std::vector<double> crossings;
    const Index b = row % n_[1], c = row / n_[1];
    const Vec3 x = at(0, b, c);
    rows_inside(x[1], x[2], crossings);
    for (std::size_t m = 0; m + 1 < crossings.size(); m += 2) {
      const double scale = 1.0 / static_cast<double>(step_[0]);
      const Index begin = std::max<Index>(0, static_cast<Index>(std::ceil((crossings[m] - x[0]) * scale))),
                  end = std::min<Index>(
                      n_[0], static_cast<Index>(std::floor((crossings[m + 1] - x[0]) * scale)) + 1);
      for (Index a = begin; a < end; ++a) inside_[static_cast<std::size_t>(point_number(a, b, c))] = 1;
    }
  });
  // Blocks of two by two by two: neighbours have most of their nodes in common.
  const Index pairs_b = (n_[1] + 1) / 2, pairs_c = (n_[2] + 1) / 2;
  tbb::parallel_for(Index{0}, pairs_b * pairs_c, [&](Index pair) {
    std::array<Index, 8> number;
    Points places(3, FieldAnywhere::most_places);
    for (Index a = 0; a < n_[0]; a += 2) {
      stop_if_requested();
      Index count = 0;
      for (int corner = 0; corner < 8; ++corner) {
        const Index x = a + (corner & 1), y = pair % pairs_b * 2 + (corner >> 1 & 1),
                    z = pair / pairs_b * 2 + (corner >> 2 & 1);
        if (x >= n_[0] || y >= n_[1] || z >= n_[2]) continue;
        const Index m = point_number(x, y, z);
        if (!inside_[static_cast<std::size_t>(m)]) continue;
        places.col(count) = at(x, y, z);
        number[static_cast<std::size_t>(count++)] = m;
      }
      if (count == 0) continue;
      const Points u = displaced(places.leftCols(count));
      for (Index k = 0; k < count; ++k)
        for (Index r = 0; r < 3; ++r)
          v_[static_cast<std::size_t>(3 * number[static_cast<std::size_t>(k)] + r)] =
              static_cast<float>(u(r, k));
    }
  });
}

// Displacement of a lattice point outside, next to some inside: the field continued from the nearest of
// those, by at most half of the distance and the largest displacement; false where there is none.
bool DeformationMap::continue_from_inside(const std::array<Index, 3>& at, double largest_mm, Vec3& v) const {
  constexpr double most = 0.5;
  const Vec3 step = vec(step_).cwiseProduct(grid_.spacing());
  Points extrapolated(3, FieldAnywhere::most_places);
  Index count = 0;
  double nearest = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 27; ++k) {
    const std::array<Index, 3> offset{k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1};
    std::array<Index, 3> other = at;
    bool in_lattice = true;
    for (std::size_t a = 0; a < 3; ++a) {
      other[a] += offset[a];
      in_lattice = in_lattice && other[a] >= 0 && other[a] < n_[a];
    }
    if (!in_lattice || !inside_[static_cast<std::size_t>(point_number(other[0], other[1], other[2]))])
      continue;
    const double away = vec(offset).cwiseProduct(step).norm();
    if (away < nearest * (1.0 - 1e-9)) nearest = away, count = 0;
    if (away < nearest * (1.0 + 1e-9) && count < extrapolated.cols()) extrapolated.col(count++) = vec(offset);
  }
  if (count == 0) return false;
  extrapolated.conservativeResize(3, count);
  const Vec3 here = vec(first_) + vec(step_).cwiseProduct(vec(at));
  Points value;
  Eigen::Matrix<double, 9, Eigen::Dynamic> derivative;
  const Points places = (vec(step_).asDiagonal() * extrapolated).colwise() + here;
  field_.at(1e-3 * (grid_.to_world * places), u_, value, &derivative);
  Vec3 u_mm = Vec3::Zero();
  for (Index k = 0; k < count; ++k) {
    const Vec3 back = grid_.to_world.linear() * (here - places.col(k));  // [mm]
    Vec3 more = Eigen::Map<const Mat3>(derivative.col(k).data()) * back;
    if (const double size = more.norm(), bound = most * back.norm(); size > bound) more *= bound / size;
    u_mm += (1e3 * value.col(k) + more) / static_cast<double>(count);
  }
  if (const double size = u_mm.norm(); size > largest_mm) u_mm *= largest_mm / size;
  v = to_voxels_.linear() * u_mm;
  return true;
}

void DeformationMap::continue_outside() {
  const double largest_mm = 1e3 * u_.colwise().norm().maxCoeff();
  LatticeField level{.n = n_, .known = inside_, .v = std::move(v_)};
  tbb::parallel_for(Index{0}, n_[1] * n_[2], [&](Index row) {
    if (row % 64 == 0) stop_if_requested();
    for (Index a = 0; a < n_[0]; ++a) {
      const auto m = static_cast<std::size_t>(a + n_[0] * row);
      Vec3 v;
      if (inside_[m] || !continue_from_inside({a, row % n_[1], row / n_[1]}, largest_mm, v)) continue;
      level.known[m] = 1;
      for (Index r = 0; r < 3; ++r) level.v[3 * m + static_cast<std::size_t>(r)] = static_cast<float>(v[r]);
    }
  });
  // The border is zero, except where the lattice ends because the image ends.
  for (Index c = 0; c < n_[2]; ++c)
    for (Index b = 0; b < n_[1]; ++b)
      for (Index a = 0; a < n_[0]; ++a) {
        const std::array<Index, 3> at{a, b, c};
        for (std::size_t d = 0; d < 3; ++d)
          if ((at[d] == 0 && !cut_[d][0]) || (at[d] == n_[d] - 1 && !cut_[d][1]))
            level.known[static_cast<std::size_t>(point_number(a, b, c))] = 1;
      }
  const Vec3 step = vec(step_).cwiseProduct(grid_.spacing());
  continue_smoothly(level, step.cwiseInverse().cwiseAbs2() * step.squaredNorm());
  v_ = std::move(level.v);
}

void DeformationMap::bound_rows() {
  constexpr float none = std::numeric_limits<float>::infinity();
  const Index rows = n_[1] - 1;
  reach_.assign(static_cast<std::size_t>(rows * (n_[2] - 1)), {none, -none});
  tbb::parallel_for(Index{0}, n_[2] - 1, [&](Index c) {
    stop_if_requested();
    for (Index b = 0; b < rows; ++b) {
      auto& [least, most] = reach_[static_cast<std::size_t>(b + rows * c)];
      bool moves = false;
      for (int side = 0; side < 4; ++side)
        for (Index a = 0; a < n_[0]; ++a) {
          const float* v = v_.data() + 3 * point_number(a, b + (side & 1), c + (side >> 1));
          const float k = static_cast<float>(first_[2] + step_[2] * (c + (side >> 1))) + v[2];
          moves = moves || v[0] != 0.0f || v[1] != 0.0f || v[2] != 0.0f;
          least = std::min(least, k);
          most = std::max(most, k);
        }
      if (!moves) least = none, most = -none;
    }
  });
}

// The lattice's displacement between its points [voxels]; zero beyond.
Vec3 DeformationMap::on_lattice(const Vec3& place) const {
  std::array<Index, 3> low;
  Vec3 part;
  for (std::size_t a = 0; a < 3; ++a) {
    const auto d = static_cast<Index>(a);
    const double at = (place[d] - static_cast<double>(first_[a])) / static_cast<double>(step_[a]);
    if (!(at >= 0.0 && at <= static_cast<double>(n_[a] - 1))) return Vec3::Zero();
    low[a] = std::min(static_cast<Index>(at), n_[a] - 2);
    part[d] = at - static_cast<double>(low[a]);
  }
  Vec3 sum = Vec3::Zero();
  for (int c = 0; c < 8; ++c) {
    const double w = (c & 1 ? part[0] : 1.0 - part[0]) * (c & 2 ? part[1] : 1.0 - part[1]) *
                     (c & 4 ? part[2] : 1.0 - part[2]);
    if (w == 0.0) continue;
    const float* v =
        v_.data() + 3 * point_number(low[0] + (c & 1), low[1] + (c >> 1 & 1), low[2] + (c >> 2 & 1));
    sum += w * Vec3(v[0], v[1], v[2]);
  }
  return sum;
}

void DeformationMap::displacement(Index k, std::span<float> u_mm, std::span<float> jacobian) const {
  std::fill(u_mm.begin(), u_mm.end(), 0.0f);
  std::fill(jacobian.begin(), jacobian.end(), 0.0f);
  const Index ni = grid_.size[0];
  std::vector<char> is_inside(static_cast<std::size_t>(grid_.slice()));
  inside(k, is_inside);
  // With a lattice as fine as the voxels the field was evaluated there already.
  const bool known = has_lattice() && step_ == std::array<Index, 3>{1, 1, 1} && jacobian.empty();
  tbb::parallel_for(Index{0}, grid_.size[1], [&](Index j) {
    stop_if_requested();
    Points places(3, FieldAnywhere::most_places), value;
    std::array<std::size_t, 8> number;
    Index count = 0;
    Eigen::Matrix<double, 9, Eigen::Dynamic> derivative;
    const auto evaluate = [&] {
      if (count == 0) return;
      stop_if_requested();
      field_.at(1e-3 * places.leftCols(count), u_, value, jacobian.empty() ? nullptr : &derivative);
      for (Index m = 0; m < count; ++m) {
        const std::size_t voxel = number[static_cast<std::size_t>(m)];
        for (Index r = 0; r < 3; ++r)
          u_mm[3 * voxel + static_cast<std::size_t>(r)] = static_cast<float>(1e3 * value(r, m));
        if (!jacobian.empty())
          jacobian[voxel] =
              static_cast<float>((Mat3::Identity() + derivative.col(m).reshaped(3, 3)).determinant());
      }
      count = 0;
    };
    for (Index i = 0; i < ni; ++i) {
      const auto voxel = static_cast<std::size_t>(i + ni * j);
      const Vec3 x = vec({i, j, k});
      if (is_inside[voxel] && !known) {
        if (!has_lattice() && jacobian.empty()) continue;
        places.col(count) = grid_.to_world * x;
        number[static_cast<std::size_t>(count++)] = voxel;
        if (count == FieldAnywhere::most_places) evaluate();
      } else if (has_lattice()) {
        const Vec3 u = grid_.to_world.linear() * on_lattice(x);
        for (Index r = 0; r < 3; ++r)
          u_mm[3 * voxel + static_cast<std::size_t>(r)] = static_cast<float>(u[r]);
      }
    }
    evaluate();
  });
}

// A tetrahedron of the lattice, at rest and displaced.
struct DeformationMap::Cell {
  Vec3 undeformed, moved;              // its first corner
  Mat3 undeformed_edges, moved_edges;  // from there to the others
  Cell(const DeformationMap& map, Index a, Index b, Index c, int order) {
    const auto corner = [&](const std::array<Index, 3>& at, Vec3& place, Vec3& displaced_place) {
      for (std::size_t d = 0; d < 3; ++d)
        place[static_cast<Index>(d)] = static_cast<double>(map.first_[d] + map.step_[d] * at[d]);
      const float* v = map.v_.data() + 3 * map.point_number(at[0], at[1], at[2]);
      displaced_place = place + Vec3(v[0], v[1], v[2]);
    };
    std::array<Index, 3> at{a, b, c};
    corner(at, undeformed, moved);
    for (Index e = 0; e < 3; ++e) {
      ++at[static_cast<std::size_t>(orders[static_cast<std::size_t>(order)][static_cast<std::size_t>(e)])];
      Vec3 place, displaced_place;
      corner(at, place, displaced_place);
      undeformed_edges.col(e) = place - undeformed;
      moved_edges.col(e) = displaced_place - moved;
    }
  }
};

// Tetrahedron that each voxel of a slice is in, and whether that is not inverted.
struct DeformationMap::Owners {
  static constexpr std::int32_t nobody = -1;
  std::vector<std::int32_t> cell;  // six times the number of its first corner, and its path
  std::vector<char> upright;
};

// Assigns the voxels of slice k in a displaced tetrahedron to it, unless an earlier, upright one has them.
void DeformationMap::cover(const Cell& cell, std::int32_t number, bool order_is_even, Index k,
                           Owners& owners) const {
  const double level = static_cast<double>(k);
  const Mat3& edges = cell.moved_edges;
  const Vec3 lower = cell.moved + edges.rowwise().minCoeff().cwiseMin(0.0),
             upper = cell.moved + edges.rowwise().maxCoeff().cwiseMax(0.0);
  if (lower[2] > level + 1e-6 || upper[2] < level - 1e-6) return;
  const double volume = edges.determinant();
  if (std::abs(volume) < 1e-12) return;
  const bool oriented = (volume > 0.0) == order_is_even;
  const Mat3 inverse = edges.inverse();
  const auto from = [](double x) { return static_cast<Index>(std::ceil(x - 1e-6)); };
  const auto to = [](double x) { return static_cast<Index>(std::floor(x + 1e-6)); };
  const Index ni = grid_.size[0], nj = grid_.size[1];
  const Index i0 = std::max<Index>(0, from(lower[0])), i1 = std::min(ni - 1, to(upper[0]));
  const Index j0 = std::max<Index>(0, from(lower[1])), j1 = std::min(nj - 1, to(upper[1]));
  for (Index j = j0; j <= j1; ++j)
    for (Index i = i0; i <= i1; ++i) {
      const auto voxel = static_cast<std::size_t>(i + ni * j);
      if (owners.upright[voxel] || (owners.cell[voxel] != Owners::nobody && !oriented)) continue;
      const Vec3 s = inverse * (vec({i, j, k}) - cell.moved);
      if (s.minCoeff() < -on_edge || s.sum() > 1.0 + on_edge) continue;
      owners.cell[voxel] = number;
      owners.upright[voxel] = oriented;
    }
}

// Does the cell of the lattice move, and does it reach that slice?
bool DeformationMap::moves_to(const std::array<Index, 3>& at, double level) const {
  float low = std::numeric_limits<float>::infinity(), high = -low;
  bool moves = false;
  for (int corner = 0; corner < 8; ++corner) {
    const Index layer = at[2] + (corner >> 2 & 1);
    const float* v = v_.data() + 3 * point_number(at[0] + (corner & 1), at[1] + (corner >> 1 & 1), layer);
    const float there = static_cast<float>(first_[2] + step_[2] * layer) + v[2];
    low = std::min(low, there), high = std::max(high, there);
    moves = moves || v[0] != 0.0f || v[1] != 0.0f || v[2] != 0.0f;
  }
  return moves && static_cast<double>(low) <= level + 1e-3 && static_cast<double>(high) >= level - 1e-3;
}

DeformationMap::Owners DeformationMap::owners_in_slice(Index k) const {
  const auto voxels = static_cast<std::size_t>(grid_.slice());
  Owners owners{.cell = std::vector<std::int32_t>(voxels, Owners::nobody),
                .upright = std::vector<char>(voxels, 0)};
  const double level = static_cast<double>(k);
  const Index rows = n_[1] - 1;
  for (Index c = 0; c + 1 < n_[2]; ++c)
    for (Index b = 0; b < rows; ++b) {
      const auto [least, most] = reach_[static_cast<std::size_t>(b + rows * c)];
      if (static_cast<double>(least) > level + 1e-3 || static_cast<double>(most) < level - 1e-3) continue;
      stop_if_requested();
      for (Index a = 0; a + 1 < n_[0]; ++a) {
        if (!moves_to({a, b, c}, level)) continue;
        for (int order = 0; order < 6; ++order)
          cover(Cell(*this, a, b, c, order), static_cast<std::int32_t>(6 * point_number(a, b, c) + order),
                order < 3, k, owners);
      }
    }
  return owners;
}

// A voxel for which the place at rest is searched.
struct DeformationMap::Seeker {
  float* place;
  Vec3 x, start, X;
  Mat3 back;  // inverse gradient: change of X for a change of X + u(X)
  Vec3 best;  // so far
  double residual = std::numeric_limits<double>::infinity();
};

// Solves for the field itself by Newton's method, for a group of neighbours.
void DeformationMap::solve(std::vector<Seeker>& group, InverseMapReport& report) const {
  if (group.empty()) return;
  stop_if_requested();
  const Vec3 cell_size = vec(step_);
  std::vector<Seeker*> open;
  for (Seeker& one : group) open.push_back(&one);
  Points places, u;
  Eigen::Matrix<double, 9, Eigen::Dynamic> derivative;
  for (int step = 0; step < most_newton_steps && !open.empty(); ++step) {
    places.resize(3, static_cast<Index>(open.size()));
    for (std::size_t m = 0; m < open.size(); ++m) places.col(static_cast<Index>(m)) = open[m]->X;
    // The tetrahedron's gradient is available, and suffices for nearly all.
    const bool own_gradient = step >= cheap_steps;
    field_.at(1e-3 * (grid_.to_world * places), u_, u, own_gradient ? &derivative : nullptr);
    u = to_voxels_.linear() * (1e3 * u);
    for (std::size_t m = 0; m < open.size(); ++m) {
      Seeker& one = *open[m];
      const auto column = static_cast<Index>(m);
      const Vec3 off = one.X + u.col(column) - one.x;
      if (const double residual = off.cwiseAbs().maxCoeff(); residual < one.residual) {
        one.residual = residual;
        one.best = one.X;
      }
      if (own_gradient) {
        const Mat3 F = Mat3::Identity() +
                       to_voxels_.linear() * derivative.col(column).reshaped(3, 3) * grid_.to_world.linear();
        if (std::abs(F.determinant()) > 1e-3) one.back = F.inverse();
      }
      const Vec3 by = one.back * off;
      one.X -= by / std::max(1.0, by.cwiseQuotient(cell_size).cwiseAbs().maxCoeff());
    }
    std::erase_if(open, [&](const Seeker* one) {
      return one->residual <= converged ||
             !((one->X - one->start).cwiseAbs().array() <= neighbourhood * cell_size.array()).all();
    });
  }
  for (Seeker& one : group) {
    ++report.solved;
    if (one.residual > converged) ++report.unsettled;
    report.largest_residual = std::max(report.largest_residual, one.residual);
    for (Index r = 0; r < 3; ++r) one.place[r] = static_cast<float>(one.best[r]);
  }
  group.clear();
}

bool DeformationMap::at_body(Index a, Index b, Index c) const {
  for (int corner = 0; corner < 8; ++corner)
    if (inside_[static_cast<std::size_t>(
            point_number(a + (corner & 1), b + (corner >> 1 & 1), c + (corner >> 2 & 1)))])
      return true;
  return false;
}

InverseMapReport DeformationMap::reference_slice(Index k, std::span<float> place) const {
  InverseMapReport report;
  const Index ni = grid_.size[0], nj = grid_.size[1];
  for (Index j = 0; j < nj; ++j)
    for (Index i = 0; i < ni; ++i) {
      float* x = place.data() + 3 * (i + ni * j);
      x[0] = static_cast<float>(i), x[1] = static_cast<float>(j), x[2] = static_cast<float>(k);
    }
  if (!has_lattice()) return report;
  const Owners owners = owners_in_slice(k);
  const Vec3 cell_size = vec(step_);
  std::vector<Seeker> group;
  for (std::size_t voxel = 0; voxel < owners.cell.size(); ++voxel) {
    const std::int32_t owner = owners.cell[voxel];
    if (owner == Owners::nobody) continue;
    ++report.moved;
    if (!owners.upright[voxel]) ++report.folded;
    const Index number = owner / 6, a = number % n_[0], b = number / n_[0] % n_[1],
                c = number / (n_[0] * n_[1]);
    const Cell cell(*this, a, b, c, static_cast<int>(owner % 6));
    const Vec3 x = vec({static_cast<Index>(voxel) % ni, static_cast<Index>(voxel) / ni, k});
    const Mat3 back = cell.undeformed_edges * cell.moved_edges.inverse();
    const Vec3 start = cell.undeformed + back * (x - cell.moved);
    float* to = place.data() + 3 * voxel;
    for (Index r = 0; r < 3; ++r) to[r] = static_cast<float>(start[r]);
    if (!at_body(a, b, c)) continue;
    if (!group.empty() &&
        (group.size() == static_cast<std::size_t>(FieldAnywhere::most_places) ||
         ((start - group.front().start).cwiseAbs().array() > 8.0 + 2.0 * cell_size.array()).any()))
      solve(group, report);
    group.push_back({to, x, start, start, back, start});
  }
  solve(group, report);
  return report;
}

InverseMapReport DeformationMap::reference_places(Index first, Index last, std::span<float> place) const {
  std::vector<InverseMapReport> of_slice(static_cast<std::size_t>(last - first));
  const auto length = static_cast<std::size_t>(3 * grid_.slice());
  tbb::parallel_for(first, last, [&](Index k) {
    const auto m = static_cast<std::size_t>(k - first);
    of_slice[m] = reference_slice(k, place.subspan(m * length, length));
  });
  InverseMapReport report;
  for (const InverseMapReport& slice : of_slice) report.add(slice);
  return report;
}

}  // namespace dimple
