// Reference force of a bonded patch pressed into the body of a label image, or into a block with a slit.
//
// Static, nearly incompressible neo-Hooke:
//   W = mu/2 (J^(-2/3) I1 - 3) + bulk/2 (J - 1)^2
// CGAL's Mesh_3 fills the body with tetrahedra; displacement is quadratic, pressure linear and continuous
// (Taylor-Hood), faces are flat. Full Newton on displacement and pressure, MUMPS, load steps that halve when
// they fail. Surface, base, patch and labels of an image's body are those of Dimple's preprocess library;
// nothing else of Dimple is used.
//
//   dimple_reference_tetrahedra BODY rim_mm depth_mm levels [name=value ...]
//   BODY: block | slit | patch (a homogeneous stretch of the block's mesh) | ellipsoid (cut) | a label image
//   options: see Options; label=N takes one label of the image, without it all foreground is the body
//
// Lengths in mm, force in N. Built by -DDIMPLE_BENCH=ON where MUMPS is installed (libmumps-seq-dev).
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Mesh_complex_3_in_triangulation_3.h>
#include <CGAL/Mesh_criteria_3.h>
#include <CGAL/Mesh_triangulation_3.h>
#include <CGAL/Polygon_mesh_processing/triangulate_faces.h>
#include <CGAL/Polyhedral_mesh_domain_with_features_3.h>
#include <CGAL/Random.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/make_mesh_3.h>
#include <dmumps_c.h>

#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <map>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "io/label_image.hpp"
#include "preprocess/build_model.hpp"
#include "preprocess/scene/boundary_conditions.hpp"
#include "preprocess/surface/label_surface.hpp"
#include "tests/helpers/shapes.hpp"

