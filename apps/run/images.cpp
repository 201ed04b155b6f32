#include "apps/run/images.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "apps/run/results.hpp"
#include "apps/run/stopwatch.hpp"
#include "io/digits.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "preprocess/output/section.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr Index voxels_at_once = 2'000'000;
constexpr double most_outside = 0.5, much_outside = 0.1;  // of the body at rest: refused; warned of

// Rounds to a micrometre, and to four digits: further digits have no meaning and fill most of a packed file.
float rounded_mm(float x) {
  return std::nearbyint(x * 1024.0f) / 1024.0f;
}
float with_four_digits(float x) {
  return std::bit_cast<float>((std::bit_cast<std::uint32_t>(x) + 0x400u) & ~0x7FFu);
}

// "patient.nii.gz" -> "patient"
std::string stem_of(const fs::path& file) {
  std::string stem = file.filename().string();
  for (const std::string suffix :
       {".gz", ".nii", ".seg.nrrd", ".nrrd", ".nhdr", ".mha", ".mhd", ".hdr", ".img"})
    if (stem.size() > suffix.size() && stem.ends_with(suffix)) stem.resize(stem.size() - suffix.size());
  return stem;
}

// A segmentation of 3D Slicer keeps its suffix.
std::string suffix_of_labels(const fs::path& file) {
  return file.filename().string().ends_with(".seg.nrrd") ? ".seg.nrrd" : volume_suffix(file);
}

// Voxel whose label a voxel at place X gets, if it is not the nearest one; else -1. At the body's border the
// smooth surface decides. The staircase of voxels moves by whole voxels only, and would lose bulges below
// half a voxel. If the surface is between X and the nearest voxel's centre, that label is not used. A voxel
// that has not moved keeps its label.
Index at_border(const VoxelGrid& grid, const std::vector<char>& body, const DeformationMap& map,
                const Vec3& X, Index own) {
  const Eigen::Matrix<Index, 3, 1> nearest = (X.array() + 0.5).floor().cast<Index>();
  for (Index a = 0; a < 3; ++a)
    if (nearest[a] < 0 || nearest[a] >= grid.size[static_cast<std::size_t>(a)]) return -1;
  const auto number = [&](const Eigen::Matrix<Index, 3, 1>& at) {
    return at[0] + grid.size[0] * (at[1] + grid.size[1] * at[2]);
  };
  const Index there = number(nearest);
  const bool is_body = body[static_cast<std::size_t>(there)];
  Index best = -1;
  double least = 0.0;
  for (Index k = -1; k <= 1; ++k)
    for (Index j = -1; j <= 1; ++j)
      for (Index i = -1; i <= 1; ++i) {
        const Eigen::Matrix<Index, 3, 1> at = nearest + Eigen::Matrix<Index, 3, 1>(i, j, k);
        bool in_image = true;
        for (Index a = 0; a < 3; ++a)
          in_image = in_image && at[a] >= 0 && at[a] < grid.size[static_cast<std::size_t>(a)];
        if (!in_image || static_cast<bool>(body[static_cast<std::size_t>(number(at))]) == is_body) continue;
        const double away = (at.cast<double>() - X).squaredNorm();
        if (best < 0 || away < least) best = number(at), least = away;
      }
  if (best < 0 || (there == own && (X - nearest.cast<double>()).squaredNorm() == 0.0)) return -1;
  const std::optional<bool> inside = map.inside_near_surface(X);
  if (!inside || *inside == is_body) return -1;
  return map.inside_near_surface(nearest.cast<double>()) == is_body ? best : -1;
}

Vec3 last_voxel(const VoxelGrid& grid) {
  return {static_cast<double>(grid.size[0] - 1), static_cast<double>(grid.size[1] - 1),
          static_cast<double>(grid.size[2] - 1)};
}

