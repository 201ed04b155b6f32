#include "apps/studies/shift_page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "apps/run/report.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "io/draw/before_after.hpp"
#include "io/draw/picture.hpp"
#include "io/draw/zero_pieces.hpp"
#include "io/file.hpp"
#include "preprocess/output/reduce_surface.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr double most_pixels = 480.0;  // along the longer side of a plane

// Values of an image on a plane, row by row.
struct Sampled {
  Index columns = 0, rows = 0;
  std::vector<double> value;
};

Sampled sampled(const VolumeImage& image, const Slice& slice, double pixel_mm, Sampling how) {
  Sampled on;
  on.columns = std::max<Index>(1, std::lround(slice.width_mm / pixel_mm));
  on.rows = std::max<Index>(1, std::lround(slice.height_mm / pixel_mm));
  const Eigen::Affine3d to_voxel = image.grid().to_world.inverse() * slice.place.inverse();
  std::vector<float> place;
  place.reserve(static_cast<std::size_t>(3 * on.columns * on.rows));
  for (Index row = 0; row < on.rows; ++row)
    for (Index column = 0; column < on.columns; ++column) {
      const Vec3 on_plane(
          (static_cast<double>(column) + 0.5) * slice.width_mm / static_cast<double>(on.columns),
          (static_cast<double>(row) + 0.5) * slice.height_mm / static_cast<double>(on.rows), 0.0);
      for (const double x : Vec3(to_voxel * on_plane)) place.push_back(static_cast<float>(x));
    }
  const std::size_t count = place.size() / 3, size = image.bytes_per_voxel();
  std::vector<std::byte> bytes(count * size);
  image.sample(place, how, bytes.data());
  for (std::size_t k = 0; k < count; ++k) on.value.push_back(image.value_of(bytes.data() + k * size));
  return on;
}

// Grey values from black at `low` to white at `high`.
std::vector<std::uint8_t> greys(const std::vector<double>& value, double low, double high) {
  std::vector<std::uint8_t> grey;
  grey.reserve(3 * value.size());
  for (const double x : value) {
    const double fraction = high > low ? std::clamp((x - low) / (high - low), 0.0, 1.0) : 0.0;
    grey.insert(grey.end(), 3,
                static_cast<std::uint8_t>(std::isfinite(x) ? std::lround(255.0 * fraction) : 0));
  }
  return grey;
}

// Pale colours as on the page; all but the brain is grey.
std::vector<std::uint8_t> tints(const std::vector<double>& value, const std::vector<LabelMeasure>& taken) {
  constexpr std::array<std::array<std::uint8_t, 3>, 8> of_taken = {{{0xDC, 0xE6, 0xF1},
                                                                    {0xF3, 0xE2, 0xD3},
                                                                    {0xDD, 0xEB, 0xDD},
                                                                    {0xEA, 0xDF, 0xEF},
                                                                    {0xF6, 0xED, 0xCB},
                                                                    {0xD6, 0xEC, 0xEC},
                                                                    {0xF2, 0xDC, 0xE0},
                                                                    {0xE4, 0xE4, 0xD4}}};
  std::vector<std::uint8_t> colour;
  colour.reserve(3 * value.size());
  for (const double x : value) {
    const auto at = std::find_if(taken.begin(), taken.end(),
                                 [&](const LabelMeasure& label) { return label.value == std::lround(x); });
    std::array<std::uint8_t, 3> c = {0xFF, 0xFF, 0xFF};
    if (at != taken.end())
      c = of_taken[static_cast<std::size_t>(at - taken.begin()) % of_taken.size()];
    else if (std::lround(x) != 0)
      c = {0xCF, 0xCF, 0xCF};
    colour.insert(colour.end(), c.begin(), c.end());
  }
  return colour;
}

// Image that is shown, before and after the shift.
struct Shown {
  fs::path before, after;
  Sampling how = Sampling::nearest;
};

