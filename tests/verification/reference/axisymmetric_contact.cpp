// Reference force of a rigid tool of revolution pressed into a cylinder with a held base. Contact is without
// friction, with Coulomb friction, or without slip after first contact.
//
// Static, nearly incompressible neo-Hooke, any strain:
//   W = mu/2 (J^(-2/3) I1 - 3) + bulk/2 (J - 1)^2
// The section r >= 0, 0 <= z <= height is meshed with 9-node quadrilaterals. J - 1 of the second term is
// replaced by its projection on three functions per element (1, R, Z: the discontinuous linear pressure).
// Nodes of the top must not penetrate the tool: their contact forces are unknowns (Lagrange multipliers, a
// primal-dual active set in each step of a full Newton iteration). There is no penalty and no penetration at
// nodes. Failed load steps are halved.
//
// Friction: a node slides freely in the load step of its first contact. From then on it is held at its place
// on the tool at the last load step, if the tangential force T is at most friction x the normal force N.
// Otherwise it slips along the tool, with T = friction N against its motion. This choice is part of the
// active set; the column of N is then n + friction d t, its row n, and the system is not symmetric. (With
// nodes held where an iterate made first contact, the force depended on the mesh: +2.5, not +4.3 % at 4 mm.)
//
//   axisymmetric_contact [name=value ...]     options: see Options
//
// Lengths in mm, stress in N/mm^2, force in N. Prints a CSV.
// Build: g++ -std=c++20 -O3 -march=native -I/usr/include/eigen3 -I/usr/include/suitesparse
//        axisymmetric_contact.cpp -o axisymmetric_contact -lumfpack -lopenblas
#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <Eigen/UmfPackSupport>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <numbers>
#include <string>
#include <vector>

using Eigen::Matrix2d, Eigen::Matrix3d, Eigen::Vector2d, Eigen::Vector3d, Eigen::VectorXd;
using SparseMatrix = Eigen::SparseMatrix<double>;
using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;
using ElementVector = Eigen::Matrix<double, 18, 1>;
using ElementMatrix = Eigen::Matrix<double, 18, 18>;
constexpr double pi = std::numbers::pi;

struct Options {
  std::string tool = "sphere";    // sphere | paraboloid | punch (flat, with a rounded edge)
  std::string base = "bonded";    // bonded | loose (slides on its bed)
  std::string indenter = "slip";  // slip | stick | coulomb
  std::map<std::string, double> named = {
      {"radius", 5},   // of the tool; of a paraboloid that at its tip
      {"edge", 1},     // radius of the punch's edge
      {"body", 30},    // radius of the cylinder
      {"height", 30},  //
      {"nu", 0.499},
      {"mu", 210e-6},
      {"depth", 4},
      {"steps", 16},
      {"fine", 0.25},   // size of the elements near the contact
      {"reach", 7},     // to this radius, and to `below` under the top
      {"below", 3},     //
      {"growth", 1.2},  // of the elements beyond
      {"largest", 5},
      {"edge_fine", 0},   // size of the elements near r = radius - edge ... radius, 0: as
                          // `fine`
      {"friction", 0.3},  // of touch=coulomb
      {"layer", 0},       // thickness of a layer of another tissue at the top, which `below` then is
      {"layer_mu", 0},
      {"film", 0},    // shear modulus times thickness of a neo-Hookean membrane on the top [N/mm]
      {"weight", 0},  // of the body [N/mm^3], in equilibrium before contact
  };
  double operator[](const std::string& name) const { return named.at(name); }
};

// ---- the law, in the components F_rR, F_rZ, F_zR, F_zZ, F_tt
struct Law {
  double mu, bulk;
};
Law law_of(double mu, double nu) {
  return {mu, mu * 2.0 * nu / (1.0 - 2.0 * nu) + 2.0 / 3.0 * mu};
}

double volume_ratio(const Vector5d& F) {
  return (F[0] * F[3] - F[1] * F[2]) * F[4];
}

Vector5d cofactor(const Vector5d& F) {
  return {F[3] * F[4], -F[2] * F[4], -F[1] * F[4], F[0] * F[4], F[0] * F[3] - F[1] * F[2]};
}

