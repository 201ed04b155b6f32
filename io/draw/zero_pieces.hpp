#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <functional>
#include <vector>

namespace dimple {

/// A signed distance from rigid walls [mm] at a place in LPS mm; not a number where nothing is drawn.
using GapAt = std::function<double(const Eigen::Vector3d&)>;

/// Zero lines of a function of the plane between 0, 0 and width, height: straight pieces, each through a cell
/// of a lattice of about `step`. Cells with a value that is not a number have none.
template <class Function>
std::vector<std::array<Eigen::Vector2d, 2>> zero_pieces(double width, double height, double step,
                                                        const Function& value) {
  using Vec2 = Eigen::Vector2d;
  std::vector<std::array<Vec2, 2>> pieces;
  const auto across = static_cast<Eigen::Index>(std::ceil(width / step)),
             down = static_cast<Eigen::Index>(std::ceil(height / step));
  if (across < 1 || down < 1) return pieces;
  const Vec2 cell(width / static_cast<double>(across), height / static_cast<double>(down));
  Eigen::MatrixXd at(across + 1, down + 1);
  const auto corner = [&](Eigen::Index i, Eigen::Index j) {
    return Vec2(static_cast<double>(i) * cell.x(), static_cast<double>(j) * cell.y());
  };
  for (Eigen::Index j = 0; j <= down; ++j)
    for (Eigen::Index i = 0; i <= across; ++i) at(i, j) = value(corner(i, j));
  const auto in_triangle = [&](const std::array<std::array<Eigen::Index, 2>, 3>& t) {
    std::array<Vec2, 2> end;
    std::size_t found = 0;
    for (std::size_t e = 0; e < 3; ++e) {
      const auto [i, j] = t[e];
      const auto [k, l] = t[(e + 1) % 3];
      const double a = at(i, j), b = at(k, l);
      if (!std::isfinite(a) || !std::isfinite(b)) return;
      if ((a < 0.0) != (b < 0.0))
        end[found++ % 2] = corner(i, j) + (corner(k, l) - corner(i, j)) * (a / (a - b));
    }
    if (found == 2) pieces.push_back(end);
  };
  for (Eigen::Index j = 0; j < down; ++j)
    for (Eigen::Index i = 0; i < across; ++i) {
      in_triangle({{{i, j}, {i + 1, j}, {i + 1, j + 1}}});
      in_triangle({{{i, j}, {i + 1, j + 1}, {i, j + 1}}});
    }
  return pieces;
}

}  // namespace dimple
