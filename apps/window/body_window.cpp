#include "apps/window/body_window.hpp"

#include <vtkActor.h>
#include <vtkAxis.h>
#include <vtkCallbackCommand.h>
#include <vtkCamera.h>
#include <vtkCellArray.h>
#include <vtkCellPicker.h>
#include <vtkChartXY.h>
#include <vtkColorTransferFunction.h>
#include <vtkContextActor.h>
#include <vtkContextScene.h>
#include <vtkDoubleArray.h>
#include <vtkFloatArray.h>
#include <vtkInteractorStyleTrackballCamera.h>
#include <vtkNew.h>
#include <vtkObjectFactory.h>
#include <vtkPNGWriter.h>
#include <vtkPlot.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderWindow.h>
#include <vtkRenderWindowInteractor.h>
#include <vtkRenderer.h>
#include <vtkScalarBarActor.h>
#include <vtkTable.h>
#include <vtkTextActor.h>
#include <vtkTextProperty.h>
#include <vtkWindowToImageFilter.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include "apps/window/display.hpp"
#include "io/digits.hpp"
#include "io/file.hpp"

namespace dimple {
namespace {

constexpr double chart_from = 0.66;  // as a fraction of the window's width

using Rgb = std::array<double, 3>;
// Colours of overview.png and view.py.
constexpr std::array<Rgb, 7> pale_to_dark = {{{0.925, 0.922, 0.902},
                                              {0.976, 0.875, 0.639},
                                              {0.976, 0.718, 0.408},
                                              {0.933, 0.498, 0.322},
                                              {0.796, 0.290, 0.361},
                                              {0.549, 0.169, 0.420},
                                              {0.278, 0.090, 0.353}}};
void put(const Points& places, vtkPoints& points) {
  points.SetNumberOfPoints(places.cols());
  for (Index n = 0; n < places.cols(); ++n) points.SetPoint(n, places(0, n), places(1, n), places(2, n));
  points.Modified();
}

void put(const Triangles& triangles, vtkPolyData& mesh) {
  vtkNew<vtkCellArray> cells;
  cells->AllocateExact(triangles.cols(), 3 * triangles.cols());
  for (Index t = 0; t < triangles.cols(); ++t) {
    const std::array<vtkIdType, 3> corner = {triangles(0, t), triangles(1, t), triangles(2, t)};
    cells->InsertNextCell(3, corner.data());
  }
  mesh.SetPolys(cells);
}

// Mesh and its actor.
struct Shape {
  Shape() {
    mesh->SetPoints(points);
    mapper->SetInputData(mesh);
    mapper->ScalarVisibilityOff();
    actor->SetMapper(mapper);
  }
  void set(const Points& places, const Triangles& triangles) {
    put(places, *points);
    put(triangles, *mesh);
    mesh->GetPointData()->Initialize();
  }
  void move(const Points& places) {
    put(places, *points);
    mesh->Modified();
  }
  void colour(const Eigen::VectorXd& value) {
    vtkNew<vtkFloatArray> array;
    array->SetNumberOfTuples(value.size());
    for (Index n = 0; n < value.size(); ++n) array->SetValue(n, static_cast<float>(value[n]));
    mesh->GetPointData()->SetScalars(array);
  }
  vtkNew<vtkPoints> points;
  vtkNew<vtkPolyData> mesh;
  vtkNew<vtkPolyDataMapper> mapper;
  vtkNew<vtkActor> actor;
};

// Mouse style: the left button moves the tool if it is accepted, the right one rotates the body.
class ToolStyle : public vtkInteractorStyleTrackballCamera {
 public:
  static ToolStyle* New();
  vtkTypeMacro(ToolStyle, vtkInteractorStyleTrackballCamera)

      std::function<bool(int x, int y)> down;
  std::function<void(int x, int y)> moved;
  std::function<void()> up;
  std::function<bool(const std::string&)> key;

