// Walls and several rigid contacts at once, against closed forms.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "preprocess/supports/wall_surface.hpp"
#include "solver/equilibrium/relax.hpp"
#include "solver/solve.hpp"
#include "tests/helpers/block.hpp"

namespace dimple {
namespace {

const Vec3 size(30e-3, 30e-3, 20e-3);  // of the block [m]

// The half-space behind a plane through `at`, and what of the body faces it.
Touch plane(const Model& model, const std::string& name, const Vec3& at, const Vec3& normal) {
  return {.shape = {.kind = ToolShape::Kind::plane, .radius = 10e-3},
          .pose = {at, normal},
          .surface = wall_surface(
              model, [&](const Vec3&, const Vec3& outward) { return outward.dot(normal) < -0.9; }, 2000),
          .motion = Vec3::Zero().eval(),
          .name = name};
}

double root(const std::function<double(double)>& f, double lower, double upper) {
  for (int k = 0; k < 100; ++k) {
    const double middle = 0.5 * (lower + upper);
    ((f(middle) > 0.0) == (f(upper) > 0.0) ? upper : lower) = middle;
  }
  return 0.5 * (lower + upper);
}

// What symmetry needs: the middle slides in itself, about its own middle.
std::vector<HeldSet> symmetry(const Model& model) {
  HeldSet plane{.name = "plane", .node = {}, .hold = HeldSet::Hold::along, .direction = Vec3::UnitZ()},
      line{.name = "line", .node = {}, .hold = HeldSet::Hold::across, .direction = Vec3::UnitX()},
      point{.name = "point", .node = {}};
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 d = model.X.col(a) - 0.5 * size;
    if (std::abs(d.z()) > 1e-9) continue;
    (std::abs(d.y()) > 1e-9 ? plane : std::abs(d.x()) > 1e-9 ? line : point).node.push_back(a);
  }
  return {plane, line, point};
}

TEST(SeveralRigidContacts, PressABlockBetweenTwoPlatesAsAUniaxialTestDoes) {
  Model model = testing_bodies::averaged_block(4, 0.0);
  model.base.clear();
  const Material material = neo_hookean(1000.0, 0.45, 1000.0);
  const ForceSystem tissue(model, {{material}, model.tissue});
  Touch above = plane(model, "above", Vec3(0.0, 0.0, size.z()), -Vec3::UnitZ());
  above.motion.reset();
  std::vector<std::unique_ptr<TouchingTool>> rigid;
  Touch below = plane(model, "below", Vec3::Zero(), Vec3::UnitZ());
  below.motion = Vec3::UnitZ();
  rigid.push_back(std::make_unique<TouchingTool>(below));
  rigid.push_back(std::make_unique<TouchingTool>(above));
  System system(tissue, model, Constraints(model.node_count(), symmetry(model)), {}, std::move(rigid));
  ASSERT_EQ(system.walls().size(), 1u);
  EXPECT_EQ(system.touching()->touch().name, "above")
      << "the one that is measured, whichever was named first";
  const Relaxation relax(system);
  Rest rest = system.at_rest();
  Nodal f = rest.u;
  const double depth = 2e-3, l = 1.0 - 2.0 * depth / size.z();
  for (const double way : {1e-3, depth}) {
    system.set({.depth = way}, rest.u);
    const Relaxed found = relax.from_near(rest.u, rest.lambda, f, {});
    ASSERT_TRUE(found.converged) << way << ' ' << found.residual << ' ' << found.evaluations;
    system.accept_step(rest.u);
  }
  const auto F = [&](double wide) { return Mat3(Vec3(wide, wide, l).asDiagonal()); };
  const double wide =
      root([&](double w) { return pk1_stress(material, F(w))(0, 0); }, 1.0, 1.0 / std::sqrt(l) + 0.1);
  const double expected = -size.x() * size.y() * pk1_stress(material, F(wide))(2, 2);
  const Vec3 on_tool = system.touching()->touched().force, on_wall = system.walls().front()->touched().force;
  EXPECT_NEAR(on_tool.z(), expected, 2e-3 * expected);
  EXPECT_NEAR(on_wall.z(), -expected, 2e-3 * expected);
  EXPECT_LT((on_tool + on_wall).norm(), 1e-3 * expected);
  EXPECT_NEAR(system.along_push(f), expected, 2e-3 * expected);
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 X = model.X.col(a), u = rest.u.col(a).head<3>();
    EXPECT_LT((u - Vec3(wide - 1.0, wide - 1.0, l - 1.0).cwiseProduct(X - 0.5 * size)).norm(), 0.01 * depth)
        << X.transpose();
  }
}

