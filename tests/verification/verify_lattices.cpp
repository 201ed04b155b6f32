// Lattices with states known in closed form.

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>

#include "preprocess/supports/support.hpp"
#include "tests/verification/verify_bodies.hpp"

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;

constexpr double pi = std::numbers::pi;

Mat3 stretches(double x, double y, double z) {
  return Vec3(x, y, z).asDiagonal();
}

Mat3 simple_shear(double gamma) {
  Mat3 F = Mat3::Identity();
  F(0, 1) = gamma;
  return F;
}

// A body whose whole boundary is prescribed.
Statics held_at_all_sides(const Lattice& lattice, const std::vector<Material>& material) {
  LatticeBody body = make_lattice(lattice);
  auto held = boundary_fixed(body);
  return Statics(std::move(body), std::move(held), material);
}
Statics held_cube(const Material& material, int intervals = 6) {
  return held_at_all_sides(box_lattice(Vec3::Constant(0.02), intervals), {material});
}

// Displacements that grow linearly to u(X).
std::function<Points(double)> growing(const Statics& body, const std::function<Vec3(const Vec3&)>& u) {
  Points all = body.model().X;
  for (auto x : all.colwise()) x = u(x);
  return [all](double fraction) { return Points(fraction * all); };
}

// Mean stress of a cube whose whole boundary moves by F; the inside finds its equilibrium.
Mat3 stress_inside(const Statics& held, const Mat3& F) {
  const Equilibrium found = held.solve({.displacement = [&](double fraction) {
    return affine_displacement(held.model(), Mat3::Identity() + fraction * (F - Mat3::Identity()));
  }});
  return mean_stress(held.model(), found.f);
}

// Nominal stress of a bar, stretched along z between frictionless ends; its sides are free.
Statics free_bar(const Material& material, int intervals = 4) {
  // The bar is twice as wide as high: a cube between frictionless plates sways before it is half as high.
  LatticeBody body = make_lattice(box_lattice(Vec3(0.04, 0.04, 0.02), intervals));
  HeldSet ends =
      sliding_nodes(body, [&](Index a) { return body.on_face(a, 2, 0.0) || body.on_face(a, 2, 1.0); });
  return Statics(std::move(body), {std::move(ends)}, {material});
}

double stretched(const Statics& bar, double stretch) {
  const Equilibrium found = bar.solve(
      {.displacement =
           [&](double fraction) {
             return affine_displacement(bar.model(), stretches(1.0, 1.0, 1.0 + fraction * (stretch - 1.0)));
           }},
      5);
  return mean_stress(bar.model(), found.f)(2, 2);
}

// The law W = mu/2 (J^(-2/3) I1 - 3) + kappa/2 (J - 1)^2, written separately, so that no reference here comes
// from the code under test. P = mu J^(-2/3) (F - I1/3 F^-T) + kappa J (J - 1) F^-T.
Mat3 nominal_stress(const Material& m, const Mat3& F) {
  const double J = F.determinant();
  const Mat3 T = F.inverse().transpose();
  return m.mu * std::pow(J, -2.0 / 3.0) * (F - F.squaredNorm() / 3.0 * T) + m.kappa * J * (J - 1.0) * T;
}

}  // namespace