namespace {

using dimple::BodySurface, dimple::Boundary, dimple::Points, dimple::Vec3, dimple::Triangles;
using Eigen::Matrix3d, Eigen::VectorXd;

struct Options {
  std::string body = "block";
  double patch_edge = 1.2, depth = 4;
  int levels = 4;
  std::map<std::string, double> named = {
      {"label", -1},        // of the image; -1: all foreground
      {"stiff", -1},        // label of a second tissue, of the element that has its centroid in it
      {"times", 5},         // its mu and bulk modulus over the others'
      {"x", 0},             // of the patch on the ellipsoid, or on an organ, LPS mm
      {"y", std::nan("")},  // on an organ; without it the highest place
      {"z", std::nan("")},
      {"mu", 210e-6},           // N/mm^2
      {"nu", 0.499},            // Poisson's ratio
      {"extend", 0.2},          // below this J, J^(-2/3) is its quadratic Taylor polynomial
      {"slit", 1},              // width
      {"gap", 3},               // from the patch edge to the slit's near wall
      {"slit_depth", 25},       // from the top
      {"growth", 0.3},          // of the required edge length by the distance from the patch
      {"far", 6},               // largest required edge
      {"near", 0.08},           // allowed distance between mesh and surface / required edge
      {"farthest", 1},          // limit of this distance, mm
      {"manifold", 1},          // 0: do not ask CGAL for a manifold surface
      {"first_depth", 0.5},     // reported before the others
      {"smallest_step", 0.01},  // mm
  };
  double operator[](const char* name) const { return named.at(name); }
};

Options read_options(int count, char** text) {
  Options options;
  if (count < 3)
    throw std::runtime_error(
        "usage: dimple_reference_tetrahedra BODY rim_mm depth_mm levels [name=value ...]");
  options.body = text[1];
  int position = 0;
  for (int i = 2; i < count; ++i) {
    const std::string word = text[i];
    if (const auto equals = word.find('='); equals != std::string::npos) {
      options.named.at(word.substr(0, equals)) = std::stod(word.substr(equals + 1));
      continue;
    }
    if (position == 0) options.patch_edge = std::stod(word);
    if (position == 1) options.depth = std::stod(word);
    if (position == 2) options.levels = std::stoi(word);
    ++position;
  }
  return options;
}

// ---------------------------------------------------------------- body

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Surface = CGAL::Surface_mesh<Kernel::Point_3>;
using Domain = CGAL::Polyhedral_mesh_domain_with_features_3<Kernel, Surface>;
using Triangulation = CGAL::Mesh_triangulation_3<Domain>::type;
using Complex = CGAL::Mesh_complex_3_in_triangulation_3<Triangulation>;
using Criteria = CGAL::Mesh_criteria_3<Triangulation>;

struct Scene {
  BodySurface surface;
  Boundary boundary;
  bool sharp = false;                                 // its edges are features of the mesh
  std::function<double(const Vec3&)> stiffness = {};  // of the tissue there over mu; empty: 1
};

// Block of 60 x 60 x 30 mm, with or without a slit along y.
Scene analytic_scene(const Options& options) {
  std::vector<std::array<double, 2>> outline = {{-30, 0}, {30, 0}, {30, 30}};
  if (options.body == "slit") {
    const double wall = 5 + options["gap"], end = 30 - options["slit_depth"];
    outline.push_back({wall + options["slit"], 30});
    outline.push_back({wall + options["slit"], end});
    outline.push_back({wall, end});
    outline.push_back({wall, 30});
  }
  outline.push_back({-30, 30});
  Surface mesh;
  std::vector<Surface::Vertex_index> front, back;
  for (const auto& [x, z] : outline) {
    front.push_back(mesh.add_vertex({x, -30, z}));
    back.push_back(mesh.add_vertex({x, 30, z}));
  }
  for (size_t k = 0; k < outline.size(); ++k) {
    const size_t next = (k + 1) % outline.size();
    mesh.add_face(front[next], front[k], back[k], back[next]);
  }
  mesh.add_face(front);
  mesh.add_face(std::vector<Surface::Vertex_index>(back.rbegin(), back.rend()));
  CGAL::Polygon_mesh_processing::triangulate_faces(mesh);
  Points vertex(3, static_cast<Eigen::Index>(mesh.number_of_vertices()));
  for (const auto v : mesh.vertices())
    vertex.col(v.idx()) << mesh.point(v).x(), mesh.point(v).y(), mesh.point(v).z();
  Triangles triangles(3, static_cast<Eigen::Index>(mesh.number_of_faces()));
  Eigen::Index t = 0;
  for (const auto face : mesh.faces()) {
    int k = 0;
    for (const auto v : mesh.vertices_around_face(mesh.halfedge(face)))
      triangles(k++, t) = static_cast<Triangles::Scalar>(v.idx());
    ++t;
  }
  Scene scene{BodySurface(vertex, triangles), {}, true};
  scene.boundary.height = 30;
  scene.boundary.base_depth = 1e-6;
  scene.boundary.flat_base = true;
  scene.boundary.centre = Vec3(0, 0, 30);
  return scene;
}

// Scene of the ellipsoids in tests/bench/organs.cpp.
Scene ellipsoid_scene(const Options& options) {
  BodySurface surface = dimple::cut_ellipsoid_surface({46.25, 31.25, 16.7647}, -11.7353);
  const dimple::BoundaryOptions requested{.base = "inferior",
                                          .indent_at = std::to_string(options["x"]) + ",0,top"};
  const Boundary boundary = dimple::find_boundary(surface, requested);
  return {std::move(surface), boundary, true};
}

Scene image_scene(const Options& options) {
  static const dimple::LabelImage image = dimple::read_label_image(options.body);
  std::vector<int> labels;
  if (options["label"] >= 0) labels.push_back(static_cast<int>(options["label"]));
  dimple::SegmentedBody body = dimple::make_body_surface(image, labels);
  dimple::BoundaryOptions requested{.base = "organ"};  // the organ's own flat or broadest side
  if (std::isfinite(options["z"]))
    requested.indent_at = std::to_string(options["x"]) + "," + std::to_string(options["y"]) + "," +
                          std::to_string(options["z"]);
  requested.voxel_mm = image.spacing().maxCoeff();
  Boundary boundary = dimple::find_boundary(body.surface, requested);
  const Vec3 centre = body.surface.to_world() * boundary.centre;
  std::fprintf(stderr, "base: %s\ncircle at %.1f, %.1f, %.1f: %s\n", boundary.base_reason.c_str(), centre.x(),
               centre.y(), centre.z(), boundary.patch_reason.c_str());
  Scene scene{std::move(body.surface), boundary, false};
  if (options["stiff"] >= 0)
    scene.stiffness = [label_at = dimple::label_finder(image, scene.surface), stiff = options["stiff"],
                       times = options["times"]](const Vec3& x) {
      return label_at(x) == stiff ? times : 1.0;
    };
  return scene;
}

// ---------------------------------------------------------------- mesh

struct Mesh {
  std::vector<Vec3> nodes;  // corners, then middles of edges
  int corners = 0;
  std::vector<std::array<int, 10>> elements;
  std::vector<char> on_base, on_patch, on_outside;
  double volume = 0;
};

using Sizes = std::function<double(const Vec3&)>;

struct Field {
  using FT = Kernel::FT;
  using Point_3 = Kernel::Point_3;
  using Index = Domain::Index;
  const Sizes* sizes;
  double scale, largest = 1e9;
  FT operator()(const Point_3& p, int, const Index&) const {
    return std::min(largest, scale * (*sizes)(Vec3(p.x(), p.y(), p.z())));
  }
};

Mesh make_mesh(const Scene& scene, const Options& options) {
  const BodySurface& body = scene.surface;
  const Boundary& boundary = scene.boundary;
  Surface surface;
  std::vector<Surface::Vertex_index> vertices;
  for (Eigen::Index v = 0; v < body.vertex().cols(); ++v)
    vertices.push_back(surface.add_vertex({body.vertex()(0, v), body.vertex()(1, v), body.vertex()(2, v)}));
  for (Eigen::Index t = 0; t < body.triangles().cols(); ++t)
    surface.add_face(vertices[size_t(body.triangles()(0, t))], vertices[size_t(body.triangles()(1, t))],
                     vertices[size_t(body.triangles()(2, t))]);

  CGAL::get_default_random() = CGAL::Random(0);
  Domain domain(surface, &CGAL::get_default_random());
  if (scene.sharp) domain.detect_features(60);
  const Points patch_edge = dimple::edge_of_patch(body, boundary, 120);
  std::vector<std::vector<Kernel::Point_3>> lines(1);
  for (Eigen::Index k = 0; k <= patch_edge.cols(); ++k) {
    const Vec3 x = patch_edge.col(k % patch_edge.cols());
    lines[0].emplace_back(x.x(), x.y(), x.z());
  }
  domain.add_features(lines.begin(), lines.end());

  const double first = options.patch_edge, growth = options["growth"], far = options["far"];
  const Sizes sizes = [&](const Vec3& x) {
    // edges have the patch edge's length up to one of them away from it
    const double squared = (patch_edge.colwise() - x).colwise().squaredNorm().minCoeff();
    return std::min(far, first + growth * std::max(0.0, std::sqrt(squared) - first));
  };
  // The bounds of the circumradii are 0.7 of the required edge: equilateral ones have 0.58 and 0.61.
  const Field edges{&sizes, 1.0}, radii{&sizes, 0.7}, distances{&sizes, options["near"], options["farthest"]};
  namespace p = CGAL::parameters;
  const Criteria criteria(p::edge_size = edges, p::facet_angle = 25.0, p::facet_size = radii,
                          p::facet_distance = distances, p::cell_radius_edge_ratio = 2.0,
                          p::cell_size = radii);
  const auto complex = options["manifold"] > 0
                           ? CGAL::make_mesh_3<Complex>(domain, criteria, p::manifold())
                           : CGAL::make_mesh_3<Complex>(domain, criteria, p::non_manifold());

  Mesh mesh;
  std::map<Triangulation::Vertex_handle, int> number;
  std::vector<std::array<int, 4>> cells;
  for (auto cell = complex.cells_in_complex_begin(); cell != complex.cells_in_complex_end(); ++cell) {
    std::array<int, 4> c;
    for (int k = 0; k < 4; ++k) {
      const auto vertex = cell->vertex(k);
      const auto [found, added] = number.try_emplace(vertex, static_cast<int>(mesh.nodes.size()));
      if (added) mesh.nodes.emplace_back(vertex->point().x(), vertex->point().y(), vertex->point().z());
      c[k] = found->second;
    }
    const Vec3 &a = mesh.nodes[c[0]], &b = mesh.nodes[c[1]], &d = mesh.nodes[c[2]], &e = mesh.nodes[c[3]];
    const double volume = (b - a).cross(d - a).dot(e - a) / 6;
    if (volume < 0) std::swap(c[2], c[3]);
    mesh.volume += std::abs(volume);
    cells.push_back(c);
  }
  mesh.corners = static_cast<int>(mesh.nodes.size());
  std::map<std::pair<int, int>, int> middles;
  auto middle = [&](int a, int b) {
    const auto [found, added] =
        middles.try_emplace({std::min(a, b), std::max(a, b)}, static_cast<int>(mesh.nodes.size()));
    if (added) mesh.nodes.push_back((mesh.nodes[a] + mesh.nodes[b]) / 2);
    return found->second;
  };
  std::map<std::array<int, 3>, std::pair<int, std::array<int, 3>>> faces;  // times, corners outwards
  static constexpr int opposite[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
  for (const auto& c : cells) {
    mesh.elements.push_back({c[0], c[1], c[2], c[3], middle(c[0], c[1]), middle(c[1], c[2]),
                             middle(c[2], c[0]), middle(c[0], c[3]), middle(c[1], c[3]), middle(c[2], c[3])});
    for (const auto& f : opposite) {
      const std::array<int, 3> face = {c[f[0]], c[f[1]], c[f[2]]};
      std::array<int, 3> sorted = face;
      std::sort(sorted.begin(), sorted.end());
      ++faces.try_emplace(sorted, 0, face).first->second.first;
    }
  }

  const size_t total = mesh.nodes.size();
  mesh.on_base.assign(total, 0), mesh.on_patch.assign(total, 0), mesh.on_outside.assign(total, 0);
  for (const auto& [sorted, about] : faces) {
    const auto& [times, f] = about;
    if (times != 1) continue;
    const std::array<int, 6> all = {
        f[0], f[1], f[2], middle(f[0], f[1]), middle(f[1], f[2]), middle(f[2], f[0])};
    const Vec3 normal =
        (mesh.nodes[f[1]] - mesh.nodes[f[0]]).cross(mesh.nodes[f[2]] - mesh.nodes[f[0]]).normalized();
    bool held = true, pressed = normal.dot(boundary.approach) < 0;
    for (int k = 0; k < 3; ++k) {
      const Vec3 from = mesh.nodes[f[k]] - boundary.centre;
      const double along = from.dot(boundary.approach), square = boundary.radius * boundary.radius;
      held = held && dimple::on_base(boundary, mesh.nodes[f[k]], normal);
      pressed = pressed && from.squaredNorm() - along * along <= square * (1 + 1e-3) &&
                std::abs(along) <= 2 * boundary.radius;
    }
    for (const int node : all) {
      mesh.on_outside[node] = 1;
      if (held) mesh.on_base[node] = 1;
      if (pressed) mesh.on_patch[node] = 1;
    }
  }
  // An image's base ends inside a triangle, so each node is tested itself, with the surface's normal.
  if (!scene.sharp)
    for (size_t node = 0; node < total; ++node)
      if (mesh.on_outside[node]) {
        const auto closest = body.closest(mesh.nodes[node]);
        mesh.on_base[node] = dimple::on_base(boundary, mesh.nodes[node], body.normal().col(closest.triangle));
      }
  std::fprintf(stderr, "%zu tetrahedra, %zu nodes, %d corners; volume %.1f of %.1f mm^3 (%+.3f %%)\n",
               mesh.elements.size(), total, mesh.corners, mesh.volume, body.volume(),
               100 * (mesh.volume / body.volume() - 1));
  return mesh;
}

// ---------------------------------------------------------------- element

constexpr int quadrature_points = 14;  // exact for polynomials of degree 5
struct Quadrature {
  std::array<Eigen::Vector4d, quadrature_points> place;  // barycentric
  std::array<double, quadrature_points> weight;          // parts of the volume
};

const Quadrature& quadrature() {
  static const Quadrature rule = [] {
    Quadrature q;
    int next = 0;
    const double corner[2] = {0.31088591926330060980, 0.092735250310891226402};
    const double weight[2] = {0.11268792571801585080, 0.07349304311636194934};
    for (int family = 0; family < 2; ++family)
      for (int k = 0; k < 4; ++k) {
        q.place[next].setConstant(corner[family]);
        q.place[next][k] = 1 - 3 * corner[family];
        q.weight[next++] = weight[family];
      }
    const double a = 0.045503704125649649492;
    for (int k = 0; k < 4; ++k)
      for (int l = k + 1; l < 4; ++l) {
        q.place[next].setConstant(0.5 - a);
        q.place[next][k] = q.place[next][l] = a;
        q.weight[next++] = 0.04254602077708146644;
      }
    return q;
  }();
  return rule;
}

// Displacement unknowns 3 * node + component of the ten nodes, then the four pressures.
using Gradients = Eigen::Matrix<double, 10, 3>;
using ElementVector = Eigen::Matrix<double, 34, 1>;
using ElementMatrix = Eigen::Matrix<double, 34, 34>;

constexpr int edge_ends[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};

std::array<double, 3> isochoric_factor(double J, double extend_below) {
  const double at = std::max(J, extend_below);
  const double value = std::pow(at, -2.0 / 3), slope = -2.0 / 3 * value / at,
               curvature = 10.0 / 9 * value / (at * at);
  const double beyond = J - at;
  return {value + slope * beyond + curvature * beyond * beyond / 2, slope + curvature * beyond, curvature};
}

Matrix3d cofactor(const Matrix3d& F) {
  Matrix3d result;
  for (int i = 0; i < 3; ++i) result.row(i) = F.row((i + 1) % 3).cross(F.row((i + 2) % 3));
  return result;
}

// Second derivative of det F by its rows i and j.
Matrix3d second_cofactor(const Matrix3d& F, int i, int j) {
  Matrix3d result = Matrix3d::Zero();
  if (i == j) return result;
  const double sign = (i + 1) % 3 == j ? 1 : -1;
  const Vec3 row = sign * F.row(3 - i - j).transpose();
  result << 0, row[2], -row[1], -row[2], 0, row[0], row[1], -row[0], 0;
  return result;
}

// Element with stresses in units of mu.
struct Element {
  Eigen::Matrix<double, 4, 3> slopes;  // of the barycentric coordinates
  double volume, stiffness = 1.0;
};

Element make_element(const Mesh& mesh, const std::array<int, 10>& nodes) {
  Matrix3d map;
  for (int k = 0; k < 3; ++k) map.col(k) = mesh.nodes[nodes[k + 1]] - mesh.nodes[nodes[0]];
  Element element;
  element.volume = map.determinant() / 6;
  if (element.volume <= 0) throw std::runtime_error("mesh: inverted element");
  const Matrix3d inverse = map.inverse();
  element.slopes.bottomRows<3>() = inverse;
  element.slopes.row(0) = -inverse.colwise().sum();
  return element;
}

Gradients shape_gradients(const Element& element, const Eigen::Vector4d& place) {
  Gradients gradients;
  for (int k = 0; k < 4; ++k) gradients.row(k) = (4 * place[k] - 1) * element.slopes.row(k);
  for (int e = 0; e < 6; ++e) {
    const int a = edge_ends[e][0], b = edge_ends[e][1];
    gradients.row(4 + e) = 4 * (place[a] * element.slopes.row(b) + place[b] * element.slopes.row(a));
  }
  return gradients;
}

// Force and, on request, stiffness (full, symmetric) of an element.
void element_response(const Element& element, double plain_bulk, double extend, const Gradients& displacement,
                      const Eigen::Vector4d& pressure, ElementVector& force, ElementMatrix* stiffness,
                      double& smallest_J) {
  const double bulk = plain_bulk * element.stiffness;
  force.setZero();
  if (stiffness) stiffness->setZero();
  const Quadrature& rule = quadrature();
  using Block = Eigen::Matrix<double, 10, 10>;
  std::array<std::array<Block, 3>, 3> blocks;
  if (stiffness)
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j <= i; ++j) blocks[i][j].setZero();
  for (int g = 0; g < quadrature_points; ++g) {
    const Eigen::Vector4d& modes = rule.place[g];
    const double weight = rule.weight[g] * element.volume;
    const Gradients gradients = shape_gradients(element, modes);
    const Matrix3d F = Matrix3d::Identity() + displacement.transpose() * gradients;
    const Matrix3d C = cofactor(F);
    const double J = F.row(0).dot(C.row(0)), square = F.squaredNorm(), p = pressure.dot(modes);
    smallest_J = std::min(smallest_J, J);
    auto [factor, slope, curvature] = isochoric_factor(J, extend);
    factor *= element.stiffness, slope *= element.stiffness, curvature *= element.stiffness;
    const double along_J = slope * square / 2 + p;
    const Gradients nodal = weight * gradients * (factor * F + along_J * C).transpose();
    for (int k = 0; k < 10; ++k)
      for (int i = 0; i < 3; ++i) force[3 * k + i] += nodal(k, i);
    force.tail<4>() += weight * (J - 1 - p / bulk) * modes;
    if (!stiffness) continue;
    const Gradients volume_slope = weight * gradients * C.transpose();
    for (int k = 0; k < 10; ++k)
      for (int i = 0; i < 3; ++i)
        for (int m = 0; m < 4; ++m) (*stiffness)(30 + m, 3 * k + i) += volume_slope(k, i) * modes[m];
    stiffness->bottomRightCorner<4, 4>() -= weight / bulk * modes * modes.transpose();
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j <= i; ++j) {
        Matrix3d tangent = slope * (F.row(i).transpose() * C.row(j) + C.row(i).transpose() * F.row(j)) +
                           curvature * square / 2 * C.row(i).transpose() * C.row(j) +
                           along_J * second_cofactor(F, i, j);
        if (i == j) tangent += factor * Matrix3d::Identity();
        const Gradients half = weight * gradients * tangent;
        blocks[i][j].noalias() += half * gradients.transpose();
      }
  }
  if (!stiffness) return;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j)
      for (int k = 0; k < 10; ++k)
        for (int l = 0; l < 10; ++l) {
          (*stiffness)(3 * k + i, 3 * l + j) = blocks[i][j](k, l);
          (*stiffness)(3 * l + j, 3 * k + i) = blocks[i][j](k, l);
        }
  stiffness->topRightCorner<30, 4>() = stiffness->bottomLeftCorner<4, 30>().transpose();
}

