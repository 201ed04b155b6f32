// Batch runs: a table of cases, their results, and one table of all.

#include <map>
#include <tuple>

#include "tests/end_to_end/in_folder.hpp"
#include "tests/end_to_end/whole_files.hpp"

namespace dimple {
namespace {

class Batch : public InFolder {
 protected:
  void SetUp() override { make_block(); }

  /// Rows of the table of results by id: column -> field.
  std::map<std::string, std::map<std::string, std::string>> collected(const std::string& arguments) const {
    const Ran ran = good("collect " + arguments);
    write("collected.csv", ran.out);
    const TextTable table = read_text_csv(folder / "collected.csv");
    std::map<std::string, std::map<std::string, std::string>> rows;
    for (const TextTable::Row& row : table.row)
      for (std::size_t c = 0; c < row.field.size(); ++c) rows[row.field[0]][table.header[c]] = row.field[c];
    return rows;
  }

  /// Expects that no case runs because the table itself is wrong.
  void expect_refused(int code, const std::string& content, const std::vector<std::string>& words) const {
    SCOPED_TRACE(content.substr(0, 200));
    write("bad.csv", content);
    const Ran ran = dimple(folder, "batch bad.csv -o out");
    EXPECT_EQ(ran.out, "");
    expect_refusal(ran, code, words);
    expect_refusal(ran, code, {"\n  code:  "});
    EXPECT_FALSE(fs::exists(folder / "out"));
  }
};

TEST_F(Batch, GivesEachCaseTheBitsOfARunOfItsOwn) {
  // The table has semicolons, CRLF, a byte order mark, a path relative to it, a list in quotes and a name
  // that is not English.
  write("tables/cases.csv",
        "\xEF\xBB\xBFid;image;mu_Pa;indent-at;output.write;image.label\r\n"
        "a;../block.nrrd;300;;\"force,nodes\";\r\n"
        "M\xC3\xBCller 2;../block.nrrd;0.5kPa;5,0,top;force;1\r\n;;;;;\r\n");
  const Ran ran = good("batch tables/cases.csv -o out --nodes 400 --depth 2mm --frames 4");
  EXPECT_EQ(ran.out.rfind("2 finished, 0 skipped, 0 failed of 2 cases", 0), 0u) << ran.out;

  good("run block.nrrd -o one --nodes 400 --depth 2mm --frames 4 --mu 300 --write force,nodes");
  ASSERT_EQ(
      dimple(
          folder,
          "run block.nrrd -o two --nodes 400 --depth 2mm --frames 4 --mu 500 --indent-at 5,0,top --label 1 "
          "--write force --threads 2")
          .code,
      0);
  for (const auto& [case_, alone] : {std::pair{"out/a", "one"}, std::pair{"out/M\xC3\xBCller 2", "two"}}) {
    std::set<std::string> here, there;
    for (const auto& [root, files] : {std::pair{folder / case_, &here}, std::pair{folder / alone, &there}})
      for (const auto& entry : fs::recursive_directory_iterator(root))
        files->insert(entry.path().lexically_relative(root).string());
    EXPECT_EQ(here, there);
    for (const std::string& file : there)
      if (fs::is_regular_file(folder / alone / file) && file != "summary.json" &&
          file != "config.resolved.toml") {
        EXPECT_EQ(text_of(folder / case_ / file), text_of(folder / alone / file)) << case_ << ' ' << file;
      }
    EXPECT_EQ(summary(case_).at("force_N"), summary(alone).at("force_N"));
  }
  EXPECT_EQ(summary("out/a").at("threads"), 1);
}

TEST_F(Batch, ContinuesAfterCasesThatFailAndReportsWhyEachDid) {
  write("words.nrrd", "these are words\n");
  write("cases.csv",
        "id,image,mu,depth\n"
        "good,block.nrrd,200,1\n"
        "missing,nowhere.nrrd,200,1\n"
        "soft,block.nrrd,soft,1\n"
        "words,words.nrrd,200,1\n"
        "through,block.nrrd,200,80\n"
        "no_image,,200,1\n"
        "also_good,block.nrrd,300,1\n");
  const std::string line = "batch cases.csv -o out --nodes 400 --frames 2 --write force";
  const Ran ran = dimple(folder, line);
  EXPECT_EQ(ran.code, 3) << ran.err;  // code of the first failure
  EXPECT_THAT(ran.out, HasSubstr("2 finished, 0 skipped, 5 failed of 7 cases"));
  const std::vector<std::tuple<std::string, int, std::string>> failures = {{"missing", 3, "nowhere.nrrd"},
                                                                           {"soft", 2, "soft is not allowed"},
                                                                           {"words", 3, "words.nrrd"},
                                                                           {"through", 4, "80.00 mm"},
                                                                           {"no_image", 3, "no image"}};
  for (const auto& [id, code, word] : failures) {
    SCOPED_TRACE(id);
    const Json failure = summary("out/" + id);
    EXPECT_EQ(failure.at("status"), "failed");
    EXPECT_EQ(failure.at("exit_code"), code);
    EXPECT_THAT(failure.at("failure").at("fact").get<std::string>(), HasSubstr(word)) << failure;
    for (const char* part : {"code", "where", "why", "remedy"})
      EXPECT_NE(failure.at("failure").at(part), "") << part;
    EXPECT_THAT(ran.out, HasSubstr(failure.at("failure").at("fact").get<std::string>()));
  }
  EXPECT_THAT(summary("out/soft").at("failure").at("where").get<std::string>(),
              HasSubstr("cases.csv, line 4"));
  EXPECT_EQ(summary("out/missing").at("image"), "nowhere.nrrd");
  EXPECT_EQ(summary("out/words").at("image"), "words.nrrd");
  EXPECT_FALSE(summary("out/no_image").contains("image"));
  EXPECT_FALSE(fs::exists(folder / "out/good.log"));

  // An array job of each row reports the failure in the same words, with the exit code of its own task.
  for (std::size_t k = 0; k < failures.size(); ++k) {
    const auto& [id, code, word] = failures[k];
    const Json before = summary("out/" + id);
    const Ran task = dimple(folder, line + " --id " + id + " -q");
    EXPECT_EQ(task.code, code) << task.err;
    EXPECT_THAT(task.err, HasSubstr(word));
    EXPECT_EQ(summary("out/" + id).at("failure"), before.at("failure"));
    EXPECT_EQ(summary("out/" + id).value("image", ""), before.value("image", ""));
  }

  // Corrected cases run, and the others do not.
  write("words.nrrd", text_of(folder / "block.nrrd"));
  write("cases.csv",
        "id,image,mu,depth\n"
        "good,block.nrrd,200,1\n"
        "missing,block.nrrd,200,1\n"
        "soft,block.nrrd,150,1\n"
        "words,words.nrrd,200,1\n"
        "through,block.nrrd,200,1\n"
        "also_good,block.nrrd,300,1\n");
  const Ran again = good(line + " --json");
  const Json reported = Json::parse(again.out);
  EXPECT_EQ(reported.at("finished"), Json({"missing", "soft", "words", "through"}));
  EXPECT_EQ(reported.at("skipped"), Json({"good", "also_good"}));
  EXPECT_EQ(reported.at("failed"), Json::array());
}

TEST_F(Batch, SkipsWhatIsFinishedAndSaysSoOfWhatIsAnotherRun) {
  write("a.nrrd", text_of(folder / "block.nrrd"));
  write("cases.csv", "id,image,mu\none,block.nrrd,200\ntwo,a.nrrd,200\n");
  const std::string line = "batch cases.csv -o out --nodes 400 --depth 1 --frames 2 --write force";
  good(line);
  const std::string before = text_of(folder / "out/one/summary.json");
  Ran ran = dimple(folder, line);
  EXPECT_EQ(ran.code, 0) << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("0 finished, 2 skipped, 0 failed"));

