// force.csv and energy.csv of a run.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "apps/run/results.hpp"

namespace dimple {

void ResultWriter::tables(const History& history, const ErrorBounds& error_bounds, const ImageError& image,
                          double spread) const {
  Table force{.header = {"time_s", "indentation_mm", "force_N", "base_force_N"},
              .column = std::vector<std::vector<double>>(4)};
  for (const ForceSample& s : history.force) {
    const std::array<double, 4> row = {s.t, 1e3 * s.depth, s.force, s.base_force};
    for (std::size_t c = 0; c < row.size(); ++c) force.column[c].push_back(row[c]);
  }
  const auto add_from_to = [&](const char* low, const char* high, const auto& half) {
    std::vector<double> least, most;
    for (std::size_t k = 0; k < history.force.size(); ++k) {
      const double force = history.force[k].force;
      least.push_back(lower_bound(force, half(k), indenter_ != nullptr));
      most.push_back(force + half(k));
    }
    force.header.insert(force.header.end(), {low, high});
    force.column.push_back(std::move(least));
    force.column.push_back(std::move(most));
  };
  if (error_bounds.known())
    add_from_to("low_N", "high_N", [&](std::size_t k) { return error_bounds.half[k]; });
  if (image.known()) {
    force.header.push_back("image_half_N");
    force.column.push_back(image.half);
  }
  if (spread > 0.0)
    add_from_to("mu_low_N", "mu_high_N",
                [&](std::size_t k) { return spread * std::abs(history.force[k].force); });
  for (std::size_t c = 0; c < wrench_columns.size(); ++c) {
    force.header.push_back(wrench_columns[c]);
    std::vector<double>& column = force.column.emplace_back();
    for (const ForceSample& s : history.force) column.push_back(s.on_tool[c]);
  }
  // Columns that are zero except in a scene of steps.
  const auto add_if_any = [&](const auto& names, double unit, std::array<double, 3> ForceSample::*its) {
    if (std::all_of(history.force.begin(), history.force.end(),
                    [&](const ForceSample& s) { return s.*its == std::array<double, 3>{}; }))
      return;
    for (std::size_t c = 0; c < names.size(); ++c) {
      force.header.push_back(names[c]);
      std::vector<double>& column = force.column.emplace_back();
      for (const ForceSample& s : history.force) column.push_back(unit * (s.*its)[c]);
    }
  };
  add_if_any(aside_columns, 1e3, &ForceSample::aside);
  add_if_any(turned_columns, 180.0 / std::numbers::pi, &ForceSample::turned);
  add_further_wrenches(history, force);
  write_csv(folder_ / "force.csv", force);

  Table energy{.header = {"time_s", "indentation_mm", "kinetic_J", "stored_J", "external_work_J",
                          "dissipated_J", "error_J"},
               .column = std::vector<std::vector<double>>(7)};
  for (const EnergySample& s : history.energy) {
    const std::array<double, 7> row = {s.t,        1e3 * s.depth, s.kinetic, s.stored,
                                       s.external, s.dissipated,  s.error()};
    for (std::size_t c = 0; c < row.size(); ++c) energy.column[c].push_back(row[c]);
  }
  write_csv(folder_ / "energy.csv", energy);
}

// A wall has no reference point for a moment.
void ResultWriter::add_further_wrenches(const History& history, Table& force) const {
  const std::size_t walls = further_.size();
  for (std::size_t k = 0; k < walls; ++k)
    for (std::size_t c = 0; c < (further_[k].is_tool ? wrench_columns.size() : 3); ++c) {
      force.header.push_back(fmt::format("{}_{}", further_[k].name, wrench_columns[c]));
      std::vector<double>& column = force.column.emplace_back();
      for (std::size_t sample = 0; sample < history.force.size(); ++sample)
        column.push_back(history.on_walls[sample * walls + k][c]);
    }
}

}  // namespace dimple
