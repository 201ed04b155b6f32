// pydimple._core: the library as the package in pydimple/ hands it to its users. Here are views of arrays,
// the interpreter's lock, Ctrl-C and errors; names of options, images and their affines are matters of
// __init__.py.

#include <fmt/format.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <future>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "apps/python/in_memory.hpp"
#include "apps/run/compare.hpp"
#include "apps/scene/compatibility.hpp"
#include "apps/run/folds.hpp"
#include "apps/run/live.hpp"
#include "apps/run/loads.hpp"
#include "apps/run/membranes.hpp"
#include "apps/run/organ.hpp"
#include "apps/run/other_tools.hpp"
#include "apps/run/places.hpp"
#include "apps/run/record.hpp"
#include "apps/run/simulate.hpp"
#include "apps/run/steps.hpp"
#include "apps/run/stopwatch.hpp"
#include "apps/run/summary.hpp"
#include "apps/run/supports.hpp"
#include "apps/run/tool.hpp"
#include "apps/run/unloaded.hpp"
#include "apps/run/walls.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "io/stop.hpp"
#include "preprocess/make_model.hpp"
#include "preprocess/scene/usable_places.hpp"
#include "preprocess/supports/support.hpp"
#include "solver/session.hpp"

namespace py = pybind11;

namespace dimple {

namespace {

// ---------------------------------------------------------------------------------------------------------
// Errors, Ctrl-C and the interpreter's lock
// ---------------------------------------------------------------------------------------------------------

const char* class_of(ExitCode code) {
  switch (code) {
    case ExitCode::usage:
      return "UsageError";
    case ExitCode::input:
      return "InputError";
    case ExitCode::model:
      return "ModelError";
    case ExitCode::solve:
      return "SolveError";
    case ExitCode::output:
      return "OutputError";
    case ExitCode::interrupted:
      return "Stopped";
    default:
      return "Error";
  }
}

// File names need not be UTF-8.
py::object words(const std::string& text) {
  return py::reinterpret_steal<py::object>(
      PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "replace"));
}

// What the program says to its command line, as it is said in Python: `--nodes` is `nodes=`.
py::object in_keywords(const std::string& text) {
  return py::module_::import("pydimple._errors").attr("in_keywords")(words(text));
}
py::list in_keywords(const std::vector<std::string>& texts) {
  py::list said;
  for (const std::string& text : texts) said.append(in_keywords(text));
  return said;
}

void raise(const Error& error) {
  const Report& r = error.report;
  const py::object raised = py::module_::import("pydimple._errors")
                                .attr("error_of")(class_of(error.code), words(r.fact), words(r.where),
                                                  words(r.why), words(r.remedy), words(r.code));
  PyErr_SetObject(py::type::of(raised).ptr(), raised.ptr());
}

// Of all computations under way: a request to stop is to all of them, and done with when the last has ended.
std::mutex under_way_mutex;
int under_way = 0;

class UnderWay {
 public:
  UnderWay() {
    const std::lock_guard lock(under_way_mutex);
    ++under_way;
  }
  ~UnderWay() {
    const std::lock_guard lock(under_way_mutex);
    if (--under_way == 0) forget_stop();
  }
  UnderWay(const UnderWay&) = delete;
  UnderWay& operator=(const UnderWay&) = delete;
};

// Does work in a thread of its own, without the interpreter's lock. This thread hears signals meanwhile, as
// Python alone can: what the handler raises, KeyboardInterrupt by default, ends the work and is raised then.
template <class Work>
auto computing(const Work& work) {
  const UnderWay counted;
  auto result = std::async(std::launch::async, work);
  std::optional<py::error_already_set> raised;
  for (bool ready = false; !ready;) {
    {
      const py::gil_scoped_release others_may_run;
      ready = result.wait_for(std::chrono::milliseconds(50)) == std::future_status::ready;
    }
    if (!raised && PyErr_CheckSignals() != 0) {
      raised.emplace();
      ask_to_stop(StopReason::interrupted);
    }
  }
  if (!raised) return result.get();
  try {
    result.get();
  } catch (...) {  // a consequence of the stop
  }
  if (raised->matches(PyExc_KeyboardInterrupt)) throw Stopped(StopReason::interrupted);
  throw *raised;
}

// The program's lines go to Python's logging, as those of "pydimple".
void log(RunObserver::Line kind, const std::string& text) {
  using Line = RunObserver::Line;
  if (kind == Line::doing) return;
  const int level = kind == Line::warning ? 30 : kind == Line::said ? 20 : 10;
  const py::gil_scoped_acquire lock;
  try {
    const py::object logger = py::module_::import("logging").attr("getLogger")("pydimple");
    if (logger.attr("isEnabledFor")(level).cast<bool>()) logger.attr("log")(level, "%s", in_keywords(text));
  } catch (py::error_already_set& error) {
    error.discard_as_unraisable("pydimple");
  }
}

// ---------------------------------------------------------------------------------------------------------
// Arrays
// ---------------------------------------------------------------------------------------------------------

using Shape = std::vector<py::ssize_t>;

// Numbers where they are: read-only, and `owner` lives as long as the array.
template <class T>
py::array view(const py::object& owner, const T* first, const Shape& shape, const Shape& strides = {}) {
  py::array array(py::dtype::of<T>(), shape, strides, first, owner);
  array.attr("setflags")(py::arg("write") = false);
  return array;
}

// Vectors side by side, [3xN], are the rows of [N, 3].
template <class T>
py::array view(const py::object& owner, const Eigen::Matrix<T, 3, Eigen::Dynamic>& rows) {
  return view(owner, rows.data(), {rows.cols(), 3});
}

// The array becomes the owner.
template <class Numbers>
py::array_t<double> handed_over(Numbers&& numbers, Shape shape) {
  auto* kept = new std::decay_t<Numbers>(std::forward<Numbers>(numbers));
  const py::capsule owner(kept, [](void* it) { delete static_cast<std::decay_t<Numbers>*>(it); });
  return py::array_t<double>(std::move(shape), kept->data(), owner);
}
py::array_t<double> handed_over(Points&& rows) {
  const Index count = rows.cols();
  return handed_over(std::move(rows), {count, 3});
}

py::bytes as_object(const std::vector<std::uint8_t>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}
// First in the state of a pickled object.
std::vector<std::uint8_t> bytes_in(const py::tuple& state, std::size_t parts) {
  if (state.size() != parts || !py::isinstance<py::bytes>(state[0]))
    throw InputError({.fact = "a pickled object cannot be read",
                      .where = "pickle",
                      .why = "its state is not what this module makes",
                      .remedy = "compute it again, or read it with the version that it was pickled by"});
  const auto bytes = state[0].cast<std::string_view>();
  return {bytes.begin(), bytes.end()};
}

template <class T>
LabelArray label_array(const py::array& array) {
  LabelArray labels;
  labels.voxel = static_cast<const T*>(array.data());
  for (std::size_t a = 0; a < 3; ++a) {
    labels.size[a] = array.shape(static_cast<py::ssize_t>(a));
    labels.step[a] = array.strides(static_cast<py::ssize_t>(a)) / array.itemsize();
  }
  return labels;
}

LabelArray labels_in(const py::array& array) {
  const char kind = array.dtype().kind();
  const auto bytes = array.itemsize();
  if (kind == 'f') return bytes == 4 ? label_array<float>(array) : label_array<double>(array);
  const bool is_signed = kind == 'i';
  switch (bytes) {
    case 1:
      return is_signed ? label_array<std::int8_t>(array) : label_array<std::uint8_t>(array);
    case 2:
      return is_signed ? label_array<std::int16_t>(array) : label_array<std::uint16_t>(array);
    case 4:
      return is_signed ? label_array<std::int32_t>(array) : label_array<std::uint32_t>(array);
    default:
      return is_signed ? label_array<std::int64_t>(array) : label_array<std::uint64_t>(array);
  }
}

// `array`: of one of the types above, three axes, side by side in memory; `to_world`: 4x4, to LPS mm.
std::shared_ptr<LabelImage> label_image(const py::array& array, const py::array_t<double>& to_world,
                                        const std::string& label_names) {
  LabelArray labels = labels_in(array);
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) labels.to_world.matrix()(r, c) = to_world.at(r, c);
  return computing([&] { return std::make_shared<LabelImage>(label_image_of(labels, label_names)); });
}

