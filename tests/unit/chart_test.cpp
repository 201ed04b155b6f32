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

/// The texts in an SVG, as a reader sees them; a test failure where it is not XML.
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

/// Drawn both ways: a PNG of the right size that is not empty, an SVG that is XML without numbers that are
/// none. Returns the texts.
template <class Panel>
std::vector<std::string> expect_drawn(const std::vector<Panel>& panels, int columns = 1) {
  const fs::path folder = fresh_folder();
  if constexpr (std::is_same_v<Panel, Chart>) {
    EXPECT_NO_THROW(write_chart_png(folder / "picture.png", panels, columns));
    EXPECT_NO_THROW(write_chart_svg(folder / "picture.svg", panels, columns));
  } else {
    EXPECT_NO_THROW(write_tornado_png(folder / "picture.png", panels, columns));
    EXPECT_NO_THROW(write_tornado_svg(folder / "picture.svg", panels, columns));
  }
  const int count = static_cast<int>(panels.size()), across = std::min(columns, count);
  const auto image = decoded(folder / "picture.png");
  EXPECT_EQ(image->GetDimensions()[0], 1000 * across);
  EXPECT_EQ(image->GetDimensions()[1], 650 * ((count + across - 1) / across));
  EXPECT_LT(image->GetScalarRange()[0], 140.0);
  const std::string svg = read_file(folder / "picture.svg");
  for (const char* bad : {"\"nan", "\"inf", "\"-nan", "\"-inf", " nan", " inf", "href"})
    EXPECT_EQ(svg.find(bad), std::string::npos) << bad;
  return texts_of(svg);
}

std::vector<std::string> expect_drawn(const Chart& chart) {
  return expect_drawn(std::vector<Chart>{chart});
}

/// Five series of four labelled points on logarithmic axes, some of them close together.
Chart accuracy_against_time() {
  Chart chart;
  chart.title = "Error against computing time";
  chart.subtitle = {"brain.nrrd, 8 mm indentation; each point is one cloud, labelled by its number of nodes",
                    "error of the force against the finest finite element model"};
  chart.x_label = "computing time [s]";
  chart.y_label = "error of the force [%]";
  chart.log_x = chart.log_y = true;
  const std::vector<std::string> names{"even cloud", "graded cloud", "averaged gradients",
                                       "linear tetrahedra", "quadratic tetrahedra"};
  for (std::size_t n = 0; n < names.size(); ++n) {
    ChartSeries s;
    s.name = names[n];
    for (int i = 0; i < 4; ++i) {
      const auto k = static_cast<double>(n);
      s.x.push_back(0.6 * std::pow(6.0, i) * (1.0 + 0.35 * k));
      s.y.push_back(30.0 * std::pow(0.36 + 0.03 * k, i) * (1.0 - 0.12 * k));
      s.label.push_back(std::to_string(1000 << (i + i)) + (n > 2 ? " el." : ""));
    }
    s.dashed = n == 3;
    s.hollow = n == 4;
    chart.series.push_back(s);
  }
  chart.lines = {{true, 8.0, "real time"}, {false, 2.0, "2 %"}};
  return chart;
}

TEST(Chart, IsAPngOf1000By650PixelsAPanelDrawnWithoutADisplay) {
  ::unsetenv("DISPLAY");
  expect_drawn(accuracy_against_time());
}

TEST(Chart, PutsPanelsInAGrid) {
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
  expect_drawn<Chart>({accuracy_against_time(), curve, Chart{.title = "nothing yet"}}, 2);
}

TEST(Chart, IsTheSameFileForTheSameInput) {
  const fs::path folder = fresh_folder();
  for (const char* name : {"a", "b"}) {
    write_chart_png(folder / (std::string(name) + ".png"), {accuracy_against_time()});
    write_chart_svg(folder / (std::string(name) + ".svg"), {accuracy_against_time()});
  }
  EXPECT_EQ(read_file(folder / "a.png"), read_file(folder / "b.png"));
  EXPECT_EQ(read_file(folder / "a.svg"), read_file(folder / "b.svg"));
}

