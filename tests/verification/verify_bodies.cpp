#include "tests/verification/verify_bodies.hpp"

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <map>
#include <random>

namespace dimple {
namespace {

using Nodal = ForceSystem::Nodal;

// Initial displacement of the free nodes as a fraction of the load's displacement; not the solution.
constexpr double guess = 0.9;

// Jacobian d place / d xi by central differences; exact for maps up to second order in each coordinate.
Mat3 jacobian(const Lattice& lattice, const Vec3& xi) {
  constexpr double h = 1e-4;
  Mat3 J;
  for (int d = 0; d < 3; ++d)
    J.col(d) = (lattice.place(xi + h * Vec3::Unit(d)) - lattice.place(xi - h * Vec3::Unit(d))) / (2.0 * h);
  return J;
}

// Moments of a part of a cell, summed over pieces that each have a second moment of their own.
struct Part {
  double volume = 0.0;
  Vec3 first = Vec3::Zero();
  Mat3 second = Mat3::Zero();
  void add(const Vec3& x, double v, const Mat3& own) {
    volume += v;
    first += v * x;
    second += v * (x * x.transpose() + own);
  }
};

std::map<int, Part> parts_of_cell(const Lattice& lattice, const Vec3& lower, const Vec3& size) {
  std::map<int, Part> parts;
  bool mixed = false;
  int tissue = 0;
  if (lattice.tissue) {
    // Points just inside of the corners, so that an interface at its boundary does not split a cell.
    tissue = lattice.tissue(lattice.place(lower + 0.5 * size));
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 fraction(corner & 1 ? 0.999 : 0.001, corner & 2 ? 0.999 : 0.001, corner & 4 ? 0.999 : 0.001);
      mixed = mixed || lattice.tissue(lattice.place(lower + fraction.cwiseProduct(size))) != tissue;
    }
  }
  const auto each = [&](const auto& place, const auto& weight, bool boxes) {
    for (std::size_t k = 0; k < place.size(); ++k)
      for (std::size_t j = 0; j < place.size(); ++j)
        for (std::size_t i = 0; i < place.size(); ++i) {
          const Vec3 xi = lower + Vec3(place[i], place[j], place[k]).cwiseProduct(size);
          const Mat3 J = jacobian(lattice, xi);
          const Vec3 x = lattice.place(xi);
          Mat3 own = Mat3::Zero();
          if (boxes)
            own = J *
                  Vec3((0.5 / static_cast<double>(place.size()) * size).array().square() / 3.0).asDiagonal() *
                  J.transpose();
          parts[boxes ? lattice.tissue(x) : tissue].add(
              x, weight[i] * weight[j] * weight[k] * size.prod() * J.determinant(), own);
        }
  };
  if (mixed) {
    std::array<double, 8> place, weight;
    for (std::size_t k = 0; k < 8; ++k) {
      place[k] = (static_cast<double>(k) + 0.5) / 8.0;
      weight[k] = 1.0 / 8.0;
    }
    each(place, weight, true);
  } else {
    const double g = std::sqrt(0.15);
    each(std::array{0.5 - g, 0.5, 0.5 + g}, std::array{5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0}, false);
  }
  return parts;
}

}  // namespace