  // One row has another option, the other row another image.
  write("cases.csv", "id,image,mu\none,block.nrrd,300\ntwo,a.nrrd,200\n");
  good("phantom a.nrrd --shape block --size 60,60,24 --spacing 3");
  ran = dimple(folder, line);
  EXPECT_EQ(ran.code, 2) << ran.err;
  expect_words(ran.out, {"0 finished, 0 skipped, 2 failed", "material.mu_Pa is 300.0 now, and was 200.0",
                         "the image or model differs or has changed", "--force", "[other-run]"});
  EXPECT_EQ(text_of(folder / "out/one/summary.json"), before);

  // With --force a changed case is computed again, and no other.
  write("cases.csv", "id,image,mu\none,block.nrrd,200\ntwo,a.nrrd,200\n");
  ran = dimple(folder, line + " --force");
  EXPECT_EQ(ran.code, 0) << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("1 finished, 1 skipped, 0 failed"));
  EXPECT_EQ(text_of(folder / "out/one/summary.json"), before);

  // Files of others are kept.
  fs::remove_all(folder / "out/one");
  write("out/one/thesis.txt", "years of work");
  ran = dimple(folder, line + " --force");
  EXPECT_EQ(ran.code, 6) << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("not results of dimple"));
  EXPECT_EQ(text_of(folder / "out/one/thesis.txt"), "years of work");
  EXPECT_FALSE(fs::exists(folder / "out/one/summary.json"));
}

