// Indented bodies, from a surface to a force, without an image.

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <numbers>

#include "apps/run/error_bounds.hpp"
#include "apps/scene/option.hpp"
#include "io/stop.hpp"
#include "io/table.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/shapes.hpp"
#include "tests/verification/verify_bodies.hpp"

namespace dimple {
namespace {

// Force [N] at even depths up to `depth_mm` of a bonded patch of 5 mm radius on the top of a body. The body
// is on a flat base; the patch is at x = y = 0.
class Indentation {
 public:
  Indentation(const BodySurface& body, Index nodes) {
    ModelOptions options;
    options.node_set.count = nodes;
    options.boundary = {.base = "inferior", .indent_at = "0,0,top", .indenter_diameter_mm = 10.0};
    model_ = build_model(body, options).model;
  }
  std::vector<double> forces(const Material& material, double depth_mm, int count, Contact contact) const {
    const ForceSystem system(model_, Tissues{{material}, model_.tissue}, Precision::single_);
    History history;
    solve(TimeMode::quasi_static, system, model_, {.depth = 1e-3 * depth_mm, .contact = contact},
          {.frames = count}, {}, history);
    if (history.interrupted) throw Stopped(stop_requested());
    std::vector<double> depths;
    for (int k = 1; k <= count; ++k) depths.push_back(1e-3 * depth_mm * k / count);
    return forces_between(history.force, depths);
  }

