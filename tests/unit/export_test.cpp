// Files for other programs, and how programs are run.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "apps/studies/run_program.hpp"
#include "io/element_files.hpp"
#include "io/error.hpp"
#include "io/file.hpp"
#include "preprocess/output/tetrahedra.hpp"
#include "tests/helpers/folder.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

using testing::HasSubstr;
using testing::Not;

/// One tetrahedron; node 1 is the base, nodes 2 and 5 the bonded patch.
ElementModel one_tetrahedron() {
  ElementModel model;
  model.remarks = {"a remark -- with two hyphens"};
  model.X.resize(3, 10);
  model.X << 0, 2, 0, 0, 1, 1, 0, 0, 1, 0,  //
      0, 0, 2, 0, 0, 1, 1, 0, 0, 1,         //
      0, 0, 0, 2, 0, 0, 0, 1, 1, 1;
  model.elements.resize(10, 1);
  model.elements.col(0) << 0, 1, 2, 3, 4, 5, 6, 7, 8, 9;
  model.base = {0};
  model.bonded_patch = {1, 4};
  return model;
}

TEST(CalculixInput, HoldsNodesElementsSetsMaterialAndLoadInMillimetresAndKilopascals) {
  const std::string text = calculix_input(one_tetrahedron());
  EXPECT_THAT(text, HasSubstr("** Units: mm, mN, kPa; positions are LPS."));
  EXPECT_THAT(text, HasSubstr("\n2, 2, 0, 0\n"));
  EXPECT_THAT(text, HasSubstr("*ELEMENT, TYPE=C3D10, ELSET=tissue\n1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10\n"));
  EXPECT_THAT(text, HasSubstr("*NSET, NSET=base\n1\n*NSET, NSET=circle\n2, 5\n"));
  EXPECT_THAT(text, HasSubstr("*HYPERELASTIC, NEO HOOKE\n0.105, 0.0190603259\n"));  // mu/2 kPa, 2/kappa 1/kPa
  EXPECT_THAT(text, HasSubstr("circle, 1, 1, 0\ncircle, 2, 2, 0\ncircle, 3, 3, -8\n"));
  EXPECT_THAT(text, HasSubstr("NAME=depths\n0.125\n0.25\n"));
}

TEST(CalculixInput, LetsASlidingPatchGoSideways) {
  ElementModel model = one_tetrahedron();
  model.bonded = false;
  EXPECT_THAT(calculix_input(model), HasSubstr("*BOUNDARY\ncircle, 3, 3, -8\n"));
  model.approach = Vec3(0.6, 0.0, -0.8);
  const std::string text = calculix_input(model);
  EXPECT_THAT(text, HasSubstr("*TRANSFORM, NSET=circle, TYPE=R\n0.6, 0, -0.8,"));
  EXPECT_THAT(text, HasSubstr("*BOUNDARY\ncircle, 1, 1, 8\n"));
}

TEST(FebioInput, HoldsNodesElementsSetsMaterialAndLoadInMillimetresAndKilopascals) {
  const std::string text = febio_input(one_tetrahedron());
  EXPECT_THAT(text, HasSubstr("<!-- a remark - - with two hyphens -->"));
  EXPECT_THAT(text, HasSubstr("<node id=\"2\">2,0,0</node>"));
  EXPECT_THAT(
      text,
      HasSubstr(
          "<Elements type=\"tet10\" name=\"tissue\">\n      <elem id=\"1\">1,2,3,4,5,6,7,8,9,10</elem>"));
  EXPECT_THAT(text, HasSubstr("<NodeSet name=\"circle\">\n2,5\n"));
  EXPECT_THAT(text, HasSubstr("<c1>0.105</c1>\n      <c2>0</c2>\n      <k>104.93</k>"));
  EXPECT_THAT(text, HasSubstr("<dof>z</dof>\n      <value lc=\"1\">-8</value>"));
  EXPECT_THAT(text, HasSubstr("three-field-solid"));
}

TEST(FebioInput, RefusesASlidingPatchThatIsNotPressedAlongAnAxis) {
  ElementModel model = one_tetrahedron();
  model.bonded = false;
  EXPECT_THAT(febio_input(model), Not(HasSubstr("<dof>x</dof>")));
  model.approach = Vec3(0.6, 0.0, -0.8);
  EXPECT_THROW(febio_input(model), UsageError);
}

TEST(Tetrahedra, FillABlockAndMarkItsBaseAndPatch) {
  const BodySurface block = block_surface({-15, -15, 0}, {15, 15, 15});
  const Boundary boundary = find_boundary(block, {.base = "inferior", .indent_at = "0,0,top"});
  const Sizing sizing(block, boundary, {.patch_edge = 0.3});
  const TetrahedralMesh mesh = make_tetrahedra(block, boundary, sizing, 6.0);
  double volume = 0.0;
  for (Index e = 0; e < mesh.tetrahedra.cols(); ++e) {
    const auto x = [&](Index k) -> Vec3 { return mesh.X.col(mesh.tetrahedra(k, e)); };
    const double part = (x(1) - x(0)).cross(x(2) - x(0)).dot(x(3) - x(0)) / 6.0;
    EXPECT_GT(part, 0.0);
    volume += part;
    static constexpr int ends[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};
    for (Index k = 0; k < 6; ++k) EXPECT_LT((x(4 + k) - 0.5 * (x(ends[k][0]) + x(ends[k][1]))).norm(), 1e-12);
  }
  EXPECT_NEAR(volume, mesh.volume_mm3, 1e-6);
  EXPECT_NEAR(volume, block.volume(), 0.05 * block.volume());
  double on_patch_edge = 0.0;
  for (const Index a : mesh.bonded_patch) {
    EXPECT_NEAR(mesh.X(2, a), 15.0, 1e-9);
    on_patch_edge = std::max(on_patch_edge, mesh.X.col(a).head<2>().norm());
  }
  EXPECT_NEAR(on_patch_edge, 5.0, 0.01);
  // The mesh rounds sharp edges: some of the held nodes there are slightly higher.
  const auto flat = std::count_if(mesh.base.begin(), mesh.base.end(),
                                  [&](Index a) { return std::abs(mesh.X(2, a)) < 1e-6; });
  EXPECT_GT(static_cast<double>(flat), 0.6 * static_cast<double>(mesh.base.size()));
  for (const Index a : mesh.base) EXPECT_LT(mesh.X(2, a), 0.5 * 6.0);
}

TEST(RunProgram, ReturnsTheCodeAndEndsWhatIsToStop) {
  const std::filesystem::path folder = fresh_folder();
  EXPECT_EQ(run_program({"/bin/sh", "-c", "echo words; exit 3"}, folder, "run.txt").code, 3);
  EXPECT_EQ(read_file(folder / "run.txt"), "words\n");
  // The command takes longer than this test may last.
  const std::vector<std::string> slow = {"/bin/sh", "-c", "sleep 3000"};
  EXPECT_TRUE(run_program(slow, folder, "run.txt", [] { return true; }).interrupted);
  EXPECT_THROW(run_program({"/no/such/program"}, folder, "run.txt"), UsageError);
}

}  // namespace
}  // namespace dimple
