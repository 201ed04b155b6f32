#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "apps/commands/all_commands.hpp"
#include "apps/commands/log.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/words.hpp"
#include "apps/studies/explain.hpp"

namespace dimple {

Outcome explain_run(const Scene& scene, const Invocation& shared, Outcome outcome) {
  const Stopwatch comparing;
  Explanation explanation =
      explain(scene, 0, [](const std::string& line) { to_log().line(RunObserver::Line::said, line); });
  const std::filesystem::path out = shared.out;
  const FileList list(out);
  const Json summary = Json::parse(outcome.summary_json);
  explanation.run =
      fmt::format("{} with {} nodes", force_title(summary.at("force_N"), summary.at("indentation_mm")),
                  summary.at("counts").at("nodes").get<Index>());
  write_explanation(out, explanation, std::filesystem::path(scene.image.file).filename().string());
  add_explained(outcome, out, comparing.seconds(), explanation.ended_by);
  return outcome;
}

}  // namespace dimple
