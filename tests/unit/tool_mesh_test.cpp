#include "preprocess/scene/tool_mesh.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <numbers>
#include <tuple>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/surface_mesh.hpp"
#include "preprocess/surface/closed_mesh.hpp"
#include "tests/helpers/folder.hpp"
#include "tests/helpers/report.hpp"
#include "tests/helpers/shapes.hpp"

namespace dimple {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

TriangleMesh ball(double radius, const Vec3& middle = Vec3::Zero(), int sides = 96) {
  std::vector<std::vector<Vec3>> rings;
  for (int r = 1; r < sides / 2; ++r) {
    const double polar = 2.0 * std::numbers::pi * r / sides, across = radius * std::sin(polar);
    rings.push_back(ring_of(across, across, -radius * std::cos(polar), sides));
  }
  const BodySurface body = of_rings(rings, -radius * Vec3::UnitZ(), radius * Vec3::UnitZ());
  return {body.vertex().colwise() + middle, body.triangles()};
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

std::string all_of(const Report& report) {
  return report.fact + " / " + report.why + " / " + report.remedy;
}

std::string refusal(const TriangleMesh& mesh) {
  const Report report = report_of<InputError>([&] { drawn(mesh); });
  EXPECT_EQ(report.code, "tool-mesh");
  return all_of(report);
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
  // The middle of a triangle is inside the sphere by the rise of both of its arcs above their chords. The
  // spline is inside the ball by step^2 / (3 r).
  const double of_triangles = R * std::pow(std::numbers::pi / 96, 2);
  EXPECT_LT(largest, of_triangles + std::pow(tool.distance.step, 2) / (3.0 * (R - 1e-3)));
}

TEST(ToolMesh, ContinuesUpwardWhereItIsNotSampledAndFarAwayIsFar) {
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
  mesh.triangles.conservativeResize(3, mesh.triangles.cols() - 1);  // next to the highest point
  const std::string said = refusal(mesh);
  EXPECT_THAT(said, HasSubstr("an open border of 3 edges"));
  EXPECT_THAT(said, HasSubstr("35.0"));  // height of that point
  EXPECT_THAT(said, HasSubstr("close its holes"));
}

TEST(ToolMesh, ThatPassesThroughItselfIsRefusedWithThePlace) {
  const std::string said = refusal(together(ball(5.0), ball(5.0, {4.0, 0.3, 0.2}, 60)));
  EXPECT_THAT(said, HasSubstr("passes through itself"));
  EXPECT_THAT(said, HasSubstr("unite its parts"));
  EXPECT_NO_THROW(drawn(together(ball(5.0, Vec3::Zero(), 32), ball(5.0, {20.0, 0, 0}, 32))))
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
    return all_of(report_of<InputError>([&] { read_surface_mesh(folder / name); }));
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
  const std::tuple<const char*, const char*, const char*> files[] = {
      {"empty.stl", "", "too short"},
      {"words.stl", "solid\nfacet normal 0 0 0\n outer loop\n  vertex 0 0 much\n", ""},
      {"none.obj", "v 0 0 0\nv 1 0 0\n", ""},
      {"beyond.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", ""},
      {"letter.ply", "ply\n", ".stl, .obj and .vtp"}};
  for (const auto& [name, text, words] : files) {
    write_file(folder / name, text);
    EXPECT_THAT(refusal(name), HasSubstr(words)) << name;
  }
  refusal("nowhere.stl");
}

TEST_F(SurfaceMesh, OfTextBeginsAsItMay) {
  const TriangleMesh mesh = ball(5.0, {1, 2, 3}, 24);
  write_text_stl(folder / "plain.stl", mesh);
  const std::string plain = read_file(folder / "plain.stl");
  std::string capitals = plain;
  std::transform(capitals.begin(), capitals.end(), capitals.begin(),
                 [](unsigned char c) { return std::toupper(c); });
  const SurfaceFile right = read_surface_mesh(folder / "plain.stl");
  for (const std::string& text : {capitals, "\xef\xbb\xbf" + plain, "\n" + plain, "   " + plain}) {
    write_file(folder / "other.stl", text);
    EXPECT_EQ(read_surface_mesh(folder / "other.stl").position_mm, right.position_mm) << text.substr(0, 20);
  }
  for (const char* name : {"wide.stl", "wide.obj"}) {
    write_file(folder / name, std::string("\xff\xfes\0o\0", 6));
    EXPECT_THAT(refusal(name), HasSubstr("UTF-16"));
  }
  write_file(folder / "short.stl", plain.substr(0, plain.find("endsolid")));
  EXPECT_THAT(refusal("short.stl"), HasSubstr("breaks off"));
  std::string commas = plain;
  std::replace(commas.begin(), commas.end(), '.', ',');
  write_file(folder / "commas.stl", commas);
  EXPECT_THAT(refusal("commas.stl"), HasSubstr("decimal commas"));
}

TEST_F(SurfaceMesh, WhoseNumbersCannotBeReadIsRefusedWithTheLine) {
  const std::string first = "# a sheet\nv 0 0 0\nv 1 0 0\n";
  const std::tuple<const char*, const char*, const char*> refused[] = {
      {"v 0 1 5,5\nf 1 2 3\n", "'5,5' is not a finite number in line 4", "decimal commas"},
      {"v 0 x 0\nf 1 2 3\n", "'x' is not a finite number in line 4", "three numbers"},
      {"v 0 1\nf 1 2 3\n", "too few numbers in line 4", "three numbers"},
      {"v 0mm 1mm 0mm\nf 1 2 3\n", "'0mm' is not a finite number in line 4", "three numbers"},
      {"v 0 1 nan\nf 1 2 3\n", "'nan' is not a finite number in line 4", "three numbers"},
      {"v 0 1 0\nf 1 2 x\n", "'x' in line 5 is no corner", "by number"},
      {"v 0 1 0\nf 1 2 -4\n", "'-4' in line 5 is no corner", "by number"},
      {"v 0 1 0\nf 1 2\n", "the face in line 5 has 2 corners", "three"}};
  for (const auto& [remaining, fact, why] : refused) {
    write_file(folder / "bad.obj", first + remaining);
    EXPECT_THAT(refusal("bad.obj"), testing::AllOf(HasSubstr(fact), HasSubstr(why))) << remaining;
  }
  write_file(folder / "good.obj", "\xef\xbb\xbf" + first + "v +0 1e0 0 0.5 0.5 0.5\r\nf 1/1 2//7 \\\n -1\n");
  EXPECT_EQ(read_surface_mesh(folder / "good.obj").triangles.cols(), 1);
}

std::string vtp_of_a_triangle(const std::string& field_data, const std::string& cell_data = "") {
  return R"(<VTKFile type="PolyData" version="0.1" byte_order="LittleEndian"><PolyData>)" + field_data +
         R"(<Piece NumberOfPoints="3" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" )"
         R"(NumberOfPolys="1"><PointData/><CellData>)" +
         cell_data +
         R"(</CellData><Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">)"
         R"(8 -15 5 8 15 5 9 15 35</DataArray></Points><Polys>)"
         R"(<DataArray type="Int32" Name="connectivity" format="ascii">0 1 2</DataArray>)"
         R"(<DataArray type="Int32" Name="offsets" format="ascii">3</DataArray></Polys></Piece></PolyData></VTKFile>)";
}

