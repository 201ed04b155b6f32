#include "io/draw/chart.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPNGReader.h>
#include <vtkSmartPointer.h>
#include <vtkXMLDataElement.h>
#include <vtkXMLDataParser.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <type_traits>

#include "io/error.hpp"
#include "io/file.hpp"
#include "tests/helpers/folder.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double inf = std::numeric_limits<double>::infinity();

vtkSmartPointer<vtkImageData> decoded(const fs::path& file) {
  vtkNew<vtkPNGReader> reader;
  reader->SetFileName(file.c_str());
  reader->Update();
  return reader->GetOutput();
}

/// Texts in an SVG, as a reader sees them; fails the test if it is not XML.
std::vector<std::string> texts_of(const std::string& svg) {
  std::istringstream in(svg);
  vtkNew<vtkXMLDataParser> parser;
  parser->SetIgnoreCharacterData(0);
  parser->SetStream(&in);
  std::vector<std::string> texts;
  if (parser->Parse() == 0 || parser->GetRootElement() == nullptr) {
    ADD_FAILURE() << "not well-formed XML: " << svg.substr(0, 400);
    return texts;
  }
  EXPECT_STREQ(parser->GetRootElement()->GetName(), "svg");
  const std::function<void(vtkXMLDataElement*)> walk = [&](vtkXMLDataElement* element) {
    const std::string name = element->GetName();
    if ((name == "text" || name == "title") && element->GetCharacterData() != nullptr)
      texts.emplace_back(element->GetCharacterData());
    for (int n = 0; n < element->GetNumberOfNestedElements(); ++n) walk(element->GetNestedElement(n));
  };
  walk(parser->GetRootElement());
  return texts;
}

/// Draws a PNG of the right size that is not empty, and an SVG that is XML without invalid numbers. Returns
/// its texts.
template <class Panel>
std::vector<std::string> expect_drawn(const std::vector<Panel>& panels) {
  const fs::path folder = fresh_folder();
  for (const char* name : {"picture.png", "picture.svg"}) {
    if constexpr (std::is_same_v<Panel, Chart>) {
      EXPECT_NO_THROW(write_chart(folder / name, panels));
    } else {
      EXPECT_NO_THROW(write_tornado(folder / name, panels));
    }
  }
  const int count = static_cast<int>(panels.size());
  const auto image = decoded(folder / "picture.png");
  EXPECT_EQ(image->GetDimensions()[0], 1000);
  if constexpr (std::is_same_v<Panel, Tornado>)
    EXPECT_LE(image->GetDimensions()[1], 650 * count);
  else
    EXPECT_EQ(image->GetDimensions()[1], 650 * count);
  EXPECT_LT(image->GetScalarRange()[0], 140.0);
  const std::string svg = read_file(folder / "picture.svg");
  for (const char* bad : {"\"nan", "\"inf", "\"-nan", "\"-inf", " nan", " inf", "href"})
    EXPECT_EQ(svg.find(bad), std::string::npos) << bad;
  return texts_of(svg);
}

std::size_t times_in(const std::string& text, const std::string& word) {
  std::size_t count = 0;
  for (std::size_t at = 0; (at = text.find(word, at)) != std::string::npos; ++at) ++count;
  return count;
}

std::vector<std::string> expect_drawn(const Chart& chart) {
  return expect_drawn(std::vector<Chart>{chart});
}

/// Five curves of twenty samples, some of them close together.
Chart force_curves() {
  Chart chart;
  chart.title = "Force against indentation";
  chart.subtitle = {"brain.nrrd, 8 mm indentation; each curve is one cloud",
                    "dashed: the band of its discretisation"};
  chart.x_label = "indentation [mm]";
  chart.y_label = "force [mN]";
  const std::vector<std::string> names{"measured", "1000 nodes", "2000 nodes", "low", "high"};
  for (std::size_t n = 0; n < names.size(); ++n) {
    ChartSeries s{.name = names[n], .markers = n<3, .dashed = n> 2};
    for (int i = 0; i < 20; ++i) {
      s.x.push_back(0.4 * i);
      s.y.push_back((9.0 + 0.1 * static_cast<double>(n)) * std::pow(0.4 * i, 1.05));
    }
    chart.series.push_back(s);
  }
  return chart;
}