Shown shown_of(const ImageTask& task, const fs::path& folder) {
  for (const ImageTask::Warped& image : task.warped)
    if (image.how == Sampling::linear)
      return {image.file, folder / "images" / (image.name + volume_suffix(image.file)), image.how};
  const bool slicer = task.label_image.filename().string().ends_with(".seg.nrrd");
  return {task.label_image,
          folder / "images" / ("labels" + (slicer ? ".seg.nrrd" : volume_suffix(task.label_image))),
          Sampling::nearest};
}

BeforeAfter::Pieces flat(const std::vector<std::array<Vec3, 2>>& pieces) {
  BeforeAfter::Pieces result;
  for (const auto& [a, b] : pieces)
    result.push_back({Eigen::Vector2d(a.head<2>()), Eigen::Vector2d(b.head<2>())});
  return result;
}

// Largest distance of a target that is marked on its closest plane.
constexpr double near_plane_mm = 10.0;

void mark_targets(const Shifted& now, const std::vector<Vec3>& targets, const Slice& slice,
                  BeforeAfter::Plane& plane) {
  Points places(3, static_cast<Index>(targets.size()));
  for (Index k = 0; k < places.cols(); ++k) places.col(k) = targets[static_cast<std::size_t>(k)];
  const Points moved = places + now.at(places);
  for (Index k = 0; k < places.cols(); ++k) {
    const Vec3 before = slice.place * Vec3(places.col(k)), after = slice.place * Vec3(moved.col(k));
    if (std::abs(before.z()) > near_plane_mm) continue;
    plane.mark_before.emplace_back(before.head<2>());
    plane.mark_after.emplace_back(after.head<2>());
  }
}

// Common range of grey values of all planes: up to the 99th percentile, and from 0 or from a negative first
// percentile.
std::array<double, 2> window_of(const std::vector<Sampled>& planes) {
  std::vector<double> all;
  for (const Sampled& plane : planes)
    for (const double x : plane.value)
      if (std::isfinite(x) && x != 0.0) all.push_back(x);
  if (all.empty()) return {0.0, 1.0};
  std::sort(all.begin(), all.end());
  const auto at = [&](double fraction) {
    return all[static_cast<std::size_t>(fraction * static_cast<double>(all.size() - 1))];
  };
  return {std::min(at(0.01), 0.0), at(0.99)};
}

// Depth at which the planes cross below the opening; a plane at the opening may pass above the brain.
constexpr double planes_below_mm = 20.0;

std::vector<Slice> slices_of(const Shifted& now, const ShiftScene& requested) {
  Vec3 through = requested.opening.head<3>();
  for (Index k = 0; k < now.line.cols(); ++k) {
    through = now.line.col(k);
    if ((now.line.col(k) - now.line.col(0)).norm() >= planes_below_mm) break;
  }
  return slices_through(through, now.result.model, now.result.image);
}

// Ring around the opening, as a tube [mm], which the page shows in place of a tool.
SurfaceFile ring(const Vec3& centre, const Vec3& normal, double radius) {
  constexpr Index around = 48, about = 8;
  const double thick = 0.04 * radius;
  Index axis = 0;
  normal.cwiseAbs().minCoeff(&axis);
  const Vec3 u = normal.cross(Vec3::Unit(axis)).normalized(), v = normal.cross(u);
  SurfaceFile tube;
  tube.position_mm.resize(3, around * about);
  tube.triangles.resize(3, 2 * around * about);
  for (Index i = 0; i < around; ++i)
    for (Index j = 0; j < about; ++j) {
      const double a = 2.0 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(around),
                   b = 2.0 * std::numbers::pi * static_cast<double>(j) / static_cast<double>(about);
      const Vec3 out = std::cos(a) * u + std::sin(a) * v;
      tube.position_mm.col(i * about + j) =
          centre + (radius + thick * std::cos(b)) * out + thick * std::sin(b) * normal;
      const Index next = (i + 1) % around * about, same = i * about, up = (j + 1) % about;
      tube.triangles.col(2 * (same + j)) << same + j, next + j, next + up;
      tube.triangles.col(2 * (same + j) + 1) << same + j, next + up, same + up;
    }
  return tube;
}

}  // namespace

