#include <fcntl.h>
#include <unistd.h>

#include "io/digits.hpp"
#include "tests/end_to_end/in_folder.hpp"

// Output for a person: on a terminal, in a log, in the help.

namespace dimple {
namespace {

const std::vector<std::string> commands = {"phantom", "info",    "places",  "model",     "solve",  "run",
                                           "batch",   "collect", "compare", "fit",       "export", "options",
                                           "cite",    "doctor",  "man",     "completion"};

class Terminal : public InFolder {};

// True if there are terminals; a container may have none.
bool has_terminals() {
  const int terminal = posix_openpt(O_RDWR | O_NOCTTY);
  const bool has = terminal >= 0 && grantpt(terminal) == 0 && unlockpt(terminal) == 0 &&
                   ptsname(terminal) != nullptr && fs::exists(ptsname(terminal));
  if (terminal >= 0) close(terminal);
  return has;
}
constexpr const char* no_terminal = "no pseudo-terminal can be had here (/dev/pts)";

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) {
    line.erase(std::remove(line.begin(), line.end(), '\r'), line.end());
    lines.push_back(line);
  }
  return lines;
}

// Final lines on a terminal: a carriage return overwrites the line before it.
std::vector<std::string> shown(const std::string& sent) {
  const std::string plain = std::regex_replace(sent, std::regex("\033\\[[0-9;]*m"), "");
  std::vector<std::string> lines(1);
  for (std::size_t k = 0; k < plain.size(); ++k)
    if (plain.compare(k, 4, "\r\033[K") == 0) {
      lines.back().clear();
      k += 3;
    } else if (plain[k] == '\n') {
      lines.emplace_back();
    } else if (plain[k] != '\r') {
      lines.back() += plain[k];
    }
  if (lines.back().empty()) lines.pop_back();
  return lines;
}

void expect_times_add_up(const std::string& text) {
  std::smatch line;
  ASSERT_TRUE(std::regex_search(text, line, std::regex("time     ([0-9.]+) s: ([^\n]*)"))) << text;
  double sum = 0.0;
  const std::string parts = line[2];
  const std::regex part("([0-9.]+) [a-z]");
  for (auto p = std::sregex_iterator(parts.begin(), parts.end(), part); p != std::sregex_iterator(); ++p)
    sum += std::stod((*p)[1]);
  EXPECT_NEAR(sum, std::stod(line[1]), 1e-6) << line[0];
}

TEST_F(Terminal, ANovicesRunIsATwelveLinesAtMost) {
  EXPECT_EQ(good("phantom brain.nrrd").err, "");
  const auto begun = std::chrono::steady_clock::now();
  const Ran run = good("run brain.nrrd -o out");
  const double passed = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  EXPECT_LE(lines_of(run.err).size() + lines_of(run.out).size(), 12u) << run.err << run.out;
  EXPECT_THAT(run.err, Not(HasSubstr("\r")));
  expect_words(run.err, {"image ", "organ ", "base ", "contact ", "solving  50 %", "open     out/"});
  for (const char* word : {"slivers", "conditioning", "waves", "residual"})
    EXPECT_THAT(run.err, Not(HasSubstr(word)));
  EXPECT_THAT(run.out,
              testing::MatchesRegex("[0-9.]+ mN at 8\\.00 mm, [0-9.]+ to [0-9.]+ \\(discretisation\\), \\+- "
                                    "[0-9.]+ \\(image resolution\\)\tout\n"));
  expect_times_add_up(run.err);
  // The reported total covers the whole run and is not more than the elapsed time.
  std::smatch total;
  ASSERT_TRUE(std::regex_search(run.err, total, std::regex("time     ([0-9.]+) s")));
  const Json summary = summary_of(folder / "out");
  constexpr double rounding = 0.06;
  EXPECT_LE(std::stod(total[1]), passed + rounding);
  EXPECT_GE(std::stod(total[1]), summary.at("total_wall_s").get<double>() - rounding);
}

TEST_F(Terminal, WhatANoviceIsSparedIsThereOnRequest) {
  good("phantom block.nrrd --shape block --size 60,60,30 --spacing 3");
  const Ran run = good("run block.nrrd -o out -v --nodes 300 --depth 1 --frames 10 --write force");
  expect_words(run.err, {"slivers", "conditioning", "waves", "residual", "load ", "mass ", "solving  10 %"});
  expect_times_add_up(run.err);
}