// ---------------------------------------------------------------------------------------------------------
// Options
// ---------------------------------------------------------------------------------------------------------

// The word of the flag with the unit of the key: "--mu" of material.mu_Pa is mu_Pa.
std::string keyword_of(const Option& option) {
  const std::string last = option.key.substr(option.key.find('.') + 1);
  if (option.flag.empty()) return last;
  std::string word = option.flag.substr(2);
  std::replace(word.begin(), word.end(), '-', '_');
  return last.starts_with(word) ? last : word;
}

// Words that an option of free text knows. In Slicer, which makes a closed list of its words, these stay
// free.
std::vector<std::string> words_beside_text(const Option& option) {
  static const std::map<std::string, std::vector<std::string>> others = {
      {"image.label_names", {"totalsegmentator", "totalsegmentator-ct", "totalsegmentator-mr", "freesurfer"}},
      {"boundary.direction", {"auto"}},
      {"accuracy.quantity", {"force"}},
      {"tool.friction", {"stick"}},
      {"output.compare", {paper_word}}};
  const auto found = others.find(option.key);
  return found == others.end() ? option.words : found->second;
}

py::list options() {
  Config defaults;
  py::list result;
  for (const Option& option : options_of(defaults)) {
    if (option.key == "image.file") continue;
    py::dict entry;
    entry["keyword"] = keyword_of(option);
    entry["flag"] = option.flag;
    entry["key"] = option.key;
    entry["key_without_unit"] = without_unit(option);
    entry["stage"] = option.stage;
    entry["unit"] = option.unit;
    entry["help"] = option.help;
    entry["choices"] = option.choices;
    entry["words"] = option.choices.empty() ? words_beside_text(option) : option.choices;
    entry["default"] = std::visit([](const auto* value) { return py::cast(*value); }, option.value);
    result.append(std::move(entry));
  }
  return result;
}

// As the package hands them over: a file of options or "", then key, text and where it was given.
struct Settings {
  std::string config_file;
  std::vector<std::array<std::string, 3>> given;

