#include "io/table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/text.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

/// A field in quotes, its own doubled, by RFC 4180.
std::string in_quotes(const std::string& field) {
  std::string text = "\"";
  for (const char c : field) {
    if (c == '"') text += '"';
    text += c;
  }
  return text + '"';
}

/// A field in quotes if it has a comma, a quote or a line break.
std::string quoted(const std::string& field) {
  return field.find_first_of(",\"\r\n") == std::string::npos ? field : in_quotes(field);
}

/// True for a number in the form of shortest().
bool is_number(const std::string& field) {
  double value = 0.0;
  const char* const end = field.data() + field.size();
  const auto [stop, error] = std::from_chars(field.data(), end, value);
  return !field.empty() && stop == end && error == std::errc();
}

/// Splits at `separator` outside quotes; ' ' means any run of blanks. False: a quote is open at the end.
bool split(std::string_view line, char separator, std::vector<std::string>& fields) {
  std::string field;
  bool in_quotes = false, was_quoted = false;
  const auto finish = [&] {
    fields.push_back(was_quoted ? field : std::string(trimmed(field)));
    field.clear();
    was_quoted = false;
  };
  if (separator == ' ') line = trimmed(line);
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    const bool separates = separator == ' ' ? c == ' ' || c == '\t' : c == separator;
    if (in_quotes && c == '"' && i + 1 < line.size() && line[i + 1] == '"') {
      field += line[++i];
    } else if (c == '"' && (in_quotes || trimmed(field).empty())) {
      if (!in_quotes) field.clear();
      in_quotes = !in_quotes;
      was_quoted = true;
    } else if (separates && !in_quotes) {
      if (separator != ' ' || !field.empty() || was_quoted) finish();
    } else {
      field += c;
    }
  }
  finish();
  return !in_quotes;
}

/// Lines of a file, without comments and blank lines.
class Lines {
 public:
  explicit Lines(std::string_view content) : undeformed_(content) {
    if (undeformed_.starts_with("\xEF\xBB\xBF"))
      undeformed_.remove_prefix(3);  // the byte order mark of spreadsheets
  }
  /// The next line without its end; false: there is none left.
  bool next(std::string_view& text) {
    while (!undeformed_.empty()) {
      ++number_;
      const auto end = undeformed_.find('\n');
      text = undeformed_.substr(0, end);
      undeformed_.remove_prefix(end == std::string_view::npos ? undeformed_.size() : end + 1);
      if (text.ends_with('\r')) text.remove_suffix(1);
      if (const std::string_view inner = trimmed(text); !inner.empty() && inner.front() != '#') return true;
    }
    return false;
  }
  std::size_t number() const { return number_; }

 private:
  std::string_view undeformed_;
  std::size_t number_ = 0;
};

/// The last of `candidates` in the header, or the first of them.
char separator_in(std::string_view header, std::string_view candidates) {
  char separator = candidates.front();
  for (const char candidate : candidates)
    if (header.find(candidate) != std::string_view::npos) separator = candidate;
  return separator;
}

InputError bad_table(const fs::path& file, std::size_t line, std::string fact, std::string why,
                     std::string remedy) {
  return InputError({.fact = std::move(fact),
                     .where = line == 0 ? fmt::format("table {}", file.string())
                                        : fmt::format("table {}, line {}", file.string(), line),
                     .why = std::move(why),
                     .remedy = std::move(remedy)});
}

/// Throws if two columns have one name. Empty names are left to the caller.
void require_unlike(const std::vector<std::string>& header, const fs::path& file, std::size_t line) {
  for (auto name = header.begin(); name != header.end(); ++name)
    if (!name->empty() && std::find(header.begin(), name, *name) != name)
      throw bad_table(file, line, fmt::format("two columns are called '{}'", *name),
                      "only its name identifies a column", "give one of them another name, or remove it");
}

double number(const std::string& field, const fs::path& file, std::size_t line, const std::string& column) {
  const char* first = field.data();
  const char* const last = first + field.size();
  if (first != last && *first == '+') ++first;  // std::from_chars accepts no plus sign
  double value = 0.0;
  const auto [end, error] = std::from_chars(first, last, value);
  // An error without an estimate is infinite.
  const bool may_be_infinite = column.starts_with("error_") && value > 0.0;
  if (error != std::errc() || end != last || std::isnan(value) || (std::isinf(value) && !may_be_infinite))
    throw bad_table(file, line,
                    field.empty() ? fmt::format("column '{}' is empty", column)
                                  : fmt::format("'{}' in column '{}' is not a finite number", field, column),
                    "every field below the header must be a number with a decimal point",
                    "correct the field, or start the line with # to leave it out");
  return value;
}

}  // namespace

const std::vector<double>* Table::find(const std::string& name) const {
  const auto found = std::find(header.begin(), header.end(), name);
  return found == header.end() ? nullptr : &column[static_cast<std::size_t>(found - header.begin())];
}

