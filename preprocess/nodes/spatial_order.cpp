#include "preprocess/nodes/spatial_order.hpp"

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Spatial_sort_traits_adapter_3.h>
#include <CGAL/hilbert_sort.h>
#include <CGAL/property_map.h>

#include <cmath>
#include <numeric>

namespace dimple {

std::vector<Index> spatial_order(const Points& places) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  std::vector<Kernel::Point_3> point;
  // Points of a grid have equal coordinates except for rounding: rounded to a nanometre, they are exact ties.
  const auto rounded = [](double mm) { return std::round(mm * 1e6) / 1e6; };
  for (const auto& x : places.colwise()) point.emplace_back(rounded(x.x()), rounded(x.y()), rounded(x.z()));
  std::vector<std::size_t> order(point.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  using Traits =
      CGAL::Spatial_sort_traits_adapter_3<Kernel, CGAL::Pointer_property_map<Kernel::Point_3>::type>;
  CGAL::hilbert_sort(order.begin(), order.end(), Traits(CGAL::make_property_map(point)),
                     CGAL::Hilbert_sort_median_policy());
  return {order.begin(), order.end()};
}

}  // namespace dimple