  void OnLeftButtonDown() override {
    const int* at = Interactor->GetEventPosition();
    taken_ = down && down(at[0], at[1]);
    if (!taken_) Superclass::OnLeftButtonDown();
  }
  void OnMouseMove() override {
    const int* at = Interactor->GetEventPosition();
    if (taken_)
      moved(at[0], at[1]);
    else
      Superclass::OnMouseMove();
  }
  void OnLeftButtonUp() override {
    if (taken_)
      up();
    else
      Superclass::OnLeftButtonUp();
    taken_ = false;
  }
  void OnRightButtonDown() override { Superclass::OnLeftButtonDown(); }
  void OnRightButtonUp() override { Superclass::OnLeftButtonUp(); }
  // VTK's own keys would change the display of the body.
  void OnChar() override {}
  void OnKeyPress() override {
    const char* name = Interactor->GetKeySym();
    if (!name) return;
    if (std::string(name) == "q" || std::string(name) == "Escape")
      Interactor->TerminateApp();
    else if (key && key(name))
      Interactor->Render();
  }

 private:
  bool taken_ = false;
};
vtkStandardNewMacro(ToolStyle)

    void report(vtkObject*, unsigned long, void* what, void*) {
  (*static_cast<std::function<void()>*>(what))();
}

// Legend of the displacement's colours, with its title above.
void lay_out(vtkScalarBarActor& legend, vtkColorTransferFunction& colours) {
  legend.SetLookupTable(&colours);
  legend.SetTitle("displacement [mm]\n ");  // empty line: VTK sets the numbers too close
  legend.SetOrientationToHorizontal();
  legend.SetNumberOfLabels(3);
  legend.SetLabelFormat("%.2g");
  legend.SetPosition(0.27, 0.88);
  legend.SetWidth(0.46);
  legend.SetHeight(0.10);
  legend.SetVerticalTitleSeparation(8);
  legend.UnconstrainedFontSizeOn();
  for (vtkTextProperty* text : {legend.GetTitleTextProperty(), legend.GetLabelTextProperty()}) {
    text->SetColor(0.15, 0.15, 0.15);
    text->SetFontSize(13);
    text->ItalicOff();
    text->BoldOff();
    text->ShadowOff();
  }
}

// Adds columns time, force, low, high, and a line each for the last three: the force above its error bounds.
void plot_force(vtkChartXY& chart, vtkTable& table) {
  for (const char* name : {"time", "force", "low", "high"}) {
    vtkNew<vtkDoubleArray> column;
    column->SetName(name);
    table.AddColumn(column);
  }
  chart.SetForceAxesToBounds(true);
  chart.GetAxis(vtkAxis::BOTTOM)->SetTitle("time [s]");
  const std::array<std::pair<int, Rgb>, 3> lines = {
      {{2, {0.62, 0.76, 0.88}}, {3, {0.62, 0.76, 0.88}}, {1, {0.08, 0.38, 0.63}}}};
  for (const auto& [column, colour] : lines) {
    vtkPlot* line = chart.AddPlot(vtkChart::LINE);
    line->SetInputData(&table, 0, column);
    line->SetColor(colour[0], colour[1], colour[2]);
    line->SetWidth(column == 1 ? 2.5F : 1.5F);
    line->SetVisible(false);
  }
}

}  // namespace

struct BodyWindow::Parts {
  vtkNew<vtkRenderer> view, chart_view;
  vtkNew<vtkRenderWindow> window;
  vtkNew<vtkRenderWindowInteractor> interactor;
  vtkNew<ToolStyle> style;
  Shape body, tool;
  vtkNew<vtkColorTransferFunction> colours;
  vtkNew<vtkScalarBarActor> legend;
  vtkNew<vtkTextActor> words;
  vtkNew<vtkContextActor> chart_actor;
  vtkNew<vtkChartXY> chart;
  vtkNew<vtkTable> table;
  std::function<void()> ticked;
  vtkNew<vtkCallbackCommand> on_tick;
  Vec3 up = Vec3::UnitZ(), front = -Vec3::UnitY(), centre = Vec3::Zero();
  int from_x = 0, from_y = 0, to_x = 0, to_y = 0;  // of a drag

  void look() {
    vtkCamera& camera = *view->GetActiveCamera();
    const double angle = 28.0 * std::numbers::pi / 180.0;
    const Vec3 toward = std::cos(angle) * front + std::sin(angle) * up;
    camera.ParallelProjectionOn();
    const double* box = view->ComputeVisiblePropBounds();
    const Vec3 middle(0.5 * (box[0] + box[1]), 0.5 * (box[2] + box[3]), 0.5 * (box[4] + box[5]));
    camera.SetFocalPoint(middle.data());
    camera.SetPosition(Vec3(middle + 500.0 * toward).data());
    camera.SetViewUp(up.data());
    view->ResetCamera();
    camera.Zoom(1.25);
  }

