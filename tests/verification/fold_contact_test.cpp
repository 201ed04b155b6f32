// Folds that close, against closed forms and bodies without contact.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <random>
#include <vector>

#include "preprocess/supports/contact_surface.hpp"
#include "preprocess/supports/fold_faces.hpp"
#include "solver/equilibrium/relax.hpp"
#include "tests/helpers/block.hpp"
#include "tests/helpers/marched.hpp"
#include "tests/helpers/shapes.hpp"
#include "tests/verification/hertz.hpp"

namespace dimple {
namespace {

constexpr double height = 20e-3, side = 30e-3;  // of one block [m]

// One body above another with a gap between them: the base of the lower one is fixed, `moved` is moved.
Model two_bodies(const Discretisation& below, const Discretisation& above, std::vector<Index> moved) {
  Discretisation both = below;
  const auto join = [](auto& all, const auto& a, const auto& b) {
    all.resize(a.rows(), a.cols() + b.cols());
    all << a, b;
  };
  const auto append = [](auto& all, const auto& a, const auto& b) {
    all.resize(a.size() + b.size());
    all << a, b;
  };
  join(both.X, below.X, above.X);
  join(both.point, below.point, above.point);
  join(both.second_moments, below.second_moments, above.second_moments);
  append(both.spacing, below.spacing, above.spacing);
  append(both.volume, below.volume, above.volume);
  append(both.label, below.label, above.label);
  join(both.surface.vertex_mm, below.surface.vertex_mm, above.surface.vertex_mm);
  const Triangles further =
      above.surface.triangles.array() + static_cast<int>(below.surface.vertex_mm.cols());
  join(both.surface.triangles, below.surface.triangles, further);
  both.bonded_patch = std::move(moved);
  for (Index& a : both.bonded_patch) a += below.node_count();
  Eigen::VectorXi tissue = Eigen::VectorXi::Zero(both.point_count());
  return make_model(std::move(both), converging, std::move(tissue), {1000.0});
}

// Mirror image at a plane across z [m].
Discretisation mirrored(const Discretisation& one, double at) {
  Discretisation above = one;
  for (auto* z : {&above.X, &above.point}) z->row(2) = 2.0 * at - z->row(2).array();
  above.surface.vertex_mm.row(2) = 2e3 * at - above.surface.vertex_mm.row(2).array();
  above.surface.triangles.row(0).swap(above.surface.triangles.row(1));
  above.second_moments.row(4) *= -1.0;
  above.second_moments.row(5) *= -1.0;
  return above;
}

Discretisation block_of(Index nodes, unsigned seed) {
  Discretisation one = testing_bodies::block_places(nodes, 0.15, 1.8, seed);
  one.second_moments = SecondMoments::Zero(6, one.point_count());
  one.second_moments.topRows<3>().setConstant(std::pow(one.volume[0], 2.0 / 3.0) / 12.0);
  return one;
}

// Column of two blocks that have different nodes.
Model column_of_two(double gap) {
  const Discretisation below = block_of(6, 7);
  Discretisation above = block_of(7, 11);
  const Vec3 up(0.0, 0.0, height + gap);
  above.X.colwise() += up;
  above.point.colwise() += up;
  above.surface.vertex_mm.colwise() += 1e3 * up;
  std::vector<Index> top;
  for (Index a = 0; a < above.node_count(); ++a)
    if (above.X(2, a) > 2.0 * height + gap - 1e-9) top.push_back(a);
  return two_bodies(below, above, top);
}

std::vector<HeldSet> all_slide(const Model& model) {  // only up and down
  HeldSet inner{.name = "column", .node = {}, .hold = HeldSet::Hold::across, .direction = Vec3::UnitZ()};
  for (Index a = 0; a < model.node_count(); ++a)
    if (model.X(2, a) > 1e-9 && model.X(2, a) < model.X.row(2).maxCoeff() - 1e-9) inner.node.push_back(a);
  return {inner};
}

// Equilibrium of two bodies. Before the search for contact, the upper one, from node `parting` on, has moved
// down by `depth` into the lower one.
struct Pressed {
  std::unique_ptr<System> system;
  EquilibriumState state;
  double force = 0.0;
};

Pressed pressed_together(const ForceSystem& tissue, const Model& model, Index parting,
                         const std::vector<HeldSet>& further, double depth,
                         Contact contact = Contact::bonded) {
  Pressed pressed;
  auto fold_faces = std::make_shared<const FoldFaces>(find_fold_faces(model, 2.0 * depth));
  pressed.system = make_system(tissue, model, contact, further, {}, 1e-4, nullptr, fold_faces);
  pressed.state = pressed.system->step_start();
  for (Index a = 0; a < model.node_count(); ++a)
    if (a >= parting) pressed.state.u(2, a) = -depth;
  pressed.system->set({.depth = depth}, pressed.state.u);
  Nodal f = pressed.state.u;
  const Relaxation relax(*pressed.system);
  EXPECT_TRUE(relax.from_near(pressed.state.u, pressed.state.lambda, f, {}).converged);
  pressed.force = pressed.system->along_approach(f);
  // Opposing faces are paired, and gaps measured, when a state is accepted. The pairs are constant once they
  // are those of the full depth.
  for (const double within : {0.02, 0.002}) {
    pressed.system->accept_step(pressed.state.u);
    EXPECT_TRUE(relax.from_near(pressed.state.u, pressed.state.lambda, f, {}).converged);
    EXPECT_NEAR(pressed.system->along_approach(f), pressed.force, within * pressed.force);
    pressed.force = pressed.system->along_approach(f);
  }
  return pressed;
}

TEST(FoldsThatClose, CarryTheStressOfAConfinedColumnAsIfNothingParted) {
  const double gap = 0.2e-3, depth = 3e-3;
  const Model model = column_of_two(gap);
  const Material material = neo_hookean(1000.0, 0.45, 1000.0);
  const ForceSystem tissue(model, {{material}, model.tissue});
  const Pressed pressed = pressed_together(tissue, model, (model.X.row(2).array() < height + 1e-9).count(),
                                           all_slide(model), depth);
  const double stretch = 1.0 - (depth - gap) / (2.0 * height);
  const Mat3 F = Vec3(1.0, 1.0, stretch).asDiagonal();
  const double expected = -side * side * pk1_stress(material, F)(2, 2);
  EXPECT_NEAR(pressed.force, expected, 0.01 * expected);
  const FoldContact::Audit contact = pressed.system->folds()->audit();
  EXPECT_NEAR(contact.force, expected, 0.01 * expected);
  EXPECT_NEAR(contact.area, side * side, 0.1 * side * side);
  EXPECT_LT(contact.penetration, 0.002 * model.spacing.minCoeff());
  for (Index a = 0; a < model.node_count(); ++a) {
    const double z = model.X(2, a), expected_z = z > height + 1e-9
                                                     ? -depth + (1.0 - stretch) * (2.0 * height + gap - z)
                                                     : -(1.0 - stretch) * z;
    EXPECT_NEAR(pressed.state.u(2, a), expected_z, 0.03 * depth) << model.X.col(a).transpose();
  }
}

// Two domes of a radius of 20 mm meet at their tops.
TEST(FoldsThatClose, OfTwoEqualDomesPressEachOtherAsAPlatePressesOneByHalf) {
  const double gap = 0.2e-3, displacement = 2e-3;
  const Model one =
      model_with_tool(cut_ellipsoid_surface({20, 20, 20}, 0.0), {.nodes = 1500, .contact_radius = 4.0});
  const Material material = neo_hookean(1000.0, 0.49, 1000.0);

  auto plate = std::make_shared<RigidBody>();
  plate->shape = punch_shape(30e-3, 3e-3);
  plate->surface = contact_surface(one, 12e-3);
  plate->pose = first_contact(plate->shape, one.tool, plate->surface);
  Loading loading{.depth = 0.5 * (displacement - gap)};
  loading.indenter = plate;
  const ForceSystem tissue_of_one(one, {{material}, one.tissue});
  const History history = marched(tissue_of_one, one, loading);

  const Discretisation above = mirrored(one, 0.5 * (2.0 * one.tool.centre.z() + gap));
  const Model both = two_bodies(one, above, one.base);
  const ForceSystem tissue(both, {{material}, both.tissue});
  const Pressed pressed = pressed_together(tissue, both, one.node_count(), {}, displacement);
  const double expected = history.force.back().force;
  EXPECT_NEAR(pressed.force, expected, 0.02 * expected);
  EXPECT_LT(pressed.system->folds()->audit().penetration, 0.01 * both.spacing.minCoeff());
}

// Force [N] of two halves whose tops meet, with sliding middle planes that each move by `approach` [m];
// `further` are held in addition.
double halves(const Discretisation& below, double radius, double mu, double nu, double approach,
              std::vector<HeldSet> further = {}) {
  const double gap = 0.02e-3;
  const Index centre = hertz::centre_of(below), count = below.node_count();
  HeldSet still{
      .name = "still", .node = below.base, .hold = HeldSet::Hold::along, .direction = Vec3::UnitZ()};
  std::erase(still.node, centre);
  further.insert(further.begin(), still);
  further.push_back(
      {.name = "centre", .node = {count + centre}, .direction = -Vec3::UnitZ(), .fraction = 1.0});
  Discretisation fixed = below;
  fixed.base = {centre};
  fixed.tool = {.centre = Vec3(0.0, 0.0, 2.0 * radius + gap), .approach = -Vec3::UnitZ(), .radius = radius};
  const Model model = two_bodies(fixed, mirrored(below, 0.5 * (2.0 * radius + gap)), still.node);
  const ForceSystem tissue(model, {{neo_hookean(mu, nu, 1000.0)}, model.tissue});
  return pressed_together(tissue, model, count, further, 2.0 * approach + gap, Contact::frictionless).force;
}

TEST(FoldsThatClose, OfTwoSpheresPressEachOtherAsHertzFound) {
  if (!std::getenv("DIMPLE_ALL_SCENES")) GTEST_SKIP() << "skipped: 10 s, without DIMPLE_ALL_SCENES";
  const auto [nodes, within] = hertz::fineness();
  const double approach = 0.3e-3, expected = hertz::force_at(approach),
               force = halves(hertz::half_sphere(nodes), hertz::radius, hertz::mu, hertz::nu, approach);
  std::printf("%td nodes: %+.2f %% of the truth\n", nodes, 100.0 * (force / expected - 1.0));
  EXPECT_NEAR(force, expected, within * expected);
}

namespace cylinders {

constexpr double radius = 20e-3, width = 6e-3, mu = 1000.0, nu = 0.45,
                 compliance = (1.0 - nu) / (2.0 * mu * std::numbers::pi);  // (1 - nu^2) / (pi E)

// Upper half of a cylinder along y, a prism of flat pieces half a degree wide [mm].
BodySurface upper_half() {
  constexpr Index pieces = 360;
  Points vertex(3, 2 * (pieces + 1));
  for (Index i = 0; i <= pieces; ++i) {
    const double angle = std::numbers::pi * static_cast<double>(i) / static_cast<double>(pieces);
    for (Index end = 0; end < 2; ++end)
      vertex.col(2 * i + end) = 1e3 * Vec3(radius * std::cos(angle), (end == 0 ? -0.5 : 0.5) * width,
                                           i % pieces == 0 ? 0.0 : radius * std::sin(angle));
  }
  std::vector<std::array<Index, 3>> triangle;
  const auto join = [&](Index a, Index b) {  // of two edges along y, outward if b follows a
    triangle.push_back({a, b + 1, b});
    triangle.push_back({a, a + 1, b + 1});
  };
  for (Index i = 0; i < pieces; ++i) join(2 * i, 2 * i + 2);
  join(2 * pieces, 0);
  for (Index i = 1; i < pieces; ++i) {
    triangle.push_back({0, 2 * i, 2 * i + 2});
    triangle.push_back({1, 2 * i + 3, 2 * i + 1});
  }
  Triangles triangles(3, static_cast<Index>(triangle.size()));
  for (std::size_t t = 0; t < triangle.size(); ++t)
    for (int k = 0; k < 3; ++k)
      triangles(k, static_cast<Index>(t)) = static_cast<int>(triangle[t][static_cast<std::size_t>(k)]);
  return {std::move(vertex), std::move(triangles)};
}

// Force [N] of two cylinders whose centres approach each other by twice that. Johnson, Contact Mechanics,
// 1985, (5.57) and (4.43).
double force_at(double approach) {
  double low = 0.0, high = 100.0;  // N/m
  for (int k = 0; k < 100; ++k) {
    const double force = 0.5 * (low + high), half_width = std::sqrt(4.0 * force * radius * compliance);
    (force * compliance * (2.0 * std::log(4.0 * radius / half_width) - 1.0) < approach ? low : high) = force;
  }
  return low * width;
}

}  // namespace cylinders

// Two parallel half-cylinders in plane strain, with sliding middle planes.
TEST(FoldsThatClose, OfTwoParallelCylindersPressEachOtherAsHertzFound) {
  // The whole line of contact needs nodes as fine as at a sphere's pole, so more are needed.
  const auto [nodes, within] =
      std::getenv("DIMPLE_ALL_SCENES") ? hertz::Fineness{6000, 0.02} : hertz::Fineness{3000, 0.04};
  const Discretisation below =
      model_with_tool(cylinders::upper_half(), {.nodes = nodes, .contact_radius = 2.5});
  const Index count = below.node_count();
  HeldSet ends{.name = "ends", .node = {}, .hold = HeldSet::Hold::along, .direction = Vec3::UnitY()};
  for (Index a = 0; a < count; ++a)
    if (std::abs(std::abs(below.X(1, a)) - 0.5 * cylinders::width) < 1e-6 &&
        !std::binary_search(below.base.begin(), below.base.end(), a)) {
      ends.node.push_back(a);
      ends.node.push_back(count + a);
    }
  std::sort(ends.node.begin(), ends.node.end());
  const double approach = 0.25e-3, expected = cylinders::force_at(approach),
               force = halves(below, cylinders::radius, cylinders::mu, cylinders::nu, approach, {ends});
  std::printf("%td nodes: %+.2f %% of the truth\n", count, 100.0 * (force / expected - 1.0));
  EXPECT_NEAR(force, expected, within * expected);
}

Model pressed_on_one_side(const BodySurface& body) {
  ModelOptions options;
  options.node_set.count = 800;
  options.boundary = {.base = "inferior", .indent_at = "-6,0,top", .indenter_diameter_mm = 8.0};
  return build_model(body, options).model;
}

// A block with a slit from its top, 5 mm from the tool's middle, pressed down on that side.
struct NextToASlit {
  Model model;
  Material material = neo_hookean(1000.0, 0.49, 1000.0);
  ForceSystem tissue;
  Loading loading{.depth = 3e-3};
  explicit NextToASlit(bool indenter)
      : model(pressed_on_one_side(slit_block_surface({30, 30, 20}, 0.0, 0.3, 12.0))),
        tissue(model, {{material}, model.tissue}) {
    if (indenter)
      loading.folds = std::make_shared<const FoldFaces>(find_fold_faces(model, 2.0 * loading.depth));
  }
  History solved(const Observer& observer = {}, const MarchState* from = nullptr) const {
    return marched(tissue, model, loading, {.frames = 1}, observer, from);
  }
};

// Displacements of only the lobe on the left of the slit.
Nodal left_moved(const NextToASlit& scene, const Vec3& displacement) {
  Nodal u = Nodal::Zero(4, scene.model.node_count());
  for (Index a = 0; a < u.cols(); ++a)
    if (scene.model.X(0, a) < 0.15e-3) u.col(a).head<3>() = displacement;
  return u;
}

// Displacements of a rigid motion.
Nodal rigid(const Model& model, const Mat3& turn, const Vec3& displacement) {
  return to_nodal(((turn - Mat3::Identity()) * model.X).colwise() + displacement);
}

// Gaps in a state that is not accepted, and those after it is.
Eigen::VectorXd gaps_in(FoldContact& folds, const Nodal& u) {
  Nodal f = Nodal::Zero(4, u.cols());
  folds.add_force(u, {}, f);
  return folds.gaps();
}
Eigen::VectorXd gaps_after(FoldContact& folds, const Nodal& u) {
  gaps_in(folds, u);
  folds.accept(u, {});
  return gaps_in(folds, u);
}

TEST(FoldsThatClose, MakeABlockWithASlitStifferThanItsOpenSlitAndSofterThanTheWholeBlock) {
  const History open = NextToASlit(false).solved(), in_contact = NextToASlit(true).solved();
  const Model whole = pressed_on_one_side(block_surface({-15, -15, 0}, {15, 15, 20}));
  const ForceSystem tissue(whole, {{neo_hookean(1000.0, 0.49, 1000.0)}, whole.tissue});
  const History of_whole = marched(tissue, whole, {.depth = 3e-3});
  EXPECT_GT(in_contact.force.back().force, 1.003 * open.force.back().force);
  EXPECT_LT(in_contact.force.back().force, 1.01 * of_whole.force.back().force);
  EXPECT_GT(in_contact.folds.in_contact, 2);
  EXPECT_TRUE(in_contact.retries.empty());
}

TEST(FoldsThatClose, ContinueFromAStateThatWasKeptToTheSameBits) {
  const NextToASlit scene(true);
  std::vector<MarchState> kept;
  Observer observer;
  observer.between_steps = [&](const std::function<MarchState()>& state) { kept.push_back(state()); };
  const History whole = scene.solved(observer);
  ASSERT_GE(kept.size(), 2u);
  const History again = scene.solved({}, &kept[1]);
  EXPECT_EQ(again.force.back().force, whole.force.back().force);
  EXPECT_EQ(again.folds.force, whole.folds.force);
  EXPECT_GT(whole.folds.force, 0.0);
}

// A wedge of air of 25 degrees between two blocks: the direction to the opposing face is normal to neither.
TEST(FoldsThatClose, OfFacesThatAreNotParallelMeetTheSamePlacesAsLongAsNothingSlides) {
  const Discretisation below = block_of(6, 7);
  Discretisation above = block_of(7, 11);
  const Vec3 edge(side, 0.0, 0.0), lift(0.0, 0.0, height + 0.5e-3);
  const Mat3 turn = Eigen::AngleAxisd(25.0 * 3.14159265358979 / 180.0, Vec3::UnitY()).toRotationMatrix();
  const auto open = [&](const Points& x) {
    return Points((turn * (x.colwise() - edge)).colwise() + Vec3(edge + lift));
  };
  above.X = open(above.X);
  above.point = open(above.point);
  above.surface.vertex_mm = 1e3 * open(1e-3 * above.surface.vertex_mm);
  const Model model = two_bodies(below, above, {0});
  const ForceSystem tissue(model, {{neo_hookean(1000.0, 0.49, 1000.0)}, model.tissue});
  const auto fold_faces = std::make_shared<const FoldFaces>(find_fold_faces(model, 12e-3));
  ASSERT_GT(fold_faces->count(), 20);
  FoldContact folds(fold_faces, tissue);
  Nodal u = Nodal::Zero(4, model.node_count()), f = u;
  const auto moved_along = [&](double displacement) {
    for (Index a = below.node_count(); a < model.node_count(); ++a)
      u.col(a).head<3>() = displacement * Vec3::UnitY();
    folds.add_force(u, {}, f);
    folds.accept(u, {});
    const std::vector<double> past = folds.past();  // part opposite to each sample; -1: that at rest
    return std::any_of(past.begin(), past.begin() + folds.count(), [](double one) { return one != -1.0; });
  };
  EXPECT_FALSE(moved_along(0.0));
  EXPECT_FALSE(moved_along(0.3 * fold_faces->spacing.minCoeff()));
  EXPECT_TRUE(moved_along(0.7 * fold_faces->spacing.maxCoeff()));
}

// Two domes, top to top: at a place off the tops, the part nearer to them is nearer to the other dome.
TEST(FoldsThatClose, OfFacesThatBulgeHaveThePartsThatAreNearest) {
  const Model one = model_with_tool(cut_ellipsoid_surface({20, 20, 20}, 0.0),
                                    {.nodes = 400, .contact_radius = 4.0, .whole_patch = false});
  const Discretisation above = mirrored(one, 20e-3 + 0.1e-3);
  const Model model = two_bodies(one, above, one.base);
  const ForceSystem tissue(model, {{neo_hookean(1000.0, 0.49, 1000.0)}, model.tissue});
  const auto fold_faces = std::make_shared<const FoldFaces>(find_fold_faces(model, 12e-3));
  ASSERT_GT(fold_faces->part_end.back(), fold_faces->count());
  FoldContact folds(fold_faces, tissue);
  const Nodal undeformed = Nodal::Zero(4, model.node_count());
  const Eigen::VectorXd wholes = gaps_in(folds, undeformed), parts = gaps_after(folds, undeformed);
  Index nearer = 0;
  for (Index s = 0; s < parts.size(); ++s) {
    EXPECT_LE(parts[s], wholes[s]) << s;
    nearer += parts[s] < wholes[s] - 0.02 * fold_faces->spacing[s];
  }
  EXPECT_GT(nearer, 10);
  const Mat3 turn = Eigen::AngleAxisd(1.0, Vec3(1.0, 2.0, -1.0).normalized()).toRotationMatrix();
  EXPECT_LT((gaps_in(folds, rigid(model, turn, {0.01, -0.02, 0.03})) - parts).cwiseAbs().maxCoeff(), 1e-9)
      << "no rigid motion changes them";
  FoldContact again(fold_faces, tissue);
  again.restore_past(folds.past());
  EXPECT_EQ(gaps_in(again, undeformed), parts);
}

TEST(FoldsThatClose, AreWatchedWhereTheSurfaceFacesItselfAndNowhereElse) {
  const NextToASlit scene(true);
  const FoldFaces& fold_faces = *scene.loading.folds;
  EXPECT_GT(fold_faces.count(), 20);
  EXPECT_LT((fold_faces.sample.place.row(0).cwiseAbs()).maxCoeff(), 1e-3) << "the walls lie at 0 and 0.3 mm";
  EXPECT_LT((fold_faces.opposite - fold_faces.sample.place).colwise().norm().maxCoeff(), 1e-3);
  EXPECT_LT(
      (fold_faces.opposite_normal.array() * fold_faces.sample.normal.array()).colwise().sum().maxCoeff(),
      -0.9);
  EXPECT_EQ(find_fold_faces(scene.model, 0.2e-3).count(), 0) << "no gap is as narrow";
}

// The left wall is displaced by a spacing along the other and by a tenth of one into it.
TEST(FoldsThatClose, DoNotBeginContactDeepInsideAnotherFaceUnlessTheyHadItBefore) {
  const NextToASlit scene(true);
  const auto deepest_after = [&](double force) {
    FoldContact folds(scene.loading.folds, scene.tissue);
    folds.set_forces(Eigen::VectorXd::Constant(folds.count(), force));
    const double spacing = scene.loading.folds->spacing.maxCoeff();
    const Nodal u = left_moved(scene, {0.3e-3 + 0.1 * spacing, spacing, 0.0});
    return gaps_after(folds, u).minCoeff() / spacing;
  };
  EXPECT_GT(deepest_after(0.0), -0.05);
  EXPECT_LT(deepest_after(1e-3), -0.09);
}

TEST(FoldsThatClose, HaveGapsThatNoRigidMotionChanges) {
  const NextToASlit scene(true);
  FoldContact folds(scene.loading.folds, scene.tissue);
  const Eigen::VectorXd undeformed = gaps_in(folds, Nodal::Zero(4, scene.model.node_count()));
  const Mat3 turn = Eigen::AngleAxisd(1.0, Vec3(1.0, 2.0, -1.0).normalized()).toRotationMatrix();
  const Nodal moved = rigid(scene.model, turn, {0.01, -0.02, 0.03});
  EXPECT_LT((gaps_in(folds, moved) - undeformed).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_NEAR(undeformed.minCoeff(), 0.3e-3, 1e-6);
}

TEST(FoldsThatClose, PressBothFacesApartWithForcesThatSumToNothing) {
  const NextToASlit scene(true);
  FoldContact folds(scene.loading.folds, scene.tissue);
  folds.set_forces(Eigen::VectorXd::Constant(folds.count(), 1e-3));
  Nodal f = Nodal::Zero(4, scene.model.node_count());
  folds.add_force(Nodal::Zero(4, scene.model.node_count()), {}, f);
  EXPECT_LT(f.rowwise().sum().norm(), 1e-12);
  double left = 0.0;  // sign of a resisting force
  for (Index a = 0; a < f.cols(); ++a)
    if (scene.model.X(0, a) < 0.15e-3) left += f(0, a);
  EXPECT_GT(left, 1e-3) << "the wall on the left is pushed to the left";
}

// One lobe is displaced along the slit and rotated, so that a sample and its pair are no longer opposite.
// Equal and opposite forces there would then have a moment, and not correspond to the change of the gap.
TEST(FoldsThatClose, PressBothFacesAlongOneLineAndAsTheGapChanges) {
  const NextToASlit scene(true);
  FoldContact folds(scene.loading.folds, scene.tissue);
  const double spacing = scene.loading.folds->spacing.maxCoeff();
  const Mat3 turn = Eigen::AngleAxisd(0.2, Vec3(0.3, 1.0, 0.5).normalized()).toRotationMatrix();
  Nodal u = Nodal::Zero(4, scene.model.node_count()), f = u;
  for (Index a = 0; a < u.cols(); ++a) {
    const Vec3 X = scene.model.X.col(a);
    Vec3 x = X;
    if (X.x() < 0.15e-3) x += Vec3(0.25e-3, 0.4 * spacing, 0.3 * spacing * X.y() / 10e-3);
    u.col(a).head<3>() = turn * x - X;
  }
  for (int pass = 0; pass < 3; ++pass) {
    f.setZero();
    folds.add_force(u, {}, f);
    folds.accept(u, {});
  }
  folds.set_forces(Eigen::VectorXd::Constant(folds.count(), 1e-3));
  f.setZero();
  folds.add_force(u, {}, f);
  Vec3 couple = Vec3::Zero();
  for (Index a = 0; a < u.cols(); ++a)
    couple += (scene.model.X.col(a) + u.col(a).head<3>()).cross(f.col(a).head<3>());
  const double all = 1e-3 * static_cast<double>(folds.count());
  EXPECT_LT(f.rowwise().sum().norm(), 1e-9 * all);
  EXPECT_LT(couple.norm(), 0.01 * all * spacing);

  std::mt19937 random(1);
  std::uniform_real_distribution<double> any(-1e-6, 1e-6);
  Nodal du = Nodal::Zero(4, u.cols());
  for (Index a = 0; a < u.cols(); ++a) du.col(a) << any(random), any(random), any(random), 0.0;
  const Eigen::VectorXd here = folds.gaps();
  const Points normal = folds.normals();
  const Points moves = folds.moves()(du.topRows<3>());
  const Eigen::VectorXd after = gaps_in(folds, u + du), change = 0.5 * (after - gaps_in(folds, u - du));
  int compared = 0;
  for (Index s = 0; s < folds.count(); ++s) {
    if (here[s] == scene.loading.folds->spacing[s]) continue;  // not in contact
    ++compared;
    EXPECT_NEAR(change[s], normal.col(s).dot(moves.col(s)), 0.01e-6) << s;
  }
  EXPECT_GT(compared, folds.count() / 2);
}

TEST(FoldsThatClose, MeetTheNextPartOfTheWallThatTheySlideAlong) {
  const NextToASlit scene(true);
  const auto open_after =
      [&](double displacement) {  // fraction of places with the gap of rest after the left lobe slid along y
        FoldContact folds(scene.loading.folds, scene.tissue);
        const Eigen::VectorXd gaps = gaps_after(folds, left_moved(scene, displacement * Vec3::UnitY()));
        return static_cast<double>(((gaps.array() - 0.3e-3).abs() < 1e-5).count()) /
               static_cast<double>(folds.count());
      };
  EXPECT_GT(open_after(0.0), 0.95);
  EXPECT_GT(open_after(6e-3), 0.7) << "of 30 mm";
  // A march accepts that step for them.
  const auto system =
      make_system(scene.tissue, scene.model, Contact::bonded, {}, {}, 1e-4, nullptr, scene.loading.folds);
  const Nodal u = left_moved(scene, 6e-3 * Vec3::UnitY());
  Nodal f = u;
  system->force(u, f);
  const int before = system->folds()->pairing();
  system->accept_step(u);
  EXPECT_GT(system->folds()->pairing(), before);
}

}  // namespace
}  // namespace dimple
