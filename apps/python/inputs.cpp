#include <algorithm>
#include <map>
#include <variant>

#include "apps/python/binding.hpp"
#include "apps/run/compare.hpp"
#include "io/label_image.hpp"

namespace dimple {
namespace {

template <class T>
LabelArray label_array(const py::array& array) {
  LabelArray labels;
  labels.voxel = static_cast<const T*>(array.data());
  for (std::size_t a = 0; a < 3; ++a) {
    labels.size[a] = array.shape(static_cast<py::ssize_t>(a));
    labels.step[a] = array.strides(static_cast<py::ssize_t>(a)) / array.itemsize();
  }
  return labels;
}

LabelArray labels_in(const py::array& array) {
  const char kind = array.dtype().kind();
  const auto bytes = array.itemsize();
  if (kind == 'f') return bytes == 4 ? label_array<float>(array) : label_array<double>(array);
  const bool is_signed = kind == 'i';
  switch (bytes) {
    case 1:
      return is_signed ? label_array<std::int8_t>(array) : label_array<std::uint8_t>(array);
    case 2:
      return is_signed ? label_array<std::int16_t>(array) : label_array<std::uint16_t>(array);
    case 4:
      return is_signed ? label_array<std::int32_t>(array) : label_array<std::uint32_t>(array);
    default:
      return is_signed ? label_array<std::int64_t>(array) : label_array<std::uint64_t>(array);
  }
}

// Image of an array: one of the types above, three axes, contiguous. `to_world`: 4x4, to LPS mm.
std::shared_ptr<LabelImage> label_image(const py::array& array, const py::array_t<double>& to_world,
                                        const std::string& label_names) {
  LabelArray labels = labels_in(array);
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) labels.to_world.matrix()(r, c) = to_world.at(r, c);
  return computing([&] { return std::make_shared<LabelImage>(label_image_of(labels, label_names)); });
}

// Keyword of an option: its flag with the unit of the key, mu_Pa for "--mu" of material.mu_Pa.
std::string keyword_of(const Option& option) {
  const std::string last = option.key.substr(option.key.find('.') + 1);
  if (option.flag.empty()) return last;
  std::string word = option.flag.substr(2);
  std::replace(word.begin(), word.end(), '-', '_');
  return last.starts_with(word) ? last : word;
}

// Suggested words of an option of free text. They are not in its table, as Slicer would allow no others.
std::vector<std::string> words_next_to_text(const Option& option) {
  static const std::map<std::string, std::vector<std::string>> others = {
      {"image.label_names", {"totalsegmentator", "totalsegmentator-ct", "totalsegmentator-mr", "freesurfer"}},
      {"boundary.direction", {"auto"}},
      {"accuracy.quantity", {"force"}},
      {"tool.friction", {"stick"}},
      {"output.compare", {paper_word}}};
  const auto found = others.find(option.key);
  return found == others.end() ? option.words : found->second;
}

py::list options() {
  py::list result;
  for (const Option& option : usual_options()) {
    if (option.key == "image.file") continue;
    py::dict entry;
    entry["keyword"] = keyword_of(option);
    entry["flag"] = option.flag;
    entry["key"] = option.key;
    entry["key_without_unit"] = without_unit(option);
    entry["stage"] = option.stage;
    entry["unit"] = option.unit;
    entry["help"] = option.help;
    entry["choices"] = option.choices;
    entry["words"] = option.choices.empty() ? words_next_to_text(option) : option.choices;
    entry["default"] = std::visit([](const auto* value) { return py::cast(*value); }, option.value);
    result.append(std::move(entry));
  }
  return result;
}

}  // namespace

Settings Settings::combined_with(const Settings& further) const {
  Settings both = *this;
  both.given.insert(both.given.end(), further.given.begin(), further.given.end());
  return both;
}

Description Settings::described() const {
  Description result;
  if (!config_file.empty()) read_config(result, config_file);
  for (const auto& [key, text, source] : given) set_option(result, key, text, source);
  complete(result);
  return result;
}

py::dict Settings::values() const {
  const Description all = described();
  py::dict result;
  for (const Option& option : usual_options())
    result[py::str(option.key)] =
        std::visit([](const auto& value) { return py::cast(value); }, value_of(all, option.key));
  return result;
}

void add_inputs(py::module_& m) {
  m.def("options", &options);
  py::class_<LabelImage, std::shared_ptr<LabelImage>>(m, "LabelImage").def(py::init(&label_image));
  py::class_<Settings>(m, "Settings")
      .def(py::init([](std::string file, std::vector<std::array<std::string, 3>> given) {
        return Settings{std::move(file), std::move(given)};
      }))
      .def("set",
           [](Settings& self, std::string key, std::string text, std::string source) {
             self.given.push_back({std::move(key), std::move(text), std::move(source)});
           })
      .def("values", &Settings::values);
}

}  // namespace dimple
