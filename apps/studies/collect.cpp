#include "apps/studies/collect.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <regex>
#include <set>

#include "apps/run/checkpoint.hpp"
#include "apps/run/result_folder.hpp"
#include "apps/run/words.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"
#include "io/text.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// A case's folder may be of others: a device or a pipe may never end, and no file of a run that is read here
// is larger.
fs::path small_file(const fs::path& file) {
  require_regular_file(file);
  if (fs::file_size(file) > most_bytes_of_text)
    throw InputError({.fact = fmt::format("{} is larger than {} MB", file.filename().string(),
                                          most_bytes_of_text / 1'000'000),
                      .where = file.string(),
                      .why = "no run writes such a one",
                      .remedy = "run the case anew with --force"});
  return file;
}

// What JSON holds under these names, one within the other, as a field of a table.
std::string field(const Json& json, std::initializer_list<const char*> names) {
  const Json* at = &json;
  for (const char* name : names) {
    if (!at->is_object() || !at->contains(name)) return {};
    at = &at->at(name);
  }
  if (at->is_string()) return at->get<std::string>();
  if (at->is_number_integer()) return std::to_string(at->get<std::int64_t>());
  return at->is_number() ? shortest(at->get<double>()) : "";
}

std::string labels_in(const Json& summary) {
  std::string text;
  if (!summary.contains("labels") || !summary.at("labels").is_array()) return text;
  for (const Json& label : summary.at("labels")) {
    const std::string name = field(label, {"name"});
    text += (text.empty() ? "" : "; ") + field(label, {"value"}) + (name.empty() ? "" : " " + name);
  }
  return text;
}

// The value of a column at a depth, between two rows or between rest and the first; nothing: it does not
// reach so deep.
std::string between_rows(const std::vector<double>& depth, const std::vector<double>& value, double at) {
  for (std::size_t k = 0; k < depth.size(); ++k) {
    const double rounding = 1e-9 * at;  // depths were converted from metres
    if (depth[k] < at - rounding) continue;
    if (depth[k] <= at + rounding) return shortest(value[k]);
    const double before = k > 0 ? depth[k - 1] : 0.0, first = k > 0 ? value[k - 1] : 0.0;
    return shortest(first + (value[k] - first) * (at - before) / (depth[k] - before));
  }
  return {};
}

std::vector<CollectedCase::Force> forces_at(const fs::path& file, const std::vector<double>& depths_mm) {
  std::vector<CollectedCase::Force> forces(depths_mm.size());
  const Table table = read_csv(small_file(file));
  const std::vector<double>* depth = table.find("indentation_mm");
  if (!depth) return forces;
  constexpr std::array columns = {"force_N", "low_N", "high_N"};
  for (std::size_t c = 0; c < columns.size(); ++c)
    if (const std::vector<double>* value = table.find(columns[c]))
      for (std::size_t d = 0; d < depths_mm.size(); ++d)
        forces[d][c] = between_rows(*depth, *value, depths_mm[d]);
  return forces;
}

void read_summary(const fs::path& folder, const std::vector<double>& depths_mm, CollectedCase& one) {
  const Json summary = Json::parse(read_file(small_file(folder / "summary.json")), nullptr, false);
  if (!summary.is_object())
    throw InputError({.fact = "summary.json is damaged",
                      .where = (folder / "summary.json").string(),
                      .why = "it is no JSON object",
                      .remedy = "run the case anew with --force"});
  one.status = field(summary, {"status"});
  one.code = field(summary, {"failure", "code"});
  one.fact = field(summary, {"failure", "fact"});
  one.where = field(summary, {"failure", "where"});
  one.remedy = field(summary, {"failure", "remedy"});
  one.image = field(summary, {"image"});
  one.labels = labels_in(summary);
  one.volume_mm3 = field(summary, {"volume_mm3"});
  if (summary.contains("material") && summary.at("material").is_array() && !summary.at("material").empty())
    one.mu_Pa = field(summary.at("material").front(), {"mu_Pa"});
  one.indentation_mm = field(summary, {"indentation_mm"});
  one.force = {field(summary, {"force_N"}), field(summary, {"band", "low_N"}),
               field(summary, {"band", "high_N"})};
  for (std::size_t k = 0; const char* key : {"force_N", "indentation_mm", "step"})
    one.largest[k++] = field(summary, {"largest_force", key});
  // One that found no equilibrium: what is at rest is no force of it.
  if (one.status == "failed" && one.indentation_mm == "0") one.indentation_mm = one.force[0] = "";
  one.total_s = field(summary, {"total_wall_s"});
  one.nodes = field(summary, {"counts", "nodes"});
  if (summary.contains("warnings") && summary.at("warnings").is_array())
    one.warnings = std::to_string(summary.at("warnings").size());
  one.version = field(summary, {"version"});
  const std::string diameter = field(summary, {"counts", "circle_diameter_mm"});
  one.tool = field(summary, {"tool", "words"});
  if (one.tool.empty() && !diameter.empty()) one.tool = fmt::format("a circle of {} mm diameter", diameter);
  if (!depths_mm.empty() && !one.force[0].empty()) one.at_depth = forces_at(folder / "force.csv", depths_mm);
}

