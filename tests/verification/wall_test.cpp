// Walls, and several rigid contacts at once, against closed forms.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numeric>

#include "preprocess/scene/wall_field.hpp"
#include "preprocess/supports/wall_surface.hpp"
#include "solver/equilibrium/relax.hpp"
#include "tests/helpers/block.hpp"
#include "tests/helpers/marched.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

const Vec3 size(30e-3, 30e-3, 20e-3);  // of the block [m]

// Half-space behind a plane through `at`, and the part of the body that faces it.
RigidBody plane(const Model& model, const std::string& name, const Vec3& at, const Vec3& normal) {
  return {.shape = plane_shape(10e-3),
          .pose = {at, normal},
          .surface = wall_surface(
              model, [&](const Vec3&, const Vec3& outward) { return outward.dot(normal) < -0.9; }, 2000),
          .motion = Vec3::Zero().eval(),
          .name = name};
}

// Walls at the sides of the block.
std::vector<RigidBody> four_sides(const Model& model) {
  return {plane(model, "-x", Vec3::Zero(), Vec3::UnitX()), plane(model, "+x", size, -Vec3::UnitX()),
          plane(model, "-y", Vec3::Zero(), Vec3::UnitY()), plane(model, "+y", size, -Vec3::UnitY())};
}

std::unique_ptr<System> undeformed(const ForceSystem& tissue, const Model& model, const Loads& loads,
                                   const std::vector<RigidBody>& walls, double tolerance = 1e-4,
                                   const std::vector<HeldSet>& held = {}) {
  return make_system(tissue, model, Contact::bonded, held, loads, tolerance, nullptr, nullptr, walls);
}
Loads downwards(double g) {
  return {.gravity = Vec3(0.0, 0.0, -g), .pressure = {}};
}

double root(const std::function<double(double)>& f, double lower, double upper) {
  for (int k = 0; k < 100; ++k) {
    const double middle = 0.5 * (lower + upper);
    ((f(middle) > 0.0) == (f(upper) > 0.0) ? upper : lower) = middle;
  }
  return 0.5 * (lower + upper);
}

// Symmetry conditions: the middle plane slides in itself, about its own middle.
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
  RigidBody above = plane(model, "above", Vec3(0.0, 0.0, size.z()), -Vec3::UnitZ());
  above.motion.reset();
  std::vector<std::unique_ptr<RigidContact>> rigid;
  RigidBody below = plane(model, "below", Vec3::Zero(), Vec3::UnitZ());
  below.motion = Vec3::UnitZ();
  rigid.push_back(std::make_unique<RigidContact>(below));
  rigid.push_back(std::make_unique<RigidContact>(above));
  System system(tissue, model, Constraints(model.node_count(), symmetry(model)), {}, std::move(rigid));
  ASSERT_EQ(system.walls().size(), 1u);
  EXPECT_EQ(system.tool_contact()->body().name, "above")
      << "the one that is measured, whichever was named first";
  const Relaxation relax(system);
  EquilibriumState state = system.step_start();
  Nodal f = state.u;
  const double depth = 2e-3, l = 1.0 - 2.0 * depth / size.z();
  for (const double displacement : {1e-3, depth}) {
    system.set({.depth = displacement}, state.u);
    const Relaxed found = relax.from_near(state.u, state.lambda, f, {});
    ASSERT_TRUE(found.converged) << displacement << ' ' << found.residual << ' ' << found.evaluations;
    system.accept_step(state.u);
  }
  const auto F = [&](double wide) { return Mat3(Vec3(wide, wide, l).asDiagonal()); };
  const double wide =
      root([&](double w) { return pk1_stress(material, F(w))(0, 0); }, 1.0, 1.0 / std::sqrt(l) + 0.1);
  const double expected = -size.x() * size.y() * pk1_stress(material, F(wide))(2, 2);
  const Vec3 on_tool = system.tool_contact()->contact_summary().force,
             on_wall = system.walls().front()->contact_summary().force;
  EXPECT_NEAR(on_tool.z(), expected, 2e-3 * expected);
  EXPECT_NEAR(on_wall.z(), -expected, 2e-3 * expected);
  EXPECT_LT((on_tool + on_wall).norm(), 1e-3 * expected);
  EXPECT_NEAR(system.along_approach(f), expected, 2e-3 * expected);
  for (Index a = 0; a < model.node_count(); ++a) {
    const Vec3 X = model.X.col(a), u = state.u.col(a).head<3>();
    EXPECT_LT((u - Vec3(wide - 1.0, wide - 1.0, l - 1.0).cwiseProduct(X - 0.5 * size)).norm(), 0.01 * depth)
        << X.transpose();
  }
}

