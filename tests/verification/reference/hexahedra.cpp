// Reference force for pressing a bonded circle into a soft body whose base is held.
//
// Static, nearly incompressible neo-Hooke:
//   W = mu/2 (J^(-2/3) I1 - 3) + bulk/2 (J - 1)^2
// A quarter of the body (planes x = 0 and y = 0 are mirrors; of the slit block a half, plane y = 0) is meshed
// with 27-node hexahedra;
// J - 1 of the second term is replaced by its projection on four functions per element
// (1, X, Y, Z: the discontinuous linear pressure), eliminated element by element.
// Full Newton on displacement and pressure, sparse Cholesky, load steps that halve when they fail.
//
//   hexahedra scene rim_mm depth_mm levels [name=value ...]
//   hexahedra patch rim_mm                  (homogeneous stretch of the block's mesh)
//   hexahedra slit_patch rim_mm             (the same of the slit block's)
//   scene: block | cylinder | ellipsoid | slit     options: see Options
//
// Lengths in mm, stress in N/mm^2, force in N (of the whole body).
// Build: g++ -std=c++20 -O3 -march=native -I/usr/include/eigen3 -I/usr/include/suitesparse
//        hexahedra.cpp -o hexahedra -lcholmod -lopenblas
#include <Eigen/CholmodSupport>
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
#include <stdexcept>
#include <string>
#include <vector>

using Eigen::Matrix3d, Eigen::Matrix4d, Eigen::Vector2d, Eigen::Vector3d, Eigen::Vector4d, Eigen::VectorXd;
using SparseMatrix = Eigen::SparseMatrix<double>;
using Gradients = Eigen::Matrix<double, 27, 3>;
using ElementVector = Eigen::Matrix<double, 81, 1>;  // component-major: component * 27 + node
using ElementMatrix = Eigen::Matrix<double, 81, 81>;

struct Options {
  std::string scene = "block";
  double rim = 1.2, depth = 8;
  int levels = 8;
  std::map<std::string, double> named = {
      {"nu", 0.499},
      {"mu", 210e-6},
      {"circle", 5},
      {"width", 60},
      {"length", 60},
      {"height", 30},  // block
      {"radius", 30},  // cylinder (and height)
      {"axis_x", 46.25},
      {"axis_y", 31.25},
      {"axis_z", 16.7647},
      {"cut", -11.7353},    // ellipsoid
      {"seam", 0.3},        // height (in axis_z) at which the ellipsoid's top meets its side
      {"slit", 1},          // width of the slit of scene slit, a block of 60 x 60 x 30 mm
      {"gap", 3},           // from the rim to the slit's near wall
      {"slit_depth", 25},   // from the top
      {"filled", 0},        // 1: tissue fills the slit, so that the plain block is computed on the same mesh
      {"tip", 1},           // element at the slit's end
      {"half_sectors", 3},  // elements along 45 degrees of the circle
      {"growth", 1.35},
      {"far", 4},
      {"inner", 1.0},  // grading; largest element far away, under the circle
      {"first_depth", 0.25},
      {"extend", 0},     // below this J, J^(-2/3) goes on as its quadratic Taylor polynomial; 0: never
      {"pointwise", 0},  // part of the bulk modulus (in mu) that acts on J itself, not on its projection
      {"lame", 0},       // 1: bulk = lambda = 2 mu nu / (1 - 2 nu) instead of the bulk modulus
      {"smallest_step", 0.004},
  };
  double operator[](const char* name) const { return named.at(name); }
};

Options read_options(int count, char** text) {
  Options options;
  if (count < 3) throw std::runtime_error("usage: hexahedra scene rim_mm depth_mm levels [name=value ...]");
  options.scene = text[1];
  int position = 0;
  for (int i = 2; i < count; ++i) {
    const std::string word = text[i];
    if (const auto equals = word.find('='); equals != std::string::npos) {
      options.named.at(word.substr(0, equals)) = std::stod(word.substr(equals + 1));
      continue;
    }
    if (position == 0) options.rim = std::stod(word);
    if (position == 1) options.depth = std::stod(word);
    if (position == 2) options.levels = std::stoi(word);
    ++position;
  }
  return options;
}

// ---------------------------------------------------------------- mesh

struct Mesh {
  std::vector<Vector3d> nodes;
  std::vector<std::array<int, 27>> elements;
  std::vector<char> on_base, on_circle, on_outside;
  std::array<bool, 2> mirrored = {true, true};  // at the planes x = 0 and y = 0
  std::vector<int> near_wall;                   // of the slit
  double far_wall = 0;                          // its x

  int copies() const { return (mirrored[0] ? 2 : 1) * (mirrored[1] ? 2 : 1); }
};

// Outline of the body as the mesh sees it: height fraction 0 (base) .. 1 (top).
struct Outline {
  std::function<Vector2d(double angle, double fraction)> side;
  std::function<double(const Vector2d& plan)> top;
  double base = 0, typical_height = 30, typical_radius = 30;
};