Matrix5d second_of_volume(const Vector5d& F) {
  Matrix5d S = Matrix5d::Zero();
  S(0, 3) = S(3, 0) = F[4];
  S(1, 2) = S(2, 1) = -F[4];
  S(0, 4) = S(4, 0) = F[3];
  S(3, 4) = S(4, 3) = F[0];
  S(1, 4) = S(4, 1) = -F[2];
  S(2, 4) = S(4, 2) = -F[1];
  return S;
}

Vector5d distortional_stress(double mu, const Vector5d& F) {
  const double J = volume_ratio(F), I1 = F.squaredNorm();
  return mu * std::pow(J, -2.0 / 3.0) * (F - I1 / (3.0 * J) * cofactor(F));
}

Matrix5d distortional_tangent(double mu, const Vector5d& F) {
  const double J = volume_ratio(F), I1 = F.squaredNorm(), g = std::pow(J, -2.0 / 3.0);
  const Vector5d c = cofactor(F);
  return mu * g *
         (Matrix5d::Identity() - 2.0 / (3.0 * J) * (F * c.transpose() + c * F.transpose()) +
          5.0 / 9.0 * I1 / (J * J) * c * c.transpose() - I1 / (3.0 * J) * second_of_volume(F));
}

// ---- the mesh
struct Element {
  std::array<int, 9> node;
};
struct Mesh {
  std::vector<Vector2d> X;
  std::vector<Element> element;
  std::vector<int> top;  // nodes from the axis outwards
};

// Borders of elements: `fine` until `reach`, then growing until `end`.
std::vector<double> graded(double fine, double reach, double growth, double largest, double end) {
  std::vector<double> border = {0.0};
  const int even = std::max(1, static_cast<int>(std::lround(reach / fine)));
  for (int k = 1; k <= even; ++k) border.push_back(std::min(reach, end) * k / even);
  double size = fine;
  while (border.back() < end - 1e-9) {
    size = std::min(largest, size * growth);
    border.push_back(border.back() + size);
  }
  if (border.size() > static_cast<std::size_t>(even) + 1) {  // the grown ones are adjusted to fit
    const double from = border[static_cast<std::size_t>(even)], to = border.back();
    for (std::size_t k = static_cast<std::size_t>(even) + 1; k < border.size(); ++k)
      border[k] = from + (border[k] - from) * (end - from) / (to - from);
  }
  return border;
}

Mesh mesh_of(const Options& o) {
  std::vector<double> r = graded(o["fine"], o["reach"], o["growth"], o["largest"], o["body"]);
  if (o["edge_fine"] > 0.0) {  // divides those near the edge
    std::vector<double> divided = {0.0};
    for (std::size_t k = 1; k < r.size(); ++k) {
      const double middle = 0.5 * (r[k] + r[k - 1]), size = r[k] - r[k - 1];
      const bool near = middle > o["radius"] - 1.5 * o["edge"] && middle < o["radius"] + 0.5 * o["edge"];
      const int parts = near ? std::max(1, static_cast<int>(std::lround(size / o["edge_fine"]))) : 1;
      for (int p = 1; p <= parts; ++p) divided.push_back(r[k - 1] + size * p / parts);
    }
    r = divided;
  }
  const double below = o["layer"] > 0.0 ? o["layer"] : o["below"];
  std::vector<double> z = graded(o["fine"], below, o["growth"], o["largest"], o["height"]);
  for (double& one : z) one = o["height"] - one;
  std::reverse(z.begin(), z.end());
  const int nr = static_cast<int>(r.size()) - 1, nz = static_cast<int>(z.size()) - 1, row = 2 * nr + 1;
  Mesh mesh;
  const auto at = [](const std::vector<double>& x, int k) {
    return k % 2 == 0 ? x[static_cast<std::size_t>(k / 2)]
                      : 0.5 * (x[static_cast<std::size_t>(k / 2)] + x[static_cast<std::size_t>(k / 2) + 1]);
  };
  for (int j = 0; j <= 2 * nz; ++j)
    for (int i = 0; i <= 2 * nr; ++i) mesh.X.emplace_back(at(r, i), at(z, j));
  for (int j = 0; j < nz; ++j)
    for (int i = 0; i < nr; ++i) {
      Element e;
      for (int b = 0; b < 3; ++b)
        for (int a = 0; a < 3; ++a)
          e.node[static_cast<std::size_t>(3 * b + a)] = (2 * j + b) * row + 2 * i + a;
      mesh.element.push_back(e);
    }
  for (int i = 0; i < row; ++i) mesh.top.push_back(2 * nz * row + i);
  return mesh;
}

