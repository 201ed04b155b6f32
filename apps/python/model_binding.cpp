#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "apps/python/binding.hpp"
#include "apps/run/model_options.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/places.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/summary.hpp"
#include "apps/scene/resolve.hpp"
#include "io/digits.hpp"
#include "preprocess/scene/usable_places.hpp"

namespace dimple {
namespace {

ModelHolder build(const Settings& settings, const LabelImage* image) {
  return computing([&] {
    const Scene scene = resolve(settings.described());
    Result result;
    build_case({.scene = scene, .image = image}, {.line = log}, result);
    stop_if_requested();
    return take_model(result, scene);
  });
}

// Organ that is read once, for models at several positions.
struct OrganInMemory {
  Settings settings;
  PreparedOrgan organ;
};

std::unique_ptr<OrganInMemory> read_organ_of(const Settings& settings, const LabelImage* image) {
  return computing([&] {
    const Scene scene = resolve(settings.described());
    return std::make_unique<OrganInMemory>(
        OrganInMemory{settings, read_once({.scene = scene, .image = image}, {.line = log})});
  });
}

// Builds a model. `settings`: changes to the organ's, except those of the image and the patch's diameter.
ModelHolder build_of_organ(const OrganInMemory& of, const Settings& settings) {
  return computing([&] {
    const Scene scene = resolve(of.settings.combined_with(settings).described());
    Result result;
    build_case({.scene = scene, .organ = &of.organ}, {.line = log}, result);
    stop_if_requested();
    return take_model(result, scene);
  });
}

std::string places_of_organ(const OrganInMemory& of, const Settings& settings) {
  return computing([&] {
    const Scene scene = resolve(of.settings.combined_with(settings).described());
    const Organ& organ = of.organ.organ;
    BoundaryOptions boundary = model_options(scene).boundary;
    boundary.voxel_mm = organ.options.boundary.voxel_mm;
    check_words(boundary);
    return places_json(scene, {usable_places(organ.body->surface, boundary), of.organ.read.warnings});
  });
}

std::string shown(const OrganInMemory& of) {
  const Result& read = of.organ.read;
  return fmt::format("<pydimple.Organ: {}, {} triangles>", volume_in_words(read.segment.voxel_volume_mm3),
                     of.organ.organ.body->surface.triangles().cols());
}

std::string usable_places_json(const Settings& settings, const LabelImage* image) {
  return computing([&] {
    const Scene scene = resolve(settings.described());
    return places_json(scene, places_of_image(scene, image, {.line = log}));
  });
}

py::array_t<double> at_surface(const ModelInMemory& built,
                               const py::array_t<double, py::array::c_style>& nodal) {
  if (nodal.ndim() != 2 || nodal.shape(0) != built.model.node_count())
    throw UsageError(
        {.fact = fmt::format("values of shape {} are given", std::string(py::str(nodal.attr("shape")))),
         .where = "Model.at_surface",
         .why = fmt::format("the model has {} nodes and needs one row of values for each",
                            built.model.node_count()),
         .remedy = "give an array of shape (nodes, components), such as nodal_parameter_m[-1]"});
  const Index components = nodal.shape(1);
  const Eigen::Map<const Eigen::MatrixXd> values(nodal.data(), components, nodal.shape(0));
  Eigen::MatrixXd at = computing([&] { return built.to_surface()(values); });
  const Index vertices = at.cols();
  return handed_over(std::move(at), {vertices, components});
}

const Model& model_in(const py::object& self) {
  return self.cast<const ModelInMemory&>().model;
}

void add_arrays(py::class_<ModelInMemory, ModelHolder>& model) {
  model
      .def_property_readonly(
          "positions_m", [](const py::object& self) { return view(self, model_in(self).X); },
          "(N, 3) float64, metres, LPS: the nodes at rest.")
      .def_property_readonly(
          "circle", [](const py::object& self) { return view(self, model_in(self).bonded_patch); },
          "(n,) int64: numbers of the nodes that move with the tool, ascending.")
      .def_property_readonly(
          "base", [](const py::object& self) { return view(self, model_in(self).base); },
          "(n,) int64: numbers of the nodes that are held, ascending.")
      .def_property_readonly(
          "points_m", [](const py::object& self) { return view(self, model_in(self).point); },
          "(Q, 3) float64, metres, LPS: the integration points at rest.")
      .def_property_readonly(
          "volume_m3", [](const py::object& self) { return view(self, model_in(self).volume); },
          "(Q,) float64, cubic metres: volume of tissue of each integration point.")
      .def_property_readonly(
          "label", [](const py::object& self) { return view(self, model_in(self).label); },
          "(Q,) int32: the image's label at each integration point, where the model was made for several "
          "tissues.")
      .def_property_readonly(
          "circle_centre_m", [](const py::object& self) { return view(self, model_in(self).tool.centre); },
          "(3,) float64, metres, LPS: first contact of the tool.")
      .def_property_readonly(
          "circle_radius_m", [](const ModelInMemory& self) { return self.model.tool.radius; },
          "float, metres.")
      .def_property_readonly(
          "push", [](const py::object& self) { return view(self, model_in(self).tool.approach); },
          "(3,) float64: unit vector, LPS, approach direction of the tool.")
      .def_property_readonly(
          "surface_mm", [](const py::object& self) { return view(self, model_in(self).surface.vertex_mm); },
          "(V, 3) float64, millimetres, LPS: vertices of the boundary at rest, for pictures.")
      .def_property_readonly(
          "triangles", [](const py::object& self) { return view(self, model_in(self).surface.triangles); },
          "(T, 3) int64: vertices of each triangle of the boundary, outward when counted anticlockwise.");
}

void add_organ(py::module_& m) {
  py::class_<OrganInMemory>(m, "Organ")
      .def(py::init(&read_organ_of))
      .def_property_readonly(
          "warnings", [](const OrganInMemory& self) { return in_keywords(self.organ.read.warnings); },
          "list of str: warnings about the image.")
      .def("__repr__", [](const OrganInMemory& self) { return shown(self); });
}

}  // namespace

ModelHolder take_model(Result& result, const ModelChoices& choices) {
  auto built = std::make_shared<ModelInMemory>();
  for (const LabelMeasure& label : result.labels)
    if (!label.name.empty()) built->label_names[label.name] = label.value;
  built->provenance = result.provenance;
  built->warnings = result.warnings;
  built->origin = result.origin;
  built->report_json = as_text(summary_of_model(choices, result));
  static_cast<Discretisation&>(built->model) = std::move(static_cast<Discretisation&>(result.model));
  built->model.scheme = result.model.scheme;
  if (built->model.support_report.unseen = result.model.support_report.unseen;
      built->model.support_report.unseen > 0)
    built->model.support = std::move(result.model.support);  // needed to interpolate fields to the surface
  return built;
}

void add_model(py::module_& m) {
  py::class_<ModelInMemory, ModelHolder> model(
      m, "Model",
      R"(A body as nodes and integration points, with its base and the contact patch of the tool.

Made by `build_model`. Its arrays are read-only views of the library's own memory, which lives as long as one of them.
Positions are LPS, in metres, but for those whose name ends in `_mm`.)");
  add_arrays(model);
  model
      .def("at_surface", &at_surface, py::arg("nodal"),
           R"(Values at the vertices of the boundary from values at the nodes.

Parameters
----------
nodal : (N, k) array
    A row for each node, for instance ``result.nodal_parameter_m[-1]``.

Returns
-------
(V, k) float64 array
    In the same unit: with the nodal parameters, ``model.surface_mm + 1e3 * model.at_surface(u)`` is the deformed boundary.)")
      .def_property_readonly(
          "report", [](const ModelInMemory& self) { return dictionary(self.report_json); },
          "dict: counts, volumes, spacings, and the reasons for the base and the place of the tool.")
      .def_property_readonly(
          "warnings", [](const ModelInMemory& self) { return in_keywords(self.warnings); },
          "list of str: warnings about the model.")
      .def("__repr__",
           [](const ModelInMemory& self) {
             return fmt::format("<pydimple.Model: {} nodes, {} integration points, contact patch {} wide>",
                                self.model.node_count(), self.model.point_count(),
                                length_in_words(2e3 * self.model.tool.radius));
           })
      .def(py::pickle([](const ModelInMemory& self) { return py::make_tuple(as_object(bytes_of(self))); },
                      [](const py::tuple& state) {
                        const std::vector<std::uint8_t> bytes = bytes_in(state, 1);
                        return computing([&] { return model_of(bytes); });
                      }));
  add_organ(m);
  m.def("build", &build);
  m.def("usable_places_json", &usable_places_json);
  m.def("build_of_organ", &build_of_organ);
  m.def("places_of_organ", &places_of_organ);
}

}  // namespace dimple