Outline make_outline(const Options& options) {
  Outline outline;
  if (options.scene == "ellipsoid") {
    const double a = options["axis_x"], b = options["axis_y"], c = options["axis_z"];
    const double cut = options["cut"], seam = options["seam"] * c;
    outline.base = cut;
    outline.typical_height = c - cut;
    outline.typical_radius = std::max(a, b) * std::sqrt(1 - options["seam"] * options["seam"]);
    outline.side = [=](double angle, double fraction) {
      const double z = cut + fraction * (seam - cut);
      const double scale = std::sqrt(1 - z * z / (c * c));
      return Vector2d(a * scale * std::cos(angle), b * scale * std::sin(angle));
    };
    outline.top = [=](const Vector2d& plan) {
      return c * std::sqrt(1 - plan.x() * plan.x() / (a * a) - plan.y() * plan.y() / (b * b));
    };
    return outline;
  }
  const double height = options["height"];
  outline.typical_height = height;
  outline.top = [=](const Vector2d&) { return height; };
  if (options.scene == "cylinder") {
    const double radius = options["radius"];
    outline.typical_radius = radius;
    outline.side = [=](double angle, double) {
      return Vector2d(radius * std::cos(angle), radius * std::sin(angle));
    };
  } else {
    const double half_x = options["width"] / 2, half_y = options["length"] / 2;
    outline.typical_radius = std::max(half_x, half_y);
    outline.side = [=](double angle, double) {
      if (angle <= M_PI / 4 + 1e-12) return Vector2d(half_x, half_y * std::tan(angle));
      return Vector2d(half_x * std::tan(M_PI / 2 - angle), half_y);
    };
  }
  return outline;
}

// Fractions 0 .. 1 of a length, the elements growing geometrically from `first` up to `largest`;
// two entries per element (its mid node lies halfway).
std::vector<double> graded_fractions(double length, double first, double growth, double largest) {
  std::vector<double> ends = {0};
  for (double size = std::min(first, largest); ends.back() < length * (1 - 1e-9);
       size = std::min(largest, size * growth))
    ends.push_back(ends.back() + size);
  const size_t last = ends.size() - 1;
  // the last element may overshoot: drop it if less than half of it is needed
  if (last > 1 && length - ends[last - 1] < 0.5 * (ends[last] - ends[last - 1])) ends.pop_back();
  std::vector<double> fractions = {0};
  for (size_t i = 1; i < ends.size(); ++i) {
    fractions.push_back((ends[i - 1] + ends[i]) / 2 / ends.back());
    fractions.push_back(ends[i] / ends.back());
  }
  return fractions;
}

Mesh make_mesh(const Options& options) {
  const Outline outline = make_outline(options);
  const double circle = options["circle"], growth = options["growth"], far = options["far"],
               rim = options.rim;
  const int sectors = static_cast<int>(options["half_sectors"]);
  const double core_size = 0.55, core_bulge = 0.22;  // the rounded square in the middle of the circle

  const auto inside =
      graded_fractions(circle * (1 - core_size), rim, growth, options["inner"]);  // from the rim inwards
  const auto outside =
      graded_fractions(outline.typical_radius - circle, rim, growth, far);            // from the rim outwards
  const auto downwards = graded_fractions(outline.typical_height, rim, growth, far);  // from the top down

  const int core_points = 2 * sectors + 1, ring_points = 4 * sectors + 1;
  const int inside_points = static_cast<int>(inside.size()) - 1;
  const int radial_points = inside_points + static_cast<int>(outside.size()) - 1;
  const int plan_points = core_points * core_points + ring_points * radial_points;
  const int layer_points = static_cast<int>(downwards.size());

  auto core_index = [&](int p, int q) { return q * core_points + p; };
  // radial 0 is the outline of the core, inside_points is the circle
  auto ring_index = [&](int radial, int around) {
    if (radial == 0)
      return around <= 2 * sectors ? core_index(2 * sectors, around)
                                   : core_index(4 * sectors - around, 2 * sectors);
    return core_points * core_points + (radial - 1) * ring_points + around;
  };
  auto core_position = [&](int p, int q) {
    const double s = p / (2.0 * sectors), t = q / (2.0 * sectors), size = core_size * circle;
    return Vector2d(size * s * (1 - core_bulge * t * t), size * t * (1 - core_bulge * s * s));
  };
  auto plan_position = [&](int radial, int around, double height_fraction) -> Vector2d {
    const double angle = M_PI / 2 * around / (4.0 * sectors);
    const Vector2d on_circle = circle * Vector2d(std::cos(angle), std::sin(angle));
    if (radial <= inside_points) {
      const Vector2d on_core = around <= 2 * sectors ? core_position(2 * sectors, around)
                                                     : core_position(4 * sectors - around, 2 * sectors);
      return on_circle + inside[inside_points - radial] * (on_core - on_circle);
    }
    return on_circle + outside[radial - inside_points] * (outline.side(angle, height_fraction) - on_circle);
  };

  Mesh mesh;
  const int total = plan_points * layer_points;
  mesh.nodes.resize(total);
  mesh.on_base.assign(total, 0), mesh.on_circle.assign(total, 0), mesh.on_outside.assign(total, 0);
  for (int layer = 0; layer < layer_points; ++layer) {
    const double fraction = 1 - downwards[layer_points - 1 - layer];
    const bool base = layer == 0, top = layer == layer_points - 1;
    auto place = [&](int plan, const Vector2d& here, const Vector2d& at_top, bool in_circle, bool at_side) {
      const int node = layer * plan_points + plan;
      mesh.nodes[node] << here, outline.base + fraction * (outline.top(at_top) - outline.base);
      mesh.on_base[node] = base;
      mesh.on_circle[node] = top && in_circle;
      mesh.on_outside[node] = base || top || at_side;
    };
    for (int q = 0; q < core_points; ++q)
      for (int p = 0; p < core_points; ++p)
        place(core_index(p, q), core_position(p, q), core_position(p, q), true, false);
    for (int radial = 1; radial <= radial_points; ++radial)
      for (int around = 0; around < ring_points; ++around)
        place(ring_index(radial, around), plan_position(radial, around, fraction),
              plan_position(radial, around, 1), radial <= inside_points, radial == radial_points);
  }

  auto add_column = [&](const std::function<int(int, int)>& plan_index, int first, int second) {
    for (int layer = 0; layer + 2 < layer_points; layer += 2) {
      std::array<int, 27> element;
      for (int c = 0; c < 3; ++c)
        for (int b = 0; b < 3; ++b)
          for (int a = 0; a < 3; ++a)
            element[9 * c + 3 * b + a] = (layer + c) * plan_points + plan_index(first + a, second + b);
      mesh.elements.push_back(element);
    }
  };
  for (int q = 0; q + 2 < core_points; q += 2)
    for (int p = 0; p + 2 < core_points; p += 2) add_column(core_index, p, q);
  for (int radial = 0; radial + 2 <= radial_points; radial += 2)
    for (int around = 0; around + 2 < ring_points; around += 2) add_column(ring_index, radial, around);
  return mesh;
}