  Settings beside(const Settings& further) const {
    Settings both = *this;
    both.given.insert(both.given.end(), further.given.begin(), further.given.end());
    return both;
  }

  Config config() const {
    Config result;
    if (!config_file.empty()) read_config(result, config_file);
    for (const auto& [key, text, source] : given) set_option(result, key, text, source);
    resolve_material(result);
    return result;
  }

  // What they amount to: key -> value, in the unit of the key.
  py::dict values() const {
    Config all = config();
    py::dict result;
    for (const Option& option : options_of(all))
      result[py::str(option.key)] =
          std::visit([](const auto* value) { return py::cast(*value); }, option.value);
    return result;
  }
};

// ---------------------------------------------------------------------------------------------------------
// Model
// ---------------------------------------------------------------------------------------------------------

// Leaves the rest of the result.
ModelHolder take_model(Result& result, const Config& config) {
  auto built = std::make_shared<ModelInMemory>();
  for (const LabelMeasure& label : result.labels)
    if (!label.name.empty()) built->label_names[label.name] = label.value;
  built->config = config;
  built->provenance = result.provenance;
  built->warnings = result.warnings;
  built->origin = result.origin;
  built->report_json = as_text(summary_of_model(config, result));
  static_cast<Discretisation&>(built->model) = std::move(static_cast<Discretisation&>(result.model));
  built->model.scheme = result.model.scheme;
  if (built->model.support_report.unseen = result.model.support_report.unseen;
      built->model.support_report.unseen > 0)
    built->model.support = std::move(result.model.support);  // a surface's fields hang on who sees whom
  return built;
}

ModelHolder build(const Settings& settings, const LabelImage* image) {
  return computing([&] {
    const Config config = settings.config();
    Result result;
    build_case({.config = config, .image = image}, {.line = log}, result);
    stop_if_asked();
    return take_model(result, config);
  });
}

// An organ that is read once, for models at several places.
struct OrganInMemory {
  Settings settings;
  ReadOrgan organ;
};

std::unique_ptr<OrganInMemory> read_organ_of(const Settings& settings, const LabelImage* image) {
  return computing([&] {
    const Config config = settings.config();
    return std::make_unique<OrganInMemory>(
        OrganInMemory{settings, read_once({.config = config, .image = image}, {.line = log})});
  });
}

// `settings`: what differs from the organ's own, none of it about the image or the circle's width.
ModelHolder build_of_organ(const OrganInMemory& of, const Settings& settings) {
  return computing([&] {
    const Config config = of.settings.beside(settings).config();
    Result result;
    build_case({.config = config, .organ = &of.organ}, {.line = log}, result);
    stop_if_asked();
    return take_model(result, config);
  });
}

std::string places_of_organ(const OrganInMemory& of, const Settings& settings) {
  return computing([&] {
    const Config config = of.settings.beside(settings).config();
    const Organ& organ = of.organ.organ;
    BoundaryOptions boundary = model_options(config).boundary;
    boundary.voxel_mm = organ.options.boundary.voxel_mm;
    check_words(boundary);
    return places_json(config, {usable_places(organ.body->surface, boundary), of.organ.read.warnings});
  });
}

std::string shown(const OrganInMemory& of) {
  const Result& read = of.organ.read;
  return fmt::format("<pydimple.Organ: {}, {} triangles>", volume_in_words(read.segment.voxel_volume_mm3),
                     of.organ.organ.body->surface.triangles().cols());
}

std::string usable_places_json(const Settings& settings, const LabelImage* image) {
  return computing([&] {
    const Config config = settings.config();
    return places_json(config, places_of_image(config, image, {.line = log}));
  });
}

py::array_t<double> at_surface(const ModelInMemory& built,
                               const py::array_t<double, py::array::c_style>& nodal) {
  if (nodal.ndim() != 2 || nodal.shape(0) != built.model.node_count())
    throw UsageError(
        {.fact = fmt::format("values of shape {} are given", std::string(py::str(nodal.attr("shape")))),
         .where = "Model.at_surface",
         .why = fmt::format("the model has {} nodes, and takes a row of values for each",
                            built.model.node_count()),
         .remedy = "give an array of shape (nodes, components), such as nodal_parameter_m[-1]"});
  const Index components = nodal.shape(1);
  const Eigen::Map<const Eigen::MatrixXd> values(nodal.data(), components, nodal.shape(0));
  Eigen::MatrixXd at = computing([&] { return built.to_surface()(values); });
  const Index vertices = at.cols();
  return handed_over(std::move(at), {vertices, components});
}

// ---------------------------------------------------------------------------------------------------------
// Result
// ---------------------------------------------------------------------------------------------------------

// A step has cut the body: its model is another, and its frames begin there.
void forget_frames(Solved& solved) {
  solved.frame_time.clear(), solved.frame_depth.clear(), solved.frame_u.clear();
}

void add(Solved& solved, const Frame& frame) {
  solved.frame_time.push_back(frame.t);
  solved.frame_depth.push_back(frame.depth);
  for (Index a = 0; a < frame.u.cols(); ++a)
    solved.frame_u.insert(solved.frame_u.end(), &frame.u(0, a), &frame.u(0, a) + 3);
}

