#include "preprocess/supports/interpolation.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>

#include "io/stop.hpp"
#include "preprocess/supports/place_support.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {
namespace {

// Nodes of one place and their weights.
struct PlaceWeights {
  std::vector<int> member;
  std::vector<double> weight;
};

Interpolation packed(const std::vector<PlaceWeights>& rows) {
  const auto count = static_cast<Index>(rows.size());
  Interpolation result;
  result.rows.offset.resize(count + 1);
  result.rows.offset[0] = 0;
  for (Index m = 0; m < count; ++m)
    result.rows.offset[m + 1] =
        result.rows.offset[m] + static_cast<int>(rows[static_cast<std::size_t>(m)].member.size());
  result.rows.member.resize(result.rows.offset[count]);
  result.weight.resize(result.rows.member.size());
  for (Index m = 0; m < count; ++m) {
    const PlaceWeights& row = rows[static_cast<std::size_t>(m)];
    std::copy(row.member.begin(), row.member.end(), result.rows.member.data() + result.rows.offset[m]);
    std::copy(row.weight.begin(), row.weight.end(), result.weight.data() + result.rows.offset[m]);
  }
  return result;
}

}  // namespace

std::shared_ptr<const Sight> sight_in(const Discretisation& model, const SupportOptions& options) {
  if (!options.through_tissue || model.surface.empty()) return {};
  auto sight = std::make_shared<const Sight>(model, options.radius_factor * model.spacing);
  return sight->all_clear() ? nullptr : sight;
}

Interpolation make_interpolation(const Discretisation& body, const SupportOptions& options,
                                 const Points& places, const Connected& connected) {
  const SupportNodes node_set(body, options);
  const bool masked = static_cast<bool>(connected);
  const auto near = nodes_near(places, node_set, {}, connected);
  std::vector<PlaceWeights> rows(static_cast<std::size_t>(places.cols()));
  const auto by_itself = [&](Index m) {
    std::function<bool(int)> to_place;
    if (masked) to_place = [&](int a) { return connected(a, m); };
    const PlaceSupport s = support_of(places.col(m), node_set, near.of(m), to_place);
    PlaceWeights& row = rows[static_cast<std::size_t>(m)];
    if (s.ok && !s.unconnected) {
      row = {s.nodes, {s.phi.begin(), s.phi.end()}};
      return;
    }
    const auto away = [&](int a) { return (body.X.col(a) - places.col(m)).norm(); };
    const auto there = near.of(m);
    row = {{there.empty() ? node_set.tree.nearest(places.col(m), 1).front()
                          : *std::min_element(there.begin(), there.end(),
                                              [&](int a, int b) { return away(a) < away(b); })},
           {1.0}};
  };
  tbb::parallel_for(Index{0}, (places.cols() + cell_places - 1) / cell_places, [&](Index group) {
    stop_if_requested();
    const Index first = group * cell_places, last = std::min(first + cell_places, places.cols());
    if (last - first < cell_places) {
      for (Index m = first; m < last; ++m) by_itself(m);
      return;
    }
    thread_local std::vector<int> nodes;
    thread_local MlsOfEight eight;
    nodes.clear();
    for (Index m = first; m < last; ++m) nodes.insert(nodes.end(), near.of(m).begin(), near.of(m).end());
    std::sort(nodes.begin(), nodes.end());
    nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
    mls_of_eight(places.middleCols(first, cell_places), body.X, nodes, node_set.radius, node_set.pinned,
                 options.interpolation, false, eight);
    for (Index m = first; m < last; ++m) {
      const auto k = static_cast<std::size_t>(m - first);
      // Another place of the eight may be connected with a node that this one is not.
      const bool same = !masked || eight.reached[k] == static_cast<int>(near.of(m).size());
      if (!same || !surely_good(eight, k)) {
        by_itself(m);
        continue;
      }
      const double* phi = eight.rows.data() + (m - first) * eight.stride;
      PlaceWeights& row = rows[static_cast<std::size_t>(m)];
      row.member.reserve(static_cast<std::size_t>(eight.reached[k]));
      row.weight.reserve(static_cast<std::size_t>(eight.reached[k]));
      for (std::size_t e = 0; e < eight.nodes.size(); ++e)
        if (phi[e] != 0.0) {
          row.member.push_back(eight.nodes[e]);
          row.weight.push_back(phi[e]);
        }
    }
  });
  return packed(rows);
}

