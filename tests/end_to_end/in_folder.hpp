#pragma once

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/end_to_end/program.hpp"

namespace dimple {

/// The summary of the results in this folder.
inline nlohmann::json summary_of(const std::filesystem::path& out) {
  return nlohmann::json::parse(text_of(out / "summary.json"));
}

/// Tests of the program in a folder of their own.
class InFolder : public testing::Test {
 protected:
  const std::filesystem::path folder = fresh_folder();

  /// It must end well.
  Ran good(const std::string& arguments) const { return dimple::good(folder, arguments); }
  void refused(int code, const std::string& arguments, const std::vector<std::string>& words) const {
    SCOPED_TRACE("dimple " + arguments);
    expect_refusal(dimple(folder, arguments), code, words);
  }
  void write(const std::filesystem::path& name, const std::string& content) const {
    std::filesystem::create_directories((folder / name).parent_path());
    std::ofstream(folder / name, std::ios::binary) << content;
  }
  nlohmann::json summary(const std::string& out = "out") const { return summary_of(folder / out); }
  /// A block of 60 x 60 x 30 mm, block.nrrd.
  void make_block(int spacing_mm = 3) const {
    good("phantom block.nrrd --shape block --size 60,60,30 -q --spacing " + std::to_string(spacing_mm));
  }
};

}  // namespace dimple
