#pragma once

#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// One result compared with a closed form, or with that of an independent code.
struct VerifyCase {
  std::string name;  ///< group/row: "hayes/a_h_0.2_nu_0.3"
  std::string what;
  double ours = 0.0, reference = 0.0;
  double error = 0.0;      ///< relative; for an order of convergence, the missing part
  double tolerance = 0.0;  ///< relative; set by the accuracy of the reference and by the scheme's claim
  std::string unit, source;
  bool passed = false;
};

/// A family of cases computed together.
struct VerifyGroup {
  std::string name, what;
};
std::vector<VerifyGroup> verify_groups();

/// Computes the groups whose names are in `filter` (empty: all), each with the converging scheme and its
/// standard supports. `nodes`: of the indented bodies; the lattices of the others are fixed. A group without
/// an equilibrium is one failed row. Throws UsageError for an unknown name.
std::vector<VerifyCase> verify(const std::vector<std::string>& filter, Index nodes);

/// Table as text and for a spreadsheet.
std::string verify_markdown(const std::vector<VerifyCase>& rows);
std::string verify_csv(const std::vector<VerifyCase>& rows);

/// Throws a SolveError that names the failed rows, if there are any.
void require_passed(const std::vector<VerifyCase>& rows);

}  // namespace dimple
