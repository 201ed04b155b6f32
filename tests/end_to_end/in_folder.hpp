#pragma once

// Includes and fixture that nearly every test of the program needs.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>
#include <thread>

#include "io/table.hpp"
#include "io/vtk_files.hpp"
#include "tests/end_to_end/program.hpp"

namespace dimple {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using testing::HasSubstr;
using testing::Not;

/// Summary of the results in this folder.
inline Json summary_of(const fs::path& out) {
  return Json::parse(text_of(out / "summary.json"));
}

/// Table force.csv of the results, and the last number of a column in it.
inline Table curve_of(const fs::path& out) {
  return read_csv(out / "force.csv");
}
inline double end_of(const fs::path& out, const char* column = "force_N") {
  return curve_of(out).find(column)->back();
}

/// Object that a page holds under this name; null if there is none.
template <class Object = Json>
Object held_by(const std::string& page, const std::string& id) {
  const std::string head = "<script type=\"application/json\" id=\"" + id + "\">";
  const std::size_t at = page.find(head);
  if (at == std::string::npos) return {};
  const std::size_t from = at + head.size();
  return Object::parse(page.substr(from, page.find("</script>", from) - from));
}

inline Vec3 vector_of(const Json& list) {
  return Vec3(list.at(0), list.at(1), list.at(2));
}

/// Fixture for tests of the program in a folder of their own.
class InFolder : public testing::Test {
 protected:
  const fs::path folder = fresh_folder();

  /// Runs the program; the test fails unless the exit code is 0.
  Ran good(const std::string& arguments) const { return dimple::good(folder, arguments); }
  void refused(int code, const std::string& arguments, const std::vector<std::string>& words) const {
    SCOPED_TRACE("dimple " + arguments);
    expect_refusal(dimple(folder, arguments), code, words);
  }
  void refuses(const std::string& command, const std::vector<RefusedLine>& lines) const {
    expect_refusals(folder, command, lines);
  }
  void write(const fs::path& name, const std::string& content) const {
    fs::create_directories((folder / name).parent_path());
    std::ofstream(folder / name, std::ios::binary) << content;
  }
  std::string text(const fs::path& name) const { return text_of(folder / name); }
  Json summary(const std::string& out = "out") const { return summary_of(folder / out); }
  /// Makes a block of 60 x 60 x 30 mm, block.nrrd.
  void make_block(int spacing_mm = 3) const {
    good("phantom block.nrrd --shape block --size 60,60,30 -q --spacing " + std::to_string(spacing_mm));
  }
};

}  // namespace dimple