// ---- an element
struct Point {
  Eigen::Matrix<double, 5, 18> B;  // from the nodes' displacements (r0 z0 r1 z1 ...) to F - 1
  Eigen::Matrix<double, 9, 1> N;
  double volume;
  Vector3d psi;
};

std::array<Point, 9> points_of(const Mesh& mesh, const Element& e) {
  const double g = std::sqrt(0.6);
  const std::array<double, 3> at = {-g, 0.0, g}, weight = {5.0 / 9.0, 8.0 / 9.0, 5.0 / 9.0};
  const auto shape = [](double x) { return Vector3d(0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)); };
  const auto slope = [](double x) { return Vector3d(x - 0.5, -2.0 * x, x + 0.5); };
  const Vector2d low = mesh.X[static_cast<std::size_t>(e.node[0])],
                 high = mesh.X[static_cast<std::size_t>(e.node[8])], half = 0.5 * (high - low),
                 middle = 0.5 * (high + low);
  std::array<Point, 9> points;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) {
      Point& p = points[static_cast<std::size_t>(3 * j + i)];
      const double x = at[static_cast<std::size_t>(i)], y = at[static_cast<std::size_t>(j)];
      const double R = middle.x() + half.x() * x;
      p.volume = weight[static_cast<std::size_t>(i)] * weight[static_cast<std::size_t>(j)] * half.x() *
                 half.y() * 2.0 * pi * R;
      p.psi = Vector3d(1.0, x, y);
      p.B.setZero();
      const Vector3d nx = shape(x), ny = shape(y), dx = slope(x) / half.x(), dy = slope(y) / half.y();
      for (int b = 0; b < 3; ++b)
        for (int a = 0; a < 3; ++a) {
          const int k = 3 * b + a;
          p.B(0, 2 * k) = p.B(2, 2 * k + 1) = dx[a] * ny[b];
          p.B(1, 2 * k) = p.B(3, 2 * k + 1) = nx[a] * dy[b];
          p.N[k] = nx[a] * ny[b];
          p.B(4, 2 * k) = p.N[k] / R;
        }
    }
  return points;
}

struct Assembly {
  VectorXd force;                             // derivative of the energy
  std::vector<Eigen::Triplet<double>> entry;  // its second derivative
  double J_min = 1e9;
};

// Adds a membrane on the top: W = film/2 (a + b + 1/(a b) - 3) by area at rest, with a and b the squares of
// its stretches along the meridian and around. It resists compression, too.
void add_film(const Mesh& mesh, double film, const VectorXd& u, Assembly& all) {
  const double g = std::sqrt(0.6);
  const std::array<double, 3> at = {-g, 0.0, g}, weight = {5.0 / 9.0, 8.0 / 9.0, 5.0 / 9.0};
  for (std::size_t first = 0; first + 2 < mesh.top.size(); first += 2) {
    const int* node = &mesh.top[first];
    const double low = mesh.X[static_cast<std::size_t>(node[0])].x(),
                 half = 0.5 * (mesh.X[static_cast<std::size_t>(node[2])].x() - low);
    for (std::size_t q = 0; q < 3; ++q) {
      const double x = at[q], R = low + half * (1.0 + x), area = weight[q] * half * 2.0 * pi * R;
      const Vector3d N(0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)),
          slope = Vector3d(x - 0.5, -2.0 * x, x + 0.5) / half;
      Vector2d along(1.0, 0.0);
      double r = R;
      for (int k = 0; k < 3; ++k) {
        along += slope[k] * u.segment<2>(2 * node[k]);
        r += N[k] * u[2 * node[k]];
      }
      const double a = along.squaredNorm(), b = r * r / (R * R), ab = a * b;
      Eigen::Matrix<double, 6, 1> da, db;
      Eigen::Matrix<double, 6, 6> dda = Eigen::Matrix<double, 6, 6>::Zero(), ddb = dda;
      for (int k = 0; k < 3; ++k) {
        da.segment<2>(2 * k) = 2.0 * slope[k] * along;
        db.segment<2>(2 * k) = Vector2d(2.0 * r * N[k] / (R * R), 0.0);
        for (int l = 0; l < 3; ++l) {
          dda.block<2, 2>(2 * k, 2 * l) = 2.0 * slope[k] * slope[l] * Matrix2d::Identity();
          ddb(2 * k, 2 * l) = 2.0 * N[k] * N[l] / (R * R);
        }
      }
      const double Wa = 0.5 * film * (1.0 - 1.0 / (a * ab)), Wb = 0.5 * film * (1.0 - 1.0 / (ab * b)),
                   Waa = film / (a * a * ab), Wbb = film / (ab * b * b), Wab = 0.5 * film / (ab * ab);
      const Eigen::Matrix<double, 6, 1> f = area * (Wa * da + Wb * db);
      const Eigen::Matrix<double, 6, 6> K =
          area * (Wa * dda + Wb * ddb + Waa * da * da.transpose() + Wbb * db * db.transpose() +
                  Wab * (da * db.transpose() + db * da.transpose()));
      for (int k = 0; k < 6; ++k) {
        all.force[2 * node[k / 2] + k % 2] += f[k];
        for (int l = 0; l < 6; ++l)
          all.entry.emplace_back(2 * node[k / 2] + k % 2, 2 * node[l / 2] + l % 2, K(k, l));
      }
    }
  }
}