LatticeBody make_lattice(const Lattice& lattice) {
  LatticeBody body;
  Discretisation& places = body.places;
  const Eigen::Array3i n = lattice.intervals;
  const Index count = (n + 1).prod();
  body.at.resize(3, count);
  places.X.resize(3, count);
  places.spacing.resize(count);
  std::mt19937 random(lattice.seed);
  // std::uniform_real_distribution is avoided, since its numbers differ between libraries.
  const auto noise = [&] { return lattice.jitter * (static_cast<double>(random()) / 2147483648.0 - 1.0); };
  Index a = 0;
  for (int k = 0; k <= n[2]; ++k)
    for (int j = 0; j <= n[1]; ++j)
      for (int i = 0; i <= n[0]; ++i) {
        const Eigen::Array3i at(i, j, k);
        Vec3 xi;
        for (int d = 0; d < 3; ++d) {
          xi[d] = at[d] == n[d] ? 1.0 : static_cast<double>(at[d]) / n[d];
          if (at[d] > 0 && at[d] < n[d] && lattice.jitter > 0.0) xi[d] += noise() / n[d];
        }
        body.at.col(a) = xi;
        places.X.col(a) = lattice.place(xi);
        const Mat3 J = jacobian(lattice, xi);
        places.spacing[a++] =
            std::sqrt((J.colwise().norm().array() / n.cast<double>().transpose()).square().mean());
      }

  std::vector<Part> parts;
  std::vector<int> tissue;
  const Vec3 size = lattice.cells.cast<double>().inverse();
  for (int k = 0; k < lattice.cells[2]; ++k)
    for (int j = 0; j < lattice.cells[1]; ++j)
      for (int i = 0; i < lattice.cells[0]; ++i)
        for (const auto& [number, part] : parts_of_cell(lattice, Vec3(i, j, k).cwiseProduct(size), size)) {
          parts.push_back(part);
          tissue.push_back(number);
        }
  const auto points = static_cast<Index>(parts.size());
  places.point.resize(3, points);
  places.volume.resize(points);
  places.second_moments.resize(6, points);
  places.label = Eigen::Map<Eigen::VectorXi>(tissue.data(), points);
  for (Index q = 0; q < points; ++q) {
    const Part& part = parts[static_cast<std::size_t>(q)];
    const Vec3 x = part.first / part.volume;
    const Mat3 s = part.second / part.volume - x * x.transpose();
    places.point.col(q) = x;
    places.volume[q] = part.volume;
    set_moments(places.second_moments, q, s);
  }
  // Surface of six faces; each face of a cell on them is a square of two triangles.
  std::vector<Vec3> corner;
  std::vector<std::array<Index, 3>> triangle;
  for (int axis = 0; axis < 3; ++axis)
    for (const double side : {0.0, 1.0}) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      const Index first = static_cast<Index>(corner.size()), across = lattice.cells[u] + 1;
      for (int j = 0; j <= lattice.cells[v]; ++j)
        for (int i = 0; i <= lattice.cells[u]; ++i) {
          Vec3 xi;
          xi[axis] = side;
          xi[u] = static_cast<double>(i) / lattice.cells[u];
          xi[v] = static_cast<double>(j) / lattice.cells[v];
          corner.push_back(lattice.place(xi));
        }
      for (int j = 0; j < lattice.cells[v]; ++j)
        for (int i = 0; i < lattice.cells[u]; ++i) {
          const Index a0 = first + i + across * j, a1 = a0 + 1, a2 = a0 + across + 1, a3 = a0 + across;
          if (side == 1.0) {
            triangle.push_back({a0, a1, a2});
            triangle.push_back({a0, a2, a3});
          } else {
            triangle.push_back({a0, a2, a1});
            triangle.push_back({a0, a3, a2});
          }
        }
    }
  Points vertex(3, static_cast<Index>(corner.size()));
  Triangles triangles(3, static_cast<Index>(triangle.size()));
  for (std::size_t k = 0; k < corner.size(); ++k) vertex.col(static_cast<Index>(k)) = 1e3 * corner[k];
  for (std::size_t k = 0; k < triangle.size(); ++k)
    for (int c = 0; c < 3; ++c)
      triangles(c, static_cast<Index>(k)) =
          static_cast<Triangles::Scalar>(triangle[k][static_cast<std::size_t>(c)]);
  places.surface = {std::move(vertex), std::move(triangles)};
  return body;
}

Lattice box_lattice(const Vec3& size, int intervals, double jitter) {
  const Eigen::Array3d n = (size.array() / size.minCoeff() * intervals).round();
  return {.place = [size](const Vec3& xi) -> Vec3 { return size.cwiseProduct(xi); },
          .intervals = n.cast<int>(),
          .cells = (1.75 * n).round().cast<int>(),
          .jitter = jitter,
          .tissue = {}};
}

// Dead loads that need not be proportional to the fraction of the load.
class FractionOfLoad : public ForceTerm {
 public:
  explicit FractionOfLoad(std::function<Points(double)> force) : force_(std::move(force)) {}
  void add_force(const Nodal&, const Instant& now, Nodal& f) override {
    f.topRows<3>() -= force_(now.fraction);
  }
  double energy(const Nodal& u, const Instant& now) override {
    return -force_(now.fraction).cwiseProduct(u.topRows<3>()).sum();
  }