  // Sets the colours for displacements from 0 to `top`.
  void colours_to(double top) {
    colours->RemoveAllPoints();
    for (std::size_t k = 0; k < pale_to_dark.size(); ++k)
      colours->AddRGBPoint(top * static_cast<double>(k) / static_cast<double>(pale_to_dark.size() - 1),
                           pale_to_dark[k][0], pale_to_dark[k][1], pale_to_dark[k][2]);
  }

  // Approach direction on the screen, in pixels per mm.
  std::array<double, 2> approach_on_screen() {
    const auto seen = [&](const Vec3& p) {
      view->SetWorldPoint(p.x(), p.y(), p.z(), 1.0);
      view->WorldToDisplay();
      const double* d = view->GetDisplayPoint();
      return std::array<double, 2>{d[0], d[1]};
    };
    const auto a = seen(centre), b = seen(centre - up);
    return {b[0] - a[0], b[1] - a[1]};
  }

  void open() {
    view->SetViewport(0.0, 0.0, chart_from, 1.0);
    view->SetBackground(1.0, 1.0, 1.0);
    chart_view->SetViewport(chart_from, 0.0, 1.0, 1.0);
    chart_view->SetBackground(1.0, 1.0, 1.0);
    window->SetSize(1280, 760);
    window->SetWindowName("Dimple");
    window->SetMultiSamples(0);  // software rendering would take a multiple of the time
    window->AddRenderer(view);
    window->AddRenderer(chart_view);
  }

  // Adds the body, coloured by displacement, and the tool in metal; the mouse picks only the body.
  void add_shapes() {
    colours->SetColorSpaceToLab();
    colours_to(1.0);
    body.mapper->SetLookupTable(colours);
    body.mapper->UseLookupTableScalarRangeOn();
    body.mapper->ScalarVisibilityOn();
    body.actor->GetProperty()->SetAmbient(0.25);
    body.actor->GetProperty()->SetDiffuse(0.75);
    view->AddActor(body.actor);
    tool.actor->GetProperty()->SetColor(0.31, 0.62, 0.65);  // as in overview.png
    tool.actor->PickableOff();
    view->AddActor(tool.actor);
  }

  void add_texts() {
    lay_out(*legend, *colours);
    view->AddActor2D(legend);
    words->GetTextProperty()->SetColor(0.15, 0.15, 0.15);
    words->GetTextProperty()->SetFontSize(16);
    words->SetPosition(14, 12);
    view->AddActor2D(words);
  }

  void add_chart() {
    vtkNew<vtkContextScene> scene;
    scene->AddItem(chart);
    chart_actor->SetScene(scene);
    chart_view->AddActor(chart_actor);
    plot_force(*chart, *table);
  }

  void take_mouse_and_keys() {
    interactor->SetRenderWindow(window);
    interactor->SetInteractorStyle(style);
    style->SetDefaultRenderer(view);
    style->SetCurrentRenderer(view);
    style->AutoAdjustCameraClippingRangeOn();
  }

  // Point of the body under the mouse.
  std::optional<Vec3> body_at(int x, int y) {
    vtkNew<vtkCellPicker> picker;
    picker->SetTolerance(0.0005);
    if (!picker->Pick(x, y, 0.0, view)) return {};
    return Vec3(picker->GetPickPosition());
  }