// Two entries per element, as graded_fractions(), for elements that end at `ends`.
std::vector<double> with_middles(const std::vector<double>& ends) {
  std::vector<double> places = {ends.front()};
  for (size_t i = 1; i < ends.size(); ++i) {
    places.push_back((ends[i - 1] + ends[i]) / 2);
    places.push_back(ends[i]);
  }
  return places;
}

// Places from `from` to `to`: the elements grow from `first` up to `largest`.
std::vector<double> graded_places(double from, double to, double first, double growth, double largest) {
  std::vector<double> places;
  for (double fraction : graded_fractions(std::abs(to - from), first, growth, largest))
    places.push_back(from + fraction * (to - from));
  return places;
}

// The same, growing from both ends.
std::vector<double> places_graded_from_both_ends(double from, double to, double first, double last,
                                                 double growth, double largest) {
  const double length = std::abs(to - from);
  std::vector<double> sizes_first, sizes_last;
  double sum = 0, next_first = first, next_last = last;
  while (sum < length * (1 - 1e-9)) {
    double& size = next_first <= next_last ? next_first : next_last;
    if (!sizes_first.empty() && !sizes_last.empty() && length - sum < size / 2) break;
    (&size == &next_first ? sizes_first : sizes_last).push_back(size);
    sum += size;
    size = std::min(largest, size * growth);
  }
  sizes_first.insert(sizes_first.end(), sizes_last.rbegin(), sizes_last.rend());
  std::vector<double> ends = {from};
  for (double size : sizes_first) ends.push_back(ends.back() + size / sum * (to - from));
  ends.back() = to;
  return with_middles(ends);
}

// `count` elements on a length, the first of the given size (or of an even share, if that is less) and each
// larger than the one before by the same factor. Fractions with middles.
std::vector<double> stretched_fractions(double length, double first, int count) {
  auto total = [&](double factor) {
    double sum = 0, size = std::min(first, length / count);
    for (int i = 0; i < count; ++i, size *= factor) sum += size;
    return sum;
  };
  double low = 1, high = 10;
  for (int i = 0; i < 100; ++i) (total((low + high) / 2) < length ? low : high) = (low + high) / 2;
  std::vector<double> ends = {0};
  double size = std::min(first, length / count);
  for (int i = 0; i < count; ++i, size *= low) ends.push_back(ends.back() + size);
  for (double& end : ends) end /= ends.back();
  return with_middles(ends);
}

