// What the studies beside __init__.py need of the library: options as numbers, and fields of a run's files.

#include <fmt/format.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <map>

#include "apps/run/config.hpp"
#include "io/error.hpp"
#include "io/vtk_files.hpp"

namespace py = pybind11;

namespace dimple {
namespace {

// What the options amount to: key -> value, in the unit of the key. Throws UsageError.
py::dict values_of(const std::map<std::string, std::string>& given) {
  Config config;
  for (const auto& [key, text] : given) set_option(config, key, text, key);
  resolve_material(config);
  py::dict values;
  for (const Option& option : options_of(config))
    values[py::str(option.key)] =
        std::visit([](const auto* value) { return py::cast(*value); }, option.value);
  return values;
}

// (points, components), of a .vtu file.
py::array_t<double> point_field(const std::string& file, const std::string& name) {
  const PointFile points = read_vtu(file);
  const Field* field = points.find(name);
  if (!field)
    throw InputError({.fact = fmt::format("there is no field {}", name),
                      .where = file,
                      .why = "another version wrote the file",
                      .remedy = "run it again"});
  const Eigen::MatrixXd& values = field->values;
  return py::array_t<double>({values.cols(), values.rows()}, values.data());  // a copy
}

}  // namespace

void add_studies(py::module_& m) {
  m.def("option_values", &values_of);
  m.def("point_field", &point_field);
}

}  // namespace dimple