// The same sides held: they slide in themselves.
std::vector<HeldSet> sides_held(const Model& model) {
  std::vector<HeldSet> sets = {
      {.name = "x", .node = {}, .hold = HeldSet::Hold::along, .direction = Vec3::UnitX()},
      {.name = "y", .node = {}, .hold = HeldSet::Hold::along, .direction = Vec3::UnitY()},
      {.name = "edges", .node = {}, .hold = HeldSet::Hold::across, .direction = Vec3::UnitZ()}};
  for (Index a = 0; a < model.node_count(); ++a) {
    const auto outside = [&](int d) { return model.X(d, a) < 1e-9 || model.X(d, a) > size[d] - 1e-9; };
    const int at = outside(0) + 2 * outside(1);
    if (at > 0) sets[static_cast<std::size_t>(at - 1)].node.push_back(a);
  }
  return sets;
}

TEST(Walls, ConfineAColumnThatItsOwnWeightShortens) {
  const Model model = testing_bodies::averaged_block(6, 0.1);
  const double g = 9.81, H = size.z();
  const Material sponge = neo_hookean(210.0, 0.3, 1000.0);
  const ForceSystem tissue(model, {{sponge}, model.tissue});
  const std::vector<Touch> walls = {
      plane(model, "-x", Vec3::Zero(), Vec3::UnitX()), plane(model, "+x", size, -Vec3::UnitX()),
      plane(model, "-y", Vec3::Zero(), Vec3::UnitY()), plane(model, "+y", size, -Vec3::UnitY())};
  const auto system =
      make_system(tissue, model, Contact::bonded, {}, {.gravity = Vec3(0.0, 0.0, -g), .pressure = {}}, 1e-4,
                  nullptr, nullptr, walls);
  const Nodal& u = system->at_rest().u;
  const auto held = make_system(tissue, model, Contact::bonded, sides_held(model),
                                {.gravity = Vec3(0.0, 0.0, -g), .pressure = {}});
  const auto confined = [&](double l) { return pk1_stress(sponge, Mat3(Vec3(1.0, 1.0, l).asDiagonal())); };
  const auto stretch = [&](double Z) {
    return root([&](double l) { return confined(l)(2, 2) + 1000.0 * g * (H - Z); }, 0.2, 1.2);
  };
  constexpr int parts = 400;
  const auto sinks = [&](double Z) {
    double sum = 0.0;
    for (int k = 0; k < parts; ++k) sum += (stretch(Z * (k + 0.5) / parts) - 1.0) * Z / parts;
    return sum;
  };
  double top = 0.0, count = 0.0;
  for (Index a = 0; a < model.node_count(); ++a) {
    EXPECT_LT((u.col(a) - held->at_rest().u.col(a)).norm(), 0.01 * std::abs(sinks(H)))
        << model.X.col(a).transpose();
    if (model.X(2, a) < H - 1e-9) continue;
    top += u(2, a);
    ++count;
  }
  EXPECT_NEAR(top / count, sinks(H), 0.01 * std::abs(sinks(H)));
  ASSERT_EQ(system->walls().size(), 4u);
  const ContactSurface& face = system->walls()[1]->touch().surface;
  EXPECT_GT(face.area.sum(), 0.9 * size.y() * H) << "all but what the base holds";
  double covered = 0.0, all = 0.0;
  for (Index s = 0; s < face.count(); ++s)
    covered -= confined(stretch(face.place(2, s)))(0, 0) * face.area[s];
  for (int k = 0; k < parts; ++k)
    all -= confined(stretch(H * (k + 0.5) / parts))(0, 0) * H * size.y() / parts;
  const Vec3 left = system->walls()[0]->touched().force, right = system->walls()[1]->touched().force;
  EXPECT_GT(right.x(), 0.99 * covered);
  EXPECT_LT(right.x(), 1.01 * all);
  EXPECT_NEAR(left.x(), -right.x(), 0.01 * all);
  EXPECT_LT(std::abs(right.z()), 1e-9 * all) << "without friction";
}

}  // namespace
}  // namespace dimple
