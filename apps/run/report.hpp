#pragma once

#include <array>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/compare.hpp"
#include "apps/run/error_bounds.hpp"
#include "io/draw/zero_pieces.hpp"
#include "io/label_image.hpp"
#include "io/vtk_files.hpp"
#include "preprocess/model.hpp"
#include "solver/march.hpp"
#include "solver/terms/rigid_contact.hpp"

namespace dimple {

// Report of a run: report.html is one file for people with all its data. The page itself is made in
// apps/report. The summary, as in summary.json, and the data that a summary has no room for are filled in
// here.

/// Plane through a place, along two of the image's axes. Its coordinates start at the upper left corner, to
/// the right and down [mm].
struct Slice {
  std::string name;                                     ///< "axial"
  std::array<std::string, 4> letters = {};              ///< of its left, right, upper and lower side
  Eigen::Affine3d place = Eigen::Affine3d::Identity();  ///< LPS mm -> to the right, down, normal to the plane
  double width_mm = 0.0, height_mm = 0.0;
  Index columns = 0, rows = 0;  ///< of the labels; 0: there is no image
  std::vector<int> label = {};  ///< [columns x rows], row by row from the top
};
/// Angle between the patient's axes and the nearest of these [degrees], in any order: 0 for a scan that is
/// not oblique.
double tilt_degrees(const Mat3& axes);

/// Slices: sagittal, coronal, axial. Without an image along the model's axes and without labels.
std::vector<Slice> slices_through(const Vec3& place_mm, const Model& model, const LabelImage& image);

/// Intersection of a surface with the plane z = 0: pairs of places.
std::vector<std::array<Vec3, 2>> crossings(const Points& on_slice, const Triangles& triangles);
/// Intersection of the walls with the slice.
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
  std::size_t every = 1;  ///< interval of the kept frames; the last one is kept too
};
/// Most triangles and frames of the page.
inline constexpr Index most_triangles_shown = 12'000;
inline constexpr std::size_t most_frames_shown = 60;
void keep(BodyFrames& frames, BodyFrames::Frame frame);

/// Data of a page at the end of a run. Missing parts are left out.
struct ReportInput {
  const Model& model;
  const SurfaceFile& tool;    ///< at rest
  const RigidBody* indenter;  ///< of a contacting tool; else null
  const std::vector<Slice>& slices;
  const BodyFrames& frames;
  const History& history;
  const ErrorBounds& error_bounds;
  const std::optional<Comparison>& comparison;
  const Points& surface_displacement_mm;  ///< [3 x vertices of the frames' body] at the end, or none
  std::string options;                    ///< config.resolved.toml
  std::string picture;                    ///< of the body at the end: bytes of a PNG, or none
  GapAt walls = {};                       ///< at the end; empty: there are none
  bool over_time = false;                 ///< show forces over time, as for a scene of steps
};
/// Data of the page without the summary; this is the slow part.
nlohmann::ordered_json report_data(const ReportInput& input);
/// Throws OutputError.
void write_report(const std::filesystem::path& file, const nlohmann::ordered_json& summary,
                  const nlohmann::ordered_json& data);

/// Replaces the summary of a page and adds the chart of what the force depends on, unless it has one. Does
/// nothing without a page. Throws OutputError.
void amend_report(const std::filesystem::path& file, const nlohmann::ordered_json& summary,
                  const std::string& chart_svg);

}  // namespace dimple
