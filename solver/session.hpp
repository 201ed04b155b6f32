#pragma once

#include <memory>
#include <vector>

#include "solver/constraints.hpp"
#include "solver/terms/internal_force.hpp"
#include "solver/terms/loads.hpp"
#include "solver/terms/tool_force.hpp"
#include "solver/terms/touching_tool.hpp"

namespace dimple {

struct SessionOptions {
  Contact contact = Contact::bonded;
  Precision precision = Precision::single_;
  double tolerance = 1e-4;            ///< of an equilibrium: relative residual
  std::int64_t steps = 20000;         ///< of one step(), at most: the bound of its time
  std::vector<HeldSet> further = {};  ///< beside the circle and the base
  Loads loads = {};                   ///< that act before the tool touches, and go on acting
  /// A tool that touches elastic tissue without friction, in place of the circle and without loads.
  std::shared_ptr<const Touch> touch = {};
};

/// What one frame may take: a time, or, for the same bits whatever the machine, evaluations of the force.
struct FrameLimit {
  double seconds = 0.04;         ///< counts where `evaluations` is 0
  std::int64_t evaluations = 0;  ///< at most; then no clock is read
};

/// Where a tool that is followed stands, and what it feels there.
struct LiveFrame {
  enum class Tool {
    there,    ///< where it was asked to be
    lags,     ///< the limit did not suffice: it is on its way, and the next frames go on
    stopped,  ///< no equilibrium is found any deeper: it stays at the deepest that is known
    /// The force is that of a pose beside the one asked for. The session does not say it: its tool has one
    /// axis; whoever moves the tool freely does (move_tip()).
    elsewhere,
    beyond  ///< it was asked to be deeper than the body reaches, or than a tool that touches is long
  };
  double asked = 0.0, depth = 0.0;  ///< where the tool was to be, and where it is [m]
  double force = 0.0;  ///< on the tool along the push [N], with what is left unbalanced accounted for
  /// All of it: its component against the push is `force`; across the push nothing is accounted for.
  Wrench on_tool = Wrench::Zero();
  /// `on_tool` over `force`; where there is none, as at the least depth that is known. Zero: none is known.
  Wrench per_force = Wrench::Zero();
  /// Estimate of how far `force` is from that of equilibrium at the pose that was asked for [N]; infinite
  /// where nothing is known of it: `stopped`, `beyond`, or far behind.
  double error = 0.0;
  /// The same at `depth` [N]: it held in 99.8 % of the frames on a phantom and a heart with 8 evaluations a
  /// frame or more, in 95 % with 2 (tests/bench/README.md).
  double error_at_depth = 0.0;
  double stiffness = 0.0;  ///< d force / d depth [N/m]
  double residual = 0.0;   ///< relative, as SessionOptions::tolerance
  /// How deep the body's surface reaches into a tool that touches, between the places of contact [m].
  double penetration = 0.0;
  std::int64_t evaluations = 0;
  Tool tool = Tool::there;
};

/// How far the force at a pose near that of a frame may be from the frame's own [N], which grew to it from
/// none over its depth: `apart` [m] from it along the push (negative: less deep) or across. Deeper or aside
/// by x of the depth d at most F ((1 + x/d)^2 - 1), which holds for forces that grow by no more than the
/// square of the depth, and on slopes up to 45 degrees; infinite beyond the depth. Less deep at most 2 x/d of
/// F.
double force_apart(const LiveFrame& frame, double apart);

/// A body under a tool that someone moves, step by step: for interactive use. All of it is in memory; the
/// model is its own. The tool stands where it touches the body at first. SI units, positions LPS in metres.
///
///     Session session(std::move(built.model), {neo_hookean(210.0, 0.499, 1000.0)});
///     session.equilibrate(1e-3);
///     double newtons = session.force();
class Session {
 public:
  /// `materials`: of each tissue of the model, by its number. Throws SolveError: what options.touch does not
  /// say, or a scheme or material that MixedIteration does not serve under such a tool.
  Session(Model model, std::vector<Material> materials, const SessionOptions& options = {});
  ~Session();
  Session(Session&&) noexcept;
  Session& operator=(Session&&) noexcept;

  /// Moves the tool along its push to `depth` [m] from where it first touched, or back, and lets the body
  /// come to rest there; way by way where it is far. `dt` [s]: how long the move takes, for viscoelastic
  /// tissue. Returns the evaluations of the force that it took. Throws SolveError: there is no equilibrium to
  /// be found; the body is then as it was.
  std::int64_t equilibrate(double depth, double dt = 0.0);

  /// Moves the tool towards `depth` [m] and follows the body for as long as the limit allows: the tool
  /// lags where that does not suffice, and every later frame goes on from there. No state is shown that is
  /// far from equilibrium, has folded over or lies beyond the tool; in its place the last good one stays.
  /// Lifted (depth <= 0) the body is at rest. Tissue that relaxes draws a circle that came back to depth 0
  /// in, until it is lifted (depth < 0), which it forgets all by. `dt` [s]: since the last frame, for such
  /// tissue. A tool that has come no nearer for 300 evaluations of the force or 100 frames says `stopped`
  /// until it is moved back.
  ///
  /// The force is that on the tool plus w.r + m.s, with r, s the forces and volumes left unbalanced and w, m
  /// the derivatives of displacements and pressures by the depth: its error is of second order in theirs.
  ///
  /// Source:   Becker, Rannacher, Acta Numerica 10, 2001 (dual weighted residuals), the dual solution
  ///           by differences of equilibria along the tool's way, which symmetry makes the same.
  /// The first frame of a tool that touches takes up to 240 evaluations more, to find what to begin with.
  /// Throws SolveError: a scheme that MixedIteration does not serve; Stopped.
  LiveFrame follow(double depth, const FrameLimit& limit, double dt = 0.0);

  /// Lifts the tool: the body is as it was before it was touched, its states on the way remain known.
  void lift();

  /// Moves the tool to `depth` [m] at an even speed within `dt` [s] and follows the body with its inertia, by
  /// central differences. Returns their number. Throws SolveError: they would be more than
  /// SessionOptions::steps, a number stopped being one, or an integration point was inverted, and the body is
  /// then as it was; or the tool is one that touches.
  std::int64_t step(double depth, double dt);

  /// Goes on from where `before` stands, after a blade has cut its body (cut_by_sheet()). The tool stays
  /// where it is, the nodes at u [3xN] m, the first of them as they are there; pressures go to the parts of
  /// their patches, `of_patch` [patches]. Until a frame finds an equilibrium of the cut body this state is
  /// shown: its tool lags, and its error is the force itself. Throws SolveError: the tissue relaxes, and this
  /// session is then as it was; std::invalid_argument: other numbers of nodes or patches.
  void go_on_from(const Session& before, const Points& u, const std::vector<Index>& of_patch);

  double depth() const;       ///< of the tool [m]
  double force() const;       ///< along the push on the tool [N], positive when the tissue resists
  double base_force() const;  ///< along the push on the base [N]
  Wrench on_tool() const;     ///< all of the force on the tool and its moment
  /// 3 x N, metres: u_a, of which the displacement at X is sum_a phi_a(X) u_a (node_interpolation() gives
  /// that at the nodes themselves).
  Points nodal_parameters() const;
  /// 3 x N, newtons: what the tissue resists with at each node; on held nodes the reaction.
  Points forces() const;
  const Model& model() const;
  /// Where depth is counted from: the circle's middle, or the tip of a tool that touches where it first does;
  /// and its radius.
  ToolPlace tool() const;
  const Touch* touch() const;  ///< null: the circle

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace dimple