// `built`: the model that was solved; none: it was made for this.
void take(Solved& solved, Result& result, const Config& config, ModelHolder built = nullptr) {
  solved.force = std::move(result.history.force);
  solved.band = result.band;
  solved.warnings = result.warnings;
  solved.model = built ? std::move(built) : take_model(result, config);
}

// A column of the force curve, as it lies among the others.
py::array curve(const py::object& self, double ForceSample::*column) {
  const std::vector<ForceSample>& force = self.cast<const Solved&>().force;
  return view(self, force.empty() ? nullptr : &(force.front().*column),
              {static_cast<py::ssize_t>(force.size())}, {sizeof(ForceSample)});
}

// Of the force on the tool and its moment, three numbers a sample, as they lie among the others.
py::array on_tool(const py::object& self, std::size_t first) {
  const std::vector<ForceSample>& force = self.cast<const Solved&>().force;
  return view(self, force.empty() ? nullptr : &force.front().on_tool[first],
              {static_cast<py::ssize_t>(force.size()), 3}, {sizeof(ForceSample), sizeof(double)});
}

py::object band_edge(const Solved& solved, double side) {
  if (!solved.band.known()) return py::none();
  std::vector<double> edge;
  for (std::size_t k = 0; k < solved.force.size(); ++k)
    edge.push_back(solved.force[k].force + side * solved.band.half[k]);
  const auto count = static_cast<py::ssize_t>(edge.size());
  return handed_over(std::move(edge), {count});
}

std::string shown(const Solved& solved) {
  if (solved.force.empty()) return "<pydimple.Result: no force>";
  const ForceSample& last = solved.force.back();
  std::optional<double> half_N;
  if (solved.band.known()) half_N = solved.band.half.back();
  return "<pydimple.Result: " + force_title(last.force, 1e3 * last.depth, half_N) +
         (half_N ? "" : ", no error estimate: " + in_keywords(solved.band.unknown).cast<std::string>()) + ">";
}

// What simulate() makes of a case, all in memory. `summary` begins it; `built`: the model that the case
// begins with.
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
                                     const History&) { return stop_asked() == StopReason::none; }}},
             result);
    if (result.history.interrupted) throw Stopped(stop_asked());
    Json all = summary(result);
    add_run(all, given.config, result, {.solve_s = result.solve_s, .total_s = whole.seconds()}, "finished",
            ExitCode::ok, nullptr);
    kept->summary_json = as_text(all);
    const bool is_built =
        built && result.levels.empty() && !result.unloaded;  // an accuracy takes other nodes
    take(*kept, result, result.origin ? result.origin->config : given.config, is_built ? built : nullptr);
    return kept;
  });
}

// A model that was made for a tool that touches has none.
void require_nodes_of_circle(const ModelInMemory& built, const char* where) {
  if (!built.model.circle.empty()) return;
  throw UsageError(
      {.fact = "the model has no nodes of a circle",
       .where = where,
       .why = "it was made for a tool that touches the body, and what moves here is a circle of nodes",
       .remedy = "make it by build_model, or give the image to run, which takes the tool"});
}

