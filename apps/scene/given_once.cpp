#include "apps/scene/given_once.hpp"

#include <fmt/format.h>

#include "apps/scene/config.hpp"
#include "io/error.hpp"

namespace dimple {

void GivenOnce::add(const std::string& key, const std::string& text, const std::string& source) {
  const std::string option = full_key(key, source);
  const auto [before, is_first] = of_option_.try_emplace(option, Given{key, text, source});
  const Given& first = before->second;
  if (is_first || first.text == text) return;
  throw UsageError({.fact = fmt::format("{} is given twice: {} = {}, and {} = {}", option, first.key,
                                        first.text, key, text),
                    .where = first.source == source ? source : fmt::format("{}; {}", first.source, source),
                    .why = "an option has one value",
                    .remedy = "leave one of them out"});
}

}  // namespace dimple
