#pragma once

#include "tests/helpers/block.hpp"

namespace dimple::testing_bodies {

/// A shallow arch 39 x 7.5 x 3 mm held at both ends, `rise` higher in the middle. A soft pad 6 mm high on its
/// crown is pressed by a bonded patch from above. Tissue 0 is the arch, 1 the pad. The arch snaps through
/// while the tool does not move: a path with a limit point, with a few hundred nodes.
inline Model arch_under_a_pad(double rise = 10e-3) {
  constexpr double h = 1.5e-3, length = 26 * h, width = 5 * h, arch = 2 * h, top = 6 * h, reach = 3 * h;
  const auto lifted = [&](Vec3 x) {
    x.z() += 0.5 * rise * (1.0 - std::cos(2.0 * M_PI * x.x() / length));  // a shear: volumes stay
    return x;
  };
  const auto in_pad = [&](const Vec3& x) { return std::abs(x.x() - 0.5 * length) < reach + 1e-6; };
  std::mt19937 random(7);
  std::uniform_real_distribution<double> noise(-0.1 * h, 0.1 * h);
  Discretisation places;
  std::vector<Vec3> nodes, points;
  for (int k = 0; k <= 6; ++k)
    for (int j = 0; j <= 5; ++j)
      for (int i = 0; i <= 26; ++i) {
        Vec3 x(i * h, j * h, k * h);
        if (k > 2 && !in_pad(x)) continue;
        const auto a = static_cast<Index>(nodes.size());
        if (i == 0 || i == 26) places.base.push_back(a);
        if (k == 6) places.bonded_patch.push_back(a);
        if (i > 0 && i < 26 && k != 6) x += Vec3(noise(random), noise(random), noise(random));
        nodes.push_back(lifted(x));
      }
  const double cell = h / 1.8;
  for (int k = 0; (k + 0.5) * cell < top; ++k)
    for (int j = 0; (j + 0.5) * cell < width; ++j)
      for (int i = 0; (i + 0.5) * cell < length; ++i) {
        const Vec3 x((i + 0.5) * cell, (j + 0.5) * cell, (k + 0.5) * cell);
        if (x.z() > arch && !in_pad(x)) continue;
        points.push_back(x);
      }
  places.X.resize(3, static_cast<Index>(nodes.size()));
  for (std::size_t a = 0; a < nodes.size(); ++a) places.X.col(static_cast<Index>(a)) = nodes[a];
  places.spacing = Eigen::VectorXd::Constant(places.X.cols(), h);
  const auto count = static_cast<Index>(points.size());
  places.point.resize(3, count);
  places.label.resize(count);
  for (Index q = 0; q < count; ++q) {
    const Vec3& x = points[static_cast<std::size_t>(q)];
    places.point.col(q) = lifted(x);
    places.label[q] = x.z() > arch ? 1 : 0;
  }
  places.volume = Eigen::VectorXd::Constant(count, cell * cell * cell);
  places.second_moments = SecondMoments::Zero(6, count);
  places.second_moments.topRows<3>().setConstant(cell * cell / 12.0);
  places.tool = {
      .centre = lifted({0.5 * length, 0.5 * width, top}), .approach = -Vec3::UnitZ(), .radius = reach};
  Eigen::VectorXi tissue = places.label;
  return make_model(std::move(places), converging, std::move(tissue), {1000.0, 1000.0});
}

}  // namespace dimple::testing_bodies