// Closed forms of the law above; free stretches follow from zero stress.
void verify_homogeneous(Rows& rows, Index) {
  const std::string source = "closed form, bisected";
  const Material tissue = neo_hookean(210.0, 0.499, 1000.0), stiffer = neo_hookean(1006.7114, 0.49, 1000.0);
  const Statics bar = free_bar(tissue), stiffer_bar = free_bar(stiffer);
  // Uniaxial: both transverse stretches are free; equibiaxial: the one across.
  const auto uniaxial = [](const Material& m, double l) {
    const double side = root(0.3, 3.0, [&](double t) { return nominal_stress(m, stretches(t, t, l))(0, 0); });
    return stretches(side, side, l);
  };
  const auto equibiaxial = [](const Material& m, double l) {
    return stretches(l, l,
                     root(0.3, 3.0, [&](double t) { return nominal_stress(m, stretches(l, l, t))(2, 2); }));
  };
  const auto free_sides = [&](const Statics& body, const Material& m, double stretch, const std::string& nu) {
    rows.push_back(compared(
        fmt::format("homogeneous/free_sides_{}{}", stretch, nu.empty() ? "" : "_nu_" + nu),
        fmt::format("bar, free sides, stretch {}{}", stretch, nu.empty() ? "" : ", nu " + nu),
        stretched(body, stretch), nominal_stress(m, uniaxial(m, stretch))(2, 2), 0.005, "Pa", source));
  };
  for (const double stretch : {0.5, 0.7, 0.8, 0.9, 1.1, 1.2, 1.5, 2.0}) free_sides(bar, tissue, stretch, "");
  for (const double stretch : {0.8, 1.2}) free_sides(stiffer_bar, stiffer, stretch, "0.49");

  const Statics held = held_cube(tissue);
  const auto add = [&](const std::string& name, const std::string& what, const Mat3& F, int i, int j) {
    rows.push_back(compared("homogeneous/" + name, what, stress_inside(held, F)(i, j),
                            nominal_stress(tissue, F)(i, j), 0.005, "Pa", source));
  };
  add("uniaxial_0.7", "cube, uniaxial 0.7", uniaxial(tissue, 0.7), 2, 2);
  add("uniaxial_1.5", "cube, uniaxial 1.5", uniaxial(tissue, 1.5), 2, 2);
  add("confined_0.99", "cube, confined 0.99", stretches(1.0, 1.0, 0.99), 2, 2);
  add("confined_0.95", "cube, confined 0.95", stretches(1.0, 1.0, 0.95), 2, 2);
  add("equibiaxial_1.2", "cube, equibiaxial 1.2", equibiaxial(tissue, 1.2), 0, 0);
  add("equibiaxial_0.8", "cube, equibiaxial 0.8", equibiaxial(tissue, 0.8), 0, 0);
  add("shear_0.5", "cube, simple shear 0.5", simple_shear(0.5), 0, 1);
}

// Cook's membrane: a tapered panel, held at the left, sheared upwards at the right by a dead load, between
// frictionless planes. Simo, Armero, Int. J. Numer. Meth. Engng 33 (1992) 1413; nearly incompressible.
void verify_cook(Rows& rows, Index) {
  constexpr double thickness = 4e-3, traction = 6.25;
  const Lattice lattice = {.place =
                               [](const Vec3& xi) {
                                 const double left = 44.0 * xi.y(), right = 44.0 + 16.0 * xi.y();
                                 return Vec3(48e-3 * xi.x(), 1e-3 * (left + (right - left) * xi.x()),
                                             thickness * xi.z());
                               },
                           .intervals = {24, 16, 2},
                           .cells = {42, 28, 4},
                           .tissue = {}};
  LatticeBody body = make_lattice(lattice);
  Index corner = 0;
  for (Index a = 0; a < body.places.node_count(); ++a)
    if (body.on_face(a, 0, 1.0) && body.on_face(a, 1, 1.0) && body.at(2, a) == 0.5) corner = a;
  HeldSet sides =
      sliding_nodes(body, [&](Index a) { return body.on_face(a, 2, 0.0) || body.on_face(a, 2, 1.0); });
  HeldSet clamped = fixed_nodes(body, [&](Index a) { return body.on_face(a, 0, 0.0); });
  const Statics panel(std::move(body), {std::move(sides), std::move(clamped)},
                      {{.mu = 80.1938, .kappa = 400943.0}});

  // The load on the edge is distributed over even points.
  constexpr int along = 160, across = 16;
  Points places(3, along * across);
  for (int j = 0; j < along; ++j)
    for (int k = 0; k < across; ++k)
      places.col(j * across + k) = lattice.place(Vec3(1.0, (j + 0.5) / along, (k + 0.5) / across));
  const Interpolation edge = make_interpolation(panel.model(), converging.support, places);
  const double fraction = traction * 16e-3 * thickness / (along * across);
  Points load = Points::Zero(3, panel.model().node_count());
  for (Index m = 0; m < edge.rows.member.size(); ++m)
    load(1, edge.rows.member[m]) += edge.weight[m] * fraction;

  const Equilibrium found =
      panel.solve({.displacement = [&](double) { return Points(0.0 * panel.model().X); },
                   .force = [&](double part) { return Points(part * load); }},
                  3, 1e-4);
  const Eigen::MatrixXd at = make_interpolation(panel.model(), converging.support,
                                                panel.model().X(Eigen::all, std::array{corner}))(found.u);
  const std::string source = "plane strain Q2/P1, 32 x 32, code not here";
  rows.push_back(
      compared("cook/tip", "Cook's membrane, tip's rise", 1e3 * at(1, 0), 6.927, 0.03, "mm", source));
}

