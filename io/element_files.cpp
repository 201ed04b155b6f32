#include "io/element_files.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <cmath>
#include <iterator>

#include "io/error.hpp"

namespace dimple {
namespace {

constexpr double kPa = 1e-3;  // per Pa

using Text = std::back_insert_iterator<std::string>;

// Numbers from 1, sixteen a line: the limit of Abaqus's and CalculiX's readers.
void list(Text out, const std::vector<Index>& nodes) {
  for (std::size_t k = 0; k < nodes.size(); ++k)
    fmt::format_to(out, "{}{}", nodes[k] + 1, k + 1 == nodes.size() || k % 16 == 15 ? "\n" : ", ");
}

// Remarks at the head of both files, one a line.
std::vector<std::string> head(const ElementModel& m) {
  std::vector<std::string> lines = m.remarks;
  lines.push_back("Units: mm, mN, kPa; positions are LPS. Divide forces by 1000 for N.");
  lines.push_back(fmt::format(
      "Tissue: W = mu/2 (J^(-2/3) tr C - 3) + kappa/2 (J - 1)^2, mu = {:.6g} Pa, kappa = {:.6g} Pa.", m.mu,
      m.kappa));
  return lines;
}

// The axis of the press direction, or 3 for none.
int axis_of(const Vec3& approach) {
  for (int d = 0; d < 3; ++d)
    if (std::abs(std::abs(approach[d]) - 1.0) < 1e-9) return d;
  return 3;
}

}  // namespace

std::string calculix_input(const ElementModel& m) {
  std::string text;
  const Text out(text);
  for (const std::string& line : head(m)) fmt::format_to(out, "** {}\n", line);
  fmt::format_to(
      out,
      "** CalculiX: U = C10 (I1_bar - 3) + 1/D1 (J - 1)^2: the same with C10 = mu/2, D1 = 2/kappa.\n"
      "** C3D10: linear elements lock at this kappa / mu; CalculiX has no mixed (hybrid) ones.\n"
      "*NODE, NSET=all\n");
  for (Index a = 0; a < m.X.cols(); ++a)
    fmt::format_to(out, "{}, {:.9g}, {:.9g}, {:.9g}\n", a + 1, m.X(0, a), m.X(1, a), m.X(2, a));
  fmt::format_to(out, "*ELEMENT, TYPE=C3D10, ELSET=tissue\n");
  for (Index e = 0; e < m.elements.cols(); ++e) {
    fmt::format_to(out, "{}", e + 1);
    for (Index k = 0; k < m.elements.rows(); ++k) fmt::format_to(out, ", {}", m.elements(k, e) + 1);
    fmt::format_to(out, "\n");
  }
  fmt::format_to(out, "*NSET, NSET=base\n");
  list(out, m.base);
  fmt::format_to(out, "*NSET, NSET=circle\n");
  list(out, m.bonded_patch);
  fmt::format_to(out,
                 "*MATERIAL, NAME=soft\n*HYPERELASTIC, NEO HOOKE\n{:.9g}, {:.9g}\n"
                 "*SOLID SECTION, ELSET=tissue, MATERIAL=soft\n",
                 0.5 * m.mu * kPa, 2.0 / (m.kappa * kPa));
  const bool turned = !m.bonded && axis_of(m.approach) == 3;
  if (turned) {
    // The first axis along the press direction: the only one that is prescribed.
    const Vec3 side = m.approach.unitOrthogonal();
    fmt::format_to(out, "*TRANSFORM, NSET=circle, TYPE=R\n{:.9g}, {:.9g}, {:.9g}, {:.9g}, {:.9g}, {:.9g}\n",
                   m.approach.x(), m.approach.y(), m.approach.z(), side.x(), side.y(), side.z());
  }
  fmt::format_to(out, "*BOUNDARY\nbase, 1, 3\n");
  const double step = 1.0 / m.frames;
  // GENERATE would stop CalculiX where there is only one.
  fmt::format_to(out, "*TIME POINTS, NAME=depths\n");
  for (int k = 1; k <= m.frames; ++k) fmt::format_to(out, "{:.9g}\n", static_cast<double>(k) / m.frames);
  fmt::format_to(out, "*STEP, NLGEOM, INC=10000\n*STATIC\n{0:.9g}, 1., 1e-6, {0:.9g}\n*BOUNDARY\n", step);
  if (turned) {
    fmt::format_to(out, "circle, 1, 1, {:.9g}\n", m.depth_mm);
  } else {
    for (int d = 0; d < 3; ++d)
      if (m.bonded || d == axis_of(m.approach))
        fmt::format_to(out, "circle, {0}, {0}, {1:.9g}\n", d + 1, m.depth_mm * m.approach[d] + 0.0);
  }
  fmt::format_to(out,
                 "*NODE PRINT, NSET=circle, TOTALS=ONLY, GLOBAL=YES, TIME POINTS=depths\nRF\n*END STEP\n");
  return text;
}

namespace {

void require_febio_approach(const ElementModel& m) {
  if (m.bonded || axis_of(m.approach) < 3) return;
  throw UsageError(
      {.fact = fmt::format("FEBio cannot model a frictionless contact patch with the approach direction "
                           "({:.3f}, {:.3f}, {:.3f})",
                           m.approach.x(), m.approach.y(), m.approach.z()),
       .where = "--contact frictionless",
       .why = "its prescribed displacements are along x, y and z",
       .remedy = "give --direction along an axis, e.g. 0,0,-1, or --contact bonded, or --format calculix"});
}

void febio_comments(Text out, const ElementModel& m) {
  for (std::string line : head(m)) {
    // Two hyphens would end an XML comment.
    for (std::size_t at; (at = line.find("--")) != std::string::npos;) line.replace(at, 2, "- -");
    fmt::format_to(out, "<!-- {} -->\n", line);
  }
  fmt::format_to(
      out,
      "<!-- FEBio: W = c1 (I1_bar - 3) + U(J), U = k/2 (J - 1)^2 with the pressure model Abaqus: c1 = mu/2, "
      "k = "
      "kappa. -->\n"
      "<!-- tet10 with a pressure of their own (three-field): without, they lock at this k / c1. -->\n");
}

void febio_control(Text out, int frames) {
  fmt::format_to(out,
                 "  <Module type=\"solid\"/>\n"
                 "  <Control>\n    <analysis>STATIC</analysis>\n    <time_steps>{0}</time_steps>\n"
                 "    <step_size>{1:.9g}</step_size>\n"
                 "    <time_stepper type=\"default\">\n      <max_retries>20</max_retries>\n      "
                 "<opt_iter>15</opt_iter>\n"
                 "      <dtmin>{2:.9g}</dtmin>\n      <dtmax lc=\"2\">{1:.9g}</dtmax>\n    </time_stepper>\n"
                 "    <solver type=\"solid\">\n      "
                 "<symmetric_stiffness>symmetric</symmetric_stiffness>\n    </solver>\n"
                 "  </Control>\n",
                 frames, 1.0 / frames, 1e-4 / frames);
}

void febio_material(Text out, const ElementModel& m) {
  fmt::format_to(out,
                 "  <Material>\n    <material id=\"1\" name=\"soft\" type=\"Mooney-Rivlin\">\n      "
                 "<density>1e-6</density>\n"
                 "      <c1>{:.9g}</c1>\n      <c2>0</c2>\n      <k>{:.9g}</k>\n"
                 "      <pressure_model>Abaqus</pressure_model>\n    </material>\n  </Material>\n",
                 0.5 * m.mu * kPa, m.kappa * kPa);
}

void febio_node_set(Text out, const char* name, const std::vector<Index>& nodes) {
  fmt::format_to(out, "    <NodeSet name=\"{}\">\n", name);
  for (std::size_t k = 0; k < nodes.size(); ++k)
    fmt::format_to(out, "{}{}", nodes[k] + 1,
                   k + 1 == nodes.size() || k % 16 == 15 ? (k + 1 == nodes.size() ? "\n" : ",\n") : ",");
  fmt::format_to(out, "    </NodeSet>\n");
}

void febio_mesh(Text out, const ElementModel& m) {
  fmt::format_to(out, "  <Mesh>\n    <Nodes name=\"all\">\n");
  for (Index a = 0; a < m.X.cols(); ++a)
    fmt::format_to(out, "      <node id=\"{}\">{:.9g},{:.9g},{:.9g}</node>\n", a + 1, m.X(0, a), m.X(1, a),
                   m.X(2, a));
  fmt::format_to(out, "    </Nodes>\n    <Elements type=\"tet10\" name=\"tissue\">\n");
  for (Index e = 0; e < m.elements.cols(); ++e) {
    fmt::format_to(out, "      <elem id=\"{}\">", e + 1);
    for (Index k = 0; k < m.elements.rows(); ++k)
      fmt::format_to(out, "{}{}", k == 0 ? "" : ",", m.elements(k, e) + 1);
    fmt::format_to(out, "</elem>\n");
  }
  fmt::format_to(out, "    </Elements>\n");
  febio_node_set(out, "base", m.base);
  febio_node_set(out, "circle", m.bonded_patch);
  fmt::format_to(out,
                 "  </Mesh>\n  <MeshDomains>\n    <SolidDomain name=\"tissue\" mat=\"soft\" "
                 "type=\"three-field-solid\"/>\n  </MeshDomains>\n");
}

void febio_boundary(Text out, const ElementModel& m) {
  fmt::format_to(out,
                 "  <Boundary>\n    <bc name=\"held\" node_set=\"base\" type=\"zero displacement\">\n"
                 "      <x_dof>1</x_dof>\n      <y_dof>1</y_dof>\n      <z_dof>1</z_dof>\n    </bc>\n");
  for (int d = 0; d < 3; ++d)
    if (m.bonded || d == axis_of(m.approach))
      fmt::format_to(out,
                     "    <bc name=\"push_{0}\" node_set=\"circle\" type=\"prescribed displacement\">\n"
                     "      <dof>{0}</dof>\n      <value lc=\"1\">{1:.9g}</value>\n      "
                     "<relative>0</relative>\n    </bc>\n",
                     "xyz"[d], m.depth_mm * m.approach[d] + 0.0);
  fmt::format_to(out, "  </Boundary>\n");
}

// The first curve moves the tool to its depth, the second limits the steps.
void febio_load_curves(Text out, int frames) {
  fmt::format_to(
      out,
      "  <LoadData>\n    <load_controller id=\"1\" type=\"loadcurve\">\n"
      "      <interpolate>LINEAR</interpolate>\n      <points>\n        <pt>0,0</pt>\n        <pt>1,1</pt>\n"
      "      </points>\n    </load_controller>\n"
      // A curve for the largest step makes FEBio stop at each of its points.
      "    <load_controller id=\"2\" type=\"loadcurve\">\n      <interpolate>STEP</interpolate>\n      "
      "<points>\n");
  for (int k = 0; k <= frames; ++k)
    fmt::format_to(out, "        <pt>{0:.9g},{1:.9g}</pt>\n", static_cast<double>(k) / frames, 1.0 / frames);
  fmt::format_to(out, "      </points>\n    </load_controller>\n  </LoadData>\n");
}

}  // namespace

std::string febio_input(const ElementModel& m) {
  require_febio_approach(m);
  std::string text = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
  const Text out(text);
  febio_comments(out, m);
  fmt::format_to(out, "<febio_spec version=\"4.0\">\n");
  febio_control(out, m.frames);
  febio_material(out, m);
  febio_mesh(out, m);
  febio_boundary(out, m);
  febio_load_curves(out, m.frames);
  fmt::format_to(out,
                 "  <Output>\n    <logfile>\n      <node_data data=\"Rx;Ry;Rz\" node_set=\"circle\" "
                 "file=\"circle_forces.txt\" delim=\" \"/>\n"
                 "    </logfile>\n  </Output>\n</febio_spec>\n");
  return text;
}

}  // namespace dimple
