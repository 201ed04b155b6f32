#include "apps/commands/slicer.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "apps/scene/option.hpp"
#include "io/file.hpp"

namespace dimple {
namespace {

using Json = nlohmann::ordered_json;

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text)
    result += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : std::string(1, c);
  return result;
}

// Label of a flag: "Indenter diameter [mm]" for "boundary.indenter_diameter_mm".
std::string label_of(const Option& option) {
  std::string words = option.flag.substr(2);
  std::replace(words.begin(), words.end(), '-', ' ');
  words.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(words.front())));
  return words + (option.unit.empty() ? "" : " [" + option.unit + "]");
}

std::string name_of(const Option& option) {
  std::string name = option.key;
  std::replace(name.begin(), name.end(), '.', '_');
  return name;
}

// Lines of a parameter: name, flag, label, description and `more`.
std::string parameter(const std::string& tag, const std::string& attributes, const std::string& name,
                      const std::string& flag, const std::string& label, const std::string& help,
                      const std::string& more) {
  return fmt::format(
      "    <{0}{1}>\n      <name>{2}</name>\n{3}      <label>{4}</label>\n      "
      "<description>{5}</description>\n"
      "{6}    </{0}>\n",
      tag, attributes, name, flag.empty() ? "" : fmt::format("      <longflag>{}</longflag>\n", flag),
      escaped(label), escaped(help), more);
}

std::string number(const Option& option, const std::string& tag, double standard) {
  // Largest value of a spin box in 3D Slicer; the program itself checks the option's range.
  constexpr double largest = 1e9;
  const double most = std::min(option.most, largest);
  const double step =
      tag == "integer" ? 1.0 : std::pow(10.0, std::floor(std::log10(standard > 0.0 ? standard : 1.0)) - 1.0);
  return parameter(
      tag, "", name_of(option), option.flag, label_of(option), option.help,
      fmt::format(
          "      <default>{:.10g}</default>\n      <constraints>\n        <minimum>{:.10g}</minimum>\n"
          "        <maximum>{:.10g}</maximum>\n        <step>{:.10g}</step>\n      </constraints>\n",
          standard, option.least, most, step));
}

std::string described(const Option& option) {
  const auto text = [&](const std::string& standard) {
    return fmt::format("      <default>{}</default>\n", escaped(standard));
  };
  if (option.key == "boundary.indent_at")  // fiducials; none: the default
    return parameter(
        "point", " multiple=\"false\" coordinateSystem=\"lps\"", name_of(option), option.flag, "Indent at",
        "where the tool meets the body: a point; none: the highest point opposite to the base", "");
  if (option.key == "output.compare")
    return parameter("file", " fileExtensions=\".csv\"", name_of(option), option.flag, label_of(option),
                     option.help, "      <channel>input</channel>\n");
  if (const auto* real = std::get_if<double*>(&option.value)) return number(option, "double", **real);
  if (const auto* whole = std::get_if<std::int64_t*>(&option.value))
    return number(option, "integer", static_cast<double>(**whole));
  if (const auto* word = std::get_if<std::string*>(&option.value)) {
    std::string more = text(**word);
    const std::vector<std::string>& choices = option.choices.empty() ? option.words : option.choices;
    for (const std::string& choice : choices) more += fmt::format("      <element>{}</element>\n", choice);
    return parameter(choices.empty() ? "string" : "string-enumeration", "", name_of(option), option.flag,
                     label_of(option), option.help, more);
  }
  if (const auto* list = std::get_if<std::vector<std::string>*>(&option.value))
    return parameter("string", "", name_of(option), option.flag, label_of(option), option.help,
                     text(fmt::format("{}", fmt::join(**list, ","))));
  return {};
}

std::string group(const std::string& label, const std::string& help, bool advanced,
                  const std::string& inner) {
  return fmt::format(
      "  <parameters{}>\n    <label>{}</label>\n    <description>{}</description>\n{}  </parameters>\n",
      advanced ? " advanced=\"true\"" : "", label, help, inner);
}

}  // namespace

std::string slicer_xml() {
  std::string common, others;
  for (const Option& option : usual_options())
    if (!option.flag.empty()) (option.common ? common : others) += described(option);

  const std::string channel = "      <channel>{}</channel>\n",
                    output = fmt::format(fmt::runtime(channel), "output");
  const std::string files =
      parameter("image", " type=\"label\"", "image", "", "Label image",
                "the organ, or several labels of which one is",
                fmt::format(fmt::runtime(channel), "input") + "      <index>0</index>\n") +
      parameter("directory", "", "out", "--out", "Results folder",
                "a folder of its own for the force curve, the pictures and the files for ParaView", output) +
      parameter("boolean", "", "force", "--force", "Replace results", "replace the results of an earlier run",
                "      <default>true</default>\n") +
      parameter("boolean", " hidden=\"true\"", "slicer", slicer_flag, "Progress for 3D Slicer",
                "write progress to stdout, and treat default values as not given",
                "      <default>true</default>\n");
  std::string results;
  for (const auto& [name, label, help] :
       {std::tuple{"force_N", "Force [N]", "at the depth that was reached"},
        std::tuple{"low_N", "Force, at least [N]", "lower error bound by discretisation; -1: unknown"},
        std::tuple{"high_N", "Force, at most [N]", "upper error bound by discretisation; -1: unknown"},
        std::tuple{"indentation_mm", "Indentation [mm]", "that was reached"}})
    results += parameter("double", "", name, "", label, help, output + "      <default>0</default>\n");

  return "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<executable>\n  <category>Simulation</category>\n"
         "  <title>Dimple</title>\n  <description>From a label image to a force: meshless indentation of a "
         "soft "
         "organ.</description>\n  <version>" DIMPLE_VERSION
         "</version>\n  <documentation-url></documentation-url>\n"
         "  <license>MIT; the program as a whole GPL 3</license>\n  <contributor>The Dimple "
         "authors</contributor>\n"
         "  <acknowledgements>The method grew from Horton, Wittek and Miller, MICCAI "
         "2007.</acknowledgements>\n" +
         group("Image and results", "Label image and folder of the results", false, files) +
         group("Scene", "Organ, base, tool, tissue and load", false, common) +
         group("All other options", "Discretisation, supports, time stepping and files", true, others) +
         group("Force", "Results of the run", false, results) + "</executable>\n";
}

void write_return_parameters(const std::filesystem::path& file, const std::string& summary_json) {
  const Json summary = Json::parse(summary_json);
  const Json error_bounds = summary.value("band", Json::object());
  std::string text;
  for (const char* name : {"force_N", "indentation_mm"})
    text += fmt::format("{} = {:.9g}\n", name, summary.value(name, 0.0));
  for (const char* name : {"low_N", "high_N"})
    text += fmt::format("{} = {:.9g}\n", name, error_bounds.value(name, -1.0));
  write_file(file, text);
}

}  // namespace dimple