std::unique_ptr<Solved> solve_model(const ModelHolder& built, const Settings& settings) {
  Case given{.config = settings.config()};
  if (!tool_of(given.config)) require_nodes_of_circle(*built, "solve");
  given.band = given.config.accuracy.band == "on";
  given.model = ModelFiles{.places = built->model,
                           .scheme = built->model.scheme,
                           .label_names = built->label_names,
                           .provenance = built->provenance,
                           .facing_share = built->origin ? built->origin->facts.facing_share : 0.0,
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
  const Config config = settings.config();
  return solved({.config = config, .image = image, .band = config.accuracy.band == "on"},
                [&](const Result& result) { return summary_of_image(config, result); });
}

std::unique_ptr<Solved> run_into_folder(const Settings& settings, const LabelImage* image,
                                        const std::string& folder, bool overwrite) {
  return computing([&] {
    const Config config = settings.config();
    auto kept = std::make_unique<Solved>();
    const Outcome outcome = record_run(config, folder, overwrite ? Existing::replace : Existing::refuse,
                                       {.line = log,
                                        .frame = [&](const Frame& frame) { add(*kept, frame); },
                                        .after_cut = [&] { forget_frames(*kept); },
                                        .result = [&](Result& result) { take(*kept, result, config); }},
                                       image);
    if (outcome.interrupted) throw Stopped(stop_asked());
    kept->summary_json = outcome.summary_json;
    return kept;
  });
}

// ---------------------------------------------------------------------------------------------------------
// Session
// ---------------------------------------------------------------------------------------------------------

// One thing at a time is asked of it, by whatever thread.
class LiveSession {
 public:
  LiveSession(const ModelInMemory& built, const Settings& settings) {
    session_ = computing([&] {
      const Config config = settings.config();
      config_ = config;
      check_pairs(config, Feature::session);
      require_nodes_of_circle(built, "Session");
      const std::vector<Material> materials = materials_of(config);
      check_materials(config, built.model.scheme);
      const TissueOptions tissues = tissues_of(config, built.label_names, built.model);
      materials_ = materials, label_names_ = built.label_names;
      Model model = make_model(built.model, built.model.scheme, tissue_of_points(built.model, tissues),
                               tissues.density);
      return std::make_unique<Session>(session_on(given(), std::move(model)));
    });
  }

  // Places on the body as it now is [mm, LPS].
  void cut(const Vec3& from, const Vec3& to, double depth) {
    computing([&] {
      const std::lock_guard alone(mutex_);
      const Model& before = session_->model();
      if (!rest_) rest_.emplace(before.surface.vertex_mm, before.surface.triangles);
      const Points u = session_->nodal_parameters();
      CutSession made = cut_session(given(), before, u, {1e-3 * from, 1e-3 * to, 1e-3 * depth});
      made.session.go_on_from(*session_, carried(made.cut, u), made.cut.of_patch);
      *session_ = std::move(made.session);
      to_nodes_ = {};
      return 0;
    });
  }

  // `ask`: of the session. Without the interpreter's lock, which another thread may need to finish.
  template <class Ask>
  auto now(const Ask& ask) {
    const py::gil_scoped_release others_may_run;
    const std::lock_guard alone(mutex_);
    return ask(*session_);
  }
  template <class Move>
  auto move(const Move& move) {
    return computing([&] {
      const std::lock_guard alone(mutex_);
      return move(*session_);
    });
  }

  Points displacements() {
    return now([&](Session& session) { return displacements_of(session); });
  }
  Points positions() {
    return now([&](Session& session) { return Points(session.model().X + displacements_of(session)); });
  }

 private:
  Points displacements_of(const Session& session) {
    if (to_nodes_.weight.size() == 0) to_nodes_ = node_interpolation(session.model());
    return to_nodes_(session.nodal_parameters());
  }
  SessionGiven given() const { return {config_, materials_, label_names_, rest_ ? &*rest_ : nullptr, 0.0}; }

  std::mutex mutex_;
  Config config_;
  std::vector<Material> materials_;
  std::map<std::string, int> label_names_;
  std::optional<BodySurface> rest_ = {};  // made by the first cut
  std::unique_ptr<Session> session_;
  Interpolation to_nodes_ = {};  // empty: not asked for since the body was cut
};

std::string shown(LiveSession& session) {
  return session.now([](Session& s) {
    return fmt::format("<pydimple.Session: {} nodes, {}>", s.model().node_count(),
                       force_title(s.force(), 1e3 * s.depth()));
  });
}

py::array on_tool(LiveSession& session, Index first) {
  const Wrench all = session.now([](Session& s) { return s.on_tool(); });
  return handed_over(std::vector<double>(&all[first], &all[first] + 3), {3});
}

// The members of pydimple.Frame, in its order.
py::tuple frame_of(const LiveFrame& frame) {
  const auto three = [](const Wrench& of, Index first) {
    return py::make_tuple(of[first], of[first + 1], of[first + 2]);
  };
  return py::make_tuple(1e3 * frame.asked, 1e3 * frame.depth, frame.force, frame.error, frame.error_at_depth,
                        three(frame.on_tool, 0), three(frame.on_tool, 3), three(frame.per_force, 0),
                        three(frame.per_force, 3), frame.stiffness, frame.residual, frame.evaluations,
                        name_of(frame.tool));
}

void require(const char* name, double value, bool allowed, const char* why) {
  if (std::isfinite(value) && allowed) return;
  throw UsageError({.fact = fmt::format("{}={} is not allowed", name, value),
                    .where = "Session",
                    .why = why,
                    .remedy = "give another number"});
}

Vec3 place_of(const char* name, const std::vector<double>& mm) {
  require(name, static_cast<double>(mm.size()), mm.size() == 3, "a place has three numbers");
  for (const double number : mm)
    require(name, number, std::abs(number) <= 1e6, "it must be a finite number of no more than a kilometre");
  return {mm[0], mm[1], mm[2]};
}

py::tuple follow(LiveSession& session, double depth_mm, double seconds, std::int64_t evaluations,
                 double dt_s) {
  require("depth_mm", depth_mm, true, "it must be a finite number");
  require("seconds", seconds, seconds > 0.0, "it must be a finite number above 0");
  require("evaluations", static_cast<double>(evaluations), evaluations >= 0, "it must be 0 or more");
  require("dt_s", dt_s, dt_s >= 0.0, "it must be a finite number from 0 on");
  const FrameLimit limit{.seconds = seconds, .evaluations = evaluations};
  return frame_of(session.move([=](Session& s) { return s.follow(1e-3 * depth_mm, limit, dt_s); }));
}

std::optional<tbb::global_control> thread_limit;

// ---------------------------------------------------------------------------------------------------------
// What Python sees: documented in numpydoc's style, with shape, type, unit and meaning
// ---------------------------------------------------------------------------------------------------------

void add_errors() {
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Error& error) {
      raise(error);
    }
  });
}

void add_words(py::module_& m) {
  m.attr("version") = DIMPLE_VERSION;
  m.def("force_in_words", &force_in_words);
  m.def("force_title", [](double force_N, double depth_mm) { return force_title(force_N, depth_mm); });
  m.def("words_of_status", [] {
    std::vector<std::string> all;
    for (int k = 0; k <= static_cast<int>(LiveFrame::Tool::beyond); ++k)
      all.push_back(name_of(static_cast<LiveFrame::Tool>(k)));
    return all;
  });
  m.def("options", &options);
  m.def("limit_threads", [](std::optional<int> count) {
    thread_limit.reset();
    if (count)
      thread_limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(*count));
  });
}

