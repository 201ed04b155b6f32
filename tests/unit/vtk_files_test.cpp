#include "io/vtk_files.hpp"

#include <gtest/gtest.h>
#include <vtkCellData.h>
#include <vtkDoubleArray.h>
#include <vtkFieldData.h>
#include <vtkImageData.h>
#include <vtkInformation.h>
#include <vtkMatrix3x3.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkSmartPointer.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLImageDataReader.h>
#include <vtkXMLPolyDataReader.h>
#include <vtkXMLUnstructuredGridReader.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <random>
#include <set>
#include <sstream>

#include "io/error.hpp"
#include "io/file.hpp"
#include "io/triangle_strips.hpp"
#include "tests/helpers/folder.hpp"
#include "tests/helpers/image.hpp"
#include "tests/helpers/report.hpp"

namespace dimple {
namespace {

namespace fs = std::filesystem;

void put(const fs::path& file, const std::string& content) {
  std::ofstream(file, std::ios::binary) << content;
}

/// Values with all 53 bits in use.
Eigen::MatrixXd random_values(Index rows, Index cols, unsigned seed) {
  std::mt19937 draw(seed);
  std::uniform_real_distribution<double> uniform(-100.0, 100.0);
  return Eigen::MatrixXd::NullaryExpr(rows, cols, [&] { return uniform(draw); });
}

PointFile sample_points(Index count = 50) {
  Eigen::MatrixXd set = Eigen::MatrixXd::Zero(1, count);
  set(0, 0) = 1;
  set(0, 1) = 3;
  return {.position_mm = random_values(3, count, 1),
          .fields = {{.name = "mass_kg", .unit = "kg", .values = random_values(1, count, 2)},
                     {.name = "displacement_mm",
                      .unit = "mm",
                      .values = random_values(3, count, 3),
                      .components = {"L", "P", "S"},
                      .type = Field::Type::real64},
                     {.name = "node_set", .unit = "", .values = set, .type = Field::Type::int32}}};
}

SurfaceFile tetrahedron() {
  SurfaceFile surface;
  surface.position_mm = random_values(3, 4, 4);
  surface.triangles.resize(3, 4);
  surface.triangles << 0, 0, 0, 1, /**/ 2, 1, 3, 2, /**/ 1, 3, 2, 3;
  surface.fields = {{.name = "displacement_mm", .unit = "mm", .values = random_values(3, 4, 5)}};
  return surface;
}

/// Expects that `action` throws an error of type E with `word` in one of its four fields.
template <class E, class Action>
void expect_report(Action action, const std::string& word) {
  testing::internal::CaptureStderr();
  const Report r = report_of<E>(action);
  EXPECT_FALSE(r.fact.empty() || r.where.empty() || r.why.empty() || r.remedy.empty());
  const std::string all = r.fact + " | " + r.where + " | " + r.why + " | " + r.remedy;
  EXPECT_NE(all.find(word), std::string::npos) << all;
  EXPECT_EQ(all.find('\n'), std::string::npos) << all;
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "VTK printed";
}

/// A damaged file, and a word of its refusal.
struct Changed {
  std::string what, content, word;
};

template <class Read>
void expect_refused(const fs::path& file, Read read, const std::vector<Changed>& changes) {
  for (const Changed& changed : changes) {
    SCOPED_TRACE(changed.what);
    put(file, changed.content);
    expect_report<InputError>([&] { read(file); }, changed.word);
  }
}

std::string vtu_of(const PointFile& points, bool exact = false) {
  const fs::path file = test_folder() / "written.vtu";
  write_vtu(file, points, 0.0, exact);
  return read_file(file);
}

std::string replaced(std::string content, const std::string& was, const std::string& is) {
  return content.replace(content.find(was), was.size(), is);
}

/// The content with another value of the first attribute of this name.
std::string with_attribute(std::string content, const std::string& name, const std::string& value) {
  const std::size_t at = content.find(name + "=\"") + name.size() + 2;
  return content.replace(at, content.find('"', at) - at, value);
}

/// The content with another letter in the first binary array.
std::string with_letter(std::string content, std::size_t letter) {
  const std::size_t tag = content.find('>', content.find("format=\"binary\""));
  content[content.find_first_not_of(" \n", tag + 1) + letter] = '/';
  return content;
}

// ------------------------------------------------------------------------------------------------------ VTU

TEST(Vtu, IsPackedByWhatIsFastInNumbersAsLongAsTheyNeedBeWithoutTextArraysOrRawBytes) {
  const std::string content = vtu_of(sample_points());
  EXPECT_EQ(vtu_of(sample_points()), content);
  for (const std::string part :
       {"compressor=\"vtkLZ4DataCompressor\"", "<DataArray type=\"Int32\" Name=\"connectivity\"",
        "<DataArray type=\"Int32\" Name=\"offsets\"", "format=\"binary\""})
    EXPECT_NE(content.find(part), std::string::npos) << part;
  for (const std::string part : {"type=\"String\"", "<AppendedData"})
    EXPECT_EQ(content.find(part), std::string::npos) << part;
}

TEST(Vtu, IsReadByVtkAsOneVertexPerPointWithUnitsTimeAndActiveDisplacement) {
  const fs::path file = fresh_folder() / "nodes.vtu";
  const PointFile points = sample_points();
  write_vtu(file, points, 0.1);

  vtkNew<vtkXMLUnstructuredGridReader> reader;
  reader->SetFileName(file.c_str());
  reader->Update();
  vtkUnstructuredGrid* grid = reader->GetOutput();
  ASSERT_EQ(grid->GetNumberOfPoints(), 50);
  ASSERT_EQ(grid->GetNumberOfCells(), 50);
  EXPECT_EQ(grid->GetCellType(49), VTK_VERTEX);
  EXPECT_EQ(grid->GetPoints()->GetDataType(), VTK_FLOAT);
  for (Index n = 0; n < 50; ++n)
    for (int c = 0; c < 3; ++c)
      EXPECT_EQ(grid->GetPoint(n)[c], static_cast<double>(static_cast<float>(points.position_mm(c, n))));

  vtkDataArray* displacement = grid->GetPointData()->GetArray("displacement_mm");
  ASSERT_NE(displacement, nullptr);
  EXPECT_EQ(grid->GetPointData()->GetVectors(), displacement);
  EXPECT_STREQ(displacement->GetInformation()->Get(vtkDataArray::UNITS_LABEL()), "mm");
  EXPECT_STREQ(displacement->GetComponentName(2), "S");
  EXPECT_EQ(grid->GetPointData()->GetArray("mass_kg")->GetDataType(), VTK_FLOAT);
  EXPECT_EQ(grid->GetPointData()->GetArray("node_set")->GetDataType(), VTK_INT);

  auto* time = vtkDoubleArray::SafeDownCast(grid->GetFieldData()->GetArray("TimeValue"));
  ASSERT_NE(time, nullptr);
  EXPECT_EQ(time->GetValue(0), 0.1);
}

TEST(Vtu, GivesBackTheSameBitsWhenExact) {
  const fs::path file = fresh_folder() / "nodes.vtu";
  const PointFile out = sample_points(40000);  // of many blocks: 960 kB of positions
  write_vtu(file, out, 8.0, true);
  const PointFile in = read_vtu(file);
  EXPECT_EQ(in.position_mm, out.position_mm);
  ASSERT_EQ(in.fields.size(), out.fields.size());
  for (std::size_t f = 0; f < out.fields.size(); ++f) {
    EXPECT_EQ(in.fields[f].name, out.fields[f].name);
    EXPECT_EQ(in.fields[f].unit, out.fields[f].unit);
    EXPECT_EQ(in.fields[f].components, out.fields[f].components);
    EXPECT_EQ(in.fields[f].type, out.fields[f].type);
  }
  EXPECT_EQ(in.find("displacement_mm")->values, out.find("displacement_mm")->values);
  EXPECT_EQ(in.find("node_set")->values, out.find("node_set")->values);
  EXPECT_EQ(in.find("mass_kg")->values, out.find("mass_kg")->values.cast<float>().cast<double>());
  EXPECT_EQ(in.find("temperature"), nullptr);
}

TEST(Vtu, RefusesAFieldThatDoesNotMatchThePoints) {
  const fs::path file = fresh_folder() / "nodes.vtu";
  PointFile points = sample_points();
  points.fields[0].values.resize(1, 7);
  EXPECT_THROW(write_vtu(file, points, 0.0), std::invalid_argument);
  points = sample_points();
  points.fields[2].values(0, 3) = std::nan("");
  EXPECT_THROW(write_vtu(file, points, 0.0), std::invalid_argument);
  EXPECT_FALSE(fs::exists(file));
}

TEST(Vtu, SaysWhyAFileCannotBeRead) {
  const fs::path folder = fresh_folder();
  expect_report<InputError>([&] { read_vtu(folder / "absent.vtu"); }, "no such file");
  expect_report<InputError>([&] { read_vtu(folder); }, "folder");
  write_vtp(folder / "surface.vtp", tetrahedron(), 0.0);
  PointFile infinite = sample_points();
  infinite.position_mm(1, 17) = std::numeric_limits<double>::infinity();
  expect_refused(
      folder / "bad.vtu", read_vtu,
      {{"empty", "", "not a VTK XML file"},
       {"picture", "\x89PNG\r\n\x1a\n", "not a VTK XML file"},
       {"legacy", "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n", "not a VTK XML file"},
       {"surface", read_file(folder / "surface.vtp"), "PolyData"},
       {"no points", vtu_of({}), "no point"},
       {"infinite", vtu_of(infinite, true), "bad.vtu"}});  // VTK itself stops at its range
}

TEST(Vtu, RefusesAbsurdNumbersAndADamagedHeader) {
  const fs::path folder = fresh_folder();
  const std::string content = vtu_of(sample_points());
  std::vector<Changed> bad;
  for (const std::string count : {"51", "9000000000000000", "-50", "many"})
    bad.push_back({count + " points", with_attribute(content, "NumberOfPoints", count), "bad.vtu"});
  for (const std::string key :
       {"<UnstructuredGrid", "type=\"Float64\"", "type=\"Float32\"", "<Points", "<Cells"}) {
    std::string damaged = content;
    damaged[content.find(key) + key.size() - 2] = '5';
    bad.push_back({key, damaged, "bad.vtu"});
  }
  for (const std::string name : {"NumberOfComponents", "NumberOfTuples"}) {
    ASSERT_NE(content.find(name + "=\""), std::string::npos);
    for (const std::string count : {"2000000000", "99999999999999999999999999", "-1", "&#50;000000000"})
      bad.push_back({name, with_attribute(content, name, count), name + " of " + count});
  }
  expect_refused(folder / "bad.vtu", read_vtu, bad);
}

TEST(Vtu, RefusesATextArrayWhereverItIs) {
  // VTK's reader treats unexpectedly terminated words as its own memory.
  const fs::path folder = fresh_folder();
  // The array is beyond the first 64 kB.
  const std::string content = vtu_of({.position_mm = Points::Random(3, 20000), .fields = {}}, true);
  std::vector<Changed> bad;
  for (const std::string element : {"DataArray", "Array"})
    bad.push_back({element,
                   replaced(content, "<Cells>",
                            "<" + element + " type=\"String\" Name=\"s\" format=\"ascii\">65 \"\" 66 0</" +
                                element + "><Cells>"),
                   "not one of numbers"});
  expect_refused(folder / "bad.vtu", read_vtu, bad);
}

TEST(Vtu, RefusesDamagedCompressedDataAndMoreBlocksThanTheFileCanHold) {
  const fs::path folder = fresh_folder();
  const std::string content = vtu_of(sample_points());
  std::string damaged = content;
  const std::size_t data = content.find_first_not_of(" \n", content.find("format=\"binary\"") + 100);
  for (std::size_t i = data + 60; i < data + 90; ++i)
    damaged[i] = content[i] == 'A' ? 'B' : 'A';  // still base64
  std::vector<Changed> bad = {{"data", damaged, "bad.vtu"}};
  // Header words, four letters for three bytes: number of blocks, bytes of each, bytes of the last,
  // compressed bytes.
  for (const std::size_t letter : {3, 8, 14, 19})
    bad.push_back({std::to_string(letter), with_letter(content, letter), "more than"});
  expect_refused(folder / "bad.vtu", read_vtu, bad);
}

TEST(Vtu, SeesThroughUnusualFormsOfAnAttribute) {
  const fs::path folder = fresh_folder();
  const std::string content = vtu_of(sample_points());
  const std::string compressor = "compressor=\"vtkLZ4DataCompressor\"";
  std::vector<Changed> bad = {
      {"character", replaced(content, "format=\"binary\"", "format=\"&#98;inary\""), "more than"}};
  for (const std::string& is :
       std::vector<std::string>{"note=\">\" " + compressor, "compressor\n = 'vtkLZ4DataCompressor'",
                                "note=\"" + std::string(300000, 'x') + "\" " + compressor}) {
    SCOPED_TRACE(is.substr(0, 60));
    const std::string unusual = replaced(content, compressor, is);
    put(folder / "unusual.vtu", unusual);
    EXPECT_EQ(read_vtu(folder / "unusual.vtu").position_mm.cols(), 50);
    bad.push_back({is.substr(0, 60), with_letter(unusual, 3), "more than"});
  }
  expect_refused(folder / "bad.vtu", read_vtu, bad);
}

// ------------------------------------------------------------------------------------------------------ VTP

/// A lattice of squares, each cut in two, with its triangles in random order.
Triangles shuffled_lattice(Index side) {
  std::vector<std::array<Index, 3>> list;
  for (Index j = 0; j + 1 < side; ++j)
    for (Index i = 0; i + 1 < side; ++i) {
      const Index a = i + side * j;
      list.push_back({a, a + 1, a + side});
      list.push_back({a + side, a + 1, a + side + 1});
    }
  std::mt19937 draw(5);
  std::shuffle(list.begin(), list.end(), draw);
  Triangles triangles(3, static_cast<Index>(list.size()));
  for (Index t = 0; t < triangles.cols(); ++t) {
    const auto& corner = list[static_cast<std::size_t>(t)];
    triangles.col(t) << corner[0], corner[1], corner[2];
  }
  return triangles;
}

/// Triangles from their smallest corner on, with their orientation.
std::set<std::array<Index, 3>> set_of(const Triangles& triangles) {
  std::set<std::array<Index, 3>> result;
  for (const auto& t : triangles.colwise()) {
    std::array<Index, 3> corner = {t[0], t[1], t[2]};
    std::rotate(corner.begin(), std::min_element(corner.begin(), corner.end()), corner.end());
    result.insert(corner);
  }
  return result;
}

TEST(Strips, HoldEachTriangleOnceWithTheSideItShows) {
  const Triangles before = shuffled_lattice(30), after = in_strips(before);
  ASSERT_EQ(after.cols(), before.cols());
  EXPECT_EQ(set_of(after).size(), static_cast<std::size_t>(before.cols()));
  EXPECT_EQ(set_of(after), set_of(before));
}

TEST(Strips, ContinueFromTriangleToTriangle) {
  const Triangles triangles = in_strips(shuffled_lattice(60));
  Index begun = 1;
  for (Index t = 1; t < triangles.cols(); ++t) {
    Index shared = 0;
    for (const Index v : triangles.col(t)) shared += (triangles.col(t - 1).array() == v).any();
    begun += shared < 2;
  }
  EXPECT_LT(3 * begun, triangles.cols());
}

TEST(Vtp, OfASmallFileHoldsPolygonsFieldsAndTimeAndGivesBackTheSameBits) {
  const fs::path file = fresh_folder() / "surface.vtp";
  SurfaceFile out{.position_mm = random_values(3, 400, 6),
                  .triangles = in_strips(shuffled_lattice(20)),
                  .fields = {{.name = "displacement_mm", .unit = "mm", .values = random_values(3, 400, 5)}},
                  .small = true};
  Eigen::MatrixXd label(1, out.triangles.cols());
  for (Index t = 0; t < label.cols(); ++t) label(0, t) = out.triangles(0, t) < 200 ? 3.0 : 7.0;
  out.on_triangles = {{.name = "label", .unit = "", .values = label, .type = Field::Type::int32}};
  write_vtp(file, out, 2.5, true);
  EXPECT_NE(read_file(file).find("compressor=\"vtkZLibDataCompressor\""), std::string::npos);

  vtkNew<vtkXMLPolyDataReader> reader;
  reader->SetFileName(file.c_str());
  reader->Update();
  vtkPolyData* mesh = reader->GetOutput();
  EXPECT_EQ(mesh->GetNumberOfStrips(), 0);
  ASSERT_EQ(mesh->GetNumberOfPolys(), out.triangles.cols());
  EXPECT_EQ(mesh->GetCellType(0), VTK_TRIANGLE);
  vtkDataArray* displacement = mesh->GetPointData()->GetVectors();
  ASSERT_NE(displacement, nullptr);
  EXPECT_STREQ(displacement->GetName(), "displacement_mm");
  EXPECT_STREQ(displacement->GetInformation()->Get(vtkDataArray::UNITS_LABEL()), "mm");
  EXPECT_EQ(mesh->GetFieldData()->GetArray("TimeValue")->GetTuple1(0), 2.5);
  vtkDataArray* labels = mesh->GetCellData()->GetArray("label");
  ASSERT_NE(labels, nullptr);
  ASSERT_EQ(labels->GetNumberOfTuples(), mesh->GetNumberOfPolys());
  for (Index t = 0; t < label.cols(); ++t) EXPECT_EQ(labels->GetTuple1(t), label(0, t));

  const SurfaceFile in = read_vtp(file);
  EXPECT_EQ(in.position_mm, out.position_mm);
  EXPECT_EQ(in.triangles, out.triangles);
  ASSERT_EQ(in.fields.size(), 1U);
  EXPECT_EQ(in.fields[0].values, out.fields[0].values.cast<float>().cast<double>());
}

/// A surface of four points as VTK writes one: its cells follow the number of its strips.
std::string surface_of(const std::string& cells) {
  return R"(<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64"><PolyData>)"
         R"(<Piece NumberOfPoints="4" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" )" +
         cells +
         R"(<Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">)"
         R"(0 0 0 1 0 0 1 1 0 0 1 0</DataArray></Points></Piece></PolyData></VTKFile>)";
}

