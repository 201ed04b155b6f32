#pragma once

#include <filesystem>
#include <list>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/run/simulate.hpp"
#include "apps/scene/scene.hpp"
#include "io/volume_image.hpp"
#include "preprocess/output/deformation_map.hpp"
#include "solver/march.hpp"

namespace dimple {

// Images of a run on the grids of its input images: the folder `images` of its results.

/// Images that are requested.
struct ImageTask {
  std::filesystem::path label_image;  ///< whose grid displacement, labels and stress use; empty: none of them
  struct Warped {
    std::filesystem::path file;
    Sampling how;
    std::string name;  ///< "warped_mri"
    VoxelGrid grid;
    double from_labels_mm =
        0.0;  ///< distance from the label image's grid, if the number of voxels is the same
  };
  std::vector<Warped> warped;
  bool each_frame = false;  ///< false: the last frame only

  bool any() const { return !label_image.empty() || !warped.empty(); }
};

/// Reads every image to its end, so that nothing is computed for an unreadable one. Throws UsageError,
/// InputError.
ImageTask requested_images(const Scene& scene);
/// Throws InputError: more than half of the body is outside of an image to be warped, or the model has no
/// surface that bounds it.
void require_overlap(const ImageTask& task, const Discretisation& body);

/// Writer of these images, frame by frame.
class ImageWriter {
 public:
  /// `model` must outlive this, and its discretisation must not change. `labels`: those of the body; none:
  /// all. Removed tissue is background in the deformed labels.
  ImageWriter(ImageTask task, std::filesystem::path folder, const Model& model, std::vector<int> labels,
              ImageFacts::Cut cut);
  ~ImageWriter();

  bool each_frame() const { return task_.each_frame; }
  /// Keeps a frame, which may be written later.
  void keep(const Frame& frame);
  /// Writes the images of the frame kept last. Throws OutputError, InputError, Stopped.
  void write();
  /// Files written last, in a line; empty: none yet.
  const std::string& reported() const { return reported_; }
  /// Warning of what is unexpected in them, in a sentence; empty: nothing.
  std::string warning() const;
  nlohmann::ordered_json summary() const;
  double seconds() const { return seconds_; }

 private:
  struct Group;
  struct Target;
  void write_group(const Group& group);
  void write_fields(const VoxelGrid& grid, const DeformationMap& map);
  std::vector<Target> targets_of(const Group& group, std::list<VolumeImage>& images);
  VolumeWriter begun(const std::filesystem::path& file, const VoxelGrid& grid, const VolumeKind& kind);
  bool is_body(std::int64_t label) const;
  void take_out_what_was_cut(VolumeImage& labels) const;
  std::vector<char> body_of(const VolumeImage& labels, const VoxelGrid& grid) const;
  std::int64_t voxels_of_body(const VolumeImage& image, const std::byte* number, Index n) const;
  std::filesystem::path file_of(const std::string& name, const std::string& suffix) const;

  ImageTask task_;
  std::filesystem::path folder_;
  const Model& model_;
  std::vector<int> labels_;
  ImageFacts::Cut cut_;
  std::unique_ptr<FieldAnywhere> field_;

  int frame_ = -1;
  Points u_;                  // [3xN] m
  Eigen::RowVectorXd mises_;  // [Q] Pa
  double deformed_mm3_ = 0.0;

  std::vector<std::string> written_;
  InverseMapReport inverse_report_;
  double undeformed_labels_mm3_ = 0.0, labels_mm3_ = 0.0, fraction_beyond_ = 0.0;
  std::string reported_;
  double seconds_ = 0.0;
};

}  // namespace dimple
