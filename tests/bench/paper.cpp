// What Horton, Wittek and Miller (MICCAI 2007) compare with, measured on our own phantom of their brain.
//
//   dimple_paper curve FOLDER        force curves beside the numbers that the paper prints: paper_curve.csv,
//                                    .svg, .png
//   dimple_paper tetrahedra FOLDER   linear tetrahedra on the nodes of the model, as section 3.1 has it: how
//   many,
//                                    what an evaluation of their force costs, and how far off it is:
//                                    tetrahedra.csv
//
// Times are the processor's own, of one thread, the least of many evaluations.

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>
#include <fmt/format.h>
#include <tbb/global_control.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <functional>

#include "apps/run/simulate.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "preprocess/clones.hpp"
#include "preprocess/image/phantom.hpp"
#include "solver/solve.hpp"
#include "tests/bench/picture.hpp"
#include "tests/bench/scene.hpp"
#include "tests/helpers/system.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;
using Nodal = ForceSystem::Nodal;

// Section 5: at 8 mm, and no other number; Fig. 5 is a picture.
constexpr double paper_depth_mm = 8.0, paper_computed_N = 0.131, paper_left_N = 0.181, paper_right_N = 0.125;

void curve(const fs::path& folder) {
  make_folder(folder);
  const fs::path image = folder / "brain.nrrd";
  write_label_image(image, make_phantom({}));
  std::string csv = "source,indentation_mm,force_N\n";
  Plot chart{
      .title = "Reaction force on the indenter: the paper's swine brain and our phantom of its size",
      .subtitle = {"mu = 210 Pa, nu = 0.499, circle of 10 mm, 1 mm/s, 4250 nodes; of the paper only the "
                   "numbers printed in its section 5 are shown, not its Fig. 5"},
      .x_label = "indentation [mm]",
      .y_label = "force [N]"};
  for (const char* scheme : {"converging", "horton2007"}) {
    Config config;
    config.image.file = image.string();
    config.scheme.name = scheme;
    config.cloud.nodes = 4250;
    const Result m = simulate({.config = config});
    PlotSeries series{.name = fmt::format("Dimple, {}, {} points", scheme, m.model.point_count()),
                      .markers = false};
    double next = 0.0;
    for (const ForceSample& sample : m.history.force) {
      if (1e3 * sample.depth < next - 1e-9 && &sample != &m.history.force.back()) continue;
      next += 0.25;
      series.x.push_back(1e3 * sample.depth);
      series.y.push_back(sample.force);
      csv += fmt::format("{},{:.6g},{:.6g}\n", scheme, 1e3 * sample.depth, sample.force);
    }
    chart.series.push_back(series);
    fmt::print("{}: {:.4f} N at {:.3g} mm, {} points\n", scheme, series.y.back(), series.x.back(),
               m.model.point_count());
  }
  for (const auto& [name, words, force] :
       {std::tuple{"paper_experiment_left", "the paper's experiment, left hemisphere", paper_left_N},
        {"paper_simulation", "the paper's simulation", paper_computed_N},
        {"paper_experiment_right", "the paper's experiment, right hemisphere", paper_right_N}}) {
    chart.series.push_back({.name = words, .x = {paper_depth_mm}, .y = {force}, .line = false});
    csv += fmt::format("{},{:.6g},{:.6g}\n", name, paper_depth_mm, force);
  }
  fs::remove(image);
  write_file(folder / "paper_curve.csv", csv);
  write_plots(folder, "paper_curve", {chart});
}

// ---------------------------------------------------------------- tetrahedra

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Vertex = CGAL::Triangulation_vertex_base_with_info_3<int, Kernel>;
using Delaunay = CGAL::Delaunay_triangulation_3<Kernel, CGAL::Triangulation_data_structure_3<Vertex>>;

// Volume / longest edge^3 below which a tetrahedron is a sliver that no mesher would keep: a hundredth of an
// equilateral one's.
constexpr double sliver = 0.01 * 0.1178511;

struct Tetrahedra {
  std::vector<std::array<int, 4>> corner;  // ascending
  std::size_t all = 0, inside = 0;         // of Delaunay's; with their middle inside the surface
  double volume = 0.0;                     // [m^3] of those that are kept
};