TEST_F(Batch, TakesOneRowOfAnArrayJob) {
  write("cases.csv", "id,image,mu\none,block.nrrd,200\ntwo,block.nrrd,300\n");
  const std::string line = "batch cases.csv -o out --nodes 400 --depth 1 --frames 2 --write force --index ";
  const Ran ran = good(line + "2");
  EXPECT_THAT(ran.out, HasSubstr("N at 1.00 mm"));
  EXPECT_TRUE(fs::exists(folder / "out/two/summary.json"));
  EXPECT_FALSE(fs::exists(folder / "out/one"));
  const Ran again = good(line + "2");
  EXPECT_THAT(again.err, HasSubstr("nothing to do"));
  EXPECT_EQ(again.out, ran.out);
  ends_with(folder, 2, line + "3", {"row 3 is requested, and the table has 2"});
  EXPECT_EQ(dimple(folder, line + "0").code, 2);
  ends_with(folder, 2, "batch cases.csv -o out --id tow", {"did you mean 'two'?"});

  // The table shows cases without a run if it has their list.
  EXPECT_EQ(collected("out").size(), 1u);
  const auto rows = collected("out --cases cases.csv");
  EXPECT_EQ(rows.at("one").at("status"), "missing");
  EXPECT_EQ(rows.at("two").at("status"), "finished");
  write("cases.csv", "id,image,mu\none,block.nrrd,200\ntwo,block.nrrd,400\n");
  const auto changed = collected("out --cases cases.csv").at("two");
  EXPECT_EQ(changed.at("status"), "changed");
  EXPECT_EQ(changed.at("code"), "other-run");
  EXPECT_THAT(changed.at("fact"), HasSubstr("material.mu_Pa is 400.0 now, and was 300.0"));
}

TEST_F(Batch, RefusesTwoModuliInOneRowAlsoWhereOneIsTheUsual) {
  write("cases.csv", "id,image,mu_Pa,young\nusual,block.nrrd,210,600\nother,block.nrrd,211,600\n");
  EXPECT_EQ(dimple(folder, "batch cases.csv -o out --nodes 400 --depth 1 --frames 2 --write force -q").code,
            2);
  for (const char* id : {"usual", "other"})
    EXPECT_THAT(summary(std::string("out/") + id).at("failure").at("fact").get<std::string>(),
                HasSubstr("both a shear modulus"))
        << id;
}

TEST_F(Batch, OfScenesOfStepsShowsTheirLargestForceOnItsPage) {
  write("cases.csv", "id,image,mu\none,block.nrrd,2000\n");
  const Ran ran = dimple(folder,
                         "batch cases.csv -o out --nodes 600 --tool sphere:3mm --base inferior --indent-at "
                         "0,0,top --set step.press.move=1mm --set step.lift.move=-3mm --write force");
  ASSERT_EQ(ran.code, 0) << ran.out << ran.err;
  collected("out");
  EXPECT_THAT(text_of(folder / "out/index.html"), HasSubstr("largest force "));
}

