#include "io/table.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <random>

#include "io/error.hpp"
#include "io/file.hpp"
#include "tests/helpers/folder.hpp"
#include "tests/helpers/report.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

fs::path with_content(const std::string& content) {
  const fs::path file = test_folder() / "table.csv";
  write_file(file, content);
  return file;
}

Report refusal(const std::string& content) {
  SCOPED_TRACE(content);
  return report_of<InputError>([&] { read_csv(with_content(content)); });
}

TEST(Table, ReadsBackTheSameBits) {
  std::mt19937_64 random(1);
  Table table{{"time_s", "force_N"}, {{}, {}}};
  for (const double value : {0.0, -0.0, 0.1, 1.0 / 3.0, std::numeric_limits<double>::denorm_min(),
                             std::numeric_limits<double>::max(), -1e-300})
    for (auto& column : table.column) column.push_back(value);
  while (table.rows() < 1000) {
    const std::uint64_t bits = random();
    double value;
    std::memcpy(&value, &bits, sizeof value);
    if (!std::isfinite(value)) continue;
    table.column[0].push_back(value);
    table.column[1].push_back(-value);
  }
  const fs::path file = with_content("");
  write_csv(file, table);
  const Table back = read_csv(file);
  ASSERT_EQ(back.header, table.header);
  ASSERT_EQ(back.rows(), table.rows());
  for (std::size_t c = 0; c < 2; ++c)
    EXPECT_EQ(std::memcmp(back.column[c].data(), table.column[c].data(), 8 * table.rows()), 0);
}

TEST(Table, IsWrittenAsRfc4180Says) {
  const Table table{{"time_s", "a, \"b\""}, {{0.0, 0.5}, {0.1, -1e-9}}};
  EXPECT_EQ(to_csv(table), "time_s,\"a, \"\"b\"\"\"\r\n0,0.1\r\n0.5,-1e-09\r\n");
  EXPECT_EQ(read_csv(with_content(to_csv(table))).header, table.header);
}

TEST(Table, IsReadWithCommasSemicolonsOrBlanks) {
  const std::vector<double> depth{0, 1.5, 8}, force{0, -0.0125, 0.131};
  for (const char* content :
       {"depth_mm,force_N\n0,0\n1.5,-0.0125\n8,0.131\n",
        "\xEF\xBB\xBF"
        "depth_mm; force_N\r\n0; 0\r\n1.5; -1.25e-2\r\n8; +0.131",
        "# from the paper\n\n depth_mm \t force_N\n0 0\n# half way\n  1.5   -0.0125 \n8\t.131\n"}) {
    const Table table = read_csv(with_content(content));
    ASSERT_NE(table.find("depth_mm"), nullptr) << content;
    ASSERT_NE(table.find("force_N"), nullptr) << content;
    EXPECT_EQ(*table.find("depth_mm"), depth);
    EXPECT_EQ(*table.find("force_N"), force);
    EXPECT_EQ(table.find("force"), nullptr);
  }
}

TEST(Table, TakesAColumnNameThatBeginsLikeANumber) {
  EXPECT_EQ(read_csv(with_content("info,1st\n1,2\n")).header, (std::vector<std::string>{"info", "1st"}));
}

TEST(Table, NamesLineAndColumnOfWhatItRefuses) {
  Report report = refusal("depth_mm,force_N\n0,0\n1,one\n");
  EXPECT_NE(report.fact.find("'one' in column 'force_N'"), std::string::npos);
  EXPECT_NE(report.where.find("line 3"), std::string::npos);
  EXPECT_NE(refusal("a,b\n1,\n").fact.find("column 'b' is empty"), std::string::npos);
  EXPECT_NE(refusal("a,b\n1,nan\n").fact.find("not a finite number"), std::string::npos);
  EXPECT_NE(refusal("a,error_N\n1,-inf\n").fact.find("not a finite number"), std::string::npos);
  EXPECT_NE(refusal("a,b\n1,inf\n").fact.find("not a finite number"), std::string::npos);
  EXPECT_NE(refusal("a,b\n1,1e999\n").fact.find("not a finite number"), std::string::npos);
  EXPECT_NE(refusal("a;b\n1;0,5\n").fact.find("'0,5' in column 'b'"), std::string::npos);  // decimal comma
  EXPECT_NE(refusal("a,b\n1,2,3\n").fact.find("3 fields"), std::string::npos);
  EXPECT_NE(refusal("0,0\n1,2\n").remedy.find("header"), std::string::npos);
  EXPECT_NE(refusal("# nothing\n\n").fact.find("empty"), std::string::npos);
  report = refusal("# of one name\ndepth_mm,force_N,force_N\n0,0,0\n");
  EXPECT_EQ(report.fact, "two columns are called 'force_N'");
  EXPECT_NE(report.where.find("line 2"), std::string::npos);
  EXPECT_THROW(read_csv("/no/such/table.csv"), InputError);
}

TEST(TextTable, IsReadAsSpreadsheetsWriteIt) {
  for (const char* content :
       {"id,image,label\na,\"scans/a, left.nrrd\",\"Brain \"\"L\"\"\"\n\nb, b c.nrrd ,\n",
        "\xEF\xBB\xBFid;image;label\r\na;scans/a, left.nrrd;\"Brain \"\"L\"\"\"\r\nb;b c.nrrd;\r\n;;\r\n",
        "# a comment\nid\timage\tlabel\na\tscans/a, left.nrrd\t\"Brain \"\"L\"\"\"\n# b\nb\tb c.nrrd\t"}) {
    const TextTable table = read_text_csv(with_content(content));
    EXPECT_EQ(table.header, (std::vector<std::string>{"id", "image", "label"})) << content;
    ASSERT_EQ(table.row.size(), 2u) << content;
    EXPECT_EQ(table.row[0].field, (std::vector<std::string>{"a", "scans/a, left.nrrd", "Brain \"L\""}));
    EXPECT_EQ(table.row[1].field, (std::vector<std::string>{"b", "b c.nrrd", ""}));
    EXPECT_GT(table.row[1].line, table.row[0].line);
  }
}

TEST(TextTable, ReadsBackWhatIsWritten) {
  const TextTable table{{"id", "why, \"so\""}, {{2, {"a", "b,c"}}, {3, {"", "\"quoted\" ; and\ttabs"}}}};
  const TextTable back = read_text_csv(with_content(to_csv(table)));
  EXPECT_EQ(back.header, table.header);
  ASSERT_EQ(back.row.size(), 2u);
  for (std::size_t r = 0; r < 2; ++r) EXPECT_EQ(back.row[r].field, table.row[r].field);
}

}  // namespace
}  // namespace dimple
