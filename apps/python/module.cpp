// Extension pydimple._core: the library for the package in pydimple/. Keywords, images and their affines are
// handled in __init__.py.

#include <tbb/global_control.h>

#include "apps/python/binding.hpp"
#include "apps/run/live.hpp"
#include "apps/run/words.hpp"
#include "io/digits.hpp"
#include "solver/session.hpp"

namespace dimple {
namespace {

std::optional<tbb::global_control> thread_limit;

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
  m.def("limit_threads", [](std::optional<int> count) {
    thread_limit.reset();
    if (count)
      thread_limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(*count));
  });
}

}  // namespace

PYBIND11_MODULE(_core, m) {
  add_errors();
  // In this order, as a signature can name only registered classes.
  add_words(m);
  add_inputs(m);
  add_model(m);
  add_result(m);
  add_session(m);
}

}  // namespace dimple