// Conditions that replace four walls: the sides slide in their planes.
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

// Column confined at its sides, with a stretch along z alone: its stress, the stretch under a load [Pa], and
// the sinking of a point at height Z under given stretches below it.
Mat3 confined_stress(const Material& sponge, double l) {
  return pk1_stress(sponge, Mat3(Vec3(1.0, 1.0, l).asDiagonal()));
}
double confined_stretch(const Material& sponge, double load) {
  return root([&](double l) { return confined_stress(sponge, l)(2, 2) + load; }, 0.2, 1.2);
}
constexpr int parts = 400;
double sunk(const std::function<double(double)>& stretch, double Z) {
  double sum = 0.0;
  for (int k = 0; k < parts; ++k) sum += (stretch(Z * (k + 0.5) / parts) - 1.0) * Z / parts;
  return sum;
}

TEST(Walls, ConfineAColumnThatItsOwnWeightShortens) {
  const Model model = testing_bodies::averaged_block(6, 0.1);
  const double g = 9.81, H = size.z();
  const Material sponge = neo_hookean(210.0, 0.3, 1000.0);
  const ForceSystem tissue(model, {{sponge}, model.tissue});
  const auto system = undeformed(tissue, model, downwards(g), four_sides(model));
  const Nodal& u = system->step_start().u;
  const auto held = undeformed(tissue, model, downwards(g), {}, 1e-4, sides_held(model));
  const auto stretch = [&](double Z) { return confined_stretch(sponge, 1000.0 * g * (H - Z)); };
  const auto sinks = [&](double Z) { return sunk(stretch, Z); };
  double top = 0.0, count = 0.0;
  for (Index a = 0; a < model.node_count(); ++a) {
    EXPECT_LT((u.col(a) - held->step_start().u.col(a)).norm(), 0.01 * std::abs(sinks(H)))
        << model.X.col(a).transpose();
    if (model.X(2, a) < H - 1e-9) continue;
    top += u(2, a);
    ++count;
  }
  EXPECT_NEAR(top / count, sinks(H), 0.01 * std::abs(sinks(H)));
  ASSERT_EQ(system->walls().size(), 4u);
  const ContactSurface& face = system->walls()[1]->body().surface;
  EXPECT_GT(face.area.sum(), 0.9 * size.y() * H) << "all but what the base holds";
  double covered = 0.0, all = 0.0;
  for (Index s = 0; s < face.count(); ++s)
    covered -= confined_stress(sponge, stretch(face.place(2, s)))(0, 0) * face.area[s];
  for (int k = 0; k < parts; ++k)
    all -= confined_stress(sponge, stretch(H * (k + 0.5) / parts))(0, 0) * H * size.y() / parts;
  const Vec3 left = system->walls()[0]->contact_summary().force,
             right = system->walls()[1]->contact_summary().force;
  EXPECT_GT(right.x(), 0.99 * covered);
  EXPECT_LT(right.x(), 1.01 * all);
  EXPECT_NEAR(left.x(), -right.x(), 0.01 * all);
  EXPECT_LT(std::abs(right.z()), 1e-9 * all) << "without friction";
}