// A rod twisted by tau per length, with plane ends at constant distance: M = pi/2 mu tau a^4, N = -pi/4 mu
// tau^2 a^4. Rivlin, Phil. Trans. R. Soc. A 242 (1949) 173; incompressible neo-Hookean.
void verify_torsion(Rows& rows, Index) {
  constexpr double radius = 15e-3, length = 40e-3, twist = 20.0, mu = 210.0;
  // The square is mapped to a disc without creases: x = u sqrt(1 - v^2/2), y = v sqrt(1 - u^2/2).
  const Lattice lattice = {.place =
                               [](const Vec3& xi) {
                                 const double u = 2.0 * xi.x() - 1.0, v = 2.0 * xi.y() - 1.0;
                                 return Vec3(radius * u * std::sqrt(1.0 - 0.5 * v * v),
                                             radius * v * std::sqrt(1.0 - 0.5 * u * u), length * xi.z());
                               },
                           .intervals = {10, 10, 14},
                           .cells = {18, 18, 25},
                           .tissue = {}};
  LatticeBody body = make_lattice(lattice);
  HeldSet ends =
      fixed_nodes(body, [&](Index a) { return body.on_face(a, 2, 0.0) || body.on_face(a, 2, 1.0); });
  const Statics rod(std::move(body), {std::move(ends)}, {neo_hookean(mu, 0.499, 1000.0)});
  const Equilibrium found =
      rod.solve({.displacement =
                     [&](double fraction) {
                       Points u = rod.model().X;
                       for (auto x : u.colwise())
                         x = Eigen::AngleAxisd(fraction * twist * x.z(), Vec3::UnitZ()) * x - x;
                       return u;
                     }},
                4);
  double moment = 0.0, force = 0.0;
  for (Index a = 0; a < rod.model().node_count(); ++a)
    if (rod.body().on_face(a, 2, 1.0)) {
      const Vec3 x = rod.model().X.col(a) + found.u.col(a).head<3>(), f = found.f.col(a).head<3>();
      moment += x.cross(f).z();
      force += f.z();
    }
  const double a4 = std::pow(radius, 4);
  const std::string source = "Rivlin 1949, incompressible";
  rows.push_back(compared("torsion/moment", "rod twisted 46 degrees, moment", 1e3 * moment,
                          1e3 * 0.5 * pi * mu * twist * a4, 0.02, "N mm", source));
  rows.push_back(compared("torsion/axial_force", "the same, axial force", force,
                          -0.25 * pi * mu * twist * twist * a4, 0.02, "N", source));
}

