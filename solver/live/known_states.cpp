#include "solver/live/known_states.hpp"

#include <algorithm>
#include <cmath>

namespace dimple {

using State = KnownStates::State;

void KnownStates::add(State mine) {
  const auto near = [&](const State& s) { return std::abs(s.at - mine.at) < apart; };
  // The better one stays: the tool may have rested here before, and only pass now.
  if (std::any_of(state.begin(), state.end(),
                  [&](const State& s) { return near(s) && s.residual < mine.residual; }))
    return;
  state.erase(std::remove_if(state.begin(), state.end(), near), state.end());
  const auto after = std::find_if(state.begin(), state.end(), [&](const State& s) { return s.at > mine.at; });
  state.insert(after, std::move(mine));
}

const State& KnownStates::nearest(double at) const {
  return *std::min_element(state.begin(), state.end(), [&](const State& a, const State& b) {
    return std::abs(a.at - at) < std::abs(b.at - at);
  });
}

void KnownStates::guess(double at, ForceSystem::Nodal& u, Eigen::VectorXd& lambda) const {
  const auto above = static_cast<std::ptrdiff_t>(
      std::find_if(state.begin(), state.end(), [&](const State& s) { return s.at > at; }) - state.begin());
  const auto count = static_cast<std::ptrdiff_t>(state.size());
  // Two on each side; beyond the last the line through two, since three would amplify their residuals.
  std::ptrdiff_t first = std::max<std::ptrdiff_t>(0, above - 2), last = std::min(count, above + 2);
  if (above == count) first = count - 2, last = count;
  u.setZero(4, state.front().u.cols());
  lambda.setZero(state.front().lambda.size());
  for (std::ptrdiff_t i = first; i < last; ++i) {
    const State& mine = state[static_cast<std::size_t>(i)];
    double weight = 1.0;
    for (std::ptrdiff_t j = first; j < last; ++j)
      if (j != i) {
        const double other = state[static_cast<std::size_t>(j)].at;
        weight *= (at - other) / (mine.at - other);
      }
    u += weight * mine.u;
    lambda += weight * mine.lambda;
  }
}

KnownStates::Slope KnownStates::slope(double at) const {
  const auto count = static_cast<std::ptrdiff_t>(state.size());
  const auto above = static_cast<std::ptrdiff_t>(
      std::find_if(state.begin(), state.end(), [&](const State& s) { return s.at > at; }) - state.begin());
  const std::ptrdiff_t b = std::clamp<std::ptrdiff_t>(above, 1, count - 1);
  const State &lower = state[static_cast<std::size_t>(b - 1)], &upper = state[static_cast<std::size_t>(b)];
  const double distance = upper.at - lower.at;
  return {(upper.u - lower.u) / distance, (upper.lambda - lower.lambda) / distance,
          (upper.force - lower.force) / distance};
}

}  // namespace dimple