std::string to_csv(const Table& table) {
  const auto row = [columns = table.header.size()](auto&& field) {
    std::string text;
    for (std::size_t c = 0; c < columns; ++c) {
      if (c > 0) text += ',';
      text += field(c);
    }
    text += "\r\n";  // line ends of RFC 4180
    return text;
  };
  std::string text = row([&](std::size_t c) { return quoted(table.header[c]); });
  for (std::size_t r = 0; r < table.rows(); ++r)
    text += row([&](std::size_t c) { return shortest(table.column[c][r]); });
  return text;
}

void write_csv(const fs::path& file, const Table& table) {
  write_file(file, to_csv(table));
}

Table read_csv(const fs::path& file) {
  const std::string content = read_file(file, most_bytes_of_table);
  Table table;
  char separator = ',';
  Lines lines(content);
  for (std::string_view text; lines.next(text);) {
    const std::size_t line = lines.number();
    text = trimmed(text);
    if (table.header.empty()) {
      separator = separator_in(text, " ;,");
      split(text, separator, table.header);
      table.column.resize(table.header.size());
      double value = 0.0;
      const std::string& first = table.header.front();
      const auto [stop, error] = std::from_chars(first.data(), first.data() + first.size(), value);
      if (error == std::errc() && stop == first.data() + first.size())
        throw bad_table(file, line, fmt::format("the table starts with the number '{}'", first),
                        "the first line must name the columns with their units, e.g. depth_mm,force_N",
                        "put such a header above the numbers");
      require_unlike(table.header, file, line);
      continue;
    }
    std::vector<std::string> fields;
    split(text, separator, fields);
    if (fields.size() != table.header.size())
      throw bad_table(file, line, fmt::format("the row has {} fields", fields.size()),
                      fmt::format("the header names {} columns", table.header.size()),
                      "give every row one number per column");
    for (std::size_t c = 0; c < fields.size(); ++c)
      table.column[c].push_back(number(fields[c], file, line, table.header[c]));
  }
  if (table.header.empty())
    throw bad_table(file, 0, "the table is empty", "it holds no line but blank ones and comments",
                    "write a header line such as depth_mm,force_N and rows of numbers below it");
  return table;
}

TextTable read_text_csv(const fs::path& file) {
  const std::string content = read_file(file, most_bytes_of_table);
  if (content.find('\0') != std::string::npos)  // UTF-16 too
    throw bad_table(file, 0, "the table is not plain text", "it may be a spreadsheet's own format, or UTF-16",
                    "save it as CSV, with UTF-8 as the encoding");
  TextTable table;
  char separator = ',';
  Lines lines(content);
  for (std::string_view text; lines.next(text);) {
    const bool is_header = table.header.empty();
    if (is_header) separator = separator_in(text, ",;\t");
    std::vector<std::string> fields;
    if (!split(text, separator, fields))
      throw bad_table(file, lines.number(), "a quote is opened and not closed",
                      "a field in quotes ends in its line, and a quote within it is written twice",
                      "close the quote, or remove it");
    if (is_header) {
      if (const auto name = std::find(fields.begin(), fields.end(), ""); name != fields.end())
        throw bad_table(file, lines.number(),
                        fmt::format("column {} of {} has no name", name - fields.begin() + 1, fields.size()),
                        "only its name identifies a column", "name it in the header, or remove it");
      require_unlike(fields, file, lines.number());
      table.header = std::move(fields);
      continue;
    }
    if (fields.size() != table.header.size())
      throw bad_table(
          file, lines.number(), fmt::format("the row has {} fields", fields.size()),
          fmt::format("the header names {} columns", table.header.size()),
          "give every row one field per column, empty where there is nothing; put a field that holds the "
          "separator in quotes");
    const auto is_empty = [](const std::string& field) { return field.empty(); };
    if (std::all_of(fields.begin(), fields.end(), is_empty)) continue;  // as spreadsheets end a table
    table.row.push_back({lines.number(), std::move(fields)});
  }
  if (table.header.empty())
    throw bad_table(file, 0, "the table is empty", "it holds no line but blank ones and comments",
                    "write a header line such as id,image and a row for each case below it");
  return table;
}

std::string to_csv(const TextTable& table) {
  std::string text;
  const auto add = [&text](const std::vector<std::string>& fields) {
    for (const std::string& field : fields) {
      if (&field != &fields.front()) text += ',';
      text += is_number(field) ? field : quoted(as_text(field));
    }
    text += "\r\n";
  };
  add(table.header);
  for (const TextTable::Row& row : table.row) add(row.field);
  return text;
}

std::string as_text(const std::string& words) {
  const bool formula =
      !words.empty() && std::string_view("=+-@\t\r\n").find(words[0]) != std::string_view::npos;
  return formula ? '\'' + words : words;
}

std::string csv_field(const std::string& words) {
  return in_quotes(as_text(words));
}

std::string shortest(double value) {
  char buffer[32];
  const auto end = std::to_chars(buffer, buffer + sizeof buffer, value).ptr;
  return {buffer, end};
}

}  // namespace dimple
