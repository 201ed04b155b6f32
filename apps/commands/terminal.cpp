#include "apps/commands/terminal.hpp"

#include <sys/ioctl.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <sstream>

#include "io/text.hpp"

namespace dimple {

std::size_t terminal_width(int file_descriptor) {
  constexpr std::size_t usual = 80, least = 40, most = 1000;
  const char* text = std::getenv("COLUMNS");
  if (const long columns = text ? std::strtol(text, nullptr, 10) : 0; columns > 0)
    return std::clamp(static_cast<std::size_t>(columns), least, most);
  winsize size{};
  if (ioctl(file_descriptor, TIOCGWINSZ, &size) == 0 && size.ws_col > 0)
    return std::max(least, static_cast<std::size_t>(size.ws_col));
  return usual;
}

std::string wrapped(const std::string& text, std::size_t column, std::size_t width) {
  std::string result;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t begin = std::min(line.find_first_not_of(' '), line.size());
    const bool listed = begin > 0 && line.size() > column && line[column - 1] == ' ';
    // A wide first column leaves no room for a second one.
    const std::size_t indent = !listed ? begin : 2 * column > width ? begin + 4 : column;
    while (line.size() > width) {
      std::size_t blank = line.rfind(' ', width);
      if (blank == std::string::npos || line.find_first_not_of(' ') >= blank || blank <= indent)
        blank = line.find(' ', std::max(indent, line.find_first_not_of(' ')) + 1);  // too long for a line
      if (blank == std::string::npos) break;
      std::string head = line.substr(0, blank);
      head.erase(head.find_last_not_of(' ') + 1);
      const std::size_t next = line.find_first_not_of(' ', blank);
      if (next == std::string::npos) {
        line = head;
        break;
      }
      result += head + '\n';
      line = std::string(indent, ' ') + line.substr(next);
    }
    result += line + '\n';
  }
  return result;
}

namespace {

// Writes without exceptions: stdio records a failure, which command_line() reports at the end; fmt::print
// would throw.
void put(const std::string& text, std::FILE* file) {
  std::fwrite(text.data(), 1, text.size(), file);
}

}  // namespace

void print(const std::string& text) {
  put(printable_lines(text), stdout);
}

void print_error(const std::string& text) {
  put(printable_lines(text), stderr);
}

void print_json(const std::string& json) {
  put(printable_json(json), stdout);
}

}  // namespace dimple