void add_weight(const Mesh& mesh, const std::vector<std::array<Point, 9>>& points, double weight,
                Assembly& all) {
  for (std::size_t n = 0; n < mesh.element.size(); ++n)
    for (const Point& p : points[n])
      for (int k = 0; k < 9; ++k)
        all.force[2 * mesh.element[n].node[static_cast<std::size_t>(k)] + 1] += weight * p.volume * p.N[k];
}

// Assembles the body; elements above the height `layer_from` have the second law.
Assembly assemble(const Mesh& mesh, const std::vector<std::array<Point, 9>>& points,
                  const std::array<Law, 2>& laws, double layer_from, const VectorXd& u) {
  Assembly all;
  all.force = VectorXd::Zero(u.size());
  const Vector5d one(1.0, 0.0, 0.0, 1.0, 1.0);
  for (std::size_t n = 0; n < mesh.element.size(); ++n) {
    const Element& e = mesh.element[n];
    const Law& law = laws[mesh.X[static_cast<std::size_t>(e.node[4])].y() > layer_from ? 1 : 0];
    ElementVector ue, f = ElementVector::Zero();
    for (int k = 0; k < 9; ++k) ue.segment<2>(2 * k) = u.segment<2>(2 * e.node[static_cast<std::size_t>(k)]);
    ElementMatrix K = ElementMatrix::Zero();
    Matrix3d M = Matrix3d::Zero();
    Vector3d theta = Vector3d::Zero();
    Eigen::Matrix<double, 3, 18> G = Eigen::Matrix<double, 3, 18>::Zero();
    std::array<Vector5d, 9> F;
    for (int q = 0; q < 9; ++q) {
      const Point& p = points[n][static_cast<std::size_t>(q)];
      Vector5d& Fq = F[static_cast<std::size_t>(q)];
      Fq = one + p.B * ue;
      const double J = volume_ratio(Fq);
      all.J_min = std::min(all.J_min, J);
      if (J <= 0.0) continue;
      M += p.volume * p.psi * p.psi.transpose();
      theta += p.volume * (J - 1.0) * p.psi;
      G += p.volume * p.psi * (cofactor(Fq).transpose() * p.B);
      f += p.volume * p.B.transpose() * distortional_stress(law.mu, Fq);
      K += p.volume * p.B.transpose() * distortional_tangent(law.mu, Fq) * p.B;
    }
    if (all.J_min <= 0.0) return all;
    const Vector3d pressure = law.bulk * M.ldlt().solve(theta);
    f += G.transpose() * pressure;
    for (int k = 0; k < 9; ++k)
      all.force.segment<2>(2 * e.node[static_cast<std::size_t>(k)]) += f.segment<2>(2 * k);
    K += law.bulk * G.transpose() * M.ldlt().solve(G);
    for (int q = 0; q < 9; ++q) {
      const Point& p = points[n][static_cast<std::size_t>(q)];
      K += p.volume * p.psi.dot(pressure) * p.B.transpose() *
           second_of_volume(F[static_cast<std::size_t>(q)]) * p.B;
    }
    for (int k = 0; k < 18; ++k)
      for (int l = 0; l < 18; ++l)
        all.entry.emplace_back(2 * e.node[static_cast<std::size_t>(k / 2)] + k % 2,
                               2 * e.node[static_cast<std::size_t>(l / 2)] + l % 2, K(k, l));
  }
  return all;
}

