#pragma once

#include <limits>

#include "apps/run/record.hpp"

namespace dimple {

struct AccuracyOptions {
  std::vector<std::string> only;  ///< of a, b, image; empty: all that there are
  std::filesystem::path reference;  ///< of the image: CSV with indentation_mm at even steps and force_N, or empty
  std::vector<Index> nodes = {600, 1000, 2000, 3000, 4250, 8500};
  std::vector<std::string> goals = {"10%", "5%", "3%"};  ///< accuracies to ask for, besides
  std::vector<std::string> schemes = {"converging", "horton2007"};
  std::vector<std::string> times = {"quasi-static", "dynamic"};
  int repeat = 1;  ///< clouds of each size (seeds): times are medians, errors the largest of all
  /// Sizes of dynamic runs; empty: those of `nodes` up to 4250.
  std::vector<Index> dynamic_nodes;
  std::string calculix = "ccx";                            ///< path or name, or none
  std::string febio;                                       ///< path, or empty: left out
  std::vector<std::string> peer_elements = {"hexahedra"};  ///< or tetrahedra, or both
  std::vector<Index> peer_nodes = {500, 1000, 2000};       ///< of other programs' meshes, about
  double peer_limit_s = 120.0;                             ///< for one run of theirs
};

/// What one run reached and what it cost.
struct AccuracyPoint {
  std::string scene;    ///< a, b, image
  std::string program;  ///< dimple, calculix, febio
  std::string scheme;   ///< converging, horton2007; of other programs the element; with a goal "accuracy 2%"
  std::string time;     ///< quasi-static, dynamic
  Index nodes = 0, points = 0;
  double build_s = 0.0, solve_s = 0.0;
  std::size_t depths = 8;  ///< that were asked for
  std::vector<std::vector<double>> runs = {};  ///< per cloud: [N] at those depths, as far as it came
  std::string status = "ok";                   ///< or why there is no more
  double error = 0.0;       ///< largest |force / reference - 1| over the depths; not a number where unknown
  double error_last = 0.0;  ///< at the deepest
  bool on_front = false;
  double stated = std::numeric_limits<double>::quiet_NaN();  ///< half the band at the deepest, as a part of the force
  double band_s = 0.0;                                       ///< that the band took besides
  bool on_stated_front = false;  ///< among the points with a band: none is as cheap and states as little
  double wall_s() const { return build_s + solve_s; }
};

/// Which of the points no other one beats: none is both as cheap and as accurate, and one of both better. In
/// order of cost. Points that are not finite are on no front.
std::vector<std::size_t> pareto_front(const std::vector<double>& cost, const std::vector<double>& error);

/// Runs scenes over schemes, cloud sizes and ways of stepping in time, beside other programs that are
/// installed, and draws error against wall time, and below it what the runs with a band say of their error, the band's
/// time counted in: chart.csv, chart.png, chart.svg. Scenes A and B are made
/// here, as 1 mm images left in the folder (scene_a.nrrd), and have a reference; `config` names another image
/// and what belongs to it. Without a reference of its own its runs are shown by their difference from the finest of
/// them, with no front and no verdict on other programs. Times are those of the whole, from the image to the force; of
/// other programs with the mesh. Throws UsageError, and what run() throws where a scene cannot be made; a run
/// that fails is a row without an error.
Outcome accuracy_chart(const Config& config, const AccuracyOptions& options,
                       const std::filesystem::path& folder,
                       const std::function<void(const std::string&)>& progress);

}  // namespace dimple
