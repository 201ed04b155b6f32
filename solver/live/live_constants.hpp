#pragma once

#include <cstdint>

namespace dimple {

/// Numbers of Session and of the advance of its tool that were chosen, each with its evidence as far as there
/// is any. Lengths are in radii of the bonded patch or of the contacting tool.
struct LiveConstants {
  /// Longest move of the tool, or of a support that moves further, between two equilibria. Not studied.
  double longest_move = 0.1;
  /// Ratio of the time step of a move to the stable one at its beginning. Not studied.
  double safety = 0.8;

  // States that are kept, and states on the path to the requested depth.
  /// Distance of two known states. Not studied.
  double kept_apart = 0.04;
  /// Largest relative residual of a state that is shown. Not studied.
  double shown = 0.05;
  /// Largest relative residual of a state on the path to the requested depth. Not studied.
  double passed = 0.01;
  /// Fraction of `longest_move` below which no shorter move is tried: the tool has stopped. Not studied.
  double slowest = 1.0 / 32.0;
  /// Largest fraction of inverted points in a state that is shown. Not studied.
  double folded = 0.01;
  /// Largest displacement in a state that is shown, in depths of the tool. Not studied.
  double widest = 2.5;
  /// Largest distance of a depth from that of the last dJ/du, for which that one still serves. Not studied.
  double gradient_good = 0.1;
  /// Ratio of two residuals below which the search nears an equilibrium, and is continued in the next frame.
  /// Not studied.
  double nears = 0.7;

  // Contacting tools.
  /// Largest depth at which first contact is searched. Not studied.
  double deepest_first = 0.35;
  /// Evaluations for each of these depths: four depths are at most 240. Not studied.
  std::int64_t for_first = 60;
  /// Largest gap that contact may lack in a state that is shown, of the depth. Not studied.
  double open_contact = 0.02;
  /// Largest penetration of the surface into the tool between the contact points. Not studied.
  double deepest_in_tool = 0.05;
  /// Largest penetration of parts of the surface that have no contact points. Not studied.
  double beyond_samples = 1e-3;

  // Error of a frame's force. The first three were chosen before the study that counts how often the error
  // holds (tests/bench/README.md).
  /// Fraction of the correction of the force.
  double of_correction = 0.5;
  /// Fraction of the geometric mean of the energies left and of the tool.
  double of_energy = 0.1;
  /// Fraction of the force.
  double of_force = 1e-3;
  /// Value of `of_energy` under a contacting tool: with few evaluations the edge of its contact is not yet
  /// found. Chosen on a sphere pressed straight onto a cylinder, where 0.1 did not hold with 3 evaluations a
  /// frame.
  double of_energy_in_contact = 0.3;
  /// Largest ratio of the whole force to its component along the press direction, for the wrench over that
  /// component. Not studied.
  double steepest = 10.0;

  // Limits after which a tool without progress has stopped: several times what the slowest steps took.
  std::int64_t fruitless_evaluations = 300;
  std::int64_t fruitless_frames = 100;
};
inline constexpr LiveConstants live_constants{};

}  // namespace dimple
