#pragma once

#include "preprocess/supports/contact_surface.hpp"
#include "solver/terms/force_term.hpp"
#include "solver/terms/tool_force.hpp"
#include "solver/terms/tool_shape.hpp"

namespace dimple {

/// A rigid tool that is pushed straight into a body and touches it without friction.
struct Touch {
  ToolShape shape;
  ToolPose pose;  ///< where it first touches: at depth 0
  ContactSurface surface;
};

/// The tool on the axis of `at`, moved along its push to where it first touches the surface.
ToolPose first_touch(const ToolShape& shape, const Indenter& at, const ContactSurface& surface);

/// The contact forces of such a tool on the body: one at each sample of the surface, along the normal of the
/// tool's surface next to it, spread to the nodes by the shape functions at the sample. The forces are
/// unknowns beside the displacements, and no penalty:
///
///     lambda_s >= 0,   d_s(u) >= 0,   lambda_s d_s(u) = 0    at every sample s,
///
/// d_s the signed distance from the tool to the sample's place X_s + sum_a phi_a(X_s) u_a. Whoever looks for
/// equilibrium sets them, see MixedIteration. Their energy is nothing: they do work with the tool alone.
///
/// Source:   Wriggers, Computational Contact Mechanics, 2006, chapters 4 and 5 (node to rigid surface,
/// Lagrange multipliers).
class TouchingTool : public ForceTerm {
 public:
  explicit TouchingTool(Touch touch) : touch_(std::move(touch)) { force_.setZero(count()); }

  Index count() const { return touch_.surface.count(); }  ///< samples
  const Touch& touch() const { return touch_; }
  ToolPose pose_at(double depth) const;

  /// [M] N from now on.
  void set_forces(const Eigen::VectorXd& force) { force_ = force; }
  const Eigen::VectorXd& forces() const { return force_; }

  /// Of the last add_force(): [M] d_s, [3xM] the tool's normals, [3xM] where the samples were.
  const Eigen::VectorXd& gaps() const { return gap_; }
  const Points& normals() const { return normal_; }
  const Points& places() const { return place_; }

  void add_force(const Nodal& u, const Instant& now, Nodal& f) override;
  double energy(const Nodal&, const Instant&) override { return 0.0; }

  /// Adds such forces [M] N on the body to f [4xN] N, as of what resists, along the normals of the last
  /// add_force().
  void spread(const Eigen::VectorXd& force, Nodal& f) const;

  /// On the body, of the last add_force() [N].
  double along(const Vec3& push) const { return (normal_ * force_).dot(push); }
  /// On the tool, about its tip.
  Wrench on_tool(const Instant& now) const;

  /// How far the body's surface reaches into the tool anywhere between the samples [m]; and where the tool
  /// has come to parts of the surface that have no samples.
  struct Audit {
    double penetration = 0.0;
    double beyond = 0.0;  ///< [m] into the tool, of those parts
    Index beyond_at = -1;
  };
  Audit audit(const Nodal& u, const Instant& now) const;

 private:
  Touch touch_;
  Eigen::VectorXd force_, gap_;
  Points normal_, place_;
};

}  // namespace dimple