std::string polygons(const std::string& corners, const std::string& offsets) {
  return surface_of(
      R"(NumberOfPolys="1"><Polys><DataArray type="Int64" Name="connectivity" format="ascii">)" + corners +
      R"(</DataArray><DataArray type="Int64" Name="offsets" format="ascii">)" + offsets +
      "</DataArray></Polys>");
}

std::string strips(const std::string& corners, const std::string& offsets, const std::string& count = "1") {
  std::string content = with_attribute(polygons(corners, offsets), "NumberOfStrips", count);
  content = with_attribute(content, "NumberOfPolys", "0");
  return replaced(replaced(content, "<Polys>", "<Strips>"), "</Polys>", "</Strips>");
}

TEST(Vtp, SaysWhyAFileIsNoTriangleSurface) {
  const fs::path folder = fresh_folder();
  put(folder / "good.vtp", polygons("0 1 2", "3"));
  EXPECT_EQ(read_vtp(folder / "good.vtp").triangles.cols(), 1);
  Triangles apart(3, 2);
  apart << 0, 2, 1, 1, 2, 3;
  put(folder / "good.vtp", strips("0 1 2 3", "4"));
  EXPECT_EQ(read_vtp(folder / "good.vtp").triangles, apart);
  expect_report<InputError>([&] { read_vtp(folder / "absent.vtp"); }, "no such file");
  expect_refused(folder / "bad.vtp", read_vtp,
                 {{"four corners", polygons("0 1 2 3", "4"), "4 corners"},
                  {"no such point", polygons("0 1 4", "3"), "uses point 4"},
                  {"a point below 0", polygons("0 -1 2", "3"), "bad.vtp"},
                  {"an end beyond", polygons("0 1 2", "9"), "bad.vtp"},
                  {"an end below 0", polygons("0 1 2", "-3"), "bad.vtp"},
                  {"none", surface_of(R"(NumberOfPolys="0">)"), "no triangle"},
                  {"a strip of two corners", strips("0 1", "2"), "2 corners"},
                  {"a strip of no such point", strips("0 1 4 3", "4"), "uses point 4"},
                  {"a strip of a point below 0", strips("0 -1 2", "3"), "bad.vtp"},
                  {"a strip that ends beyond", strips("0 1 2", "9"), "bad.vtp"},
                  {"a strip that ends below 0", strips("0 1 2", "-3"), "bad.vtp"},
                  {"strips that go back", strips("0 1 2 3", "900000 4", "2"), "bad.vtp"}});
  SurfaceFile surface = tetrahedron();
  surface.triangles(2, 3) = 4;  // which is no point, and is not written either
  EXPECT_THROW(write_vtp(folder / "surface.vtp", surface, 0.0), std::invalid_argument);
}