std::string before_and_after(const Shifted& now, const ShiftScene& requested, const Scene& scene,
                             const ImageTask& written, const fs::path& folder, const std::string& title,
                             std::string& reported) {
  const Shown shown = shown_of(written, folder);
  const VolumeImage before(shown.before), after(shown.after);
  const std::vector<Slice> slices = slices_of(now, requested);
  double longest = 0.0;
  for (const Slice& slice : slices) longest = std::max({longest, slice.width_mm, slice.height_mm});
  const double pixel_mm = std::max(before.grid().spacing().minCoeff(), longest / most_pixels);
  std::vector<Sampled> first, second;
  for (const Slice& slice : slices) {
    first.push_back(sampled(before, slice, pixel_mm, shown.how));
    second.push_back(sampled(after, slice, pixel_mm, shown.how));
  }
  const auto [low, high] = window_of(first);
  const auto coloured = [&, low = low, high = high](const Sampled& on) {
    return shown.how == Sampling::linear ? greys(on.value, low, high) : tints(on.value, now.result.labels);
  };
  const Surface& surface = now.result.model.surface;
  const GapAt gap = gap_to_walls(scene, now.result.loading);
  BeforeAfter picture{.title = title, .warnings = now.result.warnings, .wall = "skull"};
  for (std::size_t k = 0; k < slices.size(); ++k) {
    const Slice& slice = slices[k];
    const auto on_plane = [&](const Points& places) {
      return Points((slice.place.linear() * places).colwise() + slice.place.translation());
    };
    BeforeAfter::Plane& plane = picture.plane.emplace_back();
    plane.name = slice.name;
    plane.letters = slice.letters;
    plane.width_mm = slice.width_mm;
    plane.height_mm = slice.height_mm;
    plane.columns = first[k].columns;
    plane.rows = first[k].rows;
    plane.before = coloured(first[k]);
    plane.after = coloured(second[k]);
    plane.undeformed = flat(crossings(on_plane(surface.vertex_mm), surface.triangles));
    plane.moved = flat(crossings(on_plane(surface.vertex_mm + now.surface_mm), surface.triangles));
    plane.wall = wall_on(slice, gap);
    mark_targets(now, requested.targets, slice, plane);
  }
  reported = fmt::format(
      "{} in three planes through a point below the opening, before and after; targets within {:g} mm of a "
      "plane",
      shown.before.filename().string(), near_plane_mm);
  picture.lines = {reported};
  return before_after_png(picture);
}

nlohmann::ordered_json page_of_shift(Shifted& now, const ShiftScene& requested, const Scene& scene,
                                     const std::string& options, const std::string& command,
                                     const std::string& picture) {
  // View from above, with the opening in front.
  Model& model = now.result.model;
  const ToolPlace was = model.tool;
  model.tool = {1e-3 * requested.opening.head<3>(), -requested.up, 1e-3 * requested.opening[3]};
  const ReducedSurface reduced = reduced_surface(model.surface, model.tool, most_triangles_shown);
  BodyFrames frames;
  frames.body = {model.surface.vertex_mm(Eigen::all, reduced.vertex), reduced.triangles};
  const Points moved = now.surface_mm(Eigen::all, reduced.vertex);
  frames.frame = {{0, 0.0, Eigen::Matrix3Xf::Zero(3, moved.cols())}, {1, 1.0, moved.cast<float>()}};
  const Vec3 out = (requested.opening.head<3>() - 1e3 * model.X.rowwise().mean()).normalized();
  const SurfaceFile tool = ring(requested.opening.head<3>(), out, requested.opening[3]);
  const std::vector<Slice> slices = slices_of(now, requested);
  const std::optional<Comparison> nothing;
  const ErrorBounds error_bounds;
  nlohmann::ordered_json page = report_data({.model = model,
                                             .tool = tool,
                                             .indenter = nullptr,
                                             .slices = slices,
                                             .frames = frames,
                                             .history = now.result.history,
                                             .error_bounds = error_bounds,
                                             .comparison = nothing,
                                             .surface_displacement_mm = moved,
                                             .options = options,
                                             .picture = {},
                                             .walls = gap_to_walls(scene, now.result.loading)});
  page["command"] = command;
  page["before_after"] = "data:image/png;base64," + base64(picture);
  model.tool = was;
  return page;
}

}  // namespace dimple