namespace {

Connected members_of(const CompressedRows& rows) {
  return [&rows](int a, Index m) {
    return std::binary_search(rows.member.data() + rows.offset[m], rows.member.data() + rows.offset[m + 1],
                              a);
  };
}

// Visibility of a model that make_model() has not made is computed here.
std::shared_ptr<const Sight> sight_of(const Model& model) {
  if (model.sight || model.support_report.unseen == 0) return model.sight;
  return sight_in(model, model.scheme.support);
}

// Nodes that each place is connected with: the supports of the nearest points for which `reaches`(point,
// place) holds. Accurate enough for pictures, and cheaper than a test of every node.
template <class Reaches>
CompressedRows nodes_by_points(const Model& model, const Points& places, Reaches&& reaches) {
  constexpr int requested = 12, enough = 2;
  const Neighbours points(model.point);
  std::vector<std::vector<int>> nodes(static_cast<std::size_t>(places.cols()));
  tbb::parallel_for(Index{0}, places.cols(), [&](Index m) {
    if (m % 256 == 0) stop_if_requested();
    std::vector<int>& list = nodes[static_cast<std::size_t>(m)];
    int taken = 0;
    for (const int q : points.nearest(places.col(m), requested)) {
      if (!reaches(q, m)) continue;
      list.insert(list.end(), model.support.member.data() + model.support.offset[q],
                  model.support.member.data() + model.support.offset[q + 1]);
      if (++taken == enough) break;
    }
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  });
  CompressedRows result;
  result.offset.resize(places.cols() + 1);
  result.offset[0] = 0;
  for (Index m = 0; m < places.cols(); ++m)
    result.offset[m + 1] = result.offset[m] + static_cast<int>(nodes[static_cast<std::size_t>(m)].size());
  result.member.resize(result.offset[places.cols()]);
  for (Index m = 0; m < places.cols(); ++m)
    std::copy(nodes[static_cast<std::size_t>(m)].begin(), nodes[static_cast<std::size_t>(m)].end(),
              result.member.data() + result.offset[m]);
  return result;
}

}  // namespace

Interpolation surface_interpolation(const Model& model) {
  std::vector<Index> all(static_cast<std::size_t>(model.surface.vertex_mm.cols()));
  std::iota(all.begin(), all.end(), Index{0});
  return surface_interpolation(model, all);
}

Interpolation surface_interpolation(const Model& model, const std::vector<Index>& vertices) {
  const Points places = model.surface.vertex_mm * 1e-3;
  Points normals = Points::Zero(3, places.cols());
  for (const auto& t : model.surface.triangles.colwise()) {
    const Vec3 a = places.col(t[0]), n = (places.col(t[1]) - a).cross(places.col(t[2]) - a);
    for (const Index v : t) normals.col(v) += n;
  }
  return surface_interpolation(model, places(Eigen::all, vertices), normals(Eigen::all, vertices));
}

Interpolation surface_interpolation(const Model& model, const Points& places, const Points& normals) {
  if (model.support_report.unseen == 0) return make_interpolation(model, model.scheme.support, places);
  CompressedRows allowed;
  if (const auto sight = sight_of(model))
    allowed = nodes_by_points(model, places, [&](int q, Index m) {  // behind the surface
      return (model.point.col(q) - places.col(m)).dot(normals.col(m)) < 0.0 &&
             sight->point_sees(q, places.col(m));
    });
  return make_interpolation(model, model.scheme.support, places,
                            allowed.offset.size() > 0 ? members_of(allowed) : Connected());
}

Interpolation inner_interpolation(const Model& model, const Points& places) {
  CompressedRows allowed;
  if (const auto sight = sight_of(model))
    allowed =
        nodes_by_points(model, places, [&](int q, Index m) { return sight->point_sees(q, places.col(m)); });
  return make_interpolation(model, model.scheme.support, places,
                            allowed.offset.size() > 0 ? members_of(allowed) : Connected());
}