// ---- the tool, whose tip is at z = 0: distance from it, positive outside, with derivatives
struct Gap {
  double value;
  Vector2d normal;
  Matrix2d curvature;
};

Gap round_gap(const Vector2d& from_centre, double radius) {
  const double length = std::max(from_centre.norm(), 1e-12);
  const Vector2d n = from_centre / length;
  return {length - radius, n, (Matrix2d::Identity() - n * n.transpose()) / length};
}

Gap gap_of(const Options& o, const Vector2d& x) {
  const double radius = o["radius"], edge = o["edge"];
  if (o.tool == "sphere") return round_gap(x - Vector2d(0.0, radius), radius);
  if (o.tool == "paraboloid") {  // about the distance, and zero on its surface
    const Vector2d down(x[0] / radius, -1.0);
    const double steep = down.norm();
    const Vector2d n = down / steep;
    const Matrix2d across = Matrix2d::Identity() - n * n.transpose();
    return {(x[0] * x[0] / (2.0 * radius) - x[1]) / steep, n,
            across.col(0) * Vector2d(1.0 / radius / steep, 0.0).transpose()};
  }
  const Vector2d q(x[0] - (radius - edge), edge - x[1]);  // outwards and down from the middle of the edge
  if (q[0] > 0.0 && q[1] > 0.0) {
    Gap gap = round_gap(q, edge);
    gap.normal[1] *= -1.0;
    gap.curvature(0, 1) *= -1.0;
    gap.curvature(1, 0) *= -1.0;
    return gap;
  }
  if (q[0] > q[1]) return {q[0] - edge, {1.0, 0.0}, Matrix2d::Zero()};
  return {q[1] - edge, {0.0, -1.0}, Matrix2d::Zero()};
}

Vector2d turned(const Vector2d& n) {
  return {-n.y(), n.x()};
}

// State of each node of the top: contact, slip and direction of friction, the force of the tool on it, and
// its place on the tool. The place is where it is held; when slipping, its place at the last load step.
struct State {
  VectorXd u;
  std::vector<char> active, slips;
  std::vector<int> side;
  std::vector<Vector2d> force, no_slip_at;
};

struct Result {
  bool converged = false;
  double force = 0.0, radius = 0.0, J_min = 0.0, between = 0.0;
  int iterations = 0;
};

class Scene {
 public:
  explicit Scene(const Options& o)
      : options_(o),
        laws_{law_of(o["mu"], o["nu"]), law_of(o["layer_mu"], o["nu"])},
        layer_from_(o["height"] - o["layer"]),
        mesh_(mesh_of(o)) {
    for (const Element& e : mesh_.element) points_.push_back(points_of(mesh_, e));
    held_.assign(2 * mesh_.X.size(), 0);
    for (std::size_t a = 0; a < mesh_.X.size(); ++a) {
      if (mesh_.X[a].x() < 1e-12) held_[2 * a] = 1;
      if (mesh_.X[a].y() < 1e-12) held_[2 * a + 1] = 1, held_[2 * a] |= o.base == "bonded";
    }
  }

  State undeformed() const {
    const std::size_t tops = mesh_.top.size();
    return {VectorXd::Zero(static_cast<Eigen::Index>(2 * mesh_.X.size())),
            std::vector<char>(tops, 0),
            std::vector<char>(tops, 1),
            std::vector<int>(tops, 0),
            std::vector<Vector2d>(tops, Vector2d::Zero()),
            std::vector<Vector2d>(tops, Vector2d::Zero())};
  }
  // Sinking of the middle of the top under the body's weight.
  double equilibrium_under_weight(State& s) {
    for (int k = 1; k <= 16; ++k) {
      weight_ = options_["weight"] * k / 16.0;
      if (!solve(s, -1e3).converged) return std::nan("");
    }
    return -s.u[2 * mesh_.top[0] + 1];
  }
  std::size_t nodes() const { return mesh_.X.size(); }