// Largest distance between the corresponding corners of two grids [mm].
double distance_between(const VoxelGrid& one, const VoxelGrid& other) {
  double largest = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 at = Vec3(corner & 1, corner >> 1 & 1, corner >> 2).cwiseProduct(last_voxel(one));
    largest = std::max(largest, (one.to_world * at - other.to_world * at).norm());
  }
  return largest;
}

// Fraction of the vertices of the surface at rest that are outside of the grid.
double fraction_outside(const VoxelGrid& grid, const Surface& surface) {
  const Points place = grid.to_world.inverse() * surface.vertex_mm;
  const Vec3 last = last_voxel(grid);
  const auto outside = std::count_if(place.colwise().begin(), place.colwise().end(), [&](const auto& x) {
    return (x.array() < 0.0).any() || (x.array() > last.array()).any();
  });
  return static_cast<double>(outside) / static_cast<double>(std::max<Index>(1, place.cols()));
}

}  // namespace

ImageTask requested_images(const Scene& scene) {
  const Scene::Output& output = scene.output;
  ImageTask task;
  task.each_frame = output.write_frames == "all";
  const bool images = requested_by(scene).images;
  if (images && scene.image.file.empty())
    throw UsageError(
        {.fact = "images on the grid of the label image are requested, and the label image is in memory",
         .where = "--write images (output.write)",
         .why = "they are written as its file is: in its format, on its stored axes",
         .remedy = "begin with a file of it, or name an image of the patient with --warp"});
  if (images) task.label_image = scene.image.file;
  std::optional<VoxelGrid> labels;
  if (!scene.image.file.empty() && !(output.warp.empty() && output.warp_labels.empty())) {
    try {
      labels = VolumeImage(scene.image.file).grid();
    } catch (const InputError&) {  // a file of several layers, as segmentations may be
    }
  }
  std::set<std::string> names;
  const auto add = [&](const std::vector<std::string>& files, Sampling how) {
    for (const std::string& file : files) {
      const std::string name = "warped_" + stem_of(file);
      if (!names.insert(name).second)
        throw UsageError({.fact = fmt::format("two images to be warped are called {}", stem_of(file)),
                          .where = "--warp, --warp-labels (output.warp, output.warp_labels)",
                          .why = "the results have their names, and one would replace the other",
                          .remedy = "give one of them another name, or warp it in a run of its own"});
      try {
        const VoxelGrid grid = VolumeImage(file).grid();
        const bool is_twin = labels && labels->size == grid.size;
        task.warped.push_back({file, how, name, grid, is_twin ? distance_between(grid, *labels) : 0.0});
      } catch (const InputError& error) {
        Report report = error.report;
        report.where =
            fmt::format("{}: {}", how == Sampling::linear ? "--warp" : "--warp-labels", report.where);
        throw InputError(std::move(report));
      }
    }
  };
  add(output.warp, Sampling::linear);
  add(output.warp_labels, Sampling::nearest);
  if (task.each_frame && !task.any())
    throw UsageError({.fact = "images of each frame are requested, but no images",
                      .where = "--write-frames (output.write_frames)",
                      .why = "it selects the frames for --write images and --warp",
                      .remedy = "add --write all,images or --warp IMAGE, or leave it out"});
  return task;
}

void require_overlap(const ImageTask& task, const Discretisation& body) {
  if (task.any() && body.surface.empty())
    throw InputError({.fact = "images are requested, and the model has no surface",
                      .where = "--warp (output.warp)",
                      .why = "the surface determines which voxels are inside the body",
                      .remedy = "make the model by dimple model, which writes surface.vtp"});
  for (const ImageTask::Warped& image : task.warped) {
    const double outside = fraction_outside(image.grid, body.surface);
    if (outside <= most_outside) continue;
    const Points corners =
        image.grid.to_world * (Points(3, 2) << Vec3::Zero(), last_voxel(image.grid)).finished();
    const auto in_words = [](const Vec3& x) {
      return fmt::format("({:.4g}, {:.4g}, {:.4g})", x[0], x[1], x[2]);
    };
    throw InputError(
        {.fact = outside < 1.0
                     ? fmt::format("{} of the body is outside of {}", percent(outside), image.file.string())
                     : fmt::format("{} does not overlap the body", image.file.string()),
         .where = "--warp (output.warp)",
         .why = fmt::format("it extends from {} to {} mm, and the body from {} to {} mm (LPS)",
                            in_words(corners.rowwise().minCoeff()), in_words(corners.rowwise().maxCoeff()),
                            in_words(1e3 * body.X.rowwise().minCoeff()),
                            in_words(1e3 * body.X.rowwise().maxCoeff())),
         .remedy =
             "give an image of the same patient in the same coordinates; register it first if it is not",
         .code = "no-overlap"});
  }
}

