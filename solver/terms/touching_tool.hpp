#pragma once

#include <algorithm>
#include <optional>
#include <string>

#include "preprocess/supports/contact_surface.hpp"
#include "solver/terms/contact_term.hpp"
#include "solver/terms/rigid_way.hpp"
#include "solver/terms/tool_force.hpp"
#include "solver/terms/tool_shape.hpp"

namespace dimple {

/// A rigid tool that touches a body, without friction or with Coulomb's; or a wall, which does not turn.
struct Touch {
  ToolShape shape = sphere_shape(5e-3);
  ToolPose pose;  ///< where it first touches: at depth 0
  ContactSurface surface;
  double friction = 0.0;  ///< Coulomb's coefficient; infinite: what has touched sticks, as with 100
  /// Of what stands, a wall, or moves beside the tool that is measured: its way for each metre of that one's.
  /// Nothing: it is this tool.
  std::optional<Vec3> motion = {};
  std::string name = {};
  bool is_tool = false;  ///< of what has a name: a further tool, and no wall
  /// [M], [K] m: how far its surface is set back at each sample, and at each piece between; empty: not at
  /// all.
  Eigen::VectorXd set_back = {}, set_back_between = {};
};

/// The nearest to `force` that is no larger than `bound`.
inline Vec3 brought_within(double bound, const Vec3& force) {
  const double size = force.norm();
  return size > bound ? Vec3(force * (bound / size)) : force;
}

/// [M] m: from a wall that stands to the surface at rest, the mean over the pieces of each sample, less that
/// to the sample's place. That is the mean of the pieces' places and lies beneath a surface that is round: a
/// body in a shell would seem to have room left all around. Zero where samples do not know their pieces, and
/// of what moves, which does not stay where it was measured.
Eigen::VectorXd roundness(const Touch& touch);

/// The tool on the axis of `at`, moved along its push to where it first touches the surface.
ToolPose first_touch(const ToolShape& shape, const ToolPlace& at, const ContactSurface& surface);
/// The same on the surface as it lies at u [4xN] m: the axis has gone with what it stood over.
ToolPose first_touch(const Touch& touch, const Nodal& u);

/// The contact forces of such a tool on the body: one at each sample of the surface, along the normal of the
/// tool's surface next to it. The gap is the signed distance from the tool to the sample's place
/// X_s + sum_a phi_a(X_s) u_a. They do work with the tool alone.
///
/// With friction a sample has a force t_s in the tangent plane of the tool's surface besides. Its slip is how
/// far it has moved along the tool, which turns under it, since the last accepted state, and
///
///     |t_s| <= friction lambda_s;   slip_s = 0 where it is less, opposite to t_s where it is not.
/// A sample that comes to touch slips from where it would touch if it went on as in the step before; in the
/// first step, which a march keeps short, all slide freely along a tool, and along a wall from where it is
/// nearest to them at rest.
/// Friction takes energy, see heat().
class TouchingTool : public ContactTerm {
 public:
  explicit TouchingTool(Touch touch);

  Index count() const override { return touch_.surface.count(); }
  const Interpolation& moves() const override { return touch_.surface.at_place; }
  bool is_measured() const { return !touch_.motion; }
  double error_at(Index s, const Instant& now) const override {
    if (!is_measured()) return wall_error * touch_.surface.spacing[s];
    return contact_error *
           std::min(now.depth > 0.0 ? now.depth : gone_, touch_.shape.radius);  // it may be held
  }
  const Touch& touch() const { return touch_; }
  /// After `depth` [m] of the way that it goes now.
  ToolPose pose_at(double depth) const;
  /// From now on it goes so; it has gone `gone` [m] to where that begins.
  void go_on(const RigidWay& way, double gone);

  /// While loads come on that act before it does, it stands apart from the body.
  void stand_apart(bool apart) { apart_ = apart; }

  bool rubs() const { return touch_.friction > 0.0; }
  /// Of the search for equilibrium: a normal force for each sample, with friction t_s behind them all.
  Index unknowns() const override { return (rubs() ? 4 : 1) * count(); }

  void set_forces(const Eigen::VectorXd& unknowns) override;
  /// [3xM] N t_s, in the tangent planes and within the cones; no columns without friction.
  const Points& friction_forces() const { return friction_; }
  /// The largest friction [N] of a sample with that normal force [N].
  double bound(Index s, double normal_force) const;
  void bring_back(Eigen::Ref<Eigen::VectorXd> unknowns) const override;