TEST(Chart, IsAPngOf1000By650PixelsAPanelDrawnWithoutADisplay) {
  ::unsetenv("DISPLAY");
  expect_drawn(force_curves());
}

TEST(Chart, PutsPanelsBelowEachOther) {
  Chart curve;
  curve.title = "Force";
  curve.x_label = "indentation [mm]";
  curve.y_label = "force [N]";
  ChartSeries s{.name = "measured", .markers = false};
  ChartSeries t{.name = "computed", .markers = false, .dashed = true};
  for (int i = 0; i <= 200; ++i) {
    s.x.push_back(0.04 * i), s.y.push_back(0.0003 * i + 2e-6 * i * i);
    t.x.push_back(0.04 * i), t.y.push_back(0.00035 * i + 1.6e-6 * i * i - 0.002 * std::sin(0.1 * i));
  }
  curve.series = {s, t};
  expect_drawn<Chart>({force_curves(), curve, Chart{.title = "nothing yet"}});
}

TEST(Chart, IsTheSameFileForTheSameInput) {
  const fs::path folder = fresh_folder();
  for (const char* name : {"a", "b"}) {
    write_chart(folder / (std::string(name) + ".png"), {force_curves()});
    write_chart(folder / (std::string(name) + ".svg"), {force_curves()});
  }
  EXPECT_EQ(read_file(folder / "a.png"), read_file(folder / "b.png"));
  EXPECT_EQ(read_file(folder / "a.svg"), read_file(folder / "b.svg"));
}

TEST(Chart, SaysEveryNameAndEveryLabel) {
  const Chart chart = force_curves();
  const std::vector<std::string> texts = expect_drawn(chart);
  for (const ChartSeries& s : chart.series) EXPECT_THAT(texts, testing::Contains(s.name));
  EXPECT_THAT(texts, testing::Contains(chart.title));
  EXPECT_THAT(texts, testing::Contains(chart.x_label));
  EXPECT_THAT(texts, testing::Contains(chart.y_label));
}

TEST(Chart, CarriesTheWholeOfATextThatItHadToShorten) {
  Chart chart = force_curves();
  chart.series[1].name = std::string(300, 'W') + " end";
  EXPECT_THAT(expect_drawn(chart), testing::Contains(chart.series[1].name));
}

TEST(Chart, EscapesWhatXmlWouldTakeForMarkup) {
  Chart chart = force_curves();
  chart.series[0].name = R"(</text><script>a & "b" > 'c'</script>)";
  chart.title = "a < b & c";
  const std::vector<std::string> texts = expect_drawn(chart);
  EXPECT_THAT(texts, testing::Contains(chart.series[0].name));
  EXPECT_THAT(texts, testing::Contains("a < b & c"));
}

TEST(Chart, SurvivesAnyText) {
  Chart chart = force_curves();
  chart.title = std::string(3000, 'W') + "\xFF\xFE \n\t \xE2\x82";
  chart.subtitle = {
      std::string(5000, 'x'), "", "   ", "\xC2", "\xE8\x84\xB3 \xEF\xBF\xBF \xED\xA0\x80 \x01", "a", "b"};
  chart.x_label = std::string(1, '\0') + std::string(900, 'l');
  chart.series[0].name = "\xCE\xBB = 3, \xF0\x9F\xA7\xA0";
  EXPECT_THAT(expect_drawn(chart), testing::Contains(chart.series[0].name));
}

TEST(Chart, SaysThatThereIsNoData) {
  EXPECT_THAT(expect_drawn(Chart{}), testing::Contains("no data"));
  const std::vector<std::string> texts = expect_drawn(
      Chart{.series = {{.name = "none"}, {.name = "no numbers", .x = {nan, 1.0}, .y = {1.0, inf}}}});
  EXPECT_THAT(texts, testing::Contains("no data"));
  EXPECT_THAT(texts, testing::Contains("no numbers"));
}

