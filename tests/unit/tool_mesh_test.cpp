#include "preprocess/scene/tool_mesh.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <numbers>

#include "io/error.hpp"
#include "io/surface_mesh.hpp"
#include "preprocess/surface/closed_mesh.hpp"
#include "preprocess/surface/shapes.hpp"
#include "tests/helpers/folder.hpp"

namespace dimple {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

TriangleMesh ball(double radius, const Vec3& middle = Vec3::Zero(), int sides = 96) {
  const int rings = sides / 2;
  TriangleMesh mesh;
  mesh.vertex.resize(3, sides * (rings - 1) + 2);
  for (int r = 1; r < rings; ++r)
    for (int k = 0; k < sides; ++k) {
      const double polar = std::numbers::pi * r / rings, around = 2.0 * std::numbers::pi * k / sides;
      mesh.vertex.col((r - 1) * sides + k) =
          middle + radius * Vec3(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around),
                                 std::cos(polar));
    }
  const Index top = sides * (rings - 1), bottom = top + 1;
  mesh.vertex.col(top) = middle + radius * Vec3::UnitZ();
  mesh.vertex.col(bottom) = middle - radius * Vec3::UnitZ();
  std::vector<std::array<Index, 3>> faces;
  for (int k = 0; k < sides; ++k) {
    const Index next = (k + 1) % sides;
    faces.push_back({top, k, next});
    for (int r = 0; r + 2 < rings; ++r) {
      const Index a = r * sides + k, b = r * sides + next;
      faces.push_back({a, a + sides, b});
      faces.push_back({b, a + sides, b + sides});
    }
    faces.push_back({bottom, (rings - 2) * sides + next, (rings - 2) * sides + k});
  }
  mesh.triangles.resize(3, static_cast<Index>(faces.size()));
  for (std::size_t t = 0; t < faces.size(); ++t)
    mesh.triangles.col(static_cast<Index>(t)) << faces[t][0], faces[t][1], faces[t][2];
  return mesh;
}

TriangleMesh together(const TriangleMesh& a, const TriangleMesh& b) {
  TriangleMesh both;
  both.vertex.resize(3, a.vertex.cols() + b.vertex.cols());
  both.vertex << a.vertex, b.vertex;
  both.triangles.resize(3, a.triangles.cols() + b.triangles.cols());
  both.triangles << a.triangles, (b.triangles.array() + a.vertex.cols()).matrix();
  return both;
}

ToolMesh drawn(const TriangleMesh& mesh) {
  return tool_mesh(mesh.vertex, mesh.triangles, "probe.stl");
}

std::string refusal(const TriangleMesh& mesh) {
  try {
    tool_mesh(mesh.vertex, mesh.triangles, "probe.stl");
  } catch (const InputError& error) {
    EXPECT_EQ(error.report.code, "tool-mesh");
    return error.report.fact + " / " + error.report.why + " / " + error.report.remedy;
  }
  return "";
}

TEST(ToolMesh, OfABallHasItsDistancesAndNormals) {
  const double R = 5e-3;
  const ToolMesh tool = drawn(ball(5.0, {100, -40, 7}));
  EXPECT_FALSE(tool.turned);
  EXPECT_NEAR(tool.length, 2 * R, 1e-12);
  EXPECT_NEAR(tool.width, 2 * R, 1e-12);
  double largest = 0.0;
  for (int k = 0; k < 500; ++k) {
    const double polar = 0.5 * std::numbers::pi * (1.0 + (k % 50) / 50.0), around = 0.1 * k;
    const Vec3 out(std::sin(polar) * std::cos(around), std::sin(polar) * std::sin(around), std::cos(polar));
    const double away = -1e-3 + 2e-3 * (k % 7) / 6.0;
    const Distance found = distance_in(tool.distance, Vec3(0, 0, R) + (R + away) * out);
    largest = std::max(largest, std::abs(found.distance - away));
    EXPECT_NEAR(found.gradient.norm(), 1.0, 0.01);
    EXPECT_GT(found.gradient.normalized().dot(out), 0.9995);
  }
  // The middle of a triangle lies within the sphere by what both of its arcs rise above their chords, and the
  // spline within the ball by step^2 / (3 r).
  const double of_triangles = R * std::pow(std::numbers::pi / 96, 2);
  EXPECT_LT(largest, of_triangles + std::pow(tool.distance.step, 2) / (3.0 * (R - 1e-3)));
}

