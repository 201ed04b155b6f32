#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "apps/scene/resolve_parts.hpp"
#include "io/error.hpp"
#include "io/table.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

constexpr double least_turned_deg = 1e-6;  // less is rounding

[[noreturn]] void refuse_poses(const std::string& file, const std::string& fact, const std::string& why,
                               const std::string& remedy) {
  throw InputError({.fact = fact,
                    .where = fmt::format("--poses {}", file),
                    .why = why,
                    .remedy = remedy,
                    .code = "bad-path"});
}

Eigen::Quaterniond turn_of(const std::string& file, const std::array<const std::vector<double>*, 4>& column,
                           std::size_t row) {
  constexpr double of_length_one = 1e-3;
  if (!column[0]) return Eigen::Quaterniond::Identity();
  const Eigen::Quaterniond q((*column[0])[row], (*column[1])[row], (*column[2])[row], (*column[3])[row]);
  if (!(std::abs(q.norm() - 1.0) < of_length_one))
    refuse_poses(file, fmt::format("the quaternion in row {} has the length {:.4g}", row + 1, q.norm()),
                 "a rotation is a quaternion of length one", "give qw, qx, qy, qz with w first");
  return q.normalized();
}

}  // namespace

// Steps between successive poses, from the first contact on.
PosesTaken steps_of_poses(const std::string& file) {
  constexpr std::size_t most = 500;
  const Table table = read_csv(file);
  const auto *time = table.find("time_s"), *x = table.find("x_mm"), *y = table.find("y_mm"),
             *z = table.find("z_mm");
  if (!time || !x || !y || !z)
    refuse_poses(file, "a column of time_s, x_mm, y_mm, z_mm is missing",
                 fmt::format("the columns are named {}", fmt::join(table.header, ", ")),
                 "give these, of the tool's tip in LPS, and qw, qx, qy, qz if it turns");
  const std::array<const std::vector<double>*, 4> turn = {table.find("qw"), table.find("qx"),
                                                          table.find("qy"), table.find("qz")};
  if (std::count(turn.begin(), turn.end(), nullptr) % 4 != 0)
    refuse_poses(file, "a quaternion lacks a column", "it has the four numbers qw, qx, qy, qz",
                 "give all of them, or none");
  if (table.rows() < 2 || table.rows() > most)
    refuse_poses(file, fmt::format("there are {} rows", table.rows()),
                 fmt::format("a path has two to {} rows, each a search for equilibria", most),
                 "give the first contact and the poses after it");
  PosesTaken taken;
  bool moves = false;
  for (std::size_t k = 1; k < table.rows(); ++k) {
    if (!((*time)[k] > (*time)[k - 1]))
      refuse_poses(
          file,
          fmt::format("row {} is at {:g} s, the one before at {:g} s", k + 1, (*time)[k], (*time)[k - 1]),
          "time must increase along a path", "sort the rows, and remove duplicates");
    StepText step;
    step.order = static_cast<int>(k);
    const Vec3 displacement((*x)[k] - (*x)[k - 1], (*y)[k] - (*y)[k - 1], (*z)[k] - (*z)[k - 1]);
    const Eigen::AngleAxisd by(turn_of(file, turn, k) * turn_of(file, turn, k - 1).conjugate());
    const Vec3 degrees = by.angle() * 180.0 / std::numbers::pi * by.axis();
    if (!displacement.isZero(0.0)) step.move_mm.assign(displacement.begin(), displacement.end());
    if (degrees.norm() > least_turned_deg) step.turn_deg.assign(degrees.begin(), degrees.end());
    step.time_s = (*time)[k] - (*time)[k - 1];
    moves = moves || !step.move_mm.empty() || !step.turn_deg.empty();
    taken.steps[fmt::format("pose_{:04d}", k + 1)] = step;
  }
  if (!moves)
    refuse_poses(file, "the tool is in one place all the time", "a path needs a displacement", "let it move");
  const double turned = 180.0 / std::numbers::pi * Eigen::AngleAxisd(turn_of(file, turn, 0)).angle();
  taken.words = fmt::format(
      "its first row, at {}{}, is the first contact of the tool{}; time starts there",
      in_words(Vec3((*x)[0], (*y)[0], (*z)[0])),
      turned > least_turned_deg ? fmt::format(" and turned by {:.4g} degrees", turned) : "",
      turned > least_turned_deg ? ", where the tool is upright: later rows are rotations from it" : "");
  return taken;
}

}  // namespace dimple
