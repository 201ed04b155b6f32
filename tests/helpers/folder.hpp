#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>

namespace dimple {

/// Folder of this process alone, in TEST_TMPDIR or gtest's folder for temporary files. No other test or
/// checkout uses it. It is removed with the process if all tests have passed.
inline const std::filesystem::path& process_folder() {
  struct Folder {
    std::filesystem::path path;
    pid_t owner = getpid();  // a forked child leaves it alone
    Folder() {
      std::string name = (std::filesystem::path(testing::TempDir()) / "dimple_tests_XXXXXX").string();
      if (mkdtemp(name.data()) == nullptr)
        throw std::runtime_error("no folder can be made in " + testing::TempDir());
      path = name;
    }
    ~Folder() {
      std::error_code ignored;
      if (getpid() == owner && !testing::UnitTest::GetInstance()->Failed())
        std::filesystem::remove_all(path, ignored);
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;
  };
  static const Folder folder;
  return folder.path;
}

/// Folder of the running test, created if necessary.
inline std::filesystem::path test_folder() {
  const auto* test = testing::UnitTest::GetInstance()->current_test_info();
  const std::filesystem::path folder = process_folder() / test->test_suite_name() / test->name();
  std::filesystem::create_directories(folder);
  return folder;
}

/// Folder of the test, emptied.
inline std::filesystem::path fresh_folder() {
  std::filesystem::remove_all(test_folder());
  return test_folder();
}

}  // namespace dimple
