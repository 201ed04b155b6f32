#include "tests/bench/calibration_scenes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "io/label_image.hpp"
#include "tests/helpers/draw.hpp"
#include "tests/helpers/random_bodies.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {

const PhantomOptions phantom_with_core = {.spacing_mm = 1.5, .two_labels = true};

namespace {

namespace fs = std::filesystem;

struct Organ {
  const char *name, *file;
  int label;
};
constexpr std::array<Organ, 4> organs_to_calibrate = {{{"liver", "abdomen_mr_3mm.nii.gz", 5},
                                                       {"spleen", "abdomen_mr_3mm.nii.gz", 6},
                                                       {"chest_right_lung", "chest_ct_10mm.seg.nrrd", 5},
                                                       {"chest_left_lung", "chest_ct_10mm.seg.nrrd", 6}}};
constexpr std::array<Organ, 3> organs_to_prove = {{{"heart", "heart_ct_1.5mm.nii.gz", 0},
                                                   {"human_brain", "human_brain_mri_2mm.nrrd", 0},
                                                   {"right_lung", "lung_ct_aniso.mha", 0}}};

// Brains of two people and a macaque, none of them among the held-out organs. The second has its tracts of
// white matter alone.
constexpr std::array folded = {"brodmann.nii.gz", "natbrainlab.nii.gz", "inia19-NeuroMaps.nii.gz"};

void set_organ(Draw& draw, CalibrationScene& scene, const Organ& organ, const fs::path& data) {
  scene.body = organ.name, scene.image = data / organ.file;
  scene.surface = [=] {
    return make_body_surface(read_label_image(data / organ.file),
                             organ.label > 0 ? std::vector<int>{organ.label} : std::vector<int>{});
  };
  scene.boundary.base = draw.of(std::array{"organ", "inferior", "posterior", "left", "right"});
}

CalibrationScene first_scene_of(int number, const fs::path& data, const fs::path& atlases) {
  Draw draw{std::mt19937_64(static_cast<std::uint64_t>(number))};
  CalibrationScene scene;
  scene.number = number;
  const double diameter = draw.between(6.0, 20.0);
  double thickness = 30.0, reach_x = 0.0,
         reach_y = 0.0;  // of the body, and largest offset of the patch from its middle
  const auto exactly = [](auto make) { return [make] { return SegmentedBody{make(), {}}; }; };
  constexpr int an_organ = 7;
  switch (number < first_folded ? number % 7 : an_organ) {
    case 0: {
      const Vec3 size(draw.between(3.0, 8.0) * diameter, draw.between(3.0, 8.0) * diameter,
                      draw.between(1.2, 4.0) * diameter);
      scene.body = fmt::format("block {:.0f}x{:.0f}x{:.0f}", size.x(), size.y(), size.z());
      scene.surface = exactly([size] {
        return block_surface({-size.x() / 2, -size.y() / 2, 0.0}, {size.x() / 2, size.y() / 2, size.z()});
      });
      thickness = size.z(), reach_x = 0.3 * size.x() - 0.2 * diameter,
      reach_y = 0.3 * size.y() - 0.2 * diameter;
      break;
    }
    case 1: {
      const Vec3 half(draw.between(2.0, 4.0) * diameter, draw.between(1.6, 3.0) * diameter,
                      draw.between(1.2, 2.0) * diameter);
      scene.body = fmt::format("ellipsoid {:.0f}x{:.0f}x{:.0f}", half.x(), half.y(), half.z());
      scene.surface = exactly([half] { return cut_ellipsoid_surface(half, -0.7 * half.z()); });
      thickness = 1.4 * half.z(), reach_x = 0.4 * half.x(), reach_y = 0.3 * half.y();
      break;
    }
    case 2: {
      const double radius = draw.between(1.5, 3.5) * diameter, height = draw.between(1.2, 4.0) * diameter;
      scene.body = fmt::format("cylinder {:.0f}x{:.0f}", radius, height);
      scene.surface = exactly([=] { return cylinder_surface(radius, height); });
      thickness = height, reach_x = reach_y = 0.4 * radius;
      break;
    }
    case 3: {
      const Vec3 size(5.0 * diameter, 5.0 * diameter, draw.between(2.0, 3.5) * diameter);
      const double wall = diameter * draw.between(0.6, 1.3), width = draw.between(0.5, 2.0),
                   deep = draw.between(0.4, 0.85) * size.z();
      scene.body = fmt::format("slit block {:.0f}x{:.0f}, wall at {:.1f}, {:.1f} wide, {:.0f} deep", size.x(),
                               size.z(), wall, width, deep);
      scene.surface = exactly([=] { return slit_block_surface(size, wall, width, deep); });
      thickness = size.z();
      break;
    }
    case 4:
      scene.body = "phantom with a core";
      scene.surface = [] { return make_body_surface(make_phantom(phantom_with_core), {}); };
      scene.core = true;
      reach_x = 6.0, reach_y = 15.0;
      break;
    case an_organ: {
      const char* file = draw.of(folded);
      scene.body = file, scene.image = atlases / file;
      scene.surface = [=] { return make_body_surface(read_label_image(atlases / file), {}); };
      scene.boundary.base = draw.of(std::array{"organ", "inferior", "posterior", "left", "right"});
      scene.boundary.indent_at = draw.of(std::array{"opposite", "opposite,left", "opposite,right"});
      break;
    }
    default: {
      set_organ(draw, scene, proves(number) ? draw.of(organs_to_prove) : draw.of(organs_to_calibrate), data);
    }
  }
  scene.boundary.indenter_diameter_mm = diameter;
  if (scene.image.empty()) {
    scene.boundary.base = "inferior";
    scene.boundary.indent_at =
        fmt::format("{:.2f},{:.2f},top", draw.between(-reach_x, reach_x), draw.between(-reach_y, reach_y));
  }
  scene.depth_mm = std::min(draw.between(0.3, 1.7) * 0.5 * diameter, 0.35 * thickness);
  scene.nu = draw.of(std::array{0.45, 0.49, 0.499});
  scene.law = draw.of(std::array{"neo-Hookean", "neo-Hookean", "Mooney-Rivlin", "Ogden"});
  return scene;
}

// Length between two bounds, evenly distributed over its logarithm.
double log_between(Draw& draw, double low, double high) {
  return low * std::pow(high / low, draw.between(0.0, 1.0));
}

// Places the bonded patch on the top of a body, at most so far from the middle of its outline.
void place_on_top(Draw& draw, CalibrationScene& scene, double reach_x, double reach_y) {
  scene.boundary.base = "inferior";
  scene.boundary.indent_at =
      fmt::format("{:.2f},{:.2f},top", draw.between(-reach_x, reach_x), draw.between(-reach_y, reach_y));
}

// Makes a solid with about this cube root of volume and about this height.
void set_solid(Draw& draw, CalibrationScene& scene, int kind, double size, double height) {
  const auto exactly = [](auto make) { return [make] { return SegmentedBody{make(), {}}; }; };
  const double area = size * size * size / height;
  if (kind == 0) {
    const double x = std::sqrt(area) * draw.between(0.75, 1.33), y = area / x;
    scene.body = fmt::format("block {:.1f}x{:.1f}x{:.1f}", x, y, height);
    scene.surface = exactly([=] { return block_surface({-x / 2, -y / 2, 0.0}, {x / 2, y / 2, height}); });
    place_on_top(draw, scene, 0.3 * x, 0.3 * y);
  } else if (kind == 1) {
    const double z = height / 1.7, x = std::sqrt(area / 2.2) * draw.between(0.8, 1.25), y = area / 2.2 / x;
    scene.body = fmt::format("ellipsoid {:.1f}x{:.1f}x{:.1f}", x, y, z);
    scene.surface = exactly([=] { return cut_ellipsoid_surface({x, y, z}, -0.7 * z); });
    place_on_top(draw, scene, 0.3 * x, 0.3 * y);
  } else {
    const double radius = std::sqrt(area / 3.14);
    scene.body = fmt::format("cylinder {:.1f}x{:.1f}", radius, height);
    scene.surface = exactly([=] { return cylinder_surface(radius, height); });
    place_on_top(draw, scene, 0.4 * radius, 0.4 * radius);
  }
}

// Makes a lump so many times larger than drawn and, in addition, so many times higher.
void set_lump(CalibrationScene& scene, double larger, double higher) {
  const RandomBody body = random_body(scene.number);
  const double diameter = scene.boundary.indenter_diameter_mm,
               scale = larger * diameter / body.boundary.indenter_diameter_mm;
  LabelImage image = body.image;
  const Vec3 spacing = scale * body.image.spacing().cwiseProduct(Vec3(1.0, 1.0, higher));
  image.to_world = Eigen::Affine3d(Eigen::Scaling(spacing));
  double x = 0.0, y = 0.0;
  std::sscanf(body.boundary.indent_at.c_str(), "%lf,%lf", &x, &y);
  scene.body = fmt::format("lump {} x {:.2f} x {:.2f}", body.name, scale, higher);
  scene.boundary.base = "inferior";
  scene.boundary.indent_at = fmt::format("{:.2f},{:.2f},top", scale * x, scale * y);
  scene.boundary.voxel_mm = spacing.maxCoeff();
  scene.surface = [image] { return make_body_surface(image, {}); };
}

// Scene of the two groups that extend the range: a solid, or an organ or a lump.
CalibrationScene extension_scene(int number, const fs::path& data) {
  Draw draw{std::mt19937_64(static_cast<std::uint64_t>(number))};
  CalibrationScene scene{.number = number, .body = {}, .surface = {}};
  const double diameter = draw.between(6.0, 20.0), radius = 0.5 * diameter;
  scene.boundary.indenter_diameter_mm = diameter;
  constexpr std::array<Organ, 3> first_organs = {
      {{"chest", "chest_ct_10mm.seg.nrrd", 0}, organs_to_calibrate[2], organs_to_calibrate[3]}};
  constexpr std::array<Organ, 2> other_organs = {{organs_to_prove[0], organs_to_prove[2]}};
  const bool other = (number - 1) / 4 % 2 == 1;  // blocks of four scenes in turn
  const bool largest = number >= first_largest && number < first_thin;
  const int kind = largest ? number % 3 : number % 4;
  double thickness = 0.0;
  if (number >= first_thin) {
    thickness = radius * log_between(draw, 0.8, 3.0);
    const double across = radius * log_between(draw, 8.0, 24.0);
    if (kind < 3)
      set_solid(draw, scene, kind, std::cbrt(across * across * thickness), thickness);
    else
      set_lump(scene, 2.0, thickness / (4.0 * diameter));
  } else {
    const double size = radius * (largest ? draw.between(210.0, 320.0) : log_between(draw, 20.0, 200.0));
    thickness = size * log_between(draw, largest ? 0.95 : 0.4, 1.25);
    if (kind < 3 && (largest || !(other && kind == 2))) {
      set_solid(draw, scene, kind, size, thickness);
    } else if (kind == 2) {
      set_lump(scene, size / (2.5 * diameter), 1.0);
    } else {
      set_organ(draw, scene, other ? draw.of(other_organs) : draw.of(first_organs), data);
      scene.boundary.indenter_diameter_mm = log_between(draw, 2.0, 12.0);
    }
  }
  scene.depth_mm =
      std::min(draw.between(0.3, 1.7) * 0.5 * scene.boundary.indenter_diameter_mm, 0.35 * thickness);
  scene.nu = draw.of(std::array{0.45, 0.49, 0.499});
  scene.law = draw.of(std::array{"neo-Hookean", "neo-Hookean", "Mooney-Rivlin", "Ogden"});
  return scene;
}

}  // namespace

Material material_of(const CalibrationScene& scene, double mu) {
  if (scene.law == "Mooney-Rivlin") return mooney_rivlin(0.35 * mu, 0.15 * mu, scene.nu, 1000.0);
  if (scene.law == "Ogden") return ogden({{.mu = mu, .alpha = -4.7}}, scene.nu, 1000.0);
  return neo_hookean(mu, scene.nu, 1000.0);
}

CalibrationScene scene_of(int number, const fs::path& data, const fs::path& atlases) {
  if (number >= first_large) return extension_scene(number, data);
  return first_scene_of(number, data, atlases);
}

std::string set_of(const CalibrationScene& scene) {
  if (scene.number >= first_large) return scene.number < first_thin ? "large" : "thin";
  if (proves(scene.number)) return "proof";
  // The tracts of white matter cannot be indented in practice: they are as thin as their own node spacing,
  // and 8000 nodes are not enough.
  return scene.body == folded[1] ? "aside" : "calibration";
}

}  // namespace dimple
