#pragma once

#include <algorithm>
#include <optional>
#include <string>

#include "preprocess/supports/contact_surface.hpp"
#include "solver/terms/contact_term.hpp"
#include "solver/terms/rigid_motion.hpp"
#include "solver/terms/tool_force.hpp"
#include "solver/terms/tool_shape.hpp"

namespace dimple {

/// Rigid contact of a tool, without friction or with Coulomb's; or of a wall, which does not rotate.
struct RigidBody {
  ToolShape shape = sphere_shape(5e-3);
  ToolPose pose;  ///< at first contact: depth 0
  ContactSurface surface;
  double friction = 0.0;  ///< Coulomb's coefficient; infinite: no slip, as with 100
  /// Motion of a wall or further tool, per metre of the measured tool's path; zero for a fixed wall. Empty:
  /// this is the measured tool.
  std::optional<Vec3> motion = {};
  std::string name = {};
  bool is_tool = false;  ///< with a name: a further tool; otherwise a wall
  /// [M], [K] m: distance by which its surface is set back at each sample, and at each piece between; empty:
  /// none.
  Eigen::VectorXd gap_offset = {}, gap_offset_between = {};
};

/// The nearest vector to `force` that is no longer than `bound`.
inline Vec3 brought_within(double bound, const Vec3& force) {
  const double size = force.norm();
  return size > bound ? Vec3(force * (bound / size)) : force;
}

/// [M] m, for a fixed wall at rest: mean distance to the pieces of each sample, less that to the sample's
/// place. The place is the mean of the pieces and is beneath a round surface: a body in a shell would seem to
/// have room all around. Zero for samples without pieces, and for objects that move.
Eigen::VectorXd roundness(const RigidBody& body);

/// Pose at first contact: the tool on the axis of `at`, moved along its press direction to the surface.
ToolPose first_contact(const ToolShape& shape, const ToolPlace& at, const ContactSurface& surface);
/// Pose at first contact with the surface deformed by u [4xN] m; the axis moves with the surface point below
/// it.
ToolPose first_contact(const RigidBody& body, const Nodal& u);

/// Contact forces of such a tool on the body: one at each sample of the surface, along the normal of the
/// nearest tool surface. The gap is the signed distance from the tool to the sample's place X_s + sum_a
/// phi_a(X_s) u_a.
///
/// With friction a sample also has a force t_s in the tangent plane of the tool's surface. Its slip is its
/// motion along the tool, which may rotate, since the last accepted state, and
///
///     |t_s| <= friction lambda_s;   slip_s = 0 where it is less, opposite to t_s where it is not.
/// A new contact slips from its place of contact, predicted from the motion of the last step. In the first
/// step, which a march keeps short, all samples slide freely along a tool; along a wall they slip from their
/// nearest points at rest. Friction dissipates energy, see dissipation().
class RigidContact : public ContactTerm {
 public:
  explicit RigidContact(RigidBody body);

  Index count() const override { return body_.surface.count(); }
  const Interpolation& moves() const override { return body_.surface.at_place; }
  bool is_measured() const { return !body_.motion; }
  double error_at(Index s, const Instant& now) const override {
    if (!is_measured()) return wall_error * body_.surface.spacing[s];
    return contact_error *
           std::min(now.depth > 0.0 ? now.depth : travel_, body_.shape.radius);  // it may be held
  }
  const RigidBody& body() const { return body_; }
  /// Pose after a path of `depth` [m] of the present motion.
  ToolPose pose_at(double depth) const;
  /// Continues with the motion `displacement`, which begins after a path of `travel` [m].
  void begin_motion(const RigidMotion& motion, double travel);

  /// Keeps the tool apart from the body while the preload is applied.
  void set_separated(bool apart) { separated_ = apart; }

  bool has_friction() const { return body_.friction > 0.0; }
  /// Number of unknowns: a normal force for each sample, then with friction all t_s.
  Index unknowns() const override { return (has_friction() ? 4 : 1) * count(); }

  void set_forces(const Eigen::VectorXd& unknowns) override;
  /// [3xM] N t_s, in the tangent planes and within the cones; no columns without friction.
  const Points& friction_forces() const { return friction_; }
  /// Largest friction [N] of a sample with that normal force [N].
  double bound(Index s, double normal_force) const;
  void project_to_admissible(Eigen::Ref<Eigen::VectorXd> unknowns) const override;

