#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace dimple {

// Last line of a run, from its numbers or from those of its summary.json.

/// ", +- 1.2 (image resolution)": error by the image's resolution, for the title of a force. Empty for a
/// model without an image. `image_error`: from image_error_json().
std::string of_image(double force_N, const nlohmann::ordered_json& image_error);

/// Title of a force, with the reason why it has no error bounds, and with the errors by the image and the
/// material. `spread`: of the force by its material, as a part of it.
std::string headline_of(const std::string& title, double force_N, const std::string& unknown,
                        const nlohmann::ordered_json& image_error, double spread);

/// "moved by 1.234 mm at (12.0, -30.0, 45.0) mm, +- 0.010 mm (discretisation)", from the displacement of a
/// summary.json.
std::string displacement_title(const nlohmann::ordered_json& displacement);

}  // namespace dimple
