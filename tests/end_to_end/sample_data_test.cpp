// Images of sample_data: the program still makes them, voxel for voxel, and they still give the results in
// expected.json.

#include "io/label_image.hpp"
#include "tests/end_to_end/in_folder.hpp"
#include "tests/helpers/image.hpp"

namespace dimple {
namespace {

const fs::path sample_data = DIMPLE_SAMPLE_DATA;

Json expected() {
  return Json::parse(text_of(sample_data / "expected.json"));
}

TEST(SampleData, IsWhatThePhantomCommandMakes) {
  const fs::path folder = fresh_folder();
  ASSERT_FALSE(expected().empty());
  for (const Json& sample : expected()) {
    const auto name = sample.at("file").get<std::string>();
    SCOPED_TRACE(name);
    good(folder, sample.at("made_by").get<std::string>());
    const LabelImage kept = read_label_image(sample_data / name), made = read_label_image(folder / name);
    EXPECT_EQ(kept.size, made.size);
    EXPECT_EQ(every_voxel(kept), every_voxel(made));
    EXPECT_EQ(kept.names, made.names);
    EXPECT_EQ(kept.to_world.matrix(), made.to_world.matrix());
    EXPECT_LT(fs::file_size(sample_data / name), 50000u);
  }
}

TEST(SampleData, HoldsWhatIsWrittenAboutIt) {
  for (const Json& sample : expected()) {
    const auto name = sample.at("file").get<std::string>();
    SCOPED_TRACE(name);
    const Ran ran = good(sample_data, {"info", name, "--json"});
    const Json labels = Json::parse(ran.out).at("labels");
    ASSERT_EQ(labels.size(), sample.at("labels").size());
    for (std::size_t l = 0; l < labels.size(); ++l)
      for (const char* key : {"value", "name", "voxels", "volume_mm3"})
        EXPECT_EQ(labels[l].at(key), sample.at("labels")[l].at(key)) << key;
  }
}

TEST(SampleData, GivesTheForceThatIsWrittenAboutIt) {
  const fs::path folder = fresh_folder();
  for (const Json& sample : expected()) {
    const auto name = sample.at("file").get<std::string>();
    SCOPED_TRACE(name);
    fs::copy_file(sample_data / name, folder / name);
    for (const Json& run : sample.at("runs")) {
      const auto command = run.at("command").get<std::string>();
      SCOPED_TRACE(command);
      const Ran ran = good(folder, command + " --json -q --force");
      const Json summary = Json::parse(ran.out);
      EXPECT_EQ(summary.at("status"), "finished");
      const double force = run.at("force_N").get<double>();
      EXPECT_NEAR(summary.at("force_N"), force, run.at("tolerance").get<double>() * force);
    }
  }
}

}  // namespace
}  // namespace dimple