// Half of the block with a slit. Its plan is a square around the circle, whose side touches the slit's near
// wall, with rings of elements between the two, and rows of rectangles outside; all are extruded along z.
Mesh make_slit_mesh(const Options& options) {
  const double circle = options["circle"], growth = options["growth"], far = options["far"],
               rim = options.rim, width = options["slit"], half_x = options["width"] / 2,
               half_y = options["length"] / 2, height = options["height"], tip = options["tip"];
  const double wall = circle + options["gap"], end = height - options["slit_depth"];
  const bool filled = options["filled"] > 0;
  const int sectors = static_cast<int>(options["half_sectors"]);
  const double core_size = 0.55, core_bulge = 0.22;  // as in make_mesh()

  std::vector<Vector2d> plan_nodes;
  std::vector<std::array<int, 9>> plan_elements;
  std::map<std::pair<long, long>, int> known;
  auto plan_node = [&](const Vector2d& place) {
    const long x = std::lround(place.x() * 1e6), y = std::lround(place.y() * 1e6);
    for (long dx = -1; dx <= 1; ++dx)
      for (long dy = -1; dy <= 1; ++dy)
        if (const auto found = known.find({x + dx, y + dy}); found != known.end()) return found->second;
    known[{x, y}] = static_cast<int>(plan_nodes.size());
    plan_nodes.push_back(place);
    return static_cast<int>(plan_nodes.size()) - 1;
  };
  // Right-handed: the second index goes anticlockwise from the first.
  auto add_patch = [&](int first_points, int second_points, const std::function<Vector2d(int, int)>& place) {
    for (int j = 0; j + 2 < second_points; j += 2)
      for (int i = 0; i + 2 < first_points; i += 2) {
        std::array<int, 9> element;
        for (int b = 0; b < 3; ++b)
          for (int a = 0; a < 3; ++a) element[3 * b + a] = plan_node(place(i + a, j + b));
        plan_elements.push_back(element);
      }
  };
  auto add_rectangles = [&](const std::vector<double>& x, const std::vector<double>& y) {
    add_patch(static_cast<int>(x.size()), static_cast<int>(y.size()),
              [&](int i, int j) { return Vector2d(x[i], y[j]); });
  };

  auto core_position = [&](int p, int q) {
    const double s = p / (2.0 * sectors) - 1, t = q / (2.0 * sectors), size = core_size * circle;
    return Vector2d(size * s * (1 - core_bulge * t * t), size * t * (1 - core_bulge * s * s));
  };
  add_patch(4 * sectors + 1, 2 * sectors + 1, core_position);
  const auto inside = graded_fractions(circle * (1 - core_size), rim, growth, options["inner"]);
  const int inside_points = static_cast<int>(inside.size());
  const int diagonal_elements =
      static_cast<int>(graded_fractions(std::sqrt(2) * wall - circle, rim, growth, far).size()) / 2;
  auto ring_position = [&](int radial, int around) -> Vector2d {
    const double angle = M_PI / 4 * around / (2.0 * sectors);
    const Vector2d on_circle = circle * Vector2d(std::cos(angle), std::sin(angle));
    const int corner = 2 * sectors;
    if (radial < inside_points) {
      const Vector2d on_core = around <= corner       ? core_position(2 * corner, around)
                               : around <= 3 * corner ? core_position(3 * corner - around, corner)
                                                      : core_position(0, 4 * corner - around);
      return on_circle + inside[inside_points - 1 - radial] * (on_core - on_circle);
    }
    const double cosine = std::cos(angle), sine = std::sin(angle);
    const Vector2d on_square = wall / std::max(std::abs(cosine), sine) * Vector2d(cosine, sine);
    const auto outside = stretched_fractions((on_square - on_circle).norm(), rim, diagonal_elements);
    return on_circle + outside[radial - inside_points + 1] * (on_square - on_circle);
  };
  add_patch(inside_points + 2 * diagonal_elements, 8 * sectors + 1, ring_position);

  // the square's own places along x and y go on outside of it
  std::vector<double> square_x, square_y;
  for (int k = 0; k <= 2 * sectors; ++k) square_y.push_back(wall * std::tan(M_PI / 4 * k / (2 * sectors)));
  for (int k = 2 * sectors; k > 0; --k) square_x.push_back(-square_y[k]);
  square_x.insert(square_x.end(), square_y.begin(), square_y.end());
  const double last_ring = std::max(rim, options["gap"] / 2);
  const auto beyond_y = graded_places(wall, half_y, last_ring, growth, far);
  auto left_x = graded_places(-wall, -half_x, last_ring, growth, far);
  std::reverse(left_x.begin(), left_x.end());
  const auto strip_x = with_middles({wall, wall + width});
  const auto right_x = graded_places(wall + width, half_x, std::max(width, 2 * rim), growth, far);
  add_rectangles(square_x, beyond_y);
  add_rectangles(left_x, square_y), add_rectangles(left_x, beyond_y);
  const size_t strip_begin = plan_elements.size();
  add_rectangles(strip_x, square_y), add_rectangles(strip_x, beyond_y);
  const size_t strip_end = plan_elements.size();
  add_rectangles(right_x, square_y), add_rectangles(right_x, beyond_y);

  auto layers = graded_places(end, 0, tip, growth, far);
  std::reverse(layers.begin(), layers.end());
  const auto upper = places_graded_from_both_ends(end, height, tip, rim, growth, far);
  const int end_layer = static_cast<int>(layers.size()) - 1;
  layers.insert(layers.end(), upper.begin() + 1, upper.end());
  const int layer_count = static_cast<int>(layers.size()), plan_count = static_cast<int>(plan_nodes.size());

  Mesh mesh;
  mesh.mirrored = {false, true};
  mesh.far_wall = wall + width;
  std::vector<int> number(size_t(plan_count) * layer_count, -1);
  for (size_t plan = 0; plan < plan_elements.size(); ++plan)
    for (int layer = 0; layer + 2 < layer_count; layer += 2) {
      if (!filled && plan >= strip_begin && plan < strip_end && layer >= end_layer) continue;
      std::array<int, 27> element;
      for (int k = 0; k < 27; ++k) {
        const int at = plan_elements[plan][k % 9], height_layer = layer + k / 9;
        int& node = number[size_t(height_layer) * plan_count + at];
        if (node < 0) {
          node = static_cast<int>(mesh.nodes.size());
          const Vector2d& place = plan_nodes[at];
          const double z = layers[height_layer];
          mesh.nodes.emplace_back(place.x(), place.y(), z);
          const bool base = height_layer == 0, top = height_layer == layer_count - 1;
          const bool above = z > end - 1e-9, at_near = std::abs(place.x() - wall) < 1e-9,
                     at_far = std::abs(place.x() - wall - width) < 1e-9;
          const bool at_end = std::abs(z - end) < 1e-9 && place.x() > wall && place.x() < wall + width;
          mesh.on_base.push_back(base);
          mesh.on_circle.push_back(top && place.norm() < circle + 1e-9);
          mesh.on_outside.push_back(base || top || std::abs(place.x()) > half_x - 1e-9 ||
                                    place.y() > half_y - 1e-9 ||
                                    (!filled && (at_end || (above && (at_near || at_far)))));
          if (!filled && above && at_near) mesh.near_wall.push_back(node);
        }
        element[k] = node;
      }
      mesh.elements.push_back(element);
    }
  return mesh;
}

// ---------------------------------------------------------------- element

struct GaussPoint {
  Gradients gradients;  // of the 27 shape functions, by reference position
  double weight;        // times reference volume
  Vector4d modes;       // the four functions J is projected on
};

struct Element {
  std::array<int, 27> nodes;
  std::array<GaussPoint, 27> points;
  Matrix4d inverse_mass;  // of the modes
};

double shape(int node, double s) {
  return node == 0 ? s * (s - 1) / 2 : node == 1 ? 1 - s * s : s * (s + 1) / 2;
}
double shape_slope(int node, double s) {
  return node == 0 ? s - 0.5 : node == 1 ? -2 * s : s + 0.5;
}

