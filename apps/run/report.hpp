#pragma once

#include <array>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/band.hpp"
#include "apps/run/compare.hpp"
#include "io/draw/zero_pieces.hpp"
#include "io/label_image.hpp"
#include "io/vtk_files.hpp"
#include "preprocess/model.hpp"
#include "solver/march.hpp"
#include "solver/terms/touching_tool.hpp"

namespace dimple {

// report.html: one file for people, with all that it shows in it. The page itself, without numbers, is made
// in apps/report; what is filled in here are the summary, as summary.json has it, and what a summary has no
// room for.

/// A plane through a place, along two of the image's axes. Places on it are counted from its upper left
/// corner, to the right and down [mm].
struct Slice {
  std::string name;                                     ///< "axial"
  std::array<std::string, 4> letters = {};              ///< of its left, right, upper and lower side
  Eigen::Affine3d place = Eigen::Affine3d::Identity();  ///< LPS mm -> to the right, down, out of the plane
  double width_mm = 0.0, height_mm = 0.0;
  Index columns = 0, rows = 0;  ///< of the labels; 0: there is no image
  std::vector<int> label = {};  ///< [columns x rows], row by row from the top
};
/// Angle between the patient's axes and the nearest of these [degrees], whatever their order: 0 for any scan
/// that is not oblique.
double tilt_degrees(const Mat3& axes);

/// Sagittal, coronal, axial. Without an image along the model's axes, with no labels.
std::vector<Slice> slices_through(const Vec3& place_mm, const Model& model, const LabelImage& image);

/// Where a surface crosses the plane z = 0: pairs of places.
std::vector<std::array<Vec3, 2>> crossings(const Points& on_slice, const Triangles& triangles);
/// Where what is rigid does.
std::vector<std::array<Eigen::Vector2d, 2>> wall_on(const Slice& slice, const GapAt& gap);

/// The body's surface over time.
struct BodyFrames {
  struct Frame {
    std::size_t number = 0;  ///< of the run's
    double time_s = 0.0;
    Eigen::Matrix3Xf displacement_mm = {};  ///< at the vertices of the body
  };
  Surface body = {};  ///< at rest
  std::vector<Frame> frame = {};
  std::size_t every = 1;  ///< so many of the run's frames one is kept, and the last
};
/// At most so many triangles and frames are shown.
inline constexpr Index most_triangles_shown = 12'000;
inline constexpr std::size_t most_frames_shown = 60;
void keep(BodyFrames& frames, BodyFrames::Frame frame);

/// All that a page is made of, at the end of a run. What is not there is left out.
struct ReportInput {
  const Model& model;
  const SurfaceFile& tool;  ///< at rest
  const Touch* touch;       ///< of a tool that touches; else none
  const std::vector<Slice>& slices;
  const BodyFrames& frames;
  const History& history;
  const Band& band;
  const std::optional<Comparison>& comparison;
  const Points& surface_displacement_mm;  ///< [3 x its vertices] of the frames' body at the end, or none
  std::string options;                    ///< config.resolved.toml
  std::string picture;                    ///< of the body at the end: a PNG's bytes, or none
  GapAt walls = {};                       ///< at the end; empty: there are none
  bool over_time = false;                 ///< forces are shown over time, as of a scene of steps
};
/// The page but for the summary: what takes time.
nlohmann::ordered_json report_data(const ReportInput& input);
/// Throws OutputError.
void write_report(const std::filesystem::path& file, const nlohmann::ordered_json& summary,
                  const nlohmann::ordered_json& data);

/// Gives a page that is there another summary and, where it has none yet, the chart of what the force depends
/// on; does nothing where there is no page. Throws OutputError.
void amend_report(const std::filesystem::path& file, const nlohmann::ordered_json& summary,
                  const std::string& chart_svg);

}  // namespace dimple
