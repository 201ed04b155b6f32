// Files of an explanation: a table, a chart and a page.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "apps/run/words.hpp"
#include "apps/studies/explain.hpp"
#include "io/digits.hpp"
#include "io/draw/chart.hpp"
#include "io/file.hpp"
#include "io/table.hpp"

namespace dimple {

void sort_by_effect(std::vector<Alternative>& alternatives) {
  std::map<std::string, double> largest;
  for (const Alternative& a : alternatives)
    if (a.failed.empty()) largest[a.what] = std::max(largest[a.what], std::abs(a.effect));
  std::stable_sort(alternatives.begin(), alternatives.end(), [&](const Alternative& a, const Alternative& b) {
    if (a.failed.empty() != b.failed.empty()) return a.failed.empty();
    const double x = largest[a.what], y = largest[b.what];
    return x != y ? x > y : a.what < b.what;
  });
}

std::string instead_of(const Alternative& a, const Explanation& e) {
  if (!a.failed.empty() || !(a.depth_mm < e.depth_mm)) return a.instead;
  return fmt::format("{} (at {}: {})", a.instead, length_in_words(a.depth_mm), a.deeper);
}

const char* word_of(Alternative::Kind kind) {
  return kind == Alternative::Kind::node_set ? "discretisation"
         : kind == Alternative::Kind::doubt  ? "doubt"
                                             : "simplification";
}

std::string verdict(const Explanation& explanation, const Alternative& a) {
  if (!a.failed.empty()) return "no force: " + a.failed;
  if (std::abs(a.effect) > threshold(explanation)) return "matters";
  return a.kind == Alternative::Kind::simplification && a.seconds < explanation.seconds ? "free"
                                                                                        : "no matter";
}

namespace {

// Row of the table for a comparison.
ChoiceTable::Row row_of(const Explanation& e, const Alternative& a) {
  const bool there = a.failed.empty();
  return {.what = a.what,
          .instead = instead_of(a, e),
          .all = a.all,
          .at = there && a.depth_mm < e.depth_mm ? "at " + length_in_words(a.depth_mm) : "",
          .kind = a.kind,
          .effect = there ? std::optional(100.0 * a.effect) : std::nullopt,
          .csv = fmt::format("{},{},{},{:g},{},{},{:.3g},{}", csv_field(a.what), csv_field(a.instead),
                             word_of(a.kind), a.depth_mm, there ? fmt::format("{:.6g}", a.force) : "",
                             there ? fmt::format("{:.4g}", 100.0 * a.effect) : "", a.seconds,
                             csv_field(verdict(e, a))),
          .verdict = verdict(e, a),
          .seconds = a.seconds};
}

}  // namespace

void write_explanation(const std::filesystem::path& folder, const Explanation& e,
                       const std::string& subject) {
  const std::string unchanged = fmt::format("{} with {} nodes", force_title(e.force, e.depth_mm), e.nodes);
  ChoiceTable table{
      .text = fmt::format("{}: {}, in {:.1f} s. Each line repeats that run with one choice changed. Effects "
                          "below {:.1f} % are negligible: other random nodes change the force by {:.1f} %. "
                          "By default a run makes none of the simplifications.\n\n",
                          subject, unchanged, e.seconds, 100.0 * threshold(e), 100.0 * e.noise),
      .effect = "effect on the force, %",
      .csv_header = "choice,instead,kind,indentation_mm,force_N,effect_percent,wall_s,verdict",
      .title = fmt::format("What the force depends on: {}", subject),
      .subtitle = {fmt::format("{}; each bar repeats that run with one choice changed; {:.0f} s in all",
                               unchanged, e.total_s)},
      .axis = "effect on the force [%]",
      .shade = 100.0 * threshold(e),
      .shade_text = fmt::format("below {:.1f} %: negligible", 100.0 * threshold(e))};
  if (!e.run.empty()) {
    table.text = fmt::format("The run: {}. The comparisons: {}, so that random nodes do not decide them.\n\n",
                             e.run, unchanged) +
                 table.text;
    table.subtitle.push_back("the explained run: " + e.run);
  }
  for (const std::string& warning : e.warnings)
    table.text = "Of the unchanged run: " + warning + ".\n\n" + table.text;
  if (!e.ended_by.empty()) table.text = "Some choices are missing: " + e.ended_by + ".\n\n" + table.text;
  for (const Alternative& a : e.alternatives) table.rows.push_back(row_of(e, a));
  write_choices(folder, table);
}

void write_choices(const std::filesystem::path& folder, const ChoiceTable& table) {
  // write_csv() accepts only numbers.
  std::string csv = table.csv_header + "\n";
  std::string text = table.text + fmt::format(
                                      "| choice | instead | kind | {} | s | "
                                      "|\n|---|---|---|---:|---:|---|\n",
                                      table.effect);
  std::map<std::string, std::size_t> place;
  Tornado tornado{.title = table.title,
                  .subtitle = table.subtitle,
                  .x_label = table.axis,
                  .shade = table.shade,
                  .shade_text = table.shade_text,
                  .legend = {{0, "not known from the image"}, {2, "the discretisation"}}};
  for (const ChoiceTable::Row& row : table.rows) {
    csv += row.csv + "\n";
    text += fmt::format("| {} | {} | {} | {} | {:.1f} | {} |\n", row.what, row.instead, word_of(row.kind),
                        row.effect ? with_sign(*row.effect) : "", row.seconds, row.verdict);
    if (row.kind == Alternative::Kind::simplification) tornado.legend[1] = "could be left out";
    if (!row.effect) continue;
    const auto [at, is_new] = place.emplace(row.what, tornado.rows.size());
    if (is_new)
      tornado.rows.push_back({.name = row.what,
                              .note = row.all,
                              .colour = row.kind == Alternative::Kind::node_set ? 2
                                        : row.kind == Alternative::Kind::doubt  ? 0
                                                                                : 1});
    Tornado::Row& bar = tornado.rows[at->second];
    if (!row.at.empty() && bar.note.find(row.at) == std::string::npos)
      bar.note += (bar.note.empty() ? "" : ", ") + row.at;
    bar.low = std::min(bar.low, *row.effect);
    bar.high = std::max(bar.high, *row.effect);
  }
  write_file(folder / "explain.csv", csv);
  for (const char* name : {"explain.png", "explain.svg"}) write_tornado(folder / name, {tornado});
  write_file(folder / "explain.md", text);
}

}  // namespace dimple