TEST(VtkFile, RefusesEveryTruncation) {
  const fs::path folder = fresh_folder();
  const auto expect_refused_beginnings = [&](const std::string& whole, const fs::path& part, auto read) {
    std::vector<Changed> parts;
    for (std::size_t length = 0; length + 40 < whole.size(); length += 97)
      parts.push_back({std::to_string(length) + " bytes", whole.substr(0, length), part.filename()});
    expect_refused(part, read, parts);
  };
  expect_refused_beginnings(vtu_of(sample_points()), folder / "part.vtu", read_vtu);
  write_vtp(folder / "surface.vtp", tetrahedron(), 0.0);
  expect_refused_beginnings(read_file(folder / "surface.vtp"), folder / "part.vtp", read_vtp);
}

// ------------------------------------------------------------------------------------------------------ VTI

/// Image of 20 x 16 x 12 voxels of 0.5 x 1 x 2 mm, rotated and shifted, with a labelled box inside.
LabelImage oblique_image(std::int32_t label) {
  LabelImage image = image_of({20, 16, 12}, Vec3::Ones(), [&](Index i, Index j, Index k) {
    return i >= 8 && i <= 17 && j >= 3 && j <= 12 && k >= 4 && k <= 7 ? label : 0;
  });
  image.to_world = Eigen::Translation3d(-31.0, 12.5, 7.0) *
                   Eigen::AngleAxisd(0.4, Vec3(1.0, -2.0, 0.5).normalized()) * Eigen::Scaling(0.5, 1.0, 2.0);
  return image;
}

