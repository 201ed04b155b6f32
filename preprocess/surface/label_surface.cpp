#include "preprocess/surface/label_surface.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include "io/error.hpp"
#include "io/stop.hpp"
#include "io/words.hpp"
#include "preprocess/image/voxel_set.hpp"
#include "preprocess/model.hpp"
#include "preprocess/surface/between_voxels.hpp"
#include "preprocess/surface/closed_mesh.hpp"
#include "preprocess/surface/smooth_lattice.hpp"

namespace dimple {
namespace {

constexpr double smoothing_voxels = 0.7;
constexpr double leash = 0.5;                     // lattice steps or voxels: the accuracy of the voxels
constexpr double cavity_fraction = 1.0 / 500.0;   // of the organ's volume: smaller cavities are filled
constexpr double halfway = 0.5, at_level = 1e-3;  // lattice values nearer to the level count as inside
constexpr double most_lattice_points = 64e6;
constexpr double most_triangles = 1e6;                          // beyond it a coarser lattice is used
constexpr double most_lost = 1.0 / 3.0, lost_to_report = 0.03;  // of the volume, to smoothing

// Lattice: as fine as the voxels, but no finer than affects the force. The phantom brain in voxels of 0.5 mm
// gives 0.03 % more with 64 steps across than with 89, 0.4 % less with 45.
constexpr double steps_across_organ = 100.0, steps_across_patch = 7.0, most_steps_across_organ = 250.0;

VoxelSet chosen_voxels(const LabelImage& image, const std::vector<int>& labels) {
  VoxelSet set = voxels_with(image, labels);
  if (!set.stretch.empty()) return set;
  std::string requested;
  for (const int l : labels) requested += (requested.empty() ? "" : ", ") + std::to_string(l);
  throw InputError(
      {.fact = fmt::format("no voxel has label {}", requested.empty() ? "other than 0" : requested),
       .where = "choice of labels",
       .why = "the image does not hold it",
       .remedy = "see the labels with `dimple info IMAGE` and choose with --label"});
}

bool meets_border(const VoxelSet& set, const LabelImage& image) {
  for (std::size_t d = 0; d < 3; ++d)
    if (set.first[d] + 1 == 0 || set.first[d] + set.size[d] - 1 == image.size[d]) return true;
  return false;
}

// Reports requested labels of which nothing is in the piece that is kept.
void report_dropped_labels(const LabelImage& image, const VoxelSet& kept, SegmentReport& report) {
  std::set<int> left;
  for (Index k = 0; k < kept.size[2]; ++k) {
    stop_if_requested();
    for (Index j = 0; j < kept.size[1]; ++j) {
      const auto runs = image.row(j + kept.first[1], k + kept.first[2]);
      auto run = runs.begin();
      for (const auto& [begin, end] : kept.row(j, k)) {
        while (run != runs.end() && run->end <= begin + kept.first[0]) ++run;
        for (; run != runs.end() && run->begin < end + kept.first[0]; ++run) left.insert(run->label);
      }
    }
  }
  std::vector<int> dropped;
  std::copy_if(report.labels.begin(), report.labels.end(), std::back_inserter(dropped),
               [&](int label) { return !left.contains(label); });
  if (!dropped.empty())
    report.warnings.push_back(
        fmt::format("label{} {} {} dropped completely: choose {} with --label {}; no part of it is connected "
                    "to the largest piece of the labels",
                    dropped.size() > 1 ? "s" : "", fmt::join(dropped, ", "),
                    dropped.size() > 1 ? "are" : "is", dropped.size() > 1 ? "one" : "it", dropped.front()));
}

// The largest piece, with its small cavities filled, in a box of its own: dropped voxels have no influence.
VoxelSet one_body(const LabelImage& image, const VoxelSet& set, double voxel_volume, SegmentReport& report) {
  const Pieces pieces = face_connected(set);
  const std::size_t body = largest(pieces);
  std::int64_t all = 0;
  for (const auto& piece : pieces.piece) all += piece.voxels;
  std::int64_t kept = pieces.piece[body].voxels;
  report.pieces = static_cast<int>(pieces.piece.size());
  report.label_volume_mm3 = voxel_volume * static_cast<double>(all);
  report.dropped_volume_mm3 = voxel_volume * static_cast<double>(all - kept);
  std::vector<bool> chosen(pieces.piece.size(), false);
  chosen[body] = true;

  const VoxelSet largest_piece = selection(set, pieces, chosen);
  if (report.pieces > 1) report_dropped_labels(image, largest_piece, report);
  const VoxelSet around = complement(largest_piece);
  const Pieces gaps = face_connected(around);  // the first is what surrounds the organ
  std::vector<bool> empty(gaps.piece.size(), true);
  const auto limit = cavity_fraction * static_cast<double>(kept);
  for (std::size_t g = 1; g < gaps.piece.size(); ++g) {
    const auto voxels = gaps.piece[g].voxels;
    empty[g] = static_cast<double>(voxels) >= limit;
    const Vec3 centre(gaps.piece[g].centre + Vec3(static_cast<double>(set.first[0]),
                                                  static_cast<double>(set.first[1]),
                                                  static_cast<double>(set.first[2])));
    report.cavities.push_back(
        {voxel_volume * static_cast<double>(voxels), image.to_world * centre, !empty[g]});
    if (!empty[g]) kept += voxels;
  }
  std::stable_sort(report.cavities.begin(), report.cavities.end(),
                   [](const Cavity& a, const Cavity& b) { return a.volume_mm3 > b.volume_mm3; });
  report.voxel_volume_mm3 = voxel_volume * static_cast<double>(kept);
  if (kept < 64)
    throw ModelError({.fact = fmt::format("the largest piece has {} voxels; a body needs at least 64", kept),
                      .where = "choice of labels",
                      .why = "the label is too small, or the image is too coarse for it",
                      .remedy = "choose another --label, or give a finer image"});
  return cropped(complement(selection(around, gaps, empty)));
}

void report_cavities(SegmentReport& report) {
  for (const bool filled : {false, true}) {
    std::string list;
    int count = 0;
    double volume = 0.0;
    for (const Cavity& cavity : report.cavities) {
      if (cavity.filled != filled) continue;
      volume += cavity.volume_mm3;
      if (++count <= 3)
        list += fmt::format("{}{} at {}", count > 1 ? ", " : "", volume_in_words(cavity.volume_mm3),
                            in_words(cavity.centre_mm));
    }
    if (count == 0) continue;
    if (count > 3) list += fmt::format(", and {} smaller ones", count - 3);
    report.warnings.push_back(
        filled
            ? fmt::format("{} inside the organ {} filled, {} in all ({}): {} smaller than 0.2 % of the organ",
                          count == 1 ? "one cavity" : fmt::format("{} cavities", count),
                          count == 1 ? "was" : "were", volume_in_words(volume), list,
                          count == 1 ? "it is" : "each is")
            : fmt::format("the organ has {}, {} in all ({}): kept as empty space with free walls; label its "
                          "content if it is not empty",
                          count == 1 ? "a cavity" : fmt::format("{} cavities", count),
                          volume_in_words(volume), list));
  }
}

// A rigid frame along the voxels' axes, and voxel -> that frame. Both count from the same place.
struct Frame {
  Eigen::Isometry3d to_world = Eigen::Isometry3d::Identity();
  Mat3 voxel_to_local;  // diagonal, except for sheared images
};

// Rounds to a picometre: headers in other formats, or of an image with another corner, differ in the last
// digits, and the body must not depend on those.
template <class Matrix>
Matrix rounded(const Matrix& mm) {
  return (mm.array() * 1e9).round() / 1e9;
}

Frame frame_of(const Mat3& A, const Vec3& spacing) {
  Frame frame;
  const Eigen::JacobiSVD<Mat3> svd(A * spacing.cwiseInverse().asDiagonal(),
                                   Eigen::ComputeFullU | Eigen::ComputeFullV);
  frame.to_world.linear() = svd.matrixU() * svd.matrixV().transpose();
  Mat3 L = frame.to_world.linear().transpose() * A;
  const Mat3 off_diagonal = L - Mat3(L.diagonal().asDiagonal());
  if (off_diagonal.cwiseAbs().maxCoeff() < 1e-6 * spacing.minCoeff())
    L = Mat3(Vec3(L.diagonal()).asDiagonal());
  frame.voxel_to_local = rounded(L);
  return frame;
}

// Voxel -> world for voxels counted in another order.
Eigen::Affine3d reordered(const LabelImage& image, const AxisOrder& order) {
  Eigen::Affine3d old_voxel = Eigen::Affine3d::Identity();
  for (std::size_t d = 0; d < 3; ++d) {
    const auto column = static_cast<Index>(d), old = static_cast<Index>(order.axis[d]);
    old_voxel.linear().col(column) = (order.reversed[d] ? -1.0 : 1.0) * Vec3::Unit(old);
    if (order.reversed[d])
      old_voxel.translation()[old] = static_cast<double>(image.size[static_cast<std::size_t>(old)] - 1);
  }
  return image.to_world * old_voxel;
}

// The body's own frame, and the body's voxels in its order. The origin is two voxels before the body, as in a
// phantom, and not the image's corner: the empty voxels around the body are no property of it.
Frame own_frame(const LabelImage& image, const AxisOrder& order, VoxelSet& body) {
  const Eigen::Affine3d to_world = reordered(image, order);
  Frame frame = frame_of(to_world.linear(), image.spacing()(order.axis));
  Vec3 corner;
  for (std::size_t d = 0; d < 3; ++d) {
    corner[static_cast<Index>(d)] = static_cast<double>(body.first[d] - 1);
    body.first[d] = 1;
  }
  frame.to_world.translation() = rounded(Vec3(to_world * corner));
  return frame;
}

Index voxels_in_slice(const VoxelSet& set, std::size_t axis, Index at) {
  Index count = 0;
  for (Index k = 0; k < set.size[2]; ++k)
    for (Index j = 0; j < set.size[1]; ++j) {
      if ((axis == 1 && j != at) || (axis == 2 && k != at)) continue;
      for (const auto& [begin, end] : set.row(j, k))
        count += axis > 0 ? end - begin : begin <= at && at < end;
    }
  return count;
}

// Planes on which the image cuts the body off, in the body's frame. There the body is about as wide in the
// last voxels as in those before them. A sphere that just meets the border has a third of them, a horizontal
// cylinder 0.58. The surface is half a voxel beyond the last voxels.
std::vector<BodySurface::ImageEnd> image_ends(const LabelImage& image, const VoxelSet& body,
                                              const Eigen::Isometry3d& to_world) {
  constexpr double tolerance = 0.75;  // voxels
  constexpr double as_wide = 0.7;
  std::vector<BodySurface::ImageEnd> ends;
  for (std::size_t d = 0; d < 3; ++d) {
    const auto axis = static_cast<Index>(d);
    const Vec3 along = to_world.linear().transpose() * image.to_world.linear().col(axis);
    const auto add = [&](double index, double direction) {
      const Vec3 place = to_world.inverse() * (image.to_world * Vec3(index * Vec3::Unit(axis)));
      const Vec3 out = direction * along.normalized();
      ends.push_back({out, place.dot(out), tolerance * along.norm()});
    };
    const auto is_cut = [&](Index last, Index before) {
      return static_cast<double>(voxels_in_slice(body, d, last)) >=
             as_wide * static_cast<double>(voxels_in_slice(body, d, before));
    };
    const Index last = body.size[d] - 2;  // an empty voxel is on either side
    if (body.first[d] + 1 == 0 && is_cut(1, 2)) add(-0.5, -1.0);
    if (body.first[d] + last + 1 == image.size[d] && is_cut(last, last - 1))
      add(static_cast<double>(image.size[d]) - 0.5, 1.0);
  }
  return ends;
}

// Lower bound of the step: the voxels' edge, and the memory.
double finest_step(const VoxelSet& body, const Vec3& spacing) {
  double box = 1.0;
  for (std::size_t d = 0; d < 3; ++d)
    box *= static_cast<double>(body.size[d]) * spacing[static_cast<Index>(d)];
  return std::max(spacing.minCoeff(), std::cbrt(box / most_lattice_points));
}

double lattice_step(const VoxelSet& body, const Vec3& spacing, double volume_mm3, double patch_mm) {
  const double organ = std::cbrt(volume_mm3);
  return std::max({finest_step(body, spacing),
                   std::min(organ / steps_across_organ, patch_mm / steps_across_patch),
                   organ / most_steps_across_organ});
}

// Points of the lattice above or at the level.
VoxelSet inside_of(const Lattice& lattice, double level) {
  VoxelSet set;
  for (std::size_t d = 0; d < 3; ++d) set.size[d] = lattice.n[d];
  set.offset = {0};
  const float* value = lattice.value.data();
  for (int row = 0; row < lattice.n[1] * lattice.n[2]; ++row, value += lattice.n[0]) {
    for (int i = 0; i < lattice.n[0]; ++i) {
      if (!(value[i] > level - at_level)) continue;
      const int begin = i;
      while (i < lattice.n[0] && value[i] > level - at_level) ++i;
      set.stretch.push_back({begin, i});
    }
    set.offset.push_back(set.stretch.size());
  }
  return set;
}

void set_values(Lattice& lattice, const VoxelSet& set, float to) {
  for (Index k = 0; k < set.size[2]; ++k)
    for (Index j = 0; j < set.size[1]; ++j)
      for (const auto& [begin, end] : set.row(j, k)) {
        float* row = lattice.value.data() + lattice.n[0] * (j + lattice.n[1] * k);
        std::fill(row + begin, row + end, to);
      }
}

// Leaves one piece above the level, and no small cavity below it, since smoothing cuts off specks and closes
// pockets. Values at the level are moved off it, so that no triangle of the contour is degenerate. Returns
// the number of cavities.
int keep_one_body(Lattice& lattice, double level, double smallest_cavity_points) {
  const VoxelSet inside = inside_of(lattice, level);
  if (inside.stretch.empty()) return 0;
  for (float& value : lattice.value)
    if (value > level - at_level && value < level + at_level) value = static_cast<float>(level + at_level);

  const Pieces pieces = face_connected(inside);
  std::vector<bool> specks(pieces.piece.size(), true);
  specks[largest(pieces)] = false;
  set_values(lattice, selection(inside, pieces, specks), 0.0f);
  specks.flip();

  const VoxelSet around = complement(selection(inside, pieces, specks));
  const Pieces gaps = face_connected(around);
  std::vector<bool> pocket(gaps.piece.size(), false);
  int cavities = 0;
  for (std::size_t g = 1; g < gaps.piece.size(); ++g) {
    pocket[g] = static_cast<double>(gaps.piece[g].voxels) < smallest_cavity_points;
    cavities += pocket[g] ? 0 : 1;
  }
  set_values(lattice, selection(around, gaps, pocket), 1.0f);
  return cavities;
}

// The contour of the smoothed body, in the local frame.
struct SurfaceDrawing {
  TriangleMesh surface;
  int cavities = 0;
  double added_mm3 = 0.0;  // by drawing it further out
};

SurfaceDrawing draw(const VoxelSet& body, const Frame& frame, double step, const SurfaceOptions& options,
                    SegmentReport& report) {
  const Vec3 spacing = frame.voxel_to_local.colwise().norm();
  const Vec3 sigma = options.smoothing * (0.5 * step * spacing.cwiseInverse()).cwiseMax(smoothing_voxels);
  report.step_mm = step;
  report.smoothing_mm = sigma.cwiseProduct(spacing).maxCoeff();
  Lattice lattice = smoothed(body, sigma, step * spacing.cwiseInverse());
  SurfaceDrawing drawing;
  const double smallest_cavity_points = cavity_fraction * report.voxel_volume_mm3 / (step * step * step);
  const auto in_frame = [&](TriangleMesh mesh) {
    const Points voxel = (lattice.step.asDiagonal() * mesh.vertex).colwise() + lattice.origin;
    mesh.vertex = frame.voxel_to_local * voxel;
    return mesh;
  };
  double level = halfway;
  if (options.outward_mm != 0.0) {
    // The level of the smoothed indicator at that distance from a flat border. Unlike offsets along normals,
    // a level set merges parts that grow together.
    Lattice unmoved = lattice;
    keep_one_body(unmoved, level, smallest_cavity_points);
    drawing.added_mm3 = -enclosed_volume(in_frame(contour(unmoved, level)));
    const double deviation = std::cbrt(sigma.cwiseProduct(spacing).prod());
    level = 0.5 * std::erfc(options.outward_mm / (std::sqrt(2.0) * deviation));
  }
  drawing.cavities = keep_one_body(lattice, level, smallest_cavity_points);
  drawing.surface = in_frame(contour(lattice, level));
  if (options.outward_mm != 0.0) drawing.added_mm3 += enclosed_volume(drawing.surface);
  stop_if_requested();
  return drawing;
}

// Refuses a body of which smoothing removes a third: sheets and strands of a voxel or lattice step or less.
void check_lost_volume(double enclosed_mm3, double step, SegmentReport& report) {
  const double lost = 1.0 - enclosed_mm3 / report.voxel_volume_mm3;
  const double thickness = std::max(2.0 * report.smoothing_mm, 1.5 * step);
  if (lost > most_lost)
    throw ModelError(
        {.fact = fmt::format("smoothing its surface would lose {:.0f} % of the organ's {}", 100.0 * lost,
                             volume_in_words(report.voxel_volume_mm3)),
         .where = "body surface",
         .why = fmt::format("most of it is thinner than {:.2f} mm, too thin for a smooth surface: the "
                            "smoothing is {:.2f} mm, the surface's lattice {:.2f} mm",
                            thickness, report.smoothing_mm, step),
         .remedy =
             "give an image in which the organ is at least three voxels thick, choose another --label, or, "
             "where the lattice is coarser than the voxels, a smaller --indenter-diameter",
         .code = "too-thin"});
  if (std::abs(lost) > lost_to_report)
    report.warnings.push_back(
        fmt::format("smoothing by {:.2f} mm {} {:.0f} % of the organ's volume where {} {:.2f} mm; the whole "
                    "surface is moved "
                    "evenly to keep the volume",
                    report.smoothing_mm, lost > 0.0 ? "takes" : "adds", 100.0 * std::abs(lost),
                    lost > 0.0 ? "it is thinner than about" : "gaps are narrower than about", thickness));
}

}  // namespace

SegmentedBody make_body_surface(const LabelImage& image, const std::vector<int>& labels,
                                const SurfaceOptions& options) {
  SegmentReport report;
  report.labels = labels;
  const VoxelSet chosen = chosen_voxels(image, labels);
  report.cut_by_border = meets_border(chosen, image);
  const VoxelSet in_image = one_body(
      image, chosen, frame_of(image.to_world.linear(), image.spacing()).voxel_to_local.determinant(), report);
  report_cavities(report);
  // The organ's own frame: the result does not depend on how the organ was turned in the scanner, or on its
  // place in the image.
  const AxisOrder order = own_order(in_image, image.spacing());
  VoxelSet body = reordered(in_image, order, image.size);
  const Frame frame = own_frame(image, order, body);
  const Vec3 spacing = frame.voxel_to_local.colwise().norm();
  double step = options.step_mm > 0.0
                    ? std::max(options.step_mm, finest_step(body, spacing))
                    : lattice_step(body, spacing, report.voxel_volume_mm3, options.indenter_diameter_mm);
  SurfaceDrawing drawing = draw(body, frame, step, options, report);
  TriangleMesh& surface = drawing.surface;
  for (int again = 0; again < 8 && static_cast<double>(surface.triangles.cols()) > most_triangles; ++again) {
    step *= 1.1 * std::sqrt(static_cast<double>(surface.triangles.cols()) / most_triangles);
    drawing = draw(body, frame, step, options, report);
  }
  const auto kept = std::count_if(report.cavities.begin(), report.cavities.end(),
                                  [](const Cavity& cavity) { return !cavity.filled; });
  if (drawing.cavities != kept)
    report.warnings.push_back(fmt::format(
        "smoothed by {:.2f} mm the organ has {} of more than 0.2 % of its volume, and its voxels have {}: "
        "narrow gaps "
        "or thin walls were closed or opened",
        report.smoothing_mm,
        drawing.cavities == 1 ? "one cavity" : fmt::format("{} cavities", drawing.cavities), kept));
  check_lost_volume(enclosed_volume(surface) - drawing.added_mm3, step, report);
  separate_coincident_sheets(surface);
  const double target_mm3 = report.voxel_volume_mm3 + drawing.added_mm3,
               reach_mm = leash * std::min(step, spacing.maxCoeff());
  place_between_voxels(surface, body, frame.voxel_to_local, {step, reach_mm, options.outward_mm, target_mm3});

  const double error = enclosed_volume(surface) / target_mm3 - 1.0;
  if (std::abs(error) > 1e-3)
    report.warnings.push_back(
        fmt::format("the smooth surface encloses {:.2f} % {} than the voxels: parts of the organ are "
                    "thinner than two voxels or lattice steps of {:.2f} mm",
                    100.0 * std::abs(error), error > 0.0 ? "more" : "less", step));
  if (report.cut_by_border)
    report.warnings.push_back(
        "the organ reaches the border of the image, where the scan cuts it off: the cut face is used as its "
        "surface");
  SegmentedBody result{BodySurface(std::move(surface.vertex), std::move(surface.triangles), frame.to_world),
                       std::move(report)};
  result.surface.ends_with_image(image_ends(image, in_image, frame.to_world));
  return result;
}

double facing_fraction(const BodySurface& surface, double width_mm) {
  constexpr Index most_triangles_requested = 2000;
  constexpr double lift = 0.05;  // of the width: off the triangle itself, whose neighbours may bend up to it
  const Index every = (surface.triangles().cols() + most_triangles_requested - 1) / most_triangles_requested;
  double area = 0.0, facing = 0.0;
  for (Index t = 0; t < surface.triangles().cols(); t += every) {
    stop_if_requested();
    const Vec3 middle = surface.middle_of(t), normal = surface.normal().col(t);
    const double here = surface.triangle_area()[t];
    area += here;
    if (surface.is_between(middle + lift * width_mm * normal, middle + width_mm * normal)) facing += here;
  }
  return area > 0.0 ? facing / area : 0.0;
}

}  // namespace dimple
