// Results in VTK's own readers, those of ParaView and 3D Slicer, have the position of the organ.

#include <vtkCellArray.h>
#include <vtkCellData.h>
#include <vtkCellType.h>
#include <vtkDataArray.h>
#include <vtkFieldData.h>
#include <vtkImageData.h>
#include <vtkInformation.h>
#include <vtkMatrix3x3.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPolyData.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLImageDataReader.h>
#include <vtkXMLPolyDataReader.h>
#include <vtkXMLUnstructuredGridReader.h>

#include "tests/end_to_end/in_folder.hpp"

namespace dimple {
namespace {

template <class Reader>
void read(Reader& reader, const fs::path& file) {
  ASSERT_TRUE(reader.CanReadFile(file.c_str())) << file;
  reader.SetFileName(file.c_str());
  reader.Update();
  ASSERT_EQ(reader.GetErrorCode(), 0u) << file;
}

void expect_finite(vtkDataSet* data, const char* name, int components, const char* unit) {
  vtkDataArray* array = data->GetPointData()->GetArray(name);
  ASSERT_NE(array, nullptr) << name;
  EXPECT_EQ(array->GetNumberOfComponents(), components) << name;
  EXPECT_EQ(array->GetNumberOfTuples(), data->GetNumberOfPoints()) << name;
  for (vtkIdType t = 0; t < array->GetNumberOfTuples(); ++t)
    for (int c = 0; c < components; ++c) ASSERT_TRUE(std::isfinite(array->GetComponent(t, c))) << name;
  if (*unit) {
    ASSERT_TRUE(array->GetInformation()->Has(vtkDataArray::UNITS_LABEL())) << name;
    EXPECT_STREQ(array->GetInformation()->Get(vtkDataArray::UNITS_LABEL()), unit) << name;
  }
}

TEST(ResultFiles, OpenInVtksOwnReadersAndLieOverTheLabels) {
  const fs::path folder = fresh_folder();
  good(folder, "phantom brain.nrrd --spacing 3");
  good(folder, "run brain.nrrd -o out -q --nodes 500 --depth 1mm --time quasi-static --frames 2");

  vtkNew<vtkXMLImageDataReader> label;
  read(*label, folder / "out" / "label.vti");
  vtkImageData* image = label->GetOutput();
  ASSERT_NE(image->GetPointData()->GetArray("label"), nullptr);
  double range[2];
  image->GetPointData()->GetArray("label")->GetRange(range);
  EXPECT_EQ(range[0], 0.0);
  EXPECT_EQ(range[1], 2.0);
  EXPECT_TRUE(image->GetDirectionMatrix()->IsIdentity());
  double box[6];
  image->GetBounds(box);

  const Table forces = read_csv(folder / "out" / "force.csv");
  for (const char* frame : {"0000", "0001", "0002"}) {
    SCOPED_TRACE(frame);
    vtkNew<vtkXMLUnstructuredGridReader> nodes;
    read(*nodes, folder / "out" / "nodes" / (std::string("nodes_") + frame + ".vtu"));
    vtkUnstructuredGrid* grid = nodes->GetOutput();
    EXPECT_EQ(grid->GetNumberOfPoints(), 500);
    EXPECT_EQ(grid->GetNumberOfCells(), 500);
    EXPECT_EQ(grid->GetCellType(0), VTK_VERTEX);
    expect_finite(grid, "displacement_mm", 3, "mm");
    expect_finite(grid, "reaction_N", 3, "N");
    expect_finite(grid, "node_set", 1, "");
    expect_finite(grid, "mass_kg", 1, "kg");
    EXPECT_STREQ(grid->GetPointData()->GetVectors()->GetName(), "displacement_mm");
    ASSERT_NE(grid->GetFieldData()->GetArray("TimeValue"), nullptr);
    double bounds[6];
    grid->GetBounds(bounds);
    for (int d = 0; d < 3; ++d) {
      EXPECT_GT(bounds[2 * d], box[2 * d]);
      EXPECT_LT(bounds[2 * d + 1], box[2 * d + 1]);
    }

    vtkNew<vtkXMLUnstructuredGridReader> points;  // of the last depth
    read(*points, folder / "out" / "points" / "points_0000.vtu");
    expect_finite(points->GetOutput(), "displacement_mm", 3, "mm");
    expect_finite(points->GetOutput(), "cauchy_stress_Pa", 6, "Pa");
    expect_finite(points->GetOutput(), "von_mises_Pa", 1, "Pa");
    expect_finite(points->GetOutput(), "jacobian", 1, "");
    expect_finite(points->GetOutput(), "volume_mm3", 1, "mm^3");
    EXPECT_STREQ(points->GetOutput()->GetPointData()->GetArray("cauchy_stress_Pa")->GetComponentName(3),
                 "XY");

    vtkNew<vtkXMLPolyDataReader> surface;
    read(*surface, folder / "out" / "surface" / (std::string("surface_") + frame + ".vtp"));
    EXPECT_GT(surface->GetOutput()->GetNumberOfPolys(), 100);
    EXPECT_EQ(surface->GetOutput()->GetNumberOfStrips(), 0) << "not every program reads them";
    expect_finite(surface->GetOutput(), "displacement_mm", 3, "mm");
    expect_finite(surface->GetOutput(), "von_mises_Pa", 1, "Pa");

    vtkNew<vtkXMLPolyDataReader> section;
    read(*section, folder / "out" / "section" / (std::string("section_") + frame + ".vtp"));
    expect_finite(section->GetOutput(), "displacement_mm", 3, "mm");
    expect_finite(section->GetOutput(), "von_mises_Pa", 1, "Pa");
    vtkDataArray* labels = section->GetOutput()->GetCellData()->GetArray("label");
    ASSERT_NE(labels, nullptr);
    labels->GetRange(range);
    EXPECT_GE(range[0], 1.0);
    EXPECT_LE(range[1], 2.0);

    vtkNew<vtkXMLPolyDataReader> tool;
    read(*tool, folder / "out" / "tool" / (std::string("tool_") + frame + ".vtp"));
    const auto fact = [&](const char* name) {
      return tool->GetOutput()->GetFieldData()->GetArray(name)->GetComponent(0, 0);
    };
    const auto& depths = *forces.find("indentation_mm");
    const auto row = static_cast<std::size_t>(std::min_element(depths.begin(), depths.end(),
                                                               [&](double a, double b) {
                                                                 return std::abs(a - fact("indentation_mm")) <
                                                                        std::abs(b - fact("indentation_mm"));
                                                               }) -
                                              depths.begin());
    EXPECT_NEAR(depths[row], fact("indentation_mm"), 1e-9);
    EXPECT_NEAR((*forces.find("force_N"))[row], fact("force_N"), 1e-3 * forces.find("force_N")->back());
  }

  // Nodal parameters are prescribed: the bonded patch moved by the requested depth, the base did not move.
  vtkNew<vtkXMLUnstructuredGridReader> last;
  read(*last, folder / "out" / "nodes" / "nodes_0002.vtu");
  vtkPointData* data = last->GetOutput()->GetPointData();
  int base = 0, bonded_patch = 0;
  for (vtkIdType a = 0; a < 500; ++a) {
    const auto set = static_cast<int>(data->GetArray("node_set")->GetComponent(a, 0));
    const double down = -data->GetArray("nodal_parameter_mm")->GetComponent(a, 2);
    if (set & 1) {
      EXPECT_EQ(down, 0.0);
    }
    if (set & 2) {
      EXPECT_NEAR(down, 1.0, 1e-6);
    }
    base += (set & 1) != 0;
    bonded_patch += (set & 2) != 0;
  }
  EXPECT_GT(base, 20);
  EXPECT_GE(bonded_patch, 7);
}

}  // namespace
}  // namespace dimple