vtkSmartPointer<vtkImageData> read_image(const fs::path& file) {
  vtkNew<vtkXMLImageDataReader> reader;
  reader->SetFileName(file.c_str());
  reader->Update();
  return reader->GetOutput();
}

/// Label of the nearest voxel at a position, as a viewer finds it; 0 outside.
double label_at(vtkImageData& image, const Vec3& position_mm) {
  double index[3];
  image.TransformPhysicalPointToContinuousIndex(position_mm.data(), index);
  const int* size = image.GetDimensions();
  std::array<int, 3> voxel;
  for (std::size_t d = 0; d < 3; ++d) {
    voxel[d] = static_cast<int>(std::lround(index[d]));
    if (voxel[d] < 0 || voxel[d] >= size[d]) return 0.0;
  }
  return image.GetPointData()->GetScalars()->GetTuple1(voxel[0] + size[0] * (voxel[1] + size[1] * voxel[2]));
}

TEST(Vti, PutsEveryVoxelOfAnObliqueImageInItsPlace) {
  const fs::path file = fresh_folder() / "label.vti";
  const LabelImage image = oblique_image(3);
  write_vti(file, image);
  const auto grid = read_image(file);
  EXPECT_EQ(Eigen::Map<const Eigen::Vector3i>(grid->GetDimensions()), Eigen::Vector3i(14, 14, 8));
  EXPECT_STREQ(grid->GetPointData()->GetScalars()->GetName(), "label");
  EXPECT_EQ(grid->GetPointData()->GetScalars()->GetDataType(), VTK_SIGNED_CHAR);

  const Mat3 direction = image.to_world.rotation();
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      EXPECT_NEAR(grid->GetDirectionMatrix()->GetElement(r, c), direction(r, c), 1e-14);
  for (Index k = 0; k < image.size[2]; ++k)
    for (Index j = 0; j < image.size[1]; ++j)
      for (Index i = 0; i < image.size[0]; ++i) {
        ASSERT_EQ(label_at(*grid, image.to_world * place_of(i, j, k)), image.at(i, j, k))
            << i << ' ' << j << ' ' << k;
      }
  // The grid is cropped to the foreground and two voxels more, so that the first voxel is voxel (6, 1, 2).
  const Vec3 corner = image.to_world * Vec3(6.0, 1.0, 2.0);
  for (int d = 0; d < 3; ++d) EXPECT_NEAR(grid->GetPoint(0)[d], corner[d], 1e-12);
}

