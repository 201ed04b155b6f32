#pragma once

#include <deque>

#include "solver/terms/internal_force.hpp"

namespace dimple {

/// The last equilibria along the load: the polynomial through them says where to look for the next one.
struct Predictor {
  struct Point {
    double at;  ///< depth or time
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
  void extrapolate(double at, ForceSystem::Nodal& u, Eigen::VectorXd& lambda) const {
    u.setZero();
    lambda.setZero();
    for (const Point& mine : point) {
      double weight = 1.0;
      for (const Point& other : point)
        if (&other != &mine) weight *= (at - other.at) / (mine.at - other.at);
      u += weight * mine.u;
      lambda += weight * mine.lambda;
    }
  }
};

}  // namespace dimple