// ---------------------------------------------------------------- whole body

using SparseMatrix = Eigen::SparseMatrix<double, Eigen::ColMajor, int>;  // lower triangle

struct Body {
  Mesh mesh;
  double mu, bulk, extend;  // bulk in units of mu
  std::vector<Element> elements;
  std::vector<int> unknown_of;  // per entry (three per node, then one per corner), -1 where prescribed
  int unknowns = 0;
  VectorXd direction;  // prescribed motion per unit of load
  std::vector<char> driven;

  std::array<int, 34> entries(size_t element) const {
    std::array<int, 34> result;
    for (int k = 0; k < 10; ++k)
      for (int i = 0; i < 3; ++i) result[3 * k + i] = 3 * mesh.elements[element][k] + i;
    for (int m = 0; m < 4; ++m)
      result[30 + m] = 3 * static_cast<int>(mesh.nodes.size()) + mesh.elements[element][m];
    return result;
  }
};

struct Response {
  VectorXd force;
  double smallest_J = 1e9;
};

void respond(const Body& body, const VectorXd& state, Response& response, SparseMatrix* stiffness) {
  response.force = VectorXd::Zero(state.size());
  response.smallest_J = 1e9;
  if (stiffness) std::fill_n(stiffness->valuePtr(), stiffness->nonZeros(), 0.0);
  ElementVector force;
  ElementMatrix matrix;
  for (size_t number = 0; number < body.elements.size(); ++number) {
    const auto entries = body.entries(number);
    Gradients local;
    Eigen::Vector4d pressure;
    for (int k = 0; k < 10; ++k)
      for (int i = 0; i < 3; ++i) local(k, i) = state[entries[3 * k + i]];
    for (int m = 0; m < 4; ++m) pressure[m] = state[entries[30 + m]];
    element_response(body.elements[number], body.bulk, body.extend, local, pressure, force,
                     stiffness ? &matrix : nullptr, response.smallest_J);
    for (int k = 0; k < 34; ++k) response.force[entries[k]] += force[k];
    if (!stiffness) continue;
    for (int column = 0; column < 34; ++column) {
      const int to = body.unknown_of[entries[column]];
      if (to < 0) continue;
      const int *begin = stiffness->innerIndexPtr() + stiffness->outerIndexPtr()[to],
                *end = stiffness->innerIndexPtr() + stiffness->outerIndexPtr()[to + 1];
      double* values = stiffness->valuePtr() + stiffness->outerIndexPtr()[to];
      for (int row = 0; row < 34; ++row)
        if (const int from = body.unknown_of[entries[row]]; from >= to)
          values[std::lower_bound(begin, end, from) - begin] += matrix(row, column);
    }
  }
}

