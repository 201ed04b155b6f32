// How much of what `dimple run --explain` says is true: each of its lines, from short runs, beside the same
// comparison with several times as many nodes.
//
//   dimple_explained FOLDER IMAGE... [--nodes 8000] [--depth 4]
//
// Writes explained.csv, a row for each line, and explained.md: how many agree in sign and size, within a
// third of the effect or one per cent of the force. Where the tissue gives way with one of both clouds, they
// are compared above.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <tuple>

#include "apps/studies/explain.hpp"
#include "io/error.hpp"
#include "io/file.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

constexpr double share = 1.0 / 3.0, least = 0.01;

void compare(const fs::path& folder, const std::vector<std::string>& images, Index nodes, double depth_mm) {
  const auto say = [](const std::string& line) {
    fmt::print("{}\n", line);
    std::fflush(stdout);
  };
  std::string csv =
      "image,choice,instead,indentation_mm,nodes,effect_percent,direct_nodes,direct_effect_percent,agrees\n";
  std::string text =
      "| image | choice | instead | effect, % | with {} nodes, % | |\n|---|---|---|---:|---:|---|\n";
  text = fmt::format(fmt::runtime(text), nodes);
  std::string sums;
  for (const std::string& image : images) {
    Config config;
    config.image.file = image;
    config.load.depth_mm = depth_mm;
    const std::string name = fs::path(image).filename().string();
    const Explanation told = explain(config, 0, say);
    write_explanation(folder, told, name);  // the last image's stays: one picture is enough
    const Explanation direct = explain(config, nodes, say);
    int lines = 0, agreeing = 0;
    for (const Alternative& a : told.alternatives) {
      if (a.kind == Alternative::Kind::cloud) continue;  // that is the discretisation's own
      const auto same = [&](const Alternative& b) { return b.what == a.what && b.instead == a.instead; };
      const auto other = std::find_if(direct.alternatives.begin(), direct.alternatives.end(), same);
      // The deepest place that both have.
      double at_mm = 0.0, effect = 0.0, direct_effect = 0.0;
      if (other != direct.alternatives.end())
        for (std::size_t k = 0; k < std::min(a.effects.size(), other->effects.size()); ++k)
          std::tie(at_mm, effect) = a.effects[k], direct_effect = other->effects[k].second;
      const bool compared = at_mm > 0.0;
      const bool agrees =
          compared && std::abs(effect - direct_effect) <= std::max(least, share * std::abs(direct_effect));
      const std::string verdict = compared ? agrees ? "yes" : "no" : "one of them has no force";
      const std::string instead = !compared || at_mm == depth_mm
                                      ? a.instead
                                      : fmt::format("{} (at {:g} mm: {})", a.instead, at_mm,
                                                    other->deeper.empty() ? a.deeper : other->deeper);
      const std::string with_many = compared ? fmt::format("{:+.2f}", 100.0 * direct_effect) : std::string();
      ++lines;
      agreeing += agrees;
      csv += fmt::format("{},\"{}\",\"{}\",{:g},{},{:.3f},{},{},{}\n", name, a.what, a.instead, at_mm,
                         told.nodes, 100.0 * effect, nodes, with_many, verdict);
      text += fmt::format("| {} | {} | {} | {:+.1f} | {} | {} |\n", name, a.what, instead, 100.0 * effect,
                          with_many, agrees ? "" : verdict);
    }
    sums += fmt::format(
        "- {}: {} of {} lines agree; {:.0f} s with {} nodes, {:.0f} s with {}; noise {:.1f} and {:.1f} %\n",
        name, agreeing, lines, told.total_s, told.nodes, direct.total_s, nodes, 100.0 * told.noise,
        100.0 * direct.noise);
    write_file(folder / "explained.csv", csv);
    write_file(folder / "explained.md", sums + "\n" + text);
  }
  fmt::print("{}", sums);
}

}  // namespace
}  // namespace dimple

int main(int argc, char** argv) try {
  std::filesystem::path folder;
  std::vector<std::string> images;
  dimple::Index nodes = 8000;
  double depth_mm = 4.0;  // deeper than the circle's radius no number of nodes is near a converged force
  CLI::App app("What --explain says, beside the same with many nodes");
  app.add_option("folder", folder, "for tables and pictures")->required();
  app.add_option("images", images)->required();
  app.add_option("--nodes", nodes);
  app.add_option("--depth", depth_mm, "[mm]");
  CLI11_PARSE(app, argc, argv);
  dimple::make_folder(folder);
  dimple::compare(folder, images, nodes, depth_mm);
} catch (const dimple::Error& error) {
  fmt::print(stderr, "{}\n{}\n", error.report.fact, error.report.remedy);
  return static_cast<int>(error.code);
}
