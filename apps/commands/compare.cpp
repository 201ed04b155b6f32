#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <nlohmann/json.hpp>

#include "apps/commands/all_commands.hpp"
#include "apps/commands/log.hpp"
#include "apps/commands/terminal.hpp"
#include "apps/run/error_bounds.hpp"
#include "apps/studies/read_results.hpp"
#include "io/digits.hpp"
#include "io/draw/chart.hpp"
#include "io/text.hpp"
#include "io/units.hpp"
#include "io/words.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

struct Difference {
  std::string what, a, b;
};

// Differences in the options, then in the choices that the runs made themselves.
std::vector<Difference> differences_of(const FinishedRun& a, const FinishedRun& b) {
  std::vector<Difference> differences;
  const auto compare = [&](const std::string& what, const std::string& of_a, const std::string& of_b) {
    if (of_a != of_b) differences.push_back({what, printable(of_a), printable(of_b)});
  };
  std::map<std::string, std::string> keys = a.options;
  keys.insert(b.options.begin(), b.options.end());
  const auto value_in = [](const FinishedRun& run, const std::string& key) {
    const auto found = run.options.find(key);
    return found == run.options.end() ? std::string("not given") : found->second;
  };
  // The list of written files does not change the result.
  std::erase_if(keys, [](const auto& option) { return option.first.starts_with("output."); });
  // Nodes chosen for an accuracy are compared below.
  if (a.summary.contains("ladder") || b.summary.contains("ladder")) keys.erase("cloud.nodes");
  for (const auto& [key, ignored] : keys) compare(key, value_in(a, key), value_in(b, key));
  const auto compare_part = [&](const std::string& what, std::initializer_list<const char*> names) {
    const auto reported = [&](const FinishedRun& run) {
      const Json* part = part_of(run.summary, names);
      return part ? part->dump() : std::string("not said");
    };
    compare(what, reported(a), reported(b));
  };
  for (const char* key : {"version", "time"}) compare_part(key, {key});
  for (const char* key : {"nodes", "circle_centre_mm", "push"})
    compare_part(fmt::format("chosen {}", key), {"counts", key});
  compare_part("chosen base", {"model", "base_reason"});
  return differences;
}

struct Row {
  double depth, force_a, half_a, force_b, half_b;  // [m], [N]
  bool overlap() const { return std::abs(force_a - force_b) <= half_a + half_b; }
  double change() const { return force_b / force_a - 1.0; }
};

// Rows at the depths of the curve with fewer rows; the other curve is interpolated there.
std::vector<Row> rows_of(const FinishedRun& a, const FinishedRun& b) {
  const auto shallower = std::min(a.curve.back().depth, b.curve.back().depth) * (1.0 + 1e-9);
  std::vector<double> depths;
  double first = std::max(a.curve.front().depth, b.curve.front().depth) * (1.0 - 1e-9);
  for (const ForceSample& s : (a.curve.size() <= b.curve.size() ? a : b).curve)
    if (s.depth >= first && s.depth <= shallower) depths.push_back(s.depth);
  if (depths.empty())
    throw InputError(
        {.fact = "the two curves have no depth in common",
         .where = a.folder + ", " + b.folder,
         .why = fmt::format("one is from {:.3g} to {:.3g} mm, the other from {:.3g} to {:.3g} mm",
                            1e3 * a.curve.front().depth, 1e3 * a.curve.back().depth,
                            1e3 * b.curve.front().depth, 1e3 * b.curve.back().depth),
         .remedy = "run one of them with more --frames"});
  constexpr std::size_t most_rows = 16;  // including the last one
  std::vector<double> kept;
  const std::size_t count = std::min(most_rows, depths.size());
  for (std::size_t k = 1; k <= count; ++k) kept.push_back(depths[k * depths.size() / count - 1]);
  const auto forces_a = forces_between(a.curve, kept), forces_b = forces_between(b.curve, kept);
  const auto half = [&](const FinishedRun& run) {
    return run.half.empty() ? std::vector<double>(kept.size(), 0.0)
                            : halves_between(run.curve, run.half, kept);
  };
  const std::vector<double> half_a = half(a), half_b = half(b);
  std::vector<Row> rows;
  for (std::size_t k = 0; k < kept.size(); ++k)
    rows.push_back({kept[k], forces_a[k], half_a[k], forces_b[k], half_b[k]});
  return rows;
}