// P(l(Z)) = -rho_fluid g (H - max(Z, L)): buoyancy is lost above the level, and nothing changes below it.
TEST(FluidLost, ShortensAConfinedColumnByTheBuoyancyOfWhatIsAboveItsLevel) {
  const Model model = testing_bodies::averaged_block(6, 0.1);
  const double H = size.z(), level = 8.5e-3;
  const Material sponge = neo_hookean(210.0, 0.3, 1000.0);
  const ForceSystem tissue(model, {{sponge}, model.tissue});
  Loads loads;
  loads.fluid = FluidLost{.up = Vec3::UnitZ(), .level = level, .density = 1100.0};
  const auto system = undeformed(tissue, model, loads, {}, 1e-4, sides_held(model));
  const auto stretch = [&](double Z) {
    return confined_stretch(sponge, 1100.0 * 9.81 * (H - std::max(Z, level)));
  };
  const auto sinks = [&](double Z) { return sunk(stretch, Z); };
  EXPECT_GT(stretch(0.0), 0.6);
  std::map<double, std::vector<double>> by_height;  // sinking at about that height, less the expected one
  for (Index a = 0; a < model.node_count(); ++a)
    by_height[std::round(6.0 * model.X(2, a) / H)].push_back(system->step_start().u(2, a) -
                                                             sinks(model.X(2, a)));
  for (const auto& [layer, off] : by_height)
    EXPECT_NEAR(std::accumulate(off.begin(), off.end(), 0.0) / static_cast<double>(off.size()), 0.0,
                0.015 * std::abs(sinks(H)))
        << layer;
  const double all = lost_buoyancy(model, *loads.fluid).row(2).sum();
  EXPECT_NEAR(all, -1100.0 * 9.81 * size.x() * size.y() * (H - level), 0.01 * std::abs(all));
}

// Walls overlap the body at rest, as surfaces of neighbouring labels do.
TEST(Walls, ThatLieInTheBodyAtRestAndAreSetBackByAsMuchHaveContactAndPressNothing) {
  const Model model = testing_bodies::averaged_block(4, 0.1);
  const ForceSystem tissue(model, {{neo_hookean(210.0, 0.3, 1000.0)}, model.tissue});
  const auto preloaded = [&](double in, double back) {
    std::vector<RigidBody> walls = {plane(model, "-x", Vec3(in, 0.0, 0.0), Vec3::UnitX()),
                                    plane(model, "+x", size - Vec3(in, 0.0, 0.0), -Vec3::UnitX())};
    for (RigidBody& wall : walls) {
      wall.gap_offset.setConstant(wall.surface.count(), back);
      wall.gap_offset_between.setConstant(wall.surface.between.cols(), back);
    }
    return undeformed(tissue, model, downwards(5.0), walls, 1e-5);
  };
  const auto next_to = preloaded(0.0, 0.0), overlapping = preloaded(0.4e-3, 0.4e-3);
  const double sinks = next_to->step_start().u.colwise().norm().maxCoeff();
  EXPECT_LT((overlapping->step_start().u - next_to->step_start().u).cwiseAbs().maxCoeff(), 0.005 * sinks);
  const RigidContact& wall = *overlapping->walls().front();
  EXPECT_GT(wall.contact_summary().samples, 10);
  EXPECT_LT(wall.audit(overlapping->step_start().u, overlapping->now()).penetration, 0.1e-3);
}

TEST(Walls, SeparateFromAColumnThatHangsAndNeverPullAtIt) {
  const Model model = testing_bodies::averaged_block(4, 0.1);
  const ForceSystem tissue(model, {{neo_hookean(210.0, 0.45, 1000.0)}, model.tissue});
  const std::vector<RigidBody> walls = {plane(model, "-x", Vec3::Zero(), Vec3::UnitX()),
                                        plane(model, "+x", size, -Vec3::UnitX())};
  const auto between = undeformed(tissue, model, downwards(-4.0), walls, 1e-5);
  const auto alone = undeformed(tissue, model, downwards(-4.0), {}, 1e-5);
  const double longest = alone->step_start().u.colwise().norm().maxCoeff();
  EXPECT_GT(longest, 0.5e-3);
  EXPECT_LT((between->step_start().u - alone->step_start().u).cwiseAbs().maxCoeff(), 0.01 * longest);
  double all = 0.0;
  for (const RigidContact* wall : between->walls()) {
    EXPECT_GE(wall->forces().minCoeff(), 0.0);
    all += wall->forces().sum();
  }
  EXPECT_LT(all, 1e-3 * model.mass.sum() * 4.0);
}