  /// Of the last add_force(): [3xM] the slip of those that friction may hold, without friction no columns.
  const Points& slips() const { return slip_; }
  /// Whether it slips against friction, at the last add_force(): that is at its bound, or it is not where it
  /// was held.
  bool slides(Index s) const;

  /// [3xM] where the samples were then.
  const Points& places() const { return place_; }
  const Vec3& motion() const { return way_.motion; }

  void add_force(const Nodal& u, const Instant& now, Nodal& f) override;
  /// Those of the last add_force() end a step; where samples then touch is from where they slip.
  void accept(const Nodal& u, const Instant& now) override;
  std::vector<double> past() const override;
  void restore_past(const std::vector<double>& past) override;
  /// What friction has taken since the last accepted state, at the last add_force() [J]; nothing where that
  /// was accepted.
  double heat() const;
  /// What friction has taken so far counts from here.
  void count_heat_anew() { heat_so_far_ = 0.0; }

  /// On the body, of the last add_force() [N].
  double along(const Vec3& push) const;
  /// Likewise, what does work on its way, for each metre of that [N].
  double working_force(const Instant& now) const;
  /// On the tool, about its tip.
  Wrench on_tool(const Instant& now) const;

  /// At the last add_force(): the force on the tool [N], and its moment about the tip [N m]; what friction
  /// has taken so far [J]; the area that touches and what of it friction holds, both at rest [m^2]; the
  /// largest of pressures() [Pa]; the samples that touch; and how far the surface reaches into the tool, at
  /// samples [m].
  struct Touched {
    Vec3 force = Vec3::Zero(), moment = Vec3::Zero();
    double area = 0.0, sticks = 0.0, pressure = 0.0;
    Index samples = 0;
    double penetration = 0.0, heat = 0.0;
  };
  Touched touched() const;
  /// [M] Pa at rest, likewise: the mean around each sample, by a hat of two node spacings to each side.
  /// Single samples' forces scatter where their parts of the surface differ, up to nothing between others
  /// that touch; their sums do not. At the contact's border it is smeared by as much.
  Eigen::VectorXd pressures() const;
  /// [3xM] N on the body, likewise.
  Points forces_on_body() const;
  /// [M] m, likewise: of what touches, how far it has slid along the tool since it did, all its ways added
  /// but those before a scene's first accepted state; empty without friction, which alone knows.
  Eigen::VectorXd slid_along() const;
  /// Of a sample, likewise.
  enum class Contact { none, slides, sticks };
  Contact contact(Index s) const;

  /// How far the body's surface reaches into the tool anywhere between the samples [m]; and where the tool
  /// has come to parts of the surface that have no samples.
  struct Audit {
    double penetration = 0.0;
    double beyond = 0.0;  ///< [m] into the tool, of those parts
    Index beyond_at = -1;
  };
  Audit audit(const Nodal& u, const Instant& now) const;
  /// Whether it is then outside of the body, everywhere, as that lies at u.
  bool clears_body(const Nodal& u, const Instant& now) const;

 private:
  Touch touch_;
  Points place_;
  Vec3 tip_ = Vec3::Zero();
  RigidWay way_;
  bool apart_ = false;
  bool is_accepted_ = false;  // the last add_force() has ended a step
  double gone_ = 0.0;
  // With friction alone. Places from the tip in the tool's own frame, which are the world's axes as it began:
  // where samples slip from; where they were at the last two accepted states, which of them touched at the
  // last, and by how much they had slipped there.
  Points friction_, slip_, anchor_, last_, before_last_, slid_;
  Mat3 turned_ = Mat3::Identity();  // at the last add_force()
  std::vector<char> touched_;
  double heat_so_far_ = 0.0;                    // [J] at the last accepted state
  double last_gone_ = 0.0, gone_before_ = 0.0;  // all the way to those two states, see gone()
  double foreseen_for_ = -1.0;  // the way for which anchors of what has not touched were looked for

  Eigen::VectorXd roundness_;
  Eigen::VectorXd slid_along_;
  Eigen::VectorXd force_before_;  // [N] of the last accepted state
  Eigen::VectorXd held_within_;   // [m] of where it is held: what friction holds now

  double set_back(Index s) const {
    return roundness_[s] + (touch_.set_back.size() > 0 ? touch_.set_back[s] : 0.0);
  }
  Wrench on_tool_about(const Vec3& tip) const;
  double gone(const Instant& now) const;
  bool may_rub() const { return last_gone_ > gone_before_; }
  void foresee(double gone);
};

}  // namespace dimple