Element make_element(const Mesh& mesh, const std::array<int, 27>& nodes) {
  const double places[3] = {-std::sqrt(0.6), 0, std::sqrt(0.6)}, weights[3] = {5.0 / 9, 8.0 / 9, 5.0 / 9};
  Element element{nodes, {}, {}};
  const Vector3d centre = mesh.nodes[nodes[13]];
  const double size = (mesh.nodes[nodes[26]] - mesh.nodes[nodes[0]]).norm() / 2;
  Matrix4d mass = Matrix4d::Zero();
  for (int g = 0; g < 27; ++g) {
    const int at[3] = {g % 3, g / 3 % 3, g / 9};
    Gradients local;
    Vector3d position = Vector3d::Zero();
    Matrix3d map = Matrix3d::Zero();  // d position / d local
    for (int k = 0; k < 27; ++k) {
      const int which[3] = {k % 3, k / 3 % 3, k / 9};
      double value[3], slope[3];
      for (int axis = 0; axis < 3; ++axis) {
        value[axis] = shape(which[axis], places[at[axis]]);
        slope[axis] = shape_slope(which[axis], places[at[axis]]);
      }
      local.row(k) << slope[0] * value[1] * value[2], value[0] * slope[1] * value[2],
          value[0] * value[1] * slope[2];
      position += value[0] * value[1] * value[2] * mesh.nodes[nodes[k]];
      map += mesh.nodes[nodes[k]] * local.row(k);
    }
    GaussPoint& point = element.points[g];
    const double volume = map.determinant();
    if (volume <= 0) throw std::runtime_error("mesh: inverted element");
    point.gradients = local * map.inverse();
    point.weight = weights[at[0]] * weights[at[1]] * weights[at[2]] * volume;
    point.modes << 1, (position - centre) / size;
    mass += point.weight * point.modes * point.modes.transpose();
  }
  element.inverse_mass = mass.inverse();
  return element;
}

struct Material {
  double mu, bulk, pointwise_bulk, extend_below;
};

// J^(-2/3) with its first two derivatives, optionally continued as a quadratic below `extend_below`.
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

// Second derivative of det F by its rows i and j: (d2J)_(iA)(jB) = sign * (row m)^ _AB
Matrix3d second_cofactor(const Matrix3d& F, int i, int j) {
  Matrix3d result = Matrix3d::Zero();
  if (i == j) return result;
  const int m = 3 - i - j;
  const double sign = (i + 1) % 3 == j ? 1 : -1;
  const Vector3d row = sign * F.row(m).transpose();
  result << 0, row[2], -row[1], -row[2], 0, row[0], row[1], -row[0], 0;
  return result;
}

// An element's pressure as a function of its displacement: value + slope * (change of displacement).
// First the four modes of the projected part, then the 27 Gauss points of the pointwise part.
constexpr int pressures = 4 + 27;
using Pressure = Eigen::Matrix<double, pressures, 1>;
struct PressureLine {
  Pressure value;
  Eigen::Matrix<double, pressures, 81> slope;
};

// Fills the force (with the pressure that belongs to the displacement) and, when wanted, the stiffness. There
// the pressure is an unknown of its own, `pressure` its present value; eliminating it leaves the force as it
// is. False if a Gauss point inverted.
bool element_response(const Element& element, const Material& material, const Gradients& displacement,
                      const Pressure& pressure, ElementVector& force, ElementMatrix* stiffness,
                      PressureLine& line, double& smallest_J) {
  std::array<Matrix3d, 27> deformation, cofactors;
  std::array<double, 27> volume_ratio;
  Eigen::Matrix<double, 4, 81> coupling = Eigen::Matrix<double, 4, 81>::Zero();
  Vector4d volume_change = Vector4d::Zero();
  for (int g = 0; g < 27; ++g) {
    const GaussPoint& point = element.points[g];
    const Matrix3d F = Matrix3d::Identity() + displacement.transpose() * point.gradients;
    const Matrix3d C = cofactor(F);
    const double J = F.row(0).dot(C.row(0));
    deformation[g] = F, cofactors[g] = C, volume_ratio[g] = J;
    smallest_J = std::min(smallest_J, J);
    if (J <= 0 && material.extend_below <= 0) return false;
    volume_change += point.weight * (J - 1) * point.modes;
    const Gradients slope = point.gradients * C.transpose();  // dJ / d displacement
    const auto flat_slope = Eigen::Map<const ElementVector>(slope.data()).transpose();
    coupling += point.weight * point.modes * flat_slope;
    line.value[4 + g] = material.pointwise_bulk * (J - 1);
    line.slope.row(4 + g) = material.pointwise_bulk * flat_slope;
  }
  line.value.head<4>() = material.bulk * element.inverse_mass * volume_change;
  line.slope.topRows<4>() = material.bulk * element.inverse_mass * coupling;

  Gradients force_by_node = Gradients::Zero();
  if (stiffness) stiffness->setZero();
  for (int g = 0; g < 27; ++g) {
    const GaussPoint& point = element.points[g];
    const Matrix3d &F = deformation[g], &C = cofactors[g];
    const double square = F.squaredNorm(), mu = material.mu;
    const auto [factor, slope, curvature] = isochoric_factor(volume_ratio[g], material.extend_below);
    const double shear_along_J = mu / 2 * slope * square;
    const Matrix3d stress =
        mu * factor * F + (shear_along_J + line.value.head<4>().dot(point.modes) + line.value[4 + g]) * C;
    force_by_node += point.weight * point.gradients * stress.transpose();
    if (!stiffness) continue;
    const double along_J = shear_along_J + pressure.head<4>().dot(point.modes) + pressure[4 + g];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j <= i; ++j) {
        Matrix3d tangent =
            mu * slope * (F.row(i).transpose() * C.row(j) + C.row(i).transpose() * F.row(j)) +
            (mu / 2 * curvature * square + material.pointwise_bulk) * C.row(i).transpose() * C.row(j) +
            along_J * second_cofactor(F, i, j);
        if (i == j) tangent += mu * factor * Matrix3d::Identity();
        const Gradients half = point.weight * point.gradients * tangent;
        stiffness->block<27, 27>(27 * i, 27 * j) += half * point.gradients.transpose();
      }
  }
  force = Eigen::Map<const ElementVector>(force_by_node.data());
  if (stiffness) {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j <= i; ++j)
        stiffness->block<27, 27>(27 * i, 27 * j) +=
            coupling.middleCols<27>(27 * i).transpose() * line.slope.block<4, 27>(0, 27 * j);
    for (int i = 0; i < 3; ++i)
      for (int j = i + 1; j < 3; ++j)
        stiffness->block<27, 27>(27 * i, 27 * j) = stiffness->block<27, 27>(27 * j, 27 * i).transpose();
  }
  return true;
}

