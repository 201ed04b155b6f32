#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <future>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/compare.hpp"
#include "apps/run/error_bounds.hpp"
#include "apps/run/image_error.hpp"
#include "apps/run/report.hpp"
#include "apps/scene/scene.hpp"
#include "io/draw/picture.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/table.hpp"
#include "io/vtk_files.hpp"
#include "preprocess/nodes/integration_grid.hpp"
#include "preprocess/output/reduce_surface.hpp"
#include "preprocess/output/section.hpp"
#include "preprocess/supports/support.hpp"

namespace dimple {

/// Requested files, in addition to those of every run: force.csv, energy.csv, config.resolved.toml,
/// summary.json.
struct Requested {
  bool nodes = true, points = true, surface = true, picture = true, model = true, label = true, report = true;
  bool images = false;  ///< not among "all": they take longer than the rest of a run, and more room
  /// The surface as it was drawn, and the points of every frame; else a smaller surface, and the points of
  /// the last frame.
  bool fine = false;
};
Requested requested_by(const Scene& scene);
inline constexpr Requested tables_alone = {false, false, false, false, false, false, false, false, false};

/// Columns of force.csv in a scene of steps: lateral displacement of the tool, LPS.
inline constexpr std::array aside_columns = {"aside_x_mm", "aside_y_mm", "aside_z_mm"};
/// Columns of force.csv for a rotating tool: its rotation vector from the start, LPS.
inline constexpr std::array turned_columns = {"turned_x_deg", "turned_y_deg", "turned_z_deg"};
/// Force of the tissue on the tool, and its moment about the middle of the bonded patch or the tip of a tool
/// in contact, which move with the tool: LPS.
inline constexpr std::array wrench_columns = {"force_x_N",   "force_y_N",   "force_z_N",
                                              "moment_x_Nm", "moment_y_Nm", "moment_z_Nm"};

/// At the integration points.
struct PointStress {
  Eigen::MatrixXd J;  ///< [1xQ] det F
  /// [6xQ] Cauchy stress in VTK's order, XX, YY, ZZ, XY, YZ, XZ [Pa]; not a number where det F is below
  /// least_J_of_stress
  Eigen::MatrixXd sigma;
  Eigen::MatrixXd mises;  ///< [1xQ] von Mises stress [Pa], likewise
};
PointStress stress_at_points(const Frame& frame);

/// Writer of a run's results: frames during the march, then tables, the picture and the data of report.html.
///
/// A thread of its own packs and writes each frame, one at a time and in order, while the march continues.
/// With one thread allowed, or little memory, the frame is written at once. The bytes are the same.
class ResultWriter {
 public:
  /// `model` must outlive this, and its discretisation must not change. `label_at`: label of the image at a
  /// point [mm, LPS]; empty: there is no image. `supports`: nodes.pvd shows the nodes they hold. `end_s`: end
  /// of the load.
  ResultWriter(std::filesystem::path folder, const Model& model, const Requested& requested = {},
               const LabelAt& label_at = {}, const std::vector<HeldSet>& supports = {},
               double end_s = std::numeric_limits<double>::infinity(),
               std::shared_ptr<const RigidBody> indenter = nullptr);

  /// A wall or further tool, in the order of Loading::walls: its forces are in force.csv and contact.pvd, and
  /// tools are drawn.
  struct Rigid {
    std::string name;
    bool is_tool = false;
    SurfaceFile body = {};                                 ///< of a tool, at first contact [mm]
    std::function<Vec3(double time_s)> displacement = {};  ///< of a tool: displacement since then [m]
  };
  void show_further(std::vector<Rigid> rigid) { further_ = std::move(rigid); }

  ~ResultWriter();