// Elastic energy released by the further cut, for two bodies that differ only in their cuts.
struct Released {
  bool in_b = true;     // the one with the further cut
  double energy, area;  // [J], [m^2]
};

std::optional<Released> released_by_cut(const FinishedRun& a, const FinishedRun& b,
                                        const std::vector<Difference>& differences) {
  const bool alike = a.image_sha256 == b.image_sha256 && !a.image_sha256.empty() &&
                     std::abs(a.curve.back().depth - b.curve.back().depth) < 1e-9 &&
                     std::all_of(differences.begin(), differences.end(), [](const Difference& d) {
                       return d.what == "image.cut" || d.what == "chosen nodes";
                     });
  if (!alike || a.cut_area == b.cut_area || !(a.stored > 0.0 && b.stored > 0.0)) return std::nullopt;
  const bool in_b = b.cut_area > a.cut_area;
  const double sign = in_b ? 1.0 : -1.0;
  return Released{in_b, sign * (a.stored - b.stored), sign * (b.cut_area - a.cut_area)};
}

std::string in_words(const Released& released, const FinishedRun& a, const FinishedRun& b) {
  return fmt::format(
      "energy   {} more of cut in {} release {} uJ at that depth, {} J/m2; A stores {}, B {} uJ, and the "
      "errors of both discretisations are in the difference",
      fmt::format("{:.4g} mm2", 1e6 * released.area), released.in_b ? "B" : "A",
      three_digits(1e6 * released.energy), three_digits(released.energy / released.area),
      three_digits(1e6 * a.stored), three_digits(1e6 * b.stored));
}

bool both_banded(const FinishedRun& a, const FinishedRun& b) {
  return !a.half.empty() && !b.half.empty();
}

// "yes", "no" or "not known".
std::string same_image(const FinishedRun& a, const FinishedRun& b) {
  if (a.image_sha256.empty() || b.image_sha256.empty()) return "not known";
  return a.image_sha256 == b.image_sha256 ? "yes" : "no";
}

std::string image_in_words(const FinishedRun& a, const FinishedRun& b) {
  const std::string same = same_image(a, b);
  if (same == "yes")
    return "both runs are of the same image (SHA-256 " + a.image_sha256.substr(0, 12) + "...)";
  if (same == "no") return "the runs are of DIFFERENT images: their forces belong to two bodies";
  return "the runs may be of different images: one of them does not name its image";
}

Written force_at(const Row& row) {
  const auto [less, more] = std::minmax({std::abs(row.force_a), std::abs(row.force_b)});  // a list: by value
  return force_written(less > 0.0 ? less : more);  // unit in which both have digits
}

// Unit of the smallest force of a table, without forces that are nearly zero.
Written force_of(const std::vector<Row>& rows) {
  constexpr double next_to_nothing = 0.01;
  const auto most = [](const Row& row) { return std::max(std::abs(row.force_a), std::abs(row.force_b)); };
  Row least = rows.back();
  for (const Row& row : rows)
    if (most(row) < most(least) && most(row) >= next_to_nothing * most(rows.back())) least = row;
  return force_at(least);
}

