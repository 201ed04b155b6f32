#include "apps/run/words.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "io/text.hpp"

namespace dimple {

// "2 (right_hemisphere)"
std::string in_words(const LabelMeasure& label) {
  return label.name.empty() ? std::to_string(label.value) : fmt::format("{} ({})", label.value, label.name);
}

std::string in_words(const std::vector<LabelMeasure>& labels) {
  constexpr std::size_t most = 12;
  std::vector<std::string> words;
  for (const LabelMeasure& label : labels)
    if (words.size() < most) words.push_back(in_words(label));
  return fmt::format("{}{}", fmt::join(words, ", "),
                     labels.size() > most ? fmt::format(" and {} more", labels.size() - most) : "");
}

std::string from_to(double force_N, double half_N, const std::string& by) {
  const Written written = force_written(force_N);
  return fmt::format(", {} to {} ({})", written.number(force_N - half_N), written.number(force_N + half_N),
                     by);
}

std::string plus_minus(double force_N, double half_N, const std::string& by) {
  return fmt::format(", +- {} ({})", plain(force_written(force_N).per_unit * half_N, 2), by);
}

std::string force_title(double force_N, double depth_mm, std::optional<double> half_N) {
  return fmt::format("{} at {}{}", force_in_words(force_N), length_in_words(depth_mm),
                     half_N ? from_to(force_N, *half_N, "discretisation") : "");
}

std::string scene_title(double largest_N, double depth_mm, const std::string& step, double last_N,
                        std::optional<double> half_N) {
  const Written written = force_written(largest_N);
  const std::string at =
      fmt::format("{} at {} (step '{}')", written(largest_N), length_in_words(depth_mm), step);
  const std::string within = half_N ? plus_minus(largest_N, *half_N, "discretisation") : "";
  if (last_N == largest_N) return at + ", the largest force and the last" + within;
  return fmt::format("largest force {}, {} at the end{}", at, last_N == 0.0 ? "0 N" : written(last_N),
                     within);
}

std::string nodes_in_words(Index nodes, const ModelReport& report) {
  const std::string near = length_in_words(report.patch_edge_spacing_mm);
  return report.patch_edge_spacing_mm < report.spacing_mm
             ? fmt::format("{} nodes: {} apart at the tool, {} far from it", nodes, near,
                           length_in_words(report.largest_spacing_mm))
             : fmt::format("{} nodes: {} apart", nodes, near);
}

std::string run_again(const std::vector<std::string>& words, const std::filesystem::path& folder) {
  namespace fs = std::filesystem;
  std::string line = fmt::format("cd {} && dimple", shell_word(fs::current_path().string()));
  for (const std::string& word : words) line += ' ' + shell_word(word);
  const fs::path options = fs::absolute(folder / "config.resolved.toml").lexically_normal();
  return line + fmt::format(" --config {} -o again", shell_word(options.string()));
}

double poisson_ratio(const Material& m) {
  return (3.0 * m.kappa - 2.0 * m.mu) / (2.0 * (3.0 * m.kappa + m.mu));
}

std::string in_words(const Finding& finding) {
  const Report& r = finding.report;
  return fmt::format("{} ({}); {}; try: {} [{}]", r.fact, r.where, r.why, r.remedy, r.code);
}

}  // namespace dimple