  // Slipping nodes are held at their present place from now on, as are those that have just come into
  // contact.
  void accept(State& s, double depth) const {
    const std::vector<Gap> gap = gaps(s.u, depth);
    for (std::size_t i = 0; i < gap.size(); ++i) {
      if (!s.active[i] || !s.slips[i]) continue;
      s.no_slip_at[i] = place(s.u, i, depth) - gap[i].value * gap[i].normal;
      s.slips[i] = options_.indenter == "slip" || s.side[i] != 0;
    }
  }

  // Solves by semismooth Newton from `s`.
  Result solve(State& s, double depth) const {
    for (int k = 0; k < 60; ++k) {
      Assembly tissue = assemble(mesh_, points_, laws_, layer_from_, s.u);
      if (!(tissue.J_min > 0.0)) return {};
      if (options_["film"] > 0.0) add_film(mesh_, options_["film"], s.u, tissue);
      if (weight_ > 0.0) add_weight(mesh_, points_, weight_, tissue);
      const std::vector<Gap> gap = gaps(s.u, depth);
      const bool changed = choose_active(s, gap, depth, k >= single_changes_after);
      const std::vector<Row> row = rows(s, gap, depth);
      VectorXd residual = tissue.force;
      double force = 0.0, worst = 0.0;
      for (std::size_t i = 0; i < gap.size(); ++i) {
        residual.segment<2>(2 * mesh_.top[i]) -= s.force[i];
        force += s.force[i][1];
      }
      for (Eigen::Index d = 0; d < residual.size(); ++d)
        if (held_[static_cast<std::size_t>(d)]) residual[d] = 0.0;
      for (const Row& one : row) worst = std::max(worst, std::abs(one.open));
      if (!changed && residual.norm() < 1e-5 * std::abs(force) + 1e-12 + 1e-6 * weight_ && worst < 1e-8)
        return found(s, depth, -force, tissue.J_min, k);
      if (!step(s, tissue, residual, gap, row)) return {};
    }
    return {};
  }

 private:
  static constexpr int single_changes_after = 8;  // Newton steps; then only one node at a time changes
  Options options_;
  std::array<Law, 2> laws_;
  double layer_from_, weight_ = 0.0;
  Mesh mesh_;
  std::vector<std::array<Point, 9>> points_;
  std::vector<char> held_;

  // Component of a node's place that the tool prescribes.
  struct Row {
    std::size_t i;
    Vector2d direction;
    Vector2d unit_forces;  // force of a unit multiplier
    double open;
  };
  double friction() const { return options_.indenter == "coulomb" ? options_["friction"] : 0.0; }

  // Nodes on the axis represent no part of the surface.
  bool may_contact(std::size_t i) const {
    const double r = mesh_.X[static_cast<std::size_t>(mesh_.top[i])].x();
    return r > 1e-9 && r < options_["body"] - 1e-9;
  }
  // Place of a node relative to the tool's tip.
  Vector2d place(const VectorXd& u, std::size_t i, double depth) const {
    const int a = mesh_.top[i];
    return mesh_.X[static_cast<std::size_t>(a)] + u.segment<2>(2 * a) -
           Vector2d(0.0, options_["height"] - depth);
  }
  std::vector<Gap> gaps(const VectorXd& u, double depth) const {
    std::vector<Gap> gap;
    for (std::size_t i = 0; i < mesh_.top.size(); ++i) gap.push_back(gap_of(options_, place(u, i, depth)));
    return gap;
  }

