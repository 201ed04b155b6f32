#include "preprocess/output/carry_back.hpp"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "io/words.hpp"
#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/supports/support.hpp"
#include "preprocess/surface/cut.hpp"

namespace dimple {
namespace {

constexpr double aimed_at = 1e-9, good_enough = 1e-6;  // m
constexpr int most_steps = 30, starts = 8;
constexpr double next_to_the_body = 0.25;  // node spacings: how far the field continues outside the body
constexpr double lost = 0.1;               // mm inside the surface: no solution there is an error
constexpr double far_apart = 2.5;          // node spacings from which on two places at rest are different

[[noreturn]] void refuse(const std::string& fact, const std::string& why, const std::string& remedy) {
  throw ModelError({.fact = fact, .where = "cut", .why = why, .remedy = remedy, .code = "cut"});
}

// Inverse of the deformation: X + u(X) = x, by Newton's method. All in metres.
class InverseMap {
 public:
  InverseMap(const Model& model, const Points& u)
      : model_(model), u_(u), field_(model), moved_(model.X + u), near_(moved_) {}

  // Damped Newton's method from a node, until no step reduces the residual.
  std::optional<Vec3> from(Index node, const Vec3& x) const {
    const double longest = model_.spacing[node];
    Vec3 X = model_.X.col(node) + (x - moved_.col(node));
    auto [r, F] = residual(X, x);
    double size = r.norm();
    for (int k = 0; k < most_steps && size > aimed_at; ++k) {
      Vec3 step = -F.fullPivLu().solve(r);
      if (!step.allFinite()) break;
      if (const double length = step.norm(); length > longest) step *= longest / length;
      bool nearer = false;
      for (int halved = 0; halved < 6 && !nearer; ++halved, step *= 0.5) {
        const auto [r_then, F_then] = residual(X + step, x);
        if (!(r_then.norm() < size)) continue;
        nearer = true;
        X += step;
        r = r_then, F = F_then, size = r.norm();
      }
      if (!nearer) break;
    }
    return size < good_enough ? std::optional(X) : std::nullopt;
  }

  struct Found {
    std::vector<Vec3> inside = {};     // all places of the body at rest that have moved to x
    std::optional<Vec3> outside = {};  // the place where the continued field has it; may be none
    bool converges = false;            // a search has converged
  };
  Found reference_places(const Vec3& x, const BodySurface& reference) const {
    Found all;
    std::vector<Vec3>& found = all.inside;
    for (const int a : near_.nearest(x, starts)) {
      const double spacing = model_.spacing[a], away = (moved_.col(a) - x).norm();
      if (away > 3.0 * spacing && found.empty()) break;  // the nearest is far away: outside
      const bool known = std::any_of(found.begin(), found.end(), [&](const Vec3& X) {
        return (model_.X.col(a) - X).norm() < far_apart * spacing + 2.0 * away;
      });
      if (known) continue;
      const std::optional<Vec3> X = from(a, x);
      if (!X) continue;
      all.converges = true;
      const Vec3 own = reference.to_world().inverse() * (1e3 * *X);
      if (!reference.contains(own)) {
        if (!all.outside && is_next_to(own, reference, 1e3 * spacing)) all.outside = X;
        continue;
      }
      if (std::none_of(found.begin(), found.end(),
                       [&](const Vec3& other) { return (*X - other).norm() < 0.5 * spacing; }))
        found.push_back(*X);
    }
    return all;
  }

  // d x / d X there.
  Mat3 gradient(const Vec3& X) const { return residual(X, X).second; }
  // Approximate place at rest of a place outside the body.
  Vec3 by_the_nearest_node(const Vec3& x) const {
    const int a = near_.nearest(x, 1).front();
    return model_.X.col(a) + (x - moved_.col(a));
  }
  // True for a place in the deformed body, at least near a node.
  bool is_by_a_node(const Vec3& x) const {
    const int a = near_.nearest(x, 1).front();
    return (moved_.col(a) - x).norm() < 0.5 * model_.spacing[a];
  }

 private:
  // True for X [mm, the surface's own frame] outside the body at rest but near it, and not in a gap, with
  // another wall behind.
  static bool is_next_to(const Vec3& X, const BodySurface& reference, double spacing) {
    const BodySurface::Closest next = reference.closest(X);
    if (next.distance > next_to_the_body * spacing) return false;
    const std::vector<double> behind = reference.crossings(X, X - next.place);
    return std::none_of(behind.begin(), behind.end(),
                        [&](double t) { return t > 0.0 && t * next.distance < 2.0 * spacing; });
  }
  std::pair<Vec3, Mat3> residual(const Vec3& X, const Vec3& x) const {
    Points value(3, 1);
    Eigen::Matrix<double, 9, Eigen::Dynamic> derivative(9, 1);
    field_.at(X, u_, value, &derivative);
    return {X + value - x, Mat3::Identity() + Eigen::Map<const Mat3>(derivative.data())};
  }

