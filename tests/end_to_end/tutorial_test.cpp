// sample_data/tutorial.md and craniotomy.md: their commands work in the order in which a reader types them,
// say what the page shows, and leave the files that it names.

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

std::string page_of(const char* name) {
  return text_of(fs::path(DIMPLE_SAMPLE_DATA) / name);
}

struct Step {
  std::string command;             ///< after the word dimple
  std::vector<std::string> shown;  ///< lines that the page shows of its output
};

std::vector<std::vector<std::string>> blocks(const std::string& page) {
  std::vector<std::vector<std::string>> all;
  std::istringstream in(page);
  bool within = false;
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("```")) {
      within = !within;
      if (within) all.emplace_back();
    } else if (within) {
      all.back().push_back(line);
    }
  return all;
}

std::vector<Step> steps(const std::string& page) {
  std::vector<Step> all;
  for (const auto& block : blocks(page)) {
    bool ours = false;
    for (const std::string& line : block) {
      const std::string typed = line.starts_with("$ ") ? line.substr(2) : line;
      if (typed.starts_with("dimple ")) {
        all.push_back({.command = typed.substr(7, typed.find("  ") - 7), .shown = {}});
        ours = line.starts_with("$ ");
      } else if (ours && !line.empty() && line != "...") {
        all.back().shown.push_back(line);
      }
    }
  }
  return all;
}

// Times are other ones on other machines, and lines end anywhere. All else is as the page has it, to the
// digit.
std::string without_times(const std::string& text) {
  return std::regex_replace(std::regex_replace(text, std::regex("[0-9]+(\\.[0-9]+)? s\\b"), "# s"),
                            std::regex("\\s+"), " ");
}

// The commands that were tried, by their first word. --explain takes a minute, its lines are tried by
// runs_test.
std::set<std::string> tried_of(const std::string& page, const fs::path& folder) {
  std::set<std::string> tried;
  for (const Step& step : steps(page)) {
    if (step.command.find("--explain") != std::string::npos) continue;
    SCOPED_TRACE(step.command);
    const Ran ran = good(folder, step.command);
    const std::string said = without_times(ran.out + ran.err);
    for (const std::string& line : step.shown)
      EXPECT_THAT(said, HasSubstr(without_times(line))) << line << ran.err;
    tried.insert(step.command.substr(0, step.command.find(' ')));
  }
  return tried;
}

// How many files the page names; each is there.
int files_named(const std::string& page, const fs::path& folder) {
  const std::regex named("[ `(=\"]((out|fit|paper|shift)/[a-z_./]*[a-z])");
  int there = 0;
  for (std::sregex_iterator name(page.begin(), page.end(), named), end; name != end; ++name) {
    const std::string file = (*name)[1];
    if (file.starts_with("out/explain.")) continue;
    EXPECT_TRUE(fs::exists(folder / file)) << file;
    ++there;
  }
  return there;
}

TEST(Tutorial, CommandsWorkInTheirOrderAndSayWhatThePageShows) {
  const fs::path folder = fresh_folder();
  const std::string page = page_of("tutorial.md");
  for (const auto& block : blocks(page))
    if (!block.empty() && block.front().starts_with("indentation_mm,")) {
      std::ofstream file(folder / "measured.csv");
      for (const std::string& line : block) file << line << '\n';
    }
  EXPECT_EQ(tried_of(page, folder), (std::set<std::string>{"cite", "fit", "info", "phantom", "run"}));
  EXPECT_GE(files_named(page, folder), 10);
}

TEST(Tutorial, OfACraniotomySaysWhatThePageShows) {
  const fs::path folder = fresh_folder();
  const std::string page = page_of("craniotomy.md");
  EXPECT_EQ(tried_of(page, folder), (std::set<std::string>{"phantom", "shift"}));
  EXPECT_GE(files_named(page, folder), 6);
}

}  // namespace
}  // namespace dimple