// Solution u = e sin(pi X) sin(pi Y) sin(pi Z) e_z in the unit cube for nu = 0.3. For nu = 0.499 it would
// need a load proportional to kappa, so u = e sin(pi X) sin(pi Y) e_z, which preserves volume. It is
// prescribed on the boundary; the body force is -Div P of the exact solution, by central differences of
// fourth order of the stress at the exact gradient.
void verify_manufactured(Rows& rows, Index) {
  constexpr double size = 0.1;
  for (const double nu : {0.3, 0.499}) {
    const bool isochoric = nu > 0.45;
    const auto gradient = [isochoric](const Vec3& x) {
      Mat3 F = Mat3::Identity();
      Vec3 s = (pi * x).array().sin(), c = (pi * x).array().cos();
      if (isochoric) {
        s.z() = 1.0;
        c.z() = 0.0;
      }
      F.row(2) +=
          size * pi * Eigen::RowVector3d(c.x() * s.y() * s.z(), s.x() * c.y() * s.z(), s.x() * s.y() * c.z());
      return F;
    };
    const auto solution = [isochoric](const Vec3& x) -> Vec3 {
      const double up = isochoric ? 1.0 : std::sin(pi * x.z());
      return size * std::sin(pi * x.x()) * std::sin(pi * x.y()) * up * Vec3::UnitZ();
    };
    const Material tissue = neo_hookean(210.0, nu, 1000.0);
    const auto body_force = [&](const Vec3& x) {
      constexpr double h = 1e-3;
      Vec3 sum = Vec3::Zero();
      for (int d = 0; d < 3; ++d) {
        const auto P = [&](double step) {
          return nominal_stress(tissue, gradient(x + step * Vec3::Unit(d))).col(d).eval();
        };
        sum -= (8.0 * (P(h) - P(-h)) - (P(2.0 * h) - P(-2.0 * h))) / (12.0 * h);
      }
      return sum;
    };
    std::vector<double> log_h, log_value, log_slope;
    for (const int n : {10, 14, 20, 28}) {
      const Statics statics = held_at_all_sides(box_lattice(Vec3::Ones(), n), {tissue});
      const Model& model = statics.model();
      const Index points = model.point_count();
      // The eight places in each cell over which gradients are averaged.
      Points places(3, 8 * points);
      for (Index q = 0; q < points; ++q)
        for (int k = 0; k < 8; ++k) {
          const Vec3 sign(k & 1 ? 1.0 : -1.0, k & 2 ? 1.0 : -1.0, k & 4 ? 1.0 : -1.0);
          places.col(8 * q + k) =
              model.point.col(q) + sign.cwiseProduct(model.second_moments.col(q).head<3>().cwiseSqrt());
        }
      const Interpolation to_places = make_interpolation(model, converging.support, places);
      Points load = Points::Zero(3, model.node_count());
      for (Index m = 0; m < places.cols(); ++m) {
        const Vec3 force = model.volume[m / 8] / 8.0 * body_force(places.col(m));
        for (int k = to_places.rows.offset[m]; k < to_places.rows.offset[m + 1]; ++k)
          load.col(to_places.rows.member[k]) += to_places.weight[k] * force;
      }
      const Equilibrium found =
          statics.solve({.displacement = growing(statics, solution),
                         .force = [&](double fraction) { return Points(fraction * load); }},
                        1, 1e-6);
      const Points u = to_places(found.u).topRows<3>();
      double value = 0.0, slope = 0.0;
      for (Index m = 0; m < places.cols(); ++m)
        value += model.volume[m / 8] / 8.0 * (u.col(m) - solution(places.col(m))).squaredNorm();
      // Gradients of the field itself, not their means, are compared at each cell's point.
      const double step = 1e-3 / n;
      Points around(3, 6 * points);
      for (Index q = 0; q < points; ++q)
        for (int d = 0; d < 3; ++d) {
          around.col(6 * q + 2 * d) = model.point.col(q) + step * Vec3::Unit(d);
          around.col(6 * q + 2 * d + 1) = model.point.col(q) - step * Vec3::Unit(d);
        }
      const Points v = make_interpolation(model, converging.support, around)(found.u).topRows<3>();
      for (Index q = 0; q < points; ++q) {
        Mat3 F = Mat3::Identity();
        for (int d = 0; d < 3; ++d)
          F.col(d) += (v.col(6 * q + 2 * d) - v.col(6 * q + 2 * d + 1)) / (2.0 * step);
        slope += model.volume[q] * (F - gradient(model.point.col(q))).squaredNorm();
      }
      log_h.push_back(-std::log(n));
      log_value.push_back(0.5 * std::log(value));
      log_slope.push_back(0.5 * std::log(slope));
    }
    const auto order = [&](const std::vector<double>& y) {
      const Eigen::Map<const Eigen::ArrayXd> h(log_h.data(), 4), e(y.data(), 4);
      return ((h - h.mean()) * (e - e.mean())).sum() / (h - h.mean()).square().sum();
    };
    const std::string source = "manufactured solution, theory";
    rows.push_back(order_reached(fmt::format("manufactured/displacement_nu_{}", nu),
                                 fmt::format("order of the displacement's error, nu {}", nu),
                                 order(log_value), 2.0, 0.1, source));
    rows.push_back(order_reached(fmt::format("manufactured/gradient_nu_{}", nu),
                                 fmt::format("order of the gradient's error, nu {}", nu), order(log_slope),
                                 1.0, 0.1, source));
  }
}