TEST(ToolMesh, GoesOnUpwardWhereItIsNotSampledAndFarAwayIsFar) {
  const BodySurface rod = cylinder_surface(2.0, 40.0, 180);
  const ToolMesh tool = drawn({rod.vertex(), rod.triangles()});
  EXPECT_NEAR(tool.length, 40e-3, 1e-12);
  for (const double height : {5e-3, 20e-3, 100e-3}) {
    EXPECT_NEAR(distance_in(tool.distance, Vec3(3e-3, 0, height)).distance, 1e-3, 2e-5) << height;
    EXPECT_NEAR(distance_in(tool.distance, Vec3(1.5e-3, 0, height)).distance, -0.5e-3, 2e-5) << height;
  }
  const Distance far = distance_in(tool.distance, Vec3(0, 0, -50e-3));
  EXPECT_NEAR(far.distance, 50e-3, 1e-5);
  EXPECT_NEAR(far.gradient.z(), -1.0, 1e-6);
}

TEST(ToolMesh, IsTheSameToolHoweverItsTrianglesFace) {
  TriangleMesh inverted = ball(5.0, Vec3::Zero(), 32), mixed = inverted;
  inverted.triangles.row(1).swap(inverted.triangles.row(2));
  for (Index t = 0; t < mixed.triangles.cols(); t += 3)
    std::swap(mixed.triangles(1, t), mixed.triangles(2, t));
  const ToolMesh usual = drawn(ball(5.0, Vec3::Zero(), 32));
  for (const TriangleMesh& mesh : {inverted, mixed}) {
    const ToolMesh tool = drawn(mesh);
    EXPECT_TRUE(tool.turned);
    EXPECT_NEAR(tool.volume_mm3, usual.volume_mm3, 1e-9 * usual.volume_mm3);
    EXPECT_EQ(tool.distance.value.size(), usual.distance.value.size());
    EXPECT_NEAR(distance_in(tool.distance, Vec3::Zero()).distance,
                distance_in(usual.distance, Vec3::Zero()).distance, 1e-12);
  }
}

TEST(ToolMesh, ThatIsOpenIsRefusedWithThePlace) {
  TriangleMesh mesh = ball(5.0, {10, 20, 30});
  mesh.triangles.conservativeResize(3, mesh.triangles.cols() - 1);  // beside the lowest point
  const std::string said = refusal(mesh);
  EXPECT_THAT(said, HasSubstr("an open border of 3 edges"));
  EXPECT_THAT(said, HasSubstr("25.0"));  // height of that point
  EXPECT_THAT(said, HasSubstr("close its holes"));
}

TEST(ToolMesh, ThatPassesThroughItselfIsRefusedWithThePlace) {
  const std::string said = refusal(together(ball(5.0), ball(5.0, {4.0, 0.3, 0.2}, 60)));
  EXPECT_THAT(said, HasSubstr("passes through itself"));
  EXPECT_THAT(said, HasSubstr("unite its parts"));
  EXPECT_EQ(refusal(together(ball(5.0, Vec3::Zero(), 32), ball(5.0, {20.0, 0, 0}, 32))), "")
      << "two parts beside each other";
}

TEST(ToolMesh, InMetresIsRefused) {
  TriangleMesh mesh = ball(5.0);
  mesh.vertex *= 1e-3;
  EXPECT_THAT(refusal(mesh), HasSubstr("0.01 mm long"));
  EXPECT_THAT(refusal(mesh), HasSubstr("scale it by 1000 if it was drawn in metres"));
  mesh.vertex *= 1e6;
  EXPECT_THAT(refusal(mesh), HasSubstr("1e+04 mm long"));
}

// ----------------------------------------------------------------------------------------------- its files

class SurfaceMesh : public testing::Test {
 protected:
  fs::path folder = test_folder();

