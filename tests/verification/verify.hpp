#pragma once

#include <string>
#include <vector>

#include "io/types.hpp"

namespace dimple {

/// One number of ours beside one that is known: a closed form, or what an independent code computed.
struct VerifyCase {
  std::string name;  ///< group/row: "hayes/a_h_0.2_nu_0.3"
  std::string what;
  double ours = 0.0, reference = 0.0;
  double error = 0.0;      ///< relative; of an order of convergence, the part that is missing of it
  double tolerance = 0.0;  ///< relative; set by how well the reference is known and by what the scheme claims
  std::string unit, source;
  bool passed = false;
};

/// A family of cases that are computed together.
struct VerifyGroup {
  std::string name, what;
};
std::vector<VerifyGroup> verify_groups();

/// Computes the groups whose names are in `filter` (empty: all), each with the converging scheme and its
/// standard supports. `nodes`: of the indented bodies; the lattices of the others are fixed. A group that
/// finds no equilibrium is one failed row. Throws UsageError: a name that is no group's.
std::vector<VerifyCase> verify(const std::vector<std::string>& filter, Index nodes);

/// The table for a text and for a spreadsheet.
std::string verify_markdown(const std::vector<VerifyCase>& rows);
std::string verify_csv(const std::vector<VerifyCase>& rows);

/// Throws SolveError that names the rows that fail, if any does.
void require_passed(const std::vector<VerifyCase>& rows);

}  // namespace dimple