TEST(Vti, UsesTheNarrowestTypeThatHoldsEveryLabel) {
  const fs::path file = fresh_folder() / "label.vti";
  for (const auto& [label, type] : {std::pair{127, VTK_SIGNED_CHAR},
                                    {128, VTK_SHORT},
                                    {32767, VTK_SHORT},
                                    {32768, VTK_UNSIGNED_SHORT},
                                    {65535, VTK_UNSIGNED_SHORT},
                                    {65536, VTK_INT},
                                    {2147483647, VTK_INT}}) {
    write_vti(file, oblique_image(label));
    const auto grid = read_image(file);
    EXPECT_EQ(grid->GetPointData()->GetScalars()->GetDataType(), type) << label;
    EXPECT_EQ(grid->GetScalarRange()[1], label);
  }
}

TEST(Vti, StraightensAShearedImageWithoutMovingItsLabels) {
  const fs::path file = fresh_folder() / "label.vti";
  LabelImage image = oblique_image(5);
  Mat3 shear = Mat3::Identity();
  shear(0, 1) = 0.3;
  image.to_world.linear() = image.to_world.linear() * shear;
  write_vti(file, image);
  const auto grid = read_image(file);
  EXPECT_TRUE(grid->GetDirectionMatrix()->IsIdentity());
  // Each sample has the label of the sheared voxel that covers its position, and nothing else appears.
  const Eigen::Affine3d to_voxel = image.to_world.inverse();
  double foreground = 0.0;
  for (vtkIdType n = 0; n < grid->GetNumberOfPoints(); ++n) {
    const Vec3 at = to_voxel * Vec3(grid->GetPoint(n)[0], grid->GetPoint(n)[1], grid->GetPoint(n)[2]);
    const Eigen::Array<Index, 3, 1> v = at.array().round().cast<Index>();
    const bool inside = (v >= 0).all() && v[0] < 20 && v[1] < 16 && v[2] < 12;
    const double label = grid->GetPointData()->GetScalars()->GetTuple1(n);
    EXPECT_EQ(label, inside ? image.at(v[0], v[1], v[2]) : 0);
    foreground += label > 0 ? 1.0 : 0.0;
  }
  const Vec3 spacing(grid->GetSpacing());
  EXPECT_NEAR(foreground * spacing.prod(), 400.0 * image.voxel_volume(), 0.05 * 400.0 * image.voxel_volume());
}

