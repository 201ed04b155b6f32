#pragma once

#include <cmath>

#include "preprocess/make_model.hpp"

namespace dimple {

/// Box with a lattice; lengths in m.
struct LatticeBox {
  Vec3 lower, upper;
  Eigen::Array3i intervals;
  Vec3 spacing() const { return (upper - lower).array() / intervals.cast<double>(); }
};

/// Nodes on a box's faces and inside, and so many cells that fill it.
inline Discretisation even_lattice(const LatticeBox& box, const Eigen::Array3i& cells) {
  const Vec3 cell = (box.upper - box.lower).array() / cells.cast<double>(), spacing = box.spacing();
  const auto filled = [&](const Eigen::Array3i& n, const Vec3& step, double shift) {
    Points x(3, n.prod());
    Index b = 0;
    for (int k = 0; k < n.z(); ++k)
      for (int j = 0; j < n.y(); ++j)
        for (int i = 0; i < n.x(); ++i)
          x.col(b++) = box.lower + step.cwiseProduct(Vec3(i + shift, j + shift, k + shift));
    return x;
  };
  Discretisation places;
  places.X = filled(box.intervals + 1, spacing, 0.0);
  places.point = filled(cells, cell, 0.5);
  places.spacing = Eigen::VectorXd::Constant(places.X.cols(), spacing.norm() / std::sqrt(3.0));
  places.volume = Eigen::VectorXd::Constant(places.point.cols(), cell.prod());
  places.second_moments = SecondMoments::Zero(6, places.point.cols());
  places.second_moments.topRows<3>().colwise() = Vec3(cell.array().square() / 12.0);
  places.label = Eigen::VectorXi::Zero(places.point.cols());
  return places;
}

}  // namespace dimple