std::string verdict_in_words(const FinishedRun& a, const FinishedRun& b, const Row& deepest) {
  const Written force = force_at(deepest);
  const double percent = 100.0 * deepest.change();
  std::string text = fmt::format("at {:.2f} mm: A {}, B {}", 1e3 * deepest.depth, force(deepest.force_a),
                                 force(deepest.force_b));
  if (deepest.force_a == deepest.force_b)
    text += ", the same force";
  else
    text += std::abs(percent) < 0.05
                ? std::string(", less than 0.1 % apart")
                : fmt::format(", B {:.1f} % {}", std::abs(percent), percent > 0.0 ? "above A" : "below A");
  for (const FinishedRun* run : {&a, &b})
    if (run->half.empty())
      return text + fmt::format(
                        "; {} has no error estimate ({}), so the discretisation may or may not explain the "
                        "difference",
                        run == &a ? "A" : "B", run->no_error_bounds);
  return text +
         (deepest.overlap()
              ? "; the error bounds overlap: the discretisation alone may explain the difference"
              : "; the error bounds do not overlap: the discretisation does not explain the difference");
}

std::string error_bounds_text(const Written& force, const FinishedRun& run, double at, double half) {
  if (run.half.empty()) return "none";
  return fmt::format("{} to {}", force.number(lower_bound(at, half, run.contacting)),
                     force.number(at + half));
}

void print_table(const FinishedRun& a, const FinishedRun& b, const std::vector<Row>& rows,
                 const std::vector<Difference>& differences) {
  const auto one = [](const char* name, const FinishedRun& run) {
    const Json* image = part_of(run.summary, {"image"});
    print(fmt::format(
        "{}        {}: {}\n", name, run.folder,
        printable(image && image->is_string() ? image->get<std::string>() : "made from a model")));
  };
  one("A", a);
  one("B", b);
  print(fmt::format("image    {}\n", image_in_words(a, b)));
  if (differences.empty()) print(fmt::format("options  no difference\n"));
  for (const Difference& d : differences) print(fmt::format("differs  {}: A {}, B {}\n", d.what, d.a, d.b));
  const Written force = force_of(rows);
  const std::string unit = force.unit;
  print(fmt::format("\n{:>8}  {:>9}  {:>18}  {:>9}  {:>18}  {:>9}  {}\n", "depth_mm", "A_" + unit,
                    "bounds of A", "B_" + unit, "bounds of B", "B-A_%", "bounds overlap"));
  for (const Row& row : rows)
    print(fmt::format("{:>8.2f}  {:>9}  {:>18}  {:>9}  {:>18}  {:>+9.1f}  {}\n", 1e3 * row.depth,
                      force.number(row.force_a), error_bounds_text(force, a, row.force_a, row.half_a),
                      force.number(row.force_b), error_bounds_text(force, b, row.force_b, row.half_b),
                      100.0 * row.change() + 0.0,
                      !both_banded(a, b) ? "not known"
                      : row.overlap()    ? "yes"
                                         : "no"));
  print(fmt::format("\n{}\n", verdict_in_words(a, b, rows.back())));
  if (const auto released = released_by_cut(a, b, differences)) print(in_words(*released, a, b) + "\n");
}

Json to_json(const FinishedRun& a, const FinishedRun& b, const std::vector<Row>& rows,
             const std::vector<Difference>& differences) {
  Json json;
  for (const auto& [name, run] : {std::pair("a", &a), std::pair("b", &b)}) {
    json[name] = {{"folder", run->folder},
                  {"image_sha256", run->image_sha256.empty() ? Json() : Json(run->image_sha256)}};
    if (run->half.empty()) json[name]["band_unknown"] = run->no_error_bounds;
  }
  const std::string same = same_image(a, b);
  json["same_image"] = same == "not known" ? Json() : Json(same == "yes");
  json["differences"] = Json::array();
  for (const Difference& d : differences)
    json["differences"].push_back({{"what", d.what}, {"a", d.a}, {"b", d.b}});
  if (const auto released = released_by_cut(a, b, differences))
    json["released_by_cut"] = {{"energy_J", released->energy},
                               {"area_mm2", 1e6 * released->area},
                               {"energy_per_area_J_m2", released->energy / released->area}};
  json["at_depth"] = Json::array();
  const auto end = [](bool known, double value) { return known ? Json(value) : Json(); };
  for (const Row& row : rows) {
    const bool of_a = !a.half.empty(), of_b = !b.half.empty();
    json["at_depth"].push_back({{"indentation_mm", 1e3 * row.depth},
                                {"a_force_N", row.force_a},
                                {"a_low_N", end(of_a, lower_bound(row.force_a, row.half_a, a.contacting))},
                                {"a_high_N", end(of_a, row.force_a + row.half_a)},
                                {"b_force_N", row.force_b},
                                {"b_low_N", end(of_b, lower_bound(row.force_b, row.half_b, b.contacting))},
                                {"b_high_N", end(of_b, row.force_b + row.half_b)},
                                {"bands_overlap", of_a && of_b ? Json(row.overlap()) : Json()}});
  }
  return json;
}

