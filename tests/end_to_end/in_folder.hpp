#pragma once

#include <gtest/gtest.h>

#include "tests/end_to_end/program.hpp"

namespace dimple {

/// Tests of the program in a folder of their own.
class InFolder : public testing::Test {
 protected:
  const std::filesystem::path folder = fresh_folder();

  /// It must end well.
  Ran good(const std::string& arguments) const {
    const Ran ran = dimple(folder, arguments);
    EXPECT_EQ(ran.code, 0) << "dimple " << arguments << '\n' << ran.err;
    return ran;
  }
};

}  // namespace dimple
