#pragma once

#include <gtest/gtest.h>

#include <string>
#include <utility>

#include "io/error.hpp"

namespace dimple {

/// Report of the failure of type E that `action` throws. If it throws none, the test fails and the report is
/// empty.
template <class E, class Action>
Report report_of(const Action& action) {
  try {
    action();
  } catch (const E& error) {
    return error.report;
  }
  ADD_FAILURE() << "nothing was thrown";
  return {};
}

/// Words that the parts of a report contain, and its code; an empty one matches any.
struct Says {
  std::string fact = {}, where = {}, why = {}, remedy = {}, code = {};
};

/// Fails the test unless `action` throws an E with these words.
template <class E, class Action>
void expect_error(const Action& action, const Says& says) {
  const Report report = report_of<E>(action);
  for (const auto& [part, words] :
       {std::pair{&report.fact, &says.fact}, std::pair{&report.where, &says.where},
        std::pair{&report.why, &says.why}, std::pair{&report.remedy, &says.remedy}})
    EXPECT_NE(part->find(*words), std::string::npos) << *part;
  EXPECT_TRUE(says.code.empty() || report.code == says.code) << report.code;
}

}  // namespace dimple
