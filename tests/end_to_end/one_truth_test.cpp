// A number that appears in several places is the same: on the terminal, in summary.json, in force.csv, on the
// page, in explain.md. The picture's strings are made by the same functions (io/digits.hpp), which
// picture_test checks.

#include "io/digits.hpp"
#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

using Ordered = nlohmann::ordered_json;  // in the order of the page

/// Headline from the summary: "75.4 mN at 8.00 mm, 69.3 to 81.5 (discretisation)".
std::string headline(const Ordered& summary) {
  const double force = summary.at("force_N");
  const Written as = force_written(force);
  std::string text = as(force) + " at " + length_in_words(summary.at("indentation_mm"));
  if (summary.at("band").contains("low_N"))
    text += ", " + as.number(summary.at("band").at("low_N")) + " to " +
            as.number(summary.at("band").at("high_N")) + " (discretisation)";
  else
    text += ", no error estimate: " + summary.at("band").at("unknown").get<std::string>();
  if (summary.at("image_error").contains("half_N"))
    text += std::string(summary.at("band").contains("low_N") ? "," : ";") + " +- " +
            plain(as.per_unit * summary.at("image_error").at("half_N").get<double>(), 2) +
            " (image resolution)";
  return text;
}

class OneTruth : public testing::Test {
 protected:
  const fs::path folder = fresh_folder();
  Ran ran;
  Ordered summary;
  std::string page;

  void run(const std::string& words, int code = 0) {
    ran = dimple(folder, "run " + words);
    ASSERT_EQ(ran.code, code) << ran.err;
    summary = Ordered::parse(text_of(folder / "out/summary.json"));
    page = text_of(folder / "out/report.html");
  }
  void expect_on_stderr(const std::string& text) const {
    EXPECT_NE(ran.err.find(text), std::string::npos) << text << '\n' << ran.err;
  }

  void expect_one_force() const {
    EXPECT_EQ(ran.out.substr(0, ran.out.find('\t')), headline(summary));
    const Table curve = read_csv(folder / "out/force.csv");
    EXPECT_DOUBLE_EQ(curve.find("force_N")->back(), summary.at("force_N").get<double>());
    EXPECT_DOUBLE_EQ(curve.find("base_force_N")->back(), summary.at("base_force_N").get<double>());
    EXPECT_DOUBLE_EQ(curve.find("indentation_mm")->back(), summary.at("indentation_mm").get<double>());
    const Ordered drawn = held_by<Ordered>(page, "dimple-data").at("curve");
    EXPECT_DOUBLE_EQ(drawn.at("force_N").back().get<double>(), summary.at("force_N").get<double>());
    const Ordered& image = summary.at("image_error");
    if (image.contains("half_N"))
      EXPECT_DOUBLE_EQ(curve.find("image_half_N")->back(), image.at("half_N").get<double>());
    const Ordered& error_bounds = summary.at("band");
    if (!error_bounds.contains("low_N")) return;
    EXPECT_DOUBLE_EQ(curve.find("low_N")->back(), error_bounds.at("low_N").get<double>());
    EXPECT_DOUBLE_EQ(curve.find("high_N")->back(), error_bounds.at("high_N").get<double>());
    for (const char* bound : {"low_N", "high_N"})
      EXPECT_EQ(drawn.at(bound).get<std::vector<double>>(), *curve.find(bound)) << bound;
    EXPECT_NEAR(summary.at("verdict").at("accuracy").at("value").get<double>(),
                100.0 * error_bounds.at("half_N").get<double>() / summary.at("force_N").get<double>(), 1e-9);
  }