TEST_F(Terminal, OneLineRenewsItselfAndIsGoneInTheEnd) {
  if (!has_terminals()) GTEST_SKIP() << no_terminal;
  good("phantom block.nrrd --shape block --size 60,60,30 --spacing 3");
  const Ran run = dimple_on_terminal(
      folder, words_of("run block.nrrd -o out --nodes 300 --depth 1 --frames 4 --write force"), 100);
  EXPECT_EQ(run.code, 0) << run.out;
  for (const char* part : {"reading", "surface", "cloud", "supports", "solving", "writing"})
    EXPECT_TRUE(
        std::regex_search(run.out, std::regex(std::string("\r\033\\[K") + part + " +\\[=* *\\] .*left")))
        << "no line for " << part << " in\n"
        << run.out;
  const std::vector<std::string> lines = shown(run.out);
  EXPECT_LE(lines.size(), 12u) << run.out;
  for (const std::string& line : lines) EXPECT_THAT(line, Not(HasSubstr(" left")));
  // Progress lines fit into one line of the terminal.
  for (const int columns : {40, 60}) {
    const Ran narrow = dimple_on_terminal(
        folder, words_of("run block.nrrd -o out --force --nodes 300 --depth 1 --frames 4 --write force"),
        columns);
    const std::regex drawn("\r\033\\[K([^\r\n]*)");
    for (auto line = std::sregex_iterator(narrow.out.begin(), narrow.out.end(), drawn);
         line != std::sregex_iterator(); ++line) {
      if ((*line)[1].str().find(" [") == 9) {
        EXPECT_LT((*line)[1].length(), columns) << (*line)[1];
      }
    }
  }
}

TEST_F(Terminal, HelpIsAsWideAsTheTerminal) {
  if (!has_terminals()) GTEST_SKIP() << no_terminal;
  for (const int columns : {60, 80, 120, 200}) {
    std::size_t longest = 0;
    for (const std::string& command : commands)
      for (const char* help : {"--help", "--help-all"}) {
        const Ran ran = dimple_on_terminal(folder, {command, help}, columns);
        EXPECT_EQ(ran.code, 0) << command;
        for (const std::string& line : lines_of(ran.out)) {
          EXPECT_LE(line.size(), static_cast<std::size_t>(columns)) << command << ": " << line;
          longest = std::max(longest, line.size());
        }
      }
    EXPECT_GT(longest, static_cast<std::size_t>(columns) * 4 / 5) << "the width is not made use of";
    for (const std::string& line : lines_of(dimple_on_terminal(folder, {"options"}, columns).out))
      EXPECT_LE(line.size(), static_cast<std::size_t>(columns)) << line;
  }
}

TEST_F(Terminal, HelpIsEightyWideWhereThereIsNoTerminal) {
  std::vector<std::string> all = {"", "--help", "--help-all", "options", "--version"};
  for (const std::string& command : commands) {
    all.push_back(command + " --help");
    all.push_back(command + " --help-all");
  }
  for (const std::string& command : all) {
    const Ran ran = good(command);
    EXPECT_FALSE(ran.out.empty()) << command;
    EXPECT_EQ(ran.err, "") << command;
    for (const std::string& line : lines_of(ran.out)) EXPECT_LE(line.size(), 80u) << command << ": " << line;
  }
  EXPECT_THAT(good("options").out, HasSubstr("material.mu_Pa"));
}

TEST_F(Terminal, HelpShowsWhatIsCommonAndAllOnRequest) {
  const std::string common = good("run --help").out, all = good("run --help-all").out;
  for (const char* flag :
       {"--label", "--depth", "--mu", "--indent-at", "--accuracy", "--nodes", "--help-all"}) {
    EXPECT_THAT(common, HasSubstr(flag));
    EXPECT_THAT(all, HasSubstr(flag));
  }
  for (const char* flag : {"--safety", "--support", "--seed", "--rim"}) {
    EXPECT_THAT(common, Not(HasSubstr(flag)));
    EXPECT_THAT(all, HasSubstr(flag));
  }
  EXPECT_LT(all.find("--depth"), all.find("--safety"));
  EXPECT_LE(lines_of(common).size(), 60u) << "more than a page: " << common;
}

