// Indented bodies: the whole way from a surface to a force, without an image.

#include <fmt/format.h>

#include <array>
#include <cmath>

#include "apps/config.hpp"
#include "apps/scenes.hpp"
#include "apps/verify_bodies.hpp"
#include "preprocess/shapes.hpp"

namespace dimple {
namespace {

// Force [N] at even depths up to `depth_mm` of a circle of 5 mm radius pressed onto the top of a body that
// stands on a flat base, at x = y = 0.
class Indentation {
 public:
  Indentation(const BodySurface& body, Index nodes) {
    ModelOptions options = model_options(Config{});
    options.cloud.count = nodes;
    options.boundary = {.base = "inferior", .indent_at = "0,0,top", .indenter_diameter_mm = 10.0};
    model_ = build_model(body, options).model;
    tissue_ = Eigen::VectorXi::Zero(model_.point_count());
    complete_model(model_, standard_support(), tissue_,
                   Eigen::VectorXd::Constant(model_.point_count(), 1000.0),
                   pieces_of(body.vertex() * 1e-3, body.triangles(), model_));
  }
  std::vector<double> forces(const Material& material, double depth_mm, int count, Contact contact) const {
    const ForceSystem system(model_, Tissues{{material}, tissue_}, Precision::single_);
    History history;
    load_slowly(system, model_, {.depth = 1e-3 * depth_mm, .contact = contact}, {.frames = count}, {},
                history);
    std::vector<double> result;
    for (const ForceSample& sample : history.force) result.push_back(sample.force);
    return {result.begin() + 1, result.end()};
  }

 private:
  Model model_;
  Eigen::VectorXi tissue_;
};

void add_curve(Rows& rows, const std::string& group, const std::string& what, const Scene& scene,
               Index nodes) {
  const std::vector<double> ours = Indentation(exact_surface(scene), nodes)
                                       .forces(neo_hookean(210.0, 0.499, 1000.0), 8.0, 8, Contact::bonded);
  for (std::size_t k = 0; k < 8; ++k)
    rows.push_back(compared(fmt::format("{}/{}_mm", group, k + 1),
                            fmt::format("{}, force at {} mm", what, k + 1), ours[k], scene.reference[k], 0.02,
                            "N", scene.source));
}

}  // namespace

void verify_scene_a(Rows& rows, Index nodes) {
  add_curve(rows, "scene_a", "block", scene_a(), nodes);
}

void verify_scene_b(Rows& rows, Index nodes) {
  add_curve(rows, "scene_b", "cut ellipsoid", scene_b(), nodes);
}

// The finite elements' law has kappa = lambda = 2 mu nu / (1 - 2 nu) where ours has lambda + 2/3 mu: a
// difference only far from incompressibility, at nu 0.3 of a third. Theirs is taken.
void verify_compressibility(Rows& rows, Index nodes) {
  const Indentation bonded(cylinder_surface(30.0, 30.0), nodes);
  struct Known {
    double nu;
    std::array<double, 3> force;  // at 1, 2 and 4 mm
  };
  for (const Known& known :
       {Known{0.3, {0.006606, 0.013435, 0.028094}}, Known{0.49, {0.009479, 0.018845, 0.037125}},
        Known{0.495, {0.009575, 0.019023, 0.037456}}, Known{0.499, {0.009653, 0.019166, 0.037711}},
        Known{0.4999, {0.009670, 0.019198, 0.037767}}}) {
    const double mu = 210.0, lambda = 2.0 * mu * known.nu / (1.0 - 2.0 * known.nu);
    const std::vector<double> ours = bonded.forces({.mu = mu, .kappa = lambda}, 4.0, 4, Contact::bonded);
    for (const std::size_t k : {0u, 1u, 2u}) {
      const int depth = 1 << k;
      rows.push_back(compared(fmt::format("compressibility/nu_{}_{}_mm", known.nu, depth),
                              fmt::format("cylinder, nu {}, {} mm", known.nu, depth),
                              ours[static_cast<std::size_t>(depth - 1)], known.force[k], 0.03, "N",
                              "axisymmetric Q2/P1, rim 0.3 mm"));
    }
  }
}

// F = 4 G a d / (1 - nu) kappa(a/h, nu), linear elastic, frictionless flat punch on a layer bonded to its
// base. kappa: Hayes, Keer, Herrmann, Mockros, J. Biomechanics 5 (1972) 541, its integral equation solved
// anew. The layer has no end there; here it ends three heights beside the circle, which is not corrected for.
void verify_hayes(Rows& rows, Index nodes) {
  constexpr double mu = 210.0, radius = 5.0, depth = 0.01 * radius;
  struct Known {
    double ratio, at_03, at_0499;
  };
  for (const Known& known :
       {Known{0.1754, 1.1778, 1.2393}, Known{0.2, 1.2066, 1.2800}, Known{0.4, 1.4726, 1.6817},
        Known{0.5, 1.6240, 1.9298}, Known{1.0, 2.4835, 3.6044}}) {
    const double height = radius / known.ratio;
    const Indentation layer(cylinder_surface(radius + 3.0 * height, height), nodes);
    for (const auto& [nu, kappa] : {std::pair{0.3, known.at_03}, {0.499, known.at_0499}}) {
      const double ours = layer.forces(neo_hookean(mu, nu, 1000.0), depth, 1, Contact::frictionless).front();
      const double unit = 4.0 * mu * 1e-3 * radius * 1e-3 * depth / (1.0 - nu);
      rows.push_back(compared(fmt::format("hayes/a_h_{}_nu_{}", known.ratio, nu),
                              fmt::format("layer, a/h {}, nu {}", known.ratio, nu), ours / unit, kappa, 0.03,
                              "", "Hayes et al. 1972, recomputed"));
    }
  }
}

}  // namespace dimple
