#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace dimple {

/// Columns of numbers with a header; the header carries the units (time_s, force_N).
struct Table {
  std::vector<std::string> header;
  std::vector<std::vector<double>> column;  ///< one vector per header entry, all of one length
  std::size_t rows() const { return column.empty() ? 0 : column.front().size(); }
  /// The column of that name, or nullptr.
  const std::vector<double>* find(const std::string& name) const;
};

/// RFC 4180 CSV; numbers in the shortest form that reads back to the same bits.
std::string to_csv(const Table& table);
void write_csv(const std::filesystem::path& file, const Table& table);

/// Reads a CSV of numbers with a header line; `#` starts a comment line; commas, semicolons or blanks
/// separate. No library: the content is a plain rectangle of numbers, and the message must name line and
/// column. Throws InputError: no such file, no header, a field that is not a finite number, rows of different
/// length.
Table read_csv(const std::filesystem::path& file);

/// Rows of words with a header.
struct TextTable {
  struct Row {
    std::size_t line;                ///< in the file, 1 is its first
    std::vector<std::string> field;  ///< one for each header entry
  };
  std::vector<std::string> header;
  std::vector<Row> row;
};

/// Reads a CSV of words like read_csv(): commas, semicolons or tabs separate, since words may contain blanks;
/// a field may be empty. Throws InputError: no such file, zero bytes in it, no header, an empty or duplicate
/// header entry, quotes that do not close in their line, rows of different length.
TextTable read_text_csv(const std::filesystem::path& file);
/// RFC 4180 CSV of rows of words. Fields that are no numbers are written by as_text().
std::string to_csv(const TextTable& table);
/// Words of others for a field of a table: behind an apostrophe if a spreadsheet would read them as a
/// formula. That begins with = + - @ or with a blank control character before those.
std::string as_text(const std::string& words);
/// The field of as_text(), in quotes.
std::string csv_field(const std::string& words);
/// Shortest text that reads back to the same bits; "nan" and "inf" for what is not finite.
std::string shortest(double value);

}  // namespace dimple