TEST_F(Terminal, EveryLengthTimeAndModulusTakesAUnitOrNone) {
  good("phantom a.nrrd --shape block --size 60,60,30 --spacing 3");
  const auto force = [&](const std::string& options) {
    good("run a.nrrd -o out --force --quiet --nodes 300 --frames 2 --write force " + options);
    return text_of(folder / "out" / "force.csv");
  };
  const std::string plain =
      "--indent-at 3,-2,30 --indenter-diameter 12 --depth 1 --mu 300 --base inferior --time-limit 600";
  EXPECT_EQ(
      force(plain),
      force(
          "--indent-at 3mm,-0.2cm,0.03m --indenter-diameter 1.2cm --depth 1000um --mu 0.3kPa --base inferior "
          "--time-limit 10min"));
  EXPECT_EQ(force("--set material.ogden_mu=842 --set material.ogden_alpha=-4.7"),
            force("--set material.ogden_mu_Pa=0.842kPa --set material.ogden_alpha=-4.7"));
}

TEST_F(Terminal, ALabelIsFoundByItsNameInTheUsualNumberings) {
  good("phantom brain.nrrd --two-labels --spacing 3");
  const std::string run = "run brain.nrrd -o out --force --nodes 300 --depth 0.5 --frames 2 --write force ";
  EXPECT_THAT(good(run + "--label-names freesurfer --label left-cerebral-white-matter").err,
              HasSubstr("chosen: 2 (Left-Cerebral-White-Matter)"));
  EXPECT_THAT(good(run + "--label-names totalsegmentator --label kidney_right").err,
              HasSubstr("chosen: 2 (kidney_right)"));
  good("phantom plain.nrrd --shape block --size 60,60,30 --spacing 3");
  ends_with(folder, 3, "run plain.nrrd -o out --force --label liver",
            {"label 5 of totalsegmentator", "--label-names totalsegmentator"});
}

TEST_F(Terminal, CitesWhatTheCitationFileSays) {
  std::string text = good("cite").out;
  const std::string bibtex = good("cite --bibtex").out,
                    file = text_of(fs::path(DIMPLE_SOURCE) / "CITATION.cff");
  std::replace(text.begin(), text.end(), '\n', ' ');
  int compared = 0;
  const std::regex field(
      "\n *(- )?(title|name|family-names|given-names|collection-title|version|year): *\"?([^\"\n]*)\"?");
  for (auto part = std::sregex_iterator(file.begin(), file.end(), field); part != std::sregex_iterator();
       ++part) {
    EXPECT_THAT(text, HasSubstr((*part)[3].str()));
    EXPECT_THAT(bibtex, HasSubstr((*part)[3].str()));
    ++compared;
  }
  EXPECT_GE(compared, 11);
}

TEST_F(Terminal, TheDoctorReportsWhetherTheProgramWorksHere) {
  const Ran well = good("doctor");
  const std::string said = std::regex_replace(well.out, std::regex("\\s+"), " ");  // without line breaks
  expect_words(said, {"ITK", "VTK", "oneTBB", "threads", "SIMD", "memory", "self test", "by finite elements",
                      "temporary", "output", "locale"});
  EXPECT_THAT(well.out, Not(HasSubstr("wrong")));
  const Table known = read_csv(DIMPLE_SOURCE "/tests/verification/reference/block.csv");
  const auto& depth = *known.find("indentation_mm");
  const auto at = std::find(depth.begin(), depth.end(), 5.0) - depth.begin();
  EXPECT_THAT(said, HasSubstr(force_in_words((*known.find("force_N"))[static_cast<std::size_t>(at)]) +
                              " by finite elements"));
  const auto reported = nlohmann::json::parse(good("doctor --json").out);
  EXPECT_GE(reported.at("checks").size(), 8U);
  for (const auto& check : reported.at("checks")) EXPECT_TRUE(check.at("ok").get<bool>()) << check;
  const Ran ill = dimple(folder, "doctor -o /proc");  // where no file can be made
  EXPECT_EQ(ill.code, 6);
  EXPECT_THAT(ill.out, HasSubstr("/proc cannot be written"));
}

// Output of a script in a shell; empty if there is no such shell.
std::string said_by(const std::string& shell, const std::string& script) {
  if (std::system(("command -v " + shell + " > /dev/null 2>&1").c_str()) != 0) return {};
  const fs::path out = test_folder() / "said_by_a_shell";
  const int code = std::system((shell + " -c '" + script + "' > " + out.string() + " 2>&1").c_str());
  return text_of(out) + (code == 0 ? "" : "\nended with an error");
}

