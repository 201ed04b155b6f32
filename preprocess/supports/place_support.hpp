#pragma once

#include <functional>
#include <span>
#include <vector>

#include "preprocess/nodes/neighbours.hpp"
#include "preprocess/supports/mls_lanes.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {

/// The largest factor by which the radii of the nodes around a place may be enlarged.
inline constexpr double largest_support_growth = 2.5;

/// Nodes and shape functions of one place.
struct PlaceSupport {
  std::vector<int> nodes;
  Eigen::VectorXd phi;
  Points dphi;
  double growth = 1.0;       ///< factor by which radii were enlarged
  bool unconnected = false;  ///< too few nodes are connected with it: the nearest were taken
  MlsResult mls;
  bool ok = false;
};

/// The nodes of a model with their radii and search trees, for all its places.
struct SupportNodes {
  /// Both must outlive it.
  SupportNodes(const Discretisation& model, const SupportOptions& options);

  const Discretisation& model;
  const SupportOptions& options;
  Neighbours tree;
  Eigen::VectorXd radius;
  /// Nodes by the powers of two of their radii. In graded nodes, a search with the largest radius would find
  /// most nodes of the fine part.
  struct Octave {
    Neighbours tree;
    std::vector<int> nodes;
    double largest_radius;
  };
  std::vector<Octave> octaves;
  std::vector<char> pinned;

  /// Nodes whose radius, enlarged by `growth`, comes within `extent` of x; ascending.
  void reaching(const Vec3& x, double growth, std::vector<int>& result, double extent = 0.0) const;
  bool reaches(int a, const Vec3& x, double growth, double extent = 0.0) const {
    return (model.X.col(a) - x).norm() < radius[a] * growth + extent;
  }
};

/// Nodes that enlarged supports of places within `extent` of `middle` may use, searched once for all of them.
/// Each is tested for connection once, when it is in reach.
struct NodesAround {
  Vec3 middle;
  double extent = 0.0;
  std::vector<int> node;
  enum class Known : char { no, connected, hidden };
  std::vector<Known> known;

  /// Those that reach x with radii `growth` times as large; ascending.
  void reaching(const Vec3& x, const SupportNodes& node_set, double growth,
                const std::function<bool(int)>& connected, bool only_connected, std::vector<int>& result);
};

/// Support of the place x [m]. `near`: all nodes that reach x with their own radii and are `connected` with
/// it by the tissue; others are ignored. `around`: a region that contains x.
PlaceSupport support_of(const Vec3& x, const SupportNodes& node_set, std::span<const int> near,
                        NodesAround& around, const std::function<bool(int)>& connected = {});
/// Overload for a single place.
PlaceSupport support_of(const Vec3& x, const SupportNodes& node_set, std::span<const int> near,
                        const std::function<bool(int)>& connected = {});

/// Nodes near each place, ascending.
struct NodesNear {
  std::vector<std::size_t> offset;
  std::vector<int> node;
  std::span<const int> of(Index place) const {
    const auto k = static_cast<std::size_t>(place);
    return {node.data() + offset[k], offset[k + 1] - offset[k]};
  }
};

/// For each place the nodes whose radius comes within `margin` of it, except those that `connected`(node,
/// place) excludes, if given. The search is by nodes: in graded nodes, a place would have to search within
/// the largest radius of all.
NodesNear nodes_near(const Points& places, const SupportNodes& node_set, const Eigen::VectorXd& margin,
                     const Connected& connected = {});

/// Least number of nodes of a place: twice the terms of the linear basis.
constexpr std::size_t enough_nodes = 8;

/// True if mls_of_eight() had enough nodes and a well-conditioned moment matrix for this place.
bool surely_good(const MlsOfEight& eight, std::size_t place);

}  // namespace dimple