TEST(Chart, SaysEveryNameAndEveryLabel) {
  const Chart chart = accuracy_against_time();
  const std::vector<std::string> texts = expect_drawn(chart);
  for (const ChartSeries& s : chart.series) {
    EXPECT_THAT(texts, testing::Contains(s.name));
    for (const std::string& label : s.label) EXPECT_THAT(texts, testing::Contains(label));
  }
  for (const ChartLine& line : chart.lines) EXPECT_THAT(texts, testing::Contains(line.text));
  EXPECT_THAT(texts, testing::Contains(chart.title));
  EXPECT_THAT(texts, testing::Contains(chart.x_label));
  EXPECT_THAT(texts, testing::Contains(chart.y_label));
}

TEST(Chart, CarriesTheWholeOfATextThatItHadToShorten) {
  Chart chart = accuracy_against_time();
  chart.series[1].name = std::string(300, 'W') + " end";
  EXPECT_THAT(expect_drawn(chart), testing::Contains(chart.series[1].name));
}

TEST(Chart, EscapesWhatXmlWouldTakeForMarkup) {
  Chart chart = accuracy_against_time();
  chart.series[0].name = R"(</text><script>a & "b" > 'c'</script>)";
  chart.series[0].label[2] = "<&>";
  chart.title = "a < b & c";
  const std::vector<std::string> texts = expect_drawn(chart);
  EXPECT_THAT(texts, testing::Contains(chart.series[0].name));
  EXPECT_THAT(texts, testing::Contains("<&>"));
  EXPECT_THAT(texts, testing::Contains("a < b & c"));
}

TEST(Chart, SurvivesAnyText) {
  Chart chart = accuracy_against_time();
  chart.title = std::string(3000, 'W') + "\xFF\xFE \n\t \xE2\x82";
  chart.subtitle = {
      std::string(5000, 'x'), "", "   ", "\xC2", "\xE8\x84\xB3 \xEF\xBF\xBF \xED\xA0\x80 \x01", "a", "b"};
  chart.x_label = std::string(1, '\0') + std::string(900, 'l');
  chart.series[0].name = "\xCE\xBB = 3, \xF0\x9F\xA7\xA0";
  chart.series[0].label[0] = std::string(400, 'q');
  chart.series[1].label = {"", " ", "\x7F", "\t"};
  chart.lines[0].text = std::string(400, 'r');
  EXPECT_THAT(expect_drawn(chart), testing::Contains(chart.series[0].name));
}

TEST(Chart, SaysThatThereIsNoData) {
  EXPECT_THAT(expect_drawn(Chart{}), testing::Contains("no data"));
  Chart log;
  log.log_x = log.log_y = true;
  log.series = {{.name = "none"}, {.name = "no numbers", .x = {nan, 1.0}, .y = {1.0, inf}}};
  const std::vector<std::string> texts = expect_drawn(log);
  EXPECT_THAT(texts, testing::Contains("no data"));
  EXPECT_THAT(texts, testing::Contains("no numbers"));
}

TEST(Chart, LeavesAGapWhereAValueIsNotFinite) {
  Chart chart;
  chart.series = {
      {.name = "gap", .x = {0, 1, 2, 3, 4}, .y = {1, 2, nan, 2, inf}, .label = {"a", "b", "c", "d", "e"}}};
  const std::vector<std::string> texts = expect_drawn(chart);
  EXPECT_THAT(texts, testing::Contains("d"));
  EXPECT_THAT(texts, testing::Not(testing::Contains("c")));
  EXPECT_THAT(texts, testing::Not(testing::Contains("e")));
}

TEST(Chart, CountsWhatALogarithmicAxisCannotShow) {
  Chart chart;
  chart.log_x = chart.log_y = true;
  chart.series = {{.name = "a", .x = {-1, 1, 2, 3}, .y = {1, 0, 2, 3}}, {.name = "b", .x = {5}, .y = {-2}}};
  chart.lines = {{false, -1.0, "below"}, {true, nan, "nowhere"}};
  EXPECT_THAT(expect_drawn(chart),
              testing::Contains("3 points not shown: not positive on a logarithmic axis"));
}

TEST(Chart, CountsWhatARangeLeavesOut) {
  Chart chart = accuracy_against_time();
  chart.x_range = {1.0, 100.0};
  chart.y_range = {0.1, 20.0};
  EXPECT_THAT(expect_drawn(chart), testing::Contains(testing::EndsWith("outside the range shown")));
}