void add_image_and_settings(py::module_& m) {
  py::class_<LabelImage, std::shared_ptr<LabelImage>>(m, "LabelImage").def(py::init(&label_image));
  py::class_<Settings>(m, "Settings")
      .def(py::init([](std::string file, std::vector<std::array<std::string, 3>> given) {
        return Settings{std::move(file), std::move(given)};
      }))
      .def("set",
           [](Settings& self, std::string key, std::string text, std::string source) {
             self.given.push_back({std::move(key), std::move(text), std::move(source)});
           })
      .def("values", &Settings::values);
}

void add_computations(py::module_& m) {
  m.def("build", &build);
  m.def("usable_places_json", &usable_places_json);
  m.def("solve", &solve_model, py::arg("model"), py::arg("settings"));
  m.def("run_in_memory", &run_in_memory);
  m.def("run_into_folder", &run_into_folder);
  m.def("build_of_organ", &build_of_organ);
  m.def("places_of_organ", &places_of_organ);
  m.def("follow", &follow, py::arg("session"), py::arg("depth_mm"), py::arg("seconds"),
        py::arg("evaluations"), py::arg("dt_s"));
}

const Model& model_in(const py::object& self) {
  return self.cast<const ModelInMemory&>().model;
}

py::array node_numbers(const py::object& self, const std::vector<Index>& list) {
  return view(self, list.data(), {static_cast<py::ssize_t>(list.size())});
}

py::object dictionary(const std::string& json) {
  return py::module_::import("json").attr("loads")(json);
}

void add_model(py::module_& m) {
  py::class_<ModelInMemory, ModelHolder>(
      m, "Model", R"(A body as nodes and integration points, with its base and the circle of the tool.

Made by `build_model`. Its arrays are read-only views of the library's own memory, which lives as long as one of them.
Positions are LPS, in metres, but for those whose name ends in `_mm`.)")
      .def_property_readonly(
          "positions_m", [](const py::object& self) { return view(self, model_in(self).X); },
          "(N, 3) float64, metres, LPS: the nodes at rest.")
      .def_property_readonly(
          "circle", [](const py::object& self) { return node_numbers(self, model_in(self).circle); },
          "(n,) int64: numbers of the nodes that move with the tool, ascending.")
      .def_property_readonly(
          "base", [](const py::object& self) { return node_numbers(self, model_in(self).base); },
          "(n,) int64: numbers of the nodes that are held, ascending.")
      .def_property_readonly(
          "points_m", [](const py::object& self) { return view(self, model_in(self).point); },
          "(Q, 3) float64, metres, LPS: the integration points at rest.")
      .def_property_readonly(
          "volume_m3",
          [](const py::object& self) {
            return view(self, model_in(self).volume.data(), {model_in(self).point_count()});
          },
          "(Q,) float64, cubic metres: of the tissue that each integration point stands for.")
      .def_property_readonly(
          "label",
          [](const py::object& self) {
            return view(self, model_in(self).label.data(), {model_in(self).label.size()});
          },
          "(Q,) int32: the image's label at each integration point, where the model was made for several "
          "tissues.")
      .def_property_readonly(
          "circle_centre_m",
          [](const py::object& self) { return view(self, model_in(self).tool.centre.data(), {3}); },
          "(3,) float64, metres, LPS: where the tool touches the body at first.")
      .def_property_readonly(
          "circle_radius_m", [](const ModelInMemory& self) { return self.model.tool.radius; },
          "float, metres.")
      .def_property_readonly(
          "push", [](const py::object& self) { return view(self, model_in(self).tool.push.data(), {3}); },
          "(3,) float64: unit vector, LPS, the way in which the tool moves.")
      .def_property_readonly(
          "surface_mm", [](const py::object& self) { return view(self, model_in(self).surface.vertex_mm); },
          "(V, 3) float64, millimetres, LPS: vertices of the boundary at rest, for pictures.")
      .def_property_readonly(
          "triangles", [](const py::object& self) { return view(self, model_in(self).surface.triangles); },
          "(T, 3) int64: vertices of each triangle of the boundary, outward when counted anticlockwise.")
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
          "dict: counts, volumes, spacings, and why the base and the circle are where they are.")
      .def_property_readonly(
          "warnings", [](const ModelInMemory& self) { return in_keywords(self.warnings); },
          "list of str: what may make the model another than was meant.")
      .def("__repr__",
           [](const ModelInMemory& self) {
             return fmt::format("<pydimple.Model: {} nodes, {} integration points, circle {} wide>",
                                self.model.node_count(), self.model.point_count(),
                                length_in_words(2e3 * self.model.tool.radius));
           })
      .def(py::pickle([](const ModelInMemory& self) { return py::make_tuple(as_object(bytes_of(self))); },
                      [](const py::tuple& state) {
                        const std::vector<std::uint8_t> bytes = bytes_in(state, 1);
                        return computing([&] { return model_of(bytes); });
                      }));
}