SparseMatrix lower_pattern(const Body& body) {
  std::vector<std::vector<int>> rows(body.unknowns);
  for (size_t number = 0; number < body.elements.size(); ++number) {
    std::vector<int> present;
    for (int at : body.entries(number))
      if (body.unknown_of[at] >= 0) present.push_back(body.unknown_of[at]);
    for (int column : present)
      for (int row : present)
        if (row >= column) rows[column].push_back(row);
  }
  SparseMatrix pattern(body.unknowns, body.unknowns);
  size_t total = 0;
  for (auto& list : rows) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
    total += list.size();
  }
  pattern.resizeNonZeros(static_cast<Eigen::Index>(total));
  int next = 0;
  for (int column = 0; column < body.unknowns; ++column) {
    pattern.outerIndexPtr()[column] = next;
    for (int row : rows[column]) {
      pattern.innerIndexPtr()[next] = row;
      pattern.valuePtr()[next++] = 0;
    }
  }
  pattern.outerIndexPtr()[body.unknowns] = next;
  return pattern;
}

Matrix3d patch_stretch() {
  Matrix3d stretch;
  stretch << 0.2, 0.05, 0, 0, -0.1, 0.03, 0.02, 0, -0.08;
  return stretch;
}

Body make_body(const Scene& scene, const Options& options) {
  Body body;
  body.mesh = make_mesh(scene, options);
  const double nu = options["nu"], lambda = 2 * nu / (1 - 2 * nu);
  body.mu = options["mu"];
  body.bulk = lambda + 2.0 / 3;
  body.extend = options["extend"];
  for (const auto& nodes : body.mesh.elements) body.elements.push_back(make_element(body.mesh, nodes));
  if (scene.stiffness)
    for (size_t e = 0; e < body.elements.size(); ++e) {
      const auto& corner = body.mesh.elements[e];
      const Vec3 middle = (body.mesh.nodes[corner[0]] + body.mesh.nodes[corner[1]] +
                           body.mesh.nodes[corner[2]] + body.mesh.nodes[corner[3]]) /
                          4;
      body.elements[e].stiffness = scene.stiffness(middle);
    }
  const int count = static_cast<int>(body.mesh.nodes.size()), entries = 3 * count + body.mesh.corners;
  body.unknown_of.assign(entries, -1);
  body.driven.assign(entries, 0);
  body.direction = VectorXd::Zero(entries);
  const bool patch = options.body == "patch";
  for (int node = 0; node < count; ++node)
    for (int i = 0; i < 3; ++i) {
      const int at = 3 * node + i;
      const bool held =
          patch ? bool(body.mesh.on_outside[node]) : body.mesh.on_base[node] || body.mesh.on_patch[node];
      if (patch && held)
        body.direction[at] = patch_stretch().row(i).dot(body.mesh.nodes[node]), body.driven[at] = 1;
      if (!patch && body.mesh.on_patch[node])
        body.direction[at] = scene.boundary.approach[i], body.driven[at] = 1;
      if (!held) body.unknown_of[at] = body.unknowns++;
    }
  for (int corner = 0; corner < body.mesh.corners; ++corner)
    body.unknown_of[3 * count + corner] = body.unknowns++;
  return body;
}

