#include "apps/run/headline.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "apps/run/words.hpp"
#include "io/digits.hpp"

namespace dimple {

using Json = nlohmann::ordered_json;

std::string of_image(double force_N, const Json& image_error) {
  return image_error.contains("half_N")
             ? plus_minus(force_N, image_error["half_N"].get<double>(), "image resolution")
             : "";
}

std::string headline_of(const std::string& title, double force_N, const std::string& unknown,
                        const Json& image_error, double spread) {
  std::string image = of_image(force_N, image_error);
  if (!unknown.empty() && !image.empty()) image.front() = ';';  // the reason may contain commas
  return title + (unknown.empty() ? "" : ", no error estimate: " + unknown) + image +
         (spread > 0.0
              ? from_to(force_N, spread * std::abs(force_N), fmt::format("mu +- {} %", plain(100.0 * spread)))
              : "");
}

std::string displacement_title(const Json& displacement) {
  const auto& place = displacement["place_mm"];
  std::string title =
      fmt::format("moved by {} mm at {}", three_digits(displacement["length_mm"].get<double>()),
                  in_words(Vec3(place[0], place[1], place[2])));
  if (displacement.contains("coarser_nodes"))
    title += fmt::format(", +- {} mm (discretisation)", plain(displacement["half_mm"].get<double>(), 2));
  return title;
}

}  // namespace dimple