TEST_F(Batch, RefusesATableThatIsWrongAsAWhole) {
  expect_refused(3, "", {"empty"});
  expect_refused(3, "id,image\n", {"no rows"});
  expect_refused(3, "image,mu\nblock.nrrd,200\n", {"no column id"});
  expect_refused(3, "id,mu\na,200\n", {"no column image"});
  expect_refused(3, "id,image\na,block.nrrd\nb,block.nrrd\na,block.nrrd\n",
                 {"'a' is there twice", "line 4", "line 2"});
  expect_refused(3, "id,image\na,block.nrrd\nA,block.nrrd\n", {"'A' is there twice"});
  expect_refused(3, "id,image\n,block.nrrd\n", {"it is empty", "line 2"});
  for (const std::string id :
       {"../a", "a/b", "..", ".", ".hidden", "-q", "a\\b", "a:b", "a.", "a.log", "tab\x01"})
    expect_refused(3, "id,image\n\"" + id + "\",block.nrrd\n", {"cannot be the id of a case", "line 2"});
  expect_refused(3, "id,image\n" + std::string(201, 'a') + ",block.nrrd\n", {"longer than 200 bytes"});
  expect_refused(3, "id,image\nM\xFCller,block.nrrd\n", {"not UTF-8"});
  expect_refused(3, "id,image,mu\na,block.nrrd\n", {"the row has 2 fields", "names 3 columns", "line 2"});
  expect_refused(3, "id,image\na,\"block.nrrd\n", {"a quote is opened and not closed", "line 2"});
  expect_refused(3, "id,image,\na,block.nrrd,\n", {"column 3 of 3 has no name"});
  expect_refused(3, std::string("\xFF\xFEi\0d\0", 6), {"plain text", "UTF-8"});
  expect_refused(2, "id,image,mu_pa\na,block.nrrd,200\n", {"'mu_pa'", "did you mean 'mu", "bad.csv"});
  expect_refused(2, "id,imgae\na,block.nrrd\n", {"did you mean 'image'?"});
  expect_refused(2, "id,image,indent at\na,block.nrrd,top\n", {"did you mean 'indent_at'?"});
  expect_refused(2, "id,image,mu,material.mu_Pa\na,block.nrrd,200,200\n",
                 {"two columns give material.mu_Pa"});
  expect_refused(3, "id,image,id\na,block.nrrd,b\n", {"two columns are called 'id'"});
  expect_refused(2, "id,image,tissue.2.mo\na,block.nrrd,200\n", {"material.mo"});
  expect_refused(2, "id,image,age\na,block.nrrd,40\n", {"'age'"});
  ends_with(folder, 3, "batch nowhere.csv -o out", {"nowhere.csv"});
}

TEST_F(Batch, ReadsTenThousandRows) {
  std::string content = "id,image,mu,label\n";
  for (int n = 0; n < 10000; ++n) content += "case_" + std::to_string(n) + ",block.nrrd,210,\"1,2\"\n";
  write("cases.csv", content);
  const Ran ran = dimple(
      folder,
      "batch cases.csv -o out --nodes 400 --depth 1 --frames 2 --write force --label 1 --index 10000 -q");
  EXPECT_EQ(ran.code, 3) << ran.err;  // the block has no label 2
  EXPECT_EQ(std::distance(fs::directory_iterator(folder / "out"), fs::directory_iterator()), 1);
  EXPECT_TRUE(fs::exists(folder / "out/case_9999/summary.json"));
}

TEST_F(Batch, IsStoppedWithinTwoSecondsAndContinuesFromThere) {
  std::string content = "id,image,mu,frames\nquick,block.nrrd,200,2\n";
  for (int n = 1; n <= 4; ++n)
    content += "slow_" + std::to_string(n) + ",block.nrrd,21" + std::to_string(n) + ",400\n";
  write("cases.csv", content);
  const std::string line = "batch cases.csv -o out --nodes 400 --depth 2mm --write force --jobs 2";
  Program program(folder, words_of(line));
  program.wait_until_it_listens();
  while (program.running() && !fs::exists(folder / "out/slow_2/checkpoint.cbor"))
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  const double before_s = program.cpu_s();
  program.send(SIGINT);
  Ran ran = program.wait();
  EXPECT_LT(ran.cpu_s - before_s, cpu_of(2.0));
  EXPECT_EQ(ran.code, 130) << ran.err;
  EXPECT_THAT(ran.err, HasSubstr("interrupted"));
  expect_whole_files(folder / "out", true);
  EXPECT_EQ(summary("out/quick").at("status"), "finished");
  EXPECT_FALSE(fs::exists(folder / "out/slow_4/force.csv"));

  ran = good(line);
  EXPECT_THAT(ran.out, HasSubstr(" skipped, 0 failed of 5 cases"));
  good("run block.nrrd -o alone --mu 212 --frames 400 --nodes 400 --depth 2mm --write force -q");
  EXPECT_EQ(text_of(folder / "out/slow_2/force.csv"), text_of(folder / "alone/force.csv"));
}