// ---------------------------------------------------------------- whole body

struct Body {
  Mesh mesh;
  Material material;
  std::vector<Element> elements;
  std::vector<int> unknown_of;  // per node and component, -1 where prescribed
  int unknowns = 0;
  VectorXd direction;        // prescribed motion per unit of load
  std::vector<char> driven;  // entries whose motion is `direction` (not zero by symmetry or base)
};

int entry(int node, int component) {
  return 3 * node + component;
}

struct State {
  VectorXd displacement;
  VectorXd pressure;  // `pressures` values per element
};

struct Response {
  VectorXd force;                   // internal, all entries
  VectorXd force_per_load;          // stiffness times direction, all entries
  std::vector<PressureLine> lines;  // per element
  double smallest_J = 1e9;
};

bool respond(const Body& body, const State& state, Response& response, SparseMatrix* stiffness) {
  const VectorXd& displacement = state.displacement;
  response.lines.resize(body.elements.size());
  response.force = VectorXd::Zero(displacement.size());
  response.force_per_load = VectorXd::Zero(displacement.size());
  response.smallest_J = 1e9;
  if (stiffness) std::fill_n(stiffness->valuePtr(), stiffness->nonZeros(), 0.0);
  ElementVector force, motion;
  ElementMatrix matrix;
  for (size_t number = 0; number < body.elements.size(); ++number) {
    const Element& element = body.elements[number];
    Gradients local;
    std::array<int, 81> entries;
    for (int k = 0; k < 27; ++k)
      for (int i = 0; i < 3; ++i) {
        entries[27 * i + k] = entry(element.nodes[k], i);
        local(k, i) = displacement[entry(element.nodes[k], i)];
        motion[27 * i + k] = body.direction[entry(element.nodes[k], i)];
      }
    if (!element_response(element, body.material, local,
                          state.pressure.segment<pressures>(pressures * number), force,
                          stiffness ? &matrix : nullptr, response.lines[number], response.smallest_J))
      return false;
    for (int k = 0; k < 81; ++k) response.force[entries[k]] += force[k];
    if (!stiffness) continue;
    if (motion.squaredNorm() > 0) {
      const ElementVector pulled = matrix * motion;
      for (int k = 0; k < 81; ++k) response.force_per_load[entries[k]] += pulled[k];
    }
    for (int column = 0; column < 81; ++column) {
      const int to = body.unknown_of[entries[column]];
      if (to < 0) continue;
      for (int row = 0; row < 81; ++row)
        if (const int from = body.unknown_of[entries[row]]; from >= to)
          stiffness->coeffRef(from, to) += matrix(row, column);
    }
  }
  return true;
}

SparseMatrix lower_pattern(const Body& body) {
  std::vector<std::vector<int>> rows(body.unknowns);
  for (const Element& element : body.elements) {
    std::vector<int> present;
    for (int node : element.nodes)
      for (int i = 0; i < 3; ++i)
        if (const int unknown = body.unknown_of[entry(node, i)]; unknown >= 0) present.push_back(unknown);
    for (int column : present)
      for (int row : present)
        if (row >= column) rows[column].push_back(row);
  }
  std::vector<int> lengths(body.unknowns);
  for (int column = 0; column < body.unknowns; ++column) {
    auto& list = rows[column];
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
    lengths[column] = static_cast<int>(list.size());
  }
  SparseMatrix pattern(body.unknowns, body.unknowns);
  pattern.reserve(lengths);
  for (int column = 0; column < body.unknowns; ++column)
    for (int row : rows[column]) pattern.insert(row, column) = 0;
  pattern.makeCompressed();
  return pattern;
}

Body make_body(const Options& options, bool patch) {
  Body body;
  body.mesh = options.scene == "slit" ? make_slit_mesh(options) : make_mesh(options);
  const double mu = options["mu"], nu = options["nu"];
  const double lambda = 2 * mu * nu / (1 - 2 * nu);
  const double bulk = options["lame"] > 0 ? lambda : lambda + 2 * mu / 3,
               pointwise = options["pointwise"] * mu;
  body.material = {mu, bulk - pointwise, pointwise, options["extend"]};
  for (const auto& nodes : body.mesh.elements) body.elements.push_back(make_element(body.mesh, nodes));

  const int count = static_cast<int>(body.mesh.nodes.size());
  body.unknown_of.assign(3 * count, -1);
  body.driven.assign(3 * count, 0);
  body.direction = VectorXd::Zero(3 * count);
  Matrix3d stretch;  // the patch test's displacement gradient, symmetric in the quarter's planes
  stretch << 0.2, 0, 0, 0, -0.1, 0, 0, 0, -0.15;
  for (int node = 0; node < count; ++node)
    for (int i = 0; i < 3; ++i) {
      const Vector3d& place = body.mesh.nodes[node];
      const bool mirror = i < 2 && body.mesh.mirrored[i] && std::abs(place[i]) < 1e-9;
      const bool held =
          patch ? bool(body.mesh.on_outside[node]) : body.mesh.on_base[node] || body.mesh.on_circle[node];
      const int at = entry(node, i);
      if (patch && held) body.direction[at] = stretch.row(i).dot(place), body.driven[at] = 1;
      if (!patch && body.mesh.on_circle[node] && i == 2) body.direction[at] = -1, body.driven[at] = 1;
      if (!held && !mirror) body.unknown_of[at] = body.unknowns++;
    }
  return body;
}

