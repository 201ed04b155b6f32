#pragma once

// Common parts of the module: views of arrays, the interpreter's lock, Ctrl-C and errors.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "apps/python/in_memory.hpp"
#include "apps/scene/description.hpp"
#include "io/error.hpp"
#include "io/stop.hpp"

namespace py = pybind11;

namespace dimple {

/// Python string of a text; file names need not be UTF-8.
py::object words(const std::string& text);
/// Message of the program with its options named as in Python: `nodes=` for `--nodes`.
py::object in_keywords(const std::string& text);
py::list in_keywords(const std::vector<std::string>& texts);
/// Python dictionary of JSON.
py::object dictionary(const std::string& json);

/// Counter of running computations: a request to stop applies to all of them and is reset when the last has
/// ended.
class ActiveCall {
 public:
  ActiveCall();
  ~ActiveCall();
  ActiveCall(const ActiveCall&) = delete;
  ActiveCall& operator=(const ActiveCall&) = delete;
};

/// Runs work in its own thread, without the interpreter's lock. Meanwhile this thread handles signals, as
/// only Python can: an exception of the handler (by default KeyboardInterrupt) stops the work and is raised
/// then.
template <class Work>
auto computing(const Work& work) {
  const ActiveCall counted;
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
  } catch (...) {  // caused by the stop
  }
  if (raised->matches(PyExc_KeyboardInterrupt)) throw Stopped(StopReason::interrupted);
  throw *raised;
}

/// Passes a message to the Python logger "pydimple".
void log(RunObserver::Line kind, const std::string& text);

using Shape = std::vector<py::ssize_t>;

/// Read-only array without a copy; `owner` lives as long as the array.
template <class T>
py::array view(const py::object& owner, const T* first, const Shape& shape, const Shape& strides = {}) {
  py::array array(py::dtype::of<T>(), shape, strides, first, owner);
  array.attr("setflags")(py::arg("write") = false);
  return array;
}

/// Array [N, 3] of the columns of a matrix [3xN].
template <class T>
py::array view(const py::object& owner, const Eigen::Matrix<T, 3, Eigen::Dynamic>& rows) {
  return view(owner, rows.data(), {rows.cols(), 3});
}

/// Array of a vector.
template <class T, int n>
py::array view(const py::object& owner, const Eigen::Matrix<T, n, 1>& numbers) {
  return view(owner, numbers.data(), {numbers.size()});
}
template <class T>
py::array view(const py::object& owner, const std::vector<T>& numbers) {
  return view(owner, numbers.data(), {static_cast<py::ssize_t>(numbers.size())});
}

/// Array that owns the numbers.
template <class Numbers>
py::array_t<double> handed_over(Numbers&& numbers, Shape shape) {
  auto* kept = new std::decay_t<Numbers>(std::forward<Numbers>(numbers));
  const py::capsule owner(kept, [](void* it) { delete static_cast<std::decay_t<Numbers>*>(it); });
  return py::array_t<double>(std::move(shape), kept->data(), owner);
}
py::array_t<double> handed_over(Points&& rows);

/// Bytes for a pickle, and bytes of the first of `parts` in a pickle's state. Throws InputError.
py::bytes as_object(const std::vector<std::uint8_t>& bytes);
std::vector<std::uint8_t> bytes_in(const py::tuple& state, std::size_t parts);

/// File of options or "", then key, text and source of each option, from the Python package.
struct Settings {
  std::string config_file;
  std::vector<std::array<std::string, 3>> given;

  Settings combined_with(const Settings& further) const;
  Description described() const;
  py::dict values() const;  ///< resulting values by key, in the unit of the key
};

/// Moves the model out of a result.
ModelHolder take_model(Result& result, const ModelChoices& choices);

/// Throws UsageError: the model was made for a contacting tool and has no nodes of a bonded patch.
void require_patch_nodes(const ModelInMemory& built, const char* where);

// Functions that define the Python interface, documented in numpydoc's style with shape, type, unit and
// meaning.
void add_errors();
void add_inputs(py::module_& m);   ///< options, LabelImage, Settings
void add_model(py::module_& m);    ///< Model, Organ, and their makers
void add_result(py::module_& m);   ///< Result and its makers
void add_session(py::module_& m);  ///< Session

}  // namespace dimple