// ---------------------------------------------------------------- solution

// MUMPS factors of a symmetric indefinite matrix. Old factors precondition GMRES for a new matrix.
class LinearSolver {
 public:
  LinearSolver() {
    mumps_.par = 1, mumps_.sym = 2, mumps_.comm_fortran = -987654, mumps_.job = -1;
    dmumps_c(&mumps_);
    mumps_.icntl[0] = mumps_.icntl[1] = mumps_.icntl[2] = -1, mumps_.icntl[3] = 0;  // no messages
    mumps_.icntl[6] = 5;                                                            // METIS
    mumps_.icntl[13] = 60;                                                          // room for late pivots, %
  }
  ~LinearSolver() {
    mumps_.job = -2;
    dmumps_c(&mumps_);
  }
  bool factorise(const SparseMatrix& matrix) {
    if (rows_.empty()) {
      for (int column = 0; column < matrix.cols(); ++column)
        for (SparseMatrix::InnerIterator it(matrix, column); it; ++it)
          rows_.push_back(static_cast<int>(it.row()) + 1), columns_.push_back(column + 1);
      mumps_.n = static_cast<int>(matrix.cols());
      mumps_.nnz = matrix.nonZeros();
      mumps_.irn = rows_.data(), mumps_.jcn = columns_.data();
      mumps_.a = const_cast<double*>(matrix.valuePtr());
      mumps_.job = 1;
      dmumps_c(&mumps_);
      if (mumps_.infog[0] < 0) return false;
    }
    mumps_.a = const_cast<double*>(matrix.valuePtr());
    mumps_.job = 2;
    dmumps_c(&mumps_);
    ready_ = mumps_.infog[0] >= 0;
    if (!ready_) std::fprintf(stderr, "MUMPS: %d %d\n", mumps_.infog[0], mumps_.infog[1]);
    ++factorisations;
    return ready_;
  }
  bool ready() const { return ready_; }
  int negative_pivots() const { return mumps_.infog[11]; }
  VectorXd solve(VectorXd right) {
    mumps_.rhs = right.data(), mumps_.nrhs = 1, mumps_.lrhs = mumps_.n;
    mumps_.job = 3;
    dmumps_c(&mumps_);
    return right;
  }
  // Solves by right-preconditioned GMRES; empty if it needs more than `most` steps.
  std::optional<VectorXd> iterate(const SparseMatrix& matrix, const VectorXd& right, double tolerance,
                                  int most) {
    std::vector<VectorXd> basis = {right / right.norm()}, preconditioned;
    Eigen::MatrixXd hessenberg = Eigen::MatrixXd::Zero(most + 1, most);
    for (int step = 0; step < most; ++step) {
      preconditioned.push_back(solve(basis[step]));
      VectorXd next = matrix.selfadjointView<Eigen::Lower>() * preconditioned[step];
      for (int k = 0; k <= step; ++k) {
        hessenberg(k, step) = basis[k].dot(next);
        next -= hessenberg(k, step) * basis[k];
      }
      hessenberg(step + 1, step) = next.norm();
      basis.push_back(next / hessenberg(step + 1, step));
      const Eigen::MatrixXd small = hessenberg.topLeftCorner(step + 2, step + 1);
      VectorXd target = VectorXd::Zero(step + 2);
      target[0] = right.norm();
      const VectorXd weights = small.colPivHouseholderQr().solve(target);
      if ((small * weights - target).norm() < tolerance * right.norm()) {
        VectorXd result = VectorXd::Zero(right.size());
        for (int k = 0; k <= step; ++k) result += weights[k] * preconditioned[k];
        return result;
      }
    }
    return std::nullopt;
  }
  int factorisations = 0;