 private:
  std::function<Points(double)> force_;
};

Statics::Statics(LatticeBody body, std::vector<HeldSet> held, std::vector<Material> material)
    : body_(std::move(body)), constraints_(body_.places.node_count(), std::move(held)) {
  for (Index a = 0; a < body_.places.node_count(); ++a)
    if (!constraints_.is_free(a)) body_.places.base.push_back(a);
  std::vector<double> density;
  for (const Material& m : material) density.push_back(m.density);
  model_ = make_model(body_.places, converging, body_.places.label, density);
  system_ = std::make_unique<ForceSystem>(model_, Tissues{std::move(material), model_.tissue});
}

Equilibrium Statics::solve(const Load& load, int steps, double tolerance) const {
  const Index n = model().node_count();
  ForceTerms loads;
  if (load.force) loads.push_back(std::make_unique<FractionOfLoad>(load.force));
  System body(*system_, model(), constraints_, std::move(loads));
  const Relaxation relax(body);
  Equilibrium result{guess * to_nodal(load.displacement(1.0 / steps)), Nodal::Zero(4, n)};
  for (int step = 1; step <= steps; ++step) {
    const double fraction = static_cast<double>(step) / steps;
    if (step > 1) result.u *= static_cast<double>(step) / (step - 1);
    const Nodal requested = to_nodal(load.displacement(fraction));
    constraints_.apply_dirichlet(result.u, requested);
    body.set({.fraction = fraction});
    relax(result.u, result.f, {.tolerance = tolerance, .evaluations = 60000});
  }
  body.tissue().internal_force(result.u, result.f);
  return result;
}

HeldSet fixed_nodes(const LatticeBody& body, const std::function<bool(Index)>& chosen) {
  HeldSet set{.name = "fixed", .node = {}};
  for (Index a = 0; a < body.places.node_count(); ++a)
    if (chosen(a)) set.node.push_back(a);
  return set;
}

HeldSet sliding_nodes(const LatticeBody& body, const std::function<bool(Index)>& chosen) {
  HeldSet set = fixed_nodes(body, chosen);
  set.name = "sliding";
  set.hold = HeldSet::Hold::along;
  set.direction = Vec3::UnitZ();
  return set;
}

std::vector<HeldSet> boundary_fixed(const LatticeBody& body) {
  return {fixed_nodes(body, [&](Index a) { return body.on_boundary(a); })};
}

Points affine_displacement(const Model& model, const Mat3& F) {
  return (F - Mat3::Identity()) * model.X;
}

Mat3 mean_stress(const Model& model, const Nodal& f) {
  return f.topRows<3>() * model.X.transpose() / model.volume.sum();
}

Vec3 face_force(const LatticeBody& body, const Nodal& f, int axis, double value) {
  Vec3 sum = Vec3::Zero();
  for (Index a = 0; a < f.cols(); ++a)
    if (body.on_face(a, axis, value)) sum += f.col(a).head<3>();
  return sum;
}

double root(double low, double high, const std::function<double(double)>& value) {
  for (int k = 0; k < 100; ++k) {
    const double middle = 0.5 * (low + high);
    (value(middle) < 0.0 ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

VerifyCase compared(std::string name, std::string what, double ours, double reference, double tolerance,
                    std::string unit, std::string source) {
  const double error = std::abs(ours - reference) / std::abs(reference);
  return {.name = std::move(name),
          .what = std::move(what),
          .ours = ours,
          .reference = reference,
          .error = error,
          .tolerance = tolerance,
          .unit = std::move(unit),
          .source = std::move(source),
          .passed = error <= tolerance};
}

VerifyCase order_reached(std::string name, std::string what, double ours, double expected, double tolerance,
                         std::string source) {
  VerifyCase row =
      compared(std::move(name), std::move(what), ours, expected, tolerance, "", std::move(source));
  row.error = std::max(0.0, (expected - ours) / expected);
  row.passed = row.error <= tolerance;
  return row;
}

}  // namespace dimple