  bool choose_active(State& s, const std::vector<Gap>& gap, double depth, bool one) const {
    const double stiffness = laws_[0].mu * options_["fine"];
    std::vector<std::pair<double, std::size_t>> wrong;  // by how much
    for (std::size_t i = 0; i < gap.size(); ++i) {
      const double requested = s.force[i].dot(gap[i].normal) - stiffness * gap[i].value;
      if (may_contact(i) && (requested > 0.0) != static_cast<bool>(s.active[i]))
        wrong.emplace_back(-std::abs(requested), i);
    }
    const std::size_t of_contact = wrong.size();
    if (options_.indenter == "coulomb")
      for (std::size_t i = 0; i < gap.size(); ++i) {
        if (!s.active[i]) continue;
        const Vector2d along = turned(gap[i].normal);
        const double T = s.force[i].dot(along),
                     beyond = std::abs(T) - friction() * s.force[i].dot(gap[i].normal);
        const double pressed = s.side[i] * along.dot(place(s.u, i, depth) - s.no_slip_at[i]);
        if (!s.slips[i] && beyond > 1e-12) wrong.emplace_back(-beyond, i);
        if (s.slips[i] && pressed > 1e-9) wrong.emplace_back(-stiffness * pressed, i);
      }
    const std::vector<std::pair<double, std::size_t>> has_contact(
        wrong.begin(), wrong.begin() + static_cast<std::ptrdiff_t>(of_contact));
    std::sort(wrong.begin(), wrong.end());
    if (one && wrong.size() > 1) wrong.resize(1);
    for (const auto& one_wrong : wrong) {
      const std::size_t i = one_wrong.second;
      if (std::find(has_contact.begin(), has_contact.end(), one_wrong) != has_contact.end()) {
        s.active[i] = !s.active[i];
        s.slips[i] = 1;
        s.side[i] = 0;
        s.force[i].setZero();
        s.no_slip_at[i] = place(s.u, i, depth) - gap[i].value * gap[i].normal;
      } else if (s.active[i]) {
        const Vector2d n = gap[i].normal, along = turned(n);
        s.slips[i] = !s.slips[i];
        s.side[i] = s.force[i].dot(along) > 0.0 ? 1 : -1;
        if (s.slips[i]) s.force[i] = s.force[i].dot(n) * (n + friction() * s.side[i] * along);
      }
    }
    return !wrong.empty();
  }

  std::vector<Row> rows(const State& s, const std::vector<Gap>& gap, double depth) const {
    std::vector<Row> row;
    for (std::size_t i = 0; i < gap.size(); ++i) {
      if (!s.active[i]) continue;
      if (s.slips[i]) {
        const Vector2d n = gap[i].normal;
        row.push_back({i, n, n + friction() * s.side[i] * turned(n), gap[i].value});
        continue;
      }
      const Vector2d open = place(s.u, i, depth) - s.no_slip_at[i];
      row.push_back({i, Vector2d::UnitX(), Vector2d::UnitX(), open[0]});
      row.push_back({i, Vector2d::UnitY(), Vector2d::UnitY(), open[1]});
    }
    return row;
  }

  // Map from the normal to the force of a unit multiplier at a slipping node.
  Matrix2d with_friction(const State& s, std::size_t i) const {
    Matrix2d all = Matrix2d::Identity();
    all(0, 1) = -friction() * s.side[i];
    all(1, 0) = friction() * s.side[i];
    return all;
  }

  bool step(State& s, const Assembly& tissue, const VectorXd& residual, const std::vector<Gap>& gap,
            const std::vector<Row>& row) const {
    const auto n = s.u.size(), m = static_cast<Eigen::Index>(row.size());
    std::vector<Eigen::Triplet<double>> entry;
    entry.reserve(tissue.entry.size() + 1000);
    const auto free = [&](int d) { return !held_[static_cast<std::size_t>(d)]; };
    for (const auto& t : tissue.entry)
      if (free(t.row()) && free(t.col())) entry.push_back(t);
    VectorXd right(n + m);
    right.head(n) = -residual;
    for (Eigen::Index j = 0; j < m; ++j) {
      const Row& one = row[static_cast<std::size_t>(j)];
      const int dof = 2 * mesh_.top[one.i];
      right[n + j] = one.open;
      for (int a = 0; a < 2; ++a)
        if (free(dof + a)) {
          entry.emplace_back(dof + a, static_cast<int>(n + j), -one.unit_forces[a]);
          entry.emplace_back(static_cast<int>(n + j), dof + a, -one.direction[a]);
        }
      if (!s.slips[one.i]) continue;
      const double size = s.force[one.i].dot(one.direction);
      const Matrix2d turns = with_friction(s, one.i) * gap[one.i].curvature;
      for (int a = 0; a < 2; ++a)
        for (int b = 0; b < 2; ++b)
          if (free(dof + a) && free(dof + b)) entry.emplace_back(dof + a, dof + b, -size * turns(a, b));
    }
    for (int d = 0; d < n; ++d)
      if (!free(d)) entry.emplace_back(d, d, 1.0);
    SparseMatrix A(n + m, n + m);
    A.setFromTriplets(entry.begin(), entry.end());
    const Eigen::UmfPackLU<SparseMatrix> factor(A);
    if (factor.info() != Eigen::Success) return false;
    const VectorXd all = factor.solve(right);
    if (!all.allFinite()) return false;
    const double fraction =
        std::min(1.0, 2.0 * options_["fine"] / std::max(all.head(n).cwiseAbs().maxCoeff(), 1e-300));
    s.u += fraction * all.head(n);
    for (const Row& one : row) {
      const Eigen::Index j = &one - row.data();
      if (!s.slips[one.i]) {
        s.force[one.i] += fraction * all[n + j] * one.direction;
        continue;
      }
      const double size = s.force[one.i].dot(one.direction);
      const Vector2d moved = all.segment<2>(2 * mesh_.top[one.i]) * fraction;
      s.force[one.i] =
          (size + fraction * all[n + j]) * with_friction(s, one.i) *
          (one.direction + gap[one.i].curvature * moved).normalized();  // it rotates with the normal
    }
    return true;
  }

