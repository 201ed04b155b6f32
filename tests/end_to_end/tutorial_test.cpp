// The user's guide: commands of its tutorials work in the reader's order, print the lines that the page
// shows, and leave the files that it names. Commands of the how-to pages are accepted.

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

const fs::path guide_folder = fs::path(DIMPLE_SOURCE) / "apps" / "guide";

struct Step {
  std::string command;             ///< without the word dimple
  std::vector<std::string> shown;  ///< lines that the page shows of its output
};

struct CodeBlock {
  std::string language;  ///< after the backticks; empty: none
  std::vector<std::string> lines;
};

// Code blocks of a page; a line that ends with a backslash continues in the next.
std::vector<CodeBlock> blocks(const std::string& page) {
  std::vector<CodeBlock> all;
  std::istringstream in(page);
  bool within = false, continues = false;
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("```")) {
      within = !within;
      if (within) all.push_back({line.substr(3), {}});
      continue;
    }
    if (!within) continue;
    if (continues)
      all.back().lines.back() += line.substr(line.find_first_not_of(' '));
    else
      all.back().lines.push_back(line);
    continues = line.ends_with('\\');
    if (continues) all.back().lines.back().pop_back();
  }
  return all;
}

std::vector<Step> steps(const std::string& page) {
  std::vector<Step> all;
  for (const CodeBlock& block : blocks(page)) {
    bool ours = false;
    for (const std::string& line : block.lines) {
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

// Replaces times, which differ between machines, and line breaks. All other text must agree to the digit.
std::string without_times(const std::string& text) {
  return std::regex_replace(std::regex_replace(text, std::regex("[0-9]+(\\.[0-9]+)? s\\b"), "# s"),
                            std::regex("\\s+"), " ");
}

// First words of the commands that were run. --explain takes a minute; runs_test checks its lines.
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

// Number of files that the page names; each must exist.
int files_named(const std::string& page, const fs::path& folder) {
  const std::regex named("[ `(=\"]((out|fit|paper|shift|slide|cut)/[0-9a-z_./]*[a-z])");
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
  const std::string page = text_of(guide_folder / "tutorials/figure.md");
  for (const CodeBlock& block : blocks(page))
    if (!block.lines.empty() && block.lines.front().starts_with("indentation_mm,")) {
      std::ofstream file(folder / "measured.csv");
      for (const std::string& line : block.lines) file << line << '\n';
    }
  EXPECT_EQ(tried_of(page, folder), (std::set<std::string>{"cite", "fit", "info", "phantom", "run"}));
  EXPECT_GE(files_named(page, folder), 6);
}

TEST(Tutorial, OfACraniotomySaysWhatThePageShows) {
  const fs::path folder = fresh_folder();
  const std::string page = text_of(guide_folder / "tutorials/craniotomy.md");
  EXPECT_EQ(tried_of(page, folder), (std::set<std::string>{"phantom", "shift"}));
  EXPECT_GE(files_named(page, folder), 6);
}

TEST(Tutorial, OfAnInstrumentSaysWhatThePageShows) {
  const fs::path folder = fresh_folder();
  const std::string page = text_of(guide_folder / "tutorials/instrument.md");
  EXPECT_EQ(tried_of(page, folder), (std::set<std::string>{"phantom", "run"}));
  EXPECT_GE(files_named(page, folder), 4);
}

TEST(Guide, GettingStartedSaysWhatThePageShows) {
  const fs::path folder = fresh_folder();
  const std::string page = text_of(guide_folder / "getting-started.md");
  EXPECT_EQ(tried_of(page, folder), (std::set<std::string>{"info", "phantom", "places", "run"}));
  EXPECT_GE(files_named(page, folder), 4);
}

// Expects that a command of a page, without its files, is accepted and then misses a file (3).
void expect_understood(const fs::path& folder, const std::string& command) {
  SCOPED_TRACE(command);
  if (command.starts_with("poke") && command.find("--s") == std::string::npos) return;  // opens a window
  std::smatch config;
  if (std::regex_search(command, config, std::regex("--config (\\S+/\\S+)"))) {
    fs::create_directories(folder / fs::path(config[1].str()).parent_path());
    std::ofstream(folder / config[1].str()) << "[image]\nfile = \"absent.nrrd\"\n";
  }
  const Ran ran = dimple(folder, command);
  EXPECT_EQ(ran.code, 3) << ran.err;
}

TEST(Guide, ShowsCommandsAndFilesOfOptionsThatAreUnderstood) {
  int commands = 0, files = 0;
  for (const fs::directory_entry& page : fs::directory_iterator(guide_folder / "how-to")) {
    SCOPED_TRACE(page.path().filename());
    const std::string text = text_of(page.path());
    for (const Step& step : steps(text)) {
      expect_understood(fresh_folder(), step.command);
      ++commands;
    }
    for (const CodeBlock& block : blocks(text)) {
      if (block.language != "toml") continue;
      const fs::path folder = fresh_folder();
      {
        std::ofstream file(folder / "options.toml");
        for (const std::string& line : block.lines) file << line << '\n';
      }
      expect_understood(folder, "run absent.nrrd -o out --config options.toml");
      ++files;
    }
  }
  EXPECT_GE(commands, 30);
  EXPECT_GE(files, 6);
}

std::set<std::string> found_in(const std::string& text, const char* pattern) {
  const std::regex searched(pattern);
  std::set<std::string> found;
  for (std::sregex_iterator one(text.begin(), text.end(), searched), end; one != end; ++one)
    found.insert((*one)[1]);
  return found;
}

TEST(Guide, NamesOnlyFlagsAndKeysThatThereAre) {
  const fs::path folder = fresh_folder();
  std::set<std::string> flags = found_in(good(folder, "completion bash").out, "(--[a-z][a-z-]*)");
  flags.insert({"--array", "--install", "--preset", "--state"});  // of sbatch, cmake and ParaView
  const std::set<std::string> keys = found_in(good(folder, "options").out, "\n  ([a-zA-Z_.0-9]+) ");
  std::vector<fs::path> pages = {fs::path(DIMPLE_SOURCE) / "README.md"};
  for (const fs::directory_entry& page : fs::recursive_directory_iterator(guide_folder))
    if (page.path().extension() == ".md") pages.push_back(page.path());
  EXPECT_GE(pages.size(), 25u);
  for (const fs::path& page : pages) {
    SCOPED_TRACE(page);
    const std::string text = text_of(page);
    for (const std::string& flag : found_in(text, "[ `](--[a-z][a-z-]*)"))
      EXPECT_EQ(flags.count(flag), 1u) << flag;
    for (const std::string& key :
         found_in(text, "`((?:image|material|load|solver|accuracy|output|step|wall)\\.[a-zA-Z_.0-9]+)`"))
      EXPECT_EQ(keys.count(key), 1u) << key;
  }
}

}  // namespace
}  // namespace dimple