ImageWriter::ImageWriter(ImageTask task, fs::path folder, const Model& model, std::vector<int> labels,
                         ImageFacts::Cut cut)
    : task_(std::move(task)),
      folder_(std::move(folder) / "images"),
      model_(model),
      labels_(std::move(labels)),
      cut_(std::move(cut)) {}
ImageWriter::~ImageWriter() = default;

void ImageWriter::keep(const Frame& frame) {
  frame_ = frame.number;
  u_ = frame.u.topRows<3>();
  const PointStress stress = stress_at_points(frame);
  mises_ = stress.mises.row(0);
  deformed_mm3_ = 1e9 * stress.J.row(0).transpose().dot(model_.volume);
}

fs::path ImageWriter::file_of(const std::string& name, const std::string& suffix) const {
  return folder_ / (task_.each_frame ? fmt::format("{}_{:04}{}", name, frame_, suffix) : name + suffix);
}

// Images of one grid.
struct ImageWriter::Group {
  VoxelGrid grid;
  const VolumeImage* labels = nullptr;  // if it has this grid
  std::vector<const ImageTask::Warped*> warped = {};
};

void ImageWriter::write() {
  const Stopwatch watch;
  if (!field_) field_ = std::make_unique<FieldAnywhere>(model_);
  make_folder(folder_);
  inverse_report_ = {};
  written_.clear();
  std::vector<Group> groups;
  std::optional<VolumeImage> labels;
  if (!task_.label_image.empty()) {
    labels.emplace(task_.label_image);
    take_out_what_was_cut(*labels);
    groups.push_back({.grid = labels->grid(), .labels = &*labels});
  }
  for (const ImageTask::Warped& image : task_.warped) {
    const auto same = std::find_if(groups.begin(), groups.end(),
                                   [&](const Group& group) { return group.grid == image.grid; });
    Group& group = same != groups.end() ? *same : groups.emplace_back(Group{.grid = image.grid});
    group.warped.push_back(&image);
  }
  for (const Group& group : groups) write_group(group);
  seconds_ += watch.seconds();
  const auto& n = groups.front().grid.size;
  reported_ = fmt::format("{} files on {} x {} x {} voxels, {:.1f} s", written_.size(), n[0], n[1], n[2],
                          watch.seconds());
  if (!task_.label_image.empty())
    reported_ += fmt::format("; labels {}, {} at rest, the deformed body {}", volume_in_words(labels_mm3_),
                             volume_in_words(undeformed_labels_mm3_), volume_in_words(deformed_mm3_));
}

VolumeWriter ImageWriter::begun(const fs::path& file, const VoxelGrid& grid, const VolumeKind& kind) {
  written_.push_back((fs::path("images") / file.filename()).string());
  return VolumeWriter(file, grid, kind);
}

