#pragma once

#include <chrono>
#include <limits>
#include <optional>

#include "solver/equilibrium/relax.hpp"
#include "solver/live/known_states.hpp"
#include "solver/live/progress.hpp"
#include "solver/march/predictor.hpp"
#include "solver/session.hpp"

namespace dimple {

/// All of a Session: its body, its tool, and the progress of the tool. SI units. Moves to an equilibrium and
/// with inertia are in session.cpp, the advance within a frame in live/follow.cpp, and what a frame reports
/// in live/live_frame.cpp.
struct Session::Parts {
  /// Throws SolveError as Session does.
  Parts(Model m, std::vector<Material> materials, const SessionOptions& o);

  /// State of the tool, and of the body that is shown. One function per transition:
  ///
  ///     touching, cut -> air   lift(); of touching also to_equilibrium() at rest
  ///     air, cut -> touching   begin_contact(): an equilibrium is shown
  ///     air -> touching        move_freely(): with inertia
  ///     air -> cut             continue_from(): in the session of the cut body
  enum class State {
    air,         ///< the tool is lifted, the body is at rest
    in_contact,  ///< the tool is in the body, which is near an equilibrium or moves with its inertia
    cut          ///< state of the body before a cut: no equilibrium of the cut body yet
  };
  State state = State::air;

  /// State that is tried for the equilibrium at a depth.
  struct Attempt {
    double at = 0.0;        ///< depth [m]
    double residual = 0.0;  ///< that an earlier frame reached; 0: none
    Nodal u;                ///< [4xN] m
    Eigen::VectorXd lambda;
  };

  Model model;
  SessionOptions options;
  ForceSystem tissue;
  std::unique_ptr<System> system;
  Relaxation relax;
  Nodal u, v, f;           ///< [4xN] m, m/s, N: the state that is shown
  Eigen::VectorXd lambda;  ///< [patches, samples] as MixedIteration calls it
  bool moves_supports;     ///< may draw the tissue away from the tool
  ToolPlace tool;          ///< see Session::tool()
  double longest;          ///< longest move of the tool between two equilibria [m]
  double thick;            ///< of the body along the press direction, from first contact [m]
  double longest_tool = std::numeric_limits<double>::infinity();  ///< [m]
  Predictor path{2};                                              ///< the last equilibria
  double depth = 0.0;                                             ///< of the tool [m]

  // State of follow().
  using Clock = std::chrono::steady_clock;
  KnownStates known;
  MixedIteration::Residual left;   ///< at u
  double residual = 0.0;           ///< there
  double caution = 1.0;            ///< fraction of `longest` that is tried
  double gradient_at = -1.0;       ///< depth of dJ/du [m]; negative: none serves
  Clock::duration overhead{};      ///< time of a frame besides the iteration, mean of the last few
  std::optional<Attempt> pending;  ///< an equilibrium that is not good enough yet: the next frame refines it
  Progress progress;               ///< of the tool to where it is to be
  std::vector<double> unloaded_past;  ///< history of viscoelastic tissue before any contact
  double waited = 0.0;                ///< time not yet applied to such tissue [s]

  // Transitions of `state`.
  void lift();
  void begin_contact(double its_residual);
  void move_freely();
  void continue_from(const Parts& before, const Points& its, const std::vector<Index>& of_patch);

  // Moves, as those of Session.
  std::int64_t equilibrate(double to, double dt);
  std::int64_t step(double to, double dt);
  LiveFrame follow(double requested, const FrameLimit& limit, double dt);

  /// Force on the tool along its press direction at a state [N]; sets the contact to that state.
  double resistance(const Nodal& its, const Eigen::VectorXd& l, const Nodal& force, double at) const;
  /// Frame of the state that is shown, without its status and its error for the requested pose.
  LiveFrame frame_at_depth(double requested, std::int64_t evaluations) const;

 private:
  struct Call;
  void require_curve_of_equilibria() const;
  void nothing_left();
  void reset_to_undeformed();

  void predict(double to);
  std::int64_t to_equilibrium(double to);
  std::int64_t count_steps(double dt);
  void find_force();
  template <class Move>
  std::int64_t with_rollback(const Move& move);

  void guess(double to, Nodal& next, Eigen::VectorXd& l) const;
  double towards(double requested) const;
  bool resists(const Attempt& now, const Nodal& force, const MixedIteration::Residual& its) const;
  bool good(const Relaxed& found, const Nodal& its, double at) const;
  bool contact_is_good(const Attempt& now, const MixedIteration::Residual& its) const;
  bool is_good(const Attempt& now, const Relaxed& found, const Nodal& force,
               const MixedIteration::Residual& its) const;

  bool lacks_first_contact(const Call& call) const;
  std::int64_t find_first_contact();
  bool search(Call& call, bool reassemble, Relaxed& found);
  void advance(Call& call);
  void look_for_place(Call& call);
  void take(Call& call, double its_residual);
  void miss(Call& call, double its_residual);
  void restore(Call& call);
  void refine_later(Call& call, double its_residual);
  void shorten(Call& call);
  void report_arrival(LiveFrame& frame, const Call& call, bool arrived) const;

  double correction_at(double at, const MixedIteration::Residual& its) const;
  Wrench per_force(const LiveFrame& frame) const;
};

}  // namespace dimple