// Delaunay's tetrahedra of the model's nodes whose middle lies inside the surface, without slivers.
Tetrahedra tetrahedra_of(const Model& model, const BodySurface& body) {
  std::vector<std::pair<Kernel::Point_3, int>> nodes;
  for (Index a = 0; a < model.node_count(); ++a)
    nodes.emplace_back(Kernel::Point_3(model.X(0, a), model.X(1, a), model.X(2, a)), static_cast<int>(a));
  const Delaunay mesh(nodes.begin(), nodes.end());
  const Eigen::Isometry3d to_body = body.to_world().inverse();
  Tetrahedra result;
  for (auto cell = mesh.finite_cells_begin(); cell != mesh.finite_cells_end(); ++cell) {
    ++result.all;
    std::array<int, 4> corner;
    for (int k = 0; k < 4; ++k) corner[static_cast<std::size_t>(k)] = cell->vertex(k)->info();
    std::sort(corner.begin(), corner.end());
    Vec3 middle = Vec3::Zero();
    double longest = 0.0;
    for (const int a : corner) {
      middle += 0.25 * model.X.col(a);
      for (const int b : corner) longest = std::max(longest, (model.X.col(a) - model.X.col(b)).norm());
    }
    if (!body.contains(to_body * (1e3 * middle))) continue;
    ++result.inside;
    Mat3 edges;
    for (int k = 0; k < 3; ++k)
      edges.col(k) = model.X.col(corner[static_cast<std::size_t>(k + 1)]) - model.X.col(corner[0]);
    const double volume = std::abs(edges.determinant()) / 6.0;
    if (volume < sliver * std::pow(longest, 3)) continue;
    result.volume += volume;
    result.corner.push_back(corner);
  }
  std::sort(result.corner.begin(), result.corner.end());
  return result;
}

// The same nodes, base and circle, with a point of constant gradients for each tetrahedron: for the product's
// solvers this is a linear tetrahedral mesh.
Model as_tetrahedra(const Model& nodes, const Tetrahedra& mesh) {
  Model model = nodes;
  model.scheme = horton2007;
  const auto count = static_cast<Index>(mesh.corner.size());
  model.point.resize(3, count);
  model.volume.resize(count);
  model.second_moments.resize(6, 0);
  model.label = Eigen::VectorXi::Zero(count);
  model.support.offset = Eigen::VectorXi::LinSpaced(count + 1, 0, static_cast<int>(4 * count));
  model.support.member.resize(4 * count);
  model.dphi.resize(3, 4 * count);
  model.patches = {};
  model.variance.clear();
  model.mass = Eigen::VectorXd::Zero(model.node_count());
  for (Index e = 0; e < count; ++e) {
    const auto& corner = mesh.corner[static_cast<std::size_t>(e)];
    Mat3 edges;
    for (int k = 0; k < 3; ++k)
      edges.col(k) = model.X.col(corner[static_cast<std::size_t>(k + 1)]) - model.X.col(corner[0]);
    const Mat3 inverse = edges.inverse();
    model.volume[e] = std::abs(edges.determinant()) / 6.0;
    model.point.col(e).setZero();
    for (int k = 0; k < 4; ++k) {
      const int a = corner[static_cast<std::size_t>(k)];
      model.point.col(e) += 0.25 * model.X.col(a);
      model.support.member[4 * e + k] = a;
      model.dphi.col(4 * e + k) = k == 0 ? Vec3(-inverse.colwise().sum()) : Vec3(inverse.row(k - 1));
      model.mass[a] += 0.25 * 1000.0 * model.volume[e];
    }
  }
  model.mass = model.mass.cwiseMax(1e-3 * model.mass.maxCoeff());  // nodes that only slivers had
  return model;
}

// As one would write it first: a loop over tetrahedra, their forces added to the nodes.
struct PlainTetrahedra {
  std::vector<std::int32_t> corner;      // [4 x tetrahedra]
  std::vector<double> gradient, volume;  // [12 x tetrahedra] 1/m, [m^3]
  std::vector<double> u, f;              // [3 x nodes] m, N
  double mu = 210.0, kappa = 104930.0;
};