  Result found(const State& s, double depth, double force, double J_min, int iterations) const {
    Result result{true, force, 0.0, J_min, 0.0, iterations};
    for (std::size_t i = 0; i < s.active.size(); ++i)
      if (s.active[i]) result.radius = std::max(result.radius, place(s.u, i, depth).x());
    // Deepest penetration of the top into the tool between its nodes.
    for (std::size_t i = 0; i + 2 < mesh_.top.size(); i += 2)
      for (const double x : {-0.75, -0.5, -0.25, 0.25, 0.5, 0.75}) {
        const Vector2d at = 0.5 * x * (x - 1.0) * place(s.u, i, depth) +
                            (1.0 - x * x) * place(s.u, i + 1, depth) +
                            0.5 * x * (x + 1.0) * place(s.u, i + 2, depth);
        result.between = std::max(result.between, -gap_of(options_, at).value);
      }
    return result;
  }
};

int main(int count, char** word) {
  Options o;
  for (int k = 1; k < count; ++k) {
    const std::string text = word[k], name = text.substr(0, text.find('=')),
                      value = text.substr(text.find('=') + 1);
    if (name == "tool" || name == "base" || name == "touch")
      (name == "tool" ? o.tool : name == "base" ? o.base : o.indenter) = value;
    else if (o.named.count(name))
      o.named[name] = std::atof(value.c_str());
    else
      return std::fprintf(stderr, "no option is called %s\n", name.c_str()), 2;
  }
  Scene scene(o);
  State state = scene.undeformed();
  const double sunk = o["weight"] > 0.0 ? scene.equilibrium_under_weight(state) : 0.0;
  if (std::isnan(sunk)) return std::fprintf(stderr, "the body does not carry its weight\n"), 1;
  if (sunk > 0.0) std::fprintf(stderr, "sunk by %.5g mm\n", sunk);
  std::printf("depth_mm,force_N,contact_radius_mm,J_min,penetration_between_nodes_mm,nodes\n");
  const double longest = o["depth"] / o["steps"];
  double done = 0.0, step = longest / 8.0;
  for (int k = 1; k <= static_cast<int>(o["steps"]);) {
    const double to = k * longest, go = std::min(to - done, step), next = to - done <= step ? to : done + go;
    State tried = state;
    const Result found = scene.solve(tried, next + sunk);
    if (!found.converged) {
      step = 0.5 * go;
      if (step < longest / 1024.0) return std::fprintf(stderr, "no equilibrium beyond %g mm\n", done), 1;
      continue;
    }
    scene.accept(tried, next + sunk);
    state = std::move(tried);
    done = next;
    step = std::min(longest, 2.0 * step);
    if (next != to) continue;
    ++k;
    std::printf("%.5g,%.6g,%.5g,%.4f,%.2g,%zu\n", done, found.force, found.radius, found.J_min, found.between,
                scene.nodes());
    std::fflush(stdout);
  }
}
