#include "apps/run/tool_error_bounds.hpp"

#include <algorithm>
#include <cmath>

#include "apps/run/error_bounds.hpp"
#include "solver/guards.hpp"

namespace dimple {
namespace {

struct Changes {
  std::vector<double> depth, most;  // largest change so far
  double at(double d) const {
    const auto after =
        static_cast<std::size_t>(std::lower_bound(depth.begin(), depth.end(), d) - depth.begin());
    return most[std::min(after, most.size() - 1)];
  }
};

// Error by penetration at this depth or deeper, as a part of the force.
double by_penetration(const Penetration& penetration, double depth) {
  return penetration.at > 0.0
             ? Guards::off_by_penetration(penetration.largest, std::max(penetration.at, depth))
             : 0.0;
}

}  // namespace

const double tool_error_multiplier = 2.7;

double tool_error_measure(double change, Index nodes, double spacing, double contact) {
  const double r = spacing / contact;
  return 0.3 * std::abs(change) + 0.01 * std::pow(1e-3 * static_cast<double>(nodes), -0.6) + 0.4 * r * r;
}

double tool_error_half_width(double change, Index nodes, double spacing, double contact) {
  return tool_error_multiplier * tool_error_measure(change, nodes, spacing, contact);
}

std::vector<double> tool_half_widths(const std::vector<ForceSample>& force, const Model& model,
                                     const std::vector<ForceSample>& coarse, const ToolShape& shape,
                                     const Penetration& penetration) {
  if (force.empty() || coarse.empty() || coarse.back().depth < force.back().depth * (1.0 - 1e-9)) return {};
  const double shallowest = shallowest_with_tool_error_bounds * shape.radius * (1.0 - 1e-9);
  Changes changes;  // none at less: with little contact node sets differ by a factor
  for (const ForceSample& sample : coarse)
    if (sample.force > 0.0 && sample.depth >= shallowest && sample.depth <= force.back().depth * (1.0 + 1e-9))
      changes.depth.push_back(sample.depth);
  if (changes.depth.empty()) return {};
  const std::vector<double> fine = forces_between(force, changes.depth),
                            other = forces_between(coarse, changes.depth);
  for (std::size_t k = 0; k < fine.size(); ++k) {
    const double here = std::abs(fine[k] / other[k] - 1.0);
    changes.most.push_back(k > 0 ? std::max(changes.most.back(), here) : here);
  }
  const double spacing = model.spacing.minCoeff();
  const auto first = std::find_if(force.begin(), force.end(),
                                  [&](const ForceSample& sample) { return sample.depth >= shallowest; });
  if (first == force.end()) return {};
  std::vector<double> half;
  for (const ForceSample& sample : force) {
    if (!(sample.depth > 0.0)) {
      half.push_back(0.0);
      continue;
    }
    const double of_node_sets = tool_error_half_width(changes.at(sample.depth), model.node_count(), spacing,
                                                      contact_radius(shape, sample.depth));
    half.push_back(std::abs(sample.force) *
                   std::max(by_penetration(penetration, sample.depth), of_node_sets));
  }
  const auto measured = static_cast<std::size_t>(first - force.begin());
  const double most = std::abs(first->force) + half[measured];
  for (std::size_t k = 0; k < measured; ++k) {
    const double here = std::abs(force[k].force), line = most * force[k].depth / first->depth;
    half[k] = std::max({half[k], here, line - here});
  }
  return half;
}

std::vector<double> tool_half_widths_of_steps(const std::vector<ForceSample>& force, const Model& model,
                                              const std::vector<ForceSample>& coarse, const ToolShape& shape,
                                              const Penetration& penetration) {
  const double shallowest = shallowest_with_tool_error_bounds * shape.radius,
               spacing = model.spacing.minCoeff();
  return half_widths_of_steps(force, coarse, shallowest, [&](double change, double deepest) {
    const double depth = std::max(deepest, shallowest);
    return std::max(by_penetration(penetration, depth),
                    tool_error_half_width(change, model.node_count(), spacing, contact_radius(shape, depth)));
  });
}

}  // namespace dimple
