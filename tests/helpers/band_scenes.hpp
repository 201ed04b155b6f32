#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "apps/run/band.hpp"
#include "io/file.hpp"

namespace dimple {

// The scenes of tests/verification/results/band_scenes.csv, which dimple_calibrate writes, and what follows
// from them.

/// Nodes of the finest cloud of every scene, and of any scene: the finest of a scene counts as the truth.
inline constexpr Index band_truth = 16'000, band_finest_truth = 64'000;
/// Clouds with up to this part of the truth's nodes are compared with it for the multiplier.
inline constexpr Index band_compared = 4;

struct BandScene {
  int number = 0;
  std::string set;  ///< "proof", "calibration", "aside": in neither, "large" or "thin": of such bodies
  std::string body;
  double facing_share = 0.0;
  double radius = 0.0;  ///< of the circle [m]
  bool several_tissues = false;
  std::map<Index, std::vector<ForceSample>> forces;  ///< nodes -> force curve
  std::map<Index, double> seconds;                   ///< from the surface to the curve
  Index truth = 0;                                   ///< nodes of its finest cloud
};

/// The rows of a file, without its header. read_csv() takes numbers alone, and these rows name bodies and
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

/// In the order of their numbers; those without a truth are left out.
inline std::vector<BandScene> band_scenes(const std::filesystem::path& file) {
  std::map<int, BandScene> scenes;
  for (const std::vector<std::string>& field : rows_of(file)) {
    const int number = std::stoi(field[0]);
    BandScene& scene = scenes[number];
    scene.number = number;
    scene.set = field[1];
    scene.body = field[2];
    scene.facing_share = std::stod(field[5]);
    scene.radius = 0.5e-3 * std::stod(field[6]);
    scene.several_tissues = scene.body == "phantom with a core";
    const Index nodes = std::stol(field[9]);
    std::vector<ForceSample>& curve = scene.forces[nodes];
    if (curve.empty()) curve.push_back({0.0, 0.0, 0.0, 0.0});
    const double depth = 1e-3 * std::stod(field[10]), force = std::stod(field[11]);
    curve.push_back({depth, depth, force, force});
    scene.seconds[nodes] = std::stod(field[12]) + std::stod(field[13]);
  }
  std::vector<BandScene> result;
  for (auto& [number, scene] : scenes) {
    const auto has = [&](Index nodes) {
      return scene.forces.contains(nodes) && scene.forces.contains(nodes / 2) &&
             scene.forces[nodes].size() == scene.forces[nodes / 2].size();
    };
    for (Index nodes = band_truth; nodes <= band_finest_truth; nodes *= 2)
      if (has(nodes)) scene.truth = nodes;
    if (scene.truth > 0) result.push_back(std::move(scene));
  }
  return result;
}

/// The force of `nodes` over the truth at the depth of sample k, less one.
inline double band_error(const BandScene& scene, Index nodes, std::size_t k) {
  return scene.forces.at(nodes)[k].force / scene.forces.at(scene.truth)[k].force - 1.0;
}

/// How far the truth itself may be off at that depth: as far as the next coarser cloud is from it.
inline double truth_error(const BandScene& scene, std::size_t k) {
  return std::abs(scene.forces.at(scene.truth / 2)[k].force / scene.forces.at(scene.truth)[k].force - 1.0);
}

/// The error with the truth's own.
inline double error_at_most(const BandScene& scene, Index nodes, std::size_t k) {
  return std::abs(band_error(scene, nodes, k)) + truth_error(scene, k);
}

/// Half the width of the error bounds of so many nodes, against a coarser set, at each depth [N].
inline std::vector<double> error_bounds(const BandScene& scene, Index nodes, Index coarse) {
  const std::vector<ForceSample>& fine = scene.forces.at(nodes);
  return half_widths(fine, nodes, scene.forces.at(coarse), scene.radius, scene.several_tissues);
}

/// Do the error bounds of so many nodes, against half as many, contain all that the truth may be, at all
/// depths? Nothing where one of these has no force at all of them.
inline std::optional<bool> contains_truth(const BandScene& scene, Index nodes) {
  const std::size_t samples = scene.forces.at(scene.truth).size();
  for (const Index of : {nodes, nodes / 2})
    if (!scene.forces.contains(of) || scene.forces.at(of).size() < samples) return std::nullopt;
  const std::vector<double> half = error_bounds(scene, nodes, nodes / 2);
  for (std::size_t k = 1; k < samples; ++k)
    if (error_at_most(scene, nodes, k) > half[k] / std::abs(scene.forces.at(nodes)[k].force)) return false;
  return true;
}

/// Of the calibration's scenes, nodes -> the largest error over the depths, with the truth's own, over what
/// band_measure() makes of that cloud's change.
using BandScores = std::map<Index, std::vector<double>>;
inline BandScores band_scores(const std::vector<BandScene>& scenes) {
  BandScores scores;
  for (const BandScene& scene : scenes) {
    if (scene.set != "calibration") continue;
    for (Index nodes = fewest_nodes_with_band(scene.facing_share); nodes <= scene.truth / band_compared;
         nodes *= 2) {
      const Index other = nodes / 2;
      if (!scene.forces.contains(nodes) || !scene.forces.contains(other)) continue;
      const auto &fine = scene.forces.at(nodes), &coarse = scene.forces.at(other);
      const std::size_t samples = scene.forces.at(scene.truth).size();
      if (fine.size() < samples || coarse.size() < samples) continue;
      double change = 0.0, largest = 0.0;
      for (std::size_t k = 1; k < samples; ++k) {
        const BandLoad load{fine[k].depth / scene.radius, scene.several_tissues};
        change = std::max(change, std::abs(fine[k].force / coarse[k].force - 1.0));
        largest = std::max(largest, error_at_most(scene, nodes, k) / band_measure(change, nodes, load));
      }
      scores[nodes].push_back(largest);
    }
  }
  return scores;
}

/// Where a random place of a scene's body goes: band_points.csv. The truth is the finest of these clouds, and
/// may itself be off by as much as the one before is from it.
struct PointScene {
  int number = 0;
  std::string set;
  double facing_share = 0.0, depth = 0.0;  ///< of the tool [mm]
  std::map<Index, Vec3> u;                 ///< nodes -> displacement at the last depth [mm]
};
inline constexpr Index point_truth = 8'000;

inline std::vector<PointScene> point_scenes(const std::filesystem::path& file) {
  std::map<int, PointScene> scenes;
  for (const std::vector<std::string>& field : rows_of(file)) {  // the last depth comes last
    PointScene& scene = scenes[std::stoi(field[0])];
    scene.number = std::stoi(field[0]);
    scene.set = field[1];
    scene.facing_share = std::stod(field[3]);
    scene.depth = std::stod(field[8]);
    scene.u[std::stol(field[4])] = Vec3(std::stod(field[9]), std::stod(field[10]), std::stod(field[11]));
  }
  std::vector<PointScene> result;
  for (auto& [number, scene] : scenes)
    if (scene.u.contains(point_truth) && scene.u.contains(point_truth / 2))
      result.push_back(std::move(scene));
  return result;
}

/// Of each cloud with a coarser one and a finer one than the truth's own doubt: its error at most, with the
/// truth's own, and what displacement_measure() makes of its change [mm].
struct PointError {
  Index nodes;
  double error, measure, length;
};
inline std::vector<PointError> point_errors(const PointScene& scene) {
  std::vector<PointError> errors;
  const Vec3 truth = scene.u.at(point_truth);
  const double unsure = (scene.u.at(point_truth / 2) - truth).norm();
  for (Index nodes = fewest_nodes_with_band(scene.facing_share); nodes <= point_truth / 4; nodes *= 2)
    if (scene.u.contains(nodes) && scene.u.contains(nodes / 2))
      errors.push_back(
          {nodes, (scene.u.at(nodes) - truth).norm() + unsure,
           displacement_measure((scene.u.at(nodes) - scene.u.at(nodes / 2)).norm(), scene.depth, nodes),
           scene.u.at(nodes).norm()});
  return errors;
}

/// As band_scores().
inline BandScores point_scores(const std::vector<PointScene>& scenes) {
  BandScores scores;
  for (const PointScene& scene : scenes)
    if (scene.set == "calibration")
      for (const PointError& e : point_errors(scene)) scores[e.nodes].push_back(e.error / e.measure);
  return scores;
}

/// The least multiplier with which a new scene's band holds with that probability, with each number of nodes
/// for which there are at least so many scenes: split conformal prediction.
inline double conformal(BandScores scores, double probability, std::size_t least) {
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
/// Scenes with a number of nodes, for it to be counted.
inline constexpr std::size_t least_scenes = 40, least_points = 20;
inline std::string counted(const BandScores& scores, std::size_t least) {
  std::string text;
  for (const auto& [nodes, of_scenes] : scores)
    if (of_scenes.size() >= least)
      text += (text.empty() ? "" : ", ") + std::to_string(of_scenes.size()) + " scenes with " +
              std::to_string(nodes) + " nodes";
  return text;
}

}  // namespace dimple
