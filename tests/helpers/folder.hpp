#pragma once

#include <gtest/gtest.h>

#include <filesystem>

namespace dimple {

/// The running test's own folder, made if need be. No two tests share one: they run side by side. Nor do two
/// builds: ctest gives each a place of its own (TEST_TMPDIR in tests/CMakeLists.txt).
inline std::filesystem::path test_folder() {
  const auto* test = testing::UnitTest::GetInstance()->current_test_info();
  const std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / "dimple_tests" / test->test_suite_name() / test->name();
  std::filesystem::create_directories(folder);
  return folder;
}

/// The same, emptied.
inline std::filesystem::path fresh_folder() {
  std::filesystem::remove_all(test_folder());
  return test_folder();
}

}  // namespace dimple