TEST_F(SurfaceMesh, IsReadInTheSpaceThatItNames) {
  const auto space = [](const std::string& letters) {
    return R"(<FieldData><Array type="String" Name="SPACE" NumberOfTuples="1" format="ascii">)" + letters +
           " 0</Array></FieldData>";
  };
  TriangleMesh one;
  one.vertex = Mat3{{8, 8, 9}, {-15, 15, 15}, {5, 5, 35}};
  one.triangles = Triangles(3, 1);
  one.triangles << 0, 1, 2;
  write_text_stl(folder / "none.stl", one);
  std::string text = read_file(folder / "none.stl");
  write_file(folder / "text_ras.stl", text.replace(0, 10, "solid 3D Slicer output. SPACE=RAS"));
  for (const std::string name : {"LPS", "RAS"}) {
    write_binary_stl(folder / (name + ".stl"), one, "3D Slicer output. SPACE=" + name);
    write_file(folder / (name + ".obj"),
               "# 3D Slicer output. SPACE=" + name + "\nv 8 -15 5\nv 8 15 5\nv 9 15 35\nf 1 2 3\n");
  }
  write_file(folder / "LPS.vtp", vtp_of_a_triangle(space("76 80 83")));
  write_file(folder / "RAS.vtp", vtp_of_a_triangle(space("82 65 83")));
  const Mat3 turn = Vec3(-1, -1, 1).asDiagonal();
  for (const char* name : {"none.stl", "LPS.stl", "LPS.obj", "LPS.vtp"})
    EXPECT_EQ(read_surface_mesh(folder / name).position_mm, one.vertex) << name;
  for (const char* name : {"text_ras.stl", "RAS.stl", "RAS.obj", "RAS.vtp"}) {
    const SurfaceFile read = read_surface_mesh(folder / name);
    EXPECT_EQ(read.position_mm, turn * one.vertex) << name;
    EXPECT_EQ(read.triangles, one.triangles) << name;
  }
}

TEST_F(SurfaceMesh, LeavesTextArraysOfAVtpAside) {
  const std::string words = R"(type="String" Name="names" format="ascii">65 66 0 "" 67)";
  for (const std::string element : {"DataArray", "Array"}) {
    const std::string array = "<" + element + " " + words + "</" + element + ">";
    write_file(folder / "text.vtp", vtp_of_a_triangle("<FieldData>" + array + "</FieldData>", array + array));
    EXPECT_EQ(read_surface_mesh(folder / "text.vtp").triangles.cols(), 1);
  }
  write_file(folder / "open.vtp", vtp_of_a_triangle("<FieldData><Array " + words + "</FieldData>"));
  refusal("open.vtp");
}

TEST_F(SurfaceMesh, WithATriangleTwiceIsRefusedWithThePlace) {
  const TriangleMesh mesh = ball(5.0, {10, 20, 30}, 24);
  TriangleMesh one = mesh;
  one.triangles.conservativeResize(3, mesh.triangles.cols() + 1);
  one.triangles.rightCols<1>() << mesh.triangles(2, 0), mesh.triangles(0, 0), mesh.triangles(1, 0);
  const std::string all = std::to_string(mesh.triangles.cols());
  for (const auto& [twice, copies] : {std::pair{one, std::string("1 of its")}, {together(mesh, mesh), all}}) {
    write_binary_stl(folder / "twice.stl", twice);
    write_vtp(folder / "twice.vtp", {.position_mm = twice.vertex, .triangles = twice.triangles, .fields = {}},
              0.0, true);
    for (const char* name : {"twice.stl", "twice.vtp"})
      EXPECT_THAT(refusal(name), testing::AllOf(HasSubstr(std::string("in ") + name),
                                                HasSubstr("a triangle is there twice near ("),
                                                HasSubstr(") mm / " + copies)));
  }
}

}  // namespace
}  // namespace dimple