  /// [3xM] tangential slip of the samples at the last add_force(); no columns without friction.
  const Points& slips() const { return slip_; }
  /// True if the sample slips against friction at the last add_force(): it is at its bound, or has left its
  /// anchor.
  bool slides(Index s) const;

  /// [3xM] m: places of the samples at the last add_force().
  const Points& places() const { return place_; }
  const Vec3& motion() const { return motion_.motion; }

  void add_force(const Nodal& u, const Instant& now, Nodal& f) override;
  /// Ends a step with the contact of the last add_force(); samples in contact slip from there.
  void accept(const Nodal& u, const Instant& now) override;
  std::vector<double> past() const override;
  void restore_past(const std::vector<double>& past) override;
  /// Frictional dissipation from the last accepted state to the last add_force() [J]; 0 if that state is
  /// accepted.
  double dissipation() const;
  /// Restarts the sum of the frictional dissipation.
  void reset_dissipation() { dissipated_ = 0.0; }

  /// Component of the forces on the body at the last add_force() [N].
  double along(const Vec3& approach) const;
  /// Force that does work on the path at the last add_force(), per metre of it [N].
  double force_along_motion(const Instant& now) const;
  /// On the tool, about its tip.
  Wrench on_tool(const Instant& now) const;

  /// At the last add_force(): force on the tool [N], and its moment about the tip [N m]; frictional
  /// dissipation so far [J]; contact area at rest and its no-slip part [m^2]; largest of pressures() [Pa];
  /// samples in contact; and largest penetration at samples [m].
  struct ContactSummary {
    Vec3 force = Vec3::Zero(), moment = Vec3::Zero();
    double area = 0.0, no_slip = 0.0, pressure = 0.0;
    Index samples = 0;
    double penetration = 0.0, dissipation = 0.0;
  };
  ContactSummary contact_summary() const;
  /// [M] Pa at rest, at the last add_force(): mean around each sample, by a hat of two node spacings to each
  /// side. Forces of single samples scatter with their areas, down to zero between others in contact; their
  /// sums do not. The edge of the contact is smeared by as much.
  Eigen::VectorXd pressures() const;
  /// [3xM] N on the body, at the last add_force().
  Points forces_on_body() const;
  /// [M] m, at the last add_force(): path that each sample in contact has slid along the tool since first
  /// contact, apart from that before a scene's first accepted state; empty without friction.
  Eigen::VectorXd slid_along() const;
  /// State of one sample at the last add_force().
  enum class Contact { none, slides, no_slip };
  Contact contact(Index s) const;

  /// Largest penetration of the surface into the tool, between samples too [m]; and that of parts of the
  /// surface without samples.
  struct Audit {
    double penetration = 0.0;
    double beyond = 0.0;  ///< [m] into the tool, of those parts
    Index beyond_at = -1;
  };
  Audit audit(const Nodal& u, const Instant& now) const;
  /// True if the tool at `now` does not penetrate the surface anywhere, deformed by u.
  bool is_separated(const Nodal& u, const Instant& now) const;

 private:
  RigidBody body_;
  Points place_;
  Vec3 tip_ = Vec3::Zero();
  RigidMotion motion_;
  bool separated_ = false;
  bool is_accepted_ = false;  // the last add_force() has ended a step
  double travel_ = 0.0;
  // With friction only. Places from the tip in the tool's own frame, which are the world's axes at the
  // beginning: anchors of the slip; places at the last two accepted states; slips at the last.
  // `was_in_contact_`: in contact at the last.
  Points friction_, slip_, anchor_, last_, before_last_, slid_;
  Mat3 turned_ = Mat3::Identity();  // at the last add_force()
  std::vector<char> was_in_contact_;
  double dissipated_ = 0.0;                         // [J] at the last accepted state
  double last_travel_ = 0.0, travel_before_ = 0.0;  // path lengths at those two states, see travel()
  double predicted_for_ = -1.0;                     // path length for which anchors were predicted

  Eigen::VectorXd roundness_;
  Eigen::VectorXd slid_along_;
  Eigen::VectorXd force_before_;  // [N] of the last accepted state
  Eigen::VectorXd held_within_;   // [m] slip within which friction holds a sample

  double gap_offset(Index s) const {
    return roundness_[s] + (body_.gap_offset.size() > 0 ? body_.gap_offset[s] : 0.0);
  }
  Wrench on_tool_about(const Vec3& tip) const;
  double travel(const Instant& now) const;
  bool friction_is_active() const { return last_travel_ > travel_before_; }
  void predict_contact(double travel);
};

}  // namespace dimple