// Displacement and stress of the tissue, in the voxels that it fills at rest.
void ImageWriter::write_fields(const VoxelGrid& grid, const DeformationMap& map) {
  const auto slice = static_cast<std::size_t>(grid.slice());
  const std::string suffix = volume_suffix(task_.label_image);
  std::vector<VolumeWriter> out;
  out.push_back(begun(file_of("displacement_mm", suffix), grid, {.components = 3, .meaning = "modeling"}));
  out.push_back(begun(file_of("jacobian", suffix), grid, {}));
  out.push_back(begun(file_of("von_mises_Pa", suffix), grid, {}));
  std::vector<float> u(3 * slice), jacobian(slice), mises(slice);
  std::vector<char> inside(slice);
  for (Index k = 0; k < grid.size[2]; ++k) {
    map.displacement(k, u, jacobian);
    map.inside(k, inside);
    std::vector<std::size_t> voxel;
    for (std::size_t v = 0; v < slice; ++v)
      if (inside[v]) voxel.push_back(v);
    Points places(3, static_cast<Index>(voxel.size()));
    for (std::size_t m = 0; m < voxel.size(); ++m) {
      const auto v = static_cast<Index>(voxel[m]);
      const Vec3 x(static_cast<double>(v % grid.size[0]), static_cast<double>(v / grid.size[0]),
                   static_cast<double>(k));
      places.col(static_cast<Index>(m)) = 1e-3 * (grid.to_world * x);
    }
    const Eigen::RowVectorXd means = make_point_means(model_.point, places)(mises_);
    std::fill(mises.begin(), mises.end(), 0.0f);
    for (std::size_t m = 0; m < voxel.size(); ++m) {
      mises[voxel[m]] = with_four_digits(static_cast<float>(means[static_cast<Index>(m)]));
      jacobian[voxel[m]] = with_four_digits(jacobian[voxel[m]]);
    }
    std::transform(u.begin(), u.end(), u.begin(), &rounded_mm);
    out[0].write(u);
    out[1].write(jacobian);
    out[2].write(mises);
  }
  for (VolumeWriter& writer : out) writer.finish();
}

// One file on the deformed grid: a warped image, or the transform itself if `image` is null.
struct ImageWriter::Target {
  const VolumeImage* image;
  Sampling how;
  VolumeWriter out;
};

std::vector<ImageWriter::Target> ImageWriter::targets_of(const Group& group, std::list<VolumeImage>& images) {
  std::vector<Target> targets;
  if (group.labels) {
    const std::string suffix = volume_suffix(task_.label_image);
    targets.push_back(
        {nullptr, Sampling::nearest,
         begun(file_of("transform", suffix), group.grid, {.components = 3, .meaning = "resampling"})});
    targets.push_back(
        {group.labels, Sampling::nearest,
         begun(file_of("labels", suffix_of_labels(task_.label_image)), group.grid, {.like = group.labels})});
  }
  for (const ImageTask::Warped* image : group.warped) {
    const VolumeImage& read = images.emplace_back(image->file);
    if (!(read.grid() == group.grid))
      throw InputError({.fact = fmt::format("{} has changed", image->file.string()),
                        .where = "images",
                        .why = "another program has written to it during this run",
                        .remedy = "run it again"});
    targets.push_back(
        {&read, image->how,
         begun(file_of(image->name, suffix_of_labels(image->file)), group.grid, {.like = &read})});
  }
  return targets;
}

bool ImageWriter::is_body(std::int64_t label) const {
  return label != 0 && (labels_.empty() || std::find(labels_.begin(), labels_.end(), label) != labels_.end());
}

void ImageWriter::take_out_what_was_cut(VolumeImage& labels) const {
  if (cut_.labels.empty() && !cut_.took) return;
  const VoxelGrid& grid = labels.grid();
  tbb::parallel_for(Index{0}, grid.size[1] * grid.size[2], [&](Index row) {
    if (row % 16 == 0) stop_if_requested();
    for (Index i = 0; i < grid.size[0]; ++i) {
      const Index v = i + grid.size[0] * row;
      const std::int64_t label = labels.label_of(labels.voxel(v));
      if (label == 0) continue;
      const Vec3 at(static_cast<double>(i), static_cast<double>(row % grid.size[1]),
                    static_cast<double>(row / grid.size[1]));
      const bool is_cut_out = std::any_of(cut_.labels.begin(), cut_.labels.end(),
                                          [&](const LabelMeasure& m) { return m.value == label; });
      if (is_cut_out || (cut_.took && is_body(label) && cut_.took(grid.to_world * at))) labels.set_to_zero(v);
    }
  });
}