// ---------------------------------------------------------------- solution

struct LinearSolver {
  Eigen::CholmodSupernodalLLT<SparseMatrix, Eigen::Lower> cholesky;
  Eigen::CholmodSimplicialLDLT<SparseMatrix, Eigen::Lower> indefinite;
  bool analysed = false, indefinite_analysed = false, positive = true;

  bool factorise(const SparseMatrix& matrix, bool may_be_indefinite) {
    cholesky.cholmod().print = 0, indefinite.cholmod().print = 0;
    if (!analysed) cholesky.analyzePattern(matrix), analysed = true;
    cholesky.factorize(matrix);
    positive = cholesky.info() == Eigen::Success;
    if (positive || !may_be_indefinite) return positive;
    if (!indefinite_analysed) indefinite.analyzePattern(matrix), indefinite_analysed = true;
    indefinite.factorize(matrix);
    return indefinite.info() == Eigen::Success;
  }
  VectorXd solve(const VectorXd& right) {
    return positive ? VectorXd(cholesky.solve(right)) : VectorXd(indefinite.solve(right));
  }
};

VectorXd free_part(const Body& body, const VectorXd& all) {
  VectorXd result(body.unknowns);
  for (int at = 0; at < all.size(); ++at)
    if (body.unknown_of[at] >= 0) result[body.unknown_of[at]] = all[at];
  return result;
}

// Moves by `scale` times the linearised answer: displacement by `change`, pressure along the elements' lines.
State moved(const Body& body, const State& state, const Response& response, const VectorXd& change,
            double scale) {
  State result = state;
  result.displacement += scale * change;
  for (size_t number = 0; number < body.elements.size(); ++number) {
    ElementVector local;
    for (int k = 0; k < 27; ++k)
      for (int i = 0; i < 3; ++i) local[27 * i + k] = change[entry(body.elements[number].nodes[k], i)];
    const PressureLine& line = response.lines[number];
    auto pressure = result.pressure.segment<pressures>(pressures * number);
    pressure += scale * (line.value + line.slope * local - pressure);
  }
  return result;
}

VectorXd spread(const Body& body, const VectorXd& unknowns) {
  VectorXd result = VectorXd::Zero(body.direction.size());
  for (int at = 0; at < result.size(); ++at)
    if (body.unknown_of[at] >= 0) result[at] = unknowns[body.unknown_of[at]];
  return result;
}

// Newton at a fixed load. An indefinite stiffness is a failure unless allowed (slow to factorise). Returns
// the number of iterations, or -1.
int newton(const Body& body, State& state, Response& response, SparseMatrix& stiffness, LinearSolver& solver,
           bool may_be_indefinite, bool& positive) {
  const double tolerance = 1e-8;
  positive = true;
  for (int iteration = 0; iteration < 20; ++iteration) {
    if (!respond(body, state, response, &stiffness)) return -1;
    const VectorXd residual = free_part(body, response.force);
    const double residual_norm = residual.norm();
    const double reaction_norm =
        std::sqrt(std::max(1e-300, response.force.squaredNorm() - residual_norm * residual_norm));
    std::fprintf(stderr, "   iteration %d residual %.2e Jmin %.3f%s\n", iteration,
                 residual_norm / reaction_norm, response.smallest_J, positive ? "" : " indefinite");
    if (!(residual_norm < 1e3 * reaction_norm) || response.smallest_J < -2) return -1;  // astray
    if (residual_norm < tolerance * reaction_norm) return iteration;
    if (!solver.factorise(stiffness, may_be_indefinite)) return -1;
    positive = solver.positive;
    const VectorXd change = spread(body, solver.solve(-residual));
    bool accepted = false;
    for (double scale = 1; scale > 0.1 && !accepted; scale /= 2) {
      State trial = moved(body, state, response, change, scale);
      Response there;
      accepted = body.material.extend_below > 0 || respond(body, trial, there, nullptr);  // no inverted point
      if (accepted) state = trial;
    }
    if (!accepted) return -1;
  }
  return -1;
}

using Report = std::function<void(double load, const State& state, const Response& response, bool positive)>;

