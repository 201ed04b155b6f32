#pragma once

#include <cmath>
#include <deque>
#include <vector>

#include "solver/terms/internal_force.hpp"

namespace dimple {

/// The last equilibria along the load: the polynomial through them says where to look for the next one.
struct Predictor {
  struct Point {
    double at;  ///< [m] depth, or way of the load
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
  /// Through the last of the points, of which as many count as do not blow up what the search for equilibrium
  /// has left in them: all where they are evenly spaced, fewer where the last way was short.
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
  static constexpr double largest = 16.0;  // of four evenly spaced points 15: 4, -6, 4, -1

  // Of the polynomial through the points from `first` on.
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
