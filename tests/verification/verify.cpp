#include "tests/verification/verify.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "apps/scene/option.hpp"
#include "io/error.hpp"
#include "tests/verification/verify_bodies.hpp"

namespace dimple {
namespace {

struct Group {
  const char* name;
  const char* what;
  void (*run)(Rows& rows, Index nodes);
};
constexpr Group groups[] = {
    {"homogeneous", "cubes in uniaxial, confined, equibiaxial stretch and shear: closed forms",
     verify_homogeneous},
    {"ogden", "cubes of one, two and three Ogden terms: closed forms", verify_ogden},
    {"viscoelastic", "a cube sheared at once and held: relaxation function", verify_viscoelastic},
    {"layers", "two tissues in series, sheared and pressed: closed forms", verify_layers},
    {"inclusion", "a stiff sphere in a strained solid: Eshelby", verify_inclusion},
    {"torsion", "a twisted rod: Rivlin", verify_torsion},
    {"manufactured", "order of convergence towards a manufactured solution", verify_manufactured},
    {"cook", "Cook's membrane, nearly incompressible: mixed finite elements", verify_cook},
    {"hayes", "punch on a bonded layer: Hayes", verify_hayes},
    {"compressibility", "bonded cylinder, nu 0.3 to 0.4999: mixed finite elements", verify_compressibility},
    {"scene_a", "block indented by up to 8 mm: mixed finite elements", verify_scene_a},
    {"scene_b", "cut ellipsoid indented by up to 8 mm: mixed finite elements", verify_scene_b},
};

bool has_numbers(const VerifyCase& row) {
  return std::isfinite(row.ours);
}

std::string with_unit(const std::string& number, const std::string& unit) {
  return unit.empty() ? number : number + " " + unit;
}

std::string number(double value) {
  return fmt::format("{:.5g}", value);
}

std::string error_text(const VerifyCase& row) {
  return has_numbers(row) ? fmt::format("{:.2f} %", 100.0 * row.error) : "-";
}

// Cells of the table, without its header.
std::vector<std::string> cells(const VerifyCase& row) {
  return {row.what,
          has_numbers(row) ? with_unit(number(row.ours), row.unit) : "none",
          with_unit(number(row.reference), row.unit),
          error_text(row),
          fmt::format("{:.3g} %", 100.0 * row.tolerance),
          row.passed ? "yes" : "NO",
          row.source};
}

const std::vector<std::string> header = {"case",      "ours",   "reference", "error",
                                         "tolerance", "passed", "source"};

// Quotes a field as in RFC 4180.
std::string quoted(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string result = "\"";
  for (const char c : text) result += c == '"' ? std::string("\"\"") : std::string(1, c);
  return result + "\"";
}

}  // namespace

std::vector<VerifyGroup> verify_groups() {
  std::vector<VerifyGroup> result;
  for (const Group& group : groups) result.push_back({group.name, group.what});
  return result;
}

std::vector<VerifyCase> verify(const std::vector<std::string>& filter, Index nodes) {
  std::vector<std::string> known;
  for (const Group& group : groups) known.push_back(group.name);
  for (const std::string& name : filter)
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw UsageError({.fact = fmt::format("there is no case '{}'{}", name, did_you_mean(name, known)),
                        .where = "--case",
                        .why = fmt::format("known are {}", fmt::join(known, ", ")),
                        .remedy = "see `dimple_verify --list`"});
  Rows rows;
  for (const Group& group : groups) {
    if (!filter.empty() && std::find(filter.begin(), filter.end(), group.name) == filter.end()) continue;
    try {
      group.run(rows, nodes);
    } catch (const SolveError& error) {
      rows.push_back({.name = std::string(group.name) + "/stopped",
                      .what = fmt::format("{}: {}", group.name, error.report.fact),
                      .ours = std::nan(""),
                      .reference = std::nan(""),
                      .error = std::nan(""),
                      .unit = "",
                      .source = error.report.where});
    }
  }
  return rows;
}

std::string verify_markdown(const std::vector<VerifyCase>& rows) {
  std::string result = fmt::format("| {} |\n|---|---:|---:|---:|---:|---|---|\n", fmt::join(header, " | "));
  for (const VerifyCase& row : rows) result += fmt::format("| {} |\n", fmt::join(cells(row), " | "));
  return result;
}

std::string verify_csv(const std::vector<VerifyCase>& rows) {
  std::string result = "name,case,ours,reference,unit,relative_error,tolerance,passed,source\n";
  for (const VerifyCase& row : rows)
    result += fmt::format("{},{},{},{},{},{},{},{},{}\n", row.name, quoted(row.what), row.ours, row.reference,
                          quoted(row.unit), row.error, row.tolerance, row.passed ? 1 : 0, quoted(row.source));
  return result;
}

void require_passed(const std::vector<VerifyCase>& rows) {
  std::vector<std::string> failed;
  for (const VerifyCase& row : rows)
    if (!row.passed)
      failed.push_back(
          fmt::format("{} ({}, {:.3g} % allowed)", row.name, error_text(row), 100.0 * row.tolerance));
  if (failed.empty()) return;
  throw SolveError(
      {.fact = fmt::format("{} of {} verification rows fail", failed.size(), rows.size()),
       .where = fmt::format("{}", fmt::join(failed, "; ")),
       .why = "these numbers are further from the known ones than their tolerance",
       .remedy = "with the standard number of nodes, please report this as a mistake of ours; with fewer "
                 "(--nodes) larger errors are to be expected"});
}

}  // namespace dimple