Interpolation node_interpolation(const Model& model) {
  if (model.support_report.unseen == 0) return make_interpolation(model, model.scheme.support, model.X);
  const Connected belongs = members_of(model.support);
  const CompressedRows allowed =
      nodes_by_points(model, model.X, [&](int q, Index m) { return belongs(static_cast<int>(m), q); });
  return make_interpolation(model, model.scheme.support, model.X, members_of(allowed));
}

Interpolation point_interpolation(const Model& model) {
  return make_interpolation(model, model.scheme.support, model.point,
                            model.support_report.unseen > 0 ? members_of(model.support) : Connected());
}

Eigen::MatrixXd Interpolation::operator()(const Eigen::MatrixXd& nodal) const {
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(nodal.rows(), rows.rows());
  for (Index m = 0; m < rows.rows(); ++m)
    for (int k = rows.offset[m]; k < rows.offset[m + 1]; ++k)
      result.col(m) += weight[k] * nodal.col(rows.member[k]);
  return result;
}

struct FieldAnywhere::Parts {
  explicit Parts(const Model& m) : model(m), node_set(m, m.scheme.support), sight(sight_of(m)) {
    if (sight) points.emplace(m.point);
  }
  const Model& model;
  SupportNodes node_set;
  std::shared_ptr<const Sight> sight;
  std::optional<Neighbours> points;

  // Nodes that x is connected with, by the nearest points that see it; `first` of them, or -1.
  void connected_with(const Vec3& x, std::vector<int>& nodes, int& first) const {
    constexpr int requested = 12, enough = 2;
    nodes.clear();
    first = -1;
    int taken = 0;
    const auto take = [&](int q) {
      nodes.insert(nodes.end(), model.support.member.data() + model.support.offset[q],
                   model.support.member.data() + model.support.offset[q + 1]);
      if (first < 0) first = q;
      return ++taken == enough;
    };
    const std::vector<int> nearest = points->nearest(x, requested);
    for (const int q : nearest)
      if (sight->point_sees(q, x) && take(q)) break;
    if (nodes.empty()) take(nearest.front());
    std::sort(nodes.begin(), nodes.end());
    nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
  }

  // Nodes that each place is connected with, and all of them. True if the first place's nearest point sees
  // all places: they are then connected with the same nodes.
  bool see_alike(const Points& places, std::array<std::vector<int>, most_places>& allowed,
                 std::vector<int>& all_allowed) const {
    bool alike = true;
    all_allowed.clear();
    int first = -1, own = -1;
    for (Index k = 0; k < places.cols(); ++k) {
      auto& list = allowed[static_cast<std::size_t>(k)];
      connected_with(places.col(k), list, own);
      if (k == 0) first = own;
      alike = alike && (k == 0 || own == first || sight->point_sees(first, places.col(k)));
      all_allowed.insert(all_allowed.end(), list.begin(), list.end());
    }
    std::sort(all_allowed.begin(), all_allowed.end());
    all_allowed.erase(std::unique(all_allowed.begin(), all_allowed.end()), all_allowed.end());
    return alike;
  }

  // One place with larger supports if necessary; if none serves, the nearest node's value.
  void by_itself(const Vec3& x, const Points& nodal, std::span<const int> near_x,
                 const std::vector<int>* allowed, Index k, Points& value,
                 Eigen::Matrix<double, 9, Eigen::Dynamic>* derivative) const {
    std::function<bool(int)> connected;
    if (allowed) connected = [&](int a) { return std::binary_search(allowed->begin(), allowed->end(), a); };
    std::vector<int> reaching(near_x.begin(), near_x.end());
    if (connected) std::erase_if(reaching, [&](int a) { return !connected(a); });
    const PlaceSupport s = support_of(x, node_set, reaching, connected);
    value.col(k).setZero();
    if (derivative) derivative->col(k).setZero();
    if (!s.ok) {
      value.col(k) = nodal.col(node_set.tree.nearest(x, 1).front());
      return;
    }
    for (std::size_t m = 0; m < s.nodes.size(); ++m) {
      const auto column = static_cast<Index>(m);
      const Vec3 u = nodal.col(s.nodes[m]);
      value.col(k) += s.phi[column] * u;
      if (derivative) derivative->col(k) += (u * s.dphi.col(column).transpose()).reshaped();
    }
  }
};