  // Distance [mm] of a drag along the approach direction.
  double dragged_to(int x, int y) {
    const auto approach = approach_on_screen();
    const double mm = std::hypot(approach[0], approach[1]);  // pixels
    const double dx = x - from_x, dy = y - from_y;
    const double in_one = 0.5 * view->GetSize()[1] / view->GetActiveCamera()->GetParallelScale();
    // Seen from straight above, the approach direction has no length on the screen: a drag down presses.
    return mm > 0.3 * in_one ? (dx * approach[0] + dy * approach[1]) / (mm * mm) : -dy / in_one;
  }
};

BodyWindow::BodyWindow() {
  require_display();
  parts_ = std::make_unique<Parts>();
  Parts& p = *parts_;
  p.open();
  p.add_shapes();
  p.add_texts();
  p.add_chart();
  p.take_mouse_and_keys();
  p.style->down = [this](int x, int y) {
    const std::optional<Vec3> place = pressed ? parts_->body_at(x, y) : std::nullopt;
    if (!place) return false;
    parts_->from_x = parts_->to_x = x, parts_->from_y = parts_->to_y = y;
    return pressed(*place);
  };
  p.style->moved = [this](int x, int y) {
    parts_->to_x = x, parts_->to_y = y;
    if (dragged) dragged(parts_->dragged_to(x, y));
  };
  p.style->up = [this] {
    if (const auto place = on_release ? parts_->body_at(parts_->to_x, parts_->to_y) : std::nullopt)
      on_release(*place);
    if (released) released();
  };
  p.style->key = [this](const std::string& name) { return key && key(name); };
}

BodyWindow::~BodyWindow() = default;

void BodyWindow::show(const ShownBody& body, double most_mm, bool look) {
  Parts& p = *parts_;
  p.up = body.up, p.front = body.front, p.centre = body.centre_mm;
  p.body.set(body.surface_mm, body.triangles);
  p.tool.set(body.tool_mm, body.tool_triangles);
  p.tool.actor->SetPosition(0.0, 0.0, 0.0);
  p.colours_to(std::max(most_mm, 1e-6));
  if (look) p.look();
}

void BodyWindow::show(const ShownFrame& frame) {
  Parts& p = *parts_;
  p.body.move(frame.surface_mm);
  p.body.colour(frame.displacement_mm);
  p.tool.actor->SetPosition(frame.tool_mm.x(), frame.tool_mm.y(), frame.tool_mm.z());
  p.words->SetInput(frame.words.c_str());
}

void BodyWindow::show(const std::vector<ShownForce>& curve) {
  Parts& p = *parts_;
  const auto count = static_cast<vtkIdType>(curve.size());
  double largest = 0.0;
  for (const ShownForce& now : curve) largest = std::max(largest, std::abs(now.force_N));
  const Written unit = force_written(largest);
  // Ticks start at the least value, so rounding errors at rest are set to zero.
  const auto shown = [&](double N) { return std::abs(N) < 1e-3 * largest ? 0.0 : unit.per_unit * N; };
  p.chart->GetAxis(vtkAxis::LEFT)->SetTitle(std::string("force [") + unit.unit + "]");
  p.table->SetNumberOfRows(count);
  for (vtkIdType k = 0; k < count; ++k) {
    const ShownForce& now = curve[static_cast<std::size_t>(k)];
    const std::array<double, 4> row = {now.time_s, shown(now.force_N), shown(now.low_N), shown(now.high_N)};
    for (vtkIdType c = 0; c < 4; ++c)
      vtkDoubleArray::SafeDownCast(p.table->GetColumn(c))->SetValue(k, row[static_cast<std::size_t>(c)]);
  }
  for (vtkIdType c = 0; c < 4; ++c) p.table->GetColumn(c)->Modified();
  p.table->Modified();
  for (vtkIdType k = 0; k < p.chart->GetNumberOfPlots(); ++k) {
    p.chart->GetPlot(k)->SetVisible(count > 1);
    p.chart->GetPlot(k)->Modified();
  }
  if (count > 1) p.chart->RecalculateBounds();
}

void BodyWindow::draw() {
  parts_->view->ResetCameraClippingRange();
  parts_->window->Render();
}

void BodyWindow::save_picture(const std::filesystem::path& png) {
  draw();
  vtkNew<vtkWindowToImageFilter> picture;
  picture->SetInput(parts_->window);
  picture->ReadFrontBufferOff();
  picture->Update();
  vtkNew<vtkPNGWriter> writer;
  writer->SetInputConnection(picture->GetOutputPort());
  writer->WriteToMemoryOn();
  writer->Write();
  vtkUnsignedCharArray& bytes = *writer->GetResult();
  write_file(png, std::string(reinterpret_cast<const char*>(bytes.GetPointer(0)),
                              static_cast<std::size_t>(bytes.GetNumberOfValues())));
}

void BodyWindow::run() {
  Parts& p = *parts_;
  p.interactor->Initialize();
  p.ticked = [this] {
    if (tick && !tick()) parts_->interactor->TerminateApp();
  };
  p.on_tick->SetCallback(report);
  p.on_tick->SetClientData(&p.ticked);
  p.interactor->AddObserver(vtkCommand::TimerEvent, p.on_tick);
  p.interactor->CreateRepeatingTimer(4);
  draw();
  p.interactor->Start();
}

}  // namespace dimple