// Incompressible closed forms of W = sum 2 mu / alpha^2 (l1^alpha + l2^alpha + l3^alpha - 3):
//
//   uniaxial      P = sum 2 mu / alpha (l^(alpha - 1) - l^(-alpha/2 - 1))
//   simple shear  tau = sum 2 mu / alpha (l^alpha - l^-alpha) / (l + 1/l)
//                 l = gamma/2 + sqrt(1 + gamma^2/4)
//
// Ogden, Proc. R. Soc. A 326 (1972) 565; its three terms for rubber are the last material's.
void verify_ogden(Rows& rows, Index) {
  struct Rubber {
    const char* name;
    std::vector<OgdenTerm> terms;
  };
  for (const Rubber& law :
       {Rubber{"one_term", {{842.0, -4.7}}}, Rubber{"two_terms", {{300.0, 4.0}, {500.0, -6.0}}},
        Rubber{"three_terms", {{4.095e5, 1.3}, {3.0e3, 5.0}, {1.0e4, -2.0}}}}) {
    const Material tissue = ogden(law.terms, 0.4999, 1000.0);
    const Statics bar = free_bar(tissue), held = held_cube(tissue, 5);
    for (const double stretch : {0.75, 1.4}) {
      double P = 0.0;
      for (const auto& [mu, alpha] : law.terms)
        P += 2.0 * mu / alpha * (std::pow(stretch, alpha - 1.0) - std::pow(stretch, -0.5 * alpha - 1.0));
      rows.push_back(compared(fmt::format("ogden/{}_uniaxial_{}", law.name, stretch),
                              fmt::format("Ogden, {}, free sides, stretch {}", law.name, stretch),
                              stretched(bar, stretch), P, 0.005, "Pa", "Ogden 1972, incompressible"));
    }
    constexpr double gamma = 0.5;
    const double l = 0.5 * gamma + std::sqrt(1.0 + 0.25 * gamma * gamma);
    double tau = 0.0;
    for (const auto& [mu, alpha] : law.terms)
      tau += 2.0 * mu / alpha * (std::pow(l, alpha) - std::pow(l, -alpha)) / (l + 1.0 / l);
    rows.push_back(compared(fmt::format("ogden/{}_shear_{}", law.name, gamma),
                            fmt::format("Ogden, {}, simple shear {}", law.name, gamma),
                            stress_inside(held, simple_shear(gamma))(0, 1), tau, 0.005, "Pa",
                            "Ogden 1972, incompressible"));
  }
}