  // Expects that numbers on the page are those of the summary, in the terminal's unit and digits.
  void expect_the_page_to_say_what_the_summary_holds() const {
    EXPECT_EQ(held_by<Ordered>(page, "dimple-summary"), summary);
    const Ordered words = held_by<Ordered>(page, "dimple-words");
    const Written force = force_written(summary.at("force_N"));
    int forces = 0, volumes = 0, lengths = 0, fractions = 0;
    for (const auto& [key, word] : words.items()) {
      SCOPED_TRACE(key + ": " + word.dump());
      const double x =
          summary.at(Ordered::json_pointer("/" + std::regex_replace(key, std::regex("\\."), "/")));
      const std::string said = word[0].get<std::string>() + " " + word[1].get<std::string>();
      if (key.ends_with("_N")) {
        EXPECT_EQ(said, force(x));
        ++forces;
      }
      if (key.ends_with("_mm3")) {
        EXPECT_EQ(said, volume_in_words(x));
        ++volumes;
      }
      if (key.ends_with("_mm")) {
        EXPECT_EQ(said, length_in_words(x));
        ++lengths;
      }
      if (key.ends_with("_Pa")) EXPECT_EQ(said, stress_in_words(x));
      if (key.ends_with("value")) {
        EXPECT_EQ(said, percent(0.01 * x));
        ++fractions;
      }
      EXPECT_EQ(said.find('e'), std::string::npos);
      // Numbers are rounded to their last written digit; an error after its force has fewer than three.
      const std::string number = word[0];
      const std::size_t point = number.find('.'),
                        decimals = point == std::string::npos ? 0 : number.size() - point - 1;
      if (number[0] != '<')
        EXPECT_NEAR(std::stod(number), x * word[2].get<double>(),
                    0.5000001 * std::pow(10.0, -static_cast<double>(decimals)));
    }
    EXPECT_GE(forces, 2);
    EXPECT_GE(volumes, 4);
    EXPECT_GE(lengths, 5);
    EXPECT_GE(fractions, 4);
  }

  void expect_the_terminal_to_say_what_the_summary_holds() const {
    const Ordered &model = summary.at("model"), &counts = summary.at("counts");
    const auto count = [&](const char* what) { return std::to_string(counts.at(what).get<int>()); };
    expect_on_stderr("model    " + count("nodes") + " nodes: " + length_in_words(model.at("rim_spacing_mm")) +
                     " apart at the tool, " + length_in_words(model.at("largest_spacing_mm")) +
                     " far from it; " + count("integration_points") + " integration points");
    expect_on_stderr("organ    " + volume_in_words(model.at("organ_volume_mm3")) + "\n");
    expect_on_stderr("base     " + count("base_nodes") +
                     " nodes: " + model.at("base_reason").get<std::string>());
    expect_on_stderr("contact  " + count("circle_nodes") + " nodes, ");
    expect_on_stderr(model.at("circle_reason").get<std::string>());
  }

  // Expects that the parts add up to the total, and that the terminal shows the summary's parts except for
  // later ones.
  void expect_times_to_be_of_one_clock() const {
    const Ordered& parts = summary.at("parts_wall_s");
    const double total = summary.at("total_wall_s");
    double sum = 0.0;
    for (const auto& [name, s] : parts.items()) sum += s.get<double>();
    EXPECT_NEAR(sum, total, 1e-9 + 1e-9 * total);
    EXPECT_EQ(parts.at("solving"), summary.at("solve_wall_s"));
    EXPECT_EQ(parts.at("writing"), summary.at("write_wall_s"));
    std::smatch line;
    ASSERT_TRUE(std::regex_search(ran.err, line, std::regex("time     ([0-9.]+) s: ([^\n]*)"))) << ran.err;
    const double rounding = std::stod(line[1]) < 10.0 ? 0.0101 : 0.101;
    EXPECT_GE(std::stod(line[1]), total - rounding);
    const std::string remaining = line[2];
    for (const auto& [name, s] : parts.items()) {
      if (name == "starting and ending" || s.get<double>() < 2.0 * rounding) continue;
      std::smatch part;
      ASSERT_TRUE(std::regex_search(remaining, part, std::regex("([0-9.]+) " + name)))
          << name << ": " << remaining;
      EXPECT_NEAR(std::stod(part[1]), s.get<double>(), rounding) << name;
    }
  }