// Mask of the body, for each voxel of a label image.
std::vector<char> ImageWriter::body_of(const VolumeImage& labels, const VoxelGrid& grid) const {
  std::vector<char> body(static_cast<std::size_t>(grid.voxels()));
  tbb::parallel_for(Index{0}, grid.size[1] * grid.size[2], [&](Index row) {
    if (row % 256 == 0) stop_if_requested();
    for (Index v = row * grid.size[0]; v < (row + 1) * grid.size[0]; ++v)
      body[static_cast<std::size_t>(v)] = is_body(labels.label_of(labels.voxel(v)));
  });
  return body;
}

std::int64_t ImageWriter::voxels_of_body(const VolumeImage& image, const std::byte* number, Index n) const {
  // In a run of equal labels the first alone is looked up.
  const std::size_t width = image.bytes_per_voxel();
  std::int64_t sum = 0;
  bool in_body = false;
  for (Index v = 0; v < n; ++v, number += width) {
    if (v == 0 || !std::equal(number, number + width, number - width))
      in_body = is_body(image.label_of(number));
    sum += in_body;
  }
  return sum;
}

namespace {

// Slices of a grid, and the places at rest of what their voxels show [3 x voxels, in voxels].
struct Slices {
  const VoxelGrid& grid;
  Index first, last;
  std::span<const float> places;
  Index rows() const { return (last - first) * grid.size[1]; }
};

// Vectors from each voxel to its place at rest [3 x voxels, mm LPS].
std::vector<float> displacements_to_reference(const Slices& of) {
  std::vector<float> vectors(of.places.size());
  const Eigen::Matrix3f axes = of.grid.to_world.linear().cast<float>();
  tbb::parallel_for(Index{0}, of.rows(), [&](Index row) {
    for (Index i = 0; i < of.grid.size[0]; ++i) {
      const Index v = i + of.grid.size[0] * row;
      const Eigen::Map<const Eigen::Vector3f> X(of.places.data() + 3 * v);
      const Eigen::Vector3f x(static_cast<float>(i), static_cast<float>(row % of.grid.size[1]),
                              static_cast<float>(of.first + row / of.grid.size[1]));
      Eigen::Map<Eigen::Vector3f>(vectors.data() + 3 * v) = (axes * (X - x)).unaryExpr(&rounded_mm);
    }
  });
  return vectors;
}

std::vector<std::byte> warped(const VolumeImage& image, Sampling how, const Slices& of) {
  const std::size_t width = image.bytes_per_voxel(), length = static_cast<std::size_t>(of.grid.size[0]);
  std::vector<std::byte> voxels(static_cast<std::size_t>(of.rows()) * length * width);
  tbb::parallel_for(Index{0}, of.rows(), [&](Index row) {
    const std::size_t begin = static_cast<std::size_t>(row) * length;
    image.sample(of.places.subspan(3 * begin, 3 * length), how, voxels.data() + width * begin);
  });
  return voxels;
}

void follow_surface(const VolumeImage& labels, const std::vector<char>& body, const DeformationMap& map,
                    const Slices& of, std::vector<std::byte>& voxels) {
  const std::size_t width = labels.bytes_per_voxel();
  tbb::parallel_for(Index{0}, of.rows(), [&](Index row) {
    if (row % 64 == 0) stop_if_requested();
    for (Index v = row * of.grid.size[0]; v < (row + 1) * of.grid.size[0]; ++v) {
      const float* X = of.places.data() + 3 * v;
      const Index own = of.first * of.grid.slice() + v;
      if (const Index other = at_border(of.grid, body, map, Vec3(X[0], X[1], X[2]), own); other >= 0)
        std::copy_n(labels.voxel(other), width, voxels.data() + width * static_cast<std::size_t>(v));
    }
  });
}

}  // namespace