// Sudden simple shear, then held: tau(t) = mu gamma (g_inf + sum g_i exp(-t/tau_i)).
void verify_viscoelastic(Rows& rows, Index) {
  Material tissue = neo_hookean(842.0, 0.499, 1000.0);
  tissue.prony = {{.g = 0.450, .tau = 0.5}, {.g = 0.365, .tau = 50.0}};
  constexpr double gamma = 0.3;
  const Statics held = held_cube(tissue, 5);
  const ForceSystem& system = held.system();
  System body(system, held.model(), held.constraints());
  const Relaxation relax(body);
  Nodal u = to_nodal(affine_displacement(held.model(), simple_shear(gamma))), f = u;
  for (Index a = 0; a < u.cols(); ++a)
    if (held.constraints().is_free(a)) u.col(a) *= 0.9;
  double t = 0.0;
  for (const double next : {0.0, 0.1, 0.5, 2.0, 20.0, 200.0}) {
    // The steps do not divide the relaxation times evenly: the history's recursion is exact for a held
    // strain.
    for (int step = 0; step < 3; ++step) {
      body.begin_step((next - t) / 3.0);
      relax(u, f, {.tolerance = 1e-5});
      body.accept_step(u);
    }
    t = next;
    double g = 1.0;
    for (const PronyTerm& term : tissue.prony) g += term.g * std::expm1(-t / term.tau);
    rows.push_back(compared(fmt::format("viscoelastic/{}_s", t), fmt::format("shear stress after {} s", t),
                            mean_stress(held.model(), f)(0, 1), tissue.mu * gamma * g, 0.01, "Pa",
                            "closed form"));
  }
}

namespace {

// Two layers across z, the lower `below` of the height; the interface is on faces of cells and on nodes.
// Returns the stress on the upper face when the boundary moves along an axis by slopes of its displacement
// over z.
Vec3 stress_of_layers(double height, double below, const Material& soft, const Material& stiff, int axis,
                      double lower_slope, double upper_slope) {
  Lattice lattice = box_lattice(Vec3(height, height, height), 12, 0.0);
  lattice.cells = {21, 21, 22};
  lattice.tissue = [=](const Vec3& x) { return x.z() < below * height ? 0 : 1; };
  const Statics layers = held_at_all_sides(lattice, {soft, stiff});
  const Equilibrium found = layers.solve({.displacement = growing(layers, [=](const Vec3& x) -> Vec3 {
                                            return (std::min(x.z(), below * height) * lower_slope +
                                                    std::max(0.0, x.z() - below * height) * upper_slope) *
                                                   Vec3::Unit(axis);
                                          })});
  return face_force(layers.body(), found.f, 2, 1.0) / (height * height);
}

}  // namespace

// Two layers in shear, tau = u / (h1/mu1 + h2/mu2), and compressed within rigid frictionless walls. There
// stress P(l1) = P(l2) is the same in both and h1 l1 + h2 l2 = h. The walls move as in the solution; the
// inside has to find it.
void verify_layers(Rows& rows, Index) {
  constexpr double height = 0.02, below = 0.5;
  for (const double ratio : {2.0, 5.0, 20.0}) {
    const Material soft = neo_hookean(210.0, 0.499, 1000.0),
                   stiff = neo_hookean(210.0 * ratio, 0.499, 1000.0);
    const double tau = 0.2 / (below / soft.mu + (1.0 - below) / stiff.mu);
    const Vec3 ours = stress_of_layers(height, below, soft, stiff, 0, tau / soft.mu, tau / stiff.mu);
    rows.push_back(compared(fmt::format("layers/shear_{}", ratio),
                            fmt::format("two layers sheared, moduli 1 : {}", ratio), ours.x(), tau, 0.02,
                            "Pa", "closed form, in series"));
  }
  for (const double ratio : {2.0, 5.0}) {
    const Material soft = neo_hookean(210.0, 0.3, 1000.0), stiff = neo_hookean(210.0 * ratio, 0.3, 1000.0);
    constexpr double total = 0.9;
    const auto stress = [](const Material& m, double l) {
      return nominal_stress(m, stretches(1.0, 1.0, l))(2, 2);
    };
    // The soft layer's stretch is between that of a homogeneous body and that next to a rigid layer.
    const auto other = [=](double l) { return (total - below * l) / (1.0 - below); };
    const double l1 = root(1.0 - (1.0 - total) / below, total,
                           [&](double l) { return stress(soft, l) - stress(stiff, other(l)); }),
                 l2 = other(l1);
    const Vec3 ours = stress_of_layers(height, below, soft, stiff, 2, l1 - 1.0, l2 - 1.0);
    rows.push_back(compared(fmt::format("layers/confined_{}", ratio),
                            fmt::format("two layers pressed by 10 %, moduli 1 : {}", ratio), ours.z(),
                            stress(soft, l1), 0.02, "Pa", "closed form, in series"));
  }
}

