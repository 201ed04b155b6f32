#pragma once

// What the parts of the module share: views of arrays, the interpreter's lock, Ctrl-C and errors.

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

/// A string of Python. File names need not be UTF-8.
py::object words(const std::string& text);
/// What the program says to its command line, as it is said in Python: `--nodes` is `nodes=`.
py::object in_keywords(const std::string& text);
py::list in_keywords(const std::vector<std::string>& texts);
/// JSON as a dictionary of Python.
py::object dictionary(const std::string& json);

/// One of the computations under way: a request to stop is to all of them, and done with when the last has
/// ended.
class UnderWay {
 public:
  UnderWay();
  ~UnderWay();
  UnderWay(const UnderWay&) = delete;
  UnderWay& operator=(const UnderWay&) = delete;
};

/// Does work in a thread of its own, without the interpreter's lock. This thread hears signals meanwhile, as
/// Python alone can: what the handler raises, KeyboardInterrupt by default, ends the work and is raised then.
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

/// The program's lines go to Python's logging, as those of "pydimple".
void log(RunObserver::Line kind, const std::string& text);

using Shape = std::vector<py::ssize_t>;

/// Numbers where they are: read-only, and `owner` lives as long as the array.
template <class T>
py::array view(const py::object& owner, const T* first, const Shape& shape, const Shape& strides = {}) {
  py::array array(py::dtype::of<T>(), shape, strides, first, owner);
  array.attr("setflags")(py::arg("write") = false);
  return array;
}

/// Vectors side by side, [3xN], are the rows of [N, 3].
template <class T>
py::array view(const py::object& owner, const Eigen::Matrix<T, 3, Eigen::Dynamic>& rows) {
  return view(owner, rows.data(), {rows.cols(), 3});
}

/// The numbers of a vector.
template <class T, int n>
py::array view(const py::object& owner, const Eigen::Matrix<T, n, 1>& numbers) {
  return view(owner, numbers.data(), {numbers.size()});
}
template <class T>
py::array view(const py::object& owner, const std::vector<T>& numbers) {
  return view(owner, numbers.data(), {static_cast<py::ssize_t>(numbers.size())});
}

/// The array becomes the owner.
template <class Numbers>
py::array_t<double> handed_over(Numbers&& numbers, Shape shape) {
  auto* kept = new std::decay_t<Numbers>(std::forward<Numbers>(numbers));
  const py::capsule owner(kept, [](void* it) { delete static_cast<std::decay_t<Numbers>*>(it); });
  return py::array_t<double>(std::move(shape), kept->data(), owner);
}
py::array_t<double> handed_over(Points&& rows);

/// What a pickle holds, and back: the first of `parts` in its state. Throws InputError.
py::bytes as_object(const std::vector<std::uint8_t>& bytes);
std::vector<std::uint8_t> bytes_in(const py::tuple& state, std::size_t parts);

/// A file of options or "", then key, text and where it was given, as the package hands them over.
struct Settings {
  std::string config_file;
  std::vector<std::array<std::string, 3>> given;

  Settings beside(const Settings& further) const;
  Description described() const;
  py::dict values() const;  ///< what they amount to: key -> value, in the unit of the key
};

/// Moves the model out of a result and leaves the rest.
ModelHolder take_model(Result& result, const ModelChoices& choices);

/// Throws UsageError: the model was made for a tool that touches and has no nodes that a circle moves.
void require_nodes_of_circle(const ModelInMemory& built, const char* where);

// What Python sees: documented in numpydoc's style, with shape, type, unit and meaning.
void add_errors();
void add_inputs(py::module_& m);   ///< options, LabelImage, Settings
void add_model(py::module_& m);    ///< Model, Organ, and what makes them
void add_result(py::module_& m);   ///< Result, and what makes it
void add_session(py::module_& m);  ///< Session

}  // namespace dimple
