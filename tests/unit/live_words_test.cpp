// Messages of a window during live contact.

#include <gtest/gtest.h>

#include <limits>

#include "apps/run/live.hpp"

namespace dimple {
namespace {

using Tool = LiveFrame::Tool;

PathFrame frame_at(double depth, double force, Tool tool = Tool::there) {
  PathFrame now;
  now.tip = {0.012, -0.03, 0.045};
  now.frame.depth = depth;
  now.frame.force = force;
  now.frame.tool = tool;
  now.half_error = 0.0;
  return now;
}

TEST(LiveWords, OnlyAHandIsShownTheMouse) {
  EXPECT_EQ(words_of(frame_at(0.0, 0.0), true),
            "no contact: press the left button on the body and drag inwards");
  EXPECT_EQ(words_of(frame_at(0.0, 0.0), false), "no contact: the tool is at (12.0, -30.0, 45.0) mm");
}

TEST(LiveWords, AToolInTheTissueIsNeverSaidToHaveNoContact) {
  for (const double force : {0.012, 0.0, -0.001})  // tissue that relaxes may pull
    for (const bool by_hand : {true, false}) {
      const std::string words = words_of(frame_at(2e-3, force), by_hand);
      EXPECT_EQ(words.find("no contact"), std::string::npos) << words;
      EXPECT_NE(words.find("2.00 mm deep"), std::string::npos) << words;
    }
}

TEST(LiveWords, AForceSmallerThanItsErrorIsUnknown) {
  PathFrame now = frame_at(19e-3, -0.042, Tool::stopped);
  now.frame.error_at_depth = 0.063;
  EXPECT_EQ(words_of(now, false),
            "force unknown, 19.00 mm deep: its error, 63.0 mN, exceeds it (no equilibrium any deeper)");
  now.frame.error_at_depth = std::numeric_limits<double>::infinity();
  EXPECT_EQ(words_of(now, false),
            "force unknown, 19.00 mm deep: no error estimate yet (no equilibrium any deeper)");
  now.frame.error_at_depth = 0.041;
  EXPECT_NE(words_of(now, false).find("+-"), std::string::npos);
}

TEST(LiveWords, EachStatusHasItsName) {
  const std::vector<std::string> names = {"there", "lags", "stopped", "elsewhere", "beyond"};
  for (int k = 0; k < 5; ++k) EXPECT_EQ(name_of(static_cast<Tool>(k)), names[static_cast<std::size_t>(k)]);
  EXPECT_NE(
      words_of(frame_at(2e-3, 0.01, Tool::elsewhere), false).find("the tool is not at the requested place"),
      std::string::npos);
  EXPECT_NE(words_of(frame_at(2e-3, 0.01, Tool::beyond), false).find("the requested depth exceeds the body"),
            std::string::npos);
}

}  // namespace
}  // namespace dimple