  /// `carried`: History::carried, the displacement of the tool by the loads [m]. Throws the error of the
  /// frame before.
  void frame(const Frame& frame, const Vec3& carried = Vec3::Zero());
  /// Waits until the last frame is on the disk; throws its error.
  void finish_frames();
  /// Writes the files of the last frame, whether or not the load has ended.
  void end_frames();
  /// Continues after the frames that an earlier run has written at these times [s].
  void resume(const std::vector<double>& frame_time_s);
  /// Continues after the frames of another body, which has been cut since.
  void continue_after_cut(const std::vector<double>& frame_time_s);
  /// Times of the frames on the disk [s].
  const std::vector<double>& frame_time_s() const { return frame_time_s_; }
  /// `spread`: of the force by its material, as a share of it; 0: not known.
  void tables(const History& history, const ErrorBounds& error_bounds, const ImageError& image,
              double spread) const;
  /// Lets overview() and report() show forces over time, for a scene of steps.
  void show_over_time() { over_time_ = true; }
  /// Lets overview() and report() show the walls.
  void show_walls(GapAt walls) { walls_ = std::move(walls); }
  /// overview.png: the model at rest, the last frame, the force curve, and what it is compared with.
  void overview(const History& history, const ErrorBounds& error_bounds, const ImageError& image,
                const std::optional<Comparison>& comparison, const std::string& title,
                const std::vector<std::string>& lines, const std::vector<std::string>& warnings) const;
  /// Data of report.html in addition to the summary; `drawn`: with a picture of the body, for readers without
  /// WebGL.
  nlohmann::ordered_json report(const History& history, const ErrorBounds& error_bounds,
                                const ImageError& image, const std::optional<Comparison>& comparison,
                                const std::vector<Slice>& slices, const std::string& options,
                                bool drawn) const;
  /// Surface in files and pictures: its triangles, and the largest distance of the body's own surface from
  /// it.
  nlohmann::ordered_json shown_surface() const;

 private:
  struct Packing;
  // A surface as files or pictures show it.
  struct Skin {
    Surface undeformed;
    Interpolation to;
    PointMeans mises;
    Eigen::MatrixXd on_patch;  // [1 x vertices]
  };
  Skin skin_of(const std::vector<Index>& vertex, const Triangles& triangles) const;
  void take_skins();
  void write(Packing frame);
  void write_points(Packing frame, bool of_stopped = false);
  void write_view(const Packing& frame);
  std::vector<TimeSeries*> view_series();
  bool has_contact() const { return indenter_ || !further_.empty(); }
  void add_further_wrenches(const History& history, Table& force) const;
  bool is_last(double time_s) const { return time_s >= end_s_ * (1.0 - 1e-9); }
  Overview body_of(double depth, const Vec3& carried, const Vec3& aside = Vec3::Zero(),
                   const Vec3& turned = Vec3::Zero()) const;
  Vec3 axis_at(const Vec3& carried, const Vec3& aside) const;
  void place_tools(Overview& picture, const ForceSample& at) const;
  void show_largest(Overview& picture) const;
  Overview picture_of(const History& history, const ErrorBounds& error_bounds, const ImageError& image) const;

  std::filesystem::path folder_;
  const Model& model_;
  std::shared_ptr<const RigidBody> indenter_;  // null: the bonded indenter
  Requested requested_;
  bool over_time_ = false;
  bool in_parallel_;  // frames are written while the march goes on
  Section section_;
  std::vector<Rigid> further_;
  /// The tool that is measured, turned about its tip by a rotation vector [rad].
  Points tool_turned(const Vec3& turned) const;
  /// All tools as one body, where that which is measured has come by `displacement_mm` and turned.
  SurfaceFile tools_at(double time_s, const Vec3& displacement_mm, const Vec3& turned) const;
  SurfaceFile tool_;  // at rest
  Interpolation to_nodes_, to_points_, to_section_;
  PointMeans on_section_;
  Skin skin_;                  // for pictures, the report, and files unless a finer one is requested
  std::optional<Skin> whole_;  // the extracted surface, if finer and requested
  double within_mm_ = 0.0;     // how far the body's surface is from skin_ at most
  Points nodes_mm_, points_mm_;
  Eigen::MatrixXd node_flags_;
  Eigen::MatrixXd label_;  // [1 x section triangles]; empty: there is no image
  TimeSeries node_series_, point_series_, surface_series_, section_series_, tool_series_, contact_series_;
  std::vector<double> frame_time_s_;
  Points last_u_mm_;
  Points largest_u_mm_;    // over time: of the frame with the largest force so far
  ForceSample largest_{};  // likewise
  GapAt walls_;
  BodyFrames shown_;
  double end_s_, pending_time_s_ = 0.0;
  std::unique_ptr<Packing> points_left_;  // of the newest frame, while it may not be the last
  std::string body_png_;                  // for the report; empty: not drawn yet
  std::future<void> pending_;             // the last member: whoever destroys this waits for it first
};

}  // namespace dimple