  const Model& model_;
  const Points& u_;
  FieldAnywhere field_;
  Points moved_;
  Neighbours near_;
};

[[noreturn]] void refuse_two_places(const Vec3& x) {
  refuse(fmt::format("the blade passes through {}, where two parts of the body overlap", in_words(x)),
         "its walls have passed through each other there, so the cut is ambiguous",
         "give --self-contact on, or cut before they close");
}

[[noreturn]] void refuse_lost(const Vec3& x) {
  refuse(
      fmt::format("tissue in the blade's path at {} cannot be mapped back to its place at rest", in_words(x)),
      "the displacement field cannot be inverted there: tissue may be inverted",
      "use more nodes, or cut at a smaller deformation");
}

// Displacement of the surface next to a place outside of the body [mm].
Vec3 moved_next_to(const BodySurface::Closest& closest, const BodySurface& now,
                   const BodySurface& reference) {
  const auto corner = now.triangles().col(closest.triangle);
  const Vec3 a = now.vertex().col(corner[0]), e = now.vertex().col(corner[1]) - a,
             g = now.vertex().col(corner[2]) - a, d = closest.place - a, n = e.cross(g);
  const double area = std::max(n.squaredNorm(), std::numeric_limits<double>::min());
  Vec3 fraction(0.0, d.cross(g).dot(n) / area, e.cross(d).dot(n) / area);
  fraction[0] = 1.0 - fraction[1] - fraction[2];
  Vec3 moved = Vec3::Zero();
  for (Index c = 0; c < 3; ++c)
    moved += fraction[c] * (now.vertex().col(corner[c]) - reference.vertex().col(corner[c]));
  return moved;
}

std::vector<std::vector<Index>> neighbours_on(const TriangleMesh& sheet) {
  std::vector<std::set<Index>> sets(static_cast<std::size_t>(sheet.vertex.cols()));
  for (const auto& t : sheet.triangles.colwise())
    for (Index c = 0; c < 3; ++c)
      for (Index d = 1; d < 3; ++d) sets[static_cast<std::size_t>(t[c])].insert(t[(c + d) % 3]);
  std::vector<std::vector<Index>> lists;
  for (const std::set<Index>& one : sets) lists.emplace_back(one.begin(), one.end());
  return lists;
}

// Continues `displacement` [3 x vertices] from the known vertices to the others, harmonically on the sheet.
void continue_over(const TriangleMesh& sheet, const std::vector<char>& known, Points& displacement) {
  constexpr int sweeps = 200;
  const std::vector<std::vector<Index>> next_to = neighbours_on(sheet);
  std::vector<char> reached = known;
  std::vector<Index> others, front;  // in the order in which they are reached
  for (std::size_t v = 0; v < known.size(); ++v)
    if (known[v]) front.push_back(static_cast<Index>(v));
  const auto mean = [&](Index v) {
    Vec3 sum = Vec3::Zero();
    int count = 0;
    for (const Index w : next_to[static_cast<std::size_t>(v)])
      if (reached[static_cast<std::size_t>(w)]) sum += displacement.col(w), ++count;
    return Vec3(sum / std::max(count, 1));
  };
  while (!front.empty()) {
    std::set<Index> ring;
    for (const Index v : front)
      for (const Index w : next_to[static_cast<std::size_t>(v)])
        if (!reached[static_cast<std::size_t>(w)]) ring.insert(w);
    front.assign(ring.begin(), ring.end());
    for (const Index v : front) displacement.col(v) = mean(v);
    for (const Index v : front) reached[static_cast<std::size_t>(v)] = 1;
    others.insert(others.end(), front.begin(), front.end());
  }
  for (int k = 0; k < sweeps; ++k)
    for (const Index v : others) displacement.col(v) = mean(v);
}

bool is_open(const Triangles& triangles) {
  std::set<std::pair<Index, Index>> edge;
  for (const auto& t : triangles.colwise())
    for (Index c = 0; c < 3; ++c) edge.emplace(t[c], t[(c + 1) % 3]);
  return std::any_of(edge.begin(), edge.end(), [&](const auto& one) {
    return !edge.contains({one.second, one.first});
  });
}

// Vertices with more than one fan of the kept triangles: parts of a sheet that meet at a vertex only.
std::vector<Index> pinched(const Triangles& triangles, const std::vector<char>& kept, Index vertices) {
  // For each vertex, the edges around it: from -> to.
  std::vector<std::map<Index, Index>> around(static_cast<std::size_t>(vertices));
  for (Index t = 0; t < triangles.cols(); ++t)
    if (kept[static_cast<std::size_t>(t)])
      for (Index c = 0; c < 3; ++c)
        around[static_cast<std::size_t>(triangles(c, t))][triangles((c + 1) % 3, t)] =
            triangles((c + 2) % 3, t);
  std::vector<Index> result;
  for (std::size_t v = 0; v < around.size(); ++v) {
    if (around[v].empty()) continue;
    std::set<Index> ends;
    for (const auto& [from, to] : around[v]) ends.insert(to);
    std::size_t fans = 0;
    for (const auto& [from, to] : around[v]) fans += ends.contains(from) ? 0 : 1;
    if (fans > 1) result.push_back(static_cast<Index>(v));
  }
  return result;
}

// The part of an open sheet near the body, in whole triangles.
TriangleMesh near_part(const TriangleMesh& sheet, const TriangleMesh& undeformed,
                       const std::vector<double>& away) {
  std::vector<char> kept(static_cast<std::size_t>(sheet.triangles.cols()), 0);
  for (Index t = 0; t < sheet.triangles.cols(); ++t) {
    double longest = 0.0, nearest = std::numeric_limits<double>::infinity();
    for (Index c = 0; c < 3; ++c) {
      const Index a = sheet.triangles(c, t), b = sheet.triangles((c + 1) % 3, t);
      longest = std::max(longest, (sheet.vertex.col(a) - sheet.vertex.col(b)).norm());
      nearest = std::min(nearest, away[static_cast<std::size_t>(a)]);
    }
    kept[static_cast<std::size_t>(t)] = nearest <= longest;
  }
  // Parts that would meet at a vertex only are joined there.
  for (std::vector<Index> at; !(at = pinched(sheet.triangles, kept, sheet.vertex.cols())).empty();) {
    const std::set<Index> all(at.begin(), at.end());
    for (Index t = 0; t < sheet.triangles.cols(); ++t)
      for (Index c = 0; c < 3; ++c)
        if (all.contains(sheet.triangles(c, t))) kept[static_cast<std::size_t>(t)] = 1;
  }
  TriangleMesh result;
  std::vector<int> number(static_cast<std::size_t>(sheet.vertex.cols()), -1);
  std::vector<Index> vertex, triangle;
  for (Index t = 0; t < sheet.triangles.cols(); ++t) {
    if (!kept[static_cast<std::size_t>(t)]) continue;
    triangle.push_back(t);
    for (Index c = 0; c < 3; ++c) number[static_cast<std::size_t>(sheet.triangles(c, t))] = 0;
  }
  for (std::size_t v = 0; v < number.size(); ++v)
    if (number[v] == 0) {
      number[v] = static_cast<int>(vertex.size());
      vertex.push_back(static_cast<Index>(v));
    }
  result.vertex = undeformed.vertex(Eigen::all, vertex);
  result.triangles.resize(3, static_cast<Index>(triangle.size()));
  for (std::size_t k = 0; k < triangle.size(); ++k)
    for (Index c = 0; c < 3; ++c)
      result.triangles(c, static_cast<Index>(k)) =
          number[static_cast<std::size_t>(sheet.triangles(c, triangle[k]))];
  return result;
}

}  // namespace

BodySurface deformed_surface(const Model& model, const Points& u) {
  return {model.surface.vertex_mm + 1e3 * surface_interpolation(model)(u), model.surface.triangles};
}

TriangleMesh carried_back(const TriangleMesh& sheet, const Model& model, const Points& u) {
  const BodySurface now = deformed_surface(model, u),
                    reference(model.surface.vertex_mm, model.surface.triangles);
  const InverseMap inverse_map(model, u);
  const Index count = sheet.vertex.cols();
  Points displacement = Points::Zero(3, count);  // backward displacements
  std::vector<double> away(static_cast<std::size_t>(count), 0.0);
  std::vector<char> places(static_cast<std::size_t>(count), 1), is_lost(places.size(), 0);
  tbb::parallel_for(tbb::blocked_range<Index>(0, count, 64), [&](const tbb::blocked_range<Index>& range) {
    for (Index v = range.begin(); v < range.end() && stop_requested() == StopReason::none; ++v) {
      const auto at = static_cast<std::size_t>(v);
      const Vec3 x = sheet.vertex.col(v);
      const InverseMap::Found found = inverse_map.reference_places(1e-3 * x, reference);
      places[at] = static_cast<char>(found.inside.empty() ? found.outside.has_value() : found.inside.size());
      if (!found.inside.empty()) {
        displacement.col(v) = 1e3 * found.inside.front() - x;
        continue;
      }
      const BodySurface::Closest closest = now.closest(x);
      away[at] = closest.distance;
      is_lost[at] = !found.converges && closest.distance > lost && now.contains(x);
      displacement.col(v) =
          found.outside ? Vec3(1e3 * *found.outside - x) : Vec3(-moved_next_to(closest, now, reference));
    }
  });
  stop_if_requested();
  for (Index v = 0; v < count; ++v) {
    const auto at = static_cast<std::size_t>(v);
    if (places[at] > 1) refuse_two_places(sheet.vertex.col(v));
    if (is_lost[at]) refuse_lost(sheet.vertex.col(v));
  }
  if (std::any_of(places.begin(), places.end(), [](char found) { return found > 0; }))
    continue_over(sheet, places, displacement);
  TriangleMesh undeformed{sheet.vertex + displacement, sheet.triangles};
  if (!is_open(sheet.triangles)) return undeformed;
  TriangleMesh result = near_part(sheet, undeformed, away);
  if (result.triangles.cols() == 0)
    refuse("a cut meets no tissue", "its blade misses the deformed organ",
           "move it; the surface of the frame before shows where the body is");
  return result;
}

TriangleMesh reference_stroke(const Vec3& x, const Vec3& y, double depth, double step, const Model& model,
                              const Points& u, const BodySurface& reference) {
  constexpr int samples = 8;
  constexpr double steepest = 0.2;  // of the mean of unit normals across the stroke
  const InverseMap inverse_map(model, u);
  const Vec3 along = (y - x).normalized();
  const Eigen::Isometry3d to_body = reference.to_world().inverse();
  Vec3 into = Vec3::Zero();
  double above = 0.0;  // the surface may be above the straight stroke
  for (int k = 0; k <= samples; ++k) {
    const InverseMap::Found found =
        inverse_map.reference_places(1e-3 * (x + k * (y - x) / samples), reference);
    if (found.inside.size() > 1) refuse_two_places(x + k * (y - x) / samples);
    const Vec3 X = !found.inside.empty() ? found.inside.front()
                   : found.outside       ? *found.outside
                                   : inverse_map.by_the_nearest_node(1e-3 * (x + k * (y - x) / samples));
    const BodySurface::Closest closest = reference.closest(to_body * (1e3 * X));
    const Vec3 normal = reference.to_world().linear() * reference.normal().col(closest.triangle);
    into -= (inverse_map.gradient(X).inverse().transpose() * normal).normalized();
    if (!found.inside.empty()) above = std::max(above, 2.0 * closest.distance);
  }
  into -= into.dot(along) * along;
  if (!(into.norm() > steepest * (samples + 1)))
    refuse("the direction into the body is not unique along the stroke",
           "the surface near it faces opposite directions, or along it",
           "keep the stroke on one side of the body");
  const TriangleMesh sheet = swept_sheet(x, y, into.normalized(), above + 0.1 * step, depth, step);
  Points displacement = Points::Zero(3, sheet.vertex.cols());
  std::vector<char> known(static_cast<std::size_t>(sheet.vertex.cols()), 0);
  Index converged = 0, lost_ones = 0;  // lost: in the opening of another cut, near a node
  Vec3 last_lost = x;
  for (Index v = 0; v < sheet.vertex.cols(); ++v) {
    stop_if_requested();
    const Vec3 place = sheet.vertex.col(v);
    const InverseMap::Found found = inverse_map.reference_places(1e-3 * place, reference);
    if (found.inside.size() > 1) refuse_two_places(place);
    if (!found.converges && inverse_map.is_by_a_node(1e-3 * place)) ++lost_ones, last_lost = place;
    if (found.inside.empty() && !found.outside) continue;
    displacement.col(v) = 1e3 * (found.inside.empty() ? *found.outside : found.inside.front()) - place;
    known[static_cast<std::size_t>(v)] = 1;
    ++converged;
  }
  if (3 * lost_ones > converged && lost_ones > 0) refuse_lost(last_lost);  // more than a quarter of both
  if (converged == 0)
    refuse("the blade meets no tissue", "its path is outside of the deformed body", "move it, or cut deeper");
  continue_over(sheet, known, displacement);
  return {sheet.vertex + displacement, sheet.triangles};
}

}  // namespace dimple