// A sphere of modulus m mu, perfectly bonded in an infinite solid with far strain e. The inner strain is
// uniform, e_in = e / (1 + beta (m - 1)), beta = 2 (4 - 5 nu) / (15 (1 - nu)), for a deviatoric e. Outside,
// with e* = (1 - m) e_in,
//
//   u = e x + a^3 / (6 (1 - nu)) { (2 - 4 nu) e*x / r^3 + 3 (x e*x) x / r^5
//                                  + a^2/5 [6 e*x / r^5 - 15 (x e*x) x / r^7] }
//
// The boundary of the cube follows u, so its finite size causes no error.
// Source: Eshelby, Proc. R. Soc. A 241 (1957) 376 and 252 (1959) 561.
void verify_inclusion(Rows& rows, Index) {
  constexpr double a = 5e-3, edge = 2.5 * a, size = 1e-3, m = 4.0, mu = 210.0;
  for (const double nu : {0.3, 0.499}) {
    Lattice lattice = box_lattice(Vec3::Constant(edge), 25);
    const Vec3 middle = Vec3::Constant(0.5 * edge);
    lattice.tissue = [=](const Vec3& x) { return (x - middle).norm() < a ? 1 : 0; };
    const Statics solid =
        held_at_all_sides(lattice, {neo_hookean(mu, nu, 1000.0), neo_hookean(m * mu, nu, 1000.0)});
    Mat3 e = stretches(-0.5, -0.5, 1.0) * size;
    e(0, 1) = e(1, 0) = 0.3 * size;
    const double beta = 2.0 * (4.0 - 5.0 * nu) / (15.0 * (1.0 - nu)), inside = 1.0 / (1.0 + beta * (m - 1.0));
    const Mat3 eigen = (1.0 - m) * inside * e;
    const auto far = [&](const Vec3& X) -> Vec3 {
      const Vec3 x = X - middle, ex = eigen * x;
      const double r = x.norm(), xex = x.dot(ex);
      if (r < a) return inside * (e * x);
      const double r3 = std::pow(r, 3), r5 = std::pow(r, 5), r7 = std::pow(r, 7);
      return e * x + a * a * a / (6.0 * (1.0 - nu)) *
                         ((2.0 - 4.0 * nu) / r3 * ex + 3.0 * xex / r5 * x +
                          0.2 * a * a * (6.0 / r5 * ex - 15.0 * xex / r7 * x));
    };
    const Equilibrium found = solid.solve({.displacement = growing(solid, far)}, 2);
    ForceState forces(solid.system());
    forces.stress_sweep(found.u);
    const auto F = forces.deformation_gradients();
    Mat3 mean = Mat3::Zero();
    double volume = 0.0;
    for (Index q = 0; q < F.cols(); ++q)
      if (solid.model().tissue[q] == 1) {
        mean += solid.model().volume[q] * (Eigen::Map<const Mat3>(F.col(q).data()) - Mat3::Identity());
        volume += solid.model().volume[q];
      }
    rows.push_back(compared(fmt::format("inclusion/nu_{}", nu),
                            fmt::format("strain in a sphere 4 x as stiff, nu {}", nu),
                            mean(2, 2) / volume / size, inside, 0.05, "of far strain", "Eshelby 1957"));
  }
}

}  // namespace dimple
