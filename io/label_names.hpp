#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "io/label_image.hpp"

namespace dimple {

using KeyValues = std::map<std::string, std::string>;

/// Names from 3D Slicer's keys SegmentN_Name and SegmentN_LabelValue; warns where one label has two.
std::map<int, std::string> names_from_segment_keys(const KeyValues& keys, std::vector<std::string>& warnings);

/// "'liver' in layer 0, 'tumour' in layer 1", from 3D Slicer's keys SegmentN_Name and SegmentN_Layer; empty
/// if there are none.
std::string layers_from_segment_keys(const KeyValues& keys);

/// 3D Slicer's keys for the labels present. `extent` of each label in stored voxels follows the image's axes.
KeyValues segment_keys(const LabelImage& image);

/// Names by label number, and what a user should know about them.
struct LabelTable {
  std::map<int, std::string> names;
  std::vector<std::string> warnings;
};

/// Reads ITK-SNAP label descriptions, a colour table (3D Slicer .ctbl, FreeSurfer LUT) or 3D Slicer's newer
/// tables with commas (columns LabelValue, Name or Type_CodeMeaning). Background is left out. Throws
/// InputError naming the line.
LabelTable read_label_names(const std::filesystem::path& file);

/// A numbering that needs no file: "totalsegmentator" (its CT task `total`; also "totalsegmentator-ct") or
/// "totalsegmentator-mr" (`total_mr`), of version 2, or "freesurfer" (aseg, aparc+aseg, wmparc).
std::optional<LabelTable> known_label_names(const std::string& word);

/// A label of that name in these numberings, for instance "label 5 of totalsegmentator"; empty: none has it.
std::string numbering_with(const std::string& label_name);

/// A sentence if the labels of the image would have other names in a related numbering and nothing decides
/// between them; else empty.
std::string other_numbering(const std::string& word, const LabelImage& image);

/// ITK-SNAP label descriptions of the labels present that have a name; empty if there are none.
std::string label_descriptions(const LabelImage& image);

}  // namespace dimple
