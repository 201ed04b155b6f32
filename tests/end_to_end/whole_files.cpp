#include "tests/end_to_end/whole_files.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <regex>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/label_image.hpp"
#include "io/table.hpp"
#include "io/vtk_files.hpp"
#include "tests/end_to_end/program.hpp"

namespace dimple {

namespace fs = std::filesystem;
using Json = nlohmann::json;

namespace {

void erase_times(Json& json) {
  static const std::regex time("(.*_wall|image_read|model_build)_s|ms_per_step|real_time_factor");
  for (auto item = json.begin(); item != json.end();) {
    if (std::regex_match(item.key(), time)) {
      item = json.erase(item);
      continue;
    }
    if (item->is_object()) erase_times(*item);
    ++item;
  }
}

void read_whole(const fs::path& file) {
  const std::string name = file.filename().string(), text = text_of(file), suffix = file.extension().string();
  if (suffix == ".vtu") {
    EXPECT_GT(read_vtu(file).position_mm.cols(), 0) << file;
  } else if (suffix == ".vtp") {
    EXPECT_GT(read_vtp(file).triangles.cols(), 0) << file;
  } else if (suffix == ".csv" && name != "explain.csv") {
    EXPECT_TRUE(text.ends_with('\n')) << file;
    EXPECT_TRUE(read_csv(file).rows() > 0) << file;
  } else if (suffix == ".json") {
    EXPECT_TRUE(Json::accept(text)) << file << text;
  } else if (suffix == ".cbor") {
    const std::size_t length = text.size() - 64;  // its checksum follows
    EXPECT_EQ(sha256(text.substr(0, length)), text.substr(length)) << file;
    EXPECT_TRUE(Json::from_cbor(text.substr(0, length)).is_object()) << file;
  } else if (suffix == ".png") {
    EXPECT_EQ(text.substr(text.size() - std::min<std::size_t>(8, text.size()), 4), "IEND") << file;
  } else if (suffix == ".pvd" || suffix == ".vti") {
    EXPECT_TRUE(text.ends_with("</VTKFile>\n")) << file;
    const std::regex frame("file=\"([^\"]+)\"");
    for (std::sregex_iterator m(text.begin(), text.end(), frame), end; m != end; ++m)
      EXPECT_TRUE(fs::is_regular_file(file.parent_path() / (*m)[1].str())) << file << " lists " << (*m)[1];
  } else if (suffix == ".py") {
    EXPECT_TRUE(text.ends_with("RenderAllViews()\n")) << file;
  } else if (suffix == ".html") {
    EXPECT_TRUE(text.ends_with("</html>\n")) << file;
  } else if (suffix == ".svg") {
    EXPECT_TRUE(text.ends_with("</svg>\n")) << file;
  } else if (suffix == ".inp") {
    EXPECT_NE(text.rfind("*END STEP"), std::string::npos) << file;
  } else if (suffix == ".feb") {
    EXPECT_NE(text.rfind("</febio_spec>"), std::string::npos) << file;
  } else if (name == "model.toml") {
    EXPECT_NE(text.find("[made_from]"), std::string::npos) << file;
    for (const char* part : {"nodes.vtu", "points.vtu", "surface.vtp"})  // it is written last
      EXPECT_TRUE(fs::exists(file.parent_path() / part)) << file;
  } else if (suffix == ".nrrd" || suffix == ".gz" || suffix == ".mha") {
    EXPECT_GT(read_label_image(file).run.size(), 0u) << file;
  } else if (suffix == ".txt" || suffix == ".toml" || suffix == ".md" || name == "explain.csv") {
    EXPECT_TRUE(text.ends_with('\n')) << file;
  } else {
    ADD_FAILURE() << "what is " << file << '?';
  }
}

}  // namespace

std::vector<std::string> files_in(const fs::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) names.push_back(entry.path().lexically_relative(folder).string());
  std::sort(names.begin(), names.end());
  return names;
}

void expect_whole_files(const fs::path& folder, bool without_leftovers) {
  for (const std::string& name : files_in(folder)) {
    const fs::path file = folder / name;
    if (file.filename() == file_list_name) continue;
    if (file.filename().string().starts_with('.')) {
      EXPECT_FALSE(without_leftovers) << "left over: " << file;
      continue;
    }
    try {
      read_whole(file);
    } catch (const Error& error) {
      ADD_FAILURE() << file << ": " << error.report.fact << ", " << error.report.why;
    } catch (const std::exception& error) {
      ADD_FAILURE() << file << ": " << error.what();
    }
  }
}

void expect_same_results(const fs::path& a, const fs::path& b) {
  EXPECT_EQ(files_in(a), files_in(b));
  for (const std::string& name : files_in(a)) {
    if (!fs::exists(b / name) || name == "overview.png" || name == "report.html")
      continue;  // these depend on the wall time
    std::string one = text_of(a / name), other = text_of(b / name);
    if (name == "summary.json") {
      Json first = Json::parse(one), second = Json::parse(other);
      erase_times(first);
      erase_times(second);
      one = first.dump(1);
      other = second.dump(1);
      EXPECT_EQ(one, other) << name;
    }
    EXPECT_TRUE(one == other) << name << " differs in " << a << " and " << b;
  }
}

}  // namespace dimple