void ImageWriter::write_group(const Group& group) {
  const VoxelGrid& grid = group.grid;
  const DeformationMap map(model_, *field_, u_, grid);
  if (group.labels || task_.label_image.empty())
    fraction_beyond_ = std::max(fraction_beyond_, map.fraction_beyond());
  if (group.labels) write_fields(grid, map);

  std::list<VolumeImage> images;
  std::vector<Target> targets = targets_of(group, images);
  const std::vector<char> body = group.labels ? body_of(*group.labels, grid) : std::vector<char>{};
  const Index together = std::clamp<Index>(voxels_at_once / grid.slice(), 1, grid.size[2]);
  std::vector<float> place(3 * static_cast<std::size_t>(grid.slice() * together));
  std::int64_t counted = 0, counted_undeformed = 0;
  for (Index first = 0; first < grid.size[2]; first += together) {
    const Index last = std::min(first + together, grid.size[2]), now = (last - first) * grid.slice();
    const std::span<float> places(place.data(), 3 * static_cast<std::size_t>(now));
    inverse_report_.add(map.reference_places(first, last, places));
    const Slices slices{grid, first, last, places};
    for (Target& target : targets) {
      stop_if_requested();
      if (!target.image) {
        target.out.write(displacements_to_reference(slices));
        continue;
      }
      std::vector<std::byte> voxels = warped(*target.image, target.how, slices);
      if (target.image == group.labels) {
        follow_surface(*group.labels, body, map, slices, voxels);
        counted += voxels_of_body(*group.labels, voxels.data(), now);
        counted_undeformed += voxels_of_body(*group.labels, group.labels->voxel(first * grid.slice()), now);
      }
      target.out.write(voxels);
    }
  }
  for (Target& target : targets) target.out.finish();
  if (!group.labels) return;
  labels_mm3_ = static_cast<double>(counted) * grid.voxel_volume();
  undeformed_labels_mm3_ = static_cast<double>(counted_undeformed) * grid.voxel_volume();
}

std::string ImageWriter::warning() const {
  std::string text;
  if (fraction_beyond_ > 0.0)
    text = fmt::format("{} of the deformed surface is outside of the image grid", percent(fraction_beyond_));
  for (const ImageTask::Warped& image : task_.warped) {
    const double outside = fraction_outside(image.grid, model_.surface);
    const bool is_moved = image.from_labels_mm > 1e-3 * image.grid.spacing().minCoeff();
    if (!is_moved && outside < much_outside) continue;
    if (!text.empty()) text += "; ";
    text += image.file.filename().string();
    if (is_moved)
      text +=
          fmt::format(" has as many voxels as the label image, {:.3g} mm away from it", image.from_labels_mm);
    if (outside >= much_outside)
      text +=
          fmt::format("{} {} of the body at rest outside", is_moved ? " and" : " leaves", percent(outside));
  }
  if (100 * inverse_report_.unsettled > inverse_report_.solved)
    text += fmt::format(
        "{}{} of the images' voxels at the body show the nearest place at rest, not the exact one: the "
        "tissue is folded there",
        text.empty() ? "" : "; ",
        percent(static_cast<double>(inverse_report_.unsettled) /
                static_cast<double>(inverse_report_.solved)));
  return text;
}

nlohmann::ordered_json ImageWriter::summary() const {
  nlohmann::ordered_json json;
  json["wall_s"] = seconds_;
  json["files"] = written_;
  if (!task_.label_image.empty()) {
    json["labels_at_rest_mm3"] = undeformed_labels_mm3_;
    json["labels_mm3"] = labels_mm3_;
  }
  json["deformed_mm3"] = deformed_mm3_;
  json["moved_voxels"] = inverse_report_.moved;
  json["solved_voxels"] = inverse_report_.solved;
  json["unsettled_voxels"] = inverse_report_.unsettled;
  json["folded_voxels"] = inverse_report_.folded;
  json["largest_residual_voxels"] = inverse_report_.largest_residual;
  json["surface_beyond_the_image"] = fraction_beyond_;
  return json;
}

}  // namespace dimple