// All of its top is pressed, so that nothing detaches, and the bed acts like a sliding face.
TEST(Walls, BelowABodyThatNothingElseHoldsAreAsABaseThatSlides) {
  Model model = testing_bodies::averaged_block(5, 0.1);
  const HeldSet slides{
      .name = "slides", .node = model.base, .hold = HeldSet::Hold::along, .direction = Vec3::UnitZ()};
  model.base.clear();
  model.bonded_patch.clear();
  for (Index a = 0; a < model.node_count(); ++a)
    if (model.X(2, a) > size.z() - 1e-9) model.bonded_patch.push_back(a);
  model.tool = {.centre = Vec3(0.5 * size.x(), 0.5 * size.y(), size.z()),
                .approach = -Vec3::UnitZ(),
                .radius = 0.5 * size.x()};
  const ForceSystem tissue(model, {{neo_hookean(1000.0, 0.45, 1000.0)}, model.tissue});
  const auto pressed = [&](bool on_bed) {
    Loading loading{.depth = 2e-3};
    if (on_bed)
      loading.walls = {plane(model, "bed", Vec3::Zero(), Vec3::UnitZ())};
    else
      loading.further = {slides};
    return marched(tissue, model, loading, {.frames = 2});
  };
  const History bed = pressed(true), sliding = pressed(false);
  const double force = sliding.force.back().force;
  EXPECT_NEAR(bed.force.back().force, force, 0.005 * force);
  EXPECT_NEAR(-bed.walls.front().force.z(), force, 0.005 * force) << "all of it goes into the bed";
  EXPECT_LT(bed.walls.front().force.head<2>().norm(), 1e-9 * force) << "without friction";
  EXPECT_NEAR(bed.walls.front().area, size.x() * size.y(), 0.01 * size.x() * size.y());
}

// Its lower face is pressed everywhere, so that the bed acts like a sliding base.
TEST(Walls, CarryTheWeightOfABlockThatNothingElseHolds) {
  Model model = testing_bodies::averaged_block(5, 0.1);
  const HeldSet slides{
      .name = "slides", .node = model.base, .hold = HeldSet::Hold::along, .direction = Vec3::UnitZ()};
  model.base.clear();
  model.bonded_patch.clear();
  const ForceSystem tissue(model, {{neo_hookean(1000.0, 0.45, 1000.0)}, model.tissue});
  const auto on_bed =
      undeformed(tissue, model, downwards(9.81), {plane(model, "bed", Vec3::Zero(), Vec3::UnitZ())});
  const auto sliding = undeformed(tissue, model, downwards(9.81), {}, 1e-4, {slides});
  const double newtons = 9.81 * model.mass.sum();
  const RigidContact::ContactSummary bed = on_bed->walls().front()->contact_summary();
  EXPECT_NEAR(bed.force.z(), -newtons, 1e-3 * newtons);
  EXPECT_LT(bed.force.head<2>().norm(), 1e-9 * newtons) << "without friction";
  const auto sinks = [&](const System& system) {  // on average
    return -system.step_start().u.row(2).dot(model.mass) / model.mass.sum();
  };
  EXPECT_GT(sinks(*sliding), 0.02 * size.z());
  EXPECT_NEAR(sinks(*on_bed), sinks(*sliding), 0.01 * sinks(*sliding));
}

