// Names, folders and files made by others: none is written through, trusted or printed to a terminal
// unchecked.

#include <fmt/ranges.h>
#include <sys/stat.h>
#include <unistd.h>

#include "io/file.hpp"
#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/whole_files.hpp"

namespace dimple {
namespace {

using Words = std::vector<std::string>;

class Files : public InFolder {
 protected:
  const std::string few = " --nodes 300 --depth 1mm --frames 4 --band off -q --write ";
  const std::string fewer = " --nodes 300 --depth 1mm --frames 2 --band off -q --write ";

  Ran run(const std::string& arguments) const { return dimple(folder, arguments); }
  Ran by_shell(const std::string& script) const { return Program(folder, {"-c", script}, "/bin/sh").wait(); }
  double force(const std::string& out) const { return summary(out).at("force_N"); }
  std::string option(const std::string& out, const std::string& key) const {
    std::istringstream lines(text(out + "/config.resolved.toml"));
    for (std::string line; std::getline(lines, line);)
      if (line.starts_with(key + " = ")) return line;
    return "no " + key;
  }
};

// -------------------------------------------------------------------------------------------------- displays

TEST_F(Files, AWindowWhereNoOpenGLIsDrawnEndsInWords) {
  if (std::system("command -v xvfb-run > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "xvfb-run is not installed here (Debian: xvfb, xauth)";
  make_block();
  const Ran ran = by_shell(fmt::format(
      "xvfb-run -a -n $((200 + $$ % 700)) -s '-screen 0 800x600x24 -noreset -extension GLX' '{}' poke "
      "block.nrrd -q",
      DIMPLE_PROGRAM));
  EXPECT_EQ(ran.code, 2) << ran.err;
  EXPECT_THAT(ran.err + ran.out, HasSubstr("no window can be opened"));
  EXPECT_THAT(ran.err + ran.out, HasSubstr("GLX"));
}

TEST_F(Files, AWindowEndsWhenItsTimeIsUp) {
  if (std::system("command -v xvfb-run > /dev/null 2>&1") != 0)
    GTEST_SKIP() << "xvfb-run is not installed here (Debian: xvfb, xauth)";
  make_block();
  const Ran ran =
      by_shell(fmt::format("xvfb-run -a -n $((200 + $$ % 700)) -s '-screen 0 800x600x24 -noreset' timeout -s "
                           "KILL 60 '{}' poke block.nrrd --nodes 600 -q --time-limit 2s",
                           DIMPLE_PROGRAM));
  EXPECT_EQ(ran.code, 130) << ran.err << ran.out;
}

// ------------------------------------------------------------------------------------ folders of results

TEST_F(Files, APlaceThatCannotBeWrittenToIsRefusedBeforeTheInputIsRead) {
  write("broken.nrrd", "no image");  // would be the reason if it were read first
  write("a_file", "a file");
  write("curve.csv", "indentation_mm,force_N\n1,0.01\n2,0.02\n3,0.03\n");
  write("path.csv", "time_s,depth_mm\n0,0\n1,1\n");
  write("cases.csv", "id,image\na,broken.nrrd\n");
  write("cases/a/summary.json", "{}");
  fs::create_symlink("nowhere", folder / "dangling");
  const Words before = files_in(folder);
  for (const std::string place : {"/proc/nope", "a_file", "a_file/out", "dangling", "dangling/out"})
    for (const std::string command : {"run broken.nrrd -o ", "model broken.nrrd -o ", "solve broken -o ",
                                      "fit broken.nrrd --curve curve.csv -o ", "batch cases.csv -o ",
                                      "man -o ", "poke broken.nrrd --script path.csv --record "}) {
      const Ran ran = run(command + place);
      EXPECT_EQ(ran.code, 6) << command << place << '\n' << ran.err;
      EXPECT_THAT(ran.err, HasSubstr(place)) << command;
      EXPECT_THAT(ran.err, HasSubstr("\n  try:   ")) << command;
    }
  for (const std::string place : {"/proc/nope", "a_file/out", "nowhere/out"})
    for (const std::string command : {"export broken.nrrd -o " + place + ".inp",
                                      "collect cases -o " + place + ".csv", "phantom " + place + ".nrrd"}) {
      const Ran ran = run(command);
      EXPECT_EQ(ran.code, 6) << command << '\n' << ran.err;
      EXPECT_THAT(ran.err, HasSubstr(place)) << command;
    }
  EXPECT_EQ(files_in(folder), before) << "and nothing is left of the trial";
  EXPECT_EQ(run("run broken.nrrd -o " + std::string(300, 'x')).code, 6);
  EXPECT_EQ(run("run broken.nrrd -o new/folder").code, 3) << "which can be made";
}

TEST_F(Files, ForceRemovesWhatARunHasMadeAndNothingElse) {
  make_block();
  const std::string line = "run block.nrrd -o out" + few + "all,images";
  good(line);
  // The list in the folder names all files of the run.
  std::set<std::string> listed;
  std::istringstream lines(text("out/.dimple_files"));
  for (std::string name; std::getline(lines, name);) listed.insert(name);
  for (const std::string& name : files_in(folder / "out"))
    EXPECT_TRUE(name == ".dimple_files" || listed.count(name) == 1) << name;
  const Words of_the_run = files_in(folder / "out");
  // Files of others, with names that a run might have used.
  const Words of_others = {"out/nodes/nodes_9999.vtu", "out/images/labels_0099.nrrd", "out/explain.md",
                           "out/notes.txt", "out/model/mine.txt"};
  for (const std::string& name : of_others) write(name, "mine");
  write("out/nodes/.77-3-nodes_0001.vtu", "half a fi");  // as after a kill
  good("run block.nrrd -o out --force" + fewer + "all,images");
  EXPECT_FALSE(fs::exists(folder / "out/nodes/.77-3-nodes_0001.vtu"));
  for (const std::string& name : of_others) EXPECT_EQ(text(name), "mine") << name;
  EXPECT_TRUE(fs::exists(folder / "out/nodes/nodes_0002.vtu"));
  EXPECT_FALSE(fs::exists(folder / "out/nodes/nodes_0004.vtu")) << "of the first run";
  for (const std::string& name : of_the_run)
    if (name.find("_0003.") == std::string::npos && name.find("_0004.") == std::string::npos) {
      EXPECT_TRUE(fs::exists(folder / "out" / name)) << name;
    }
}

TEST_F(Files, ForceTakesNothingFromAFolderThatNeverHeldARun) {
  make_block();
  for (const char* name :
       {"overview.png", "force.csv", "report.html", "nodes.pvd", "surface.vtp", "nodes.vtu", "fit.csv"}) {
    write("holiday/" + std::string(name), "mine");
    const Ran ran = run("run block.nrrd -o holiday --force" + few + "all");
    EXPECT_EQ(ran.code, 6) << name << ran.err;
    EXPECT_THAT(ran.err, HasSubstr("not results of dimple")) << name;
    EXPECT_EQ(text("holiday/" + std::string(name)), "mine");
    EXPECT_EQ(files_in(folder / "holiday").size(), 1u);
    fs::remove_all(folder / "holiday");
  }
  // A list written by others cannot lead out of the folder.
  write("elsewhere/force.csv", "mine");
  write("list/.dimple_files", "../elsewhere/force.csv\n/etc/hostname\nmodel/../../elsewhere/force.csv\n");
  write("list/notes.txt", "mine");
  good("run block.nrrd -o list --force" + few + "force");
  EXPECT_EQ(text("elsewhere/force.csv"), "mine");
  EXPECT_EQ(text("list/notes.txt"), "mine");
}

TEST_F(Files, ARunGoesThroughNoLink) {
  make_block();
  good("run block.nrrd -o out" + few + "all");
  for (const char* part : {"nodes", "model", "images"}) {
    fs::remove_all(folder / "out" / part);
    write("elsewhere/nodes_0000.vtu", "mine");
    write("elsewhere/model.toml", "mine");
    fs::create_directory_symlink(folder / "elsewhere", folder / "out" / part);
    for (const char* how : {" --force", " --resume"}) {
      const Ran ran = run("run block.nrrd -o out" + few + "all" + how);
      EXPECT_EQ(ran.code, 6) << part << how << ran.err;
      EXPECT_THAT(ran.err, HasSubstr("is a link"));
    }
    EXPECT_EQ(text("elsewhere/nodes_0000.vtu"), "mine");
    EXPECT_EQ(text("elsewhere/model.toml"), "mine");
    EXPECT_EQ(files_in(folder / "elsewhere").size(), 2u);
    fs::remove(folder / "out" / part);
  }
}

TEST_F(Files, AFolderWithoutItsListIsNotChanged) {
  make_block();
  good("run block.nrrd -o out" + few + "all");
  fs::remove(folder / "out/.dimple_files");
  const Words before = files_in(folder / "out");
  for (const char* how : {"", " --force", " --resume"}) {
    const Ran ran = run("run block.nrrd -o out" + fewer + "force" + how);
    EXPECT_EQ(ran.code, 6) << how << ran.err;
    EXPECT_THAT(ran.err, HasSubstr(".dimple_files")) << how;
  }
  EXPECT_EQ(files_in(folder / "out"), before);
}

TEST_F(Files, AFileOfOthersInThePlaceOfAResultIsNamedAndKept) {
  make_block();
  good("run block.nrrd -o out" + few + "force");
  write("out/surface.pvd", "mine");
  const Ran ran = run("run block.nrrd -o out --force" + fewer + "surface");
  EXPECT_EQ(ran.code, 6) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("out/surface.pvd was not written by this program"));
  EXPECT_EQ(text("out/surface.pvd"), "mine");
  good("run block.nrrd -o out --force" + fewer + "force");
  EXPECT_EQ(text("out/surface.pvd"), "mine");
}

TEST_F(Files, AModelAndAFitAreResultsToo) {
  make_block();
  good("model block.nrrd -o model --nodes 300 -q");
  const std::string nodes = text("model/nodes.vtu");
  const Ran over_model = run("run block.nrrd -o model" + few + "force");
  EXPECT_EQ(over_model.code, 6) << over_model.err;
  EXPECT_THAT(over_model.err, HasSubstr("model holds a model already"));
  EXPECT_EQ(text("model/nodes.vtu"), nodes);
  good("solve model -o solved --depth 1mm --frames 2 -q");
  good("run block.nrrd -o model --force" + few + "force");
  EXPECT_FALSE(fs::exists(folder / "model/nodes.vtu"));

  write("curve.csv", "indentation_mm,force_N\n0.5,0.004\n1,0.009\n");
  const std::string fit = "fit block.nrrd -o fitted --curve curve.csv --nodes 300 --set accuracy.band=off -q";
  good(fit);
  const std::string found = text("fitted/summary.json");
  const Ran over_fit = run(fit + " --rim 0.2");
  EXPECT_EQ(over_fit.code, 6) << over_fit.err;
  EXPECT_THAT(over_fit.err, HasSubstr("fitted holds the results of a run"));
  EXPECT_EQ(text("fitted/summary.json"), found);
  good(fit + " --force");
}

// -------------------------------------------------------------------------------------------------- material

TEST_F(Files, ANumberOfTheMaterialCountsMoreThanThePresetAndIsListed) {
  make_block();
  const std::string line = "run block.nrrd --nodes 300 --depth 1mm --frames 4 --band off --write force -o ";
  good(line + "plain --mu 3");
  const Ran said = good(line + "flags --preset horton_2007 --mu 3");
  EXPECT_EQ(text("flags/force.csv"), text("plain/force.csv"));
  EXPECT_THAT(said.err, HasSubstr("preset   horton_2007, but mu_Pa 3.0 (--mu) in place of 210.0"));
  EXPECT_THAT(option("flags", "mu_Pa"), HasSubstr("mu_Pa = 3.0"));
  EXPECT_THAT(option("flags", "preset"), HasSubstr("horton_2007"));

  write("given.toml", "[material]\npreset = \"horton_2007\"\nmu_Pa = 3\nnu = 0.45\n");
  const Ran file = good(line + "file --config given.toml");
  EXPECT_THAT(file.err, HasSubstr("mu_Pa 3.0 (given.toml, line 3) in place of 210.0; nu 0.45"));
  good(line + "beside --mu 3 --nu 0.45");
  EXPECT_EQ(text("file/force.csv"), text("beside/force.csv"));
  EXPECT_THAT(option("file", "nu"), HasSubstr("nu = 0.45"));

  // An option that only a preset sets is listed too, and a flag overrides a file.
  EXPECT_THAT(good(line + "whole --config given.toml --preset miller_chinzei_2002").err,
              Not(HasSubstr("in place of")));
  EXPECT_THAT(option("whole", "mu_Pa"), HasSubstr("mu_Pa = 842.0"));
  EXPECT_THAT(option("whole", "ogden_alpha"), HasSubstr("[-4.7]"));
  EXPECT_THAT(option("whole", "prony_tau_s"), HasSubstr("[0.5, 50]"));
}

TEST_F(Files, AShearModulusWithAPresetOfOgdensLawScalesItsTerms) {
  make_block();
  const std::string line =
      "run block.nrrd --nodes 300 --depth 1mm --frames 4 --band off -q --write force -o ";
  good(line + "whole --preset miller_chinzei_2002");
  good(line + "half --preset miller_chinzei_2002 --mu 421");
  EXPECT_NEAR(force("half") / force("whole"), 0.5, 1e-3);
  EXPECT_THAT(option("half", "ogden_mu_Pa"), HasSubstr("[421]"));
  EXPECT_THAT(option("half", "prony_g"), HasSubstr("[0.45, 0.365]"));
  for (const char* out : {"half", "whole"}) {
    good(line + "again --force --config " + out + "/config.resolved.toml");
    EXPECT_EQ(text("again/force.csv"), text(std::string(out) + "/force.csv")) << "bit by bit";
  }
  // File written by an older version: defaults in addition to a preset that was applied as a whole.
  write("older.toml",
        "[material]\nmu_Pa = 210.0\nnu = 0.499\npreset = \"miller_chinzei_2002\"\nogden_mu_Pa = "
        "[]\nogden_alpha = []\n"
        "prony_g = []\nprony_tau_s = []\n");
  good(line + "older --config older.toml");
  EXPECT_EQ(text("older/force.csv"), text("whole/force.csv"));
  const Ran both = run(line + "both --mu 300 --set material.ogden_mu=842 --set material.ogden_alpha=-4.7");
  EXPECT_EQ(both.code, 2);
  EXPECT_THAT(both.err, HasSubstr("Ogden moduli that add up to 842 Pa are given"));
}

TEST_F(Files, ARowOfATableCountsMoreThanWhatIsGivenForAllRows) {
  make_block();
  write("cases.csv",
        "id,image,mu_Pa,preset\nown,block.nrrd,300,\nall,block.nrrd,,\npreset,block.nrrd,,horton_2007\n");
  const std::string few_of_all = " --nodes 300 --depth 1mm --frames 4 --band off --write force -q ";
  good("batch cases.csv -o by_preset --preset miller_chinzei_2002" + few_of_all);
  EXPECT_THAT(option("by_preset/own", "mu_Pa"), HasSubstr("mu_Pa = 300.0"));
  EXPECT_THAT(option("by_preset/own", "ogden_mu_Pa"), HasSubstr("[300]"));
  EXPECT_THAT(option("by_preset/all", "mu_Pa"), HasSubstr("mu_Pa = 842.0"));
  EXPECT_THAT(option("by_preset/preset", "ogden_mu_Pa"), HasSubstr("[]"));
  good("batch cases.csv -o by_mu --mu 500" + few_of_all);
  EXPECT_THAT(option("by_mu/own", "mu_Pa"), HasSubstr("mu_Pa = 300.0"));
  EXPECT_THAT(option("by_mu/all", "mu_Pa"), HasSubstr("mu_Pa = 500.0"));
  EXPECT_THAT(option("by_mu/preset", "mu_Pa"), HasSubstr("mu_Pa = 210.0"));
}

// ------------------------------------------------------------------------------------- files of others

const std::string summary_of_others =
    R"({"status": "finished", "image": "=cmd|' /C calc'!A0", "force_N": -0.5, "volume_mm3": "=1+1", "version": "+1",
        "failure": {"code": "@x", "fact": "\u001b[31mred\u0007 and \u009b2J"}, "material": [{"mu_Pa": -1e-05}]})";

TEST_F(Files, ATableOfCasesHoldsNoFormula) {
  for (const char* id : {"=1+1", "@SUM(1)", "+1", "-1", "\tt", "\rr", "plain"})
    write(fs::path("cases") / id / "summary.json", summary_of_others);
  good("collect cases -o table.csv -q");
  const TextTable table = read_text_csv(folder / "table.csv");
  ASSERT_EQ(table.row.size(), 7u);
  std::set<std::string> ids;
  for (const TextTable::Row& row : table.row) {
    ids.insert(row.field[0]);
    for (std::size_t c = 0; c < row.field.size(); ++c) {
      const std::string& field = row.field[c];
      const bool number = table.header[c] == "force_N" || table.header[c] == "mu_Pa";
      EXPECT_TRUE(number || field.empty() || std::string("=+-@\t\r\n").find(field[0]) == std::string::npos)
          << table.header[c] << ": " << field;
      if (number) {
        EXPECT_EQ(field, table.header[c] == "force_N" ? "-0.5" : "-1e-05") << "numbers stay";
      }
    }
  }
  EXPECT_EQ(ids, (std::set<std::string>{"'=1+1", "'@SUM(1)", "'+1", "'-1", "'\tt", "'\rr", "plain"}));
}

/// Expects no bytes that move a cursor, change colours or ring, in one byte or in two.
void expect_plain(const Ran& ran) {
  for (const std::string* stream : {&ran.out, &ran.err})
    for (std::size_t k = 0; k < stream->size(); ++k) {
      const auto byte = static_cast<unsigned char>((*stream)[k]);
      const bool of_a_line = byte == '\n' || byte == '\t' || (byte == '\r' && (*stream)[k + 1] == '\n');
      ASSERT_TRUE(of_a_line || (byte >= 0x20 && byte != 0x7F)) << int(byte) << " in " << *stream;
      if (byte == 0xC2) {
        ASSERT_GE(static_cast<unsigned char>((*stream)[k + 1]), 0xA0) << *stream;
      }
    }
}

TEST_F(Files, NoStreamRepeatsControlCharacters) {
  const std::string bad =
      "a\x1b[31m\x07\x7f\xc2\x9b"
      "2J\r\x08";
  make_block();
  fs::rename(folder / "block.nrrd", folder / (bad + ".nrrd"));
  const auto with_few = [&](Words words) {
    for (const std::string& word : words_of(few + "force"))
      if (word != "-q") words.push_back(word);
    return words;
  };
  const std::vector<std::pair<int, Words>> commands = {
      {3, {"info", bad}},
      {0, {"info", bad + ".nrrd"}},
      {0, {"info", "--json", bad + ".nrrd"}},
      {0, {"phantom", bad + "2.nrrd", "--spacing", "3"}},
      {0, with_few({"run", bad + ".nrrd", "-v", "-o", bad})},
      {6, with_few({"run", bad + ".nrrd", "-o", bad})},
      {0, with_few({"run", bad + ".nrrd", "-o", bad, "--force", "--json"})},
      {3, with_few({"run", bad + ".nrrd", "-o", "out", "--label", bad})},
      {2, {"run", bad + ".nrrd", "-o", "out", "--set", bad + "=1"}},
      {2, {bad}},
      {2, {"run", "--" + bad}},
      {3, {"run", bad + ".nrrd", "-o", "out", "--config", bad}},
      {3, {"batch", bad + ".csv", "-o", "out"}}};
  for (const auto& [code, words] : commands) {
    const Ran ran = dimple(folder, words);
    SCOPED_TRACE(fmt::format("{}", fmt::join(words, " ")));
    EXPECT_EQ(ran.code, code) << ran.err;
    expect_plain(ran);
    if (std::find(words.begin(), words.end(), "--json") != words.end()) {
      EXPECT_TRUE(Json::accept(ran.out)) << ran.out;
    }
  }
  fs::create_directories(folder / "cases" / bad);
  write(fs::path("cases") / bad / "summary.json", summary_of_others);
  const Ran table = good("collect cases");
  EXPECT_THAT(table.out, HasSubstr("red"));
  expect_plain(table);
}

TEST_F(Files, CollectReadsFilesAloneAndNoneWithoutEnd) {
  for (const char* name : {"device", "pipe", "large", "curve"})
    fs::create_directories(folder / "cases" / name);
  fs::create_symlink("/dev/zero", folder / "cases/device/summary.json");
  ASSERT_EQ(mkfifo((folder / "cases/pipe/summary.json").c_str(), 0600), 0);
  write("cases/large/summary.json", "{\"status\": \"" + std::string(11'000'000, 'x') + "\"}");
  write("cases/curve/summary.json", R"({"status": "finished", "force_N": 1})");
  fs::create_symlink("/dev/zero", folder / "cases/curve/force.csv");
  Program program(folder, words_of("collect cases --depths 1mm -o table.csv"));
  while (program.running() && program.cpu_s() < 20.0) usleep(10'000);
  ASSERT_FALSE(program.running()) << "still reading";
  const Ran ran = program.wait();
  EXPECT_EQ(ran.code, 0) << ran.err;
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // their shadows are as large
  EXPECT_LT(ran.peak_MB, 200.0);
#endif
  const TextTable table = read_text_csv(folder / "table.csv");
  ASSERT_EQ(table.row.size(), 4u);
  const auto fact = std::find(table.header.begin(), table.header.end(), "fact") - table.header.begin();
  for (const TextTable::Row& row : table.row)
    EXPECT_THAT(row.field[static_cast<std::size_t>(fact)],
                HasSubstr(row.field[0] == "large" ? "summary.json is larger than 10 MB"
                                                  : "is not a file but a pipe or a device"))
        << row.field[0];
}

TEST_F(Files, NoInputWithoutEndIsReadForEver) {
  make_block();
  for (const char* command :
       {"run block.nrrd -o out --config /dev/zero", "info block.nrrd --label-names /dev/zero",
        "run block.nrrd -o out --compare /dev/zero", "batch /dev/zero -o out"}) {
    Program program(folder, words_of(command));
    while (program.running() && program.cpu_s() < 20.0) usleep(10'000);
    ASSERT_FALSE(program.running()) << command;
    const Ran ran = program.wait();
    EXPECT_EQ(ran.code, 3) << command << ran.err;
    EXPECT_LT(ran.peak_MB, 1500.0) << command;
    EXPECT_THAT(ran.err, HasSubstr("/dev/zero")) << command;
  }
}

TEST_F(Files, TheDoctorNamesATemporaryFolderThatIsNotThere) {
  const Ran ran = by_shell(fmt::format("TMPDIR=/nonexistent/place '{}' doctor", DIMPLE_PROGRAM));
  EXPECT_EQ(ran.code, 6) << ran.err;
  const std::string said = std::regex_replace(ran.out, std::regex("\\s+"), " ");
  EXPECT_THAT(said, HasSubstr("/nonexistent/place is not an existing folder"));
  EXPECT_THAT(said, HasSubstr("set TMPDIR to a folder that can be written"));
  EXPECT_THAT(ran.err, Not(HasSubstr("error in the program")));
}

// ---------------------------------------------------------------------------------------- command line

TEST_F(Files, TheResolvedConfigurationRepeatsAnyName) {
  make_block();
  const std::string name = "a \"\"\"'''\nb = 1\n[c]\\x # \t\x1b\x7f\u00e4.nrrd";
  fs::rename(folder / "block.nrrd", folder / name);
  const auto with_few = [&](Words words) {
    for (const std::string& word : words_of(few + "force")) words.push_back(word);
    return dimple(folder, words);
  };
  Ran ran = with_few({"run", name, "-o", "out"});
  ASSERT_EQ(ran.code, 0) << ran.err;
  ran = with_few({"run", "--config", "out/config.resolved.toml", "-o", "again"});
  ASSERT_EQ(ran.code, 0) << ran.err;
  EXPECT_EQ(text("again/force.csv"), text("out/force.csv"));
  EXPECT_EQ(Json::parse(text("again/summary.json")).at("image"), name);
  EXPECT_EQ(dimple(folder, {"model", name, "-o", "model", "--nodes", "300", "-q"}).code, 0);
  good("solve model -o solved --depth 1mm --frames 4 -q --write force");
}

TEST_F(Files, ANameThatNoConfigurationCanRepeatIsRefusedInWords) {
  make_block();
  const std::string name = "a\xff.nrrd";
  fs::rename(folder / "block.nrrd", folder / name);
  const Ran ran = dimple(folder, {"run", name, "-o", "out", "--nodes", "300"});
  EXPECT_EQ(ran.code, 2) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("a\\xff.nrrd is not UTF-8"));
  EXPECT_THAT(ran.err, HasSubstr("rename the file"));
  EXPECT_FALSE(fs::exists(folder / "out"));
}

TEST_F(Files, TwoHyphensEndTheOptions) {
  make_block();
  fs::rename(folder / "block.nrrd", folder / "-odd.nrrd");
  EXPECT_THAT(good("info -- -odd.nrrd").out, HasSubstr("-odd.nrrd"));
  good("run" + few + "force -o out -- -odd.nrrd");
  good("model -o model --nodes 300 -q -- -odd.nrrd");
  EXPECT_EQ(run("info --").code, 2) << "no image";
  EXPECT_EQ(run("info -- -odd.nrrd -q").code, 2) << "which is no option there";
}

TEST_F(Files, ATinyDepthHasTheStiffnessOfEquilibrium) {
  make_block();
  const std::string line = "run block.nrrd --nodes 300 --frames 4 --band off --write force ";
  good(line + "-o equilibrium --depth 0.1mm --time quasi-static -q");
  const double slope = force("equilibrium") / 0.1;
  for (const auto& [depth, mm] :
       {std::pair{"1e-6mm", 1e-6}, std::pair{"0.001mm", 1e-3}, std::pair{"0.3mm", 0.3}}) {
    const Ran ran = good(line + "--force -o out --depth " + depth);
    EXPECT_NEAR(force("out") / mm / slope, 1.0, 0.05) << depth;
    EXPECT_THAT(ran.err, HasSubstr("time     quasi-static: the load lasts")) << "it is said";
    EXPECT_THAT(ran.err, HasSubstr("--time explicit resolves the waves"));
    EXPECT_FALSE(std::regex_search(ran.err, std::regex("the load lasts [^\n]*([0-9]e-?[0-9]|0\\.0000)")))
        << ran.err;
  }
  EXPECT_THAT(good(line + "-o fast --depth 0.3mm --rate 1m/s").err, HasSubstr("time     explicit dynamics"))
      << "a fast tool still has inertia";
  // In so large a block shear needs long to cross it; a tilted load once had the wrong sign, by inertia.
  good("phantom large.nrrd --shape block --size 100,100,60 --spacing 4");
  good(
      "run large.nrrd -o tilted --direction 0.5,0,-1 --nodes 600 --frames 1 --band off --write force -q "
      "--depth 0.01mm");
  good(
      "run large.nrrd -o deeper --direction 0.5,0,-1 --nodes 600 --frames 1 --band off --write force -q "
      "--depth 0.1mm");
  EXPECT_NEAR(force("tilted") / force("deeper"), 0.1, 0.005);
}

TEST_F(Files, AMillionRowsOfACurveAreAveraged) {
  make_block();
  std::string rows = "indentation_mm,force_N\n";
  for (int k = 1; k <= 1'000'000; ++k) rows += fmt::format("{:.6f},{:.8f}\n", 1e-6 * k, 0.0098e-6 * k);
  write("curve.csv", rows);
  const Ran ran = good("fit block.nrrd --curve curve.csv -o fit --nodes 300 --set accuracy.band=off");
  EXPECT_LT(ran.peak_MB, 400.0);
  EXPECT_THAT(text("fit/summary.json"), HasSubstr("the curve has 1000000 rows: means of"));
  EXPECT_LE(read_csv(folder / "fit/fit.csv").rows(), 4000u);
  EXPECT_GE(read_csv(folder / "fit/fit.csv").rows(), 2000u);
  // A curve of a hundred rows gives the same modulus as the averaged million.
  std::string thin = "indentation_mm,force_N\n";
  for (int k = 1; k <= 100; ++k) thin += fmt::format("{:.6f},{:.8f}\n", 1e-2 * k, 0.0098e-2 * k);
  write("thin.csv", thin);
  good("fit block.nrrd --curve thin.csv -o thin --nodes 300 --set accuracy.band=off");
  const auto mu = [&](const std::string& out) {
    const std::string found = text(out + "/fitted.toml");
    return std::stod(found.substr(found.find("mu_Pa = ") + 8));
  };
  EXPECT_NEAR(mu("fit") / mu("thin"), 1.0, 0.01);
}

}  // namespace
}  // namespace dimple
