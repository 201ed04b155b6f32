#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "io/label_image.hpp"

namespace dimple {

using KeyValues = std::map<std::string, std::string>;

/// Names from 3D Slicer's keys SegmentN_Name and SegmentN_LabelValue; warns where one label has two.
std::map<int, std::string> names_from_segment_keys(const KeyValues& keys, std::vector<std::string>& warnings);

/// 3D Slicer's keys for the labels present. `extent` of each label in stored voxels follows the image's axes.
KeyValues segment_keys(const LabelImage& image);

/// Reads ITK-SNAP label descriptions or a colour table (3D Slicer .ctbl, FreeSurfer LUT). Background is left
/// out. Throws InputError naming the line.
std::map<int, std::string> read_label_names(const std::filesystem::path& file);

/// ITK-SNAP label descriptions of the labels present that have a name; empty if there are none.
std::string label_descriptions(const LabelImage& image);

}  // namespace dimple
