#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "preprocess/model.hpp"

namespace dimple {

/// Vectors of nodes, padded with a zero for the hot loops: [4xN].
using Nodal = Eigen::Matrix4Xd;

/// How the tool holds the tissue under it.
enum class Contact {
  bonded,       ///< the circle's nodes move with the tool: all three components prescribed
  frictionless  ///< only along the push; the nodes slide sideways freely under the flat end
};

/// Nodes whose motion is prescribed: the fixed base, the tool's circle, a patch that a retractor holds.
struct HeldSet {
  enum class Hold {
    all,    ///< all three components
    along,  ///< the one along `direction`; across it the nodes slide freely
    across  ///< the two across `direction`, and they stay where they are; along it the nodes slide freely
  };
  std::string name;
  std::vector<Index> node;
  Hold hold = Hold::all;
  Vec3 direction = Vec3::Zero();  ///< unit vector of the motion, and of the component that is held
  double share = 0.0;             ///< the set moves along it by this share of the tool's depth; 0: not at all
};

/// The names of the sets that are the tool's circle and the fixed base; no further set has one of them.
inline constexpr const char* tool_set = "";
inline constexpr const char* base_set = "base";

/// How far the fastest of the tool and of these comes for one of the tool's way.
double longest_share(const std::vector<HeldSet>& sets);

/// All prescribed motion of a run. Every marcher asks this and nothing else: a further set needs no change in
/// any of them.
class Constraints {
 public:
  Constraints() = default;
  /// Needs: nodes below `node_count`. Of a node in several sets the last one counts.
  Constraints(Index node_count, std::vector<HeldSet> sets);

  bool is_free(Index a) const { return of_node_[static_cast<std::size_t>(a)] < 0; }
  bool is_held_wholly(Index a) const { return !is_free(a) && held(a).hold == HeldSet::Hold::all; }
  bool slides(Index a) const { return !is_free(a) && held(a).hold != HeldSet::Hold::all; }

  /// The part of a node's velocity, force or mode that is not prescribed.
  Eigen::Vector4d project(Index a, const Eigen::Vector4d& v) const {
    if (is_free(a)) return v;
    const Held& its = held(a);
    if (its.hold == HeldSet::Hold::all) return Eigen::Vector4d::Zero();
    const Eigen::Vector4d along = its.direction * v.dot(its.direction);
    return its.hold == HeldSet::Hold::along ? Eigen::Vector4d(v - along) : along;
  }

  /// Puts what is prescribed of node a where it is when the tool has come to `depth` [m], and to the speed
  /// that it has when the tool moves at `rate` [m/s].
  template <class Column>
  void place(Index a, Column&& u, double depth) const {
    put(a, u, depth);
    if (start_.cols() > 0 && !is_free(a)) u += start_.col(a) - project(a, start_.col(a));
  }
  template <class Column>
  void speed(Index a, Column&& v, double rate) const {
    put(a, v, rate);
  }
  /// The same of all nodes.
  void prescribe(Nodal& u, double depth) const;
  /// From now on the ways of all sets begin at u [4xN] m, not at rest.
  void start_at(const Nodal& u) { start_ = u; }
  /// Puts what is held of all nodes where `wanted` has it [4xN] m.
  void take_held(Nodal& u, const Nodal& wanted) const;

  /// What the sets that move with the tool feel along their motion [N]: the force that does work on the
  /// depth.
  double working_force(const Nodal& f) const;
  /// Brings the moving nodes to speed at once, and returns the work that it takes [J].
  double set_off(Nodal& v, double rate, const Eigen::VectorXd& mass) const;

  /// How far a set comes for each of the tool's way; zero where there is none of that name, or it stands
  /// still.
  Vec3 motion(std::string_view name) const;

  /// Along which sets are held that slide across it: no two of them closer than 45 degrees.
  std::vector<Eigen::Vector4d> sliding_directions() const;
  /// Whether a node is free to move along a unit vector, rather than held.
  bool moves_along(Index a, const Eigen::Vector4d& direction) const {
    return project(a, direction).squaredNorm() > 0.5;
  }
  /// Whether the body may move as a whole in some direction: nothing is held there.
  bool let_drift() const;
  Index node_count() const { return static_cast<Index>(of_node_.size()); }
  const std::vector<HeldSet>& sets() const { return set_; }

 private:
  struct Held {
    Eigen::Vector4d direction;
    double share;
    HeldSet::Hold hold;
  };
  std::vector<HeldSet> set_;
  std::vector<Held> held_;
  std::vector<std::int16_t> of_node_;  // [N] number of its set, or -1
  Nodal start_;                        // no columns: at rest

  const Held& held(Index a) const {
    return held_[static_cast<std::size_t>(of_node_[static_cast<std::size_t>(a)])];
  }
  template <class Column>
  void put(Index a, Column&& value, double of_tool) const {
    if (is_free(a)) return;
    const Held& its = held(a);
    const double way = its.share * of_tool;
    if (its.hold == HeldSet::Hold::all)
      value = its.direction * way;
    else if (its.hold == HeldSet::Hold::along)
      value += its.direction * (way - value.dot(its.direction));
    else
      value = (its.direction * value.dot(its.direction)).eval();
  }
};

/// The tool's circle, moved with the tool, the base, which is fixed, and `further` sets.
Constraints make_constraints(const Model& model, Contact contact, std::vector<HeldSet> further = {});

/// With a zero below.
inline Eigen::Vector4d padded(const Vec3& v) {
  return {v.x(), v.y(), v.z(), 0.0};
}

}  // namespace dimple