FieldAnywhere::FieldAnywhere(const Model& model) : parts_(std::make_unique<Parts>(model)) {}
FieldAnywhere::~FieldAnywhere() = default;

namespace {

// Gradient of the field of nodal values [3xN] at place k of the eight.
Mat3 gradient_at_place(const MlsOfEight& eight, Index k, const Points& nodal) {
  Mat3 sum = Mat3::Zero();
  const double* row = eight.rows.data() + 3 * k * eight.stride;
  for (std::size_t e = 0; e < eight.nodes.size(); ++e)
    sum += nodal.col(eight.nodes[e]) *
           Eigen::RowVector3d(row[e], row[static_cast<std::size_t>(eight.stride) + e],
                              row[2 * static_cast<std::size_t>(eight.stride) + e]);
  return sum;
}

}  // namespace

void FieldAnywhere::at(const Points& places, const Points& nodal, Points& value,
                       Eigen::Matrix<double, 9, Eigen::Dynamic>* derivative) const {
  const Parts& p = *parts_;
  const Index count = places.cols();
  value.resize(3, count);
  if (derivative) derivative->resize(9, count);
  if (count == 0) return;
  const Vec3 centre = places.rowwise().mean();
  const double extent = (places.colwise() - centre).colwise().norm().maxCoeff();
  thread_local std::vector<int> nodes;
  p.node_set.reaching(centre, 1.0, nodes, extent);

  thread_local std::array<std::vector<int>, most_places> allowed;
  thread_local std::vector<int> all_allowed, reaching;
  const bool hidden =
      p.sight && std::any_of(nodes.begin(), nodes.end(), [&](int a) { return !p.sight->sees_all(a); });
  reaching.assign(nodes.begin(), nodes.end());
  const bool alike = !hidden || p.see_alike(places, allowed, all_allowed);
  if (hidden)
    std::erase_if(reaching,
                  [&](int a) { return !std::binary_search(all_allowed.begin(), all_allowed.end(), a); });
  const auto single = [&](Index k) {
    const std::vector<int>* list = !hidden ? nullptr
                                   : alike ? &all_allowed
                                           : &allowed[static_cast<std::size_t>(k)];
    p.by_itself(places.col(k), nodal, nodes, list, k, value, derivative);
  };
  const SupportOptions& options = p.node_set.options;
  if (!alike || reaching.empty()) {
    for (Index k = 0; k < count; ++k) single(k);
    return;
  }
  thread_local MlsOfEight eight;
  Points x(3, cell_places);  // missing places repeat the last
  for (Index k = 0; k < cell_places; ++k) x.col(k) = places.col(std::min(k, count - 1));
  value.setZero();
  mls_of_eight(x, p.model.X, reaching, p.node_set.radius, p.node_set.pinned, options.interpolation, false,
               eight);
  std::array<bool, most_places> good{};
  for (Index k = 0; k < count; ++k) {
    good[static_cast<std::size_t>(k)] = surely_good(eight, static_cast<std::size_t>(k));
    if (!good[static_cast<std::size_t>(k)]) {
      single(k);
      continue;
    }
    const double* phi = eight.rows.data() + k * eight.stride;
    Vec3 sum = Vec3::Zero();
    for (std::size_t e = 0; e < eight.nodes.size(); ++e) sum += phi[e] * nodal.col(eight.nodes[e]);
    value.col(k) = sum;
  }
  if (!derivative) return;
  mls_of_eight(x, p.model.X, reaching, p.node_set.radius, p.node_set.pinned, options.interpolation, true,
               eight);
  for (Index k = 0; k < count; ++k)
    if (good[static_cast<std::size_t>(k)]) derivative->col(k) = gradient_at_place(eight, k, nodal).reshaped();
}

}  // namespace dimple
