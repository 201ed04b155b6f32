#include "apps/studies/collect.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <regex>

#include "apps/run/words.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/text.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      default:
        result += c;
    }
  return result;
}

// Path as a link in a page.
std::string as_link(const std::string& path) {
  std::string result;
  for (const char c : path) {
    const auto byte = static_cast<unsigned char>(c);
    const bool plain =
        byte < 0x80 && (std::isalnum(byte) || std::string_view("-._~/").find(c) != std::string_view::npos);
    result += plain ? std::string(1, c) : fmt::format("%{:02X}", byte);
  }
  return result;
}

double number_in(const std::string& field) {
  return field.empty() ? 0.0 : std::stod(field);  // written by shortest()
}

std::string title_of(const CollectedCase& one) {
  if (one.force[0].empty()) return {};
  std::optional<double> half_N;
  if (!one.force[1].empty()) half_N = number_in(one.force[2]) - number_in(one.force[0]);
  if (const auto& [force, depth, step] = one.largest; !force.empty())
    return escaped(scene_title(number_in(force), number_in(depth), step, number_in(one.force[0]), half_N));
  return force_title(number_in(one.force[0]), number_in(one.indentation_mm), half_N);
}

constexpr const char* page_head = R"(<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Cases</title>
<meta name="viewport" content="width=device-width">
<style>
body{font:14px/1.4 sans-serif;margin:1.5em;color:#222}
main{display:grid;grid-template-columns:repeat(auto-fill,minmax(22em,1fr));gap:1em}
figure{margin:0;border:1px solid #ccc;padding:.5em;content-visibility:auto;contain-intrinsic-size:22em 20em}
img{width:100%;aspect-ratio:4/3;object-fit:contain;background:#f4f4f4}
b{overflow-wrap:anywhere}small{color:#666}.bad{border-color:#b00}.bad i{color:#b00;font-style:normal}
</style></head><body>
)";

std::string figure_of(const CollectedCase& one, const std::string& to_cases) {
  const bool is_finished = one.status == "finished";
  const std::string folder = as_link(to_cases + one.id);
  std::string text = is_finished ? "<figure>" : "<figure class=bad>";
  if (one.picture)
    text += fmt::format("<a href=\"{0}/{1}\"><img loading=lazy src=\"{0}/overview.png\" alt=\"\"></a>",
                        folder, one.report ? "report.html" : "overview.png");
  text += fmt::format("<figcaption><b>{}</b> ", escaped(one.id));
  if (!is_finished)
    text += fmt::format("<i>{}{}: {}</i><br>{}<br>", escaped(one.status),
                        one.code.empty() ? "" : " [" + escaped(one.code) + "]", escaped(one.fact),
                        escaped(one.remedy));
  text += title_of(one);
  text += "<br><small>";
  if (!one.nodes.empty())
    text +=
        fmt::format("{} nodes, {} s, ", escaped(one.nodes), fmt::format("{:.1f}", number_in(one.total_s)));
  if (!one.warnings.empty() && one.warnings != "0")
    text += fmt::format("{} warnings, ", escaped(one.warnings));
  text += escaped(one.image) + "</small></figcaption></figure>\n";
  return text;
}

// BIDS 1.8: entities are key-value pairs joined by underscores, the first is the subject.
const std::regex& bids_entities() {
  static const std::regex pattern(R"(sub-[A-Za-z0-9]+(_ses-[A-Za-z0-9]+)?(_[a-z]+-[A-Za-z0-9]+)*)");
  return pattern;
}

std::string as_tsv(const Table& table) {
  std::string text;
  for (const std::string& name : table.header) {
    if (!text.empty()) text += '\t';
    text += as_text(printable(name));
  }
  text += '\n';
  for (std::size_t r = 0; r < table.rows(); ++r) {
    for (std::size_t c = 0; c < table.header.size(); ++c) {
      if (c > 0) text += '\t';
      text += shortest(table.column[c][r]);
    }
    text += '\n';
  }
  return text;
}

// Description of each column of force.csv, for the file that BIDS requires next to a table.
Json columns_of(const Table& table) {
  static const std::map<std::string, std::pair<const char*, const char*>> known = {
      {"time_s", {"time since contact", "s"}},
      {"indentation_mm", {"depth of the tool since contact", "mm"}},
      {"force_N", {"force on the tool along its approach direction", "N"}},
      {"base_force_N", {"force on the fixed base", "N"}},
      {"low_N", {"lower error bound of the force, by discretisation", "N"}},
      {"high_N", {"upper error bound of the force, by discretisation", "N"}},
      {"force_x_N", {"force of the tissue on the tool, towards the patient's left", "N"}},
      {"force_y_N", {"force of the tissue on the tool, towards posterior", "N"}},
      {"force_z_N", {"force of the tissue on the tool, towards superior", "N"}},
      {"moment_x_Nm",
       {"its moment about the centre of the contact patch or the tip of a contacting tool, which moves with "
        "the tool; about the axis to the left",
        "N.m"}},
      {"moment_y_Nm", {"the same about the axis to posterior", "N.m"}},
      {"moment_z_Nm", {"the same about the axis to superior", "N.m"}},
      {"aside_x_mm",
       {"displacement of the tool across its approach direction, towards the patient's left", "mm"}},
      {"aside_y_mm", {"the same towards posterior", "mm"}},
      {"aside_z_mm", {"the same towards superior", "mm"}},
      {"turned_x_deg", {"rotation vector of the tool from its start: towards the patient's left", "deg"}},
      {"turned_y_deg", {"the same towards posterior", "deg"}},
      {"turned_z_deg", {"the same towards superior", "deg"}},
      {"mu_low_N", {"lower bound of the force, by the shear modulus", "N"}},
      {"mu_high_N", {"upper bound of the force, by the shear modulus", "N"}}};
  Json columns = Json::object();
  for (const std::string& name : table.header)
    if (const auto found = known.find(name); found != known.end())
      columns[name] = {{"Description", found->second.first}, {"Units", found->second.second}};
  return columns;
}

}  // namespace

TextTable table_of(const std::vector<CollectedCase>& cases, const std::vector<double>& depths_mm) {
  TextTable table{.header = {"id", "image", "labels", "volume_mm3", "mu_Pa", "indentation_mm", "force_N",
                             "low_N", "high_N"},
                  .row = {}};
  for (const double depth : depths_mm)
    for (const char* name : {"force", "low", "high"})
      table.header.push_back(fmt::format("{}_at_{}mm_N", name, shortest(depth)));
  for (const char* name : {"status", "code", "fact", "total_s", "nodes", "warnings", "version", "tool"})
    table.header.push_back(name);
  for (const CollectedCase& one : cases) {
    TextTable::Row row{table.row.size() + 2,
                       {as_text(one.id), as_text(one.image), as_text(one.labels), one.volume_mm3, one.mu_Pa,
                        one.indentation_mm}};
    row.field.insert(row.field.end(), one.force.begin(), one.force.end());
    for (const CollectedCase::Force& force : one.at_depth)
      row.field.insert(row.field.end(), force.begin(), force.end());
    for (const std::string& last : {as_text(one.status), as_text(one.code), as_text(one.fact), one.total_s,
                                    one.nodes, one.warnings, as_text(one.version), as_text(one.tool)})
      row.field.push_back(last);
    table.row.push_back(std::move(row));
  }
  return table;
}

std::string page_of(const std::vector<CollectedCase>& cases, const std::string& to_cases) {
  std::vector<const CollectedCase*> order;
  for (const CollectedCase& one : cases) order.push_back(&one);
  std::stable_partition(order.begin(), order.end(),
                        [](const CollectedCase* one) { return one->status != "finished"; });
  std::map<std::string, int> counts;
  for (const CollectedCase& one : cases) ++counts[one.status];
  std::string text = page_head;
  text += fmt::format("<h1>{} cases</h1>\n<p>", cases.size());
  for (const auto& [status, count] : counts) text += fmt::format("{} {}. ", count, escaped(status));
  text += "Unfinished cases come first.</p>\n<main>\n";
  for (const CollectedCase* one : order) text += figure_of(*one, to_cases);
  return text + "</main></body></html>\n";
}

std::size_t write_bids(const std::vector<CollectedCase>& cases, const fs::path& out,
                       const fs::path& dataset) {
  for (const CollectedCase& one : cases)
    if (!std::regex_match(one.id, bids_entities()))
      throw UsageError(
          {.fact = fmt::format("'{}' is no name of a BIDS subject", one.id),
           .where = "--bids",
           .why = "files of a BIDS dataset are called after entities such as sub-01 or sub-01_ses-02",
           .remedy = "call the cases so in the column id, or leave --bids out"});
  make_folder(dataset);
  std::size_t count = 0;
  std::string version;
  for (const CollectedCase& one : cases) {
    stop_if_requested();
    const fs::path from = out / one.id;
    std::error_code ignored;
    if (one.force[0].empty() || !fs::exists(from / "force.csv", ignored)) continue;
    const std::string subject = one.id.substr(0, one.id.find('_'));
    std::smatch part;
    static const std::regex session("_(ses-[A-Za-z0-9]+)");
    fs::path to = dataset / subject;
    if (std::regex_search(one.id, part, session)) to /= part[1].str();
    make_folder(to);
    const std::string stem = one.id + "_desc-indentation_";
    const Table force = force_table_in(from);
    write_file(to / (stem + "force.tsv"), as_tsv(force));
    Json about = columns_of(force);
    about["Sources"] = Json::array({one.image});
    about["Status"] = one.status;
    write_file(to / (stem + "force.json"), as_text(about));
    if (one.picture) write_file(to / (stem + "overview.png"), read_small_file(from / "overview.png"));
    version = one.version;
    ++count;
  }
  Json description = {
      {"Name", "Force of an indentation"}, {"BIDSVersion", "1.8.0"}, {"DatasetType", "derivative"}};
  Json program = {{"Name", "Dimple"}, {"Version", version.empty() ? DIMPLE_VERSION : version}};
  description["GeneratedBy"] = Json::array({std::move(program)});
  write_file(dataset / "dataset_description.json", description.dump(2) + "\n");
  return count;
}

}  // namespace dimple
