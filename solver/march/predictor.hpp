#pragma once

#include <cmath>
#include <deque>
#include <vector>

#include "solver/terms/internal_force.hpp"

namespace dimple {

/// First guess of the next equilibrium: polynomial through the last ones along the load path.
struct Predictor {
  struct Point {
    double at;  ///< [m] depth, or path length of the load
    ForceSystem::Nodal u;
    Eigen::VectorXd lambda;
  };
  std::deque<Point> point;
  std::size_t most;

  explicit Predictor(std::size_t kept) : most(kept) {}

  void push(double at, const ForceSystem::Nodal& u, const Eigen::VectorXd& lambda) {
    point.push_back({at, u, lambda});
    if (point.size() > most) point.pop_front();
  }
  /// Evaluates it at `at`. Points are left out, oldest first, until the |weights| sum to `largest` at most,
  /// since weights amplify the residuals of the points: none at even spacing, some after a short increment.
  void extrapolate(double at, ForceSystem::Nodal& u, Eigen::VectorXd& lambda) const {
    std::vector<double> weight;
    double size = 0.0;
    for (std::size_t first = 0;; ++first) {
      weight = weights(at, first);
      size = 0.0;
      for (const double w : weight) size += std::abs(w);
      if (size <= largest || weight.size() <= 2) break;
    }
    u.setZero();
    lambda.setZero();
    for (std::size_t k = 0; k < weight.size(); ++k) {
      const Point& mine = point[point.size() - weight.size() + k];
      u += weight[k] * mine.u;
      lambda += weight[k] * mine.lambda;
    }
  }

 private:
  static constexpr double largest = 16.0;  // four evenly spaced points have 15: 4, -6, 4, -1

  // Lagrange weights at `at` of the polynomial through the points from `first` on.
  std::vector<double> weights(double at, std::size_t first) const {
    std::vector<double> all;
    for (std::size_t k = first; k < point.size(); ++k) {
      double weight = 1.0;
      for (std::size_t j = first; j < point.size(); ++j)
        if (j != k) weight *= (at - point[j].at) / (point[k].at - point[j].at);
      all.push_back(weight);
    }
    return all;
  }
};

}  // namespace dimple