CollectedCase case_in(const fs::path& folder, const std::vector<double>& depths_mm) {
  std::error_code ignored;
  CollectedCase one;
  one.id = folder.filename().string();
  try {
    if (fs::exists(folder / "summary.json", ignored)) {
      read_summary(folder, depths_mm, one);
    } else if (fs::is_directory(folder, ignored)) {
      one.status = "unfinished";
      one.fact = "the run has not come to its end";
      one.remedy = "start the batch again: it goes on from where the run was";
    } else {
      one.status = "missing";
      one.fact = "the case has not been run";
      one.remedy = "start the batch again";
    }
  } catch (const Stopped&) {
    throw;
  } catch (const Error& error) {
    one.status = "failed";
    one.code = error.report.code;
    one.fact = error.report.fact;
    one.where = error.report.where;
    one.remedy = error.report.remedy;
  }
  one.at_depth.resize(depths_mm.size());
  one.picture = fs::exists(folder / "overview.png", ignored);
  one.report = fs::exists(folder / "report.html", ignored);
  return one;
}

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

// A path as a link of a page names it.
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
  return field.empty() ? 0.0 : std::stod(field);  // which shortest() has written
}

std::string title_of(const CollectedCase& one) {
  if (one.force[0].empty()) return {};
  if (const auto& [force, depth, step] = one.largest; !force.empty())
    return escaped(scene_title(number_in(force), number_in(depth), step, number_in(one.force[0])));
  std::optional<double> half_N;
  if (!one.force[1].empty()) half_N = 0.5 * (number_in(one.force[2]) - number_in(one.force[1]));
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

// What each column of force.csv is, for the file that BIDS wants beside a table.
Json columns_of(const Table& table) {
  static const std::map<std::string, std::pair<const char*, const char*>> known = {
      {"time_s", {"time since contact", "s"}},
      {"indentation_mm", {"depth of the tool since contact", "mm"}},
      {"force_N", {"force on the tool along its way", "N"}},
      {"base_force_N", {"force that the held base carries", "N"}},
      {"low_N", {"low end of the force's band, by its discretisation", "N"}},
      {"high_N", {"high end of the force's band, by its discretisation", "N"}},
      {"force_x_N", {"force of the tissue on the tool, towards the patient's left", "N"}},
      {"force_y_N", {"force of the tissue on the tool, towards posterior", "N"}},
      {"force_z_N", {"force of the tissue on the tool, towards superior", "N"}},
      {"moment_x_Nm",
       {"its moment about the middle of the circle, or the tip of a tool that touches, which moves with it; "
        "about the axis to the left",
        "N.m"}},
      {"moment_y_Nm", {"the same about the axis to posterior", "N.m"}},
      {"moment_z_Nm", {"the same about the axis to superior", "N.m"}},
      {"aside_x_mm", {"how far the tool has come across its push, towards the patient's left", "mm"}},
      {"aside_y_mm", {"the same towards posterior", "mm"}},
      {"aside_z_mm", {"the same towards superior", "mm"}},
      {"turned_x_deg",
       {"by which rotation vector the tool has turned from where it began: towards the patient's left",
        "deg"}},
      {"turned_y_deg", {"the same towards posterior", "deg"}},
      {"turned_z_deg", {"the same towards superior", "deg"}},
      {"mu_low_N", {"low end of the force's band, by the shear modulus", "N"}},
      {"mu_high_N", {"high end of the force's band, by the shear modulus", "N"}}};
  Json columns = Json::object();
  for (const std::string& name : table.header)
    if (const auto found = known.find(name); found != known.end())
      columns[name] = {{"Description", found->second.first}, {"Units", found->second.second}};
  return columns;
}

}  // namespace

std::vector<CollectedCase> collect(const fs::path& out, const std::vector<double>& depths_mm,
                                   const std::vector<std::string>& expected) {
  std::error_code error;
  if (!fs::is_directory(out, error))
    throw InputError({.fact = fmt::format("there is no folder {}", out.string()),
                      .where = "command line",
                      .why = "the cases of a batch are folders in one",
                      .remedy = "give the folder that `dimple batch -o` has filled"});
  std::set<std::string> ids(expected.begin(), expected.end());
  for (const auto& entry : fs::directory_iterator(out)) {
    stop_if_asked();
    if (fs::exists(entry.path() / "summary.json", error) || fs::exists(entry.path() / checkpoint_file, error))
      ids.insert(entry.path().filename().string());
  }
  if (ids.empty())
    throw InputError({.fact = fmt::format("{} holds no case", out.string()),
                      .where = "command line",
                      .why = "no folder in it has a summary.json",
                      .remedy = "give the folder that `dimple batch -o` has filled"});
  std::vector<CollectedCase> cases;
  for (const std::string& id : ids) {
    stop_if_asked();
    cases.push_back(case_in(out / id, depths_mm));
  }
  return cases;
}

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
  text += "Those that are not finished come first.</p>\n<main>\n";
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
    stop_if_asked();
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
    const Table force = read_csv(small_file(from / "force.csv"));
    write_file(to / (stem + "force.tsv"), as_tsv(force));
    Json about = columns_of(force);
    about["Sources"] = Json::array({one.image});
    about["Status"] = one.status;
    write_file(to / (stem + "force.json"), about.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
    if (one.picture) write_file(to / (stem + "overview.png"), read_file(small_file(from / "overview.png")));
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