 private:
  DMUMPS_STRUC_C mumps_{};
  std::vector<int> rows_, columns_;
  bool ready_ = false;
};

VectorXd free_part(const Body& body, const VectorXd& all) {
  VectorXd result(body.unknowns);
  for (int at = 0; at < all.size(); ++at)
    if (body.unknown_of[at] >= 0) result[body.unknown_of[at]] = all[at];
  return result;
}

VectorXd spread(const Body& body, const VectorXd& unknowns) {
  VectorXd result = VectorXd::Zero(body.direction.size());
  for (int at = 0; at < result.size(); ++at)
    if (body.unknown_of[at] >= 0) result[at] = unknowns[body.unknown_of[at]];
  return result;
}

// Newton iteration at a fixed load. Returns the number of iterations, or -1.
int newton(const Body& body, VectorXd& state, Response& response, SparseMatrix& stiffness,
           LinearSolver& solver) {
  const int displacements = 3 * static_cast<int>(body.mesh.nodes.size());
  double before = 1e300;
  for (int iteration = 0; iteration < 25; ++iteration) {
    respond(body, state, response, &stiffness);
    double residual = 0, reaction = 1e-300, volume = 0;
    for (int at = 0; at < response.force.size(); ++at) {
      const double square = response.force[at] * response.force[at];
      (at >= displacements ? volume : body.unknown_of[at] >= 0 ? residual : reaction) += square;
    }
    residual = std::sqrt(residual / reaction), volume = std::sqrt(volume);
    std::fprintf(stderr, "   iteration %d residual %.2e volume %.2e Jmin %.3f, %d factorisations\n",
                 iteration, residual, volume, response.smallest_J, solver.factorisations);
    if (!(residual < 1e4) || response.smallest_J < -3) return -1;  // diverged
    if (residual < 1e-6 && volume < 1e-6) return iteration;
    const VectorXd right = -free_part(body, response.force);
    // Old factors are kept while Newton converges and GMRES needs few steps.
    std::optional<VectorXd> change;
    if (solver.ready() && residual < before) change = solver.iterate(stiffness, right, 1e-3, 25);
    before = residual;
    if (!change) {
      if (!solver.factorise(stiffness)) return -1;
      change = solver.solve(right);
    }
    state += spread(body, *change);
  }
  return -1;
}