TEST(Walls, WithoutSlipHoldTheSidesOfAColumnThatSinks) {
  const Model model = testing_bodies::averaged_block(5, 0.1);
  const ForceSystem tissue(model, {{neo_hookean(210.0, 0.4, 1000.0)}, model.tissue});
  std::vector<RigidBody> walls = four_sides(model);
  // Mean sinking along the walls, at half their height, where they are pressed.
  const auto sinks_next_to = [&](double friction) {
    for (RigidBody& wall : walls) wall.friction = friction;
    const auto system = undeformed(tissue, model, downwards(9.81), walls);
    double sum = 0.0, count = 0.0;
    for (const HeldSet& set : sides_held(model))
      for (const Index a : set.node)
        if (std::abs(model.X(2, a) - 0.5 * size.z()) < 0.15 * size.z()) {
          sum -= system->step_start().u(2, a);
          ++count;
        }
    for (const RigidContact* wall : system->walls())
      for (Index s = 0; s < wall->count(); ++s)
        if (friction > 0.0 && std::isfinite(friction)) {
          EXPECT_LE(wall->friction_forces().col(s).norm(), 1.001 * friction * wall->forces()[s]);
        }
    return sum / count;
  };
  const double slides = sinks_next_to(0.0);
  EXPECT_GT(slides, 0.5e-3);
  const double frictional = sinks_next_to(0.2);
  EXPECT_LT(frictional, 0.9 * slides);
  EXPECT_LT(sinks_next_to(std::numeric_limits<double>::infinity()), std::min(0.15 * slides, frictional));
}

// A ball of 5 mm is pressed on a layer.
TEST(Walls, ThatAreMovedPressAsTheToolThatIsMeasuredDoes) {
  const Model model =
      model_with_tool(block_surface({-20, -20, 0}, {20, 20, 20}), {.nodes = 800, .contact_radius = 2.7});
  const ForceSystem tissue(model, {{neo_hookean(210.0, 0.49, 1000.0)}, model.tissue}, Precision::double_);
  const Vec3 top(0.0, 0.0, 20e-3);
  RigidBody ball{.shape = sphere_shape(5e-3), .pose = {top, -Vec3::UnitZ()}, .surface = {}};
  ball.surface = wall_surface(
      model, [&](const Vec3& x, const Vec3& n) { return n.z() > 0.5 && (x - top).norm() < 7e-3; }, 2000);
  const auto force = [&](const RigidBody& indenter) {
    std::vector<std::unique_ptr<RigidContact>> rigid;
    rigid.push_back(std::make_unique<RigidContact>(indenter));
    System system(tissue, model, make_constraints(model, Contact::bonded, {}), {}, std::move(rigid));
    EquilibriumState state = system.step_start();
    Nodal f = state.u;
    const Relaxation relax(system);
    for (const double depth : {0.5e-3, 1e-3, 1.5e-3}) {
      system.set({.depth = depth}, state.u);
      EXPECT_TRUE(relax.from_near(state.u, state.lambda, f, {}).converged) << depth;
      system.accept_step(state.u);
    }
    return system.contacts().front().rigid->contact_summary().force.z();
  };
  const double measured = force(ball);
  RigidBody moved = ball;
  moved.motion = -Vec3::UnitZ();
  EXPECT_NEAR(force(moved), measured, 0.005 * measured);
  // The ball is also given by a distance field, like a wall.
  const BodySurface drawn = cut_ellipsoid_surface(Vec3::Constant(5.0), -4.999);
  auto field = std::make_shared<DistanceGrid>(
      wall_field(drawn, false, Vec3::Constant(-9.0), Vec3::Constant(9.0), 0.2, 4.0));
  moved.shape = field_shape(field);
  moved.pose.tip = top + Vec3(0.0, 0.0, 5e-3);  // origin of its frame
  EXPECT_NEAR(force(moved), measured, 0.02 * measured);
}

// A tool and a wall with friction, a following pressure and weight, which all have a history.
class ABodyUnderLoads : public testing::TestWithParam<bool> {};