TEST(Chart, DrawsASinglePoint) {
  for (const bool log : {false, true}) {
    Chart chart;
    chart.log_x = chart.log_y = log;
    chart.series = {{.name = "one", .x = {3.0}, .y = {4e-9}, .label = {"here"}, .markers = log}};
    EXPECT_THAT(expect_drawn(chart), testing::Contains("here"));
  }
}

TEST(Chart, DrawsValuesThatAreAllEqual) {
  for (const double value : {0.0, 5.0, -1e-200, 1e300, 1e9})
    for (const bool log : {false, true}) {
      SCOPED_TRACE(testing::Message() << value << " log " << log);
      Chart chart;
      chart.log_x = chart.log_y = log;
      chart.series = {{.name = "same", .x = {value, value, value}, .y = {value, value, value}}};
      expect_drawn(chart);
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
                             {1e-9, 1e9}})
    for (const bool log : {false, true}) {
      SCOPED_TRACE(testing::Message() << values[0] << " to " << values[1] << " log " << log);
      Chart chart;
      chart.log_x = chart.log_y = log;
      chart.series = {{.name = "wide", .x = values, .y = values}};
      expect_drawn(chart);
    }
}

TEST(Chart, DrawsManySeriesWithManyLabels) {
  Chart chart;
  for (int n = 0; n < 40; ++n)
    chart.series.push_back({.name = "a series with quite a long name, number " + std::to_string(n),
                            .x = {1.0, 2.0},
                            .y = {1.0 * n, 2.0 * n},
                            .label = {"left", "right"}});
  expect_drawn(chart);
}

TEST(Chart, GivesTheSameColourToTheSameNumber) {
  Chart chart;
  chart.series = {{.name = "a", .x = {1, 2}, .y = {1, 2}},
                  {.name = "b", .x = {1, 2}, .y = {2, 3}, .colour = 0},
                  {.name = "c", .x = {1, 2}, .y = {3, 4}, .hollow = true, .colour = 0}};
  const fs::path file = fresh_folder() / "colours.svg";
  write_chart_svg(file, {chart});
  const std::string drawn = read_file(file);
  const auto lines_of = [&](const std::string& hue) {
    std::size_t count = 0;
    for (std::size_t at = 0; (at = drawn.find("fill=\"none\" stroke=\"" + hue, at)) != std::string::npos;
         ++at)
      ++count;
    return count;
  };
  EXPECT_EQ(lines_of("#0072b2"), 4U);  // two curves and their samples
  EXPECT_EQ(lines_of("#d55e00"), 2U);  // the one that asked for nothing takes the next
}

TEST(Chart, RefusesLengthsThatDoNotAgree) {
  const fs::path file = fresh_folder() / "chart.png";
  EXPECT_THROW(write_chart_png(file, {Chart{.series = {{.x = {1, 2}, .y = {1}}}}}), std::invalid_argument);
  EXPECT_THROW(write_chart_png(file, {Chart{.series = {{.x = {1}, .y = {1}, .label = {"a", "b"}}}}}),
               std::invalid_argument);
  EXPECT_THROW(write_chart_png(file, {Chart{.x_range = {{2.0, 1.0}}}}), std::invalid_argument);
  EXPECT_THROW(write_chart_png(file, {Chart{.log_x = true, .x_range = {{0.0, 1.0}}}}), std::invalid_argument);
  EXPECT_THROW(write_chart_png(file, {Chart{}}, 0), std::invalid_argument);
  EXPECT_THROW(write_chart_png(file, {}), std::invalid_argument);
}

TEST(Chart, GivesAnOutputErrorWhereItCannotWrite) {
  const fs::path absent = fresh_folder() / "absent";
  EXPECT_THROW(write_chart_png(absent / "chart.png", {accuracy_against_time()}), OutputError);
  EXPECT_THROW(write_chart_svg(absent / "chart.svg", {accuracy_against_time()}), OutputError);
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

TEST(Tornado, RefusesABarThatEndsNowhere) {
  for (const double end : {nan, inf}) {
    Tornado tornado = doubts(3);
    tornado.rows[1].high = end;
    EXPECT_THROW(write_tornado_svg(fresh_folder() / "picture.svg", {tornado}), std::invalid_argument);
  }
}

}  // namespace
}  // namespace dimple
