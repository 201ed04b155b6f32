#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "preprocess/model.hpp"

namespace dimple {

/// Vectors of nodes, padded with a zero for the hot loops: [4xN].
using Nodal = Eigen::Matrix4Xd;

/// Hold of the tool on the tissue under it.
enum class Contact {
  bonded,       ///< the bonded patch moves with the tool: all three components prescribed
  frictionless  ///< only along the press direction; the nodes slide freely across it
};

/// Nodes whose motion is prescribed: the fixed base, the bonded patch, the patch of a retractor.
struct HeldSet {
  enum class Hold {
    all,    ///< all three components
    along,  ///< the one along `direction`; across it the nodes slide freely
    across  ///< the two across `direction`, fixed; along it the nodes slide freely
  };
  std::string name;
  std::vector<Index> node;
  Hold hold = Hold::all;
  Vec3 direction = Vec3::Zero();  ///< unit vector of the motion, and of the component that is held
  double fraction = 0.0;          ///< the set moves along it by this fraction of the tool's depth; 0: fixed
};

/// Names of the sets of the bonded patch and of the fixed base; further sets have other names.
inline constexpr const char* tool_set = "";
inline constexpr const char* base_set = "base";

/// Largest motion of the tool and of these sets, per metre of the tool's path.
double max_displacement_ratio(const std::vector<HeldSet>& sets);

/// All prescribed motion of a run. Every march uses it alone: a further set needs no change in any of them.
class Constraints {
 public:
  Constraints() = default;
  /// Needs: nodes below `node_count`. The last set of a node counts.
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

  /// Sets the held components of node a to their position at the tool's `depth` [m], or to their velocity at
  /// the tool's `rate` [m/s].
  template <class Column>
  void place(Index a, Column&& u, double depth) const {
    put(a, u, depth);
    if (start_.cols() > 0 && !is_free(a)) u += start_.col(a) - project(a, start_.col(a));
  }
  template <class Column>
  void speed(Index a, Column&& v, double rate) const {
    put(a, v, rate);
  }
  /// Prescribes the position of all held nodes, as place().
  void prescribe(Nodal& u, double depth) const;
  /// Makes the motions of all sets begin at u [4xN] m instead of at rest.
  void start_at(const Nodal& u) { start_ = u; }
  /// Sets the held components of all nodes to those of `requested` [4xN] m.
  void apply_dirichlet(Nodal& u, const Nodal& requested) const;

  /// Force on the sets that move with the tool, along their motion [N]; it does work on the depth.
  double force_along_motion(const Nodal& f) const;
  /// Applies the initial velocity of the moving sets, and returns its work [J].
  double apply_initial_velocity(Nodal& v, double rate, const Eigen::VectorXd& mass) const;

  /// Motion of a set per metre of the tool's path; zero if it is fixed or there is none of that name.
  Vec3 motion(std::string_view name) const;

  /// Directions along which sliding sets are held; no two of them closer than 45 degrees.
  std::vector<Eigen::Vector4d> sliding_directions() const;
  /// True if a node may move along a unit vector.
  bool moves_along(Index a, const Eigen::Vector4d& direction) const {
    return project(a, direction).squaredNorm() > 0.5;
  }
  /// True if the body has a translational rigid-body mode: nothing is held in some direction.
  bool has_rigid_body_modes() const;
  Index node_count() const { return static_cast<Index>(of_node_.size()); }
  const std::vector<HeldSet>& sets() const { return set_; }

 private:
  struct Held {
    Eigen::Vector4d direction;
    double fraction;
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
    const double distance = its.fraction * of_tool;
    if (its.hold == HeldSet::Hold::all)
      value = its.direction * distance;
    else if (its.hold == HeldSet::Hold::along)
      value += its.direction * (distance - value.dot(its.direction));
    else
      value = (its.direction * value.dot(its.direction)).eval();
  }
};

/// The bonded patch, which moves with the tool, the fixed base, and `further` sets.
Constraints make_constraints(const Model& model, Contact contact, std::vector<HeldSet> further = {});

/// Vector padded with a zero.
inline Eigen::Vector4d padded(const Vec3& v) {
  return {v.x(), v.y(), v.z(), 0.0};
}

}  // namespace dimple
