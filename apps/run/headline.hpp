#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace dimple {

// The line with which a run ends, from its numbers or from those of its summary.json.

/// ", +- 1.2 (image resolution)": what the image's resolution adds to the title of a force. Empty for a model
/// without an image. `image_error`: as image_error_json() has it.
std::string of_image(double force_N, const nlohmann::ordered_json& image_error);

/// The title of a force, with the reason why it has no error bounds, and with what the image and the material
/// add to it. `spread`: of the force by its material, as a share of it.
std::string headline_of(const std::string& title, double force_N, const std::string& unknown,
                        const nlohmann::ordered_json& image_error, double spread);

/// "moved by 1.234 mm at (12.0, -30.0, 45.0) mm, +- 0.010 mm (discretisation)", from the displacement of a
/// summary.json.
std::string displacement_title(const nlohmann::ordered_json& displacement);

}  // namespace dimple
