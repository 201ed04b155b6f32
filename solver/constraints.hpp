#pragma once

#include "solver/internal_force.hpp"

namespace dimple {

/// How the tool holds the tissue under it.
enum class Contact {
  bonded,       ///< the circle's nodes move with the tool: all three components prescribed
  frictionless  ///< only along the push; the nodes slide sideways freely under the flat end
};

/// What each node may do.
struct Constraints {
  enum class Kind : std::int8_t { free, fixed, driven, sliding };
  std::vector<Kind> kind;  ///< [N]
  Eigen::Vector4d push;    ///< unit vector of the driven and sliding nodes, padded

  /// The part of a node's velocity, force or mode that is not prescribed.
  Eigen::Vector4d project(Index a, const Eigen::Vector4d& v) const {
    switch (kind[static_cast<std::size_t>(a)]) {
      case Kind::free:
        return v;
      case Kind::sliding:
        return v - push * v.dot(push);
      default:
        return Eigen::Vector4d::Zero();
    }
  }
  /// Puts what is prescribed where the tool is at this depth [m].
  void prescribe(ForceSystem::Nodal& u, double depth) const {
    for (Index a = 0; a < u.cols(); ++a) {
      const Kind its = kind[static_cast<std::size_t>(a)];
      if (its == Kind::fixed) u.col(a).setZero();
      if (its == Kind::driven) u.col(a) = push * depth;
      if (its == Kind::sliding) u.col(a) += push * (depth - u.col(a).dot(push));
    }
  }
};

Constraints make_constraints(const Model& model, Contact contact);

}  // namespace dimple
