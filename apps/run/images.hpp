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

// Images that a run writes on the grids of its input images: the folder `images` of its results.

/// What was asked for.
struct ImageTask {
  std::filesystem::path
      label_image;  ///< on whose grid displacement, labels and stress are; empty: none of them
  struct Warped {
    std::filesystem::path file;
    Sampling how;
    std::string name;  ///< "warped_mri"
    VoxelGrid grid;
    double from_labels_mm =
        0.0;  ///< where it has as many voxels as the label image: how far it is from there
  };
  std::vector<Warped> warped;
  bool each_frame = false;  ///< else the last alone

  bool any() const { return !label_image.empty() || !warped.empty(); }
};

/// Reads every image to its end, so that nothing is computed for one that cannot be read. Throws
/// UsageError, InputError.
ImageTask images_asked_for(const Scene& scene);
/// Throws InputError: more than half of the body lies outside of an image to be warped; or the model has no
/// surface, and so no inside.
void require_overlap(const ImageTask& task, const Discretisation& body);

/// Writes them, of one frame after the other.
class ImageWriter {
 public:
  /// `model` must outlive this, and its discretisation must not change. `labels`: those that are the body;
  /// none: all. What was cut out is background in the deformed labels.
  ImageWriter(ImageTask task, std::filesystem::path folder, const Model& model, std::vector<int> labels,
              ImageFacts::Cut cut);
  ~ImageWriter();

  bool each_frame() const { return task_.each_frame; }
  /// To be written later, or never.
  void keep(const Frame& frame);
  /// Of the frame kept last. Throws OutputError, InputError, Stopped.
  void write();
  /// What was written last, in a line; empty: nothing yet.
  const std::string& told() const { return told_; }
  /// What of it is not as one might expect, in a sentence; empty: nothing.
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
  WayBackReport way_back_;
  double labels_at_rest_mm3_ = 0.0, labels_mm3_ = 0.0, share_beyond_ = 0.0;
  std::string told_;
  double seconds_ = 0.0;
};

}  // namespace dimple