DIMPLE_CLONES void evaluate(PlainTetrahedra& t) {
  std::fill(t.f.begin(), t.f.end(), 0.0);
  for (std::size_t e = 0; e < t.volume.size(); ++e) {
    const std::int32_t* node = &t.corner[4 * e];
    const double* d = &t.gradient[12 * e];
    double F[3][3] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};
    for (int k = 0; k < 4; ++k)
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) F[i][j] += t.u[static_cast<std::size_t>(3 * node[k] + i)] * d[3 * k + j];
    double cof[3][3], square = 0.0;
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
        cof[i][j] = F[i1][j1] * F[i2][j2] - F[i1][j2] * F[i2][j1];
        square += F[i][j] * F[i][j];
      }
    const double J = F[0][0] * cof[0][0] + F[0][1] * cof[0][1] + F[0][2] * cof[0][2], root = std::cbrt(J);
    const double shear = t.volume[e] * t.mu / (root * root),
                 pressure = t.volume[e] * t.kappa * (J - 1.0) - shear * square / (3.0 * J);
    for (int k = 0; k < 4; ++k)
      for (int i = 0; i < 3; ++i) {
        double sum = 0.0;
        for (int j = 0; j < 3; ++j) sum += (shear * F[i][j] + pressure * cof[i][j]) * d[3 * k + j];
        t.f[static_cast<std::size_t>(3 * node[k] + i)] += sum;
      }
  }
}

PlainTetrahedra plain(const Model& model, const Nodal& u) {
  PlainTetrahedra t;
  t.corner.assign(model.support.member.begin(), model.support.member.end());
  for (Index k = 0; k < model.dphi.cols(); ++k)
    for (int i = 0; i < 3; ++i) t.gradient.push_back(model.dphi(i, k));
  t.volume.assign(model.volume.begin(), model.volume.end());
  for (Index a = 0; a < u.cols(); ++a)
    for (int i = 0; i < 3; ++i) t.u.push_back(u(i, a));
  t.f.resize(t.u.size());
  return t;
}

