#include "io/label_names.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/text.hpp"

namespace dimple {
namespace {

/// The whole text as an integer.
std::optional<int> integer(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// A name that is valid in every later file and terminal: one line of UTF-8 (else it is read as Latin-1).
std::string clean_name(const std::string& name) {
  std::string text;
  for (std::size_t n = 0; n < name.size();) {
    const auto lead = static_cast<unsigned char>(name[n]);
    std::size_t length = lead < 0x80 ? 1 : lead >> 5 == 6 ? 2 : lead >> 4 == 14 ? 3 : lead >> 3 == 30 ? 4 : 0;
    for (std::size_t b = 1; b < length; ++b)
      if (n + b >= name.size() || (static_cast<unsigned char>(name[n + b]) & 0xC0) != 0x80) length = 0;
    if (length == 0) {
      text += static_cast<char>(0xC0 | lead >> 6);
      text += static_cast<char>(0x80 | (lead & 0x3F));
    } else {
      text += lead < 0x20 || lead == 0x7F ? std::string(1, ' ') : name.substr(n, length);
    }
    n += std::max<std::size_t>(length, 1);
  }
  return text;
}

/// Well separated colours that depend on the label's number alone: hues a golden angle apart.
std::array<int, 3> colour_of(int label) {
  const double hue = std::fmod(0.61803398874989485 * label, 1.0) * 6.0;
  std::array<int, 3> rgb{};
  for (int c = 0; c < 3; ++c) {
    const double distance =
        std::abs(std::fmod(hue + 2.0 * (3 - c), 6.0) - 3.0);  // 3 at the channel's own hue
    rgb[static_cast<std::size_t>(c)] = static_cast<int>(64.0 + 176.0 * std::clamp(distance - 1.0, 0.0, 1.0));
  }
  return rgb;
}

/// Extent of each label present: first and last voxel along i, j, k.
std::map<int, std::array<Index, 6>> extents(const LabelImage& image) {
  std::map<int, std::array<Index, 6>> extent;
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j)
      for (const Run& run : image.row(j, k)) {
        const Index i = run.begin, last = run.end - 1;
        auto& e = extent.try_emplace(run.label, std::array<Index, 6>{i, last, j, j, k, k}).first->second;
        e = {std::min(e[0], i), std::max(e[1], last), std::min(e[2], j),
             std::max(e[3], j), std::min(e[4], k),    std::max(e[5], k)};
      }
  return extent;
}

// The numbering of TotalSegmentator (Wasserthal et al. 2023, D'Antonoli et al. 2025) from version 2 on, label
// 1 first: its tasks `total`, for CT, and `total_mr`. Published with it under Apache-2.0.
constexpr std::string_view totalsegmentator_ct =
    "spleen kidney_right kidney_left gallbladder liver stomach pancreas adrenal_gland_right "
    "adrenal_gland_left lung_upper_lobe_left lung_lower_lobe_left lung_upper_lobe_right "
    "lung_middle_lobe_right lung_lower_lobe_right esophagus trachea thyroid_gland small_bowel "
    "duodenum colon urinary_bladder prostate kidney_cyst_left kidney_cyst_right sacrum vertebrae_S1 "
    "vertebrae_L5 vertebrae_L4 vertebrae_L3 vertebrae_L2 vertebrae_L1 vertebrae_T12 vertebrae_T11 "
    "vertebrae_T10 vertebrae_T9 vertebrae_T8 vertebrae_T7 vertebrae_T6 vertebrae_T5 vertebrae_T4 "
    "vertebrae_T3 vertebrae_T2 vertebrae_T1 vertebrae_C7 vertebrae_C6 vertebrae_C5 vertebrae_C4 "
    "vertebrae_C3 vertebrae_C2 vertebrae_C1 heart aorta pulmonary_vein brachiocephalic_trunk "
    "subclavian_artery_right subclavian_artery_left common_carotid_artery_right "
    "common_carotid_artery_left brachiocephalic_vein_left brachiocephalic_vein_right "
    "atrial_appendage_left superior_vena_cava inferior_vena_cava portal_vein_and_splenic_vein "
    "iliac_artery_left iliac_artery_right iliac_vena_left iliac_vena_right humerus_left humerus_right "
    "scapula_left scapula_right clavicula_left clavicula_right femur_left femur_right hip_left "
    "hip_right spinal_cord gluteus_maximus_left gluteus_maximus_right gluteus_medius_left "
    "gluteus_medius_right gluteus_minimus_left gluteus_minimus_right autochthon_left autochthon_right "
    "iliopsoas_left iliopsoas_right brain skull rib_left_1 rib_left_2 rib_left_3 rib_left_4 "
    "rib_left_5 rib_left_6 rib_left_7 rib_left_8 rib_left_9 rib_left_10 rib_left_11 rib_left_12 "
    "rib_right_1 rib_right_2 rib_right_3 rib_right_4 rib_right_5 rib_right_6 rib_right_7 rib_right_8 "
    "rib_right_9 rib_right_10 rib_right_11 rib_right_12 sternum costal_cartilages";
constexpr std::string_view totalsegmentator_mr =
    "spleen kidney_right kidney_left gallbladder liver stomach pancreas adrenal_gland_right "
    "adrenal_gland_left lung_left lung_right esophagus small_bowel duodenum colon urinary_bladder "
    "prostate sacrum vertebrae intervertebral_discs spinal_cord heart aorta inferior_vena_cava "
    "portal_vein_and_splenic_vein iliac_artery_left iliac_artery_right iliac_vena_left "
    "iliac_vena_right humerus_left humerus_right scapula_left scapula_right clavicula_left "
    "clavicula_right femur_left femur_right hip_left hip_right gluteus_maximus_left "
    "gluteus_maximus_right gluteus_medius_left gluteus_medius_right gluteus_minimus_left "
    "gluteus_minimus_right autochthon_left autochthon_right iliopsoas_left iliopsoas_right brain";

// The numbering of FreeSurfer's FreeSurferColorLUT.txt for its segmentations: aseg.mgz (number, name; ...)
// and, with the Desikan-Killiany names from 1000 (left) and 2000 (right) on, aparc+aseg.mgz; wmparc.mgz from
// 3000 and 4000 on.
constexpr std::string_view freesurfer_aseg =
    "2 Left-Cerebral-White-Matter 3 Left-Cerebral-Cortex 4 Left-Lateral-Ventricle 5 Left-Inf-Lat-Vent "
    "7 Left-Cerebellum-White-Matter 8 Left-Cerebellum-Cortex 10 Left-Thalamus 11 Left-Caudate 12 "
    "Left-Putamen "
    "13 Left-Pallidum 14 3rd-Ventricle 15 4th-Ventricle 16 Brain-Stem 17 Left-Hippocampus 18 Left-Amygdala "
    "24 CSF 25 Left-Lesion 26 Left-Accumbens-area 28 Left-VentralDC 30 Left-vessel 31 Left-choroid-plexus "
    "41 Right-Cerebral-White-Matter 42 Right-Cerebral-Cortex 43 Right-Lateral-Ventricle 44 "
    "Right-Inf-Lat-Vent "
    "46 Right-Cerebellum-White-Matter 47 Right-Cerebellum-Cortex 49 Right-Thalamus 50 Right-Caudate "
    "51 Right-Putamen 52 Right-Pallidum 53 Right-Hippocampus 54 Right-Amygdala 57 Right-Lesion "
    "58 Right-Accumbens-area 60 Right-VentralDC 62 Right-vessel 63 Right-choroid-plexus 72 5th-Ventricle "
    "77 WM-hypointensities 78 Left-WM-hypointensities 79 Right-WM-hypointensities 80 non-WM-hypointensities "
    "81 Left-non-WM-hypointensities 82 Right-non-WM-hypointensities 85 Optic-Chiasm 192 Corpus_Callosum "
    "250 Fornix 251 CC_Posterior 252 CC_Mid_Posterior 253 CC_Central 254 CC_Mid_Anterior 255 CC_Anterior "
    "257 CSF-ExtraCerebral 258 Head-ExtraCerebral 5001 Left-UnsegmentedWhiteMatter "
    "5002 Right-UnsegmentedWhiteMatter";
constexpr std::string_view freesurfer_cortex =
    "unknown bankssts caudalanteriorcingulate caudalmiddlefrontal corpuscallosum cuneus entorhinal fusiform "
    "inferiorparietal inferiortemporal isthmuscingulate lateraloccipital lateralorbitofrontal lingual "
    "medialorbitofrontal middletemporal parahippocampal paracentral parsopercularis parsorbitalis "
    "parstriangularis pericalcarine postcentral posteriorcingulate precentral precuneus "
    "rostralanteriorcingulate rostralmiddlefrontal superiorfrontal superiorparietal superiortemporal "
    "supramarginal frontalpole temporalpole transversetemporal insula";

std::map<int, std::string> freesurfer() {
  std::map<int, std::string> table;
  std::istringstream aseg{std::string(freesurfer_aseg)}, cortex{std::string(freesurfer_cortex)};
  std::string name;
  for (int label = 0; aseg >> label >> name;) table[label] = name;
  for (int k = 0; cortex >> name; ++k)
    for (const auto& [first, before] : {std::pair{1000, "ctx-lh-"}, std::pair{2000, "ctx-rh-"},
                                        std::pair{3000, "wm-lh-"}, std::pair{4000, "wm-rh-"}})
      table[first + k] = before + name;
  return table;
}

std::map<int, std::string> numbered(std::string_view names) {
  std::istringstream words{std::string(names)};
  std::map<int, std::string> table;
  for (std::string name; words >> name;) table[static_cast<int>(table.size()) + 1] = name;
  return table;
}

/// The values of one line of a CSV file; quotes keep commas.
std::vector<std::string> values_of(std::string_view line) {
  std::vector<std::string> values(1);
  bool quoted = false;
  for (const char c : line)
    if (c == '"')
      quoted = !quoted;
    else if (c == ',' && !quoted)
      values.emplace_back();
    else if (c != '\r')
      values.back() += c;
  for (std::string& value : values) {
    const auto first = value.find_first_not_of(" \t"), last = value.find_last_not_of(" \t");
    value = first == std::string::npos ? "" : value.substr(first, last - first + 1);
  }
  return values;
}

}  // namespace

std::map<int, std::string> names_from_segment_keys(const KeyValues& keys,
                                                   std::vector<std::string>& warnings) {
  constexpr std::string_view before = "Segment", after = "_Name";
  std::map<int, std::string> names;
  for (const auto& [key, name] : keys) {
    if (name.empty() || !key.starts_with(before) || !key.ends_with(after) ||
        key.size() <= before.size() + after.size())
      continue;
    const std::string segment = key.substr(0, key.size() - after.size());
    // No std::regex: it recurses for each letter, and a long key would overflow the stack.
    if (segment.find_first_not_of("0123456789", before.size()) != std::string::npos) continue;
    const auto value = keys.find(segment + "_LabelValue");
    // Slicer wrote no LabelValue before 4.11; a single segment then has label 1.
    const std::optional<int> label = value == keys.end() ? std::optional(1) : integer(value->second);
    if (!label || *label <= 0) continue;
    const auto [known, is_new] = names.emplace(*label, clean_name(name));
    if (!is_new)
      warnings.push_back(fmt::format("The file calls label {} both '{}' and '{}'; the first is used.", *label,
                                     known->second, clean_name(name)));
  }
  return names;
}

std::string layers_from_segment_keys(const KeyValues& keys) {
  constexpr std::string_view before = "Segment", after = "_Layer";
  std::vector<std::string> layers;
  for (const auto& [key, layer] : keys) {
    if (!key.starts_with(before) || !key.ends_with(after)) continue;
    const std::string segment = key.substr(0, key.size() - after.size());
    const auto name = keys.find(segment + "_Name");
    layers.push_back(
        fmt::format("'{}' in layer {}", clean_name(name == keys.end() ? segment : name->second), layer));
  }
  return fmt::format("{}", fmt::join(layers, ", "));
}

KeyValues segment_keys(const LabelImage& image) {
  KeyValues keys{{"Segmentation_MasterRepresentation", "Binary labelmap"},
                 {"Segmentation_ContainedRepresentationNames", "Binary labelmap|"},
                 {"Segmentation_ReferenceImageExtentOffset", "0 0 0"}};
  int n = 0;
  for (const auto& [label, e] : extents(image)) {
    const std::string segment = fmt::format("Segment{}_", n++);
    const auto name = image.names.find(label);
    const auto rgb = colour_of(label);
    keys[segment + "ID"] = fmt::format("Segment_{}", label);
    keys[segment + "Name"] = name == image.names.end() ? fmt::format("label {}", label) : name->second;
    keys[segment + "LabelValue"] = fmt::format("{}", label);
    keys[segment + "Layer"] = "0";
    keys[segment + "Extent"] = fmt::format("{}", fmt::join(e, " "));
    keys[segment + "Color"] =
        fmt::format("{:.6g} {:.6g} {:.6g}", rgb[0] / 255.0, rgb[1] / 255.0, rgb[2] / 255.0);
    keys[segment + "NameAutoGenerated"] = "0";
    keys[segment + "ColorAutoGenerated"] = "1";
  }
  return keys;
}

std::optional<LabelTable> known_label_names(const std::string& word) {
  const std::string name = lower(word);
  if (name == "totalsegmentator" || name == "totalsegmentator-ct")
    return LabelTable{numbered(totalsegmentator_ct), {}};
  if (name == "totalsegmentator-mr") return LabelTable{numbered(totalsegmentator_mr), {}};
  if (name == "freesurfer") return LabelTable{freesurfer(), {}};
  return std::nullopt;
}

std::string numbering_with(const std::string& label_name) {
  for (const char* word : {"totalsegmentator", "freesurfer", "totalsegmentator-mr"}) {
    const std::optional<LabelTable> table = known_label_names(word);
    for (const auto& [label, name] : table->names)
      if (lower(name) == lower(label_name)) return fmt::format("label {} of {}", label, word);
  }
  return {};
}

std::string other_numbering(const std::string& word, const LabelImage& image) {
  const std::string name = lower(word);
  if (name != "totalsegmentator") return {};
  const auto ct = numbered(totalsegmentator_ct), mr = numbered(totalsegmentator_mr);
  std::set<int> present;
  for (const Run& run : image.run) present.insert(run.label);
  if (*present.rbegin() > static_cast<int>(mr.size())) return {};  // only the one for CT has so many
  for (const int label : present)
    if (ct.at(label) != mr.at(label))
      return fmt::format(
          "TotalSegmentator numbers CT and MR differently: label {} is read as {}, as in CT; for an MR it is "
          "{} (--label-names totalsegmentator-mr).",
          label, ct.at(label), mr.at(label));
  return {};
}

namespace {

/// A line of a table of label names; number 0: the table as a whole.
struct TableLine {
  const std::filesystem::path& file;
  std::size_t number = 0;  ///< from 1
  std::string text = {};
};

InputError bad_table(const TableLine& line, std::string fact) {
  return InputError(
      {.fact = std::move(fact),
       .where = line.number == 0
                    ? fmt::format("table of label names {}", line.file.string())
                    : fmt::format("table of label names {}, line {}", line.file.string(), line.number),
       .why = "a line is  IDX R G B A VIS MSH \"NAME\"  (ITK-SNAP) or  ID NAME R G B A  (colour table of 3D "
              "Slicer or FreeSurfer); a table with commas has a first line with LabelValue and Name (3D "
              "Slicer)",
       .remedy = "correct the line, or give another table with --label-names; known without a file are "
                 "totalsegmentator, totalsegmentator-mr and freesurfer"});
}

struct NamedLabel {
  int label = 0;
  std::string name;
  bool unclear = false;  ///< unclear where the name ends and the colour begins
};

/// Label in a table with commas, whose first line names its columns.
NamedLabel label_of_columns(const TableLine& line, const std::vector<std::string>& columns) {
  const std::vector<std::string> values = values_of(line.text);
  const auto value = [&](const char* column) {
    const auto at =
        static_cast<std::size_t>(std::find(columns.begin(), columns.end(), column) - columns.begin());
    return at < values.size() ? values[at] : std::string();
  };
  const std::optional<int> label = integer(value("labelvalue"));
  if (!label || *label < 0) throw bad_table(line, fmt::format("its LabelValue is '{}'", value("labelvalue")));
  // Without a name, its meaning in the terminology.
  return {*label, !value("name").empty() ? value("name") : value("type_codemeaning")};
}

/// Label in a colour table: words between the label and R G B, usually A.
NamedLabel label_before_colour(const TableLine& line, const std::vector<std::string>& word, int label) {
  std::size_t numbers = 0;  // of the colour
  while (numbers < 4 && numbers + 1 < word.size() && integer(word[word.size() - 1 - numbers])) ++numbers;
  if (numbers < 3 || word.size() < numbers + 2)
    throw bad_table(line, fmt::format("'{}' names no label and colour", line.text));
  return {
      label,
      fmt::format("{}", fmt::join(word.begin() + 1, word.end() - static_cast<std::ptrdiff_t>(numbers), " ")),
      // "7 lobe 3 10 20 30": a third lobe without opacity, or a lobe with a colour of four numbers?
      numbers == 4 && word.size() > 6 && integer(word[word.size() - 5]).has_value()};
}

/// Label of ITK-SNAP, with the name in quotes, or of a colour table.
NamedLabel label_of_words(const TableLine& line) {
  const std::string& text = line.text;
  const auto open = text.find('"'), close = text.rfind('"');
  std::istringstream words(text.substr(0, open));
  const std::vector<std::string> word{std::istream_iterator<std::string>(words), {}};
  const std::optional<int> label = word.empty() ? std::nullopt : integer(word.front());
  if (!label || *label < 0)
    throw bad_table(line, fmt::format("'{}' does not start with a label number", text));
  if (open == std::string::npos) return label_before_colour(line, word, *label);
  if (close == open) throw bad_table(line, "the name has no closing quote");
  return {*label, text.substr(open + 1, close - open - 1)};
}

void keep(LabelTable& table, int label, const std::string& text) {
  // Names that 3D Slicer writes for numbers without a name.
  if (label == 0 || text.empty() || text == "(none)" || text == "invalid") return;
  const std::string name = clean_name(text);
  const auto [known, is_new] = table.names.emplace(label, name);
  if (is_new || known->second == name) return;
  table.warnings.push_back(
      fmt::format("The table of label names calls label {} both '{}' and '{}'; the last "
                  "is used.",
                  label, known->second, name));
  known->second = name;
}

}  // namespace

// No library: formats of one short line for each label, and the message must name the line.
LabelTable read_label_names(const std::filesystem::path& file) {
  require_regular_file(file);
  std::istringstream lines(read_file(file, most_bytes_of_text));
  LabelTable table;
  std::size_t unclear = 0, first_unclear = 0;
  std::vector<std::string> columns;  // of a table with commas
  bool is_first = true;
  TableLine line{.file = file};
  while (std::getline(lines, line.text)) {
    if (++line.number % 4096 == 0) stop_if_requested();
    std::string& text = line.text;
    if (line.number == 1 && text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);  // byte order mark
    const auto first = text.find_first_not_of(" \t\r");
    if (first == std::string::npos || text[first] == '#') continue;

    if (std::exchange(is_first, false) && lower(text).find("labelvalue") != std::string::npos &&
        text.find(',') != std::string::npos) {
      columns = values_of(lower(text));
      continue;
    }
    const NamedLabel named = columns.empty() ? label_of_words(line) : label_of_columns(line, columns);
    if (named.unclear && unclear++ == 0) first_unclear = line.number;
    keep(table, named.label, named.name);
  }
  if (table.names.empty()) throw bad_table({.file = file}, "the table names no label");
  if (unclear > 0)
    table.warnings.push_back(
        fmt::format("In {} line{} of the table of label names, first in line {}, a name with blanks ends in "
                    "a number; the last four numbers are read as the colour.",
                    unclear, unclear == 1 ? "" : "s", first_unclear));
  return table;
}

std::string label_descriptions(const LabelImage& image) {
  std::string lines;
  for (const auto& [label, extent] : extents(image)) {
    const auto name = image.names.find(label);
    if (name == image.names.end()) continue;
    const auto rgb = colour_of(label);
    lines += fmt::format("{:5} {:4} {:4} {:4}        1  1  1    \"{}\"\n", label, rgb[0], rgb[1], rgb[2],
                         name->second);
  }
  if (lines.empty()) return {};
  return "################################################\n"
         "# ITK-SnAP Label Description File\n"
         "# File format:\n"
         "# IDX   -R-  -G-  -B-  -A--  VIS MSH  LABEL\n"
         "################################################\n"
         "    0     0    0    0        0  0  0    \"Clear Label\"\n" +
         lines;
}

}  // namespace dimple