 private:
  Model model_;
};

// Force of a body by independent finite elements at 1, 2, ... 8 mm: a table of reference/, whose README
// states method and accuracy. Beyond one radius it is a guess: the sharp patch edge makes every force depend
// on the mesh, so no code converges.
struct KnownCurve {
  const char* file;
  std::array<double, 8> tolerance;  // relative tolerance of our force, set independently of it
  std::array<const char*, 8> source;
};

void add_curve(Rows& rows, const std::string& group, const std::string& what, const BodySurface& body,
               const KnownCurve& known, Index nodes) {
  const Table table = read_csv(std::string(DIMPLE_REFERENCE_DIR "/") + known.file);
  const std::vector<double> ours =
      Indentation(body, nodes).forces(neo_hookean(210.0, 0.499, 1000.0), 8.0, 8, Contact::bonded);
  for (std::size_t k = 0; k < 8; ++k)
    rows.push_back(compared(
        fmt::format("{}/{}_mm", group, k + 1), fmt::format("{}, force at {} mm", what, k + 1), ours[k],
        table.find("force_N")->at(k), known.tolerance[k], "N",
        fmt::format("{}; known to {:.2g} %", known.source[k], table.find("uncertainty_percent")->at(k))));
}

}  // namespace

// Lengths in radii and with H = h/a:
//
//   phi(s) - 2/pi int_0^1 phi(t) int_0^inf (1 - L(x H)) cos(x t) cos(x s) dx dt = 1,  kappa = int_0^1 phi ds
//   L(z) = (2 k sinh 2z - 4z) / (2 k cosh 2z + 1 + k^2 + 4 z^2),  k = 3 - 4 nu
//
// by the trapezium rule in x, whose integrand is even and falls as exp(-2 x H), and Gauss points in s.
PunchOnLayer::PunchOnLayer(double a_over_h, double nu) : H_(1.0 / a_over_h), k_(3.0 - 4.0 * nu) {
  constexpr int points = 24;
  // Gauss-Legendre on [0, 1]: eigenvalues of the polynomials' recurrence.
  Eigen::MatrixXd recurrence = Eigen::MatrixXd::Zero(points, points);
  for (int n = 1; n < points; ++n)
    recurrence(n, n - 1) = recurrence(n - 1, n) = n / std::sqrt(4.0 * n * n - 1.0);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> gauss(recurrence);
  t_ = 0.5 * (gauss.eigenvalues().array() + 1.0);
  w_ = gauss.eigenvectors().row(0).array().square();
  Eigen::MatrixXd A = Eigen::MatrixXd::Identity(points, points);
  over_x([&](double x, double dx) {
    const Eigen::VectorXd c = (x * t_.array()).cos();
    A -= 2.0 / std::numbers::pi * dx * c * c.cwiseProduct(w_).transpose();
  });
  phi_ = A.partialPivLu().solve(Eigen::VectorXd::Ones(points));
}

double PunchOnLayer::sinks(double r) const {
  double sum = (w_.array() * phi_.array() / (r * r - t_.array().square()).sqrt()).sum();
  over_x([&](double x, double dx) {
    sum -= dx * std::cyl_bessel_j(0, x * r) * (w_.array() * phi_.array() * (x * t_.array()).cos()).sum();
  });
  return 2.0 / std::numbers::pi * sum;
}

void PunchOnLayer::over_x(const std::function<void(double, double)>& add) const {
  constexpr int steps = 4000;
  const double step = 20.0 / H_ / steps;
  for (int j = 0; j <= steps; ++j) {
    const double x = step * j, z = x * H_, e = std::exp(-2.0 * z);  // L with e^(2z) taken out
    const double L =
        (k_ * (1.0 - e * e) - 4.0 * z * e) / (k_ * (1.0 + e * e) + (1.0 + k_ * k_ + 4.0 * z * z) * e);
    add(x, (1.0 - L) * (j == 0 ? 0.5 : 1.0) * step);
  }
}

void verify_scene_a(Rows& rows, Index nodes) {
  constexpr const char *fine = "P2/P1 tetrahedra, rim 0.3 mm, code not here",
                       *coarser = "P2/P1 tetrahedra, rim 0.6 mm, code not here";
  add_curve(rows, "scene_a", "block", block_surface({-30, -30, 0}, {30, 30, 30}),
            {"block.csv",
             {0.01, 0.01, 0.01, 0.01, 0.01, 0.02, 0.03, 0.04},
             {fine, fine, fine, fine, fine, fine, coarser, coarser}},
            nodes);
}

// The tetrahedral code has one mesh of this body, with edges of 1.2 mm around the patch. From 5 mm on it is
// stiffer, relative to the block, than any pair of matching meshes: see reference/README.md. Both count.
void verify_scene_b(Rows& rows, Index nodes) {
  KnownCurve known{"cut_ellipsoid.csv", {0.015, 0.015, 0.015, 0.015, 0.015, 0.02, 0.03, 0.04}, {}};
  known.source.fill("block's x ratio of both by hexahedra.cpp");
  add_curve(rows, "scene_b", "cut ellipsoid", cut_ellipsoid_surface({46.25, 31.25, 16.7647}, -11.7353), known,
            nodes);
}

// The finite elements' law has kappa = lambda = 2 mu nu / (1 - 2 nu), ours lambda + 2/3 mu. They differ only
// far from incompressibility, by a third at nu 0.3. Theirs is used.
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
                              "axisymmetric Q2/P1, rim 0.3 mm, code not here"));
    }
  }
}

// Linear elastic: the depth is a hundredth of the radius. The layer is infinite in theory; here it ends three
// heights from the patch, which is not corrected.
void verify_hayes(Rows& rows, Index nodes) {
  constexpr double mu = 210.0, radius = 5.0, depth = 0.01 * radius;
  for (const double ratio : {0.1754, 0.2, 0.4, 0.5, 1.0}) {
    const double height = radius / ratio;
    const Indentation layer(cylinder_surface(radius + 3.0 * height, height), nodes);
    for (const double nu : {0.3, 0.499}) {
      const double ours = layer.forces(neo_hookean(mu, nu, 1000.0), depth, 1, Contact::frictionless).front();
      const double unit = 4.0 * mu * 1e-3 * radius * 1e-3 * depth / (1.0 - nu);
      rows.push_back(compared(fmt::format("hayes/a_h_{}_nu_{}", ratio, nu),
                              fmt::format("layer, a/h {}, nu {}", ratio, nu), ours / unit,
                              hayes_factor(ratio, nu), 0.03, "", "Hayes et al. 1972, solved here"));
    }
  }
}

}  // namespace dimple
