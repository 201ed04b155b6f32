#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "apps/run/error_bounds.hpp"
#include "io/file.hpp"

namespace dimple {

// Scenes of tests/verification/results/error_scenes.csv, which dimple_calibrate writes, and derived
// quantities.

/// Nodes of the finest discretisation of every scene, and of any scene. A scene's finest counts as the truth.
inline constexpr Index truth_nodes = 16'000, finest_truth_nodes = 64'000;
/// Discretisations with up to 1 / error_compared of the truth's nodes enter the multiplier.
inline constexpr Index error_compared = 4;

struct ErrorScene {
  int number = 0;
  std::string set;  ///< "proof", "calibration", "aside" (in neither), "large" or "thin"
  std::string body;
  double facing_fraction = 0.0;
  double radius = 0.0;  ///< of the bonded patch [m]
  bool several_tissues = false;
  std::map<Index, std::vector<ForceSample>> forces;  ///< nodes -> force curve
  std::map<Index, double> seconds;                   ///< from the surface to the curve
  Index truth = 0;                                   ///< nodes of its finest discretisation
};

/// Rows of a file, without its header. read_csv() accepts numbers alone, and these rows name bodies and
/// places, some with commas.
inline std::vector<std::vector<std::string>> rows_of(const std::filesystem::path& file) {
  std::vector<std::vector<std::string>> rows;
  std::istringstream lines(read_file(file));
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line)) {
    std::vector<std::string>& field = rows.emplace_back(1);
    bool quoted = false;
    for (const char c : line)
      if (c == '"')
        quoted = !quoted;
      else if (c == ',' && !quoted)
        field.emplace_back();
      else
        field.back() += c;
  }
  return rows;
}

/// Scenes in the order of their numbers; those without a truth are left out.
inline std::vector<ErrorScene> error_scenes(const std::filesystem::path& file) {
  std::map<int, ErrorScene> scenes;
  for (const std::vector<std::string>& field : rows_of(file)) {
    const int number = std::stoi(field[0]);
    ErrorScene& scene = scenes[number];
    scene.number = number;
    scene.set = field[1];
    scene.body = field[2];
    scene.facing_fraction = std::stod(field[5]);
    scene.radius = 0.5e-3 * std::stod(field[6]);
    scene.several_tissues = scene.body == "phantom with a core";
    const Index nodes = std::stol(field[9]);
    std::vector<ForceSample>& curve = scene.forces[nodes];
    if (curve.empty()) curve.push_back({0.0, 0.0, 0.0, 0.0});
    const double depth = 1e-3 * std::stod(field[10]), force = std::stod(field[11]);
    curve.push_back({depth, depth, force, force});
    scene.seconds[nodes] = std::stod(field[12]) + std::stod(field[13]);
  }
  std::vector<ErrorScene> result;
  for (auto& [number, scene] : scenes) {
    const auto has = [&](Index nodes) {
      return scene.forces.contains(nodes) && scene.forces.contains(nodes / 2) &&
             scene.forces[nodes].size() == scene.forces[nodes / 2].size();
    };
    for (Index nodes = truth_nodes; nodes <= finest_truth_nodes; nodes *= 2)
      if (has(nodes)) scene.truth = nodes;
    if (scene.truth > 0) result.push_back(std::move(scene));
  }
  return result;
}

/// Relative error of the force with `nodes` at the depth of sample k.
inline double scene_error(const ErrorScene& scene, Index nodes, std::size_t k) {
  return scene.forces.at(nodes)[k].force / scene.forces.at(scene.truth)[k].force - 1.0;
}

/// Possible error of the truth itself at that depth: its difference from the next coarser discretisation.
inline double truth_error(const ErrorScene& scene, std::size_t k) {
  return std::abs(scene.forces.at(scene.truth / 2)[k].force / scene.forces.at(scene.truth)[k].force - 1.0);
}

/// Largest possible error: the error plus that of the truth.
inline double error_at_most(const ErrorScene& scene, Index nodes, std::size_t k) {
  return std::abs(scene_error(scene, nodes, k)) + truth_error(scene, k);
}

/// Half the width of the error bounds of so many nodes, against a coarser set, at each depth [N].
inline std::vector<double> error_bounds(const ErrorScene& scene, Index nodes, Index coarse) {
  const std::vector<ForceSample>& fine = scene.forces.at(nodes);
  return half_widths(fine, nodes, scene.forces.at(coarse), scene.radius, scene.several_tissues);
}

/// True if the error bounds of so many nodes, against half as many, contain all possible values of the truth
/// at all depths. Empty if one of these discretisations does not have all forces.
inline std::optional<bool> contains_truth(const ErrorScene& scene, Index nodes) {
  const std::size_t samples = scene.forces.at(scene.truth).size();
  for (const Index of : {nodes, nodes / 2})
    if (!scene.forces.contains(of) || scene.forces.at(of).size() < samples) return std::nullopt;
  const std::vector<double> half = error_bounds(scene, nodes, nodes / 2);
  for (std::size_t k = 1; k < samples; ++k)
    if (error_at_most(scene, nodes, k) > half[k] / std::abs(scene.forces.at(nodes)[k].force)) return false;
  return true;
}