// `make demo` builds such a program.
TEST_F(Terminal, AProgramOfOneRunSaysHowTheOtherCommandsAreBuilt) {
  const fs::path alone = folder / "alone";
  fs::copy_file(DIMPLE_PROGRAM, alone);
  const auto ran = [&](const std::string& words) {
    return Program(folder, words_of(words), alone.string()).wait();
  };
  EXPECT_EQ(ran("--help").out, good("--help").out);
  for (const std::string words : {"fit --help", "export brain.nrrd -o brain.inp", "poke brain.nrrd --fps 25",
                                  "run brain.nrrd -o out --explain", "man run"}) {
    const Ran refused = ran(words);
    EXPECT_EQ(refused.code, 2) << words;
    EXPECT_THAT(refused.err, HasSubstr("has not been built")) << words;
    EXPECT_THAT(refused.err, HasSubstr("`make build` builds all of them")) << words;
  }
  EXPECT_EQ(ran("run --no-such-option").code, 2);
  EXPECT_FALSE(fs::exists(folder / "out"));
}

TEST_F(Terminal, PagesOfTheManualAreWholeAndRight) {
  good("man -o pages");
  for (const std::string& command : commands) {
    const std::string page = text_of(folder / "pages" / ("dimple-" + command + ".1"));
    EXPECT_EQ(page, good("man " + command).out);
    EXPECT_THAT(page, HasSubstr(".SH NAME"));
  }
  EXPECT_THAT(text_of(folder / "pages" / "dimple-run.1"), HasSubstr("\\-\\-safety"));
  // The line for whatis(1) is complete in itself.
  EXPECT_THAT(text_of(folder / "pages" / "dimple-run.1"),
              HasSubstr("dimple\\-run \\- model and solve in one:"));
  EXPECT_THAT(text_of(folder / "pages" / "dimple.1"), HasSubstr("Exit codes"));
  EXPECT_THAT(dimple(folder, "man rum").err, HasSubstr("did you mean 'run'"));
  const std::string groff =
      "cd " + folder.string() + "; for page in pages/*.1; do groff -man -Tascii -ww -z $page; done";
  if (std::system("command -v groff > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "groff, which would look at the pages, is not installed (Debian: groff)";
  EXPECT_EQ(said_by("sh", groff), "");
}

TEST_F(Terminal, ShellsCompleteCommandsOptionsAndWords) {
  const std::string source = "cd " + folder.string() + "; " + DIMPLE_PROGRAM + " completion ";
  const std::string bash = source + "bash > bash; . ./bash; COMP_WORDS=(dimple ";
  EXPECT_EQ(said_by("bash", bash + "pha); COMP_CWORD=1; _dimple; echo ${COMPREPLY[@]}"), "phantom\n");
  EXPECT_EQ(said_by("bash", bash + "run --sch); COMP_CWORD=2; _dimple; echo ${COMPREPLY[@]}"), "--scheme\n");
  EXPECT_EQ(said_by("bash", bash + "run --scheme hor); COMP_CWORD=3; _dimple; echo ${COMPREPLY[@]}"),
            "horton2007\n");
  EXPECT_EQ(said_by("bash", bash + "run --depth 5); COMP_CWORD=3; _dimple; echo ${COMPREPLY[@]}"), "\n");
  EXPECT_EQ(said_by("bash", bash + "run br); COMP_CWORD=2; _dimple; echo ${COMPREPLY[@]}"), "\n");  // files
  EXPECT_EQ(said_by("bash", bash + "phantom --shape cut); COMP_CWORD=3; _dimple; echo ${COMPREPLY[@]}"),
            "cut-ellipsoid\n");
  EXPECT_EQ(said_by("bash", bash + "completion \"\"); COMP_CWORD=2; _dimple; echo ${COMPREPLY[@]:0:3}"),
            "bash zsh fish\n");
  EXPECT_EQ(dimple(folder, "completion tcsh").code, 2);
  EXPECT_EQ(said_by("zsh", source + "zsh > _dimple; zsh -n _dimple"), "");
  const std::string fish =
      said_by("fish", source + "fish > dimple.fish; source dimple.fish; complete -C \"dimple run --sch\"");
  if (!fish.empty()) {
    EXPECT_THAT(fish, testing::StartsWith("--scheme"));
    const auto completed = [&](const std::string& line) {
      return said_by("fish",
                     "source " + (folder / "dimple.fish").string() + "; complete -C \"" + line + "\"");
    };
    // Each word alone: a description of the flag fits one of them at most.
    EXPECT_EQ(completed("dimple run brain.nrrd --write-frames "), "all\nlast\n");
    EXPECT_EQ(completed("dimple phantom --shape b"), "block\nbrain\n");
    EXPECT_EQ(completed("dimple completion "), "bash\nfish\nzsh\n");
  }
  if (fish.empty()) GTEST_SKIP() << "fish is not installed, so its completion was not tried (Debian: fish)";
}

}  // namespace
}  // namespace dimple