// --------------------------------------------------------------------------------------------------- series

TEST(TimeSeries, ListsRelativeFilesThatExistAfterEveryFrame) {
  const fs::path folder = fresh_folder();
  TimeSeries series(folder / "nodes.pvd", ".vtu");
  for (int frame = 0; frame < 3; ++frame) {
    write_vtu(series.next_frame(), sample_points(), 0.1 * frame);
    series.add(0.1 * frame);

    const std::string list = read_file(folder / "nodes.pvd");
    EXPECT_NE(list.find("</VTKFile>"), std::string::npos);
    int listed = 0;
    for (std::size_t at = 0; (at = list.find("file=\"", at)) != std::string::npos; ++listed) {
      at += 6;
      const fs::path named = list.substr(at, list.find('"', at) - at);
      EXPECT_TRUE(named.is_relative()) << named;
      EXPECT_TRUE(fs::exists(folder / named)) << named;
    }
    EXPECT_EQ(listed, frame + 1);
  }
  const std::string list = read_file(folder / "nodes.pvd");
  EXPECT_NE(list.find("timestep=\"0.2\" group=\"\" part=\"0\" file=\"nodes/nodes_0002.vtu\""),
            std::string::npos)
      << list;
  EXPECT_TRUE(fs::exists(folder / "nodes" / "nodes_0002.vtu"));
}