TEST_P(ABodyUnderLoads, IsPressedByTheSameBitsWhetherItComesToRestOnceOrTwice) {
  const Model model = model_with_tool(block_surface({-20, -20, 0}, {20, 20, 20}),
                                      {.nodes = 500, .contact_radius = 2.7, .whole_patch = false});
  Material material = neo_hookean(2100.0, 0.49, 1000.0);
  if (GetParam()) material.prony = {{.g = 0.4, .tau = 0.5}};
  const ForceSystem tissue(model, {{material}, model.tissue}, Precision::double_);
  RigidBody ball{
      .shape = sphere_shape(5e-3),
      .pose = {Vec3(0.0, 0.0, 20e-3), -Vec3::UnitZ()},
      .surface = wall_surface(
          model, [](const Vec3& x, const Vec3& n) { return n.z() > 0.5 && x.head<2>().norm() < 9e-3; }, 2000),
      .friction = 0.3};
  RigidBody next_to = plane(model, "beside", Vec3(20e-3, 0.0, 0.0), -Vec3::UnitX());
  next_to.friction = 0.2;
  Loading loading{.depth = 1.5e-3};
  loading.indenter = std::make_shared<const RigidBody>(ball);
  loading.walls = {next_to};
  loading.loads.gravity = {2.0, 0.0, -9.81};
  loading.loads.pressure = {{.patch = surface_patch(model, triangles_facing(model, -Vec3::UnitY())),
                             .pressure = 50.0,
                             .follows = true}};
  equilibrium_under_loads(tissue, model, loading);
  ASSERT_TRUE(loading.preloaded);
  Loading fresh = loading;
  fresh.preloaded = nullptr;
  const History once = marched(tissue, model, loading, {.frames = 2}),
                twice = marched(tissue, model, fresh, {.frames = 2});
  EXPECT_GT(once.preload_displacement, 1e-4) << "they do move it";
  EXPECT_GT(once.walls.front().samples, 0);
  const double dissipation = once.contact_dissipation + once.walls.front().dissipation;
  EXPECT_GT(once.walls.front().dissipation, 0.0);
  if (!GetParam())
    EXPECT_NEAR(dissipation, once.energy.back().dissipated, 1e-9 * dissipation)
        << "that of the loads is told nowhere";
  EXPECT_EQ(once.evaluations, twice.evaluations);
  ASSERT_EQ(once.force.size(), twice.force.size());
  for (std::size_t k = 0; k < once.force.size(); ++k) {
    EXPECT_EQ(once.force[k].force, twice.force[k].force) << k;
    EXPECT_EQ(once.force[k].base_force, twice.force[k].base_force) << k;
  }
  ASSERT_EQ(once.energy.size(), twice.energy.size());
  for (std::size_t k = 0; k < once.energy.size(); ++k) {
    EXPECT_EQ(once.energy[k].stored, twice.energy[k].stored) << k;
    EXPECT_EQ(once.energy[k].dissipated, twice.energy[k].dissipated) << k;
  }
}
INSTANTIATE_TEST_SUITE_P(ElasticAndViscous, ABodyUnderLoads, testing::Bool());

TEST(WallField, IsTheDistanceFromTheSurfaceInsideOutWhereItIsHollow) {
  const BodySurface ball = cut_ellipsoid_surface(Vec3::Constant(20.0), -19.999);
  const Vec3 far = Vec3::Constant(30.0);
  const DistanceGrid solid = wall_field(ball, false, -far, far, 1.0, 8.0),
                     hollow = wall_field(ball, true, -far, far, 1.0, 8.0);
  const Vec3 out = Vec3(1.0, 2.0, 2.0) / 3.0;
  for (const double r : {14e-3, 18e-3, 20e-3, 22e-3, 26e-3}) {
    const Distance from = distance_in(solid, r * out), within = distance_in(hollow, r * out);
    EXPECT_NEAR(from.distance, r - 20e-3, 0.05e-3) << r;
    EXPECT_NEAR(within.distance, 20e-3 - r, 0.05e-3) << r;
    EXPECT_LT((from.gradient - out).norm(), 0.02);
    EXPECT_LT((within.gradient + out).norm(), 0.02);
  }
  EXPECT_NEAR(distance_in(solid, Vec3::Zero()).distance, -8e-3, 1e-9)
      << "and no farther than it was requested";
}

}  // namespace
}  // namespace dimple