// The process ends by kill -9, as when the system is short of memory.
TEST_F(Batch, LosesNoOtherCaseWhenTheProcessOfOneDies) {
  write("cases.csv", "id,image,frames\nslow,block.nrrd,400\nquick,block.nrrd,2\n");
  const std::string command = "batch cases.csv -o out --nodes 400 --depth 2mm --write force --jobs 1 -v";
  Program program(folder, words_of(command));
  while (program.running() && !fs::exists(folder / "out/slow/checkpoint.cbor"))
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  pid_t victim = -1;
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const std::string line = text_of(entry.path() / "cmdline");
    std::error_code error;
    if (line.ends_with(std::string("--index\0"
                                   "1\0",
                                   10)) &&
        fs::read_symlink(entry.path() / "cwd", error) == fs::canonical(folder))
      victim = std::stoi(entry.path().filename().string());
  }
  ASSERT_GT(victim, 0);
  kill(victim, SIGKILL);
  Ran ran = program.wait();
  EXPECT_EQ(ran.code, 4) << ran.err;
  EXPECT_THAT(ran.out, HasSubstr("1 finished, 0 skipped, 1 failed"));
  EXPECT_THAT(ran.out, HasSubstr("was ended by signal 9"));
  EXPECT_EQ(summary("out/slow").at("failure").at("code"), "crashed");
  EXPECT_TRUE(fs::exists(folder / "out/slow.log"));
  ran = good(command);
  EXPECT_THAT(ran.out, HasSubstr("1 finished, 1 skipped, 0 failed"));
  EXPECT_FALSE(fs::exists(folder / "out/slow.log"));
}

// ------------------------------------------------------------------------------------------------- collect

