// Words of options: their parsing, and the names in a refusal.

#include "apps/scene/option_word.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "apps/scene/tool_words.hpp"
#include "io/error.hpp"
#include "tests/helpers/report.hpp"

namespace dimple {
namespace {

using testing::HasSubstr;

const WordTable table{"the thing",
                      {{"none"},
                       {"disc", place_numbers(1e-3), "", {length_number("radius", 1e-3, 100.0)}},
                       {.kind = "label", .names = "NAME"},
                       {.numbers = direction_numbers(), .is_side = true}}};

OptionWord read(const std::string& text) {
  return parse_word(table, text, "--thing", "the scene");
}

TEST(OptionWord, IsReadInItsFormAndScaled) {
  EXPECT_EQ(read(" none ").kind, "none");
  EXPECT_EQ(read("disc: 1, 2cm,3,radius = 4mm").number, (std::vector<double>{1e-3, 2e-2, 3e-3, 4e-3}));
  EXPECT_EQ(read("disc:-1,0,3,radius=4").number.front(), -1e-3);
  EXPECT_EQ(read("disc:0,0,3,radius=4").number.back(), 4e-3);
  EXPECT_EQ(read("label:a, b").name, (std::vector<std::string>{"a", "b"}));
  EXPECT_EQ(read("0,-0.5,2").three(), Vec3(0.0, -0.5, 2.0));
  const OptionWord side = read("anterior");
  EXPECT_TRUE(side.is_side);
  EXPECT_EQ(side.three(), Vec3(0.0, -1.0, 0.0));
}

TEST(OptionWord, OfAnotherFormIsRefusedWithItsOptionItsReasonAndWhatToGive) {
  const struct {
    const char *text, *fact;
  } refused[] = {{"cube:1", "the thing 'cube:1' of the scene is not known"},
                 {"disc:1,2,radius=4", "has 2 numbers"},
                 {"disc", "has no number"},
                 {"disc:1,2,3", "has no radius"},
                 {"disc:1,2,3,radius=4,depth=1", "does not take 'depth'"},
                 {"disc:1,2,3,radius=4,radius=5", "two values of radius"},
                 {"disc:1,2,3,radius=0mm", "radius = 0mm is not allowed"},
                 {"disc:1,two,3,radius=4", "y = two is not allowed"},
                 {"label:,", "names no label"},
                 {"1,2", "has 2 numbers"}};
  for (const auto& [text, fact] : refused) {
    SCOPED_TRACE(text);
    const Report report = report_of<UsageError>([&] { read(text); });
    EXPECT_THAT(report.fact, HasSubstr(fact));
    EXPECT_EQ(report.where, "--thing");
    EXPECT_FALSE(report.why.empty() || report.remedy.empty());
  }
}

TEST(OptionWord, OfAToolGivesAShapeThatIsMadeAgainFromItsLengths) {
  for (const char* text :
       {"sphere:5mm", "punch:5mm,edge=1mm", "capsule:2mm,length=2cm", "cone:30deg,tip=0.5mm"}) {
    const ToolShape shape = tool_named(text, "--tool").value();
    EXPECT_EQ(shape.kind, std::string(text).substr(0, shape.kind.size()));
    const ToolShape again = with_length(shape, 0, shape.numbers[0]);
    EXPECT_EQ(again.numbers, shape.numbers);
    EXPECT_EQ(again.edge, shape.edge);
    EXPECT_EQ(again.length, shape.length);
  }
  EXPECT_FALSE(tool_named("circle", "--tool"));
  EXPECT_THROW(tool_named("punch:5mm,edge=0.1mm", "--tool"), UsageError);
  EXPECT_THROW(tool_named("capsule:2mm,length=3mm", "--tool"), UsageError);
}

TEST(OptionWord, OfAConeHasAnAngleATipAndAUsualRadius) {
  const ToolShape cone = tool_named("cone:30deg,tip=0.5mm", "--tool").value();
  EXPECT_EQ(cone.kind, "cone");
  ASSERT_EQ(cone.numbers.size(), 3u);
  EXPECT_NEAR(std::sin(cone.numbers[0]), 0.5, 1e-12);
  EXPECT_NEAR(cone.numbers[1], 0.5e-3, 1e-12);
  EXPECT_EQ(cone.radius, 5e-3);
  EXPECT_NEAR(tool_named("cone:0.5rad,tip=0.5mm,radius=8mm", "--tool")->numbers[0], 0.5, 1e-12);
  EXPECT_NEAR(tool_named("cone:30,tip=0.5mm,radius=8mm", "--tool")->radius, 8e-3, 1e-12);
  EXPECT_EQ(in_words(cone), "a cone of 30 deg from its axis with a tip of 0.50 mm and a radius of 5.00 mm");
  const std::vector<ToolLength> lengths = lengths_of(cone);
  ASSERT_EQ(lengths.size(), 3u);
  EXPECT_EQ(lengths[0].in_words(lengths[0].value), "30.0 deg");
  EXPECT_NEAR(lengths[0].in_unit(lengths[0].value), 30.0, 1e-12);
  EXPECT_EQ(lengths[1].in_words(lengths[1].value), "0.50 mm");
  for (const char* text : {"cone:30deg", "cone:90deg,tip=1mm", "cone:30mm,tip=1mm", "cone:30deg,tip=0mm"})
    EXPECT_THROW(tool_named(text, "--tool"), UsageError) << text;
}

}  // namespace
}  // namespace dimple