double driven_force(const Body& body, const Response& response) {
  double sum = 0;
  for (int at = 0; at < response.force.size(); ++at)
    if (body.driven[at]) sum += body.direction[at] * response.force[at];
  return body.mu * sum;
}

using Report = std::function<void(double load, const VectorXd& state, const Response& response)>;

bool follow(const Body& body, const std::vector<double>& stops, double smallest_step, LinearSolver& solver,
            const Report& report) {
  SparseMatrix stiffness = lower_pattern(body);
  std::fprintf(stderr, "%d unknowns, %ld entries\n", body.unknowns, static_cast<long>(stiffness.nonZeros()));
  Response response;
  VectorXd state = VectorXd::Zero(body.direction.size()), before = state;
  double load = 0, load_before = 0, step = stops.front();
  for (size_t next = 0; next < stops.size();) {
    double target = std::min(stops[next], load + step);
    if (stops[next] - target < 1e-9) target = stops[next];
    VectorXd trial = state;
    if (load > load_before) {
      trial += (target - load) / (load - load_before) * (state - before);
    } else {  // along the tangent: the prescribed part alone would tear elements at the patch
      respond(body, state, response, &stiffness);
      Response there;
      const double little = 1e-6;
      respond(body, state + little * body.direction, there, nullptr);
      if (!solver.factorise(stiffness)) return false;
      const VectorXd right = -free_part(body, (there.force - response.force) / little);
      trial += (target - load) * (body.direction + spread(body, solver.solve(right)));
    }
    std::fprintf(stderr, " load %.4f\n", target);
    const int iterations = newton(body, trial, response, stiffness, solver);
    if (iterations < 0) {
      step = (target - load) / 2;
      if (step < smallest_step) {
        std::printf("# stopped after %.4f\n", load);
        return false;
      }
      continue;
    }
    before = state, load_before = load;
    state = trial, load = target;
    if (load == stops[next]) {
      report(load, state, response);
      ++next;
      if (next == 1) step = std::max(step, 2 * stops.front());
    }
    if (iterations <= 5) step *= 1.5;
  }
  return true;
}

