#pragma once

#include <cstddef>

#include "io/types.hpp"

namespace dimple {

/// Numbers of the mixed iteration that were chosen, each with its evidence. Those of Anderson, BestState,
/// Multigrid, contact_step() and friction_step() are in their own files.
struct MixedConstants {
  /// Ratio of A to the Laplacian of the shear modulus at rest; the tangent at rest is at most twice that one.
  /// 3 to 5 take as many evaluations; 2, which overshoots, takes twice as many.
  double laplacian_stiffness = 4.0;
  /// Fraction of a node's weight that is added to A's diagonal; a piece that nothing holds is not singular.
  /// Not studied.
  double diagonal_of_held = 1e-6;
  /// Fraction of a node's weight on A's diagonal for a body with a rigid-body mode. 1e-3 to 1e-2 take as many
  /// evaluations; 1e-6 moved a body by 100 m in the first iteration, which single precision could not undo.
  double diagonal_of_loose = 1e-3;
  /// Largest distance of neighbours in A, in mean node spacings: some 14 neighbours. Not studied.
  double neighbour_distance = 1.6;
  /// Least number of neighbours of a node, however far away they are. Not studied.
  std::size_t fewest_neighbours = 6;
  /// Largest ratio of the law's stiffness at a state to that at rest, for an A of large strains.
  /// Single points have 1e5; 300 takes as many evaluations as 30.
  double largest_stiffening = 30.0;
  /// Increment of F for the law's stiffness by differences. Not studied.
  double difference_of_F = 1e-5;
  /// Largest strain between neighbours in one iteration; longer steps pass through the law's barriers. The
  /// value is not studied.
  double longest_step = 0.3;
  /// Largest number of contact points, a bound on memory: their compliance and the matrix of a contact step
  /// have 1.2 GB each.
  Index most_contact_points = 12000;
  /// Relative growth of the compliance's diagonal; in single precision A^-1 need not be positive definite.
  /// Not studied.
  double compliance_margin = 1e-4;
  /// Reactions below this fraction of the forces that contact lacks count as none. Not studied.
  double negligible_reactions = 1e-9;
  /// The default tolerance of the residual, for which contact_error was chosen.
  double usual_tolerance = 1e-4;
  /// Rows below which a sparse factor takes 0.1 s and needs no thread of its own; time grows as their square.
  Index quickly_factorised = 3000;
  /// Rows above which S is left to conjugate gradients. With 100,000 nodes the factors took three times as
  /// long as the rest of the solution; the evaluations are as many.
  Index worth_factorising = 12000;
  /// Relative residual of these conjugate gradients, and their largest number. With 100,000 nodes they take
  /// as many evaluations as the factors; the values are not studied.
  double schur_tolerance = 1e-6;
  int most_schur_iterations = 100;
};
inline constexpr MixedConstants mixed_constants{};

}  // namespace dimple
