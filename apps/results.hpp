#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/config.hpp"
#include "io/vtk_files.hpp"

namespace dimple {

/// Writes a run's results while it goes: frames as they come, tables and the summary at the end.
class ResultWriter {
 public:
  /// `surface` [LPS mm] may be empty. `model` must be complete and outlive this.
  ResultWriter(std::filesystem::path folder, const Model& model, const ForceSystem& system,
               const SurfaceFile& surface, const SupportOptions& support);

  void frame(const Frame& frame);
  void tables(const History& history) const;
  /// overview.png: the model at rest, the last frame, the force curve.
  void overview(const History& history, const std::string& title,
                const std::vector<std::string>& lines) const;

 private:
  std::filesystem::path folder_;
  const Model& model_;
  const ForceSystem& system_;
  const SurfaceFile& surface_;
  Interpolation to_points_, to_surface_;
  Points nodes_mm_, points_mm_;
  Eigen::MatrixXd node_set_;
  Eigen::MatrixXd on_circle_;  // [1 x surface vertices]
  TimeSeries node_series_, point_series_, surface_series_;
  Points last_u_mm_, last_surface_u_mm_;
};

/// Refuses a folder that holds other things than our results, before anything expensive. Throws OutputError.
void check_result_folder(const std::filesystem::path& folder);

/// Makes the folder, and removes what an earlier run left there. Throws OutputError.
void prepare_result_folder(const std::filesystem::path& folder);

}  // namespace dimple