TEST(Chart, LeavesAGapWhereAValueIsNotFinite) {
  Chart chart;
  chart.series = {{.name = "gap", .x = {0, 1, 2, 3, 4, 5}, .y = {1, 2, nan, 2, 1, inf}, .colour = 0}};
  const fs::path file = fresh_folder() / "gap.svg";
  expect_drawn(chart);
  write_chart(file, {chart});
  EXPECT_EQ(times_in(read_file(file), "fill=\"none\" stroke=\"#0072b2"), 3U);  // two pieces, and its sample
}

TEST(Chart, ShadesTheErrorBoundsOfASeriesAndWritesWhatIsAtItsEnd) {
  Chart chart;
  chart.series = {{.name = "force",
                   .x = {0, 1, nan, 3},
                   .y = {0, 1, 2, 3},
                   .markers = false,
                   .low = {0, 0.9, 1.8, 2.7},
                   .high = {0, 1.1, 2.2, 3.3},
                   .end = "3 N, +- 10 %"}};
  const fs::path file = fresh_folder() / "band.svg";
  EXPECT_THAT(expect_drawn(chart), testing::Contains("3 N, +- 10 %"));
  write_chart(file, {chart});
  const std::string drawn = read_file(file);
  const std::size_t at = drawn.find("<polygon points=\"");
  ASSERT_NE(at, std::string::npos);
  EXPECT_EQ(times_in(drawn.substr(at, drawn.find("fill", at) - at), ","), 6U);  // two corners a finite point
  chart.series[0].low.pop_back();
  EXPECT_THROW(write_chart(file, {chart}), std::invalid_argument);
}

TEST(Chart, DrawsASinglePoint) {
  for (const bool marked : {false, true})
    EXPECT_THAT(expect_drawn(Chart{.series = {{.name = "one", .x = {3.0}, .y = {4e-9}, .markers = marked}}}),
                testing::Contains("one"));
}

TEST(Chart, DrawsValuesThatAreAllEqual) {
  for (const double value : {0.0, 5.0, -1e-200, 1e300, 1e9}) {
    SCOPED_TRACE(value);
    expect_drawn(Chart{.series = {{.name = "same", .x = {value, value, value}, .y = {value, value, value}}}});
  }
}

TEST(Chart, DrawsRangesOfAnySize) {
  for (const auto& values : {std::vector<double>{-1e300, 1e300},
                             {1e-320, 1e300},
                             {1e12, 1e12 + 1.0},
                             {-3e-9, 2e-9},
                             {2.0, 2.0003},
                             {1.0, 1.7},
                             {0.4, 90.0},
                             {1e-9, 1e9}}) {
    SCOPED_TRACE(testing::Message() << values[0] << " to " << values[1]);
    expect_drawn(Chart{.series = {{.name = "wide", .x = values, .y = values}}});
  }
}

TEST(Chart, DrawsManySeries) {
  Chart chart;
  for (int n = 0; n < 40; ++n)
    chart.series.push_back({.name = "a series with quite a long name, number " + std::to_string(n),
                            .x = {1.0, 2.0},
                            .y = {1.0 * n, 2.0 * n}});
  expect_drawn(chart);
}

TEST(Chart, GivesTheSameColourToTheSameNumber) {
  Chart chart;
  chart.series = {{.name = "a", .x = {1, 2}, .y = {1, 2}},
                  {.name = "b", .x = {1, 2}, .y = {2, 3}, .colour = 0},
                  {.name = "c", .x = {1, 2}, .y = {3, 4}, .dashed = true, .colour = 0}};
  const fs::path file = fresh_folder() / "colours.svg";
  write_chart(file, {chart});
  const std::string drawn = read_file(file);
  EXPECT_EQ(times_in(drawn, "fill=\"none\" stroke=\"#0072b2"), 4U);  // two curves and their samples
  EXPECT_EQ(times_in(drawn, "fill=\"none\" stroke=\"#d55e00"),
            2U);  // a series without a colour uses the next
}