// Follows the load through `stops`, reporting each. False if it could not go on.
bool follow(const Body& body, const std::vector<double>& stops, double smallest_step, const Report& report) {
  SparseMatrix stiffness = lower_pattern(body);
  LinearSolver solver;
  Response response;
  State state{VectorXd::Zero(body.direction.size()), VectorXd::Zero(pressures * body.elements.size())},
      before = state;
  double load = 0, load_before = 0, step = stops.front();
  for (size_t next = 0; next < stops.size();) {
    double target = std::min(stops[next], load + step);
    if (stops[next] - target < 1e-9) target = stops[next];
    State trial = state;
    bool usable = false;
    if (load > load_before) {  // straight on from the last two states
      const double ratio = (target - load) / (load - load_before);
      trial.displacement += ratio * (state.displacement - before.displacement);
      trial.pressure += ratio * (state.pressure - before.pressure);
      usable = respond(body, trial, response, nullptr);
    }
    if (!usable) {  // along the tangent
      respond(body, state, response, &stiffness);
      if (!solver.factorise(stiffness, true)) return false;
      const VectorXd right =
          -(target - load) * free_part(body, response.force_per_load) - free_part(body, response.force);
      trial = moved(body, state, response,
                    (target - load) * body.direction + spread(body, solver.solve(right)), 1);
    }
    bool positive = true;
    std::fprintf(stderr, " load %.4f\n", target);
    const int iterations = newton(body, trial, response, stiffness, solver, target - load < 0.1, positive);
    if (iterations < 0) {
      step = (target - load) / 2;
      if (step < smallest_step) {
        std::fprintf(stderr, "stopped at %.4f\n", load);
        std::printf("# stopped after %.4f\n", load);
        return false;
      }
      continue;
    }
    before = state, load_before = load;
    state = trial, load = target;
    if (load == stops[next]) {
      report(load, state, response, positive);
      ++next;
      if (next < stops.size() && next == 1) step = std::max(step, 2 * stops.front());
    }
    if (iterations <= 5) step *= 1.5;
  }
  return true;
}

double driven_force(const Body& body, const Response& response) {
  double sum = 0;
  for (int at = 0; at < response.force.size(); ++at)
    if (body.driven[at]) sum += body.direction[at] * response.force[at];
  return body.mesh.copies() * sum;
}

void run_patch(const Options& options) {
  const Body body = make_body(options, true);
  follow(body, {0.5, 1.0}, 0.01, [&](double load, const State& state, const Response& response, bool) {
    double error = 0;
    for (size_t node = 0; node < body.mesh.nodes.size(); ++node) {
      const Vector3d exact = load * Vector3d(0.2, -0.1, -0.15).cwiseProduct(body.mesh.nodes[node]);
      for (int i = 0; i < 3; ++i)
        error = std::max(error, std::abs(state.displacement[entry(node, i)] - exact[i]));
    }
    double volume = 0;
    for (const Element& element : body.elements)
      for (const GaussPoint& point : element.points) volume += point.weight;
    const Matrix3d F = Vector3d(1 + 0.2 * load, 1 - 0.1 * load, 1 - 0.15 * load).asDiagonal();
    const double J = F.determinant();
    const Matrix3d stress =
        body.material.mu * std::pow(J, -2.0 / 3) * (F - F.squaredNorm() / 3 * F.inverse().transpose()) +
        (body.material.bulk + body.material.pointwise_bulk) * (J - 1) * cofactor(F);
    const double exact =
        body.mesh.copies() * volume * (stress * Vector3d(0.2, -0.1, -0.15).asDiagonal()).trace();
    std::printf(
        "patch load %.2f: volume %.6f mm^3, largest displacement error %.2e mm, work %.12g exact %.12g, "
        "J %.12g exact %.12g\n",
        load, body.mesh.copies() * volume, error, driven_force(body, response), exact, response.smallest_J,
        J);
  });
}

// Smallest distance from the slit's near wall to where its far wall lies at rest: the far wall hardly moves.
double wall_distance(const Body& body, const State& state) {
  double smallest = 1e9;
  for (int node : body.mesh.near_wall)
    smallest = std::min(smallest,
                        body.mesh.far_wall - body.mesh.nodes[node].x() - state.displacement[entry(node, 0)]);
  return smallest;
}

void run_scene(const Options& options) {
  const Body body = make_body(options, false);
  const auto start = std::chrono::steady_clock::now();
  std::fprintf(stderr, "%zu elements, %d unknowns\n", body.elements.size(), body.unknowns);
  std::vector<double> stops;
  if (options["first_depth"] > 0 && options["first_depth"] < options.depth / options.levels - 1e-9)
    stops.push_back(options["first_depth"]);
  for (int level = 1; level <= options.levels; ++level)
    stops.push_back(options.depth * level / options.levels);
  // the last four columns: J below which the energy is extended (0: plain), pointwise part of the bulk
  // modulus (mu), whether the stiffness was positive definite, seconds
  const bool slit = options.scene == "slit";
  std::printf(
      "scene,rim_mm,nu,unknowns,depth_mm,force_N,J_min,extended_below,pointwise,positive_definite,seconds%"
      "s\n",
      slit ? ",slit_mm,gap_mm,filled,half_sectors,growth,far_mm,wall_distance_mm" : "");
  follow(body, stops, options["smallest_step"],
         [&](double load, const State& state, const Response& response, bool positive) {
           const double seconds =
               std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
           std::printf("%s,%g,%g,%d,%g,%.7f,%.3f,%g,%g,%d,%.0f", options.scene.c_str(), options.rim,
                       options["nu"], body.unknowns, load, driven_force(body, response), response.smallest_J,
                       options["extend"], options["pointwise"], int(positive), seconds);
           if (slit)
             std::printf(",%g,%g,%g,%g,%g,%g,%.3f", options["slit"], options["gap"], options["filled"],
                         options["half_sectors"], options["growth"], options["far"],
                         body.mesh.near_wall.empty() ? 0 : wall_distance(body, state));
           std::printf("\n");
           std::fflush(stdout);
         });
}

int main(int count, char** text) {
  try {
    Options options = read_options(count, text);
    if (options.scene == "patch" || options.scene == "slit_patch") {
      options.scene = options.scene == "patch" ? "block" : "slit";
      run_patch(options);
    } else {
      run_scene(options);
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