void add_organ(py::module_& m) {
  py::class_<OrganInMemory>(m, "Organ")
      .def(py::init(&read_organ_of))
      .def_property_readonly(
          "warnings", [](const OrganInMemory& self) { return in_keywords(self.organ.read.warnings); },
          "list of str: of the image, what may make the organ another than was meant.")
      .def("__repr__", [](const OrganInMemory& self) { return shown(self); });
}

void add_forces(py::class_<Solved>& result) {
  result
      .def_property_readonly(
          "depth_m", [](const py::object& self) { return curve(self, &ForceSample::depth); },
          "(S,) float64, metres: how far the tool has come from where it touched.")
      .def_property_readonly(
          "force_N", [](const py::object& self) { return curve(self, &ForceSample::force); },
          "(S,) float64, newtons: on the tool along its push, positive where the tissue resists.")
      .def_property_readonly(
          "base_force_N", [](const py::object& self) { return curve(self, &ForceSample::base_force); },
          "(S,) float64, newtons: with which the base holds the body.")
      .def_property_readonly(
          "force_on_tool_N", [](const py::object& self) { return on_tool(self, 0); },
          "(S, 3) float64, newtons, LPS: all of the force on the tool, not along its push alone.")
      .def_property_readonly(
          "moment_on_tool_Nm", [](const py::object& self) { return on_tool(self, 3); },
          "(S, 3) float64, newton metres, LPS: its moment about the middle of the circle, which moves with "
          "the tool.")
      .def_property_readonly(
          "time_s", [](const py::object& self) { return curve(self, &ForceSample::t); },
          "(S,) float64, seconds since the tool touched.");
}

void add_band(py::class_<Solved>& result) {
  result
      .def_property_readonly(
          "band",
          [](const Solved& self) -> py::object {
            if (!self.band.known()) return py::none();
            return py::module_::import("pydimple").attr("Band")(band_edge(self, -1.0), band_edge(self, 1.0));
          },
          "Band, or None: between which forces the discretisation lets the true one be, at each sample.")
      .def_property_readonly(
          "band_low_N", [](const Solved& self) { return band_edge(self, -1.0); },
          "(S,) float64, newtons, or None: lower edge of the band that the discretisation gives the force.")
      .def_property_readonly(
          "band_high_N", [](const Solved& self) { return band_edge(self, 1.0); },
          "(S,) float64, newtons, or None: its upper edge.")
      .def_property_readonly(
          "band_unknown", [](const Solved& self) { return in_keywords(self.band.unknown); },
          "str: why there is no band; empty where there is one.");
}

// Of each node at each frame [F x N x 3].
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
          "displacement_m", [](const Solved& self) { return displacements(self); },
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
          "(F, N, 3) float64, metres, LPS: u_a, of which the displacement at X is sum_a phi_a(X) u_a; what "
          "``Model.at_surface`` takes. A node's displacement is another number.")
      .def_property_readonly(
          "frame_depth_m",
          [](const py::object& self) {
            const auto& depth = self.cast<const Solved&>().frame_depth;
            return view(self, depth.data(), {static_cast<py::ssize_t>(depth.size())});
          },
          "(F,) float64, metres: the tool's way at each frame.")
      .def_property_readonly(
          "frame_time_s",
          [](const py::object& self) {
            const auto& time = self.cast<const Solved&>().frame_time;
            return view(self, time.data(), {static_cast<py::ssize_t>(time.size())});
          },
          "(F,) float64, seconds since the tool touched, at each frame.");
}