TEST_F(Batch, IsCollectedAsOneTableWithForcesAtDepths) {
  write("cases.csv",
        "id,image,mu,depth\nb,block.nrrd,200,2\na & "
        "b's,block.nrrd,400,1\nc,nowhere.nrrd,200,1\nd,block.nrrd,200,2mm\n");
  ASSERT_EQ(dimple(folder, "batch cases.csv -o out --nodes 1200 --frames 4 -q").code, 3);
  write("out/d/summary.json", "{\"status\": \"fin");
  const auto rows = collected("out --depths 1mm,1.7mm,2mm");
  ASSERT_EQ(rows.size(), 4u);
  const auto& b = rows.at("b");
  const Table force = read_csv(folder / "out/b/force.csv");
  ASSERT_NE(force.find("low_N"), nullptr);
  for (std::size_t k = 0; k < force.rows(); ++k)
    if (std::abs(force.find("indentation_mm")->at(k) - 1.0) < 1e-9) {
      EXPECT_EQ(b.at("force_at_1mm_N"), shortest(force.find("force_N")->at(k)));
    }
  EXPECT_EQ(b.at("low_at_2mm_N"), shortest(force.find("low_N")->back()));
  EXPECT_EQ(b.at("force_at_2mm_N"), b.at("force_N"));
  EXPECT_LT(std::stod(b.at("force_at_1mm_N")), std::stod(b.at("force_at_1.7mm_N")));
  EXPECT_LT(std::stod(b.at("force_at_1.7mm_N")), std::stod(b.at("force_at_2mm_N")));
  EXPECT_EQ(b.at("mu_Pa"), "200");
  EXPECT_EQ(b.at("tool"), "a contact patch of 10 mm diameter");
  EXPECT_EQ(b.at("image"), "block.nrrd");
  EXPECT_EQ(b.at("nodes"), std::to_string(summary("out/b").at("counts").at("nodes").get<int>()));
  EXPECT_EQ(b.at("volume_mm3"), shortest(summary("out/b").at("volume_mm3").get<double>()));
  EXPECT_EQ(b.at("warnings"), std::to_string(summary("out/b").at("warnings").size()));
  EXPECT_EQ(rows.at("a & b's").at("force_at_1.7mm_N"), "");  // it is not that deep
  EXPECT_NE(rows.at("a & b's").at("force_at_1mm_N"), "");
  EXPECT_EQ(rows.at("c").at("status"), "failed");
  EXPECT_EQ(rows.at("c").at("code"), "input");
  EXPECT_THAT(rows.at("c").at("fact"), HasSubstr("nowhere.nrrd"));
  EXPECT_EQ(rows.at("d").at("status"), "failed");
  EXPECT_THAT(rows.at("d").at("fact"), HasSubstr("damaged"));

  // The page has failures first, pictures by valid links, and names as text.
  const std::string page = text_of(folder / "out/index.html");
  EXPECT_LT(page.find("nowhere.nrrd"), page.find("src=\"a%20%26%20b%27s/overview.png\""));
  EXPECT_THAT(page, HasSubstr("<b>a &amp; b's</b>"));
  EXPECT_THAT(page, Not(HasSubstr("<b>a & b")));
  EXPECT_THAT(page, HasSubstr("loading=lazy"));
  EXPECT_TRUE(fs::exists(folder / "out/b/overview.png"));
  good("collect out -o table.csv --page pages.html -q");
  EXPECT_THAT(text_of(folder / "pages.html"), HasSubstr("src=\"out/b/overview.png\""));
  EXPECT_EQ(read_text_csv(folder / "table.csv").row.size(), 4u);

  EXPECT_EQ(dimple(folder, "collect nowhere").code, 3);
  fs::create_directories(folder / "empty");
  EXPECT_EQ(dimple(folder, "collect empty").code, 3);
  EXPECT_EQ(dimple(folder, "collect out --depths deep").code, 2);
  ends_with(folder, 2, "collect out --bids bids", {"sub-01"});
  EXPECT_FALSE(fs::exists(folder / "bids"));
}

TEST_F(Batch, IsCollectedUnderTheNamesOfBids) {
  write("cases.csv", "id,image\nsub-01,block.nrrd\nsub-02_ses-a,block.nrrd\nsub-03,nowhere.nrrd\n");
  ASSERT_EQ(dimple(folder, "batch cases.csv -o out --nodes 400 --depth 1 --frames 2 -q").code, 3);
  good("collect out --bids bids");
  std::set<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder / "bids"))
    if (entry.is_regular_file()) files.insert(entry.path().lexically_relative(folder / "bids").string());
  EXPECT_EQ(files,
            (std::set<std::string>{"dataset_description.json", "sub-01/sub-01_desc-indentation_force.json",
                                   "sub-01/sub-01_desc-indentation_force.tsv",
                                   "sub-01/sub-01_desc-indentation_overview.png",
                                   "sub-02/ses-a/sub-02_ses-a_desc-indentation_force.json",
                                   "sub-02/ses-a/sub-02_ses-a_desc-indentation_force.tsv",
                                   "sub-02/ses-a/sub-02_ses-a_desc-indentation_overview.png"}));
  const Json description = Json::parse(text_of(folder / "bids/dataset_description.json"));
  EXPECT_EQ(description.at("DatasetType"), "derivative");
  EXPECT_EQ(description.at("GeneratedBy").at(0).at("Name"), "Dimple");
  const std::string tsv = text_of(folder / "bids/sub-01/sub-01_desc-indentation_force.tsv");
  EXPECT_EQ(tsv.substr(0, tsv.find('\n')),
            "time_s\tindentation_mm\tforce_N\tbase_force_N\timage_half_N\tforce_x_N\tforce_y_N\tforce_z_"
            "N\tmoment_x_Nm\t"
            "moment_y_Nm\tmoment_z_Nm");
  const Json about = Json::parse(text_of(folder / "bids/sub-01/sub-01_desc-indentation_force.json"));
  EXPECT_EQ(about.at("force_N").at("Units"), "N");
  EXPECT_EQ(about.at("Sources").at(0), "block.nrrd");
}

}  // namespace
}  // namespace dimple