// Processor time of one call [s], the least of many: what other programs do meanwhile does not count.
double cost(const std::function<void()>& call) {
  const auto now = [] {
    timespec t{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
  };
  double least = 1e300;
  for (int k = 0; k < 300; ++k) {
    const double start = now();
    call();
    least = std::min(least, now() - start);
  }
  return least;
}

// A dent of 1 mm under the tool that fades with the distance.
Nodal dent_of(const Model& model) {
  Nodal u = Nodal::Zero(4, model.node_count());
  for (Index a = 0; a < u.cols(); ++a)
    u.col(a).head<3>() = 1e-3 *
                         std::exp(-(model.X.col(a) - model.tool.centre).norm() / (2.0 * model.tool.radius)) *
                         model.tool.push;
  return u;
}

// Small enough for every tetrahedron to stay upright on the way to equilibrium.
constexpr double force_depth_mm = 0.1;

// [N] in equilibrium.
double force(const Model& model, const Material& material) {
  const ForceSystem system(model, material);
  ForceState forces(system);
  History history;
  solve(TimeMode::quasi_static, system, model, {.depth = 1e-3 * force_depth_mm},
        {.frames = 1, .tolerance = 1e-3, .evaluations = 30000, .guards = false}, {}, history);
  return history.force.back().force;
}

void tetrahedra(const fs::path& folder) {
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Material material = neo_hookean(210.0, 0.499, 1000.0);
  make_folder(folder);
  std::string csv = fmt::format(
      "# one thread, the least of 300 evaluations; force at {} mm in equilibrium\n"
      "body,method,nodes,cells_or_points,node_pairs,evaluation_us,stable_step_us,"
      "seconds_for_8_s_of_central_differences,force_N\n",
      force_depth_mm);
  for (const bool brain : {true, false}) {
    const std::string name = brain ? "phantom brain" : "block 60 x 60 x 30 mm";
    const LabelImage image = brain ? make_phantom({}) : scene_image();
    const auto add = [&](const std::string& method, const Model& model, ForceState& forces, double newtons,
                         const std::function<void()>& call) {
      const double seconds = cost(call);
      const StableStep step = testing_bodies::stable_step(forces.system(), model, model.mass,
                                                          make_constraints(model, Contact::bonded),
                                                          Nodal::Zero(4, model.node_count()));
      const double whole = 8.0 / (0.9 * step.dt) * seconds;
      fmt::print(
          "  {:<32} {:>6} cells {:>7} pairs {:>7.1f} us, step {:>6.2f} us, 8 s: {:>6.2f} s, {:.6f} N\n",
          method, model.point_count(), model.support.member.size(), 1e6 * seconds, 1e6 * step.dt, whole,
          newtons);
      csv += fmt::format("{},\"{}\",{},{},{},{:.1f},{:.3f},{:.3f},{:.6f}\n", name, method, model.node_count(),
                         model.point_count(), model.support.member.size(), 1e6 * seconds, 1e6 * step.dt,
                         whole, newtons);
    };
    const auto add_own = [&](const std::string& scheme, const Model& model) {
      const Nodal u = dent_of(model);
      Nodal f = u;
      const double newtons = force(model, material);
      for (const Precision precision : {Precision::double_, Precision::single_}) {
        const ForceSystem system(model, material, precision);
        ForceState forces(system);
        add(scheme + (precision == Precision::single_ ? ", single" : ", double"), model, forces, newtons,
            [&] { forces.internal_force(u, f); });
      }
    };
    const auto model_of = [&](const std::string& scheme) {
      Config config = scene_config(scheme, 4250);
      if (!brain) {
        config.boundary.base = "inferior";
        config.boundary.indent_at = "0,0,top";
      }
      return std::pair(make_body_surface(image, {}), whole_model(image, config));
    };
    const auto [body, model] = model_of("horton2007");
    const Tetrahedra mesh = tetrahedra_of(model, body.surface);
    const Model linear = as_tetrahedra(model, mesh);
    const std::string found = fmt::format(
        "{}, {} even nodes: {} tetrahedra with their middle inside, {} without slivers, {:.1f} % of "
        "the body's volume",
        name, model.node_count(), mesh.inside, mesh.corner.size(),
        100.0 * mesh.volume / (1e-9 * body.surface.volume()));
    fmt::print("{}\n", found);
    csv += "# " + found + "\n";
    const Nodal u = dent_of(linear);
    Nodal f = u;
    PlainTetrahedra loop = plain(linear, u);
    const ForceSystem product(linear, material);
    ForceState product_forces(product);
    evaluate(loop);
    product_forces.internal_force(u, f);
    double difference = 0.0;
    for (Index a = 0; a < u.cols(); ++a)
      for (int i = 0; i < 3; ++i)
        difference = std::max(difference, std::abs(f(i, a) - loop.f[static_cast<std::size_t>(3 * a + i)]));
    if (!(difference < 1e-9 * f.cwiseAbs().maxCoeff()))
      throw std::runtime_error(fmt::format("the two forces of tetrahedra differ by {}", difference));
    const double stiff = force(linear, material);
    add("linear tetrahedra, plain loop", linear, product_forces, stiff, [&] { evaluate(loop); });
    add("linear tetrahedra, our kernel", linear, product_forces, stiff,
        [&] { product_forces.internal_force(u, f); });
    add_own("horton2007", model);
    add_own("converging", model_of("converging").second);
  }
  write_file(folder / "tetrahedra.csv", csv);
}

}  // namespace
}  // namespace dimple

int main(int count, char** argument) {
  const std::string what = count == 3 ? argument[1] : "";
  if (what != "curve" && what != "tetrahedra") {
    fmt::print(stderr, "usage: dimple_paper curve|tetrahedra FOLDER\n");
    return 2;
  }
  try {
    what == "curve" ? dimple::curve(argument[2]) : dimple::tetrahedra(argument[2]);
  } catch (const dimple::Error& error) {
    fmt::print(stderr, "error: {}: {}\n", error.what(), error.report.where);
    return 1;
  } catch (const std::exception& error) {
    fmt::print(stderr, "error: {}\n", error.what());
    return 1;
  }
}