TEST(Chart, RefusesLengthsThatDoNotAgree) {
  const fs::path file = fresh_folder() / "chart.png";
  EXPECT_THROW(write_chart(file, {Chart{.series = {{.x = {1, 2}, .y = {1}}}}}), std::invalid_argument);
  EXPECT_THROW(write_chart(file, {}), std::invalid_argument);
}

TEST(Chart, GivesAnOutputErrorWhereItCannotWrite) {
  const fs::path absent = fresh_folder() / "absent";
  EXPECT_THROW(write_chart(absent / "chart.png", {force_curves()}), OutputError);
  EXPECT_THROW(write_chart(absent / "chart.svg", {force_curves()}), OutputError);
}

Tornado doubts(std::size_t rows) {
  Tornado tornado{.title = "What the force depends on",
                  .x_label = "effect on the force [%]",
                  .shade = 1.0,
                  .shade_text = "grey: no matter",
                  .legend = {{0, "not known"}, {1, "could be left out"}}};
  for (std::size_t n = 0; n < rows; ++n)
    tornado.rows.push_back({.name = "choice " + std::to_string(n),
                            .note = "this in place of that",
                            .low = n % 3 == 0 ? 0.0 : -12.0 / static_cast<double>(n),
                            .high = n % 3 == 1 ? 0.0 : 30.0 / static_cast<double>(n + 1),
                            .colour = static_cast<int>(n % 2)});
  return tornado;
}

TEST(Tornado, SaysEveryNameEveryEndAndEveryMeaning) {
  const std::vector<std::string> texts = expect_drawn(std::vector<Tornado>{doubts(5)});
  for (const char* text : {"choice 0", "choice 4", "this in place of that", "+30.0", "-12.0", "not known",
                           "could be left out", "grey: no matter", "effect on the force [%]"})
    EXPECT_THAT(texts, testing::Contains(testing::HasSubstr(text)));
}

TEST(Tornado, DrawsAnyNumberOfRowsAndNothing) {
  for (const std::size_t rows : {0, 1, 12, 60}) expect_drawn(std::vector<Tornado>{doubts(rows)});
  Tornado nothing = doubts(2);
  nothing.shade = 0.0;
  for (Tornado::Row& row : nothing.rows) row.low = row.high = 0.0;
  expect_drawn(std::vector<Tornado>{nothing});
}

TEST(Tornado, EndsBelowItsRowsAndGivesTheBarsTheRoomThatNamesLeave) {
  const fs::path folder = fresh_folder();
  const auto size_of = [&](const Tornado& tornado) {
    write_tornado(folder / "picture.png", {tornado});
    const auto image = decoded(folder / "picture.png");
    int bars = 0;  // pixels of their blue and orange
    for (int y = 0; y < image->GetDimensions()[1]; ++y)
      for (int x = 0; x < image->GetDimensions()[0]; ++x) {
        const auto* p = static_cast<const unsigned char*>(image->GetScalarPointer(x, y, 0));
        bars += std::abs(p[0] - p[2]) > 100;
      }
    return std::pair(image->GetDimensions()[1], bars);
  };
  Tornado few = doubts(4), named = few;
  for (Tornado::Row& row : named.rows) row.name += ", with a name that is as long as names are";
  const auto [few_tall, few_bars] = size_of(few);
  const auto [named_tall, named_bars] = size_of(named);
  EXPECT_LT(few_tall, 400);
  EXPECT_EQ(named_tall, few_tall);
  EXPECT_GT(few_bars, 1.15 * named_bars);
  EXPECT_EQ(size_of(doubts(60)).first, 650);
}

TEST(Tornado, RefusesABarThatEndsNowhere) {
  for (const double end : {nan, inf}) {
    Tornado tornado = doubts(3);
    tornado.rows[1].high = end;
    EXPECT_THROW(write_tornado(fresh_folder() / "picture.svg", {tornado}), std::invalid_argument);
  }
}

}  // namespace
}  // namespace dimple