/// Scores of the calibration scenes by number of nodes. A score is the largest error over the depths,
/// including that of the truth, divided by error_measure() of that discretisation's change.
using ErrorScores = std::map<Index, std::vector<double>>;
inline ErrorScores error_scores(const std::vector<ErrorScene>& scenes) {
  ErrorScores scores;
  for (const ErrorScene& scene : scenes) {
    if (scene.set != "calibration") continue;
    for (Index nodes = fewest_nodes_with_error_bounds(scene.facing_fraction);
         nodes <= scene.truth / error_compared; nodes *= 2) {
      const Index other = nodes / 2;
      if (!scene.forces.contains(nodes) || !scene.forces.contains(other)) continue;
      const auto &fine = scene.forces.at(nodes), &coarse = scene.forces.at(other);
      const std::size_t samples = scene.forces.at(scene.truth).size();
      if (fine.size() < samples || coarse.size() < samples) continue;
      double change = 0.0, largest = 0.0;
      for (std::size_t k = 1; k < samples; ++k) {
        const ErrorLoad load{fine[k].depth / scene.radius, scene.several_tissues};
        change = std::max(change, std::abs(fine[k].force / coarse[k].force - 1.0));
        largest = std::max(largest, error_at_most(scene, nodes, k) / error_measure(change, nodes, load));
      }
      scores[nodes].push_back(largest);
    }
  }
  return scores;
}

/// Displacements of a random point of a scene's body: band_points.csv. The finest discretisation is the
/// truth; its own error may be as large as its difference from the next coarser one.
struct PointScene {
  int number = 0;
  std::string set;
  double facing_fraction = 0.0, depth = 0.0;  ///< of the tool [mm]
  std::map<Index, Vec3> u;                    ///< nodes -> displacement at the last depth [mm]
};
inline constexpr Index point_truth = 8'000;

inline std::vector<PointScene> point_scenes(const std::filesystem::path& file) {
  std::map<int, PointScene> scenes;
  for (const std::vector<std::string>& field : rows_of(file)) {  // the last depth is in the last row
    PointScene& scene = scenes[std::stoi(field[0])];
    scene.number = std::stoi(field[0]);
    scene.set = field[1];
    scene.facing_fraction = std::stod(field[3]);
    scene.depth = std::stod(field[8]);
    scene.u[std::stol(field[4])] = Vec3(std::stod(field[9]), std::stod(field[10]), std::stod(field[11]));
  }
  std::vector<PointScene> result;
  for (auto& [number, scene] : scenes)
    if (scene.u.contains(point_truth) && scene.u.contains(point_truth / 2))
      result.push_back(std::move(scene));
  return result;
}

/// Errors of each discretisation that has a coarser one and at most a quarter of the truth's nodes. The error
/// is an upper bound that includes the truth's own; `measure` is displacement_measure() of the change [mm].
struct PointError {
  Index nodes;
  double error, measure, length;
};
inline std::vector<PointError> point_errors(const PointScene& scene) {
  std::vector<PointError> errors;
  const Vec3 truth = scene.u.at(point_truth);
  const double unsure = (scene.u.at(point_truth / 2) - truth).norm();
  for (Index nodes = fewest_nodes_with_error_bounds(scene.facing_fraction); nodes <= point_truth / 4;
       nodes *= 2)
    if (scene.u.contains(nodes) && scene.u.contains(nodes / 2))
      errors.push_back(
          {nodes, (scene.u.at(nodes) - truth).norm() + unsure,
           displacement_measure((scene.u.at(nodes) - scene.u.at(nodes / 2)).norm(), scene.depth, nodes),
           scene.u.at(nodes).norm()});
  return errors;
}

/// Scores as in error_scores(), for displacements.
inline ErrorScores point_scores(const std::vector<PointScene>& scenes) {
  ErrorScores scores;
  for (const PointScene& scene : scenes)
    if (scene.set == "calibration")
      for (const PointError& e : point_errors(scene)) scores[e.nodes].push_back(e.error / e.measure);
  return scores;
}

/// Smallest multiplier with which a new scene's bounds hold with that probability, by split conformal
/// prediction. Only numbers of nodes with at least `least` scenes count.
inline double conformal(ErrorScores scores, double probability, std::size_t least) {
  double multiplier = 0.0;
  for (auto& [nodes, of_scenes] : scores) {
    if (of_scenes.size() < least) continue;
    std::sort(of_scenes.begin(), of_scenes.end());
    const auto rank =
        static_cast<std::size_t>(std::ceil(probability * (static_cast<double>(of_scenes.size()) + 1.0)));
    multiplier = std::max(multiplier, rank > of_scenes.size() ? INFINITY : of_scenes[rank - 1]);
  }
  return multiplier;
}
/// Fewest scenes, or points, with which a number of nodes counts.
inline constexpr std::size_t least_scenes = 40, least_points = 20;
inline std::string counted(const ErrorScores& scores, std::size_t least) {
  std::string text;
  for (const auto& [nodes, of_scenes] : scores)
    if (of_scenes.size() >= least)
      text += (text.empty() ? "" : ", ") + std::to_string(of_scenes.size()) + " scenes with " +
              std::to_string(nodes) + " nodes";
  return text;
}

}  // namespace dimple