  void expect_one_truth() const {
    expect_one_force();
    expect_the_page_to_say_what_the_summary_holds();
    expect_the_terminal_to_say_what_the_summary_holds();
    expect_times_to_be_of_one_clock();
    EXPECT_EQ(summary.at("exit_code"), ran.code);
    const std::regex exponent("[0-9]e[-+][0-9]");
    for (const std::string& text : {ran.out, ran.err, summary.at("warnings").dump()})
      EXPECT_FALSE(std::regex_search(text, exponent)) << text;
  }
};

TEST_F(OneTruth, OfABlockWithItsErrorBoundsAndImages) {
  good(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3");
  run("block.nrrd -o out --nodes 1000 --depth 3mm --frames 4 --write all,images");
  expect_one_truth();
  EXPECT_GT(summary.at("parts_wall_s").at("images"), 0.0);
  EXPECT_TRUE(summary.at("band").contains("low_N"));
}

TEST_F(OneTruth, OfTwoTissuesWithoutErrorBounds) {
  good(folder, "phantom brain.nrrd --spacing 3");
  run("brain.nrrd -o out --nodes 700 --depth 2mm --frames 3 --write report --mu 20kPa --set "
      "tissue.left_hemisphere.mu=12500Pa");
  expect_one_truth();
  expect_on_stderr("mu 12.5 kPa");
  EXPECT_EQ(held_by<Ordered>(page, "dimple-words").at("material.0.mu_Pa"),
            Ordered::array({"20", "kPa", 1e-3}));
}

TEST_F(OneTruth, IsRepeatedFromAnyFolderByTheCommandOnThePage) {
  good(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3");
  ran = dimple(folder, {"run", "block.nrrd", "-o", "its $results", "--nodes", "400", "--depth", "1mm",
                        "--frames", "1", "--band", "off", "--write", "report"});
  ASSERT_EQ(ran.code, 0) << ran.err;
  std::string command = held_by<Ordered>(text_of(folder / "its $results" / "report.html"), "dimple-data")
                            .at("command")
                            .get<std::string>();
  const std::size_t program = command.find("&& dimple run ");
  ASSERT_NE(program, std::string::npos) << command;
  command.replace(program, 9, "&& " DIMPLE_PROGRAM);
  fs::create_directories(folder / "elsewhere");
  const Ran again = Program(folder / "elsewhere", {"-c", command}, "/bin/sh").wait();
  ASSERT_EQ(again.code, 0) << command << '\n' << again.err;
  EXPECT_EQ(text_of(folder / "again" / "force.csv"), text_of(folder / "its $results" / "force.csv"));
}

TEST_F(OneTruth, OfAnExplanationTooAndOfHowItEnded) {
  good(folder, "phantom block.nrrd --shape block --size 60,60,30 --spacing 3");
  run("block.nrrd -o out --nodes 500 --depth 2mm --frames 2 --band off --write report --explain --time-limit "
      "4s",
      130);
  EXPECT_EQ(summary.at("exit_code"), 130);
  EXPECT_EQ(summary.at("status"), "interrupted");
  EXPECT_EQ(summary.at("failure").at("code"), "out-of-time");
  EXPECT_EQ(held_by<Ordered>(page, "dimple-summary"), summary);
  if (!fs::exists(folder / "out/explain.md"))
    GTEST_SKIP() << "too slow a machine: no comparison came to its end";
  const std::string reported = text_of(folder / "out/explain.md");
  EXPECT_NE(
      reported.find("The run: " + force_in_words(summary.at("force_N")) + " at 2.00 mm with 500 nodes."),
      std::string::npos)
      << reported;
  EXPECT_NE(reported.find(" with 1500 nodes, so that "), std::string::npos) << reported;
  expect_times_to_be_of_one_clock();
  EXPECT_GT(summary.at("parts_wall_s").at("comparing"), 0.0);
}

}  // namespace
}  // namespace dimple
