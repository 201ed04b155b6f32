#pragma once

#include <memory>
#include <vector>

#include "solver/constraints.hpp"
#include "solver/terms/internal_force.hpp"
#include "solver/terms/loads.hpp"
#include "solver/terms/rigid_contact.hpp"
#include "solver/terms/tool_force.hpp"

namespace dimple {

struct SessionOptions {
  Contact contact = Contact::bonded;
  Precision precision = Precision::single_;
  double tolerance = 1e-4;            ///< of an equilibrium: relative residual
  std::int64_t steps = 20000;         ///< of one step(), at most: bounds its time
  std::vector<HeldSet> further = {};  ///< other than the bonded patch and the base
  Loads loads = {};                   ///< act before first contact and afterwards
  /// Contacting tool on elastic tissue without friction, in place of the bonded patch and without loads.
  std::shared_ptr<const RigidBody> indenter = {};
};

/// Limit of one frame: a time, or force evaluations for the same bits on every machine.
struct FrameLimit {
  double seconds = 0.04;         ///< counts where `evaluations` is 0
  std::int64_t evaluations = 0;  ///< at most; then no clock is read
};

/// Position of an advanced tool and the force on it.
struct LiveFrame {
  enum class Tool {
    there,    ///< at the requested depth
    lags,     ///< the limit did not suffice: the next frames continue
    stopped,  ///< no deeper equilibrium is found: it stays at the deepest one
    /// The force is that of a pose near the requested one. The session does not report it, since its tool has
    /// one axis; callers that move the tool freely do (move_tip()).
    elsewhere,
    beyond  ///< requested deeper than the body, or than a contacting tool is long
  };
  double requested = 0.0, depth = 0.0;  ///< requested, and of the tool [m]
  double force = 0.0;  ///< on the tool along the press direction [N], corrected for unbalanced forces
  /// Wrench: its component against the press direction is `force`; the others are not corrected.
  Wrench on_tool = Wrench::Zero();
  /// `on_tool` over `force`; without a force that of the least deep known state. Zero: there is none.
  Wrench per_force = Wrench::Zero();
  /// Error estimate of `force` for the requested pose [N]; infinite if there is none: `stopped`, `beyond`, or
  /// far behind.
  double error = 0.0;
  /// Error estimate at `depth` [N]: it held in 99.8 % of the frames on a phantom and a heart with 8
  /// evaluations a frame or more, in 95 % with 2 (tests/bench/README.md).
  double error_at_depth = 0.0;
  double stiffness = 0.0;  ///< d force / d depth [N/m]
  double residual = 0.0;   ///< relative, as SessionOptions::tolerance
  /// Penetration of the body's surface into a contacting tool, between samples [m].
  double penetration = 0.0;
  std::int64_t evaluations = 0;
  Tool tool = Tool::there;
};

/// Largest difference of the force between a frame and a pose `apart` [m] from it [N], along the press
/// direction (negative: less deep) or across. Deeper or across by x at the depth d: at most F ((1 + x/d)^2 -
/// 1), for forces that grow by no more than the square of the depth, on slopes up to 45 degrees; infinite
/// beyond the depth. Less deep: at most 2 x/d of F.
double force_apart(const LiveFrame& frame, double apart);

/// Body under a tool that moves step by step, for interactive use. All of it is in memory; the model is its
/// own. Depth counts from first contact. SI units, positions LPS in metres.
///
///     Session session(std::move(built.model), {neo_hookean(210.0, 0.499, 1000.0)});
///     session.equilibrate(1e-3);
///     double newtons = session.force();
class Session {
 public:
  /// `materials`: of each tissue of the model, by its number. Throws SolveError: `indenter` does not fit
  /// the model, or MixedIteration does not serve the scheme or a material under such a tool.
  Session(Model model, std::vector<Material> materials, const SessionOptions& options = {});
  ~Session();
  Session(Session&&) noexcept;
  Session& operator=(Session&&) noexcept;

  /// Moves the tool along its press direction to `depth` [m] from first contact and finds the equilibrium
  /// there, in several moves if it is far. `dt` [s]: duration, for viscoelastic tissue. Returns the force
  /// evaluations. Throws SolveError: no equilibrium is found; the body is then unchanged.
  std::int64_t equilibrate(double depth, double dt = 0.0);

  /// Moves the tool towards `depth` [m] and advances the body within the limit; if that does not suffice the
  /// tool lags, and the next frames continue. States far from equilibrium, folded over or beyond the tool are
  /// not shown; the last good one stays. At depth <= 0 the body is at rest. Viscoelastic tissue bonded to a
  /// tool at depth 0 is held there; lifting it (depth < 0) clears the history. `dt` [s]: since the last
  /// frame, for such tissue. A tool without progress for 300 force evaluations or 100 frames reports
  /// `stopped` until it is moved back.
  ///
  /// The force is that on the tool plus w.r + m.s, with r, s the forces and volumes left unbalanced and w, m
  /// the derivatives of displacements and pressures by the depth: its error is of second order in theirs.
  ///
  /// Source:   Becker, Rannacher, Acta Numerica 10, 2001 (dual weighted residuals), the dual solution
  ///           by differences of equilibria along the tool's path, equal by symmetry.
  /// The first frame of a contacting tool takes up to 240 further evaluations, to find first contact.
  /// Throws SolveError: a scheme that MixedIteration does not serve; Stopped.
  LiveFrame follow(double depth, const FrameLimit& limit, double dt = 0.0);

  /// Lifts the tool: the body is as before first contact; its known states are kept.
  void lift();

  /// Moves the tool to `depth` [m] at constant speed within `dt` [s], with inertia, by central differences.
  /// Returns their number. Throws SolveError: more than SessionOptions::steps, values that are not finite, or
  /// an inverted point, and the body is then unchanged; or a contacting tool.
  std::int64_t step(double depth, double dt);

  /// Continues from the state of `before` after its body was cut (cut_by_sheet()). The tool stays, the nodes
  /// are at u [3xN] m, first those of `before`; pressures go to the parts of their patches, `of_patch`
  /// [patches]. This state is shown until a frame finds an equilibrium of the cut body: the tool lags, and
  /// its error is the force itself. Throws SolveError: viscoelastic tissue, and this session is then
  /// unchanged; std::invalid_argument: other numbers of nodes or patches.
  void continue_from(const Session& before, const Points& u, const std::vector<Index>& of_patch);

  double depth() const;       ///< of the tool [m]
  double force() const;       ///< on the tool along the press direction [N], positive when the tissue resists
  double base_force() const;  ///< on the base along the press direction [N]
  Wrench on_tool() const;     ///< force on the tool and its moment
  /// 3 x N, metres: u_a, of which the displacement at X is sum_a phi_a(X) u_a (node_interpolation() gives
  /// that at the nodes themselves).
  Points nodal_parameters() const;
  /// 3 x N, newtons: internal force at each node; on held nodes the reaction.
  Points forces() const;
  const Model& model() const;
  /// Reference of the depth: the centre of the bonded patch, or the tip of a contacting tool at first
  /// contact; and its radius.
  ToolPlace tool() const;
  const RigidBody* indenter() const;  ///< null: bonded patch

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace dimple