void run_patch(const Body& body) {
  LinearSolver solver;
  follow(body, {0.5, 1.0}, 0.01, solver, [&](double load, const VectorXd& state, const Response& response) {
    double error = 0;
    const Matrix3d gradient = load * patch_stretch();
    for (size_t node = 0; node < body.mesh.nodes.size(); ++node)
      error = std::max(
          error, (state.segment<3>(static_cast<Eigen::Index>(3 * node)) - gradient * body.mesh.nodes[node])
                     .cwiseAbs()
                     .maxCoeff());
    const Matrix3d F = Matrix3d::Identity() + gradient;
    const double J = F.determinant();
    const Matrix3d stress = std::pow(J, -2.0 / 3) * (F - F.squaredNorm() / 3 * F.inverse().transpose()) +
                            body.bulk * (J - 1) * cofactor(F);
    const double exact = body.mu * body.mesh.volume * stress.cwiseProduct(patch_stretch()).sum();
    std::printf(
        "patch load %.2f: largest displacement error %.2e mm, work %.12g exact %.12g, J %.12g exact %.12g\n",
        load, error, driven_force(body, response), exact, response.smallest_J, J);
  });
}

void run_scene(const Body& body, const Options& options) {
  const auto start = std::chrono::steady_clock::now();
  std::vector<double> stops;
  if (options["first_depth"] > 0 && options["first_depth"] < options.depth / options.levels - 1e-9)
    stops.push_back(options["first_depth"]);
  for (int level = 1; level <= options.levels; ++level)
    stops.push_back(options.depth * level / options.levels);
  std::string name = options.body.substr(options.body.find_last_of('/') + 1);
  name = name.substr(0, name.find('.'));
  if (options.body == "ellipsoid") name += ":" + std::to_string(static_cast<int>(options["x"]));
  if (options["stiff"] >= 0) name = "two_labels";
  if (options["label"] >= 0) name += ":" + std::to_string(static_cast<int>(options["label"]));
  if (options.body == "slit") {
    char text[64];
    std::snprintf(text, sizeof text, ":%g/%g", options["slit"], options["gap"]);
    name += text;
  }
  std::printf("body,rim_mm,growth,far_mm,tetrahedra,unknowns,depth_mm,force_N,J_min,wrong_pivots,seconds\n");
  LinearSolver solver;
  follow(body, stops, options["smallest_step"], solver,
         [&](double load, const VectorXd&, const Response& response) {
           const double seconds =
               std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
           // of the last factors: a stable equilibrium has as many negative pivots as pressures
           std::printf("%s,%g,%g,%g,%zu,%d,%g,%.7f,%.3f,%d,%.0f\n", name.c_str(), options.patch_edge,
                       options["growth"], options["far"], body.elements.size(), body.unknowns, load,
                       driven_force(body, response), response.smallest_J,
                       solver.negative_pivots() - body.mesh.corners, seconds);
           std::fflush(stdout);
         });
}

}  // namespace

int main(int count, char** text) {
  try {
    const Options options = read_options(count, text);
    const bool analytic = options.body == "block" || options.body == "slit" || options.body == "patch";
    const Scene scene = analytic                      ? analytic_scene(options)
                        : options.body == "ellipsoid" ? ellipsoid_scene(options)
                                                      : image_scene(options);
    const Body body = make_body(scene, options);
    if (options.body == "patch")
      run_patch(body);
    else
      run_scene(body, options);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
