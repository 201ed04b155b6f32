#include "apps/run/words.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

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

double poisson_ratio(const Material& m) {
  return (3.0 * m.kappa - 2.0 * m.mu) / (2.0 * (3.0 * m.kappa + m.mu));
}

std::string in_words(const Finding& finding) {
  const Report& r = finding.report;
  return fmt::format("{} ({}); {}; try: {} [{}]", r.fact, r.where, r.why, r.remedy, r.code);
}

}  // namespace dimple