TEST(TimeSeries, ThatContinuesFromAnEarlierFrameNeverListsTheRemovedOnes) {
  const fs::path folder = fresh_folder();
  TimeSeries first(folder / "nodes.pvd", ".vtu");
  for (int frame = 0; frame < 4; ++frame) {
    write_vtu(first.next_frame(), sample_points(), 0.1 * frame);
    first.add(0.1 * frame);
  }
  TimeSeries second(folder / "nodes.pvd", ".vtu");
  second.resume({0.0, 0.1});
  const std::string list = read_file(folder / "nodes.pvd");
  for (const char* name : {"nodes_0000.vtu", "nodes_0001.vtu"}) EXPECT_NE(list.find(name), std::string::npos);
  for (const char* name : {"nodes_0002.vtu", "nodes_0003.vtu"}) {
    EXPECT_EQ(list.find(name), std::string::npos);
    EXPECT_FALSE(fs::exists(folder / "nodes" / name));
  }
  second.resume({});
  EXPECT_FALSE(fs::exists(folder / "nodes.pvd"));
}

TEST(TimeSeries, EscapesNamesThatXmlWouldMisread) {
  const fs::path folder = fresh_folder();
  TimeSeries series(folder / "a&b.pvd", ".vtu");
  write_vtu(series.next_frame(), sample_points(), 0.0);
  series.add(0.0);
  EXPECT_NE(read_file(folder / "a&b.pvd").find("file=\"a&amp;b/a&amp;b_0000.vtu\""), std::string::npos);
}

TEST(TimeSeries, DoesNotListAFrameThatWasNotWrittenAndSaysThatItCannotMakeItsFolder) {
  const fs::path folder = fresh_folder();
  TimeSeries series(folder / "nodes.pvd", ".vtu");
  expect_report<OutputError>([&] { series.add(0.0); }, "nodes_0000.vtu");
  put(folder / "file", "not a folder");
  TimeSeries nowhere(folder / "file" / "nodes.pvd", ".vtu");
  expect_report<OutputError>([&] { nowhere.next_frame(); }, "folder");
}

}  // namespace
}  // namespace dimple