void add_result(py::module_& m) {
  py::class_<Solved> result(
      m, "Result",
      R"(A force curve, the body's displacement along it, and how well the force is known.

Made by `run` and `solve`. S samples, F frames, N nodes; all but the two edges of the band are read-only views of the
library's own memory, which lives as long as one of them.)");
  add_forces(result);
  add_band(result);
  add_frames(result);
  result
      .def_property_readonly(
          "model", [](const Solved& self) { return self.model; }, "Model: the body at rest.")
      .def_property_readonly(
          "summary", [](const Solved& self) { return dictionary(self.summary_json); },
          "dict: what summary.json holds: status, material, counts, force and band, guards, times.")
      .def_property_readonly(
          "warnings", [](const Solved& self) { return in_keywords(self.warnings); },
          "list of str: what may make the force another than was meant.")
      .def("__repr__", [](const Solved& self) { return shown(self); })
      .def(
          py::pickle([](const Solved& self) { return py::make_tuple(as_object(bytes_of(self)), self.model); },
                     [](const py::tuple& state) {
                       const std::vector<std::uint8_t> bytes = bytes_in(state, 2);
                       const auto its_model = state[1].cast<ModelHolder>();
                       return computing([&] { return solved_of(bytes, its_model); });
                     }));
}

void add_moves(py::class_<LiveSession>& session) {
  session
      .def(
          "equilibrate",
          [](LiveSession& self, double depth_mm, double dt_s) {
            require("depth_mm", depth_mm, true, "it must be a finite number");
            require("dt_s", dt_s, dt_s >= 0.0, "it must be a finite number from 0 on");
            return self.move([=](Session& s) { return s.equilibrate(1e-3 * depth_mm, dt_s); });
          },
          py::kw_only(), py::arg("depth_mm"), py::arg("dt_s") = 0.0,
          R"(Moves the tool to a depth, or back, and lets the body come to rest there.

Parameters
----------
depth_mm : float
    The tool's way along its push from where it first touched, millimetres.
dt_s : float
    How long the move takes, seconds: for viscoelastic tissue.

Returns
-------
int
    Evaluations of the force that it took.

Raises
------
SolveError
    There is no equilibrium to be found; the body is then as it was.)")
      .def(
          "cut",
          [](LiveSession& self, const std::vector<double>& from_mm, const std::vector<double>& to_mm,
             double depth_mm) {
            const Vec3 from = place_of("from_mm", from_mm), to = place_of("to_mm", to_mm);
            require("depth_mm", depth_mm, depth_mm > 0.0 && depth_mm <= 1e3,
                    "it must be a finite number above 0 and not above 1000");
            if (from == to) require("to_mm", to.x(), false, "a stroke that does not move opens nothing");
            self.cut(from, to, depth_mm);
          },
          py::kw_only(), py::arg("from_mm"), py::arg("to_mm"), py::arg("depth_mm"),
          R"(Cuts the body as it now is: a scalpel goes from place to place on its surface, straight in.

The banks get nodes behind those that are there, so that arrays are longer afterwards; the first of them are the
same. The next move finds the equilibrium of the cut body.

Parameters
----------
from_mm, to_mm : sequence of 3 floats
    Places on the surface, millimetres, LPS.
depth_mm : float
    How deep the blade goes below the straight way between them, millimetres.

Raises
------
ModelError
    The blade misses the body, or parts a piece off that nothing holds; the body is then as it was.
SolveError
    The tissue relaxes.)")
      .def(
          "step",
          [](LiveSession& self, double depth_mm, double dt_s) {
            require("depth_mm", depth_mm, true, "it must be a finite number");
            require("dt_s", dt_s, dt_s > 0.0, "it must be a finite number above 0");
            return self.move([=](Session& s) { return s.step(1e-3 * depth_mm, dt_s); });
          },
          py::kw_only(), py::arg("depth_mm"), py::arg("dt_s"),
          R"(Moves the tool to a depth at an even speed and follows the body with its inertia, by central differences.

Parameters
----------
depth_mm : float
    The tool's way along its push from where it first touched, millimetres.
dt_s : float
    How long the move takes, seconds.

Returns
-------
int
    Steps that it took.

Raises
------
SolveError
    They would be more than 20000, or the body cannot follow; it is then as it was.)");
}

void add_state(py::class_<LiveSession>& session) {
  session.def("__repr__", [](LiveSession& self) { return shown(self); })
      .def_property_readonly(
          "depth_m", [](LiveSession& self) { return self.now([](Session& s) { return s.depth(); }); },
          "float, metres: the tool's way from where it first touched.")
      .def_property_readonly(
          "force_N", [](LiveSession& self) { return self.now([](Session& s) { return s.force(); }); },
          "float, newtons: on the tool along its push, positive where the tissue resists.")
      .def_property_readonly(
          "base_force_N",
          [](LiveSession& self) { return self.now([](Session& s) { return s.base_force(); }); },
          "float, newtons: with which the base holds the body.")
      .def_property_readonly(
          "force_on_tool_N", [](LiveSession& self) { return on_tool(self, 0); },
          "(3,) float64, newtons, LPS: all of the force on the tool; a new array each time.")
      .def_property_readonly(
          "moment_on_tool_Nm", [](LiveSession& self) { return on_tool(self, 3); },
          "(3,) float64, newton metres, LPS: its moment about the middle of the circle, which moves with the "
          "tool; a new "
          "array each time.")
      .def_property_readonly(
          "displacement_m", [](LiveSession& self) { return handed_over(self.displacements()); },
          "(N, 3) float64, metres, LPS: of each node now; a new array each time.")
      .def_property_readonly(
          "nodal_parameter_m",
          [](LiveSession& self) {
            return handed_over(self.now([](Session& s) { return s.nodal_parameters(); }));
          },
          "(N, 3) float64, metres, LPS: u_a, of which the displacement at X is sum_a phi_a(X) u_a; a new "
          "array "
          "each time.")
      .def_property_readonly(
          "positions_m", [](LiveSession& self) { return handed_over(self.positions()); },
          "(N, 3) float64, metres, LPS: the nodes now; a new array each time.")
      .def_property_readonly(
          "forces_N",
          [](LiveSession& self) { return handed_over(self.now([](Session& s) { return s.forces(); })); },
          "(N, 3) float64, newtons, LPS: what the tissue resists with at each node now; a new array each "
          "time.");
}

void add_session(py::module_& m) {
  py::class_<LiveSession> session(m, "Session");
  session.def(py::init<const ModelInMemory&, const Settings&>());
  add_moves(session);
  add_state(session);
}

}  // namespace

PYBIND11_MODULE(_core, m) {
  add_errors();
  // In this order: a signature names classes that are known by then.
  add_words(m);
  add_image_and_settings(m);
  add_model(m);
  add_organ(m);
  add_result(m);
  add_session(m);
  add_computations(m);
}

}  // namespace dimple
