#include "apps/python/binding.hpp"

#include <map>
#include <mutex>

namespace dimple {
namespace {

const char* class_of(ExitCode code) {
  static const std::map<ExitCode, const char*> classes = {
      {ExitCode::usage, "UsageError"}, {ExitCode::input, "InputError"},   {ExitCode::model, "ModelError"},
      {ExitCode::solve, "SolveError"}, {ExitCode::output, "OutputError"}, {ExitCode::interrupted, "Stopped"}};
  const auto found = classes.find(code);
  return found == classes.end() ? "Error" : found->second;
}

void raise(const Error& error) {
  const Report& r = error.report;
  const py::object raised = py::module_::import("pydimple._errors")
                                .attr("error_of")(class_of(error.code), words(r.fact), words(r.where),
                                                  words(r.why), words(r.remedy), words(r.code));
  PyErr_SetObject(py::type::of(raised).ptr(), raised.ptr());
}

std::mutex active_calls_mutex;
int active_calls = 0;

}  // namespace

py::object words(const std::string& text) {
  return py::reinterpret_steal<py::object>(
      PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "replace"));
}

py::object in_keywords(const std::string& text) {
  return py::module_::import("pydimple._errors").attr("in_keywords")(words(text));
}
py::list in_keywords(const std::vector<std::string>& texts) {
  py::list said;
  for (const std::string& text : texts) said.append(in_keywords(text));
  return said;
}

py::object dictionary(const std::string& json) {
  return py::module_::import("json").attr("loads")(json);
}

ActiveCall::ActiveCall() {
  const std::lock_guard lock(active_calls_mutex);
  ++active_calls;
}
ActiveCall::~ActiveCall() {
  const std::lock_guard lock(active_calls_mutex);
  if (--active_calls == 0) forget_stop();
}

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

py::array_t<double> handed_over(Points&& rows) {
  const Index count = rows.cols();
  return handed_over(std::move(rows), {count, 3});
}

py::bytes as_object(const std::vector<std::uint8_t>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}
std::vector<std::uint8_t> bytes_in(const py::tuple& state, std::size_t parts) {
  if (state.size() != parts || !py::isinstance<py::bytes>(state[0]))
    throw InputError({.fact = "a pickled object cannot be read",
                      .where = "pickle",
                      .why = "its state was not made by this module",
                      .remedy = "compute it again, or read it with the version that it was pickled by"});
  const auto bytes = state[0].cast<std::string_view>();
  return {bytes.begin(), bytes.end()};
}

void add_errors() {
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const Error& error) {
      raise(error);
    }
  });
}

}  // namespace dimple
