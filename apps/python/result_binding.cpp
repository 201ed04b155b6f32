#include <fmt/format.h>

#include <functional>
#include <nlohmann/json.hpp>

#include "apps/python/binding.hpp"
#include "apps/run/model_files.hpp"
#include "apps/run/record.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/words.hpp"
#include "apps/scene/resolve.hpp"

namespace dimple {
namespace {

// Removes the frames before a cut, as the cut body has another model.
void forget_frames(Solved& solved) {
  solved.frame_time.clear(), solved.frame_depth.clear(), solved.frame_u.clear();
}

void add(Solved& solved, const Frame& frame) {
  solved.frame_time.push_back(frame.t);
  solved.frame_depth.push_back(frame.depth);
  for (Index a = 0; a < frame.u.cols(); ++a)
    solved.frame_u.insert(solved.frame_u.end(), &frame.u(0, a), &frame.u(0, a) + 3);
}

// Takes a result. `built`: the model that was solved; null: it was made for this run.
void take(Solved& solved, Result& result, const ModelChoices& choices, ModelHolder built = nullptr) {
  solved.force = std::move(result.history.force);
  solved.error_bounds = result.error_bounds;
  solved.warnings = result.warnings;
  solved.model = built ? std::move(built) : take_model(result, choices);
}

// View of a column of the force curve, in place.
py::array curve(const py::object& self, double ForceSample::*column) {
  const std::vector<ForceSample>& force = self.cast<const Solved&>().force;
  return view(self, force.empty() ? nullptr : &(force.front().*column),
              {static_cast<py::ssize_t>(force.size())}, {sizeof(ForceSample)});
}

// View of the force on the tool or of its moment: three numbers of each sample, in place.
py::array on_tool(const py::object& self, std::size_t first) {
  const std::vector<ForceSample>& force = self.cast<const Solved&>().force;
  return view(self, force.empty() ? nullptr : &force.front().on_tool[first],
              {static_cast<py::ssize_t>(force.size()), 3}, {sizeof(ForceSample), sizeof(double)});
}

py::object bounds_or_none(const Solved& solved, std::vector<double> bound) {
  if (!solved.error_bounds.known()) return py::none();
  const auto count = static_cast<py::ssize_t>(bound.size());
  return handed_over(std::move(bound), {count});
}

py::object lower(const Solved& solved) {
  return bounds_or_none(solved, lower_bounds(solved.force, solved.error_bounds));
}

py::object upper(const Solved& solved) {
  std::vector<double> high = solved.error_bounds.half;
  for (std::size_t k = 0; k < high.size(); ++k) high[k] += solved.force[k].force;
  return bounds_or_none(solved, std::move(high));
}

std::string shown(const Solved& solved) {
  if (solved.force.empty()) return "<pydimple.Result: no force>";
  const ForceSample& last = solved.force.back();
  std::optional<double> half_N;
  if (solved.error_bounds.known()) half_N = solved.error_bounds.half.back();
  return "<pydimple.Result: " + force_title(last.force, 1e3 * last.depth, half_N) +
         (half_N ? ""
                 : ", no error estimate: " + in_keywords(solved.error_bounds.unknown).cast<std::string>()) +
         ">";
}

// Result of simulate() for a case, all in memory. `summary` gives the first part of the summary; `built`: the
// model with which the case begins.
std::unique_ptr<Solved> solved(const Case& given, const std::function<Json(const Result&)>& summary,
                               const ModelHolder& built = nullptr) {
  return computing([&] {
    const Stopwatch whole;
    auto kept = std::make_unique<Solved>();
    Result result;
    simulate(given,
             {.line = log,
              .after_cut = [&](Result&) { forget_frames(*kept); },
              .march = {.frame = [&](const Frame& frame) { add(*kept, frame); },
                        .sample = [](const ForceSample&,
                                     const History&) { return stop_requested() == StopReason::none; }}},
             result);
    if (result.history.interrupted) throw Stopped(stop_requested());
    Json all = summary(result);
    add_run(all, given.scene, result, {.solve_s = result.solve_s, .total_s = whole.seconds()}, "finished",
            ExitCode::ok, nullptr);
    kept->summary_json = as_text(all);
    const bool is_built =
        built && result.levels.empty() && !result.unloaded;  // otherwise the run made other nodes
    take(*kept, result, result.origin ? result.origin->choices : given.scene, is_built ? built : nullptr);
    return kept;
  });
}

std::unique_ptr<Solved> solve_model(const ModelHolder& built, const Settings& settings) {
  Case given{.scene = resolve(settings.described())};
  if (!given.scene.tool) require_patch_nodes(*built, "solve");
  given.error_bounds = given.scene.error_bounds;
  given.model = ModelFiles{.places = built->model,
                           .scheme = built->model.scheme,
                           .label_names = built->label_names,
                           .provenance = built->provenance,
                           .facing_fraction = built->origin ? built->origin->facts.facing_fraction : 0.0,
                           .notes = {}};
  given.origin = built->origin;
  return solved(
      given,
      [&](const Result& result) {
        return Json{{"made_from", result.provenance}};
      },
      built);
}

std::unique_ptr<Solved> run_in_memory(const Settings& settings, const LabelImage* image) {
  const Scene scene = resolve(settings.described());
  return solved({.scene = scene, .image = image, .error_bounds = scene.error_bounds},
                [&](const Result& result) { return summary_of_image(scene, result); });
}

std::unique_ptr<Solved> run_into_folder(const Settings& settings, const LabelImage* image,
                                        const std::string& folder, bool overwrite) {
  return computing([&] {
    const auto options = settings.described();
    const Scene scene = resolve(options);
    auto kept = std::make_unique<Solved>();
    const Outcome outcome = record_run(options, folder, overwrite ? Existing::replace : Existing::refuse,
                                       {.line = log,
                                        .frame = [&](const Frame& frame) { add(*kept, frame); },
                                        .after_cut = [&] { forget_frames(*kept); },
                                        .result = [&](Result& result) { take(*kept, result, scene); }},
                                       image);
    if (outcome.interrupted) throw Stopped(stop_requested());
    kept->summary_json = outcome.summary_json;
    return kept;
  });
}

void add_forces(py::class_<Solved>& result) {
  result
      .def_property_readonly(
          "depth_m", [](const py::object& self) { return curve(self, &ForceSample::depth); },
          "(S,) float64, metres: depth of the tool below first contact.")
      .def_property_readonly(
          "force_N", [](const py::object& self) { return curve(self, &ForceSample::force); },
          "(S,) float64, newtons: on the tool along its approach direction, positive where the tissue "
          "resists.")
      .def_property_readonly(
          "base_force_N", [](const py::object& self) { return curve(self, &ForceSample::base_force); },
          "(S,) float64, newtons: reaction of the base.")
      .def_property_readonly(
          "force_on_tool_N", [](const py::object& self) { return on_tool(self, 0); },
          "(S, 3) float64, newtons, LPS: force vector on the tool.")
      .def_property_readonly(
          "moment_on_tool_Nm", [](const py::object& self) { return on_tool(self, 3); },
          "(S, 3) float64, newton metres, LPS: its moment about the centre of the contact patch, which moves "
          "with the tool.")
      .def_property_readonly(
          "time_s", [](const py::object& self) { return curve(self, &ForceSample::t); },
          "(S,) float64, seconds since first contact.");
}

void add_error_bounds(py::class_<Solved>& result) {
  result
      .def_property_readonly(
          "band",
          [](const Solved& self) -> py::object {
            if (!self.error_bounds.known()) return py::none();
            return py::module_::import("pydimple").attr("Band")(lower(self), upper(self));
          },
          "Band, or None: error bounds of the force by discretisation, at each sample.")
      .def_property_readonly(
          "band_low_N", [](const Solved& self) { return lower(self); },
          "(S,) float64, newtons, or None: lower error bound of the force, by discretisation.")
      .def_property_readonly(
          "band_high_N", [](const Solved& self) { return upper(self); },
          "(S,) float64, newtons, or None: upper error bound of the force.")
      .def_property_readonly(
          "band_unknown", [](const Solved& self) { return in_keywords(self.error_bounds.unknown); },
          "str: why there are no error bounds; empty if there are.");
}

// Displacement of each node at each frame [F x N x 3].
py::array_t<double> displacements(const Solved& kept) {
  const Index nodes = kept.model->model.node_count(), frames = static_cast<Index>(kept.frame_time.size());
  std::vector<double> all(kept.frame_u.size());
  computing([&] {
    const Interpolation& to_nodes = kept.model->to_nodes();
    for (Index k = 0; k < frames; ++k) {
      const auto first = 3 * nodes * k;
      Eigen::Map<Points>(all.data() + first, 3, nodes) =
          to_nodes(Eigen::Map<const Points>(kept.frame_u.data() + first, 3, nodes));
    }
    return 0;
  });
  return handed_over(std::move(all), {frames, nodes, 3});
}

void add_frames(py::class_<Solved>& result) {
  result
      .def_property_readonly(
          "displacement_m", &displacements,
          "(F, N, 3) float64, metres, LPS: of each node at each frame, the first at rest; a new array each "
          "time.")
      .def_property_readonly(
          "nodal_parameter_m",
          [](const py::object& self) {
            const auto& kept = self.cast<const Solved&>();
            return view(
                self, kept.frame_u.data(),
                {static_cast<py::ssize_t>(kept.frame_time.size()), kept.model->model.node_count(), 3});
          },
          "(F, N, 3) float64, metres, LPS: u_a, of which the displacement at X is sum_a phi_a(X) u_a; the "
          "argument of ``Model.at_surface``. A node's displacement differs from it.")
      .def_property_readonly(
          "frame_depth_m",
          [](const py::object& self) { return view(self, self.cast<const Solved&>().frame_depth); },
          "(F,) float64, metres: depth of the tool at each frame.")
      .def_property_readonly(
          "frame_time_s",
          [](const py::object& self) { return view(self, self.cast<const Solved&>().frame_time); },
          "(F,) float64, seconds since first contact, at each frame.");
}

}  // namespace

void require_patch_nodes(const ModelInMemory& built, const char* where) {
  if (!built.model.bonded_patch.empty()) return;
  throw UsageError({.fact = "the model has no nodes of a bonded patch",
                    .where = where,
                    .why = "it was made for a contacting tool, and a bonded patch of nodes moves here",
                    .remedy = "make it with build_model, or give the image to run, which has the tool"});
}

void add_result(py::module_& m) {
  py::class_<Solved> result(m, "Result",
                            R"(A force curve with its error bounds, and the body's displacement along it.

Made by `run` and `solve`. S samples, F frames, N nodes; all but the two error bounds are read-only views of the
library's own memory, which lives as long as one of them.)");
  add_forces(result);
  add_error_bounds(result);
  add_frames(result);
  result
      .def_property_readonly(
          "model", [](const Solved& self) { return self.model; }, "Model: the body at rest.")
      .def_property_readonly(
          "summary", [](const Solved& self) { return dictionary(self.summary_json); },
          "dict: contents of summary.json: status, material, counts, force and error bounds, guards, times.")
      .def_property_readonly(
          "warnings", [](const Solved& self) { return in_keywords(self.warnings); },
          "list of str: warnings about the force.")
      .def("__repr__", [](const Solved& self) { return shown(self); })
      .def(
          py::pickle([](const Solved& self) { return py::make_tuple(as_object(bytes_of(self)), self.model); },
                     [](const py::tuple& state) {
                       const std::vector<std::uint8_t> bytes = bytes_in(state, 2);
                       const auto its_model = state[1].cast<ModelHolder>();
                       return computing([&] { return solved_of(bytes, its_model); });
                     }));
  m.def("solve", &solve_model, py::arg("model"), py::arg("settings"));
  m.def("run_in_memory", &run_in_memory);
  m.def("run_into_folder", &run_into_folder);
}

}  // namespace dimple