void add_series(Chart& chart, const char* name, const FinishedRun& run, double per_N, int colour) {
  ChartSeries curve{
      .name = fmt::format("{}: {}", name, run.folder), .markers = run.curve.size() <= 64, .colour = colour};
  ChartSeries low{.markers = false, .dashed = true, .colour = colour}, high = low;
  for (ChartSeries* series : {&curve, &low, &high}) series->x = series->y = {0.0};  // at rest
  for (std::size_t k = 0; k < run.curve.size(); ++k) {
    const ForceSample& s = run.curve[k];
    const double half = run.half.empty() ? 0.0 : run.half[k];
    for (ChartSeries* series : {&curve, &low, &high}) series->x.push_back(1e3 * s.depth);
    curve.y.push_back(per_N * s.force);
    low.y.push_back(per_N * lower_bound(s.force, half, run.contacting));
    high.y.push_back(per_N * (s.force + half));
  }
  chart.series.push_back(curve);
  if (run.half.empty()) return;
  chart.series.push_back(low);
  chart.series.push_back(high);
}

void draw(const fs::path& file, const FinishedRun& a, const FinishedRun& b, const Row& deepest) {
  const Written force = force_at(deepest);
  Chart chart{.title = "Force curves of two runs; dashed: error bounds of the discretisation",
              .subtitle = {image_in_words(a, b), verdict_in_words(a, b, deepest)},
              .x_label = "indentation [mm]",
              .y_label = fmt::format("force [{}]", force.unit)};
  add_series(chart, "A", a, force.per_unit, 0);
  add_series(chart, "B", b, force.per_unit, 1);
  write_chart(file, {chart});
}

struct CompareArguments {
  std::string a, b;
};

int perform(const Invocation& shared, const CompareArguments& options) {
  const fs::path picture = shared.out;
  if (!shared.out.empty() && picture.extension() != ".png" && picture.extension() != ".svg")
    throw UsageError({.fact = fmt::format("'{}' is no name of a picture", printable(shared.out)),
                      .where = "-o",
                      .why = "the suffix selects the format: .png or .svg",
                      .remedy = "for instance -o compare.png"});
  const FinishedRun a = read_finished_run(options.a), b = read_finished_run(options.b);
  const std::vector<Row> rows = rows_of(a, b);
  const std::vector<Difference> differences = differences_of(a, b);
  if (same_image(a, b) != "yes") warn(image_in_words(a, b));
  if (!shared.out.empty()) draw(picture, a, b, rows.back());
  if (shared.json)
    print_json(as_text(to_json(a, b, rows, differences)));
  else
    print_table(a, b, rows, differences);
  return 0;
}

}  // namespace

Command add_compare(CLI::App& app, Invocation& shared) {
  const auto options = std::make_shared<CompareArguments>();
  CLI::App* command = add_to(app, whole::compare);
  command->add_option("A", options->a, "folder of a finished run")->required();
  command->add_option("B", options->b, "folder of another")->required();
  command->add_option("-o,--out,--output", shared.out, "picture of both force curves: .png or .svg");
  command->add_flag("--json", shared.json, "JSON on stdout in place of the table");
  command->add_flag("-q,--quiet", shared.quiet, "errors only");
  return {command, [&shared, options] { return perform(shared, *options); }};
}

}  // namespace dimple