  static void write_text_stl(const fs::path& file, const TriangleMesh& mesh) {
    std::ofstream out(file);
    out.precision(9);
    out << "solid ball\n";
    for (const auto& t : mesh.triangles.colwise()) {
      out << "facet normal 0 0 0\n outer loop\n";
      for (int c = 0; c < 3; ++c) out << "  vertex " << mesh.vertex.col(t[c]).transpose() << '\n';
      out << " endloop\nendfacet\n";
    }
    out << "endsolid ball\n";
  }
  static void write_binary_stl(const fs::path& file, const TriangleMesh& mesh,
                               const std::string& title = "") {
    std::ofstream out(file, std::ios::binary);
    std::string head = title;
    head.resize(80, ' ');
    const auto count = static_cast<std::uint32_t>(mesh.triangles.cols());
    out << head;
    out.write(reinterpret_cast<const char*>(&count), 4);
    for (const auto& t : mesh.triangles.colwise()) {
      float numbers[12] = {};
      for (int c = 0; c < 3; ++c)
        for (int r = 0; r < 3; ++r) numbers[3 + 3 * c + r] = static_cast<float>(mesh.vertex(r, t[c]));
      out.write(reinterpret_cast<const char*>(numbers), sizeof numbers);
      out.write("\0\0", 2);
    }
  }
  static void write_obj(const fs::path& file) {  // a cube in squares
    std::ofstream(file) << "# cube\nv 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nv 0 0 4\nv 4 0 4\nv 4 4 4\nv 0 4 4\n"
                           "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
  }
  std::string refusal(const std::string& name) {
    try {
      read_surface_mesh(folder / name);
    } catch (const InputError& error) {
      return error.report.fact + " / " + error.report.why + " / " + error.report.remedy;
    }
    return "";
  }
};

TEST_F(SurfaceMesh, IsTheSameInEachFormat) {
  const TriangleMesh mesh = ball(5.0, {1, 2, 3}, 24);
  write_text_stl(folder / "text.stl", mesh);
  write_binary_stl(folder / "binary.stl", mesh);
  write_binary_stl(folder / "named.STL", mesh, "solid made by a program that calls its binary files so");
  write_vtp(folder / "ball.vtp", {.position_mm = mesh.vertex, .triangles = mesh.triangles, .fields = {}}, 0.0,
            true);
  for (const char* name : {"text.stl", "binary.stl", "named.STL", "ball.vtp"}) {
    const SurfaceFile read = read_surface_mesh(folder / name);
    EXPECT_EQ(read.position_mm.cols(), mesh.vertex.cols()) << name;
    EXPECT_EQ(read.triangles.cols(), mesh.triangles.cols()) << name;
    EXPECT_NEAR(enclosed_volume({read.position_mm, read.triangles}), enclosed_volume(mesh), 1e-3) << name;
  }
  write_obj(folder / "cube.obj");
  const SurfaceFile cube = read_surface_mesh(folder / "cube.obj");
  EXPECT_EQ(cube.triangles.cols(), 12);
  EXPECT_NEAR(enclosed_volume({cube.position_mm, cube.triangles}), 64.0, 1e-9);
}

TEST_F(SurfaceMesh, ThatIsDamagedIsRefused) {
  write_binary_stl(folder / "cut.stl", ball(5.0, Vec3::Zero(), 24));
  fs::resize_file(folder / "cut.stl", fs::file_size(folder / "cut.stl") - 77);
  EXPECT_THAT(refusal("cut.stl"), HasSubstr("is no STL file"));
  std::ofstream(folder / "empty.stl");
  EXPECT_THAT(refusal("empty.stl"), HasSubstr("too short"));
  std::ofstream(folder / "words.stl") << "solid\nfacet normal 0 0 0\n outer loop\n  vertex 0 0 much\n";
  EXPECT_NE(refusal("words.stl"), "");
  std::ofstream(folder / "none.obj") << "v 0 0 0\nv 1 0 0\n";
  EXPECT_NE(refusal("none.obj"), "");
  std::ofstream(folder / "beyond.obj") << "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n";
  EXPECT_NE(refusal("beyond.obj"), "");
  std::ofstream(folder / "letter.ply") << "ply\n";
  EXPECT_THAT(refusal("letter.ply"), HasSubstr(".stl, .obj and .vtp"));
  EXPECT_NE(refusal("nowhere.stl"), "");
}

}  // namespace
}  // namespace dimple
